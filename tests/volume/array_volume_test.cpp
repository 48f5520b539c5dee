#include "volume/array_volume.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/error.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

/// An array of its own, x slowest.
struct Array {
  ivec3 size;
  std::vector<float> values;

  Array(const ivec3& n, const std::function<float(const ivec3&)>& value) : size(n) {
    for (int x = 0; x < n.x; ++x)
      for (int y = 0; y < n.y; ++y)
        for (int z = 0; z < n.z; ++z) values.push_back(value({x, y, z}));
  }
  VoxelArray view() const {
    VoxelArray view;
    view.data = reinterpret_cast<const std::byte*>(values.data());
    view.size = size;
    view.stride = {4 * size.y * size.z, 4 * size.z, 4};
    return view;
  }
};

float blob(const ivec3& v) {
  const dvec3 d = dvec3(v) - dvec3(9, 13, 6);
  return static_cast<float>(std::max(0.0, 1 - glm::length(d) / 6 + 0.1 * std::sin(v.x + 2 * v.y)));
}

std::shared_ptr<const ScalarField> field_of(const Array& array) {
  return grids_of_arrays({.density = array.view()})->density;
}

TEST(ArrayVolume, HoldsEachValueAtItsIndicesAndNothingOutside) {
  const Array array({21, 27, 13}, blob);
  const auto field = field_of(array);
  const BrickGrid& bricks = field->bricks;
  for (int x = -2; x < 23; ++x)
    for (int y = -2; y < 29; ++y)
      for (int z = -2; z < 15; ++z) {
        const bool inside = x >= 0 && y >= 0 && z >= 0 && x < 21 && y < 27 && z < 13;
        ASSERT_EQ(bricks.voxel(ivec3(x, y, z) - bricks.origin()), inside ? blob({x, y, z}) : 0.0f);
      }
  std::vector<float> again(array.values.size());
  copy_values(bricks, array.size, again.data());
  EXPECT_EQ(again, array.values);
}

TEST(ArrayVolume, EqualsTheSameVolumeInAFileBrickByBrick) {
  const test::TemporaryFolder folder;
  const Array array({37, 27, 30}, blob);
  const ScalarOptions adjusted{.remap = {{0.0, 0.0}, {0.5, 2.0}, {1.0, 2.5}}, .limit = 1.75};
  test::write_affine_vdb(folder / "a.vdb", {ivec3(0), array.size - 1}, dmat4(1), blob);
  for (const ScalarOptions& options : {ScalarOptions(), adjusted}) {
    const ScalarField file = load_scalar(folder / "a.vdb", options),
                      here = adjusted_density(*field_of(array), options, {});
    const BrickGrid &a = file.bricks, &b = here.bricks;
    ASSERT_EQ(a.origin(), b.origin());
    ASSERT_EQ(a.cells(), b.cells());
    EXPECT_EQ(a.support_lo(), b.support_lo());
    EXPECT_EQ(a.support_hi(), b.support_hi());
    EXPECT_EQ(a.maximum(), b.maximum());
    for (int x = 0; x < a.cells().x; ++x)
      for (int y = 0; y < a.cells().y; ++y)
        for (int z = 0; z < a.cells().z; ++z) {
          const BrickGrid::Cell &p = a.cell({x, y, z}), &q = b.cell({x, y, z});
          ASSERT_EQ(p.brick != 0, q.brick != 0);
          ASSERT_EQ(p.majorant, q.majorant);
          if (p.brick) {
            ASSERT_TRUE(std::equal(a.brick(p), a.brick(p) + BrickGrid::kBrick, b.brick(q)));
          }
        }
    ASSERT_EQ(file.notes.size(), here.notes.size());
    for (size_t i = 0; i < file.notes.size(); ++i) EXPECT_EQ(file.notes[i], here.notes[i]);
  }
}

