// Grids whose voxels fan out from a camera.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/vdb_grids.h"
#include "volume/displacement.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

using openvdb::Vec3d;

constexpr int kSide = 24, kDepth = 40;  // voxels

/// Twice as wide at its far end as at its near one, and ten units deep.
openvdb::math::Transform::Ptr frustum() {
  const auto transform = openvdb::math::Transform::createFrustumTransform(
      openvdb::BBoxd(Vec3d(0), Vec3d(kSide - 1, kSide - 1, kDepth - 1)), 0.5, 10, 0.2);
  transform->postRotate(0.4, openvdb::math::X_AXIS);
  transform->postTranslate(Vec3d(3, -20, 5));
  return transform;
}

double linear(const Vec3d& at) {
  return 20 + 0.5 * at.x() + 0.25 * at.y() - 0.125 * at.z();
}

/// A grid that is linear in the world, in all of the frustum.
template <class Grid>
typename Grid::Ptr filled(const std::string& name, const typename Grid::ValueType& unit) {
  openvdb::initialize();
  auto grid = Grid::create();
  grid->setName(name);
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  grid->setTransform(frustum());
  for (int x = 0; x < kSide; ++x)
    for (int y = 0; y < kSide; ++y)
      for (int z = 0; z < kDepth; ++z) {
        const Vec3d at = grid->indexToWorld(openvdb::Coord(x, y, z));
        using Element = typename openvdb::VecTraits<typename Grid::ValueType>::ElementType;
        grid->tree().setValue({x, y, z}, unit * static_cast<Element>(linear(at)));
      }
  return grid;
}

Vec3d world_of(const dmat4& world_from_index, const ivec3& voxel) {
  const dvec3 at = dvec3(world_from_index[3]) + dmat3(world_from_index) * dvec3(voxel);
  return {at.x, at.y, at.z};
}

/// Calls check(place in the world, voxel) for the voxels of a field that lie well inside the frustum. @return how many
template <class Check>
int each_inside(const dmat4& world_from_index, const BrickGrid& bricks, const Check& check) {
  const auto map = frustum();
  const ivec3 size = ivec3(bricks.support_hi()) + 1;
  int inside = 0;
  for (int x = 0; x < size.x; ++x)
    for (int y = 0; y < size.y; ++y)
      for (int z = 0; z < size.z; ++z) {
        const Vec3d at = world_of(world_from_index, bricks.origin() + ivec3(x, y, z)), index = map->worldToIndex(at);
        if (index.x() < 1 || index.y() < 1 || index.z() < 1 || index.x() > kSide - 2 || index.y() > kSide - 2 ||
            index.z() > kDepth - 2)
          continue;
        ++inside;
        check(at, ivec3(x, y, z));
      }
  return inside;
}

class Frustum : public ::testing::Test {
 protected:
  void write(const openvdb::GridPtrVec& grids) const {
    openvdb::io::File file(path_.string());
    file.write(grids);
    file.close();
  }
  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "frustum.vdb";
};

TEST_F(Frustum, IsSampledOnEqualCubes) {
  write({filled<openvdb::FloatGrid>("density", 1), filled<openvdb::DoubleGrid>("heat", 2)});
  const ScalarField density = load_scalar(path_, {});
  ASSERT_EQ(density.notes.size(), 1u);
  EXPECT_NE(density.notes[0].find("grid 'density': its voxels fan out (a frustum); sampled on equal cubes of"),
            std::string::npos)
      << density.notes[0];
  const int inside = each_inside(density.world_from_index, density.bricks, [&](const Vec3d& at, const ivec3& voxel) {
    ASSERT_NEAR(static_cast<double>(density.bricks.voxel(voxel)), linear(at), 1e-4);
  });
  // Eight times as many as it had, but for its rim.
  const int had = (kSide - 3) * (kSide - 3) * (kDepth - 3);
  EXPECT_NEAR(inside, 8 * had, 0.1 * 8 * had);

  ScalarOptions heat_options;
  heat_options.grid = "heat";
  const ScalarField heat = load_scalar(path_, heat_options);
  EXPECT_EQ(heat.world_from_index, density.world_from_index);
  each_inside(heat.world_from_index, heat.bricks, [&](const Vec3d& at, const ivec3& voxel) {
    ASSERT_NEAR(static_cast<double>(heat.bricks.voxel(voxel)), 2 * linear(at), 2e-4);
  });
}

