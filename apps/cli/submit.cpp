#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/cli/command.h"
#include "apps/cli/frame.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "base/text.h"
#include "farm/opencue.h"
#include "farm/plan.h"
#include "farm/progress.h"
#include "farm/shot.h"
#include "farm/slurm.h"
#include "farm/submit_lock.h"
#include "filters/api/registry.h"
#include "render/scene/scene_io.h"
#include "workflows/clean.h"
#include "workflows/scene.h"
#include "workflows/version.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string action, target, folder, frames, layers = "direct,indirect,gradient,coverage,transmittance",
                                              filter = "transport_regression", program;
  std::vector<std::string> overrides;
  int parts = 1, spp = 0, window = -1, after = 0;
  int64_t seed = -1;
  bool clean = false, buckets = false, keep_parts = false, dry_run = false, break_lock = false;
  SlurmOptions slurm;
  std::vector<std::string> slurm_given;  // which of its options stand on the command line
};

/// Names a writer for every time that a line runs, also where one shell runs several at once.
constexpr const char* kWriter = "BRUME_WRITER=$(uname -n).$(mktemp -u XXXXXXXXXX) ";

std::string fingerprint_of_scenes(const Shot& shot) {
  std::string text = read_text(shot.scene);
  if (FramePattern::of(shot.scene))
    for (const int frame : shot.frames) text += read_text(file_of_frame(shot.scene, frame));
  return fingerprint(text);
}

/// The scene of a frame, without reading volumes. @throws InputError
Scene scene_of(const Shot& shot, int frame) {
  std::vector<std::string> overrides = shot.overrides;
  overrides.push_back(fmt::format("render.frame={}", frame));
  return read_scene_alone(file_of_frame(shot.scene, frame), overrides);
}

/// The frames whose scenes cannot be read, say why: a sequence with gaps is not submitted.
Scene check_scenes(const Shot& shot) {
  std::vector<int> bad;
  std::string why;
  Scene first;
  for (const int frame : shot.frames) try {
      Scene scene = scene_of(shot, frame);
      if (frame == shot.frames.front()) first = std::move(scene);
    } catch (const InputError& error) {
      if (bad.empty()) why = error.what();
      bad.push_back(frame);
    }
  if (!bad.empty())
    throw InputError(
        fmt::format("frame{} {} cannot be rendered: {}", bad.size() > 1 ? "s" : "", frames_text(bad), why));
  return first;
}

/// What the command line asks for. @throws InputError
Shot asked_shot(const Options& o, const Common& common) {
  if (o.frames.empty()) throw InputError("no frames; expected --frames 1-240");
  if (o.folder.empty()) throw InputError("no folder for the shot; expected -o FOLDER");
  Shot shot;
  shot.folder = fs::absolute(o.folder).lexically_normal();
  if (shot.folder.filename().empty()) shot.folder = shot.folder.parent_path();
  shot.scene = fs::absolute(o.target).lexically_normal().string();
  shot.overrides = o.overrides;
  shot.frames = parse_frames(o.frames);
  const fs::path first = file_of_frame(shot.scene, shot.frames.front());
  if (is_volume(first))
    throw InputError(fmt::format(
        "{}: is a bare volume, around which each machine would make up its own scene; expected a scene, which brume render {} --save-scene shot.toml --explain makes",
        o.target, o.target));
  const Scene scene = check_scenes(shot);
  shot.name = scene.name;
  if (const size_t place =
          shot.name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+");
      place != std::string::npos)
    shot.name = fs::path(shot.scene).stem().stem().string();
  shot.scene_text = fingerprint_of_scenes(shot);
  shot.program = version_text();
  shot.brume = o.program.empty() ? fs::read_symlink("/proc/self/exe").string() : o.program;
  shot.parts = o.parts;
  shot.spp = o.spp > 0 ? o.spp : scene.render.spp;
  shot.seed = o.seed >= 0 ? o.seed : scene.render.seed;
  if (shot.parts > shot.spp)
    throw InputError(
        fmt::format("--parts {}: {} samples per pixel cannot be shared by {} parts", o.parts, shot.spp, shot.parts));
  LayerRequest layers = LayerRequest::of(
      o.layers.empty() || o.layers == "none" ? std::vector<std::string>{} : split(o.layers, ','), true, o.buckets);
  if (o.clean) {
    layers = Cleaner(o.filter, scene.film.exposure, {}).request(layers, shot.spp);
    shot.filter = o.filter;
    const FilterSettings settings = parse_filter(o.filter);
    const FilterEntry& filter = settings.entry();
    if (o.window > 0 && !filter.sequences)
      throw InputError(fmt::format("--window {}: {} cleans every frame by itself", o.window, filter.name));
    shot.window = o.window >= 0 ? o.window : filter.frame_window;
  }
  shot.layers = join(layers.text(), ",");
  shot.statistics = layers.buckets ? "buckets" : "halves";
  shot.threads = common.threads;
  shot.keep_parts = o.keep_parts;
  return shot;
}

