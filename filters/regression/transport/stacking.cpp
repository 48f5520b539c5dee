#include "filters/regression/transport/stacking.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/parallel_for.h"
#include "filters/regression/transport/block_lattice.h"

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

/// Floats of a node: products of errors, squares of what each candidate gains over the first, then pixels.
size_t node_floats(size_t candidates) {
  return candidates * (candidates + 1) / 2 + candidates + 1;
}

/// Adds to pi^T D pi, sum pi = 1, the price of each candidate, sum of price_i pi_i.
void add_prices(const std::vector<double>& price, std::vector<double>& d) {
  const size_t n = price.size();
  for (size_t i = 0; i < n; ++i)
    for (size_t j = 0; j < n; ++j) d[i * n + j] += 0.5 * (price[i] + price[j]);
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

namespace {

/// Sums over a row of blocks of the products of two candidates' errors, the part above the diagonal, then of pixels.
std::vector<float> products_of_errors(const std::vector<StoredPair>& candidates, const HalfPair& data,
                                      const Plane& weight, const BlockLattice& lattice, int block_row) {
  const size_t n = candidates.size() + 1, size = node_floats(n), length = static_cast<size_t>(lattice.width);
  std::vector<float> row(static_cast<size_t>(lattice.across) * size);
  std::vector<float> da(n), db(n), change(n), gain(n);
  // A row of both halves of every candidate, colour by colour.
  std::vector<float> fits(6 * (n - 1) * length);
  const auto fit = [&](size_t c, size_t i, size_t half) {
    return fits.data() + ((c * (n - 1) + i) * 2 + half) * length;
  };
  const int last = std::min(lattice.height, (block_row + 1) * lattice.block);
  for (int y = block_row * lattice.block; y < last; ++y) {
    if (std::none_of(weight.row(y), weight.row(y) + length, [](float w) { return w > 0; })) continue;
    for (size_t c = 0; c < 3; ++c)
      for (size_t i = 0; i + 1 < n; ++i) {
        candidates[i].a[c].read(y, 0, lattice.width, fit(c, i, 0));
        candidates[i].b[c].read(y, 0, lattice.width, fit(c, i, 1));
      }
    for (int x = 0; x < lattice.width; ++x) {
      const float w = weight(x, y);
      if (!(w > 0)) continue;
      float* to = row.data() + static_cast<size_t>(x / lattice.block) * size;
      to[size - 1] += 1;
      std::fill(gain.begin(), gain.end(), 0.0f);
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
        const auto product = [&](size_t i, size_t j) {
          return w * (0.5f * (da[i] * da[j] + db[i] * db[j]) - 0.25f * change[i] * change[j]);
        };
        for (size_t i = 0; i < n; ++i) {
          gain[i] += product(0, 0) - product(i, i);
          for (size_t j = i; j < n; ++j) *pair++ += product(i, j);
        }
      }
      for (size_t i = 0; i < n; ++i) to[size - 1 - n + i] += gain[i] * gain[i];
    }
  }
  return row;
}

/// A map of each weight, from the nodes'.
std::vector<Plane> maps_of(const LatticeRows& nodes, const BlockLattice& lattice, size_t n, const Task& task) {
  std::vector<Plane> maps;
  for (size_t i = 0; i < n; ++i) maps.emplace_back(lattice.width, lattice.height);
  const SplinePlaces along(lattice.width, lattice.block, lattice.across),
      down(lattice.height, lattice.block, lattice.down);
  for_each_row(lattice.height, quiet(task), [&](int y) {
    const std::vector<float> row = down.between(nodes, y);
    for (int x = 0; x < lattice.width; ++x) {
      const int* node = along.nodes.data() + 3 * static_cast<size_t>(x);
      const float* w = along.weights.data() + 3 * static_cast<size_t>(x);
      const auto at = [&](int k, size_t i) { return w[k] * row[static_cast<size_t>(node[k]) * n + i]; };
      for (size_t i = 0; i < n; ++i) maps[i](x, y) = at(0, i) + at(1, i) + at(2, i);
    }
  });
  return maps;
}

}  // namespace

std::vector<Plane> stacking_weights(const std::vector<StoredPair>& candidates, const HalfPair& data,
                                    const Plane& weight, const StackingWindow& window, const Task& task) {
  const size_t n = candidates.size() + 1, size = node_floats(n);
  const BlockLattice lattice(weight.width(), weight.height(), BlockLattice::block_for(window.deviation));
  const std::vector<float> taps = lattice_taps(window.deviation / lattice.block);
  LatticeRows sums(static_cast<size_t>(lattice.down));
  parallel_for(lattice.down, quiet(task), [&](int r) {
    sums[static_cast<size_t>(r)] = blurred_along(products_of_errors(candidates, data, weight, lattice, r), size, taps);
  });
  std::vector<double> whole(size);
  for (const std::vector<float>& row : sums)
    for (size_t i = 0; i < row.size(); ++i) whole[i % size] += static_cast<double>(row[i]);
  const std::vector<double> frame_matrix = matrix_of(whole.data(), n);
  const double* const frame_squares = whole.data() + size - 1 - n;
  /// What candidates must gain over the first, from sums of squares in a window and over so large a share of the frame.
  const auto prices = [&](const float* squares, double share) {
    std::vector<double> price(n);
    for (size_t i = 0; i < n; ++i)
      price[i] = window.doubt *
                 std::sqrt((squares ? 0.5 * static_cast<double>(squares[i]) : 0.0) + share * share * frame_squares[i]);
    return price;
  };
  std::vector<double> priced = frame_matrix;
  add_prices(prices(nullptr, 1), priced);
  const std::vector<double> frame_weights =
      simplex_minimum(priced, std::vector<double>(n, 1.0 / static_cast<double>(n)));
  LatticeRows nodes(static_cast<size_t>(lattice.down));
  parallel_for(lattice.down, quiet(task), [&](int r) {
    const std::vector<float> blurred = blurred_down(sums, r, taps);
    for (int i = 0; i < lattice.across; ++i) {
      const float* from = blurred.data() + static_cast<size_t>(i) * size;
      std::vector<double> best = frame_weights;
      if (from[size - 1] > 0) {
        std::vector<double> d = matrix_of(from, n);
        // As though so many more pixels had been seen that are like the frame's average.
        const double share = window.caution / std::max(1.0, whole[size - 1]);
        for (size_t k = 0; k < d.size(); ++k) d[k] += share * frame_matrix[k];
        add_prices(prices(from + size - 1 - n, share), d);
        best = simplex_minimum(d, frame_weights);
      }
      for (const double v : best) nodes[static_cast<size_t>(r)].push_back(static_cast<float>(v));
    }
  });
  return maps_of(nodes, lattice, n, task);
}

}  // namespace brume
