#include "filters/regression/transport/lattice_regression.h"

#include <algorithm>
#include <cmath>

#include "base/parallel_for.h"
#include "filters/kernels/moments.h"
#include "filters/kernels/regression.h"
#include "filters/regression/transport/block_lattice.h"

namespace brume {
namespace {

constexpr double kCoefficientBlur = 0.6;  // deviation of the coefficients' smoothing, in windows
constexpr int kGlobalBlock = 32;          // where one window is the frame: sums stay short
constexpr double kDependent = 3e-6;       // share of a column that the free ones leave: less is rounding
constexpr size_t kCounts = 16;            // floats behind the products: sum of weights, and of their squares

size_t padded(size_t n) {
  return (n + 15) / 16 * 16;
}

/// Sizes of one problem on its lattice.
struct Shape : BlockLattice {
  size_t columns, targets, stride, products, node;  // `node`: floats of a node's sums
  size_t used, coefficients;                        // per target; of a node, its weight behind them

  Shape(const LatticeProblem& p, int side)
      : BlockLattice(p.weight->width(), p.weight->height(), side),
        columns(p.columns.size()),
        targets(p.targets.size()),
        stride(padded(columns + targets)),
        products(kernels::product_floats(columns, stride)),
        node(products + kCounts),
        used(padded(columns)),
        coefficients(targets * used + 16) {}
  size_t weight() const { return targets * used; }
};

// Pixels of a row that are packed at a time, so that what is packed stays in cache.
constexpr int kChunk = 64;

/// The columns of some pixels, one row after another.
class PackedColumns {
 public:
  /// @param most  pixels at a time
  PackedColumns(const LatticePixels& pixels, int most)
      : pixels_(pixels),
        most_(static_cast<size_t>(most)),
        room_((pixels.columns.size() + 1) * most_),
        rows_((pixels.columns.size() + 3) / 4 * 4, room_.data() + pixels.columns.size() * most_),  // behind them zeros
        offsets_(rows_.size()),
        scales_(rows_.size()) {
    for (size_t k = 0; k < pixels.columns.size(); ++k) {
      offsets_[k] = pixels.columns[k].offset;
      scales_[k] = pixels.columns[k].scale;
    }
  }
  /// out[x][k] = factors[x] times column k at the pixels from..to of a row.
  void pack(int y, int from, int to, const float* factors, float* const* out) {
    kernels::pack_columns(rows(y, from, to), factors, static_cast<size_t>(to - from), out);
  }
  /// The pixels from..to of a row.
  kernels::ColumnRows rows(int y, int from, int to) {
    for (size_t k = 0; k < pixels_.columns.size(); ++k)
      rows_[k] = pixels_.columns[k].values.row(y, from, to, room_.data() + k * most_);
    return {rows_.data(), offsets_.data(), scales_.data(), rows_.size()};
  }

 private:
  const LatticePixels& pixels_;
  size_t most_;
  std::vector<float> room_;
  std::vector<const float*> rows_;
  std::vector<float> offsets_, scales_;
};

/// Adds up the pixels of a row of blocks.
void add_blocks(const LatticePixels& p, const Shape& s, int row, float* nodes) {
  const int width = p.weight->width(), height = p.weight->height(), side = s.block;
  const int first_row = row * side, last_row = std::min(height, first_row + side);
  const int together = std::max(1, kChunk / side);  // blocks
  const auto most = static_cast<size_t>(std::max(side, kChunk)),
             block = most * s.stride;  // pixels of a block at a time
  std::vector<float> vectors(static_cast<size_t>(together) * block), root(static_cast<size_t>(together * side));
  std::vector<float*> places(root.size());
  std::vector<size_t> packed(static_cast<size_t>(together));
  PackedColumns columns(p, together * side);
  const auto add_packed = [&](int b, size_t at) {
    if (packed[at] > 0)
      kernels::add_products(vectors.data() + at * block, packed[at], s.stride, s.columns,
                            nodes + static_cast<size_t>(b) * s.node);
    packed[at] = 0;
  };
  for (int b0 = 0; b0 < s.across; b0 += together) {
    const int begin = b0 * side, end = std::min(width, begin + together * side);
    for (int y = first_row; y < last_row; ++y) {
      const float* w = p.weight->row(y);
      bool any_at_all = false;
      for (int b = b0; b * side < end; ++b) {
        float* const node = nodes + static_cast<size_t>(b) * s.node;
        const auto at = static_cast<size_t>(b - b0);
        if (packed[at] + static_cast<size_t>(side) > most) add_packed(b, at);
        float* const own = vectors.data() + at * block + packed[at] * s.stride;
        bool any = false;
        for (int x = b * side; x < std::min(end, (b + 1) * side); ++x) {
          const auto i = static_cast<size_t>(x - begin);
          root[i] = w[x] > 0 ? std::sqrt(w[x]) : 0.0f;
          places[i] = own + static_cast<size_t>(x - b * side) * s.stride;
          any |= w[x] > 0;
          node[s.products] += w[x];
          node[s.products + 1] += w[x] * w[x];
        }
        // Rows of a block that count nothing are written over.
        if (any) packed[at] += static_cast<size_t>(std::min(end, (b + 1) * side) - b * side);
        any_at_all |= any;
      }
      if (!any_at_all) continue;
      columns.pack(y, begin, end, root.data(), places.data());
      for (size_t t = 0; t < s.targets; ++t) {
        const float* const v = p.targets[t]->row(y) + begin;
        for (size_t i = 0; i < static_cast<size_t>(end - begin); ++i) places[i][s.columns + t] = root[i] * v[i];
      }
    }
    for (int b = b0; b * side < end; ++b) add_packed(b, static_cast<size_t>(b - b0));
  }
}

/// Solves the normal equations of nodes, several at a time.
class Solver {
 public:
  Solver(const Shape& shape, size_t free, const LatticeWindow& window)
      : s_(shape),
        free_(free),
        window_(window),
        a_(kernels::kTogether * s_.columns * (s_.columns + 1) / 2),
        b_(kernels::kTogether * s_.columns * s_.targets),
        variance_(kernels::kTogether * s_.columns) {}

