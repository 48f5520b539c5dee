#include "volume/vdb_io.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <sstream>

#include "base/error.h"
#include "tests/support/files.h"
#include "tests/support/vdb_grids.h"
#include "tests/support/volumes.h"
#include "volume/medium.h"
#include "volume/procedural.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

void write(const fs::path& path, const openvdb::GridPtrVec& grids) {
  openvdb::io::File file(path.string());
  file.write(grids);
  file.close();
}

template <class Grid>
typename Grid::Ptr small_grid(const std::string& name) {
  openvdb::initialize();
  auto grid = Grid::create();
  grid->setName(name);
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  for (int i = 0; i < 5; ++i) grid->tree().setValue(openvdb::Coord(i, 0, 0), typename Grid::ValueType(i + 1));
  return grid;
}

std::string load_error(const fs::path& path, const ScalarOptions& options = {}) {
  try {
    load_scalar(path, options);
  } catch (const InputError& error) {
    return error.what();
  } catch (const OutOfMemory& error) {
    return std::string("memory: ") + error.what();
  }
  return "";
}

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST(LoadDensity, TransformsOfEveryAffineKind) {
  const test::TemporaryFolder folder;
  Rng rng(1);
  for (int i = 0; i < 8; ++i) {
    const dmat4 m = test::random_affine(rng);
    test::write_affine_vdb(folder / "a.vdb", {{-3, 2, 5}, {9, 8, 7}}, m,
                           [](const ivec3& v) { return 0.1f * static_cast<float>(v.x + 4) + static_cast<float>(v.z); });
    const ScalarField field = load_scalar(folder / "a.vdb", {});
    for (int c = 0; c < 4; ++c)
      for (int r = 0; r < 4; ++r) EXPECT_NEAR(field.world_from_index[c][r], m[c][r], 1e-12);
    const Medium medium(field.bricks, field.world_from_index, 1, dvec3(1), 0);
    const dvec3 world = dvec3(m * glm::dvec4(2.5, 4, 6, 1));  // between voxels (2, 4, 6) and (3, 4, 6)
    EXPECT_NEAR(medium.sigma_t(medium.to_local(world)), 0.1 * 6.5 + 6, 1e-5);
  }
}

TEST(LoadDensity, FloatDoubleAndHalfAgree) {
  const test::TemporaryFolder folder;
  auto floats = small_grid<openvdb::FloatGrid>("density"), halves = small_grid<openvdb::FloatGrid>("density");
  auto doubles = small_grid<openvdb::DoubleGrid>("density");
  halves->setSaveFloatAsHalf(true);
  write(folder / "f.vdb", {floats}), write(folder / "h.vdb", {halves}), write(folder / "d.vdb", {doubles});
  for (const char* name : {"f.vdb", "h.vdb", "d.vdb"}) {
    const ScalarField field = load_scalar(folder / name, {});
    for (int i = 0; i < 5; ++i)
      EXPECT_EQ(field.bricks.voxel(ivec3(i, 0, 0) - field.bricks.origin()), static_cast<float>(i + 1)) << name;
  }
}

TEST(LoadDensity, TilesAndBackgroundCount) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  auto grid = openvdb::FloatGrid::create(0.25f);
  grid->setName("density");
  grid->sparseFill(openvdb::CoordBBox({0, 0, 0}, {255, 127, 127}), 2.0f);
  grid->tree().setValue({300, 64, 64}, 5.0f);
  ASSERT_GT(grid->tree().activeTileCount(), 0u);
  write(folder / "t.vdb", {grid});
  const ScalarField field = load_scalar(folder / "t.vdb", {});
  const auto at = [&](int x, int y, int z) { return field.bricks.voxel(ivec3(x, y, z) - field.bricks.origin()); };
  EXPECT_EQ(at(100, 100, 100), 2.0f);
  EXPECT_EQ(at(300, 64, 64), 5.0f);
  EXPECT_EQ(at(280, 10, 10), 0.25f) << "the background inside the active box";
  EXPECT_EQ(at(301, 64, 64), 0.0f) << "the background outside";
  ASSERT_FALSE(field.notes.empty());
  EXPECT_TRUE(holds(field.notes[0], "background 0.25"));
}

