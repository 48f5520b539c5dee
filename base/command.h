#pragma once
#include <filesystem>
#include <functional>
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

/// A program to run, and what it may take.
struct Command {
  std::filesystem::path program;                        ///< as find_program() gives it
  std::vector<std::string> words;                       ///< the program's name first
  std::filesystem::path folder = {};                    ///< where it runs; empty: where this process does
  std::map<std::string, std::string> environment = {};  ///< beside this process's own, which it replaces
  double time_limit = 0;                                ///< seconds; 0: none
  double memory_limit = 0;                              ///< bytes that it and all it starts hold together; 0: none
  double stall_limit = 0;                               ///< seconds in which it uses no processor time; 0: none
  int handed_over = -1;                                 ///< what it gets as its descriptor kHandedOver; -1: nothing
  /// Whether its last words are kept, and what it starts is measured, and killed with it. Otherwise it has no output,
  /// and what it starts is its own affair.
  bool supervised = true;
  std::function<void()> watch = {};  ///< called about fifty times a second meanwhile
};
constexpr int kHandedOver = 3;

/// How it ended.
struct CommandEnd {
  enum class Limit { kNone, kTime, kMemory, kStall };

  int status = 0;               ///< what it exited with
  int signal = 0;               ///< what killed it; 0: nothing did
  Limit passed = Limit::kNone;  ///< it was killed because it passed this one
  double seconds = 0;           ///< from its first instruction to its end
  double peak_bytes = 0;        ///< that it and all it started held at most, looked at every 20 ms; 0: ended too soon
  std::string said;  ///< its last lines, of 300 bytes at most, on stderr, or, where there are none, on stdout

  bool good() const { return status == 0 && signal == 0 && passed == Limit::kNone; }
};

/// Runs a program to its end, without input. It is killed when it passes a limit, the task is cancelled, or this
/// process is killed. Of a supervised one whatever it has started is killed in the end too, daemons by a variable
/// BRUME_COMMAND_... that they have in their environment.
/// @throws InputError when it cannot be started; Interrupted when the task is cancelled
CommandEnd run_command(const Command& command, const Task& task);

}  // namespace brume
