#include <fmt/format.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tools/Prune.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <mutex>
#include <type_traits>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "volume/stored_values.h"
#include "volume/vdb_exchange.h"

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

/// Limits of this process while OpenVDB parses a file, which believes what a damaged one says of its sizes.
///
/// A leaf of 512 voxels takes at least 128 bytes of a file, its mask twice, and at most 16 KiB of memory; so do the
/// nodes above it, in proportion. A file's bytes thus bound what it can honestly unpack to.
class ParsingLimits {
 public:
  explicit ParsingLimits(uint64_t file_bytes) {
    const double bytes = 5e8 + 128.0 * static_cast<double>(file_bytes);
    const double seconds = cpu_seconds() + 10 + 1e-6 * static_cast<double>(file_bytes);
    const double data = used_bytes(kDataColumn);
    cramped_ = bytes > std::min({physical_memory(), most(RLIMIT_DATA) - data, most(RLIMIT_AS) - used_bytes(1)});
    set(RLIMIT_DATA, data + std::min(bytes, physical_memory()), memory_);
    set(RLIMIT_CPU, seconds, processor_);
  }
  ~ParsingLimits() {
    setrlimit(RLIMIT_DATA, &memory_);
    setrlimit(RLIMIT_CPU, &processor_);
  }
  /// Whether the machine, or limits that held before, allow less than a file of this size can honestly need.
  bool cramped() const { return cramped_; }
  ParsingLimits(const ParsingLimits&) = delete;
  ParsingLimits& operator=(const ParsingLimits&) = delete;

 private:
  /// Memory that this process has mapped: all of it (column 1), or what is writable, which RLIMIT_DATA counts.
  static constexpr int kDataColumn = 6;
  static double used_bytes(int column) {
    std::ifstream stream("/proc/self/statm");
    double pages = 0;
    for (int i = 0; i < column; ++i) stream >> pages;
    return pages * static_cast<double>(sysconf(_SC_PAGESIZE));
  }
  static double most(int resource) {
    rlimit limit{};
    getrlimit(static_cast<__rlimit_resource>(resource), &limit);
    return limit.rlim_cur == RLIM_INFINITY ? std::numeric_limits<double>::infinity()
                                           : static_cast<double>(limit.rlim_cur);
  }
  static void set(int resource, double most, rlimit& before) {
    getrlimit(static_cast<__rlimit_resource>(resource), &before);
    rlimit now = before;
    now.rlim_cur = std::min(before.rlim_cur, static_cast<rlim_t>(most));
    setrlimit(static_cast<__rlimit_resource>(resource), &now);
  }
  rlimit memory_{}, processor_{};
  bool cramped_ = false;
};

/// One request being answered.
struct Reading {
  MemoryFile& memory;  ///< where bricks go
  ExchangeHeader& header;
  Task task;
  std::optional<ParsingLimits> limits = {};
};

/// Opens a file whose table of contents has been checked against its length.
std::unique_ptr<openvdb::io::File> open(Reading& reading, const fs::path& path) {
  initialize();
  std::error_code error;
  if (!fs::exists(path, error)) fail(path, "no such file");
  if (fs::is_directory(path, error)) fail(path, "is a folder, expected an OpenVDB file");
  if (!fs::is_regular_file(path, error)) fail(path, "is no regular file, expected an OpenVDB file");
  const uint64_t size = fs::file_size(path, error);
  reading.limits.emplace(size);
  reading.header.cramped = reading.limits->cramped();
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

/// An iterator over a grid's values, kept from its leaves.
template <class Iterator>
Iterator tiles_of(Iterator values) {
  values.setMaxDepth(Iterator::LEAF_DEPTH - 1);
  return values;
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
    for (size_t i = first; i < end; ++i)
      for (auto value = leaves[i]->cbeginValueOn(); value; ++value) scan.add(static_cast<double>(*value));
  });
  ValueScan whole;
  for (const ValueScan& scan : scans) whole.add(scan);
  for (auto tile = tiles_of(grid.cbeginValueOn()); tile; ++tile)
    whole.add(static_cast<double>(*tile), tile.getVoxelCount());
  return whole;
}

