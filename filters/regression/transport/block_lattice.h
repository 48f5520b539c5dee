#pragma once
#include <cstddef>
#include <vector>

namespace brume {

/// A lattice over a picture: sums are taken over its blocks of pixels, blurred from block to block, and what is found
/// at its nodes, the blocks' middles, is interpolated by quadratic B-splines.
struct BlockLattice {
  int width, height;  ///< of the picture [px]
  int block;          ///< side of the blocks [px]
  int across, down;   ///< blocks

  BlockLattice(int width, int height, int block);
  /// Side of the blocks for a Gaussian window [px].
  static int block_for(double deviation);
};

/// The floats of each node side by side, row by row.
using LatticeRows = std::vector<std::vector<float>>;

/// Taps of a Gaussian.
std::vector<float> lattice_taps(double deviation_in_blocks);

/// A row of nodes of `size` floats, blurred along the row.
std::vector<float> blurred_along(const std::vector<float>& row, size_t size, const std::vector<float>& taps);
/// One row of a lattice, blurred with those above and below.
std::vector<float> blurred_down(const LatticeRows& rows, int row, const std::vector<float>& taps);

/// Where pixels lie between the nodes of a lattice: three nodes and their quadratic B-spline weights for each pixel.
struct SplinePlaces {
  std::vector<int> nodes;
  std::vector<float> weights;
  SplinePlaces(int pixels, int block, int count);
  /// The row of nodes between three rows, at pixel y.
  std::vector<float> between(const LatticeRows& rows, int y) const;
};

}  // namespace brume