TEST(LoadDensity, OddValuesAreCountedAndSanitised) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  auto grid = openvdb::FloatGrid::create();
  grid->setName("density");
  const float values[] = {1,
                          std::numeric_limits<float>::quiet_NaN(),
                          -2,
                          std::numeric_limits<float>::infinity(),
                          3,
                          std::numeric_limits<float>::denorm_min(),
                          -std::numeric_limits<float>::infinity()};
  for (int i = 0; i < 7; ++i) grid->tree().setValue(openvdb::Coord(i, 0, 0), values[i]);
  write(folder / "n.vdb", {grid});
  const ScalarField field = load_scalar(folder / "n.vdb", {});
  const float expected[] = {1, 0, 0, 3, 3, 0, 0};
  for (int i = 0; i < 7; ++i) EXPECT_EQ(field.bricks.voxel(ivec3(i, 0, 0) - field.bricks.origin()), expected[i]);
  std::string notes;
  for (const std::string& n : field.notes) notes += n + "\n";
  EXPECT_TRUE(holds(notes, "1 NaN voxels became 0")) << notes;
  EXPECT_TRUE(holds(notes, "1 negative voxels became 0"));
  EXPECT_TRUE(holds(notes, "1 infinite voxels became the largest finite value, 3"));
  EXPECT_TRUE(holds(notes, "1 negative infinite voxels became 0"));
  EXPECT_TRUE(holds(notes, "1 denormal voxels became 0"));
}

TEST(LoadDensity, InfiniteVoxelsWithoutAFiniteOneAreNoDensity) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  auto grid = openvdb::FloatGrid::create();
  grid->setName("density");
  for (int i = 0; i < 3; ++i)
    grid->tree().setValue(openvdb::Coord(i, 0, 0), (i ? 1 : -1) * std::numeric_limits<float>::infinity());
  write(folder / "n.vdb", {grid});
  const ScalarField field = load_scalar(folder / "n.vdb", {});
  EXPECT_TRUE(field.bricks.empty());
  std::string notes;
  for (const std::string& n : field.notes) notes += n + "\n";
  EXPECT_TRUE(holds(notes, "1 negative infinite voxels became 0")) << notes;
  EXPECT_TRUE(holds(notes, "2 infinite voxels became 0: no finite value is positive")) << notes;
  EXPECT_TRUE(holds(notes, "holds no positive value")) << notes;
}

/// The same values in a grid whose tiles have been made voxels.
openvdb::FloatGrid::Ptr of_voxels(const openvdb::FloatGrid& tiles) {
  auto grid = openvdb::FloatGrid::create(tiles.background());
  grid->setName(tiles.getName());
  for (auto it = tiles.cbeginValueOn(); it; ++it) grid->tree().fill(it.getBoundingBox(), *it, true);
  grid->tree().voxelizeActiveTiles();
  return grid;
}

void expect_same_cells(const BrickGrid& a, const BrickGrid& b) {
  ASSERT_EQ(a.origin(), b.origin());
  ASSERT_EQ(a.cells(), b.cells());
  for (int x = 0; x < a.cells().x; ++x)
    for (int y = 0; y < a.cells().y; ++y)
      for (int z = 0; z < a.cells().z; ++z) {
        const BrickGrid::Cell &p = a.cell({x, y, z}), &q = b.cell({x, y, z});
        ASSERT_EQ(p.brick != 0, q.brick != 0) << x << " " << y << " " << z;
        ASSERT_EQ(p.majorant, q.majorant);
        if (p.brick) {
          ASSERT_TRUE(std::equal(a.brick(p), a.brick(p) + a.brick_values(), b.brick(q))) << x << " " << y << " " << z;
        }
      }
}

