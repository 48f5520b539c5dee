#include "filters/apply.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "base/error.h"
#include "base/text.h"

namespace brume {
namespace {

float median_of_finite_neighbours(const Plane& plane, int x, int y) {
  std::vector<float> values;
  for (int qy = std::max(0, y - 1); qy <= std::min(plane.height() - 1, y + 1); ++qy)
    for (int qx = std::max(0, x - 1); qx <= std::min(plane.width() - 1, x + 1); ++qx)
      if (std::isfinite(plane(qx, qy))) values.push_back(plane(qx, qy));
  if (values.empty()) return 0.0f;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Plane repaired(const Plane& plane, std::set<std::pair<int, int>>& bad) {
  Plane result = plane;
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x)
      if (!std::isfinite(plane(x, y))) {
        result(x, y) = median_of_finite_neighbours(plane, x, y);
        bad.insert({x, y});
      }
  return result;
}

void check_layers(const FilterEntry& filter, const Layers& frame, const ApplyOptions& options) {
  std::vector<std::string> missing, record;
  for (const LayerName& l : required_layers(filter, options))
    if (!frame.has(l)) {
      missing.push_back("'" + l.label() + "'");
      if (!l.name.empty()) record.push_back(std::string(l.name));
    }
  if (missing.empty()) return;
  for (const LayerName& l : {layer::direct, layer::indirect, layer::gradient, layer::coverage, layer::transmittance})
    if (frame.has(l) && std::find(record.begin(), record.end(), l.name) == record.end())
      record.push_back(std::string(l.name));
  // --component all helps only where nothing but the split is missing.
  const bool only_split =
      std::all_of(filter.needs.begin(), filter.needs.end(), [&](const LayerName& l) { return frame.has(l); });
  const std::string way_out =
      !only_split ? "; other renderers do not record what it needs: take another filter for their frames"
      : options.component == Component::kIndirect ? "; or clean the whole picture with --component all"
                                                  : "";
  throw InputError(fmt::format(
      "filter {} needs the layer{} {}, which the frame does not have. Record it with: brume render SCENE -o OUT.exr "
      "--layers {}{}",
      filter.name, missing.size() > 1 ? "s" : "", join(missing), join(record, ","), way_out));
}

}  // namespace

std::vector<LayerName> required_layers(const FilterEntry& filter, const ApplyOptions& options) {
  std::vector<LayerName> layers;
  if (options.component == Component::kIndirect)
    layers = {layer::direct, layer::indirect};
  else
    layers = {layer::beauty};
  for (const LayerName& l : filter.needs)
    if (std::find(layers.begin(), layers.end(), l) == layers.end()) layers.push_back(l);
  return layers;
}

Layers apply_filter(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options, const Task& task,
                    ApplyReport* report) {
  check_layers(filter.entry(), frame, options);
  ApplyReport local;
  ApplyReport& r = report ? *report : local;
  r = {};

  // Only planes with something to repair are copied.
  std::set<std::pair<int, int>> bad;
  Layers fixed(frame.width(), frame.height());
  std::vector<LayerName> used = required_layers(filter.entry(), options);
  for (const LayerName& optional : filter.entry().can_use)
    if (frame.has(optional)) used.push_back(optional);
  for (const LayerName& kept : {layer::coverage, layer::alpha})
    if (frame.has(kept)) used.push_back(kept);
  for (const LayerName& l : used)
    for (size_t c = 0; c < l.channels.size(); ++c)
      if (const Plane& plane = frame.at(l.channel(c)); count_not_finite(plane))
        fixed.set(l.channel(c), repaired(plane, bad));
  r.repaired_pixels = bad.size();
  const bool any_fixed = !bad.empty();
  if (any_fixed) {
    for (const auto& [name, plane] : frame.channels())
      if (!fixed.find(name)) fixed.set(name, plane);
    r.notes.push_back(
        fmt::format("{} pixels were NaN or infinite and were replaced by the median of their neighbours", bad.size()));
  }
  const Layers& source = any_fixed ? fixed : frame;

  FilterFrame input{source.rgb(options.component == Component::kIndirect ? layer::indirect : layer::beauty), source,
                    options.exposure, nullptr};
  if (options.background == BackgroundRule::kBilateral) {
    input.medium = source.find(layer::coverage.channel(0));
    if (!input.medium) r.notes.push_back("no coverage layer: every pixel is filtered as medium");
  }
  Layers result(frame.width(), frame.height());
  result.header = frame.header;
  const auto out = result.add_rgb(layer::beauty);
  const Stopwatch watch;
  filter.run(input, out, task);
  r.seconds = watch.seconds();
  task.check();

  const bool add_direct = options.component == Component::kIndirect;
  const auto direct = add_direct ? source.rgb(layer::direct) : input.signal;
  for (int y = 0; y < result.height(); ++y)
    for (int x = 0; x < result.width(); ++x) {
      const bool finite =
          std::isfinite((*out[0])(x, y)) && std::isfinite((*out[1])(x, y)) && std::isfinite((*out[2])(x, y));
      r.not_finite_results += !finite;
      for (size_t c = 0; c < 3; ++c) {
        if (!finite) (*out[c])(x, y) = (*input.signal[c])(x, y);
        if (add_direct) (*out[c])(x, y) += (*direct[c])(x, y);
      }
    }
  if (r.not_finite_results)
    r.notes.push_back(
        fmt::format("{} pixels were out of the filter's range and kept their input", r.not_finite_results));
  if (const Plane* alpha = source.find(layer::alpha.channel(0))) result.set(layer::alpha.channel(0), *alpha);
  result.header["biased"] = "true: filtered by " + filter.entry().name;
  result.header["filter"] = filter.entry().name;
  result.header["filterParameters"] = filter.text();
  result.header["filterComponent"] = std::string(add_direct ? "indirect; direct added back" : "all");
  result.header["filterBackground"] =
      std::string(input.medium ? "bilateral sigma-domain=2 sigma-range=20" : "as the medium");
  result.header["filterExposure"] = static_cast<float>(options.exposure);
  result.header["filterSeconds"] = static_cast<float>(r.seconds);
  result.header["filterSource"] = filter.entry().source;
  return result;
}

}  // namespace brume