dmat4 affine_matrix(const openvdb::math::Transform& transform) {
  // OpenVDB multiplies row vectors from the left; so the element (i, j) there is column i, row j here.
  const auto m = transform.baseMap()->getAffineMap()->getMat4();
  dmat4 result;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) result[i][j] = m(i, j);
  return result;
}

// The type of a grid of points' values; its own header takes long to compile.
constexpr std::string_view kPointIndex = "ptdataidx32";

/// What a grid's metadata say of it.
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
  grid.apply<openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Int32Grid, openvdb::Int64Grid>>(
      scalar);
  return s;
}

std::vector<std::string> grid_names(openvdb::io::File& file) {
  std::vector<std::string> names;
  for (auto it = file.beginName(); it != file.endName(); ++it) names.push_back(*it);
  return names;
}

std::vector<GridEntry> entries_of(openvdb::io::File& file) {
  std::vector<GridEntry> entries;
  for (const std::string& name : grid_names(file)) {
    const GridSummary grid = named(*file.readGridMetadata(name));
    entries.push_back({name, grid.type, grid.grid_class});
  }
  return entries;
}

std::string list_grids(openvdb::io::File& file) {
  return grids_text(entries_of(file));
}

/// The grid that is wanted, or without a wish the one that usual_grid() takes.
/// @throws NoSuchGrid where there is no usual one; InputError
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

/// @param clean  what a stored value counts as: values that become 0 occupy nothing
template <class Grid, class Clean>
std::vector<ivec3> occupied_blocks(const Grid& grid, const CoordBBox& box, const Clean& clean) {
  std::vector<ivec3> blocks;
  if (clean(static_cast<double>(grid.background())) != 0) {
    append_blocks(box, blocks);
    return blocks;
  }
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) blocks.push_back(from(leaf->origin()));
  for (auto tile = tiles_of(grid.tree().cbeginValueAll()); tile; ++tile) {
    if (clean(static_cast<double>(*tile)) == 0) continue;
    CoordBBox covered = tile.getBoundingBox();
    covered.intersect(box);
    if (!covered.empty()) append_blocks(covered, blocks);
  }
  return blocks;
}

/// A brick's 9 x 9 x 9 values, from a function of the voxel.
template <class Value>
void fill_brick(const ivec3& lo, float* values, const Value& value) {
  Coord c;
  for (int x = 0; x <= 8; ++x)
    for (int y = 0; y <= 8; ++y)
      for (int z = 0; z <= 8; ++z) {
        c.reset(lo.x + x, lo.y + y, lo.z + z);
        *values++ = value(c);
      }
}

/// A brick's 9 x 9 x 9 values as they are stored, copied from the eight leaves that it touches row by row.
template <class Tree>
class LeafRows {
 public:
  using Value = typename Tree::ValueType;

  template <class Accessor>
  LeafRows(const Accessor& accessor, const ivec3& lo) {
    for (int k = 0; k < 8; ++k) {
      const Coord at(lo.x + 8 * (k >> 2), lo.y + 8 * (k >> 1 & 1), lo.z + 8 * (k & 1));
      const auto* const leaf = accessor.probeConstLeaf(at);
      leaf_[k] = leaf ? leaf->buffer().data() : nullptr;
      if (!leaf) tile_[k] = accessor.getValue(at);
    }
  }

  void copy(Value* to) const {
    for (int x = 0; x <= 8; ++x)
      for (int y = 0; y <= 8; ++y, to += 9) {
        const int own = (x >> 3) << 2 | (y >> 3) << 1, row = (x & 7) << 6 | (y & 7) << 3;
        if (leaf_[own])
          std::copy_n(leaf_[own] + row, 8, to);
        else
          std::fill_n(to, 8, tile_[own]);
        to[8] = leaf_[own | 1] ? leaf_[own | 1][row] : tile_[own | 1];
      }
  }

 private:
  std::array<const Value*, 8> leaf_;
  std::array<Value, 8> tile_{};
};

