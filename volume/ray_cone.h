#pragma once
#include "base/vec.h"

namespace brume {

/// All rays close to a central one: on each axis, their origins differ from its own by at most `apart`, their
/// directions by at most `apart_per_t`. Ray parameters begin at 0.
struct RayCone {
  Ray middle;
  double apart = 0, apart_per_t = 0;
};

/// The cubes of a lattice that the rays of a cone can touch, in layers perpendicular to the cone's main axis.
class RayConeLayers {
 public:
  /// The lattice begins at the origin. @param n  cubes along its axes   @param size  of a cube
  RayConeLayers(const RayCone& cone, const ivec3& n, double size);

  /// Whether all rays cross the layers in one order. If not, the cone is too wide for any bound.
  bool ordered() const { return per_speed_ > 0; }
  int axis() const { return axis_; }
  int step() const { return step_; }
  /// An upper bound of the cubes in a row, on either other axis, that the rays touch in a plane between layers, t >= 0.
  int most_crossed() const;
  /// The first layer that a ray can touch at the parameter t or later; and whether there is a layer with the number k.
  int first(double t) const;
  bool has(int k) const { return k >= 0 && k < n_[axis_]; }

  struct Layer {
    double begin;  ///< no ray enters it before this parameter
    ivec3 lo, hi;  ///< the range of cubes that rays can touch, inclusive; none where lo > hi on an axis
    int cubes() const;
  };
  Layer layer(int k) const;

 private:
  double width(double t) const;
  double reached(int plane) const { return (plane * size_ - cone_.middle.o[axis_]) * per_d_; }

  RayCone cone_;
  ivec3 n_;
  double size_, per_size_;
  int axis_, step_;
  double per_d_ = 0, per_speed_ = 0;  // 1 / the axis component of the central ray's direction; the smallest, absolute
};

}  // namespace brume
