#include "volume/vdb_io.h"

#include <fmt/format.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/openvdb.h>
#include <openvdb/points/PointDataGrid.h>
#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tools/Prune.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <mutex>

#include "base/error.h"
#include "base/output_file.h"
#include "base/parallel_for.h"
#include "base/text.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;
using openvdb::CoordBBox;

void initialize() {
  static std::once_flag once;
  std::call_once(once, [] { openvdb::initialize(); });
}

/// Reads a file's table of contents, which OpenVDB's own reader does not show: where each grid ends. A truncated file
/// is found here, before the reader runs past its end.
class Contents : openvdb::io::Archive {
 public:
  explicit Contents(const fs::path& path) {
    std::ifstream stream(path, std::ios::binary);
    stream.exceptions(std::ios::failbit | std::ios::badbit);
    readHeader(stream);
    openvdb::io::setCurrentVersion(stream);
    setFormatVersion(stream);
    setLibraryVersion(stream);
    openvdb::MetaMap metadata;
    metadata.readMeta(stream);
    if (!inputHasGridOffsets()) return;
    for (int32_t count = readGridCount(stream); count > 0; --count) {
      openvdb::io::GridDescriptor descriptor;
      descriptor.read(stream);
      end_ = std::max(end_, static_cast<uint64_t>(descriptor.getEndPos()));
      stream.seekg(static_cast<std::streamoff>(descriptor.getEndPos()));
    }
  }
  uint64_t end() const { return end_; }

 private:
  uint64_t end_ = 0;
};

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw InputError(fmt::format("{}: {}", path.string(), what));
}

/// Runs `read`, turning whatever OpenVDB throws over damaged contents into an InputError.
template <class Read>
auto guarded(const fs::path& path, const Read& read) {
  try {
    return read();
  } catch (const InputError&) {
    throw;
  } catch (const Interrupted&) {
    throw;
  } catch (const std::ios::failure&) {
    fail(path, "truncated or damaged: the file ends where its contents go on");
  } catch (const std::exception& exception) {
    fail(path, fmt::format("damaged, or not readable by OpenVDB {}: {}", openvdb::getLibraryVersionString(),
                           exception.what()));
  }
}

/// Opens a file whose table of contents has been checked against its length.
std::unique_ptr<openvdb::io::File> open(const fs::path& path) {
  initialize();
  std::error_code error;
  if (!fs::exists(path, error)) fail(path, "no such file");
  if (fs::is_directory(path, error)) fail(path, "is a folder, expected an OpenVDB file");
  const uint64_t size = fs::file_size(path, error);
  char magic[4] = {};
  std::ifstream(path, std::ios::binary).read(magic, 4);
  if (std::string_view(magic, 4) != std::string_view(" BDV", 4))
    fail(path, "not an OpenVDB file (its first bytes are not the format's)");
  uint64_t end = 0;
  try {
    end = Contents(path).end();
  } catch (const std::ios::failure&) {
    fail(path, fmt::format("truncated: the file ends at byte {}, before the end of its table of contents", size));
  }
  if (end > size) fail(path, fmt::format("truncated: its last grid ends at byte {}, the file at byte {}", end, size));
  auto file = std::make_unique<openvdb::io::File>(path.string());
  file->open(/*delayLoad=*/false);
  return file;
}

std::string class_name(const openvdb::GridBase& grid) {
  switch (grid.getGridClass()) {
    case openvdb::GRID_FOG_VOLUME:
      return "fog volume";
    case openvdb::GRID_LEVEL_SET:
      return "level set";
    case openvdb::GRID_STAGGERED:
      return "staggered";
    default:
      return "unknown";
  }
}

std::map<std::string, std::string> texts(const openvdb::MetaMap& meta) {
  std::map<std::string, std::string> result;
  for (auto it = meta.beginMeta(); it != meta.endMeta(); ++it)
    if (it->second) result[it->first] = it->second->str();
  return result;
}

ivec3 from(const Coord& c) {
  return {c.x(), c.y(), c.z()};
}

/// What the stored values of a scalar tree are like.
struct ValueScan {
  double minimum = std::numeric_limits<double>::infinity(), maximum = -minimum;  // of the finite ones
  uint64_t nans = 0, infinities = 0, negatives = 0;

