#include <fmt/format.h>
#include <pybind11/stl.h>

#include <optional>
#include <set>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "base/sequence.h"
#include "help_compare_txt.h"
#include "help_metrics_txt.h"
#include "workflows/compare_frames.h"
#include "workflows/frame.h"

namespace brume::python {
namespace {

/// What the command prints as JSON, names of files as Python has them.
py::dict to_dict(const std::string& json, const std::string& picture, const std::string& reference) {
  py::dict dict = py::module_::import("json").attr("loads")(to_str(json));
  dict["picture"] = to_str(picture);
  dict["reference"] = to_str(reference);
  if (dict.contains("window")) dict["window"] = py::tuple(dict["window"]);
  return dict;
}

/// A picture of Python's, read or copied when it is compared.
class Given {
 public:
  /// @param name  by which errors call it where it is no file
  Given(std::string name, py::handle value) : name_(std::move(name)) {
    if (is_path(value))
      path_ = to_path(value);
    else
      layers_ = to_layers(value);
  }
  /// The file of a frame of a sequence. @param pattern  a path with a place for its number
  Given(const std::string& pattern, int number) : path_(file_of_frame(pattern, number).string()) {}

  const std::string& name() const { return path_ ? *path_ : name_; }
  /// @param layer  that is compared; nothing: all
  NamedFrame frame(const std::optional<std::string>& layer, const Host& host) const {
    if (path_) return {*path_, read_frame(ExrFile(*path_), host)};
    if (!layer) return {name_, *layers_};
    // Cut to the common window later, so that they are copies: of what is needed.
    const LayerName wanted{*layer, "RGB", ""};
    std::set<std::string> channels = {layer::coverage.channel(0)};
    for (const std::string& channel : wanted.channel_names()) channels.insert(channel);
    Layers part = part_of(*layers_, channels);
    return {name_, part.has(wanted) ? std::move(part) : Layers(*layers_)};
  }

 private:
  std::string name_;
  std::optional<std::string> path_;
  LayersPointer layers_;
};

/// The frames of a sequence, or one picture.
struct GivenFrames {
  std::string name;
  bool sequence = false;
  std::vector<Given> frames;

  /// @param numbers  of the frames; empty: as many as there are
  GivenFrames(std::string what, py::handle value, const std::vector<int>& numbers) : name(std::move(what)) {
    if (is_sequence_of_frames(value)) {
      sequence = true;
      for (const py::handle frame : py::reinterpret_borrow<py::sequence>(value))
        frames.emplace_back(fmt::format("{}[{}]", name, frames.size()), frame);
      if (!numbers.empty() && numbers.size() != frames.size())
        throw InputError(fmt::format("frames: {} numbers for {} frames of {}", numbers.size(), frames.size(), name));
    } else if (!numbers.empty()) {
      sequence = true;
      name = to_path(value);
      if (numbers.size() > 1 && !FramePattern::of(name))
        throw InputError(
            fmt::format("{}: has no place for a frame's number; expected a name such as shot.####.exr", name));
      for (const int number : numbers) frames.emplace_back(name, number);
    } else {
      frames.emplace_back(name, value);
      name = frames[0].name();
    }
  }
};

std::string layer_of(const std::string& name) {
  return name == layer::beauty.label() ? "" : name;
}

py::dict compare_sequence(const GivenFrames& picture, const GivenFrames& reference,
                          const std::optional<GivenFrames>& second, std::vector<int> numbers,
                          const CompareOptions& options, const std::string& sheet, int threads,
                          const py::object& progress) {
  const size_t count = picture.frames.size();
  for (const GivenFrames* other : {&reference, second ? &*second : &reference})
    if (other->frames.size() != count)
      throw InputError(
          fmt::format("{} has {} frames, {} has {}", other->name, other->frames.size(), picture.name, count));
  if (numbers.empty())
    for (size_t i = 0; i < count; ++i) numbers.push_back(static_cast<int>(i));
  std::optional<SequenceComparison> sequence;
  run_work({progress}, threads, [&](const Work& work) {
    const Host host = host_of(work);
    sequence.emplace(options, sheet, numbers);
    for (size_t i = 0; i < count; ++i) {
      work.task.check();
      std::optional<NamedFrame> other;
      if (second) other = second->frames[i].frame("", host);
      sequence->add(picture.frames[i].frame("", host), reference.frames[i].frame("", host), std::move(other), host);
      work.task.report(static_cast<double>(i + 1) / static_cast<double>(count));
    }
    sequence->finish();
  });
  return to_dict(sequence->json(picture.name, reference.name), picture.name, reference.name);
}

py::dict compare(const py::object& picture, const py::object& reference, const py::object& second,
                 const std::string& layer, bool each_layer, const py::object& exposure, bool clip,
                 const py::object& frames, const py::object& contact_sheet, int threads, const py::object& progress) {
  const CompareOptions options{layer_of(layer), each_layer, to_exposure(exposure), clip};
  std::vector<int> numbers;
  if (!frames.is_none()) numbers = parse_frames(to_text(frames));
  const GivenFrames x("picture", picture, numbers), r("reference", reference, numbers);
  std::optional<GivenFrames> r2;
  if (!second.is_none()) r2.emplace("second", second, numbers);
  if (x.sequence != r.sequence || (r2 && r2->sequence != r.sequence))
    throw InputError("picture, reference and second: expected sequences of all of them, or one frame of each");
  const std::string sheet = to_optional_path(contact_sheet);
  if (x.sequence) return compare_sequence(x, r, r2, std::move(numbers), options, sheet, threads, progress);
  if (!sheet.empty()) throw InputError("contact_sheet: shows the frames of a sequence; expected lists, or frames");
  std::optional<ComparisonReport> report;
  run_work({progress}, threads, [&](const Work& work) {
    const Host host = host_of(work);
    const std::optional<std::string> wanted = each_layer ? std::nullopt : std::optional(options.layer);
    std::optional<NamedFrame> other;
    if (r2) other = r2->frames[0].frame(wanted, host);
    report = compare_frames(x.frames[0].frame(wanted, host), r.frames[0].frame(wanted, host), std::move(other), options,
                            host);
  });
  return to_dict(report->json(), report->picture, report->reference);
}

py::dict metrics(const py::object& picture, const py::object& reference, const py::object& second,
                 const std::string& layer, const py::object& exposure, bool clip) {
  const py::dict all = compare(picture, reference, second, layer, /*each_layer=*/false, exposure, clip, py::none(),
                               py::none(), 0, py::none());
  py::dict result = all["metrics"];
  if (all.contains("medium")) result["medium"] = all["medium"];
  return result;
}

}  // namespace

void bind_compare(py::module_& module) {
  module.def("compare", &compare, py::arg("picture"), py::arg("reference"), py::arg("second") = py::none(),
             py::kw_only(), py::arg("layer") = "", py::arg("each_layer") = false, py::arg("exposure") = "header",
             py::arg("clip") = true, py::arg("frames") = py::none(), py::arg("contact_sheet") = py::none(),
             py::arg("threads") = 0, py::arg("progress") = py::none(), help(embedded::help_compare_txt).c_str());
  module.def("metrics", &metrics, py::arg("picture"), py::arg("reference"), py::arg("second") = py::none(),
             py::kw_only(), py::arg("layer") = "", py::arg("exposure") = "header", py::arg("clip") = true,
             help(embedded::help_metrics_txt).c_str());
}

}  // namespace brume::python
