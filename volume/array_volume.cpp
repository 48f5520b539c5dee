#include "volume/array_volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <numeric>
#include <vector>

#include "base/error.h"
#include "base/memory_file.h"
#include "base/parallel_for.h"
#include "base/rng.h"
#include "volume/displacement.h"
#include "volume/stored_values.h"
#include "volume/voxel_box.h"

namespace brume {
namespace {

constexpr int kCell = BrickGrid::kCell;

/// The voxels that are not 0. @param of_slab  those with one x
VoxelBox box_of_slabs(int slabs, const Task& task, const std::function<VoxelBox(int x)>& of_slab) {
  std::vector<VoxelBox> boxes(static_cast<size_t>(slabs));
  parallel_for(slabs, quiet(task), [&](int x) { boxes[static_cast<size_t>(x)] = of_slab(x); });
  VoxelBox box;
  for (const VoxelBox& slab : boxes) enclose(box, slab);
  return box;
}

/// Calls visit(v) for the voxels with one x.
template <class Visit>
void each_in_slab(const ivec3& size, int x, const Visit& visit) {
  for (int y = 0; y < size.y; ++y)
    for (int z = 0; z < size.z; ++z) visit(ivec3(x, y, z));
}

std::vector<ivec3> blocks_of(const VoxelBox& box) {
  std::vector<ivec3> blocks;
  const ivec3 first = box.lo >> 3, last = box.hi >> 3;
  for (int x = first.x; x <= last.x; ++x)
    for (int y = first.y; y <= last.y; ++y)
      for (int z = first.z; z <= last.z; ++z) blocks.emplace_back(kCell * ivec3(x, y, z));
  return blocks;
}

/// A grid of what value(v) says of the voxels in a box, 0 outside. Its bricks lie in a memory file, which grows without
/// a second copy.
template <class Value>
BrickGrid build(const VoxelBox& box, const Value& value, const Task& task) {
  MemoryFile file;
  return BrickGrid::build(
      box, blocks_of(box),
      [&](const ivec3& lo, float* values) {
        for (int x = lo.x; x <= lo.x + kCell; ++x)
          for (int y = lo.y; y <= lo.y + kCell; ++y)
            for (int z = lo.z; z <= lo.z + kCell; ++z) {
              const ivec3 v(x, y, z);
              const bool inside = glm::all(glm::greaterThanEqual(v, box.lo)) && glm::all(glm::lessThanEqual(v, box.hi));
              *values++ = inside ? value(v) : 0.0f;
            }
      },
      task, &file);
}

std::shared_ptr<const ScalarField> scalar_field(const VoxelArray& array, const std::string& name, const Task& task) {
  auto field = std::make_shared<ScalarField>();
  GridSummary& s = field->summary;
  s.name = name;
  s.type = array.type == VoxelArray::Type::kDouble ? "double" : "float";
  s.grid_class = "array";
  s.voxel_size = dvec3(1);
  std::vector<ValueScan> scans(static_cast<size_t>(array.size.x));
  parallel_for(array.size.x, quiet(task), [&](int x) {
    each_in_slab(array.size, x, [&](const ivec3& v) { scans[static_cast<size_t>(x)].add(array.at(v)); });
  });
  ValueScan whole;
  for (const ValueScan& scan : scans) whole.add(scan);
  whole.write(s);
  const DensityRule clean({}, s.maximum);
  field->notes = notes_of_values(s, clean.largest());
  std::vector<uint64_t> counts(static_cast<size_t>(array.size.x));
  s.box = box_of_slabs(array.size.x, task, [&](int x) {
    VoxelBox box;
    each_in_slab(array.size, x, [&](const ivec3& v) {
      if (!(clean(array.at(v)) > 0)) return;
      ++counts[static_cast<size_t>(x)];
      enclose(box, {v, v});
    });
    return box;
  });
  for (const uint64_t count : counts) s.active_voxels += count;
  if (s.negative_count > s.active_voxels)
    field->notes.push_back(fmt::format(
        "grid '{}' is mostly negative; if it holds distances to a surface, make it a density of what is inside", name));
  field->bricks = build(
      s.box, [&](const ivec3& v) { return clean(array.at(v)); }, task);
  if (field->bricks.empty())
    field->notes.push_back(fmt::format("grid '{}' holds no positive value: the field is absent", name));
  return field;
}

std::shared_ptr<const VectorField> vector_field(const std::array<VoxelArray, 3>& arrays, const std::string& name,
                                                const Task& task) {
  auto field = std::make_shared<VectorField>();
  const ivec3& size = arrays[0].size;
  std::vector<uint64_t> not_finite(static_cast<size_t>(size.x));
  const VoxelBox box = box_of_slabs(size.x, task, [&](int x) {
    VoxelBox slab;
    each_in_slab(size, x, [&](const ivec3& v) {
      const auto counts = [&](const VoxelArray& a) { return finite_or_zero(a.at(v)) != 0; };
      not_finite[static_cast<size_t>(x)] +=
          std::any_of(arrays.begin(), arrays.end(), [&](const VoxelArray& a) { return !std::isfinite(a.at(v)); });
      if (std::any_of(arrays.begin(), arrays.end(), counts)) enclose(slab, {v, v});
    });
    return slab;
  });
  if (const uint64_t count = std::accumulate(not_finite.begin(), not_finite.end(), uint64_t{0}))
    field->notes.push_back(fmt::format("grid '{}': what is not finite in {} voxels became 0", name, count));
  for (size_t c = 0; c < 3; ++c)
    field->bricks.parts[c] = build(
        box, [&](const ivec3& v) { return finite_or_zero(arrays[c].at(v)); }, quiet(task));
  return field;
}

/// The voxels that a grid was built over.
VoxelBox box_of(const BrickGrid& grid) {
  if (!(grid.support_hi().x > grid.support_lo().x)) return {};
  return {grid.origin() + ivec3(grid.support_lo()) + 1, grid.origin() + ivec3(grid.support_hi()) - 1};
}

/// Tells the values of grids from those of others.
class Content {
 public:
  void add(const BrickGrid& grid) {
    const VoxelBox box = box_of(grid);
    for (int a = 0; a < 3; ++a) {
      add(static_cast<uint64_t>(box.lo[a]));
      add(static_cast<uint64_t>(box.hi[a]));
    }
    const ivec3& n = grid.cells();
    for (int x = 0; x < n.x; ++x)
      for (int y = 0; y < n.y; ++y)
        for (int z = 0; z < n.z; ++z)
          if (const BrickGrid::Cell& cell = grid.cell({x, y, z}); cell.brick) {
            const float* const values = grid.brick(cell);
            for (size_t i = 0; i < grid.brick_values(); ++i) add(std::bit_cast<uint32_t>(values[i]));
          }
  }
  void add(uint64_t value) { hash_ = hash_combine(hash_, value); }
  std::string text() const { return fmt::format("{:016x}", hash_); }

