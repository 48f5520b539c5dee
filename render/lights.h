#pragma once
#include <vector>

#include "base/math.h"
#include "image/layers.h"
#include "render/scene.h"
#include "volume/medium.h"

namespace brume {

/// A direction from a point towards a light.
struct LightSample {
  dvec3 wi{0};        ///< unit
  dvec3 radiance{0};  ///< that arrives from there in empty space
  double pdf = 0;     ///< [1/sr]; meaningless where delta
  double distance = 0;
  bool delta = false;  ///< exactly parallel light: radiance holds the irradiance, no other technique can hit it
};

/// Parallel light from a disc around a direction.
class Sun {
 public:
  explicit Sun(const LightSettings& settings);
  LightSample sample(const dvec2& u) const;
  bool contains(const dvec3& d) const { return !delta_ && 1.0 - glm::dot(d, axis_) <= one_minus_cos_; }
  double pdf() const { return 1.0 / (2.0 * kPi * one_minus_cos_); }
  const dvec3& radiance() const { return radiance_; }
  const dvec3& irradiance() const { return irradiance_; }
  bool visible() const { return visible_; }

 private:
  dvec3 axis_, irradiance_, radiance_{0};
  double one_minus_cos_;
  bool delta_, visible_;
};

/// A ball that emits the same radiance from every point of its surface, inwards too, and on which rays end.
class SphereLight {
 public:
  SphereLight(const LightSettings& settings, const dvec3& world_shift);
  LightSample sample(const dvec3& p, const dvec2& u) const;
  double pdf(const dvec3& p) const;
  /// Distance to the surface along a ray, negative for none.
  double intersect(const Ray& ray) const;
  const dvec3& radiance() const { return radiance_; }
  const dvec3& centre() const { return centre_; }
  double radius() const { return radius_; }
  bool visible() const { return visible_; }

 private:
  dvec3 centre_, radiance_;
  double radius_;
  bool visible_;
};

/// Constant radiance, or a lat-long picture sampled in proportion to luminance and solid angle.
class Environment {
 public:
  Environment() = default;
  /// @throws InputError: unreadable file, no RGB in it, negative or non-finite texels
  explicit Environment(const EnvironmentSettings& settings);

  bool black() const { return picture_.empty() && radiance_ == dvec3(0); }
  bool constant() const { return picture_.empty(); }
  bool visible() const { return visible_; }
  dvec3 radiance(const dvec3& d) const;
  LightSample sample(const dvec2& u) const;
  double pdf(const dvec3& d) const;
  const dvec3& mean_radiance() const { return mean_; }
  size_t bytes() const { return picture_.size() * sizeof(vec3) + (row_cdf_.size() + cdf_.size()) * sizeof(double); }

 private:
  dvec2 to_picture(const dvec3& d) const;  // in [0, 1)^2
  dvec3 from_picture(const dvec2& uv) const;

  dvec3 radiance_{0}, mean_{0};
  bool visible_ = true;
  int width_ = 0, height_ = 0;
  std::vector<vec3> picture_;
  std::vector<double> row_cdf_, cdf_;  // inclusive sums, each ending in 1
  dmat3 picture_from_world_{1};
  double rotation_ = 0;
};

/// All lights of a scene, and which of them next-event estimation aims at.
class Lights {
 public:
  Lights() = default;
  /// @param near  where most scattering happens: the choice between lights follows what arrives there
  Lights(const Scene& scene, const Medium::Sphere& near, const dvec3& world_shift);

  Environment environment;
  std::vector<Sun> suns;
  std::vector<SphereLight> spheres;

  bool any_sampled() const { return !choice_.empty(); }
  /// A direction to one light, its pdf including the probability of choosing that light.
  LightSample sample(const dvec3& p, double choice, const dvec2& u) const;
  /// Probability that sample() picks the light.
  double choice_of_environment() const { return environment_share_; }
  double choice_of_sun(size_t i) const { return sun_share_[i]; }
  double choice_of_sphere(size_t i) const { return sphere_share_[i]; }

 private:
  struct Choice {
    double end;  // inclusive sum of the shares
    int kind;    // 0 environment, 1 sun, 2 sphere
    size_t index;
  };
  std::vector<Choice> choice_;
  double environment_share_ = 0;
  std::vector<double> sun_share_, sphere_share_;
};

}  // namespace brume