TEST(LoadDensity, TilesAreTheirVoxels) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  for (const float background : {0.0f, 0.25f}) {
    auto grid = openvdb::FloatGrid::create(background);
    grid->setName("density");
    grid->sparseFill(openvdb::CoordBBox({-128, 0, 0}, {127, 127, 127}), 2.0f);
    grid->sparseFill(openvdb::CoordBBox({128, 0, 0}, {255, 127, 127}), 1.0f);
    grid->sparseFill(openvdb::CoordBBox({-128, 128, 0}, {-1, 255, 127}), 0.0f);  // active, and no density
    grid->sparseFill(openvdb::CoordBBox({0, 128, 0}, {7, 135, 7}), 3.0f);        // a small one
    grid->tree().setValue({270, 64, 64}, 5.0f);                                  // voxels beside
    grid->tree().setValue({64, 64, 64}, 7.0f);                                   // and in the middle of a tile
    ASSERT_GT(grid->tree().activeTileCount(), 4u);
    write(folder / "tiles.vdb", {grid}), write(folder / "voxels.vdb", {of_voxels(*grid)});
    const ScalarField tiles = load_scalar(folder / "tiles.vdb", {}), voxels = load_scalar(folder / "voxels.vdb", {});
    EXPECT_EQ(tiles.summary.active_voxels, voxels.summary.active_voxels);
    EXPECT_EQ(tiles.bricks.maximum(), 7.0f);
    expect_same_cells(tiles.bricks, voxels.bricks);
  }
}

// A tile that is not active counts with its value as voxels do, inside the box of what is active.
TEST(LoadDensity, TilesThatAreNotActiveCountInsideTheActiveBox) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  auto grid = openvdb::FloatGrid::create();
  grid->setName("density");
  grid->tree().addTile(2, {0, 0, 0}, 0.5f, false);
  grid->tree().setValue({-1, 60, 60}, 1.0f);
  grid->tree().setValue({130, 61, 100}, 1.0f);
  write(folder / "t.vdb", {grid});
  const ScalarField field = load_scalar(folder / "t.vdb", {});
  const auto at = [&](int x, int y, int z) { return field.bricks.voxel(ivec3(x, y, z) - field.bricks.origin()); };
  EXPECT_EQ(at(-1, 60, 60), 1.0f);
  EXPECT_EQ(at(5, 60, 80), 0.5f);
  EXPECT_EQ(at(5, 59, 80), 0.0f) << "outside of the active box";
}

TEST(LoadDensity, ARootTileAndFarVoxelsCostWhatIsThere) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  auto root = openvdb::FloatGrid::create();
  root->setName("density");
  root->tree().addTile(3, {-4096, 0, 4096}, 0.75f, true);
  write(folder / "root.vdb", {root});
  const ScalarField tile = load_scalar(folder / "root.vdb", {});
  EXPECT_EQ(tile.summary.active_voxels, uint64_t{1} << 36);
  EXPECT_LT(tile.bricks.bytes(), 4e6);
  EXPECT_EQ(tile.bricks.voxel(ivec3(-4096, 4095, 8191) - tile.bricks.origin()), 0.75f);
  EXPECT_EQ(tile.bricks.voxel(ivec3(-4097, 4095, 8191) - tile.bricks.origin()), 0.0f);
  auto apart = openvdb::FloatGrid::create(0.0f);
  apart->setName("density");
  apart->tree().setValue({0, 0, 0}, 1.0f);
  apart->tree().setValue({1000000, 1000000, 1000000}, 2.0f);
  write(folder / "apart.vdb", {apart});
  const ScalarField far_voxels = load_scalar(folder / "apart.vdb", {});
  EXPECT_LT(far_voxels.bricks.bytes(), 4e6);
  EXPECT_EQ(far_voxels.bricks.voxel(ivec3(1000000) - far_voxels.bricks.origin()), 2.0f);
}

