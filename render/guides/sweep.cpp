#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/guides/sweep.cpp"
#include "render/guides/sweep.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <tuple>
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

/// Where the ray through a node comes from in the plane before: a corner of a square, and how far from it.
struct Footpoint {
  std::ptrdiff_t corner_across, corner_row;
  float across, row;

  Footpoint(const std::array<double, 3>& direction, size_t axis_across, double forward) {
    const auto split = [&](double component) {
      const double shift = -component / forward, whole = std::clamp(std::floor(shift), -1.0, 0.0);
      return std::pair(static_cast<std::ptrdiff_t>(whole), static_cast<float>(shift - whole));
    };
    std::tie(corner_across, across) = split(direction[axis_across]);
    std::tie(corner_row, row) = split(direction[2]);
  }
  /// @param back  from a node to the one straight before it   @param next  from there to its neighbour across
  Upwind upwind(std::ptrdiff_t back, std::ptrdiff_t next) const {
    const std::ptrdiff_t first = back + corner_across * next + corner_row;
    return {{first, first + 1, first + next, first + next + 1},
            {set((1 - across) * (1 - row)), set((1 - across) * row), set(across * (1 - row)), set(across * row)}};
  }
};

/// A plane of floats with room for vectors before and behind it, and the plane before it.
struct TwoPlanes {
  std::vector<float> memory;
  float *now, *before;
  TwoPlanes(size_t floats, float value) : memory(2 * (floats + 2 * Lattice::kVector), value) {
    now = memory.data() + Lattice::kVector;
    before = now + floats + 2 * Lattice::kVector;
  }
};

