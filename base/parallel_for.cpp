#include "base/parallel_for.h"

#include <tbb/global_control.h>
#include <tbb/info.h>

#include <map>
#include <optional>

namespace brume {
namespace {

/// Kept as long as the program runs. TBB's workers leave an arena late: with one for every loop they pile up where the
/// machine has other work, and each loop takes longer than the one before.
struct Arena {
  std::optional<tbb::global_control> limit;  // TBB wants to be told of more threads than processors
  tbb::task_arena arena;

  explicit Arena(int threads) : arena(threads) {
    if (threads > tbb::info::default_concurrency())
      limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<size_t>(threads));
  }
};

Arena& arena_of(int threads) {
  static std::mutex mutex;
  static auto& arenas = *new std::map<int, Arena>;
  const std::lock_guard lock(mutex);
  return arenas.try_emplace(threads, threads).first->second;
}

}  // namespace

void run_on_threads(int threads, const std::function<void()>& work) {
  if (threads <= 0 || threads == tbb::this_task_arena::max_concurrency()) return work();
  arena_of(threads).arena.execute(work);
}

}  // namespace brume
