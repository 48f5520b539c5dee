#include "filters/run/clean_lights.h"

#include <cmath>
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

/// Brings the clean picture, which is cleaned of samples of its own, towards the sum of its groups, as far as their
/// estimated errors say: the mean of two estimates whose errors are independent. Its direct and indirect light follow.
void mix_with_sum(const std::vector<std::array<Plane*, 3>>& lights, const std::vector<Plane>& errors, Layers& clean,
                  const Task& task) {
  const Plane& error_of_picture = clean.at(layer::clean_error.channel(0));
  const bool parts = clean.has(layer::clean_direct) && clean.has(layer::clean_indirect);
  const auto squared = [](float v) { return static_cast<double>(v) * static_cast<double>(v); };
  for (size_t c = 0; c < 3; ++c) {
    std::vector<Plane*> wholes{clean.find(layer::beauty.channel(c))};
    if (parts)
      for (const LayerName& part : {layer::clean_direct, layer::clean_indirect})
        wholes.push_back(clean.find(part.channel(c)));
    for_each_row(clean.height(), quiet(task), [&](int y) {
      for (int x = 0; x < clean.width(); ++x) {
        double sum = 0, of_sum = 0;
        for (const auto& light : lights) sum += static_cast<double>((*light[c])(x, y));
        for (const Plane& error : errors) of_sum += squared(error(x, y));
        const double own = squared(error_of_picture(x, y)), picture = (*wholes[0])(x, y);
        if (!(own + of_sum > 0) || !(picture > 0)) continue;
        const double scale = (of_sum * picture + own * sum) / ((own + of_sum) * picture);
        if (!std::isfinite(scale)) continue;
        for (Plane* const whole : wholes)
          (*whole)(x, y) = static_cast<float>(scale * static_cast<double>((*whole)(x, y)));
      }
    });
  }
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
  if (options.component != Component::kIndirect && errors.size() == lights.size() && clean.has(layer::clean_error))
    mix_with_sum(lights, errors, clean, task);
  add_up_exactly(lights, errors, clean.rgb(layer::beauty), task);
}

}  // namespace brume