/// The shot that is asked for: a new one, or what a folder holds.
Shot chosen_shot(const Options& o, const Common& common) {
  if (fs::is_directory(o.target)) {
    if (!o.frames.empty() || !o.folder.empty())
      throw InputError(
          fmt::format("{} is a shot's folder, which says what its frames are; expected no --frames, no -o", o.target));
    Shot shot = Shot::load(o.target);
    if (shot.program != version_text())
      throw InputError(fmt::format("{}: is rendered by {}, this is {}; expected the same program for the whole shot",
                                   o.target, shot.program, version_text()));
    if (fingerprint_of_scenes(shot) != shot.scene_text)
      throw InputError(fmt::format(
          "{}: the scene {} has changed since it was submitted; expected it as it was, or another folder for the new shot",
          o.target, shot.scene));
    return shot;
  }
  return asked_shot(o, common);
}

/// Refuses a shot whose folder holds another one. @return whether the folder holds this one
bool is_in_folder(const Options& o, const Shot& shot) {
  if (!fs::exists(shot.folder / "shot.json")) return false;
  const std::string difference = Shot::load(shot.folder).difference(shot);
  if (!difference.empty())
    throw InputError(fmt::format(
        "{}: holds another shot: {}; expected another folder, or the same again to complete it", o.folder, difference));
  return true;
}

void tell_plan(const Common& common, const std::vector<Stage>& stages) {
  if (stages.empty()) log(common, "nothing is missing");
  for (const Stage& stage : stages) log(common, fmt::format("{}: {} commands", stage.name, stage.commands.size()));
}

/// Jobs that were killed leave what they had written aside.
void remove_leftovers(const Shot& shot) {
  std::error_code error;
  for (fs::recursive_directory_iterator entry(shot.folder, error), end; !error && entry != end; entry.increment(error))
    if (entry->path().extension() == ".part") {
      std::error_code ignored;
      fs::remove(entry->path(), ignored);
    }
}

