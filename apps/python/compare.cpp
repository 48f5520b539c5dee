#include <pybind11/stl.h>

#include <optional>
#include <set>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "workflows/comparison.h"
#include "workflows/frame.h"

namespace brume::python {
namespace {

constexpr const char* kMetricsHelp =
    "Error measures of a picture against a reference, as `brume compare --json` gives them.\n\n"
    "picture, reference, second: Layers, a mapping of arrays, or height x width x 3. second: an independent reference,\n"
    "to take the references' noise off. layer: to compare; the beauty without it. exposure: a number, \"header\" or\n"
    "\"auto\", of the reference. clip: to [0, 1] before CIE-Lab. The dict has the measures and pixels, and with a\n"
    "reference that has coverage the same over the medium under \"medium\". Raises InputError: other sizes, NaN.";

py::dict to_dict(const Errors& errors) {
  py::dict dict;
  for (const auto& [name, value] : listed(errors)) dict[py::str(name)] = value;
  dict["pixels"] = errors.pixels;
  return dict;
}

py::dict metrics(const py::object& picture, const py::object& reference, const py::object& second,
                 const std::string& layer, const py::object& exposure, bool clip) {
  const std::string layer_name = layer == layer::beauty.label() ? "" : layer;
  std::set<std::string> channels = {layer::coverage.channel(0)};
  for (const std::string& name : LayerName{layer_name, "RGB", ""}.channel_names()) channels.insert(name);
  // Cut to the common window below, so that they are copies.
  const auto named = [&](const char* name, const py::object& value) {
    const LayersPointer layers = to_layers(value);
    Layers part = part_of(*layers, channels);
    return NamedFrame{name, part.has(LayerName{layer_name, "RGB", ""}) ? std::move(part) : Layers(*layers)};
  };
  NamedFrame x = named("picture", picture), r = named("reference", reference);
  std::optional<NamedFrame> r2;
  if (!second.is_none()) r2 = named("second", second);
  const std::string exposure_text = to_exposure(exposure);
  std::vector<Errors> errors;
  run_work(py::none(), 0, [&](const Work& work) {
    const Comparison pictures(std::move(x), std::move(r), std::move(r2), host_of(work));
    errors = pictures.errors(layer_name, pictures.policy(exposure_text, clip), ErrorScope::kAll, work.task);
  });
  py::dict result = to_dict(errors[0]);
  if (errors.size() > 1) result["medium"] = to_dict(errors[1]);
  return result;
}

}  // namespace

void bind_compare(py::module_& module) {
  module.def("metrics", &metrics, py::arg("picture"), py::arg("reference"), py::arg("second") = py::none(),
             py::kw_only(), py::arg("layer") = "", py::arg("exposure") = "header", py::arg("clip") = true,
             kMetricsHelp);
}

}  // namespace brume::python
