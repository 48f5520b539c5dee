#pragma once
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "base/parallel_for.h"
#include "render/guides/guide_media.h"
#include "render/guides/lattice.h"
#include "render/guides/sweep.h"

namespace brume {

/// Factors of light along a unit vector in its moments over directions: its mean, what goes along x, y and z, and the
/// five real spherical harmonics of the second order, of which the sum of products for two vectors is P2 of the cosine
/// between them. Shorter vectors, means of unit ones, have less of them.
inline std::array<float, kMostMoments> moments_of(const dvec3& d) {
  constexpr double kRoot3 = 1.7320508075688772;
  const std::array moments = {1.0,
                              d.x,
                              d.y,
                              d.z,
                              kRoot3 * d.x * d.y,
                              kRoot3 * d.x * d.z,
                              kRoot3 * d.y * d.z,
                              0.5 * kRoot3 * (d.x * d.x - d.y * d.y),
                              d.z * d.z - 0.5 * (d.x * d.x + d.y * d.y)};
  std::array<float, kMostMoments> rounded;
  for (size_t i = 0; i < kMostMoments; ++i) rounded[i] = static_cast<float>(moments[i]);
  return rounded;
}

/// Moments over directions of a field, at every node: the first four, and the rest where they matter.
template <class Kind>
struct Moments : std::array<NodeValues, kMostMoments> {
  Moments() = default;
  size_t known() const { return this->back().empty() ? 4 : kMostMoments; }
  /// Keeps the first four.
  void drop_second() {
    for (size_t a = 4; a < kMostMoments; ++a) (*this)[a] = {};
  }
  /// The memory of another kind's, for what is computed in its place.
  template <class Other>
  static Moments in_place_of(Moments<Other>&& other) {
    Moments moments;
    static_cast<std::array<NodeValues, kMostMoments>&>(moments) = std::move(other);
    return moments;
  }
};
/// Incident radiance: its mean, and its mean flux along x, y and z.
using Radiance = Moments<struct RadianceKind>;
/// Scattered radiance, the source function: towards d it is the sum of [i] moments_of(d)[i].
using Source = Moments<struct SourceKind>;
/// What nodes send out per spacing: extinction times the source function.
using Emission = Moments<struct EmissionKind>;

/// A number in [0, 1] for each node of a lattice and each of the solver's directions of travel, within 4e-5 of its
/// root.
class SkyShares {
 public:
  SkyShares() = default;
  SkyShares(const Lattice& lattice, size_t directions) : directions_(directions), roots_(lattice.size() * directions) {}
  float operator()(size_t node, size_t direction) const {
    const float own = root(node, direction);
    return own * own;
  }
  float root(size_t node, size_t direction) const {
    return static_cast<float>(roots_[node * directions_ + direction]) * (1.0f / kOne);
  }
  void set(size_t node, size_t direction, float share) {
    roots_[node * directions_ + direction] = static_cast<uint16_t>(kOne * std::sqrt(share) + 0.5f);
  }
  bool empty() const { return roots_.empty(); }
  size_t bytes() const { return roots_.size() * sizeof(uint16_t); }

 private:
  static constexpr float kOne = 65535;
  size_t directions_ = 0;
  std::vector<uint16_t, LazyZeros<uint16_t>> roots_;
};

/// Multiple scattering on a lattice, order by order: each is swept from the one before along 24 directions.
///
/// Scattering is taken to the first moment. A forward peak of weight g^2 counts as not scattered at all, and what is
/// left varies linearly with the cosine; where peaks are broad and weigh less (forward_peak.h), it has a second moment,
/// without which a beam would be scattered sideways twice as much: of lights' first scattering, and where broad peaks
/// are left out of lamps' next ones, too. Light that leaves the
/// media by more than a few nodes does not come back. Sources: Joseph, Wiscombe, Weinman 1976, The delta-Eddington
/// approximation; Kunasz, Auer 1988 for the sweeps.
class ScatteringSolver {
 public:
  /// @param leave_out_broad_peak  of the only medium: where its g is below kNarrowPeak all light counts as scattered
  ScatteringSolver(const Lattice& lattice, const GuideMedia& media, GuideColour colour, const Task& task,
                   bool leave_out_broad_peak = false);
  /// The same media on a lattice of twice the spacing.
  ScatteringSolver(const Lattice& lattice, const ScatteringSolver& fine, const Task& task);

