#include <fmt/format.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/Prune.h>

#include <algorithm>
#include <cmath>
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

/// The edge of the cubes that stand for a frustum's voxels, from its map alone, so that all grids of one map have the
/// same: as short as the shortest edge of its voxels, but half of the cubic root of their mean volume at least.
double edge_of_cubes(const openvdb::math::NonlinearFrustumMap& map) {
  const openvdb::BBoxd& box = map.getBBox();
  const Vec3d middle = box.getCenter();
  const auto at = [&](double z) { return Vec3d(middle.x(), middle.y(), z); };
  const auto volume = [&](const Vec3d& p) { return std::abs(map.determinant(p)); };
  const Vec3d front = map.voxelSize(at(box.min().z())), back = map.voxelSize(at(box.max().z()));
  const double shortest = std::min({front.x(), front.y(), front.z(), back.x(), back.y(), back.z()});
  // Simpson's rule, which is exact: areas grow by the square of the depth.
  const double mean = (volume(at(box.min().z())) + 4 * volume(middle) + volume(at(box.max().z()))) / 6;
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

/// The voxels of `to` that may see voxels of `from` in a box: as straight edges stay straight, those of its eight
/// corners.
CoordBBox seen_box(const openvdb::GridBase& from, const openvdb::GridBase& to, const CoordBBox& box) {
  CoordBBox seen;
  for (int k = 0; k < 8; ++k) {
    const Coord& lo = box.min();
    const Coord& hi = box.max();
    const Vec3d corner(k & 1 ? hi.x() + 1 : lo.x() - 1, k & 2 ? hi.y() + 1 : lo.y() - 1,
                       k & 4 ? hi.z() + 1 : lo.z() - 1);
    const Vec3d at = to.worldToIndex(from.indexToWorld(corner));
    seen.expand(Coord::floor(at));
    seen.expand(Coord::ceil(at));
  }
  return seen;
}

/// Interpolates one grid at the voxels of another, which are active where one of the eight that they lie among is.
template <class Grid>
void sample(const Grid& from, Grid& to, const Task& task) {
  using Leaf = typename Grid::TreeType::LeafNodeType;
  const auto add_leaves = [&](const CoordBBox& box) {
    const CoordBBox seen = seen_box(from, to, box);
    const int size = Leaf::DIM;
    const Coord lo = seen.min() & ~(size - 1), hi = seen.max();
    for (int x = lo.x(); x <= hi.x(); x += size)
      for (int y = lo.y(); y <= hi.y(); y += size)
        for (int z = lo.z(); z <= hi.z(); z += size) to.tree().touchLeaf({x, y, z});
  };
  for (auto leaf = from.tree().cbeginLeaf(); leaf; ++leaf) add_leaves(leaf->getNodeBoundingBox());
  for (auto tile = tiles_of(from.tree().cbeginValueOn()); tile; ++tile) add_leaves(tile.getBoundingBox());
  std::vector<Leaf*> leaves;
  to.tree().getNodes(leaves);
  parallel_for(static_cast<int>(leaves.size()), {task.threads, {}, task.cancel}, [&](int i) {
    Leaf& leaf = *leaves[static_cast<size_t>(i)];
    const auto values = from.getConstUnsafeAccessor();
    for (unsigned voxel = 0; voxel < Leaf::SIZE; ++voxel) {
      const Vec3d at = from.worldToIndex(to.indexToWorld(leaf.offsetToGlobalCoord(voxel)));
      typename Grid::ValueType value;
      if (openvdb::tools::BoxSampler::sample(values, at, value)) leaf.setValueOn(voxel, value);
    }
  });
  openvdb::tools::pruneInactive(to.tree());
}

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
  openvdb::GridBase::Ptr result;
  uint64_t not_finite = 0;
  grid->apply<openvdb::TypeList<openvdb::FloatGrid, openvdb::DoubleGrid, openvdb::Vec3SGrid, openvdb::Vec3DGrid>>(
      [&](auto& from) {
        using Grid = std::decay_t<decltype(from)>;
        // A half more for the tree around them, and as much again for what is made of it.
        const double bytes = 3 * kMoreVoxels * static_cast<double>(from.activeVoxelCount()) *
                             static_cast<double>(sizeof(typename Grid::ValueType));
        if (bytes > physical_memory())
          fail(path, fmt::format("grid '{}' is a frustum whose voxels need {:.1f} GB as equal cubes; this machine has "
                                 "{:.1f} GB. Expected fewer voxels: resample it to a uniform grid",
                                 from.getName(), bytes / 1e9, physical_memory() / 1e9));
        not_finite = zero_what_is_not_finite(from);
        const auto to = Grid::create(from.background());
        to->insertMeta(from);
        to->setTransform(openvdb::math::Transform::createLinearTransform(edge));
        sample(from, *to, task);
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
