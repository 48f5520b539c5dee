#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/window.cpp"
#include "filters/kernels/window.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {
#include "filters/kernels/exp2_negative.h"

// -1 / (2 sigma^2) as an exponent of 2; 0 switches the term off.
float exponent_factor(float sigma) {
  constexpr float kFloor = 1e-6f;
  if (!(sigma > 0)) return 0.0f;
  const float s = std::max(sigma, kFloor);
  return -std::numbers::log2e_v<float> / (2.0f * s * s);
}

template <size_t C>
struct Pixels {
  V v[C];
};

template <size_t C>
HWY_INLINE Pixels<C> load(D d, const std::array<const float*, C>& rows, int x) {
  Pixels<C> p;
  for (size_t c = 0; c < C; ++c) p.v[c] = hn::LoadU(d, rows[c] + x);
  return p;
}

template <size_t C>
HWY_INLINE V squared_distance(const Pixels<C>& a, const Pixels<C>& b) {
  V diff = a.v[0] - b.v[0];
  V sum = diff * diff;
  for (size_t c = 1; c < C; ++c) {
    diff = a.v[c] - b.v[c];
    sum = hn::MulAdd(diff, diff, sum);
  }
  return sum;
}

template <size_t C>
std::array<const float*, C> rows_at(const WorkImage& image, int y) {
  std::array<const float*, C> rows;
  for (size_t c = 0; c < C; ++c) rows[c] = image.channels[c].row(y);
  return rows;
}

// Where a tap is: its weight in the domain kernel as an exponent, and its place.
struct Tap {
  int x, y, row;  // pixel, and its index among the window's rows
  float domain;
};

/// Sums over the window of one block of pixels. `weight(tap)` gives the weights of the block's lanes. Values are summed
/// relative to the centre, so that constants stay exact and bright neighbours do not swallow dark ones.
template <size_t CV>
struct Sums {
  V weight;
  Pixels<CV> centre, value;

  /// Average; where the weights vanish, `otherwise`.
  void finish(D d, V threshold, const Pixels<CV>& otherwise, Pixels<CV>& result) const {
    const M enough = hn::Gt(weight, threshold);
    const V inverse = hn::Set(d, 1.0f) / hn::IfThenElse(enough, weight, hn::Set(d, 1.0f));
    for (size_t c = 0; c < CV; ++c)
      result.v[c] = hn::IfThenElse(enough, hn::MulAdd(value.v[c], inverse, centre.v[c]), otherwise.v[c]);
  }
};

/// Adds the window of the block at (x, y) in one frame: clipped by rows, masked by columns where the block is near an
/// edge.
template <size_t CV, class Weight>
HWY_INLINE void add_window(D d, const WorkImage& values, int radius, int x, int y, float domain_factor,
                           const Weight& weight, Sums<CV>& s) {
  const int width = values.width(), height = values.height();
  const int lanes = static_cast<int>(hn::Lanes(d));
  const bool inside = x - radius >= 0 && x + lanes - 1 + radius < width;
  const V lane = hn::Iota(d, 0.0f) + hn::Set(d, static_cast<float>(x));
  for (int ty = std::max(0, y - radius); ty <= std::min(height - 1, y + radius); ++ty) {
    const auto rows = rows_at<CV>(values, ty);
    const float dy2 = static_cast<float>((ty - y) * (ty - y));
    for (int dx = -radius; dx <= radius; ++dx) {
      V w = weight(Tap{x + dx, ty, ty - y + radius, domain_factor * (dy2 + static_cast<float>(dx * dx))});
      if (!inside) {
        const V column = lane + hn::Set(d, static_cast<float>(dx));
        const M valid = hn::And(hn::Ge(column, hn::Zero(d)), hn::Lt(column, hn::Set(d, static_cast<float>(width))));
        w = hn::IfThenElseZero(valid, w);
      }
      s.weight += w;
      for (size_t c = 0; c < CV; ++c)
        s.value.v[c] = hn::MulAdd(w, hn::LoadU(d, rows[c] + x + dx) - s.centre.v[c], s.value.v[c]);
    }
  }
}

template <size_t CV, class Weight>
HWY_INLINE Sums<CV> sum_window(D d, const WindowInput& in, int x, int y, float domain_factor, const Weight& weight) {
  Sums<CV> s{hn::Zero(d), load(d, rows_at<CV>(*in.values, y), x), {}};
  for (size_t c = 0; c < CV; ++c) s.value.v[c] = hn::Zero(d);
  add_window(d, *in.values, in.radius, x, y, domain_factor, weight, s);
  return s;
}

