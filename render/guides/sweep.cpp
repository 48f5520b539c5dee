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
};

/// The footpoints of a beam on an even lattice, and values there: between four neighbours in the plane that the light
/// comes from.
class EvenUpwind {
 public:
  EvenUpwind(const SweepDomain&, const std::array<double, 3>& direction, size_t along)
      : foot_(direction, 1 - along, std::abs(direction[along])),
        weight_{(1 - foot_.across) * (1 - foot_.row), (1 - foot_.across) * foot_.row, foot_.across * (1 - foot_.row),
                foot_.across * foot_.row} {}
  /// How far the beam's next plane is, in spacings.
  void enter_plane(float) {}
  /// From a row to that of its footpoints.
  std::ptrdiff_t enter_row(int, std::ptrdiff_t next) { return foot_.corner_across * next + foot_.corner_row; }
  /// @param row  of the footpoints   @param z  of a vector of nodes   @param next  to the neighbour across
  HWY_INLINE V operator()(const float* row, int z, std::ptrdiff_t next) const {
    const D d;
    const float* const first = row + z;
    return weight_[0] * hn::LoadU(d, first) + weight_[1] * hn::LoadU(d, first + 1) +
           weight_[2] * hn::LoadU(d, first + next) + weight_[3] * hn::LoadU(d, first + next + 1);
  }

 private:
  Footpoint foot_;
  float weight_[4];
};

/// The same on a lattice whose planes are not evenly spaced: each node's footpoint lies in a cell of its own.
class GradedUpwind {
 public:
  GradedUpwind(const SweepDomain& domain, const std::array<double, 3>& direction, size_t along)
      : across_(domain.places[1 - along], domain.n[1 - along], domain.n[1 - along],
                direction[1 - along] / std::abs(direction[along])),
        row_(domain.places[2], domain.n[2], domain.row, direction[2] / std::abs(direction[along])),
        whole_(static_cast<size_t>(domain.row / Lattice::kVector)) {}
  void enter_plane(float distance) {
    if (distance == distance_) return;
    distance_ = distance;
    across_.find(distance);
    row_.find(distance);
    for (size_t v = 0; v < whole_.size(); ++v) {
      const int32_t* const cells = row_.cell.data() + v * Lattice::kVector;
      whole_[v] = true;
      for (int k = 1; k < Lattice::kVector; ++k) whole_[v] = whole_[v] && cells[k] == cells[0] + k;
    }
  }
  std::ptrdiff_t enter_row(int r, std::ptrdiff_t next) {
    share_ = across_.share[static_cast<size_t>(r)];
    return (across_.cell[static_cast<size_t>(r)] - r) * next;
  }
  HWY_INLINE V operator()(const float* row, int z, std::ptrdiff_t next) const {
    const D d;
    const hn::RebindToSigned<D> di;
    const int32_t* const cell = row_.cell.data() + z;
    const V share = hn::LoadU(d, row_.share.data() + z);
    V value[4];
    if (whole_[static_cast<size_t>(z / Lattice::kVector)]) {
      const float* const first = row + *cell;
      for (int k = 0; k < 4; ++k) value[k] = hn::LoadU(d, first + (k & 1) + (k & 2 ? next : 0));
    } else {
      const auto cells = hn::LoadU(di, cell);
      for (int k = 0; k < 4; ++k) value[k] = hn::GatherIndex(d, row + (k & 1) + (k & 2 ? next : 0), cells);
    }
    const V here = value[0] + share * (value[1] - value[0]), there = value[2] + share * (value[3] - value[2]);
    return here + share_ * (there - here);
  }

 private:
  /// Of the nodes along an axis: the first node of the cell that its footpoint is in, and how far into it that is.
  struct Cells {
    Cells(const float* axis_places, int nodes, int room, double change)
        : cell(static_cast<size_t>(room)), share(cell.size()), places(axis_places), n(nodes), slope(change) {}
    void find(float distance) {
      int k = 0;
      for (int i = 0; i < n; ++i) {
        const double from = static_cast<double>(places[i]) - slope * static_cast<double>(distance);
        const double place = std::clamp(from, 0.0, static_cast<double>(places[n - 1]));
        while (k + 2 < n && static_cast<double>(places[k + 1]) <= place) ++k;
        cell[static_cast<size_t>(i)] = k;
        share[static_cast<size_t>(i)] = static_cast<float>((place - static_cast<double>(places[k])) /
                                                           static_cast<double>(places[k + 1] - places[k]));
      }
      for (size_t i = static_cast<size_t>(n); i < cell.size(); ++i) cell[i] = cell[i - 1] + 1;
    }
    std::vector<int32_t> cell;
    std::vector<float> share;
    const float* places;
    int n;
    double slope;
  };

