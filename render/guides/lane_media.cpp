#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/guides/lane_media.cpp"
#include "render/guides/lane_media.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/cell_walk.h"

HWY_INLINE V3 set3(const dvec3& v) {
  return {set(static_cast<float>(v.x)), set(static_cast<float>(v.y)), set(static_cast<float>(v.z))};
}

/// As density_at(), but that nothing is looked up where no lane meets a brick.
HWY_INLINE V density_of_grid(const LaneCells& grid, const V3& p) {
  const D d;
  const DI di;
  const V3 cell = floor(p * grid.inverse_cell);
  const auto within = [](V c, float n) { return hn::And(c >= 0.0f, c < n); };
  const M inside = hn::And(within(cell.x, grid.nx), hn::And(within(cell.y, grid.ny), within(cell.z, grid.nz)));
  if (hn::AllFalse(d, inside)) return hn::Zero(d);
  const V row = cell.x * grid.ny + cell.y;
  const VI index =
      hn::IfThenElseZero(hn::RebindMask(di, inside), hn::ConvertTo(di, row) * grid.nz_int + hn::ConvertTo(di, cell.z));
  const VI brick = hn::GatherIndex(di, grid.brick, index);
  const M found = hn::And(inside, hn::RebindMask(d, brick > -1));
  if (hn::AllFalse(d, found)) return hn::Zero(d);
  const V3 q = select(found, p - cell * grid.cell, zero3());
  return hn::IfThenElseZero(found, interpolated(grid, hn::Max(brick, hn::Zero(di)), q));
}

HWY_INLINE V density_of_shape(const HomogeneousShape& shape, const V3& p) {
  const dvec3 half = 0.5 * (shape.hi - shape.lo);
  const V3 q = (p - set3(0.5 * (shape.lo + shape.hi))) * set3(1.0 / half);
  const bool sphere = shape.shape == HomogeneousShape::Shape::kSphere;
  const V from_middle = sphere ? dot(q, q) : max_component(max(q, zero3() - q));
  return hn::IfThenElseZero(from_middle <= 1.0f, set(1.0f));
}

/// A line of each lane in a medium's coordinates.
struct LocalLines {
  dvec3 start, across, step;
  HWY_INLINE V3 at(V lane, int k) const { return set3(start + static_cast<double>(k) * step) + set3(across) * lane; }
};

V Density(const LaneMedia::Part& part, const LocalLines& lines, int k, V lane) {
  if (part.grid) return density_of_grid(part.cells, lines.at(lane, k));
  if (const auto& shape = part.medium->homogeneous()) {
    const V inside = density_of_shape(*shape, lines.at(lane, k));
    if (!shape->falloff) return inside;
    const V height =
        set(static_cast<float>(shape->falloff->height(lines.start + static_cast<double>(k) * lines.step))) +
        set(static_cast<float>(glm::dot(shape->falloff->slope, lines.across))) * lane;
    return inside * exponential(-hn::Max(height, hn::Zero(D())));
  }
  HWY_ALIGN Lanes number, density;
  hn::Store(lane, D(), number);
  for (size_t i = 0; i < hn::Lanes(D()); ++i)
    density[i] = static_cast<float>(part.medium->smooth_density(lines.start + static_cast<double>(k) * lines.step +
                                                                static_cast<double>(number[i]) * lines.across));
  return hn::Load(D(), density);
}

/// An instance that lines may meet, from one to another of their samples.
struct MetInstance {
  const LaneMedia::Part* part;
  LocalLines lines;
  float extinction;  // of a sample
  int first, last;
};

/// The instances whose boxes the lines may meet.
std::vector<MetInstance> instances_met(const std::vector<LaneMedia::Part>& parts, const LaneMedia::Lines& lines,
                                       double step) {
  std::vector<MetInstance> met;
  const int samples = (lines.nodes - 1) * lines.inner;
  const dvec3 across = static_cast<double>(LaneMedia::Lines::kMost - 1) * lines.across;
  const dvec3 along = lines.length * (lines.nodes - 1) * lines.along;
  const dvec3 end = lines.start + across + along;
  dvec3 lo = glm::min(lines.start, end), hi = glm::max(lines.start, end);
  for (const dvec3& corner : {lines.start + across, lines.start + along}) {
    lo = glm::min(lo, corner);
    hi = glm::max(hi, corner);
  }
  for (const LaneMedia::Part& part : parts) {
    const Instances* const all = part.medium->instances();
    if (!all) continue;
    const auto [from, to] = part.medium->support();
    all->each_near(lo, hi, [&](size_t i) {
      const Instance& one = (*all)[i];
      const Ray ray = one.to_local(Ray{lines.start + 0.5 * step * lines.along, lines.along});
      const LocalLines local{ray.o, one.to_local.matrix * lines.across, step * ray.d};
      // Against the box, wider by as much as lines lie apart.
      const dvec3 apart = glm::abs(local.across * static_cast<double>(LaneMedia::Lines::kMost - 1));
      double first = 0, last = samples - 1;
      for (int a = 0; a < 3; ++a) {
        const double low = from[a] - apart[a] - local.start[a], high = to[a] + apart[a] - local.start[a];
        if (std::abs(local.step[a]) < 1e-12) {
          if (low > 0 || high < 0) return;
          continue;
        }
        first = std::max(first, std::min(low / local.step[a], high / local.step[a]));
        last = std::min(last, std::max(low / local.step[a], high / local.step[a]));
      }
      if (first > last) return;
      met.push_back({&part, local, static_cast<float>(part.sigma_t * one.density * step),
                     static_cast<int>(std::ceil(first)), static_cast<int>(std::floor(last))});
    });
  }
  return met;
}