template <class Grid>
void build_bricks(const Grid& grid, const ScalarOptions& options, ScalarField& field, Reading& reading) {
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  const GridSummary& s = field.summary;
  const DensityRule clean(options, s.maximum);
  for (const std::string& note : notes_of_values(s, clean.largest())) field.notes.push_back(note);
  if (grid.background() != 0)
    field.notes.push_back(fmt::format("grid '{}': background {} counts inside the active bounding box and is 0 outside",
                                      s.name, s.background));
  if (options.limit > 0) {
    uint64_t limited = 0;
    for (auto it = grid.cbeginValueOn(); it; ++it)
      if (clean.limits(static_cast<double>(*it))) limited += it.getVoxelCount();
    if (limited) field.notes.push_back(note_of_limited(s, limited, options.limit));
  }
  using Value = typename Grid::ValueType;
  const bool as_stored = std::is_same_v<Value, float> && !clean.remaps();
  const float largest = clean.largest(), limit = clean.limit();
  const auto sample = [&](const ivec3& lo, float* values) {
    std::array<Value, BrickGrid::kBrick> stored;
    LeafRows<typename Grid::TreeType>(grid.getConstUnsafeAccessor(), lo).copy(stored.data());
    if (as_stored)  // what clean() says, without branches
      std::transform(stored.begin(), stored.end(), values, [=](auto v) {
        const auto finite =
            static_cast<float>(v) <= std::numeric_limits<float>::max() ? static_cast<float>(v) : largest;
        return v > 0 ? std::min(finite, limit) : 0.0f;
      });
    else
      std::transform(stored.begin(), stored.end(), values, [&](auto v) { return clean(static_cast<double>(v)); });
    if (box.isInside(CoordBBox({lo.x, lo.y, lo.z}, {lo.x + 8, lo.y + 8, lo.z + 8}))) return;
    const float* value = values;
    fill_brick(lo, values, [&](const Coord& c) { return box.isInside(c) ? *value++ : (++value, 0.0f); });
  };
  field.bricks = BrickGrid::build({from(box.min()), from(box.max())}, occupied_blocks(grid, box, clean), sample,
                                  reading.task, &reading.memory);
  if (field.bricks.empty())
    field.notes.push_back(fmt::format("grid '{}' holds no positive value: the field is absent", s.name));
}

/// @param values  whether the grids are read and looked through, or their metadata only
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

/// Refuses a grid that this machine cannot hold, by what the file says of its size, before any of it is read.
void check_memory(openvdb::io::File& file, const fs::path& path, const std::string& name) {
  const openvdb::GridBase::Ptr grid = file.readGridMetadata(name);
  const auto bytes = grid->getMetadata<openvdb::Int64Metadata>(openvdb::GridBase::META_FILE_MEM_BYTES);
  if (!bytes) return;
  // A brick for each leaf, and some at the rim.
  const double tree = static_cast<double>(bytes->value()), bricks = 1.1 * tree * BrickGrid::kBrick / 512;
  if (!(tree + bricks > physical_memory())) return;
  throw InputError(fmt::format(
      "{}: grid '{}' needs {:.1f} GB of memory to be read, {:.1f} GB of them to be rendered; this machine has {:.1f} GB. Expected a volume of fewer voxels: resample it, or crop it",
      path.string(), name, (tree + bricks) / 1e9, bricks / 1e9, physical_memory() / 1e9));
}

