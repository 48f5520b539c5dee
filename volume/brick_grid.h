#pragma once
#include <cstdint>
#include <functional>
#include <vector>

#include "base/memory_file.h"
#include "base/progress.h"
#include "base/shared_array.h"
#include "base/vec.h"

namespace brume {

/// A box of voxels, both corners inclusive.
struct VoxelBox {
  ivec3 lo{0}, hi{-1};
  bool empty() const { return hi.x < lo.x || hi.y < lo.y || hi.z < lo.z; }
};

/// A box of voxels that hold one value, such as a tile of a file.
struct ConstantBox {
  VoxelBox box;
  float value = 0;
};

/// Where a grid may hold anything but zeros.
struct Occupancy {
  Occupancy() = default;
  Occupancy(std::vector<ivec3> sampled, std::vector<ConstantBox> constant = {})
      : blocks(std::move(sampled)), constants(std::move(constant)) {}

  /// Lowest corners of 8 x 8 x 8 blocks of voxels whose values are asked for one by one: multiples of 8 in index space,
  /// in any order, repeated or not.
  std::vector<ivec3> blocks;
  /// What the voxels outside of the blocks hold, 0 where there is no box. The boxes after the first replace it where
  /// they lie in it; where they overlap one another they hold one value.
  std::vector<ConstantBox> constants;
};

/// A sparse scalar field on a voxel lattice, laid out for ray tracing.
///
/// The value of voxel (i, j, k) sits at the integer point (i, j, k) (OpenVDB's convention) and the field between is
/// trilinear. Space is cut into cells of 8 x 8 x 8 (recut() makes others); a cell that is not identically zero owns a
/// brick of 9 x 9 x 9 values, the far faces being those of its neighbours (the apron), so that each look-up stays
/// inside one brick. The maximum over a brick bounds the interpolated field over its cell exactly, because no other
/// value takes part: the cells are the majorant grid. Bricks that hold one value everywhere are shared. Cells are
/// grouped into nodes, so that empty space costs one entry per node and is crossed in one step.
///
/// Copies share their values, which may lie in memory that another process has filled.
///
/// Local coordinates: index space shifted by origin(), so that the field lies in [0, extent()].
class BrickGrid {
 public:
  /// Cells as build() makes them: voxels along a cell, values along a brick, values in a brick.
  static constexpr int kCell = 8, kStored = kCell + 1, kBrick = kStored * kStored * kStored;

  BrickGrid() = default;

  /// Fills `values` (x slowest, z fastest) with the voxels lo .. lo + 8 inclusive, index coordinates. Called from
  /// several threads.
  using Sampler = std::function<void(const ivec3& lo, float* values)>;

  /// Builds the grid over the support of the voxels in `box`: one voxel more on each side, where the field falls to 0.
  ///
  /// @param sample  of the cells that a block reaches; these values may lie in constant boxes, too
  /// @param file    where the bricks' values go as they are made; null: into this process's memory
  /// @throws InputError when index or bricks would need more memory than this machine has
  static BrickGrid build(const VoxelBox& box, const Occupancy& occupied, const Sampler& sample, const Task& task = {},
                         MemoryFile* file = nullptr);

  /// The same field in cells of another size: smaller ones bound it more tightly, larger ones are crossed in fewer
  /// steps.
  /// @param cell_size  voxels, a power of two from 2 to 32
  BrickGrid recut(int cell_size, const Task& task = {}) const;

  /// Hands every member to `archive`, in one order: to be sent to another process, or received from one.
  template <class Archive>
  void transfer(Archive& archive) {
    archive(origin_, cell_count_, top_count_, cell_bits_, depth_, support_lo_, support_hi_, maximum_, top_, inner_,
            inner_levels_, cells_, bricks_);
  }
  /// Whether every index points to something, as it does unless what was received is damaged.
  bool consistent() const;

