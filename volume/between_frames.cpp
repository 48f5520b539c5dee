#include "volume/between_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "base/memory_file.h"
#include "base/parallel_for.h"
#include "volume/voxel_box.h"
#include "volume/voxel_interpolation.h"
#include "volume/voxel_reader.h"

namespace brume {
namespace {

constexpr int kCell = BrickGrid::kCell, kStored = BrickGrid::kStored;

/// One of the two frames, seen from the lattice on which they meet.
struct Side {
  const ScalarField* field = nullptr;
  Displacement motion;        ///< voxels of its own lattice per frame; empty: it is not known
  dmat4 from_lattice{1};      ///< of the common lattice's index coordinates, to its own
  dmat3 lattice_from_own{1};  ///< of directions
  bool one_lattice = true;

  dvec3 own(const dvec3& p) const { return one_lattice ? p : dvec3(from_lattice * glm::dvec4(p, 1.0)); }
  double total() const {
    double sum = 0;
    const BrickGrid& bricks = field->bricks;
    bricks.each_cell([&](const ivec3& c) {
      const float* const values = bricks.brick(bricks.cell(c));
      double of_cell = 0;
      for (int x = 0; x < kCell; ++x)
        for (int y = 0; y < kCell; ++y)
          for (int z = 0; z < kCell; ++z) of_cell += static_cast<double>(values[(x * kStored + y) * kStored + z]);
      sum += of_cell;
    });
    return sum * std::abs(glm::determinant(dmat3(field->world_from_index)));
  }
};

/// Calls visit(voxel) for the 9 x 9 x 9 voxels of a brick, in the order in which it holds them.
template <class Visit>
void each_of_brick(const ivec3& lo, const Visit& visit) {
  for (int x = 0; x < kStored; ++x)
    for (int y = 0; y < kStored; ++y)
      for (int z = 0; z < kStored; ++z) visit(lo + ivec3(x, y, z));
}

BrickGrid build_over(const VoxelBox& box, const std::vector<ivec3>& blocks, const BrickGrid::Sampler& sample,
                     const Task& task) {
  MemoryFile file;
  return BrickGrid::build(box, blocks, sample, task, &file);
}

double voxel_of(const ScalarField& field) {
  return std::abs(glm::determinant(dmat3(field.world_from_index)));
}

}  // namespace

class BetweenFrames::Inside {
 public:
  Inside(const ScalarField& first, const ScalarField& second, const TimeBetween& time) : time_(time) {
    sides_[0].field = &first;
    sides_[1].field = &second;
    constexpr double kSmaller = 0.999;
    lattice_ = first.bricks.empty() || (!second.bricks.empty() && voxel_of(second) < kSmaller * voxel_of(first))
                   ? &second
                   : &first;
    for (Side& side : sides_) {
      side.one_lattice = side.field->world_from_index == lattice_->world_from_index;
      if (side.one_lattice) continue;
      side.from_lattice = glm::inverse(side.field->world_from_index) * lattice_->world_from_index;
      side.lattice_from_own = glm::inverse(dmat3(side.from_lattice));
    }
  }

  void set_motions(const std::array<const StoredVelocity*, 2>& velocities, std::vector<std::string>& notes,
                   const Task& task) {
    moves_ = true;
    for (size_t k = 0; k < 2; ++k) {
      Side& side = sides_[k];
      if (side.field->bricks.empty()) continue;
      const ShutterMotion motion{time_.scale, k == 0 ? 0 : -time_.frames, k == 0 ? time_.frames : 0};
      side.motion = displacement_over(*velocities[k], *side.field, motion, notes, quiet(task));
    }
  }

  bool empty() const { return sides_[0].field->bricks.empty() && sides_[1].field->bricks.empty(); }

  ScalarField field(bool conserve, const Task& task) const {
    ScalarField result;
    result.world_from_index = lattice_->world_from_index;
    result.summary = lattice_->summary;
    for (const Side& side : sides_)
      for (const std::string& note : side.field->notes)
        if (std::find(result.notes.begin(), result.notes.end(), note) == result.notes.end())
          result.notes.push_back(note);
    if (empty()) return result;
    const std::vector<ivec3> blocks = reached();
    VoxelBox box;
    for (const ivec3& block : blocks) enclose(box, {block, block + kCell - 1});
    BrickGrid made = build_over(
        box, blocks,
        [&](const ivec3& lo, float* values) {
          if (!fill(lo, conserve, values)) return;
          each_of_brick(lo, [&](const ivec3& v) {  // the field ends at the box
            if (!inside(box, v)) *values = 0;
            ++values;
          });
        },
        task);
    const bool resampled = moves_ || !sides_[0].one_lattice || !sides_[1].one_lattice;
    if (conserve && resampled) made = with_total(made, box, blocks, task);
    result.summary.box = made.empty() ? VoxelBox() : box;
    result.summary.minimum = 0;
    result.summary.maximum = static_cast<double>(made.maximum());
    result.bricks = std::move(made);
    return result;
  }

