#include "evaluate/metrics/flip.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/math.h"
#include "base/parallel_for.h"
#include "filters/kernels/lab.h"
#include "filters/kernels/rows.h"
#include "image/color.h"

namespace brume {
namespace {

// The publication's constants, by its names: exponent and knee of the colour error, width and exponent of the features.
constexpr float kQc = 0.7f, kPc = 0.4f, kPt = 0.95f;
constexpr double kFeatureWidth = 0.082;  // degrees
constexpr int kBand = 64;                // rows that are worked on together
constexpr int kBeyond = 16;              // floats that kernels may read and write past a row

struct Xyz {
  float x, y, z;  // over the white point's
};

Xyz xyz_from_rgb(float r, float g, float b) {
  constexpr auto& m = LabMatrices::xyz_from_rgb;
  const auto row = [&](int i) {
    return static_cast<float>(m[i][0]) * r + static_cast<float>(m[i][1]) * g + static_cast<float>(m[i][2]) * b;
  };
  return {row(0), row(1), row(2)};
}

/// The inverse of xyz_from_rgb.
dmat3 rgb_from_xyz() {
  constexpr auto& m = LabMatrices::xyz_from_rgb;
  dmat3 matrix;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) matrix[column][row] = m[row][column];
  return glm::inverse(matrix);
}

float lab_curve(float t) {
  constexpr float knee = 216.0f / 24389.0f;
  return t > knee ? std::cbrt(t) : t * (841.0f / 108.0f) + 4.0f / 29.0f;
}

struct Lab {
  float l, a, b;
};

/// CIE-Lab with Hunt's effect: colours count for less where it is dark.
Lab hunt_lab(const Xyz& c) {
  const float fx = lab_curve(c.x), fy = lab_curve(c.y), fz = lab_curve(c.z);
  const float l = 116 * fy - 16;
  return {l, 0.01f * l * 500 * (fx - fy), 0.01f * l * 200 * (fy - fz)};
}

float hyab(const Lab& p, const Lab& q) {
  const float da = p.a - q.a, db = p.b - q.b;
  return std::abs(p.l - q.l) + std::sqrt(da * da + db * db);
}

/// The largest colour error there can be: of pure green and pure blue.
float largest_colour_error() {
  return std::pow(hyab(hunt_lab(xyz_from_rgb(0, 1, 0)), hunt_lab(xyz_from_rgb(0, 0, 1))), kQc);
}

/// A symmetric or antisymmetric kernel, 2 radius + 1 weights; ends too small for a float are cut.
struct Kernel {
  std::vector<float> weights;
  int radius() const { return static_cast<int>(weights.size()) / 2; }
};

Kernel cut(std::vector<double> weights) {
  double largest = 0;
  for (const double w : weights) largest = std::max(largest, std::abs(w));
  while (weights.size() > 1 && std::abs(weights.front()) < 1e-9 * largest &&
         std::abs(weights.back()) < 1e-9 * largest) {
    weights.erase(weights.begin());
    weights.pop_back();
  }
  return {{weights.begin(), weights.end()}};
}

/// The contrast sensitivity filters of the achromatic, red-green and blue-yellow channel; the last is a sum of two.
struct SpatialKernels {
  Kernel y, cx, cz1, cz2;

  explicit SpatialKernels(double pixels_per_degree) {
    const double largest = 0.04;
    const int radius = static_cast<int>(std::ceil(3 * std::sqrt(largest / (2 * kPi * kPi)) * pixels_per_degree));
    const auto gaussian = [&](double b) {
      std::vector<double> g;
      for (int i = -radius; i <= radius; ++i) {
        const double degrees = i / pixels_per_degree;
        g.push_back(std::exp(-kPi * kPi * degrees * degrees / b));
      }
      return g;
    };
    const auto sum = [](const std::vector<double>& g) {
      double s = 0;
      for (const double v : g) s += v;
      return s;
    };
    const auto scaled = [](std::vector<double> g, double factor) {
      for (double& v : g) v *= factor;
      return cut(std::move(g));
    };
    const auto normalised = [&](double b) {
      const std::vector<double> g = gaussian(b);
      return scaled(g, 1 / sum(g));
    };
    y = normalised(0.0047);
    cx = normalised(0.0053);
    const std::vector<double> first = gaussian(0.04), second = gaussian(0.025);
    const double amount1 = 34.1 * std::sqrt(kPi / 0.04), amount2 = 13.5 * std::sqrt(kPi / 0.025);
    const double total = amount1 * sum(first) * sum(first) + amount2 * sum(second) * sum(second);
    cz1 = scaled(first, std::sqrt(amount1 / total));
    cz2 = scaled(second, std::sqrt(amount2 / total));
  }
};

/// Detectors of edges and points: a Gaussian and its first two derivatives, their weights on either side of zero
/// summing to one.
struct FeatureKernels {
  Kernel gaussian, edge, point;

