#define NANOVDB_USE_BLOSC
#define NANOVDB_USE_TBB
#define NANOVDB_USE_ZIP
#include <fmt/format.h>
#include <nanovdb/util/GridChecksum.h>
#include <nanovdb/util/IO.h>
#include <nanovdb/util/NanoToOpenVDB.h>
#include <openvdb/io/Stream.h>

#include <algorithm>
#include <fstream>

#include "volume/vdb/reading.h"

namespace brume::vdb {
namespace {

namespace fs = std::filesystem;

/// @throws InputError: of another version than the library's, which is another format
void check_version(const fs::path& path) {
  nanovdb::io::Header header;
  std::ifstream stream(path, std::ios::binary);
  stream.exceptions(std::ios::failbit | std::ios::badbit);
  stream.read(reinterpret_cast<char*>(&header), sizeof(header));
  if (header.magic != NANOVDB_MAGIC_NUMBER) {
    const std::string found(reinterpret_cast<const char*>(&header.magic), sizeof(header.magic));
    fail(path, fmt::format("is a NanoVDB file that begins with '{}'; expected NanoVDB0: convert it to .vdb", found));
  }
  const uint32_t found = header.version.getMajor(), own = NANOVDB_MAJOR_VERSION_NUMBER;
  if (found != own)
    fail(path, fmt::format("is a NanoVDB file of version {}; expected {}: convert it to .vdb", found, own));
}

/// Refuses a file whose grids this machine cannot hold while they become those of a .vdb: unpacked to floats and
/// written as that file, with one of them as it was.
void check_fits(const fs::path& path, const std::vector<nanovdb::io::GridMetaData>& contents) {
  double unpacked = 0, largest = 0;
  for (const auto& grid : contents) {
    const auto size = static_cast<double>(grid.gridSize);
    unpacked += std::max(size, 512.0 * sizeof(float) * grid.nodeCount[0]);
    largest = std::max(largest, size);
  }
  const double needed = 2 * unpacked + largest;
  if (!(needed > physical_memory())) return;
  fail(
      path,
      fmt::format(
          "its grids need {:.1f} GB of memory to be read; this machine has {:.1f} GB. Expected a .vdb, whose density need not fit into memory: nanovdb_convert {} FILE.vdb",
          needed / 1e9, physical_memory() / 1e9, path.filename().string()));
}

using Handle = nanovdb::GridHandle<nanovdb::HostBuffer>;

/// The grid of a handle; null where its values are of another type.
template <class Value>
openvdb::GridBase::Ptr unpacked(const fs::path& path, const Handle& handle) {
  const auto* const grid = handle.grid<Value>();
  if (!grid) return nullptr;
  if (!nanovdb::validateChecksum(*grid, nanovdb::ChecksumMode::Full))
    fail(path, fmt::format("damaged: the checksum of grid '{}' is not that of its values", grid->gridName()));
  return nanovdb::nanoToOpenVDB(*grid);
}

template <class... Values>
openvdb::GridBase::Ptr first_unpacked(const fs::path& path, const Handle& handle) {
  openvdb::GridBase::Ptr grid;
  ((grid = grid ? grid : unpacked<Values>(path, handle)), ...);
  return grid;
}

}  // namespace

bool is_nano(const fs::path& path) {
  std::array<char, 7> magic{};
  std::ifstream(path, std::ios::binary).read(magic.data(), magic.size());
  return std::string_view(magic.data(), magic.size()) == "NanoVDB";
}

void unpack_nano(const fs::path& path, std::ostream& vdb) {
  check_version(path);
  openvdb::GridPtrVec grids;
  const auto contents = nanovdb::io::readGridMetaData(path.string());
  check_fits(path, contents);
  for (size_t i = 0; i < contents.size(); ++i) {
    const Handle handle = nanovdb::io::readGrid(path.string(), i);
    const auto grid = first_unpacked<float, double, nanovdb::Fp4, nanovdb::Fp8, nanovdb::Fp16, nanovdb::FpN,
                                     nanovdb::Vec3f, nanovdb::Vec3d, int32_t, int64_t>(path, handle);
    if (!grid)
      fail(path, fmt::format("grid '{}' is of type {}; expected numbers or vectors of three", contents[i].gridName,
                             nanovdb::toStr(contents[i].gridType)));
    grids.push_back(grid);
  }
  openvdb::io::Stream out(vdb);
  out.setCompression(openvdb::io::COMPRESS_NONE);
  out.write(grids);
}

}  // namespace brume::vdb
