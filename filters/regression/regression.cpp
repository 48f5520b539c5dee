#include "filters/regression/regression.h"

#include <algorithm>
#include <bit>

#include "base/parallel_for.h"
#include "filters/kernels/regression.h"

namespace brume {
namespace {

// Relative growth of the diagonal, and what a column of zeros gets: enough for float sums, too little to be seen.
constexpr float kRidge = 3e-6f, kFloor = 1e-7f;
// The pixel itself counts at least this much, however unlike its neighbours it is.
constexpr float kCentreWeight = 1e-4f;

/// Spans of a power of two, doubled step by step; two of them cover a window.
template <class Better>
Plane extreme(const Plane& in, int radius, const Task& task, const Better& better) {
  const int width = in.width(), height = in.height(), whole = 2 * radius + 1;
  const int longest = static_cast<int>(std::bit_floor(static_cast<unsigned>(whole)));
  // Beyond the edges stands what every window there holds anyway.
  Plane padded(width, height + 2 * radius), out(width, height);
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<float> row(static_cast<size_t>(width + 2 * radius));
    for (int i = 0; i < width + 2 * radius; ++i)
      row[static_cast<size_t>(i)] = in(std::clamp(i - radius, 0, width - 1), y);
    float* const v = row.data();
    for (int span = 1; span < longest; span *= 2)
      for (int i = 0; i + span < width + 2 * radius; ++i) v[i] = better(v[i], v[i + span]);
    float* const to = padded.row(y + radius);
    for (int x = 0; x < width; ++x) to[x] = better(v[x], v[x + whole - longest]);
  });
  constexpr int kStrip = 64;
  parallel_for((width + kStrip - 1) / kStrip, quiet(task), [&](int strip) {
    const int x0 = strip * kStrip, n = std::min(kStrip, width - x0);
    const auto row = [&](int y) { return padded.row(y) + x0; };
    for (int y = 0; y < radius; ++y) {
      std::copy_n(row(radius), n, row(y));
      std::copy_n(row(radius + height - 1), n, row(radius + height + y));
    }
    for (int span = 1; span < longest; span *= 2)
      for (int y = 0; y + span < height + 2 * radius; ++y)
        for (int x = 0; x < n; ++x) row(y)[x] = better(row(y)[x], row(y + span)[x]);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < n; ++x) out.row(y)[x0 + x] = better(row(y)[x], row(y + whole - longest)[x]);
  });
  return out;
}

}  // namespace

Plane window_maximum(const Plane& in, int radius, const Task& task) {
  return extreme(in, radius, task, [](float a, float b) { return a > b ? a : b; });
}

Plane window_minimum(const Plane& in, int radius, const Task& task) {
  return extreme(in, radius, task, [](float a, float b) { return a < b ? a : b; });
}

