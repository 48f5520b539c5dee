#include "evaluate/protocol/speed.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace brume {
namespace {

/// A method's way from few to many samples. Errors fall as pictures get better, whatever the metric.
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

double error_of(const MethodResult& m, const Judgement& by) {
  return as_error(by.info(), mean_interval(m.values(by)).mean);
}

/// Whether a method has time and error.
bool is_timed(const MethodResult& m, const Judgement& by) {
  if (!m.failed.empty() || !(m.seconds() > 0) || m.errors[static_cast<size_t>(by.region)].empty()) return false;
  const double error = error_of(m, by);
  return error > 0 && std::isfinite(error);
}

std::vector<Curve> curves_of(const SceneResult& scene, const Judgement& by) {
  std::vector<Curve> curves;
  for (const MethodResult& m : scene.methods) {
    if (!is_timed(m, by)) continue;
    auto it = std::find_if(curves.begin(), curves.end(), [&](const Curve& c) { return c.first->id() == m.id(); });
    if (it == curves.end()) it = curves.insert(curves.end(), {&m, {}});
    it->points.emplace_back(m.seconds(), error_of(m, by));
  }
  for (Curve& c : curves) std::sort(c.points.begin(), c.points.end());
  return curves;
}

/// A root mean square of plain path tracing takes four times as long for half of it, its square twice as long, from
/// whichever sample count is nearest.
std::optional<double> path_tracing_seconds(const std::vector<Curve>& curves, double error, int noise_power) {
  for (const Curve& c : curves) {
    if (!c.first->filter.empty()) continue;
    if (const auto measured = c.seconds_to(error)) return measured;
    if (noise_power == 0) return std::nullopt;
    const auto nearest = std::min_element(c.points.begin(), c.points.end(), [&](const auto& a, const auto& b) {
      return std::abs(std::log(a.second / error)) < std::abs(std::log(b.second / error));
    });
    return nearest->first * std::pow(nearest->second / error, 2.0 / noise_power);
  }
  return std::nullopt;
}

/// Round values of a metric within the range of all curves, the worst first.
std::vector<double> round_values(const std::vector<Curve>& curves, const MetricInfo& metric) {
  double lowest = 1e300, highest = 0;
  for (const Curve& c : curves)
    for (const auto& point : c.points) {
      lowest = std::min(lowest, point.second);
      highest = std::max(highest, point.second);
    }
  std::vector<double> values;
  if (curves.empty()) return values;
  if (std::string_view(metric.unit) == "dB") {
    const double worst = from_error(metric, highest), best = from_error(metric, lowest),
                 step = best - worst > 16 ? 5 : 2;
    for (double value = step * std::ceil(worst / step); value <= best; value += step) values.push_back(value);
    return values;
  }
  for (int decade = static_cast<int>(std::ceil(std::log10(highest))); decade >= std::floor(std::log10(lowest));
       --decade)
    for (const double m : {5.0, 2.0, 1.0})
      if (const double level = m * std::pow(10.0, decade); level >= lowest && level <= highest)
        values.push_back(from_error(metric, level));
  return values;
}

}  // namespace

std::vector<const MethodResult*> pareto_front(const SceneResult& scene, const Judgement& by,
                                              std::optional<Tuning> setting) {
  std::vector<const MethodResult*> front;
  for (const MethodResult& m : scene.methods) {
    const bool is_meant = setting ? m.tuning == *setting || m.tuning == Tuning::kNone : !scene.repeats_default(m);
    if (is_meant && is_timed(m, by)) front.push_back(&m);
  }
  std::stable_sort(front.begin(), front.end(), [&](const MethodResult* a, const MethodResult* b) {
    return std::pair(a->seconds(), error_of(*a, by)) < std::pair(b->seconds(), error_of(*b, by));
  });
  double lowest = std::numeric_limits<double>::infinity();
  std::erase_if(front, [&](const MethodResult* m) {
    const double error = error_of(*m, by);
    if (error >= lowest) return true;
    lowest = error;
    return false;
  });
  return front;
}

std::vector<TimeToError> times_to_error(const SceneResult& scene, const Judgement& by) {
  const MetricInfo& metric = by.info();
  const std::vector<Curve> curves = curves_of(scene, by);
  std::vector<TimeToError> list;
  for (const double value : round_values(curves, metric)) {
    const double error = as_error(metric, value);
    const std::optional<double> path_tracing = path_tracing_seconds(curves, error, metric.noise_power);
    for (const Curve& c : curves) {
      const std::optional<double> seconds = c.seconds_to(error);
      if (!seconds) continue;
      TimeToError entry{c.first, value, *seconds, std::nullopt, std::nullopt};
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
