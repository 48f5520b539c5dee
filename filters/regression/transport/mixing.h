#pragma once
#include <functional>

#include "filters/regression/transport/pixels.h"

namespace brume {

/// What candidates are held against.
struct MixingFrame {
  RgbPlanes half_a, half_b;  ///< the data
  const Plane& weight;       ///< of squared errors at each pixel, >= 0; 0 leaves a pixel alone
  const std::vector<MixingRegion>& regions;
};

/// A candidate within a box of the frame: one that is there, or one made in `room` from the result, which it is to
/// improve and which has the box's size.
using Proposal = std::function<const HalfPair&(const HalfPair& result, const Box& box, HalfPair& room)>;

/// A candidate that costs too much to be made everywhere: within a box, where `wanted`, of its size, is above 0. May be
/// null.
using LateProposal = std::function<HalfPair(const Box& box, const Plane& wanted)>;

/// Moves a result towards candidates where the data prove that this lowers its error, and leaves it alone elsewhere.
///
/// With T the result, f a candidate, d = f - T, a share s of the way changes the squared error of the mean of both
/// halves by s^2 a - 2 s b, where
///
///     a = E |(d_A + d_B) / 2|^2
///     b = E [(y_B - T_A) d_A + (y_A - T_B) d_B] / 2 + E [(T_B - T_A) (d_B - d_A)] / 4
///
/// and every product pairs what one half's fit says with the other half's data, so that noise drops out of the mean.
/// In place of b stands a lower bound of it over a Gaussian window: so many standard errors less, and a term for single
/// large values after Bernstein. Each pixel takes the candidate, window and share of the largest sure gain. The first
/// round is over the whole frame; up to three others follow, each within boxes around tiles in which the one before
/// gained more than a twentieth of the noise that the result has, with the candidates that it took and the late one.
/// Definition: tests/support/reference_mixing, which tests/filters/mixing_test holds it to.
void mix(HalfPair& result, const std::vector<Proposal>& proposals, const LateProposal& late, const MixingFrame& frame,
         const Task& task);

}  // namespace brume
