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
  EXPECT_LE(grid.brick_count(), 27u);  // a face, an edge or a corner on each side, and the inside
  EXPECT_EQ(grid.lookup(dvec3(100.3) - dvec3(grid.origin())), 1.0f);
}

TEST(BrickGrid, AHugeSparseGridNeedsLittle) {
  std::vector<ivec3> blocks = {{0, 0, 0}, {99992, 99992, 99992}, {50000, 16, 99992}};
  const BrickGrid grid = BrickGrid::build({{0, 0, 0}, {99999, 99999, 99999}}, blocks,
                                          [](const ivec3&, float* v) { std::fill_n(v, BrickGrid::kBrick, 1.0f); });
  EXPECT_LT(grid.bytes(), 10e6);
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

TEST(BrickGrid, AnEnormousBoxCostsWhatIsInIt) {
  const VoxelBox box{{-(1 << 28), 0, 0}, {1 << 28, 1 << 28, 1 << 28}};
  const std::vector<ivec3> blocks = {box.lo, box.hi & ~7};
  const BrickGrid grid =
      BrickGrid::build(box, blocks, [](const ivec3&, float* v) { std::fill_n(v, BrickGrid::kBrick, 1.0f); });
  EXPECT_TRUE(grid.consistent());
  EXPECT_LT(grid.bytes(), 10e6);
  EXPECT_EQ(grid.voxel(box.lo - grid.origin()), 1.0f);
  EXPECT_EQ(grid.voxel(box.hi - grid.origin()), 1.0f);
  EXPECT_EQ(grid.voxel(ivec3(0, 1 << 27, 1 << 27) - grid.origin()), 0.0f);
  EXPECT_THROW(BrickGrid::build({{0, 0, 0}, {(1 << 29) + 1, 0, 0}}, {}, [](const ivec3&, float*) {}), InputError);
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

/// Boxes of one value, some of them in sampled blocks' neighbourhood, one over a background.
struct Patchwork {
  VoxelBox box{{-70, -13, 5}, {700, 260, 300}};
  std::vector<ConstantBox> constants;
  std::vector<ivec3> blocks;

  explicit Patchwork(float background) {
    if (background != 0) constants.push_back({box, background});
    constants.push_back({{{0, 0, 8}, {255, 255, 263}}, 2.0f});
    constants.push_back({{{256, 0, 8}, {383, 127, 135}}, 2.0f});
    constants.push_back({{{384, 0, 8}, {511, 127, 135}}, 0.5f});
    constants.push_back({{{512, 128, 136}, {639, 255, 263}}, background != 0 ? 0.0f : 3.0f});
    blocks = {{640, 128, 136}, {64, 64, 72}, {512, 0, 8}, {-64, 0, 160}, {0, 256, 8}};
  }
  float operator()(const ivec3& v) const {
    if (glm::any(glm::lessThan(v, box.lo)) || glm::any(glm::greaterThan(v, box.hi))) return 0;
    if (std::find(blocks.begin(), blocks.end(), v & ~7) != blocks.end()) return rough(v) + 0.25f;
    float value = 0;
    for (const ConstantBox& c : constants)
      if (glm::all(glm::greaterThanEqual(v, c.box.lo)) && glm::all(glm::lessThanEqual(v, c.box.hi))) value = c.value;
    return value;
  }
  BrickGrid build() const {
    return BrickGrid::build(box, {blocks, constants}, [&](const ivec3& lo, float* values) {
      for (int x = 0; x <= 8; ++x)
        for (int y = 0; y <= 8; ++y)
          for (int z = 0; z <= 8; ++z) *values++ = (*this)(lo + ivec3(x, y, z));
    });
  }
};

TEST_P(BrickGridOfCells, ConstantBoxesAreTheirVoxels) {
  for (const float background : {0.0f, 0.125f}) {
    const Patchwork patchwork(background);
    const BrickGrid grid = patchwork.build().recut(GetParam());
    ASSERT_TRUE(grid.consistent());
    EXPECT_EQ(grid.maximum(), 2.0f + (background != 0 ? 0.0f : 1.0f));
    Rng rng(5);
    const dvec3 lo = dvec3(patchwork.box.lo) - 3.0, hi = dvec3(patchwork.box.hi) + 3.0;
    for (int i = 0; i < 200000; ++i) {
      ivec3 v(test::random_point(rng, lo, hi));
      // Half of them on the faces, where values change.
      if (i % 2)
        for (int a = 0; a < 3; ++a)
          if (rng.uniform() < 0.6) v[a] = (v[a] & ~127) + (a == 2 ? 8 : 0) - (rng.uniform() < 0.5);
      ASSERT_EQ(grid.voxel(v - grid.origin()), patchwork(v)) << v.x << " " << v.y << " " << v.z;
    }
    for (int i = 0; i < 300; ++i) {
      const dvec3 target = test::random_point(rng, grid.support_lo(), grid.support_hi());
      check_walk(grid, {target - 500.0 * test::random_direction(rng), test::random_direction(rng)}, 1e9, rng);
    }
  }
}

// The same bits as of a volume whose voxels are all sampled, bricks and majorants, whatever shares what.
TEST(BrickGrid, ConstantBoxesMakeTheCellsThatVoxelsMake) {
  for (const float background : {0.0f, 0.125f}) {
    const Patchwork patchwork(background);
    const BrickGrid grid = patchwork.build(), sampled = make_bricks(patchwork.box, patchwork);
    ASSERT_EQ(grid.cells(), sampled.cells());
    EXPECT_LE(grid.brick_count(), sampled.brick_count());
    for (int x = 0; x < grid.cells().x; ++x)
      for (int y = 0; y < grid.cells().y; ++y)
        for (int z = 0; z < grid.cells().z; ++z) {
          const BrickGrid::Cell &a = grid.cell({x, y, z}), &b = sampled.cell({x, y, z});
          ASSERT_EQ(a.brick != 0, b.brick != 0);
          ASSERT_EQ(a.majorant, b.majorant);
          if (a.brick) {
            ASSERT_TRUE(std::equal(grid.brick(a), grid.brick(a) + grid.brick_values(), sampled.brick(b)));
          }
        }
  }
}

TEST(BrickGrid, AConstantBoxCostsNeitherItsVoxelsNorItsCells) {
  const auto never = [](const ivec3&, float*) { FAIL() << "no value has to be asked for"; };
  const VoxelBox tile{{-4096, 0, 4096}, {-1, 4095, 8191}}, far_tile{{1 << 28, 0, 0}, {(1 << 28) + 4095, 4095, 4095}};
  const BrickGrid one = BrickGrid::build(tile, Occupancy({}, {{tile, 0.5f}}), never);
  EXPECT_LT(one.bytes(), 2e6);
  EXPECT_EQ(one.voxel(tile.lo - one.origin()), 0.5f);
  EXPECT_EQ(one.voxel(tile.lo - one.origin() - 1), 0.0f);
  EXPECT_EQ(one.lookup(dvec3(tile.lo - one.origin()) - dvec3(0.25, 0, 0)), 0.375f);
  uint64_t cells = 0;
  one.each_distinct_cell([&](const BrickGrid::Cell&, uint64_t count) { cells += count; });
  EXPECT_EQ(cells, uint64_t{513} * 513 * 513);
  const VoxelBox both{glm::min(tile.lo, far_tile.lo), glm::max(tile.hi, far_tile.hi)};
  const BrickGrid two = BrickGrid::build(both, Occupancy({}, {{tile, 0.5f}, {far_tile, 0.25f}}), never);
  EXPECT_LT(two.bytes(), 20e6);
  EXPECT_EQ(two.voxel(far_tile.lo - two.origin()), 0.25f);
  EXPECT_EQ(two.voxel(far_tile.lo - two.origin() - ivec3(1, 0, 0)), 0.0f);
}

/// Takes a grid apart and puts it together again with some of its indices changed.
struct Damage {
  std::function<void(std::vector<int32_t>&)> nodes = {};
  std::function<void(std::vector<uint8_t>&)> levels = {};
  std::function<void(std::vector<BrickGrid::Cell>&)> cells = {};
  std::function<void(std::vector<float>&)> bricks = {};

  template <class... Members>
  void operator()(Members&... members) {
    (visit(members), ...);
  }
  template <class Member>
  void visit(Member&) {}
  void visit(SharedArray<int32_t>& array) { change(array, nodes); }
  void visit(SharedArray<uint8_t>& array) { change(array, levels); }
  void visit(SharedArray<BrickGrid::Cell>& array) { change(array, cells); }
  void visit(SharedArray<float>& array) { change(array, bricks); }
  template <class T>
  static void change(SharedArray<T>& array, const std::function<void(std::vector<T>&)>& how) {
    std::vector<T> values(array.begin(), array.end());
    if (how && !values.empty()) how(values);
    array = SharedArray(std::move(values));
  }
};

// What another process left in memory is walked through only where no index leads out of it.
class DamagedBrickGrid : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(BrickGrid, DamagedBrickGrid, testing::Bool(),
                         [](const auto& wide) { return std::string(wide.param ? "OfSeveralLevels" : "OfOneLevel"); });

TEST_P(DamagedBrickGrid, IsNoticed) {
  const VoxelBox wide{{-(1 << 20), -(1 << 20), 0}, {1 << 20, 1 << 20, 1 << 20}};
  const BrickGrid whole =
      GetParam() ? BrickGrid::build(wide, std::vector{wide.lo, wide.hi & ~7},
                                    [](const ivec3&, float* v) { std::fill_n(v, BrickGrid::kBrick, 1.0f); })
                 : make_bricks(kBox, rough);
  EXPECT_TRUE(whole.consistent());
  EXPECT_TRUE(BrickGrid().consistent());
  const auto consistent_with = [&](Damage damage) {
    BrickGrid grid = whole;
    grid.transfer(damage);
    return grid.consistent();
  };
  EXPECT_TRUE(consistent_with({}));
  if (GetParam()) {
    EXPECT_FALSE(consistent_with({.levels = [](auto& levels) { levels.front() = 9; }}));
  }
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
