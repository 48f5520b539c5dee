#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "base/vec.h"
#include "volume/medium.h"

namespace brume {

/// Directions from a point to smoke that scatters the light of fields that emit: uniform in the cones that balls around
/// their light subtend.
class FieldCones {
 public:
  bool empty() const { return count_ == 0; }
  /// Probability with which a new direction is one of these, instead of one of the phase function or BSDF.
  double share() const { return share_; }
  /// Density of such a direction [1/sr]. @param d  of any length: narrow cones notice how far floats are from 1
  double pdf(const dvec3& d) const {
    const double length = glm::length(d);
    double sum = 0;
    for (size_t k = 0; k < count_; ++k)
      if (length - glm::dot(cones_[k].axis, d) <= cones_[k].one_minus_cos * length) sum += cones_[k].density;
    return sum;
  }
  dvec3 sample(double choice, const dvec2& u) const;
  /// Density of a new direction, where that of the phase function or BSDF is `other`.
  double mixed(double other, const dvec3& d) const { return share_ > 0 ? mixed(other, pdf(d)) : other; }
  /// @param aimed  pdf() of it
  double mixed(double other, double aimed) const { return other + share_ * (aimed - other); }

  /// @param irradiance  that comes from what the field emits there, about
  /// @param scattered   as a share of that, what comes from there scattered
  void add(const dvec3& axis, double one_minus_cos, double irradiance, double scattered);
  /// After the last one. @param others  irradiance of everything else that shines, about
  void finish(double others);

 private:
  static constexpr size_t kMost = 16;  // what does not fit in is left to the other directions
  struct Cone {
    dvec3 axis;
    double one_minus_cos, density, chosen;  // chosen: probability of this cone or one before it
  };
  std::array<Cone, kMost> cones_;
  size_t count_ = 0;
  double share_ = 0, irradiance_ = 0, scattered_ = 0;
};

/// Balls around the light of a field that emits, by which directions find from afar what its smoke scatters: light
/// samples find only what the field emits, and find that better. So a ball draws directions by the optical depth of
/// what scatters in it, and none without.
///
/// A direction is drawn from the mixture of cones and phase function or BSDF, whose density counts in every weight
/// against light samples, so that it is unbiased whatever the balls are.
/// Proof: tests/render/field_cones_test.cpp
class FieldBalls {
 public:
  /// A part of the light: radiant intensity, centre, mean square distance from there.
  struct Glow {
    double power;
    dvec3 centre;
    double spread;
  };

  FieldBalls() = default;
  /// @param light  that adds up to the field's
  /// @param media  that scatter it
  FieldBalls(std::vector<Glow> light, std::span<const Medium> media);
  /// Whether any of them scatters.
  bool scatter() const;
  /// @param normal  of a surface that scatters to one side; 0: to all
  void add_cones(const dvec3& p, const dvec3& normal, FieldCones& cones) const;

 private:
  struct Ball {
    dvec3 centre;
    double radius, power;
    double scattered = 0;  ///< light that the media in it scatter, as a share of its light, about
  };
  void divide(std::vector<Glow>::iterator begin, std::vector<Glow>::iterator end, size_t parts);

  std::vector<Ball> balls_;
};

}  // namespace brume