  StoredVelocity velocity(const Task& task) const {
    StoredVelocity result;
    result.name = "velocity";
    if (empty() || !moves_) return result;
    const std::vector<ivec3> blocks = reached();
    VoxelBox box;
    for (const ivec3& block : blocks) enclose(box, {block, block + kCell - 1});
    const dmat3 world_from_voxels(lattice_->world_from_index);
    for (int c = 0; c < 3; ++c) {
      StoredVelocity::Component& component = result.components[static_cast<size_t>(c)];
      component.world_from_index = lattice_->world_from_index;
      component.box = box;
      component.values = build_over(
          box, blocks,
          [&](const ivec3& lo, float* values) {
            Walker walker(*this);
            each_of_brick(lo, [&](const ivec3& v) {
              *values++ = static_cast<float>((world_from_voxels * walker.velocity(dvec3(v), time_.share))[c]);
            });
          },
          quiet(task));
      component.stored = BrickGrid::build(
          box, blocks, [](const ivec3&, float* values) { std::fill_n(values, BrickGrid::kBrick, 1.0f); }, quiet(task));
    }
    return result;
  }

  /// Compares voxels of the second frame, every other one along each axis, with what `carried(voxel)` says of them.
  template <class Carried>
  double difference(const Carried& carried, const Task& task) const {
    const BrickGrid& second = sides_[1].field->bricks;
    std::vector<ivec3> cells;
    second.each_cell([&](const ivec3& c) { cells.push_back(c); });
    std::vector<double> squares(cells.size());
    parallel_for(static_cast<int>(cells.size()), quiet(task), [&](int i) {
      const ivec3 c = cells[static_cast<size_t>(i)];
      const float* const values = second.brick(second.cell(c));
      Walker walker(*this);
      double sum = 0;
      for (int x = 0; x < kCell; x += 2)
        for (int y = 0; y < kCell; y += 2)
          for (int z = 0; z < kCell; z += 2) {
            const ivec3 v = second.origin() + kCell * c + ivec3(x, y, z);
            const double d = carried(walker, v) - static_cast<double>(values[(x * kStored + y) * kStored + z]);
            sum += d * d;
          }
      squares[static_cast<size_t>(i)] = sum;
    });
    double sum = 0;
    for (const double s : squares) sum += s;
    return std::sqrt(sum);
  }

  /// Whether the frames can be compared voxel by voxel.
  bool comparable() const {
    return moves_ && sides_[0].one_lattice && sides_[1].one_lattice && !sides_[0].field->bricks.empty() &&
           !sides_[1].field->bricks.empty();
  }
  double still(const Task& task) const {
    return difference([](Walker& w, const ivec3& v) { return static_cast<double>(w.voxels[0](v)); }, task);
  }
  double misfit(const Task& task) const {
    const double at_rest = comparable() ? still(task) : 0;
    if (!(at_rest > 0)) return 0;
    return difference([&](Walker& w, const ivec3& v) { return w.cubic[0](w.follow(dvec3(v), 1, 0)); }, task) / at_rest;
  }
  double best_factor(const Task& task) const {
    if (!comparable()) return 1;
    double best = 1, least = std::numeric_limits<double>::infinity();
    constexpr double kStep = 1.2, kFarthest = 1e5;
    for (double factor = 1 / kFarthest; factor < kFarthest; factor *= kStep) {
      const double error = difference(
          [&](Walker& w, const ivec3& v) {
            return w.cubic[0](dvec3(v) - factor * time_.frames * w.own_velocity(1, dvec3(v)));
          },
          task);
      if (error < least) least = error, best = factor;
    }
    return best;
  }

