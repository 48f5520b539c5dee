// Which grid of a file is meant.

#include <gtest/gtest.h>

#include "tests/support/vdb_files.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

using test::holds;
using test::load_error;
using test::notes_of;
using test::small_grid;
using test::write;

TEST(LoadDensity, ChoosesTheGridThatIsMeant) {
  const test::TemporaryFolder folder;
  write(folder / "a.vdb", {small_grid<openvdb::FloatGrid>("shadow"), small_grid<openvdb::FloatGrid>("density_noise"),
                           small_grid<openvdb::Vec3SGrid>("velocity")});
  EXPECT_EQ(load_scalar(folder / "a.vdb", {}).summary.name, "density_noise");
  EXPECT_EQ(load_scalar(folder / "a.vdb", {"shadow"}).summary.name, "shadow");
  const std::string missing = load_error(folder / "a.vdb", {"smoke"});
  EXPECT_TRUE(holds(missing, "no grid 'smoke'") && holds(missing, "shadow (float)") &&
              holds(missing, "velocity (vec3s)"))
      << missing;
  EXPECT_TRUE(holds(load_error(folder / "a.vdb", {"velocity"}), "of type vec3s; expected float or double"));
}

TEST(LoadDensity, GridsOfOneNameAreAskedForByNumber) {
  const test::TemporaryFolder folder;
  const auto first = small_grid<openvdb::FloatGrid>("density"), second = small_grid<openvdb::FloatGrid>("density");
  second->tree().setValue(openvdb::Coord(9, 0, 0), 7.0f);
  write(folder / "two.vdb", {first, second});
  const ScalarField field = load_scalar(folder / "two.vdb", {});
  EXPECT_EQ(field.summary.active_voxels, 5u);
  EXPECT_TRUE(holds(notes_of(field),
                    "2 grids are named 'density': 'density[0]' is used, the others can be named as "
                    "'density[1]'"))
      << notes_of(field);
  EXPECT_EQ(load_scalar(folder / "two.vdb", {"density"}).summary.name, "density[0]");
  EXPECT_EQ(load_scalar(folder / "two.vdb", {"density[1]"}).summary.active_voxels, 6u);
  EXPECT_TRUE(load_scalar(folder / "two.vdb", {"density[1]"}).notes.empty());
  EXPECT_TRUE(holds(load_error(folder / "two.vdb", {"density[2]"}), "density[0] (float), density[1] (float)"));
  write(folder / "one.vdb", {first});
  EXPECT_EQ(load_scalar(folder / "one.vdb", {"density[0]"}).summary.name, "density");
  EXPECT_EQ(read_vdb_contents(folder / "two.vdb").grids[1].name, "density[1]");
  EXPECT_EQ(read_vdb_info(folder / "two.vdb").grids[1].name, "density[1]");
}

TEST(LoadDensity, AGridWithoutANameIsToldAndAskedFor) {
  const test::TemporaryFolder folder;
  write(folder / "u.vdb", {small_grid<openvdb::FloatGrid>("")});
  const ScalarField field = load_scalar(folder / "u.vdb", {});
  EXPECT_EQ(field.summary.active_voxels, 5u);
  EXPECT_TRUE(holds(notes_of(field), "no grid 'density'; the unnamed grid '[0]' is used")) << notes_of(field);
  EXPECT_EQ(load_scalar(folder / "u.vdb", {"[0]"}).summary.active_voxels, 5u);
  EXPECT_TRUE(holds(load_error(folder / "u.vdb", {"smoke"}),
                    "no grid 'smoke'; the file has: an unnamed grid (float), which is asked for as '[0]'"));
}

