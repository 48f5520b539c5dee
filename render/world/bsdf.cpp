#include "render/world/bsdf.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

// Microfacets after Walter, Marschner, Li, Torrance 2007 (GGX, reflection and refraction), visible normals sampled
// after Heitz 2018, Fresnel of conductors after Schlick 1994. What a coat lets through to its base and out again after
// Kelemen and Szirmay-Kalos 2001: (1 - E(o)) (1 - E(i)) / (1 - mean E), which is reciprocal and loses nothing.

namespace brume {
namespace {

double square(double x) {
  return x * x;
}

double ggx_d(const dvec3& m, double a) {
  const double e = square(m.x / a) + square(m.y / a) + square(m.z);
  return 1.0 / (kPi * a * a * e * e);
}

double lambda(const dvec3& w, double a) {
  const double tan2 = (square(w.x) + square(w.y)) / square(w.z);
  return 0.5 * (std::sqrt(1.0 + a * a * tan2) - 1.0);
}

double g1(const dvec3& w, double a) {
  return 1.0 / (1.0 + lambda(w, a));
}

// The density of visible normals, seen from w (w.z > 0).
double visible_d(const dvec3& w, const dvec3& m, double a) {
  return g1(w, a) * std::max(0.0, glm::dot(w, m)) * ggx_d(m, a) / w.z;
}

dvec3 sample_visible_normal(const dvec3& w, double a, double u1, double u2) {
  const dvec3 v = glm::normalize(dvec3(a * w.x, a * w.y, w.z));
  const double length2 = v.x * v.x + v.y * v.y;
  const dvec3 t1 = length2 > 0 ? dvec3(-v.y, v.x, 0) / std::sqrt(length2) : dvec3(1, 0, 0), t2 = glm::cross(v, t1);
  const double r = std::sqrt(u1);
  const SinCos phi = portable_sincos_2pi(u2);
  const double x = r * phi.cos, s = 0.5 * (1.0 + v.z);
  const double y = (1.0 - s) * std::sqrt(std::max(0.0, 1.0 - x * x)) + s * r * phi.sin;
  const dvec3 n = x * t1 + y * t2 + std::sqrt(std::max(0.0, 1.0 - x * x - y * y)) * v;
  return glm::normalize(dvec3(a * n.x, a * n.y, std::max(1e-9, n.z)));
}

dvec3 schlick(const dvec3& f0, const dvec3& edge, double cos_theta) {
  const double x = 1.0 - std::clamp(cos_theta, 0.0, 1.0), x2 = x * x;
  return f0 + (edge - f0) * (x2 * x2 * x);
}

// The direction refracted at a normal m; false under total reflection. eta: transmitted over incident index.
bool refract(const dvec3& wo, const dvec3& m, double eta, dvec3& wi) {
  const double c = glm::dot(wo, m), sin2 = (1.0 - c * c) / (eta * eta);
  if (sin2 >= 1) return false;
  wi = -wo / eta + (c / eta - std::sqrt(1.0 - sin2)) * m;
  return true;
}

}  // namespace

double fresnel_dielectric(double cos_i, double eta) {
  const double sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
  if (sin2_t >= 1) return 1.0;
  const double cos_t = std::sqrt(1.0 - sin2_t);
  const double parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
  const double perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
  return 0.5 * (parallel * parallel + perpendicular * perpendicular);
}

CoatAlbedo::CoatAlbedo(double alpha, double ior) {
  constexpr int kSide = 32;
  const auto cosine = [](size_t i) { return std::max(1e-4, static_cast<double>(i * i) / (64 * 64)); };
  for (size_t i = 0; i < values_.size(); ++i) {
    const double c = cosine(i);
    const dvec3 wo(std::sqrt(1 - c * c), 0, c);
    double sum = 0;
    for (int k = 0; k < kSide * kSide; ++k) {
      const dvec3 m = sample_visible_normal(wo, alpha, (k % kSide + 0.5) / kSide, (k / kSide + 0.5) / kSide);
      const double co = glm::dot(wo, m);
      const dvec3 wi = 2.0 * co * m - wo;
      if (!(co > 0) || !(wi.z > 0)) continue;
      sum += fresnel_dielectric(co, ior) * (1.0 + lambda(wo, alpha)) / (1.0 + lambda(wo, alpha) + lambda(wi, alpha));
    }
    values_[i] = sum / (kSide * kSide);
  }
  // 2 E(c) c dc of the straight lines between.
  for (size_t i = 0; i + 1 < values_.size(); ++i) {
    const double a = static_cast<double>(i * i) / (64 * 64), b = static_cast<double>((i + 1) * (i + 1)) / (64 * 64);
    mean_ += (b - a) / 3 * (values_[i] * (2 * a + b) + values_[i + 1] * (a + 2 * b));
  }
}

double CoatAlbedo::at(double cos_theta) const {
  const double c = std::clamp(cos_theta, 0.0, 1.0);
  const size_t i = std::min<size_t>(static_cast<size_t>(64 * std::sqrt(c)), 63);
  const double a = static_cast<double>(i * i) / (64 * 64), b = static_cast<double>((i + 1) * (i + 1)) / (64 * 64);
  return values_[i] + (values_[i + 1] - values_[i]) * ((c - a) / (b - a));
}

/// What passes the coat twice, by way of a base that reflects all.
double Bsdf::base_share(double cos_o, double cos_i) const {
  return (1 - coat->at(cos_o)) * (1 - coat->at(cos_i)) / (1 - coat->mean());
}

/// Of sampling the coat.
double Bsdf::coat_chance(double cos_o) const {
  const double E = coat->at(cos_o), reflected = max_component(edge) * E, base = max_component(albedo) * (1 - E);
  return std::clamp(reflected / std::max(reflected + base, 1e-12), 0.1, 0.9);
}

Bsdf Bsdf::base_seen(double cos_o) const {
  return {Kind::kDiffuse, albedo * (1 - coat->at(cos_o))};
}

Bsdf Bsdf::gloss() const {
  return {Kind::kConductor, edge * fresnel_dielectric(1, ior), std::sqrt(alpha()), ior, edge};
}

Bsdf Bsdf::evened() const {
  return {Kind::kDiffuse, albedo * (1 - coat->mean()) + edge * coat->mean()};
}

dvec3 Bsdf::value(const dvec3& wo, const dvec3& wi, bool inside) const {
  const double a = alpha();
  if (kind == Kind::kDiffuse) return wi.z > 0 ? albedo * (wi.z / kPi) : passed * (-wi.z / kPi);
  if (a == 0 || wo.z <= 0) return dvec3(0);
  if (kind == Kind::kCoated) {
    if (!(wi.z > 0)) return dvec3(0);
    const dvec3 m = glm::normalize(wo + wi);
    const double shape = ggx_d(m, a) / ((1.0 + lambda(wo, a) + lambda(wi, a)) * 4.0 * wo.z);
    return edge * (fresnel_dielectric(glm::dot(wo, m), ior) * shape) + albedo * (base_share(wo.z, wi.z) * wi.z / kPi);
  }
  if (wi.z > 0) {
    const dvec3 sum = wo + wi;
    if (!(glm::length(sum) > 0)) return dvec3(0);
    const dvec3 m = glm::normalize(sum);
    const double shape = ggx_d(m, a) / ((1.0 + lambda(wo, a) + lambda(wi, a)) * 4.0 * wo.z);
    const double c = glm::dot(wo, m);
    if (kind == Kind::kConductor) return schlick(albedo, edge, c) * shape;
    return edge * (fresnel_dielectric(c, inside ? 1.0 / ior : ior) * shape);
  }
  if (kind != Kind::kDielectric || wi.z == 0) return dvec3(0);
  const double eta = inside ? 1.0 / ior : ior;
  dvec3 m = glm::normalize(wo + eta * wi);
  if (m.z < 0) m = -m;
  const double co = glm::dot(wo, m), ci = glm::dot(wi, m);
  if (co <= 0 || ci >= 0) return dvec3(0);
  const double f = fresnel_dielectric(co, eta), denominator = square(co + eta * ci);
  const dvec3 wi_up{wi.x, wi.y, -wi.z};
  // Radiance is not scaled by the index: the camera and the lights lie outside of the glass.
  const double shape =
      ggx_d(m, a) / (1.0 + lambda(wo, a) + lambda(wi_up, a)) * std::abs(co * ci) * eta * eta / (wo.z * denominator);
  return albedo * ((1.0 - f) * shape);
}

double Bsdf::pdf(const dvec3& wo, const dvec3& wi, bool inside) const {
  const double a = alpha();
  if (kind == Kind::kDiffuse) return (wi.z > 0 ? reflection_chance() : reflection_chance() - 1) * wi.z / kPi;
  if (a == 0 || wo.z <= 0) return 0;
  if (kind == Kind::kCoated) {
    if (!(wi.z > 0)) return 0;
    const dvec3 m = glm::normalize(wo + wi);
    const double chance = coat_chance(wo.z);
    return chance * visible_d(wo, m, a) / (4.0 * glm::dot(wo, m)) + (1 - chance) * wi.z / kPi;
  }
  if (wi.z > 0) {
    const dvec3 sum = wo + wi;
    if (!(glm::length(sum) > 0)) return 0;
    const dvec3 m = glm::normalize(sum);
    const double c = glm::dot(wo, m);
    if (!(c > 0)) return 0;
    const double reflected = visible_d(wo, m, a) / (4.0 * c);
    return kind == Kind::kConductor ? reflected : reflected * fresnel_dielectric(c, inside ? 1.0 / ior : ior);
  }
  if (kind != Kind::kDielectric || wi.z == 0) return 0;
  const double eta = inside ? 1.0 / ior : ior;
  dvec3 m = glm::normalize(wo + eta * wi);
  if (m.z < 0) m = -m;
  const double co = glm::dot(wo, m), ci = glm::dot(wi, m);
  if (co <= 0 || ci >= 0) return 0;
  return (1.0 - fresnel_dielectric(co, eta)) * visible_d(wo, m, a) * eta * eta * std::abs(ci) / square(co + eta * ci);
}

/// Probability that a diffuse surface's sample is reflected rather than transmitted.
double Bsdf::reflection_chance() const {
  const double through = max_component(passed);
  return through > 0 ? max_component(albedo) / (max_component(albedo) + through) : 1.0;
}

/// Both parts of a coated surface, in a direction of either. @return whether it carries anything
bool Bsdf::weigh(const dvec3& wo, Sample& out) const {
  out.pdf = pdf(wo, out.wi, false);
  out.weight = value(wo, out.wi, false) / out.pdf;
  return out.pdf > 0;
}

bool Bsdf::sample(const dvec3& wo, bool inside, const dvec3& u, Sample& out) const {
  out = {};
  if (!(wo.z > 0)) return false;
  const double a = alpha();
  if (kind == Kind::kDiffuse || (kind == Kind::kCoated && u.z >= coat_chance(wo.z))) {
    const double r = std::sqrt(u.x);
    const SinCos phi = portable_sincos_2pi(u.y);
    out.wi = {r * phi.cos, r * phi.sin, std::sqrt(std::max(0.0, 1.0 - u.x))};
    out.pdf = out.wi.z / kPi;
    out.weight = albedo;
    if (kind == Kind::kDiffuse && passed != dvec3(0)) {
      const double reflects = reflection_chance();
      out.transmitted = u.z >= reflects;
      out.weight = out.transmitted ? passed / (1 - reflects) : albedo / reflects;
      out.pdf *= out.transmitted ? 1 - reflects : reflects;
      if (out.transmitted) out.wi.z = -out.wi.z;
      return out.wi.z != 0;
    }
    return out.wi.z > 0 && (kind == Kind::kDiffuse || weigh(wo, out));
  }
  const dvec3 m = a == 0 ? dvec3(0, 0, 1) : sample_visible_normal(wo, a, u.x, u.y);
  const double c = glm::dot(wo, m);
  if (!(c > 0)) return false;
  const dvec3 reflected = 2.0 * c * m - wo;
  if (kind == Kind::kCoated) {
    out.wi = reflected;
    return out.wi.z > 0 && weigh(wo, out);
  }
  if (kind == Kind::kConductor) {
    out.wi = reflected;
    if (!(out.wi.z > 0)) return false;
    out.weight = schlick(albedo, edge, c);
    if (a > 0) out.weight *= (1.0 + lambda(wo, a)) / (1.0 + lambda(wo, a) + lambda(out.wi, a));
    out.pdf = pdf(wo, out.wi, inside);
    return true;
  }
  const double eta = inside ? 1.0 / ior : ior, f = fresnel_dielectric(c, eta);
  if (u.z < f) {
    out.wi = reflected;
    if (!(out.wi.z > 0)) return false;
    out.weight = edge;
  } else {
    if (!refract(wo, m, eta, out.wi) || !(out.wi.z < 0)) return false;
    out.transmitted = true;
    out.weight = albedo;
  }
  if (a > 0) {
    const dvec3 up{out.wi.x, out.wi.y, std::abs(out.wi.z)};
    out.weight *= (1.0 + lambda(wo, a)) / (1.0 + lambda(wo, a) + lambda(up, a));
    out.pdf = pdf(wo, out.wi, inside);
  }
  return true;
}

}  // namespace brume
