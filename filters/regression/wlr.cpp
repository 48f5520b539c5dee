#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

#include "filters/api/registry.h"
#include "filters/patch/neighbourhood.h"
#include "filters/regression/bandwidth.h"

namespace brume {
namespace {

struct Wlr {
  int radius = 5, curvature_radius = 5;
  float rejection = 3;
  FeatureSet feature_set = FeatureSet::kOpacity;
};

constexpr std::array<double, 5> kBandwidths = {0.2, 0.4, 0.6, 0.8, 1.0};
constexpr double kSmallestBandwidth = 0.01, kLargestBandwidth = 1;
// Least spread of a feature within a window, and what of a singular value is noise whatever the features' variance.
constexpr double kSpreadFloor = 0.01, kSingularFloor = 0.01;
// Curvature that is always assumed, and the least brightness difference that rejects a neighbour, white being 1.
constexpr double kCurvatureFloor = 0.16, kRejectionFloor = 0.005;
constexpr double kRidge = 1e-4;
constexpr int kMost = 16;  // dimensions of the full space

using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMost + 1, 1>;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMost + 1, kMost + 1>;
using Curved = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMost + 1, 2 * kMost + 1>;

/// The pixels of one window in the reduced space around its centre.
struct Window {
  int dimensions = 0;
  std::vector<ivec2> places;
  std::vector<double> z;              // dimensions numbers for each place
  std::array<double, kMost> width{};  // of each dimension, before the bandwidth
};

class Regression {
 public:
  Regression(const Wlr& p, const FilterFrame& frame, const Task& task) : p_(p), frame_(frame) {
    for (const Feature& f : *frame.features)
      for (size_t c = 0; c < f.mean.size() && planes_.size() + 2 < kMost; ++c) {
        planes_.push_back(&f.mean[c]);
        variances_.push_back(&f.variance[c]);
      }
    const float exposure = static_cast<float>(frame.exposure);
    light_ = make_plane(frame.width(), frame.height(), quiet(task),
                        [&](int x, int y) { return exposure * frame.space.luminance(color_at(frame.signal, x, y)); });
    noise_ = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
      const auto s = [&](size_t c) { return std::sqrt((*frame.variance[c])(x, y)); };
      const float sum = exposure * frame.space.luminance(vec3(s(0), s(1), s(2)));
      return sum * sum;
    });
  }

  /// The window around a pixel: position and features, less their mean, over their largest deviation, projected on the
  /// directions whose singular values the features' noise does not explain.
  void open(int x, int y, Window& w) const {
    const int r = p_.radius, columns = 2 + static_cast<int>(planes_.size());
    w.places.clear();
    for (int qy = std::max(0, y - r); qy <= std::min(frame_.height() - 1, y + r); ++qy)
      for (int qx = std::max(0, x - r); qx <= std::min(frame_.width() - 1, x + r); ++qx)
        if (std::abs(light_(qx, qy) - light_(x, y)) <=
            static_cast<double>(p_.rejection) * (std::sqrt(noise_(qx, qy)) + std::sqrt(noise_(x, y))) + kRejectionFloor)
          w.places.push_back({qx, qy});
    const size_t n = w.places.size();
    std::vector<double> full(n * static_cast<size_t>(columns));
    double noise = 0;
    for (int k = 0; k < columns; ++k) {
      const auto value = [&](const ivec2& q) {
        if (k < 2) return static_cast<double>(k == 0 ? q.x - x : q.y - y) / std::max(r, 1);
        return static_cast<double>((*planes_[static_cast<size_t>(k) - 2])(q.x, q.y));
      };
      double mean = 0, spread = k < 2 ? 1.0 : kSpreadFloor, own_noise = 0;
      if (k >= 2) {
        for (const ivec2& q : w.places) mean += value(q) / static_cast<double>(n);
        for (const ivec2& q : w.places) spread = std::max(spread, std::abs(value(q) - mean));
        for (const ivec2& q : w.places) own_noise += (*variances_[static_cast<size_t>(k) - 2])(q.x, q.y);
        noise += own_noise / (spread * spread * static_cast<double>(n));
      }
      for (size_t i = 0; i < n; ++i)
        full[i * static_cast<size_t>(columns) + static_cast<size_t>(k)] = (value(w.places[i]) - mean) / spread;
    }
    Matrix gram = Matrix::Zero(columns, columns);
    for (size_t i = 0; i < n; ++i) {
      const Eigen::Map<const Eigen::VectorXd> row(full.data() + i * static_cast<size_t>(columns), columns);
      gram.selfadjointView<Eigen::Lower>().rankUpdate(row, 1.0 / static_cast<double>(n));
    }
    // Position stays as it is; the features' part is reduced, so that noise-free axes are always there.
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(gram);
    const double threshold = kSingularFloor + 4 * std::sqrt(noise / columns);
    int kept = 0;
    for (int k = 0; k < columns; ++k) kept += std::sqrt(std::max(0.0, eigen.eigenvalues()[k])) > threshold;
    kept = std::clamp(kept, std::min(2, columns), columns);
    w.dimensions = kept;
    const Matrix basis = eigen.eigenvectors().rightCols(kept);
    Vector origin = Vector::Zero(columns);
    size_t own = 0;
    for (size_t i = 0; i < n; ++i)
      if (w.places[i] == ivec2(x, y)) own = i;
    for (int k = 0; k < columns; ++k) origin[k] = full[own * static_cast<size_t>(columns) + static_cast<size_t>(k)];
    w.z.resize(n * static_cast<size_t>(kept));
    for (size_t i = 0; i < n; ++i) {
      const Eigen::Map<const Eigen::VectorXd> row(full.data() + i * static_cast<size_t>(columns), columns);
      Eigen::Map<Eigen::VectorXd>(w.z.data() + i * static_cast<size_t>(kept), kept).noalias() =
          basis.transpose() * (row - origin);
    }
    measure_widths(x, y, w);
  }

