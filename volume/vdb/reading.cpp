#include "volume/vdb/reading.h"

#include <fmt/format.h>
#include <openvdb/io/GridDescriptor.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <mutex>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "volume/stored_values.h"
#include "volume/vdb/leaves.h"

namespace brume::vdb {
namespace {

namespace fs = std::filesystem;
using openvdb::CoordBBox;

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

/// Memory that this process has mapped: all of it (column 1), or what is writable, which RLIMIT_DATA counts.
constexpr int kDataColumn = 6;
double used_bytes(int column) {
  std::ifstream stream("/proc/self/statm");
  double pages = 0;
  for (int i = 0; i < column; ++i) stream >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE));
}

double most(int resource) {
  rlimit limit{};
  getrlimit(static_cast<__rlimit_resource>(resource), &limit);
  return limit.rlim_cur == RLIM_INFINITY ? std::numeric_limits<double>::infinity()
                                         : static_cast<double>(limit.rlim_cur);
}

void set(int resource, double most, rlimit& before) {
  getrlimit(static_cast<__rlimit_resource>(resource), &before);
  rlimit now = before;
  now.rlim_cur = std::min(before.rlim_cur, static_cast<rlim_t>(most));
  setrlimit(static_cast<__rlimit_resource>(resource), &now);
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

template <class Grid>
std::vector<const typename Grid::TreeType::LeafNodeType*> leaves_of(const Grid& grid) {
  std::vector<const typename Grid::TreeType::LeafNodeType*> leaves;
  grid.tree().getNodes(leaves);
  return leaves;
}

template <class Grid>
ValueScan scan_active(const Grid& grid, const Task& task) {
  const auto leaves = leaves_of(grid);
  constexpr size_t kAtOnce = 1024;
  std::vector<ValueScan> scans((leaves.size() + kAtOnce - 1) / kAtOnce);
  parallel_for(static_cast<int>(scans.size()), {task.threads, {}, task.cancel}, [&](int part) {
    const size_t first = static_cast<size_t>(part) * kAtOnce, end = std::min(leaves.size(), first + kAtOnce);
    ValueScan& scan = scans[static_cast<size_t>(part)];
    const auto add = [&](const auto& leaf) {
      for (auto value = leaf.cbeginValueOn(); value; ++value) scan.add(static_cast<double>(*value));
    };
    for (size_t i = first; i < end; ++i)
      if (leaves[i]->isAllocated())
        add(*leaves[i]);
      else  // values that are read when they are looked at: those of a copy do not stay
        add(typename Grid::TreeType::LeafNodeType(*leaves[i]));
  });
  ValueScan whole;
  for (const ValueScan& scan : scans) whole.add(scan);
  for (auto tile = tiles_of(grid.cbeginValueOn()); tile; ++tile)
    whole.add(static_cast<double>(*tile), tile.getVoxelCount());
  return whole;
}

// The type of a grid of points' values; its own header takes long to compile.
constexpr std::string_view kPointIndex = "ptdataidx32";

std::vector<GridEntry> entries_of(openvdb::io::File& file) {
  std::vector<GridEntry> entries;
  for (const std::string& name : grid_names(file)) {
    const GridSummary grid = named(*file.readGridMetadata(name));
    entries.push_back({name, grid.type, grid.grid_class});
  }
  return entries;
}

/// A NanoVDB file as the .vdb that it came from, which lies in memory alone.
std::unique_ptr<openvdb::io::File> open_nano(const fs::path& path) {
  const MemoryFile memory;
  const std::string name = fmt::format("/proc/self/fd/{}", memory.descriptor());
  {
    std::ofstream stream(name, std::ios::binary);
    unpack_nano(path, stream);
    if (!stream.flush()) throw std::bad_alloc();
  }
  auto file = std::make_unique<openvdb::io::File>(name);
  file->open(/*delayLoad=*/false);
  return file;
}

}  // namespace

ParsingLimits::ParsingLimits(uint64_t file_bytes) {
  const double bytes = 5e8 + 128.0 * static_cast<double>(file_bytes);
  const double seconds = cpu_seconds() + 10 + 1e-6 * static_cast<double>(file_bytes);
  const double data = used_bytes(kDataColumn);
  cramped_ = bytes > std::min({physical_memory(), most(RLIMIT_DATA) - data, most(RLIMIT_AS) - used_bytes(1)});
  set(RLIMIT_DATA, data + std::min(bytes, physical_memory()), memory_);
  set(RLIMIT_CPU, seconds, processor_);
}

ParsingLimits::~ParsingLimits() {
  setrlimit(RLIMIT_DATA, &memory_);
  setrlimit(RLIMIT_CPU, &processor_);
}

void fail(const fs::path& path, const std::string& what) {
  throw InputError(fmt::format("{}: {}", path.string(), what));
}

void initialize() {
  static std::once_flag once;
  std::call_once(once, [] {
    openvdb::initialize();
    if (!HalfGrid::isRegistered()) HalfGrid::registerGrid();
  });
}

