#include "volume/procedural.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "base/rng.h"

namespace brume {
namespace {

/// Gradient noise in about [-1, 1]. Source: Perlin 2002, Improving Noise.
class Noise {
 public:
  explicit Noise(uint64_t seed) : seed_(mix64(seed)) {}

  /// The slopes at the corners of the cube that was looked up last: neighbouring points share them.
  struct Cube {
    uint64_t seed = 0;
    dvec3 base{0};
    std::array<dvec3, 8> slopes;
    bool known = false;
  };

  double operator()(const dvec3& p, Cube& cube) const {
    const dvec3 base = glm::floor(p), f = p - base;
    if (!cube.known || cube.seed != seed_ || cube.base != base) {
      cube = {seed_, base, {}, true};
      for (int k = 0; k < 8; ++k) cube.slopes[static_cast<size_t>(k)] = slope(base + dvec3(k & 1, k >> 1 & 1, k >> 2));
    }
    const dvec3 u = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    double sum = 0;
    for (int k = 0; k < 8; ++k) {
      const dvec3 o(k & 1, k >> 1 & 1, k >> 2);
      const double w = (o.x > 0 ? u.x : 1 - u.x) * (o.y > 0 ? u.y : 1 - u.y) * (o.z > 0 ? u.z : 1 - u.z);
      sum += w * glm::dot(cube.slopes[static_cast<size_t>(k)], f - o);
    }
    return sum;
  }
  double fractal(dvec3 p, int octaves, double gain = 0.5) const {
    return fractal(p, octaves, gain, [](double, double) { return false; });
  }
  /// @param enough  (sum, rest): whether to stop at a sum of octaves from which that of all differs by `rest` at
  ///                most
  template <class Enough>
  double fractal(dvec3 p, int octaves, double gain, const Enough& enough) const {
    constexpr double kBound = 1.5;  // of an octave: three components of slopes, half a cube away
    static thread_local std::array<Cube, 8> cubes;
    double sum = 0, amplitude = 1, rest = 0;
    for (int i = 0; i < octaves; ++i, amplitude *= gain) rest += kBound * amplitude;
    amplitude = 1;
    for (int i = 0; i < octaves; ++i, amplitude *= gain, p = p * 2.03 + 17.0) {
      sum += amplitude * (*this)(p, cubes[static_cast<size_t>(i)]);
      rest -= kBound * amplitude;
      if (enough(sum, rest)) break;
    }
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
  // Signed distance to the union of the spheres, positive inside, and what noise makes of it.
  const auto inside_of = [puffs](const dvec3& p) {
    double inside = -1e9;
    for (const Puff& puff : puffs) inside = std::max(inside, puff.radius - glm::distance(p, puff.centre));
    return inside;
  };
  constexpr double kRough = 0.16, kFarthest = 0.15, kRim = 0.06;
  const auto density = [inside_of, voxel, noise = Noise(seed)](const ivec3& v) {
    const dvec3 p = dvec3(v) * voxel;
    const double smoothly = inside_of(p);
    if (smoothly < -kFarthest) return 0.0f;
    // Deep inside and far outside the small octaves change nothing.
    const auto decided = [&](double sum, double rest) {
      const double so_far = smoothly + kRough * sum, most = kRough * rest + 1e-6;
      return so_far + most < 0 || so_far - most > kRim;
    };
    const double inside = smoothly + kRough * noise.fractal(p * 3.0, 6, 0.55, decided);
    return static_cast<float>(smooth(0.0, kRim, inside) * smooth(-0.36, -0.28, p.z));
  };
  const auto is_zero = [inside_of, voxel](const VoxelBox& box) {
    const dvec3 lo = dvec3(box.lo) * voxel, hi = dvec3(box.hi) * voxel;
    return inside_of(0.5 * (lo + hi)) + 0.5 * glm::distance(lo, hi) + 1e-6 < -kFarthest;
  };
  return {{{-half, -half, -high}, {half, half, high}}, voxel, density, is_zero};
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
  return {{{-wide, -wide, -half}, {wide, wide, half}}, voxel, density, {}};
}

}  // namespace brume
