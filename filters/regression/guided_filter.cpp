#include "filters/regression/guided_filter.h"

#include <algorithm>
#include <cstring>
#include <vector>

#include "filters/kernels/regression.h"
#include "filters/kernels/rows.h"
#include "filters/patch/neighbourhood.h"

namespace brume {
namespace {

std::vector<float> inverse_counts(int length, int radius) {
  std::vector<float> inverse;
  for (int i = 0; i < length; ++i)
    inverse.push_back(1.0f / static_cast<float>(std::min(length - 1, i + radius) - std::max(0, i - radius) + 1));
  return inverse;
}

using Inputs = std::span<const Plane* const>;

/// A picture, or a block, at once: a plane for every product of the guide's channels.
class GuidedBlock {
 public:
  GuidedBlock(Inputs inputs, Inputs guide, int radius, float eps, const Task& task)
      : inputs_(inputs),
        guide_(guide),
        d_(static_cast<int>(guide.size())),
        m_(static_cast<int>(inputs.size())),
        width_(inputs[0]->width()),
        height_(inputs[0]->height()),
        radius_(radius),
        eps_(eps),
        stride_(static_cast<size_t>(width_ + 15) / 16 * 16),
        columns_(inverse_counts(width_, radius)),
        lines_(inverse_counts(height_, radius)),
        task_(task) {}

  std::vector<Plane> filtered() const {
    const std::vector<Plane> coefficients = coefficients_of(products());
    std::vector<Plane> out(inputs_.size(), Plane(width_, height_));
    for_each_row(height_, task_, [&](int y) {
      std::vector<float> sum(stride_);
      for (int c = 0; c < m_; ++c) {
        float* to = out[static_cast<size_t>(c)].row(y);
        sum_of_rows(coefficients[static_cast<size_t>(d_ * m_ + c)], y, sum.data());
        for (int x = 0; x < width_; ++x) to[x] = sum[static_cast<size_t>(x)];
        for (int i = 0; i < d_; ++i) {
          sum_of_rows(coefficients[static_cast<size_t>(i * m_ + c)], y, sum.data());
          const float* g = guide_[static_cast<size_t>(i)]->row(y);
          for (int x = 0; x < width_; ++x) to[x] += sum[static_cast<size_t>(x)] * g[x];
        }
        divide_by_window(y, to);
      }
    });
    return out;
  }

 private:
  /// Sums over rows of: the guide, the inputs, guide x guide, guide x inputs.
  std::vector<Plane> products() const {
    std::vector<Plane> sums(static_cast<size_t>(d_ + m_ + d_ * (d_ + 1) / 2 + d_ * m_), Plane(width_, height_));
    for_each_row(height_, quiet(task_), [&](int y) {
      std::vector<float> product(stride_);
      size_t next = 0;
      const auto add = [&](const float* row) { kernels::box_row(row, sums[next++].row(y), width_, radius_); };
      const auto add_product = [&](const float* a, const float* b) {
        for (int x = 0; x < width_; ++x) product[static_cast<size_t>(x)] = a[x] * b[x];
        add(product.data());
      };
      for (const Plane* g : guide_) add(g->row(y));
      for (const Plane* p : inputs_) add(p->row(y));
      for (size_t i = 0; i < guide_.size(); ++i)
        for (size_t j = i; j < guide_.size(); ++j) add_product(guide_[i]->row(y), guide_[j]->row(y));
      for (const Plane* g : guide_)
        for (const Plane* p : inputs_) add_product(g->row(y), p->row(y));
    });
    return sums;
  }

