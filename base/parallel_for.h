#pragma once
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <mutex>

#include "base/progress.h"

namespace brume {

/// Calls body(i) for i in [0, count), each once, on the task's threads, reporting progress and stopping when cancelled.
/// The bodies must not depend on one another: then the result does not depend on the number of threads.
/// @throws Interrupted when the task was cancelled; whatever a body throws, once
template <class Body>
void parallel_for(int count, const Task& task, const Body& body) {
  std::atomic<int> done{0};
  std::mutex reporting;
  int reported = 0;
  const auto one = [&](int i) {
    if (task.cancelled()) return;
    body(i);
    const int finished = ++done;
    if (!task.progress) return;
    const std::unique_lock lock(reporting, std::try_to_lock);
    if (lock && finished > reported) {
      reported = finished;
      task.report(static_cast<double>(finished) / count);
    }
  };
  if (task.threads == 1) {
    for (int i = 0; i < count; ++i) one(i);
  } else {
    const int threads = task.threads > 0 ? task.threads : tbb::this_task_arena::max_concurrency();
    // More threads than processors are asked for by tests of determinism; TBB wants to be told.
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<size_t>(threads));
    tbb::task_arena arena(threads);
    arena.execute([&] { tbb::parallel_for(0, count, one); });
  }
  task.check();
  if (reported < count || count == 0) task.report(1.0);
}

}  // namespace brume
