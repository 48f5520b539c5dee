#include "render/world/visible_density.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <queue>

#include "base/parallel_for.h"
#include "volume/tracking.h"

namespace brume {
namespace {

constexpr int kMap = 64;                 // columns and rows of rays
constexpr double kLeastOpacity = 0.015;  // of a column that is seen
constexpr double kFaintColumn = 1e-3;    // of the mean column: left out before an extinction is known
constexpr double kSolidColumn = 0.02;    // of the mean column: counts for the typical depth
constexpr double kStrayMass = 0.002;     // of the whole: what separate pieces may hold together and be left out
constexpr double kStrayArea = 0.03;      // of what is seen: the largest such piece
constexpr int kStrayColumns = 2;         // the same, where that is less
constexpr double kStrayRays = 0.02;      // share of the rays whose entry is not believed
constexpr int kMostZooms = 24;
constexpr double kZoomed = 0.6;         // a smaller share of the map is worth a finer one
constexpr double kMostCells = 1 << 24;  // that are looked through
constexpr size_t kFewest = 64;          // voxels of a density that are no damage

/// A rectangle across the view, in world units.
struct Window {
  dvec2 lo{0}, hi{0};
  dvec2 size() const { return hi - lo; }
  dvec2 centre(int x, int y) const { return lo + (dvec2(x, y) + 0.5) / static_cast<double>(kMap) * size(); }
};

/// Right, up, and along the view.
struct ViewAxes {
  dvec3 right, above, view;
  ViewAxes(const dvec3& view_, const dvec3& up) : view(view_) {
    right = glm::cross(view, up);
    right = glm::length(right) > 1e-9 ? glm::normalize(right) : Frame(view).x;
    above = glm::cross(right, view);
  }
  dvec3 of(const dvec3& world) const { return {glm::dot(world, right), glm::dot(world, above), glm::dot(world, view)}; }
  dvec3 world(const dvec3& p) const { return right * p.x + above * p.y + view * p.z; }
};

/// The cells that hold anything; of very many every few along each axis.
template <class Visit>
void each_full_cell(const BrickGrid& grid, const Visit& visit) {
  double all = 0;
  grid.each_distinct_cell([&](const BrickGrid::Cell&, uint64_t count) { all += static_cast<double>(count); });
  int step = 1;
  while (all > kMostCells * std::pow(step, 3)) step *= 2;
  grid.each_cell(
      [&](const ivec3& c) {
        if (const BrickGrid::Cell& cell = grid.cell(c); cell.majorant > 0) visit(c, cell);
      },
      step);
}

/// The value that all but the kFewest largest voxels are below, or in a small grid but a sixteenth of them: a few
/// damaged voxels do not outweigh all others.
float undamaged_maximum(const BrickGrid& grid) {
  std::priority_queue<float, std::vector<float>, std::greater<>> largest;
  size_t positive = 0;
  std::vector<bool> known(grid.brick_count() + 1, false);
  const int size = grid.cell_size(), stored = grid.stored();
  each_full_cell(grid, [&](const ivec3&, const BrickGrid::Cell& cell) {
    if (known[cell.brick] || (largest.size() == kFewest && cell.majorant <= largest.top())) return;
    known[cell.brick] = true;
    const float* const values = grid.brick(cell);
    for (int x = 0; x < size; ++x)
      for (int y = 0; y < size; ++y)
        for (int z = 0; z < size; ++z) {
          const float v = values[(x * stored + y) * stored + z];
          if (!(v > 0)) continue;
          ++positive;
          if (largest.size() == kFewest && v <= largest.top()) continue;
          largest.push(v);
          if (largest.size() > kFewest) largest.pop();
        }
  });
  for (size_t leave = positive / 16 + 1; largest.size() > leave;) largest.pop();
  return largest.empty() ? 0.0f : largest.top();
}

/// Optical depths of columns, and which of them are seen.
struct Map {
  std::array<double, kMap * kMap> depth{};
  std::array<bool, kMap * kMap> seen{};

