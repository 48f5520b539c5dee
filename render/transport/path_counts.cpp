#include "render/transport/path_counts.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/parallel_for.h"
#include "render/scene/scene.h"
#include "render/transport/wavefront.h"
#include "render/world/camera.h"

namespace brume {
namespace {

constexpr int kGrid = 48;         // points along each side of the picture
constexpr uint32_t kSamples = 2;  // camera rays through the pixel at each of them

// Processor time of a voxel that a camera ray's walk through what emits crosses, and of a path before its first event,
// in that of an event. Events in the one grid stay in lanes, so that voxels count for more.
constexpr double kVoxelCost = 0.16, kVoxelCostInOneGrid = 0.7, kStartCost = 1.0;

// Share of the variance of what camera rays see that is left where samples spread evenly over the pixel.
constexpr double kUneven = 0.3;

// Fewer paths are taken where their efficiency is within this of the best: a sample takes less time.
constexpr double kNearlyBest = 1.03;

/// At the points of a grid over the picture.
struct Pilot {
  int columns = 0, rows = 0;
  std::vector<dvec3> mean, spread;    // of a pixel; mean absolute difference of what follows from its rays, over that
  std::vector<double> seen_variance;  // of what camera rays see, relative to the mean
  std::vector<double> ray_cost, path_cost;

