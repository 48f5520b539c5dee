#include "workflows/evaluate.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/command.h"
#include "base/error.h"
#include "base/output_folder.h"
#include "base/scratch_folder.h"
#include "base/sequence.h"
#include "base/text.h"
#include "evaluate/protocol/command_filter.h"
#include "evaluate/protocol/sequences.h"
#include "evaluate/report/report.h"
#include "filters/api/registry.h"
#include "image/exr_io.h"
#include "render/scene/scene_fingerprint.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "workflows/choices.h"
#include "workflows/frame.h"
#include "workflows/version.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

Contender contender_of(const ExperimentFilter& filter) {
  if (!filter.command.empty()) {
    Contender c = external_contender(filter_of_command(filter),
                                     filter.label.empty() ? command_label(filter.command) : filter.label);
    c.time_limit = filter.time_limit;
    return c;
  }
  Contender c = parse_contender(filter.parameters.empty() ? filter.filter : filter.filter + ":" + filter.parameters);
  c.features = filter.features;
  c.guides = filter.guides;
  c.time_limit = filter.time_limit;
  c.study = filter.study;
  if (!filter.features.empty()) c.label += " " + join(filter.features, " ");
  if (!filter.guides) c.label += " without guides";
  if (!filter.label.empty()) c.label = filter.label;
  return c;
}

/// @throws InputError for a label that tables could not hold, or that stands for another filter
void check_label(const Contender& contender) {
  const std::string& label = contender.label;
  if (std::any_of(label.begin(), label.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }))
    throw InputError(
        fmt::format("a filter is called {}; expected a label without line breaks and other control characters",
                    nlohmann::json(label).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)));
  if (!contender.external) return;
  for (const FilterEntry* own : all_filters())
    if (label == own->name)
      throw InputError(
          fmt::format("a filter of yours (`{}`) is called '{}', as one of brume's; expected a label of its own",
                      contender.external->words, label));
}

/// Leaves out learnt filters whose weights are not there, unless the user named the filters one by one.
void check_weights(std::vector<Contender>& contenders, bool chosen, const Host& host) {
  std::erase_if(contenders, [&](const Contender& contender) {
    try {
      contender.settings.weights();
    } catch (const InputError& error) {
      if (chosen) throw;
      host.note(fmt::format("'{}' is left out: {}", contender.label, error.what()));
      return true;
    }
    return false;
  });
}

EvaluationSettings settings_of(const EvaluateOptions& o, const Host& host) {
  const Experiment& e = o.experiment;
  EvaluationSettings s;
  static_cast<ExperimentSettings&>(s) = e;
  s.component = kComponents.of(e.component);
  s.background = kBackgrounds.of(e.background);
  s.all_layers = !o.cache.empty();
  s.provenance = {version_number(), version_commit(), o.command, processor_name(),
                  host.threads > 0 ? host.threads : static_cast<int>(std::thread::hardware_concurrency())};
  if (e.filters.empty() && !(o.chosen_filters && !o.others.empty())) s.contenders = all_contenders();
  for (const ExperimentFilter& filter : e.filters) s.contenders.push_back(contender_of(filter));
  s.contenders.insert(s.contenders.end(), o.others.begin(), o.others.end());
  for (const Contender& contender : s.contenders) check_label(contender);
  check_weights(s.contenders, o.chosen_filters, host);
  for (size_t i = 0; i < s.contenders.size(); ++i)
    for (size_t k = 0; k < i; ++k)
      if (s.contenders[i].label == s.contenders[k].label)
        throw InputError(fmt::format("two filters are called '{}'; give one a label of its own, or leave it out",
                                     s.contenders[i].label));
  std::vector<std::string> known;
  for (const MetricInfo& m : all_metrics()) known.emplace_back(m.id);
  for (const std::string& id : e.metrics)
    if (std::find(known.begin(), known.end(), id) == known.end())
      throw InputError(fmt::format("no metric '{}'{}", id, suggestion(id, known)));
  for (const int spp : e.study_spp)
    if (std::find(e.spp.begin(), e.spp.end(), spp) == e.spp.end())
      throw InputError(fmt::format("study_spp {} is none of the experiment's sample counts", spp));
  if (std::find(s.spp.begin(), s.spp.end(), 1) != s.spp.end())
    for (const Contender& c : s.contenders)
      if (o.chosen_filters && c.settings.entry().statistics == Statistics::kHalves)
        throw InputError(fmt::format(
            "--spp 1: {} needs two half images, and of one sample the second is empty; leave it out with -f, or begin at 2",
            c.label));
  return s;
}

/// Renders the frames of all scenes. Keeps one scene loaded, with what was recorded last.
class SceneRenderer {
 public:
  explicit SceneRenderer(const Host& host) : host_(host) {}

