#include "farm/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <tuple>

#include "base/error.h"
#include "base/output_file.h"
#include "base/shares.h"
#include "base/text.h"
#include "image/finished_frame.h"
#include "run_sh.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMark = "brume task: ";  // begins the lines of a log that its script writes

/// What is wrong with a file of a shot; empty: it is whole and of this shot.
std::string what_is_wrong(const Shot& shot, const fs::path& path, int frame, const FrameContent& content, bool thorough,
                          const Task& task) {
  const std::tuple<const char*, const char*, std::string> wanted[] = {
      {"program", "the program version", shot.program},
      {"frame", "the frame", std::to_string(frame)},
      {"seed", "the seed", std::to_string(shot.seed)},
      {"recordedLayers", "the list of layers", shot.layers},
      {"statistics", "what is kept of statistics", shot.statistics}};
  const auto differs = [&](const Layers& header) {
    for (const auto& [key, what, text] : wanted) {
      const std::optional<double> number = header.number(key);
      const std::string found = header.text(key, number ? fmt::format("{:.0f}", *number) : "");
      if (found != text) return fmt::format("{} is {} in the file, {} in the shot", what, found, text);
    }
    return content.differs(header);
  };
  return what_is_wrong_with(path, differs, thorough, task);
}

/// The samples of parts, numbered from 1 on, as render --part shares them.
FrameContent content_of(const Shot& shot, int first_part, int last_part) {
  return {end_of_share(shot.spp, first_part - 1, shot.parts), end_of_share(shot.spp, last_part, shot.parts), false, ""};
}

std::string frame_name(int frame) {
  return fmt::format("{:04}", frame);
}

ShotCommand render_command(const Shot& shot, int frame, int part) {
  std::vector<std::string> words = {shot.brume, "render", shot.scene, "--frames", std::to_string(frame)};
  for (const std::string& assignment : shot.overrides) words.insert(words.end(), {"-D", assignment});
  words.insert(words.end(), {"--spp", std::to_string(shot.spp), "--seed", std::to_string(shot.seed), "--layers",
                             shot.layers.empty() ? "none" : shot.layers});
  if (shot.statistics == "buckets") words.push_back("--buckets");
  std::string name = "render." + frame_name(frame);
  const bool whole = shot.parts == 1;
  if (!whole) {
    words.insert(words.end(), {"--part", fmt::format("{}/{}", part, shot.parts)});
    name += fmt::format(".{:05}", part);
  }
  const fs::path output = whole ? shot.frame(frame) : shot.part(frame, part);
  const fs::path checkpoint =
      whole ? fs::path(output).replace_extension(".checkpoint.exr") : shot.checkpoint(frame, part);
  words.insert(words.end(),
               {"--checkpoint", checkpoint.string(), "-o", output.string(), "--progress", "lines", "--resume"});
  if (shot.threads > 0) words.insert(words.end(), {"--threads", std::to_string(shot.threads)});
  for (std::string& word : words) word = shell_word(word);
  return {name, whole ? "" : fmt::format("mkdir -p {} && ", shell_word(output.parent_path().string())),
          join(words, " ")};
}

std::string threads_of(const Shot& shot) {
  return shot.threads > 0 ? fmt::format(" --threads {}", shot.threads) : "";
}

/// Merges files that a pattern names into one.
std::string merge_call(const Shot& shot, const fs::path& pattern, int first, int last, const fs::path& output,
                       const std::string& options) {
  return fmt::format("{} merge {} --parts {}-{} -o {} --resume{}{}{}", shell_word(shot.brume),
                     shell_word(pattern.string()), first, last, shell_word(output.string()),
                     shot.keep_parts ? "" : " --discard", options, threads_of(shot));
}

ShotCommand gather_command(const Shot& shot, int frame, int group) {
  const auto [first, last] = shot.parts_of_group(group);
  const fs::path pattern = shot.part(frame, 1).parent_path() / "#####.exr";
  return {fmt::format("gather.{}.{:05}", frame_name(frame), group), "",
          merge_call(shot, pattern, first, last, shot.group(frame, group), " --mergeable")};
}

