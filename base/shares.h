#pragma once
#include <cstdint>

namespace brume {

/// Where a share of samples ends that is the `number`-th of `parts` equal ones, counted from 1: the next one begins
/// there. Of 0 it is 0.
constexpr int end_of_share(int samples, int number, int parts) {
  return static_cast<int>(static_cast<int64_t>(samples) * number / parts);
}

}  // namespace brume
