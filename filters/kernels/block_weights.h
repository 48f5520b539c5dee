#pragma once
#include <span>
#include <vector>

#include "base/vec.h"
#include "filters/kernels/box.h"
#include "image/plane.h"

namespace brume::kernels {

/// A squared distance between a pixel p and its neighbour q, made of channels, and possibly averaged over a patch.
struct Distance {
  enum class Kind {
    /// ((a - b)^2 - (Va + min(Va, Vb))) / (1e-10 + k^2 (Va + Vb)), mean over channels: what is left of the difference
    /// once its noise is taken off, in units of that noise (docs/methods.md, Patch distances).
    kNoise,
    /// sum of ((a - b)^2 - (Va + min(Va, Vb))) * own(p): the same in units of the pixel's own spread.
    kOwnScale,
    /// sum of (a - b)^2 / max(Va + Vb + own(p), floor), of which V and own have one channel or none.
    kRatio,
    /// (1 - cos)^2 where the channels are a unit direction and, fourth, 1 where it is defined; 0 beside an undefined
    /// one.
    kAngle,
  };
  Kind kind = Kind::kNoise;
  std::vector<const Plane*> guide, variance;
  std::vector<const Plane*> guide_there, variance_there;  ///< of q, where it is in another frame; empty: as of p
  const Plane* own = nullptr;
  float k = 0.45f, floor = 0;
  float scale = 1;           ///< of the distance as it enters the exponent
  std::vector<float> patch;  ///< taps of a separable patch, an odd number of them; empty: the pixel alone
  int patch_radius() const { return static_cast<int>(patch.size()) / 2; }
};

/// A yes-or-no test of a neighbour, channel by channel: rejected when (value(q) - centre(p))^2 is more than the bound
/// that p and q make of `squared_bound`. All channels must pass.
struct Membership {
  enum class Bound { kOwn, kSum, kLarger } bound = Bound::kOwn;  ///< p's, p's + q's, ...
  std::vector<const Plane*> value, centre, squared_bound;
  std::vector<const Plane*> squared_bound_there;  ///< q's, where it is in another frame; empty: as of p
};

/// w(p, q) = exp(-d), where d is the sum, or the largest, of the scaled distances, each at least 0; kPatch: their sum
/// as a whole at least 0, for the layers of one patch.
struct WeightModel {
  std::vector<Distance> distances;  ///< none: every neighbour alike
  std::vector<Membership> memberships;
  enum class Join { kSum, kLargest, kPatch } join = Join::kSum;
  const Plane* trust = nullptr;  ///< of each neighbour, in [0, 1]; null: full
};

/// Room for one thread's work on blocks.
struct WeightScratch {
  std::vector<float> distance, horizontal, norm;
};

/// Joined distances of the pixels of a block to q = p + (dx, dy): rows of `stride` floats, 0 without distances. A patch
/// that reaches outside the image is averaged over what is inside at both ends.
void block_distances(const WeightModel& model, const Box& block, int dx, int dy, WeightScratch& scratch,
                     float* distances, size_t stride);

/// Weights from distances: exp(-(scale * d + (dx^2 + dy^2) * place(p))), times trust(q), 0 where a membership rejects q
/// or q is outside the image. `weights` may be `distances`.
/// @param size   of the image
/// @param place  null: no term of distance in the picture
void block_weights(const WeightModel& model, ivec2 size, const Box& block, int dx, int dy, const float* distances,
                   float scale, const Plane* place, float* weights, size_t stride);

/// sums[c] += scale * w * (there_c(q) - values_c(p)) and, last, sums[C] += scale * w, for each pixel of the block; all
/// of them rows of `stride` floats, `plane` floats apart. With `variance`, one more plane: sums[C + 1] += (scale * w)^2
/// * variance(q).
void accumulate_block(const float* weights, size_t stride, float scale, const Box& block, int dx, int dy,
                      std::span<const Plane* const> values, std::span<const Plane* const> there, const Plane* variance,
                      float* sums, size_t plane);

}  // namespace brume::kernels