  void add(double v, uint64_t count = 1) {
    if (std::isnan(v))
      nans += count;
    else if (std::isinf(v))
      infinities += count;
    else {
      negatives += v < 0 ? count : 0;
      minimum = std::min(minimum, v);
      maximum = std::max(maximum, v);
    }
  }
  void merge(const ValueScan& other) {
    minimum = std::min(minimum, other.minimum);
    maximum = std::max(maximum, other.maximum);
    nans += other.nans, infinities += other.infinities, negatives += other.negatives;
  }
};

template <class Grid>
ValueScan scan_active(const Grid& grid) {
  ValueScan scan;
  for (auto it = grid.cbeginValueOn(); it; ++it) scan.add(static_cast<double>(*it), it.getVoxelCount());
  return scan;
}

dmat4 affine_matrix(const openvdb::math::Transform& transform) {
  // OpenVDB multiplies row vectors from the left; so the element (i, j) there is column i, row j here.
  const auto m = transform.baseMap()->getAffineMap()->getMat4();
  dmat4 result;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) result[i][j] = m(i, j);
  return result;
}

GridSummary summarize(const openvdb::GridBase& grid) {
  GridSummary s;
  s.name = grid.getName();
  s.type = grid.valueType();
  s.grid_class = class_name(grid);
  s.half = grid.saveFloatAsHalf();
  s.active_voxels = grid.activeVoxelCount();
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  if (s.active_voxels > 0) s.box = {from(box.min()), from(box.max())};
  const auto size = grid.voxelSize();
  s.voxel_size = {size.x(), size.y(), size.z()};
  s.linear = grid.transform().isLinear();
  if (s.linear) s.world_from_index = affine_matrix(grid.transform());
  s.metadata = texts(grid);
  if (const auto it = s.metadata.find("file_compression"); it != s.metadata.end()) s.compression = it->second;
  if (grid.isType<openvdb::points::PointDataGrid>()) s.grid_class = "points";
  const auto scalar = [&](const auto& typed) {
    s.background = static_cast<double>(typed.background());
    s.active_tiles = typed.tree().activeTileCount();
    if (s.active_voxels == 0) return;
    const ValueScan scan = scan_active(typed);
    s.has_range = scan.maximum >= scan.minimum;
    s.minimum = s.has_range ? scan.minimum : 0.0;
    s.maximum = s.has_range ? scan.maximum : 0.0;
    s.nan_count = scan.nans, s.infinite_count = scan.infinities, s.negative_count = scan.negatives;
  };
  grid.apply<openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid, openvdb::Int64Grid>>(
      scalar);
  return s;
}

std::string list_grids(openvdb::io::File& file) {
  std::vector<std::string> lines;
  const auto grids = file.readAllGridMetadata();
  for (const auto& grid : *grids) lines.push_back(fmt::format("{} ({})", grid->getName(), grid->valueType()));
  return lines.empty() ? "none" : join(lines);
}

std::string choose_grid(openvdb::io::File& file, const fs::path& path, const std::string& wanted,
                        std::vector<std::string>& notes) {
  std::vector<std::string> names, beginning;
  for (auto it = file.beginName(); it != file.endName(); ++it) names.push_back(*it);
  const std::string name = wanted.empty() ? "density" : wanted;
  if (std::find(names.begin(), names.end(), name) != names.end()) return name;
  for (const std::string& n : names) {
    if (openvdb::Name(n).starts_with(name + "[")) {  // several grids of one name
      notes.push_back(fmt::format("several grids are named '{}'; the first is used", name));
      return n;
    }
    if (wanted.empty() && n.starts_with(name)) beginning.push_back(n);
  }
  if (beginning.size() == 1) {
    notes.push_back(fmt::format("no grid 'density'; '{}' is used", beginning[0]));
    return beginning[0];
  }
  fail(path, fmt::format("no grid '{}'; the file has: {}", name, list_grids(file)));
}

/// Appends the 8 x 8 x 8 blocks of a box of voxels.
void append_blocks(const CoordBBox& box, std::vector<ivec3>& blocks) {
  const double count = (box.dim().x() / 8.0 + 1) * (box.dim().y() / 8.0 + 1) * (box.dim().z() / 8.0 + 1);
  if (count + static_cast<double>(blocks.size()) > 1u << 28)
    throw InputError(
        fmt::format("active tiles or background fill {:.1e} blocks of 8^3 voxels; the limit is 2.7e8", count));
  const Coord lo = box.min() & ~7, hi = box.max();
  for (int x = lo.x(); x <= hi.x(); x += 8)
    for (int y = lo.y(); y <= hi.y(); y += 8)
      for (int z = lo.z(); z <= hi.z(); z += 8) blocks.emplace_back(x, y, z);
}

