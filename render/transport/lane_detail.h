#pragma once
#include <array>
#include <cstdint>

#include "render/transport/lane_cells.h"
#include "volume/detail.h"

namespace brume {

/// Detail as the SIMD kernels (detail_noise.h) read it, in single precision.
struct LaneDetail {
  float amplitude = 0;
  int32_t octaves = 0;      ///< 0: there is no detail
  float matrix[3][3] = {};  ///< to the first octave's lattice, by rows
  float offset[3] = {};     ///< there, of the local origin; whole cells in `cell`
  int32_t cell[3] = {};
  float weight[Detail::kMostOctaves] = {};
  float weights_end[Detail::kMostOctaves] = {};  ///< sums of the weights up to an octave's
  int32_t phases = 1;
  struct Phase {
    float weight, weights_end, since;
    int32_t seed;
  } phase[Detail::kMostPhases] = {};
  bool carried = false;          ///< by a velocity
  LaneCells velocity[3] = {};    ///< its components; without values where one is 0 everywhere
  float velocity_shift[3] = {};  ///< from the density's coordinates to those of the velocity
};

/// The components of a velocity that carries detail.
using VelocityGrids = std::array<LaneGrid, 3>;
/// Whether single precision is enough for it, as LaneGrid::fits() says; true where it stands still.
bool velocity_fits(const Detail& detail);
VelocityGrids velocity_of(const Detail& detail);

/// @param velocity  of it; the result refers to them
/// @param octaves   at most so many of the widest; the others are left out, and with them their part of the amplitude
LaneDetail lane_detail(const Detail& detail, const VelocityGrids& velocity, int octaves = Detail::kMostOctaves);

}  // namespace brume
