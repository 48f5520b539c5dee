#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <thread>

#include "app/command.h"
#include "app/experiment_file.h"
#include "app/filter_options.h"
#include "app/frame.h"
#include "app/output_folder.h"
#include "app/program.h"
#include "base/error.h"
#include "base/sequence.h"
#include "base/text.h"
#include "evaluate/protocol/sequences.h"
#include "evaluate/report/page.h"
#include "evaluate/report/report.h"
#include "filters/api/registry.h"
#include "image/exr_io.h"
#include "render/frame/renderer.h"
#include "render/scene/scene_fingerprint.h"
#include "render/scene/scene_io.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<std::string> scenes, overrides, filters;
  std::string output, cache, spp = "16,36,64";
  int seeds = 5, reference_spp = 4096, size = 0;
  bool no_tuning = false;
  FilterOptions common{.component = "indirect"};  // as the papers do
  CLI::App* command = nullptr;
} o;

std::vector<int> parse_spp(const std::string& text) {
  std::vector<int> result;
  for (const std::string& word : split(text, ',')) {
    char* end = nullptr;
    const long value = std::strtol(word.c_str(), &end, 10);
    if (word.empty() || *end || value < 1 || value > 1 << 20)
      throw InputError(fmt::format("--spp {}: expected sample counts such as 16,36,64", text));
    result.push_back(static_cast<int>(value));
  }
  return result;
}

/// What is to be done: the file's words, and over them the command line's.
Experiment chosen_experiment() {
  Experiment e;
  const bool from_file = is_experiment(o.scenes.front());
  if (from_file) {
    if (o.scenes.size() > 1)
      throw InputError(fmt::format("{} is an experiment, which names its scenes; give it alone", o.scenes.front()));
    e = read_experiment(o.scenes.front());
  }
  const auto given = [&](const char* option) { return !from_file || o.command->count(option) > 0; };
  if (given("--spp")) e.spp = parse_spp(o.spp);
  if (given("--seeds")) e.seeds = o.seeds;
  if (given("--reference-spp")) e.reference_spp = o.reference_spp;
  if (given("--size")) e.size = o.size;
  if (given("--component")) e.component = o.common.component;
  if (given("--background")) e.background = o.common.background;
  if (o.no_tuning) e.search = false;
  if (!from_file)
    for (const std::string& path : o.scenes) e.scenes.push_back({path, "", {}});
  for (ExperimentScene& scene : e.scenes) scene.set.insert(scene.set.end(), o.overrides.begin(), o.overrides.end());
  if (!o.filters.empty()) {
    e.filters.clear();
    for (const std::string& text : o.filters) {
      const size_t colon = text.find(':');
      e.filters.push_back({text.substr(0, colon), colon == std::string::npos ? "" : text.substr(colon + 1), "", {}});
    }
  }
  return e;
}

