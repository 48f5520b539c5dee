#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/progress.h"

namespace brume {

/// The words of a command as a shell parts them: at blanks, with '...', "..." and backslashes. No shell runs it, so
/// what one would expand or connect (| & ; < > $ ` * ? and ~ at the beginning of a word) is refused outside of quotes.
/// @throws InputError
std::vector<std::string> parse_words(std::string_view line);

/// Where a program is: in a folder of PATH, or, where its name has a slash, beginning at `folder`; empty: nowhere.
std::filesystem::path find_program(const std::string& name, const std::filesystem::path& folder = {});

/// A program of somebody else, and what it may take.
struct Command {
  std::filesystem::path program;                   ///< as find_program() gives it
  std::vector<std::string> words;                  ///< the program's name first
  std::filesystem::path folder;                    ///< where it runs; empty: where this process does
  std::map<std::string, std::string> environment;  ///< beside this process's own, which it replaces
  double time_limit = 0;                           ///< seconds; 0: none
  double memory_limit = 0;                         ///< bytes that it and all it starts hold together; 0: none
};

/// How it ended.
struct CommandEnd {
  enum class Limit { kNone, kTime, kMemory };

  int status = 0;               ///< what it exited with
  int signal = 0;               ///< what killed it; 0: nothing did
  Limit passed = Limit::kNone;  ///< it was killed because it passed this one
  double seconds = 0;           ///< from its first instruction to its end
  double peak_bytes = 0;        ///< that it and all it started held at most, looked at every 20 ms; 0: ended too soon
  std::string said;  ///< its last lines, of 300 bytes at most, on stderr, or, where there are none, on stdout

  bool good() const { return status == 0 && signal == 0 && passed == Limit::kNone; }
};

/// Runs a program to its end, without input. When it ends, passes a limit, or the task is cancelled, whatever it has
/// started is killed too, daemons by a variable BRUME_COMMAND_... that they have in their environment; when this
/// process is killed, so is the program.
/// @throws InputError when it cannot be started; Interrupted when the task is cancelled
CommandEnd run_command(const Command& command, const Task& task);

}  // namespace brume