  Cells across_, row_;
  std::vector<uint8_t> whole_;  // vectors whose footpoints lie in cells side by side
  float distance_ = 0, share_ = 0;
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
template <class Upwind>
struct Beam {
  Upwind upwind;
  float slant;   // length for a spacing from plane to plane
  float length;  // along the beam from one plane to the next
  TwoPlanes light, gained;
  // In the row that is swept: that of the footpoints, and the row itself.
  const float *extinction_before = nullptr, *light_before = nullptr, *gained_before = nullptr;
  float *light_row = nullptr, *gained_row = nullptr;
  Beam(const SweepDomain& domain, const SweepBeam& b, size_t axis_along, size_t plane_size)
      : upwind(domain, b.direction, axis_along),
        slant(static_cast<float>(1 / std::abs(b.direction[axis_along]))),
        length(slant),
        light(plane_size, b.incoming),
        gained(plane_size, 0.0f) {}
};

/// In place of how many sources there are: each beam has its own.
constexpr size_t kOwnSource = 100;

template <class Upwind>
class Sweep {
 public:
  Sweep(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
        std::span<float* const> moments, bool adds)
      : domain_(domain),
        media_(media),
        beams_(beams),
        moments_(moments),
        adds_(adds),
        along_(std::abs(beams[0].direction[0]) * domain.width[1] >= std::abs(beams[0].direction[1]) * domain.width[0]
                   ? 0
                   : 1),
        sign_(beams[0].direction[along_] > 0 ? 1 : -1) {
    const size_t plane = static_cast<size_t>(domain.n[1 - along_]) * domain.row;
    border_.assign(plane + 2 * Lattice::kVector, 0.0f);
    state_.reserve(beams.size());
    for (const SweepBeam& b : beams) state_.emplace_back(domain, b, along_, plane);
  }