TEST(LoadDensity, MasksCountOneAndWholeNumbersThemselves) {
  const test::TemporaryFolder folder;
  openvdb::initialize();
  auto truth = openvdb::BoolGrid::create();
  auto mask = openvdb::MaskGrid::create();
  for (int i = 0; i < 5; ++i) {
    truth->tree().setValue(openvdb::Coord(i, 0, 0), i > 0);
    mask->tree().setValueOn(openvdb::Coord(i, 0, 0));
  }
  truth->fill(openvdb::CoordBBox({8, 0, 0}, {15, 7, 7}), true);
  truth->setName("density"), mask->setName("density");
  write(folder / "bool.vdb", {truth}), write(folder / "mask.vdb", {mask});
  write(folder / "int.vdb", {small_grid<openvdb::Int32Grid>("density")});
  write(folder / "long.vdb", {small_grid<openvdb::Int64Grid>("density")});
  for (const char* name : {"bool.vdb", "mask.vdb", "int.vdb", "long.vdb"}) {
    const ScalarField field = load_scalar(folder / name, {});
    const auto at = [&](int x) { return field.bricks.voxel(ivec3(x, 0, 0) - field.bricks.origin()); };
    const bool numbers = std::strchr("il", *name) != nullptr;
    EXPECT_EQ(at(0), std::string(name) == "bool.vdb" ? 0.0f : 1.0f) << name;
    for (int i = 1; i < 5; ++i) EXPECT_EQ(at(i), numbers ? static_cast<float>(i + 1) : 1.0f) << name;
    EXPECT_EQ(at(12), std::string(name) == "bool.vdb" ? 1.0f : 0.0f) << name;
    ASSERT_FALSE(field.notes.empty()) << name;
    EXPECT_TRUE(holds(field.notes[0], numbers ? "its whole numbers are the density" : "the density is 1 in its voxels"))
        << field.notes[0];
  }
}

/// A value at some voxels of a grid.
template <class Grid, class Value>
typename Grid::Ptr grid_of(const std::string& name, const Value& value) {
  openvdb::initialize();
  auto grid = Grid::create();
  grid->setName(name);
  for (int i = 0; i < 5; ++i) grid->tree().setValue(openvdb::Coord(i, 1, -1), value(i));
  return grid;
}

TEST(LoadColour, VectorsOfFloatsAndDoublesAndThreeGridsAreTheSame) {
  const test::TemporaryFolder folder;
  const auto part = [](int c) { return [c](int i) { return 0.1f * static_cast<float>(i + c); }; };
  write(folder / "s.vdb",
        {grid_of<openvdb::Vec3SGrid>("Cd", [&](int i) { return openvdb::Vec3s(part(0)(i), part(1)(i), part(2)(i)); })});
  write(folder / "d.vdb",
        {grid_of<openvdb::Vec3DGrid>("Cd", [&](int i) { return openvdb::Vec3d(part(0)(i), part(1)(i), part(2)(i)); })});
  std::vector<std::string> files = {"s.vdb", "d.vdb"};
  for (const char* names :
       {"Cd.r Cd.g Cd.b", "Cd_r Cd_g Cd_b", "Cd.x Cd.y Cd.z", "CdR CdG CdB", "color_r color_g color_b"}) {
    std::istringstream words(names);
    std::string name;
    openvdb::GridPtrVec grids;
    for (int c = 0; words >> name; ++c) grids.push_back(grid_of<openvdb::FloatGrid>(name, part(c)));
    write(folder / (std::to_string(files.size()) + ".vdb"), grids);
    files.push_back(std::to_string(files.size()) + ".vdb");
  }
  for (const std::string& file : files) {
    const VectorField field = load_colour(folder / file, "");
    EXPECT_TRUE(field.notes.empty()) << file;
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < 5; ++i) {
        const BrickGrid& bricks = field.bricks.parts[static_cast<size_t>(c)];
        EXPECT_EQ(bricks.voxel(ivec3(i, 1, -1) - bricks.origin()), part(c)(i)) << file;
      }
  }
}

TEST(LoadColour, ThreeGridsMayCoverDifferentVoxels) {
  const test::TemporaryFolder folder;
  auto red = grid_of<openvdb::FloatGrid>("Cd.r", [](int) { return 0.5f; });
  auto green = grid_of<openvdb::FloatGrid>("Cd.g", [](int) { return 0.25f; });
  green->tree().setValue({100, 50, 20}, 0.75f);
  write(folder / "c.vdb", {red, green, grid_of<openvdb::DoubleGrid>("Cd.b", [](int) { return 0.125; })});
  const VectorField field = load_colour(folder / "c.vdb", "Cd");
  const auto at = [&](size_t c, const ivec3& v) {
    return field.bricks.parts[c].voxel(v - field.bricks.parts[c].origin());
  };
  EXPECT_EQ(field.bricks.parts[0].origin(), field.bricks.parts[1].origin());
  EXPECT_EQ(at(0, {2, 1, -1}), 0.5f);
  EXPECT_EQ(at(1, {100, 50, 20}), 0.75f);
  EXPECT_EQ(at(0, {100, 50, 20}), 0.0f);
  EXPECT_EQ(at(2, {2, 1, -1}), 0.125f);
}

