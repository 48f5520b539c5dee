#include "filters/inputs/planes.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "base/parallel_for.h"
#include "filters/kernels/rows.h"

namespace brume {
namespace {

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

void for_each_row(int height, const Task& task, const std::function<void(int)>& row) {
  parallel_for((height + kRowsPerTask - 1) / kRowsPerTask, task, [&](int band) {
    for (int y = band * kRowsPerTask; y < std::min(height, (band + 1) * kRowsPerTask); ++y) row(y);
  });
}

bool any_above_0(const Plane& plane, const Box& box) {
  for (int y = box.y0; y < box.y1; ++y)
    if (std::any_of(plane.row(y) + box.x0, plane.row(y) + box.x1, [](float v) { return v > 0; })) return true;
  return false;
}

Plane luminance_of(const RgbPlanes& rgb, const FrameSpace& space, const Task& task) {
  return make_plane(rgb[0]->width(), rgb[0]->height(), quiet(task),
                    [&](int x, int y) { return space.luminance(color_at(rgb, x, y)); });
}

double sum_of(const Plane& plane) {
  double sum = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) sum += static_cast<double>(v);
  return sum;
}

Plane halved(const Plane& in, float factor, const Task& task) {
  return make_plane((in.width() + 1) / 2, (in.height() + 1) / 2, quiet(task), [&](int x, int y) {
    const int x1 = std::min(2 * x + 1, in.width() - 1), y1 = std::min(2 * y + 1, in.height() - 1);
    return factor * (in(2 * x, 2 * y) + in(x1, 2 * y) + in(2 * x, y1) + in(x1, y1));
  });
}

Plane box_mean(const Plane& in, int radius, const Task& task) {
  const int width = in.width(), height = in.height();
  Plane horizontal(width, height), out(width, height);
  for_each_row(height, quiet(task), [&](int y) { kernels::box_row(in.row(y), horizontal.row(y), width, radius); });
  const auto count = [radius](int i, int n) { return std::min(n - 1, i + radius) - std::max(0, i - radius) + 1; };
  std::vector<float> columns;
  for (int x = 0; x < width; ++x) columns.push_back(1.0f / static_cast<float>(count(x, width)));
  for_each_row(height, quiet(task), [&](int y) {
    std::vector<const float*> rows;
    for (int q = std::max(0, y - radius); q <= std::min(height - 1, y + radius); ++q) rows.push_back(horizontal.row(q));
    kernels::sum_rows(rows.data(), static_cast<int>(rows.size()), out.row(y), width);
    const float scale = 1.0f / static_cast<float>(rows.size());
    for (int x = 0; x < width; ++x) out.row(y)[x] *= scale * columns[static_cast<size_t>(x)];
  });
  return out;
}

Plane gaussian_blur(const Plane& in, double sigma, const Task& task) {
  const int width = in.width(), height = in.height(), radius = std::max(1, static_cast<int>(std::ceil(3 * sigma)));
  std::vector<float> taps;
  for (int j = -radius; j <= radius; ++j) taps.push_back(static_cast<float>(std::exp(-j * j / (2 * sigma * sigma))));
  const size_t w = static_cast<size_t>(width), r = static_cast<size_t>(radius);
  // A row with zeros on either side, and the places from which it is summed along.
  struct Wide {
    std::vector<float> row;
    std::vector<const float*> places;
    Wide(size_t width_, size_t radius_) : row(width_ + 2 * radius_) {
      for (size_t j = 0; j <= 2 * radius_; ++j) places.push_back(row.data() + j);
    }
  };
  const auto along = [&](const Wide& wide, float* to) {
    kernels::weighted_sum_rows(wide.places.data(), taps.data(), 2 * radius + 1, to, width);
  };
  std::vector<float> across(w);  // sums of the taps within the row
  Wide ones(w, r);
  std::fill_n(ones.row.data() + r, w, 1.0f);
  along(ones, across.data());
  Plane out = Plane::unset(width, height);
  parallel_for((height + kRowsPerTask - 1) / kRowsPerTask, quiet(task), [&](int band) {
    Wide down(w, r);
    std::vector<const float*> rows;
    for (int y = band * kRowsPerTask; y < std::min(height, (band + 1) * kRowsPerTask); ++y) {
      const int first = std::max(0, y - radius), last = std::min(height - 1, y + radius);
      rows.clear();
      float total = 0;
      for (int q = first; q <= last; ++q) {
        rows.push_back(in.row(q));
        total += taps[static_cast<size_t>(q - y + radius)];
      }
      kernels::weighted_sum_rows(rows.data(), taps.data() + (first - y + radius), last - first + 1, down.row.data() + r,
                                 width);
      along(down, out.row(y));
      for (size_t x = 0; x < w; ++x) out.row(y)[x] /= total * across[x];
    }
  });
  return out;
}

Plane median3x3(const Plane& in, const Task& task) {
  Plane out(in.width(), in.height());
  for_each_row(in.height(), quiet(task), [&](int y) {
    kernels::median9_row(in.row(std::max(0, y - 1)), in.row(y), in.row(std::min(in.height() - 1, y + 1)), out.row(y),
                         in.width());
  });
  return out;
}

Plane window_maximum(const Plane& in, int radius, const Task& task) {
  return extreme(in, radius, task, [](float a, float b) { return a > b ? a : b; });
}

Plane window_minimum(const Plane& in, int radius, const Task& task) {
  return extreme(in, radius, task, [](float a, float b) { return a < b ? a : b; });
}

Plane crop(const Plane& in, const Box& box) {
  Plane out = Plane::unset(box.width(), box.height());
  for (int y = box.y0; y < box.y1; ++y)
    std::memcpy(out.row(y - box.y0), in.row(y) + box.x0, sizeof(float) * static_cast<size_t>(box.width()));
  return out;
}

}  // namespace brume