  /// The mean over what is there: each column counts by its depth.
  double mean() const {
    double sum = 0, squares = 0;
    for (const double d : depth) {
      sum += d;
      squares += d * d;
    }
    return sum > 0 ? squares / sum : 0;
  }
  void see_above(double least) {
    for (size_t i = 0; i < depth.size(); ++i) seen[i] = depth[i] > least;
  }
  void drop_strays();
  /// First and last columns and rows that are seen, exclusive at the end; false where none is.
  bool bounds(ivec2& lo, ivec2& hi) const {
    lo = ivec2(kMap), hi = ivec2(0);
    for (int y = 0; y < kMap; ++y)
      for (int x = 0; x < kMap; ++x)
        if (seen[static_cast<size_t>(y * kMap + x)]) {
          lo = glm::min(lo, ivec2(x, y));
          hi = glm::max(hi, ivec2(x, y) + 1);
        }
    return hi.x > 0;
  }
};

/// Leaves out the smallest separate pieces, as long as they hold next to nothing.
void Map::drop_strays() {
  struct Piece {
    double mass = 0;
    std::vector<size_t> columns;
  };
  std::vector<Piece> pieces;
  std::array<bool, kMap * kMap> met{};
  double whole = 0;
  size_t area = 0;
  for (size_t first = 0; first < seen.size(); ++first) {
    if (!seen[first] || met[first]) continue;
    Piece& piece = pieces.emplace_back();
    piece.columns = {first};
    met[first] = true;
    for (size_t next = 0; next < piece.columns.size(); ++next) {
      const size_t at = piece.columns[next];
      piece.mass += depth[at];
      const int x = static_cast<int>(at) % kMap, y = static_cast<int>(at) / kMap;
      for (int v = std::max(y - 1, 0); v <= std::min(y + 1, kMap - 1); ++v)
        for (int u = std::max(x - 1, 0); u <= std::min(x + 1, kMap - 1); ++u)
          if (const auto i = static_cast<size_t>(v * kMap + u); seen[i] && !met[i]) {
            met[i] = true;
            piece.columns.push_back(i);
          }
    }
    whole += piece.mass;
    area += piece.columns.size();
  }
  std::sort(pieces.begin(), pieces.end(), [](const Piece& a, const Piece& b) { return a.mass < b.mass; });
  const double most = std::max<double>(kStrayColumns, kStrayArea * static_cast<double>(area));
  double dropped = 0;
  for (const Piece& piece : pieces) {
    dropped += piece.mass;
    if (dropped > kStrayMass * whole) return;
    if (static_cast<double>(piece.columns.size()) <= most)
      for (const size_t at : piece.columns) seen[at] = false;
  }
}

class Finder {
 public:
  Finder(const Medium& medium, const dvec3& view, const dvec3& up, double wanted_depth, const Task& task)
      : medium_(medium), axes_(view, up), wanted_(wanted_depth), task_(task) {
    const auto [lo, hi] = medium.support();
    dvec3 first(kUnbounded), last = -first;
    for (int k = 0; k < 8; ++k) {
      const dvec3 corner = axes_.of(medium.to_world({k & 1 ? hi.x : lo.x, k & 2 ? hi.y : lo.y, k & 4 ? hi.z : lo.z}));
      first = glm::min(first, corner);
      last = glm::max(last, corner);
    }
    window_ = {dvec2(first), dvec2(last)};
    near_ = first.z;
    far_ = last.z;
  }

  VisibleDensity find() {
    zoom_by_mass();
    VisibleDensity found;
    for (int zoom = 0; zoom < kMostZooms; ++zoom) {
      trace();
      const double mean = map_.mean();
      if (!(mean > 0)) return {};
      found.typical_depth = typical_depth(kSolidColumn * mean);
      least_ = kLeastOpacity * found.typical_depth / wanted_;
      map_.see_above(least_);
      map_.drop_strays();
      if (!narrow(1)) break;
    }
    found.points = points();
    return found;
  }

 private:
  /// Narrows the window to where the mass of the cells lies, until a column is hardly wider than a cell: rays alone
  /// could miss a small cloud in a large box.
  void zoom_by_mass() {
    const BrickGrid& grid = medium_.bricks();
    const float most = most_ = undamaged_maximum(grid);
    std::vector<float> means(grid.brick_count() + 1, -1.0f);
    const int size = grid.cell_size(), stored = grid.stored();
    const auto mean_of = [&](const BrickGrid::Cell& cell) {
      float& mean = means[cell.brick];
      if (mean >= 0) return mean;
      const float* const values = grid.brick(cell);
      double sum = 0;
      for (int x = 0; x < size; ++x)
        for (int y = 0; y < size; ++y)
          for (int z = 0; z < size; ++z) sum += std::clamp(values[(x * stored + y) * stored + z], 0.0f, most);
      return mean = static_cast<float>(sum / (1.0 * size * size * size));
    };
    double reach = 0;  // of a cell across the view
    const dvec3 corner = axes_.of(medium_.to_world(dvec3(0)));
    for (int k = 0; k < 8; ++k) {
      const dvec3 other = dvec3(k & 1 ? size : 0, k & 2 ? size : 0, k & 4 ? size : 0);
      reach = std::max(reach, glm::length(dvec2(axes_.of(medium_.to_world(other)) - corner)));
    }
    for (int zoom = 0; zoom < kMostZooms; ++zoom) {
      const dvec2 column = window_.size() / static_cast<double>(kMap);
      if (column.x < 2 * reach && column.y < 2 * reach) return;
      map_.depth.fill(0);
      each_full_cell(grid, [&](const ivec3& c, const BrickGrid::Cell& cell) {
        const dvec2 at(axes_.of(medium_.to_world((dvec3(c) + 0.5) * static_cast<double>(size))));
        const ivec2 to(glm::floor((at - window_.lo) / column));
        if (to.x >= 0 && to.y >= 0 && to.x < kMap && to.y < kMap)
          map_.depth[static_cast<size_t>(to.y * kMap + to.x)] += mean_of(cell);
      });
      map_.see_above(kFaintColumn * map_.mean());
      map_.drop_strays();
      if (!narrow(1, reach)) return;
    }
  }

