#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "app/command.h"
#include "app/filter_options.h"
#include "base/error.h"
#include "base/text.h"
#include "evaluate/report.h"
#include "render/frame/renderer.h"
#include "render/scene/scene_io.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<std::string> scenes, overrides, filters;
  std::string output, spp = "16,36,64";
  int seeds = 5, reference_spp = 4096, size = 0;
  bool no_tuning = false;
  FilterOptions common{.component = "indirect"};  // as the papers do
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

/// A lock on a file that its process holds until it ends, however it ends.
class FileLock {
 public:
  /// Makes the file and locks it before it gets its name, so that nobody sees it without its lock.
  static FileLock make(const fs::path& path) {
    const fs::path unnamed = path.string() + ".new";
    FileLock lock(open(unnamed.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666));
    std::error_code error;
    if (lock.held()) fs::rename(unnamed, path, error);
    if (!lock.held() || error) throw InputError(fmt::format("{}: cannot be written", path.string()));
    return lock;
  }
  /// Locks a file that is there; not held where another process holds it, or there is no such file.
  static FileLock take(const fs::path& path) { return FileLock(open(path.c_str(), O_RDWR | O_CLOEXEC)); }
  ~FileLock() {
    if (file_ >= 0) close(file_);
  }
  FileLock(FileLock&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
  bool held() const { return file_ >= 0; }

 private:
  explicit FileLock(int file) : file_(file) {
    if (file_ >= 0 && flock(file_, LOCK_EX | LOCK_NB) != 0) {
      close(file_);
      file_ = -1;
    }
  }
  int file_;
};

/// Results are written beside the target under a name of this run alone and moved in when they are whole. What else
/// lies in the target stays; files of an earlier evaluation are replaced. What killed runs have left is removed.
class OutputFolder {
 public:
  explicit OutputFolder(const std::string& path) : path_(fs::absolute(path + "/x").lexically_normal().parent_path()) {
    if (fs::exists(path_) && !fs::is_directory(path_))
      throw InputError(fmt::format("{}: is a file, expected the name of a folder to write", path));
    const std::string prefix = path_.string() + ".part.";
    std::error_code error;
    fs::create_directories(path_.parent_path(), error);
    remove_abandoned(prefix);
    std::string name = prefix + "XXXXXX";
    if (!mkdtemp(name.data()))
      throw InputError(fmt::format("{}: cannot be made: {}", name, std::generic_category().message(errno)));
    part_ = name;
    lock_.emplace(FileLock::make(part_ / kLock));
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
      if (entry.path().filename() == kLock) continue;
      fs::rename(entry.path(), path_ / entry.path().filename(), error);
      if (error) throw InputError(fmt::format("{}: cannot be written: {}", path_.string(), error.message()));
    }
  }

 private:
  static constexpr const char* kLock = "in_use";

  static void remove_abandoned(const std::string& prefix) {
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator(fs::path(prefix).parent_path(), ignored)) {
      if (!entry.path().string().starts_with(prefix)) continue;
      const FileLock lock = FileLock::take(entry.path() / kLock);
      if (lock.held()) fs::remove_all(entry.path(), ignored);
    }
  }

  fs::path path_, part_;
  std::optional<FileLock> lock_;
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

  if (std::find(settings.spp.begin(), settings.spp.end(), 1) != settings.spp.end())
    for (const Contender& c : settings.contenders)
      if (c.settings.entry().statistics == Statistics::kHalves)
        throw InputError(
            fmt::format("--spp 1: {} needs two half images, and of one sample the second is empty; leave it out with "
                        "-f, or begin at 2",
                        c.label));

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
    job.spp = spp;
    job.seed = seed;
    job.records = records;
    RenderResult r = scene.render(job, task);
    stamp(r.layers);
    if (r.report.invalid_samples || r.report.counters.capped_paths) note(r.report.summary());
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
    for (const std::string& text : full->notes()) note(text);
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
