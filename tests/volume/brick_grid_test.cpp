#include "volume/brick_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "base/error.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::make_bricks;

/// Values that change from voxel to voxel, half of them zero, so that bricks, aprons and gaps all occur.
float rough(const ivec3& v) {
  Rng rng(hash_combine(hash_combine(static_cast<uint64_t>(v.x + 1000), static_cast<uint64_t>(v.y + 1000)),
                       static_cast<uint64_t>(v.z + 1000)));
  const bool hole = ((v.x >> 4) + (v.y >> 4) + (v.z >> 4)) % 2 != 0;
  return hole ? 0.0f : static_cast<float>(rng.uniform());
}

double trilinear(const std::function<double(const ivec3&)>& value, const dvec3& p) {
  const ivec3 base(glm::floor(p));
  const dvec3 f = p - dvec3(base);
  double sum = 0;
  for (int k = 0; k < 8; ++k) {
    const ivec3 o(k & 1, k >> 1 & 1, k >> 2);
    sum += (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z) * value(base + o);
  }
  return sum;
}

const VoxelBox kBox{{-37, 5, -3}, {41, 60, 49}};

double rough_or_zero(const ivec3& v) {
  const bool inside = glm::all(glm::greaterThanEqual(v, kBox.lo)) && glm::all(glm::lessThanEqual(v, kBox.hi));
  return inside ? rough(v) : 0.0;
}

class BrickGridOfCells : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(BrickGrid, BrickGridOfCells, testing::Values(2, 4, 8, 16, 32),
                         testing::PrintToStringParamName());

TEST_P(BrickGridOfCells, LookUpIsTheTrilinearFieldEverywhere) {
  const BrickGrid grid = make_bricks(kBox, rough).recut(GetParam());
  EXPECT_EQ(grid.cell_size(), GetParam());
  Rng rng(1);
  for (int i = 0; i < 20000; ++i) {
    const dvec3 p = test::random_point(rng, dvec3(kBox.lo) - 3.0, dvec3(kBox.hi) + 3.0);
    ASSERT_NEAR(grid.lookup(p - dvec3(grid.origin())), trilinear(rough_or_zero, p), 2e-6)
        << p.x << " " << p.y << " " << p.z;
  }
  for (int i = 0; i < 2000; ++i) {
    const ivec3 v(test::random_point(rng, dvec3(kBox.lo) - 3.0, dvec3(kBox.hi) + 3.0));
    ASSERT_EQ(grid.voxel(v - grid.origin()), static_cast<float>(rough_or_zero(v)));
    ASSERT_NEAR(grid.lookup(dvec3(v - grid.origin())), rough_or_zero(v), 1e-7);
  }
}

TEST(BrickGrid, OneVoxelIsATentOfItsOwnVolume) {
  const BrickGrid grid = make_bricks({{8, 8, 8}, {8, 8, 8}}, [](const ivec3&) { return 2.0f; });
  double sum = 0;
  const int n = 40;
  for (int x = 0; x < n; ++x)
    for (int y = 0; y < n; ++y)
      for (int z = 0; z < n; ++z)
        sum += grid.lookup(dvec3(7) + (dvec3(x, y, z) + 0.5) * (2.0 / n) - dvec3(grid.origin()));
  EXPECT_NEAR(sum * std::pow(2.0 / n, 3), 2.0, 1e-3);
  EXPECT_EQ(grid.brick_count(), 8u);  // the voxel sits on a corner of eight cells' supports
}

TEST(BrickGrid, UniformBricksAreShared) {
  const BrickGrid grid = test::constant_box({0, 0, 0}, {255, 255, 255});
  EXPECT_LT(grid.brick_count(), 6200u);  // the shell, and one for the inside
  EXPECT_EQ(grid.lookup(dvec3(100.3) - dvec3(grid.origin())), 1.0f);
}

TEST(BrickGrid, AHugeSparseGridNeedsLittle) {
  std::vector<ivec3> blocks = {{0, 0, 0}, {99992, 99992, 99992}, {50000, 16, 99992}};
  const BrickGrid grid = BrickGrid::build({{0, 0, 0}, {99999, 99999, 99999}}, blocks,
                                          [](const ivec3&, float* v) { std::fill_n(v, BrickGrid::kBrick, 1.0f); });
  EXPECT_LT(grid.bytes(), 300e6);
  Ray ray{dvec3(-10), glm::normalize(dvec3(1))};
  MajorantWalk walk(grid, ray, 0, 1e9);
  MajorantWalk::Segment s;
  int segments = 0;
  double last = 0;
  while (walk.next(s)) {
    ++segments;
    last = s.t1;
  }
  EXPECT_GT(segments, 1);
  EXPECT_GT(last, 100000 * std::sqrt(3.0) - 100);
}

TEST(BrickGrid, RefusesAnIndexThatDoesNotFit) {
  const VoxelBox box{{0, 0, 0}, {1 << 28, 1 << 28, 1 << 28}};
  EXPECT_THROW(BrickGrid::build(box, {}, [](const ivec3&, float*) {}), InputError);
}

