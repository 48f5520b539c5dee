#include <fmt/format.h>
#include <openvdb/tools/Prune.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include "base/error.h"
#include "volume/vdb/reading.h"

// Files that are written: of leaves that a request brings, and of a grid at half its resolution.

namespace brume::vdb {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;
using openvdb::CoordBBox;

/// Writes what OpenVDB's own class for files does, through a stream whose failures are noticed.
class GridWriter : openvdb::io::Archive {
 public:
  GridWriter() { setCompression(openvdb::io::COMPRESS_ACTIVE_MASK | openvdb::io::COMPRESS_BLOSC); }
  void write_to(std::ostream& stream, const openvdb::FloatGrid::Ptr& grid) const {
    openvdb::MetaMap metadata;
    metadata.insertMeta("creator", openvdb::StringMetadata("brume"));
    write(stream, openvdb::GridCPtrVec{grid}, /*seekable=*/true, metadata);
  }
};

/// @param path  the name that errors tell   @param part  where to write
void write_grid(const fs::path& path, const fs::path& part, const openvdb::FloatGrid::Ptr& grid) {
  try {
    std::ofstream stream(part, std::ios::binary);
    stream.exceptions(std::ios::failbit | std::ios::badbit);
    GridWriter().write_to(stream, grid);
    stream.close();
  } catch (const std::ios::failure&) {
    fail(path, fmt::format("cannot be written: {}", std::strerror(errno)));
  } catch (const std::bad_alloc&) {
    throw OutOfMemory(path.string(), "write it");
  } catch (const std::exception& error) {
    fail(path, fmt::format("cannot be written: {}", error.what()));
  }
}

}  // namespace

uint64_t halve(Reading& reading, const fs::path& path, const std::string& name, const fs::path& output,
               const fs::path& part) {
  const auto file = open(reading, path);
  std::vector<std::string> notes;
  const auto stored = file->readGrid(choose_grid(*file, path, name, GridUse::kDensity, notes));
  reading.limits.reset();
  const GridSummary s = summarize(*stored, reading.task);
  check_scalar_field(path, s, *file);
  if (s.grid_class == "level set" || s.nan_count || s.infinite_count || s.negative_count)
    fail(
        path,
        fmt::format(
            "grid '{}' is a level set or holds NaN, infinite or negative voxels; expected a clean fog volume to average",
            s.name));
  const auto source = openvdb::gridPtrCast<openvdb::FloatGrid>(with_equal_voxels(path, stored, notes, reading.task));
  if (!source) fail(path, fmt::format("grid '{}' is of type double; halving takes float grids", s.name));
  auto grid = openvdb::FloatGrid::create(0.0f);
  grid->setName("density");
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setSaveFloatAsHalf(true);
  // The new voxel sits between the two it replaces on each axis: index 2 i + 1/2 of the old lattice.
  auto transform = source->transform().copy();
  transform->preTranslate(openvdb::Vec3d(0.5));
  transform->preScale(2.0);
  grid->setTransform(transform);
  auto out = grid->getAccessor();
  auto in = source->getConstAccessor();
  for (auto it = source->cbeginValueOn(); it; ++it) {
    const CoordBBox box = it.getBoundingBox();
    for (auto c = CoordBBox(box.min() >> 1, box.max() >> 1).begin(); c; ++c) {
      if (out.isValueOn(*c)) continue;
      float sum = 0;
      for (int k = 0; k < 8; ++k) sum += in.getValue(((*c) << 1) + Coord(k & 1, k >> 1 & 1, k >> 2));
      out.setValue(*c, sum / 8.0f);
    }
  }
  for (auto it = grid->beginValueOn(); it; ++it)
    if (!(*it > 0)) it.setValueOff();
  openvdb::tools::pruneInactive(grid->tree());
  write_grid(output, part, grid);
  return grid->activeVoxelCount();
}

uint64_t write_leaves(const VdbRequest& request, MemoryFile& memory) {
  constexpr size_t kAtOnce = size_t{1} << 26;  // values
  initialize();
  auto grid = openvdb::FloatGrid::create(0.0f);
  grid->setName("density");
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setSaveFloatAsHalf(request.half);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(request.scale));
  const float *values = request.leaf_values.data(), *kept = values;
  for (const VoxelPosition& corner : request.leaf_corners) {
    auto* const leaf = grid->tree().touchLeaf({corner[0], corner[1], corner[2]});
    for (openvdb::Index i = 0; i < openvdb::FloatTree::LeafNodeType::SIZE; ++i, ++values)
      if (*values > 0) leaf->setValueOn(i, *values);
    if (values - kept < static_cast<std::ptrdiff_t>(kAtOnce)) continue;
    const size_t first = static_cast<size_t>(kept - request.leaf_values.data());
    memory.discard(request.leaf_values.file_offset() + first * sizeof(float), kAtOnce * sizeof(float));
    kept = values;
  }
  write_grid(request.path, request.part, grid);
  return grid->activeVoxelCount();
}

}  // namespace brume::vdb
