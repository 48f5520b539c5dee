#include "evaluate/protocol/speed.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace brume {
namespace {

/// A method's way from few to many samples.
struct Curve {
  const MethodResult* first;
  std::vector<std::pair<double, double>> points;  // seconds, error

  /// Seconds to an error that lies between those of two neighbouring sample counts; the fewest, where there are
  /// several.
  std::optional<double> seconds_to(double error) const {
    std::optional<double> best;
    for (size_t i = 0; i + 1 < points.size(); ++i) {
      const auto& [t0, e0] = points[i];
      const auto& [t1, e1] = points[i + 1];
      if (!(error <= std::max(e0, e1) && error >= std::min(e0, e1)) || e0 == e1) continue;
      const double share = std::log(error / e0) / std::log(e1 / e0);
      const double seconds = t0 * std::pow(t1 / t0, share);
      if (!best || seconds < *best) best = seconds;
    }
    return best;
  }
};

/// Whether a method has time and error, and is not our default again under the name of the publication.
bool is_timed(const SceneResult& scene, const MethodResult& m) {
  if (!m.failed.empty() || !(m.seconds() > 0) || !(m.whole().mean > 0)) return false;
  const MethodResult* ours = scene.find(m.filter, Tuning::kDefault, m.spp);
  return m.tuning != Tuning::kPaper || !ours || ours->parameters != m.parameters;
}

std::vector<Curve> curves_of(const SceneResult& scene) {
  std::vector<Curve> curves;
  for (const MethodResult& m : scene.methods) {
    if (!is_timed(scene, m)) continue;
    auto it = std::find_if(curves.begin(), curves.end(), [&](const Curve& c) { return c.first->id() == m.id(); });
    if (it == curves.end()) it = curves.insert(curves.end(), {&m, {}});
    it->points.emplace_back(m.seconds(), m.whole().mean);
  }
  for (Curve& c : curves) std::sort(c.points.begin(), c.points.end());
  return curves;
}

/// Plain path tracing needs four times as long for half the error, from whichever sample count is nearest.
std::optional<double> path_tracing_seconds(const std::vector<Curve>& curves, double error) {
  for (const Curve& c : curves) {
    if (!c.first->filter.empty()) continue;
    if (const auto measured = c.seconds_to(error)) return measured;
    const auto nearest = std::min_element(c.points.begin(), c.points.end(), [&](const auto& a, const auto& b) {
      return std::abs(std::log(a.second / error)) < std::abs(std::log(b.second / error));
    });
    return nearest->first * std::pow(nearest->second / error, 2);
  }
  return std::nullopt;
}

std::vector<double> error_levels(const std::vector<Curve>& curves) {
  double lowest = 1e300, highest = 0;
  for (const Curve& c : curves)
    for (const auto& point : c.points) {
      lowest = std::min(lowest, point.second);
      highest = std::max(highest, point.second);
    }
  std::vector<double> levels;
  if (curves.empty()) return levels;
  for (int decade = static_cast<int>(std::ceil(std::log10(highest))); decade >= std::floor(std::log10(lowest));
       --decade)
    for (const double m : {5.0, 2.0, 1.0})
      if (const double level = m * std::pow(10.0, decade); level >= lowest && level <= highest) levels.push_back(level);
  return levels;
}

}  // namespace

std::vector<const MethodResult*> pareto_front(const SceneResult& scene) {
  std::vector<const MethodResult*> front;
  for (const MethodResult& m : scene.methods)
    if (is_timed(scene, m)) front.push_back(&m);
  std::stable_sort(front.begin(), front.end(), [](const MethodResult* a, const MethodResult* b) {
    return std::pair(a->seconds(), a->whole().mean) < std::pair(b->seconds(), b->whole().mean);
  });
  double lowest = std::numeric_limits<double>::infinity();
  std::erase_if(front, [&](const MethodResult* m) {
    const double error = m->whole().mean;
    if (error >= lowest) return true;
    lowest = error;
    return false;
  });
  return front;
}

std::vector<TimeToError> times_to_error(const SceneResult& scene) {
  const std::vector<Curve> curves = curves_of(scene);
  std::vector<TimeToError> list;
  for (const double error : error_levels(curves)) {
    const std::optional<double> path_tracing = path_tracing_seconds(curves, error);
    for (const Curve& c : curves) {
      const std::optional<double> seconds = c.seconds_to(error);
      if (!seconds) continue;
      TimeToError entry{c.first->id(), error, *seconds, std::nullopt, std::nullopt};
      if (path_tracing) entry.over_path_tracing = *path_tracing / *seconds;
      for (const Curve& other : curves)
        if (other.first->filter == "gradient_kernel" &&
            (other.first->tuning == c.first->tuning ||
             (c.first->filter.empty() && other.first->tuning == Tuning::kDefault)))
          if (const auto theirs = other.seconds_to(error)) entry.over_gradient_kernel = *theirs / *seconds;
      list.push_back(std::move(entry));
    }
  }
  return list;
}

}  // namespace brume
