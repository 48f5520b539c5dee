#include <fmt/format.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/Prune.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <type_traits>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "volume/vdb/leaves.h"
#include "volume/vdb/reading.h"

// Grids whose voxels fan out from a camera, as programs make them for what one shot sees.

namespace brume::vdb {
namespace {

using openvdb::Coord;
using openvdb::CoordBBox;
using openvdb::Vec3d;

/// How many voxels of the new grid there may be for each of the old one, in the mean.
constexpr double kMoreVoxels = 8;

/// The volume of a voxel. The map's own determinant() counts its depth from index 0, not from the near plane.
double voxel_volume(const openvdb::math::NonlinearFrustumMap& map, const Vec3d& at) {
  const auto edge = [&](int axis) {
    Vec3d unit(0);
    unit[axis] = 1;
    return map.applyJacobian(unit, at);
  };
  return std::abs(edge(0).dot(edge(1).cross(edge(2))));
}

/// The edge of the cubes that stand for a frustum's voxels, from its map alone, so that all grids of one map have the
/// same: as short as the shortest edge of its voxels, but half of the cubic root of their mean volume at least.
double edge_of_cubes(const openvdb::math::NonlinearFrustumMap& map) {
  const openvdb::BBoxd& box = map.getBBox();
  const Vec3d middle = box.getCenter();
  const Vec3d front(middle.x(), middle.y(), box.min().z()), back(middle.x(), middle.y(), box.max().z());
  double shortest = std::numeric_limits<double>::infinity();
  for (const Vec3d& at : {front, back})
    for (const int axis : {0, 1, 2}) {
      Vec3d unit(0);
      unit[axis] = 1;
      shortest = std::min(shortest, map.applyJacobian(unit, at).length());
    }
  // Simpson's rule, which is exact: areas grow by the square of the depth.
  const double mean = (voxel_volume(map, front) + 4 * voxel_volume(map, middle) + voxel_volume(map, back)) / 6;
  return std::max(shortest, std::cbrt(mean / kMoreVoxels));
}

template <class Value>
bool is_finite(const Value& value) {
  if constexpr (openvdb::VecTraits<Value>::IsVec)
    return std::isfinite(value[0]) && std::isfinite(value[1]) && std::isfinite(value[2]);
  else
    return std::isfinite(value);
}

/// Replaces values that are not finite by 0, so that they do not spread. @return how many
template <class Grid>
uint64_t zero_what_is_not_finite(Grid& grid) {
  uint64_t found = 0;
  for (auto it = grid.beginValueOn(); it; ++it)
    if (!is_finite(*it)) {
      it.setValue(openvdb::zeroVal<typename Grid::ValueType>());
      found += it.getVoxelCount();
    }
  return found;
}

/// Samples one grid at the voxels of another.
template <class Grid>
class Sampling {
 public:
  Sampling(const std::filesystem::path& path, const Grid& from, Grid& to)
      : path_(path), from_(from), to_(to), leaves_(to.getAccessor()) {
    // As in other grids a background counts inside the box of the active voxels.
    if (from.background() != openvdb::zeroVal<Value>()) filled_ = from.evalActiveVoxelBoundingBox();
  }

  void run(const Task& task) {
    if (filled_) {
      add_leaves(*filled_, task);
    } else {
      for (auto leaf = from_.tree().cbeginLeaf(); leaf; ++leaf) add_leaves(leaf->getNodeBoundingBox(), task);
      for (auto tile = tiles_of(from_.tree().cbeginValueOn()); tile; ++tile) add_leaves(tile.getBoundingBox(), task);
    }
    std::vector<Leaf*> leaves;
    to_.tree().getNodes(leaves);
    parallel_for(static_cast<int>(leaves.size()), {task.threads, {}, task.cancel},
                 [&](int i) { fill(*leaves[static_cast<size_t>(i)]); });
    openvdb::tools::pruneInactive(to_.tree());
  }

 private:
  using Leaf = typename Grid::TreeType::LeafNodeType;
  using Value = typename Grid::ValueType;
  static constexpr int kSide = Leaf::DIM;

  /// The voxels that may see those of a box: as straight edges stay straight, what lies between its eight corners.
  CoordBBox seen(const CoordBBox& box) const {
    CoordBBox found;
    for (int k = 0; k < 8; ++k) {
      const Coord &lo = box.min(), &hi = box.max();
      const Vec3d corner(k & 1 ? hi.x() + 1 : lo.x() - 1, k & 2 ? hi.y() + 1 : lo.y() - 1,
                         k & 4 ? hi.z() + 1 : lo.z() - 1);
      const Vec3d at = to_.worldToIndex(from_.indexToWorld(corner));
      if (!(std::max({std::abs(at.x()), std::abs(at.y()), std::abs(at.z())}) < 1 << 30))
        fail(path_, fmt::format("grid '{}' has voxels far outside of its frustum, whose place has no number",
                                from_.getName()));
      found.expand(Coord::floor(at));
      found.expand(Coord::ceil(at));
    }
    return found;
  }

