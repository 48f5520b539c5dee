#include "filters/mixing.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

namespace brume {
namespace {

// Deviations of the Gaussians over which gains are measured [px], each over means of blocks of so many pixels.
struct Window {
  double deviation;
  int block;
};
constexpr Window kWindows[] = {{28, 8}, {12, 4}, {6, 2}, {3, 1}};
constexpr int kRounds = 6;
constexpr float kLargeValue = 1.5f;   // of the largest value over the pixels of a window, taken off a gain
constexpr double kFirefly = 0.999;    // quantile of gains at which single pixels are cut: none decides alone
constexpr double kShareWindow = 1.5;  // over which shares are smoothed [px]

/// Means over blocks, those at the right and bottom edges of what pixels there are.
Plane block_means(const Plane& plane, int block, const Task& task) {
  if (block == 1) return plane;
  const int width = (plane.width() + block - 1) / block, height = (plane.height() + block - 1) / block;
  return make_plane(width, height, quiet(task), [&](int bx, int by) {
    const int x1 = std::min(plane.width(), (bx + 1) * block), y1 = std::min(plane.height(), (by + 1) * block);
    float sum = 0;
    for (int y = by * block; y < y1; ++y)
      for (int x = bx * block; x < x1; ++x) sum += plane(x, y);
    return sum / static_cast<float>((x1 - bx * block) * (y1 - by * block));
  });
}

/// Between the middles of blocks, bilinearly.
struct BlockPlace {
  int first, second;
  float share;  // of the second

  BlockPlace(int pixel, int block, int count) {
    const float at = (static_cast<float>(pixel) + 0.5f) / static_cast<float>(block) - 0.5f;
    first = std::clamp(static_cast<int>(std::floor(at)), 0, count - 1);
    second = std::min(first + 1, count - 1);
    share = std::clamp(at - static_cast<float>(first), 0.0f, 1.0f);
  }
};

float between(const Plane& blocks, const BlockPlace& x, const BlockPlace& y) {
  const float top = blocks(x.first, y.first) + x.share * (blocks(x.second, y.first) - blocks(x.first, y.first));
  const float bottom = blocks(x.first, y.second) + x.share * (blocks(x.second, y.second) - blocks(x.first, y.second));
  return top + y.share * (bottom - top);
}

/// What a step towards a candidate would change at each pixel: of its gain the part linear in the step, and of its loss
/// the part quadratic in it.
struct Step {
  Plane gain, loss;

  Step(const HalfPair& from, const HalfPair& to, const MixingFrame& frame, const Task& task) {
    const int width = frame.weight.width(), height = frame.weight.height();
    gain = loss = Plane(width, height);
    for_each_row(height, quiet(task), [&](int y) {
      for (int x = 0; x < width; ++x) {
        float g = 0, l = 0;
        for (size_t c = 0; c < 3; ++c) {
          const float ta = from.a[c](x, y), tb = from.b[c](x, y), da = to.a[c](x, y) - ta, db = to.b[c](x, y) - tb;
          const float ya = (*frame.half_a[c])(x, y), yb = (*frame.half_b[c])(x, y);
          g += 0.5f * ((yb - ta) * da + (ya - tb) * db) + 0.25f * (tb - ta) * (db - da);
          l += 0.25f * (da + db) * (da + db);
        }
        gain(x, y) = frame.weight(x, y) * g / 3;
        loss(x, y) = frame.weight(x, y) * l / 3;
      }
    });
    cut_fireflies();
  }

 private:
  void cut_fireflies() {
    std::vector<float> sizes;
    for (int y = 0; y < gain.height(); ++y)
      for (const float v : gain.pixels(y))
        if (v != 0) sizes.push_back(std::abs(v));
    if (sizes.empty()) return;
    const auto at = sizes.begin() + static_cast<std::ptrdiff_t>(kFirefly * static_cast<double>(sizes.size() - 1));
    std::nth_element(sizes.begin(), at, sizes.end());
    const float most = *at;
    for (int y = 0; y < gain.height(); ++y)
      for (float& v : gain.pixels(y)) v = std::clamp(v, -most, most);
  }
};

/// The best step that was found for each pixel of a region so far.
struct Best {
  Plane gain, share;
  std::vector<int> proposal;

