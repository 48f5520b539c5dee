#include "farm/progress.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <set>

#include "farm/plan.h"
#include "farm/slurm.h"

namespace brume {
namespace {

std::string why_failed(const CommandLog& log) {
  const std::optional<int>& status = log.attempts.back().status;
  if (!status) return "ended without a word: killed, or its node is gone";
  if (*status == 3) return "was stopped, and can go on";
  if (*status > 128) return fmt::format("was killed: {}", strsignal(*status - 128));
  return log.reason.empty() ? fmt::format("ended with {}", *status) : log.reason;
}

/// Sorts a command that is not done by its last attempt and by what Slurm says of it.
void sort_in(StageProgress& stage, const std::string& command, const CommandLog& log, const SlurmQueue& queue) {
  if (log.attempts.empty()) {
    if (const auto over = queue.over.find(command); over != queue.over.end())
      stage.failed.push_back({command, "no node",
                              fmt::format("never began: job {} was cancelled, or could not be started; ask sacct -j {}",
                                          over->second, over->second)});
    return;
  }
  const Attempt& last = log.attempts.back();
  const auto state = queue.states.find(command);
  const bool queued = state != queue.states.end(), at_work = queued && state->second == "RUNNING";
  if (!last.status && (at_work || !queue.known))
    stage.running.push_back({command, last.node, log.percent});
  else if (!queued)
    stage.failed.push_back({command, last.node, why_failed(log)});
}

}  // namespace

int ShotProgress::running() const {
  int sum = 0;
  for (const StageProgress& stage : stages) sum += static_cast<int>(stage.running.size());
  return sum;
}

ShotProgress progress_of(const Shot& shot, const Task& task) {
  const ShotFiles files = examine(shot, /*thorough=*/false, task);
  const SlurmQueue queue = ask_slurm(shot);
  std::set<std::string> missing;
  for (const Stage& stage : plan(shot, files))
    for (const ShotCommand& command : stage.commands) missing.insert(command.name);
  ShotProgress progress;
  progress.complete = files.complete();
  progress.refused = files.refused;
  for (const int frame : shot.frames)
    if (files.frames.at(frame).empty() && (shot.filter.empty() || files.clean.at(frame).empty()))
      progress.frames_done.push_back(frame);
  double left = 0;
  bool known = true;
  for (const Stage& all : plan(shot)) {
    StageProgress stage;
    stage.name = all.name;
    stage.total = static_cast<int>(all.commands.size());
    double seconds = 0;
    int timed = 0;
    for (const ShotCommand& command : all.commands) {
      const CommandLog log = read_log(shot, command.name);
      for (const Attempt& attempt : log.attempts)
        if (attempt.status == 0) {
          seconds += attempt.seconds;
          ++timed;
        }
      if (missing.contains(command.name))
        sort_in(stage, command.name, log, queue);
      else
        ++stage.done;
    }
    if (stage.done < stage.total && timed > 0) left += seconds / timed * (stage.total - stage.done);
    // A merge that no log tells of was done beside the last part.
    known = known && (stage.done == stage.total || timed > 0 || all.name == "merge");
    progress.stages.push_back(std::move(stage));
  }
  if (known && !progress.complete) progress.seconds_left = left / std::max(progress.running(), 1);
  return progress;
}

}  // namespace brume