  /// Coefficients of every window, summed along rows again: a (d x m), then b (m).
  std::vector<Plane> coefficients_of(const std::vector<Plane>& products) const {
    std::vector<Plane> coefficients(static_cast<size_t>(d_ * m_ + m_), Plane(width_, height_));
    for_each_row(height_, quiet(task_), [&](int y) {
      std::vector<float> mean(stride_ * products.size());
      const auto mean_row = [&](int i) { return mean.data() + stride_ * static_cast<size_t>(i); };
      for (size_t i = 0; i < products.size(); ++i) {
        sum_of_rows(products[i], y, mean.data() + stride_ * i);
        divide_by_window(y, mean.data() + stride_ * i);
      }
      const auto covariance = [&](float* product, const float* a, const float* b, float floor) {
        for (int x = 0; x < width_; ++x) product[x] -= a[x] * b[x];
        if (floor >= 0)
          for (int x = 0; x < width_; ++x) product[x] = std::max(product[x], 0.0f) + floor;
      };
      int next = d_ + m_;
      float* const sigma = mean_row(next);
      for (int i = 0; i < d_; ++i)
        for (int j = i; j < d_; ++j) covariance(mean_row(next++), mean_row(i), mean_row(j), i == j ? eps_ : -1.0f);
      float* const a = mean_row(next);
      for (int i = 0; i < d_; ++i)
        for (int c = 0; c < m_; ++c) covariance(mean_row(next++), mean_row(i), mean_row(d_ + c), -1.0f);
      kernels::solve_rows(sigma, a, d_, m_, width_, stride_, 0, 0);
      std::vector<float> b(stride_);
      for (int c = 0; c < m_; ++c) {
        std::copy_n(mean_row(d_ + c), width_, b.data());
        for (int i = 0; i < d_; ++i) {
          const float *ai = a + stride_ * static_cast<size_t>(i * m_ + c), *g = mean_row(i);
          for (int x = 0; x < width_; ++x) b[static_cast<size_t>(x)] -= ai[x] * g[x];
          kernels::box_row(ai, coefficients[static_cast<size_t>(i * m_ + c)].row(y), width_, radius_);
        }
        kernels::box_row(b.data(), coefficients[static_cast<size_t>(d_ * m_ + c)].row(y), width_, radius_);
      }
    });
    return coefficients;
  }

  void sum_of_rows(const Plane& plane, int y, float* to) const {
    std::vector<const float*> rows;
    for (int q = std::max(0, y - radius_); q <= std::min(height_ - 1, y + radius_); ++q) rows.push_back(plane.row(q));
    kernels::sum_rows(rows.data(), static_cast<int>(rows.size()), to, width_);
  }
  void divide_by_window(int y, float* row) const {
    const float line = lines_[static_cast<size_t>(y)];
    for (int x = 0; x < width_; ++x) row[x] *= line * columns_[static_cast<size_t>(x)];
  }

  const Inputs inputs_, guide_;
  const int d_, m_;  // channels of the guide, and inputs
  const int width_, height_, radius_;
  const float eps_;
  const size_t stride_;
  const std::vector<float> columns_, lines_;  // inverse numbers of pixels in a window
  const Task& task_;
};

}  // namespace

std::vector<Plane> guided_filter(std::span<const Plane* const> inputs, std::span<const Plane* const> guide, int radius,
                                 float eps, const Task& task) {
  // Blocks whose products stay in the cache, each with an apron as wide as both windows reach.
  constexpr int kWidth = 256, kHeight = 64;
  const int width = inputs[0]->width(), height = inputs[0]->height();
  std::vector<Plane> out(inputs.size(), Plane(width, height));
  for_each_block(width, height, kWidth, kHeight, task, [&](const Box& block) {
    const Box outer = block.grown(2 * radius, width, height);
    std::vector<Plane> in, by;
    for (const Plane* p : inputs) in.push_back(crop(*p, outer));
    for (const Plane* g : guide) by.push_back(crop(*g, outer));
    const std::vector<const Plane*> in_views = pointers(in), by_views = pointers(by);
    const Task alone{1, {}, task.cancel};
    const std::vector<Plane> part = GuidedBlock(in_views, by_views, radius, eps, alone).filtered();
    for (size_t c = 0; c < part.size(); ++c)
      for (int y = block.y0; y < block.y1; ++y)
        std::memcpy(out[c].row(y) + block.x0, part[c].row(y - outer.y0) + (block.x0 - outer.x0),
                    sizeof(float) * static_cast<size_t>(block.width()));
  });
  return out;
}

}  // namespace brume
