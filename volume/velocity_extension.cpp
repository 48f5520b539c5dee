#include "volume/velocity_extension.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "base/error.h"
#include "volume/cell_means.h"
#include "volume/cell_values.h"
#include "volume/cells_in_boxes.h"
#include "volume/stored_values.h"
#include "volume/velocity_component.h"
#include "volume/voxel_box.h"

namespace brume {
namespace {

constexpr int kCell = BrickGrid::kCell, kStored = BrickGrid::kStored;
constexpr double kFar = 1 << 28;            // voxels: what lies farther from the origin is refused
constexpr int kNear = 4;                    // voxels around a brick whose velocities count in it
constexpr int kWide = kStored + 2 * kNear;  // voxels along a brick with those around it

/// A range of displacements [voxels per frame].
struct Range {
  dvec3 low{0}, high{0};
  void include(const Range& other) {
    low = glm::min(low, other.low);
    high = glm::max(high, other.high);
  }
};

VoxelBox grown(const VoxelBox& box, const dvec3& low, const dvec3& high) {
  return {box.lo + ivec3(glm::floor(low)), box.hi + ivec3(glm::ceil(high))};
}

/// Sums over the voxels around each voxel of a brick, weighted by exp(-distance along the axes): the nearest decide.
/// @param window  the kWide^3 values around, kNear more on each side
void sum_around(const std::vector<float>& window, float* sums) {
  static const auto kWeights = [] {
    std::array<float, 2 * kNear + 1> weights;
    for (int i = -kNear; i <= kNear; ++i)
      weights[static_cast<size_t>(i + kNear)] = std::exp(-static_cast<float>(std::abs(i)));
    return weights;
  }();
  // Along x, y and z in turn: rows of `wide` values that lie `step` values apart become one.
  const auto sum_rows = [](const float* from, int wide, int step, float* to) {
    std::fill_n(to, wide, 0.0f);
    for (size_t i = 0; i < kWeights.size(); ++i)
      for (int k = 0; k < wide; ++k) to[k] += kWeights[i] * from[static_cast<int>(i) * step + k];
  };
  std::array<float, kStored * kWide * kWide> along_x;
  for (int x = 0; x < kStored; ++x)
    sum_rows(window.data() + x * kWide * kWide, kWide * kWide, kWide * kWide, along_x.data() + x * kWide * kWide);
  std::array<float, kWide> along_y;
  for (int x = 0; x < kStored; ++x)
    for (int y = 0; y < kStored; ++y) {
      sum_rows(along_x.data() + (x * kWide + y) * kWide, kWide, kWide, along_y.data());
      sum_rows(along_y.data(), kStored, 1, sums + (x * kStored + y) * kStored);
    }
}

/// A velocity on the lattice of the density that it moves, on its way to the places where the density may arrive.
class Extension {
 public:
  Extension(const StoredVelocity& velocity, const ScalarField& density, const ShutterMotion& motion, const Task& task)
      : velocity_(velocity),
        density_(density.bricks),
        world_from_index_(density.world_from_index),
        voxels_from_world_(glm::inverse(dmat3(density.world_from_index))),
        motion_(motion),
        task_(task),
        density_box_(density.summary.box),
        box_(density.summary.box) {}

  ExtendedVelocity run(std::vector<std::string>& notes) {
    locate();
    resample();
    settle_density();
    find_arrivals(notes);
    if (!arrivals_.empty()) extend();
    return {std::move(field_), box_};
  }

 private:
  bool one_lattice(const StoredVelocity::Component& component) const {
    return component.world_from_index == world_from_index_ && component.shift == dvec3(0);
  }

