#include "filters/run/add_up.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

// A part's error is taken to be this share of it more, so that rounding falls on bright ones.
constexpr double kLeastError = 1e-3;

}  // namespace

void add_up_exactly(std::span<float> values, std::span<const double> weights, double sum) {
  std::vector<double> exact(values.begin(), values.end());
  std::vector<bool> fixed(values.size());
  for (bool again = true; again;) {
    again = false;
    double missed = sum, weight = 0;
    for (size_t i = 0; i < exact.size(); ++i) {
      missed -= exact[i];
      if (!fixed[i]) weight += weights[i];
    }
    for (size_t i = 0; i < exact.size(); ++i) {
      if (fixed[i]) continue;
      exact[i] += missed * weights[i] / weight;
      if (exact[i] >= 0 || sum < 0) continue;
      exact[i] = 0;
      fixed[i] = again = true;
    }
    again = again && std::find(fixed.begin(), fixed.end(), false) != fixed.end();
  }
  size_t largest = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<float>(exact[i]);
    if (std::abs(values[i]) > std::abs(values[largest])) largest = i;
  }
  double left = sum;
  for (size_t i = 0; i < values.size(); ++i)
    if (i != largest) left -= static_cast<double>(values[i]);
  values[largest] = static_cast<float>(left);
}

void add_up_exactly(const std::vector<std::array<Plane*, 3>>& parts, const std::vector<Plane>& errors,
                    const RgbPlanes& sum, const Task& task) {
  const int width = sum[0]->width();
  for_each_row(sum[0]->height(), quiet(task), [&](int y) {
    std::vector<float> values(parts.size());
    std::vector<double> weights(parts.size());
    for (int x = 0; x < width; ++x)
      for (size_t c = 0; c < 3; ++c) {
        for (size_t i = 0; i < parts.size(); ++i) {
          values[i] = (*parts[i][c])(x, y);
          const double light = std::abs(static_cast<double>(values[i]));
          const double error = errors.empty() ? 0.0 : static_cast<double>(errors[i](x, y));
          weights[i] = light * (error + kLeastError * light) + 1e-30;
        }
        add_up_exactly(values, weights, static_cast<double>((*sum[c])(x, y)));
        for (size_t i = 0; i < parts.size(); ++i) (*parts[i][c])(x, y) = values[i];
      }
  });
}

}  // namespace brume
