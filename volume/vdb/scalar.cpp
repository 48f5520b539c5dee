#include <fmt/format.h>
#include <openvdb/tools/LevelSetUtil.h>

#include <limits>
#include <type_traits>

#include "base/error.h"
#include "base/text.h"
#include "volume/stored_values.h"
#include "volume/vdb/leaves.h"
#include "volume/vdb/reading.h"

// Densities, temperatures and other fields of one number.

namespace brume::vdb {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;
using openvdb::CoordBBox;

template <class Grid>
void build_bricks(Grid& grid, const ScalarOptions& options, ScalarField& field, Reading& reading) {
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
  const PassingLeaves passing(grid.tree(), options.paging == Paging::kAlways);
  const auto sample = [&](const ivec3& lo, float* values) {
    std::array<Value, BrickGrid::kBrick> stored;
    const LeafRows<typename Grid::TreeType> rows(grid.getConstUnsafeAccessor(), lo);
    rows.copy(stored.data());
    rows.end(passing);
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

/// Masks and grids of whole numbers as densities, halves as floats; any other grid as it is.
openvdb::GridBase::Ptr as_numbers(const openvdb::GridBase::Ptr& grid, std::vector<std::string>& notes) {
  if (const auto halves = openvdb::gridPtrCast<HalfGrid>(grid)) {
    const auto floats = openvdb::FloatGrid::create(std::make_shared<openvdb::FloatTree>(halves->tree()));
    floats->insertMeta(*halves);
    floats->setTransform(halves->transform().copy());
    return floats;
  }
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

/// Values that no density has, before they are interpolated: negative ones and NaN become 0, infinite ones the largest.
void clean_values(openvdb::GridBase& grid, double largest) {
  grid.apply<openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid>>([&](auto& typed) {
    using Value = typename std::decay_t<decltype(typed)>::ValueType;
    for (auto it = typed.beginValueOn(); it; ++it)
      if (!(*it >= 0) || std::isinf(*it)) it.setValue(*it > 0 ? static_cast<Value>(largest) : Value(0));
  });
}

/// From now on the values of leaves are read when they are looked at, from the file itself.
void reopen_for_passing(openvdb::io::File& file) {
  file.close();
  file.setCopyMaxBytes(0);
  file.open(/*delayLoad=*/true);
}

/// A file's usual grid of flames that holds none; empty where there is no such grid, or where it burns.
std::string grid_without_flames(Reading& reading, const fs::path& path, Paging paging) {
  const std::vector<GridEntry> entries = read_summary(reading, path, /*values=*/false).entries();
  std::vector<std::string> ignored;
  const GridEntry* const flame = usual_grid(entries, GridUse::kFlame, ignored);
  if (!flame || (flame->type != "float" && flame->type != "double" && flame->type != "half")) return "";
  const size_t end = reading.memory.size();
  const ScalarOptions options{.grid = flame->name, .use = GridUse::kFlame, .paging = paging};
  const bool burns = !read_scalar(reading, path, options).bricks.empty();
  reading.memory.resize(end);  // the flames' bricks are no part of the answer
  return burns ? "" : flame->name;
}

}  // namespace

ScalarField read_scalar(Reading& reading, const fs::path& path, const ScalarOptions& options) {
  ScalarField field;
  if (options.needs_flames)
    if (const std::string flame = grid_without_flames(reading, path, options.paging); !flame.empty()) {
      field.notes.push_back(fmt::format(
          "{}: grid '{}' holds no flames: its temperature is what lifts the smoke, and nothing burns; temperature_grid = NAME makes it glow all the same",
          path.string(), flame));
      return field;
    }
  const auto file = open(reading, path);
  if (options.use == GridUse::kDensity && file->beginName() == file->endName()) {
    field.notes.push_back(fmt::format("{} holds no grid: the field is absent", path.filename().string()));
    return field;
  }
  const std::string name = choose_grid(*file, path, options.grid, options.use, field.notes);
  const bool paged = options.paging == Paging::kAlways;
  if (!paged) check_memory(*file, path, {name});
  if (paged) reopen_for_passing(*file);
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
  if (!s.linear) {
    clean_values(*grid, s.maximum);
    grid = with_equal_voxels(path, grid, field.notes, reading.task);
    GridSummary sampled = summarize(*grid, reading.task);
    sampled.name = name;
    sampled.nan_count = s.nan_count;
    sampled.infinite_count = s.infinite_count;
    sampled.minus_infinite_count = s.minus_infinite_count;
    sampled.negative_count = s.negative_count;
    field.summary = sampled;
  }
  field.world_from_index = s.world_from_index;
  if (s.active_voxels == 0) {
    field.notes.push_back(
        fmt::format("grid '{}' is empty: the field is absent; the file has: {}", s.name, list_grids(*file)));
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

}  // namespace brume::vdb
