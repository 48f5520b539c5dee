#pragma once
#include <atomic>
#include <chrono>
#include <functional>
#include <string>

#include "base/error.h"

namespace brume {

/// What a long computation is given: how many threads, whom to tell, when to stop.
struct Task {
  int threads = 0;                            ///< 0: all of the machine's
  std::function<void(double)> progress = {};  ///< called with the finished fraction in [0, 1], from any thread in turn
  const std::atomic<bool>* cancel = nullptr;  ///< set from outside; the computation ends with Interrupted

  bool cancelled() const { return cancel != nullptr && cancel->load(std::memory_order_relaxed); }
  void report(double fraction) const {
    if (progress) progress(fraction);
  }
  void check() const {
    if (cancelled()) throw Interrupted();
  }
};

/// Asked now and then inside loops that may run for very long, from any thread: whether to give up.
struct StopSignal {
  const std::atomic<bool>* cancel = nullptr;
  std::chrono::steady_clock::time_point deadline = std::chrono::steady_clock::time_point::max();

  bool due() const {
    if (cancel != nullptr && cancel->load(std::memory_order_relaxed)) return true;
    return deadline != std::chrono::steady_clock::time_point::max() && std::chrono::steady_clock::now() > deadline;
  }
  void check() const {
    if (due()) throw Interrupted();
  }
};

/// A part of a computation that reports its own progress as [begin, end] of the whole.
inline Task share(const Task& whole, double begin, double end) {
  if (!whole.progress) return whole;
  return {whole.threads, [&whole, begin, end](double f) { whole.report(f < 1 ? begin + (end - begin) * f : end); },
          whole.cancel};
}
/// The same without a word.
inline Task quiet(const Task& task) {
  return {task.threads, {}, task.cancel};
}

/// Time that is left at the pace so far, for a line a person reads: "2 m 05 s". Empty while too early to tell.
std::string time_left(double fraction, double elapsed_seconds);
/// A duration a person reads: "12.3 s", "4 m 05 s", "2 h 10 m".
std::string format_duration(double seconds);

/// Wall-clock stopwatch.
class Stopwatch {
 public:
  double seconds() const { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Bytes of memory that the machine has.
double physical_memory();

/// Processor seconds of this process, all threads together.
double cpu_seconds();

}  // namespace brume
