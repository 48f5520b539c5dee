#include "render/transport/path_sample.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <type_traits>

#include "base/error.h"
#include "base/text.h"
#include "image/light_layers.h"

namespace brume {

namespace {

constexpr const char *kGuides = "guides", *kDepths = "depths", *kMotion = "motion", *kLightParts = "light_parts",
                     *kMattes = "cryptomatte", *kMatteObjects = "cryptomatte_object",
                     *kMatteMaterials = "cryptomatte_material";

}

static_assert(std::is_standard_layout_v<PathSample> && sizeof(PathSample) % sizeof(double) == 0);

const std::vector<RecordedLayer>& recordable_layers() {
#define BRUME_LAYER(member) \
  { layer::member, offsetof(PathSample, member) / sizeof(double) }
  static const std::vector<RecordedLayer> layers = {BRUME_LAYER(direct),
                                                    BRUME_LAYER(indirect),
                                                    BRUME_LAYER(background),
                                                    BRUME_LAYER(emission),
                                                    BRUME_LAYER(single),
                                                    BRUME_LAYER(surface),
                                                    BRUME_LAYER(surface_emission),
                                                    BRUME_LAYER(volume_indirect),
                                                    BRUME_LAYER(surface_indirect),
                                                    BRUME_LAYER(gradient),
                                                    BRUME_LAYER(gradient_first_scatter),
                                                    BRUME_LAYER(coverage),
                                                    BRUME_LAYER(gradient_transmittance_weighted),
                                                    BRUME_LAYER(transmittance),
                                                    BRUME_LAYER(scatter_depth),
                                                    BRUME_LAYER(scatter_density),
                                                    BRUME_LAYER(scatter_position),
                                                    BRUME_LAYER(scatter_share),
                                                    BRUME_LAYER(optical_depth),
                                                    BRUME_LAYER(albedo),
                                                    BRUME_LAYER(surface_albedo),
                                                    BRUME_LAYER(surface_share),
                                                    BRUME_LAYER(normal),
                                                    BRUME_LAYER(depth),
                                                    BRUME_LAYER(position),
                                                    BRUME_LAYER(flash),
                                                    BRUME_LAYER(catcher),
                                                    BRUME_LAYER(catcher_unshadowed)};
#undef BRUME_LAYER
  return layers;
}

LayerRequest LayerRequest::of(const std::vector<std::string>& names, bool statistics, bool buckets) {
  std::vector<std::string> known;
  for (const RecordedLayer& l : recordable_layers()) known.emplace_back(l.name.name);
  LayerRequest request{{}, statistics, buckets};
  if (names == std::vector<std::string>{"all"}) {
    request.names = known;
    request.guides = request.depths = request.motion = request.light_parts = true;
    request.matte_objects = request.matte_materials = true;
    return request;
  }
  for (const char* several : {kGuides, kDepths, kMotion, kLightParts, kMattes, kMatteObjects, kMatteMaterials})
    known.emplace_back(several);
  known.emplace_back(kLightAimed);
  for (const std::string& name : names) {
    if (name.starts_with(kLightPrefix)) {
      request.light_groups.push_back(name.substr(kLightPrefix.size()));
      continue;
    }
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw InputError(fmt::format("no layer '{}' to record{}", name, suggestion(name, known)));
    if (name == kGuides)
      request.guides = true;
    else if (name == kDepths)
      request.depths = true;
    else if (name == kMotion)
      request.motion = true;
    else if (name == kLightParts)
      request.light_parts = true;
    else if (name == kMattes)
      request.matte_objects = request.matte_materials = true;
    else if (name == kMatteObjects)
      request.matte_objects = true;
    else if (name == kMatteMaterials)
      request.matte_materials = true;
    else
      request.names.push_back(name);
  }
  return request;
}

std::vector<std::string> LayerRequest::text() const {
  std::vector<std::string> all = names;
  if (guides) all.emplace_back(kGuides);
  if (depths) all.emplace_back(kDepths);
  if (motion) all.emplace_back(kMotion);
  if (light_parts) all.emplace_back(kLightParts);
  if (matte_objects) all.emplace_back(matte_materials ? kMattes : kMatteObjects);
  if (matte_materials && !matte_objects) all.emplace_back(kMatteMaterials);
  for (const std::string& group : light_groups) all.push_back(light_layer(group));
  return all;
}

bool LayerRequest::has(const LayerName& layer) const {
  return std::find(names.begin(), names.end(), layer.name) != names.end();
}

std::vector<LayerRequest::GroupLayer> LayerRequest::group_layers() const {
  std::vector<GroupLayer> layers;
  const bool aimed = std::find(names.begin(), names.end(), kLightAimed) != names.end();
  for (size_t g = 0; g < light_groups.size(); ++g) {
    const std::string name = light_layer(light_groups[g]);
    layers.push_back({name, 9 * g});
    if (aimed) layers.push_back({aimed_light_layer(light_groups[g]), 9 * light_groups.size() + 3 * g});
    if (!light_parts) continue;
    layers.push_back({name + ".direct", 9 * g + 3});
    layers.push_back({name + ".indirect", 9 * g + 6});
  }
  return layers;
}

}  // namespace brume