  /// @param sums  products and counts of `nodes` nodes    @param out  coefficients, then the node's weight; zeroed
  /// before
  template <class Number>
  void solve(const Number* sums, size_t nodes, float* out) {
    size_t chosen[kernels::kTogether], count = 0;
    for (size_t i = 0; i < nodes; ++i) {
      if (sums[i * s_.node + s_.products] > 0) chosen[count++] = i;
      if (count < kernels::kTogether && (i + 1 < nodes || count == 0)) continue;
      double ridge[kernels::kTogether] = {};
      for (size_t x = 0; x < kernels::kTogether; ++x) ridge[x] = load(sums + chosen[x < count ? x : 0] * s_.node, x);
      kernels::solve_together(a_.data(), b_.data(), variance_.data(), s_.columns, s_.targets, free_, ridge, kDependent);
      for (size_t x = 0; x < count; ++x) {
        float* const to = out + chosen[x] * s_.coefficients;
        for (size_t k = 0; k < s_.columns; ++k)
          for (size_t t = 0; t < s_.targets; ++t)
            to[t * s_.used + k] = static_cast<float>(b_[(k * s_.targets + t) * kernels::kTogether + x]);
        to[s_.weight()] = static_cast<float>(sums[chosen[x] * s_.node + s_.products]);
      }
      count = 0;
    }
  }

 private:
  /// A node's means of products, as the x-th of those that are solved together; returns its ridge.
  template <class Number>
  double load(const Number* sums, size_t x) {
    const double weight = static_cast<double>(sums[s_.products]), squares = static_cast<double>(sums[s_.products + 1]);
    const double share = 1 / weight;
    double *a = a_.data() + x, *b = b_.data() + x;
    for (size_t i = 0; i < s_.columns; ++i) {
      const Number* const row = sums + kernels::product_index(i, i, s_.stride);
      for (size_t j = 0; j < s_.columns - i; ++j, a += kernels::kTogether) *a = share * static_cast<double>(row[j]);
      for (size_t j = s_.columns - i; j < s_.columns - i + s_.targets; ++j, b += kernels::kTogether)
        *b = share * static_cast<double>(row[j]);
    }
    const double pixels = weight * weight / std::max(squares, 1e-30);
    return window_.ridge + window_.ridge_per_pixel / pixels;
  }

