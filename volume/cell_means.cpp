#include "volume/cell_means.h"

#include <algorithm>
#include <utility>

namespace brume {

void CellMeans::flood(const std::vector<ivec3>& cells, const std::function<std::optional<vec3>(const ivec3&)>& known,
                      const Task& task) {
  std::vector<ivec3> next;
  for (const ivec3& c : cells)
    each_around(c, [&](const ivec3& near) {
      const auto [mean, fresh] = means_.try_emplace(near);
      if (!fresh) return;
      mean->second = known(near);
      if (!mean->second) next.push_back(near);
    });
  std::vector<std::pair<ivec3, vec3>> layer;
  while (!next.empty()) {
    task.check();
    layer.clear();
    for (const ivec3& c : next) {
      vec3 sum(0);
      float weight = 0;
      each_around(c, [&](const ivec3& near) {
        const auto mean = means_.find(near);
        if (mean == means_.end() || !mean->second) return;
        const ivec3 step = near - c;
        const float w = 1.0f / static_cast<float>(step.x * step.x + step.y * step.y + step.z * step.z);
        sum += w * *mean->second;
        weight += w;
      });
      if (weight > 0) layer.emplace_back(c, sum / weight);
    }
    next.clear();
    for (const auto& [c, mean] : layer) means_[c] = mean;
    for (const auto& [c, mean] : layer)
      each_around(c, [&](const ivec3& near) {
        const auto unknown = means_.find(near);
        if (unknown != means_.end() && !unknown->second) next.push_back(near);
      });
    std::sort(next.begin(), next.end(), by_coordinates);
    next.erase(std::unique(next.begin(), next.end()), next.end());
  }
}

CellMeans::Around::Around(const CellMeans& means, const ivec3& c, int axis) : first_(c - 1) {
  for (int k = 0; k < 27; ++k) {
    const auto near = means.means_.find(first_ + ivec3(k / 9, k / 3 % 3, k % 3));
    if (near != means.means_.end() && near->second) means_[static_cast<size_t>(k)] = (*near->second)[axis];
  }
}

float CellMeans::Around::operator()(const ivec3& v) const {
  const dvec3 q = (dvec3(v) + 0.5) / static_cast<double>(BrickGrid::kCell) - 0.5;
  const ivec3 base(glm::floor(q));
  const vec3 f(q - dvec3(base));
  float sum = 0, weight = 0;
  for (int k = 0; k < 8; ++k) {
    const ivec3 o(k >> 2, k >> 1 & 1, k & 1), at = base + o - first_;
    const std::optional<float>& mean = means_[static_cast<size_t>((at.x * 3 + at.y) * 3 + at.z)];
    if (!mean) continue;
    const float w = (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z);
    sum += w * *mean;
    weight += w;
  }
  return weight > 0 ? sum / weight : 0.0f;
}

}  // namespace brume
