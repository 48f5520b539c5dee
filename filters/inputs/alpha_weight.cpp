#include "filters/inputs/alpha_weight.h"

#include <algorithm>
#include <cmath>

#include "base/vec.h"

namespace brume {
namespace {

constexpr int kReach = 16;               // px within which an edge is judged
constexpr float kMostNoisyEdge = 0.2f;   // share of an edge's pixels
constexpr float kFewNoisyEdges = 0.02f;  // the same, of the whole frame
constexpr float kNoiseOfAlpha = 2e-3f;   // deviation
constexpr float kLeastOpacity = 1e-3f;   // that a pixel shows
constexpr float kMostAlpha = 1.01f;      // beyond, it is something else

/// Pixels that may have light, and how much their edges look like noise.
class Support {
 public:
  Support(const Plane& alpha, const RgbPlanes& signal, const Plane* opacity, const Task& task)
      : width_(alpha.width()), height_(alpha.height()), inside_(width_, height_), task_(task) {
    for_each_row(height_, quiet(task_), [&](int y) {
      for (int x = 0; x < width_; ++x)
        inside_(x, y) = alpha(x, y) != 0 || (*signal[0])(x, y) != 0 || (*signal[1])(x, y) != 0 ||
                        (*signal[2])(x, y) != 0 || (opacity && (*opacity)(x, y) > kLeastOpacity);
    });
  }

  size_t outside() const {
    size_t count = 0;
    for (int y = 0; y < height_; ++y)
      for (const float v : inside_.pixels(y)) count += v == 0;
    return count;
  }
  /// Adds the pixels at 0 whose edges are made of noise. @return whether there were any
  bool add_noisy_edges() {
    Plane edge(width_, height_), noisy(width_, height_);
    for_each_row(height_, quiet(task_), [&](int y) {
      for (int x = 0; x < width_; ++x)
        if (inside_(x, y) == 0)
          if (const Around around = look_around(x, y); around.any) {
            edge(x, y) = 1;
            noisy(x, y) = around.between || around.of_single;
          }
    });
    double edges = 0, of_noise = 0;
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x) edges += edge(x, y), of_noise += noisy(x, y);
    if (of_noise <= kFewNoisyEdges * edges) return false;
    const Plane local_edge = box_mean(edge, kReach, quiet(task_)), local_noise = box_mean(noisy, kReach, quiet(task_));
    for_each_row(height_, quiet(task_), [&](int y) {
      for (int x = 0; x < width_; ++x)
        if (local_noise(x, y) > kMostNoisyEdge * local_edge(x, y)) inside_(x, y) = 1;
    });
    return true;
  }
  const Plane& inside() const { return inside_; }

 private:
  struct Around {
    bool any = false;        ///< a pixel beside it is inside
    bool between = false;    ///< two on opposite sides
    bool of_single = false;  ///< one that has no more than one neighbour itself
  };
  Around look_around(int x, int y) const {
    constexpr int kSides[4][2] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}};
    Around around;
    for (const auto& [dx, dy] : kSides) {
      const bool one = is_inside(x + dx, y + dy), other = is_inside(x - dx, y - dy);
      around.any |= one || other;
      around.between |= one && other;
      around.of_single |= (one && is_single(x + dx, y + dy)) || (other && is_single(x - dx, y - dy));
    }
    return around;
  }
  bool is_inside(int x, int y) const { return x >= 0 && y >= 0 && x < width_ && y < height_ && inside_(x, y) != 0; }
  bool is_single(int x, int y) const {
    int neighbours = -1;
    for (int v = y - 1; v <= y + 1; ++v)
      for (int u = x - 1; u <= x + 1; ++u) neighbours += is_inside(u, v);
    return neighbours < 2;
  }

  int width_, height_;
  Plane inside_;
  const Task& task_;
};

/// Whether values between 0 and 1, edges of one pixel aside, are free of noise.
bool is_free_of_noise(const Plane& alpha) {
  constexpr float kMask[3] = {1, -2, 1};
  std::vector<float> responses;
  for (int y = 1; y + 1 < alpha.height(); ++y)
    for (int x = 1; x + 1 < alpha.width(); ++x) {
      float response = 0;
      bool within = true;
      for (int v = 0; v < 3 && within; ++v)
        for (int u = 0; u < 3; ++u) {
          const float a = alpha(x + u - 1, y + v - 1);
          within &= a > 0 && a < 1;
          response += kMask[u] * kMask[v] * a;
        }
      if (within) responses.push_back(std::abs(response));
    }
  if (responses.empty()) return true;
  const auto middle = responses.begin() + static_cast<std::ptrdiff_t>(responses.size() / 2);
  std::nth_element(responses.begin(), middle, responses.end());
  return *middle * (1.4826f / 6) < kNoiseOfAlpha;  // the mask's root sum of squares is 6
}

bool is_alpha(const Plane& plane) {
  float most = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) {
      if (!(v >= 0 && v <= kMostAlpha)) return false;
      most = std::max(most, v);
    }
  return most > 0;
}

bool is_partial(float alpha) {
  return alpha > 0 && alpha < 1;
}