std::unique_ptr<openvdb::io::File> open(Reading& reading, const fs::path& path) {
  initialize();
  std::error_code error;
  check_exists(path);
  if (fs::is_directory(path, error)) fail(path, "is a folder, expected an OpenVDB file");
  if (!fs::is_regular_file(path, error)) fail(path, "is no regular file, expected an OpenVDB file");
  const uint64_t size = fs::file_size(path, error);
  reading.limits.emplace(size);
  reading.header.cramped = reading.limits->cramped();
  if (is_nano(path)) return open_nano(path);
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

void check_memory(openvdb::io::File& file, const fs::path& path, const std::vector<std::string>& names) {
  double tree = 0;
  for (const std::string& name : names) {
    const openvdb::GridBase::Ptr grid = file.readGridMetadata(name);
    const auto bytes = grid->getMetadata<openvdb::Int64Metadata>(openvdb::GridBase::META_FILE_MEM_BYTES);
    if (bytes) tree += static_cast<double>(bytes->value());
  }
  // A brick for each leaf, and some at the rim.
  const double bricks = 1.1 * tree * BrickGrid::kBrick / 512;
  if (!(tree + bricks > physical_memory())) return;
  throw InputError(fmt::format(
      "{}: grid '{}' needs {:.1f} GB of memory to be read, {:.1f} GB of them to be rendered; this machine has {:.1f} GB. Expected a volume of fewer voxels: resample it, or crop it",
      path.string(), join(names, "', '"), (tree + bricks) / 1e9, bricks / 1e9, physical_memory() / 1e9));
}

std::map<std::string, std::string> texts(const openvdb::MetaMap& meta) {
  std::map<std::string, std::string> result;
  for (auto it = meta.beginMeta(); it != meta.endMeta(); ++it)
    if (it->second) result[it->first] = it->second->str();
  return result;
}

dmat4 affine_matrix(const openvdb::math::Transform& transform) {
  // OpenVDB multiplies row vectors from the left; so the element (i, j) there is column i, row j here.
  const auto m = transform.baseMap()->getAffineMap()->getMat4();
  dmat4 result;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) result[i][j] = m(i, j);
  return result;
}

GridSummary named(const openvdb::GridBase& grid) {
  GridSummary s;
  s.name = grid.getName();
  s.type = grid.valueType();
  s.grid_class = grid.valueType() == kPointIndex ? "points" : class_name(grid);
  s.half = grid.saveFloatAsHalf();
  s.metadata = texts(grid);
  if (const auto it = s.metadata.find("file_compression"); it != s.metadata.end()) s.compression = it->second;
  return s;
}

GridSummary summarize(const openvdb::GridBase& grid, const Task& task) {
  GridSummary s = named(grid);
  s.active_voxels = grid.activeVoxelCount();
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  if (s.active_voxels > 0) s.box = {from(box.min()), from(box.max())};
  const auto size = grid.voxelSize();
  s.voxel_size = {size.x(), size.y(), size.z()};
  s.linear = grid.transform().isLinear();
  if (s.linear) s.world_from_index = affine_matrix(grid.transform());
  const auto scalar = [&](const auto& typed) {
    s.background = static_cast<double>(typed.background());
    s.active_tiles = typed.tree().activeTileCount();
    if (s.active_voxels == 0) return;
    scan_active(typed, task).write(s);
  };
  grid.apply<
      openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid, openvdb::Int64Grid, HalfGrid>>(
      scalar);
  return s;
}

std::vector<std::string> grid_names(openvdb::io::File& file) {
  std::vector<std::string> names;
  for (auto it = file.beginName(); it != file.endName(); ++it) names.push_back(*it);
  return names;
}

std::string list_grids(openvdb::io::File& file) {
  return grids_text(entries_of(file));
}

std::string choose_grid(openvdb::io::File& file, const fs::path& path, const std::string& wanted, GridUse use,
                        std::vector<std::string>& notes) {
  const std::vector<GridEntry> entries = entries_of(file);
  const GridEntry* found = nullptr;
  try {
    found = wanted.empty() ? usual_grid(entries, use, notes) : named_grid(entries, wanted, notes);
  } catch (const InputError& error) {
    fail(path, fmt::format("{}. The file has: {}", error.what(), grids_text(entries)));
  }
  if (found) return found->name;
  const std::string& missing = wanted.empty() ? usual_grid_names(use).front() : wanted;
  const std::string text =
      fmt::format("{}: no grid '{}'; the file has: {}", path.string(), missing, grids_text(entries));
  if (wanted.empty()) throw NoSuchGrid(text);
  throw InputError(text);
}

void check_scalar_field(const fs::path& path, const GridSummary& s, openvdb::io::File& file) {
  if (s.grid_class == "points")
    fail(path,
         fmt::format("grid '{}' holds points; expected a fog volume. Rasterise the points to a density grid first",
                     s.name));
  if (s.type != "float" && s.type != "double")
    fail(path, fmt::format("grid '{}' is of type {}; expected float or double. The file has: {}", s.name, s.type,
                           list_grids(file)));
}

VdbSummary read_summary(Reading& reading, const fs::path& path, bool values) {
  const auto file = open(reading, path);
  VdbSummary summary;
  summary.bytes = fs::file_size(path);
  summary.library_version = file->version();
  if (const auto meta = file->getMetadata()) summary.metadata = texts(*meta);
  for (const std::string& name : grid_names(*file)) {
    summary.grids.push_back(values ? summarize(*file->readGrid(name), reading.task)
                                   : named(*file->readGridMetadata(name)));
    summary.grids.back().name = name;
  }
  return summary;
}

}  // namespace brume::vdb
