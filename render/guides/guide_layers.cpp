#include "render/guides/guide_layers.h"

#include <cstddef>
#include <string>

namespace brume {
namespace {

Plane* add_plane(Layers& frame, const std::string& name, char channel) {
  return &frame.add("guide." + name + "." + channel);
}

size_t offset_of(const GroupSums& sums, const double& member) {
  return static_cast<size_t>(&member - reinterpret_cast<const double*>(&sums));
}

}  // namespace

GuideLayers::GuideLayers(Layers& frame, const std::vector<SolvedLight>& lights, GuideColour colour,
                         const Contents& contents)
    : lights_(lights), colour_(colour), contents_(contents), surface_(lights.size()) {
  const char letter = colour == kGrey ? 'Y' : "RGB"[colour];
  const bool first = colour == kGrey || colour == 0;
  opacity_ = add_plane(frame, "opacity", letter);
  if (first)
    once_ = {add_plane(frame, "depth", 'Z'),    add_plane(frame, "spread", 'Z'),   add_plane(frame, "gradient", 'X'),
             add_plane(frame, "gradient", 'Y'), add_plane(frame, "gradient", 'Z'), add_plane(frame, "density", 'Y')};
  for (size_t g = 0; g < lights.size(); ++g) add_group(frame, g, lights[g].group, letter);
  for (size_t c = 0; c < 3; ++c) {
    if (colour != kGrey && colour != static_cast<int>(c)) continue;
    const auto add = [&](Rgb& rgb, const std::string& name) { rgb[c] = add_plane(frame, name, "RGB"[c]); };
    if (contents.emission) add(emission_, "emission");
    if (contents.emission) add(emission_once_, "single.emission");
    if (contents.emission || contents.surfaces) add(behind_, "multiple.behind");
    add(background_, "background");
    add(direct_, "predicted_direct");
    add(indirect_, "predicted_indirect");
    if (!contents.surfaces) continue;
    add(surface_albedo_, "surface_albedo");
    add(surface_indirect_, "surface.indirect");
    for (size_t g = 0; g < lights.size(); ++g) {
      const LightGroup& group = lights[g].group;
      if (group.from_surfaces()) continue;
      if (group.channel == kGrey || group.channel == static_cast<int>(c)) add(surface_[g], "surface." + group.name);
    }
    if (!contents.mirrors) continue;
    add(mirrored_, "surface.mirrored");
    add(mirrored_indirect_, "surface.mirrored_indirect");
  }
  if (!contents.surfaces || !first) return;
  for (size_t a = 0; a < 3; ++a) {
    normal_[a] = add_plane(frame, "normal", "XYZ"[a]);
    material_[a] = add_plane(frame, "surface_material", "RGB"[a]);
  }
  surface_depth_ = add_plane(frame, "surface_depth", 'Z');
}

void GuideLayers::add_group(Layers& frame, size_t group, const LightGroup& lights, char letter) {
  const GroupSums sums;
  const char channel = lights.channel == kGrey ? letter : "RGB"[lights.channel];
  const auto add = [&](const std::string& name, const double& member) {
    numbers_.push_back({group, offset_of(sums, member), add_plane(frame, name, channel)});
  };
  const std::string multiple = "multiple." + lights.name + "_";
  add(lights.from_surfaces() ? multiple + "once" : "single." + lights.name, sums.single);
  if (lights.sharp()) {
    add(multiple + "half", sums.octave[0]);
    add(multiple + "quarter", sums.octave[1]);
    add(multiple + "eighth", sums.octave[2]);
  }
  if (lights.sharp() || lights.sky()) {
    add(multiple + "soft2", sums.soft[0]);
    add(multiple + "soft4", sums.soft[1]);
  }
  if (lights.sharp()) {
    add(multiple + "soft8", sums.soft[2]);
    add(multiple + "soft16", sums.soft[3]);
  }
  add(multiple + "forward", sums.forward);
  constexpr std::array<const char*, 6> kOrderNames = {"order2", "order3", "order4", "order6", "order9", "tail"};
  for (size_t order = 0; order < kOrderNames.size(); ++order) add(multiple + kOrderNames[order], sums.orders[order]);
  add(multiple + "flux", sums.flux);
  add(multiple + "tail_half", sums.tail[0]);
  add(multiple + "tail_quarter", sums.tail[1]);
  add(multiple + "tail_eighth", sums.tail[2]);
}

// The whole of direct light as guides have it: a filter starts from it.
vec3 GuideLayers::predicted_direct(const GuideSums& sums) const {
  vec3 light = sums.background + sums.emission + sums.emission_once + vec3(sums.mirrored) + vec3(sums.tinted_direct);
  for (size_t k = 0; k < sums.groups.size(); ++k) {
    const LightGroup& group = lights_[k].group;
    if (group.from_surfaces()) continue;
    light += sums.surface[k];
    if (!contents_.mixed_tints) light += vec3(contents_.tint.once() * group.colour_in(colour_) * sums.groups[k].single);
  }
  return light;
}

vec3 GuideLayers::predicted_indirect(const GuideSums& sums) const {
  vec3 light = sums.indirect + vec3(sums.mirrored_indirect) + sums.behind + vec3(sums.tinted_indirect);
  for (size_t k = 0; k < sums.groups.size() && !contents_.mixed_tints; ++k) {
    const LightGroup& group = lights_[k].group;
    const GroupSums& own = sums.groups[k];
    const auto add = [&](const dvec3& tint, double value) { light += vec3(tint * group.colour_in(colour_) * value); };
    add(contents_.tint.forward(), own.forward);
    if (group.from_surfaces()) add(contents_.tint.once(), own.single);
    for (size_t order = 0; order < own.orders.size(); ++order) add(contents_.tint.of_guide(order), own.orders[order]);
  }
  return light;
}

void GuideLayers::store(int x, int y, const GuideSums& sums, double share) const {
  const auto put = [&](Plane* plane, double value) {
    if (plane) (*plane)(x, y) = static_cast<float>(share * value);
  };
  put(opacity_, sums.opacity);
  const double once[] = {sums.depth, sums.spread, sums.gradient.x, sums.gradient.y, sums.gradient.z, sums.density};
  for (size_t i = 0; i < once_.size(); ++i) put(once_[i], once[i]);
  for (const Number& n : numbers_) put(n.plane, reinterpret_cast<const double*>(&sums.groups[n.group])[n.offset]);
  put(surface_depth_, sums.surface_depth);
  const auto put_rgb = [&](const Rgb& to, const vec3& value) {
    for (int c = 0; c < 3; ++c)
      if (Plane* const plane = to[static_cast<size_t>(c)]) (*plane)(x, y) = static_cast<float>(share) * value[c];
  };
  put_rgb(emission_, sums.emission);
  put_rgb(emission_once_, sums.emission_once);
  put_rgb(behind_, sums.behind);
  put_rgb(background_, sums.background);
  put_rgb(direct_, predicted_direct(sums));
  put_rgb(indirect_, predicted_indirect(sums));
  put_rgb(surface_albedo_, sums.surface_albedo);
  put_rgb(surface_indirect_, sums.indirect);
  put_rgb(normal_, sums.normal);
  put_rgb(material_, sums.material);
  put_rgb(mirrored_, sums.mirrored);
  put_rgb(mirrored_indirect_, sums.mirrored_indirect);
  for (size_t g = 0; g < surface_.size(); ++g) put_rgb(surface_[g], sums.surface[g]);
}

}  // namespace brume
