// Values of .vdb files: types, tiles, what is no density, colours, what is written.

#include "volume/vdb_io.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <limits>
#include <sstream>

#include "tests/support/vdb_files.h"
#include "tests/support/volumes.h"
#include "volume/medium.h"
#include "volume/procedural.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

using test::holds;
using test::load_error;
using test::small_grid;
using test::write;

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

TEST(LoadTemperature, IsThereWhereFlamesAre) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  const fs::path path = folder / "fire.vdb";
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const auto load = [&](std::vector<float> flames, Paging paging) {
    const auto flame = openvdb::FloatGrid::create();
    flame->setName("flame");
    for (int x = 0; const float value : flames) flame->tree().setValue({x++, 0, 0}, value);
    write(path, {small_grid<openvdb::FloatGrid>("temperature"), flame});
    return load_scalar(path, {.use = GridUse::kTemperature, .needs_flames = true, .paging = paging});
  };
  for (const Paging paging : {Paging::kNever, Paging::kAlways}) {
    using Values = std::vector<float>;
    for (const Values& none : {Values{}, {0}, {-1, 0}, {-kInfinity, -2}, {kInfinity, 0}, {1e-40f}}) {
      const ScalarField field = load(none, paging);
      EXPECT_TRUE(field.bricks.empty());
      EXPECT_EQ(test::notes_of(field),
                fmt::format("{}: grid 'flame' holds no flames: its temperature is what lifts the smoke, and nothing "
                            "burns; temperature_grid = NAME makes it glow all the same",
                            path.string()));
    }
    for (const Values& some : {Values{0.5f}, {-kInfinity, 0, 1e-3f}, {kInfinity, 1}}) {
      const ScalarField field = load(some, paging);
      EXPECT_EQ(field.summary.name, "temperature");
      EXPECT_EQ(field.bricks.voxel(ivec3(4, 0, 0) - field.bricks.origin()), 5.0f);
      EXPECT_FALSE(holds(test::notes_of(field), "flame"));
    }
  }
  write(path, {small_grid<openvdb::FloatGrid>("temperature")});
  EXPECT_FALSE(load_scalar(path, {.use = GridUse::kTemperature, .needs_flames = true}).bricks.empty())
      << "a file without such a grid";
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