ShotCommand merge_command(const Shot& shot, int frame) {
  const fs::path folder = shot.part(frame, 1).parent_path();
  const int groups = shot.groups();
  return {"merge." + frame_name(frame), "",
          merge_call(shot, folder / (groups > 0 ? "group.#####.exr" : "#####.exr"), 1, groups > 0 ? groups : shot.parts,
                     shot.frame(frame), "")};
}

ShotCommand denoise_command(const Shot& shot, int frame) {
  std::string missing;
  for (const int f : shot.window_of(frame)) missing += " " + shell_word(shot.frame(f).string());
  const std::string prepare = fmt::format(
      "for f in{}; do [ -e \"$f\" ] || {{ echo \"brume: $f is not there, which this frame is cleaned with\" >&2; exit 1; }}; done; ",
      missing);
  std::string call = fmt::format("{} denoise {} -f {} -o {} --progress lines{}", shell_word(shot.brume),
                                 shell_word(shot.frame(frame).string()), shell_word(shot.filter),
                                 shell_word(shot.clean(frame).string()), threads_of(shot));
  if (shot.window_of(frame).size() > 1) call += fmt::format(" --extra-frames {}", shot.window);
  return {"denoise." + frame_name(frame), prepare, call};
}

}  // namespace

bool ShotFiles::complete() const {
  const auto good = [](const auto& entry) { return entry.second.empty(); };
  return std::all_of(frames.begin(), frames.end(), good) && std::all_of(clean.begin(), clean.end(), good);
}

ShotFiles examine(const Shot& shot, bool thorough, const Task& task) {
  ShotFiles files;
  for (const int frame : shot.frames) {
    task.check();
    const auto wrong = [&](const fs::path& path, const FrameContent& content) {
      std::string what = what_is_wrong(shot, path, frame, content, thorough, task);
      if (!what.empty() && what != kNotThere)
        files.refused.push_back(fmt::format("{}: {}", path.lexically_relative(shot.folder).string(), what));
      return what;
    };
    FrameContent whole = content_of(shot, 1, shot.parts);
    std::string& state = files.frames[frame] = wrong(shot.frame(frame), whole);
    whole.filter = shot.filter.substr(0, shot.filter.find(':'));
    if (!shot.filter.empty()) files.clean[frame] = wrong(shot.clean(frame), whole);
    if (state.empty() || shot.parts == 1) continue;
    const auto examine_part = [&](int part) {
      files.parts.push_back({frame, part, wrong(shot.part(frame, part), content_of(shot, part, part))});
    };
    for (int group = 1; group <= shot.groups(); ++group) {
      const auto [first, last] = shot.parts_of_group(group);
      const std::string of_group = wrong(shot.group(frame, group), content_of(shot, first, last));
      files.groups.push_back({frame, group, of_group});
      if (!of_group.empty())
        for (int part = first; part <= last; ++part) examine_part(part);
    }
    if (shot.groups() == 0)
      for (int part = 1; part <= shot.parts; ++part) examine_part(part);
    // Whole parts that could not be merged do not belong together: each is held against the scene again.
    const auto of_frame = [&](const ShotFiles::Part& part) { return part.frame == frame; };
    const CommandLog merge = read_log(shot, "merge." + frame_name(frame));
    const bool refused = !merge.attempts.empty() && merge.attempts.back().status.value_or(0) == 2 &&
                         merge.reason.find(kNotEnoughMemory) == std::string::npos;
    for (auto* list : {&files.parts, &files.groups})
      if (refused && std::none_of(list->begin(), list->end(),
                                  [&](const ShotFiles::Part& part) { return of_frame(part) && !part.wrong.empty(); }))
        for (ShotFiles::Part& part : *list)
          if (of_frame(part)) part.wrong = "could not be merged: " + merge.reason;
  }
  return files;
}

namespace {

constexpr std::string_view kProgram = "brume: ";  // begins what brume says

/// Of a line of progress: "brume: render smoke: 30 %, 4 s left".
std::optional<int> percent_of(const std::string& line) {
  const size_t at = line.rfind(" %");
  if (at == std::string::npos || !line.starts_with(kProgram)) return std::nullopt;
  const size_t begin = line.find_last_not_of("0123456789", at - 1) + 1;
  const std::string_view before(line.data(), begin), after = std::string_view(line).substr(at + 2);
  if (begin == at || !before.ends_with(": ") || !(after.empty() || after.starts_with(", "))) return std::nullopt;
  return std::atoi(line.c_str() + begin);
}

}  // namespace