template <class Grid>
std::vector<ivec3> occupied_blocks(const Grid& grid, const CoordBBox& box) {
  std::vector<ivec3> blocks;
  if (grid.background() != 0) {
    append_blocks(box, blocks);
    return blocks;
  }
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) blocks.push_back(from(leaf->origin()));
  auto tile = grid.tree().cbeginValueAll();
  tile.setMaxDepth(Grid::TreeType::ValueAllCIter::LEAF_DEPTH - 1);
  for (; tile; ++tile) {
    if (*tile == 0) continue;
    CoordBBox covered = tile.getBoundingBox();
    covered.intersect(box);
    if (!covered.empty()) append_blocks(covered, blocks);
  }
  return blocks;
}

template <class Grid>
void build_bricks(const Grid& grid, DensityField& field, const Task& task) {
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  const GridSummary& s = field.summary;
  const auto note = [&](uint64_t count, const char* what, const std::string& became) {
    if (count) field.notes.push_back(fmt::format("grid '{}': {} {} voxels became {}", s.name, count, what, became));
  };
  const auto largest = static_cast<float>(std::max(0.0, s.maximum));
  note(s.nan_count, "NaN", "0");
  note(s.negative_count, "negative", "0");
  note(s.infinite_count, "infinite", fmt::format("the largest finite value, {}", largest));
  if (grid.background() != 0)
    field.notes.push_back(fmt::format("grid '{}': background {} counts inside the active bounding box and is 0 outside",
                                      s.name, s.background));
  const auto clean = [largest](double v) {
    if (std::isinf(v)) return v > 0 ? largest : 0.0f;
    return v > 0 ? std::min(static_cast<float>(v), std::numeric_limits<float>::max()) : 0.0f;  // false for NaN too
  };
  const auto sample = [&](const ivec3& lo, float* values) {
    auto accessor = grid.getConstUnsafeAccessor();
    Coord c;
    for (int x = 0; x <= 8; ++x)
      for (int y = 0; y <= 8; ++y)
        for (int z = 0; z <= 8; ++z) {
          c.reset(lo.x + x, lo.y + y, lo.z + z);
          *values++ = box.isInside(c) ? clean(static_cast<double>(accessor.getValue(c))) : 0.0f;
        }
  };
  field.bricks = BrickGrid::build({from(box.min()), from(box.max())}, occupied_blocks(grid, box), sample, task);
  if (field.bricks.empty())
    field.notes.push_back(fmt::format("grid '{}' holds no positive density: the medium is absent", s.name));
}

VdbSummary read_summary(const fs::path& path) {
  const auto file = open(path);
  VdbSummary summary;
  summary.bytes = fs::file_size(path);
  summary.library_version = file->version();
  if (const auto meta = file->getMetadata()) summary.metadata = texts(*meta);
  for (auto it = file->beginName(); it != file->endName(); ++it)
    summary.grids.push_back(summarize(*file->readGrid(*it)));
  return summary;
}

/// Refuses what no density can be read from, with what to do instead.
void check_scalar_field(const fs::path& path, const GridSummary& s, openvdb::io::File& file) {
  if (s.grid_class == "points")
    fail(path,
         fmt::format("grid '{}' holds points; expected a fog volume. Rasterise the points to a density grid first",
                     s.name));
  if (s.type != "float" && s.type != "double")
    fail(path, fmt::format("grid '{}' is of type {}; expected float or double. The file has: {}", s.name, s.type,
                           list_grids(file)));
  if (!s.linear)
    fail(path, fmt::format("grid '{}' has a frustum or other non-affine transform; resample it to a uniform grid first",
                           s.name));
}

