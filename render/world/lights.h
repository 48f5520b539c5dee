#pragma once
#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <vector>

#include "base/math.h"
#include "image/layers.h"
#include "render/scene/scene.h"
#include "volume/medium.h"
#include "volume/ray_cone.h"

namespace brume {

class TriangleMesh;

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

 private:
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

 private:
  dvec3 intensity_towards(const dvec3& d) const;
  dvec3 position_, intensity_, axis_;
  bool cosine_ = false;                     // the intensity falls with the cosine to the axis
  double cos_inner_ = -2, cos_outer_ = -2;  // -2: a point light, no cone
};

/// Triangles that emit the same radiance from every point, on the side their normals point to or on both. Rays find
/// them through the scene's surfaces, not through this.
class MeshLight : public Light {
 public:
  MeshLight(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided);
  LightSample sample(const dvec3& p, const dvec2& u) const override;
  double importance(const dvec3& p) const override;
  /// In solid angle at distance t, for a point of the mesh met under cos_theta.
  double pdf(double t, double cos_theta) const { return t * t / (area_ * std::abs(cos_theta)); }
  const dvec3& radiance() const { return radiance_; }
  const dvec3& middle() const { return centre_; }
  /// Of the faces that shine there, seen from afar along a direction that leads to the mesh; self-occlusion is left
  /// out, and what lies between the axes interpolated.
  double projected_area(const dvec3& direction) const;

 private:
  const TriangleMesh* mesh_;
  dvec3 radiance_, centre_{0};
  bool two_sided_;
  double area_ = 0, extent_ = 0;
  std::array<double, 6> projected_{};  // along -x, x, -y, y, -z, z
  std::vector<double> cdf_;
};

/// Constant radiance, or a lat-long picture sampled in proportion to luminance and solid angle; the picture may be a
/// file or an analytic sky.
class Environment : public InfiniteLight {
 public:
  Environment() : InfiniteLight(true) {}
  /// Values that are not usable are repaired and told in notes() (image/usable_colors.h).
  /// @throws InputError: unreadable file, no RGB in it, chromaticities that are none
  explicit Environment(const EnvironmentSettings& settings, const Task& task = {});

  bool black() const { return picture_.empty() && radiance_ == dvec3(0); }
  bool constant() const { return picture_.empty(); }
  bool uniform(const RayCone&) const override { return constant(); }
  dvec3 radiance(const dvec3& d) const override;
  LightSample sample(const dvec2& u) const;
  LightSample sample(const dvec3&, const dvec2& u) const override { return sample(u); }
  double pdf(const dvec3& d) const override;
  double importance(const dvec3&) const override { return kPi * luminance(mean_); }
  size_t bytes() const { return picture_.size() * sizeof(vec3) + (row_cdf_.size() + cdf_.size()) * sizeof(double); }
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  void set_picture(const Layers& picture, const EnvironmentSettings& settings);
  dvec2 to_picture(const dvec3& d) const;  // in [0, 1)^2
  dvec3 from_picture(const dvec2& uv) const;

  dvec3 radiance_{0}, mean_{0};
  int width_ = 0, height_ = 0;
  std::vector<vec3> picture_;
  std::vector<double> row_cdf_, cdf_;  // inclusive sums, each ending in 1
  dmat3 picture_from_world_{1};
  double rotation_ = 0;
  std::vector<std::string> notes_;
};

/// All lights of a scene, and which of them next-event estimation aims at.
class Lights {
 public:
  Lights() = default;
  /// @param world_shift  subtracted from positions
  Lights(const Scene& scene, const dvec3& world_shift, const Task& task = {});
  /// A mesh that emits; returns its number for mesh().
  size_t add_mesh(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided);
  /// To be called once all lights are there.
  void finish(const std::string& mode);

  const std::vector<const InfiniteLight*>& infinite() const { return infinite_; }
  const std::vector<const FiniteLight*>& finite() const { return finite_; }
  const MeshLight& mesh(size_t i) const { return *meshes_[i]; }
  size_t mesh_count() const { return meshes_.size(); }
  const std::vector<const Sun*>& suns() const { return suns_; }
  const std::vector<const PointLight*>& points() const { return points_; }
  /// Calls visit(light) for all but the environment, each as the kind that it is.
  template <class Visit>
  void each_sharp(const Visit& visit) const {
    for (const Sun* sun : suns_) visit(*sun);
    for (const FiniteLight* light : finite_) visit(*light);
    for (const PointLight* light : points_) visit(*light);
    for (const MeshLight* light : meshes_) visit(*light);
  }
  /// Null where the scene has none.
  const Environment* environment() const { return environment_; }
  /// Whether lights stand somewhere.
  bool all_solid() const {
    return std::all_of(finite_.begin(), finite_.end(), [](const FiniteLight* light) { return light->solid(); });
  }
  /// Whether all rays of a cone that never scattered and meet nothing see the same.
  bool uniform_background(const RayCone& rays) const {
    return finite_.empty() && std::all_of(infinite_.begin(), infinite_.end(), [&](const InfiniteLight* light) {
             return !light->visible() || light->uniform(rays);
           });
  }
  bool local() const { return !finite_.empty() || !points_.empty() || !meshes_.empty(); }
  /// The light that a ray meets before t_max, and where; null for none.
  /// @param seen   only lights that rays see which never scattered
  /// @param t_min  those up to there are behind it
  std::pair<const FiniteLight*, double> nearest(const Ray& ray, double t_max, bool seen, double t_min = 0) const;
  /// Whether a solid light is in the way of a sample of another one.
  bool blocked(const Ray& shadow, double distance, const Light* from) const;

  /// Whether anything shines.
  bool any() const;
  bool any_sampled() const { return !sampled_.empty(); }
  size_t sampled_count() const { return sampled_.size(); }
  const std::vector<const Light*>& sampled() const { return sampled_; }
  bool any_delta() const;
  /// A direction to one light, its pdf including the probability of choosing that light from p.
  LightSample sample(const dvec3& p, double choice, const dvec2& u) const;
  /// The same, without radiance where another finite light is in the way.
  LightSample sample_visible(const dvec3& p, double choice, const dvec2& u) const;
  /// Probability that sample() picks the light from p; 0 for one that is never picked.
  double choice_probability(const Light& light, const dvec3& p) const;
  /// Lights of no power, and what the environment has to say.
  std::vector<std::string> notes() const;

 private:
  std::vector<std::unique_ptr<Light>> all_;  // the environment first, black or not
  std::vector<const InfiniteLight*> infinite_;
  std::vector<const FiniteLight*> finite_;
  std::vector<const MeshLight*> meshes_;
  std::vector<const Sun*> suns_;
  std::vector<const PointLight*> points_;
  const Environment* environment_ = nullptr;
  std::vector<const Light*> sampled_;
  bool same_everywhere_ = true;  // only infinite lights: the choice does not depend on the point
  std::vector<double> share_;    // of the sampled lights, where same_everywhere_
};

}  // namespace brume