  /// The voxels of the density's lattice around stored ones.
  VoxelBox on_lattice(const StoredVelocity::Component& component, const VoxelBox& box, int margin) const {
    if (one_lattice(component)) return {box.lo - margin, box.hi + margin};
    const dmat4 to_density = component.world_from_index == world_from_index_
                                 ? dmat4(1)
                                 : glm::inverse(world_from_index_) * component.world_from_index;
    dvec3 lo(1e300), hi(-1e300);
    for (int k = 0; k < 8; ++k) {
      const dvec3 corner{k & 1 ? box.hi.x + margin : box.lo.x - margin, k & 2 ? box.hi.y + margin : box.lo.y - margin,
                         k & 4 ? box.hi.z + margin : box.lo.z - margin};
      const dvec3 at(to_density * glm::dvec4(corner, 1.0));
      lo = glm::min(lo, at);
      hi = glm::max(hi, at);
    }
    if (!(glm::all(glm::greaterThan(lo, dvec3(-kFar))) && glm::all(glm::lessThan(hi, dvec3(kFar)))))
      throw InputError(fmt::format("grid '{}' lies far outside of the density", velocity_.name));
    return {ivec3(glm::floor(lo)), ivec3(glm::ceil(hi))};
  }

  /// The range of displacements while the shutter is open.
  Range over_shutter(const Range& velocity) const {
    Range range;
    for (const double t : {motion_.open, motion_.close}) {
      range.include({velocity.low * t, velocity.low * t});
      range.include({velocity.high * t, velocity.high * t});
    }
    return range;
  }

  /// Finds the box of velocity and density together, and the part of the velocity that can move any density.
  void locate() {
    Range world;
    for (size_t c = 0; c < 3; ++c) {
      const StoredVelocity::Component& component = velocity_.components[c];
      if (!component.box.empty()) enclose(box_, on_lattice(component, component.box, 1));
      component.values.each_distinct_cell([&](const BrickGrid::Cell& cell, uint64_t) {
        const float* const values = component.values.brick(cell);
        const auto [low, high] = std::minmax_element(values, values + BrickGrid::kBrick);
        const auto a = static_cast<int>(c);
        world.low[a] = std::min(world.low[a], static_cast<double>(*low));
        world.high[a] = std::max(world.high[a], static_cast<double>(*high));
      });
    }
    Range voxels;
    for (int c = 0; c < 3; ++c)
      for (int a = 0; a < 3; ++a) {
        const double l = voxels_from_world_[a][c] * world.low[a] * motion_.scale,
                     h = voxels_from_world_[a][c] * world.high[a] * motion_.scale;
        voxels.low[c] += std::min(l, h);
        voxels.high[c] += std::max(l, h);
      }
    const Range reach = over_shutter(voxels);
    const dvec3 across(2 * kFar);
    useful_ = common(box_, grown(density_box_, glm::max(reach.low, -across) - 1.0, glm::min(reach.high, across) + 1.0));
  }

