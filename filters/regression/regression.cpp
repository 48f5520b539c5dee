#include "filters/regression/regression.h"

#include <hwy/aligned_allocator.h>

#include <algorithm>

#include "base/parallel_for.h"
#include "filters/kernels/regression.h"

namespace brume {
namespace {

// Relative growth of the diagonal, and what a column of zeros gets: enough for float sums, too little to be seen.
constexpr float kRidge = 3e-6f, kFloor = 1e-7f;
// The pixel itself counts at least this much, however unlike its neighbours it is.
constexpr float kCentreWeight = 1e-4f;

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

// A block's predictions reach `radius` beyond it. Blocks of one colour of a 2 x 2 pattern are far enough apart to run
// at once, and the colours follow one another: every pixel's sum has one order, for any number of threads.
constexpr int kBlockWidth = 64, kLeastBlockHeight = 20;

class Collaboration {
 public:
  Collaboration(std::span<const RegressionFrame> frames, int radius, const Plane* wanted, const Task& task)
      : frames_(frames),
        radius_(radius),
        side_(2 * radius + 1),
        width_(frames[0].values[0]->width()),
        height_(frames[0].values[0]->height()),
        n_(static_cast<int>(frames[0].features.size()) + 3),
        m_(static_cast<int>(frames[0].values.size())),
        block_height_(std::max(kLeastBlockHeight, side_ + 1)),
        plane_(kStride * static_cast<size_t>(block_height_)),
        shape_(radius, kBlockWidth, block_height_),
        wanted_(wanted),
        sums_(frames[0].values.size() + 1, Plane(width_, height_)) {
    for (size_t c = 0; c < frames[0].values.size(); ++c)
      for (const RegressionFrame& f : frames) add_bounds(*f.values[c], &f == &frames[0], task);
  }

  std::vector<Plane> run(const Task& task) {
    const int across = (width_ + kBlockWidth - 1) / kBlockWidth, down = (height_ + block_height_ - 1) / block_height_;
    for (int colour = 0; colour < 4; ++colour) {
      std::vector<Box> blocks;
      for (int by = colour / 2; by < down; by += 2)
        for (int bx = colour % 2; bx < across; bx += 2) {
          const Box block{bx * kBlockWidth, by * block_height_, std::min(width_, (bx + 1) * kBlockWidth),
                          std::min(height_, (by + 1) * block_height_)};
          if (is_wanted(block)) blocks.push_back(block);
        }
      parallel_for(static_cast<int>(blocks.size()), share(task, 0.25 * colour, 0.25 * (colour + 1)),
                   [&](int i) { fit(blocks[static_cast<size_t>(i)]); });
    }
    const Plane total = std::move(sums_.back());
    sums_.pop_back();
    for (Plane& sum : sums_)
      for_each_pixel(width_, height_, quiet(task), [&](int x, int y) {
        if (total(x, y) > 0) sum(x, y) /= total(x, y);
      });
    return std::move(sums_);
  }

 private:
  static constexpr size_t kStride = kBlockWidth;

  /// The least and the largest value of each window, of all frames.
  void add_bounds(const Plane& values, bool first, const Task& task) {
    Plane low = window_minimum(values, radius_, task), high = window_maximum(values, radius_, task);
    if (first) {
      lowest_.push_back(std::move(low));
      highest_.push_back(std::move(high));
      return;
    }
    for_each_pixel(width_, height_, quiet(task), [&](int x, int y) {
      lowest_.back()(x, y) = std::min(lowest_.back()(x, y), low(x, y));
      highest_.back()(x, y) = std::max(highest_.back()(x, y), high(x, y));
    });
  }
  bool is_wanted(const Box& box) const {
    return !wanted_ || any_above_0(*wanted_, box.grown(radius_, width_, height_));
  }

  /// What is known of a block, and what is made of it.
  struct Block {
    Box box;
    int count;  // of pixels in a row of whole vectors: the last may be beyond the image, where weights are 0
    Aligned weights, predicted, a, b, work;
    std::vector<Aligned> copies;
  };
  float* weight_of(const Block& block, size_t f, int dx, int dy) const {
    const size_t window = plane_ * static_cast<size_t>(side_ * side_);
    return block.weights.get() + window * f + plane_ * static_cast<size_t>((dy + radius_) * side_ + dx + radius_);
  }
  size_t entries() const { return kStride * static_cast<size_t>(n_ * (n_ + 1) / 2); }
  size_t sides() const { return kStride * static_cast<size_t>(n_ * m_); }