 private:
  /// What one thread needs to follow points.
  struct Walker {
    explicit Walker(const Inside& of)
        : inside(of),
          cubic{CubicReader(of.sides_[0].field->bricks), CubicReader(of.sides_[1].field->bricks)},
          voxels{VoxelReader(of.sides_[0].field->bricks), VoxelReader(of.sides_[1].field->bricks)},
          motion{VectorReader(of.sides_[0].motion), VectorReader(of.sides_[1].motion)} {}

    /// The velocity of one of the frames at a point of the common lattice, in its voxels per frame.
    dvec3 own_velocity(size_t k, const dvec3& p) {
      const Side& side = inside.sides_[k];
      const dvec3 own = motion[k](side.own(p));
      return side.one_lattice ? own : side.lattice_from_own * own;
    }
    /// @param time  0 at the first frame, 1 at the second
    dvec3 velocity(const dvec3& p, double time) {
      const dvec3 a = own_velocity(0, p), b = own_velocity(1, p);
      if (a == dvec3(0)) return b;  // nothing is known of it in that frame, or it is still there
      if (b == dvec3(0)) return a;
      return a + time * (b - a);
    }
    /// Where a point of the common lattice is at another time.
    dvec3 follow(dvec3 p, double from, double to) {
      if (!inside.moves_ || from == to) return p;
      const double frames = inside.time_.frames;
      const int steps = std::max(1, static_cast<int>(std::ceil(2 * std::abs(to - from) * frames - 1e-9)));
      const double h = (to - from) / steps;
      for (int i = 0; i < steps; ++i) {
        const double t = from + i * h;
        const dvec3 middle = p + 0.5 * h * frames * velocity(p, t);
        p += h * frames * velocity(middle, t + 0.5 * h);
      }
      return p;
    }

    const Inside& inside;
    std::array<CubicReader, 2> cubic;
    std::array<VoxelReader, 2> voxels;
    std::array<VectorReader, 2> motion;
  };

  /// Where the flow comes from, or goes to, at points four voxels apart around a brick, and how it changes volumes:
  /// over so much space that the lattice of the velocities leaves no noise in it.
  class CoarseMap {
   public:
    static constexpr int kSpacing = 4, kInner = kCell / kSpacing + 1, kPoints = kInner + 2;

    CoarseMap(Walker& walker, const ivec3& lo, double from, double to) {
      for (int i = 0; i < kPoints * kPoints * kPoints; ++i) {
        const ivec3 at = kSpacing * (ivec3(i / (kPoints * kPoints), i / kPoints % kPoints, i % kPoints) - 1);
        points_[static_cast<size_t>(i)] = walker.follow(dvec3(lo + at), from, to);
      }
      for (int x = 0; x < kInner; ++x)
        for (int y = 0; y < kInner; ++y)
          for (int z = 0; z < kInner; ++z) {
            dmat3 change;
            for (int a = 0; a < 3; ++a) {
              ivec3 step(0);
              step[a] = 1;
              const ivec3 c(x + 1, y + 1, z + 1);
              change[a] = (at(c + step) - at(c - step)) / (2.0 * kSpacing);
            }
            // A map that folds has no volume to speak of.
            volumes_[static_cast<size_t>((x * kInner + y) * kInner + z)] = std::max(0.0, glm::determinant(change));
          }
    }
    /// The volume at that other time of what is a unit of volume here. @param v  from the brick's first voxel on
    double volume(const ivec3& v) const {
      const ivec3 c = glm::min(v / kSpacing, kInner - 2);
      const dvec3 f = dvec3(v - kSpacing * c) / static_cast<double>(kSpacing);
      double sum = 0;
      for (int k = 0; k < 8; ++k) {
        const ivec3 o(k >> 2, k >> 1 & 1, k & 1), at = c + o;
        const double w = (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z);
        if (w > 0) sum += w * volumes_[static_cast<size_t>((at.x * kInner + at.y) * kInner + at.z)];
      }
      return sum;
    }
    /// Of all its points, some voxels more on each side.
    std::pair<dvec3, dvec3> bounds() const {
      dvec3 lo = points_[0], hi = points_[0];
      for (const dvec3& p : points_) lo = glm::min(lo, p), hi = glm::max(hi, p);
      return {lo, hi};
    }

   private:
    const dvec3& at(const ivec3& c) const {
      return points_[static_cast<size_t>((c.x * kPoints + c.y) * kPoints + c.z)];
    }
    std::array<dvec3, kPoints * kPoints * kPoints> points_;
    std::array<double, kInner * kInner * kInner> volumes_;
  };