  size_t size() const { return mean.size(); }
};

/// Voxels that a ray crosses in the cells of a field that may emit.
double voxels_crossed(const Medium& shape, const Ray& local) {
  MajorantWalk walk = shape.walk(local, 0.0, kUnbounded);
  MajorantWalk::Segment s;
  double length = 0;
  while (walk.next(s))
    if (s.majorant > 0) length += s.t1 - s.t0;
  return length * glm::length(local.d);
}

/// Means over the points around each, by binomial weights.
template <class Value>
std::vector<Value> blurred(const std::vector<Value>& of, int columns, int rows) {
  constexpr std::array kWeights = {6.0, 4.0, 1.0};
  constexpr int kReach = kWeights.size() - 1;
  std::vector<Value> result(of.size());
  for (int y = 0; y < rows; ++y)
    for (int x = 0; x < columns; ++x) {
      Value sum(0);
      double weights = 0;
      for (int v = std::max(0, y - kReach); v <= std::min(rows - 1, y + kReach); ++v)
        for (int u = std::max(0, x - kReach); u <= std::min(columns - 1, x + kReach); ++u) {
          const double weight =
              kWeights[static_cast<size_t>(std::abs(u - x))] * kWeights[static_cast<size_t>(std::abs(v - y))];
          sum += weight * of[static_cast<size_t>(v) * columns + u];
          weights += weight;
        }
      result[static_cast<size_t>(y) * columns + x] = sum / weights;
    }
  return result;
}

Pilot fly_pilot(const PathContext& context, const Scene& scene, const Camera& camera, const Task& task) {
  Pilot p;
  p.columns = std::min(kGrid, scene.film.width), p.rows = std::min(kGrid, scene.film.height);
  const auto count = static_cast<size_t>(p.columns) * static_cast<size_t>(p.rows);
  p.mean.resize(count), p.spread.resize(count);
  p.seen_variance.resize(count), p.ray_cost.resize(count), p.path_cost.resize(count);
  const double voxel_cost = context.plan.one_grid ? kVoxelCostInOneGrid : kVoxelCost;
  const double floor = 0.01 / (scene.film.exposure * scene.film.exposure);
  const auto columns = static_cast<size_t>(p.columns);
  std::vector<dvec3> seen_squared(count);
  parallel_for(p.rows, quiet(task), [&](int row) {
    std::vector<PathRequest> requests = coarse_requests(scene, context.plan, camera, p.columns, p.rows, row, kSamples);
    std::vector<uint32_t> events(requests.size());
    for (size_t i = 0; i < requests.size(); ++i) requests[i].events = &events[i];
    std::vector<dvec3> seen(requests.size()), all(requests.size());
    const auto keep = [&](size_t i, const PathSample& s) {
      if (!std::isfinite(s.beauty.x + s.beauty.y + s.beauty.z)) return;  // the film will reject it, too
      all[i] = s.beauty;
      seen[i] = s.emission;
      if (context.plan.first_collision.forced) seen[i] += s.background;
    };
    PathCounters counters;
    trace_paths(context, requests, keep, counters);
    for (size_t c = 0; c < columns; ++c) {
      const size_t k = static_cast<size_t>(row) * columns + c, a = kSamples * c, b = a + 1;
      p.mean[k] = 0.5 * (all[a] + all[b]);
      p.spread[k] = glm::abs((all[a] - seen[a]) - (all[b] - seen[b]));
      const dvec3 d = seen[a] - seen[b];
      seen_squared[k] = 0.5 * d * d;
      for (const size_t i : {a, b}) {
        for (const EmissionField& field : context.emissions)
          p.ray_cost[k] +=
              voxel_cost / kSamples * voxels_crossed(field.shape(), field.shape().to_local(requests[i].ray));
        if (events[i] > 0) p.path_cost[k] += (kStartCost + events[i]) / kSamples;
      }
    }
  });
  p.mean = blurred(p.mean, p.columns, p.rows);
  p.spread = blurred(p.spread, p.columns, p.rows);
  p.path_cost = blurred(p.path_cost, p.columns, p.rows);
  for (size_t k = 0; k < count; ++k) {
    const dvec3 power = p.mean[k] * p.mean[k] + floor;
    p.spread[k] /= glm::sqrt(power);
    const dvec3 relative = seen_squared[k] / power;
    p.seen_variance[k] = kUneven * (relative.x + relative.y + relative.z) / 3;
  }
  return p;
}

/// What is recorded beside light takes no part, nor do endless paths.
PathContext for_pilot(PathContext context) {
  constexpr int kMostEvents = 1000;
  context.max_events = std::min(context.max_events, kMostEvents);
  Plan& plan = context.plan;
  plan.layers.names.clear();
  plan.isosurface = plan.flash = plan.first_event = plan.first_surface = plan.first_scatter_gradient = false;
  plan.weighted_gradient = plan.optical_depth = false;
  plan.first_collision.paths = PathCounts();
  return context;
}

/// Relative variance of a path, by its spread, which few paths tell better where some of them carry much. Of normal
/// distributions the mean absolute difference is 2 / sqrt(pi) standard deviations; paths in fire have twice that
/// variance.
double path_variance(const dvec3& spread) {
  constexpr double kTails = 2, kPi = 3.14159265358979323846;
  return kTails * 0.25 * kPi * glm::dot(spread, spread) / 3;
}

}  // namespace

PathCounts choose_path_counts(const PathContext& context, const Scene& scene, const Camera& camera, const Task& task) {
  const Pilot pilot = fly_pilot(for_pilot(context), scene, camera, task);
  std::vector<double> variance(pilot.size()), wanted(pilot.size());
  for (size_t k = 0; k < pilot.size(); ++k) {
    variance[k] = path_variance(pilot.spread[k]);
    wanted[k] = pilot.path_cost[k] > 0 ? std::sqrt(variance[k] / pilot.path_cost[k]) : 0.0;
  }
  const auto count = [&](size_t k, double scale) {
    return std::clamp(static_cast<int>(std::lround(scale * wanted[k])), 1, PathCounts::kMost);
  };
  const auto error_times_cost = [&](double scale) {
    double error = 0, cost = 0;
    for (size_t k = 0; k < pilot.size(); ++k) {
      const int n = count(k, scale);
      error += pilot.seen_variance[k] + variance[k] / n;
      cost += pilot.ray_cost[k] + n * pilot.path_cost[k];
    }
    return error * cost;
  };
  const double most = *std::max_element(wanted.begin(), wanted.end());
  if (!(most > 0)) return PathCounts(1);
  constexpr int kScales = 48;
  std::array<double, kScales> scales{}, products{};
  for (size_t s = 0; s < kScales; ++s) {
    scales[s] = std::exp2(0.25 * static_cast<double>(s)) / most;
    products[s] = error_times_cost(scales[s]);
  }
  const double bound = kNearlyBest * *std::min_element(products.begin(), products.end());
  const auto chosen = std::find_if(products.begin(), products.end(), [&](double p) { return p <= bound; });
  if (chosen == products.end()) return PathCounts(1);  // none is finite
  const double scale = scales[static_cast<size_t>(chosen - products.begin())];

  PathCounts result;
  result.width_ = scene.film.width, result.height_ = scene.film.height;
  result.columns_ = pilot.columns, result.rows_ = pilot.rows;
  result.counts_.resize(pilot.size());
  double sum = 0;
  for (size_t k = 0; k < pilot.size(); ++k) {
    const int n = count(k, scale);
    result.counts_[k] = static_cast<uint8_t>(n);
    result.most_ = std::max(result.most_, n);
    sum += n;
  }
  result.mean_ = sum / static_cast<double>(pilot.size());
  // A limit bounds the mean of a ray's paths, so that it must be of as many everywhere to darken all parts alike.
  return context.indirect_limit > 0 ? PathCounts(static_cast<int>(std::lround(result.mean_))) : result;
}

}  // namespace brume