  /// Directions of travel, evenly spread.
  static const std::vector<dvec3>& directions();
  const Lattice& lattice() const { return lattice_; }
  /// Whether what is left of scattering has second moments that matter.
  bool second_moments() const { return !quadratic_.empty(); }
  /// Whether light that is scattered nearly straight on counts as not scattered.
  bool has_peak() const { return has_peak_; }
  /// Of radiance along known directions that are to be followed.
  size_t moments() const { return second_moments() ? kMostMoments : 4; }
  /// Per spacing.
  const NodeValues& extinction() const { return extinction_; }
  /// The same without the forward peak.
  const NodeValues& scaled_extinction() const { return scaled_; }
  /// What the forward peak leaves of the extinction, averaged over the media.
  double mean_scale() const { return mean_scale_; }

  /// Whether a node or one of its 26 neighbours has any extinction.
  std::vector<uint8_t> near_media() const;

  /// Zeros. Fields are stored only at nodes within two cells of a medium, and are 0 elsewhere.
  /// @param moments  that are known
  template <class Light>
  Light nothing(size_t moments = 4) const {
    Light none;
    for (size_t a = 0; a < moments; ++a) none[a] = NodeValues(lattice_.size());
    return none;
  }
  /// For each direction of travel, the transmittance from outside to the node.
  /// @param peaks  whether what forward peaks scatter arrives, too
  SkyShares arriving(bool peaks) const;
  /// Moments of radiance that enters from outside, for each direction, the forward peak not counted as scattering.
  Radiance entering(const std::vector<double>& incoming);
  /// Moments of emitted light. @param emission  emission per spacing at the nodes
  Radiance emitted(const NodeValues& emission);

  /// What the media scatter of incident radiance.
  Source scatter(Radiance light) const;
  /// Streams scattered radiance to the next node, attenuating it along each direction: as many moments.
  Radiance transport(Source scattered);
  Radiance transport(const Emission& emission);
  /// Light that arrives at every node from nearly one direction, scattered by the phase function itself and streamed
  /// on in four times as many directions. Called where second_moments().
  Radiance transport_beam(const Radiance& arriving);
  /// What `fine`, whose lattice has half the spacing, sends out at this lattice's nodes.
  Emission emission_from(const ScatteringSolver& fine, const Source& scattered) const;

  /// Gives back the memory that sweeps need; the next one takes it again.
  void release() {
    source_ = y_major_source_ = {};
    for (Bundle& bundle : bundles_) bundle.light = {};
  }

  template <class Light>
  void add(const Light& from, Light& to) const {
    each_row([&](size_t begin, size_t end) {
      for (size_t a = 0; a < std::min(from.known(), to.known()); ++a)
        for (size_t i = begin; i < end; ++i) to[a][i] += from[a][i];
    });
  }
  /// Of the mean radiance, over the cells with extinction in them.
  double total(const Source& light) const;
  /// Of two fields, over the same cells.
  double product(const NodeValues& a, const NodeValues& b) const;

  /// Calls visit(x, y, z, index) for the inner nodes, on the task's threads.
  template <class Visit>
  void each_node(const Visit& visit) const {
    parallel_for(lattice_.n.x - 2, task_, [&](int i) {
      for (int y = 1; y < lattice_.n.y - 1; ++y)
        for (int z = 1; z < lattice_.n.z - 1; ++z) visit(i + 1, y, z, lattice_.index(i + 1, y, z));
    });
  }