TEST(ArrayVolume, TakesRowsInAnyOrderAndDoubles) {
  const Array array({5, 9, 7}, [](const ivec3& v) { return static_cast<float>(1 + v.x + 10 * v.y + 100 * v.z); });
  const std::string expected = grids_of_arrays({.density = array.view()})->content;
  std::vector<double> turned;  // z slowest, x fastest and backwards, every second value something else
  for (int z = 0; z < 7; ++z)
    for (int y = 0; y < 9; ++y)
      for (int x = 4; x >= 0; --x) {
        turned.push_back(1 + x + 10 * y + 100 * z);
        turned.push_back(std::numeric_limits<double>::quiet_NaN());
      }
  VoxelArray view;
  view.type = VoxelArray::Type::kDouble;
  view.size = array.size;
  view.stride = {-16, 16 * 5, 16 * 5 * 9};
  view.data = reinterpret_cast<const std::byte*>(turned.data() + 8);
  EXPECT_EQ(grids_of_arrays({.density = view})->content, expected);
  EXPECT_NE(grids_of_arrays({.temperature = view})->content, expected) << "what a grid is for counts";
  turned[16] += 1;
  EXPECT_NE(grids_of_arrays({.density = view})->content, expected) << "each value counts";
}

TEST(ArrayVolume, SaysWhatItTakesForSomethingElse) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
  Array array({4, 4, 4}, [](const ivec3& v) { return static_cast<float>(v.x); });
  array.values[0] = kNan;
  array.values[1] = -2;
  array.values[2] = kInf;
  array.values[3] = -kInf;
  const auto field = field_of(array);
  EXPECT_EQ(field->bricks.voxel(ivec3(0, 0, 2) - field->bricks.origin()), 3.0f) << "the largest finite value";
  for (const int z : {0, 1, 3}) EXPECT_EQ(field->bricks.voxel(ivec3(0, 0, z) - field->bricks.origin()), 0.0f);
  ASSERT_EQ(field->notes.size(), 4u);
  EXPECT_EQ(field->notes[0], "grid 'density': 1 NaN voxels became 0");
  EXPECT_EQ(field->notes[2], "grid 'density': 1 negative infinite voxels became 0");
  EXPECT_EQ(field->notes[3], "grid 'density': 1 infinite voxels became the largest finite value, 3");
  const auto nothing = field_of(Array({3, 3, 3}, [](const ivec3&) { return -1.0f; }));
  EXPECT_TRUE(nothing->bricks.empty());
  EXPECT_EQ(nothing->notes.back(), "grid 'density' holds no positive value: the field is absent");
  const auto colour = grids_of_arrays({.colour = {{array.view(), array.view(), array.view()}}})->colour;
  ASSERT_EQ(colour->notes.size(), 1u);
  EXPECT_EQ(colour->notes[0], "grid 'color': what is not finite in 3 voxels became 0");
}

TEST(ArrayVolume, CountsColoursThatAreNoNumbers) {
  const Array plain({6, 5, 4}, blob), broken({6, 5, 4}, [](const ivec3&v) {
    return v.x == 2 && v.y < 3 && v.z == 1 ? std::numeric_limits<float>::infinity() : 1.0f;
  });
  const auto grids =
      grids_of_arrays({.density = plain.view(), .colour = std::array{plain.view(), broken.view(), plain.view()}});
  ASSERT_EQ(grids->colour->notes.size(), 1u);
  EXPECT_EQ(grids->colour->notes[0], "grid 'color': what is not finite in 3 voxels became 0");
}

TEST(ArrayVolume, KeepsTheOtherGridsWhereOneIsReplaced) {
  const Array one({4, 5, 6}, blob), two({4, 5, 6}, [](const ivec3&v) { return static_cast<float>(v.z); });
  const auto both = grids_of_arrays({.density = one.view(), .temperature = two.view()});
  const auto replaced = grids_of_arrays({.density = two.view()}, both.get());
  EXPECT_EQ(replaced->temperature, both->temperature);
  EXPECT_NE(replaced->content, both->content);
  EXPECT_EQ(grids_of_arrays({.density = one.view()}, replaced.get())->content, both->content);
}

TEST(ArrayVolume, CanBeCancelled) {
  const Array array({40, 40, 40}, blob);
  const std::atomic<bool> cancel{true};
  EXPECT_THROW(grids_of_arrays({.density = array.view()}, nullptr, {2, {}, &cancel}), Interrupted);
}

}  // namespace
}  // namespace brume