int submit(const Options& o, const Common& common) {
  if (o.action == "resume" && !fs::is_directory(o.target))
    throw InputError(fmt::format("{}: expected the folder of a shot", o.target));
  const Shot shot = chosen_shot(o, common);
  SlurmOptions slurm = SlurmOptions::load(shot);
  if (!fs::exists(shot.folder / "slurm.json")) slurm = o.slurm;
  const auto given = [&](const char* option) {
    return std::find(o.slurm_given.begin(), o.slurm_given.end(), option) != o.slurm_given.end();
  };
  if (given("--sbatch")) slurm.sbatch = o.slurm.sbatch;
  if (given("--time")) slurm.time = o.slurm.time;
  if (given("--tasks")) slurm.most_tasks = o.slurm.most_tasks;
  if (given("--at-once")) slurm.at_once = o.slurm.at_once;
  if (given("--warning")) slurm.warning_seconds = o.slurm.warning_seconds;
  if (given("--retries")) slurm.retries = o.slurm.retries;
  const bool to_slurm = o.action == "slurm" || o.action == "resume";
  shot.check();
  if (to_slurm) check_slurm(shot, slurm);
  std::optional<SubmitLock> lock;
  if (!o.dry_run) lock.emplace(shot.folder, o.break_lock);
  if (lock && !lock->broken().empty()) log(common, "broke the lock of " + lock->broken());
  const bool exists = is_in_folder(o, shot);
  if (exists) {
    const SlurmQueue queue = ask_slurm(shot);
    if (!queue.jobs.empty() && !o.dry_run)
      throw InputError(fmt::format("{}: Slurm is still at work on it; wait, or scancel {}", shot.folder.string(),
                                   join(queue.jobs, " ")));
    // Who works without Slurm may be writing right now.
    if (!o.dry_run && queue.known) remove_leftovers(shot);
  }
  if (o.after > 0) slurm.exclude = failing_nodes(shot, o.after);
  const std::vector<Stage> stages =
      exists ? plan(shot, examine(shot, /*thorough=*/true, {common.threads, {}, &interrupted})) : plan(shot);
  tell_plan(common, stages);
  if (stages.empty()) return kDone;
  fs::path round = shot.folder / "rounds" / std::to_string(last_round(shot) + 1);
  if (!o.dry_run) {
    shot.save();
    round = write_round(shot, stages);
    if (to_slurm && o.after == 0) slurm.save(shot);
  }
  if (o.action == "commands") {
    std::string text;
    for (const Stage& stage : stages) {
      if (!text.empty()) text += "\n";
      for (const ShotCommand& command : stage.commands) text += command.prepare + kWriter + command.call + "\n";
    }
    print(text);
  } else if (o.action == "opencue") {
    print(opencue_outline(shot, stages, round));
  } else {
    const std::vector<SlurmJob> jobs = slurm_jobs(shot, stages, round, slurm);
    if (o.dry_run) {
      print(join(sbatch_lines(jobs, round), "\n") + "\n");
      for (const SlurmJob& job : jobs)
        print(fmt::format("\n# {}\n{}", (round / (job.stage + ".sh")).string(), job.script));
      return kDone;
    }
    const std::map<std::string, std::string> numbers = submit_to_slurm(jobs, round);
    for (const SlurmJob& job : jobs) print(fmt::format("{} {}\n", job.stage, numbers.at(job.stage)));
  }
  return kDone;
}

nlohmann::json json_of(const StageProgress& stage) {
  nlohmann::json j;
  j["done"] = stage.done;
  j["total"] = stage.total;
  j["running"] = nlohmann::json::array();
  j["failed"] = nlohmann::json::array();
  for (const StageProgress::Running& r : stage.running)
    j["running"].push_back({{"command", r.name}, {"node", r.node}, {"percent", std::max(r.percent, 0)}});
  for (const StageProgress::Failed& f : stage.failed)
    j["failed"].push_back({{"command", f.name}, {"node", f.node}, {"why", f.why}});
  return j;
}

std::string text_of(const StageProgress& stage) {
  std::string text = fmt::format("{:<8} {:>6} of {:>6} done", stage.name, stage.done, stage.total);
  if (!stage.running.empty()) text += fmt::format(", {} running", stage.running.size());
  if (!stage.failed.empty()) text += fmt::format(", {} failed", stage.failed.size());
  return text + "\n";
}

std::string details_of(const StageProgress& stage) {
  std::string text;
  for (const StageProgress::Running& r : stage.running)
    text += fmt::format("running  {} on {}{}\n", r.name, r.node, r.percent < 0 ? "" : fmt::format(", {} %", r.percent));
  for (const StageProgress::Failed& f : stage.failed)
    text += fmt::format("failed   {} on {}: {}\n", f.name, f.node, f.why);
  return text;
}

int status(const Options& o, const Common& common) {
  if (!fs::is_directory(o.target)) throw InputError(fmt::format("{}: expected the folder of a shot", o.target));
  const Shot shot = Shot::load(o.target);
  const ShotProgress progress = progress_of(shot, {common.threads, {}, &interrupted});
  if (common.json) {
    nlohmann::json j;
    j["frames"] = shot.frames;
    j["done"] = progress.frames_done;
    j["complete"] = progress.complete;
    j["refused"] = progress.refused;
    if (progress.seconds_left) j["seconds_left"] = *progress.seconds_left;
    for (const StageProgress& stage : progress.stages) j["stages"][stage.name] = json_of(stage);
    print(j.dump(2) + "\n");
  } else {
    const std::vector<int>& done = progress.frames_done;
    std::string text = fmt::format("{}: {} of {} frames are complete{}\n", shot.name, done.size(), shot.frames.size(),
                                   done.empty() ? "" : fmt::format(" ({})", frames_text(done)));
    for (const StageProgress& stage : progress.stages) text += text_of(stage);
    for (const StageProgress& stage : progress.stages) text += details_of(stage);
    for (const std::string& file : progress.refused) text += "refused  " + file + "\n";
    if (!progress.complete)
      text += progress.seconds_left
                  ? fmt::format("time left: {}, {} at work\n", format_duration(*progress.seconds_left),
                                std::max(progress.running(), 1))
                  : "time left: not known before a command of every stage has ended\n";
    print(text);
  }
  return progress.complete ? kDone : kThresholdFailed;
}

}  // namespace