  /// Whether a frame holds anything in a box of the common lattice.
  bool any_in(const Side& side, const dvec3& lo, const dvec3& hi) const {
    const BrickGrid& bricks = side.field->bricks;
    if (bricks.empty()) return false;
    dvec3 own_lo(std::numeric_limits<double>::infinity()), own_hi(-own_lo);
    for (int k = 0; k < 8; ++k) {
      const dvec3 p = side.own({k & 1 ? lo.x : hi.x, k & 2 ? lo.y : hi.y, k & 4 ? lo.z : hi.z});
      own_lo = glm::min(own_lo, p), own_hi = glm::max(own_hi, p);
    }
    const auto cell = [&](const dvec3& p) {
      return ivec3(glm::clamp(p - dvec3(bricks.origin()), dvec3(-8.0), 8.0 * dvec3(bricks.cells()))) >> 3;
    };
    const ivec3 first = glm::max(cell(own_lo - 2.0), ivec3(0)), last = glm::min(cell(own_hi + 2.0), bricks.cells() - 1);
    for (int x = first.x; x <= last.x; ++x)
      for (int y = first.y; y <= last.y; ++y)
        for (int z = first.z; z <= last.z; ++z)
          if (bricks.cell({x, y, z}).brick) return true;
    return false;
  }

  /// The values of a brick. @return false where all are 0
  bool fill(const ivec3& lo, bool conserve, float* values) const {
    std::fill_n(values, BrickGrid::kBrick, 0.0f);
    Walker walker(*this);
    bool any = false;
    for (size_t k = 0; k < 2; ++k) {
      const Side& side = sides_[k];
      const double there = static_cast<double>(k), weight = k == 0 ? 1 - time_.share : time_.share;
      if (!(weight > 0)) continue;
      std::optional<CoarseMap> map;
      if (moves_) map.emplace(walker, lo, time_.share, there);
      const auto [low, high] = map ? map->bounds() : std::pair(dvec3(lo), dvec3(lo + kCell));
      if (!any_in(side, low, high)) continue;
      any = true;
      float* to = values;
      each_of_brick(lo, [&](const ivec3& v) {
        double value;
        if (!moves_ && side.one_lattice) {
          value = static_cast<double>(walker.voxels[k](v));
        } else {
          value = walker.cubic[k](side.own(walker.follow(dvec3(v), time_.share, there)));
          if (conserve && map && value > 0) value *= map->volume(v - lo);
        }
        *to++ += static_cast<float>(weight * value);
      });
    }
    return any;
  }

  /// Lowest corners of the blocks of the common lattice that what either frame holds may reach, on its way or at its
  /// end.
  std::vector<ivec3> reached() const {
    std::vector<ivec3> blocks;
    for (const Side& side : sides_) {
      const BrickGrid& cells = moves_ ? side.motion.envelope : side.field->bricks;
      if (side.field->bricks.empty()) continue;
      cells.each_cell([&](const ivec3& c) {
        const ivec3 first = cells.origin() + kCell * c;
        if (side.one_lattice) {
          blocks.push_back(first);
          return;
        }
        const dmat4 to_lattice = glm::inverse(side.from_lattice);
        dvec3 lo(std::numeric_limits<double>::infinity()), hi(-lo);
        for (int k = 0; k < 8; ++k) {
          const dvec3 corner = dvec3(first) + 8.0 * dvec3(k & 1, k >> 1 & 1, k >> 2);
          const dvec3 p(to_lattice * glm::dvec4(corner, 1.0));
          lo = glm::min(lo, p), hi = glm::max(hi, p);
        }
        const ivec3 from = ivec3(glm::floor(lo)) >> 3, to = ivec3(glm::ceil(hi)) >> 3;
        for (int x = from.x; x <= to.x; ++x)
          for (int y = from.y; y <= to.y; ++y)
            for (int z = from.z; z <= to.z; ++z) blocks.emplace_back(kCell * ivec3(x, y, z));
      });
    }
    return blocks;
  }