CommandLog read_log(const Shot& shot, const std::string& command) {
  CommandLog log;
  std::ifstream stream(shot.log(command));
  for (std::string line; std::getline(stream, line);) {
    if (!line.starts_with(kMark)) {
      const std::optional<int> percent = percent_of(line);
      if (percent) log.percent = *percent;
      // Lines that begin with a blank go on with the message before: the place in a scene's file.
      const bool of_attempt = !log.attempts.empty() && !log.attempts.back().status;
      if (of_attempt && !percent && line.find_first_of(" \t\r") != 0 && !line.empty())
        log.reason = line.starts_with(kProgram) ? line.substr(kProgram.size()) : line;
      continue;
    }
    const std::string text = line.substr(std::string(kMark).size());
    Attempt attempt;
    char node[256] = {};
    int status = 0;
    double seconds = 0;
    if (std::sscanf(text.c_str(), "begun in round %d on %255s", &attempt.round, node) == 2) {
      attempt.node = node;
      log.attempts.push_back(attempt);
      log.percent = -1;
      log.reason.clear();
    } else if (std::sscanf(text.c_str(), "ended with %d after %lf", &status, &seconds) == 2 && !log.attempts.empty()) {
      log.attempts.back().status = status;
      log.attempts.back().seconds = seconds;
    }
  }
  return log;
}

std::vector<Stage> plan(const Shot& shot, const ShotFiles& files) {
  Stage render{"render", {}}, gather{"gather", {}}, merge{"merge", {}}, denoise{"denoise", {}};
  for (const auto& [frame, wrong] : files.frames) {
    if (wrong.empty()) continue;
    if (shot.parts == 1)
      render.commands.push_back(render_command(shot, frame, 1));
    else
      merge.commands.push_back(merge_command(shot, frame));
  }
  for (const ShotFiles::Part& part : files.parts)
    if (!part.wrong.empty()) render.commands.push_back(render_command(shot, part.frame, part.number));
  for (const ShotFiles::Part& group : files.groups)
    if (!group.wrong.empty()) gather.commands.push_back(gather_command(shot, group.frame, group.number));
  for (const auto& [frame, wrong] : files.clean)
    if (!wrong.empty()) denoise.commands.push_back(denoise_command(shot, frame));
  std::vector<Stage> stages;
  for (Stage* stage : {&render, &gather, &merge, &denoise})
    if (!stage->commands.empty()) stages.push_back(std::move(*stage));
  return stages;
}

std::vector<Stage> plan(const Shot& shot) {
  ShotFiles nothing;
  const std::string missing = kNotThere;
  for (const int frame : shot.frames) {
    nothing.frames[frame] = missing;
    if (!shot.filter.empty()) nothing.clean[frame] = missing;
    if (shot.parts == 1) continue;
    for (int part = 1; part <= shot.parts; ++part) nothing.parts.push_back({frame, part, missing});
    for (int group = 1; group <= shot.groups(); ++group) nothing.groups.push_back({frame, group, missing});
  }
  return plan(shot, nothing);
}

int last_round(const Shot& shot) {
  int last = 0;
  std::error_code error;
  for (fs::directory_iterator entry(shot.folder / "rounds", error), end; !error && entry != end; entry.increment(error))
    last = std::max(last, std::atoi(entry->path().filename().c_str()));
  return last;
}

fs::path write_round(const Shot& shot, const std::vector<Stage>& stages) {
  fs::path folder;
  std::error_code error;
  // Making a folder is the one thing that only one of several can do.
  for (int number = last_round(shot) + 1;; ++number) {
    folder = shot.folder / "rounds" / std::to_string(number);
    if (fs::create_directory(folder, error)) break;
    if (error) throw InputError(fmt::format("{}: cannot be made: {}", folder.string(), error.message()));
  }
  for (const Stage& stage : stages) {
    std::string text;
    for (const ShotCommand& command : stage.commands)
      text += command.name + "\t" + command.prepare + "exec " + command.call + "\n";
    write_text(folder / (stage.name + ".commands"), text);
  }
  write_text(folder / "run.sh", embedded::run_sh);
  return folder;
}

}  // namespace brume
