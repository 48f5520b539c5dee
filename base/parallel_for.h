#pragma once
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <atomic>
#include <functional>
#include <mutex>

#include "base/progress.h"

namespace brume {

/// Calls work() on so many threads.
/// @param threads  0: as many as there are processors. More than these are asked for by tests of determinism
void run_on_threads(int threads, const std::function<void()>& work);

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
    run_on_threads(task.threads, [&] {
      // A thread that waits for the end of this loop must not begin another body of a loop around it.
      tbb::this_task_arena::isolate([&] { tbb::parallel_for(0, count, one); });
    });
  }
  task.check();
  if (reported < count || count == 0) task.report(1.0);
}

}  // namespace brume
