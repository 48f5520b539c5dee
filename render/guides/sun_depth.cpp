#include "render/guides/sun_depth.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/parallel_for.h"
#include "render/guides/lane_media.h"

namespace brume {

namespace {
constexpr int kMostBetweenNodes = 4;  // samples, where nodes lie many voxels apart
}

SunDepth::SunDepth(const GuideMedia& media, GuideColour colour, const dvec3& towards, double spacing, size_t most_nodes,
                   const Task& task) {
  for (int a = 1; a < 3; ++a)
    if (std::abs(towards[a]) > std::abs(towards[axis_])) axis_ = a;
  u_ = (axis_ + 1) % 3;
  v_ = (axis_ + 2) % 3;
  slope_u_ = towards[u_] / towards[axis_];
  slope_v_ = towards[v_] / towards[axis_];
  // The box of the media in the sheared coordinates.
  dvec2 low(std::numeric_limits<double>::infinity()), high = -low;
  const dvec3 extent = media.hi() - media.lo();
  for (int k = 0; k < 8; ++k) {
    const dvec3 p = extent * dvec3(k & 1, k >> 1 & 1, k >> 2);
    const dvec2 q{p[u_] - p[axis_] * slope_u_, p[v_] - p[axis_] * slope_v_};
    low = glm::min(low, q);
    high = glm::max(high, q);
  }
  for (;;) {
    const dvec3 size{extent[axis_], high.x - low.x, high.y - low.y};
    n_ = ivec3(glm::ceil(size / spacing)) + 2;
    const double nodes = static_cast<double>(n_.x) * n_.y * n_.z;
    if (nodes <= static_cast<double>(most_nodes)) break;
    spacing *= std::max(1.02, std::cbrt(nodes / static_cast<double>(most_nodes)));
  }
  inverse_ = 1 / spacing;
  origin_ = media.lo();
  origin_[u_] += low.x;
  origin_[v_] += low.y;
  const auto roots = std::make_shared<Roots>(static_cast<size_t>(n_.x) * n_.y * n_.z);
  roots_ = roots;

  const bool upwards = towards[axis_] > 0;
  const double length = spacing / std::abs(towards[axis_]);  // between nodes of a column [world units]
  int inner = std::max(1, static_cast<int>(std::lround(length / media.voxel())));
  if (media.instances()) inner = std::min(inner, kMostBetweenNodes);
  // The columns' nodes farthest from the light, and the next ones towards it.
  const int first = upwards ? 0 : n_.x - 1, step = upwards ? 1 : -1;
  const LaneMedia lanes(media, colour);
  constexpr int kMost = LaneMedia::Lines::kMost;
  parallel_for(n_.y, quiet(task), [&](int u) {
    std::vector<float> depths(static_cast<size_t>(n_.x) * kMost);
    for (int v = 0; v < n_.z; v += kMost) {
      dvec3 start = origin_, across(0);
      const double along = first * spacing;
      start[axis_] += along;
      start[u_] += u * spacing + along * slope_u_;
      start[v_] += v * spacing + along * slope_v_;
      across[v_] = spacing;
      lanes.depths({start, across, towards, length, n_.x, inner}, depths.data());
      for (int lane = 0; lane < std::min(kMost, n_.z - v); ++lane) {
        uint16_t* const column = roots->data() + (static_cast<size_t>(u) * n_.z + v + lane) * n_.x;
        for (int k = 0; k < n_.x; ++k)
          if (const float depth = depths[static_cast<size_t>(k * kMost + lane)]; depth > 0)
            column[first + step * k] = root_of(depth);
      }
    }
  });
}

float SunDepth::at_place(const dvec3& q) const {
  const auto clamped = [](double x, int n, int& i) {
    const double c = std::clamp(x, 0.0, static_cast<double>(n - 1));
    i = std::min(static_cast<int>(c), n - 2);
    return static_cast<float>(c - i);
  };
  ivec3 i{0};
  const float fk = clamped(q.x, n_.x, i.x), fu = clamped(q.y, n_.y, i.y), fv = clamped(q.z, n_.z, i.z);
  const size_t next_v = static_cast<size_t>(n_.x), next_u = next_v * n_.z;
  const uint16_t* const d = roots_->data() + (static_cast<size_t>(i.y) * n_.z + i.z) * n_.x + i.x;
  const auto along = [&](size_t offset) {
    const float first = depth_of(d[offset]);
    return first + fk * (depth_of(d[offset + 1]) - first);
  };
  const float a = along(0), b = along(next_v), c = along(next_u), e = along(next_u + next_v);
  const float near = a + fv * (b - a), far = c + fv * (e - c);
  return near + fu * (far - near);
}

}  // namespace brume
