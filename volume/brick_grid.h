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
  /// @param blocks  lowest corners of the 8 x 8 x 8 blocks that may hold anything but zeros, multiples of 8 in index
  ///                space, in any order, repeated or not
  /// @param file    where the bricks' values go as they are made; null: into this process's memory
  /// @throws InputError when the index alone would need more than 8 GiB
  static BrickGrid build(const VoxelBox& box, const std::vector<ivec3>& blocks, const Sampler& sample,
                         const Task& task = {}, MemoryFile* file = nullptr);

  /// The same field in cells of another size: smaller ones bound it more tightly, larger ones are crossed in fewer
  /// steps.
  /// @param cell_size  voxels, a power of two from 2 to 32
  BrickGrid recut(int cell_size, const Task& task = {}) const;

  /// Hands every member to `archive`, in one order: to be sent to another process, or received from one.
  template <class Archive>
  void transfer(Archive& archive) {
    archive(origin_, cell_count_, node_count_, cell_bits_, node_bits_, support_lo_, support_hi_, maximum_, nodes_,
            cells_, bricks_);
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
    return bricks_.size() * sizeof(float) + nodes_.size() * sizeof(int32_t) + cells_.size() * sizeof(Cell);
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
  int node_cells() const { return 1 << node_bits_; }
  /// Whether all cells of the node with cell c are empty.
  bool node_empty(const ivec3& c) const { return nodes_[node_index(c)] < 0; }

 private:
  std::vector<int32_t> make_nodes();
  void check_index_size(double bytes) const;
  std::vector<ivec3> cells_touched_by(const std::vector<ivec3>& blocks) const;
  void fill(std::vector<int32_t> nodes, const std::vector<ivec3>& candidates, const Sampler& sample, const Task& task,
            MemoryFile* file);
  int clamp_index(double q) const {
    const int i = static_cast<int>(q), last = cell_size() - 1;
    return i < 0 ? 0 : i > last ? last : i;
  }
  size_t node_index(const ivec3& c) const {
    return (static_cast<size_t>(c.x >> node_bits_) * node_count_.y + (c.y >> node_bits_)) * node_count_.z +
           (c.z >> node_bits_);
  }
  size_t in_node(const ivec3& c) const {
    const int mask = node_cells() - 1;
    return (static_cast<size_t>(c.x & mask) << (2 * node_bits_)) | (static_cast<size_t>(c.y & mask) << node_bits_) |
           (c.z & mask);
  }

  ivec3 origin_{0}, cell_count_{0}, node_count_{0};
  int cell_bits_ = 3, node_bits_ = 3;
  dvec3 support_lo_{0}, support_hi_{0};
  float maximum_ = 0;
  SharedArray<int32_t> nodes_;  // number of the node's block of cells, -1 for an empty node
  SharedArray<Cell> cells_;
  SharedArray<float> bricks_;
};

inline const BrickGrid::Cell& BrickGrid::cell(const ivec3& c) const {
  static const Cell kEmpty{};
  const int32_t node = nodes_[node_index(c)];
  return node < 0 ? kEmpty : cells_[(static_cast<size_t>(node) << (3 * node_bits_)) + in_node(c)];
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

  /// @param ray  in local coordinates; d need not be a unit vector
  MajorantWalk(const BrickGrid& grid, const Ray& ray, double t_min, double t_max);

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
};

}  // namespace brume