  /// The velocity in voxels per frame where it is stored, and where that is.
  void resample() {
    std::vector<ivec3> blocks;
    if (!useful_.empty())
      for (size_t c = 0; c < 3; ++c) {
        const StoredVelocity::Component& component = velocity_.components[c];
        component.stored.each_cell([&](const ivec3& cell) {
          const ivec3 first = component.stored.origin() + kCell * cell;
          if (one_lattice(component)) {
            if (!common(useful_, {first, first + kCell}).empty()) blocks.push_back(first);
            return;
          }
          const VoxelBox reached = common(useful_, on_lattice(component, {first, first + kCell}, 1));
          if (reached.empty()) return;
          const ivec3 lo = reached.lo >> 3, hi = reached.hi >> 3;
          for (int x = lo.x; x <= hi.x; ++x)
            for (int y = lo.y; y <= hi.y; ++y)
              for (int z = lo.z; z <= hi.z; ++z) blocks.emplace_back(kCell * ivec3(x, y, z));
        });
      }
    const auto components = [&] {
      return std::array{VelocityComponent(velocity_.components[0], world_from_index_),
                        VelocityComponent(velocity_.components[1], world_from_index_),
                        VelocityComponent(velocity_.components[2], world_from_index_)};
    };
    const auto each_voxel = [&](const ivec3& lo, float* values, const auto& value) {
      for (int x = 0; x <= kCell; ++x)
        for (int y = 0; y <= kCell; ++y)
          for (int z = 0; z <= kCell; ++z) *values++ = value(lo + ivec3(x, y, z));
    };
    for (int c = 0; c < 3; ++c)
      field_.parts[static_cast<size_t>(c)] = BrickGrid::build(
          box_, blocks,
          [&](const ivec3& lo, float* values) {
            auto of = components();
            const std::optional<float> x = of[0].of_brick(lo), y = of[1].of_brick(lo), z = of[2].of_brick(lo);
            if (x && y && z) {
              const dvec3 world(*x, *y, *z);
              std::fill_n(values, BrickGrid::kBrick, finite_or_zero((voxels_from_world_ * world)[c] * motion_.scale));
              return;
            }
            each_voxel(lo, values, [&](const ivec3& v) {
              dvec3 world(0);
              for (int a = 0; a < 3; ++a)
                if (voxels_from_world_[a][c] != 0)
                  world[a] = static_cast<double>(of[static_cast<size_t>(a)](v).value_or(0.0f));
              return finite_or_zero((voxels_from_world_ * world)[c] * motion_.scale);
            });
          },
          quiet(task_));
    // Nothing is known of voxels without any velocity and density.
    known_ = BrickGrid::build(
        box_, blocks,
        [&](const ivec3& lo, float* values) {
          auto of = components();
          const std::optional<float> whole[] = {of[0].of_brick(lo), of[1].of_brick(lo), of[2].of_brick(lo)};
          if (whole[0] && whole[1] && whole[2] && (*whole[0] != 0 || *whole[1] != 0 || *whole[2] != 0)) {
            std::fill_n(values, BrickGrid::kBrick, 1.0f);
            return;
          }
          VoxelReader density(density_);
          each_voxel(lo, values, [&](const ivec3& v) {
            const std::optional<float> x = of[0](v), y = of[1](v), z = of[2](v);
            if (!x || !y || !z) return 0.0f;
            return *x != 0 || *y != 0 || *z != 0 || density(v) > 0 ? 1.0f : 0.0f;
          });
        },
        quiet(task_));
    note_full();
  }

  void note_full() {
    full_.assign(known_.brick_count() + 1, 0);
    known_.each_distinct_cell([&](const BrickGrid::Cell& cell, uint64_t) {
      const float* const values = known_.brick(cell);
      full_[cell.brick] = std::all_of(values, values + BrickGrid::kBrick, [](float v) { return v == 1; });
    });
  }

  /// Density without a velocity takes that of the voxels near it; where there are none it stands still. Either is known
  /// from then on.
  void settle_density() {
    if (known_.empty()) return;
    std::vector<ivec3> blocks;
    VoxelReader density(density_), known(known_);
    density_.each_cell([&](const ivec3& local) {
      const ivec3 c = (density_.origin() >> 3) + local;
      if (known_everywhere(c)) return;
      for (int i = 0; i < kCell * kCell * kCell; ++i) {
        const ivec3 v = kCell * c + ivec3(i >> 6, i >> 3 & 7, i & 7);
        if (density(v) > 0 && known(v) == 0) return blocks.push_back(kCell * c);
      }
    });
    if (blocks.empty()) return;
    known_.each_cell([&](const ivec3& c) { blocks.push_back(known_.origin() + kCell * c); });
    VectorBricks settled;
    for (size_t a = 0; a < 3; ++a)
      settled.parts[a] = BrickGrid::build(
          box_, blocks, [&](const ivec3& lo, float* values) { sample(a, lo, values, Unknown::kDensity); },
          quiet(task_));
    known_ = BrickGrid::build(
        box_, blocks,
        [&](const ivec3& lo, float* values) {
          if (known_everywhere(lo >> 3)) {
            std::fill_n(values, BrickGrid::kBrick, 1.0f);
            return;
          }
          VoxelReader density_at(density_), known_at(known_);
          for (int x = 0; x <= kCell; ++x)
            for (int y = 0; y <= kCell; ++y)
              for (int z = 0; z <= kCell; ++z) {
                const ivec3 v = lo + ivec3(x, y, z);
                *values++ = known_at(v) > 0 || density_at(v) > 0 ? 1.0f : 0.0f;
              }
        },
        quiet(task_));
    field_ = std::move(settled);
    note_full();
  }