/// The guide's rows of a window, looked up once per block instead of once per tap.
template <size_t C>
struct WindowRows {
  std::array<std::array<const float*, C>, 2 * 32 + 1> rows;
  WindowRows(const WorkImage& image, int y, int radius) {
    for (int ty = std::max(0, y - radius); ty <= std::min(image.height() - 1, y + radius); ++ty)
      rows[static_cast<size_t>(ty - y + radius)] = rows_at<C>(image, ty);
  }
  const std::array<const float*, C>& operator[](int row) const { return rows[static_cast<size_t>(row)]; }
};

template <size_t CG, size_t CV>
HWY_INLINE void bilateral_block(D d, const WindowInput& in, const WindowRows<CG>& guide, const Pixels<CG>& centre,
                                float domain, float range, int x, int y, Pixels<CV>& result) {
  const V k = hn::Set(d, range);
  const Sums<CV> s = sum_window<CV>(d, in, x, y, domain, [&](const Tap& tap) HWY_ATTR {
    const V distance = squared_distance(load(d, guide[tap.row], tap.x), centre);
    return exp2_negative(d, hn::MulAdd(distance, k, hn::Set(d, tap.domain)));
  });
  s.finish(d, hn::Zero(d), s.centre, result);
}

/// Runs `block(x, result)` over a row, and the background's treatment where the medium is not shown.
template <size_t CG, size_t CV, class Block>
HWY_INLINE void run_row(D d, const WindowInput& in, const WindowRows<CG>& guide, int y, const Block& block) {
  const int width = in.values->width(), lanes = static_cast<int>(hn::Lanes(d));
  const float domain = exponent_factor(in.background_weights.sigma_domain),
              range = exponent_factor(in.background_weights.sigma_range);
  for (int x = 0; x < width; x += lanes) {
    Pixels<CV> result;
    M background = hn::MaskFromVec(hn::Zero(d));
    if (in.medium) background = hn::Eq(hn::LoadU(d, in.medium->row(y) + x), hn::Zero(d));
    if (!hn::AllTrue(d, background)) block(x, result);
    if (!hn::AllFalse(d, background)) {
      Pixels<CV> other = load(d, rows_at<CV>(*in.values, y), x);
      if (in.background == WindowInput::Background::kBilateral)
        bilateral_block<CG, CV>(d, in, guide, load(d, rows_at<CG>(*in.guide, y), x), domain, range, x, y, other);
      for (size_t c = 0; c < CV; ++c)
        result.v[c] = hn::AllTrue(d, background) ? other.v[c] : hn::IfThenElse(background, other.v[c], result.v[c]);
    }
    for (size_t c = 0; c < CV; ++c) hn::StoreU(result.v[c], d, in.out->channels[c].row(y) + x);
  }
}

template <size_t CG, size_t CV>
void bilateral(const WindowInput& in, const Bilateral& weights, int y) {
  const D d;
  const WindowRows<CG> guide(*in.guide, y, in.radius);
  const float domain = exponent_factor(weights.sigma_domain), range = exponent_factor(weights.sigma_range);
  run_row<CG, CV>(d, in, guide, y, [&](int x, Pixels<CV>& result) HWY_ATTR {
    bilateral_block<CG, CV>(d, in, guide, load(d, rows_at<CG>(*in.guide, y), x), domain, range, x, y, result);
  });
}

template <size_t CG, size_t CV>
void extended(const WindowInput& in, const Bilateral& weights, const WorkImage& prefiltered, int y) {
  const D d;
  const WindowRows<CG> guide(*in.guide, y, in.radius);
  const float domain = exponent_factor(weights.sigma_domain), range = exponent_factor(weights.sigma_range);
  // The share of the domain kernel below which no neighbour counts as near (docs/methods.md, Extended
  // bilateral).
  float total = 0;
  for (int dy = -in.radius; dy <= in.radius; ++dy)
    for (int dx = -in.radius; dx <= in.radius; ++dx) total += std::exp2(domain * static_cast<float>(dx * dx + dy * dy));
  const V threshold = hn::Set(d, 1e-8f * total), k = hn::Set(d, range);
  // The values' own prefiltered channels follow the guide's where the two images differ.
  const size_t first = in.values == in.guide ? 0 : CG;
  run_row<CG, CV>(d, in, guide, y, [&](int x, Pixels<CV>& result) HWY_ATTR {
    const Pixels<CG> centre = load(d, rows_at<CG>(prefiltered, y), x);
    const Sums<CV> s = sum_window<CV>(d, in, x, y, domain, [&](const Tap& tap) HWY_ATTR {
      return exp2_negative(
          d, hn::MulAdd(squared_distance(load(d, guide[tap.row], tap.x), centre), k, hn::Set(d, tap.domain)));
    });
    Pixels<CV> otherwise;
    for (size_t c = 0; c < CV; ++c) otherwise.v[c] = hn::LoadU(d, prefiltered.channels[first + c].row(y) + x);
    s.finish(d, threshold, otherwise, result);
  });
}