  /// Optical depths of rays through the window at an extinction of 1 per density, damaged voxels taken for others.
  void trace() {
    const dvec2 size = window_.size();
    const double most = most_ * std::min(far_ - near_, 4 * std::max(size.x, size.y));
    parallel_for(kMap, {task_.threads, {}, task_.cancel}, [&](int y) {
      for (int x = 0; x < kMap; ++x)
        map_.depth[static_cast<size_t>(y * kMap + x)] =
            std::min(most, optical_depth(medium_, medium_.to_local(ray(x, y)), far_ - near_));
    });
  }
  Ray ray(int x, int y) const { return {axes_.world(dvec3(window_.centre(x, y), near_)), axes_.view}; }

  double typical_depth(double least) const {
    std::vector<double> all;
    for (const double d : map_.depth)
      if (d > least) all.push_back(d);
    std::sort(all.begin(), all.end());
    return all[all.size() * 3 / 4];
  }

  /// Makes the window what is seen, and `columns` columns and a length around it.
  /// @return false where that is hardly less than it was
  bool narrow(int columns, double around = 0) {
    ivec2 lo, hi;
    if (!map_.bounds(lo, hi)) return false;
    const dvec2 column = window_.size() / static_cast<double>(kMap);
    const Window smaller = {glm::max(window_.lo, window_.lo + dvec2(lo - columns) * column - around),
                            glm::min(window_.hi, window_.lo + dvec2(hi + columns) * column + around)};
    const dvec2 share = smaller.size() / window_.size();
    if (!(share.x < kZoomed || share.y < kZoomed)) return false;
    window_ = smaller;
    return true;
  }

  /// Where the rays that see something enter and leave it, with a column's width around.
  std::vector<dvec3> points() const {
    struct Part {
      dvec2 at;
      double in, out;
    };
    std::vector<Part> parts;
    for (int y = 0; y < kMap; ++y)
      for (int x = 0; x < kMap; ++x) {
        if (!map_.seen[static_cast<size_t>(y * kMap + x)]) continue;
        Part part{window_.centre(x, y), near_, far_};
        clip(medium_.to_local(ray(x, y)), part.in, part.out);
        parts.push_back(part);
      }
    const auto quantile = [&](double Part::*side, double share) {
      std::vector<double> all;
      for (const Part& part : parts) all.push_back(part.*side);
      std::sort(all.begin(), all.end());
      return all[static_cast<size_t>(share * static_cast<double>(all.size() - 1))];
    };
    std::vector<dvec3> points;
    if (parts.empty()) return points;
    const double first = quantile(&Part::in, kStrayRays), last = quantile(&Part::out, 1 - kStrayRays);
    const dvec2 half = 0.5 * window_.size() / static_cast<double>(kMap);
    for (const Part& part : parts)
      for (const double z : {std::max(part.in, first), std::min(part.out, last)})
        for (int k = 0; k < 4; ++k)
          points.push_back(axes_.world(dvec3(part.at + half * dvec2(k & 1 ? 1 : -1, k & 2 ? 1 : -1), z)));
    return points;
  }

  /// @param in,out  along the view: narrowed to where more than a hardly seen part of the ray's depth is reached
  void clip(const Ray& local, double& in, double& out) const {
    std::vector<MajorantWalk::Segment> segments;
    MajorantWalk walk(medium_.bricks(), local, 0, far_ - near_);
    for (MajorantWalk::Segment segment; walk.next(segment);) segments.push_back(segment);
    in = near_ + reached(local, segments, /*forwards=*/true, in - near_);
    std::reverse(segments.begin(), segments.end());
    out = near_ + reached(local, segments, /*forwards=*/false, out - near_);
  }
  /// Where a ray has met half of what is seen at least, voxel by voxel from one of its ends.
  double reached(const Ray& local, const std::vector<MajorantWalk::Segment>& segments, bool forwards,
                 double otherwise) const {
    double depth = 0;
    for (const MajorantWalk::Segment& segment : segments) {
      const double length = segment.t1 - segment.t0;
      if (depth + segment.majorant * length <= 0.5 * least_) {
        depth += segment.majorant * length;
        continue;
      }
      const int steps = static_cast<int>(std::ceil(length / medium_.voxel_size()));
      const double step = length / steps;
      for (int i = 0; i < steps; ++i) {
        const double t = forwards ? segment.t0 + (i + 0.5) * step : segment.t1 - (i + 0.5) * step;
        depth += step * medium_.density(segment, local.at(t));
        if (depth > 0.5 * least_) return forwards ? t - 0.5 * step : t + 0.5 * step;
      }
    }
    return otherwise;
  }

  const Medium& medium_;
  const ViewAxes axes_;
  const double wanted_;
  const Task& task_;
  Window window_;
  double near_ = 0, far_ = 0;  // of the support, along the view
  double least_ = 0;           // a column of less optical depth counts as not seen
  float most_ = 0;             // greater densities are taken for damage
  Map map_;
};

}  // namespace

VisibleDensity visible_density(const Medium& medium, const dvec3& view, const dvec3& up, double wanted_depth,
                               const Task& task) {
  if (medium.empty()) return {};
  return Finder(medium, view, up, wanted_depth, task).find();
}

}  // namespace brume