ScalarField read_scalar(Reading& reading, const fs::path& path, const ScalarOptions& options) {
  const auto file = open(reading, path);
  ScalarField field;
  if (options.use == GridUse::kDensity && file->beginName() == file->endName()) {
    field.notes.push_back(fmt::format("{} holds no grid: the field is absent", path.filename().string()));
    return field;
  }
  const std::string name = choose_grid(*file, path, options.grid, options.use, field.notes);
  check_memory(*file, path, name);
  openvdb::GridBase::Ptr grid = file->readGrid(name);
  reading.limits.reset();
  field.summary = summarize(*grid, reading.task);
  field.summary.name = name;
  const GridSummary& s = field.summary;
  check_scalar_field(path, s, *file);
  if (s.grid_class == "level set") {
    if (!options.convert_level_set)
      fail(path, fmt::format(
                     "grid '{}' is a level set; expected a fog volume. Set convert_level_set = true to fill its inside",
                     s.name));
    if (auto typed = openvdb::gridPtrCast<openvdb::FloatGrid>(grid)) openvdb::tools::sdfToFogVolume(*typed);
    if (auto typed = openvdb::gridPtrCast<openvdb::DoubleGrid>(grid)) openvdb::tools::sdfToFogVolume(*typed);
    field.summary = summarize(*grid, reading.task);
    field.summary.name = name;
    field.notes.push_back(fmt::format("grid '{}': the level set's inside was converted to fog", s.name));
  }
  field.world_from_index = s.world_from_index;
  if (s.active_voxels == 0) {
    field.notes.push_back(fmt::format("grid '{}' is empty: the field is absent", s.name));
    return field;
  }
  if (s.grid_class != "fog volume" && 4 * s.negative_count > s.active_voxels)
    field.notes.push_back(fmt::format("grid '{}' is mostly negative; if it is a level set, mark it as one", s.name));
  try {
    if (auto typed = openvdb::gridPtrCast<openvdb::FloatGrid>(grid)) build_bricks(*typed, options, field, reading);
    if (auto typed = openvdb::gridPtrCast<openvdb::DoubleGrid>(grid)) build_bricks(*typed, options, field, reading);
  } catch (const InputError& error) {
    fail(path, fmt::format("grid '{}': {}", s.name, error.what()));
  }
  return field;
}

openvdb::Vec3SGrid::Ptr as_vector_grid(const fs::path& path, const openvdb::GridBase::Ptr& grid) {
  if (!grid->transform().isLinear())
    fail(path, fmt::format("grid '{}' has a frustum or other non-affine transform; resample it to a uniform grid first",
                           grid->getName()));
  if (auto typed = openvdb::gridPtrCast<openvdb::Vec3SGrid>(grid)) return typed;
  fail(path, fmt::format("grid '{}' is of type {}; expected vec3s, three numbers per voxel", grid->getName(),
                         grid->valueType()));
}

VectorField read_colour(Reading& reading, const fs::path& path, const std::string& wanted) {
  const auto file = open(reading, path);
  VectorField field;
  const std::vector<std::string> names = grid_names(*file);
  for (const std::string& base : wanted.empty() ? usual_grid_names(GridUse::kColour) : std::vector{wanted}) {
    if (std::find(names.begin(), names.end(), base + "_r") == names.end()) continue;
    const char* const ends[] = {"_r", "_g", "_b"};
    for (size_t c = 0; c < 3; ++c) {
      ScalarField part = read_scalar(reading, path, {base + ends[c]});
      field.notes.insert(field.notes.end(), part.notes.begin(), part.notes.end());
      if (c > 0 && part.world_from_index != field.world_from_index)
        fail(path, fmt::format("grids '{0}_r' and '{0}{1}' have different transforms", base, ends[c]));
      field.world_from_index = part.world_from_index;
      field.bricks.parts[c] = std::move(part.bricks);
    }
    if (field.bricks.parts[0].origin() != field.bricks.parts[1].origin() ||
        field.bricks.parts[0].origin() != field.bricks.parts[2].origin())
      fail(path, fmt::format("grids '{0}_r', '{0}_g' and '{0}_b' cover different voxels", base));
    return field;
  }
  const auto grid =
      as_vector_grid(path, file->readGrid(choose_grid(*file, path, wanted, GridUse::kColour, field.notes)));
  reading.limits.reset();
  field.world_from_index = affine_matrix(grid->transform());
  const CoordBBox box = grid->evalActiveVoxelBoundingBox();
  if (box.empty()) return field;
  std::vector<ivec3> blocks;
  append_blocks(box, blocks);
  for (int c = 0; c < 3; ++c)
    field.bricks.parts[static_cast<size_t>(c)] = BrickGrid::build(
        {from(box.min()), from(box.max())}, blocks,
        [&](const ivec3& lo, float* values) {
          auto accessor = grid->getConstUnsafeAccessor();
          fill_brick(lo, values, [&](const Coord& at) { return finite_or_zero(accessor.getValue(at)[c]); });
        },
        reading.task, &reading.memory);
  return field;
}