  explicit FeatureKernels(double pixels_per_degree) {
    const double sigma = 0.5 * kFeatureWidth * pixels_per_degree;
    const int radius = static_cast<int>(std::ceil(3 * sigma));
    std::vector<double> g, first, second;
    for (int i = -radius; i <= radius; ++i) {
      const double value = std::exp(-i * i / (2 * sigma * sigma));
      g.push_back(value);
      first.push_back(-i * value);
      second.push_back((i * i / (sigma * sigma) - 1) * value);
    }
    const auto normalised = [](std::vector<double> w) {
      double positive = 0, negative = 0;
      for (const double v : w) (v > 0 ? positive : negative) += v;
      for (double& v : w) v /= v > 0 ? positive : -negative;
      return cut(std::move(w));
    };
    gaussian = normalised(g);
    edge = normalised(first);
    point = normalised(second);
  }
};

/// Rows of floats with room on either side.
class Rows {
 public:
  Rows(int width, int height, int radius)
      : width_(width),
        radius_(radius),
        stride_(static_cast<size_t>(width) + 2 * static_cast<size_t>(radius)),
        data_(stride_ * static_cast<size_t>(height)) {}
  float* row(int y) { return &data_[stride_ * static_cast<size_t>(y) + static_cast<size_t>(radius_)]; }
  /// Continues a row beyond its ends.
  void continue_row(int y) {
    float* r = row(y);
    std::fill(r - radius_, r, r[0]);
    std::fill(r + width_, r + width_ + radius_, r[width_ - 1]);
  }

 private:
  int width_, radius_;
  size_t stride_;
  std::vector<float> data_;
};

/// Sums of rows with weights, gathered first.
class WeightedRows {
 public:
  /// The neighbours along a row.
  WeightedRows& along(const float* row, const Kernel& kernel) {
    return add(kernel, [&](int k) { return row + k; });
  }
  /// The rows around row `y`.
  WeightedRows& across(Rows& rows, int y, const Kernel& kernel) {
    return add(kernel, [&](int k) { return rows.row(y + k); });
  }
  void sum(float* out, int width) {
    kernels::weighted_sum_rows(rows_.data(), weights_.data(), static_cast<int>(rows_.size()), out, width);
    rows_.clear();
    weights_.clear();
  }

 private:
  template <class Row>
  WeightedRows& add(const Kernel& kernel, const Row& row) {
    for (int k = -kernel.radius(); k <= kernel.radius(); ++k) rows_.push_back(row(k));
    weights_.insert(weights_.end(), kernel.weights.begin(), kernel.weights.end());
    return *this;
  }

  std::vector<const float*> rows_;
  std::vector<float> weights_;
};

/// What one picture looks like in a band of rows.
class Band {
 public:
  Band(const SpatialKernels& spatial, const FeatureKernels& features, int width)
      : spatial_(spatial),
        features_(features),
        width_(width),
        radius_(std::max({spatial.y.radius(), spatial.cx.radius(), spatial.cz1.radius(), spatial.cz2.radius(),
                          features.gaussian.radius(), features.edge.radius(), features.point.radius()})),
        source_(width, 3, radius_),
        across_{make(), make(), make(), make(), make(), make(), make()},
        sums_(width, 7, kBeyond) {}

  /// @param shown  the picture as displayed, in [0, 1]
  template <class Shown>
  void load(const Shown& shown, int height, int y0, int rows) {
    for (int i = 0; i < rows + 2 * radius_; ++i) {
      const int y = std::clamp(y0 + i - radius_, 0, height - 1);
      float *ys = source_.row(0), *cx = source_.row(1), *cz = source_.row(2);
      for (int x = 0; x < width_; ++x) {
        const auto [r, g, b] = shown(x, y);
        const Xyz c = xyz_from_rgb(r, g, b);
        ys[x] = 116 * c.y - 16;
        cx[x] = 500 * (c.x - c.y);
        cz[x] = 200 * (c.y - c.z);
      }
      for (int c = 0; c < 3; ++c) source_.continue_row(c);
      const auto filter = [&](const float* row, const Kernel& kernel, size_t to) {
        gathered_.along(row, kernel).sum(across_[to].row(i), width_);
      };
      filter(ys, spatial_.y, 0);
      filter(cx, spatial_.cx, 1);
      filter(cz, spatial_.cz1, 2);
      filter(cz, spatial_.cz2, 3);
      filter(ys, features_.gaussian, 4);
      filter(ys, features_.edge, 5);
      filter(ys, features_.point, 6);
    }
  }

