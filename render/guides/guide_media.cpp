#include "render/guides/guide_media.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace brume {
namespace {

/// By Simpson's rule in the cosine, finer towards the forward peak.
double mean_cosine_of(const PhaseFunction& phase) {
  if (phase.is_henyey_greenstein()) return phase.first.g;
  constexpr int kSteps = 2000;
  double sum = 0, norm = 0;
  for (int i = 0; i < kSteps; ++i) {
    // 1 - cos = 2 s^4 for s in [0, 1]
    const double s = (i + 0.5) / kSteps, c = 1 - 2 * s * s * s * s, weight = 8 * s * s * s * phase.value(c);
    sum += weight * c;
    norm += weight;
  }
  return sum / norm;
}

void enclose(const Medium& medium, dvec3& lo, dvec3& hi) {
  const auto [a, b] = medium.support();
  for (int k = 0; k < 8; ++k) {
    const dvec3 p = medium.to_world({k & 1 ? b.x : a.x, k & 2 ? b.y : a.y, k & 4 ? b.z : a.z});
    lo = glm::min(lo, p);
    hi = glm::max(hi, p);
  }
}

void add_intervals(const Medium& medium, const Ray& ray, double t_max, std::vector<std::pair<double, double>>& parts) {
  const Ray local = medium.to_local(ray);
  if (medium.homogeneous()) {
    const auto [t0, t1] = medium.homogeneous()->intersect(local);
    if (std::max(t0, 0.0) < std::min(t1, t_max)) parts.emplace_back(std::max(t0, 0.0), std::min(t1, t_max));
    return;
  }
  MajorantWalk walk = medium.walk(local, 0, t_max);
  MajorantWalk::Segment segment;
  while (walk.next(segment)) {
    if (!parts.empty() && segment.t0 <= parts.back().second * (1 + 1e-9))
      parts.back().second = std::max(parts.back().second, segment.t1);
    else
      parts.emplace_back(segment.t0, segment.t1);
  }
}

/// The interpolated density and its gradient, which jumps where voxels meet; local space.
double density_and_gradient(const Medium& medium, const dvec3& p, dvec3& gradient) {
  if (medium.homogeneous()) return medium.density(p);
  if (medium.displacement()) {
    for (int a = 0; a < 3; ++a) {
      dvec3 step(0);
      step[a] = 0.5;
      gradient[a] = medium.density(p + step) - medium.density(p - step);
    }
    return medium.density(p);
  }
  const BrickGrid& grid = medium.bricks();
  if (glm::any(glm::lessThanEqual(p, grid.support_lo())) || glm::any(glm::greaterThanEqual(p, grid.support_hi())))
    return 0;
  const ivec3 c = ivec3(p) / grid.cell_size();
  const BrickGrid::Cell& cell = grid.cell(c);
  if (cell.brick == 0) return 0;
  const dvec3 q = p - dvec3(c * grid.cell_size());
  const ivec3 i = glm::clamp(ivec3(q), ivec3(0), ivec3(grid.cell_size() - 1));
  const vec3 f(q - dvec3(i));
  const int Y = grid.stored(), X = Y * Y;
  const float* const b = grid.brick(cell) + i.x * X + i.y * Y + i.z;
  const auto lerp = [](float a, float d, float t) { return a + t * (d - a); };
  // Edges along z, then faces, then the cube: values and their differences.
  const float z00 = lerp(b[0], b[1], f.z), z01 = lerp(b[Y], b[Y + 1], f.z), z10 = lerp(b[X], b[X + 1], f.z),
              z11 = lerp(b[X + Y], b[X + Y + 1], f.z);
  const float dz0 = lerp(b[1] - b[0], b[Y + 1] - b[Y], f.y), dz1 = lerp(b[X + 1] - b[X], b[X + Y + 1] - b[X + Y], f.y);
  const float y0 = lerp(z00, z01, f.y), y1 = lerp(z10, z11, f.y);
  gradient = {y1 - y0, lerp(z01 - z00, z11 - z10, f.x), lerp(dz0, dz1, f.x)};
  return lerp(y0, y1, f.x);
}

}  // namespace

double in_colour(const dvec3& rgb, GuideColour colour) {
  return colour == kGrey ? (rgb.x + rgb.y + rgb.z) / 3 : rgb[colour];
}

GuideMedia::GuideMedia(std::span<const Medium> media, std::span<const EmissionField> emissions, double time) {
  lo_ = dvec3(std::numeric_limits<double>::infinity());
  hi_ = -lo_;
  voxel_ = std::numeric_limits<double>::infinity();
  const auto take = [&](const Medium& m) {
    enclose(m, lo_, hi_);
    if (!m.homogeneous()) voxel_ = std::min(voxel_, m.voxel_size());
  };
  for (const Medium& m : media) {
    media_.push_back(m.at_time(time));
    mean_cosine_.push_back(mean_cosine_of(m.phase()));
    coloured_ = coloured_ || m.chromatic() || m.coloured();
    take(media_.back());
  }
  // Several grey media of unlike tints: their mixture changes its colour from place to place.
  for (const Medium& m : media_) coloured_ = coloured_ || glm::distance(m.albedo(), media_[0].albedo()) > 1e-9;
  for (const EmissionField& e : emissions) {
    emissions_.push_back(e.at_time(time));
    take(emissions_.back().shape());
  }
  if (!std::isfinite(voxel_)) voxel_ = max_component(hi_ - lo_) / 128;
}

GuideMedia::Point GuideMedia::at(const dvec3& world, GuideColour colour, dvec3* gradient) const {
  Point point;
  if (gradient) *gradient = dvec3(0);
  double scattered = 0, forward = 0;
  for (size_t i = 0; i < media_.size(); ++i) {
    const Medium& m = media_[i];
    const dvec3 local = m.to_local(world);
    dvec3 slope(0);
    const double density = gradient ? density_and_gradient(m, local, slope) : m.density(local);
    if (!(density > 0)) continue;
    const double per_density = in_colour(m.coefficients().sigma_t, colour), sigma = density * per_density;
    if (gradient) *gradient += per_density * m.gradient_to_world(slope);
    const double sigma_s = sigma * in_colour(m.albedo(world), colour);
    point.sigma_t += sigma;
    scattered += sigma_s;
    forward += sigma_s * mean_cosine_[i];
    point.density = std::max(point.density, density / m.maximum_density());
  }
  if (point.sigma_t > 0) point.albedo = scattered / point.sigma_t;
  if (scattered > 0) point.g = forward / scattered;
  return point;
}

dvec3 GuideMedia::glow(const dvec3& world) const {
  dvec3 sum(0);
  for (const EmissionField& field : emissions_) sum += field.coefficient(world);
  return sum;
}

void GuideMedia::intervals(const Ray& ray, double t_max, std::vector<std::pair<double, double>>& parts) const {
  parts.clear();
  for (const Medium& m : media_) add_intervals(m, ray, t_max, parts);
  for (const EmissionField& e : emissions_) add_intervals(e.shape(), ray, t_max, parts);
  if (media_.size() + emissions_.size() < 2) return;
  std::sort(parts.begin(), parts.end());
  size_t kept = 0;
  for (const auto& part : parts) {
    if (kept > 0 && part.first <= parts[kept - 1].second)
      parts[kept - 1].second = std::max(parts[kept - 1].second, part.second);
    else
      parts[kept++] = part;
  }
  parts.resize(kept);
}

}  // namespace brume