  /// Makes the leaves that see a box, which is halved until little else lies between its corners.
  void add_leaves(const CoordBBox& box, const Task& task) {
    const CoordBBox around = seen(box);
    if (around.dim()[around.maxExtent()] > 2 * kSide && box.volume() > 1) {
      const auto axis = static_cast<int>(box.maxExtent());
      CoordBBox near = box, far = box;
      near.max()[axis] = box.min()[axis] + (box.dim()[axis] - 1) / 2;
      far.min()[axis] = near.max()[axis] + 1;
      add_leaves(near, task);
      add_leaves(far, task);
      return;
    }
    const Coord lo = around.min() & ~(kSide - 1), hi = around.max();
    for (int x = lo.x(); x <= hi.x(); x += kSide)
      for (int y = lo.y(); y <= hi.y(); y += kSide)
        for (int z = lo.z(); z <= hi.z(); z += kSide) {
          if (leaves_.probeConstLeaf({x, y, z})) continue;
          leaves_.touchLeaf({x, y, z});
          if (++made_ % 1024 == 0) check(task);
        }
  }

  /// Whether to go on: one half of the memory is for what is made of the grid.
  void check(const Task& task) const {
    task.check();
    const double bytes = static_cast<double>(made_) * static_cast<double>(sizeof(Leaf) + sizeof(Value) * Leaf::SIZE);
    if (2 * bytes > physical_memory())
      fail(path_,
           fmt::format("grid '{}' is a frustum whose voxels need more than {:.1f} GB as equal cubes; this machine "
                       "has {:.1f} GB. Expected fewer voxels: resample it to a uniform grid",
                       from_.getName(), 2 * bytes / 1e9, physical_memory() / 1e9));
  }

  void fill(Leaf& leaf) const {
    const auto values = from_.getConstUnsafeAccessor();
    for (unsigned voxel = 0; voxel < Leaf::SIZE; ++voxel) {
      const Vec3d at = from_.worldToIndex(to_.indexToWorld(leaf.offsetToGlobalCoord(voxel)));
      Value value;
      bool active = false;
      if constexpr (openvdb::VecTraits<Value>::IsVec)
        active = from_.getGridClass() == openvdb::GRID_STAGGERED
                     ? openvdb::tools::StaggeredBoxSampler::sample(values, at, value)
                     : openvdb::tools::BoxSampler::sample(values, at, value);
      else
        active = openvdb::tools::BoxSampler::sample(values, at, value);
      if (filled_) active = openvdb::BBoxd(filled_->min().asVec3d(), filled_->max().asVec3d()).isInside(at);
      if (active) leaf.setValueOn(voxel, value);
    }
  }

  const std::filesystem::path& path_;
  const Grid& from_;
  Grid& to_;
  typename Grid::Accessor leaves_;
  std::optional<CoordBBox> filled_;  ///< where each voxel counts
  size_t made_ = 0;                  ///< leaves
};

}  // namespace

openvdb::GridBase::Ptr with_equal_voxels(const std::filesystem::path& path, const openvdb::GridBase::Ptr& grid,
                                         std::vector<std::string>& notes, const Task& task) {
  if (grid->transform().isLinear()) return grid;
  const auto map = grid->transform().constMap<openvdb::math::NonlinearFrustumMap>();
  if (!map)
    fail(path, fmt::format("grid '{}' has a transform of type {}; expected an affine one or a frustum", grid->getName(),
                           grid->transform().mapType()));
  const double edge = edge_of_cubes(*map);
  if (!(edge > 0) || !std::isfinite(edge))
    fail(path, fmt::format("grid '{}' has a frustum without a volume", grid->getName()));
  const auto transform = openvdb::math::Transform::createLinearTransform(edge);
  transform->postTranslate(map->applyMap(map->getBBox().getCenter()));
  openvdb::GridBase::Ptr result;
  uint64_t not_finite = 0;
  grid->apply<openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Vec3SGrid, openvdb::Vec3DGrid>>(
      [&](auto& from) {
        using Grid = std::decay_t<decltype(from)>;
        not_finite = zero_what_is_not_finite(from);
        const auto to = Grid::create();
        to->insertMeta(from);
        to->setTransform(transform);
        Sampling<Grid>(path, from, *to).run(task);
        // Components of vectors, which may have stood on the faces of voxels, all stand in the middles of the cubes.
        if (from.getGridClass() == openvdb::GRID_STAGGERED) to->setGridClass(openvdb::GRID_UNKNOWN);
        result = to;
      });
  if (!result)
    fail(path, fmt::format("grid '{}' is a frustum of type {}; expected numbers or vectors of floats", grid->getName(),
                           grid->valueType()));
  notes.push_back(fmt::format("grid '{}': its voxels fan out (a frustum); sampled on equal cubes of {:.4g}",
                              grid->getName(), edge));
  if (not_finite)
    notes.push_back(fmt::format("grid '{}': {} values that are not finite became 0", grid->getName(), not_finite));
  return result;
}

}  // namespace brume::vdb
