#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "volume/brick_grid.h"
#include "volume/ray_cone.h"

namespace brume {

/// How far a ray in an empty cell can skip ahead, for each octant of directions: the side, in cells, of the largest
/// empty cube known that has the cell at its corner and extends into that octant. Packed into the bits
/// of a negative float, so that it takes the place of the cell's majorant: the sign, 6 bits for a step, 3 bits for each
/// octant. The side is 1 + step * bits.
struct OctantSkip {
  static constexpr uint32_t kEmpty = 1u << 31;
  static constexpr int kStepShift = 24;
  static constexpr uint16_t kFarthest = 1 + 63 * 7;
  /// Octants: 4 for directions with negative x, plus 2 for negative y, plus 1 for negative z.
  static uint32_t pack(const std::array<uint16_t, 8>& clear);
  static int side(uint32_t word, int octant) {
    return static_cast<int>(1 + (word >> kStepShift & 63) * (word >> 3 * octant & 7));
  }
};

/// A BrickGrid's cells laid out flat, for tracing rays in SIMD lanes: one gather reads a cell's majorant or skip
/// distance, a second one finds its values.
struct LaneGrid {
  LaneGrid() = default;
  /// Whether 32-bit offsets and single-precision local coordinates are enough for a grid: at most 4096 voxels a side
  /// (positions known to 1/4096 of a voxel), 2^26 cells, 2^31 values.
  static bool fits(const BrickGrid& grid);
  /// Whether single precision resolves the medium's mean free path: it must span sixteen representable positions.
  /// @param free_path  the shortest of the medium [voxels]
  static bool resolves(const BrickGrid& grid, double free_path);
  /// @param scale  factor on all majorants, at least 1: a looser bound changes no expectation
  explicit LaneGrid(const BrickGrid& grid, double scale = 1.0, const Task& task = {});
  /// The same bricks under cells half as long, which bound the field more tightly; empty where there would be too many.
  /// A cell's values begin in the middle of a brick, whose rows stay as long as they are.
  static LaneGrid halved(const BrickGrid& grid, double scale, const Task& task = {});
  /// For look-ups alone, of values of any sign: without majorants.
  static LaneGrid of_values(const BrickGrid& grid);

  /// Computes each voxel's distance from those that can reach a density, so that a search for the isosurface
  /// interpolates nowhere else and takes long steps.
  void find_isosurface(const BrickGrid& grid, float density, const Task& task = {});

  /// Lower bounds of the ray parameters at which the rays of a cone enter the medium and meet its isosurface. Infinity:
  /// none of them ever does.
  struct Entry {
    double medium = 0;   ///< entry into a cell that is not empty
    double surface = 0;  ///< after find_isosurface: entry into a voxel that can reach the isosurface's density
    /// The layer of that voxel, and the axis that layers are perpendicular to, where the rays are close enough to be
    /// marched as a packet: in every plane between layers they cross at most kPacketVoxels voxels in a row. Else the
    /// axis is -1.
    int axis = -1, layer = 0;
  };
  static constexpr int kPacketVoxels = 3;
  /// @param from  the bounds of a wider cone around this one
  Entry entry_bound(const RayCone& cone, const Entry& from) const;
  Entry entry_bound(const RayCone& cone) const { return entry_bound(cone, Entry()); }

  size_t bytes() const {
    return majorant.size() * sizeof(float) + (brick.size() + isosurface_cell.size()) * sizeof(int32_t) +
           distances.size();
  }

  int nx = 0, ny = 0, nz = 0;
  int cell_size = 0;  ///< in voxels
  /// x slowest, z fastest. Positive: bound of the density in the cell. Negative: the cell is empty, an OctantSkip.
  std::vector<float> majorant;
  std::vector<int32_t> brick;  ///< where the cell's values begin in `values`; -1 where it is empty
  const float* values = nullptr;
  /// One for each voxel of a brick, the cubes between eight values, x slowest: its distance (Chebyshev) from the
  /// nearest one in the brick of whose values one reaches isosurface_density.
  std::vector<uint8_t> distances;
  /// For the search: the number of the cell's brick, or, negative, an OctantSkip where the cell's majorant lies below
  /// isosurface_density.
  std::vector<int32_t> isosurface_cell;
  float isosurface_density = 0;
};

/// What a displaced density field is looked up in.
struct DisplacedLaneGrid {
  LaneGrid density;                      ///< as it is stored; of what stands still, smaller cells for its flights
  std::array<LaneGrid, 3> displacement;  ///< without cells where a component is 0 everywhere
};

}  // namespace brume
