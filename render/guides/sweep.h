#pragma once
#include <array>
#include <cstddef>

#include "render/guides/lattice.h"

namespace brume {

/// The nodes of a row that matter, in whole vectors; none where begin is not below end.
struct SweepRow {
  int begin = 0, end = 0;
};

/// Nodes as a sweep sees them: three axes of which the last is contiguous.
struct SweepDomain {
  std::array<int, 3> n{};
  int row = 0;                     ///< floats from one row of the last axis to the next; a multiple of Lattice::kVector
  const SweepRow* rows = nullptr;  ///< of each row, the first axis slowest; null: everything
  size_t size() const { return static_cast<size_t>(n[0]) * n[1] * row + 2 * Lattice::kVector; }
};

/// Light added on the way, per spacing: sum of factor[i] * values[i] over the first `count`.
struct SweepSource {
  std::array<const float*, 4> values{};
  std::array<float, 4> factor{};
  size_t count = 0;
};

/// Radiance along one direction at every node, plane by plane from where it comes (short characteristics): between two
/// planes a ray is attenuated by the mean extinction at its ends and gains the mean source. Over many planes a narrow
/// beam is widened by the interpolation, as the method does.
///
/// @param extinction  per spacing, at the nodes
/// @param direction   of travel in the domain's axes; of its components the first or second must be the largest
/// @param incoming    radiance that enters at the border
/// @param radiance    of domain.size() floats, holding `incoming` outside of domain.rows; filled inside of them
/// Source: Kunasz, Auer 1988, Short characteristic integration of radiative transfer problems.
void sweep(const SweepDomain& domain, const float* extinction, const SweepSource& source,
           const std::array<double, 3>& direction, float incoming, float* radiance);

}  // namespace brume
