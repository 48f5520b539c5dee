#include "volume/procedural.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/rng.h"

namespace brume {
namespace {

/// Gradient noise in about [-1, 1]. Source: Perlin 2002, Improving Noise.
class Noise {
 public:
  explicit Noise(uint64_t seed) : seed_(mix64(seed)) {}

  double operator()(const dvec3& p) const {
    const dvec3 base = glm::floor(p), f = p - base;
    const dvec3 u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    double sum = 0;
    for (int k = 0; k < 8; ++k) {
      const dvec3 o(k & 1, k >> 1 & 1, k >> 2);
      const double w = (o.x > 0 ? u.x : 1 - u.x) * (o.y > 0 ? u.y : 1 - u.y) * (o.z > 0 ? u.z : 1 - u.z);
      sum += w * glm::dot(slope(base + o), f - o);
    }
    return sum;
  }
  double fractal(dvec3 p, int octaves, double gain = 0.5) const {
    double sum = 0, amplitude = 1;
    for (int i = 0; i < octaves; ++i, amplitude *= gain, p = p * 2.03 + 17.0) sum += amplitude * (*this)(p);
    return sum;
  }

 private:
  dvec3 slope(const dvec3& corner) const {
    uint64_t h = seed_;
    for (int a = 0; a < 3; ++a) h = hash_combine(h, static_cast<uint64_t>(static_cast<int64_t>(corner[a])));
    const auto component = [&](int shift) { return static_cast<double>(h >> shift & 0xffff) / 32767.5 - 1.0; };
    return dvec3(component(0), component(16), component(32));
  }
  uint64_t seed_;
};

double smooth(double lo, double hi, double x) {
  const double t = std::clamp((x - lo) / (hi - lo), 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

}  // namespace

ProceduralVolume procedural_cloud(int resolution, uint64_t seed) {
  struct Puff {
    dvec3 centre;
    double radius;
  };
  std::vector<Puff> puffs;
  Rng rng(hash_combine(seed, 1));
  for (int i = 0; i < 22; ++i) {
    const double angle = rng.uniform(), away = 0.55 * std::sqrt(rng.uniform());
    const SinCos a = portable_sincos_2pi(angle);
    const double height = (0.6 - away) * rng.uniform();
    puffs.push_back({{away * a.cos * 1.2, away * a.sin, -0.25 + height}, 0.14 + 0.16 * rng.uniform()});
  }
  const double voxel = 2.0 / resolution;
  const int half = resolution / 2, high = resolution * 3 / 8;
  const auto density = [puffs, voxel, noise = Noise(seed)](const ivec3& v) {
    const dvec3 p = dvec3(v) * voxel;
    double inside = -1e9;  // signed distance to the union, positive inside
    for (const Puff& puff : puffs) inside = std::max(inside, puff.radius - glm::distance(p, puff.centre));
    if (inside < -0.15) return 0.0f;
    inside += 0.16 * noise.fractal(p * 3.0, 6, 0.55);
    return static_cast<float>(smooth(0.0, 0.06, inside) * smooth(-0.36, -0.28, p.z));
  };
  return {{{-half, -half, -high}, {half, half, high}}, voxel, density};
}

ProceduralVolume procedural_smoke(int resolution, uint64_t seed) {
  const double voxel = 2.0 / resolution;
  const int half = resolution / 2, wide = resolution * 5 / 16;
  const auto density = [voxel, noise = Noise(seed)](const ivec3& v) {
    const dvec3 p = dvec3(v) * voxel;
    const double h = p.z + 1.0;  // height over the source, 0 .. 2
    const dvec3 drift(0, 0, -1.5);
    const dvec3 warp{noise.fractal(p * 2.0 + drift, 4), noise.fractal(p * 2.0 + drift + 31.0, 4),
                     noise.fractal(p * 2.0 + drift + 67.0, 4)};
    const dvec3 q = p + warp * (0.03 + 0.1 * h);
    const dvec2 axis{0.12 * std::sin(2.1 * h), 0.08 * std::cos(1.7 * h) - 0.08};
    const double away = glm::length(dvec2(q) - axis) / (0.07 + 0.14 * h);
    if (away > 1.6) return 0.0f;
    const double body = smooth(1.0, 0.2, away) * smooth(0.0, 0.08, h) * smooth(2.0, 1.5, h);
    const double torn = std::max(0.0, 0.6 + 0.9 * noise.fractal(q * 7.0 + drift, 5, 0.6));
    const double value = body * torn / (0.5 + h);
    return value < 1e-3 ? 0.0f : static_cast<float>(value);
  };
  return {{{-wide, -wide, -half}, {wide, wide, half}}, voxel, density};
}

}  // namespace brume
