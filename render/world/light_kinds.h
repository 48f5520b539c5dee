#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "render/world/light.h"

namespace brume {

class TriangleMesh;

/// A unit vector around an axis: 1 - cos of its angle uniform in [0, one_minus_cos].
dvec3 sample_cone(const dvec3& axis, double one_minus_cos, const dvec2& u);

/// Parallel light from a disc around a direction.
class Sun : public InfiniteLight {
 public:
  explicit Sun(const LightSettings& settings);
  LightSample sample(const dvec2& u) const;
  LightSample sample(const dvec3&, const dvec2& u) const override { return sample(u); }
  dvec3 radiance(const dvec3& d) const override { return contains(d) ? radiance_ : dvec3(0); }
  double pdf(const dvec3& d) const override { return contains(d) ? 1.0 / (2.0 * kPi * one_minus_cos_) : 0.0; }
  double importance(const dvec3&) const override { return luminance(irradiance_); }
  bool delta() const override { return delta_; }
  /// Where none of the rays finds it.
  bool uniform(const RayCone& rays) const override {
    const dvec3 slack = rays.apart_per_t * glm::abs(axis_);
    return delta_ || 1.0 - (glm::dot(rays.middle.d, axis_) + slack.x + slack.y + slack.z) > one_minus_cos_;
  }
  bool contains(const dvec3& d) const { return !delta_ && 1.0 - glm::dot(d, axis_) <= one_minus_cos_; }
  const dvec3& axis() const { return axis_; }
  const dvec3& irradiance() const { return irradiance_; }
  const dvec3& disc_radiance() const { return radiance_; }
  double one_minus_cos() const { return one_minus_cos_; }

 private:
  dvec3 axis_, irradiance_, radiance_{0};
  double one_minus_cos_;
  bool delta_;
};

/// A ball that emits the same radiance from every point of its surface, inwards too.
class SphereLight : public FiniteLight {
 public:
  SphereLight(const LightSettings& settings, const dvec3& world_shift);
  LightSample sample(const dvec3& p, const dvec2& u) const override;
  double intersect(const Ray& ray) const override;
  dvec3 radiance(const Ray&, double) const override { return radiance_; }
  double pdf(const Ray& ray, double) const override { return pdf(ray.o); }
  double pdf(const dvec3& p) const;
  double importance(const dvec3& p) const override;
  const dvec3* centre() const override { return &centre_; }
  std::optional<LightPlace> place() const override {
    return LightPlace{centre_, radius_, kPi * radius_ * radius_ * radiance_};
  }

 private:
  dvec3 centre_, radiance_;
  double radius_;
};

/// A parallelogram that emits from its front, the side from which edge_x to edge_y turns counter-clockwise; black
/// behind.
class RectangleLight : public FiniteLight {
 public:
  RectangleLight(const LightSettings& settings, const dvec3& world_shift);
  LightSample sample(const dvec3& p, const dvec2& u) const override;
  double intersect(const Ray& ray) const override;
  dvec3 radiance(const Ray& ray, double) const override {
    return two_sided_ || glm::dot(ray.d, normal_) < 0 ? radiance_ : dvec3(0);
  }
  double pdf(const Ray& ray, double t) const override { return t * t / (area_ * std::abs(glm::dot(ray.d, normal_))); }
  double importance(const dvec3& p) const override;
  std::optional<LightPlace> place() const override {
    return LightPlace{middle(), 0.5 * std::max(glm::length(x_ + y_), glm::length(x_ - y_)), area_ * radiance_};
  }

 private:
  dvec3 middle() const { return corner_ + 0.5 * (x_ + y_); }

  dvec3 corner_, x_, y_, normal_, radiance_;
  double area_;
  bool two_sided_;
};

/// A point, or a cone with a soft edge, that emits radiant intensity [W/sr].
class PointLight : public Light {
 public:
  PointLight(const LightSettings& settings, const dvec3& world_shift);
  LightSample sample(const dvec3& p, const dvec2& u) const override;
  double importance(const dvec3& p) const override;
  bool delta() const override { return true; }
  const dvec3* centre() const override { return &position_; }
  std::optional<LightPlace> place() const override {
    return LightPlace{position_, 0, intensity_, axis_, cos_outer_ < -1 ? kPi : std::acos(cos_outer_)};
  }

 private:
  dvec3 intensity_towards(const dvec3& d) const;
  dvec3 position_, intensity_, axis_{0};
  bool cosine_ = false;                     // the intensity falls with the cosine to the axis
  double cos_inner_ = -2, cos_outer_ = -2;  // -2: a point light, no cone
};

/// The share of a mesh's radiance that a point of a triangle emits. @param u, v  shares of its second and third corner
using EmissionShare = std::function<dvec3(uint32_t triangle, double u, double v)>;

/// Triangles that emit on the side their normals point to or on both. Rays find them through the scene's surfaces, not
/// through this.
class MeshLight : public Light {
 public:
  /// @param share  none: it emits the same radiance from every point
  MeshLight(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided, EmissionShare share = {});
  LightSample sample(const dvec3& p, const dvec2& u) const override;
  double importance(const dvec3& p) const override;
  std::optional<LightPlace> place() const override { return LightPlace{centre_, extent_, area_ * mean_}; }
  /// In solid angle at distance t, for a point of the mesh met under cos_theta.
  double pdf(double t, double cos_theta) const { return t * t / (area_ * std::abs(cos_theta)); }
  const dvec3& mean_radiance() const { return mean_; }
  const dvec3& middle() const { return centre_; }
  /// Of the faces that shine there, seen from afar along a direction that leads to the mesh; self-occlusion is left
  /// out, and what lies between the axes interpolated.
  double projected_area(const dvec3& direction) const;

 private:
  dvec3 mean_share() const;
  const TriangleMesh* mesh_;
  dvec3 radiance_, mean_{0}, centre_{0};
  EmissionShare share_;
  bool two_sided_;
  double area_ = 0, extent_ = 0;
  std::array<double, 6> projected_{};  // along -x, x, -y, y, -z, z
  std::vector<double> cdf_;
};

}  // namespace brume