TEST(LoadColour, WhatIsNotFiniteIsCountedAndOtherTypesAreRefused) {
  const test::TemporaryFolder folder;
  write(folder / "n.vdb", {grid_of<openvdb::Vec3SGrid>("Cd", [](int i) {
          return openvdb::Vec3s(i ? 1.0f : std::numeric_limits<float>::quiet_NaN(), 1,
                                i > 1 ? 1.0f : std::numeric_limits<float>::infinity());
        })});
  const VectorField field = load_colour(folder / "n.vdb", "");
  ASSERT_EQ(field.notes.size(), 2u);
  EXPECT_EQ(field.notes[0], "grid 'Cd': 1 values that are not finite became 0 (r)");
  EXPECT_EQ(field.notes[1], "grid 'Cd': 2 values that are not finite became 0 (b)");
  EXPECT_EQ(field.bricks.parts[2].voxel(ivec3(1, 1, -1) - field.bricks.parts[2].origin()), 0.0f);
  write(folder / "i.vdb", {grid_of<openvdb::Vec3IGrid>("Cd", [](int i) { return openvdb::Vec3i(i, i, i); })});
  try {
    load_colour(folder / "i.vdb", "");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_TRUE(holds(error.what(), "grid 'Cd' is of type vec3i; expected vec3s or vec3d")) << error.what();
    EXPECT_TRUE(holds(error.what(), "The file has: Cd (vec3i)")) << error.what();
  }
}

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

std::string notes_of(const ScalarField& field) {
  return fmt::format("{}", fmt::join(field.notes, "\n"));
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
  write(folder / "e.vdb", {grid});
  const ScalarField field = load_scalar(folder / "e.vdb", {});
  EXPECT_TRUE(field.bricks.empty());
  ASSERT_EQ(field.notes.size(), 1u);
  EXPECT_TRUE(holds(field.notes[0], "empty: the field is absent"));
}

TEST(LoadDensity, LevelSetsPointsAndFrustumsAreRefusedWithAWayOut) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  auto sphere = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(5.0f, openvdb::Vec3f(0), 0.5f);
  sphere->setName("density");
  write(folder / "ls.vdb", {sphere});
  EXPECT_TRUE(holds(load_error(folder / "ls.vdb"), "is a level set") &&
              holds(load_error(folder / "ls.vdb"), "convert_level_set = true"));
  const ScalarField fog = load_scalar(folder / "ls.vdb", {.convert_level_set = true});
  EXPECT_EQ(fog.bricks.voxel(ivec3(0, 0, 0) - fog.bricks.origin()), 1.0f);
  EXPECT_EQ(fog.bricks.voxel(ivec3(14, 0, 0) - fog.bricks.origin()), 0.0f);

  std::vector<openvdb::Vec3R> positions = {{0, 0, 0}, {1, 1, 1}};
  auto points = openvdb::points::createPointDataGrid<openvdb::points::NullCodec, openvdb::points::PointDataGrid>(
      positions, *openvdb::math::Transform::createLinearTransform(1.0));
  points->setName("density");
  write(folder / "p.vdb", {points});
  EXPECT_TRUE(holds(load_error(folder / "p.vdb"), "holds points")) << load_error(folder / "p.vdb");

  auto frustum = small_grid<openvdb::FloatGrid>("density");
  frustum->setTransform(openvdb::math::Transform::createFrustumTransform(
      openvdb::BBoxd(openvdb::Vec3d(0), openvdb::Vec3d(10)), 0.5, 10.0, 1.0));
  write(folder / "fr.vdb", {frustum});
  EXPECT_TRUE(holds(load_error(folder / "fr.vdb"), "frustum or other non-affine transform"))
      << load_error(folder / "fr.vdb");
}