  /// The same field with the total that time mixes of the two frames'. Resampling loses or makes some thousandths.
  BrickGrid with_total(const BrickGrid& made, const VoxelBox& box, const std::vector<ivec3>& blocks,
                       const Task& task) const {
    ScalarField now;
    now.bricks = made;
    now.world_from_index = lattice_->world_from_index;
    const double is = Side{&now, {}, dmat4(1), dmat3(1), true}.total(),
                 was = (1 - time_.share) * sides_[0].total() + time_.share * sides_[1].total();
    if (!(is > 0) || !(was > 0)) return made;
    const double factor = was / is;
    return build_over(
        box, blocks,
        [&](const ivec3& lo, float* values) {
          VoxelReader at(made);
          each_of_brick(lo,
                        [&](const ivec3& v) { *values++ = static_cast<float>(factor * static_cast<double>(at(v))); });
        },
        quiet(task));
  }

  const TimeBetween time_;
  std::array<Side, 2> sides_;
  const ScalarField* lattice_ = nullptr;  // whose lattice is the common one
  bool moves_ = false;
};

BetweenFrames::BetweenFrames(const ScalarField& first, const StoredVelocity& first_velocity, const ScalarField& second,
                             const StoredVelocity& second_velocity, const TimeBetween& time,
                             std::vector<std::string>& notes, const Task& task) {
  auto made = std::make_unique<Inside>(first, second, time);
  made->set_motions({&first_velocity, &second_velocity}, notes, task);
  inside_ = std::move(made);
}

BetweenFrames::BetweenFrames(const ScalarField& first, const ScalarField& second, const TimeBetween& time)
    : inside_(std::make_unique<const Inside>(first, second, time)) {}

BetweenFrames::~BetweenFrames() = default;

ScalarField BetweenFrames::density(const Task& task) const {
  return inside_->field(/*conserve=*/true, task);
}

ScalarField BetweenFrames::intensity(const Task& task) const {
  return inside_->field(/*conserve=*/false, task);
}

StoredVelocity BetweenFrames::velocity(const Task& task) const {
  return inside_->velocity(task);
}

double BetweenFrames::misfit(const Task& task) const {
  return inside_->misfit(task);
}

double BetweenFrames::best_factor(const Task& task) const {
  return inside_->best_factor(task);
}

VectorField colour_between(const VectorField& first, const VectorField& second, const FieldBetween& between,
                           const Task& task) {
  constexpr size_t kCovered = 3;  // beside the three components: 1 where there is a colour
  const auto fields = [&](const VectorField& colour) {
    std::array<ScalarField, 4> all;
    std::vector<ivec3> blocks;
    VoxelBox box;
    for (size_t c = 0; c < 3; ++c) {
      const BrickGrid& part = colour.bricks.parts[c];
      all[c].bricks = part;
      if (part.empty()) continue;
      enclose(box, {part.origin() + ivec3(part.support_lo()) + 1, part.origin() + ivec3(part.support_hi()) - 1});
      part.each_cell([&](const ivec3& cell) { blocks.push_back(part.origin() + kCell * cell); });
    }
    if (!box.empty())
      all[kCovered].bricks = build_over(
          box, blocks,
          [&](const ivec3& lo, float* values) {
            std::array at{VoxelReader(all[0].bricks), VoxelReader(all[1].bricks), VoxelReader(all[2].bricks)};
            each_of_brick(
                lo, [&](const ivec3& v) { *values++ = at[0](v) != 0 || at[1](v) != 0 || at[2](v) != 0 ? 1.0f : 0.0f; });
          },
          quiet(task));
    for (ScalarField& field : all) {
      field.world_from_index = colour.world_from_index;
      field.summary.box = box;
    }
    return all;
  };
  const std::array<ScalarField, 4> a = fields(first), b = fields(second);
  std::array<ScalarField, 4> mixed;
  for (size_t c = 0; c < mixed.size(); ++c) mixed[c] = between(a[c], b[c]);
  VectorField result;
  result.notes = first.notes;
  result.world_from_index = mixed[kCovered].world_from_index;
  const BrickGrid& covered = mixed[kCovered].bricks;
  if (covered.empty()) return result;
  std::vector<ivec3> blocks;
  covered.each_cell([&](const ivec3& cell) { blocks.push_back(covered.origin() + kCell * cell); });
  for (size_t c = 0; c < 3; ++c)
    result.bricks.parts[c] = build_over(
        mixed[kCovered].summary.box, blocks,
        [&](const ivec3& lo, float* values) {
          VoxelReader part(mixed[c].bricks), share(covered);
          each_of_brick(lo, [&](const ivec3& v) {
            constexpr float kFaint = 1e-3f;
            *values++ = share(v) > kFaint ? part(v) / share(v) : 0.0f;
          });
        },
        quiet(task));
  return result;
}

}  // namespace brume