  void run() {
    const int planes = domain_.n[along_], rows = domain_.n[1 - along_];
    const int begin = sign_ > 0 ? 1 : planes - 2, end = sign_ > 0 ? planes - 1 : 0;
    for (int p = begin; p != end; p += sign_) {
      const float* const places = domain_.places[along_];
      const float distance = places ? std::abs(places[p] - places[p - sign_]) : 1;
      for (Beam<Upwind>& beam : state_) {
        std::swap(beam.light.now, beam.light.before);
        std::swap(beam.gained.now, beam.gained.before);
        beam.length = distance * beam.slant;
        beam.upwind.enter_plane(distance);
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

  void sweep_row(int p, int r, bool at_border) {
    const std::ptrdiff_t row = p * stride(along_) + r * stride(1 - along_), in_plane = r * stride(1);
    const SweepRow part = part_of(domain_.rows, p, r), kept = part_of(domain_.kept, p, r);
    const std::ptrdiff_t next = at_border ? domain_.row : stride(1 - along_);
    const float* const behind =
        at_border ? border_.data() + Lattice::kVector + in_plane : media_.extinction + row - sign_ * stride(along_);
    for (size_t k = 0; k < state_.size(); ++k) {
      Beam<Upwind>& beam = state_[k];
      beam.light_row = beam.light.now + in_plane;
      beam.gained_row = beam.gained.now + in_plane;
      const std::ptrdiff_t in_light = beam.upwind.enter_row(r, domain_.row);
      beam.extinction_before = behind + beam.upwind.enter_row(r, next);
      beam.light_before = beam.light.before + in_plane + in_light;
      beam.gained_before = beam.gained.before + in_plane + in_light;
      const auto clear = [&](int from, int to) {
        std::fill(beam.light_row + from, beam.light_row + to, beams_[k].incoming);
        std::fill(beam.gained_row + from, beam.gained_row + to, 0.0f);
      };
      clear(0, part.begin);
      clear(part.end, domain_.row);
    }
    if (moments_.size() == kMostMoments)
      sweep_part<kMostMoments>(row, part, kept, next);
    else
      sweep_part<4>(row, part, kept, next);
    for (size_t k = 0; k < state_.size(); ++k) {
      // The border, in whose last vector the row ends.
      float* const light_row = state_[k].light_row;
      light_row[0] = beams_[k].incoming;
      std::fill(light_row + domain_.n[2] - 1, light_row + domain_.row, beams_[k].incoming);
      if (beams_[k].radiance)
        std::copy(light_row + kept.begin, light_row + kept.end, beams_[k].radiance + row + kept.begin);
    }
  }

  template <size_t kMoments>
  void sweep_part(std::ptrdiff_t row, const SweepRow& part, const SweepRow& kept, std::ptrdiff_t next) {
    if (beams_[0].source)
      sweep_nodes<kOwnSource, kMoments>(row, part, kept, next);
    else if (media_.sources == kMostMoments)
      sweep_nodes<kMostMoments, kMoments>(row, part, kept, next);
    else if (media_.sources == 4)
      sweep_nodes<4, kMoments>(row, part, kept, next);
    else if (media_.sources == 1)
      sweep_nodes<1, kMoments>(row, part, kept, next);
    else
      sweep_nodes<0, kMoments>(row, part, kept, next);
  }

  /// All beams through a vector of nodes after another.
  template <size_t kSources, size_t kMoments>
  void sweep_nodes(std::ptrdiff_t row, const SweepRow& part, const SweepRow& kept, std::ptrdiff_t next) {
    const D d;
    for (int z = part.begin; z < part.end; z += static_cast<int>(hn::Lanes(d))) {
      const V extinction = hn::LoadU(d, media_.extinction + row + z);
      V source[kMostMoments], sum[kMoments];
      for (V& s : sum) s = hn::Zero(d);
      for (size_t i = 0; i < kSources && kSources != kOwnSource; ++i)
        source[i] = hn::LoadU(d, media_.source[i] + row + z);
      for (size_t k = 0; k < state_.size(); ++k) {
        const SweepBeam& b = beams_[k];
        const Beam<Upwind>& beam = state_[k];
        const V tau = 0.5f * beam.length * (beam.upwind(beam.extinction_before, z, next) + extinction);
        // exp(-tau) = 1 / (1 + tau m), by the exponential's series; (1 - exp(-tau)) / tau is m / (1 + tau m).
        const V m = 1.0f + tau * (0.5f + tau * (1.0f / 6 + tau * (1.0f / 24)));
        const V transmitted = 1.0f / (1.0f + tau * m);
        V light = beam.upwind(beam.light_before, z, domain_.row) * transmitted;
        if constexpr (kSources > 0) {
          V gain;
          if constexpr (kSources == kOwnSource) {
            gain = hn::LoadU(d, b.source + row + z);
          } else {
            gain = b.factor[0] * source[0];
            for (size_t i = 1; i < kSources; ++i) gain = gain + b.factor[i] * source[i];
            gain = hn::Max(gain, hn::Zero(d));
          }
          hn::StoreU(gain, d, beam.gained_row + z);
          const V mean = 0.5f * (beam.upwind(beam.gained_before, z, domain_.row) + gain);
          light = light + beam.length * mean * (m * transmitted);
        }
        hn::StoreU(light, d, beam.light_row + z);
        for (size_t i = 0; i < kMoments; ++i) sum[i] = sum[i] + b.factor[i] * light;
      }
      if (!moments_.empty() && z >= kept.begin && z < kept.end)
        for (size_t i = 0; i < kMoments; ++i) {
          float* const to = moments_[i] + row + z;
          hn::StoreU(adds_ ? hn::LoadU(d, to) + sum[i] : sum[i], d, to);
        }
    }
  }

  const SweepDomain& domain_;
  const SweepMedia& media_;
  const std::span<const SweepBeam> beams_;
  const std::span<float* const> moments_;
  const bool adds_;
  const size_t along_;  // the axis that planes follow one another on
  const int sign_;
  std::vector<Beam<Upwind>> state_;
  // What lies behind the first plane: no extinction, with room before its first node.
  std::vector<float> border_;
};

void SweepLattice(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
                  std::span<float* const> moments, bool adds) {
  if (domain.places[0])
    Sweep<GradedUpwind>(domain, media, beams, moments, adds).run();
  else
    Sweep<EvenUpwind>(domain, media, beams, moments, adds).run();
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(SweepLattice);

void sweep(const SweepDomain& domain, const SweepMedia& media, std::span<const SweepBeam> beams,
           std::span<float* const> moments, bool adds) {
  if (!beams.empty()) HWY_DYNAMIC_DISPATCH(SweepLattice)(domain, media, beams, moments, adds);
}

}  // namespace brume
#endif
