#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "farm/shot.h"

namespace brume {

/// One program call of a plan, for a shell.
struct ShotCommand {
  std::string name;     ///< "render.0017.00003": of its log
  std::string prepare;  ///< what a shell does before: "mkdir -p ... && ", "for ...; done; "
  std::string call;

  std::string line() const { return prepare + call; }
};

/// Commands that may run in any order and at the same time.
struct Stage {
  std::string name;  ///< render, gather, merge, denoise
  std::vector<ShotCommand> commands;
};

/// What lies in a shot's folder.
struct ShotFiles {
  /// Whether a file is whole and of this shot, by its name; else what is wrong with it.
  std::map<int, std::string> frames, clean;  ///< by frame: empty text for what is complete
  struct Part {
    int frame, number;
    std::string wrong;
  };
  std::vector<Part> parts;   ///< of the frames that are not complete, in order
  std::vector<Part> groups;  ///< likewise

  /// "frames/shot.0017.exr: truncated ..." for files that are there and are not what they should be.
  std::vector<std::string> refused;

  bool complete() const;
};

/// Looks at every file that a shot should have.
/// @param thorough  reads them to their last pixel; else the header and both ends   @throws Interrupted
ShotFiles examine(const Shot& shot, bool thorough, const Task& task = {});

/// One attempt at a command, from its log.
struct Attempt {
  int round = 0;
  std::string node;
  std::optional<int> status;  ///< nothing while it runs, or where it ended without a word
  double seconds = 0;
};
struct CommandLog {
  std::vector<Attempt> attempts;
  std::string reason;  ///< last message of the last attempt: of one that failed, why
  int percent = -1;    ///< of its progress, where it says so
};
CommandLog read_log(const Shot& shot, const std::string& command);

/// The stages that complete a shot, one after the other; a stage may start once the one before has ended, well or not.
/// Stages without commands are left out.
/// @param files  what is complete is not done again
std::vector<Stage> plan(const Shot& shot, const ShotFiles& files);
/// Of a shot of which nothing is there.
std::vector<Stage> plan(const Shot& shot);

/// FOLDER/rounds/N with the stages' commands and farm/run.sh, which runs them; N is the next number.
/// @throws InputError
std::filesystem::path write_round(const Shot& shot, const std::vector<Stage>& stages);
/// The number of the last round; 0: there is none.
int last_round(const Shot& shot);

}  // namespace brume
