#include "volume/detail_flow.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "base/parallel_for.h"
#include "volume/medium.h"

namespace brume {
namespace {

constexpr int kFinest = 2, kCoarsest = BrickGrid::kCell;  // voxels between points
constexpr double kShare = 1.0 / 20, kAlways = 4 << 20;    // of the density's memory, or so many bytes

ivec3 points_along(const BrickGrid& density, int spacing) {
  return (density.cells() * density.cell_size() + (spacing - 1)) / spacing + 1;
}
double size_of(const ivec3& count) {
  return static_cast<double>(sizeof(float)) * count.x * count.y * count.z;
}

/// Whether a point lies in a cell that holds a density, or on its border.
bool near_density(const BrickGrid& density, const ivec3& p) {
  const ivec3 size(density.cell_size()), last = density.cells() - 1;
  const ivec3 lo = glm::clamp((p - 1) / size, ivec3(0), last), hi = glm::clamp(p / size, ivec3(0), last);
  for (int x = lo.x; x <= hi.x; ++x)
    for (int y = lo.y; y <= hi.y; ++y)
      for (int z = lo.z; z <= hi.z; ++z)
        if (density.cell({x, y, z}).brick != 0) return true;
  return false;
}

}  // namespace

DetailFlow::DetailFlow(const Displacement& velocity, const BrickGrid& density, const Task& task) : spacing(kFinest) {
  const double most = std::max(kAlways, kShare * static_cast<double>(density.bytes()));
  while (spacing < kCoarsest && size_of(points_along(density, spacing)) > most) spacing *= 2;
  count = points_along(density, spacing);
  const size_t plane = static_cast<size_t>(count.y) * count.z;
  std::vector<std::array<float, 3>> found(plane * count.x);
  std::vector<dvec3> largest(static_cast<size_t>(count.x), dvec3(0));
  const Task silent{task.threads, {}, task.cancel};
  parallel_for(count.x, silent, [&](int x) {
    for (int y = 0; y < count.y; ++y)
      for (int z = 0; z < count.z; ++z) {
        const ivec3 p = spacing * ivec3(x, y, z);
        if (!near_density(density, p)) continue;
        const dvec3 v = velocity.field.lookup(dvec3(p) + velocity.origin_shift);
        for (int a = 0; a < 3; ++a)
          found[x * plane + static_cast<size_t>(y) * count.z + z][static_cast<size_t>(a)] = static_cast<float>(v[a]);
        largest[static_cast<size_t>(x)] = glm::max(largest[static_cast<size_t>(x)], glm::abs(v));
      }
  });
  for (const dvec3& v : largest) quantum = glm::max(quantum, v);
  if (quantum == dvec3(0)) return;
  quantum /= kRest - 1;
  points.resize(found.size());
  parallel_for(count.x, silent, [&](int x) {
    for (size_t i = x * plane; i < (x + 1) * plane; ++i) {
      uint32_t word = 0;
      for (int a = 0; a < 3; ++a) {
        const double steps = quantum[a] > 0 ? std::round(found[i][static_cast<size_t>(a)] / quantum[a]) : 0.0;
        word |= static_cast<uint32_t>(static_cast<int32_t>(kRest) + static_cast<int32_t>(steps)) << kBits * a;
      }
      points[i] = std::bit_cast<float>(word);
    }
  });
}

dvec3 DetailFlow::lookup(const dvec3& local) const {
  const dvec3 at = glm::clamp(local / static_cast<double>(spacing), dvec3(0), dvec3(count - 1));
  const ivec3 low = glm::min(ivec3(at), count - 2);
  const dvec3 f = at - dvec3(low);
  dvec3 sum(0);
  for (int k = 0; k < 8; ++k) {
    const ivec3 step(k >> 2, k >> 1 & 1, k & 1), p = low + step;
    const auto word = std::bit_cast<uint32_t>(points[(static_cast<size_t>(p.x) * count.y + p.y) * count.z + p.z]);
    double share = 1;
    for (int a = 0; a < 3; ++a) share *= step[a] ? f[a] : 1 - f[a];
    for (int a = 0; a < 3; ++a)
      sum[a] += share * (static_cast<double>(word >> kBits * a & kMask) - static_cast<double>(kRest));
  }
  return sum * quantum;
}

}  // namespace brume
