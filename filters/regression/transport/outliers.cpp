#include "filters/regression/transport/outliers.h"

#include <algorithm>
#include <cmath>

#include "base/vec.h"
#include "filters/inputs/extremes.h"

namespace brume {
namespace {

// Windows of local means of noise and of what returns the light taken from outliers [px].
constexpr double kNoiseWindow = 10, kReturnWindow = 32;
// An outlier is this many times what the other half shows, and more.
constexpr float kAgreement = 3;
// What both halves show is a point, a lamp or a star, where within this radius [px] no more pixels than these have a
// quarter of it, and too few within another are as bright in one half alone for noise.
constexpr int kPointRadius = 3, kPointPixels = 4, kChanceRadius = 10;
constexpr float kPointShare = 0.25f;
// From neighbours that are more times as bright, as in a highlight, less is taken over.
constexpr float kBrighter = 2;

/// What is far above a fit in both halves.
enum class Shown { kArea, kPoint, kNoise };

/// What lies above a fit, relative to it: of each half.
struct Excess {
  Plane a, b;
  float most;  ///< `limit` times the frame's deviation, of squares drawn in at what the last round found

  /// @param level  the fit's brightness
  Excess(const RgbPlanes& half_a, const RgbPlanes& half_b, const Plane& level, const Plane& mask,
         const FrameSpace& space, double limit, const Task& task) {
    const int width = level.width(), height = level.height();
    double sum = 0, count = std::max(1e-30, sum_of(mask));
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        if (mask(x, y) > 0) sum += static_cast<double>(std::max(0.0f, level(x, y)));
    const float floor = static_cast<float>(static_cast<double>(kDark) * sum / count) + 1e-30f;
    const auto relative = [&](const RgbPlanes& half) {
      return make_plane(width, height, quiet(task), [&](int x, int y) {
        if (!(mask(x, y) > 0)) return 0.0f;
        const float l = space.luminance(color_at(half, x, y));
        return (l - level(x, y)) / (std::max(0.0f, level(x, y)) + floor);
      });
    };
    a = relative(half_a);
    b = relative(half_b);
    double found = 1e15;
    for (int round = 0; round < 30; ++round) {
      double squares = 0;
      const double top = limit * found;
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
          for (const Plane* u : {&a, &b}) {
            const double v = std::min(std::abs(static_cast<double>((*u)(x, y))), top);
            squares += v * v;
          }
      const double next = std::sqrt(squares / (2 * count));
      if (next > 0.999 * found) break;
      found = next;
    }
    most = static_cast<float>(limit * found);
  }
  bool in_one_alone(int x, int y) const { return kAgreement * of_both(x, y) < std::max(a(x, y), b(x, y)); }
  /// What single halves show, in order.
  std::vector<float> singles() const {
    std::vector<float> all;
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x)
        if (in_one_alone(x, y)) all.push_back(std::max(a(x, y), b(x, y)));
    std::sort(all.begin(), all.end());
    return all;
  }
  float of_both(int x, int y) const { return std::min(a(x, y), b(x, y)); }
  /// Whether what both halves show at a pixel is a lamp or a star, or noise that is bright in both by chance.
  /// @param can_be_point  whether there can be lamps and stars
  /// @param singles       of the frame, where guides would know of these; else empty
  Shown shown(int x, int y, bool can_be_point, const std::vector<float>& singles) const {
    const float here = of_both(x, y);
    const auto count = [&](int radius, const auto& counts) {
      const Box box = Box{x, y, x + 1, y + 1}.grown(radius, a.width(), a.height());
      int n = 0;
      for (int v = box.y0; v < box.y1; ++v)
        for (int u = box.x0; u < box.x1; ++u) n += counts(u, v);
      return n;
    };
    if (count(kPointRadius, [&](int u, int v) { return of_both(u, v) > kPointShare * here; }) > kPointPixels)
      return Shown::kArea;
    if (!can_be_point) return Shown::kNoise;
    const int in_one =
        count(kChanceRadius, [&](int u, int v) { return in_one_alone(u, v) && std::max(a(u, v), b(u, v)) > here; });
    const int around = count(kChanceRadius, [](int, int) { return true; });
    // Some of a frame's many pixels may well be bright in both halves.
    const auto in_frame = singles.end() - std::upper_bound(singles.begin(), singles.end(), here);
    const bool by_chance =
        meet_by_chance(in_one, around) || meet_by_chance(static_cast<int>(in_frame), a.width() * a.height());
    return by_chance ? Shown::kNoise : Shown::kPoint;
  }
};

/// Draws outliers in to a first fit.
/// @param blurred  whether only surfaces can show points: a medium scatters light into all of its neighbourhood
ClampedHalves clamped(const RegressionInput& input, const HalfPair& first, double limit, bool blurred,
                      const Task& task) {
  const RgbPlanes &a = input.half_a, &b = input.half_b;
  const Plane &mask = input.known.mask, &solid = input.known.surfaces.share;
  const bool halves = input.halves;
  const FrameSpace& space = input.known.space;
  const Rgb fit = mean(first, task);
  const int width = mask.width(), height = mask.height();
  const Excess excess(a, b, brightness(first, space, task), mask, space, limit, task);
  const float top = excess.most;
  const std::vector<float> singles =
      halves && !input.known.expected[0].empty() ? excess.singles() : std::vector<float>();
  const Plane square = make_plane(width, height, quiet(task), [&](int x, int y) {
    const float va = std::min(std::abs(excess.a(x, y)), top), vb = std::min(std::abs(excess.b(x, y)), top);
    return 0.5f * (va * va + vb * vb);
  });
  const Plane one(width, height, 1.0f);
  const Plane local = std::move(local_ratio({&square}, one, mask, kNoiseWindow, task)[0]);
  ClampedHalves out;
  for (size_t c = 0; c < 3; ++c) {
    out.a[c] = *a[c];
    out.b[c] = *b[c];
    out.taken[c] = Plane::lazy_zeros(width, height);
    out.points[c] = Plane::lazy_zeros(width, height);
  }
  for_each_row(height, quiet(task), [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (!(mask(x, y) > 0)) continue;
      const float most = static_cast<float>(limit) * std::sqrt(std::max(0.5f * local(x, y), 0.0f) +
                                                               0.5f * top * top / static_cast<float>(limit * limit));
      const bool can_be_point = !blurred || (!solid.empty() && solid(x, y) > 0);
      const Shown shown =
          halves && excess.of_both(x, y) > most ? excess.shown(x, y, can_be_point, singles) : Shown::kArea;
      const bool point = shown == Shown::kPoint, agree = halves && shown != Shown::kNoise;
      const auto draw = [&](const Plane& u, const Plane& other, Rgb& half) {
        // What both halves show is no outlier.
        const float bound = agree ? std::max(most, kAgreement * other(x, y)) : most;
        if (!(u(x, y) > (point ? most : bound))) return;
        const float share = 1 - std::min(1.0f, bound / u(x, y)), all = point ? 1 - most / u(x, y) : share;
        for (size_t c = 0; c < 3; ++c) {
          const float missed = half[c](x, y) - fit[c](x, y);
          half[c](x, y) -= all * missed;
          out.taken[c](x, y) += 0.5f * share * missed;
          out.points[c](x, y) += 0.5f * (all - share) * missed;
        }
      };
      draw(excess.a, excess.b, out.a);
      draw(excess.b, excess.a, out.b);
    }
  });
  return out;
}

