#include <fmt/format.h>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "base/sequence.h"
#include "workflows/merge_frames.h"

namespace brume::python {
namespace {

constexpr const char* kMergeHelp =
    "Joins the parts of a render to the bits of one render of all their samples.\n\n"
    "parts: Layers that were rendered with part=(i, n), paths of files of these or of checkpoints, or a path with a place\n"
    "for a number, parts/###.exr, for all that are there; one of these or several. numbers: \"1-8\", of the parts that\n"
    "must be there. mergeable: keep the sums of the samples, so that more parts can be merged later. output: an EXR to\n"
    "write, too. Raises InputError: parts of other renders, which says what differs; samples that two of them have.";

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
  if (!output.is_none()) options.output = to_path(output);
  LayersPointer result;
  run_work({}, threads,
           [&](const Work& work) { result = std::make_shared<Layers>(merge_frames(options, host_of(work)).value()); });
  return result;
}

}  // namespace

void bind_merge(py::module_& module) {
  module.def("merge", &merge, py::arg("parts"), py::kw_only(), py::arg("numbers") = py::none(),
             py::arg("mergeable") = false, py::arg("output") = py::none(), py::arg("threads") = 0, kMergeHelp);
}

}  // namespace brume::python
