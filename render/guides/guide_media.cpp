#include "render/guides/guide_media.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "render/guides/lane_media.h"
#include "render/guides/media_line.h"

namespace brume {
namespace {

constexpr int kSamplesPerVoxel = 2;      // of displaced densities, along each axis
constexpr double kMostResampled = 16e6;  // points
constexpr double kLayerVoxel = 0.25;     // of the scale height of a layer

/// By Simpson's rule in the cosine, finer towards the forward peak.
double mean_cosine_of(const PhaseFunction& phase) {
  if (phase.is_henyey_greenstein()) return phase.first.g;
  if (phase.ocean) return phase.ocean->mean_cosine();
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

/// Of a layer: change of its height with distance along the steepest direction.
double steepest(const Medium& layer) {
  return glm::length(layer.gradient_to_world(layer.homogeneous()->falloff->slope));
}

dvec3 tint_of(const Medium& medium) {
  const double mean = in_colour(medium.albedo(), kGrey);
  return mean > 0 ? medium.albedo() / mean : dvec3(1);
}

void enclose(const Medium& medium, dvec3& lo, dvec3& hi) {
  for (const dvec3& p : medium.corners()) {
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
  const size_t own = parts.size();  // the parts of other media stay as they are
  while (walk.next(segment)) {
    if (parts.size() > own && segment.t0 <= parts.back().second * (1 + 1e-9))
      parts.back().second = std::max(parts.back().second, segment.t1);
    else
      parts.emplace_back(segment.t0, segment.t1);
  }
}

/// Puts intervals in order, those that touch together.
void merge(std::vector<std::pair<double, double>>& parts) {
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

}  // namespace

double in_colour(const dvec3& rgb, GuideColour colour) {
  return colour == kGrey ? (rgb.x + rgb.y + rgb.z) / 3 : rgb[colour];
}

// Displaced densities are looked up many times: they are resampled once, unless that would take much memory or single
// precision is not enough.
Medium GuideMedia::resampled(const Medium& medium, double time, const Task& task) {
  if (!medium.displacement()) return medium;
  const BrickGrid& envelope = medium.walked();
  const ivec3 n = envelope.cells();
  double cells = 0;
  for (int x = 0; x < n.x; ++x)
    for (int y = 0; y < n.y; ++y)
      for (int z = 0; z < n.z; ++z) cells += envelope.cell({x, y, z}).majorant > 0 ? 1 : 0;
  if (cells * std::pow(kSamplesPerVoxel * envelope.cell_size(), 3) > kMostResampled || !DisplacedSamples::fits(medium))
    return medium;
  const DisplacedSamples samples(medium, time);
  return medium.resampled(
      kSamplesPerVoxel, *resampled_.emplace_back(std::make_shared<BrickGrid>()),
      [&](const dvec3& first, double, float* values) {
        samples.sample(first, kSamplesPerVoxel, BrickGrid::kCell + 1, values);
      },
      task);
}

GuideMedia::GuideMedia(std::span<const Medium> media, std::span<const EmissionField> emissions, double time,
                       const Task& task) {
  lo_ = dvec3(std::numeric_limits<double>::infinity());
  hi_ = -lo_;
  voxel_ = std::numeric_limits<double>::infinity();
  double layer = voxel_;
  const auto take = [&](const Medium& m) {
    enclose(m, lo_, hi_);
    if (!m.homogeneous()) voxel_ = std::min(voxel_, m.voxel_size());
    if (m.falls_off()) layer = std::min(layer, kLayerVoxel / steepest(m));
  };
  for (const Medium& m : media) {
    displaced_.push_back(m.at_time(time));
    media_.push_back(resampled(displaced_.back(), time, task));
    mean_cosine_.push_back(mean_cosine_of(m.phase()));
    coloured_ = coloured_ || m.chromatic() || m.coloured();
    holdouts_ = holdouts_ || m.holdout();
    instances_ = instances_ || m.instances();
    Constants& c = constants_.emplace_back();
    for (GuideColour colour = kGrey; colour < 3; ++colour) {
      c.per_density[static_cast<size_t>(colour + 1)] = in_colour(m.coefficients().sigma_t, colour);
      c.albedo[static_cast<size_t>(colour + 1)] = in_colour(m.albedo(), colour);
    }
    c.tint = tint_of(m);
    c.inverse_maximum = m.maximum_density() > 0 ? 1 / m.maximum_density() : 0;
    take(displaced_.back());
  }
  for (size_t i = 0; i < constants_.size(); ++i)
    mixed_tints_ = mixed_tints_ || (!coloured_ && (glm::distance(constants_[i].tint, constants_[0].tint) > 1e-9 ||
                                                   (media_[i].instances() && media_[i].instances()->tinted())));
  for (const EmissionField& e : emissions) {
    const EmissionField now = e.at_time(time);
    emissions_.push_back(now.shape().displacement() ? EmissionField(resampled(now.shape(), time, task), now.ramp())
                                                    : now);
    take(now.shape());
  }
  if (!std::isfinite(voxel_)) voxel_ = max_component(hi_ - lo_) / 128;
  voxel_ = std::min(voxel_, layer);
}

double GuideMedia::grain() const {
  double finest = 1;
  for (const Medium& m : displaced_)
    if (m.detail()) finest = std::min(finest, 2 * m.voxel_size() / (voxel_ * m.detail()->finest()));
  return finest;
}

GuideMedia::Point GuideMedia::at(const dvec3& world, GuideColour colour) const {
  MediaLine line(*this, colour);
  line.follow({world, dvec3(0)});
  return line.at(0);
}

double GuideMedia::scattering(size_t medium, const dvec3& world, GuideColour colour) const {
  const Medium& m = media_[medium];
  const Constants& c = constants_[medium];
  const auto k = static_cast<size_t>(colour - kGrey);
  const Instances* const all = m.instances();
  if (!all) return m.smooth_density(m.to_local(world)) * c.per_density[k] * c.albedo[k];
  double sum = 0;
  all->each_around(world, [&](size_t i) {
    const Instance& one = (*all)[i];
    sum += m.smooth_density(one.to_local(world)) * one.density * c.per_density[k] *
           in_colour(m.albedo() * one.tint, colour);
  });
  return sum;
}

dvec3 GuideMedia::emission(const dvec3& world) const {
  dvec3 sum(0);
  for (const EmissionField& field : emissions_) sum += field.coefficient(world);
  return sum;
}

dvec3 GuideMedia::followed(const dvec3& world, const GuideMedia& other) const {
  if (this == &other) return world;
  for (size_t i = 0; i < media_.size(); ++i)
    if (!media_[i].instances() && (media_.size() == 1 || media_[i].smooth_density(media_[i].to_local(world)) > 0))
      return moved(i, world, other);
  return world;
}

std::optional<dvec3> GuideMedia::moved_since(const GuideMedia& other) const {
  const double rounding = 1e-9 * voxel_;
  const dvec3 moved = media_.empty() ? dvec3(0) : media_[0].corners()[0] - other.media_[0].corners()[0];
  for (size_t i = 0; i < media_.size(); ++i) {
    if (displaced_[i].displacement() || media_[i].instances()) return {};
    const auto now = media_[i].corners(), before = other.media_[i].corners();
    for (size_t k = 0; k < now.size(); ++k)
      if (glm::distance(now[k] - before[k], moved) > rounding) return {};
  }
  return moved;
}

void GuideMedia::intervals(const Ray& ray, double t_max, std::vector<std::pair<double, double>>& parts,
                           bool uneven) const {
  parts.clear();
  const auto add = [&](const Medium& m) {
    if (!uneven || !m.homogeneous())
      m.each_met(ray, t_max, [&](const Medium& one, size_t) { add_intervals(one, ray, t_max, parts); });
  };
  for (const Medium& m : media_) add(m);
  for (const EmissionField& e : emissions_) add(e.shape());
  if (media_.size() + emissions_.size() > 1 || instances_) merge(parts);
}

}  // namespace brume