  /// Weights l_q with estimate = sum l_q y_q of the local line at a bandwidth. Empty where it cannot be fitted.
  void hat(const Window& w, double bandwidth, std::vector<double>& l) const {
    const int k = w.dimensions;
    const size_t n = w.places.size();
    std::vector<double> weights(n);
    Matrix a = Matrix::Zero(k + 1, k + 1);
    for (size_t i = 0; i < n; ++i) {
      const double* z = w.z.data() + i * static_cast<size_t>(k);
      double weight = 1;
      for (int j = 0; j < k && weight > 0; ++j) {
        const double t = z[j] / (bandwidth * w.width[static_cast<size_t>(j)]);
        weight *= std::max(0.0, 0.75 * (1 - t * t));
      }
      if (!(weight > 0)) continue;
      // Fireflies, noisier than white is bright, count less.
      weight /= std::max(static_cast<double>(noise_(w.places[i].x, w.places[i].y)), 1.0);
      weights[i] = weight;
      a(0, 0) += weight;
      for (int j = 0; j < k; ++j) {
        a(j + 1, 0) += weight * z[j];
        for (int m = 0; m <= j; ++m) a(j + 1, m + 1) += weight * z[j] * z[m];
      }
    }
    l.assign(n, 0.0);
    const double floor = 1e-12 * a(0, 0);
    for (int j = 1; j <= k; ++j) a(j, j) += kRidge * a(j, j) + floor;
    // The estimate is the line's value at z = 0: the first row of the inverse.
    const Vector first = a.selfadjointView<Eigen::Lower>().ldlt().solve(Vector(Vector::Unit(k + 1, 0)));
    for (size_t i = 0; i < n; ++i) {
      if (weights[i] == 0) continue;
      const double* z = w.z.data() + i * static_cast<size_t>(k);
      double value = first[0];
      for (int j = 0; j < k; ++j) value += first[j + 1] * z[j];
      l[i] = weights[i] * value;
    }
  }

  double bandwidth(int x, int y, const Window& w, std::vector<double>& l) const {
    const int k = w.dimensions;
    const double n = std::max(frame_.samples_at(x, y), 1.0);
    std::array<double, kBandwidths.size()> bias, variance{};
    for (size_t j = 0; j < kBandwidths.size(); ++j) {
      hat(w, kBandwidths[j], l);
      bias[j] = -light_(x, y);
      for (size_t i = 0; i < l.size(); ++i) {
        const ivec2 q = w.places[i];
        bias[j] += l[i] * light_(q.x, q.y);
        variance[j] += l[i] * l[i] * noise_(q.x, q.y);
      }
    }
    return best_bandwidth({kBandwidths, bias, variance, n}, k, light_(x, y), kSmallestBandwidth, kLargestBandwidth);
  }