/// Two inputs from one, for frames without halves: each has the pixels of one colour of a chessboard, and between
/// them what the fit says there and the mean of what it misses at the four neighbours, less where the fit
/// is much brighter there. Their noise is independent where the noise of neighbouring pixels is.
HalfPair chessboard_halves(const Rgb& data, const Rgb& fit, const Plane& mask, const Task& task) {
  const int width = mask.width(), height = mask.height();
  constexpr int kNext[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
  HalfPair out{data, data};
  for_each_row(height, quiet(task), [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (!(mask(x, y) > 0)) continue;
      Rgb& half = (x + y) % 2 == 0 ? out.b : out.a;
      const auto share_of = [&](size_t c, int u, int v) {
        const float here = std::abs(fit[c](x, y)), there = std::abs(fit[c](u, v));
        return there > kBrighter * here ? kBrighter * here / there : 1.0f;
      };
      for (size_t c = 0; c < 3; ++c) {
        float missed = 0, count = 0;
        for (const auto& [dx, dy] : kNext) {
          const int u = x + dx, v = y + dy;
          if (u < 0 || v < 0 || u >= width || v >= height || !(mask(u, v) > 0)) continue;
          missed += share_of(c, u, v) * (data[c](u, v) - fit[c](u, v));
          ++count;
        }
        half[c](x, y) = fit[c](x, y) + (count > 0 ? missed / count : 0.0f);
      }
    }
  });
  return out;
}

}  // namespace