/// A velocity in voxels per frame, on the lattice of the density that it moves.
VelocityReply read_velocity(Reading& reading, const VdbRequest& request) {
  const fs::path& path = request.path;
  const auto file = open(reading, path);
  VelocityReply result;
  const auto grid =
      as_vector_grid(path, file->readGrid(choose_grid(*file, path, request.grid, GridUse::kVelocity, result.notes)));
  reading.limits.reset();
  // Voxels of the density's lattice that any velocity reaches, and the density's own.
  // One lattice, as a rule: then no rounding moves its points.
  const dmat4 world_from_velocity = affine_matrix(grid->transform());
  const dmat4 density_from_velocity = world_from_velocity == request.world_from_index
                                          ? dmat4(1)
                                          : glm::inverse(request.world_from_index) * world_from_velocity;
  const CoordBBox active = grid->evalActiveVoxelBoundingBox();
  VoxelBox& box = result.box;
  box = request.box;
  if (!active.empty()) {
    for (int k = 0; k < 8; ++k) {
      const dvec3 corner{k & 1 ? active.max().x() + 1 : active.min().x() - 1,
                         k & 2 ? active.max().y() + 1 : active.min().y() - 1,
                         k & 4 ? active.max().z() + 1 : active.min().z() - 1};
      const dvec3 at(density_from_velocity * glm::dvec4(corner, 1.0));
      if (glm::any(glm::greaterThan(glm::abs(at), dvec3(1 << 28))))
        fail(path, fmt::format("grid '{}' lies far outside of the density", grid->getName()));
      box.lo = glm::min(box.lo, ivec3(glm::floor(at)));
      box.hi = glm::max(box.hi, ivec3(glm::ceil(at)));
    }
  }
  std::vector<ivec3> blocks;
  append_blocks({Coord(box.lo.x, box.lo.y, box.lo.z), Coord(box.hi.x, box.hi.y, box.hi.z)}, blocks);

  const dmat4 velocity_from_density = glm::inverse(density_from_velocity);
  const dmat3 voxels_from_world = glm::inverse(dmat3(request.world_from_index));
  const bool staggered = grid->getGridClass() == openvdb::GRID_STAGGERED;
  for (int c = 0; c < 3; ++c)
    result.bricks.parts[static_cast<size_t>(c)] = BrickGrid::build(
        box, blocks,
        [&](const ivec3& lo, float* values) {
          auto accessor = grid->getConstUnsafeAccessor();
          fill_brick(lo, values, [&](const Coord& at) {
            const dvec3 q(velocity_from_density * glm::dvec4(at.x(), at.y(), at.z(), 1.0));
            const openvdb::Vec3d where(q.x, q.y, q.z);
            const openvdb::Vec3s v = staggered ? openvdb::tools::StaggeredBoxSampler::sample(accessor, where)
                                               : openvdb::tools::BoxSampler::sample(accessor, where);
            return finite_or_zero((voxels_from_world * dvec3(v.x(), v.y(), v.z()))[c] * request.scale);
          });
        },
        reading.task, &reading.memory);
  return result;
}

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

uint64_t halve(Reading& reading, const fs::path& path, const std::string& name, const fs::path& output,
               const fs::path& part) {
  const auto file = open(reading, path);
  std::vector<std::string> notes;
  const auto base = file->readGrid(choose_grid(*file, path, name, GridUse::kDensity, notes));
  reading.limits.reset();
  const GridSummary s = summarize(*base, reading.task);
  check_scalar_field(path, s, *file);
  if (s.grid_class == "level set" || s.nan_count || s.infinite_count || s.negative_count)
    fail(
        path,
        fmt::format(
            "grid '{}' is a level set or holds NaN, infinite or negative voxels; expected a clean fog volume to average",
            s.name));
  const auto source = openvdb::gridPtrCast<openvdb::FloatGrid>(base);
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

/// Writes the leaves that a request brings. @return active voxels
uint64_t write_leaves(const VdbRequest& request) {
  initialize();
  auto grid = openvdb::FloatGrid::create(0.0f);
  grid->setName("density");
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setSaveFloatAsHalf(request.half);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(request.scale));
  const float* values = request.leaf_values.data();
  for (const VoxelPosition& corner : request.leaf_corners) {
    auto* const leaf = grid->tree().touchLeaf({corner[0], corner[1], corner[2]});
    for (openvdb::Index i = 0; i < openvdb::FloatTree::LeafNodeType::SIZE; ++i, ++values)
      if (*values > 0) leaf->setValueOn(i, *values);
  }
  write_grid(request.path, request.part, grid);
  return grid->activeVoxelCount();
}