  struct Look {
    Lab* lab;
    float *edge, *point;  // how strong they are
  };
  void look(int row, const Look& out) {
    const int y = row + radius_;
    float *ys = sums_.row(0), *cx = sums_.row(1), *cz = sums_.row(2), *edge_x = sums_.row(3), *edge_y = sums_.row(4),
          *point_x = sums_.row(5), *point_y = sums_.row(6);
    const auto filter = [&](size_t from, const Kernel& kernel, float* to) {
      gathered_.across(across_[from], y, kernel).sum(to, width_);
    };
    filter(0, spatial_.y, ys);
    filter(1, spatial_.cx, cx);
    gathered_.across(across_[2], y, spatial_.cz1).across(across_[3], y, spatial_.cz2).sum(cz, width_);
    filter(5, features_.gaussian, edge_x);
    filter(4, features_.edge, edge_y);
    filter(6, features_.gaussian, point_x);
    filter(4, features_.point, point_y);
    static const dmat3 inverse = rgb_from_xyz();
    for (int x = 0; x < width_; ++x) {
      const float y_of = (ys[x] + 16) / 116;
      const Xyz seen{y_of + cx[x] / 500, y_of, y_of - cz[x] / 200};
      // Colours that no display shows are brought back into its range.
      const auto channel = [&](int c) {
        const float value = static_cast<float>(inverse[0][c]) * seen.x + static_cast<float>(inverse[1][c]) * seen.y +
                            static_cast<float>(inverse[2][c]) * seen.z;
        return std::clamp(value, 0.0f, 1.0f);
      };
      ys[x] = channel(0);
      cx[x] = channel(1);
      cz[x] = channel(2);
    }
    kernels::lab_from_rgb_row({ys, cx, cz}, 1, {ys, cx, cz}, width_);
    for (int x = 0; x < width_; ++x) {
      const float hunt = 0.01f * ys[x];
      out.lab[x] = {ys[x], hunt * cx[x], hunt * cz[x]};
      // Of luminance in [0, 1], not of Y in 0 .. 100.
      out.edge[x] = std::sqrt(edge_x[x] * edge_x[x] + edge_y[x] * edge_y[x]) / 116;
      out.point[x] = std::sqrt(point_x[x] * point_x[x] + point_y[x] * point_y[x]) / 116;
    }
  }

 private:
  Rows make() const { return {width_, kBand + 2 * radius_, 0}; }

