#include "filters/regression/stored_pair.h"

#include <algorithm>
#include <bit>

namespace brume {
namespace {

constexpr uint32_t kSign = 0x8000, kMagnitude = 0x7fff, kDropped = 13, kLeastExponent = 31, kLargestExponent = 253;
constexpr int kTop = 30;  // the stored exponent of a run's largest value; one above is left for what rounds up

/// What is taken off a float's bits, as stored: the exponent, 23 bits up there, of the stored exponent 0.
int32_t base_of(uint8_t largest) {
  return (static_cast<int32_t>(largest) - kTop) << (23 - kDropped);
}

}  // namespace

StoredPlane::StoredPlane(const Plane& plane, const Task& task) : width_(plane.width()), height_(plane.height()) {
  values_.resize(static_cast<size_t>(width_) * static_cast<size_t>(height_));
  exponents_.resize(runs() * static_cast<size_t>(height_));
  for_each_row(height_, quiet(task), [&](int y) { store_row(y, plane.row(y)); });
}

void StoredPlane::store_row(int y, const float* in) {
  uint16_t* const to = values_.data() + static_cast<size_t>(y) * static_cast<size_t>(width_);
  uint8_t* const exponents = exponents_.data() + static_cast<size_t>(y) * runs();
  for (int x0 = 0; x0 < width_; x0 += kRun) {
    const int count = std::min(kRun, width_ - x0);
    const float* __restrict from = in + x0;
    uint32_t most = 0;
    for (int i = 0; i < count; ++i) most = std::max(most, std::bit_cast<uint32_t>(from[i]) & 0x7fffffffu);
    const auto largest = static_cast<uint8_t>(std::clamp(most >> 23, kLeastExponent, kLargestExponent));
    exponents[x0 / kRun] = largest;
    const int32_t base = base_of(largest);
    uint16_t* __restrict out = to + x0;
    for (int i = 0; i < count; ++i) {
      const auto bits = std::bit_cast<uint32_t>(from[i]);
      const auto rounded = static_cast<int32_t>(((bits & 0x7fffffffu) + (1u << (kDropped - 1))) >> kDropped) - base;
      const auto magnitude =
          rounded < 1 << (23 - kDropped) ? 0u : static_cast<uint32_t>(std::min<int32_t>(rounded, kMagnitude));
      out[i] = static_cast<uint16_t>(magnitude | (bits >> 16 & kSign));
    }
  }
}

void StoredPlane::read_row(int y, float* out) const {
  const uint16_t* const from = values_.data() + static_cast<size_t>(y) * static_cast<size_t>(width_);
  const uint8_t* const exponents = exponents_.data() + static_cast<size_t>(y) * runs();
  for (int x0 = 0; x0 < width_; x0 += kRun) {
    const int count = std::min(kRun, width_ - x0);
    const int32_t base = base_of(exponents[x0 / kRun]);
    const uint16_t* __restrict in = from + x0;
    float* __restrict to = out + x0;
    for (int i = 0; i < count; ++i) {
      const uint32_t magnitude = in[i] & kMagnitude;
      const auto bits = static_cast<uint32_t>(static_cast<int32_t>(magnitude) + base) << kDropped;
      to[i] = std::bit_cast<float>((magnitude == 0 ? 0u : bits) | (in[i] & kSign) << 16);
    }
  }
}

void StoredPlane::read(Plane& out, const Task& task) const {
  if (out.width() != width_ || out.height() != height_) out = Plane(width_, height_);
  for_each_row(height_, quiet(task), [&](int y) { read_row(y, out.row(y)); });
}

StoredPair::StoredPair(const HalfPair& pair, const Task& task) {
  for (size_t c = 0; c < 3; ++c) {
    a[c] = StoredPlane(pair.a[c], task);
    b[c] = StoredPlane(pair.b[c], task);
  }
}

void StoredPair::read(HalfPair& out, const Task& task) const {
  for (size_t c = 0; c < 3; ++c) {
    a[c].read(out.a[c], task);
    b[c].read(out.b[c], task);
  }
}

HalfPair blend(const std::vector<StoredPair>& candidates, const HalfPair& data, const std::vector<Plane>& maps,
               const Task& task) {
  const size_t n = candidates.size();
  HalfPair out;
  const auto blended = [&](const Plane& last, const auto& stored) {
    const int width = last.width();
    Plane result(width, last.height());
    for_each_row(last.height(), quiet(task), [&](int y) {
      std::vector<float> sum(static_cast<size_t>(width)), total(sum.size()), row(sum.size());
      float* const to = result.row(y);
      for (size_t i = 0; i <= n; ++i) {
        if (i < n) stored(i).read_row(y, row.data());
        const float *const v = i < n ? row.data() : last.row(y), *const m = maps[i].row(y);
        if (i == 0) std::copy_n(v, width, to);
        for (size_t x = 0; x < sum.size(); ++x) {
          sum[x] += m[x] * v[x];
          total[x] += m[x];
        }
      }
      for (size_t x = 0; x < sum.size(); ++x)
        if (total[x] > 0) to[x] = sum[x] / total[x];
    });
    return result;
  };
  for (size_t c = 0; c < 3; ++c) {
    out.a[c] = blended(data.a[c], [&](size_t i) -> const StoredPlane& { return candidates[i].a[c]; });
    out.b[c] = blended(data.b[c], [&](size_t i) -> const StoredPlane& { return candidates[i].b[c]; });
  }
  return out;
}

}  // namespace brume