  void fit(const Box& box) {
    const size_t weights = plane_ * static_cast<size_t>(side_ * side_) * frames_.size();
    Block block{box,
                (box.width() + kLanes - 1) / kLanes * kLanes,
                aligned(weights),
                aligned(shape_.plane * sums_.size()),
                aligned(entries()),
                aligned(sides()),
                aligned(kernels::normal_scratch(n_ - 3, m_, radius_)),
                {}};
    if (block.count != box.width()) std::fill_n(block.weights.get(), weights, 0.0f);
    std::fill_n(block.predicted.get(), shape_.plane * sums_.size(), 0.0f);
    kernels::WeightScratch scratch;
    for (size_t f = 0; f < frames_.size(); ++f) {
      for (int dy = -radius_; dy <= radius_; ++dy)
        for (int dx = -radius_; dx <= radius_; ++dx) {
          float* const w = weight_of(block, f, dx, dy);
          kernels::block_distances(frames_[f].model, box, dx, dy, scratch, w, kStride);
          kernels::block_weights(frames_[f].model, {width_, height_}, box, dx, dy, w, 1, nullptr, w, kStride);
        }
      block.copies.push_back(shape_.copy(frames_[f], box));
    }
    for (int y = box.y0; y < box.y1; ++y)
      if (is_wanted({box.x0, y, box.x1, y + 1})) fit_row(block, y);
    const Box reached = box.grown(radius_, width_, height_);
    for (size_t c = 0; c < sums_.size(); ++c)
      for (int y = reached.y0; y < reached.y1; ++y) {
        const float* const from = shape_.at(block.predicted, reached.x0 - box.x0, y - box.y0) + shape_.plane * c;
        for (int x = reached.x0; x < reached.x1; ++x) sums_[c](x, y) += from[x - reached.x0];
      }
  }

  /// Lines around the pixels of a row, and what they predict for their windows.
  void fit_row(const Block& block, int y) const {
    const Box& box = block.box;
    const size_t line = kStride * static_cast<size_t>(y - box.y0);
    float* centre = weight_of(block, 0, 0, 0) + line;
    for (int x = 0; x < box.width(); ++x) centre[x] = std::max(centre[x], kCentreWeight);
    std::fill_n(block.a.get(), entries(), 0.0f);
    std::fill_n(block.b.get(), sides(), 0.0f);
    const int top = std::max(-radius_, -y), bottom = std::min(radius_, height_ - 1 - y);
    const auto row = [&](size_t f, int dy) {
      return kernels::RegressionRow{shape_.at(block.copies[0], 0, y - box.y0),
                                    shape_.at(block.copies[f], -radius_, y - box.y0 + dy),
                                    shape_.pitch,
                                    shape_.plane,
                                    n_ - 3,
                                    m_,
                                    block.count,
                                    radius_,
                                    kStride};
    };
    for (size_t f = 0; f < frames_.size(); ++f)
      for (int dy = top; dy <= bottom; ++dy)
        kernels::accumulate_normal(row(f, dy), weight_of(block, f, -radius_, dy) + line, plane_, dy, block.work.get(),
                                   block.a.get(), block.b.get());
    kernels::solve_rows(block.a.get(), block.b.get(), n_, m_, block.count, kStride, kRidge, kFloor);
    std::vector<const float*> low, high;
    for (size_t c = 0; c < lowest_.size(); ++c) {
      low.push_back(lowest_[c].row(y) + box.x0);
      high.push_back(highest_[c].row(y) + box.x0);
    }
    for (int dy = top; dy <= bottom; dy += 2)
      for (int dx = -radius_; dx <= radius_; ++dx)
        kernels::scatter_prediction(
            {row(0, dy), weight_of(block, 0, dx, dy) + line, plane_ * static_cast<size_t>(side_), block.b.get(), low,
             high, shape_.at(block.predicted, -radius_, y - box.y0 + dy)},
            dx, dy, std::min(2, bottom + 1 - dy));
  }

  const std::span<const RegressionFrame> frames_;
  const int radius_, side_, width_, height_;
  const int n_, m_;  // regressors, values
  const int block_height_;
  const size_t plane_;  // of a block's weights [floats]
  const Surroundings shape_;
  const Plane* const wanted_;
  std::vector<Plane> lowest_, highest_;
  std::vector<Plane> sums_;  // of predictions; last, of their weights
};

}  // namespace

std::vector<Plane> collaborative_regression(std::span<const RegressionFrame> frames, int radius, const Task& task,
                                            const Plane* wanted) {
  return Collaboration(frames, radius, wanted, task).run(task);
}

}  // namespace brume