TEST_F(Frustum, KeepsItsMassAndItsEmptySpace) {
  const auto grid = filled<openvdb::FloatGrid>("density", 1);
  double mass = 0;
  const auto& map = grid->transform();
  for (auto it = grid->beginValueOn(); it; ++it) {
    const Vec3d at = it.getCoord().asVec3d();
    if (it.getCoord().z() < 6 || it.getCoord().z() > 30) {
      it.setValue(0);
      it.setValueOff();
    } else {
      // By differences, as OpenVDB's determinant() of such maps counts depths from index 0.
      const Vec3d x = map.indexToWorld(at + Vec3d(1, 0, 0)) - map.indexToWorld(at),
                  y = map.indexToWorld(at + Vec3d(0, 1, 0)) - map.indexToWorld(at),
                  z = 0.5 * (map.indexToWorld(at + Vec3d(0, 0, 1)) - map.indexToWorld(at - Vec3d(0, 0, 1)));
      mass += static_cast<double>(*it) * std::abs(x.dot(y.cross(z)));
    }
  }
  write({grid});
  const ScalarField field = load_scalar(path_, {});
  const dmat4& m = field.world_from_index;
  const double cube = std::abs(glm::determinant(dmat3(m)));
  double sampled = 0;
  const ivec3 size = ivec3(field.bricks.support_hi()) + 1;
  for (int x = 0; x < size.x; ++x)
    for (int y = 0; y < size.y; ++y)
      for (int z = 0; z < size.z; ++z) sampled += cube * static_cast<double>(field.bricks.voxel({x, y, z}));
  EXPECT_NEAR(sampled, mass, 0.01 * mass);
}

TEST_F(Frustum, ValuesThatAreNotFiniteDoNotSpread) {
  const auto grid = filled<openvdb::FloatGrid>("density", 1);
  grid->tree().setValue({10, 10, 10}, std::numeric_limits<float>::quiet_NaN());
  grid->tree().setValue({12, 10, 10}, std::numeric_limits<float>::infinity());
  write({grid});
  const ScalarField field = load_scalar(path_, {});
  std::string notes;
  for (const std::string& note : field.notes) notes += note + "\n";
  EXPECT_NE(notes.find("1 NaN voxels became 0"), std::string::npos) << notes;
  EXPECT_NE(notes.find("1 infinite voxels became the largest finite value"), std::string::npos) << notes;
  each_inside(field.world_from_index, field.bricks,
              [&](const Vec3d&, const ivec3& voxel) { ASSERT_LT(field.bricks.voxel(voxel), 100.0f); });
}

// A camera's: far narrower in front, shallow in its own units, and cut out of a larger box.
TEST_F(Frustum, CubesAreAsShortAsItsShortestEdgeAndHalfOfTheMeanAtLeast) {
  openvdb::initialize();
  const auto cubes = [&](double taper, double depth) {
    auto grid = openvdb::FloatGrid::create();
    grid->setName("density");
    grid->setTransform(openvdb::math::Transform::createFrustumTransform(
        openvdb::BBoxd(Vec3d(0, 0, 10), Vec3d(19, 19, 39)), taper, depth, 0.1));
    grid->fill({{5, 5, 12}, {15, 15, 38}}, 1);
    write({grid});
    return load_scalar(path_, {}).world_from_index[0][0];
  };
  const auto size = [&](double taper, double depth) {
    const auto transform = openvdb::math::Transform::createFrustumTransform(
        openvdb::BBoxd(Vec3d(0, 0, 10), Vec3d(19, 19, 39)), taper, depth, 0.1);
    constexpr int kSteps = 2900;
    double sum = 0, shortest = 1e30;
    for (int i = 0; i <= kSteps; ++i) {
      const Vec3d at(9.5, 9.5, 10 + 29.0 * i / kSteps);  // on the axis, where edges are at right angles
      const auto edge = [&](const Vec3d& of) {
        return 1e3 * (transform->indexToWorld(at + 5e-4 * of) - transform->indexToWorld(at - 5e-4 * of)).length();
      };
      sum += edge({1, 0, 0}) * edge({0, 1, 0}) * edge({0, 0, 1});
      shortest = std::min({shortest, edge({1, 0, 0}), edge({0, 0, 1})});
    }
    return std::max(shortest, 0.5 * std::cbrt(sum / (kSteps + 1)));
  };
  for (const double taper : {0.9, 0.5, 0.05})
    for (const double depth : {0.5, 20.0})
      EXPECT_NEAR(cubes(taper, depth), size(taper, depth), 0.05 * size(taper, depth));
}

