#include "workflows/clean_parts.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"

namespace brume {
namespace {

constexpr LayerName kPartsOfDirect[] = {layer::single, layer::surface, layer::background, layer::emission};
constexpr LayerName kPartsOfIndirect[] = {layer::volume_indirect, layer::surface_indirect};

bool is_zero(const RgbPlanes& planes) {
  for (const Plane* plane : planes)
    for (int y = 0; y < plane->height(); ++y)
      for (const float v : plane->pixels(y))
        if (v != 0) return false;
  return true;
}

Plane view_of(const Plane& plane) {
  return Plane::view(plane, 0, 0, plane.width(), plane.height());
}

/// 1 - x, whose variance is that of x.
Plane opposite(const Plane& plane) {
  Plane out(plane.width(), plane.height());
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x) out(x, y) = 1 - plane(x, y);
  return out;
}

/// The frame as the filter is given it to clean one part: that is the beauty, and direct and indirect are not there.
/// Its planes are views. Of transmittance what it leaves of 1 is cleaned, which is 0 where alpha is.
Layers frame_of_part(const Layers& frame, const LayerName& part) {
  Layers own = frame.without_channels();
  std::set<std::string> left_out;
  std::vector<std::string_view> statistics = {"", statistic::mean_variance, statistic::half_a, statistic::half_b};
  statistics.insert(statistics.end(), statistic::buckets.begin(), statistic::buckets.end());
  for (const std::string_view which : statistics)
    for (size_t c = 0; c < 3; ++c) {
      for (const LayerName& l : {layer::beauty, layer::direct, layer::indirect})
        left_out.insert(l.channel_of(which, c));
      const Plane* const plane = frame.find(part.channel_of(which, c));
      if (!plane) continue;
      const bool turned = part == layer::transmittance && which != statistic::mean_variance;
      own.set(layer::beauty.channel_of(which, c), turned ? opposite(*plane) : view_of(*plane));
    }
  for (const auto& [name, plane] : frame.channels())
    if (!left_out.contains(name)) own.set(name, view_of(plane));
  for (const auto& [name, plane] : frame.stored()) own.set_stored(name, plane);
  return own;
}

LayerName clean_layer(const LayerName& part, std::string& name) {
  name = clean_part_name(part);
  return {name, part.channels, part.meaning};
}

/// Makes the clean parts of a whole add up to it: none is below 0, and all are scaled alike.
void add_up(std::span<const LayerName> parts, const RgbPlanes& whole, Layers& frame) {
  for (size_t c = 0; c < 3; ++c) {
    std::vector<Plane*> planes;
    for (const LayerName& part : parts) planes.push_back(frame.find(clean_part_name(part) + "." + part.channels[c]));
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        float sum = 0;
        for (Plane* plane : planes) sum += (*plane)(x, y) = std::max((*plane)(x, y), 0.0f);
        const float scale = (*whole[c])(x, y) / sum;
        if (std::isfinite(scale))
          for (Plane* plane : planes) (*plane)(x, y) *= scale;
        else
          (*planes.front())(x, y) = (*whole[c])(x, y);
      }
  }
}

/// What the guides know to pass the media and to meet no surface, without noise. @return whether there are such guides
bool transmittance_of_guides(Layers& frame) {
  const auto opacity = [&](size_t c) {
    const Plane* const grey = frame.find(guide_layer::opacity.channel(0));
    const std::string coloured(guide_layer::opacity.name);
    return grey ? grey : frame.find(coloured + "." + layer::transmittance.channels[c]);
  };
  if (!opacity(0)) return false;
  std::string name;
  const auto clean = frame.add_rgb(clean_layer(layer::transmittance, name));
  std::vector<const Plane*> materials;
  for (const std::string& channel : guide_layer::surface_material.channel_names())
    if (const Plane* const share = frame.find(channel)) materials.push_back(share);
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        float left = 1 - (*opacity(c))(x, y);
        for (const Plane* const share : materials) left -= (*share)(x, y);
        (*clean[c])(x, y) = std::clamp(left, 0.0f, 1.0f);
      }
  return true;
}

}  // namespace

std::string clean_part_name(const LayerName& part) {
  return "clean_" + std::string(part.name);
}

void clean_parts(const FilterSettings& filter, const ApplyOptions& options, Layers& frame, const Task& task) {
  const auto clean = [&](const LayerName& part, const LayerName& light) {
    std::string name;
    const LayerName target = clean_layer(part, name);
    if (is_zero(frame.rgb(part))) {
      frame.add_rgb(target);
      return;
    }
    ApplyOptions own = options;
    own.component = Component::kAll;
    own.light = light;
    Layers result = apply_filter(filter, frame_of_part(frame, part), own, task);
    for (size_t c = 0; c < 3; ++c) {
      Plane& values = *result.find(layer::beauty.channel(c));
      frame.set(target.channel(c), part == layer::transmittance ? opposite(values) : std::move(values));
    }
  };
  const auto has_all = [&](std::span<const LayerName> parts) {
    return std::all_of(parts.begin(), parts.end(), [&](const LayerName& part) { return frame.has(part); });
  };
  std::vector<LayerName> direct, indirect;
  for (const LayerName& part : kPartsOfDirect)
    if (frame.has(part)) direct.push_back(part);
  for (const LayerName& part : kPartsOfIndirect)
    if (frame.has(part)) indirect.push_back(part);
  for (const LayerName& part : direct) clean(part, layer::direct);
  for (const LayerName& part : indirect) clean(part, layer::indirect);
  if (frame.has(layer::surface_emission)) clean(layer::surface_emission, layer::direct);
  for (const LayerName& l : {layer::catcher, layer::catcher_unshadowed})
    if (frame.has(l)) clean(l, layer::direct);
  if (frame.has(layer::transmittance) && !transmittance_of_guides(frame)) clean(layer::transmittance, layer::direct);
  const bool whole_direct = has_all(kPartsOfDirect), whole_indirect = has_all(kPartsOfIndirect);
  if (frame.has(layer::clean_direct) && frame.has(layer::clean_indirect)) {
    if (whole_direct) add_up(direct, frame.rgb(layer::clean_direct), frame);
    if (whole_indirect) add_up(indirect, frame.rgb(layer::clean_indirect), frame);
  } else if (whole_direct && whole_indirect) {
    direct.insert(direct.end(), indirect.begin(), indirect.end());
    add_up(direct, frame.rgb(layer::beauty), frame);
  }
}

}  // namespace brume