 private:
  /// What lies around a node, per spacing.
  struct NodeMedia {
    double extinction = 0, scaled = 0;  ///< scaled: without the forward peak
    double scattered = 0, linear = 0;   ///< scaled, times albedo and three times the mean cosine of what is left
    double quadratic = 0;               ///< scaled, times five times its mean P2
    double cosine = 0;                  ///< scaled, times the mean cosine with the peak
    /// A point of the media, which forward peaks are a part of. @param g  mean cosine
    void add(double sigma_t, double point_albedo, double g) {
      extinction += sigma_t;
      scattered += sigma_t * point_albedo;
      linear += sigma_t * point_albedo * g;
    }
    void add(const NodeMedia& other, double share) {
      extinction += share * other.extinction;
      scaled += share * other.scaled;
      scattered += share * other.scattered;
      linear += share * other.linear;
      quadratic += share * other.quadratic;
      cosine += share * other.cosine;
    }
  };
  ScatteringSolver(const Lattice& lattice, const Task& task);
  /// @param sample  called as sample(x, y, row) to set the nodes of a row that are not its border
  template <class Sample>
  void fill(const Sample& sample);
  /// Means over the cells of a row's nodes. @param spacings  what lies around each spacing of the row
  void gather_cells(std::vector<NodeMedia>& spacings, std::vector<NodeMedia>& row) const;
  /// Of the cell around a node, in cubes of a spacing.
  double volume(int x, int y, int z) const {
    return widths_[0][static_cast<size_t>(x)] * widths_[1][static_cast<size_t>(y)] * widths_[2][static_cast<size_t>(z)];
  }
  template <class Value>
  double sum_over_media(const Value& value) const;
  void find_rows();
  void to_y_major(const NodeValues& z_major, NodeValues& y_major, bool everywhere) const;
  /// Directions with the same largest component and its sign: they are swept together.
  struct Bundle {
    bool y_major = false;
    std::vector<size_t> directions;
    std::array<NodeValues, kMostMoments> light;  ///< sums over the directions, in the bundle's own order of nodes
  };
  /// One thread adds the second bundle along an axis to the sums of the first: half the memory, and the same bits.
  bool shares_sums(size_t bundle) const { return task_.threads == 1 && bundle % 2 == 1; }
  /// Calls visit(bundle, sums, whether it adds to them), on the task's threads.
  template <class Visit>
  void each_bundle(size_t moments, const Visit& visit) {
    const auto one = [&](int i) {
      const auto k = static_cast<size_t>(i);
      std::array<NodeValues, kMostMoments>& light = bundles_[shares_sums(k) ? k - 1 : k].light;
      std::array<float*, kMostMoments> sums{};
      for (size_t a = 0; a < moments; ++a) {
        if (light[a].empty()) light[a] = NodeValues((bundles_[k].y_major ? y_major_ : z_major_).size());
        sums[a] = light[a].data();
      }
      visit(bundles_[k], std::span<float* const>(sums.data(), moments), shares_sums(k));
    };
    const auto count = static_cast<int>(bundles_.size());
    if (task_.threads != 1) return parallel_for(count, task_, one);
    for (int i = 0; i < count; ++i) one(i);
    task_.check();
  }
  /// The bundle that a direction is swept in: its largest component, in widths of a cell, and the sign of that.
  size_t bundle_of(const dvec3& direction) const;
  std::vector<SweepBeam> beams(const Bundle& bundle) const;
  /// Of some directions that are swept together in it.
  std::vector<SweepBeam> beams(const Bundle& bundle, const std::vector<dvec3>& along) const;
  /// Its domain, with results kept near the media.
  SweepDomain near(const Bundle& bundle) const;
  void sweep_sources(const Emission& source, size_t count, size_t moments);
  /// Sums of all bundles, near the media.
  void gather(Radiance& light) const;
  /// @param kShared  shares_sums()
  template <bool kShared>
  void gather_sums(Radiance& light) const;
  /// Calls body(begin, end) for the nodes of each row near the media.
  template <class Body>
  void each_row(const Body& body) const {
    parallel_for(lattice_.n.x, task_, [&](int x) {
      for (int y = 0; y < lattice_.n.y; ++y) {
        const SweepRow& row = rows_[static_cast<size_t>(x) * lattice_.n.y + y];
        const size_t first = lattice_.index(x, y, 0);
        if (row.begin < row.end) body(first + row.begin, first + row.end);
      }
    });
  }

  Lattice lattice_;
  Task task_;
  std::array<std::vector<float>, 3> places_;   // of the planes along each axis, in spacings; of a graded lattice
  std::array<std::vector<double>, 3> widths_;  // of the cells around their nodes
  // Nodes with z fastest, and with y fastest and z slowest: a sweep never goes along contiguous rows.
  SweepDomain z_major_, y_major_;
  std::vector<SweepRow> rows_, y_major_rows_;                             // the nodes near the media
  NodeValues extinction_, scaled_, y_major_extinction_, y_major_scaled_;  // per spacing; without the forward peak
  NodeValues albedo_, linear_;  // of what is left of scattering, and three times its mean cosine
  NodeValues quadratic_;        // five times its mean P2; empty where that does not matter
  NodeValues cosine_;           // the mean cosine of scattering, the peak included; as quadratic_
  Emission source_, y_major_source_;
  std::array<Bundle, 6> bundles_;  // towards -x, x, -y, y, -z, z
  double mean_scale_ = 1;
  bool has_peak_ = true;
};

}  // namespace brume