  bool empty() const { return bricks_.empty(); }
  int cell_size() const { return 1 << cell_bits_; }
  /// Values along a brick, and in one.
  int stored() const { return cell_size() + 1; }
  size_t brick_values() const { return static_cast<size_t>(stored()) * stored() * stored(); }
  /// Index coordinates of the local origin.
  const ivec3& origin() const { return origin_; }
  /// Local box outside of which the field is zero.
  const dvec3& support_lo() const { return support_lo_; }
  const dvec3& support_hi() const { return support_hi_; }
  float maximum() const { return maximum_; }
  size_t brick_count() const { return bricks_.size() / brick_values(); }
  size_t bytes() const {
    return bricks_.size() * sizeof(float) + (top_.size() + inner_.size()) * sizeof(int32_t) + inner_levels_.size() +
           cells_.size() * sizeof(Cell);
  }

  /// The trilinear field at a local point; 0 outside.
  float lookup(const dvec3& p) const;
  /// The value of a voxel, local coordinates; 0 outside.
  float voxel(const ivec3& v) const;

  struct Cell {
    uint32_t brick = 0;     ///< 1 + its number; 0: the field is zero in this cell
    float majorant = 0.0f;  ///< of the field over the closed cell
  };
  /// The cell with the coordinates c (local / cell_size()), which must lie inside.
  const Cell& cell(const ivec3& c) const;

  /// Trilinear interpolation inside one brick; p local, inside the brick's cell up to rounding.
  float lookup_in(const Cell& cell, const ivec3& c, const dvec3& p) const {
    const float* v = brick(cell);
    const dvec3 q = p - dvec3(c * cell_size());
    const ivec3 i{clamp_index(q.x), clamp_index(q.y), clamp_index(q.z)};
    const vec3 f(q - dvec3(i));
    const int Y = stored(), X = Y * Y;
    const float* b = v + i.x * X + i.y * Y + i.z;
    const auto lerp = [](float a, float d, float t) { return a + t * (d - a); };
    const float y0 = lerp(lerp(b[0], b[1], f.z), lerp(b[Y], b[Y + 1], f.z), f.y);
    const float y1 = lerp(lerp(b[X], b[X + 1], f.z), lerp(b[X + Y], b[X + Y + 1], f.z), f.y);
    return lerp(y0, y1, f.x);
  }
  /// The local values of a cell that has a brick.
  const float* brick(const Cell& cell) const { return bricks_.data() + (cell.brick - 1) * brick_values(); }

  const ivec3& cells() const { return cell_count_; }
  /// How wide the node around cell c is, in cells, where all its cells are empty; else 0.
  int empty_width(const ivec3& c) const {
    int level = depth_;
    return node(c, level) < 0 ? 1 << (kNodeBits * level) : 0;
  }
  /// Calls visit(cell, count) for each cell that is not empty; once for all those that share a node, which are `count`.
  template <class Visit>
  void each_distinct_cell(const Visit& visit) const {
    const std::vector<uint64_t> uses = node_uses();
    for (size_t i = 0; i < cells_.size(); ++i)
      if (cells_[i].brick != 0) visit(cells_[i], uses[i / kNodeCells]);
  }
  /// Calls visit(c) for the coordinates of each cell that is not empty, in one order.
  /// @param step  a power of two: only cells whose coordinates are multiples of it
  template <class Visit>
  void each_cell(const Visit& visit, int step = 1) const {
    for (int x = 0; x < top_count_.x; ++x)
      for (int y = 0; y < top_count_.y; ++y)
        for (int z = 0; z < top_count_.z; ++z) {
          const ivec3 first = ivec3(x, y, z) << (kNodeBits * depth_);
          if (reaches_step(first, depth_, step)) each_cell_of(depth_, top_[in_top(first)], first, visit, step);
        }
  }

 private:
  class Builder;
  static constexpr int kNodeBits = 3, kNodeWidth = 1 << kNodeBits, kNodeCells = 1 << (3 * kNodeBits);
  static constexpr int kMostLevels = 8;

