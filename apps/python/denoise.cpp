#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <optional>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "filters/api/registry.h"
#include "workflows/choices.h"
#include "workflows/denoise_frame.h"
#include "workflows/filters_json.h"

namespace brume::python {
namespace {

std::string denoise_help() {
  std::string text =
      "Cleans a frame with a filter; with the best that its layers allow where none is named.\n\n"
      "layers: brume.Layers, which is read where it lies, or a mapping of arrays, which is copied first, or an array of\n"
      "height x width x 3. The result is a new brume.Layers: R, G, B, what else the filter makes, and a header with the\n"
      "filter and its parameters.\n\n"
      "component: all cleans the beauty, indirect that layer, direct being added back, separate both by themselves. background: bilateral\n"
      "or filter for pixels without coverage, or default. noise: layers or spatial: where variance comes from. outliers:\n"
      "extreme limits single samples that outshine all around them; clamp, redistribute or keep fireflies. features: names to use, \"none\", or all. carry: layers to filter with the\n"
      "same weights. guides: a path or Layers by brume guides. exposure: a number, \"header\" or \"auto\". tile: side of\n"
      "the squares that are filtered one after another [px]; 0: by memory. Every other keyword is a parameter of the\n"
      "filter, a dash written as an underscore, or preset. Raises InputError.\n\n"
      "Filters, what serves best first, and their parameters:\n";
  for (const FilterEntry* entry : filters_by_merit()) {
    text += fmt::format("\n{}: {}\n", entry->name, entry->summary);
    const FilterSettings settings(*entry);
    for (const Parameter& p : entry->parameters)
      text += fmt::format("    {}: {} ({}; default {})\n", p.name, p.help, p.range(), Parameter::text(settings.get(p)));
  }
  return text;
}

/// "sigma-range" for the keyword sigma_range; "lambda" for lambda_, which Python keeps for itself.
std::string parameter_name(std::string keyword) {
  if (keyword.ends_with('_')) keyword.pop_back();
  std::replace(keyword.begin(), keyword.end(), '_', '-');
  return keyword;
}

LayersPointer denoise(const py::object& layers, const py::object& filter, const std::string& component,
                      const std::string& background, const std::string& noise, const std::string& outliers,
                      const py::object& features, const py::object& carry, const py::object& guides,
                      const py::object& exposure, int tile, int threads, const py::object& progress,
                      const py::kwargs& parameters) {
  DenoiseOptions options;
  options.how.component = kComponents.of(component);
  options.how.background = kBackgrounds.of(background);
  options.how.noise = kNoiseSources.of(noise);
  options.how.outliers = kOutlierRules.of(outliers);
  if (!features.is_none()) options.how.features = to_words(features);
  for (const std::string& name : to_words(carry)) options.how.carried.push_back(kColourLayers.of(name));
  if (tile < 0) throw InputError(fmt::format("tile: expected 0 or more, found {}", tile));
  options.how.tile = tile;
  options.picture.exposure = to_exposure(exposure);
  const LayersPointer frame = to_layers(layers);
  LayersPointer guide_layers;
  std::string guide_path;
  if (py::isinstance<Layers>(guides))
    guide_layers = guides.cast<LayersPointer>();
  else if (!guides.is_none())
    guide_path = to_path(guides);
  if (!filter.is_none()) options.filters = {parse_filter(to_text(filter))};
  if (options.filters.empty() && parameters.size() > 0)
    throw InputError(fmt::format("{}: a parameter without a filter; name the filter too",
                                 to_text(py::list(parameters.attr("keys")())[0])));
  for (const auto& [key, value] : parameters) options.filters[0].set(parameter_name(to_text(key)), to_toml(value));

  LayersPointer result;
  run_work(progress, threads, [&](const Work& work) {
    std::optional<NamedFrame> known;
    if (guide_layers) known = {"the guides", *guide_layers};
    if (!guide_path.empty()) known = read_guides(guide_path);
    result = std::make_shared<Layers>(denoise_frame(*frame, known ? &*known : nullptr, options, host_of(work)));
  });
  return result;
}

}  // namespace

void bind_denoise(py::module_& module) {
  module.def("denoise", &denoise, py::arg("layers"), py::arg("filter") = py::none(), py::kw_only(),
             py::arg("component") = "all", py::arg("background") = "default", py::arg("noise") = "layers",
             py::arg("outliers") = "extreme", py::arg("features") = py::none(), py::arg("carry") = py::tuple(),
             py::arg("guides") = py::none(), py::arg("exposure") = "header", py::arg("tile") = 0,
             py::arg("threads") = 0, py::arg("progress") = py::none(), denoise_help().c_str());
  module.def(
      "filters",
      [] {
        const py::object read_json = py::module_::import("json").attr("loads");
        return py::object(read_json(to_str(filters_json(filters_by_merit())))["filters"]);
      },
      "The declarations of the filters, what serves best first, as `brume filters --json` gives them.");
}

}  // namespace brume::python
