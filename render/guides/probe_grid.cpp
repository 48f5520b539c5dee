#include "render/guides/probe_grid.h"

#include "base/math.h"

namespace brume {

ProbeGrid::ProbeGrid(const dvec3& lo, const dvec3& hi, int across) {
  const dvec3 size = hi - lo;
  const double spacing = max_component(size) / across;
  n_ = glm::clamp(ivec3(glm::round(size / spacing)), ivec3(1), ivec3(across));
  spacing_ = size / dvec3(n_);
  lo_ = lo + 0.5 * spacing_;
}

dvec3 ProbeGrid::at(int probe) const {
  return lo_ + spacing_ * dvec3(probe / (n_.y * n_.z), probe / n_.z % n_.y, probe % n_.z);
}

ProbeGrid::Around ProbeGrid::around(const dvec3& world) const {
  const dvec3 p = glm::clamp((world - lo_) / spacing_, dvec3(0), dvec3(n_ - 1));
  const ivec3 i = glm::clamp(ivec3(p), ivec3(0), glm::max(n_ - 2, ivec3(0)));
  const dvec3 f = p - dvec3(i);
  Around found;
  for (int corner = 0; corner < 8; ++corner) {
    const ivec3 o(corner >> 2, corner >> 1 & 1, corner & 1), q = glm::min(i + o, n_ - 1);
    const auto k = static_cast<size_t>(corner);
    found.probe[k] = (q.x * n_.y + q.y) * n_.z + q.z;
    found.weight[k] = (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z);
  }
  return found;
}

}  // namespace brume
