// A plane in 16 bits: how near its values stay, and which stay as they are.

#include "image/stored_plane.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/rng.h"
#include "tests/support/targets.h"

namespace brume {
namespace {

Plane restored(const Plane& plane) {
  Plane back;
  StoredPlane(plane, {}).read(back, {});
  return back;
}

/// 150 x 3 numbers from `low` to `high`, every seventh the lowest, first and last of each row the highest.
Plane random_plane(float low, float high) {
  Plane plane(150, 3);
  Rng rng(7);
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 150; ++x)
      plane(x, y) = x == 0 || x == 149 ? high
                    : x % 7 == 0       ? low
                                       : low + (high - low) * static_cast<float>(rng.uniform());
  return plane;
}

class StoredPlanes : public test::EveryTarget {};

TEST_P(StoredPlanes, KeepValuesWithinA65535thOfTheirRange) {
  for (const auto& [low, high] : {std::pair(0.0f, 1.0f), {100.0f, 100.5f}, {0.0f, 1e-30f}, {2.0f, 1e30f}}) {
    const Plane plane = random_plane(low, high), back = restored(plane);
    for (int y = 0; y < 3; ++y)
      for (int x = 0; x < 150; ++x) {
        EXPECT_NEAR(back(x, y), plane(x, y), (high - low) / 65535 + 1e-7f * high) << low << " " << x << " " << y;
        if (plane(x, y) == low) {
          EXPECT_EQ(back(x, y), low) << x << " " << y;
        }
      }
  }
}

TEST_P(StoredPlanes, KeepSmallValuesBeside10000TimesLargerOnes) {
  Plane plane(64, 1);
  for (int x = 0; x < 64; ++x) plane(x, 0) = x % 2 ? 1.0f : 1e-4f;
  const Plane back = restored(plane);
  for (int x = 0; x < 64; x += 2) EXPECT_NEAR(back(x, 0), 1e-4f, 2e-3f * 1e-4f) << x;
}

TEST_P(StoredPlanes, KeepSignsAndZeros) {
  Plane plane = random_plane(-1, 2);
  for (int x = 5; x < 150; x += 10) plane(x, 1) = 0;
  const Plane back = restored(plane);
  for (int y = 0; y < 3; ++y)
    for (int x = 0; x < 150; ++x) {
      EXPECT_NEAR(back(x, y), plane(x, y), 2.0f / 16383) << x << " " << y;
      if (plane(x, y) == 0) {
        EXPECT_EQ(back(x, y), 0) << x << " " << y;
      }
    }
}

TEST_P(StoredPlanes, KeepWholeWhatOnePixelOutshinesAndWhatIsNotFinite) {
  Plane plane = random_plane(0.1f, 0.3f);
  plane(20, 0) = 1e5f;
  plane(80, 1) = std::numeric_limits<float>::infinity();
  plane(140, 2) = std::numeric_limits<float>::quiet_NaN();
  const Plane back = restored(plane);
  const auto expect_whole = [&](int from, int to, int y) {
    for (int x = from; x < to; ++x)
      EXPECT_TRUE(back(x, y) == plane(x, y) || (std::isnan(back(x, y)) && std::isnan(plane(x, y)))) << x << " " << y;
  };
  expect_whole(0, 64, 0);
  expect_whole(64, 128, 1);
  expect_whole(128, 150, 2);
}
INSTANTIATE_TEST_SUITE_P(Targets, StoredPlanes, ::testing::ValuesIn(test::targets()), test::target_name);

TEST(StoredPlane, CostsHalfOrLessAndNothingWhereItIsFlat) {
  const Plane full = random_plane(0, 1), flat(1000, 50, 3.0f);
  EXPECT_LT(static_cast<double>(StoredPlane(full, {}).bytes()), 0.75 * 150 * 3 * sizeof(float));
  EXPECT_LT(static_cast<double>(StoredPlane(flat, {}).bytes()), 0.12 * 1000 * 50 * sizeof(float));
  EXPECT_EQ(restored(flat)(999, 49), 3.0f);
}

TEST(StoredPlane, AViewReadsItsPartOfTheOther) {
  const Plane plane = random_plane(0, 1), whole = restored(plane);
  const StoredPlane view = StoredPlane(plane, {}).view(37, 1, 100, 2).view(3, 1, 90, 1);
  std::vector<float> row(50);
  view.read(0, 20, 70, row.data());
  for (int x = 0; x < 50; ++x) EXPECT_EQ(row[static_cast<size_t>(x)], whole(37 + 3 + 20 + x, 2)) << x;
}

}  // namespace
}  // namespace brume
