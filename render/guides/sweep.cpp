#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/guides/sweep.cpp"
#include "render/guides/sweep.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "base/vec.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/vector_math.h"

/// Four neighbours in the plane that the light comes from, by their distance from the node in floats, and their
/// weights.
struct Upwind {
  std::ptrdiff_t offset[4];
  V weight[4];
  HWY_INLINE V operator()(const float* node) const {
    const D d;
    V sum = weight[0] * hn::LoadU(d, node + offset[0]);
    for (int i = 1; i < 4; ++i) sum = sum + weight[i] * hn::LoadU(d, node + offset[i]);
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

/// A beam on its way, and what it passes from one plane to the next.
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

class Sweep {
 public:
  Sweep(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
        const std::array<float*, 4>& moments)
      : domain_(domain),
        media_(media),
        beams_(beams),
        moments_(moments),
        along_(std::abs(beams[0].direction[0]) >= std::abs(beams[0].direction[1]) ? 0 : 1),
        sign_(beams[0].direction[along_] > 0 ? 1 : -1),
        sums_(4 * static_cast<size_t>(domain.row)) {
    const size_t plane = static_cast<size_t>(domain.n[1 - along_]) * domain.row;
    border_.assign(plane + 2 * Lattice::kVector, 0.0f);
    state_.reserve(beams.size());
    for (const SweepBeam& b : beams) state_.emplace_back(b, along_, plane);
  }

  void run() {
    const int planes = domain_.n[along_], rows = domain_.n[1 - along_];
    const int begin = sign_ > 0 ? 1 : planes - 2, end = sign_ > 0 ? planes - 1 : 0;
    for (int p = begin; p != end; p += sign_) {
      for (Beam& beam : state_) {
        std::swap(beam.light.now, beam.light.before);
        std::swap(beam.gained.now, beam.gained.before);
      }
      for (int r = 1; r < rows - 1; ++r) sweep_row(p, r, p == begin);
    }
  }

 private:
  std::ptrdiff_t stride(size_t axis) const {
    return axis == 0 ? static_cast<std::ptrdiff_t>(domain_.n[1]) * domain_.row : domain_.row;
  }
  SweepRow part_of(const SweepRow* of, int p, int r) const {
    if (!of) return SweepRow{0, domain_.row};
    const SweepRow part =
        of[along_ == 0 ? static_cast<size_t>(p) * domain_.n[1] + r : static_cast<size_t>(r) * domain_.n[1] + p];
    return part.begin < part.end ? part : SweepRow{};
  }
  float* sums(size_t moment) { return sums_.data() + moment * static_cast<size_t>(domain_.row); }

  void sweep_row(int p, int r, bool at_border) {
    const std::ptrdiff_t row = p * stride(along_) + r * stride(1 - along_);
    const SweepRow part = part_of(domain_.rows, p, r), kept = part_of(domain_.kept, p, r);
    std::fill(sums_.begin(), sums_.end(), 0.0f);
    for (size_t k = 0; k < beams_.size(); ++k) sweep_beam(beams_[k], state_[k], row, r, at_border, part, kept);
    if (!moments_[0]) return;
    for (size_t i = 0; i < 4; ++i) std::copy(sums(i) + kept.begin, sums(i) + kept.end, moments_[i] + row + kept.begin);
  }

  void sweep_beam(const SweepBeam& b, Beam& beam, std::ptrdiff_t row, int r, bool at_border, const SweepRow& part,
                  const SweepRow& kept) {
    const D d;
    const std::ptrdiff_t in_plane = r * stride(1);
    const Upwind extinction =
        at_border ? beam.foot.upwind(0, domain_.row) : beam.foot.upwind(-sign_ * stride(along_), stride(1 - along_));
    const float* const behind = at_border ? border_.data() + Lattice::kVector + in_plane : media_.extinction + row;
    const Upwind light_before = beam.foot.upwind(beam.light.before - beam.light.now, domain_.row);
    const Upwind gained_before = beam.foot.upwind(beam.gained.before - beam.gained.now, domain_.row);
    const V length = set(beam.length), half_length = set(0.5f * beam.length);
    float *const light_row = beam.light.now + in_plane, *const gained_row = beam.gained.now + in_plane;
    const auto clear = [&](int from, int to) {
      std::fill(light_row + from, light_row + to, b.incoming);
      std::fill(gained_row + from, gained_row + to, 0.0f);
    };
    clear(0, part.begin);
    clear(part.end, domain_.row);
    for (int z = part.begin; z < part.end; z += static_cast<int>(hn::Lanes(d))) {
      const V tau = half_length * (extinction(behind + z) + hn::LoadU(d, media_.extinction + row + z));
      // exp(-tau) = 1 / (1 + tau m), by the exponential's series; (1 - exp(-tau)) / tau is m / (1 + tau m).
      const V m = 1.0f + tau * (0.5f + tau * (1.0f / 6 + tau * (1.0f / 24)));
      const V transmitted = 1.0f / (1.0f + tau * m);
      V light = light_before(light_row + z) * transmitted;
      if (media_.sources > 0) {
        V gain = b.factor[0] * hn::LoadU(d, media_.source[0] + row + z);
        for (size_t i = 1; i < media_.sources; ++i)
          gain = gain + b.factor[i] * hn::LoadU(d, media_.source[i] + row + z);
        gain = hn::Max(gain, hn::Zero(d));
        hn::StoreU(gain, d, gained_row + z);
        const V mean = 0.5f * (gained_before(gained_row + z) + gain);
        light = light + length * mean * (m * transmitted);
      }
      hn::StoreU(light, d, light_row + z);
      if (moments_[0])
        for (size_t i = 0; i < 4; ++i) hn::StoreU(hn::LoadU(d, sums(i) + z) + b.factor[i] * light, d, sums(i) + z);
    }
    // The border, in whose last vector the row ends.
    light_row[0] = b.incoming;
    std::fill(light_row + domain_.n[2] - 1, light_row + domain_.row, b.incoming);
    if (b.radiance) std::copy(light_row + kept.begin, light_row + kept.end, b.radiance + row + kept.begin);
  }

  const SweepDomain& domain_;
  const SweepMedia& media_;
  const std::span<const SweepBeam> beams_;
  const std::array<float*, 4>& moments_;
  const size_t along_;  // the axis that planes follow one another on
  const int sign_;
  std::vector<Beam> state_;
  std::vector<float> sums_;  // of a row's moments
  // What lies behind the first plane: no extinction, with room before its first node.
  std::vector<float> border_;
};

void SweepLattice(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
                  const std::array<float*, 4>& moments) {
  Sweep(domain, media, beams, moments).run();
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