/// What a pixel of one frame compares with its neighbours in it or in another.
struct GradientWindow {
  WindowRows<3> guide;
  WindowRows<4> directions;
  const WorkImage* values;
  const PaddedPlane* opacity;
};

template <GradientVariant kVariant>
void gradient_kernel(const WindowInput& in, const GradientWeights& weights, const WorkImage& gradient,
                     const PaddedPlane* opacity, int y, std::span<const GradientSlice> nearby) {
  const D d;
  std::vector<GradientWindow> windows;
  windows.push_back({{*in.guide, y, in.radius}, {gradient, y, in.radius}, in.values, opacity});
  for (const GradientSlice& other : nearby)
    windows.push_back({{*other.guide, y, in.radius}, {*other.gradient, y, in.radius}, other.values, other.opacity});
  const float domain = exponent_factor(weights.bilateral.sigma_domain);
  const V range = hn::Set(d, exponent_factor(weights.bilateral.sigma_range)),
          angle = hn::Set(d, exponent_factor(weights.sigma_gradient));
  const V one = hn::Set(d, 1.0f);
  run_row<3, 3>(d, in, windows[0].guide, y, [&](int x, Pixels<3>& result) HWY_ATTR {
    const Pixels<3> centre = load(d, rows_at<3>(*in.guide, y), x);
    const Pixels<4> direction = load(d, rows_at<4>(gradient, y), x);
    const V undefined = one - direction.v[3];
    const V centre_opacity = kVariant == GradientVariant::kGate ? hn::LoadU(d, opacity->row(y) + x) : hn::Zero(d);
    Sums<3> s{hn::Zero(d), load(d, rows_at<3>(*in.values, y), x), {}};
    for (size_t c = 0; c < 3; ++c) s.value.v[c] = hn::Zero(d);
    for (const GradientWindow& window : windows)
      add_window(
          d, *window.values, in.radius, x, y, domain,
          [&](const Tap& tap) HWY_ATTR {
            const V distance = squared_distance(load(d, window.guide[tap.row], tap.x), centre);
            const Pixels<4> other = load(d, window.directions[tap.row], tap.x);
            V cosine = hn::MulAdd(direction.v[2], other.v[2],
                                  hn::MulAdd(direction.v[1], other.v[1], direction.v[0] * other.v[0]));
            cosine = hn::Max(hn::Min(cosine, one), hn::Set(d, -1.0f));
            const V apart = one - cosine;
            const V turned = apart * apart * angle;
            const V defined = direction.v[3] * other.v[3];
            const V position = hn::Set(d, tap.domain);
            const V similar = exp2_negative(d, hn::MulAdd(distance, range, position));
            if constexpr (kVariant == GradientVariant::kMultiply) {
              const V both = exp2_negative(d, hn::MulAdd(distance, range, position) + turned);
              return hn::MulAdd(both, defined, similar * undefined);
            } else if constexpr (kVariant == GradientVariant::kGate) {
              const V o = hn::LoadU(d, window.opacity->row(tap.y) + tap.x) - centre_opacity;
              const V veil = o * o * hn::Set(d, exponent_factor(weights.sigma_opacity));
              const V aligned = exp2_negative(d, turned + veil + position);
              return hn::MulAdd(aligned * defined, hn::Set(d, weights.gate_strength), similar);
            } else {
              return hn::MulAdd(exp2_negative(d, turned + position), defined, similar);
            }
          },
          s);
    s.finish(d, hn::Zero(d), s.centre, result);
  });
}

HWY_INLINE void order(V& a, V& b) {
  const V low = hn::Min(a, b);
  b = hn::Max(a, b);
  a = low;
}

// Five comparators sort four.
HWY_INLINE void sort4(V& a, V& b, V& c, V& e) {
  order(a, b);
  order(c, e);
  order(a, c);
  order(b, e);
  order(b, c);
}

