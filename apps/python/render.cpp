#include "apps/python/render.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <limits>

#include "apps/python/bindings.h"
#include "base/sequence.h"
#include "help_render_options_txt.h"
#include "workflows/choices.h"

namespace brume::python {

namespace {

/// Hands whole pictures over to Python, where they are looked at.
class PythonWatcher : public RenderWatcher {
 public:
  explicit PythonWatcher(const Work& work) : work_(work) {}
  void update(const Film&, int) override {}
  void show(const Layers& frame) override { work_.show(frame); }
  bool waits() override { return work_.waits(); }

 private:
  const Work& work_;
};

RenderOptions::Part to_part(const py::object& part) {
  const std::vector<int> numbers = to_ints("part", part, "(i, n)");
  if (numbers[0] < 1 || numbers[0] > numbers[1])
    throw InputError(fmt::format("part ({}, {}): expected (i, n) with i from 1 to n", numbers[0], numbers[1]));
  return {numbers[0], numbers[1]};
}

void set_files(RenderOptions& options, const py::object& output, const py::object& png, const py::object& records,
               const py::object& checkpoint, double checkpoint_every, const py::object& resume, const py::object& deep,
               const std::vector<int>& frames) {
  options.output = to_optional_path(output);
  options.preview = to_optional_path(png);
  options.records = to_optional_path(records);
  options.deep = to_optional_path(deep);
  options.checkpoint = to_optional_path(checkpoint);
  if (!(checkpoint_every > 0))
    throw InputError(fmt::format("checkpoint_every: expected seconds above 0, found {}", checkpoint_every));
  options.checkpoint_seconds = checkpoint_every;
  if (PyBool_Check(resume.ptr()))
    options.skip_complete = resume.ptr() == Py_True;
  else
    options.resume = to_optional_path(resume);
  if (options.skip_complete && frames.empty())
    throw InputError("resume: True is for the frames of a sequence; expected a checkpoint to go on from, or frames");
  for (const auto& [argument, name] : {std::pair("output", &options.output),
                                       {"png", &options.preview},
                                       {"records", &options.records},
                                       {"deep", &options.deep},
                                       {"checkpoint", &options.checkpoint},
                                       {"resume", &options.resume}})
    check_pattern(argument, *name, frames);
}

/// The progress of renders and of cleaning what they made, frame after frame.
class RenderProgress {
 public:
  RenderProgress(const Work& work, bool cleans, size_t frames) : work_(work), cleans_(cleans), frames_(frames) {}

  std::function<void(double)> begin(const std::string& stage) {
    if (stage.starts_with("render ")) {
      ++frame_;
      rendered_ = false;
      return [this](double f) {
        if (f >= 1) rendered_ = true;
        tell(cleans_ ? 0.9 * f : f);
      };
    }
    // Pictures that are cleaned on the way say nothing of how far it is.
    return [this](double f) {
      if (rendered_) tell(0.9 + 0.1 * f);
    };
  }

 private:
  void tell(double of_frame) { work_.task.report((frame_ - 1 + of_frame) / static_cast<double>(frames_)); }

