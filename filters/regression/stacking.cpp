#include "filters/regression/stacking.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/parallel_for.h"
#include "filters/kernels/rows.h"
#include "filters/regression/lattice_regression.h"

namespace brume {
namespace {

constexpr int kSteps = 60;

/// The nearest point with non-negative parts of sum one. Source: Held, Wolfe and Crowder 1974.
void project(std::vector<double>& v) {
  std::vector<double> sorted = v;
  std::sort(sorted.begin(), sorted.end(), std::greater<>());
  double sum = 0, level = 0;
  for (size_t i = 0; i < sorted.size(); ++i) {
    sum += sorted[i];
    const double candidate = (sum - 1) / static_cast<double>(i + 1);
    if (sorted[i] > candidate) level = candidate;
  }
  for (double& x : v) x = std::max(0.0, x - level);
}

/// The symmetric matrix whose upper half lies in a row, less what all of it has in common: the noise that all
/// candidates are held against alike does not tell one from another.
template <class Number>
std::vector<double> matrix_of(const Number* upper, size_t n) {
  std::vector<double> d(n * n);
  for (size_t i = 0; i < n; ++i)
    for (size_t j = i; j < n; ++j) d[i * n + j] = d[j * n + i] = static_cast<double>(*upper++);
  const double common = *std::min_element(d.begin(), d.end());
  for (double& v : d) v -= common;
  return d;
}

}  // namespace

std::vector<double> simplex_minimum(const std::vector<double>& quadratic, const std::vector<double>& start) {
  const size_t n = start.size();
  double trace = 0;
  for (size_t i = 0; i < n; ++i) trace += std::abs(quadratic[i * n + i]);
  if (!(trace > 0)) return start;
  // Accelerated projected gradient; the largest eigenvalue is at most the trace.
  std::vector<double> x = start, previous = start, at = start;
  double momentum = 1;
  for (int step = 0; step < kSteps; ++step) {
    std::vector<double> next = at;
    for (size_t i = 0; i < n; ++i) {
      double gradient = 0;
      for (size_t j = 0; j < n; ++j) gradient += quadratic[i * n + j] * at[j];
      next[i] -= gradient / trace;
    }
    project(next);
    const double faster = 0.5 * (1 + std::sqrt(1 + 4 * momentum * momentum));
    double along = 0;
    for (size_t i = 0; i < n; ++i) along += (at[i] - next[i]) * (next[i] - x[i]);
    previous = x;
    x = next;
    if (along > 0) {
      momentum = 1;
      at = x;
    } else {
      for (size_t i = 0; i < n; ++i) at[i] = x[i] + (momentum - 1) / faster * (x[i] - previous[i]);
      momentum = faster;
    }
  }
  return x;
}

std::vector<Plane> stacking_weights(const std::vector<StoredPair>& candidates, const HalfPair& data,
                                    const Plane& weight, const StackingWindow& window, const Task& task) {
  const size_t n = candidates.size() + 1;
  const size_t size = n * (n + 1) / 2 + 1;  // sums of a block: products of errors, then pixels
  const int width = weight.width(), height = weight.height(), side = lattice_block(window.deviation);
  const int across = (width + side - 1) / side, down = (height + side - 1) / side;
  const std::vector<float> taps = lattice_taps(window.deviation / side);
  const int radius = static_cast<int>(taps.size()) / 2;
  std::vector<std::vector<float>> rows(static_cast<size_t>(down));
  parallel_for(down, quiet(task), [&](int r) {
    std::vector<float> row(static_cast<size_t>(across) * size);
    std::vector<float> da(n), db(n), change(n);
    // A row of both halves of every candidate, colour by colour.
    const size_t length = static_cast<size_t>(width);
    std::vector<float> fits(6 * (n - 1) * length);
    const auto fit = [&](size_t c, size_t i, size_t half) {
      return fits.data() + ((c * n + i - c) * 2 + half) * length;
    };
    for (int y = r * side; y < std::min(height, (r + 1) * side); ++y) {
      if (!std::any_of(weight.row(y), weight.row(y) + width, [](float w) { return w > 0; })) continue;
      for (size_t c = 0; c < 3; ++c)
        for (size_t i = 0; i + 1 < n; ++i) {
          candidates[i].a[c].read(y, 0, width, fit(c, i, 0));
          candidates[i].b[c].read(y, 0, width, fit(c, i, 1));
        }
      for (int x = 0; x < width; ++x) {
        const float w = weight(x, y);
        if (!(w > 0)) continue;
        float* to = row.data() + static_cast<size_t>(x / side) * size;
        to[size - 1] += 1;
        for (size_t c = 0; c < 3; ++c) {
          const float ya = data.a[c](x, y), yb = data.b[c](x, y);
          for (size_t i = 0; i < n; ++i) {
            const bool is_data = i + 1 == n;
            const float fa = is_data ? ya : fit(c, i, 0)[x], fb = is_data ? yb : fit(c, i, 1)[x];
            da[i] = yb - fa;
            db[i] = ya - fb;
            change[i] = fa - fb;
          }
          float* pair = to;
          for (size_t i = 0; i < n; ++i)
            for (size_t j = i; j < n; ++j)
              *pair++ += w * (0.5f * (da[i] * da[j] + db[i] * db[j]) - 0.25f * change[i] * change[j]);
        }
      }
    }
    std::vector<float>& out = rows[static_cast<size_t>(r)];
    out.resize(row.size());
    for (int i = 0; i < across; ++i) {
      const int first = std::max(0, i - radius), last = std::min(across - 1, i + radius);
      std::vector<const float*> sources;
      for (int j = first; j <= last; ++j) sources.push_back(row.data() + static_cast<size_t>(j) * size);
      kernels::weighted_sum_rows(sources.data(), taps.data() + (first - i + radius), last - first + 1,
                                 out.data() + static_cast<size_t>(i) * size, static_cast<int>(size));
    }
  });
  std::vector<double> whole(size);
  for (const auto& row : rows)
    for (size_t i = 0; i < row.size(); ++i) whole[i % size] += static_cast<double>(row[i]);
  const std::vector<double> frame_matrix = matrix_of(whole.data(), n);
  const std::vector<double> frame_weights =
      simplex_minimum(frame_matrix, std::vector<double>(n, 1.0 / static_cast<double>(n)));
  std::vector<std::vector<float>> nodes(static_cast<size_t>(down));
  parallel_for(down, quiet(task), [&](int r) {
    std::vector<float> blurred(static_cast<size_t>(across) * size);
    const int first = std::max(0, r - radius), last = std::min(down - 1, r + radius);
    std::vector<const float*> sources;
    for (int j = first; j <= last; ++j) sources.push_back(rows[static_cast<size_t>(j)].data());
    kernels::weighted_sum_rows(sources.data(), taps.data() + (first - r + radius), last - first + 1, blurred.data(),
                               static_cast<int>(blurred.size()));
    std::vector<float>& out = nodes[static_cast<size_t>(r)];
    for (int i = 0; i < across; ++i) {
      const float* from = blurred.data() + static_cast<size_t>(i) * size;
      const double pixels = static_cast<double>(from[size - 1]);
      std::vector<double> best = frame_weights;
      if (pixels > 0) {
        std::vector<double> d = matrix_of(from, n);
        // As though so many more pixels had been seen that are like the frame's average.
        const double share = window.caution / std::max(1.0, whole[size - 1]);
        for (size_t k = 0; k < d.size(); ++k) d[k] += share * frame_matrix[k];
        best = simplex_minimum(d, frame_weights);
      }
      for (const double v : best) out.push_back(static_cast<float>(v));
    }
  });
  std::vector<Plane> maps;
  for (size_t i = 0; i < n; ++i) maps.emplace_back(width, height);
  const SplinePlaces places_x(width, side, across), places_y(height, side, down);
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<float> row(nodes[0].size());
    const float* sources[3];
    for (size_t i = 0; i < 3; ++i)
      sources[i] = nodes[static_cast<size_t>(places_y.nodes[3 * static_cast<size_t>(y) + i])].data();
    kernels::weighted_sum_rows(sources, places_y.weights.data() + 3 * static_cast<size_t>(y), 3, row.data(),
                               static_cast<int>(row.size()));
    for (int x = 0; x < width; ++x) {
      const int* node = places_x.nodes.data() + 3 * static_cast<size_t>(x);
      const float* w = places_x.weights.data() + 3 * static_cast<size_t>(x);
      for (size_t i = 0; i < n; ++i)
        maps[i](x, y) = w[0] * row[static_cast<size_t>(node[0]) * n + i] +
                        w[1] * row[static_cast<size_t>(node[1]) * n + i] +
                        w[2] * row[static_cast<size_t>(node[2]) * n + i];
    }
  });
  return maps;
}

}  // namespace brume
