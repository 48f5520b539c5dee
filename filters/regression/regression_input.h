#pragma once
#include <deque>
#include <functional>
#include <vector>

#include "filters/regression/clamped_halves.h"
#include "filters/regression/half_pairs.h"
#include "filters/regression/transport_columns.h"

namespace brume {

/// Of fits to the whole frame.
inline constexpr double kGlobalRidge = 1e-4;

struct Halves {
  RgbPlanes a, b;
};

/// A frame of the sequence, or the one to clean.
struct RegressionInput {
  TransportColumns known;
  float share;  // of its pixels against those of the frame to clean
  bool halves;  // or the whole signal twice
  Halves seen;
  HalfPair left;  // of `seen`, outliers drawn in: what no fit explains so far
  Plane samples, weight, level;

  RegressionInput(const FilterFrame& frame, const Plane& one, float share_, const Task& task)
      : known(frame, one, task),
        share(share_),
        halves(frame.half_a[0] != nullptr && (frame.samples == 0 || frame.samples >= 2)),
        seen{halves ? frame.half_a : frame.signal, halves ? frame.half_b : frame.signal} {
    if (frame.samples > 0 && frame.sample_count)
      samples = make_plane(frame.width(), frame.height(), quiet(task),
                           [&](int x, int y) { return static_cast<float>(frame.samples_at(x, y) / frame.samples); });
  }
  /// Takes what a fit explains of a colour.
  void explain(size_t c, const Plane& a, const Plane& b, const Task& task) {
    add_to(left.a[c], -1, a, task);
    add_to(left.b[c], -1, b, task);
  }
};

/// The frame to clean first, then those nearby. They stay where they are: columns point into them.
using RegressionInputs = std::deque<RegressionInput>;

/// @param frames  deviation of the Gaussian over frames
/// @param one     a plane of ones, which stays where it is
/// @throws InputError for a frame with other guides
RegressionInputs inputs_of(float frames, const FilterFrame& frame, const Plane& one, const Task& task);

/// What becomes of a fit to an input: its colour c of both halves.
using TakeFit = std::function<void(size_t input, size_t c, Plane a, Plane b)>;

/// Fits both halves of the frame to clean and of those nearby with the same coefficients, each colour by itself; those
/// with the same columns together.
/// @param targets  of each picture
void regress(const RegressionInputs& inputs, ColourColumns TransportColumns::*which, const std::vector<Halves>& targets,
             const LatticeWindow& window, const TakeFit& take, const Task& task);

/// What the fits of `count` inputs leave.
std::vector<Halves> left_of(const RegressionInputs& inputs, size_t count);

/// Half images of the frame to clean whose outliers are drawn in to a first fit, the same of those nearby in `left`,
/// and weights.
/// @param power  pixels weigh as their brightness to minus this power
ClampedHalves clamped_inputs(RegressionInputs& inputs, float power, double limit, const Task& task);

/// Weights from what the fits say of the brightness, averaged over a few pixels: they must not follow what a guide
/// holds of noise.
void weigh_by_fits(RegressionInputs& inputs, float power, const std::vector<HalfPair>& before, const Task& task);

}  // namespace brume
