#include "render/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "image/picture_io.h"

namespace brume {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

// A unit vector around an axis: 1 - cos of its angle uniform in [0, one_minus_cos].
dvec3 sample_cone(const dvec3& axis, double one_minus_cos, const dvec2& u) {
  const double h = u.x * one_minus_cos, s = std::sqrt(std::max(0.0, h * (2.0 - h)));
  const SinCos phi = portable_sincos_2pi(u.y);
  return glm::normalize(Frame(axis).to_world({s * phi.cos, s * phi.sin, 1.0 - h}));
}

}  // namespace

Sun::Sun(const LightSettings& s)
    : axis_(glm::normalize(s.direction)),
      irradiance_(s.irradiance),
      delta_(s.angular_diameter == 0),
      visible_(s.visible_to_camera) {
  const double radius = 0.5 * s.angular_diameter * kPi / 180.0, half = std::sin(0.5 * radius);
  one_minus_cos_ = 2.0 * half * half;
  // The disc's projected solid angle is pi sin^2: then a facing plane gets exactly the irradiance asked for.
  if (!delta_) radiance_ = irradiance_ / (kPi * std::sin(radius) * std::sin(radius));
}

LightSample Sun::sample(const dvec2& u) const {
  if (delta_) return {axis_, irradiance_, 1.0, kFar, true};
  return {sample_cone(axis_, one_minus_cos_, u), radiance_, pdf(), kFar, false};
}

SphereLight::SphereLight(const LightSettings& s, const dvec3& world_shift)
    : centre_(s.position - world_shift), radiance_(s.radiance), radius_(s.radius), visible_(s.visible_to_camera) {}

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

Environment::Environment(const EnvironmentSettings& s)
    : radiance_(s.radiance), mean_(s.radiance), visible_(s.visible_to_camera) {
  if (s.file.empty()) return;
  Layers picture;
  const std::string name = s.file.string();
  if (name.ends_with(".hdr") || name.ends_with(".pic"))
    picture = read_hdr(s.file);
  else
    picture = read_exr(s.file, [](const std::string& c) { return c == "R" || c == "G" || c == "B"; });
  if (!picture.has(layer::beauty))
    throw InputError(fmt::format("{}: has no channels R, G, B; expected a lat-long picture", name));
  width_ = picture.width(), height_ = picture.height();
  const auto rgb = picture.rgb(layer::beauty);
  picture_.resize(static_cast<size_t>(width_) * height_);
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      vec3& texel = picture_[static_cast<size_t>(y) * width_ + x];
      for (int c = 0; c < 3; ++c) {
        const float v = (*rgb[static_cast<size_t>(c)])(x, y);
        if (!std::isfinite(v) || v < 0)
          throw InputError(
              fmt::format("{}: texel ({}, {}) is {}; expected finite radiance, not negative", name, x, y, v));
        texel[c] = static_cast<float>(v * s.radiance[c]);
      }
    }

  if (!(glm::length(s.up) > 0)) throw InputError("[environment] up is zero; expected a direction");
  const dvec3 up = glm::normalize(s.up);
  // The picture's middle faces +y where up is z, and -z where up is y, as tools with those axes expect.
  const dvec3 reference = std::abs(up.z) > 0.5 ? dvec3(0, 1, 0) : dvec3(0, 0, -1);
  const dvec3 right = glm::normalize(glm::cross(reference, up)), forward = glm::cross(up, right);
  picture_from_world_ = glm::transpose(dmat3(right, forward, up));
  rotation_ = s.rotation / 360.0;

  // Texels weighted by the largest neighbour, because the look-up is bilinear and sampling should not miss its slopes.
  cdf_.resize(picture_.size());
  row_cdf_.resize(static_cast<size_t>(height_));
  double total = 0;
  mean_ = dvec3(0);
  double solid_angle = 0;
  for (int y = 0; y < height_; ++y) {
    const double band = std::cos(kPi * y / height_) - std::cos(kPi * (y + 1) / height_);
    double row = 0;
    for (int x = 0; x < width_; ++x) {
      double weight = 0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const int ny = std::clamp(y + dy, 0, height_ - 1), nx = (x + dx + width_) % width_;
          weight = std::max(weight, static_cast<double>(luminance(picture_[static_cast<size_t>(ny) * width_ + nx])));
        }
      row += weight;
      cdf_[static_cast<size_t>(y) * width_ + x] = row;
      mean_ += dvec3(picture_[static_cast<size_t>(y) * width_ + x]) * band;
      solid_angle += band;
    }
    for (int x = 0; x < width_; ++x) {
      double& value = cdf_[static_cast<size_t>(y) * width_ + x];
      value = row > 0 ? value / row : (x + 1.0) / width_;
    }
    total += row * band;
    row_cdf_[static_cast<size_t>(y)] = total;
  }
  mean_ /= solid_angle;
  for (double& value : row_cdf_) value = total > 0 ? value / total : 1.0;
  if (!(total > 0)) {
    picture_.clear();  // a black picture lights nothing
    radiance_ = mean_ = dvec3(0);
  }
}

dvec2 Environment::to_picture(const dvec3& d) const {
  const dvec3 p = picture_from_world_ * d;
  double u = 0.5 + std::atan2(p.x, p.y) / (2.0 * kPi) + rotation_;
  u -= std::floor(u);
  return {std::min(u, 1.0 - 1e-16), std::acos(std::clamp(p.z, -1.0, 1.0)) / kPi};
}

