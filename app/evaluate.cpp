#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "app/command.h"
#include "app/filter_options.h"
#include "base/error.h"
#include "base/text.h"
#include "evaluate/report.h"
#include "render/renderer.h"
#include "render/scene_io.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<std::string> scenes, overrides, filters;
  std::string output, spp = "16,36,64";
  int seeds = 5, reference_spp = 4096, size = 0;
  bool no_tuning = false;
  FilterOptions common;
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

/// Results are written beside the target under another name and moved in when they are whole. What else lies in the
/// target stays; files of an earlier evaluation are replaced.
class OutputFolder {
 public:
  explicit OutputFolder(const std::string& path)
      : path_(fs::absolute(path + "/x").lexically_normal().parent_path()), part_(path_.string() + ".part") {
    std::error_code error;
    if (fs::exists(path_) && !fs::is_directory(path_))
      throw InputError(fmt::format("{}: is a file, expected the name of a folder to write", path));
    if (fs::exists(part_))
      throw InputError(fmt::format("{}: exists, left by another run or still in use; remove it first", part_.string()));
    fs::create_directories(part_, error);
    if (error) throw InputError(fmt::format("{}: cannot be made: {}", part_.string(), error.message()));
  }
  ~OutputFolder() {
    std::error_code ignored;
    fs::remove_all(part_, ignored);
  }
  const fs::path& part() const { return part_; }
  void commit() {
    std::error_code error;
    fs::create_directories(path_, error);
    for (const auto& entry : fs::directory_iterator(part_)) {
      fs::rename(entry.path(), path_ / entry.path().filename(), error);
      if (error) throw InputError(fmt::format("{}: cannot be written: {}", path_.string(), error.message()));
    }
  }

 private:
  fs::path path_, part_;
};

int run(const Common& common) {
  EvaluationSettings settings;
  settings.spp = parse_spp(o.spp);
  settings.seeds = o.seeds;
  settings.reference_spp = o.reference_spp;
  settings.tune = !o.no_tuning;
  settings.component = o.common.chosen_component();
  settings.background = o.common.chosen_background();
  if (o.filters.empty()) settings.contenders = all_contenders();
  for (const std::string& text : o.filters) settings.contenders.push_back(parse_contender(text));

  OutputFolder folder(o.output);

  const RecordedData data = data_to_record(settings);
  LayerRequest layers = LayerRequest::of(data.layers, data.statistics, data.buckets);
  layers.records = data.records;
  if (data.records) {
    settings.records = folder.part() / "records";
    fs::create_directories(settings.records);
  }
  const LayerRequest plain = LayerRequest::of({"direct", "indirect", "coverage"}, /*statistics=*/false);
  std::vector<std::unique_ptr<PreparedScene>> prepared;
  std::vector<EvaluationScene> scenes;
  const auto render = [](const PreparedScene& scene, int spp, int64_t seed, const fs::path& records, const Task& task) {
    RenderJob job;
    job.spp = spp, job.seed = seed, job.records = records;
    RenderResult r = scene.render(job, task);
    stamp(r.layers);
    if (r.report.invalid_samples || r.report.counters.capped_paths) warn("note: " + r.report.summary());
    return TimedFrame{std::move(r.layers), r.report.seconds, records};
  };
  for (const std::string& path : o.scenes) {
    Scene scene = read_scene(path, o.overrides);
    if (o.size > 0) {
      scene.film.height = std::max(1, o.size * scene.film.height / scene.film.width);
      scene.film.width = o.size;
    }
    const auto prepare = [&](const LayerRequest& what) {
      return prepared.emplace_back(std::make_unique<PreparedScene>(scene, what, Task{common.threads, {}, &interrupted}))
          .get();
    };
    const PreparedScene *full = prepare(layers), *reference = prepare(plain);
    for (const std::string& note : full->notes()) warn("note: " + note);
    for (const EvaluationScene& other : scenes)
      if (other.name == full->scene().name)
        throw InputError(fmt::format("two scenes are named '{}'; give each its own name", other.name));
    scenes.push_back({full->scene().name, full->scene().film.exposure,
                      [full, render](int spp, int64_t seed, const fs::path& records, const Task& task) {
                        return render(*full, spp, seed, records, task);
                      },
                      [reference, render](int spp, int64_t seed, const Task& task) {
                        return render(*reference, spp, seed, {}, task);
                      }});
  }
  size_t stage = 0;
  const size_t stages = stage_count(settings, scenes.size());
  const Evaluation result = evaluate(scenes, settings, [&](const std::string& name) {
    return make_task(common, fmt::format("[{}/{}] {}", ++stage, stages, name));
  });
  if (!settings.records.empty()) fs::remove_all(settings.records);
  write_report(result, folder.part());
  folder.commit();
  print(common.json ? json_report(result) : markdown_report(result));
  log(common, fmt::format("\nEXRs, strips, plots and the table are in {}", o.output));
  return kDone;
}

}  // namespace

void add_evaluate(CLI::App& app, Common& common, Commands& commands) {
  CLI::App* command = add_command(app, common, "evaluate",
                                  "compare the filters: references, noisy frames, tuning, tables, strips, plots");
  command->add_option("scenes", o.scenes, "scene files; with several, parameters are also transferred between them")
      ->required();
  command->add_option("-o,--output", o.output, "folder to write")->required();
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
  command->add_flag("--json", common.json, "the table as JSON on stdout");
  commands[command] = [&common] { return run(common); };
}

}  // namespace brume::app