  TimedFrame render(const Scene& scene, const FrameRequest& request, const Task& task) {
    LayerRequest layers = LayerRequest::of(request.data.layers, request.data.statistics, request.data.buckets);
    layers.records = request.data.records;
    RenderJob job;
    job.spp = request.spp;
    job.seed = request.seed;
    job.records = request.records;
    RenderResult r = prepared(scene, layers, request.data.text(), task).render(job, task);
    stamp(r.layers);
    if (r.report.invalid_samples || r.report.counters.capped_paths || r.report.counters.limited.paths)
      host_.note(r.report.summary());
    return {std::move(r.layers), r.report.seconds};
  }

  /// Seconds of solving the light and of marching it to the pixels.
  double time_guides(const Scene& scene, int spp, const Task& task) {
    const PreparedScene fresh(scene, LayerRequest::of({"guides"}, /*statistics=*/false), quiet(task));
    Layers guides(scene.film.width, scene.film.height);
    const Stopwatch clock;
    fresh.guides(spp, task)->record(fresh.camera(), {0, 0}, guides, task);
    return clock.seconds();
  }

 private:
  const PreparedScene& prepared(const Scene& scene, const LayerRequest& layers, const std::string& data,
                                const Task& task) {
    const std::string key = scene.hash + data;
    if (!prepared_ || key != key_) {
      prepared_.reset();
      prepared_ = std::make_unique<PreparedScene>(scene, layers, Task{host_.threads, {}, task.cancel});
      key_ = key;
      for (const std::string& text : prepared_->notes()) host_.note(text);
    }
    return *prepared_;
  }

  const Host& host_;
  std::string key_;
  std::unique_ptr<PreparedScene> prepared_;
};

EvaluationScene rendered_scene(const ExperimentScene& given, int size, SceneRenderer& renderer) {
  Scene scene = read_scene(given.file, given.set);
  if (size > 0) {
    scene.film.height = std::max(1, size * scene.film.height / scene.film.width);
    scene.film.width = size;
    add_fingerprint(scene);
  }
  if (!given.name.empty()) scene.name = given.name;
  return {
      .name = scene.name,
      .hash = scene.hash,
      .exposure = scene.film.exposure,
      .render = [scene, &renderer](const FrameRequest& request,
                                   const Task& task) { return renderer.render(scene, request, task); },
      .time_guides = [scene, &renderer](int spp, const Task& task) { return renderer.time_guides(scene, spp, task); }};
}

EvaluationSequence rendered_sequence(const ExperimentSequence& given, int size, SceneRenderer& renderer) {
  EvaluationSequence sequence;
  try {
    sequence.frames = parse_frames(given.frames);
  } catch (const InputError& error) {
    throw InputError(fmt::format("[[sequences]] frames = \"{}\": {}", given.frames, error.what()));
  }
  if (sequence.frames.size() < 2)
    throw InputError(
        fmt::format("[[sequences]] frames = \"{}\": expected at least two, such as \"1-16\"", given.frames));
  for (const int frame : sequence.frames) {
    ExperimentScene scene{given.file, given.name, given.set};
    scene.set.push_back(fmt::format("render.frame={}", frame));
    sequence.scenes.push_back(rendered_scene(scene, size, renderer));
  }
  sequence.name = sequence.scenes[0].name;
  return sequence;
}

std::string content_hash(const std::vector<fs::path>& files) {
  std::string all;
  for (const fs::path& path : files) all += Cache::hash_contents(path);
  return Cache::hash(all);
}

EvaluationScene foreign_scene(const ExperimentFrames& given, const Host& host) {
  std::vector<fs::path> references = {given.reference};
  if (!given.second_reference.empty()) references.push_back(given.second_reference);
  std::vector<fs::path> all = references;
  all.insert(all.end(), given.noisy.begin(), given.noisy.end());
  const Layers first = outline_of(read_exr_info(given.reference));
  int width = 0, height = 0;
  for (const fs::path& path : all) {
    const ExrInfo info = read_exr_info(path);
    if (path != given.reference && (info.data.width() != width || info.data.height() != height))
      throw InputError(fmt::format("{}: has {} x {} pixels, expected {} x {} as in {}", path.string(),
                                   info.data.width(), info.data.height(), width, height, given.reference.string()));
    const auto space = [](const std::map<std::string, Attribute>& header) {
      return name_of(chromaticities_of(header).value_or(kRec709));
    };
    if (space(info.header) != space(first.header))
      throw InputError(fmt::format("{}: its colours are {}, those of {} are {}; expected one colour space",
                                   path.string(), space(info.header), given.reference.string(), space(first.header)));
    width = info.data.width();
    height = info.data.height();
  }
  EvaluationScene scene;
  scene.name = given.name;
  scene.hash = content_hash(all);
  scene.exposure = given.exposure > 0 ? given.exposure : choose_exposure("header", first);
  scene.foreign = {static_cast<int>(references.size()), given.spp, static_cast<int>(given.noisy.size())};
  scene.render = [references, given, &host](const FrameRequest& request, const Task&) {
    const bool is_reference = request.seed >= kReferenceSeed;
    const auto index = static_cast<size_t>(request.seed - (is_reference ? kReferenceSeed : kFirstNoisySeed));
    return TimedFrame{read_frame(ExrFile((is_reference ? references : given.noisy).at(index)), host), 0};
  };
  return scene;
}