dvec3 Environment::from_picture(const dvec2& uv) const {
  double u = uv.x - 0.5 - rotation_;
  u -= std::floor(u);
  const SinCos theta = portable_sincos_2pi(0.5 * uv.y), phi = portable_sincos_2pi(u);
  return glm::transpose(picture_from_world_) * dvec3(theta.sin * phi.sin, theta.sin * phi.cos, theta.cos);
}

dvec3 Environment::radiance(const dvec3& d) const {
  if (picture_.empty()) return radiance_;
  const dvec2 uv = to_picture(d);
  const double x = uv.x * width_ - 0.5, y = std::clamp(uv.y * height_ - 0.5, 0.0, height_ - 1.0);
  const double fx = x - std::floor(x), fy = y - std::floor(y);
  const int x0 = (static_cast<int>(std::floor(x)) + width_) % width_, x1 = (x0 + 1) % width_;
  const int y0 = static_cast<int>(y), y1 = std::min(y0 + 1, height_ - 1);
  const auto texel = [&](int tx, int ty) { return dvec3(picture_[static_cast<size_t>(ty) * width_ + tx]); };
  return (texel(x0, y0) * (1 - fx) + texel(x1, y0) * fx) * (1 - fy) +
         (texel(x0, y1) * (1 - fx) + texel(x1, y1) * fx) * fy;
}

double Environment::pdf(const dvec3& d) const {
  if (picture_.empty()) return 1.0 / (4.0 * kPi);
  const dvec2 uv = to_picture(d);
  const int x = std::min(static_cast<int>(uv.x * width_), width_ - 1),
            y = std::min(static_cast<int>(uv.y * height_), height_ - 1);
  const double* row = &cdf_[static_cast<size_t>(y) * width_];
  const double p_row = row_cdf_[static_cast<size_t>(y)] - (y > 0 ? row_cdf_[static_cast<size_t>(y) - 1] : 0.0);
  const double p_texel = row[x] - (x > 0 ? row[x - 1] : 0.0);
  const double band = std::cos(kPi * y / height_) - std::cos(kPi * (y + 1) / height_);
  return p_row * p_texel * width_ / (2.0 * kPi * band);
}

LightSample Environment::sample(const dvec2& u) const {
  if (picture_.empty()) {
    const double z = 1.0 - 2.0 * u.x, r = std::sqrt(std::max(0.0, (1.0 - z) * (1.0 + z)));
    const SinCos phi = portable_sincos_2pi(u.y);
    return {{r * phi.cos, r * phi.sin, z}, radiance_, 1.0 / (4.0 * kPi), kFar, false};
  }
  const auto pick = [](const double* begin, int count, double xi, double& within) {
    const int i = std::min(static_cast<int>(std::upper_bound(begin, begin + count, xi) - begin), count - 1);
    const double before = i > 0 ? begin[i - 1] : 0.0;
    within = std::clamp((xi - before) / (begin[i] - before), 0.0, 1.0 - 1e-12);
    return i;
  };
  double fy, fx;
  const int y = pick(row_cdf_.data(), height_, u.y, fy);
  const int x = pick(&cdf_[static_cast<size_t>(y) * width_], width_, u.x, fx);
  // Uniform in solid angle within the texel: cos theta is linear.
  const double top = std::cos(kPi * y / height_), bottom = std::cos(kPi * (y + 1) / height_);
  const double v = std::acos(std::clamp(top + fy * (bottom - top), -1.0, 1.0)) / kPi;
  const dvec3 d = glm::normalize(from_picture({(x + fx) / width_, v}));
  return {d, radiance(d), pdf(d), kFar, false};
}

Lights::Lights(const Scene& scene, const Medium::Sphere& near, const dvec3& world_shift)
    : environment(scene.environment) {
  for (const LightSettings& light : scene.lights) {
    if (light.type == "sun")
      suns.emplace_back(light);
    else
      spheres.emplace_back(light, world_shift);
  }
  sun_share_.assign(suns.size(), 0.0);
  sphere_share_.assign(spheres.size(), 0.0);
  const std::string& mode = scene.render.light_sampling;
  if (mode == "none") return;

  double total = 0;
  const auto add = [&](double power, int kind, size_t index) {
    if (!(power > 0)) return;
    total += power;
    choice_.push_back({total, kind, index});
  };
  // Irradiance-like power at the medium; a light inside it is as strong as at its own surface.
  if (!environment.constant() || mode == "all") add(kPi * luminance(environment.mean_radiance()), 0, 0);
  for (size_t i = 0; i < suns.size(); ++i) add(luminance(suns[i].irradiance()), 1, i);
  for (size_t i = 0; i < spheres.size(); ++i) {
    const double d = std::max(glm::distance(spheres[i].centre(), near.centre) - near.radius, spheres[i].radius());
    add(kPi * luminance(spheres[i].radiance()) * spheres[i].radius() * spheres[i].radius() / (d * d), 2, i);
  }
  double before = 0;
  for (Choice& c : choice_) {
    c.end /= total;
    (c.kind == 0 ? environment_share_ : c.kind == 1 ? sun_share_[c.index] : sphere_share_[c.index]) = c.end - before;
    before = c.end;
  }
  if (!choice_.empty()) choice_.back().end = 1.0;
}

LightSample Lights::sample(const dvec3& p, double choice, const dvec2& u) const {
  size_t i = 0;
  while (i + 1 < choice_.size() && choice >= choice_[i].end) ++i;
  const Choice& c = choice_[i];
  LightSample s = c.kind == 0   ? environment.sample(u)
                  : c.kind == 1 ? suns[c.index].sample(u)
                                : spheres[c.index].sample(p, u);
  s.pdf *= c.kind == 0 ? environment_share_ : c.kind == 1 ? sun_share_[c.index] : sphere_share_[c.index];
  return s;
}

}  // namespace brume