 private:
  uint64_t hash_ = 0;
};

}  // namespace

std::shared_ptr<const VolumeGrids> grids_of_arrays(const VolumeArrays& arrays, const VolumeGrids* others,
                                                   const Task& task) {
  auto grids = std::make_shared<VolumeGrids>(others ? *others : VolumeGrids());
  const auto scalar = [&](const std::optional<VoxelArray>& array, const char* name, auto& grid) {
    if (!array) return;
    grids->size = array->size;
    grid = scalar_field(*array, name, task);
  };
  const auto vectors = [&](const std::optional<std::array<VoxelArray, 3>>& parts, const char* name, auto& grid) {
    if (!parts) return;
    grids->size = (*parts)[0].size;
    grid = vector_field(*parts, name, task);
  };
  scalar(arrays.density, "density", grids->density);
  scalar(arrays.temperature, "temperature", grids->temperature);
  scalar(arrays.flame, "flame", grids->flame);
  vectors(arrays.colour, "color", grids->colour);
  vectors(arrays.velocity, "velocity", grids->velocity);
  Content content;
  for (const auto* field : {&grids->density, &grids->temperature, &grids->flame}) {
    content.add(*field != nullptr);
    if (*field) content.add((*field)->bricks);
  }
  for (const auto* field : {&grids->colour, &grids->velocity}) {
    content.add(*field != nullptr);
    if (*field)
      for (const BrickGrid& part : (*field)->bricks.parts) content.add(part);
  }
  grids->content = content.text();
  return grids;
}

void copy_values(const BrickGrid& grid, const ivec3& size, float* to, std::ptrdiff_t step) {
  for (int x = 0; x < size.x; ++x)
    for (int y = 0; y < size.y; ++y)
      for (int z = 0; z < size.z; ++z, to += step)
        *to = grid.empty() ? 0.0f : grid.voxel(ivec3(x, y, z) - grid.origin());
}

ScalarField adjusted_density(const ScalarField& stored, const ScalarOptions& options, const Task& task) {
  ScalarField field = stored;
  if (stored.bricks.empty() || (options.remap.empty() && !(options.limit > 0))) return field;
  const DensityRule rule(options, stored.summary.maximum);
  const BrickGrid& bricks = stored.bricks;
  const auto value = [&](const ivec3& v) { return static_cast<double>(bricks.voxel(v - bricks.origin())); };
  const VoxelBox& box = stored.summary.box;
  if (options.limit > 0) {
    std::vector<uint64_t> limited(static_cast<size_t>(box.hi.x - box.lo.x + 1));
    parallel_for(static_cast<int>(limited.size()), quiet(task), [&](int x) {
      each_in_slab(box.hi - box.lo + 1, x,
                   [&](const ivec3& v) { limited[static_cast<size_t>(x)] += rule.limits(value(box.lo + v)) ? 1 : 0; });
    });
    uint64_t sum = 0;
    for (const uint64_t count : limited) sum += count;
    if (sum) field.notes.push_back(note_of_limited(stored.summary, sum, options.limit));
  }
  field.bricks = build(
      box, [&](const ivec3& v) { return rule(value(v)); }, task);
  return field;
}

Displacement displacement_of(const VectorField& velocity, const ScalarField& density, const ShutterMotion& motion,
                             std::vector<std::string>& notes, const Task& task) {
  StoredVelocity stored;
  stored.name = "velocity";
  for (size_t c = 0; c < 3; ++c) {
    StoredVelocity::Component& component = stored.components[c];
    component.values = velocity.bricks.parts[c];
    component.world_from_index = density.world_from_index;
    component.box = box_of(component.values);
    if (component.box.empty()) continue;
    component.stored = BrickGrid::build(component.box, Occupancy({}, {{component.box, 1.0f}}), {}, quiet(task));
  }
  return displacement_over(stored, density, motion, notes, task);
}

}  // namespace brume
