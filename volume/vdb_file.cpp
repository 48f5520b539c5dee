#include <fmt/format.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/LevelSetUtil.h>
#include <openvdb/tools/Prune.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <mutex>
#include <optional>
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

/// What a grid may hold inside a box: leaves and small tiles voxel by voxel; large tiles, and the background where it
/// counts, as boxes of one value.
/// @param clean  what a stored value counts as: values that become 0 occupy nothing
template <class Grid, class Clean>
Occupancy occupancy_of(const Grid& grid, const CoordBBox& box, const Clean& clean) {
  Occupancy occupied;
  const float background = clean(grid.background());
  if (background != 0) occupied.constants.push_back({{from(box.min()), from(box.max())}, background});
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) occupied.blocks.push_back(from(leaf->origin()));
  for (auto tile = tiles_of(grid.tree().cbeginValueAll()); tile; ++tile) {
    const float value = clean(*tile);
    if (value == background) continue;
    CoordBBox covered = tile.getBoundingBox();
    const bool small = covered.dim().x() == BrickGrid::kCell;
    covered.intersect(box);
    if (covered.empty()) continue;
    if (small)
      occupied.blocks.push_back(from(tile.getCoord()));
    else
      occupied.constants.push_back({{from(covered.min()), from(covered.max())}, value});
  }
  return occupied;
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
        return static_cast<float>(v) >= kLeastDensity ? std::min(finite, limit) : 0.0f;
      });
    else
      std::transform(stored.begin(), stored.end(), values, [&](auto v) { return clean(static_cast<double>(v)); });
    if (box.isInside(CoordBBox({lo.x, lo.y, lo.z}, {lo.x + 8, lo.y + 8, lo.z + 8}))) return;
    const float* value = values;
    fill_brick(lo, values, [&](const Coord& c) { return box.isInside(c) ? *value++ : (++value, 0.0f); });
  };
  field.bricks =
      BrickGrid::build({from(box.min()), from(box.max())},
                       occupancy_of(grid, box, [&](const Value& v) { return clean(static_cast<double>(v)); }), sample,
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

/// Masks and grids of whole numbers as densities; any other grid as it is.
openvdb::GridBase::Ptr as_numbers(const openvdb::GridBase::Ptr& grid, std::vector<std::string>& notes) {
  openvdb::FloatGrid::Ptr result;
  const auto try_type = [&](const auto& typed, const auto& number) {
    if (!typed || result) return;
    result = openvdb::FloatGrid::create();
    result->setName(typed->getName());
    result->setGridClass(typed->getGridClass());
    result->setTransform(typed->transform().copy());
    auto accessor = result->getAccessor();
    for (auto it = typed->cbeginValueOn(); it; ++it) {
      const float value = number(*it);
      if (it.isTileValue())
        accessor.addTile(it.getLevel(), it.getCoord(), value, true);
      else
        accessor.setValue(it.getCoord(), value);
    }
  };
  const auto as_float = [](auto v) { return static_cast<float>(v); };
  try_type(openvdb::gridPtrCast<openvdb::BoolGrid>(grid), as_float);
  try_type(openvdb::gridPtrCast<openvdb::MaskGrid>(grid), [](auto) { return 1.0f; });
  const bool mask = result != nullptr;
  try_type(openvdb::gridPtrCast<openvdb::Int32Grid>(grid), as_float);
  try_type(openvdb::gridPtrCast<openvdb::Int64Grid>(grid), as_float);
  if (!result) return grid;
  notes.push_back(fmt::format("grid '{}' is of type {}: {}", grid->getName(), grid->valueType(),
                              mask ? "the density is 1 in its voxels" : "its whole numbers are the density"));
  return result;
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
  openvdb::GridBase::Ptr grid = as_numbers(file->readGrid(name), field.notes);
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

/// One component of a vector: of a grid of vectors, or a scalar grid of its own.
struct ComponentGrid {
  openvdb::GridBase::Ptr grid;
  int axis = 0;  ///< of the vectors
};

/// Calls visit(grid, number) with the grid's own type and what takes the component out of its values; false for a type
/// that has none.
template <class Visit>
bool visit_component(const ComponentGrid& component, const Visit& visit) {
  const int axis = component.axis;
  const auto try_vectors = [&](auto typed) {
    if (typed) visit(*typed, [axis](const auto& v) { return static_cast<double>(v[axis]); });
    return typed != nullptr;
  };
  const auto try_numbers = [&](auto typed) {
    if (typed) visit(*typed, [](const auto& v) { return static_cast<double>(v); });
    return typed != nullptr;
  };
  return try_vectors(openvdb::gridPtrCast<openvdb::Vec3SGrid>(component.grid)) ||
         try_vectors(openvdb::gridPtrCast<openvdb::Vec3DGrid>(component.grid)) ||
         try_numbers(openvdb::gridPtrCast<openvdb::FloatGrid>(component.grid)) ||
         try_numbers(openvdb::gridPtrCast<openvdb::DoubleGrid>(component.grid));
}

/// A field of vectors as a file stores it.
struct VectorGrids {
  std::string name;
  std::array<ComponentGrid, 3> components;

  bool one_grid() const { return components[0].grid == components[1].grid; }
};

/// The three grids that hold the components of `base`: "vel.x", "vel_x", "velX" and the like.
/// @param letters  of the components, one string for each way to call them
std::optional<std::array<std::string, 3>> component_names(const std::vector<std::string>& names,
                                                          const std::string& base,
                                                          const std::vector<std::string>& letters) {
  const auto upper = [](char c) { return static_cast<char>(std::toupper(static_cast<unsigned char>(c))); };
  for (const std::string& of_kind : letters)
    for (const char* between : {".", "_", "", ":", " ", "-"})
      for (const bool large : {false, true}) {
        std::array<std::string, 3> found;
        bool all = true;
        for (size_t c = 0; c < 3; ++c) {
          found[c] = base + between + (large ? upper(of_kind[c]) : of_kind[c]);
          all &= std::find(names.begin(), names.end(), found[c]) != names.end();
        }
        if (all) return found;
      }
  return {};
}

/// Reads a grid of vectors, or three grids of one component each, of a usual name where none is wanted.
/// @throws NoSuchGrid, InputError
VectorGrids read_vector(Reading& reading, openvdb::io::File& file, const fs::path& path, const std::string& wanted,
                        GridUse use, const std::vector<std::string>& letters, std::vector<std::string>& notes) {
  const std::vector<std::string> names = grid_names(file);
  VectorGrids result;
  std::optional<std::array<std::string, 3>> parts;
  for (const std::string& base : wanted.empty() ? usual_grid_names(use) : std::vector{wanted}) {
    if (std::find(names.begin(), names.end(), base) != names.end()) break;
    result.name = base;
    if ((parts = component_names(names, base, letters))) break;
  }
  if (parts) {
    for (size_t c = 0; c < 3; ++c) result.components[c] = {file.readGrid((*parts)[c])};
  } else {
    result.name = choose_grid(file, path, wanted, use, notes);
    const auto grid = file.readGrid(result.name);
    for (int c = 0; c < 3; ++c) result.components[static_cast<size_t>(c)] = {grid, c};
  }
  reading.limits.reset();
  for (const ComponentGrid& component : result.components) {
    const openvdb::GridBase& grid = *component.grid;
    if (!grid.transform().isLinear())
      fail(path,
           fmt::format("grid '{}' has a frustum or other non-affine transform; resample it to a uniform grid first",
                       grid.getName()));
    const bool of_vectors = grid.valueType() == "vec3s" || grid.valueType() == "vec3d",
               of_numbers = grid.valueType() == "float" || grid.valueType() == "double";
    if (!(parts ? of_numbers : of_vectors))
      fail(path,
           fmt::format("grid '{}' is of type {}; expected vec3s or vec3d, three numbers per voxel, or three grids "
                       "of numbers such as '{}.{}'. The file has: {}",
                       grid.getName(), grid.valueType(), result.name, letters[0][0], list_grids(file)));
  }
  for (const ComponentGrid& component : result.components) {
    uint64_t not_finite = 0;
    visit_component(component, [&](const auto& grid, const auto& number) {
      for (auto it = grid.cbeginValueOn(); it; ++it)
        if (!std::isfinite(number(*it))) not_finite += it.getVoxelCount();
    });
    if (not_finite)
      notes.push_back(fmt::format("grid '{}': {} values that are not finite became 0{}", component.grid->getName(),
                                  not_finite,
                                  parts ? "" : fmt::format(" ({})", letters[0][static_cast<size_t>(component.axis)])));
  }
  return result;
}

/// @param box  the voxels that bricks are built over
BrickGrid component_bricks(const ComponentGrid& component, const VoxelBox& box, Reading& reading) {
  BrickGrid bricks;
  visit_component(component, [&](const auto& grid, const auto& number) {
    using Grid = std::decay_t<decltype(grid)>;
    const auto clean = [&](const auto& v) { return finite_or_zero(number(v)); };
    const auto sample = [&](const ivec3& lo, float* values) {
      std::array<typename Grid::ValueType, BrickGrid::kBrick> stored;
      LeafRows<typename Grid::TreeType>(grid.getConstUnsafeAccessor(), lo).copy(stored.data());
      std::transform(stored.begin(), stored.end(), values, clean);
    };
    // The background counts up to the faces of the cells around the box.
    const ivec3 lo = box.lo - 1 & ~(BrickGrid::kCell - 1), hi = box.hi + 2 * BrickGrid::kCell;
    bricks = BrickGrid::build(box, occupancy_of(grid, {{lo.x, lo.y, lo.z}, {hi.x, hi.y, hi.z}}, clean), sample,
                              reading.task, &reading.memory);
  });
  return bricks;
}

/// The voxels that hold a value of a grid.
VoxelBox active_box(const openvdb::GridBase& grid) {
  const CoordBBox box = grid.evalActiveVoxelBoundingBox();
  return grid.activeVoxelCount() > 0 ? VoxelBox{from(box.min()), from(box.max())} : VoxelBox();
}

/// 1 in a grid's active voxels, and in all of its box where a background counts.
BrickGrid active_bricks(const ComponentGrid& component, const VoxelBox& box, Reading& reading) {
  BrickGrid bricks;
  visit_component(component, [&](const auto& grid, const auto& number) {
    Occupancy occupied;
    if (const double background = number(grid.background()); background != 0 && std::isfinite(background)) {
      occupied.constants.push_back({box, 1.0f});
    } else {
      for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) occupied.blocks.push_back(from(leaf->origin()));
      for (auto tile = tiles_of(grid.tree().cbeginValueOn()); tile; ++tile) {
        const CoordBBox covered = tile.getBoundingBox();
        occupied.constants.push_back({{from(covered.min()), from(covered.max())}, 1.0f});
      }
    }
    bricks = BrickGrid::build(
        box, occupied,
        [&](const ivec3& lo, float* values) {
          const auto accessor = grid.getConstUnsafeAccessor();
          fill_brick(lo, values, [&](const Coord& at) { return accessor.isValueOn(at) ? 1.0f : 0.0f; });
        },
        reading.task, &reading.memory);
  });
  return bricks;
}

VectorField read_colour(Reading& reading, const fs::path& path, const std::string& wanted) {
  const auto file = open(reading, path);
  VectorField field;
  const VectorGrids grids = read_vector(reading, *file, path, wanted, GridUse::kColour, {"rgb", "xyz"}, field.notes);
  field.world_from_index = affine_matrix(grids.components[0].grid->transform());
  VoxelBox box;
  for (const ComponentGrid& component : grids.components) {
    if (affine_matrix(component.grid->transform()) != field.world_from_index)
      fail(path, fmt::format("grids '{}' and '{}' have different transforms", grids.components[0].grid->getName(),
                             component.grid->getName()));
    const VoxelBox own = active_box(*component.grid);
    if (own.empty()) continue;
    box = box.empty() ? own : VoxelBox{glm::min(box.lo, own.lo), glm::max(box.hi, own.hi)};
  }
  if (box.empty()) return field;
  for (size_t c = 0; c < 3; ++c) field.bricks.parts[c] = component_bricks(grids.components[c], box, reading);
  return field;
}

StoredVelocity read_velocity(Reading& reading, const fs::path& path, const std::string& wanted) {
  const auto file = open(reading, path);
  StoredVelocity velocity;
  const VectorGrids grids =
      read_vector(reading, *file, path, wanted, GridUse::kVelocity, {"xyz", "uvw"}, velocity.notes);
  velocity.name = grids.name;
  for (size_t c = 0; c < 3; ++c) {
    const ComponentGrid& from = grids.components[c];
    StoredVelocity::Component& to = velocity.components[c];
    to.world_from_index = affine_matrix(from.grid->transform());
    if (from.grid->getGridClass() == openvdb::GRID_STAGGERED && grids.one_grid()) to.shift[static_cast<int>(c)] = 0.5;
    to.box = active_box(*from.grid);
    if (to.box.empty()) continue;
    to.values = component_bricks(from, to.box, reading);
    to.stored = c > 0 && grids.one_grid() ? velocity.components[0].stored : active_bricks(from, to.box, reading);
  }
  return velocity;
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
      return reply(read_velocity(reading, path, request.grid));
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
