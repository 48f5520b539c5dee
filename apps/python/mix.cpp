#include <fmt/format.h>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "workflows/frame_lights.h"

namespace brume::python {
namespace {

/// "key=2" of the pair of a dict; a colour is three numbers.
std::string assignment_of(const std::string& argument, const std::pair<py::handle, py::handle>& item) {
  const std::string group = to_text(item.first);
  if (!py::isinstance<py::sequence>(item.second))
    return fmt::format("{}={}", group, to_positive(argument, item.second, /*or_zero=*/true));
  std::vector<std::string> numbers;
  for (const py::handle number : item.second)
    numbers.push_back(fmt::format("{}", to_positive(argument, number, /*or_zero=*/true)));
  return fmt::format("{}={}", group, join(numbers, ","));
}

LayersPointer mix(const py::object& frame, const py::dict& gain, const py::dict& colour, const py::object& map) {
  LightMix factors;
  for (const auto& item : gain) add_to_mix(factors, assignment_of("gain", item));
  for (const auto& item : colour) add_to_mix(factors, assignment_of("colour", item));
  const std::string names = to_optional_path(map);
  if (!is_path(frame)) {
    if (!names.empty()) throw InputError("map: is for files; expected a path as the frame");
    return std::make_shared<Layers>(mixed_frame(*to_layers(frame), factors));
  }
  const std::string file = to_path(frame);
  LayersPointer mixed;
  run_work({}, 0, [&](const Work& work) {
    const ExrFile opened(file);
    try {
      mixed = std::make_shared<Layers>(mixed_frame(opened, names, factors, host_of(work)));
    } catch (const InputError& error) {
      throw InputError(fmt::format("{}: {}", file, error.what()));
    }
  });
  return mixed;
}

}  // namespace

void bind_mix(py::module_& module) {
  module.def(
      "mix", &mix, py::arg("frame"), py::kw_only(), py::arg("gain") = py::dict(), py::arg("colour") = py::dict(),
      py::arg("map") = py::none(),
      "A frame with light groups, brume's or another renderer's, as it would be with other lights, without\n"
      "rendering.\n\n"
      "frame: layers, or an EXR. map: of an EXR, a TOML file that says which layer plays which part.\n"
      "gain: factors by names of groups, {\"key\": 2}. colour: the same with three numbers, for red, green and\n"
      "blue. Groups that are not named stay. The picture is the sum of the groups, clean where the frame is; its\n"
      "other parts are left out. Raises InputError for a frame without groups, or without one that is named.");
}

}  // namespace brume::python
