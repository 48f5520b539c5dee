#include "render/guides/guide_layers.h"

#include <string>

#include "image/light_layers.h"

namespace brume {
namespace {

using Contents = GuideLayers::Contents;  // of scenes that have a layer
constexpr auto kAll = [](const Contents&) { return true; };
constexpr auto kEmission = [](const Contents& c) { return c.emission; };
constexpr auto kEmissionOrSurfaces = [](const Contents& c) { return c.emission || c.surfaces; };
constexpr auto kSurfaces = [](const Contents& c) { return c.surfaces; };
constexpr auto kMirrors = [](const Contents& c) { return c.mirrors; };

struct Layer {
  const GuideName& name;
  bool (*of)(const Contents&);
  dvec3 (*value)(const GuideSums&);  // of layers with one channel, the first number
  bool once = false;                 // for all colours
};
using Sums = GuideSums;
constexpr Layer kLayers[] = {
    {guide_named("guide.opacity"), kAll, [](const Sums& s) { return dvec3(s.opacity); }},
    {guide_named("guide.depth"), kAll, [](const Sums& s) { return dvec3(s.depth); }},
    {guide_named("guide.spread"), kAll, [](const Sums& s) { return dvec3(s.spread); }},
    {guide_named("guide.gradient"), kAll, [](const Sums& s) { return s.gradient; }},
    {guide_named("guide.density"), kAll, [](const Sums& s) { return dvec3(s.density); }, /*once=*/true},
    {guide_named("guide.emission"), kEmission, [](const Sums& s) { return dvec3(s.emission); }},
    {guide_named("guide.single.emission"), kEmission, [](const Sums& s) { return dvec3(s.emission_once); }},
    {guide_named("guide.multiple.behind"), kEmissionOrSurfaces, [](const Sums& s) { return dvec3(s.behind); }},
    {guide_named("guide.background"), kAll, [](const Sums& s) { return dvec3(s.background); }},
    {guide_named("guide.surface_albedo"), kSurfaces, [](const Sums& s) { return dvec3(s.surface_albedo); }},
    {guide_named("guide.surface.indirect"), kSurfaces, [](const Sums& s) { return dvec3(s.indirect); }},
    {guide_named("guide.surface.mirrored"), kMirrors, [](const Sums& s) { return s.mirrored; }},
    {guide_named("guide.surface.mirrored_indirect"), kMirrors, [](const Sums& s) { return s.mirrored_indirect; }},
    {guide_named("guide.normal"), kSurfaces, [](const Sums& s) { return dvec3(s.normal); }},
    {guide_named("guide.surface_material"), kSurfaces, [](const Sums& s) { return dvec3(s.material); }, true},
    {guide_named("guide.surface_depth"), kSurfaces, [](const Sums& s) { return dvec3(s.surface_depth); }},
};

struct GroupLayer {
  const GuideName& name;
  bool (*of)(const GuideLight&);
  double (*value)(const GroupSums&);
};
constexpr auto kAny = [](const GuideLight&) { return true; };
constexpr auto kSharp = [](const GuideLight& g) { return g.sharp() != nullptr; };
constexpr auto kSharpOrSky = [](const GuideLight& g) { return g.sharp() || g.sky(); };
constexpr auto kFromSurfaces = [](const GuideLight& g) { return g.from_surfaces(); };
constexpr auto kOthers = [](const GuideLight& g) { return !g.from_surfaces(); };
constexpr GroupLayer kGroupLayers[] = {
    {guide_named("guide.single.LIGHT"), kOthers, [](const GroupSums& s) { return s.single; }},
    {guide_named("guide.multiple.LIGHT_once"), kFromSurfaces, [](const GroupSums& s) { return s.single; }},
    {guide_named("guide.multiple.LIGHT_half"), kSharp, [](const GroupSums& s) { return s.octave[0]; }},
    {guide_named("guide.multiple.LIGHT_quarter"), kSharp, [](const GroupSums& s) { return s.octave[1]; }},
    {guide_named("guide.multiple.LIGHT_eighth"), kSharp, [](const GroupSums& s) { return s.octave[2]; }},
    {guide_named("guide.multiple.LIGHT_soft2"), kSharpOrSky, [](const GroupSums& s) { return s.soft[0]; }},
    {guide_named("guide.multiple.LIGHT_soft4"), kSharpOrSky, [](const GroupSums& s) { return s.soft[1]; }},
    {guide_named("guide.multiple.LIGHT_soft8"), kSharp, [](const GroupSums& s) { return s.soft[2]; }},
    {guide_named("guide.multiple.LIGHT_soft16"), kSharp, [](const GroupSums& s) { return s.soft[3]; }},
    {guide_named("guide.multiple.LIGHT_forward"), kAny, [](const GroupSums& s) { return s.forward; }},
    {guide_named("guide.multiple.LIGHT_order2"), kAny, [](const GroupSums& s) { return s.orders[0]; }},
    {guide_named("guide.multiple.LIGHT_order3"), kAny, [](const GroupSums& s) { return s.orders[1]; }},
    {guide_named("guide.multiple.LIGHT_order4"), kAny, [](const GroupSums& s) { return s.orders[2]; }},
    {guide_named("guide.multiple.LIGHT_order6"), kAny, [](const GroupSums& s) { return s.orders[3]; }},
    {guide_named("guide.multiple.LIGHT_order9"), kAny, [](const GroupSums& s) { return s.orders[4]; }},
    {guide_named("guide.multiple.LIGHT_tail"), kAny, [](const GroupSums& s) { return s.orders[5]; }},
    {guide_named("guide.multiple.LIGHT_flux"), kAny, [](const GroupSums& s) { return s.flux; }},
    {guide_named("guide.multiple.LIGHT_tail_half"), kAny, [](const GroupSums& s) { return s.tail[0]; }},
    {guide_named("guide.multiple.LIGHT_tail_quarter"), kAny, [](const GroupSums& s) { return s.tail[1]; }},
    {guide_named("guide.multiple.LIGHT_tail_eighth"), kAny, [](const GroupSums& s) { return s.tail[2]; }},
};

}  // namespace

GuideLayers::Planes GuideLayers::add(Layers& frame, const GuideName& name, const GuideLight* light, bool once) const {
  constexpr std::string_view kLight = "LIGHT";
  const bool first = colour_ == kGrey || colour_ == 0;
  std::string layer(name.name);
  if (light) layer.replace(layer.find(kLight), kLight.size(), light->layer_name());
  const GuideColour own = light ? light->channel : kGrey;  // the only one that the light has
  Planes planes{};
  if (name.channels == "Y" && !once) {
    const GuideColour letter = own == kGrey ? colour_ : own;
    planes[0] = &frame.add(layer + "." + (letter == kGrey ? 'Y' : "RGB"[letter]));
    return planes;
  }
  for (size_t c = 0; c < name.channels.size(); ++c) {
    const auto is = [&](GuideColour colour) { return colour == kGrey || colour == static_cast<int>(c); };
    const bool wanted = name.channels == "RGB" && !once ? is(colour_) && is(own) : first;
    if (wanted) planes[c] = &frame.add(layer + "." + name.channels[c]);
  }
  return planes;
}

GuideLayers::GuideLayers(Layers& frame, const std::vector<std::unique_ptr<GuideLight>>& lights, GuideColour colour,
                         const Contents& contents)
    : lights_(lights), colour_(colour), contents_(contents) {
  for (const Layer& layer : kLayers)
    if (layer.of(contents)) layers_.push_back({add(frame, layer.name, nullptr, layer.once), layer.value});
  direct_ = add(frame, guide_named("guide.predicted_direct"));
  indirect_ = add(frame, guide_named("guide.predicted_indirect"));
  // Light of media of unlike tints is known of all lights together alone.
  for (size_t g = 0; g < contents.light_groups.size() && !contents.mixed_tints; ++g) {
    const auto add_predicted = [&](const char* part) {
      Planes planes{};
      for (size_t c = 0; c < 3; ++c)
        if (colour == kGrey || colour == static_cast<int>(c))
          planes[c] =
              &frame.add(predicted_light_layer(contents.light_groups[g], part) + "." + layer::beauty.channels[c]);
      return planes;
    };
    predicted_.push_back({add_predicted("direct"), add_predicted("indirect")});
  }
  for (size_t g = 0; g < lights.size(); ++g) {
    const GuideLight& group = *lights[g];
    for (const GroupLayer& layer : kGroupLayers)
      if (layer.of(group)) group_layers_.push_back({add(frame, layer.name, &group), layer.value, g});
    Planes& surface = surface_.emplace_back();
    if (contents.surfaces && !group.from_surfaces()) surface = add(frame, guide_named("guide.surface.LIGHT"), &group);
  }
}

void GuideLayers::add_direct_of(size_t k, const GuideSums& sums, vec3& light) const {
  const GuideLight& group = *lights_[k];
  if (group.from_surfaces()) return;
  light += sums.surface[k];
  if (!contents_.mixed_tints) light += vec3(contents_.tint.once() * group.colour_in(colour_) * sums.groups[k].single);
}

void GuideLayers::add_indirect_of(size_t k, const GuideSums& sums, vec3& light) const {
  const GuideLight& group = *lights_[k];
  const GroupSums& own = sums.groups[k];
  const auto add = [&](const dvec3& tint, double value) { light += vec3(tint * group.colour_in(colour_) * value); };
  add(contents_.tint.forward(), own.forward);
  if (group.from_surfaces()) add(contents_.tint.once(), own.single);
  for (size_t order = 0; order < own.orders.size(); ++order) add(contents_.tint.of_guide(order), own.orders[order]);
}

// The whole of direct light as guides have it: a filter starts from it.
dvec3 GuideLayers::predicted_direct(const GuideSums& sums) const {
  vec3 light = sums.background + sums.emission + sums.emission_once + vec3(sums.mirrored) + vec3(sums.tinted_direct);
  for (size_t k = 0; k < sums.groups.size(); ++k) add_direct_of(k, sums, light);
  return dvec3(light);
}

dvec3 GuideLayers::predicted_indirect(const GuideSums& sums) const {
  vec3 light = sums.indirect + vec3(sums.mirrored_indirect) + sums.behind + vec3(sums.tinted_indirect);
  for (size_t k = 0; k < sums.groups.size() && !contents_.mixed_tints; ++k) add_indirect_of(k, sums, light);
  return dvec3(light);
}

dvec3 GuideLayers::predicted_direct_of(const std::string& group, const GuideSums& sums) const {
  vec3 light(0);
  if (contents_.group_of_background == group) light += sums.background;
  for (size_t k = 0; k < sums.groups.size(); ++k) {
    if (lights_[k]->light_group != group) continue;
    add_direct_of(k, sums, light);
    if (lights_[k]->name == "glow") light += sums.emission + sums.emission_once;
  }
  return dvec3(light);
}

dvec3 GuideLayers::predicted_indirect_of(size_t group, const GuideSums& sums) const {
  vec3 light(0);
  const bool surfaces = group < sums.from_surfaces.size();
  if (surfaces) light += sums.from_surfaces[group];
  for (size_t k = 0; k < sums.groups.size(); ++k) {
    if (lights_[k]->group_number == static_cast<int>(group)) add_indirect_of(k, sums, light);
    if (!surfaces || !lights_[k]->from_surfaces()) continue;
    vec3 all(0);
    add_indirect_of(k, sums, all);
    light += sums.shares[group] * all;
  }
  return dvec3(light);
}

void GuideLayers::store(int x, int y, const GuideSums& sums, double share) const {
  const auto put = [&](const Planes& planes, const dvec3& value) {
    for (size_t c = 0; c < 3; ++c)
      if (planes[c]) (*planes[c])(x, y) = static_cast<float>(share * value[static_cast<int>(c)]);
  };
  for (const auto& layer : layers_) put(layer.planes, layer.value(sums));
  for (const auto& layer : group_layers_)
    (*layer.planes[0])(x, y) = static_cast<float>(share * layer.value(sums.groups[layer.group]));
  for (size_t g = 0; g < surface_.size(); ++g) put(surface_[g], dvec3(sums.surface[g]));
  put(direct_, predicted_direct(sums));
  put(indirect_, predicted_indirect(sums));
  for (size_t g = 0; g < predicted_.size(); ++g) {
    put(predicted_[g][0], predicted_direct_of(contents_.light_groups[g], sums));
    put(predicted_[g][1], predicted_indirect_of(g, sums));
  }
}

}  // namespace brume
