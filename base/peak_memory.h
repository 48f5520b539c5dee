#pragma once
#include <optional>

namespace brume {

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
