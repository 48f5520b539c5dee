#pragma once
#include <span>

#include "filters/kernels/work_image.h"

namespace brume::kernels {

struct SparseTap {
  int dx, dy;
  float weight;
};

/// One level of edge-avoiding a-trous wavelets: weight(tap) exp(-|a - b|^2 - direction_factor (1 - cos)^2).
struct ATrousLevel {
  const WorkImage* compared = nullptr;  ///< in units of which one apart weighs exp(-1); null: nothing is compared
  /// Unit directions, and fourth 1 where they are defined: beside an undefined one the term is 0. Null: no term.
  const WorkImage* directions = nullptr;
  float direction_factor = 0;
  const WorkImage* values = nullptr;
  std::span<const SparseTap> taps;
};

/// Pixels x0 .. x1 of row y: averages of the values over the taps inside the image.
void a_trous_row(const ATrousLevel& level, WorkImage& out, int x0, int x1, int y);

}  // namespace brume::kernels
