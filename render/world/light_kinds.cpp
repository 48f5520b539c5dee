#include "render/world/light_kinds.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "render/files/mesh.h"

namespace brume {
namespace {

// Suns below this many degrees are exactly parallel: directions in single precision tell no more.
constexpr double kParallel = 1e-5;

}  // namespace

dvec3 sample_cone(const dvec3& axis, double one_minus_cos, const dvec2& u) {
  const double h = u.x * one_minus_cos, s = std::sqrt(std::max(0.0, h * (2.0 - h)));
  const SinCos phi = portable_sincos_2pi(u.y);
  return glm::normalize(Frame(axis).to_world({s * phi.cos, s * phi.sin, 1.0 - h}));
}

Sun::Sun(const LightSettings& s)
    : InfiniteLight(s.visible_to_camera),
      axis_(glm::normalize(s.direction)),
      irradiance_(s.irradiance),
      delta_(s.angular_diameter < kParallel) {
  const double radius = 0.5 * s.angular_diameter * kPi / 180.0, half = std::sin(0.5 * radius);
  one_minus_cos_ = 2.0 * half * half;
  // The disc's projected solid angle is pi sin^2: then a facing plane gets exactly the irradiance asked for.
  if (!delta_) radiance_ = irradiance_ / (kPi * std::sin(radius) * std::sin(radius));
}

LightSample Sun::sample(const dvec2& u) const {
  if (delta_) return {axis_, irradiance_, 1.0, kUnbounded, true};
  return {sample_cone(axis_, one_minus_cos_, u), radiance_, 1.0 / (2.0 * kPi * one_minus_cos_), kUnbounded, false};
}

SphereLight::SphereLight(const LightSettings& s, const dvec3& world_shift)
    : FiniteLight(s), centre_(s.position - world_shift), radiance_(s.radiance), radius_(s.radius) {}

double SphereLight::importance(const dvec3& p) const {
  // Inside or near, as strong as at its own surface.
  const dvec3 to = centre_ - p;
  return kPi * luminance(radiance_) * std::min(1.0, radius_ * radius_ / glm::dot(to, to));
}

double SphereLight::pdf(const dvec3& p) const {
  const dvec3 to = centre_ - p;
  const double sin2 = radius_ * radius_ / glm::dot(to, to);
  if (!(sin2 < 1)) return 1.0 / (4.0 * kPi);  // from inside, every direction meets it
  // 1 - cos without cancellation: sin^2 / (1 + cos).
  return (1.0 + std::sqrt(1.0 - sin2)) / (2.0 * kPi * sin2);
}

LightSample SphereLight::sample(const dvec3& p, const dvec2& u) const {
  const double density = pdf(p);
  const dvec3 to = centre_ - p;
  const double one_minus_cos = 1.0 / (2.0 * kPi * density);
  const dvec3 axis = glm::dot(to, to) > 0 ? glm::normalize(to) : dvec3(0, 0, 1);
  const dvec3 wi = sample_cone(axis, one_minus_cos, u);
  const double t = intersect({p, wi});
  // A direction at the very rim may miss by rounding; the tangent point is then the one meant.
  return {wi, radiance_, density, t > 0 ? t : std::sqrt(std::max(0.0, glm::dot(to, to) - radius_ * radius_)), false};
}

double SphereLight::intersect(const Ray& ray) const {
  const dvec3 o = ray.o - centre_;
  const double b = glm::dot(o, ray.d), length2 = glm::dot(o, o);
  const dvec3 closest = o - b * ray.d;  // Hearn and Baker: no cancellation for far and tiny spheres
  const double discriminant = radius_ * radius_ - glm::dot(closest, closest);
  if (discriminant < 0) return -1;
  const double root = std::sqrt(discriminant);
  return length2 > radius_ * radius_ ? -b - root : -b + root;
}

RectangleLight::RectangleLight(const LightSettings& s, const dvec3& world_shift)
    : FiniteLight(s),
      corner_(s.position - world_shift - 0.5 * (s.edge_x + s.edge_y)),
      x_(s.edge_x),
      y_(s.edge_y),
      radiance_(s.radiance),
      two_sided_(s.two_sided) {
  const dvec3 n = glm::cross(x_, y_);
  area_ = glm::length(n);
  normal_ = n / area_;
}

LightSample RectangleLight::sample(const dvec3& p, const dvec2& u) const {
  const dvec3 to = corner_ + u.x * x_ + u.y * y_ - p;
  const double distance = glm::length(to);
  if (!(distance > 0)) return {};
  const dvec3 wi = to / distance;
  const Ray ray{p, wi};
  if (!(std::abs(glm::dot(wi, normal_)) > 0)) return {};
  return {wi, radiance(ray, distance), pdf(ray, distance), distance, false};
}

double RectangleLight::intersect(const Ray& ray) const {
  const double facing = glm::dot(ray.d, normal_);
  if (facing == 0) return -1;
  const double t = glm::dot(corner_ - ray.o, normal_) / facing;
  if (!(t > 0)) return -1;
  // Coordinates along the edges, which need not be perpendicular.
  const dvec3 q = ray.at(t) - corner_;
  const double a = glm::dot(glm::cross(q, y_), normal_) / area_, b = glm::dot(glm::cross(x_, q), normal_) / area_;
  return a >= 0 && a <= 1 && b >= 0 && b <= 1 ? t : -1;
}

double RectangleLight::importance(const dvec3& p) const {
  const dvec3 to = middle() - p;
  return luminance(radiance_) * kPi * std::min(1.0, area_ / (kPi * glm::dot(to, to)));
}

PointLight::PointLight(const LightSettings& s, const dvec3& world_shift)
    : position_(s.position - world_shift), intensity_(s.intensity) {
  if (s.type != "spot") return;
  axis_ = glm::normalize(s.direction);
  cosine_ = s.cosine_falloff;
  cos_outer_ = std::cos(0.5 * s.cone_angle * kPi / 180.0);
  cos_inner_ = std::cos(0.5 * s.cone_angle * (1.0 - s.cone_softness) * kPi / 180.0);
}

dvec3 PointLight::intensity_towards(const dvec3& d) const {
  if (cos_outer_ < -1) return intensity_;
  const double c = glm::dot(d, axis_);
  if (c <= cos_outer_) return dvec3(0);
  const dvec3 inside = cosine_ ? intensity_ * c : intensity_;
  if (c >= cos_inner_) return inside;
  const double f = (c - cos_outer_) / (cos_inner_ - cos_outer_);
  return inside * (f * f * (3.0 - 2.0 * f));
}

LightSample PointLight::sample(const dvec3& p, const dvec2&) const {
  const dvec3 to = position_ - p;
  const double distance = glm::length(to);
  if (!(distance > 0)) return {};
  const dvec3 wi = to / distance;
  return {wi, intensity_towards(-wi) / (distance * distance), 1.0, distance, true};
}

double PointLight::importance(const dvec3& p) const {
  const dvec3 to = position_ - p;
  const double d2 = glm::dot(to, to);
  // A spot keeps a share outside of its cone too, so that the choice never rests on rounding.
  const double shape = cos_outer_ < -1 || glm::dot(-to, axis_) >= cos_outer_ * std::sqrt(d2) ? 1.0 : 1e-3;
  return d2 > 0 ? shape * luminance(intensity_) / d2 : 0.0;
}

MeshLight::MeshLight(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided, EmissionShare share)
    : mesh_(&mesh), radiance_(radiance), share_(std::move(share)), two_sided_(two_sided) {
  cdf_.reserve(mesh.triangles.size());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    area_ += mesh.area(i);
    cdf_.push_back(area_);
    const dvec3 facing = mesh.area(i) * mesh.normal(i);
    for (int axis = 0; axis < 3; ++axis)
      for (const bool back : {false, true})
        if (two_sided_ || back == (facing[axis] < 0))
          projected_[static_cast<size_t>(2 * axis + back)] += std::abs(facing[axis]);
  }
  for (double& c : cdf_) c /= area_;
  mean_ = share_ ? radiance_ * mean_share() : radiance_;
  for (const dvec3& v : mesh.positions) centre_ += v;
  centre_ /= static_cast<double>(mesh.positions.size());
  for (const dvec3& v : mesh.positions) extent_ = std::max(extent_, glm::distance(centre_, v));
}

