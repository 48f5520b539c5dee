// Planes of zeros that take no memory, planes that are written at once, and planes that are packed aside.

#include "image/plane.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "base/peak_memory.h"
#include "base/rng.h"
#include "image/packed_plane.h"

namespace brume {
namespace {

bool same_bits(const Plane& a, const Plane& b) {
  if (a.width() != b.width() || a.height() != b.height()) return false;
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x)
      if (std::bit_cast<uint32_t>(a(x, y)) != std::bit_cast<uint32_t>(b(x, y))) return false;
  return true;
}

TEST(Planes, OfLazyZerosAreZerosAndTakeMemoryOnlyWhereTheyAreWritten) {
  constexpr int kWidth = 4000, kHeight = 4000;  // 64 MB
  const PeakMemory memory;
  Plane plane = Plane::lazy_zeros(kWidth, kHeight);
  for (int y = 0; y < 40; ++y)
    for (float& v : plane.pixels(y)) v = 1;
  EXPECT_EQ(plane(kWidth - 1, 39), 1);
  EXPECT_EQ(plane(0, 40), 0);
  EXPECT_EQ(plane(kWidth - 1, kHeight - 1), 0);
  if (const std::optional<double> growth = memory.growth()) {
    EXPECT_LT(*growth, 1.6e7);
  }
  const Plane copy = plane, moved = std::move(plane);
  EXPECT_TRUE(same_bits(copy, moved));
  EXPECT_EQ(Plane::lazy_zeros(3, 2)(2, 1), 0);
  EXPECT_TRUE(Plane::lazy_zeros(0, 0).empty());
}

TEST(Planes, ThatAreUnsetHaveZerosBehindTheirRows) {
  const Plane plane = Plane::unset(33, 5);
  for (int y = 0; y < 5; ++y)
    for (size_t x = 33; x < plane.stride(); ++x) EXPECT_EQ(plane.row(y)[x], 0);
}

TEST(PackedPlanes, ComeBackBitForBit) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInfinity = std::numeric_limits<float>::infinity();
  Rng rng(3);
  for (const int width : {1, 255, 256, 257, 1000}) {
    Plane plane(width, 7);
    for (int x = 0; x < width; ++x) {
      plane(x, 1) = 0.25f;
      plane(x, 2) = static_cast<float>(rng.uniform());
      plane(x, 3) = x < 300 ? 0.0f : static_cast<float>(rng.uniform());
      plane(x, 4) = x % 2 ? -0.0f : 0.0f;
      plane(x, 5) = kNan;
    }
    plane(width - 1, 6) = -kInfinity;
    EXPECT_TRUE(same_bits(PackedPlane(plane, {}).unpacked({}), plane)) << width;
  }
}

}  // namespace
}  // namespace brume
