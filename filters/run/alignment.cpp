#include "filters/run/alignment.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "base/parallel_for.h"
#include "filters/inputs/guide_layers.h"

namespace brume {
namespace {

constexpr int kBlock = 8, kWindow = 4;  // [px]: side, and how far the compared window reaches beyond it
constexpr int kCoarsest = 24;           // levels are halved while their shorter side has twice as many pixels
constexpr int kFirstSearch = 8;         // half width of the search on the coarsest level
constexpr double kClearly = 0.8;        // a place elsewhere must leave less than this share of the difference at rest
constexpr double kSmoothing = 2;        // of noisy pictures [px]
constexpr float kBeyondNoise = 3;       // deviations from which on a difference is a change

using Pyramid = std::vector<std::vector<Plane>>;  // finest level first

Pyramid pyramid(const std::vector<const Plane*>& planes, const Task& task) {
  Pyramid levels(1);
  for (const Plane* p : planes) levels[0].push_back(*p);
  while (std::min(levels.back()[0].width(), levels.back()[0].height()) >= 2 * kCoarsest) {
    std::vector<Plane> next;
    for (const Plane& p : levels.back()) next.push_back(halved(p, 0.25f, task));
    levels.push_back(std::move(next));
  }
  return levels;
}

/// Variance of the difference between a window and its place elsewhere, over what both pictures show: light that grows
/// or fades as a whole is no motion. Infinite where both show less than half of the window.
double difference(const std::vector<Plane>& here, const std::vector<Plane>& there, const Box& window, ivec2 shift) {
  const int width = here[0].width(), height = here[0].height();
  const int x0 = std::max(window.x0, -shift.x), x1 = std::min(window.x1, width - shift.x);
  const int y0 = std::max(window.y0, -shift.y), y1 = std::min(window.y1, height - shift.y);
  if (x0 >= x1 || y0 >= y1 || 2 * (x1 - x0) * (y1 - y0) < window.width() * window.height()) return INFINITY;
  const double pixels = (x1 - x0) * (y1 - y0);
  double variance = 0;
  for (size_t p = 0; p < here.size(); ++p) {
    double squares = 0, sum = 0;
    for (int y = y0; y < y1; ++y) {
      const float *a = here[p].row(y), *b = there[p].row(y + shift.y) + shift.x;
      float of_squares = 0, of_line = 0;
      for (int x = x0; x < x1; ++x) {
        const float d = a[x] - b[x];
        of_squares += d * d;
        of_line += d;
      }
      squares += static_cast<double>(of_squares);
      sum += static_cast<double>(of_line);
    }
    variance += (squares - sum * sum / pixels) / pixels;
  }
  return variance;
}

/// Shifts of the blocks of one level.
struct Field {
  int across = 0, down = 0;
  std::vector<ivec2> shifts;

  Field(int width, int height)
      : across((width + kBlock - 1) / kBlock),
        down((height + kBlock - 1) / kBlock),
        shifts(static_cast<size_t>(across) * static_cast<size_t>(down), ivec2(0)) {}
  ivec2& at(int x, int y) {
    return shifts[static_cast<size_t>(y) * static_cast<size_t>(across) + static_cast<size_t>(x)];
  }
  ivec2 at(int x, int y) const {
    x = std::clamp(x, 0, across - 1);
    y = std::clamp(y, 0, down - 1);
    return shifts[static_cast<size_t>(y) * static_cast<size_t>(across) + static_cast<size_t>(x)];
  }
};

/// What a block may try: rest, the shifts of the coarser level's blocks around it, and the places beside each.
std::vector<ivec2> candidates(const Field* coarser, int x, int y) {
  std::vector<ivec2> list;
  const auto add_around = [&](ivec2 centre, int radius) {
    for (int dy = -radius; dy <= radius; ++dy)
      for (int dx = -radius; dx <= radius; ++dx) {
        const ivec2 shift = centre + ivec2(dx, dy);
        if (std::find(list.begin(), list.end(), shift) == list.end()) list.push_back(shift);
      }
  };
  add_around(ivec2(0), coarser ? 1 : kFirstSearch);
  if (coarser)
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx) add_around(2 * coarser->at(x / 2 + dx, y / 2 + dy), 1);
  return list;
}

Field search(const std::vector<Plane>& here, const std::vector<Plane>& there, const Field* coarser, const Task& task) {
  const int width = here[0].width(), height = here[0].height();
  Field field(width, height);
  parallel_for(field.down, quiet(task), [&](int by) {
    for (int bx = 0; bx < field.across; ++bx) {
      const Box window =
          Box{bx * kBlock, by * kBlock, std::min(width, (bx + 1) * kBlock), std::min(height, (by + 1) * kBlock)}.grown(
              kWindow, width, height);
      const double at_rest = difference(here, there, window, ivec2(0));
      double least = kClearly * at_rest;
      for (const ivec2& shift : candidates(coarser, bx, by)) {
        const double d = difference(here, there, window, shift);
        if (!(d < least)) continue;
        least = d;
        field.at(bx, by) = shift;
      }
    }
  });
  return field;
}

int median(std::array<int, 9> values) {
  std::nth_element(values.begin(), values.begin() + 4, values.end());
  return values[4];
}

/// Blocks that moved unlike all around them take the median of their neighbours.
Field without_strays(const Field& field) {
  Field out = field;
  for (int y = 0; y < field.down; ++y)
    for (int x = 0; x < field.across; ++x) {
      std::array<int, 9> along{}, down{};
      for (size_t i = 0; i < 9; ++i) {
        const ivec2 v = field.at(x + static_cast<int>(i % 3) - 1, y + static_cast<int>(i / 3) - 1);
        along[i] = v.x;
        down[i] = v.y;
      }
      out.at(x, y) = {median(along), median(down)};
    }
  return out;
}

Plane relative(Plane plane, const Task& task) {
  double sum = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) sum += static_cast<double>(std::abs(v));
  const double pixels = static_cast<double>(plane.width()) * plane.height();
  const float scale = sum > 0 ? static_cast<float>(pixels / sum) : 0.0f;
  for_each_row(plane.height(), quiet(task), [&](int y) {
    for (float& v : plane.pixels(y)) v *= scale;
  });
  return plane;
}

