#pragma once
#include <condition_variable>
#include <mutex>
#include <thread>

#include "base/memory_file.h"

namespace brume {

/// Keeps what a process holds in memory of a mapped file on disk below a limit: a thread looks many times a second, and
/// where there is more it gives all of it back. What is needed of it comes again, from the system's cache of files
/// while there is memory for that, else from disk.
class ResidentLimit {
 public:
  /// @param most  bytes of files in this process's memory, beside those at the beginning
  ResidentLimit(const Mapping& mapping, size_t most);
  ~ResidentLimit();
  ResidentLimit(const ResidentLimit&) = delete;

 private:
  void watch();

  const Mapping& mapping_;
  const size_t most_;
  bool ended_ = false;
  std::mutex mutex_;
  std::condition_variable end_;
  std::thread thread_;
};

}  // namespace brume