void SumDepths(const std::vector<LaneMedia::Part>& parts, const LaneMedia::Lines& lines, float* depths) {
  const D d;
  constexpr int kMost = LaneMedia::Lines::kMost;
  std::vector<LocalLines> local;
  const double step = lines.length / lines.inner;
  const bool instances = std::any_of(parts.begin(), parts.end(), [](const auto& p) { return p.medium->instances(); });
  const std::vector<MetInstance> met = instances ? instances_met(parts, lines, step) : std::vector<MetInstance>();
  std::vector<float> of_instances(instances ? static_cast<size_t>(lines.nodes) * kMost : 0);
  for (const MetInstance& one : met)
    for (int first = 0; first < kMost; first += static_cast<int>(hn::Lanes(d))) {
      const V lane = hn::Iota(d, static_cast<float>(first));
      for (int k = one.first; k <= one.last; ++k) {
        float* const sum = of_instances.data() + k / lines.inner * kMost + first;
        hn::StoreU(hn::LoadU(d, sum) + Density(*one.part, one.lines, k, lane) * one.extinction, d, sum);
      }
    }
  for (const LaneMedia::Part& part : parts) {
    const Ray ray = part.medium->to_local(Ray{lines.start + 0.5 * step * lines.along, lines.along});
    local.push_back({ray.o, part.medium->to_local(Ray{lines.start, lines.across}).d, step * ray.d});
  }
  for (int first = 0; first < kMost; first += static_cast<int>(hn::Lanes(d))) {
    const V lane = hn::Iota(d, static_cast<float>(first));
    V depth = hn::Zero(d);
    hn::StoreU(depth, d, depths + (lines.nodes - 1) * kMost + first);
    for (int node = lines.nodes - 2; node >= 0; --node) {
      V sum = hn::Zero(d);
      if (instances) sum = hn::LoadU(d, of_instances.data() + node * kMost + first);
      for (size_t m = 0; m < parts.size(); ++m)
        for (int i = 0; i < lines.inner && !parts[m].medium->instances(); ++i)
          sum = sum +
                Density(parts[m], local[m], node * lines.inner + i, lane) * static_cast<float>(parts[m].sigma_t * step);
      depth = depth + hn::Max(sum, hn::Zero(d));
      hn::StoreU(depth, d, depths + node * kMost + first);
    }
  }
}

void Extinctions(const LaneMedia::Part& part, const dvec3& start, const dvec3& step, std::vector<float>& values) {
  const D d;
  constexpr size_t kMost = LaneMedia::Lines::kMost;
  const Ray ray = part.medium->to_local(Ray{start, step});
  for (size_t i = 0; i < values.size(); i += kMost) {
    const LocalLines points{ray.at(static_cast<double>(i)), ray.d, dvec3(0)};
    for (size_t first = 0; first < kMost; first += hn::Lanes(d)) {
      const V lane = hn::Iota(d, static_cast<float>(first));
      hn::StoreU(Density(part, points, 0, lane) * static_cast<float>(part.sigma_t), d, values.data() + i + first);
    }
  }
}

/// A cube of values on a lattice, x slowest: linear between each two along every axis. @param across  of the result
void refine(const std::vector<float>& coarse, int coarse_across, int per_node, int across, std::vector<float>& fine) {
  const size_t n = static_cast<size_t>(coarse_across), m = static_cast<size_t>(across);
  const auto each = [&](const auto& body) {
    for (size_t k = 0; k < m; ++k) {
      const size_t node = std::min(k / static_cast<size_t>(per_node), n - 2);
      body(k, node, static_cast<float>(k - node * static_cast<size_t>(per_node)) / static_cast<float>(per_node));
    }
  };
  std::vector<float> along_z(n * n * m), along_y(n * m * m);
  for (size_t row = 0; row < n * n; ++row)
    each([&](size_t k, size_t node, float f) {
      const float* const a = coarse.data() + row * n + node;
      along_z[row * m + k] = a[0] + f * (a[1] - a[0]);
    });
  const auto between = [&](const float* a, const float* b, float f, size_t count, float* to) {
    for (size_t i = 0; i < count; ++i) to[i] = a[i] + f * (b[i] - a[i]);
  };
  for (size_t plane = 0; plane < n; ++plane)
    each([&](size_t k, size_t node, float f) {
      const float* const a = along_z.data() + (plane * n + node) * m;
      between(a, a + m, f, m, along_y.data() + (plane * m + k) * m);
    });
  fine.resize(m * m * m);
  each([&](size_t k, size_t node, float f) {
    const float* const a = along_y.data() + node * m * m;
    between(a, a + m * m, f, m * m, fine.data() + k * m * m);
  });
}

