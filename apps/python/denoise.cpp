#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <optional>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "base/sequence.h"
#include "filters/api/registry.h"
#include "help_denoise_txt.h"
#include "workflows/choices.h"
#include "workflows/denoise_frame.h"
#include "workflows/filters_json.h"
#include "workflows/second_frame.h"

namespace brume::python {
namespace {

std::string denoise_help() {
  std::string text = help(embedded::help_denoise_txt) + "\n";
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

/// A frame or guides of Python's: a file that is read when it is needed, or layers in memory.
class Given {
 public:
  Given() = default;
  /// @param name  by which errors call it where it is no file
  Given(std::string name, py::handle value) : name_(std::move(name)) {
    if (is_path(value))
      name_ = path_ = to_path(value);
    else
      layers_ = to_layers(value);
  }
  const std::string& name() const { return name_; }
  const std::string& path() const { return path_; }

  const Layers& frame(const Host& host) {
    if (!layers_) layers_ = std::make_shared<Layers>(read_frame(ExrFile(path_), host));
    return *layers_;
  }
  /// Those of a frame; null where none are given.
  const NamedFrame* guides() {
    if (!guides_ && !path_.empty()) guides_ = read_guides(path_);
    if (!guides_ && layers_) guides_ = {name_, *layers_};
    return guides_ ? &*guides_ : nullptr;
  }
  /// Frees what was read.
  void let_go() {
    guides_.reset();
    if (!path_.empty()) layers_.reset();
  }

 private:
  std::string name_, path_;
  LayersPointer layers_;
  std::optional<NamedFrame> guides_;
};

py::list denoise_list(const py::sequence& frames, const py::object& guides, const DenoiseOptions& options, int threads,
                      const py::object& progress) {
  std::vector<Given> given, of_guides(frames.size());
  for (const py::handle frame : frames) given.emplace_back(fmt::format("frame {}", given.size()), frame);
  if (!guides.is_none()) {
    if (is_path(guides) || py::isinstance<Layers>(guides) || py::len(guides) != frames.size())
      throw InputError(fmt::format("guides: expected a list of {}, one for each frame", frames.size()));
    of_guides.clear();
    for (const py::handle one : guides) of_guides.emplace_back(fmt::format("guides {}", of_guides.size()), one);
  }
  std::vector<Layers> clean;
  run_work({progress}, threads, [&](const Work& work) {
    const Host host = host_of(work);
    const auto get = [&](size_t i) {
      return MemoryFrame{given[i].name(), &given[i].frame(host), of_guides[i].guides()};
    };
    const auto let_go = [&](size_t i) {
      given[i].let_go();
      of_guides[i].let_go();
    };
    clean = denoise_frames(given.size(), get, let_go, options, host);
  });
  py::list result;
  for (Layers& layers : clean) result.append(py::cast(std::make_shared<Layers>(std::move(layers))));
  return result;
}

py::object denoise_files(const FrameFiles& files, std::vector<int> numbers, const DenoiseOptions& options, int threads,
                         const py::object& progress) {
  if (numbers.empty()) numbers = frames_or_all_of(files.frame);
  const bool sequence = !numbers.empty();
  for (const auto& [what, name] : {std::pair("layers", &files.frame),
                                   {"second", &files.second},
                                   {"output", &files.output},
                                   {"png", &files.preview}})
    check_pattern(what, *name, numbers);
  if (options.resume && !sequence) throw InputError("resume leaves out the complete frames of a sequence");
  SequenceEnd end;
  run_work({progress}, threads, [&](const Work& work) {
    const Host host = host_of(work);
    if (sequence)
      end = denoise_sequence(files, numbers, options, host);
    else
      denoise_frame(files, options, host);
  });
  if (!sequence) return py::none();
  py::dict dict;
  dict["done"] = end.done;
  dict["skipped"] = end.skipped;
  dict["failed"] = end.failed;
  return dict;
}

py::object denoise(const py::object& layers, const py::object& filter, const std::string& component,
                   const std::string& background, const std::string& noise, const std::string& outliers,
                   const py::object& features, const py::object& carry, const py::object& guides,
                   const py::object& second, const py::object& exposure, int tile, const py::object& extra_frames,
                   const py::object& output, const py::object& png, const py::object& records,
                   const py::object& frame_numbers, bool resume, bool keep_file, const std::string& suffix,
                   const py::object& map, const py::object& samples, int threads, const py::object& progress,
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
  if (!extra_frames.is_none()) options.extra_frames = to_int("extra_frames", extra_frames, 0, 100);
  options.resume = resume;
  options.file.keep = keep_file;
  options.file.suffix = suffix;
  options.file.map = to_optional_path(map);
  if (!samples.is_none()) options.file.samples = to_int("samples", samples, 1, std::numeric_limits<int>::max());
  if (!filter.is_none()) options.filters = {parse_filter(to_text(filter))};
  if (options.filters.empty() && parameters.size() > 0)
    throw InputError(fmt::format("{}: a parameter without a filter; name the filter too",
                                 to_text(py::list(parameters.attr("keys")())[0])));
  for (const auto& [key, value] : parameters) options.filters[0].set(parameter_name(to_text(key)), to_toml(value));

  std::vector<int> numbers;
  if (!frame_numbers.is_none()) numbers = parse_frames(to_text(frame_numbers));
  if (!output.is_none()) {
    if (!is_path(layers)) throw InputError("output: is for files; expected layers to be a path");
    if (!guides.is_none() && !is_path(guides)) throw InputError("output: is for files; expected guides to be a path");
    if (!second.is_none() && !is_path(second))
      throw InputError("output: is for files; expected second_frame to be a path");
    FrameFiles files;
    files.frame = to_path(layers);
    files.second = to_optional_path(second);
    files.guides = to_optional_path(guides);
    files.records = to_optional_path(records);
    files.output = to_path(output);
    files.preview = to_optional_path(png);
    return denoise_files(files, std::move(numbers), options, threads, progress);
  }
  if (!png.is_none() || !records.is_none() || !numbers.empty() || resume || options.file.asked() ||
      options.file.samples > 0)
    throw InputError(
        "png, records, frame_numbers, resume, keep_file, suffix, map and samples are for files; expected output too");
  if (is_sequence_of_frames(layers) && !second.is_none())
    throw InputError("second_frame: is of one frame, or of files and output");
  if (is_sequence_of_frames(layers))
    return denoise_list(py::reinterpret_borrow<py::sequence>(layers), guides, options, threads, progress);
  if (options.extra_frames.value_or(0) > 0)
    throw InputError("extra_frames: are those of a sequence; expected a list of frames, or files and output");
  Given frame("the frame", layers), other, of_guides;
  if (!second.is_none()) other = Given("second_frame", second);
  if (!guides.is_none()) of_guides = Given("the guides", guides);
  LayersPointer result;
  run_work({progress}, threads, [&](const Work& work) {
    const Host host = host_of(work);
    const Layers& own = frame.frame(host);
    std::optional<Layers> both;
    if (!second.is_none()) both = joined(own, other.frame(host), {frame.name(), other.name()});
    result = std::make_shared<Layers>(denoise_frame(both ? *both : own, of_guides.guides(), options, host));
  });
  return py::cast(result);
}

}  // namespace

void bind_denoise(py::module_& module) {
  module.def("denoise", &denoise, py::arg("layers"), py::arg("filter") = py::none(), py::kw_only(),
             py::arg("component") = "all", py::arg("background") = "default", py::arg("noise") = "layers",
             py::arg("outliers") = "extreme", py::arg("features") = py::none(), py::arg("carry") = py::tuple(),
             py::arg("guides") = py::none(), py::arg("second_frame") = py::none(), py::arg("exposure") = "header",
             py::arg("tile") = 0, py::arg("extra_frames") = py::none(), py::arg("output") = py::none(),
             py::arg("png") = py::none(), py::arg("records") = py::none(), py::arg("frame_numbers") = py::none(),
             py::arg("resume") = false, py::arg("keep_file") = false, py::arg("suffix") = "",
             py::arg("map") = py::none(), py::arg("samples") = py::none(), py::arg("threads") = 0,
             py::arg("progress") = py::none(), denoise_help().c_str());
  module.def(
      "filters",
      [] {
        const py::object read_json = py::module_::import("json").attr("loads");
        return py::object(read_json(to_str(filters_json(filters_by_merit())))["filters"]);
      },
      "The declarations of the filters, what serves best first, as `brume filters --json` gives them.");
}

}  // namespace brume::python