/// Segments are in order, lie inside the support, and every point outside of them is empty.
void check_walk(const BrickGrid& grid, const Ray& ray, double t_max, Rng& rng) {
  MajorantWalk walk(grid, ray, 0, t_max);
  MajorantWalk::Segment s;
  std::vector<MajorantWalk::Segment> segments;
  while (walk.next(s)) {
    ASSERT_LT(s.t0, s.t1);
    ASSERT_GE(s.t0, segments.empty() ? 0.0 : segments.back().t1);
    ASSERT_LE(s.t1, t_max);
    segments.push_back(s);
    ASSERT_LE(segments.size(), 100000u);
    for (int i = 0; i < 3; ++i) {
      const double t = s.t0 + (s.t1 - s.t0) * rng.uniform();
      const float in_brick = grid.lookup_in(*s.cell, s.coordinates, ray.at(t));
      ASSERT_LE(in_brick, s.majorant * (1 + 1e-6f));
      ASSERT_NEAR(in_brick, grid.lookup(ray.at(t)), 2e-5) << "the segment's brick is not the point's";
    }
  }
  for (int i = 0; i < 200; ++i) {
    const double t = std::min(t_max, 400.0) * rng.uniform();
    const bool covered = std::any_of(segments.begin(), segments.end(),
                                     [&](const auto& g) { return t >= g.t0 - 1e-9 && t <= g.t1 + 1e-9; });
    if (!covered) {
      ASSERT_LT(grid.lookup(ray.at(t)), 1e-6f) << "a gap in the walk holds density";
    }
  }
}

TEST_P(BrickGridOfCells, WalkSegmentsCoverTheFieldAndBoundIt) {
  const BrickGrid grid = make_bricks(kBox, rough).recut(GetParam());
  Rng rng(2);
  for (int i = 0; i < 3000; ++i) {
    const dvec3 target = test::random_point(rng, grid.support_lo(), grid.support_hi());
    const dvec3 d = test::random_direction(rng) * (0.2 + 3 * rng.uniform());
    check_walk(grid, {target - d * (100 * rng.uniform()), d}, i % 3 ? 1e9 : 60 * rng.uniform(), rng);
  }
}

TEST_P(BrickGridOfCells, WalkSurvivesAxesFacesEdgesAndCorners) {
  const BrickGrid grid = make_bricks(kBox, rough).recut(GetParam());
  Rng rng(3);
  const dvec3 directions[] = {{1, 0, 0}, {0, -1, 0},   {0, 0, 1},     {1, 1, 0},          {-1, 0, 1},
                              {1, 1, 1}, {-1, -1, -1}, {1, 1e-25, 0}, {1, 1e-14, -1e-14}, {-0.0, 1, -0.0}};
  for (const dvec3& d : directions)
    for (const dvec3& start :
         {dvec3(8, 16, 24), dvec3(8.5, 16, 24), dvec3(0, 0, 0), dvec3(40, 40, 40), dvec3(39.5, 8, 8)}) {
      check_walk(grid, {start, d}, 1e9, rng);
      check_walk(grid, {start - 200.0 * d, d}, 1e9, rng);
    }
}

TEST(MajorantWalk, MajorantsBoundTheFieldUnderRandomAffineTransforms) {
  const BrickGrid grid = make_bricks(kBox, rough);
  Rng rng(4);
  for (int i = 0; i < 200; ++i) {
    const Medium medium(grid, test::random_affine(rng), 3.0, dvec3(1), 0);
    for (int k = 0; k < 10; ++k) {
      const dvec3 target = medium.to_world(test::random_point(rng, grid.support_lo(), grid.support_hi()));
      const dvec3 d = test::random_direction(rng);
      const Ray world{target - 30.0 * d, d}, local = medium.to_local(world);
      // One ray parameter in both spaces.
      ASSERT_NEAR(glm::distance(medium.to_local(world.at(17.0)), local.at(17.0)), 0.0, 1e-8);
      check_walk(grid, local, 1e9, rng);
    }
  }
}

/// Takes a grid apart and puts it together again with some of its indices changed.
struct Damage {
  std::function<void(std::vector<int32_t>&)> nodes = {};
  std::function<void(std::vector<BrickGrid::Cell>&)> cells = {};
  std::function<void(std::vector<float>&)> bricks = {};

  template <class... Members>
  void operator()(Members&... members) {
    (visit(members), ...);
  }
  template <class Member>
  void visit(Member&) {}
  void visit(SharedArray<int32_t>& array) { change(array, nodes); }
  void visit(SharedArray<BrickGrid::Cell>& array) { change(array, cells); }
  void visit(SharedArray<float>& array) { change(array, bricks); }
  template <class T>
  static void change(SharedArray<T>& array, const std::function<void(std::vector<T>&)>& how) {
    std::vector<T> values(array.begin(), array.end());
    if (how) how(values);
    array = SharedArray(std::move(values));
  }
};

// What another process left in memory is walked through only where no index leads out of it.
TEST(BrickGrid, DamagedIndicesAreNoticed) {
  const BrickGrid whole = make_bricks(kBox, rough);
  EXPECT_TRUE(whole.consistent());
  EXPECT_TRUE(BrickGrid().consistent());
  const auto consistent_with = [&](Damage damage) {
    BrickGrid grid = whole;
    grid.transfer(damage);
    return grid.consistent();
  };
  EXPECT_TRUE(consistent_with({}));
  EXPECT_FALSE(consistent_with({.nodes = [](auto& nodes) { nodes.front() = 1 << 20; }}));
  EXPECT_FALSE(consistent_with({.nodes = [](auto& nodes) { nodes.back() = -2; }}));
  EXPECT_FALSE(consistent_with({.nodes = [](auto& nodes) { nodes.pop_back(); }}));
  EXPECT_FALSE(consistent_with({.cells = [](auto& cells) { cells[7].brick = 1u << 31; }}));
  EXPECT_FALSE(consistent_with({.cells = [](auto& cells) { cells[7].majorant = std::nanf(""); }}));
  EXPECT_FALSE(consistent_with({.cells = [](auto& cells) { cells.pop_back(); }}));
  EXPECT_FALSE(consistent_with({.bricks = [](auto& bricks) { bricks.pop_back(); }}));
  EXPECT_TRUE(whole.consistent()) << "copies share values, changes do not reach them";
}

}  // namespace
}  // namespace brume
