#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace brume {

/// What the system says of a process's memory [bytes]; nothing where it has gone.
/// @param process  its number, or "self"
/// @param name     "VmRSS": what is resident now; "VmHWM": at most since it began
std::optional<double> memory_of(const std::string& process, std::string_view name);

/// To the system, what allocators keep for later: some hundred megabytes after much work on large pictures.
void give_back_freed_memory();
/// Whether filters hold so much for a picture of so many pixels, some hundred bytes for each, that what is kept small
/// or given back meanwhile is worth its time.
bool saves_memory(size_t pixels);
/// For programs of our own, before they have threads: filters make and drop many planes of megabytes, for each of which
/// the system would clear fresh pages. What is freed is kept for the next ones, in large pages where there are some.
void keep_freed_memory();

/// What a piece of work holds at most, beside what the process held before.
class PeakMemory {
 public:
  /// Gives back what is free and forgets the process's highest mark.
  PeakMemory();
  /// Bytes since then; nothing where the system does not tell.
  std::optional<double> growth() const;

 private:
  std::optional<double> before_;
};

}  // namespace brume
