#include "render/guides/lattice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/math.h"
#include "base/parallel_for.h"

namespace brume {

Lattice Lattice::over(const dvec3& lo, const dvec3& hi, double spacing, size_t most_nodes) {
  Lattice lattice;
  for (;;) {
    lattice.spacing = spacing;
    // A node beyond the box on each side, so that fields fall to 0 inside, and the border around them.
    lattice.n = ivec3(glm::ceil((hi - lo) / spacing)) + 4;
    lattice.origin = 0.5 * (lo + hi) - 0.5 * spacing * dvec3(lattice.n - 1);
    const double nodes = static_cast<double>(lattice.n.x) * lattice.n.y * lattice.n.z;
    if (nodes <= static_cast<double>(most_nodes)) return lattice;
    spacing *= std::max(1.02, std::cbrt(nodes / static_cast<double>(most_nodes)));
  }
}

namespace {

constexpr double kGrowth = 0.75;  // of a cell's width with its distance from what wants narrow ones
constexpr int kWidest = 256;      // spacings
constexpr double kOff = 0.25;     // of a spacing that no plane lies on the box's sides

/// Planes over a part of an axis from 0 to `length`, with a pair of cells before it and behind it.
/// @param within  the least of what is wanted between two places, in spacings
template <class Within>
std::vector<int> graded_places(double length, const Within& within) {
  std::vector<int> widths;
  int end = 0;
  while (end < length) {
    int width = 1;
    while (width < kWidest && within(end, end + 2 * (width + 1)) >= width + 1) ++width;
    widths.push_back(width);
    end += 2 * width;
  }
  widths.insert(widths.begin(), widths.front());
  widths.push_back(widths.back());
  std::vector<int> places{0};
  for (const int width : widths)
    for (int cell = 0; cell < 2; ++cell) places.push_back(places.back() + width);
  return places;
}

}  // namespace

LatticePlanes::LatticePlanes(std::vector<int> places) : place(std::move(places)) {
  for (size_t i = 0; i + 1 < place.size(); ++i)
    for (int at = place[i]; at < place[i + 1]; ++at) {
      per_spacing.push_back(1.0f / static_cast<float>(place[i + 1] - place[i]));
      first.push_back(static_cast<float>(i) - per_spacing.back() * static_cast<float>(place[i]));
    }
}

double LatticePlanes::index(double at) const {
  const auto k = static_cast<size_t>(std::clamp(at, 0.0, static_cast<double>(first.size() - 1)));
  return static_cast<double>(first[k]) + static_cast<double>(per_spacing[k]) * at;
}

std::optional<Lattice> Lattice::graded(const dvec3& lo, const dvec3& hi, std::span<const LatticeRegion> regions,
                                       double spacing, double widest, size_t most_nodes) {
  Lattice lattice;
  constexpr double kStep = 1.04;
  double wider = 1;
  while (wider * spacing <= widest * (1 + 1e-9)) {
    std::array<LatticePlanes, 3> planes;
    lattice.spacing = wider * spacing;
    double nodes = 1;
    for (int a = 0; a < 3; ++a) {
      const auto within = [&](double from, double to) {
        double least = kWidest;
        for (const LatticeRegion& r : regions) {
          const double first = kOff + (r.lo[a] - lo[a]) / lattice.spacing;
          const double last = kOff + (r.hi[a] - lo[a]) / lattice.spacing;
          least = std::min(least, r.spacing[a] / spacing + kGrowth * std::max({0.0, first - to, from - last}));
        }
        return least;
      };
      planes[static_cast<size_t>(a)] = LatticePlanes(graded_places(kOff + (hi[a] - lo[a]) / lattice.spacing, within));
      const std::vector<int>& places = planes[static_cast<size_t>(a)].place;
      lattice.n[a] = static_cast<int>(places.size());
      lattice.origin[a] = lo[a] - lattice.spacing * (places[2] + kOff);
      nodes *= lattice.n[a];
    }
    if (nodes > static_cast<double>(most_nodes)) {
      // At least as much wider as would do if all cells grew with the spacing.
      const double needed = std::log(nodes / static_cast<double>(most_nodes)) / 3;
      for (double step = 0; step == 0 || step + 1 <= needed / std::log(kStep); ++step) wider *= kStep;
      continue;
    }
    lattice.planes = std::make_shared<const std::array<LatticePlanes, 3>>(std::move(planes));
    if (std::any_of(regions.begin(), regions.end(),
                    [](const LatticeRegion& r) { return r.spacing != dvec3(r.spacing.x); }))
      lattice.flat = lattice.last_place() / dvec3(lattice.n - 1);
    return lattice;
  }
  return {};
}

Lattice Lattice::every_second() const {
  Lattice lattice = *this;
  std::array<LatticePlanes, 3> coarse;
  for (size_t a = 0; a < 3; ++a) {
    std::vector<int> places;
    for (size_t i = 0; i < (*planes)[a].place.size(); i += 2) places.push_back((*planes)[a].place[i] / 2);
    lattice.n[static_cast<int>(a)] = static_cast<int>(places.size());
    coarse[a] = LatticePlanes(std::move(places));
  }
  lattice.spacing = 2 * spacing;
  lattice.planes = std::make_shared<const std::array<LatticePlanes, 3>>(std::move(coarse));
  return lattice;
}

dvec2 Lattice::halves(int axis, int i) const {
  if (!planes) return dvec2(0.5);
  const int before = std::max(i - 1, 0), behind = std::min(i + 1, n[axis] - 1);
  return 0.5 * dvec2(place(axis, i) - place(axis, before), place(axis, behind) - place(axis, i));
}

dvec3 Lattice::cell(int x, int y, int z) const {
  const dvec2 along_x = halves(0, x), along_y = halves(1, y), along_z = halves(2, z);
  return {along_x.x + along_x.y, along_y.x + along_y.y, along_z.x + along_z.y};
}

double Lattice::reach(int x, int y, int z) const {
  const auto farther = [&](int axis, int i) {
    const dvec2 half = halves(axis, i);
    return 2 * std::max(half.x, half.y);
  };
  return spacing * glm::length(dvec3(farther(0, x), farther(1, y), farther(2, z)));
}

dvec3 Lattice::to_nodes(const dvec3& spacings) const {
  if (!planes) return spacings;
  return {(*planes)[0].index(spacings.x), (*planes)[1].index(spacings.y), (*planes)[2].index(spacings.z)};
}

NodeWeights::NodeWeights(const Lattice& lattice, const dvec3& world) {
  const dvec3 p = glm::clamp(lattice.to_lattice(world), dvec3(0), dvec3(lattice.n - 1));
  const ivec3 i = glm::min(ivec3(p), lattice.n - 2);
  const vec3 f(p - dvec3(i)), e = 1.0f - f;
  const size_t y = static_cast<size_t>(lattice.row()), x = y * static_cast<size_t>(lattice.n.y);
  const size_t first = lattice.index(i.x, i.y, i.z);
  node_ = {first, first + 1, first + y, first + y + 1, first + x, first + x + 1, first + x + y, first + x + y + 1};
  weight_ = {e.x * e.y * e.z, e.x * e.y * f.z, e.x * f.y * e.z, e.x * f.y * f.z,
             f.x * e.y * e.z, f.x * e.y * f.z, f.x * f.y * e.z, f.x * f.y * f.z};
}

float interpolated(const Lattice& lattice, const NodeValues& values, const dvec3& world) {
  return NodeWeights(lattice, world)(values);
}

namespace {

/// Along one axis: weights of three nodes of the fine lattice for each node of the coarse one.
class Taps {
 public:
  Taps(const Lattice& fine, const Lattice& coarse, int axis) : count_(fine.n[axis]) {
    weights_.resize(static_cast<size_t>(coarse.n[axis]));
    if (fine.planes) {
      begin_ = -1;
      for (int i = 0; i < coarse.n[axis]; ++i) {
        const dvec2 halves = fine.halves(axis, 2 * i);
        const auto before = static_cast<float>(halves.x / (halves.x + halves.y));
        weights_[static_cast<size_t>(i)] = {0.5f * before, 0.5f, 0.5f * (1 - before)};
      }
      return;
    }
    const double first = (coarse.origin[axis] - fine.origin[axis]) / fine.spacing - 0.5;
    begin_ = static_cast<int>(std::floor(first));
    const auto f = static_cast<float>(first - begin_);
    std::fill(weights_.begin(), weights_.end(), std::array{0.5f * (1 - f), 0.5f, 0.5f * f});
  }
  int node(int i, int tap) const { return std::clamp(2 * i + begin_ + tap, 0, count_ - 1); }
  const std::array<float, 3>& weights(int i) const { return weights_[static_cast<size_t>(i)]; }

