#pragma once
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "farm/shot.h"

namespace brume {

/// How far a stage of a shot is.
struct StageProgress {
  struct Running {
    std::string name, node;
    int percent;  ///< below 0: not known
  };
  struct Failed {
    std::string name, node, why;
  };
  std::string name;
  int total = 0, done = 0;
  std::vector<Running> running;
  std::vector<Failed> failed;  ///< in their last attempt, and not at work now
};

struct ShotProgress {
  std::vector<StageProgress> stages;
  std::vector<int> frames_done;
  bool complete = false;
  std::vector<std::string> refused;  ///< ShotFiles::refused
  /// At the pace so far and with as many at work as now. Durations are each node's own: no clock is held against
  /// another.
  std::optional<double> seconds_left;

  int running() const;
};

/// From the files of a shot, its logs, and Slurm's queue where there is one. Files are looked at, not read through.
/// @throws Interrupted
ShotProgress progress_of(const Shot& shot, const Task& task = {});

}  // namespace brume
