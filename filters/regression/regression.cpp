#include "filters/regression/regression.h"

#include <hwy/aligned_allocator.h>

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

using Aligned = hwy::AlignedFreeUniquePtr<float[]>;
Aligned aligned(size_t count) {
  return hwy::AllocateAligned<float>(count);
}

constexpr int kLanes = static_cast<int>(kernels::kRegressionLanes);

/// Copies of blocks and of what is within `radius` of them, plane by plane: neighbours are then read without checks
/// for the edges of the image.
struct Surroundings {
  int radius, rows;
  size_t pitch, plane;
  Surroundings(int window_radius, int width, int height)
      : radius(window_radius),
        rows(height + 2 * radius),
        // An odd number of cache lines, as in Plane.
        pitch(static_cast<size_t>(((width + 2 * radius + kLanes - 1) / kLanes | 1) * kLanes)),
        plane(pitch * static_cast<size_t>(rows)) {}

  /// Of the first plane, (x, y) from the block's first pixel.
  float* at(const Aligned& data, int x, int y) const {
    return data.get() + pitch * static_cast<size_t>(y + radius) + (x + radius);
  }
  /// Features, then values; 0 outside of the image.
  Aligned copy(const RegressionFrame& frame, const Box& block) const {
    Aligned to = aligned(plane * (frame.features.size() + frame.values.size()));
    std::fill_n(to.get(), plane * (frame.features.size() + frame.values.size()), 0.0f);
    const Box from = block.grown(radius, frame.values[0]->width(), frame.values[0]->height());
    size_t k = 0;
    for (const auto& planes : {frame.features, frame.values})
      for (const Plane* p : planes) {
        for (int y = from.y0; y < from.y1; ++y)
          std::copy_n(p->row(y) + from.x0, from.width(), at(to, from.x0 - block.x0, y - block.y0) + plane * k);
        ++k;
      }
    return to;
  }
};

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
  const int kWidth = 64, block_height = std::max(20, side + 1);
  const int across = (width + kWidth - 1) / kWidth, down = (height + block_height - 1) / block_height;
  const size_t stride = kWidth, plane = stride * static_cast<size_t>(block_height);
  const Surroundings shape(radius, kWidth, block_height);
  for (int colour = 0; colour < 4; ++colour) {
    std::vector<Box> blocks;
    for (int by = colour / 2; by < down; by += 2)
      for (int bx = colour % 2; bx < across; bx += 2) {
        const Box block{bx * kWidth, by * block_height, std::min(width, (bx + 1) * kWidth),
                        std::min(height, (by + 1) * block_height)};
        if (!wanted || any_above_0(*wanted, block.grown(radius, width, height))) blocks.push_back(block);
      }
    parallel_for(static_cast<int>(blocks.size()), share(task, 0.25 * colour, 0.25 * (colour + 1)), [&](int i) {
      const Box& block = blocks[static_cast<size_t>(i)];
      // Whole vectors: the last pixels may be beyond the image, where weights are 0.
      const int count = (block.width() + kLanes - 1) / kLanes * kLanes;
      kernels::WeightScratch scratch;
      const size_t window = plane * static_cast<size_t>(side * side);
      const Aligned weights = aligned(window * frames.size());
      if (count != block.width()) std::fill_n(weights.get(), window * frames.size(), 0.0f);
      const auto weight_of = [&](size_t f, int dx, int dy) {
        return weights.get() + window * f + plane * static_cast<size_t>((dy + radius) * side + dx + radius);
      };
      std::vector<Aligned> copies;
      for (size_t f = 0; f < frames.size(); ++f) {
        for (int dy = -radius; dy <= radius; ++dy)
          for (int dx = -radius; dx <= radius; ++dx) {
            float* const w = weight_of(f, dx, dy);
            kernels::block_distances(frames[f].model, block, dx, dy, scratch, w, stride);
            kernels::block_weights(frames[f].model, {width, height}, block, dx, dy, w, 1, nullptr, w, stride);
          }
        copies.push_back(shape.copy(frames[f], block));
      }
      const Aligned predicted = aligned(shape.plane * (values.size() + 1));
      std::fill_n(predicted.get(), shape.plane * (values.size() + 1), 0.0f);
      const size_t entries = stride * static_cast<size_t>(n * (n + 1) / 2), sides = stride * static_cast<size_t>(n * m);
      const Aligned a = aligned(entries), b = aligned(sides), work = aligned(kernels::normal_scratch(n - 3, m, radius));
      for (int y = block.y0; y < block.y1; ++y) {
        if (wanted && !any_above_0(*wanted, Box{block.x0, y, block.x1, y + 1}.grown(radius, width, height))) continue;
        const size_t line = stride * static_cast<size_t>(y - block.y0);
        float* centre = weight_of(0, 0, 0) + line;
        for (int x = 0; x < block.width(); ++x) centre[x] = std::max(centre[x], kCentreWeight);
        std::fill_n(a.get(), entries, 0.0f);
        std::fill_n(b.get(), sides, 0.0f);
        const int top = std::max(-radius, -y), bottom = std::min(radius, height - 1 - y);
        const auto row = [&](size_t f, int dy) {
          return kernels::RegressionRow{shape.at(copies[0], 0, y - block.y0),
                                        shape.at(copies[f], -radius, y - block.y0 + dy),
                                        shape.pitch,
                                        shape.plane,
                                        n - 3,
                                        m,
                                        count,
                                        radius,
                                        stride};
        };
        for (size_t f = 0; f < frames.size(); ++f)
          for (int dy = top; dy <= bottom; ++dy)
            kernels::accumulate_normal(row(f, dy), weight_of(f, -radius, dy) + line, plane, dy, work.get(), a.get(),
                                       b.get());
        kernels::solve_rows(a.get(), b.get(), n, m, count, stride, kRidge, kFloor);
        std::vector<const float*> low, high;
        for (size_t c = 0; c < values.size(); ++c) {
          low.push_back(lowest[c].row(y) + block.x0);
          high.push_back(highest[c].row(y) + block.x0);
        }
        for (int dy = top; dy <= bottom; dy += 2)
          for (int dx = -radius; dx <= radius; ++dx)
            kernels::scatter_prediction({row(0, dy), weight_of(0, dx, dy) + line, plane * static_cast<size_t>(side),
                                         b.get(), low, high, shape.at(predicted, -radius, y - block.y0 + dy)},
                                        dx, dy, std::min(2, bottom + 1 - dy));
      }
      const Box reached = block.grown(radius, width, height);
      for (size_t c = 0; c <= values.size(); ++c) {
        Plane& to = c < values.size() ? sums[c] : total;
        for (int y = reached.y0; y < reached.y1; ++y) {
          const float* const from = shape.at(predicted, reached.x0 - block.x0, y - block.y0) + shape.plane * c;
          for (int x = reached.x0; x < reached.x1; ++x) to(x, y) += from[x - reached.x0];
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
