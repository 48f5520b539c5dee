#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "base/progress.h"

namespace brume {

/// How a program that was run ended.
struct ChildEnd {
  int status = 0;        ///< what it exited with
  int signal = 0;        ///< what killed it; 0: nothing did
  bool stalled = false;  ///< it was killed because it did nothing for too long
};

/// Runs a program to its end, without input or output, and looks after it meanwhile.
///
/// The child gets `descriptor` as its descriptor 3. Cancelling the task kills it.
/// @param stall_seconds  it is killed when it uses no processor time for so long
/// @param watch          called about twenty times a second
/// @throws InputError when it cannot be started; Interrupted when the task is cancelled
ChildEnd run_child(const std::filesystem::path& program, const std::vector<std::string>& arguments, int descriptor,
                   const Task& task, double stall_seconds, const std::function<void()>& watch = {});

/// Makes this process end when the one that started it does, and ignore the signals that a terminal sends to both: for
/// the start of a program that run_child() runs.
void follow_parent();

/// The descriptor that run_child() hands over.
constexpr int kHandedOver = 3;

}  // namespace brume