  const Work& work_;
  const bool cleans_;
  const size_t frames_;
  int frame_ = 0;
  std::atomic<bool> rendered_{false};
};

}  // namespace

std::string render_help(bool of_scene) {
  const std::string first =
      of_scene
          ? "Renders the scene.\n\n"
            "Every other keyword sets a key for this render alone: camera__fov=30, volumes__0__density=array; set() keeps\n"
            "them.\n"
          : "Renders a scene.\n\n"
            "scene: as brume.Scene takes it: a path of a scene file (TOML) or an OpenVDB file, the text of a scene, a dict,\n"
            "or a Scene. Every other keyword sets a key of the scene: camera__fov=30, volumes__0__density=array.\n";
  return first + help(embedded::help_render_options_txt);
}

void set_layers(RenderOptions& options, const py::object& layers, bool statistics, bool buckets,
                const py::object& clean) {
  if (py::isinstance<py::str>(clean))
    options.clean_filter = to_text(clean);
  else if (!clean.is_none() && to_bool("clean", clean, "True, False or a filter's name"))
    options.clean_filter = "transport_regression";
  if (!layers.is_none()) {
    std::vector<std::string> names = to_words(layers);
    if (names == std::vector<std::string>{"none"}) names.clear();
    options.layers = LayerRequest::of(names, statistics, buckets);
  } else if (!options.clean_filter.empty()) {
    options.layers.names = {"direct", "indirect"};
  }
  options.layers.statistics = statistics;
  options.layers.buckets = buckets;
}

void set_spp(RenderOptions& options, const py::object& spp) {
  if (!spp.is_none()) options.spp = to_int("spp", spp, 1, 1 << 24);
}

void set_source(RenderOptions& options, const SceneSource& source) {
  options.scene = source.path;
  options.scene_text = source.text;
  options.arrays = source.arrays;
  options.overrides = source.overrides;
}

py::dict to_dict(const SequenceEnd& end) {
  py::dict dict;
  dict["done"] = end.done;
  dict["missed"] = end.missed;
  dict["skipped"] = end.skipped;
  dict["failed"] = end.failed;
  return dict;
}

py::object render(const py::object& scene, const py::object& spp, const py::object& seed, const py::object& layers,
                  bool statistics, bool buckets, const py::object& clean, const std::string& outliers,
                  const py::object& crop, const py::object& time, const py::object& target_error,
                  const py::object& part, const py::object& frames, bool fixed_seed, const py::object& output,
                  const py::object& png, const py::object& records, const py::object& deep, int deep_samples,
                  const py::object& checkpoint, double checkpoint_every, const py::object& resume,
                  const py::object& on_picture, int threads, const py::object& progress, const py::kwargs& keywords) {
  RenderOptions options;
  const SceneArgument argument(scene);
  const SceneChanges changes(keywords);
  set_layers(options, layers, statistics, buckets, clean);
  options.outliers = kOutlierRules.of(outliers);
  if (!crop.is_none()) {
    const std::vector<int> window = to_ints("crop", crop, "(x0, y0, x1, y1)");
    options.crop = fmt::format("{},{},{},{}", window[0], window[1], window[2], window[3]);
  }
  set_spp(options, spp);
  if (!seed.is_none()) options.seed = to_whole_number("seed", seed, 0, std::numeric_limits<int64_t>::max());
  if (!time.is_none()) options.time_limit = to_positive("time", time);
  if (!target_error.is_none()) options.target_error = to_positive("target_error", target_error);
  if (!part.is_none()) options.part = to_part(part);
  if (!frames.is_none()) parse_frames(to_text(frames));  // below, an empty text would stand for none
  const std::vector<int> numbers = frames_to_make(argument.file().value_or(""), to_optional_path(output),
                                                  frames.is_none() ? "" : to_text(frames), {"output", "frames"});
  set_files(options, output, png, records, checkpoint, checkpoint_every, resume, deep, numbers);
  if (deep_samples < 1) throw InputError(fmt::format("deep_samples: expected at least 1, found {}", deep_samples));
  options.deep_samples = deep_samples;
  options.fixed_seed = fixed_seed;
  if (numbers.empty() && fixed_seed) throw InputError("fixed_seed is for frames: one frame has one seed");
  if (!numbers.empty() && options.output.empty())
    throw InputError("frames: a sequence goes to files; expected output with a name such as shot.####.exr");

  std::shared_ptr<Layers> result;
  SequenceEnd end;
  run_work({progress, on_picture}, threads, [&](const Work& work) {
    std::optional<SceneUse> use;
    Host host = host_of(work);
    if (argument.file() && !changes.has_arrays()) {
      options.scene = *argument.file();
      options.overrides = changes.overrides();
    } else {
      if (argument.object()) {
        use.emplace(*argument.object(), work.task);
        options.scenes = &use->cache();
        host = use->host(work);
      }
      SceneSource source = argument.source(changes.overrides(), work.task);
      changes.apply(source, work.task);
      set_source(options, source);
    }
    RenderProgress told(work, !options.clean_filter.empty(), std::max<size_t>(1, numbers.size()));
    host.progress = [&told](const std::string& stage) { return told.begin(stage); };
    if (!on_picture.is_none())
      options.watch = [&work](const std::string&, ivec2) { return std::make_unique<PythonWatcher>(work); };
    if (numbers.empty())
      result = std::make_shared<Layers>(render_frame(options, host).layers);
    else
      end = render_sequence(options, numbers, host);
  });
  if (!numbers.empty()) return to_dict(end);
  return py::cast(result);
}

void bind_render(py::module_& module) {
  add_render(module, render_help(/*of_scene=*/false), py::arg("scene"));
}

}  // namespace brume::python