TEST(LoadDensity, BrokenFilesSayWhatIsWrong) {
  const test::TemporaryFolder folder;
  EXPECT_TRUE(holds(load_error(folder / "missing.vdb"), "no such file"));
  test::write_file(folder / "text.vdb", "hello");
  EXPECT_TRUE(holds(load_error(folder / "text.vdb"), "not an OpenVDB file"));
  test::write_file(folder / "empty.vdb", "");
  EXPECT_TRUE(holds(load_error(folder / "empty.vdb"), "not an OpenVDB file"));
  const std::string bytes = test::read_file(test::source("data/volumes/cloud.vdb"));
  for (const size_t size : {size_t{5}, size_t{40}, size_t{150}, bytes.size() / 3, bytes.size() / 2, bytes.size() - 1}) {
    test::write_file(folder / "cut.vdb", bytes.substr(0, size));
    EXPECT_TRUE(holds(load_error(folder / "cut.vdb"), "truncated")) << size << ": " << load_error(folder / "cut.vdb");
  }
}

TEST(LoadDensity, DamagedBytesNeverCrash) {
  const test::TemporaryFolder folder;
  write(folder / "a.vdb", {small_grid<openvdb::FloatGrid>("density")});
  const std::string bytes = test::read_file(folder / "a.vdb");
  int refused = 0;
  Rng rng(9);
  for (int i = 0; i < 50; ++i) {
    std::string damaged = bytes;
    damaged[static_cast<size_t>(rng.uniform() * static_cast<double>(bytes.size()))] ^=
        static_cast<char>(1 + rng.bits() % 255);
    test::write_file(folder / "d.vdb", damaged);
    refused += !load_error(folder / "d.vdb").empty();
  }
  EXPECT_GT(refused, 1);
}

/// Names the program that reads files, in its scope.
class ReaderIs {
 public:
  explicit ReaderIs(const std::string& how) { setenv("BRUME_VDB_READER", how.c_str(), 1); }
  ~ReaderIs() { unsetenv("BRUME_VDB_READER"); }
  ReaderIs(const ReaderIs&) = delete;
  ReaderIs& operator=(const ReaderIs&) = delete;
};

TEST(VdbReader, FilesMadeToCrashOpenVdbAreRefusedInWords) {
  for (const char* name : {"alloc.vdb", "blosc_overrun.vdb", "huge_metadata.vdb"}) {
    const fs::path path = test::source(std::string("tests/data/hostile/") + name);
    EXPECT_TRUE(holds(load_error(path), std::string(name) + ": damaged")) << load_error(path);
    EXPECT_THROW(read_vdb_info(path), InputError);
    EXPECT_THROW(load_colour(path, ""), InputError);
    const test::TemporaryFolder folder;
    EXPECT_THROW(write_halved_density(path, "", folder / "half.vdb"), InputError);
    EXPECT_TRUE(fs::is_empty(folder.path()));
  }
}

TEST(VdbReader, AVolumeBeyondMemoryIsRefusedWithTheNumbersBeforeItIsRead) {
  std::string bytes = test::read_file(test::source("data/volumes/cloud.vdb"));
  const size_t type = bytes.find("int64", bytes.find("file_mem_bytes"));
  ASSERT_NE(type, std::string::npos);
  const int64_t claimed = int64_t{1} << 50;
  std::memcpy(bytes.data() + type + 5 + sizeof(uint32_t), &claimed, sizeof claimed);  // behind the type and the size
  const test::TemporaryFolder folder;
  test::write_file(folder / "huge.vdb", bytes);
  const std::string error = load_error(folder / "huge.vdb");
  EXPECT_TRUE(holds(error, "grid 'density' needs 2889296.7 GB of memory to be read")) << error;
  EXPECT_TRUE(holds(error, "this machine has")) << error;
}

