#pragma once
#include <vector>

#include "filters/inputs/planes.h"

namespace brume {

/// What alpha says, without noise, of where a premultiplied signal has light. With it a signal is filtered as if it
/// went on outside of its edges: filled() goes in, what comes out is multiplied by the weight. Light then neither
/// leaves the area nor gets lost at its rim, whichever filter runs.
struct AlphaWeight {
  /// 0 outside, alpha at the edges, 1 elsewhere; edges are all pixels of alpha between 0 and 1, or only the sharp ones
  /// where alpha is noisy or some light comes without, and none where the signal is not multiplied by alpha. Empty:
  /// alpha says nothing.
  Plane weight;
  size_t outside = 0;  ///< pixels of weight 0
};

/// A pixel is outside where alpha and the signal are 0 and the edge is not one of noise. It is one of noise where, of
/// the pixels at 0 beside others within 16 px, more than a fifth lie between two that are not, or beside a single one:
/// a few paths that met thin smoke leave such edges, a mesh does not. Light where alpha is 0, as of fire, is inside.
/// Alpha is noisy where its response to the mask [1 -2 1] x [1 -2 1] says so (as in filters/inputs/noise.h), edges
/// aside.
/// @param opacity  of the medium without noise, by guides: where there is any, zeros are noise; null: not known
AlphaWeight alpha_weight(const Plane& alpha, const RgbPlanes& signal, const Plane* opacity, const Task& task);

/// Signals over what they would go on as outside of their edges.
class EdgeFill {
 public:
  explicit EdgeFill(const Plane& weight, const Task& task);
  /// values + (1 - weight) * the local mean of what lies inside, by a pyramid of 2 x 2 means: linear in the values.
  Plane filled(const Plane& values, const Task& task) const;

 private:
  std::vector<Plane> weights_;  // the coarsest last
};

}  // namespace brume