  const Shape& s_;
  size_t free_;
  const LatticeWindow& window_;
  std::vector<double> a_, b_, variance_;
};

/// Coefficients of every node, their weights behind them, from sums that are blurred along the rows already.
LatticeRows solve_nodes(const LatticeProblem& p, const LatticeWindow& window, const Shape& s, const LatticeRows& sums,
                        const std::vector<float>& taps, const Task& task) {
  LatticeRows nodes(static_cast<size_t>(s.down));
  parallel_for(s.down, quiet(task), [&](int r) {
    const std::vector<float> blurred = blurred_down(sums, r, taps);
    std::vector<float>& out = nodes[static_cast<size_t>(r)];
    out.assign(static_cast<size_t>(s.across) * s.coefficients, 0.0f);
    Solver(s, p.free, window).solve(blurred.data(), static_cast<size_t>(s.across), out.data());
    // Coefficients are averaged by weight.
    for (int i = 0; i < s.across; ++i) {
      float* const node = out.data() + static_cast<size_t>(i) * s.coefficients;
      for (size_t k = 0; k < s.weight(); ++k) node[k] *= node[s.weight()];
    }
  });
  return nodes;
}

void divide_by_weight(float* node, const Shape& s) {
  const float weight = node[s.weight()];
  const float scale = weight > 0 ? 1.0f / weight : 0.0f;
  for (size_t k = 0; k < s.weight(); ++k) node[k] *= scale;
}

LatticeRows smooth(LatticeRows nodes, const Shape& s, double deviation, const Task& task) {
  const std::vector<float> taps = lattice_taps(deviation);
  LatticeRows out(nodes.size());
  parallel_for(s.down, quiet(task), [&](int r) {
    std::vector<float>& row = nodes[static_cast<size_t>(r)];
    row = blurred_along(row, s.coefficients, taps);
  });
  parallel_for(s.down, quiet(task), [&](int r) {
    std::vector<float>& row = out[static_cast<size_t>(r)] = blurred_down(nodes, r, taps);
    for (int b = 0; b < s.across; ++b) divide_by_weight(row.data() + static_cast<size_t>(b) * s.coefficients, s);
  });
  return out;
}

std::vector<Plane> predict(const LatticePixels& p, const Shape& s, const LatticeRows& nodes, const Task& task) {
  const int width = p.weight->width(), height = p.weight->height();
  std::vector<Plane> out;
  for (size_t t = 0; t < s.targets; ++t) out.emplace_back(width, height);
  const SplinePlaces along(width, s.block, s.across), down(height, s.block, s.down);
  for_each_row(height, quiet(task), [&](int y) {
    const float* w = p.weight->row(y);
    int from = 0, to = width;
    while (from < to && !(w[from] > 0)) ++from;
    while (to > from && !(w[to - 1] > 0)) --to;
    if (from == to) return;
    const std::vector<float> coefficients = down.between(nodes, y);
    std::vector<float> vectors(static_cast<size_t>(kChunk) * s.used);
    const std::vector<float> ones(static_cast<size_t>(kChunk), 1.0f);
    std::vector<float*> places;
    for (size_t i = 0; i < ones.size(); ++i) places.push_back(vectors.data() + i * s.used);
    PackedColumns columns(p, kChunk);
    for (int begin = from; begin < to; begin += kChunk) {
      const int end = std::min(to, begin + kChunk);
      columns.pack(y, begin, end, ones.data(), places.data());
      std::vector<float*> results;
      for (Plane& plane : out) results.push_back(plane.row(y) + begin);
      const size_t first = 3 * static_cast<size_t>(begin);
      kernels::predict_row(vectors.data(), static_cast<size_t>(end - begin),
                           {coefficients.data(), along.nodes.data() + first, along.weights.data() + first,
                            s.coefficients, s.targets, s.used, s.used, s.used},
                           results.data());
    }
    for (Plane& plane : out)
      for (int x = from; x < to; ++x)
        if (!(w[x] > 0)) plane(x, y) = 0;
  });
  return out;
}

/// Sums over all nodes.
std::vector<double> sum_of_nodes(const LatticeRows& sums, const Shape& s) {
  std::vector<double> whole(s.node);
  for (const std::vector<float>& row : sums)
    for (size_t i = 0; i < row.size(); ++i) whole[i % s.node] += static_cast<double>(row[i]);
  return whole;
}

/// Takes what coefficients explain off the targets' products.
void explain(const Shape& s, const float* coefficients, std::vector<double>& sums) {
  for (size_t t = 0; t < s.targets; ++t)
    for (size_t i = 0; i < s.columns; ++i) {
      double& product = sums[kernels::product_index(i, s.columns + t, s.stride)];
      for (size_t j = 0; j < s.columns; ++j)
        product -= static_cast<double>(coefficients[t * s.used + j]) *
                   sums[kernels::product_index(std::min(i, j), std::max(i, j), s.stride)];
    }
}

/// Predictions with the same coefficients everywhere, those of each fit one after another.
std::vector<Plane> predict_frame(const LatticePixels& p, const Shape& s, const std::vector<float>& coefficients,
                                 const Task& task) {
  constexpr int kRun = 4 * kChunk;
  const int width = p.weight->width(), height = p.weight->height();
  std::vector<Plane> out;
  for (size_t t = 0; t < coefficients.size() / s.used; ++t) out.push_back(Plane::unset(width, height));
  for_each_row(height, quiet(task), [&](int y) {
    PackedColumns columns(p, kRun);
    std::vector<float*> results(out.size());
    for (int from = 0; from < width; from += kRun) {
      const int to = std::min(width, from + kRun);
      for (size_t t = 0; t < out.size(); ++t) results[t] = out[t].row(y) + from;
      kernels::add_columns_up(columns.rows(y, from, to), coefficients.data(), s.used, out.size(),
                              static_cast<size_t>(to - from), results.data());
    }
    const float* const w = p.weight->row(y);
    for (Plane& plane : out)
      for (int x = 0; x < width; ++x) plane(x, y) = w[x] > 0 ? plane(x, y) : 0.0f;
  });
  return out;
}

/// One window, the frame.
std::vector<Plane> frame_regression(const LatticeProblem& problem, const LatticeWindow& window, const Task& task,
                                    const std::function<void(size_t, std::vector<Plane>)>& take) {
  const Shape s(problem, kGlobalBlock);
  LatticeRows rows(static_cast<size_t>(s.down));
  parallel_for(s.down, quiet(task), [&](int r) {
    std::vector<float>& row = rows[static_cast<size_t>(r)];
    row.assign(static_cast<size_t>(s.across) * s.node, 0.0f);
    add_blocks(problem, s, r, row.data());
    for (const LatticePixels& other : problem.nearby) add_blocks(other, s, r, row.data());
  });
  task.check();
  std::vector<double> sums = sum_of_nodes(rows, s);
  std::vector<float> coefficients;
  for (size_t fit = 0; fit <= window.then.size(); ++fit) {
    const LatticeWindow step{0, window.ridge, fit == 0 ? window.ridge_per_pixel : window.then[fit - 1]};
    std::vector<float> node(s.coefficients);
    Solver(s, problem.free, step).solve(sums.data(), 1, node.data());
    coefficients.insert(coefficients.end(), node.data(), node.data() + s.weight());
    explain(s, node.data(), sums);
  }
  for (size_t i = 0; take && i < problem.nearby.size(); ++i)
    take(i, predict_frame(problem.nearby[i], s, coefficients, task));
  return predict_frame(problem, s, coefficients, task);
}

}  // namespace

std::vector<LatticeColumn> standardised(std::vector<LatticeColumn> columns, const Plane& weight, const Task& task) {
  parallel_for(static_cast<int>(columns.size()), quiet(task), [&](int i) {
    const ChannelView &column = columns[static_cast<size_t>(i)].values, &first = columns[0].values;
    const int width = weight.width();
    std::vector<float> room(2 * static_cast<size_t>(width));
    kernels::WeightedProducts sums;
    for (int y = 0; y < weight.height(); ++y)
      kernels::add_weighted_products(weight.row(y), first.row(y, 0, width, room.data() + width),
                                     column.row(y, 0, width, room.data()), static_cast<size_t>(width), sums);
    const auto [total, base, cross, own] = sums;
    const double offset = i == 0 || !(base > 0) ? 0.0 : cross / base;
    const double left = own - offset * cross;
    const bool nothing = !(total > 0) || !(left > kDependent * own);
    columns[static_cast<size_t>(i)].offset = static_cast<float>(offset);
    columns[static_cast<size_t>(i)].scale = nothing ? 0.0f : static_cast<float>(std::sqrt(total / left));
  });
  return columns;
}

std::vector<Plane> lattice_regression(const LatticeProblem& problem, const LatticeWindow& window, const Task& task,
                                      const std::function<void(size_t, std::vector<Plane>)>& take) {
  if (!(window.deviation > 0)) return frame_regression(problem, window, task, take);
  const Shape s(problem, BlockLattice::block_for(window.deviation));
  const double in_blocks = window.deviation / s.block;
  const std::vector<float> taps = lattice_taps(in_blocks);
  LatticeRows sums(static_cast<size_t>(s.down));
  parallel_for(s.down, quiet(task), [&](int r) {
    std::vector<float> row(static_cast<size_t>(s.across) * s.node);
    add_blocks(problem, s, r, row.data());
    for (const LatticePixels& other : problem.nearby) add_blocks(other, s, r, row.data());
    sums[static_cast<size_t>(r)] = blurred_along(row, s.node, taps);
  });
  task.check();
  LatticeRows nodes = solve_nodes(problem, window, s, sums, taps, task);
  sums.clear();
  nodes = smooth(std::move(nodes), s, kCoefficientBlur * in_blocks, task);
  for (size_t i = 0; take && i < problem.nearby.size(); ++i) take(i, predict(problem.nearby[i], s, nodes, task));
  return predict(problem, s, nodes, task);
}

std::vector<Plane> local_ratio(const std::vector<const Plane*>& targets, const Plane& base, const Plane& weight,
                               double window, const Task& task) {
  return lattice_regression({{{{&base}}, targets, &weight}}, {window, 0, 0}, task);
}

}  // namespace brume