Contender contender_of(const ExperimentFilter& filter) {
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

EvaluationSettings settings_of(const Experiment& e, const Common& common) {
  EvaluationSettings s;
  const FilterOptions how{e.component, e.background};
  s.spp = e.spp;
  s.seeds = e.seeds;
  s.reference_spp = e.reference_spp;
  s.reference_noise = e.reference_noise;
  s.most_reference_spp = e.most_reference_spp;
  s.tune = e.search;
  s.restarts = e.restarts;
  s.component = how.chosen_component();
  s.background = how.chosen_background();
  s.time_limit = e.time_limit;
  s.time_layers = e.time_layers;
  s.all_layers = !o.cache.empty();
  s.ablation = e.ablation;
  s.sensitivity = e.sensitivity;
  s.study_spp = e.study_spp;
  s.name = e.name;
  s.text = e.text;
  s.provenance = {version_number(), version_commit(), common.command, processor_name(),
                  common.threads > 0 ? common.threads : static_cast<int>(std::thread::hardware_concurrency())};
  if (e.filters.empty()) s.contenders = all_contenders();
  for (const ExperimentFilter& filter : e.filters) s.contenders.push_back(contender_of(filter));
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
  s.metrics = e.metrics;
  for (const int spp : e.study_spp)
    if (std::find(e.spp.begin(), e.spp.end(), spp) == e.spp.end())
      throw InputError(fmt::format("study_spp {} is none of the experiment's sample counts", spp));
  if (std::find(s.spp.begin(), s.spp.end(), 1) != s.spp.end())
    for (const Contender& c : s.contenders)
      if (!o.filters.empty() && c.settings.entry().statistics == Statistics::kHalves)
        throw InputError(
            fmt::format("--spp 1: {} needs two half images, and of one sample the second is empty; leave it out with "
                        "-f, or begin at 2",
                        c.label));
  return s;
}

/// Renders the frames of all scenes. Keeps one scene loaded, with what was recorded last.
class SceneRenderer {
 public:
  explicit SceneRenderer(const Common& common) : common_(common) {}

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
      note(r.report.summary());
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
      prepared_ = std::make_unique<PreparedScene>(scene, layers, Task{common_.threads, {}, task.cancel});
      key_ = key;
      for (const std::string& text : prepared_->notes()) note(text);
    }
    return *prepared_;
  }

  const Common& common_;
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
  for (const fs::path& path : files) {
    std::ifstream stream(path, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(stream)), {});
    all += Cache::hash(bytes);
  }
  return Cache::hash(all);
}

EvaluationScene foreign_scene(const ExperimentFrames& given, const Common& common) {
  std::vector<fs::path> references = {given.reference};
  if (!given.second_reference.empty()) references.push_back(given.second_reference);
  std::vector<fs::path> all = references;
  all.insert(all.end(), given.noisy.begin(), given.noisy.end());
  const Layers first = read_outline(given.reference.string());
  int width = 0, height = 0;
  for (const fs::path& path : all) {
    const ExrInfo info = read_exr_info(path);
    if (path != given.reference && (info.data.width() != width || info.data.height() != height))
      throw InputError(fmt::format("{}: has {} x {} pixels, expected {} x {} as in {}", path.string(),
                                   info.data.width(), info.data.height(), width, height, given.reference.string()));
    width = info.data.width();
    height = info.data.height();
  }
  EvaluationScene scene;
  scene.name = given.name;
  scene.hash = content_hash(all);
  scene.exposure = given.exposure > 0 ? given.exposure : choose_exposure("header", first);
  scene.foreign = {static_cast<int>(references.size()), given.spp, static_cast<int>(given.noisy.size())};
  scene.render = [references, given, &common](const FrameRequest& request, const Task&) {
    const bool is_reference = request.seed >= kReferenceSeed;
    const auto index = static_cast<size_t>(request.seed - (is_reference ? kReferenceSeed : kFirstNoisySeed));
    return TimedFrame{read_frame(common, (is_reference ? references : given.noisy).at(index).string()), 0};
  };
  return scene;
}

/// The commit says which sources a program was built from, its contents also what was not yet committed.
std::string program_version() {
  return fmt::format("{} {}", version_text(), content_hash({"/proc/self/exe"}).substr(0, 8));
}

/// PNGs beside the plots, by rsvg-convert.
void draw_plots(const fs::path& folder) {
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const fs::path& plot = entry.path();
    if (plot.extension() != ".svg") continue;
    fs::path picture = plot;
    picture.replace_extension(".png");
    if (const auto status = run_program({"rsvg-convert", "--zoom=2", "-o", picture.string(), plot.string()}); !status) {
      note("the plots are there as SVG alone: PNGs of them are made by rsvg-convert (Debian's librsvg2-bin)");
      return;
    } else if (*status != 0) {
      warn(fmt::format("{}: rsvg-convert made no PNG of it (exit status {})", plot.filename().string(), *status));
    }
  }
}

