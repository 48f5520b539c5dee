#include "filters/regression/bandwidth.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

/// A straight line by least squares.
class Line {
 public:
  void add(double x, double y) {
    n_ += 1;
    x_ += x;
    xx_ += x * x;
    y_ += y;
    xy_ += x * y;
  }
  double slope() const { return (n_ * xy_ - x_ * y_) / (n_ * xx_ - x_ * x_); }

 private:
  double n_ = 0, x_ = 0, xx_ = 0, y_ = 0, xy_ = 0;
};

}  // namespace

double best_pixel_width(const WidthTrials& t, double smallest, double largest) {
  Line bias, variance;
  for (size_t i = 0; i < t.widths.size(); ++i) {
    const double a2 = t.widths[i] * t.widths[i];
    bias.add(a2, t.biases[i]);
    variance.add(1 / a2, t.samples * t.variances[i]);
  }
  const double b1 = bias.slope(), v1 = variance.slope();
  if (std::abs(b1) < 1e-6) return largest;
  if (!(v1 > 0)) return std::clamp(0.5, smallest, largest);
  return std::clamp(std::sqrt(std::cbrt(v1 / (2 * b1 * b1 * t.samples))), smallest, largest);
}

double best_bandwidth(const WidthTrials& t, int dimensions, double light, double smallest, double largest) {
  Line bias, variance;
  for (size_t i = 0; i < t.widths.size(); ++i) {
    bias.add(t.widths[i] * t.widths[i], t.biases[i]);
    variance.add(std::pow(t.widths[i], -dimensions), t.samples * t.variances[i]);
  }
  const double b1 = bias.slope(), v1 = std::abs(variance.slope());
  if (!(std::abs(b1) > 1e-9 * std::abs(light))) return largest;
  return std::clamp(std::pow(dimensions * v1 / (4 * b1 * b1 * t.samples), 1.0 / (dimensions + 4)), smallest, largest);
}

}  // namespace brume