  Best(int width, int height)
      : gain(width, height), share(width, height), proposal(static_cast<size_t>(width) * height, -1) {}
  int& of(int x, int y) { return proposal[static_cast<size_t>(y) * gain.width() + x]; }
};

void consider(int proposal, const Step& step, const MixingRegion& region, Best& best, const Task& task) {
  const int width = region.share.width(), height = region.share.height();
  const auto powers = [&](int power) {
    return make_plane(width, height, quiet(task), [&](int x, int y) {
      float v = region.share(x, y);
      for (int i = 0; i < power; ++i) v *= step.gain(x, y);
      return v;
    });
  };
  const Plane gain = powers(1), square = powers(2), fourth = powers(4);
  const Plane loss =
      make_plane(width, height, quiet(task), [&](int x, int y) { return region.share(x, y) * step.loss(x, y); });
  const float sure = static_cast<float>(region.sure);
  for (const Window& window : kWindows) {
    const double s = window.deviation;
    const auto mean = [&](const Plane& plane) {
      return gaussian_blur(block_means(plane, window.block, task), s / window.block, task);
    };
    const Plane n = mean(region.share), g = mean(gain), g2 = mean(square), g4 = mean(fourth), l = mean(loss);
    const auto pixels = static_cast<float>(4 * kPi * s * s);  // that count as much as the window
    Plane sure_gain(n.width(), n.height()), share(n.width(), n.height());
    for_each_row(n.height(), quiet(task), [&](int y) {
      for (int x = 0; x < n.width(); ++x) {
        if (!(n(x, y) > 1e-6f) || !(g(x, y) > 0)) continue;
        const float b = g(x, y) / n(x, y), count = pixels * n(x, y);
        const float variance = std::max(0.0f, g2(x, y) / n(x, y) - b * b);
        const float largest = std::pow(g4(x, y) / n(x, y) * count, 0.25f);
        const float low = b - sure * std::sqrt(variance / count) - kLargeValue * largest / count;
        if (!(low > 0)) continue;
        const float a = std::max(l(x, y) / n(x, y), 1e-30f);
        share(x, y) = std::min(1.0f, low / a);
        sure_gain(x, y) = share(x, y) * (2 * low - share(x, y) * a);
      }
    });
    for_each_row(height, quiet(task), [&](int y) {
      const BlockPlace v(y, window.block, n.height());
      for (int x = 0; x < width; ++x) {
        if (!(region.share(x, y) > 0)) continue;
        const BlockPlace u(x, window.block, n.width());
        const float found = between(sure_gain, u, v);
        if (!(found > best.gain(x, y))) continue;
        best.gain(x, y) = found;
        best.share(x, y) = between(share, u, v);
        best.of(x, y) = proposal;
      }
    });
  }
}

bool any(const Plane& plane) {
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y))
      if (v > 0) return true;
  return false;
}

}  // namespace

Plane mix(HalfPair& result, const std::vector<Proposal>& proposals, const MixingFrame& frame, const Task& task) {
  const int width = frame.weight.width(), height = frame.weight.height();
  Plane moved(width, height);
  HalfPair room;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Best> best(frame.regions.size(), Best(width, height));
    std::vector<bool> taken(proposals.size());
    for (size_t m = 0; m < proposals.size(); ++m) {
      task.check();
      const Step step(result, proposals[m](result, room), frame, task);
      for (size_t r = 0; r < frame.regions.size(); ++r)
        consider(static_cast<int>(m), step, frame.regions[r], best[r], task);
    }
    for (Best& b : best)
      for (const int m : b.proposal)
        if (m >= 0) taken[static_cast<size_t>(m)] = true;
    HalfPair next = result;
    for (size_t m = 0; m < proposals.size(); ++m) {
      if (!taken[m]) continue;
      const HalfPair& candidate = proposals[m](result, room);
      for (size_t r = 0; r < frame.regions.size(); ++r) {
        const Plane& region = frame.regions[r].share;
        Plane share = make_plane(width, height, quiet(task), [&](int x, int y) {
          return best[r].of(x, y) == static_cast<int>(m) ? region(x, y) * best[r].share(x, y) : 0.0f;
        });
        if (!any(share)) continue;
        share = gaussian_blur(share, kShareWindow, task);
        const Plane around = gaussian_blur(region, kShareWindow, task);
        for_each_row(height, quiet(task), [&](int y) {
          for (int x = 0; x < width; ++x) {
            if (!(share(x, y) > 0) || !(region(x, y) > 0) || !(frame.weight(x, y) > 0)) continue;
            const float s = region(x, y) * share(x, y) / around(x, y);
            moved(x, y) = 1;
            for (size_t c = 0; c < 3; ++c) {
              next.a[c](x, y) += s * (candidate.a[c](x, y) - result.a[c](x, y));
              next.b[c](x, y) += s * (candidate.b[c](x, y) - result.b[c](x, y));
            }
          }
        });
      }
    }
    result = std::move(next);
    if (std::none_of(taken.begin(), taken.end(), [](bool t) { return t; })) break;
  }
  return moved;
}

}  // namespace brume
