#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "filters/kernels/a_trous.cpp"
#include "filters/kernels/a_trous.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <numbers>
#include <vector>

HWY_BEFORE_NAMESPACE();
namespace brume::kernels::HWY_NAMESPACE {
#include "filters/kernels/exp2_negative.h"

// Beyond this a neighbour has no weight at all.
constexpr float kFarthest = 80.0f;

struct Rows {
  std::vector<const float*> row;
  size_t count = 0;
  void set(const WorkImage* image, int y) {
    count = image ? image->channels.size() : 0;
    row.resize(count);
    for (size_t c = 0; c < count; ++c) row[c] = image->channels[c].row(y);
  }
};

HWY_INLINE V one_minus_cos_squared(D d, const Rows& a, const Rows& b, int xa, int xb) {
  V cos = hn::LoadU(d, a.row[0] + xa) * hn::LoadU(d, b.row[0] + xb);
  cos = hn::MulAdd(hn::LoadU(d, a.row[1] + xa), hn::LoadU(d, b.row[1] + xb), cos);
  cos = hn::MulAdd(hn::LoadU(d, a.row[2] + xa), hn::LoadU(d, b.row[2] + xb), cos);
  const V one = hn::Set(d, 1.0f);
  const V apart = one - hn::Min(hn::Max(cos, hn::Neg(one)), one);
  const V defined = hn::LoadU(d, a.row[3] + xa) * hn::LoadU(d, b.row[3] + xb);
  return apart * apart * defined;
}

/// kValues: 3, or 6 with a carried layer.
template <size_t kValues>
void Level(const ATrousLevel& level, WorkImage& out, int x0, int x1, int y) {
  const D d;
  const int lanes = static_cast<int>(hn::Lanes(d)), width = level.values->width(), height = level.values->height();
  const V factor = hn::Set(d, -std::numbers::log2e_v<float>), turn = hn::Set(d, level.direction_factor);
  Rows own, own_direction, own_value;
  own.set(level.compared, y);
  own_direction.set(level.directions, y);
  own_value.set(level.values, y);
  // The rows of the taps, looked up once.
  constexpr size_t kRows = 5;
  std::array<Rows, kRows> other, direction, value;
  std::array<int, kRows> offset;
  size_t rows = 0;
  const auto row_of = [&](int dy) {
    size_t r = 0;
    while (r < rows && offset[r] != dy) ++r;
    if (r < rows) return r;
    offset[rows] = dy;
    other[rows].set(level.compared, y + dy), direction[rows].set(level.directions, y + dy);
    value[rows].set(level.values, y + dy);
    return rows++;
  };
  struct Place {
    size_t row;
    int dx;
    float weight;
  };
  std::array<Place, kRows * kRows> places;
  size_t count = 0;
  int widest = 0;
  for (const SparseTap& tap : level.taps)
    if (y + tap.dy >= 0 && y + tap.dy < height) {
      places[count++] = {row_of(tap.dy), tap.dx, tap.weight};
      widest = std::max(widest, std::abs(tap.dx));
    }

  for (int x = x0; x < x1; x += lanes) {
    const bool inside = x - widest >= 0 && x + lanes - 1 + widest < width;
    const V lane = hn::Iota(d, 0.0f) + hn::Set(d, static_cast<float>(x));
    V centre[kValues], sum[kValues], total = hn::Zero(d);
    for (size_t c = 0; c < kValues; ++c) {
      centre[c] = hn::LoadU(d, own_value.row[c] + x);
      sum[c] = hn::Zero(d);
    }
    for (size_t i = 0; i < count; ++i) {
      const auto [r, dx, share] = places[i];
      V far = hn::Zero(d);
      for (size_t c = 0; c < own.count; ++c) {
        const V apart = hn::LoadU(d, own.row[c] + x) - hn::LoadU(d, other[r].row[c] + x + dx);
        far = hn::MulAdd(apart, apart, far);
      }
      if (own_direction.count)
        far = hn::MulAdd(turn, one_minus_cos_squared(d, own_direction, direction[r], x, x + dx), far);
      // NaN, which infinities may leave, counts as far.
      V w = hn::Set(d, share) * exp2_negative(d, far * factor);
      w = hn::IfThenElseZero(hn::Lt(far, hn::Set(d, kFarthest)), w);
      if (!inside) {
        const V column = lane + hn::Set(d, static_cast<float>(dx));
        const M valid = hn::And(hn::Ge(column, hn::Zero(d)), hn::Lt(column, hn::Set(d, static_cast<float>(width))));
        w = hn::IfThenElseZero(valid, w);
      }
      total += w;
      for (size_t c = 0; c < kValues; ++c)
        sum[c] = hn::MulAdd(w, hn::LoadU(d, value[r].row[c] + x + dx) - centre[c], sum[c]);
    }
    const V inverse = hn::Set(d, 1.0f) / total;  // the centre has its tap's weight
    for (size_t c = 0; c < kValues; ++c)
      hn::StoreU(hn::MulAdd(sum[c], inverse, centre[c]), d, out.channels[c].row(y) + x);
  }
}

void ATrousRow(const ATrousLevel& level, WorkImage& out, int x0, int x1, int y) {
  level.values->channels.size() == 3 ? Level<3>(level, out, x0, x1, y) : Level<6>(level, out, x0, x1, y);
}

}  // namespace brume::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume::kernels {
HWY_EXPORT(ATrousRow);

void a_trous_row(const ATrousLevel& level, WorkImage& out, int x0, int x1, int y) {
  HWY_DYNAMIC_DISPATCH(ATrousRow)(level, out, x0, x1, y);
}

}  // namespace brume::kernels
#endif