TEST(LoadDensity, KnowsWhatProgramsCallIt) {
  const test::TemporaryFolder folder;
  const auto chosen = [&](const std::vector<std::string>& names) {
    openvdb::GridPtrVec grids;
    for (const std::string& name : names) grids.push_back(small_grid<openvdb::FloatGrid>(name));
    grids.push_back(small_grid<openvdb::Vec3SGrid>("velocity"));
    write(folder / "n.vdb", grids);
    try {
      return load_scalar(folder / "n.vdb", {}).summary.name;
    } catch (const InputError& error) {
      return std::string(error.what());
    }
  };
  for (const char* only : {"density", "Density", "soot", "temperature", "Fog Density", "a.b"})
    EXPECT_EQ(chosen({only}), only) << "the only one that holds numbers";
  EXPECT_EQ(chosen({"flames", "fuel", "smoke", "temperature"}), "smoke") << "EmberGen";
  EXPECT_EQ(chosen({"Temperature", "Smoke", "Fuel"}), "Smoke") << "Phoenix, FumeFX";
  EXPECT_EQ(chosen({"voxel_temperature", "voxel_fog_density"}), "voxel_fog_density") << "Bifrost";
  EXPECT_EQ(chosen({"shadow", "flame_noise", "density_noise"}), "density_noise") << "Blender";
  EXPECT_EQ(chosen({"temperature", "density_level_4"}), "density_level_4");
  EXPECT_EQ(chosen({"smoke", "density"}), "density");
  EXPECT_EQ(chosen({"heat", "soot", "pressure", "vel.x", "vel.y", "vel.z"}), "soot") << "what is left";
  const std::string unclear = chosen({"soot", "dust", "heat"});
  EXPECT_TRUE(holds(unclear, "no grid 'density', and several that could be it: 'dust', 'soot'; name one")) << unclear;
  EXPECT_TRUE(holds(unclear, "heat (float)")) << "all that there is";
  EXPECT_TRUE(holds(chosen({"density_a", "density_b"}), "'density_a', 'density_b'"));
  EXPECT_TRUE(holds(chosen({"temperature", "flame"}), "no grid 'density'; the file has: flame (float)"));
}

TEST(LoadDensity, AFileWithoutGridsIsAnAbsentMedium) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  write(folder / "none.vdb", {});
  for (const char* name : {"", "density"}) {
    const ScalarField field = load_scalar(folder / "none.vdb", {name});
    EXPECT_TRUE(field.bricks.empty());
    EXPECT_TRUE(holds(notes_of(field), "none.vdb holds no grid"));
  }
}

TEST(LoadField, WithoutAUsualNameIsNoSuchGrid) {
  const test::TemporaryFolder folder;
  write(folder / "d.vdb", {small_grid<openvdb::FloatGrid>("density")});
  EXPECT_THROW(load_scalar(folder / "d.vdb", {.use = GridUse::kTemperature}), NoSuchGrid);
  EXPECT_THROW(load_colour(folder / "d.vdb", ""), NoSuchGrid);
  std::vector<std::string> notes;
  const ScalarField density = load_scalar(folder / "d.vdb", {});
  EXPECT_THROW(load_displacement(folder / "d.vdb", "", density, {1, 0, 1}, notes), NoSuchGrid);
}

TEST(LoadDensity, AnEmptyGridIsAnAbsentMedium) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  auto grid = openvdb::FloatGrid::create();
  grid->setName("density");
  write(folder / "e.vdb", {grid, small_grid<openvdb::FloatGrid>("smoke")});
  const ScalarField field = load_scalar(folder / "e.vdb", {});
  EXPECT_TRUE(field.bricks.empty());
  ASSERT_EQ(field.notes.size(), 1u);
  EXPECT_TRUE(holds(field.notes[0], "empty: the field is absent"));
  EXPECT_TRUE(holds(field.notes[0], "smoke (float)")) << "what could be meant instead";
}

TEST(LoadDensity, OfLevelsWithoutTheFinestTheFinestThereIs) {
  const test::TemporaryFolder folder;
  write(folder / "l.vdb",
        {small_grid<openvdb::FloatGrid>("density_level_2"), small_grid<openvdb::FloatGrid>("density_level_1")});
  for (const char* name : {"", "density"}) {
    const ScalarField field = load_scalar(folder / "l.vdb", {name});
    EXPECT_EQ(field.summary.name, "density_level_1");
    EXPECT_TRUE(holds(notes_of(field), "'density_level_1', the finest that there is, is used")) << notes_of(field);
  }
}

}  // namespace
}  // namespace brume
