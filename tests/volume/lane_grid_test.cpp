#include "volume/lane_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "tests/support/volumes.h"

namespace brume {
namespace {

// Blobs far apart, so that empty cubes of all sizes occur.
float blobs(const ivec3& v) {
  const ivec3 block(v.x >> 4, v.y >> 4, v.z >> 4);
  Rng rng(hash_combine(hash_combine(static_cast<uint64_t>(block.x + 99), static_cast<uint64_t>(block.y + 99)),
                       static_cast<uint64_t>(block.z + 99)));
  if (rng.uniform() > 0.04) return 0.0f;
  const dvec3 from_middle = dvec3(v & 15) - 7.5;
  const double height = 0.1 + rng.uniform();
  return static_cast<float>(height * std::max(0.0, 1.0 - glm::length(from_middle) / (2 + 5 * rng.uniform())));
}

const VoxelBox kBox{{-60, -40, 0}, {80, 70, 150}};

class LaneGridOfCells : public testing::TestWithParam<int> {
 protected:
  const BrickGrid bricks = test::make_bricks(kBox, blobs).recut(GetParam());
  LaneGrid grid{bricks};

  size_t at(const ivec3& c) const { return (static_cast<size_t>(c.x) * grid.ny + c.y) * grid.nz + c.z; }
  bool inside(const ivec3& c) const {
    return glm::all(glm::greaterThanEqual(c, ivec3(0))) && glm::all(glm::lessThan(c, bricks.cells()));
  }
  bool empty(const ivec3& c) const { return !inside(c) || !(bricks.cell(c).majorant > 0); }
  template <class Visit>
  void each_cell(Visit&& visit) const {
    for (int x = 0; x < grid.nx; ++x)
      for (int y = 0; y < grid.ny; ++y)
        for (int z = 0; z < grid.nz; ++z) visit(ivec3(x, y, z));
  }
};
INSTANTIATE_TEST_SUITE_P(LaneGrid, LaneGridOfCells, testing::Values(4, 8, 16), testing::PrintToStringParamName());

TEST_P(LaneGridOfCells, CubesAheadAreEmptyAndTheLargestWhereTheyAreSmall) {
  const auto empty_cube = [&](const ivec3& c, const ivec3& step, int side) {
    for (int i = 0; i < side * side * side; ++i)
      if (!empty(c + step * ivec3(i / (side * side), i / side % side, i % side))) return false;
    return true;
  };
  Rng rng(1);
  int large = 0;
  each_cell([&](const ivec3& c) {
    const float entry = grid.majorant[at(c)];
    if (!empty(c)) {
      ASSERT_EQ(entry, bricks.cell(c).majorant);
      return;
    }
    ASSERT_LT(entry, 0);
    if (rng.uniform() > 0.05) return;
    int sides[8], most = 0;
    for (int octant = 0; octant < 8; ++octant)
      most = std::max(most, sides[octant] = OctantSkip::side(std::bit_cast<uint32_t>(entry), octant));
    for (int octant = 0; octant < 8; ++octant) {
      const ivec3 step(octant & 4 ? -1 : 1, octant & 2 ? -1 : 1, octant & 1 ? -1 : 1);
      const int side = std::min(sides[octant], 40);
      ASSERT_TRUE(empty_cube(c, step, side)) << octant << ": " << side;
      if (most <= 8 && side < 8) {
        ASSERT_FALSE(empty_cube(c, step, side + 1)) << octant << ": " << side;
      }
    }
    large += most > 8;
  });
  EXPECT_TRUE(GetParam() == 16 || large > 10);
}

// Each is the field of one of the eight parts of a cell, bound by its own values, and empty where these are 0.
TEST_P(LaneGridOfCells, HalvedCellsHoldTheSameFieldUnderTighterBounds) {
  const LaneGrid half = LaneGrid::halved(bricks, 1.5);
  ASSERT_EQ(half.cell_size, bricks.cell_size() / 2);
  ASSERT_EQ(ivec3(half.nx, half.ny, half.nz), 2 * bricks.cells());
  const int row = bricks.stored();
  size_t tighter = 0, more_empty = 0;
  for (int x = 0; x < half.nx; ++x)
    for (int y = 0; y < half.ny; ++y)
      for (int z = 0; z < half.nz; ++z) {
        const size_t i = (static_cast<size_t>(x) * half.ny + y) * half.nz + z;
        const ivec3 lo = half.cell_size * ivec3(x, y, z);
        float largest = 0;
        for (int k = 0; k < (half.cell_size + 1) * (half.cell_size + 1) * (half.cell_size + 1); ++k) {
          const int side = half.cell_size + 1;
          const ivec3 step(k / (side * side), k / side % side, k % side);
          const float value = bricks.voxel(lo + step);
          largest = std::max(largest, value);
          if (half.brick[i] >= 0) {
            ASSERT_EQ(half.values[half.brick[i] + (step.x * row + step.y) * row + step.z], value);
          }
        }
        const float whole = grid.majorant[at(ivec3(x, y, z) / 2)];
        if (largest > 0) {
          ASSERT_EQ(half.majorant[i], 1.5f * largest);
          tighter += largest < whole;
        } else {
          ASSERT_LT(half.majorant[i], 0);
          more_empty += whole > 0;
        }
      }
  // All parts of a cell of 16 share the middle of its blob.
  if (GetParam() < 16) {
    EXPECT_GT(tighter, 100u);
  }
  EXPECT_GT(more_empty, 10u);
}

TEST(OctantSkip, LosesLittleOfTheOctantsProduct) {
  Rng rng(2);
  for (int i = 0; i < 2000; ++i) {
    std::array<uint16_t, 8> reach;
    double loss = 1;
    for (uint16_t& r : reach) r = static_cast<uint16_t>(std::exp2(rng.uniform() * (i % 2 ? 8.7 : 3)));
    const uint32_t word = OctantSkip::pack(reach);
    ASSERT_LT(std::bit_cast<float>(word), 0) << "a negative number, not a NaN";
    for (size_t octant = 0; octant < 8; ++octant) {
      const int side = OctantSkip::side(word, static_cast<int>(octant));
      ASSERT_GE(side, 1);
      ASSERT_LE(side, reach[octant]);
      if (i % 2 == 0) {
        ASSERT_EQ(side, reach[octant]) << "up to 8 nothing is lost";
      }
      loss *= static_cast<double>(side) / reach[octant];
    }
    ASSERT_GT(std::pow(loss, 1.0 / 8), 0.35);
  }
}

TEST_P(LaneGridOfCells, DistancesAreThoseToTheNearestVoxelThatReachesTheSurface) {
  constexpr float kSurface = 0.3f;
  grid.find_isosurface(bricks, kSurface);
  const int n = GetParam();
  const size_t voxels = static_cast<size_t>(n) * n * n;
  Rng rng(3);
  int below = 0, seen = 0;
  each_cell([&](const ivec3& c) {
    const int32_t entry = grid.isosurface_cell[at(c)];
    const BrickGrid::Cell& cell = bricks.cell(c);
    ASSERT_EQ(entry < 0, cell.majorant < kSurface);
    if (entry < 0) {
      below += !empty(c);
      return;
    }
    ASSERT_EQ(static_cast<uint32_t>(entry) + 1, cell.brick);
    std::vector<ivec3> reaching;
    const auto local = [&](size_t v) {
      return ivec3(static_cast<int>(v) / (n * n), static_cast<int>(v) / n % n, static_cast<int>(v) % n);
    };
    for (size_t v = 0; v < voxels; ++v) {
      float most = 0;
      for (int k = 0; k < 8; ++k)
        most = std::max(most, bricks.voxel(c * n + local(v) + ivec3(k & 1, k >> 1 & 1, k >> 2)));
      if (most >= kSurface) reaching.push_back(local(v));
    }
    ASSERT_FALSE(reaching.empty());
    for (int i = 0; i < 20; ++i) {
      const size_t v = static_cast<size_t>(rng.uniform() * static_cast<double>(voxels));
      int nearest = n;
      for (const ivec3& r : reaching) {
        const ivec3 d = glm::abs(r - local(v));
        nearest = std::min(nearest, std::max({d.x, d.y, d.z}));
      }
      ASSERT_EQ(grid.distances[static_cast<size_t>(entry) * voxels + v], nearest);
    }
    ++seen;
  });
  EXPECT_GT(below, 0);
  EXPECT_GT(seen, 5);
}

// A loose majorant can promise a surface that no voxel of the brick reaches: then the whole cell is crossed.
TEST_P(LaneGridOfCells, BricksWithoutTheSurfaceAreCrossedUnderLooseMajorants) {
  constexpr float kSurface = 0.3f;
  LaneGrid loose(bricks, 5.0);
  loose.find_isosurface(bricks, kSurface);
  const size_t voxels = static_cast<size_t>(GetParam()) * GetParam() * GetParam();
  int promised = 0;
  each_cell([&](const ivec3& c) {
    const int32_t entry = loose.isosurface_cell[at(c)];
    if (entry < 0 || bricks.cell(c).majorant >= kSurface) return;
    ++promised;
    for (size_t v = 0; v < voxels; ++v) ASSERT_EQ(loose.distances[static_cast<size_t>(entry) * voxels + v], GetParam());
  });
  EXPECT_GT(promised, 0);
}

// No ray of a cone may meet anything before the cone does; and cones as thin as those of a pixel must be told nearly
// where they do.
TEST_P(LaneGridOfCells, NoRayOfABeamMeetsAnythingBeforeIt) {
  constexpr float kSurface = 0.3f;
  grid.find_isosurface(bricks, kSurface);
  const int n = GetParam();
  const auto holds_medium = [&](const dvec3& p) { return !empty(ivec3(glm::floor(p / static_cast<double>(n)))); };
  const auto holds_isosurface = [&](const dvec3& p) {
    const ivec3 v(glm::floor(p));
    float most = 0;
    for (int k = 0; k < 8; ++k) most = std::max(most, bricks.voxel(v + ivec3(k & 1, k >> 1 & 1, k >> 2)));
    return most >= kSurface;
  };
  Rng rng(4);
  const dvec3 size(bricks.cells() * n);
  const double end = 4 * glm::length(size);
  int thin_rays[2] = {}, close[2] = {}, together[2] = {}, never = 0, never_told = 0;
  for (int i = 0; i < 4000; ++i) {
    const bool thin = i % 2;
    const double apart = thin ? 0.01 : 4 * rng.uniform(), apart_per_t = thin ? 1e-4 : 0.02 * rng.uniform();
    Ray middle{test::random_point(rng, -size, 2.0 * size), {}};
    middle.d = test::random_point(rng, dvec3(0), size) - middle.o;
    middle.d *= (0.3 + rng.uniform()) / glm::length(middle.d);
    if (i % 5 == 0) middle.d[i % 3] = 0;
    const LaneGrid::Entry told = grid.entry_bound({middle, apart, apart_per_t});
    ASSERT_GE(told.surface, told.medium);
    const LaneGrid::Entry wider = grid.entry_bound({middle, 3 * apart + 1, 2 * apart_per_t});
    const LaneGrid::Entry from_there = grid.entry_bound({middle, apart, apart_per_t}, wider);
    ASSERT_EQ(from_there.medium, told.medium);
    ASSERT_EQ(from_there.surface, told.surface);
    Ray rays[4] = {middle, middle, middle, middle};
    for (int k = 1; k < 4; ++k) {
      rays[k].o += test::random_point(rng, dvec3(-apart), dvec3(apart));
      rays[k].d += test::random_point(rng, dvec3(-apart_per_t), dvec3(apart_per_t));
    }
    // Where they can be walked together, all of them cross the planes in few voxels.
    if (told.axis >= 0) {
      ++together[thin];
      for (int plane = 0; plane <= static_cast<int>(size[told.axis]); plane += 3) {
        ivec3 lowest(1 << 20), highest(-(1 << 20));
        bool all = true;
        for (const Ray& ray : rays) {
          const double t = (plane - ray.o[told.axis]) / ray.d[told.axis];
          const ivec3 v(glm::floor(ray.at(t)));
          lowest = glm::min(lowest, v);
          highest = glm::max(highest, v);
          all &= t >= 0;
        }
        for (int a = 0; a < 3; ++a)
          ASSERT_TRUE(!all || a == told.axis || highest[a] - lowest[a] < LaneGrid::kPacketVoxels);
      }
    }
    for (int k = 0; k < 4; ++k) {
      const Ray& ray = rays[k];
      double medium = end, surface = end;
      for (double t = 0; t < end && surface == end; t += 0.1) {
        if (medium == end && holds_medium(ray.at(t))) medium = t;
        if (medium < end && holds_isosurface(ray.at(t))) surface = t;
      }
      ASSERT_GE(medium, std::min(told.medium, end)) << "ray " << k << " of cone " << i;
      ASSERT_GE(surface, std::min(told.surface, end)) << "ray " << k << " of cone " << i;
      if (told.axis >= 0 && surface < end) {
        const int step = ray.d[told.axis] < 0 ? -1 : 1;
        ASSERT_GE(step * static_cast<int>(std::floor(ray.at(surface)[told.axis])), step * told.layer);
      }
      if (!thin) continue;
      never += medium == end;
      never_told += std::isinf(told.medium);
      const double speed = glm::length(ray.d);
      if (medium < end) ++thin_rays[0], close[0] += (medium - told.medium) * speed < 2 * n;
      if (surface < end) ++thin_rays[1], close[1] += (surface - told.surface) * speed < 4;
    }
  }
  EXPECT_GT(never_told, 0.95 * never);
  EXPECT_GT(close[0], 0.98 * thin_rays[0]);
  EXPECT_GT(close[1], 0.95 * thin_rays[1]);
  EXPECT_GT(thin_rays[1], 80);
  EXPECT_GT(together[1], 20);
}

}  // namespace
}  // namespace brume