void SweepLattice(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
                  const std::array<float*, 4>& moments) {
  const D d;
  const auto lanes = static_cast<int>(hn::Lanes(d));
  const std::array<double, 3>& first = beams[0].direction;
  const size_t along = std::abs(first[0]) >= std::abs(first[1]) ? 0 : 1, across = 1 - along;
  const std::ptrdiff_t stride[2] = {static_cast<std::ptrdiff_t>(domain.n[1]) * domain.row, domain.row};
  const int sign = first[along] > 0 ? 1 : -1;
  const int planes = domain.n[along], rows = domain.n[across];
  const size_t plane = static_cast<size_t>(rows) * domain.row;

  struct Beam {
    Footpoint foot;
    float length;  // of its way between two planes
    TwoPlanes light, gained;
    Beam(const SweepBeam& b, size_t axis_along, size_t plane_size)
        : foot(b.direction, 1 - axis_along, std::abs(b.direction[axis_along])),
          length(static_cast<float>(1 / std::abs(b.direction[axis_along]))),
          light(plane_size, b.incoming),
          gained(plane_size, 0.0f) {}
  };
  std::vector<Beam> state;
  state.reserve(beams.size());
  for (const SweepBeam& b : beams) state.emplace_back(b, along, plane);
  std::vector<float> sums(4 * static_cast<size_t>(domain.row));  // of a row's moments
  // What lies behind the first plane: the border, which has no extinction, with room before its first node.
  const std::vector<float> border(plane + 2 * Lattice::kVector, 0.0f);

  const auto part_of = [&](const SweepRow* of, int p, int r) {
    if (!of) return SweepRow{0, domain.row};
    const SweepRow part =
        of[along == 0 ? static_cast<size_t>(p) * domain.n[1] + r : static_cast<size_t>(r) * domain.n[1] + p];
    return part.begin < part.end ? part : SweepRow{};
  };
  const V half = set(0.5f), one = set(1.0f);
  const int begin = sign > 0 ? 1 : planes - 2, end = sign > 0 ? planes - 1 : 0;
  for (int p = begin; p != end; p += sign) {
    for (Beam& beam : state) {
      std::swap(beam.light.now, beam.light.before);
      std::swap(beam.gained.now, beam.gained.before);
    }
    for (int r = 1; r < rows - 1; ++r) {
      const std::ptrdiff_t row = p * stride[along] + r * stride[across], in_plane = r * stride[1];
      const SweepRow part = part_of(domain.rows, p, r), kept = part_of(domain.kept, p, r);
      std::fill(sums.begin(), sums.end(), 0.0f);
      for (size_t k = 0; k < beams.size(); ++k) {
        const SweepBeam& b = beams[k];
        Beam& beam = state[k];
        const bool at_border = p == begin;
        const Upwind extinction =
            at_border ? beam.foot.upwind(0, domain.row) : beam.foot.upwind(-sign * stride[along], stride[across]);
        const float* const behind = at_border ? border.data() + Lattice::kVector + in_plane : media.extinction + row;
        const Upwind light_before = beam.foot.upwind(beam.light.before - beam.light.now, domain.row);
        const Upwind gained_before = beam.foot.upwind(beam.gained.before - beam.gained.now, domain.row);
        const V length = set(beam.length), half_length = set(0.5f * beam.length);
        float *const light_row = beam.light.now + in_plane, *const gained_row = beam.gained.now + in_plane;
        const auto clear = [&](int from, int to) {
          std::fill(light_row + from, light_row + to, b.incoming);
          std::fill(gained_row + from, gained_row + to, 0.0f);
        };
        clear(0, part.begin);
        clear(part.end, domain.row);
        for (int z = part.begin; z < part.end; z += lanes) {
          const float* const here = media.extinction + row + z;
          const V tau = hn::Mul(half_length, hn::Add(extinction(behind + z), hn::LoadU(d, here)));
          // exp(-tau) = 1 / (1 + tau m), by the exponential's series; (1 - exp(-tau)) / tau is m / (1 + tau m).
          V m = hn::Add(set(1.0f / 6), hn::Mul(tau, set(1.0f / 24)));
          m = hn::Add(half, hn::Mul(tau, m));
          m = hn::Add(one, hn::Mul(tau, m));
          const V transmitted = hn::Div(one, hn::Add(one, hn::Mul(tau, m)));
          V light = hn::Mul(light_before(light_row + z), transmitted);
          if (media.sources > 0) {
            V gain = hn::Mul(set(b.factor[0]), hn::LoadU(d, media.source[0] + row + z));
            for (size_t i = 1; i < media.sources; ++i)
              gain = hn::Add(gain, hn::Mul(set(b.factor[i]), hn::LoadU(d, media.source[i] + row + z)));
            gain = hn::Max(gain, hn::Zero(d));
            hn::StoreU(gain, d, gained_row + z);
            const V mean = hn::Mul(half, hn::Add(gained_before(gained_row + z), gain));
            light = hn::Add(light, hn::Mul(hn::Mul(length, mean), hn::Mul(m, transmitted)));
          }
          hn::StoreU(light, d, light_row + z);
          if (moments[0])
            for (size_t i = 0; i < 4; ++i) {
              float* const sum = sums.data() + i * static_cast<size_t>(domain.row) + z;
              hn::StoreU(hn::Add(hn::LoadU(d, sum), hn::Mul(set(b.factor[i]), light)), d, sum);
            }
        }
        // The border, in whose last vector the row ends.
        light_row[0] = b.incoming;
        std::fill(light_row + domain.n[2] - 1, light_row + domain.row, b.incoming);
        if (b.radiance) std::copy(light_row + kept.begin, light_row + kept.end, b.radiance + row + kept.begin);
      }
      if (moments[0])
        for (size_t i = 0; i < 4; ++i) {
          const float* const sum = sums.data() + i * static_cast<size_t>(domain.row);
          std::copy(sum + kept.begin, sum + kept.end, moments[i] + row + kept.begin);
        }
    }
  }
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(SweepLattice);

void sweep(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
           const std::array<float*, 4>& moments) {
  if (!beams.empty()) HWY_DYNAMIC_DISPATCH(SweepLattice)(domain, media, beams, moments);
}

}  // namespace brume
#endif