int run(const Common& common) {
  const Experiment experiment = chosen_experiment();
  const EvaluationSettings settings = settings_of(experiment, common);
  OutputFolder folder(o.output);
  const fs::path own_cache = folder.part() / "cache";
  const Cache cache(o.cache.empty() ? own_cache : fs::path(o.cache), program_version());
  if (!cache.others().empty())
    note(fmt::format("{} holds results of another version too, which are not used: {}", o.cache, join(cache.others())));

  SceneRenderer renderer(common);
  std::vector<EvaluationScene> scenes;
  for (const ExperimentScene& scene : experiment.scenes)
    scenes.push_back(rendered_scene(scene, experiment.size, renderer));
  for (const ExperimentFrames& frames : experiment.frames) scenes.push_back(foreign_scene(frames, common));
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
  if (const std::string remark = remark_on_parts(settings); !remark.empty()) note(remark);

  size_t stage = 0;
  const size_t stages = stage_count(scenes, settings) + stage_count(sequences, settings);
  const auto task_of = [&](const std::string& name) {
    return make_task(common, fmt::format("[{}/{}] {}", ++stage, stages, name));
  };
  Evaluation result = evaluate(scenes, settings, cache, task_of);
  evaluate_sequences(sequences, cache, task_of, result);
  if (o.cache.empty()) fs::remove_all(own_cache);
  write_report(result, folder.part());
  draw_plots(folder.part());
  folder.commit();
  const std::string page = !page_is_built_in() ? "no page (index.html): this program was built without Node"
                           : result.scenes.empty()
                               ? "no page (index.html), which shows scenes and frames: sequences alone have none"
                               : fmt::format("all of it in one page: open {}/index.html in a browser", o.output);
  const std::string rest =
      fmt::format("{}/table.md has every table; EXRs, strips and plots lie there, too; {}", o.output, page);
  print(common.json ? json_report(result) : short_report(result) + rest + "\n");
  log(common, fmt::format("{} frames rendered, {} results filtered; out of the cache {} and {}", result.work.rendered,
                          result.work.filtered, result.work.frames_found, result.work.results_found));
  if (common.json) log(common, rest);
  return kDone;
}

}  // namespace

void add_evaluate(CLI::App& app, Common& common, Commands& commands) {
  CLI::App* command = add_command(app, common, "evaluate",
                                  "compare the filters: references, noisy frames, tuning, tables, strips, plots");
  o.command = command;
  command
      ->add_option("scenes", o.scenes,
                   "scene files, or one experiment (docs/experiment.md); with several scenes, parameters are also "
                   "transferred between them")
      ->required();
  command
      ->add_option("-o,--output", o.output,
                   "folder to write: tables, plots, EXRs, and index.html, a page to look at it all")
      ->required();
  command->add_option("--cache", o.cache,
                      "folder that keeps all frames and results: nothing in it is made again, and an interrupted run "
                      "goes on; frames then hold what any filter may read");
  command->add_option("--spp", o.spp, "sample counts of the noisy frames")->capture_default_str();
  command->add_option("--seeds", o.seeds, "noisy frames per sample count")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--reference-spp", o.reference_spp, "of each of the two references")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  command->add_option("--size", o.size, "width in pixels instead of the scenes'")->check(CLI::Range(1, 65536));
  command->add_option("-D", o.overrides, "set a key of every scene")->allow_extra_args(false);
  command
      ->add_option("-f,--filter", o.filters, "compare only these: NAME, or NAME:parameter=value,... to fix parameters")
      ->allow_extra_args(false);
  o.common.component = "indirect";  // the papers' protocol
  o.common.add_to(*command);
  command->add_flag("--no-tuning", o.no_tuning, "published and default parameters only");
  command->add_flag("--json", common.json, "all numbers as JSON on stdout, as in results.json");
  commands[command] = [&common] {
    try {
      return run(common);
    } catch (const Interrupted&) {
      throw Interrupted(
          o.cache.empty()
              ? "no file was left half-written; with --cache DIR the same command would go on where it stopped"
              : fmt::format("no file was left half-written; what is done lies in {}: the same command goes "
                            "on from there",
                            o.cache));
    }
  };
}

}  // namespace brume::app