/// Packs the answer to a request. @throws InputError, and whatever OpenVDB throws over damaged contents
void answer(Reading& reading, VdbRequest& request, Packer& pack) {
  const fs::path path = request.path;
  const auto reply = [&](auto value) { pack(value); };
  switch (request.kind) {
    case VdbRequest::Kind::kInfo:
      return reply(read_summary(reading, path, /*values=*/true));
    case VdbRequest::Kind::kContents:
      return reply(read_summary(reading, path, /*values=*/false));
    case VdbRequest::Kind::kScalar:
      return reply(read_scalar(reading, path, request.options));
    case VdbRequest::Kind::kColour:
      return reply(read_colour(reading, path, request.grid));
    case VdbRequest::Kind::kVelocity:
      return reply(read_velocity(reading, request));
    case VdbRequest::Kind::kWrite:
      return reply(write_leaves(request));
    case VdbRequest::Kind::kHalve:
      return reply(halve(reading, path, request.grid, request.output, request.part));
  }
}

/// The same; what goes wrong becomes a message.
/// @return the message; empty when all went well
std::string answer_or_explain(Reading& reading, VdbRequest& request, Packer& pack, VdbOutcome& outcome) {
  const auto message = [&](const std::string& what) { return fmt::format("{}: {}", request.path, what); };
  outcome = VdbOutcome::kRefused;
  try {
    answer(reading, request, pack);
    outcome = VdbOutcome::kAnswered;
    return {};
  } catch (const NoSuchGrid& error) {
    outcome = VdbOutcome::kNoSuchGrid;
    return error.what();
  } catch (const InputError& error) {
    return error.what();
  } catch (const std::bad_alloc&) {
    if (reading.limits && !reading.header.cramped)
      return message("damaged: reading it asks for more memory than a file of its size can need");
    outcome = VdbOutcome::kOutOfMemory;
    return request.path;
  } catch (const std::ios::failure&) {
    return message("truncated or damaged: the file ends where its contents go on");
  } catch (const std::exception& error) {
    // What TBB throws for a thread that cannot be started.
    if (std::string_view(error.what()).find("pthread_create") != std::string_view::npos) {
      outcome = VdbOutcome::kOutOfMemory;
      return request.path;
    }
    return message(
        fmt::format("damaged, or not readable by OpenVDB {}: {}", openvdb::getLibraryVersionString(), error.what()));
  }
}

}  // namespace

void answer_vdb_request(MemoryFile& file) {
  const Mapping beginning(file, 0, sizeof(ExchangeHeader), /*writable=*/true);
  auto& header = *reinterpret_cast<ExchangeHeader*>(beginning.data());
  header.begun = kExchangeVersion;
  if (header.asked_by != kExchangeVersion) return;  // who asks says what is wrong
  VdbRequest request;
  {
    Unpacker unpack(std::make_shared<Mapping>(file, 0, file.size(), /*writable=*/false), header.request_offset,
                    header.request_size);
    unpack(request);
  }
  const auto report = [&](double fraction) { std::atomic_ref(header.progress).store(fraction); };
  Reading reading{file, header, {request.threads, report, nullptr}};
  Packer reply(file), explanation(file);
  VdbOutcome outcome{};
  std::string message = answer_or_explain(reading, request, reply, outcome);
  reading.limits.reset();
  explanation(message);
  header.outcome = outcome;
  const std::string& bytes = message.empty() ? reply.bytes() : explanation.bytes();
  header.reply_offset = file.append(std::as_bytes(std::span(bytes)));
  header.reply_size = bytes.size();
}

}  // namespace brume
