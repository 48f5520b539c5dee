#include "base/peak_memory.h"

#include <malloc.h>

#include <algorithm>
#include <fstream>
#include <sstream>

namespace brume {
namespace {

constexpr const char* kSelf = "self";

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