ClampedHalves draw_outliers_in(RegressionInputs& inputs, float power, double limit, bool blurred, const Task& task) {
  for (RegressionInput& q : inputs) q.weigh_by(q.known.bright, power, task);
  TransportColumns& own = inputs[0].known;
  for (const Fit fit : {Fit::kPredicted, Fit::kShape, Fit::kAll}) own[fit].standardise(inputs[0].weight, task);
  for (RegressionInput& q : inputs) q.known.scale_like(own);
  std::vector<HalfPair> fits(inputs.size());
  const auto keep = [&](size_t, size_t i, size_t c, Plane a, Plane b) {
    fits[i].a[c] = std::move(a);
    fits[i].b[c] = std::move(b);
  };
  const auto halves = [](const RegressionInput& q) { return std::array{q.half_a, q.half_b}; };
  fit(inputs, {Fit::kAll, {0, kGlobalRidge, 0}, own.base}, halves, keep, task);
  ClampedHalves own_data;
  for (size_t i = 0; i < inputs.size(); ++i) {
    RegressionInput& q = inputs[i];
    ClampedHalves drawn = clamped(q, fits[i], limit, blurred, task);
    q.left = q.halves ? HalfPair{std::move(drawn.a), std::move(drawn.b)}
                      : chessboard_halves(drawn.a, fits[i].a, q.known.mask, task);
    fits[i] = {};
    if (i == 0) own_data = {q.left.a, q.left.b, std::move(drawn.taken), std::move(drawn.points)};
  }
  return own_data;
}

void redistribute_energy(const Rgb& taken, Rgb& picture, const Plane& mask, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    const Plane base = make_plane(mask.width(), mask.height(), quiet(task),
                                  [&](int x, int y) { return std::max(0.0f, picture[c](x, y)); });
    // With the weight 1 / base the fitted factor is the ratio of the sums.
    const double typical = sum_of(base) / std::max(1.0, sum_of(mask));
    const float least = static_cast<float>(1e-3 * typical) + 1e-30f;
    const Plane weight = make_plane(mask.width(), mask.height(), quiet(task), [&](int x, int y) {
      return mask(x, y) > 0 ? 1.0f / std::max(base(x, y), least) : 0.0f;
    });
    const std::vector<Plane> back = local_ratio({&taken[c]}, base, weight, kReturnWindow, task);
    for_each_pixel(mask.width(), mask.height(), quiet(task), [&](int x, int y) { picture[c](x, y) += back[0](x, y); });
  }
}

void keep_within_known(const RgbPlanes& data, const Rgb& expected, const Plane& mask, bool from_above, Rgb& picture,
                       const Task& task) {
  constexpr int kLowRadius = 1, kHighRadius = 2;
  constexpr float kLow = 0.1f, kHigh = 10, kExplained = 2;
  for (size_t c = 0; c < 3; ++c) {
    const Plane low = window_minimum(*data[c], kLowRadius, task);
    Plane shown, explained;
    if (from_above) {
      shown = box_mean(*data[c], kHighRadius, task);
      explained = box_mean(expected[c], kHighRadius, task);
    }
    for_each_pixel(mask.width(), mask.height(), quiet(task), [&](int x, int y) {
      if (!(mask(x, y) > 0)) return;
      float& value = picture[c](x, y);
      const float least = std::min(low(x, y), expected[c](x, y)), most = std::max((*data[c])(x, y), expected[c](x, y));
      if (value < kLow * least) value = least;
      if (least >= 0) value = std::max(value, 0.0f);
      if (from_above && value > kHigh * most && shown(x, y) < kExplained * explained(x, y)) value = most;
    });
  }
}

void keep_within_neighbours(const RgbPlanes& data, const Plane& solid, Rgb& picture, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    const Plane low = window_minimum(*data[c], 1, task), high = window_maximum(*data[c], 1, task);
    for_each_pixel(solid.width(), solid.height(), quiet(task), [&](int x, int y) {
      if (solid(x, y) > 0) picture[c](x, y) = std::clamp(picture[c](x, y), low(x, y), high(x, y));
    });
  }
}

}  // namespace brume