  void set_depth();
  /// Whether an entry of a level, whose first cell is c, holds a cell whose coordinates are multiples of a step.
  static bool reaches_step(const ivec3& c, int level, int step) {
    return step <= 1 << (kNodeBits * level) || ((c.x | c.y | c.z) & (step - 1)) == 0;
  }
  template <class Visit>
  void each_cell_of(int level, int32_t entry, const ivec3& first, const Visit& visit, int step) const {
    if (entry < 0) return;
    for (int i = 0; i < kNodeCells; ++i) {
      const ivec3 at(i >> 2 * kNodeBits, i >> kNodeBits & (kNodeWidth - 1), i & (kNodeWidth - 1));
      const ivec3 c = first + (at << (kNodeBits * (level - 1)));
      const size_t where = static_cast<size_t>(entry) * kNodeCells + static_cast<size_t>(i);
      if (!reaches_step(c, level - 1, step)) continue;
      if (level > 1)
        each_cell_of(level - 1, inner_[where], c, visit, step);
      else if (cells_[where].brick != 0)
        visit(c);
    }
  }
  std::vector<uint64_t> node_uses() const;
  int clamp_index(double q) const {
    const int i = static_cast<int>(q), last = cell_size() - 1;
    return i < 0 ? 0 : i > last ? last : i;
  }
  /// Of the entry of a level around cell c, in the block of 8 x 8 x 8 that it belongs to.
  static size_t in_block(const ivec3& c, int level) {
    const int shift = kNodeBits * level, mask = kNodeWidth - 1;
    return (static_cast<size_t>(c.x >> shift & mask) << (2 * kNodeBits)) |
           (static_cast<size_t>(c.y >> shift & mask) << kNodeBits) | (c.z >> shift & mask);
  }
  size_t in_top(const ivec3& c) const {
    const int shift = kNodeBits * depth_;
    return (static_cast<size_t>(c.x >> shift) * top_count_.y + (c.y >> shift)) * top_count_.z + (c.z >> shift);
  }
  /// The number of the node that holds cell c; -1 where space is empty.
  /// @param level  depth_ when called; becomes the level of the entry where the search ended
  int32_t node(const ivec3& c, int& level) const {
    int32_t entry = top_[in_top(c)];
    while (level > 1 && entry >= 0) {
      --level;
      entry = inner_[static_cast<size_t>(entry) * kNodeCells + in_block(c, level)];
    }
    return entry;
  }

  // An entry of the level l stands for 8^l cells along each axis: -1 where they are empty; else the number of a block
  // of 8 x 8 x 8 entries of the level below in inner_ or, on the level 1, of cells. Several entries may have one block.
  ivec3 origin_{0}, cell_count_{0}, top_count_{0};
  int cell_bits_ = 3, depth_ = 1;  // depth_: the level of top_
  dvec3 support_lo_{0}, support_hi_{0};
  float maximum_ = 0;
  SharedArray<int32_t> top_, inner_;
  SharedArray<uint8_t> inner_levels_;  // of the entries that have the block
  SharedArray<Cell> cells_;
  SharedArray<float> bricks_;
};

inline const BrickGrid::Cell& BrickGrid::cell(const ivec3& c) const {
  static const Cell kEmpty{};
  int level = depth_;
  const int32_t number = node(c, level);
  return number < 0 ? kEmpty : cells_[static_cast<size_t>(number) * kNodeCells + in_block(c, 0)];
}

/// The segments of constant majorant along a ray, in order: they touch, and cover the ray's part inside the support.
/// Empty segments are left out. Never loops: at most one step per cell crossed.
class MajorantWalk {
 public:
  struct Segment {
    double t0, t1;
    float majorant;  ///< bounds the field on [t0, t1]
    const BrickGrid::Cell* cell;
    ivec3 coordinates;  ///< of the cell
  };

  /// @param ray     in local coordinates; d need not be a unit vector
  /// @param factor  on all majorants
  MajorantWalk(const BrickGrid& grid, const Ray& ray, double t_min, double t_max, double factor = 1);

  /// The next segment whose majorant is not zero; false at the end.
  bool next(Segment& segment);

 private:
  double plane_time(int axis, int plane) const {
    return (static_cast<double>(plane) * grid_->cell_size() - ray_.o[axis]) * inverse_[axis];
  }

  const BrickGrid* grid_;
  Ray ray_;
  dvec3 inverse_;
  ivec3 step_, cell_;
  double t_, end_;
  float factor_;
};

}  // namespace brume
