// NanoVDB files: the same bits as the .vdb that they were made from, whatever they are compressed with; damaged and
// foreign ones end with a message.

#define NANOVDB_USE_BLOSC
#define NANOVDB_USE_ZIP
#include <gtest/gtest.h>
#include <nanovdb/util/IO.h>
#include <nanovdb/util/OpenToNanoVDB.h>

#include <fstream>

#include "base/error.h"
#include "tests/support/files.h"
#include "tests/support/vdb_grids.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using nanovdb::io::Codec;

openvdb::GridPtrVec stored_grids() {
  openvdb::initialize();
  openvdb::io::File file(test::source("data/volumes/fire.vdb").string());
  file.open();
  openvdb::GridPtrVec grids;
  for (const char* name : {"density", "flame", "velocity"}) grids.push_back(file.readGrid(name));
  return grids;
}

void write_nano(const fs::path& path, const openvdb::GridPtrVec& grids, Codec codec) {
  std::vector<nanovdb::GridHandle<nanovdb::HostBuffer>> handles;
  for (const auto& grid : grids)
    handles.push_back(nanovdb::openToNanoVDB(grid, nanovdb::StatsMode::Default, nanovdb::ChecksumMode::Full));
  nanovdb::io::writeGrids(path.string(), handles, codec);
}

std::string error_of(const fs::path& path) {
  try {
    load_scalar(path, {});
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(NanoVdb, IsTheVdbThatItCameFrom) {
  const test::TemporaryFolder folder;
  const openvdb::GridPtrVec grids = stored_grids();
  openvdb::io::File((folder / "a.vdb").string()).write(grids);
  const auto voxels = [](const ScalarField& field) {
    std::vector<float> all;
    field.bricks.each_cell([&](const ivec3& c) {
      const float* const values = field.bricks.brick(field.bricks.cell(c));
      all.insert(all.end(), values, values + BrickGrid::kBrick);
    });
    return all;
  };
  for (const Codec codec : {Codec::NONE, Codec::ZIP, Codec::BLOSC}) {
    write_nano(folder / "a.nvdb", grids, codec);
    for (const char* name : {"density", "flame"}) {
      const ScalarField vdb = load_scalar(folder / "a.vdb", {name}), nano = load_scalar(folder / "a.nvdb", {name});
      EXPECT_EQ(vdb.world_from_index, nano.world_from_index) << name;
      EXPECT_EQ(voxels(vdb), voxels(nano)) << name << ", codec " << static_cast<int>(codec);
    }
    std::vector<std::string> notes;
    const ScalarField density = load_scalar(folder / "a.nvdb", {});
    const Displacement from_vdb = load_displacement(folder / "a.vdb", "", density, {0.001, 0, 1}, notes),
                       from_nano = load_displacement(folder / "a.nvdb", "", density, {0.001, 0, 1}, notes);
    EXPECT_EQ(from_vdb.field.bytes(), from_nano.field.bytes());
  }
  EXPECT_EQ(read_vdb_contents(folder / "a.nvdb", {}).grids.size(), 3u);
}

TEST(NanoVdb, WhatNoMachineCanHoldIsToldBeforeItIsRead) {
  const test::TemporaryFolder folder;
  write_nano(folder / "a.nvdb", {stored_grids()[0]}, Codec::ZIP);
  std::string bytes = test::read_file(folder / "a.nvdb");
  const uint64_t size = uint64_t{1} << 50;
  // After the file's header the first member of the first grid's metadata.
  bytes.replace(sizeof(nanovdb::io::Header), sizeof size, reinterpret_cast<const char*>(&size), sizeof size);
  std::ofstream(folder / "b.nvdb", std::ios::binary) << bytes;
  const std::string error = error_of(folder / "b.nvdb");
  EXPECT_NE(error.find("need 3377699.7 GB of memory to be read; this machine has"), std::string::npos) << error;
  EXPECT_NE(error.find("nanovdb_convert b.nvdb FILE.vdb"), std::string::npos) << error;
}

TEST(NanoVdb, DamageAndOtherVersionsAreToldApart) {
  const test::TemporaryFolder folder;
  const openvdb::GridPtrVec grids = stored_grids();
  write_nano(folder / "a.nvdb", {grids[0]}, Codec::NONE);
  const std::string whole = test::read_file(folder / "a.nvdb");
  const auto with = [&](std::string bytes) {
    std::ofstream(folder / "b.nvdb", std::ios::binary) << bytes;
    return error_of(folder / "b.nvdb");
  };
  EXPECT_EQ(with(whole), "");
  std::string other = whole;
  other[11] = 0x7f;  // in the header's version
  EXPECT_NE(with(other).find("is a NanoVDB file of version"), std::string::npos) << with(other);
  other = whole;
  other[whole.size() - 4000] = static_cast<char>(other[whole.size() - 4000] ^ 0x40);
  EXPECT_NE(with(other).find("damaged: the checksum of grid 'density'"), std::string::npos) << with(other);
  for (const double share : {0.001, 0.3, 0.999})
    EXPECT_NE(with(whole.substr(0, static_cast<size_t>(share * static_cast<double>(whole.size())))), "") << share;
}

}  // namespace
}  // namespace brume