/// Calls body(i, p) for the points of a cube, x slowest, as many together as there are lanes: the first is the i-th.
/// The last lanes may be beyond the cube.
template <class Body>
void each_point(const dvec3& first, double spacing, int across, const Body& body) {
  const D d;
  const size_t lanes = hn::Lanes(d), count = static_cast<size_t>(across) * across * across;
  std::vector<float> x(count + lanes), y(count + lanes), z(count + lanes);
  size_t next = 0;
  for (int i = 0; i < across; ++i)
    for (int j = 0; j < across; ++j)
      for (int k = 0; k < across; ++k, ++next) {
        x[next] = static_cast<float>(first.x + spacing * i);
        y[next] = static_cast<float>(first.y + spacing * j);
        z[next] = static_cast<float>(first.z + spacing * k);
      }
  for (size_t i = 0; i < count; i += lanes)
    body(i, V3{hn::LoadU(d, x.data() + i), hn::LoadU(d, y.data() + i), hn::LoadU(d, z.data() + i)});
}

// The displacement, linear between voxels, is looked up once for each of them.
void SampleDisplaced(const LaneScene& scene, float frame, const dvec3& first, int per_voxel, int across,
                     float* values) {
  const D d;
  const int voxels = (across - 1) / per_voxel + 1;
  const size_t lanes = hn::Lanes(d), count = static_cast<size_t>(across) * across * across;
  std::vector<float> at_voxels(static_cast<size_t>(voxels) * voxels * voxels + lanes), displacement[3];
  for (size_t axis = 0; axis < 3; ++axis) {
    const LaneCells& field = scene.displacement[axis];
    displacement[axis].assign(count + lanes, 0.0f);
    if (!field.values) continue;
    each_point(first, 1, voxels, [&](size_t i, const V3& p) {
      hn::StoreU(set(frame) * density_at(field, p + set3(scene.origin_shift)), d, at_voxels.data() + i);
    });
    refine(at_voxels, voxels, per_voxel, across, displacement[axis]);
    displacement[axis].resize(count + lanes);
  }
  each_point(first, 1.0 / per_voxel, across, [&](size_t i, const V3& p) {
    const auto along = [&](size_t axis) { return hn::LoadU(d, displacement[axis].data() + i); };
    HWY_ALIGN Lanes found;
    hn::Store(density_of_grid(scene.density, p - V3{along(0), along(1), along(2)}), d, found);
    std::copy_n(found, std::min(lanes, count - i), values + i);
  });
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(SumDepths);
HWY_EXPORT(Extinctions);
HWY_EXPORT(SampleDisplaced);

LaneMedia::LaneMedia(const GuideMedia& media, GuideColour colour) {
  for (size_t i = 0; i < media.media().size(); ++i) {
    const Medium& m = media.media()[i];
    Part& part = parts_.emplace_back(Part{&m, media.constants(i).per_density[static_cast<size_t>(colour + 1)], {}});
    part.grid = !m.homogeneous() && !m.displacement() && !m.bricks().empty() && LaneGrid::fits(m.bricks());
    if (part.grid) part.stored = LaneGrid::of_values(m.bricks());
  }
  for (Part& part : parts_) set_cells(part.cells, part.stored);
}

void LaneMedia::depths(const Lines& lines, float* depths) const {
  HWY_DYNAMIC_DISPATCH(SumDepths)(parts_, lines, depths);
}

bool LaneMedia::even() const {
  return std::all_of(parts_.begin(), parts_.end(), [](const Part& part) {
    return (part.grid || part.medium->homogeneous()) && !part.medium->coloured() && !part.medium->instances();
  });
}

void LaneMedia::extinctions(size_t medium, const dvec3& start, const dvec3& step, std::vector<float>& values) const {
  values.resize((values.size() + Lines::kMost - 1) / Lines::kMost * Lines::kMost);
  HWY_DYNAMIC_DISPATCH(Extinctions)(parts_[medium], start, step, values);
}

bool DisplacedSamples::fits(const Medium& medium) {
  return LaneGrid::fits(medium.bricks()) && LaneGrid::fits(medium.displacement()->envelope);
}

DisplacedSamples::DisplacedSamples(const Medium& medium, double time) {
  const Displacement& displacement = *medium.displacement();
  grids_.density = LaneGrid::of_values(medium.bricks());
  set_cells(scene_.density, grids_.density);
  for (size_t a = 0; a < 3; ++a) {
    grids_.displacement[a] = LaneGrid::of_values(displacement.field.parts[a]);
    set_cells(scene_.displacement[a], grids_.displacement[a]);
    scene_.origin_shift[a] = static_cast<float>(displacement.origin_shift[static_cast<int>(a)]);
  }
  frame_ = static_cast<float>(displacement.open + (displacement.close - displacement.open) * time);
}

void DisplacedSamples::sample(const dvec3& first, int per_voxel, int across, float* values) const {
  HWY_DYNAMIC_DISPATCH(SampleDisplaced)(scene_, frame_, first, per_voxel, across, values);
}

}  // namespace brume
#endif