TEST(VdbReader, WhateverBecomesOfItTheMessageSaysSo) {
  const fs::path cloud = test::source("data/volumes/cloud.vdb");
  const test::TemporaryFolder folder;
  const auto error_with = [&](const std::string& script) {
    test::write_file(folder / "reader", "#!/bin/sh\n" + script + "\n");
    fs::permissions(folder / "reader", fs::perms::owner_all);
    const ReaderIs reader((folder / "reader").string());
    return load_error(cloud);
  };
  // What the first version of the reader wrote where it began.
  EXPECT_TRUE(holds(error_with("printf '\\001' | dd of=/dev/fd/3 bs=1 seek=40 conv=notrunc 2>/dev/null"),
                    "reader: belongs to another version of brume (it speaks 1, expected 4)"));
  EXPECT_TRUE(holds(error_with("kill -SEGV $$"), "cloud.vdb: damaged: OpenVDB crashed on it (Segmentation fault)"));
  EXPECT_TRUE(holds(error_with("kill -XCPU $$"), "OpenVDB took far longer over it than its size allows"));
  EXPECT_TRUE(holds(error_with("kill -KILL $$"), "out of memory perhaps"));
  EXPECT_TRUE(holds(error_with("kill -KILL $$"), "memory: ")) << "and is not damage";
  EXPECT_TRUE(holds(error_with("exit 12"), "memory: ")) << "without the memory to say more";
  EXPECT_TRUE(holds(error_with("exit 3"), "OpenVDB ended on it with status 3"));
  EXPECT_TRUE(holds(error_with("exit 0"), "damaged: its reader left no answer"));
  EXPECT_TRUE(holds(error_with("printf 'overwritten, all of what was asked, the header too' >&3"), "damaged"));
  const ReaderIs nowhere("/no/such/reader");
  EXPECT_TRUE(holds(load_error(cloud), "/no/such/reader: cannot be started: No such file"));
}

// From too little memory to load its libraries to enough of it: a whole file is read, or memory is named.
TEST(VdbReader, TooLittleMemoryIsNotDamage) {
  if (!test::can_limit_memory()) GTEST_SKIP() << "memory cannot be limited here";
  const test::TemporaryFolder folder;
  const fs::path reader = fs::path(BRUME_PROGRAM).parent_path() / "brume-vdb-reader";
  for (int megabytes = 40; megabytes <= 1280; megabytes += megabytes / 8) {
    test::write_file(folder / "reader",
                     fmt::format("#!/bin/sh\nulimit -v {}000\nexec {}\n", megabytes, reader.string()));
    fs::permissions(folder / "reader", fs::perms::owner_all);
    const ReaderIs limited((folder / "reader").string());
    const std::string error = load_error(test::source("data/volumes/cloud.vdb"));
    EXPECT_TRUE(error.empty() || holds(error, "memory")) << megabytes << " MB: " << error;
    EXPECT_FALSE(holds(error, ": damaged")) << megabytes << " MB: " << error;
  }
}

TEST(VdbReader, EndsWhenTheTaskIsCancelled) {
  const std::atomic<bool> cancel{true};
  EXPECT_THROW(load_scalar(test::source("data/volumes/cloud.vdb"), {}, {1, {}, &cancel}), Interrupted);
}

