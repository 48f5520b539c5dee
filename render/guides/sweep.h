#pragma once
#include <array>
#include <cstddef>
#include <span>

#include "render/guides/lattice.h"

namespace brume {

/// Of light over directions: its mean, three of the first order and five of the second.
inline constexpr size_t kMostMoments = 9;

/// The nodes of a row that matter, in whole vectors; none where begin is not below end.
struct SweepRow {
  int begin = 0, end = 0;
};

/// Nodes as a sweep sees them: three axes of which the last is contiguous.
struct SweepDomain {
  std::array<int, 3> n{};
  int row = 0;  ///< floats from one row of the last axis to the next; a multiple of Lattice::kVector
  std::array<const float*, 3> places{};  ///< of each axis' nodes, in spacings; null: one apart
  std::array<double, 3> width{1, 1, 1};  ///< mean width of cells along each axis
  const SweepRow* rows = nullptr;  ///< of each row, the first axis slowest; null: everything. Elsewhere nothing changes
  const SweepRow* kept = nullptr;  ///< where results are wanted; null: all of them
  size_t size() const { return static_cast<size_t>(n[0]) * n[1] * row + 2 * Lattice::kVector; }
};

/// One direction of travel.
struct SweepBeam {
  std::array<double, 3> direction{};          ///< in the domain's axes, of length 1
  std::array<float, kMostMoments> factor{1};  ///< of each of SweepMedia::source
  float incoming = 0;                         ///< radiance that enters at the border
  float* radiance = nullptr;                  ///< of domain.size() floats, or null where it is not wanted
  const float* source = nullptr;  ///< light added on the way, in place of SweepMedia's; of all beams, or null
};

/// What beams pass through, domain.size() floats each.
struct SweepMedia {
  const float* extinction = nullptr;                ///< per spacing
  std::array<const float*, kMostMoments> source{};  ///< light added on the way, per spacing: sum of factor[i] source[i]
  size_t sources = 0;                               ///< how many of them there are: 0, 1, 4 or 9
};

/// Radiance along a few directions at every node, plane by plane from where it comes (short characteristics): between
/// two planes a ray is attenuated by the mean extinction at its ends and gains the mean source. Over many planes a
/// narrow beam is widened by the interpolation, as the method does. All beams go through a plane together.
///
/// @param beams    the same one of their first two components must be the largest, in widths of a cell, of the same
/// sign
/// @param moments  none, 4 or 9: for each the sum over the beams of its factor times radiance, of domain.size() floats
/// @param adds     moments are added to what is there
/// Results are written where they are wanted, but for the border: the first plane and the last, first row and last.
/// Source: Kunasz, Auer 1988, Short characteristic integration of radiative transfer problems.
void sweep(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
           std::span<float* const> moments, bool adds = false);

}  // namespace brume