TEST_F(Frustum, TilesAndBackgroundsStayInside) {
  openvdb::initialize();
  auto grid = openvdb::FloatGrid::create(0.5f);
  grid->setName("density");
  grid->setTransform(frustum());
  grid->fill({{2, 2, 2}, {20, 20, 36}}, 1);
  grid->tree().addTile(1, {8, 8, 8}, 2, true);
  write({grid});
  const ScalarField field = load_scalar(path_, {});
  const auto map = frustum();
  const ivec3 size = ivec3(field.bricks.support_hi()) + 1;
  int outside = 0;
  for (int x = 0; x < size.x; ++x)
    for (int y = 0; y < size.y; ++y)
      for (int z = 0; z < size.z; ++z) {
        const Vec3d at = map->worldToIndex(world_of(field.world_from_index, field.bricks.origin() + ivec3(x, y, z)));
        const float value = field.bricks.voxel({x, y, z});
        if (at.x() < 2 || at.y() < 2 || at.z() < 2 || at.x() > 20 || at.y() > 20 || at.z() > 36) {
          ++outside;
          ASSERT_EQ(value, 0.0f) << at;
        } else if (at.x() > 9 && at.x() < 14 && at.y() > 9 && at.y() < 14 && at.z() > 9 && at.z() < 14) {
          ASSERT_EQ(value, 2.0f) << at;
        } else {
          ASSERT_GT(value, 0.4f) << at;
        }
      }
  EXPECT_GT(outside, 100);
}

TEST_F(Frustum, FarFromTheOriginToo) {
  auto grid = filled<openvdb::FloatGrid>("density", 1);
  grid->transform().postTranslate(Vec3d(4.5e9, 0, -2e9));
  write({grid});
  const ScalarField field = load_scalar(path_, {});
  EXPECT_GT(field.summary.active_voxels, grid->activeVoxelCount());
}

TEST_F(Frustum, ComponentsOnFacesMoveToTheMiddle) {
  const auto grid = filled<openvdb::Vec3SGrid>("v", openvdb::Vec3s(1));
  grid->setGridClass(openvdb::GRID_STAGGERED);
  write({grid});
  const StoredVelocity velocity = load_velocity(path_, "v");
  for (int c = 0; c < 3; ++c) EXPECT_EQ(velocity.components[static_cast<size_t>(c)].shift, dvec3(0));
}

TEST_F(Frustum, VectorsToo) {
  write({filled<openvdb::FloatGrid>("density", 1), filled<openvdb::Vec3SGrid>("Cd", openvdb::Vec3s(1, 0.5f, 0.25f))});
  const VectorField colour = load_colour(path_, "Cd");
  EXPECT_EQ(colour.world_from_index, load_scalar(path_, {}).world_from_index);
  for (size_t c = 0; c < 3; ++c)
    each_inside(colour.world_from_index, colour.bricks.parts[c], [&](const Vec3d& at, const ivec3& voxel) {
      ASSERT_NEAR(static_cast<double>(colour.bricks.parts[c].voxel(voxel)), linear(at) / (1 << c), 1e-4);
    });
}

}  // namespace
}  // namespace brume
