#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "image/stored_plane.cpp"
#include "image/stored_plane.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/parallel_for.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;

/// Calls work(first, count) for whole vectors, then for what is left.
template <class Work>
HWY_INLINE void each_vector(size_t count, const Work& work) {
  const size_t lanes = hn::Lanes(D());
  size_t i = 0;
  for (; i + lanes <= count; i += lanes) work(i, lanes);
  if (i < count) work(i, count - i);
}

/// The lowest and the highest value; false where one is not finite.
bool FindExtent(const float* HWY_RESTRICT values, size_t count, float& low, float& high) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  auto lowest = hn::Set(d, values[0]), highest = lowest;
  auto finite = hn::IsFinite(lowest);
  size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto v = hn::LoadU(d, values + i);
    finite = hn::And(finite, hn::IsFinite(v));
    lowest = hn::Min(lowest, v);
    highest = hn::Max(highest, v);
  }
  bool all = hn::AllTrue(d, finite);
  low = hn::GetLane(hn::MinOfLanes(d, lowest));
  high = hn::GetLane(hn::MaxOfLanes(d, highest));
  for (; i < count; ++i) {
    all = all && std::isfinite(values[i]);
    low = std::min(low, values[i]);
    high = std::max(high, values[i]);
  }
  return all;
}

/// How many values differ from `zero`, by less than `limit`.
size_t CountSmall(const float* HWY_RESTRICT values, size_t count, float zero, float limit) {
  const D d;
  const size_t lanes = hn::Lanes(d);
  const auto origin = hn::Set(d, zero), most = hn::Set(d, limit);
  size_t small = 0, i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto v = hn::Abs(hn::Sub(hn::LoadU(d, values + i), origin));
    small += hn::CountTrue(d, hn::And(hn::Gt(v, hn::Zero(d)), hn::Lt(v, most)));
  }
  for (; i < count; ++i) {
    const float v = std::abs(values[i] - zero);
    small += v > 0 && v < limit;
  }
  return small;
}

/// numbers[i] = root of (values[i] - base) / range, times `most`; with the sign of the value where `signs`.
void StoreRoots(const float* HWY_RESTRICT values, size_t count, float base, float range, float most, bool signs,
                uint16_t* HWY_RESTRICT numbers) {
  const D d;
  const hn::RebindToSigned<D> di;
  const auto low = hn::Set(d, base), over = hn::Set(d, range), top = hn::Set(d, most), half = hn::Set(d, 0.5f);
  each_vector(count, [&](size_t i, size_t n) {
    HWY_ALIGN float in[16] = {};
    HWY_ALIGN int32_t out[16] = {};
    std::memcpy(in, values + i, n * sizeof(float));
    const auto v = hn::Load(d, in);
    const auto share = signs ? hn::Div(hn::Abs(v), over) : hn::Div(hn::Sub(v, low), over);
    const auto root = hn::ConvertTo(di, hn::Add(hn::Mul(hn::Sqrt(hn::Max(share, hn::Zero(d))), top), half));
    const auto sign = hn::And(hn::BroadcastSignBit(hn::BitCast(di, v)), hn::Set(di, signs ? 0x8000 : 0));
    hn::Store(hn::Or(root, sign), di, out);
    for (size_t k = 0; k < n; ++k) numbers[i + k] = static_cast<uint16_t>(out[k]);
  });
}