/// At points spread over the area.
dvec3 MeshLight::mean_share() const {
  constexpr int kPoints = 4096;
  dvec3 sum(0);
  for (int k = 0; k < kPoints; ++k) {
    constexpr double kFirst = 0.7548776662466927, kSecond = 0.5698402909980532;  // of the plastic number
    const double at = (k + 0.5) / kPoints, root = std::sqrt(k * kFirst - std::floor(k * kFirst));
    const double along = k * kSecond - std::floor(k * kSecond);
    const auto i = static_cast<size_t>(std::upper_bound(cdf_.begin(), cdf_.end(), at) - cdf_.begin());
    sum += share_(static_cast<uint32_t>(std::min(i, cdf_.size() - 1)), root * (1 - along), root * along);
  }
  return sum / double{kPoints};
}

double MeshLight::projected_area(const dvec3& direction) const {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis)
    sum +=
        direction[axis] * direction[axis] * projected_[static_cast<size_t>(2 * axis + (direction[axis] > 0 ? 1 : 0))];
  return sum;
}

LightSample MeshLight::sample(const dvec3& p, const dvec2& u) const {
  const size_t i =
      std::min(static_cast<size_t>(std::upper_bound(cdf_.begin(), cdf_.end(), u.x) - cdf_.begin()), cdf_.size() - 1);
  const double before = i > 0 ? cdf_[i - 1] : 0.0;
  const double within = std::clamp((u.x - before) / (cdf_[i] - before), 0.0, 1.0), root = std::sqrt(within);
  const auto [a, b, c] = mesh_->corners(i);
  const dvec3 at = a * (1.0 - root) + b * (root * (1.0 - u.y)) + c * (root * u.y);
  const dvec3 to = at - p;
  const double distance = glm::length(to);
  if (!(distance > 0)) return {};
  const dvec3 wi = to / distance;
  const double cos_theta = glm::dot(wi, mesh_->normal(i));
  if (cos_theta == 0) return {};
  const bool shines = two_sided_ || cos_theta < 0;
  dvec3 radiance = shines ? radiance_ : dvec3(0);
  if (shines && share_) radiance *= share_(static_cast<uint32_t>(i), root * (1.0 - u.y), root * u.y);
  return {wi, radiance, pdf(distance, cos_theta), distance, false};
}

double MeshLight::importance(const dvec3& p) const {
  const double d = std::max(glm::distance(p, centre_), extent_);
  return luminance(mean_) * area_ / (d * d);
}

}  // namespace brume
