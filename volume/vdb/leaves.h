#pragma once
#include <openvdb/openvdb.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <vector>

#include "volume/brick_grid.h"

// From OpenVDB's trees to bricks.

namespace brume::vdb {

/// The leaves of a tree whose values are read when they are looked at: each leaf's values are given back after all
/// bricks that they are in have been made, so that only few of a large grid's are in memory at once.
template <class Tree>
class PassingLeaves {
 public:
  /// @param passing  false: all stay
  PassingLeaves(Tree& tree, bool passing) {
    if (!passing) return;
    tree.getNodes(leaves_);
    for (size_t i = 0; i < leaves_.size(); ++i) leaves_[i]->setTransientData(static_cast<openvdb::Index32>(i));
    uses_ = std::vector<std::atomic<uint8_t>>(leaves_.size());
  }
  /// To be called once for each brick that a leaf's values have gone into.
  void used(const typename Tree::LeafNodeType& leaf) const {
    constexpr int kBricks = 8;  // a leaf's own, and those of whose aprons it is a part
    if (uses_.empty() || ++uses_[leaf.transientData()] < kBricks) return;
    typename Tree::LeafNodeType::Buffer none{openvdb::PartialCreate(), typename Tree::ValueType()};
    leaves_[leaf.transientData()]->buffer().swap(none);
  }

 private:
  std::vector<typename Tree::LeafNodeType*> leaves_;
  mutable std::vector<std::atomic<uint8_t>> uses_;
};

inline ivec3 from(const openvdb::Coord& c) {
  return {c.x(), c.y(), c.z()};
}

/// An iterator over a grid's values, kept from its leaves.
template <class Iterator>
Iterator tiles_of(Iterator values) {
  values.setMaxDepth(Iterator::LEAF_DEPTH - 1);
  return values;
}

/// What a grid may hold inside a box: leaves and small tiles voxel by voxel; large tiles, and the background where it
/// counts, as boxes of one value.
/// @param clean  what a stored value counts as: values that become 0 occupy nothing
template <class Grid, class Clean>
Occupancy occupancy_of(const Grid& grid, const openvdb::CoordBBox& box, const Clean& clean) {
  Occupancy occupied;
  const float background = clean(grid.background());
  if (background != 0) occupied.constants.push_back({{from(box.min()), from(box.max())}, background});
  for (auto leaf = grid.tree().cbeginLeaf(); leaf; ++leaf) occupied.blocks.push_back(from(leaf->origin()));
  for (auto tile = tiles_of(grid.tree().cbeginValueAll()); tile; ++tile) {
    const float value = clean(*tile);
    if (value == background) continue;
    openvdb::CoordBBox covered = tile.getBoundingBox();
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
  openvdb::Coord c;
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
      const openvdb::Coord at(lo.x + 8 * (k >> 2), lo.y + 8 * (k >> 1 & 1), lo.z + 8 * (k & 1));
      const auto* const leaf = accessor.probeConstLeaf(at);
      node_[k] = leaf;
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

  /// Tells the leaves that this brick is made.
  void end(const PassingLeaves<Tree>& passing) const {
    for (const auto* const node : node_)
      if (node) passing.used(*node);
  }

 private:
  std::array<const typename Tree::LeafNodeType*, 8> node_;
  std::array<const Value*, 8> leaf_;
  std::array<Value, 8> tile_{};
};

}  // namespace brume::vdb
