#include "render/guides/sky_cells.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

namespace brume {
namespace {

constexpr int kAround = 48, kUp = 24;
constexpr int kInside = 8;  // directions across a cell

}  // namespace

SkyCells::SkyCells(const SkyParts& sky) : constant_(sky.constant()) {
  if (constant_) {
    cells_.assign(1, sky.radiance(dvec3(0, 0, 1)));
    return;
  }
  for (int v = 0; v < kUp; ++v)
    for (int u = 0; u < kAround; ++u) {
      dvec3 sum(0);
      for (int i = 0; i < kInside * kInside; ++i) {
        const double z = 2 * (v + (i / kInside + 0.5) / kInside) / kUp - 1, r = std::sqrt(1 - z * z);
        const SinCos phi = portable_sincos_2pi((u + (i % kInside + 0.5) / kInside) / kAround);
        sum += sky.radiance({r * phi.cos, r * phi.sin, z});
      }
      cells_.push_back(sum / static_cast<double>(kInside * kInside));
    }
}

dvec3 SkyCells::operator()(const dvec3& d) const {
  if (constant_) return cells_[0];
  double turn = std::atan2(d.y, d.x) / (2 * kPi);
  turn -= std::floor(turn);
  const int u = std::clamp(static_cast<int>(turn * kAround), 0, kAround - 1),
            v = std::clamp(static_cast<int>(0.5 * (d.z + 1) * kUp), 0, kUp - 1);
  return cells_[static_cast<size_t>(v * kAround + u)];
}

}  // namespace brume
