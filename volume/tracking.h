#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "base/progress.h"
#include "base/rng.h"
#include "volume/medium.h"

namespace brume {

/// What the estimators did, for reports; one per thread, summed at the end.
struct TrackingCounters {
  uint64_t lookups = 0;              ///< interpolated density look-ups
  uint64_t collisions = 0;           ///< real ones
  uint64_t majorant_violations = 0;  ///< look-ups above the bound; a bug unless 0
  const StopSignal* stop = nullptr;  ///< asked every few thousand look-ups

  /// Counts one look-up. @throws Interrupted when the signal says so: dense media may take millions for one flight
  void look_up() {
    if ((++lookups & 0xfff) == 0 && stop != nullptr) stop->check();
  }
  void merge(const TrackingCounters& other) {
    lookups += other.lookups;
    collisions += other.collisions;
    majorant_violations += other.majorant_violations;
  }
};

// Interpolation rounds, so the bound is widened by more than a float's rounding and by less than anyone can measure.
inline constexpr double kMajorantMargin = 1.0 + 1e-6;

// Ratio tracking: a weight below the first plays roulette, survivors go on with the second.
inline constexpr double kLeastTransmittance = 0.05, kSurvivingTransmittance = 0.1;

/// A point of a Poisson process whose rate is the majorant of a medium's extinction.
struct TentativeCollision {
  double t;         ///< ray parameter
  double density;   ///< there
  double majorant;  ///< of the density around there
};

/// Visits those points in order along a ray, one at a time, so that the processes of several media can be merged.
class TentativeCollisions {
 public:
  /// @param local  in the medium's local coordinates, parametrised by world distance; from t = 0
  TentativeCollisions(const Medium& medium, const Ray& local, double t_max, Rng& rng)
      : medium_(&medium),
        ray_(local),
        k_(medium.extinction_per_density()),
        margin_(kMajorantMargin * medium.majorant_scale()),
        one_segment_(medium.homogeneous() || medium.global_majorant()),
        walk_(walked_grid(medium), {local.o + medium.walked_shift(), local.d}, 0.0, t_max, medium.majorant_factor()) {
    tau_ = rng.exponential();  // carried across cells: the same process as drawing anew in each, for less
    if (one_segment_) {
      const auto [lo, hi] = medium.support();
      const auto [t0, t1] =
          (medium.homogeneous() ? *medium.homogeneous() : HomogeneousShape{HomogeneousShape::Shape::kBox, lo, hi})
              .intersect(local);
      segment_.t0 = t0 > 0 ? t0 : 0.0;
      segment_.t1 = t1 < t_max ? t1 : t_max;
      segment_.majorant = static_cast<float>(medium.maximum_density());
      t_ = segment_.t0;
      open_ = segment_.t1 > segment_.t0;
    }
  }

  /// False once the ray has left the medium or passed t_max.
  bool next(TentativeCollision& point, Rng& rng, TrackingCounters& counters) {
    if (fresh_) {
      fresh_ = false;
    } else {
      tau_ = rng.exponential();
    }
    for (;;) {
      if (!open_) {
        if (one_segment_ || !walk_.next(segment_)) return false;
        t_ = segment_.t0;
        open_ = true;
      }
      const double majorant = segment_.majorant * margin_, sigma_maj = k_ * majorant;
      const double remaining = (segment_.t1 - t_) * sigma_maj;
      if (tau_ >= remaining) {
        tau_ -= remaining;
        open_ = false;
        continue;
      }
      // Never the same point again, however dense the medium: a flight moves on or ends.
      t_ = std::max(t_ + tau_ / sigma_maj, std::nextafter(t_, kUnbounded));
      const bool even = medium_->homogeneous() && !medium_->falls_off();
      const double density = even           ? 1.0
                             : one_segment_ ? medium_->density(ray_.at(t_))
                                            : medium_->density(segment_, ray_.at(t_));
      counters.look_up();
      counters.majorant_violations += density > majorant;
      point = {t_, density, majorant};
      return true;
    }
  }

 private:
  static const BrickGrid& walked_grid(const Medium& medium) {
    static const BrickGrid kNone;
    return medium.homogeneous() || medium.global_majorant() ? kNone : medium.walked();
  }

  const Medium* medium_;
  Ray ray_;
  double k_, margin_;
  bool one_segment_;  // a homogeneous medium, or one bound for the whole grid
  double tau_ = 0, t_ = 0;
  MajorantWalk walk_;
  MajorantWalk::Segment segment_{};
  bool open_ = false, fresh_ = true;
};

/// The next real collision on a ray, if any.
struct Collision {
  double t = -1;         ///< ray parameter; negative where the ray leaves the medium or passes t_max uncollided
  dvec3 probability{1};  ///< of each channel for what happened, up to a factor that all have
};

/// By delta tracking through the majorant grid: the distance has the density sigma_t exp(-tau) of the channel `hero`,
/// which decides for all.
///
/// @param local  as in TentativeCollisions
/// Source: Woodcock 1965; docs/methods.md, Spectral tracking.  Proof: tests/volume/tracking_test.cpp
Collision sample_collision(const Medium& medium, const Ray& local, double t_max, int hero, Rng& rng,
                           TrackingCounters& counters);

/// Unbiased transmittance of each channel along a ray, by ratio tracking: each tentative collision multiplies the
/// weight by the null share 1 - sigma_t / sigma_maj. Below 0.05 the weight plays roulette. Exact in media of
/// closed form.
///
/// @param local  as in TentativeCollisions
/// @return       in [0, 1]; exactly 1 where the ray misses the medium
/// Source: Novak, Selle, Jarosz 2014.  Proof: tests/volume/tracking_test.cpp
dvec3 estimate_transmittance(const Medium& medium, const Ray& local, double t_max, Rng& rng,
                             TrackingCounters& counters);

/// Optical depth of a ray by regular marching, exact but for rounding: the field is a cubic in t between voxel faces,
/// which three-point Gauss-Legendre quadrature integrates without error. Displaced media are marched in half voxels.
/// For layers, tests and reports, not for the inner loop.
double optical_depth(const Medium& medium, const Ray& local, double t_max);

/// Of rays through the middle of a medium's support, along each axis: a sanity check on units.
std::array<double, 3> depths_along_axes(const Medium& medium);

}  // namespace brume
