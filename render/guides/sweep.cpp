#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/guides/sweep.cpp"
#include "render/guides/sweep.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, Lattice::kVector>;
using V = hn::Vec<D>;

HWY_INLINE V set(float x) {
  return hn::Set(D(), x);
}

/// Four neighbours in the plane that the light comes from, by their distance from the node in floats, and their
/// weights.
struct Upwind {
  std::ptrdiff_t offset[4];
  V weight[4];
  HWY_INLINE V operator()(const float* node) const {
    const D d;
    V sum = hn::Mul(weight[0], hn::LoadU(d, node + offset[0]));
    for (int i = 1; i < 4; ++i) sum = hn::Add(sum, hn::Mul(weight[i], hn::LoadU(d, node + offset[i])));
    return sum;
  }
};

void SweepLattice(const SweepDomain& domain, const float* extinction, const SweepSource& source,
                  const std::array<double, 3>& direction, float incoming, float* radiance) {
  const D d;
  const auto lanes = static_cast<int>(hn::Lanes(d));
  const size_t along = std::abs(direction[0]) >= std::abs(direction[1]) ? 0 : 1, across = 1 - along;
  const std::ptrdiff_t stride[2] = {static_cast<std::ptrdiff_t>(domain.n[1]) * domain.row, domain.row};
  const int sign = direction[along] > 0 ? 1 : -1;

  // Where the ray through a node comes from, in nodes of the previous plane: a corner of a square, and how far from it.
  const double forward = std::abs(direction[along]);
  const auto split = [&](double component) {
    const double shift = -component / forward, whole = std::clamp(std::floor(shift), -1.0, 0.0);
    return std::pair(static_cast<std::ptrdiff_t>(whole), static_cast<float>(shift - whole));
  };
  const auto [corner_across, fa] = split(direction[across]);
  const auto [corner_row, fr] = split(direction[2]);
  const V weight[4] = {set((1 - fa) * (1 - fr)), set((1 - fa) * fr), set(fa * (1 - fr)), set(fa * fr)};
  // @param back  from a node to the one straight before it   @param next  from there to its neighbour across
  const auto upwind = [&](std::ptrdiff_t back, std::ptrdiff_t next) {
    const std::ptrdiff_t first = back + corner_across * next + corner_row;
    return Upwind{{first, first + 1, first + next, first + next + 1}, {weight[0], weight[1], weight[2], weight[3]}};
  };
  const Upwind from_lattice = upwind(-sign * stride[along], stride[across]);
  const auto length = set(static_cast<float>(
      std::sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]) / forward));

  const int planes = domain.n[along], rows = domain.n[across], last = domain.n[2] - 1;
  const size_t plane = static_cast<size_t>(rows) * domain.row + 2 * Lattice::kVector;
  std::vector<float> sources(2 * plane + 2 * Lattice::kVector, 0.0f);
  float *gained = sources.data() + Lattice::kVector, *gained_before = gained + plane;
  const V half = set(0.5f), one = set(1.0f);

  const auto part_of = [&](int p, int r) {
    if (!domain.rows) return SweepRow{0, domain.row};
    return domain
        .rows[along == 0 ? static_cast<size_t>(p) * domain.n[1] + r : static_cast<size_t>(r) * domain.n[1] + p];
  };
  const int begin = sign > 0 ? 1 : planes - 2, end = sign > 0 ? planes - 1 : 0;
  for (int p = begin; p != end; p += sign) {
    const auto row_at = [&](int r) { return p * stride[along] + r * stride[across]; };
    if (source.count > 0) {
      std::swap(gained, gained_before);
      for (int r = 0; r < rows; ++r) {
        const SweepRow part = part_of(p, r);
        float* const to = gained + static_cast<std::ptrdiff_t>(r) * domain.row;
        std::fill(to, to + part.begin, 0.0f);
        std::fill(to + std::max(part.begin, part.end), to + domain.row, 0.0f);
        for (int z = part.begin; z < part.end; z += lanes) {
          const std::ptrdiff_t at = row_at(r) + z;
          V sum = hn::Mul(set(source.factor[0]), hn::LoadU(d, source.values[0] + at));
          for (size_t i = 1; i < source.count; ++i)
            sum = hn::Add(sum, hn::Mul(set(source.factor[i]), hn::LoadU(d, source.values[i] + at)));
          hn::StoreU(hn::Max(sum, hn::Zero(d)), d, to + z);
        }
      }
    }
    // The sources of the plane before lie in the other buffer.
    const Upwind from_sources = upwind(gained_before - gained, domain.row);
    for (int r = 1; r < rows - 1; ++r) {
      const std::ptrdiff_t row = row_at(r);
      const SweepRow part = part_of(p, r);
      if (part.begin >= part.end) continue;
      for (int z = part.begin; z < part.end; z += lanes) {
        const std::ptrdiff_t at = row + z;
        const V tau =
            hn::Mul(hn::Mul(half, length), hn::Add(from_lattice(extinction + at), hn::LoadU(d, extinction + at)));
        // exp(-tau) = 1 / (1 + tau m), by the exponential's series; (1 - exp(-tau)) / tau is m / (1 + tau m).
        V m = hn::Add(set(1.0f / 6), hn::Mul(tau, set(1.0f / 24)));
        m = hn::Add(half, hn::Mul(tau, m));
        m = hn::Add(one, hn::Mul(tau, m));
        const V transmitted = hn::Div(one, hn::Add(one, hn::Mul(tau, m)));
        V light = hn::Mul(from_lattice(radiance + at), transmitted);
        if (source.count > 0) {
          const float* const node = gained + static_cast<std::ptrdiff_t>(r) * domain.row + z;
          const V mean = hn::Mul(half, hn::Add(from_sources(node), hn::LoadU(d, node)));
          light = hn::Add(light, hn::Mul(hn::Mul(length, mean), hn::Mul(m, transmitted)));
        }
        hn::StoreU(light, d, radiance + at);
      }
      radiance[row] = incoming;
      std::fill(radiance + row + last, radiance + row + domain.row, incoming);
    }
  }
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(SweepLattice);

void sweep(const SweepDomain& domain, const float* extinction, const SweepSource& source,
           const std::array<double, 3>& direction, float incoming, float* radiance) {
  HWY_DYNAMIC_DISPATCH(SweepLattice)(domain, extinction, source, direction, incoming, radiance);
}

}  // namespace brume
#endif