bool is_guided(const Layers& frame) {
  return frame.has(guide_layer::opacity) && frame.has(guide_layer::predicted_indirect);
}

/// What is compared of a frame, relative to its means.
std::vector<Plane> recognisable(const Layers& frame, const RgbPlanes& signal, bool guided, const Task& task) {
  std::vector<Plane> planes;
  if (guided) {
    planes.push_back(relative(frame.at(guide_layer::opacity.channel(0)), task));
    planes.push_back(relative(luminance_of(frame.rgb(guide_layer::predicted_indirect), FrameSpace(frame), task), task));
    return planes;
  }
  planes.push_back(relative(gaussian_blur(luminance_of(signal, FrameSpace(frame), task), kSmoothing, task), task));
  return planes;
}

/// A signal and its variance around each pixel, both smoothed; the second is that of the smoothed signal.
struct Smoothed {
  Plane mean, variance;
};

Smoothed smoothed(const Plane& mean, const Plane& variance, const Task& task) {
  Smoothed out{gaussian_blur(mean, kSmoothing, task), gaussian_blur(variance, kSmoothing, task)};
  const float share = static_cast<float>(1 / (4 * std::numbers::pi * kSmoothing * kSmoothing));
  for_each_row(mean.height(), quiet(task), [&](int y) {
    for (float& v : out.variance.pixels(y)) v *= share;
  });
  return out;
}

void forget_what_changed(const Layers& here, const Layers& there, const LayerName& signal, Alignment& alignment,
                         const Task& task) {
  const FrameSpace space(here);
  const auto variance_of = [&](const Layers& frame) {
    return luminance_of(frame.rgb(signal, statistic::mean_variance), space, task);
  };
  const Plane mean = luminance_of(here.rgb(signal), space, task), variance = variance_of(here);
  const Smoothed own = smoothed(mean, variance, task);
  const Smoothed other = smoothed(alignment.bring(luminance_of(there.rgb(signal), space, task), mean, task),
                                  alignment.bring(variance_of(there), variance, task), task);
  for (int y = 0; y < mean.height(); ++y)
    for (int x = 0; x < mean.width(); ++x) {
      const float d = other.mean(x, y) - own.mean(x, y);
      if (d * d > kBeyondNoise * kBeyondNoise * (own.variance(x, y) + other.variance(x, y))) alignment.forget(x, y);
    }
}

}  // namespace

Alignment::Alignment(int width, int height, const std::vector<ivec2>& shifts)
    : width_(static_cast<size_t>(width)), places_(shifts.size(), kNowhere) {
  const size_t stride = Plane(width, 1).stride();
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const size_t i = static_cast<size_t>(y) * width_ + static_cast<size_t>(x);
      const ivec2 to = ivec2(x, y) + shifts[i];
      if (to.x >= 0 && to.y >= 0 && to.x < width && to.y < height)
        places_[i] = static_cast<int64_t>(static_cast<size_t>(to.y) * stride + static_cast<size_t>(to.x));
    }
}

Plane Alignment::bring(const Plane& other, const Plane& own, const Task& task) const {
  return make_plane(other.width(), other.height(), quiet(task), [&](int x, int y) {
    const int64_t place = places_[static_cast<size_t>(y) * width_ + static_cast<size_t>(x)];
    return place == kNowhere ? own(x, y) : other.row(0)[place];
  });
}

Alignment match_blocks(const std::vector<const Plane*>& here, const std::vector<const Plane*>& there,
                       const Task& task) {
  const Pyramid a = pyramid(here, task), b = pyramid(there, task);
  Field field = search(a.back(), b.back(), nullptr, task);
  for (size_t level = a.size() - 1; level-- > 0;) field = search(a[level], b[level], &field, task);
  field = without_strays(field);
  const int width = here[0]->width(), height = here[0]->height();
  std::vector<ivec2> shifts;
  shifts.reserve(static_cast<size_t>(width) * static_cast<size_t>(height));
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) shifts.push_back(std::as_const(field).at(x / kBlock, y / kBlock));
  return {width, height, shifts};
}

Alignment find_alignment(const Layers& here, const Layers& there, const LayerName& signal, const Task& task) {
  const bool guided = is_guided(here) && is_guided(there);
  const std::vector<Plane> a = recognisable(here, here.rgb(signal), guided, task),
                           b = recognisable(there, there.rgb(signal), guided, task);
  Alignment alignment = match_blocks(pointers(a), pointers(b), task);
  if (here.has(signal, statistic::mean_variance) && there.has(signal, statistic::mean_variance))
    forget_what_changed(here, there, signal, alignment, task);
  return alignment;
}

}  // namespace brume
