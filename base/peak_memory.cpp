#include "base/peak_memory.h"

#include <malloc.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <sstream>

namespace brume {
namespace {

constexpr const char* kSelf = "self";
constexpr size_t kLargePage = size_t{2} << 20;
constexpr size_t kReserved = size_t{1} << 30;  // of addresses; it takes memory as it is written

bool keeping = false;

/// Extends the heap and asks for large pages there, which the system clears ten times as fast as small ones.
void reserve_large_pages() {
  rlimit addresses{};
  if (getrlimit(RLIMIT_AS, &addresses) != 0 || addresses.rlim_cur != RLIM_INFINITY) return;
  constexpr int kMostMapped = 65536;  // the default
  mallopt(M_MMAP_MAX, 0);
  if (void* const block = std::malloc(kReserved)) {
    const auto first = (reinterpret_cast<uintptr_t>(block) + kLargePage - 1) / kLargePage * kLargePage;
    madvise(reinterpret_cast<void*>(first), kReserved - kLargePage, MADV_HUGEPAGE);
    std::free(block);
  }
  mallopt(M_MMAP_MAX, kMostMapped);
}

}  // namespace

std::optional<double> memory_of(const std::string& process, std::string_view name) {
  std::ifstream file("/proc/" + process + "/status");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with(name) && line[name.size()] == ':') {
      std::istringstream words(line.substr(name.size() + 1));
      double kilobytes = 0;
      if (words >> kilobytes) return 1024 * kilobytes;
    }
  return std::nullopt;
}

void give_back_freed_memory() {
  malloc_trim(0);
  if (keeping) reserve_large_pages();
}

bool saves_memory(size_t pixels) {
  constexpr size_t kLarge = size_t{1} << 18;
  return pixels >= kLarge;
}

void keep_freed_memory() {
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, std::numeric_limits<int>::max());
  keeping = true;
  reserve_large_pages();
}

PeakMemory::PeakMemory() {
  give_back_freed_memory();
  std::ofstream marks("/proc/self/clear_refs");
  marks << "5";  // the highest mark of resident memory becomes today's
  marks.close();
  if (marks) before_ = memory_of(kSelf, "VmRSS");
}

std::optional<double> PeakMemory::growth() const {
  const std::optional<double> peak = memory_of(kSelf, "VmHWM");
  if (!before_ || !peak) return std::nullopt;
  return std::max(0.0, *peak - *before_);
}

}  // namespace brume
