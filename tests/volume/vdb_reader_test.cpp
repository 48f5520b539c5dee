// Files that are refused, and a reader that fails: what is said.

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <openvdb/points/PointConversion.h>
#include <openvdb/tools/LevelSetSphere.h>

#include <atomic>
#include <cstdlib>

#include "tests/support/vdb_files.h"
#include "tests/support/volumes.h"
#include "volume/procedural.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

using test::holds;
using test::load_error;
using test::small_grid;
using test::write;

TEST(LoadDensity, LevelSetsAndPointsAreRefusedWithAWayOut) {
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
}

TEST(LoadTemperature, IsRefusedWhereItsFlamesAre) {
  openvdb::initialize();
  const test::TemporaryFolder folder;
  const fs::path path = folder / "fire.vdb";
  const auto temperature = small_grid<openvdb::FloatGrid>("temperature");
  const ScalarOptions burning{.use = GridUse::kTemperature, .needs_flames = true};
  auto surface = openvdb::tools::createLevelSetSphere<openvdb::FloatGrid>(5.0f, openvdb::Vec3f(0), 0.5f);
  surface->setName("flame");
  write(path, {temperature, surface});
  EXPECT_TRUE(holds(load_error(path, burning), "grid 'flame' is a level set"));
  EXPECT_EQ(load_error(path, burning), load_error(path, {.use = GridUse::kFlame}));
  EXPECT_EQ(load_error(path, {.use = GridUse::kTemperature}), "");
  write(path, {temperature, small_grid<openvdb::Vec3SGrid>("flame")});
  EXPECT_EQ(load_error(path, burning), "") << "no grid of numbers says nothing of flames";
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
                    "reader: belongs to another version of brume (it speaks 1, expected 5)"));
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

}  // namespace
}  // namespace brume