void RoadRow(const WorkImage& guide, PaddedPlane& road, int y) {
  const D d;
  const int height = guide.height();
  std::array<std::array<const float*, 3>, 3> rows;
  for (int dy = -1; dy <= 1; ++dy)
    rows[static_cast<size_t>(dy + 1)] = rows_at<3>(guide, std::clamp(y + dy, 0, height - 1));
  for (int x = 0; x < guide.width(); x += static_cast<int>(hn::Lanes(d))) {
    const Pixels<3> centre = load(d, rows[1], x);
    const auto distance = [&](int dx, size_t row)
                              HWY_ATTR { return hn::Sqrt(squared_distance(load(d, rows[row], x + dx), centre)); };
    V a = distance(-1, 0), b = distance(0, 0), c = distance(1, 0), e = distance(-1, 1);
    V f = distance(1, 1), g = distance(-1, 2), h = distance(0, 2), i = distance(1, 2);
    sort4(a, b, c, e);
    sort4(f, g, h, i);
    // Of two sorted fours, the four smallest are the smaller of each pair taken from opposite ends.
    hn::StoreU(hn::Min(a, i) + hn::Min(b, h) + (hn::Min(c, g) + hn::Min(e, f)), d, road.row(y) + x);
  }
  road.extend_row(y);
}

void TrilateralRow(const WindowInput& in, const TrilateralWeights& weights, const PaddedPlane& road, int y) {
  const D d;
  const WindowRows<3> guide(*in.guide, y, in.radius);
  const float domain = exponent_factor(weights.bilateral.sigma_domain);
  const V range = hn::Set(d, exponent_factor(weights.bilateral.sigma_range)),
          impulse = hn::Set(d, exponent_factor(weights.sigma_impulse));
  const V joint = hn::Set(d, 0.25f * exponent_factor(weights.sigma_joint));  // of ((ROAD(x) + ROAD(y)) / 2)^2
  const V one = hn::Set(d, 1.0f);
  run_row<3, 3>(d, in, guide, y, [&](int x, Pixels<3>& result) HWY_ATTR {
    const Pixels<3> centre = load(d, rows_at<3>(*in.guide, y), x);
    const V own = hn::LoadU(d, road.row(y) + x);
    const Sums<3> s = sum_window<3>(d, in, x, y, domain, [&](const Tap& tap) HWY_ATTR {
      const V distance = squared_distance(load(d, guide[tap.row], tap.x), centre);
      const V other = hn::LoadU(d, road.row(tap.y) + tap.x);
      const V both = own + other;
      const V clean = exp2_negative(d, both * both * joint);  // 1 - J
      const V spread = distance * range, noisy = other * other * impulse;
      // One exponent: (1 - J) of the range term and J of the impulse term.
      return exp2_negative(d, hn::MulAdd(clean, spread, hn::MulAdd(one - clean, noisy, hn::Set(d, tap.domain))));
    });
    s.finish(d, hn::Set(d, 1e-30f), s.centre, result);
  });
}

void GaussianHorizontalRow(const WorkImage& in, WorkImage& out, int radius, float sigma, int y) {
  const D d;
  const int width = in.width(), lanes = static_cast<int>(hn::Lanes(d));
  const float k = exponent_factor(sigma);
  for (int x = 0; x < width; x += lanes) {
    const bool inside = x - radius >= 0 && x + lanes - 1 + radius < width;
    const V lane = hn::Iota(d, 0.0f) + hn::Set(d, static_cast<float>(x));
    for (size_t c = 0; c < in.channels.size(); ++c) {
      const float* row = in.channels[c].row(y);
      const V centre = hn::LoadU(d, row + x);
      V sum = hn::Zero(d), total = hn::Zero(d);
      for (int dx = -radius; dx <= radius; ++dx) {
        V w = hn::Set(d, std::exp2(k * static_cast<float>(dx * dx)));
        if (!inside) {
          const V column = lane + hn::Set(d, static_cast<float>(dx));
          w = hn::IfThenElseZero(
              hn::And(hn::Ge(column, hn::Zero(d)), hn::Lt(column, hn::Set(d, static_cast<float>(width)))), w);
        }
        total += w;
        sum = hn::MulAdd(w, hn::LoadU(d, row + x + dx) - centre, sum);
      }
      hn::StoreU(centre + sum / total, d, out.channels[c].row(y) + x);
    }
  }
}