/// Pixels partly covered by what ends there: one that is covered and one outside lie within two pixels, and none that
/// has light without alpha.
Plane sharp_edges(const Plane& alpha, const Plane& inside, const Task& task) {
  constexpr int kWidth = 2;
  return make_plane(alpha.width(), alpha.height(), quiet(task), [&](int x, int y) {
    if (!is_partial(alpha(x, y))) return 0.0f;
    bool covered = false, outside = false, lit = false;
    const Box around = Box{x, y, x + 1, y + 1}.grown(kWidth, alpha.width(), alpha.height());
    for (int v = around.y0; v < around.y1; ++v)
      for (int u = around.x0; u < around.x1; ++u) {
        covered |= alpha(u, v) >= 1;
        outside |= inside(u, v) == 0;
        lit |= inside(u, v) != 0 && alpha(u, v) == 0;
      }
    return static_cast<float>(covered && outside && !lit);
  });
}

/// Whether alpha explains the signal at the edges better than that it goes on there as beside them.
/// @param weight  alpha at the edges, else 1 inside and 0 outside
bool is_premultiplied(const Plane& weight, const Plane& edges, const RgbPlanes& signal, const Task& task) {
  const int width = weight.width(), height = weight.height();
  const auto make = [&](const auto& value) { return make_plane(width, height, quiet(task), value); };
  const Plane bright = make([&](int x, int y) { return (*signal[0])(x, y) + (*signal[1])(x, y) + (*signal[2])(x, y); });
  const Plane beside = make([&](int x, int y) { return edges(x, y) != 0 ? 0.0f : weight(x, y); });
  const Plane light_beside = make([&](int x, int y) { return edges(x, y) != 0 ? 0.0f : bright(x, y); });
  const Plane by_alpha = EdgeFill(weight, task).filled(bright, task);
  const Plane as_beside = EdgeFill(beside, task).filled(light_beside, task);
  double error_by_alpha = 0, error_as_beside = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      if (edges(x, y) == 0) continue;
      const float light = bright(x, y), a = weight(x, y);
      const float whole = (by_alpha(x, y) - light) / (1 - a);  // the local mean of light over alpha
      error_by_alpha += std::abs(static_cast<double>(light - a * whole));
      error_as_beside += std::abs(static_cast<double>(light - as_beside(x, y)));
    }
  return error_by_alpha <= error_as_beside;
}

/// A coarser plane between its pixels, linearly, at a pixel of the finer one.
float between(const Plane& coarse, int x, int y) {
  const auto place = [](int at, int size, int& first, int& second) {
    first = at / 2;
    second = std::clamp(at % 2 == 0 ? first - 1 : first + 1, 0, size - 1);
  };
  int x0, x1, y0, y1;
  place(x, coarse.width(), x0, x1);
  place(y, coarse.height(), y0, y1);
  return 0.5625f * coarse(x0, y0) + 0.1875f * (coarse(x1, y0) + coarse(x0, y1)) + 0.0625f * coarse(x1, y1);
}

}  // namespace

AlphaWeight alpha_weight(const Plane& alpha, const RgbPlanes& signal, const Plane* opacity, const Task& task) {
  AlphaWeight result;
  if (!is_alpha(alpha)) return result;
  Support support(alpha, signal, opacity, task);
  if (support.outside() == 0) return result;
  const bool noisy_edges = support.add_noisy_edges();
  result.outside = support.outside();
  if (result.outside == 0) return result;
  const Plane& inside = support.inside();
  bool lit_without_alpha = false;
  for (int y = 0; y < alpha.height() && !lit_without_alpha; ++y)
    for (int x = 0; x < alpha.width(); ++x) lit_without_alpha |= inside(x, y) != 0 && alpha(x, y) == 0;
  const bool everywhere = !noisy_edges && !lit_without_alpha && is_free_of_noise(alpha);
  const Plane edges = everywhere ? make_plane(alpha.width(), alpha.height(), quiet(task),
                                              [&](int x, int y) { return static_cast<float>(is_partial(alpha(x, y))); })
                                 : sharp_edges(alpha, inside, task);
  result.weight = make_plane(alpha.width(), alpha.height(), quiet(task),
                             [&](int x, int y) { return edges(x, y) != 0 ? alpha(x, y) : inside(x, y); });
  if (!is_premultiplied(result.weight, edges, signal, task)) result.weight = inside;
  return result;
}

EdgeFill::EdgeFill(const Plane& weight, const Task& task) {
  weights_.push_back(weight);
  while (weights_.back().width() > 1 || weights_.back().height() > 1) {
    Plane coarser = halved(weights_.back(), 0.25f, task);
    weights_.push_back(std::move(coarser));
  }
}

Plane EdgeFill::filled(const Plane& values, const Task& task) const {
  std::vector<Plane> levels;
  levels.push_back(values);
  while (levels.size() < weights_.size()) {
    Plane coarser = halved(levels.back(), 0.25f, task);
    levels.push_back(std::move(coarser));
  }
  Plane& top = levels.back();
  top(0, 0) = weights_.back()(0, 0) > 0 ? top(0, 0) / weights_.back()(0, 0) : 0.0f;
  for (size_t l = levels.size() - 1; l-- > 0;) {
    Plane& fine = levels[l];
    const Plane &coarse = levels[l + 1], &weight = weights_[l];
    for_each_pixel(fine.width(), fine.height(), quiet(task), [&](int x, int y) {
      if (weight(x, y) < 1) fine(x, y) += (1 - weight(x, y)) * between(coarse, x, y);
    });
  }
  return std::move(levels.front());
}

}  // namespace brume