  const BrickGrid::Cell* known_cell(const ivec3& c) const {
    if (known_.empty()) return nullptr;
    const ivec3 local = c - (known_.origin() >> 3);
    if (glm::any(glm::lessThan(local, ivec3(0))) || glm::any(glm::greaterThanEqual(local, known_.cells())))
      return nullptr;
    const BrickGrid::Cell& cell = known_.cell(local);
    return cell.brick ? &cell : nullptr;
  }
  bool known_everywhere(const ivec3& c) const {
    const BrickGrid::Cell* const cell = known_cell(c);
    return cell && full_[cell->brick];
  }

  /// Velocities in a cell, as they are known, and 0.
  static Range range_in(const std::array<CellRanges, 3>& parts, const ivec3& c) {
    Range range;
    for (int a = 0; a < 3; ++a) {
      const auto [low, high] = parts[static_cast<size_t>(a)].in(c);
      range.low[a] = std::min(0.0, static_cast<double>(low));
      range.high[a] = std::max(0.0, static_cast<double>(high));
    }
    return range;
  }

  /// The cells without a velocity everywhere that the density may arrive at: as far as it moves, or half as far again
  /// and again until there are not too many of them.
  void find_arrivals(std::vector<std::string>& notes) {
    if (known_.empty()) return;
    constexpr double kFarthest = 1024;  // voxels
    double farthest = 0, followed = kFarthest;
    std::vector<Range> moves;
    std::vector<ivec3> from;
    const std::array parts{CellRanges(field_.parts[0]), CellRanges(field_.parts[1]), CellRanges(field_.parts[2])};
    const ivec3 first = density_.origin() >> 3;
    density_.each_cell([&](const ivec3& local) {
      const ivec3 c = first + local;
      Range v = range_in(parts, c);
      if (!known_everywhere(c)) each_around(c, [&](const ivec3& near) { v.include(range_in(parts, near)); });
      for (const double t : {motion_.open, motion_.close}) {
        const Range move{glm::min(v.low * t, v.high * t), glm::max(v.low * t, v.high * t)};
        if (length(move) == 0) continue;
        moves.push_back(move);
        from.push_back(c);
        farthest = std::max(farthest, length(move));
      }
    });
    const size_t most = std::max<size_t>(1 << 16, 2 * from.size());
    for (;; followed /= 2) {
      std::vector<VoxelBox> boxes;  // of cells
      for (size_t i = 0; i < moves.size(); ++i) {
        const double share = std::min(1.0, followed / length(moves[i]));
        const VoxelBox own{kCell * from[i], kCell * (from[i] + 1)};
        const VoxelBox all = grown(own, moves[i].low * share - 1.0, moves[i].high * share + 1.0);
        boxes.push_back({all.lo >> 3, all.hi >> 3});
      }
      arrivals_.clear();
      each_cell_in_any(std::move(boxes), [&](const ivec3& to) {
        if (arrivals_.size() <= most && !known_everywhere(to)) arrivals_.push_back(to);
      });
      if (arrivals_.size() <= most || followed < 1) break;
    }
    if (farthest > followed)
      notes.push_back(fmt::format(
          "grid '{}' moves the density by up to {:.3g} voxels while the shutter is open; where no velocity is stored it is followed for {} of them: is velocity_scale right?",
          velocity_.name, farthest, followed));
  }
  static double length(const Range& move) {
    return std::max(max_component(glm::abs(move.low)), max_component(glm::abs(move.high)));
  }

  /// The mean of the velocities that are known in a cell.
  std::optional<vec3> mean_in(const ivec3& c) const {
    const BrickGrid::Cell* const cell = known_cell(c);
    if (!cell) return {};
    std::array<VoxelReader, 3> parts{VoxelReader(field_.parts[0]), VoxelReader(field_.parts[1]),
                                     VoxelReader(field_.parts[2])};
    const float* const known = known_.brick(*cell);
    dvec3 sum(0);
    int count = 0;
    for (int x = 0; x < kCell; ++x)
      for (int y = 0; y < kCell; ++y)
        for (int z = 0; z < kCell; ++z) {
          if (known[(x * kStored + y) * kStored + z] == 0) continue;
          ++count;
          for (int a = 0; a < 3; ++a)
            sum[a] += static_cast<double>(parts[static_cast<size_t>(a)](kCell * c + ivec3(x, y, z)));
        }
    if (count == 0) return {};
    return vec3(sum / static_cast<double>(count));
  }

