#include "base/resident_limit.h"

#include <unistd.h>

#include <chrono>
#include <fstream>

namespace brume {
namespace {

/// Bytes of mapped files that are in this process's memory.
size_t resident_bytes() {
  std::ifstream stream("/proc/self/statm");
  size_t all = 0, resident = 0, of_files = 0;
  stream >> all >> resident >> of_files;
  return of_files * static_cast<size_t>(sysconf(_SC_PAGESIZE));
}

}  // namespace

ResidentLimit::ResidentLimit(const Mapping& mapping, size_t most)
    : mapping_(mapping), most_(resident_bytes() + most), thread_([this] { watch(); }) {}

ResidentLimit::~ResidentLimit() {
  {
    const std::lock_guard lock(mutex_);
    ended_ = true;
  }
  end_.notify_one();
  thread_.join();
}

void ResidentLimit::watch() {
  constexpr std::chrono::milliseconds kBetween(20);
  std::unique_lock lock(mutex_);
  while (!end_.wait_for(lock, kBetween, [this] { return ended_; }))
    if (resident_bytes() > most_) mapping_.release();
}

}  // namespace brume
