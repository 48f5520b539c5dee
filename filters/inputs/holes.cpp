#include "filters/inputs/holes.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/vec.h"

namespace brume {
namespace {

/// The median of the finite pixels among the 3 x 3; not finite where there are none.
float median_of_finite_neighbours(const Plane& plane, int x, int y) {
  std::vector<float> values;
  for (int qy = std::max(0, y - 1); qy <= std::min(plane.height() - 1, y + 1); ++qy)
    for (int qx = std::max(0, x - 1); qx <= std::min(plane.width() - 1, x + 1); ++qx)
      if (std::isfinite(plane(qx, qy))) values.push_back(plane(qx, qy));
  if (values.empty()) return plane(x, y);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Plane without_holes(const Plane& plane, std::set<std::pair<int, int>>& bad) {
  Plane result = plane;
  std::vector<ivec2> rim;
  size_t holes = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x)
      if (!std::isfinite(plane(x, y))) {
        ++holes;
        bad.insert({x, y});
        if (std::isfinite(median_of_finite_neighbours(plane, x, y))) rim.emplace_back(x, y);
      }
  if (holes == static_cast<size_t>(plane.width()) * static_cast<size_t>(plane.height()))
    return Plane(plane.width(), plane.height());
  while (!rim.empty()) {
    // Every pixel of a rim is made from what was there before it.
    std::vector<float> values;
    for (const ivec2& p : rim) values.push_back(median_of_finite_neighbours(result, p.x, p.y));
    for (size_t i = 0; i < rim.size(); ++i) result(rim[i].x, rim[i].y) = values[i];
    std::set<std::pair<int, int>> next;
    for (const ivec2& p : rim)
      for (int y = std::max(0, p.y - 1); y <= std::min(plane.height() - 1, p.y + 1); ++y)
        for (int x = std::max(0, p.x - 1); x <= std::min(plane.width() - 1, p.x + 1); ++x)
          if (!std::isfinite(result(x, y))) next.insert({x, y});
    rim.clear();
    for (const auto& [x, y] : next) rim.emplace_back(x, y);
  }
  return result;
}

}  // namespace brume