  const SpatialKernels& spatial_;
  const FeatureKernels& features_;
  int width_, radius_;
  Rows source_;
  std::array<Rows, 7> across_;  // filtered along rows
  Rows sums_;
  WeightedRows gathered_;
};

/// @param test, reference  (x, y) -> the three channels as displayed
template <class Shown>
void add_largest(const Shown& test, const Shown& reference, double pixels_per_degree, const Task& task, Plane& map) {
  const SpatialKernels spatial(pixels_per_degree);
  const FeatureKernels features(pixels_per_degree);
  const float largest = largest_colour_error(), knee = kPc * largest;
  const int width = map.width(), height = map.height();
  parallel_for((height + kBand - 1) / kBand, task, [&](int band) {
    const int y0 = band * kBand, rows = std::min(kBand, height - y0);
    Band first(spatial, features, width), second(spatial, features, width);
    first.load(test, height, y0, rows);
    second.load(reference, height, y0, rows);
    const auto n = static_cast<size_t>(width);
    std::vector<Lab> lab1(n), lab2(n);
    std::vector<float> edge1(n), edge2(n), point1(n), point2(n);
    for (int row = 0; row < rows; ++row) {
      first.look(row, {lab1.data(), edge1.data(), point1.data()});
      second.look(row, {lab2.data(), edge2.data(), point2.data()});
      float* out = map.row(y0 + row);
      for (size_t x = 0; x < n; ++x) {
        const float distance = std::pow(hyab(lab1[x], lab2[x]), kQc);
        const float colour =
            distance < knee ? distance * kPt / knee : kPt + (distance - knee) / (largest - knee) * (1 - kPt);
        const float feature =
            std::sqrt(std::max(std::abs(edge1[x] - edge2[x]), std::abs(point1[x] - point2[x])) / std::sqrt(2.0f));
        out[x] = std::max(out[x], std::pow(colour, 1 - std::min(feature, 1.0f)));
      }
    }
  });
}

struct Rgb {
  float r, g, b;
};

/// As the display shows it.
struct Displayed {
  const RgbPlanes& rgb;
  Rgb operator()(int x, int y) const {
    const auto channel = [&](size_t c) { return std::clamp((*rgb[c])(x, y), 0.0f, 1.0f); };
    return {channel(0), channel(1), channel(2)};
  }
};

// A fit to the ACES curve, without the exposure that belongs to it: (k0 v^2 + k1 v) / (k3 v^2 + k4 v + k5). Source:
// Narkowicz 2015, ACES Filmic Tone Mapping Curve.
constexpr double kAcesFit[6] = {0.36 * 2.51, 0.6 * 0.03, 0, 0.36 * 2.43, 0.6 * 0.59, 0.14};

struct ToneMapped {
  const RgbPlanes& rgb;
  float factor;
  Rgb operator()(int x, int y) const {
    const auto channel = [&](size_t c) {
      const float v = factor * (*rgb[c])(x, y);
      const float top = static_cast<float>(kAcesFit[0]) * v * v + static_cast<float>(kAcesFit[1]) * v;
      const float bottom = static_cast<float>(kAcesFit[3]) * v * v + static_cast<float>(kAcesFit[4]) * v +
                           static_cast<float>(kAcesFit[5]);
      return std::clamp(top / bottom, 0.0f, 1.0f);
    };
    return {channel(0), channel(1), channel(2)};
  }
};

}  // namespace

Plane flip_map(const RgbPlanes& test, const RgbPlanes& reference, const Task& task, double pixels_per_degree) {
  Plane map(reference[0]->width(), reference[0]->height());
  add_largest(Displayed{test}, Displayed{reference}, pixels_per_degree, task, map);
  return map;
}

std::vector<double> hdr_flip_exposures(const RgbPlanes& reference) {
  // Where the curve reaches 85 %: the larger root of a quadratic.
  constexpr double target = 0.85;
  const double a = kAcesFit[0] - target * kAcesFit[3], b = kAcesFit[1] - target * kAcesFit[4],
               c = kAcesFit[2] - target * kAcesFit[5];
  const double shown = (-b + std::sqrt(b * b - 4 * a * c)) / (2 * a);
  std::vector<float> luminance;
  for (int y = 0; y < reference[0]->height(); ++y)
    for (int x = 0; x < reference[0]->width(); ++x)
      luminance.push_back(0.2126f * (*reference[0])(x, y) + 0.7152f * (*reference[1])(x, y) +
                          0.0722f * (*reference[2])(x, y));
  const double brightest = *std::max_element(luminance.begin(), luminance.end());
  // Where half of the picture is black, the median of the rest.
  if (std::count_if(luminance.begin(), luminance.end(), [](float v) { return v <= 0; }) * 2 >
          static_cast<std::ptrdiff_t>(luminance.size()) &&
      brightest > 0)
    std::erase_if(luminance, [](float v) { return v <= 0; });
  const auto middle = luminance.begin() + static_cast<std::ptrdiff_t>(luminance.size() / 2);
  std::nth_element(luminance.begin(), middle, luminance.end());
  const double smallest = std::numeric_limits<float>::epsilon();
  const double start = std::log2(shown / std::max(brightest, smallest));
  const double stop = std::log2(shown / std::max(static_cast<double>(*middle), smallest));
  const int count = static_cast<int>(std::max(2.0, std::ceil(stop - start)));
  std::vector<double> exposures;
  for (int i = 0; i < count; ++i) exposures.push_back(start + i * (stop - start) / (count - 1));
  return exposures;
}

Plane hdr_flip_map(const RgbPlanes& test, const RgbPlanes& reference, const Task& task, double pixels_per_degree) {
  Plane map(reference[0]->width(), reference[0]->height());
  for (const double exposure : hdr_flip_exposures(reference)) {
    const auto factor = static_cast<float>(std::exp2(exposure));
    add_largest(ToneMapped{test, factor}, ToneMapped{reference, factor}, pixels_per_degree, task, map);
  }
  return map;
}

}  // namespace brume
