#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "base/progress.h"
#include "base/vec.h"

namespace brume {

class BrickGrid;
struct Displacement;

/// The velocity that carries detail, coarse and small: noise that follows it needs to know it only roughly, but at
/// every look-up. On a lattice of its own over the density, its points two voxels apart, or up to eight where two would
/// take more than a twentieth of the density's memory, and more than 4 MB; linear between them. A point is one word of
/// 32 bits, so that a look-up reads eight words instead of twenty-four numbers of three grids.
struct DetailFlow {
  static constexpr int kBits = 10;                                                 ///< of a component; x lowest
  static constexpr uint32_t kMask = (1u << kBits) - 1, kRest = 1u << (kBits - 1);  ///< kRest: a component of 0

  DetailFlow() = default;
  /// @param velocity  known on the density's lattice
  DetailFlow(const Displacement& velocity, const BrickGrid& density, const Task& task);

  /// Voxels per frame, at a local point of the density; beyond the lattice as at its rim.
  dvec3 lookup(const dvec3& local) const;
  bool empty() const { return points.empty(); }
  size_t bytes() const { return points.size() * sizeof(float); }

  ivec3 count{0};    ///< of points along each axis
  int spacing = 1;   ///< between them [voxels]
  dvec3 quantum{0};  ///< of each component [voxels per frame]
  /// x slowest. The words stand in floats, which the kernels gather; what is far from any density is at rest.
  std::vector<float> points;
};

}  // namespace brume
