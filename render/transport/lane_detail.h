#pragma once
#include <cstdint>

#include "render/transport/lane_cells.h"
#include "volume/detail.h"
#include "volume/detail_flow.h"

namespace brume {

/// Detail as the SIMD kernels (detail_noise.h) read it, in single precision.
struct LaneDetail {
  LaneCells cells = {};  ///< what flights and shadow rays walk through: the medium's own, or smaller ones
  float amplitude = 0;
  float greatest = 1;       ///< that a density is multiplied by, or more
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
  /// Of the DetailFlow that carries it; null where it stands still.
  const float* flow = nullptr;
  float points[3] = {};  ///< their number along each axis
  int32_t row = 0, plane = 0;
  float inverse_spacing = 1;
  float step[3] = {}, rest[3] = {};  ///< of a component: what its bits are worth, where they lie in a word; its zero
};

/// @param detail   the result refers to its flow
/// @param octaves  at most so many of the widest; the others are left out, and with them their part of the amplitude
LaneDetail lane_detail(const Detail& detail, int octaves = Detail::kMostOctaves);

}  // namespace brume