/// The commit says which sources a program was built from, its contents also what was not yet committed.
std::string program_version() {
  return fmt::format("{} {}", version_text(), content_hash({"/proc/self/exe"}).substr(0, 8));
}

/// PNGs beside the plots, by rsvg-convert.
void draw_plots(const fs::path& folder, const Host& host) {
  const fs::path program = find_program("rsvg-convert");
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const fs::path& plot = entry.path();
    if (plot.extension() != ".svg") continue;
    if (program.empty())
      return host.note(
          "the plots are there as SVG alone: PNGs of them are made by rsvg-convert (Debian's librsvg2-bin)");
    fs::path picture = plot;
    picture.replace_extension(".png");
    Command command;
    command.program = program;
    command.words = {"rsvg-convert", "--zoom=2", "-o", picture.string(), plot.string()};
    if (const CommandEnd end = run_command(command, host.silent()); !end.good())
      host.say(Host::Word::kWarning, fmt::format("{}: rsvg-convert made no PNG of it (exit status {})",
                                                 plot.filename().string(), end.status));
  }
}

Evaluation measure(const EvaluateOptions& options, const fs::path& cache_folder, const Host& host) {
  const Experiment& experiment = options.experiment;
  const EvaluationSettings settings = settings_of(options, host);
  const Cache cache(cache_folder, program_version());
  if (!cache.others().empty())
    host.note(fmt::format("{} holds results of another version too, which are not used: {}", cache_folder.string(),
                          join(cache.others())));
  SceneRenderer renderer(host);
  std::vector<EvaluationScene> scenes;
  for (const ExperimentScene& scene : experiment.scenes)
    scenes.push_back(rendered_scene(scene, experiment.size, renderer));
  for (const ExperimentFrames& frames : experiment.frames) scenes.push_back(foreign_scene(frames, host));
  std::vector<EvaluationSequence> sequences;
  for (const ExperimentSequence& sequence : experiment.sequences)
    sequences.push_back(rendered_sequence(sequence, experiment.size, renderer));
  for (const EvaluationScene& scene : scenes)
    if (scene.name.empty() || scene.name.find('/') != std::string::npos)
      throw InputError(fmt::format("a scene is named '{}'; expected what can be part of a file's name", scene.name));
  for (size_t i = 0; i < scenes.size(); ++i)
    for (size_t k = 0; k < i; ++k)
      if (scenes[i].name == scenes[k].name)
        throw InputError(fmt::format("two scenes are named '{}'; give each its own name", scenes[i].name));
  // After all that may be refused, which is one line.
  if (const std::string remark = remark_on_parts(settings); !remark.empty()) host.note(remark);
  if (const std::string remark = remark_on_others(settings); is_any_searched(settings) && !remark.empty())
    host.note(remark);

  size_t stage = 0;
  const size_t stages = stage_count(scenes, settings) + stage_count(sequences, settings);
  const auto task_of = [&](const std::string& name) {
    return host.task(fmt::format("[{}/{}] {}", ++stage, stages, name));
  };
  Evaluation result = evaluate(scenes, settings, cache, task_of);
  evaluate_sequences(sequences, cache, task_of, result);
  return result;
}

}  // namespace

Evaluation evaluate_experiment(const EvaluateOptions& options, const Host& host) {
  std::optional<OutputFolder> folder;
  if (!options.output.empty()) folder.emplace(options.output.string());
  // Frames may be many and large: beside the results, where there is to be room for them.
  std::optional<ScratchFolder> scratch;
  fs::path cache = options.cache;
  if (cache.empty()) cache = folder ? folder->part() / "cache" : scratch.emplace().path();
  Evaluation result = measure(options, cache, host);
  if (!folder) return result;
  if (options.cache.empty()) fs::remove_all(cache);
  write_report(result, folder->part());
  draw_plots(folder->part(), host);
  folder->commit();
  return result;
}

}  // namespace brume