DensityField read_density(const fs::path& path, const DensityOptions& options, const Task& task) {
  const auto file = open(path);
  DensityField field;
  openvdb::GridBase::Ptr grid = file->readGrid(choose_grid(*file, path, options.grid, field.notes));
  field.summary = summarize(*grid);
  const GridSummary& s = field.summary;
  check_scalar_field(path, s, *file);
  if (s.grid_class == "level set") {
    if (!options.convert_level_set)
      fail(path, fmt::format(
                     "grid '{}' is a level set; expected a fog volume. Set convert_level_set = true to fill its inside",
                     s.name));
    if (auto typed = openvdb::gridPtrCast<openvdb::FloatGrid>(grid)) openvdb::tools::sdfToFogVolume(*typed);
    if (auto typed = openvdb::gridPtrCast<openvdb::DoubleGrid>(grid)) openvdb::tools::sdfToFogVolume(*typed);
    field.summary = summarize(*grid);
    field.notes.push_back(fmt::format("grid '{}': the level set's inside was converted to fog", s.name));
  }
  field.world_from_index = s.world_from_index;
  if (s.active_voxels == 0) {
    field.notes.push_back(fmt::format("grid '{}' is empty: the medium is absent", s.name));
    return field;
  }
  if (s.grid_class != "fog volume" && 4 * s.negative_count > s.active_voxels)
    field.notes.push_back(fmt::format("grid '{}' is mostly negative; if it is a level set, mark it as one", s.name));
  try {
    if (auto typed = openvdb::gridPtrCast<openvdb::FloatGrid>(grid)) build_bricks(*typed, field, task);
    if (auto typed = openvdb::gridPtrCast<openvdb::DoubleGrid>(grid)) build_bricks(*typed, field, task);
  } catch (const InputError& error) {
    fail(path, fmt::format("grid '{}': {}", s.name, error.what()));
  }
  return field;
}

void write_grid(const fs::path& path, const openvdb::FloatGrid::Ptr& grid) {
  OutputFile output(path);
  try {
    openvdb::io::File file(output.part().string());
    file.setCompression(openvdb::io::COMPRESS_ACTIVE_MASK | openvdb::io::COMPRESS_BLOSC);
    openvdb::MetaMap metadata;
    metadata.insertMeta("creator", openvdb::StringMetadata("brume"));
    file.write(openvdb::GridCPtrVec{grid}, metadata);
    file.close();
  } catch (const std::exception& error) {
    fail(path, fmt::format("cannot be written: {}", error.what()));
  }
  output.commit();
}

}  // namespace

VdbSummary read_vdb_info(const fs::path& path) {
  return guarded(path, [&] { return read_summary(path); });
}

DensityField load_density(const fs::path& path, const DensityOptions& options, const Task& task) {
  return guarded(path, [&] { return read_density(path, options, task); });
}

void write_density(const fs::path& path, const VoxelBox& box, double voxel_size,
                   const std::function<float(const ivec3&)>& sample, bool half, const Task& task) {
  initialize();
  check_writable(path);
  auto grid = openvdb::FloatGrid::create(0.0f);
  grid->setName("density");
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setSaveFloatAsHalf(half);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(voxel_size));
  // Slabs of leaves are filled in parallel, each into its own tree.
  const int slabs = (box.hi.x >> 3) - (box.lo.x >> 3) + 1;
  std::vector<openvdb::FloatTree::Ptr> trees(static_cast<size_t>(slabs));
  parallel_for(slabs, task, [&](int slab) {
    auto tree = std::make_shared<openvdb::FloatTree>(0.0f);
    openvdb::tree::ValueAccessor<openvdb::FloatTree> accessor(*tree);
    const int x0 = ((box.lo.x >> 3) + slab) * 8;
    ivec3 v;
    for (v.x = std::max(x0, box.lo.x); v.x <= std::min(x0 + 7, box.hi.x); ++v.x)
      for (v.y = box.lo.y; v.y <= box.hi.y; ++v.y)
        for (v.z = box.lo.z; v.z <= box.hi.z; ++v.z)
          if (const float value = sample(v); value > 0) accessor.setValue({v.x, v.y, v.z}, value);
    trees[static_cast<size_t>(slab)] = tree;
  });
  for (const auto& tree : trees) grid->tree().merge(*tree);
  write_grid(path, grid);
}

uint64_t write_halved_density(const fs::path& from_path, const std::string& name, const fs::path& to) {
  std::vector<std::string> notes;
  const auto base = guarded(from_path, [&] {
    const auto file = open(from_path);
    const auto grid = file->readGrid(choose_grid(*file, from_path, name, notes));
    const GridSummary s = summarize(*grid);
    check_scalar_field(from_path, s, *file);
    if (s.grid_class == "level set" || s.nan_count || s.infinite_count || s.negative_count)
      fail(from_path,
           fmt::format("grid '{}' is a level set or holds NaN, infinite or negative voxels; expected a clean fog "
                       "volume to average",
                       s.name));
    return grid;
  });
  const auto source = openvdb::gridPtrCast<openvdb::FloatGrid>(base);
  if (!source) fail(from_path, fmt::format("grid '{}' is of type double; halving takes float grids", base->getName()));
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
  write_grid(to, grid);
  return grid->activeVoxelCount();
}

}  // namespace brume
