#include "filters/regression/mixing.h"

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
constexpr Window kWindows[] = {{3, 2}, {6, 4}, {12, 8}, {28, 16}};  // each block twice as wide as the one before
constexpr int kRounds = 3;
constexpr float kLargeValue = 1.5f;   // of the largest value over the pixels of a window, taken off a gain
constexpr double kFirefly = 0.999;    // quantile of gains at which single pixels are cut: none decides alone
constexpr double kShareWindow = 1.5;  // over which shares are smoothed [px]

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

/// What is averaged over windows, as means over blocks; what lies beyond the picture's edge counts as nothing.
struct Measures {
  Plane share, gain, square, fourth, loss;  ///< the gain's powers and the loss times the region's share

  Measures(const Step& step, const Plane& region, const Task& task)
      : Measures((region.width() + 1) / 2, (region.height() + 1) / 2) {
    fold(region.width(), region.height(), task, [&](int x, int y, float* sums) {
      const float n = region(x, y), g = step.gain(x, y);
      sums[0] += n;
      sums[1] += n * g;
      sums[2] += n * g * g;
      sums[3] += n * g * g * g * g;
      sums[4] += n * step.loss(x, y);
    });
  }
  /// Over blocks twice as wide.
  Measures(const Measures& fine, const Task& task)
      : Measures((fine.share.width() + 1) / 2, (fine.share.height() + 1) / 2) {
    fold(fine.share.width(), fine.share.height(), task, [&](int x, int y, float* sums) {
      sums[0] += fine.share(x, y);
      sums[1] += fine.gain(x, y);
      sums[2] += fine.square(x, y);
      sums[3] += fine.fourth(x, y);
      sums[4] += fine.loss(x, y);
    });
  }
  Measures blurred(double deviation, const Task& task) const {
    const auto blur = [&](const Plane& plane) { return gaussian_blur(plane, deviation, task); };
    return {blur(share), blur(gain), blur(square), blur(fourth), blur(loss)};
  }

 private:
  Measures(int width, int height)
      : share(width, height), gain(width, height), square(width, height), fourth(width, height), loss(width, height) {}
  Measures(Plane n, Plane g, Plane g2, Plane g4, Plane l)
      : share(std::move(n)), gain(std::move(g)), square(std::move(g2)), fourth(std::move(g4)), loss(std::move(l)) {}
  /// @param add  called as add(x, y, sums) for the places of a finer grid
  template <class Add>
  void fold(int width, int height, const Task& task, const Add& add) {
    for_each_row(share.height(), quiet(task), [&](int by) {
      for (int bx = 0; bx < share.width(); ++bx) {
        float sums[5] = {};
        for (int y = 2 * by; y < std::min(height, 2 * by + 2); ++y)
          for (int x = 2 * bx; x < std::min(width, 2 * bx + 2); ++x) add(x, y, sums);
        Plane* const to[] = {&share, &gain, &square, &fourth, &loss};
        for (size_t i = 0; i < 5; ++i) (*to[i])(bx, by) = 0.25f * sums[i];
      }
    });
  }
};

/// What a step is sure to gain, and its best length, at each block.
struct SureGain {
  Plane gain, share;
  bool any = false;

  SureGain(const Measures& m, double sure, double pixels)
      : gain(m.share.width(), m.share.height()), share(m.share.width(), m.share.height()) {
    for (int y = 0; y < gain.height(); ++y)
      for (int x = 0; x < gain.width(); ++x) {
        const float n = m.share(x, y);
        if (!(n > 1e-6f) || !(m.gain(x, y) > 0)) continue;
        const float b = m.gain(x, y) / n, count = static_cast<float>(pixels) * n;
        const float variance = std::max(0.0f, m.square(x, y) / n - b * b);
        const float largest = std::pow(m.fourth(x, y) / n * count, 0.25f);
        const float low = b - static_cast<float>(sure) * std::sqrt(variance / count) - kLargeValue * largest / count;
        if (!(low > 0)) continue;
        const float a = std::max(m.loss(x, y) / n, 1e-30f);
        share(x, y) = std::min(1.0f, low / a);
        gain(x, y) = share(x, y) * (2 * low - share(x, y) * a);
        any = true;
      }
  }
};

void consider(int proposal, const Step& step, const MixingRegion& region, Best& best, const Task& task) {
  Measures measures(step, region.share, task);
  for (const Window& window : kWindows) {
    if (window.block > 2) measures = Measures(measures, task);
    const double s = window.deviation;
    // So many pixels count as much as the window.
    const SureGain sure(measures.blurred(s / window.block, task), region.sure, 4 * kPi * s * s);
    if (!sure.any) continue;
    for_each_row(region.share.height(), quiet(task), [&](int y) {
      const BlockPlace v(y, window.block, sure.gain.height());
      for (int x = 0; x < region.share.width(); ++x) {
        if (!(region.share(x, y) > 0)) continue;
        const BlockPlace u(x, window.block, sure.gain.width());
        const float found = between(sure.gain, u, v);
        if (!(found > best.gain(x, y))) continue;
        best.gain(x, y) = found;
        best.share(x, y) = between(sure.share, u, v);
        best.of(x, y) = proposal;
      }
    });
  }
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
        if (!any_above_0(share)) continue;
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