void GaussianVerticalRow(const WorkImage& in, WorkImage& out, int radius, float sigma, int y) {
  const D d;
  const int width = in.width(), lanes = static_cast<int>(hn::Lanes(d));
  const float k = exponent_factor(sigma);
  const int first = std::max(0, y - radius), last = std::min(in.height() - 1, y + radius);
  std::vector<float> taps;
  float total = 0;
  for (int ty = first; ty <= last; ++ty) {
    taps.push_back(std::exp2(k * static_cast<float>((ty - y) * (ty - y))));
    total += taps.back();
  }
  const V inverse = hn::Set(d, 1.0f / total);
  for (size_t c = 0; c < in.channels.size(); ++c)
    for (int x = 0; x < width; x += lanes) {
      const V centre = hn::LoadU(d, in.channels[c].row(y) + x);
      V sum = hn::Zero(d);
      for (int ty = first; ty <= last; ++ty)
        sum = hn::MulAdd(hn::Set(d, taps[static_cast<size_t>(ty - first)]),
                         hn::LoadU(d, in.channels[c].row(ty) + x) - centre, sum);
      hn::StoreU(hn::MulAdd(sum, inverse, centre), d, out.channels[c].row(y) + x);
    }
}

void BackgroundRow(const WindowInput& in, const WorkImage& image, int y) {
  const D d;
  const WindowRows<3> guide(*in.guide, y, in.radius);
  run_row<3, 3>(d, in, guide, y, [&](int x, Pixels<3>& result) HWY_ATTR { result = load(d, rows_at<3>(image, y), x); });
}

void BilateralRow(const WindowInput& in, const Bilateral& weights, int y) {
  if (in.guide->channels.size() == 1)
    return in.values->channels.size() == 3 ? bilateral<1, 3>(in, weights, y) : bilateral<1, 4>(in, weights, y);
  return bilateral<3, 3>(in, weights, y);
}

void ExtendedBilateralRow(const WindowInput& in, const Bilateral& weights, const WorkImage& prefiltered, int y) {
  if (in.guide->channels.size() == 1)
    return in.values->channels.size() == 3 ? extended<1, 3>(in, weights, prefiltered, y)
                                           : extended<1, 4>(in, weights, prefiltered, y);
  return extended<3, 3>(in, weights, prefiltered, y);
}

void GradientKernelRow(const WindowInput& in, const GradientWeights& weights, const WorkImage& gradient,
                       const PaddedPlane* opacity, int y, std::span<const GradientSlice> nearby) {
  switch (weights.variant) {
    case GradientVariant::kAdd:
      return gradient_kernel<GradientVariant::kAdd>(in, weights, gradient, opacity, y, nearby);
    case GradientVariant::kMultiply:
      return gradient_kernel<GradientVariant::kMultiply>(in, weights, gradient, opacity, y, nearby);
    case GradientVariant::kGate:
      return gradient_kernel<GradientVariant::kGate>(in, weights, gradient, opacity, y, nearby);
  }
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(BackgroundRow);
HWY_EXPORT(BilateralRow);
HWY_EXPORT(ExtendedBilateralRow);
HWY_EXPORT(GradientKernelRow);
HWY_EXPORT(RoadRow);
HWY_EXPORT(TrilateralRow);
HWY_EXPORT(GaussianHorizontalRow);
HWY_EXPORT(GaussianVerticalRow);

void background_row(const WindowInput& in, const WorkImage& image, int y) {
  HWY_DYNAMIC_DISPATCH(BackgroundRow)(in, image, y);
}
void bilateral_row(const WindowInput& in, const Bilateral& weights, int y) {
  HWY_DYNAMIC_DISPATCH(BilateralRow)(in, weights, y);
}
void extended_bilateral_row(const WindowInput& in, const Bilateral& weights, const WorkImage& prefiltered, int y) {
  HWY_DYNAMIC_DISPATCH(ExtendedBilateralRow)(in, weights, prefiltered, y);
}
void gradient_kernel_row(const WindowInput& in, const GradientWeights& weights, const WorkImage& gradient,
                         const PaddedPlane* opacity, int y, std::span<const GradientSlice> nearby) {
  HWY_DYNAMIC_DISPATCH(GradientKernelRow)(in, weights, gradient, opacity, y, nearby);
}
void road_row(const WorkImage& guide, PaddedPlane& road, int y) {
  HWY_DYNAMIC_DISPATCH(RoadRow)(guide, road, y);
}
void trilateral_row(const WindowInput& in, const TrilateralWeights& weights, const PaddedPlane& road, int y) {
  HWY_DYNAMIC_DISPATCH(TrilateralRow)(in, weights, road, y);
}
void gaussian_horizontal_row(const WorkImage& in, WorkImage& out, int radius, float sigma, int y) {
  HWY_DYNAMIC_DISPATCH(GaussianHorizontalRow)(in, out, radius, sigma, y);
}
void gaussian_vertical_row(const WorkImage& in, WorkImage& out, int radius, float sigma, int y) {
  HWY_DYNAMIC_DISPATCH(GaussianVerticalRow)(in, out, radius, sigma, y);
}

}  // namespace brume::kernels
#endif