 private:
  int begin_ = 0, count_;
  std::vector<std::array<float, 3>> weights_;
};

}  // namespace

NodeValues coarsened(const Lattice& fine, const NodeValues& values, const Lattice& coarse, const Task& task) {
  NodeValues result(coarse.size());
  const std::array taps = {Taps(fine, coarse, 0), Taps(fine, coarse, 1), Taps(fine, coarse, 2)};
  parallel_for(coarse.n.x, task, [&](int x) {
    // Across x, then across y, then along z.
    const size_t plane = static_cast<size_t>(fine.n.y) * fine.row(), row = static_cast<size_t>(fine.row());
    std::vector<float> across_x(plane), across_y(row);
    const auto mean = [](const std::array<float, 3>& weight, const float* a, const float* b, const float* c,
                         size_t count, float* to) {
      for (size_t i = 0; i < count; ++i) to[i] = weight[0] * a[i] + weight[1] * b[i] + weight[2] * c[i];
    };
    const auto at_x = [&](int tap) { return values.data() + fine.index(taps[0].node(x, tap), 0, 0); };
    mean(taps[0].weights(x), at_x(0), at_x(1), at_x(2), plane, across_x.data());
    for (int y = 0; y < coarse.n.y; ++y) {
      const auto at_y = [&](int tap) { return across_x.data() + taps[1].node(y, tap) * row; };
      mean(taps[1].weights(y), at_y(0), at_y(1), at_y(2), row, across_y.data());
      for (int z = 0; z < coarse.n.z; ++z) {
        float sum = 0;
        for (int tap = 0; tap < 3; ++tap)
          sum += taps[2].weights(z)[static_cast<size_t>(tap)] * across_y[static_cast<size_t>(taps[2].node(z, tap))];
        result[coarse.index(x, y, z)] = sum;
      }
    }
  });
  return result;
}

std::vector<dvec3> spiral_of_directions(int count) {
  std::vector<dvec3> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
    const double turns = 0.5 * (1 + std::sqrt(5.0)) * (i + 0.5);
    const SinCos turn = portable_sincos_2pi(turns - std::floor(turns));
    directions.emplace_back(r * turn.cos, r * turn.sin, z);
  }
  return directions;
}

}  // namespace brume
