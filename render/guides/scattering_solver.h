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

/// The first two moments over directions of a field, at every node.
template <class Kind>
struct Moments : std::array<NodeValues, 4> {
  Moments() = default;
  /// The memory of another kind's, for what is computed in its place.
  template <class Other>
  static Moments in_place_of(Moments<Other>&& other) {
    Moments moments;
    static_cast<std::array<NodeValues, 4>&>(moments) = std::move(other);
    return moments;
  }
};
/// Incident radiance: its mean, and its mean flux along x, y and z.
using Radiance = Moments<struct RadianceKind>;
/// Scattered radiance, the source function: towards d it is [0] + d . ([1], [2], [3]).
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
/// left varies linearly with the cosine. Light that leaves the media by more than a few nodes does not come back.
/// Sources: Joseph, Wiscombe, Weinman 1976, The delta-Eddington approximation; Kunasz, Auer 1988 for the sweeps.
class ScatteringSolver {
 public:
  ScatteringSolver(const Lattice& lattice, const GuideMedia& media, GuideColour colour, const Task& task);
  /// The same media on a lattice of twice the spacing.
  ScatteringSolver(const Lattice& lattice, const ScatteringSolver& fine, const Task& task);

  /// Directions of travel, evenly spread.
  static const std::vector<dvec3>& directions();
  const Lattice& lattice() const { return lattice_; }
  /// Per spacing.
  const NodeValues& extinction() const { return extinction_; }
  /// The same without the forward peak.
  const NodeValues& scaled_extinction() const { return scaled_; }
  /// What the forward peak leaves of the extinction, averaged over the media.
  double mean_scale() const { return mean_scale_; }

  /// Whether a node or one of its 26 neighbours has any extinction.
  std::vector<uint8_t> near_media() const;

  /// Zeros. Fields are stored only at nodes within two cells of a medium, and are 0 elsewhere.
  template <class Light>
  Light nothing() const {
    Light none;
    for (NodeValues& values : none) values = NodeValues(lattice_.size());
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
  /// Streams scattered radiance to the next node, attenuating it along each direction.
  Radiance transport(Source scattered);
  Radiance transport(const Emission& emission);
  /// What `fine`, whose lattice has half the spacing, sends out at this lattice's nodes.
  Emission emission_from(const ScatteringSolver& fine, const Source& scattered) const;

  template <class Light>
  void add(const Light& from, Light& to) const {
    each_row([&](size_t begin, size_t end) {
      for (size_t a = 0; a < 4; ++a)
        for (size_t i = begin; i < end; ++i) to[a][i] += from[a][i];
    });
  }
  /// Of the mean radiance, over the nodes with extinction in them.
  double total(const Source& light) const;
  /// Of two fields, over the same nodes.
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
    /// A point of the media, which forward peaks are a part of. @param g  mean cosine
    void add(double sigma_t, double point_albedo, double g) {
      extinction += sigma_t;
      scattered += sigma_t * point_albedo;
      linear += sigma_t * point_albedo * g;
    }
    void add(const NodeMedia& other) {
      extinction += other.extinction;
      scaled += other.scaled;
      scattered += other.scattered;
      linear += other.linear;
    }
  };
  ScatteringSolver(const Lattice& lattice, const Task& task);
  /// @param sample  called as sample(x, y, row) to set the nodes of a row that are not its border
  template <class Sample>
  void fill(const Sample& sample);
  template <class Value>
  double sum_over_media(const Value& value) const;
  void find_rows();
  void to_y_major(const NodeValues& z_major, NodeValues& y_major, bool everywhere) const;
  /// Directions with the same largest component and its sign: they are swept together.
  struct Bundle {
    bool y_major = false;
    std::vector<size_t> directions;
    std::array<NodeValues, 4> light;  ///< sums over the directions, in the bundle's own order of nodes
  };
  /// One thread adds the second bundle along an axis to the sums of the first: half the memory, and the same bits.
  bool shares_sums(size_t bundle) const { return task_.threads == 1 && bundle % 2 == 1; }
  /// Calls visit(bundle, sums, whether it adds to them), on the task's threads.
  template <class Visit>
  void each_bundle(const Visit& visit) {
    const auto one = [&](int i) {
      const auto k = static_cast<size_t>(i);
      std::array<NodeValues, 4>& sums = bundles_[shares_sums(k) ? k - 1 : k].light;
      visit(bundles_[k], std::array{sums[0].data(), sums[1].data(), sums[2].data(), sums[3].data()}, shares_sums(k));
    };
    const auto count = static_cast<int>(bundles_.size());
    if (task_.threads != 1) return parallel_for(count, task_, one);
    for (int i = 0; i < count; ++i) one(i);
    task_.check();
  }
  std::vector<SweepBeam> beams(const Bundle& bundle) const;
  /// Its domain, with results kept near the media.
  SweepDomain near(const Bundle& bundle) const;
  void sweep_sources(const Emission& source, size_t count);
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
  // Nodes with z fastest, and with y fastest and z slowest: a sweep never goes along contiguous rows.
  SweepDomain z_major_, y_major_;
  std::vector<SweepRow> rows_, y_major_rows_;                             // the nodes near the media
  NodeValues extinction_, scaled_, y_major_extinction_, y_major_scaled_;  // per spacing; without the forward peak
  NodeValues albedo_, linear_;  // of what is left of scattering, and three times its mean cosine
  Emission source_, y_major_source_;
  std::array<Bundle, 6> bundles_;  // towards -x, x, -y, y, -z, z
  double mean_scale_ = 1;
};

}  // namespace brume