void add_submit(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command =
      add_command(app, common, "submit", "render and clean a sequence on a farm, and see how far it is");
  command(
      "action", o.action,
      "slurm: submit job arrays; commands: print one command a line, stages apart by an empty line; opencue: print a script that launches it there; status: what is done, running, failed, and the time left; resume: submit to Slurm what is missing")
      ->required()
      ->check(CLI::IsMember({"slurm", "commands", "opencue", "status", "resume"}));
  command("target", o.target, "scene (TOML) of a new shot, or the folder of one: what is missing of it")->required();
  command("-o,--output", o.folder, "folder for all that the shot makes, which every machine sees");
  command("--frames", o.frames, "7, 1-240, 1-240x2, or several with commas between");
  command("--parts", o.parts, "shares of each frame's samples, rendered apart and merged")
      ->check(CLI::Range(1, 1'000'000))
      ->capture_default_str();
  command("--clean", o.clean, "clean the frames too");
  command("--clean-filter", o.filter, "by this filter: NAME or NAME:parameter=value,...")->capture_default_str();
  command("--window", o.window,
          "frames before and after that cleaning looks into; unless given as many as the filter declares")
      ->check(CLI::Range(0, 100));
  command("--spp", o.spp, "paths per pixel instead of the scene's")->check(CLI::Range(1, 1 << 24));
  command("--seed", o.seed, "seed instead of the scene's")->check(CLI::NonNegativeNumber);
  command("-D", o.overrides, "set a key of the scene: -D camera.fov=30")->allow_extra_args(false);
  add_size_option(command, o.overrides);
  command("--layers", o.layers, "layers to record; with --clean direct,indirect unless given")->capture_default_str();
  command("--buckets", o.buckets, "record eight bucket means of each layer too");
  command("--keep-parts", o.keep_parts, "keep the parts after they are merged");
  command("--program", o.program, "brume as the nodes call it, where it is not this file");
  command("--dry-run", o.dry_run, "print what would be submitted, and write nothing");
  command("--break-lock", o.break_lock,
          "submit even if another process holds the shot's lock: where that one was killed");
  command("--json", common.json, "status for machines");
  command("--sbatch", o.slurm.sbatch, "Slurm: an option for every job, as --sbatch=--partition=render; repeat")
      ->allow_extra_args(false);
  command("--time", o.slurm.time, "Slurm: limit of a task, after which it goes on from its checkpoint")
      ->capture_default_str();
  command("--tasks", o.slurm.most_tasks, "Slurm: tasks of one array at most, below its MaxArraySize")
      ->check(CLI::Range(1, 4'000'000))
      ->capture_default_str();
  command("--at-once", o.slurm.at_once, "Slurm: tasks that run at the same time; 0: all")
      ->check(CLI::Range(0, 4'000'000))
      ->capture_default_str();
  command("--warning", o.slurm.warning_seconds, "Slurm: seconds before the limit for the last checkpoint")
      ->check(CLI::Range(10, 3600))
      ->capture_default_str();
  command("--retries", o.slurm.retries, "Slurm: rounds after the first for what has failed")
      ->check(CLI::Range(0, 100))
      ->capture_default_str();
  command("--after", o.after, "the round that is retried: for the job that does so")->group("");
  commands[command] = [options, &common, command] {
    if (options->clean && command->count("--layers") == 0) options->layers = "direct,indirect";
    for (const char* option : {"--sbatch", "--time", "--tasks", "--at-once", "--warning", "--retries"})
      if (command->count(option) > 0) options->slurm_given.emplace_back(option);
    return options->action == "status" ? status(*options, common) : submit(*options, common);
  };
}

}  // namespace brume::app
