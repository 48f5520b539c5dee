#include "base/error.h"

#include <fmt/format.h>

namespace brume {

OutOfMemory::OutOfMemory(const std::string& where, const std::string& purpose, double bytes)
    : OutOfMemory(fmt::format("{}: {} to {}", where, kNotEnoughMemory, purpose) +
                  (bytes >= 1e9 ? fmt::format(", which takes at least {:.3g} GB", bytes / 1e9)
                   : bytes > 0  ? fmt::format(", which takes at least {:.3g} MB", bytes / 1e6)
                                : "")) {}

void fail_reading(const std::string& where, const std::bad_alloc& error) {
  if (const auto* const told = dynamic_cast<const OutOfMemory*>(&error)) throw OutOfMemory(*told);
  throw OutOfMemory(where, "read it");
}

}  // namespace brume
