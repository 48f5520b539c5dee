// Grids of halves, and coarser levels of detail beside a grid.

#include <gtest/gtest.h>

#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/vdb_grids.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

using HalfGrid = openvdb::Grid<openvdb::tree::Tree4<openvdb::math::half, 5, 4, 3>::Type>;

void write(const std::filesystem::path& path, const openvdb::GridPtrVec& grids) {
  openvdb::io::File file(path.string());
  file.write(grids);
  file.close();
}

template <class Grid>
typename Grid::Ptr named(const std::string& name, double factor = 1, double voxel_size = 0.5) {
  openvdb::initialize();
  if (!HalfGrid::isRegistered()) HalfGrid::registerGrid();
  using Value = typename Grid::ValueType;
  auto grid = Grid::create();
  grid->setName(name);
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(voxel_size));
  for (int i = 0; i < 20; ++i)
    grid->tree().setValue({i, 2 * i, -i}, Value(static_cast<float>(0.125 * factor * (i + 1))));
  grid->tree().addTile(1, {64, 0, 0}, Value(static_cast<float>(0.5 * factor)), true);
  return grid;
}

TEST(HalfGrids, HoldWhatFloatsOfTheirValuesHold) {
  const test::TemporaryFolder folder;
  write(folder / "half.vdb", {named<HalfGrid>("density")});
  write(folder / "float.vdb", {named<openvdb::FloatGrid>("density")});
  const ScalarField halves = load_scalar(folder / "half.vdb", {}), floats = load_scalar(folder / "float.vdb", {});
  EXPECT_TRUE(halves.notes.empty());
  EXPECT_EQ(halves.world_from_index, floats.world_from_index);
  EXPECT_EQ(halves.bricks.origin(), floats.bricks.origin());
  for (int x = -2; x < 80; ++x)
    for (int y = -2; y < 42; ++y)
      for (int z = -22; z < 10; ++z) {
        const ivec3 v = ivec3(x, y, z) - floats.bricks.origin();
        ASSERT_EQ(halves.bricks.voxel(v), floats.bricks.voxel(v));
      }
  const VdbSummary info = read_vdb_info(folder / "half.vdb");
  EXPECT_EQ(info.grids[0].type, "half");
  EXPECT_EQ(info.grids[0].maximum, 2.5);
  EXPECT_EQ(info.grids[0].active_voxels, 20u + 512u);
}

TEST(GridLevels, CoarserOnesAreNoDensitiesOfTheirOwn) {
  const test::TemporaryFolder folder;
  const auto grid = [](const char* name, double factor) { return named<openvdb::FloatGrid>(name, factor, factor); };
  write(folder / "multi.vdb",
        {grid("density_level_0", 1), grid("density_level_1", 2), grid("density_level_2", 4), grid("heat_level_1", 8)});
  const ScalarField finest = load_scalar(folder / "multi.vdb", {});
  EXPECT_EQ(finest.summary.name, "density_level_0");
  EXPECT_EQ(finest.bricks.maximum(), 2.5f);
  EXPECT_EQ(load_scalar(folder / "multi.vdb", {.grid = "density_level_1"}).bricks.maximum(), 5.0f)
      << "where it is named";
  EXPECT_EQ(load_scalar(folder / "multi.vdb", {.grid = "density"}).summary.name, "density_level_0");
  write(folder / "beside.vdb", {grid("smoke_level_1", 2), grid("smoke", 1)});
  EXPECT_EQ(load_scalar(folder / "beside.vdb", {}).summary.name, "smoke");
  write(folder / "alone.vdb", {grid("density_level_1", 2)});
  EXPECT_EQ(load_scalar(folder / "alone.vdb", {}).summary.name, "density_level_1") << "of nothing finer";

  const std::vector<GridEntry> entries = read_vdb_contents(folder / "multi.vdb").entries();
  const auto level = level_of(entries, "density_level_2");
  ASSERT_TRUE(level);
  EXPECT_EQ(level->of, "density_level_0");
  EXPECT_EQ(level->level, 2);
  EXPECT_FALSE(level_of(entries, "density_level_0"));
  EXPECT_FALSE(level_of(entries, "heat_level_1"));
  const test::ProgramResult info = test::run_brume("info '" + (folder / "multi.vdb").string() + "'");
  EXPECT_NE(info.out.find("level         2 of 'density_level_0', coarser: read only where it is named"),
            std::string::npos)
      << info.out;
}

}  // namespace
}  // namespace brume
