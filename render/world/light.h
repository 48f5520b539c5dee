#pragma once
#include <optional>

#include "base/math.h"
#include "render/scene/scene.h"
#include "volume/medium.h"
#include "volume/ray_cone.h"

namespace brume {

class Light;

/// A direction from a point towards a light.
struct LightSample {
  dvec3 wi{0};        ///< unit
  dvec3 radiance{0};  ///< that arrives from there in empty space
  double pdf = 0;     ///< [1/sr]; 1 where delta
  double distance = 0;
  bool delta = false;            ///< a single direction: radiance holds the irradiance, no other technique can hit it
  const Light* light = nullptr;  ///< whose it is; set by Lights::sample
  size_t index = 0;              ///< its number among the sampled lights
};

/// Where a light stands: in a ball, and from afar its importance is its power over the squared distance.
struct LightPlace {
  dvec3 centre;
  double radius;
  dvec3 power;
  dvec3 axis{0};
  double cone = kPi;  ///< half angle around the axis in which it shines
};

/// Something that next-event estimation can aim at.
class Light {
 public:
  virtual ~Light() = default;
  virtual LightSample sample(const dvec3& p, const dvec2& u) const = 0;
  /// Irradiance-like estimate of what an empty scene would receive at p: the choice between lights follows it.
  virtual double importance(const dvec3& p) const = 0;
  virtual bool delta() const { return false; }
  /// Where a small light sits, around which its light falls off with the square of the distance; null for the others.
  virtual const dvec3* centre() const { return nullptr; }
  /// None of light from infinity and of fields.
  virtual std::optional<LightPlace> place() const { return {}; }

  size_t group = 0;  ///< in Lights::groups
};

/// Light from infinitely far away.
class InfiniteLight : public Light {
 public:
  explicit InfiniteLight(bool visible) : visible_(visible) {}
  virtual dvec3 radiance(const dvec3& d) const = 0;
  /// Of sample(), in solid angle.
  virtual double pdf(const dvec3& d) const = 0;
  /// Whether its radiance is the same along all rays of a cone.
  virtual bool uniform(const RayCone& rays) const = 0;
  /// Whether rays that never scattered see it.
  bool visible() const { return visible_; }

 private:
  bool visible_;
};

/// Light from a surface that rays end on.
class FiniteLight : public Light {
 public:
  explicit FiniteLight(const LightSettings& settings) : visible_(settings.visible_to_camera), solid_(settings.solid) {}
  /// Distance to the surface along a ray, negative for none.
  virtual double intersect(const Ray& ray) const = 0;
  /// Emitted at a point of the surface that was hit, towards -ray.d.
  virtual dvec3 radiance(const Ray& ray, double t) const = 0;
  /// Of sample(), in solid angle at ray.o, for the point hit at t.
  virtual double pdf(const Ray& ray, double t) const = 0;
  bool visible() const { return visible_; }
  /// Whether rays end on it; others add its light and go on.
  bool solid() const { return solid_; }

 private:
  bool visible_, solid_;
};

}  // namespace brume
