#include "filters/run/clean_lights.h"

#include <list>
#include <set>

#include "filters/inputs/guide_layers.h"
#include "filters/run/add_up.h"
#include "image/light_layers.h"

namespace brume {
namespace {

constexpr std::string_view kStatistics[] = {"", statistic::mean_variance, statistic::half_a, statistic::half_b};

Plane view_of(const Plane& plane) {
  return Plane::view(plane, 0, 0, plane.width(), plane.height());
}

/// The frame as the filter is given it to clean one group: its light is the beauty, its predictions are those of the
/// guides, and guides of other groups are not there. Planes are views.
Layers frame_of_group(const Layers& frame, const std::string& group) {
  Layers own = frame.without_channels();
  std::set<std::string> left_out;
  const auto leave_out = [&](const LayerName& l) {
    for (const std::string_view which : kStatistics)
      for (const std::string& channel : l.channel_names(which)) left_out.insert(channel);
    for (const std::string_view which : statistic::buckets)
      for (const std::string& channel : l.channel_names(which)) left_out.insert(channel);
  };
  for (const LayerName& l : {layer::beauty, layer::direct, layer::indirect, layer::noisy, layer::clean_error,
                             guide_layer::predicted_direct, guide_layer::predicted_indirect})
    leave_out(l);
  for (const auto& [name, plane] : frame.channels())
    if (!left_out.contains(name) && !name.starts_with(kLightPrefix) &&
        (!is_guide(name) || may_guide_light(name, group)))
      own.set(name, view_of(plane));
  for (const auto& [name, plane] : frame.stored())
    if (may_guide_light(name, group)) own.set_stored(name, plane);
  const auto take = [&](const std::string& from, const LayerName& to, std::string_view which) {
    const LayerName source{from, to.channels, ""};
    for (size_t c = 0; c < 3; ++c)
      if (const Plane* plane = frame.find(source.channel_of(which, c)))
        own.set(to.channel_of(which, c), view_of(*plane));
  };
  const std::string aimed = aimed_light_layer(group), light = frame.find(aimed + ".R") ? aimed : light_layer(group);
  for (const std::string_view which : kStatistics) take(light, layer::beauty, which);
  for (const std::string_view which : statistic::buckets) take(light, layer::beauty, which);
  take(predicted_light_layer(group, "direct"), guide_layer::predicted_direct, "");
  take(predicted_light_layer(group, "indirect"), guide_layer::predicted_indirect, "");
  return own;
}

}  // namespace

void clean_lights(const FilterSettings& filter, const ApplyOptions& options, const Layers& raw, Layers& clean,
                  const Task& task) {
  const std::vector<std::string> groups = light_groups_in(raw);
  // Records are of the whole picture.
  if (groups.empty() || filter.entry().records == FilterEntry::Records::kNeeds) return;
  std::vector<std::array<Plane*, 3>> lights;
  std::vector<Plane> errors;
  for (const std::string& group : groups) {
    ApplyOptions own = options;
    own.component = Component::kAll;
    own.carried.clear();
    own.records = nullptr;
    std::list<Layers> nearby;
    for (SequenceFrame& other : own.sequence) other.layers = &nearby.emplace_back(frame_of_group(*other.layers, group));
    Layers result = apply_filter(filter, frame_of_group(raw, group), own, task);
    if (Plane* const error = result.find(layer::clean_error.channel(0))) errors.push_back(std::move(*error));
    const std::string name = clean_light_layer(group);
    lights.push_back(clean.add_rgb({name, layer::beauty.channels, ""}));
    for (size_t c = 0; c < 3; ++c) *lights.back()[c] = std::move(*result.find(layer::beauty.channel(c)));
  }
  add_up_exactly(lights, errors, clean.rgb(layer::beauty), task);
}

}  // namespace brume
