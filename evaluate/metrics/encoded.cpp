#include "evaluate/metrics/encoded.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "image/color.h"

namespace brume {
namespace {

// In steps of the square root, in which the curve bends little.
constexpr int kSteps = 4096;

std::vector<float> make_table() {
  std::vector<float> table(kSteps + 2);
  for (int i = 0; i <= kSteps + 1; ++i) {
    const double root = std::min(1.0, static_cast<double>(i) / kSteps);
    table[static_cast<size_t>(i)] = static_cast<float>(srgb_encode(root * root));
  }
  return table;
}

}  // namespace

float srgb_code(float radiance, double exposure) {
  static const std::vector<float> table = make_table();
  const float root = kSteps * std::sqrt(std::clamp(radiance * static_cast<float>(exposure), 0.0f, 1.0f));
  const int i = static_cast<int>(root);
  const float share = root - static_cast<float>(i);
  return (1 - share) * table[static_cast<size_t>(i)] + share * table[static_cast<size_t>(i + 1)];
}

}  // namespace brume