/// The values again.
void ReadRoots(const uint16_t* HWY_RESTRICT numbers, size_t count, float base, float range, float most, bool signs,
               float* HWY_RESTRICT values) {
  const D d;
  const hn::RebindToSigned<D> di;
  const hn::Rebind<uint16_t, D> du16;
  const auto low = hn::Set(d, base), over = hn::Set(d, range), inverse = hn::Set(d, 1 / most);
  const auto magnitude = hn::Set(di, signs ? 0x7fff : 0xffff);
  each_vector(count, [&](size_t i, size_t n) {
    // Numbers of a row end in room for a vector.
    const auto bits = hn::PromoteTo(di, hn::LoadU(du16, numbers + i));
    const auto root = hn::Mul(hn::ConvertTo(d, hn::And(bits, magnitude)), inverse);
    const auto part = hn::Mul(hn::Mul(root, root), over);
    const auto sign = hn::BitCast(d, hn::ShiftLeft<16>(hn::AndNot(magnitude, bits)));
    const auto value = signs ? hn::Or(part, sign) : hn::Add(low, part);
    if (n == hn::Lanes(d)) return hn::StoreU(value, d, values + i);
    HWY_ALIGN float out[16] = {};
    hn::Store(value, d, out);
    std::memcpy(values + i, out, n * sizeof(float));
  });
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(FindExtent);
HWY_EXPORT(CountSmall);
HWY_EXPORT(StoreRoots);
HWY_EXPORT(ReadRoots);

namespace {

constexpr float kMostRoot = 65535, kMostSignedRoot = 32767;
constexpr float kFaint = 2e-4f;  // of a run's range: below, roots are off by more than 0.1 %
constexpr size_t kRoom = 16;     // numbers behind those of a row

}  // namespace

StoredPlane::Row StoredPlane::stored(const float* in, int width) {
  Row row;
  for (int x0 = 0; x0 < width; x0 += kRun) {
    const auto count = static_cast<size_t>(std::min(kRun, width - x0));
    const float* const v = in + x0;
    const size_t first = row.numbers.size();
    float low, high;
    const bool finite = HWY_DYNAMIC_DISPATCH(FindExtent)(v, count, low, high), signs = low < 0;
    const float zero = signs ? 0 : low, most = signs ? std::max(high, -low) : high - low;
    Run run{low, most, static_cast<uint32_t>(first), Code::kConstant};
    if (!finite || !std::isfinite(most) ||
        HWY_DYNAMIC_DISPATCH(CountSmall)(v, count, zero, kFaint * most) > count / 2) {
      run.code = Code::kWhole;
      row.numbers.resize(first + 2 * count);
      std::memcpy(row.numbers.data() + first, v, count * sizeof(float));
    } else if (high > low) {
      run.code = signs ? Code::kSignedRoots : Code::kRoots;
      row.numbers.resize(first + count);
      HWY_DYNAMIC_DISPATCH(StoreRoots)
      (v, count, low, most, signs ? kMostSignedRoot : kMostRoot, signs, row.numbers.data() + first);
    }
    row.runs.push_back(run);
  }
  if (std::all_of(row.runs.begin(), row.runs.end(),
                  [&](const Run& run) { return run.code == Code::kConstant && run.base == row.runs[0].base; })) {
    row.runs.resize(1);
  } else {
    row.numbers.resize(row.numbers.size() + kRoom);
  }
  row.runs.shrink_to_fit();
  row.numbers.shrink_to_fit();
  return row;
}

void StoredPlane::set_rows(int y0, const Plane& rows, const Task& task) {
  parallel_for(rows.height(), quiet(task),
               [&](int y) { (*rows_)[static_cast<size_t>(y0 + y)] = stored(rows.row(y), width_); });
}

StoredPlane StoredPlane::view(int x0, int y0, int width, int height) const {
  StoredPlane part;
  part.rows_ = rows_;
  part.corner_ = corner_ + ivec2(x0, y0);
  part.width_ = width;
  part.height_ = height;
  return part;
}

void StoredPlane::read(int y, int from, int to, float* out) const {
  const Row& row = (*rows_)[static_cast<size_t>(corner_.y + y)];
  const int begin = corner_.x + from, end = corner_.x + to;
  if (row.runs.size() == 1 && row.runs[0].code == Code::kConstant) {
    std::fill_n(out, to - from, row.runs[0].base);
    return;
  }
  for (int x = begin; x < end;) {
    const int in_run = x % kRun, next = std::min(end, x - in_run + kRun);
    const auto count = static_cast<size_t>(next - x), at = static_cast<size_t>(in_run);
    const Run& run = row.runs[static_cast<size_t>(x / kRun)];
    const uint16_t* const numbers = row.numbers.data() + run.first;
    const bool signs = run.code == Code::kSignedRoots;
    if (run.code == Code::kConstant)
      std::fill_n(out, count, run.base);
    else if (run.code == Code::kWhole)
      std::memcpy(out, numbers + 2 * at, count * sizeof(float));
    else
      HWY_DYNAMIC_DISPATCH(ReadRoots)
    (numbers + at, count, run.base, run.range, signs ? kMostSignedRoot : kMostRoot, signs, out);
    out += count;
    x = next;
  }
}

void StoredPlane::read(Plane& out, const Task& task) const {
  if (out.width() != width_ || out.height() != height_) out = Plane::unset(width_, height_);
  parallel_for(height_, quiet(task), [&](int y) { read(y, 0, width_, out.row(y)); });
}

size_t StoredPlane::bytes() const {
  size_t sum = 0;
  if (rows_)
    for (const Row& row : *rows_) sum += sizeof(Row) + row.runs.size() * sizeof(Run) + row.numbers.size() * 2;
  return sum;
}

}  // namespace brume
#endif
