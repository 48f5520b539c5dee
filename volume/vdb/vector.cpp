#include <fmt/format.h>

#include <cctype>
#include <cmath>
#include <optional>

#include "base/error.h"
#include "volume/stored_values.h"
#include "volume/vdb/leaves.h"
#include "volume/vdb/reading.h"

// Colours and velocities: a grid of vectors, or three grids of numbers.

namespace brume::vdb {
namespace {

namespace fs = std::filesystem;
using openvdb::Coord;
using openvdb::CoordBBox;

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
    check_memory(file, path, {parts->begin(), parts->end()});
    for (size_t c = 0; c < 3; ++c) result.components[c] = {file.readGrid((*parts)[c])};
  } else {
    result.name = choose_grid(file, path, wanted, use, notes);
    check_memory(file, path, {result.name});
    const auto grid = file.readGrid(result.name);
    for (int c = 0; c < 3; ++c) result.components[static_cast<size_t>(c)] = {grid, c};
  }
  reading.limits.reset();
  for (const ComponentGrid& component : result.components) {
    const openvdb::GridBase& grid = *component.grid;
    const bool of_vectors = grid.valueType() == "vec3s" || grid.valueType() == "vec3d",
               of_numbers = grid.valueType() == "float" || grid.valueType() == "double";
    if (!(parts ? of_numbers : of_vectors))
      fail(path,
           fmt::format("grid '{}' is of type {}; expected vec3s or vec3d, three numbers per voxel, or three grids "
                       "of numbers such as '{}.{}'. The file has: {}",
                       grid.getName(), grid.valueType(), result.name, letters[0][0], list_grids(file)));
  }
  const openvdb::GridBase::Ptr first = result.components[0].grid;
  result.components[0].grid = with_equal_voxels(path, first, notes, reading.task);
  for (size_t c = 1; c < 3; ++c) {
    openvdb::GridBase::Ptr& grid = result.components[c].grid;
    grid = grid == first ? result.components[0].grid : with_equal_voxels(path, grid, notes, reading.task);
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

}  // namespace

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

}  // namespace brume::vdb