  void extend() {
    means_.flood(
        arrivals_, [this](const ivec3& c) { return mean_in(c); }, task_);
    std::vector<ivec3> blocks;
    VoxelBox box = box_;
    for (const ivec3& c : arrivals_) {
      blocks.push_back(kCell * c);
      enclose(box, {kCell * c, kCell * c + kCell - 1});
    }
    std::sort(blocks.begin(), blocks.end(), by_coordinates);
    known_.each_cell([&](const ivec3& c) { blocks.push_back(known_.origin() + kCell * c); });
    VectorBricks extended;
    for (size_t a = 0; a < 3; ++a)
      extended.parts[a] = BrickGrid::build(
          box, blocks, [&](const ivec3& lo, float* values) { sample(a, lo, values, Unknown::kAll); }, quiet(task_));
    field_ = std::move(extended);
    box_ = box;
  }

  /// Which of the voxels without a known velocity are given one.
  enum class Unknown { kDensity, kAll };

  void sample(size_t axis, const ivec3& lo, float* values, Unknown which) const {
    const BrickGrid& part = field_.parts[axis];
    if (known_everywhere(lo >> 3)) {
      if (const std::optional<float> one = constant_in(part, lo))
        std::fill_n(values, BrickGrid::kBrick, *one);
      else
        read_cube<kStored>(part, lo, values);
      return;
    }
    std::vector<float> known(static_cast<size_t>(kWide) * kWide * kWide), products(known.size());
    std::array<float, BrickGrid::kBrick> weight{}, product{};
    bool any = false;
    each_around(lo >> 3, [&](const ivec3& near) { any = any || known_cell(near); });
    if (any) {
      read_cube<kWide>(known_, lo - kNear, known.data());
      read_cube<kWide>(part, lo - kNear, products.data());
      for (size_t i = 0; i < known.size(); ++i) products[i] *= known[i];
      sum_around(known, weight.data());
      sum_around(products, product.data());
    }
    VoxelReader density(density_);
    const CellMeans::Around mean(means_, lo >> 3, static_cast<int>(axis));
    size_t i = 0;
    for (int x = 0; x <= kCell; ++x)
      for (int y = 0; y <= kCell; ++y)
        for (int z = 0; z <= kCell; ++z, ++i) {
          constexpr float kFaint = 1e-6f;  // of a voxel's weight: there the means of cells take over
          const ivec3 v = lo + ivec3(x, y, z);
          const int in_window = ((x + kNear) * kWide + y + kNear) * kWide + z + kNear;
          if (known[static_cast<size_t>(in_window)] > 0)
            values[i] = products[static_cast<size_t>(in_window)];
          else if (which == Unknown::kDensity)
            values[i] = density(v) > 0 && weight[i] > 0 ? product[i] / weight[i] : 0.0f;
          else
            values[i] = (product[i] + kFaint * mean(v)) / (weight[i] + kFaint);
        }
  }

  const StoredVelocity& velocity_;
  const BrickGrid& density_;
  const dmat4 world_from_index_;
  const dmat3 voxels_from_world_;
  const ShutterMotion motion_;
  const Task& task_;
  const VoxelBox density_box_;
  VoxelBox box_, useful_;
  VectorBricks field_;
  BrickGrid known_;            // 1 where a velocity is known
  std::vector<uint8_t> full_;  // by brick of known_: whether all its voxels are
  std::vector<ivec3> arrivals_;
  CellMeans means_;
};

}  // namespace

ExtendedVelocity extend_velocity(const StoredVelocity& velocity, const ScalarField& density,
                                 const ShutterMotion& motion, std::vector<std::string>& notes, const Task& task) {
  return Extension(velocity, density, motion, task).run(notes);
}

}  // namespace brume