TEST(WriteDensity, AFullDiskIsAnErrorAndLeavesNothing) {
  const test::TemporaryFolder folder;
  const ProceduralVolume v = procedural_cloud(40, 1);
  const test::FullDisk full(folder / "cloud.vdb"), full_too(folder / "half.vdb");
  EXPECT_THROW(write_density(folder / "cloud.vdb", v.box, v.voxel_size, v.density, false, {}), InputError);
  EXPECT_THROW(write_halved_density(test::source("data/volumes/cloud.vdb"), "", folder / "half.vdb"), InputError);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

// A 300^3 cloud needs at most twice its active voxels as float.
TEST(LoadDensity, ACloudNeedsAtMostTwiceItsActiveVoxels) {
  const auto path = test::shared("volumes/cloud.vdb");
  if (path.empty()) GTEST_SKIP() << "no volumes beside the project";
  const ScalarField field = load_scalar(path, {});
  EXPECT_EQ(field.summary.active_voxels, 5276200u);
  EXPECT_LE(field.bricks.bytes(), 2 * 4 * field.summary.active_voxels);
}

TEST(LoadDensity, AProceduralCloudNeedsAtMostTwiceItsActiveVoxelsToo) {
  const test::TemporaryFolder folder;
  const ProceduralVolume v = procedural_cloud(300, 1);
  write_density(folder / "cloud.vdb", v.box, v.voxel_size, v.density, false, {});
  const ScalarField field = load_scalar(folder / "cloud.vdb", {});
  EXPECT_GT(field.summary.active_voxels, 1000000u);
  EXPECT_LE(field.bricks.bytes(), 2 * 4 * field.summary.active_voxels);
}

TEST(LoadDensity, EverySharedVolumeLoadsOrIsRefusedWithTheRightWords) {
  const auto folder = test::shared("volumes");
  if (folder.empty()) GTEST_SKIP() << "no volumes beside the project";
  int loaded = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".vdb") continue;
    const std::string error = load_error(entry.path());
    if (entry.path().filename() == "types_nodensity.vdb") {
      EXPECT_TRUE(holds(error, "no grid 'density'") && holds(error, "Cd (vec3s)") && holds(error, "mask (bool)"))
          << error;
    } else {
      EXPECT_EQ(error, "") << entry.path();
      const ScalarField field = load_scalar(entry.path(), {});
      EXPECT_FALSE(field.bricks.empty()) << entry.path();
      EXPECT_TRUE(field.summary.name.starts_with("density"));
      ++loaded;
    }
  }
  EXPECT_GE(loaded, 23);
  EXPECT_EQ(load_scalar(folder / "smoke_plume.vdb", {}).bricks.maximum(), 1.951171875f);
  EXPECT_TRUE(load_scalar(folder / "smoke_plume.vdb", {"flame_noise"}).bricks.empty());
  const ScalarField decoy = load_scalar(folder / "fire.vdb", {"shadow"});
  EXPECT_TRUE(decoy.bricks.empty()) << "-1 everywhere is no density";
}

TEST(HalvedDensity, KeepsMassAndPlace) {
  const auto path = test::shared("volumes/cloud.vdb");
  if (path.empty()) GTEST_SKIP() << "no volumes beside the project";
  const auto moments = [](const fs::path& p) {
    const ScalarField f = load_scalar(p, {});
    const Medium m(f.bricks, f.world_from_index, 1, dvec3(1), 0);
    double mass = 0;
    dvec3 centre(0);
    ivec3 v;
    const ivec3 end(f.bricks.support_hi());
    for (v.x = 0; v.x <= end.x; ++v.x)
      for (v.y = 0; v.y <= end.y; ++v.y)
        for (v.z = 0; v.z <= end.z; ++v.z) {
          const double d = f.bricks.voxel(v);
          mass += d;
          centre += d * m.to_world(dvec3(v));
        }
    return std::pair(mass * m.voxel_volume(), centre / mass);
  };
  const auto [mass, centre] = moments(path);
  const auto [half_mass, half_centre] = moments(test::source("data/volumes/cloud.vdb"));
  EXPECT_NEAR(half_mass / mass, 1.0, 1e-3);
  EXPECT_LT(glm::distance(half_centre, centre), 1e-4);
}

TEST(WriteDensity, ProceduralVolumesDependOnTheirSeedAlone) {
  const test::TemporaryFolder folder;
  for (const bool cloud : {true, false}) {
    const auto make = [&](uint64_t seed, int threads, const char* name) {
      const ProceduralVolume v = cloud ? procedural_cloud(40, seed) : procedural_smoke(40, seed);
      write_density(folder / name, v.box, v.voxel_size, v.density, false, {threads, {}, nullptr});
      return load_scalar(folder / name, {});
    };
    const ScalarField a = make(3, 1, "a.vdb"), b = make(3, 7, "b.vdb"), c = make(4, 2, "c.vdb");
    EXPECT_GT(a.summary.active_voxels, 500u);
    EXPECT_EQ(a.summary.active_voxels, b.summary.active_voxels);
    EXPECT_EQ(a.summary.maximum, b.summary.maximum);
    EXPECT_NE(a.summary.active_voxels, c.summary.active_voxels);
  }
}

}  // namespace
}  // namespace brume