  std::array<double, 3> estimate(const Window& w, std::vector<double>& l, double h) const {
    hat(w, h, l);
    const auto sums = [&](const RgbPlanes& planes) {
      std::array<double, 3> total{};
      for (size_t i = 0; i < l.size(); ++i)
        for (size_t c = 0; c < 3; ++c) total[c] += l[i] * (*planes[c])(w.places[i].x, w.places[i].y);
      return total;
    };
    // The signal decides, so that layers that are carried along get its weights.
    const std::array<double, 3> line = sums(frame_.signal);
    bool beyond = false;
    for (size_t c = 0; c < 3; ++c) {
      const auto less = [&](const ivec2& a, const ivec2& b) {
        return (*frame_.signal[c])(a.x, a.y) < (*frame_.signal[c])(b.x, b.y);
      };
      const auto [low, high] = std::minmax_element(w.places.begin(), w.places.end(), less);
      beyond |= line[c] < (*frame_.signal[c])(low->x, low->y) || line[c] > (*frame_.signal[c])(high->x, high->y);
    }
    if (!beyond) return frame_.carries() ? sums(frame_.values) : line;
    // A line that leads beyond all values of its window: its positive weights alone are an average.
    double total = 0;
    for (double& v : l) {
      v = std::max(v, 0.0);
      total += v;
    }
    if (total > 0)
      for (double& v : l) v /= total;
    return sums(frame_.values);
  }

 private:
  /// Widths 1 / sqrt(|second derivative| + floor) along each dimension, from a parabola without mixed terms through the
  /// inner window.
  void measure_widths(int x, int y, Window& w) const {
    const int k = w.dimensions, n = 2 * k + 1;
    Curved a = Curved::Zero(n, n);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * kMost + 1, 1>
        b = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * kMost + 1, 1>::Zero(n),
        row = b;
    for (size_t i = 0; i < w.places.size(); ++i) {
      const ivec2 d = w.places[i] - ivec2(x, y);
      if (std::max(std::abs(d.x), std::abs(d.y)) > p_.curvature_radius) continue;
      const double* z = w.z.data() + i * static_cast<size_t>(k);
      row[0] = 1;
      for (int j = 0; j < k; ++j) {
        row[1 + j] = z[j];
        row[1 + k + j] = 0.5 * z[j] * z[j];
      }
      a.selfadjointView<Eigen::Lower>().rankUpdate(row);
      b += row * static_cast<double>(light_(w.places[i].x, w.places[i].y));
    }
    a.diagonal().array() += kRidge * std::max(a(0, 0), 1.0);
    const auto solution = a.selfadjointView<Eigen::Lower>().ldlt().solve(b).eval();
    for (int j = 0; j < k; ++j)
      w.width[static_cast<size_t>(j)] = 1 / std::sqrt(std::abs(solution[1 + k + j]) + kCurvatureFloor);
  }

  const Wlr& p_;
  const FilterFrame& frame_;
  std::vector<const Plane*> planes_, variances_;
  Plane light_, noise_;  // luminance, white being 1, and the variance of its mean
};

void run(const Wlr& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const Regression regression(p, frame, task);
  Plane bandwidths(frame.width(), frame.height());
  for_each_row(frame.height(), share(task, 0, 0.6), [&](int y) {
    Window window;
    std::vector<double> l;
    for (int x = 0; x < frame.width(); ++x) {
      regression.open(x, y, window);
      bandwidths(x, y) = static_cast<float>(regression.bandwidth(x, y, window, l));
    }
  });
  bandwidths = gaussian_blur(bandwidths, 1, task);
  for_each_row(frame.height(), share(task, 0.6, 1), [&](int y) {
    Window window;
    std::vector<double> l;
    for (int x = 0; x < frame.width(); ++x) {
      regression.open(x, y, window);
      const std::array<double, 3> value = regression.estimate(window, l, bandwidths(x, y));
      for (size_t c = 0; c < 3; ++c) (*out[c])(x, y) = static_cast<float>(value[c]);
    }
  });
}

const FilterEntry entry =
    declare<Wlr>("wlr",
                 "Weighted local regression: a line in a reduced feature space, its bandwidth fitted at every pixel.")
        .merit(4.1, "to compare with: near the best at few samples with opacity as its feature, but the slowest")
        .source("Moon, Carr and Yoon 2014, Adaptive Rendering based on Weighted Local Regression, sections 4 and 5")
        .notes(
            "Position and features of each window are reduced to the singular directions that their noise does not explain. Lines at five bandwidths give the curves of bias and variance whose best trade-off is taken, and smoothed over the picture. The authors' constants of brightness are for pictures whose white is 1; the exposure takes the frame there.")
        .statistics(Statistics::kVariance)
        .features()
        .feature_set(&Wlr::feature_set)
        .paper("radius=9,feature-set=all")
        .carries()
        .param("radius", &Wlr::radius, {1, 20}, "px", "half width of a window", {5, 9})
        .param("curvature-radius", &Wlr::curvature_radius, {1, 20}, "px", "half width of the window for the curvature")
        .param("rejection", &Wlr::rejection, {0.5, 100}, "deviations", "neighbours that differ by more are left out",
               {3, 6})
        .scratch(8)
        .apron([](const Wlr& p) { return p.radius + 3; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
