#include <fmt/format.h>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "base/sequence.h"
#include "help_merge_txt.h"
#include "workflows/merge_frames.h"

namespace brume::python {
namespace {

LayersPointer merge(const py::object& parts, const py::object& numbers, bool mergeable, const py::object& output,
                    int threads) {
  MergeOptions options;
  std::vector<LayersPointer> alive;
  const bool one = is_path(parts) || py::isinstance<Layers>(parts);
  for (const py::handle part : one ? py::object(py::make_tuple(parts)) : parts) {
    if (is_path(part)) {
      options.parts.push_back(RenderPart::of_file(to_path(part)));
    } else if (py::isinstance<Layers>(part)) {
      alive.push_back(part.cast<LayersPointer>());
      options.parts.push_back({fmt::format("part {}", options.parts.size()), {}, alive.back().get()});
    } else {
      throw py::type_error("parts: expected Layers or paths, found " + type_name(part));
    }
  }
  if (!numbers.is_none()) options.numbers = parse_frames(to_text(numbers));
  options.mergeable = mergeable;
  options.output = to_optional_path(output);
  LayersPointer result;
  run_work({}, threads,
           [&](const Work& work) { result = std::make_shared<Layers>(merge_frames(options, host_of(work)).value()); });
  return result;
}

}  // namespace

void bind_merge(py::module_& module) {
  module.def("merge", &merge, py::arg("parts"), py::kw_only(), py::arg("numbers") = py::none(),
             py::arg("mergeable") = false, py::arg("output") = py::none(), py::arg("threads") = 0,
             help(embedded::help_merge_txt).c_str());
}

}  // namespace brume::python