std::vector<Plane> collaborative_regression(std::span<const RegressionFrame> frames, int radius, const Task& task,
                                            const Plane* wanted) {
  const std::span<const Plane*const> features = frames[0].features, values = frames[0].values;
  const int width = values[0]->width(), height = values[0]->height();
  const int n = static_cast<int>(features.size()) + 3, m = static_cast<int>(values.size()), side = 2 * radius + 1;
  std::vector<Plane> sums;
  for (size_t c = 0; c < values.size(); ++c) sums.emplace_back(width, height);
  Plane total(width, height);
  std::vector<Plane*> targets;
  for (Plane& p : sums) targets.push_back(&p);

  std::vector<Plane> lowest, highest;
  for (size_t c = 0; c < values.size(); ++c)
    for (const RegressionFrame& f : frames) {
      Plane low = window_minimum(*f.values[c], radius, task), high = window_maximum(*f.values[c], radius, task);
      if (&f == &frames[0]) {
        lowest.push_back(std::move(low));
        highest.push_back(std::move(high));
        continue;
      }
      for_each_row(height, quiet(task), [&](int y) {
        for (int x = 0; x < width; ++x) {
          lowest[c](x, y) = std::min(lowest[c](x, y), low(x, y));
          highest[c](x, y) = std::max(highest[c](x, y), high(x, y));
        }
      });
    }

  // A block's predictions reach `radius` beyond it. Blocks of one colour of a 2 x 2 pattern are far enough apart to run
  // at once, and the colours follow one another: every pixel's sum has one order, for any number of threads.
  const int kWidth = 64, block_height = std::max(20, side + 1), block_width = std::max(kWidth, side + 1);
  const int across = (width + block_width - 1) / block_width, down = (height + block_height - 1) / block_height;
  const size_t stride = static_cast<size_t>((block_width + 15) / 16 * 16);
  const size_t plane = stride * static_cast<size_t>(block_height);
  for (int colour = 0; colour < 4; ++colour) {
    std::vector<Box> blocks;
    for (int by = colour / 2; by < down; by += 2)
      for (int bx = colour % 2; bx < across; bx += 2) {
        const Box block{bx * block_width, by * block_height, std::min(width, (bx + 1) * block_width),
                        std::min(height, (by + 1) * block_height)};
        if (!wanted || any_above_0(*wanted, block.grown(radius, width, height))) blocks.push_back(block);
      }
    parallel_for(static_cast<int>(blocks.size()), share(task, 0.25 * colour, 0.25 * (colour + 1)), [&](int i) {
      const Box& block = blocks[static_cast<size_t>(i)];
      kernels::WeightScratch scratch;
      const size_t window = plane * static_cast<size_t>(side * side);
      std::vector<float> weights(window * frames.size());
      const auto weight_of = [&](size_t f, int dx, int dy) {
        return weights.data() + window * f + plane * static_cast<size_t>((dy + radius) * side + dx + radius);
      };
      for (size_t f = 0; f < frames.size(); ++f)
        for (int dy = -radius; dy <= radius; ++dy)
          for (int dx = -radius; dx <= radius; ++dx) {
            float* const w = weight_of(f, dx, dy);
            kernels::block_distances(frames[f].model, block, dx, dy, scratch, w, stride);
            kernels::block_weights(frames[f].model, {width, height}, block, dx, dy, w, 1, nullptr, w, stride);
          }
      std::vector<float> a(stride * static_cast<size_t>(n * (n + 1) / 2)), b(stride * static_cast<size_t>(n * m)),
          work(kernels::normal_scratch(features.size(), values.size(), stride));
      for (int y = block.y0; y < block.y1; ++y) {
        if (wanted && !any_above_0(*wanted, Box{block.x0, y, block.x1, y + 1}.grown(radius, width, height))) continue;
        const size_t line = stride * static_cast<size_t>(y - block.y0);
        float* centre = weight_of(0, 0, 0) + line;
        for (int x = 0; x < block.width(); ++x) centre[x] = std::max(centre[x], kCentreWeight);
        std::fill(a.begin(), a.end(), 0.0f);
        std::fill(b.begin(), b.end(), 0.0f);
        const int top = std::max(-radius, -y), bottom = std::min(radius, height - 1 - y);
        // Where the whole window is inside, neighbours are taken several at once; beside the edges one by one.
        for (size_t f = 0; f < frames.size(); ++f) {
          const auto row = [&](int x0, int count) {
            return kernels::RegressionRow{features, values, frames[f].features, frames[f].values, x0, y, count,
                                          radius,   stride};
          };
          for (int dy = top; dy <= bottom; ++dy) {
            if (block.x0 - radius >= 0 && block.x1 + radius <= width) {
              kernels::accumulate_normal(row(block.x0, block.width()), weight_of(f, -radius, dy) + line, plane, -radius,
                                         dy, side, work.data(), a.data(), b.data());
              continue;
            }
            for (int dx = -radius; dx <= radius; ++dx) {
              const int first = std::max(block.x0, -dx), last = std::min(block.x1, width - dx);
              if (first >= last) continue;
              const size_t skip = static_cast<size_t>(first - block.x0);
              kernels::accumulate_normal(row(first, last - first), weight_of(f, dx, dy) + line + skip, plane, dx, dy, 1,
                                         work.data(), a.data() + skip, b.data() + skip);
            }
          }
        }
        kernels::solve_rows(a.data(), b.data(), n, m, block.width(), stride, kRidge, kFloor);
        for (int dy = top; dy <= bottom; ++dy)
          for (int dx = -radius; dx <= radius; ++dx) {
            const int first = std::max(block.x0, -dx), last = std::min(block.x1, width - dx);
            if (first >= last) continue;
            const size_t skip = static_cast<size_t>(first - block.x0);
            kernels::scatter_prediction({features, values, features, values, first, y, last - first, radius, stride},
                                        weight_of(0, dx, dy) + line + skip, dx, dy, b.data() + skip, lowest, highest,
                                        targets, total);
          }
      }
    });
  }
  for (Plane& sum : sums)
    for_each_row(height, quiet(task), [&](int y) {
      for (int x = 0; x < width; ++x)
        if (total(x, y) > 0) sum(x, y) /= total(x, y);
    });
  return sums;
}

}  // namespace brume
