// Velocities on the lattice of the density that they move: nothing is lost, and what is absurd ends.

#include "volume/displacement.h"

#include <gtest/gtest.h>

#include "tests/support/vdb_files.h"
#include "volume/medium.h"

namespace brume {
namespace {

using test::holds;
using test::write;

/// Balls of density, some voxels apart, each with a velocity of its own.
struct MovingBalls {
  static constexpr double kVoxel = 0.25, kRadius = 7.3;  // of a voxel; in voxels
  std::vector<dvec3> centres, velocities;                // voxels, world units per unit of time

  float density(const dvec3& v) const {
    double sum = 0;
    for (const dvec3& c : centres) sum += std::max(0.0, 1 - glm::distance(v, c) / kRadius);
    return static_cast<float>(sum);
  }
  openvdb::Vec3s velocity(const dvec3& v) const {
    size_t nearest = 0;
    for (size_t i = 1; i < centres.size(); ++i)
      if (glm::distance(v, centres[i]) < glm::distance(v, centres[nearest])) nearest = i;
    const dvec3& found = velocities[nearest];
    return openvdb::Vec3s(static_cast<float>(found.x), static_cast<float>(found.y), static_cast<float>(found.z));
  }
  template <class Visit>
  void each_voxel(int margin, const Visit& visit) const {
    for (const dvec3& c : centres)
      for (int x = -9 - margin; x <= 9 + margin; ++x)
        for (int y = -9 - margin; y <= 9 + margin; ++y)
          for (int z = -9 - margin; z <= 9 + margin; ++z) visit(ivec3(glm::floor(c)) + ivec3(x, y, z));
  }
  openvdb::FloatGrid::Ptr density_grid() const {
    openvdb::initialize();
    auto grid = openvdb::FloatGrid::create();
    grid->setName("density");
    grid->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel));
    each_voxel(0, [&](const ivec3& v) {
      if (const float d = density(dvec3(v)); d > 0) grid->tree().setValue({v.x, v.y, v.z}, d);
    });
    return grid;
  }
  /// The velocity where a voxel's density exceeds a limit. @param zeros  whether voxels around it are stored as 0
  openvdb::Vec3SGrid::Ptr velocity_grid(float limit = 0, bool zeros = false) const {
    openvdb::initialize();
    auto grid = openvdb::Vec3SGrid::create();
    grid->setName("vel");
    grid->setTransform(openvdb::math::Transform::createLinearTransform(kVoxel));
    if (zeros) each_voxel(12, [&](const ivec3& v) { grid->tree().setValue({v.x, v.y, v.z}, openvdb::Vec3s(0.0f)); });
    each_voxel(0, [&](const ivec3& v) {
      if (density(dvec3(v)) > limit) grid->tree().setValue({v.x, v.y, v.z}, velocity(dvec3(v)));
    });
    return grid;
  }
  /// Expects what is displaced at times of the shutter to be all of the density, each ball where it has moved to.
  void expect_moved(const ScalarField& field, const Displacement& displacement, double scale, double tolerance,
                    const std::string& what) const {
    Medium medium(field.bricks, field.world_from_index, 1, dvec3(1), 0);
    medium.set_displacement(displacement);
    for (const double time : {0.0, 0.25, 0.5, 1.0}) {
      const Medium now = medium.at_time(time);
      const double frames = displacement.open + (displacement.close - displacement.open) * time;
      for (size_t i = 0; i < centres.size(); ++i) {
        const dvec3 moved = centres[i] + velocities[i] * scale * frames / kVoxel;
        double mass = 0, expected = 0;
        dvec3 place(0);
        for (int x = -10; x <= 10; ++x)
          for (int y = -10; y <= 10; ++y)
            for (int z = -10; z <= 10; ++z) {
              const dvec3 v(x, y, z);
              const double d = now.density(now.to_local((moved + v) * kVoxel));
              mass += d;
              place += d * v;
              expected += std::max(0.0, 1 - glm::length(v) / kRadius);
            }
        EXPECT_NEAR(mass / expected, 1, tolerance) << what << ", ball " << i << ", time " << time;
        EXPECT_LT(glm::length(place / mass), 10 * tolerance) << what << ", ball " << i << ", time " << time;
      }
    }
  }
};

TEST(LoadDisplacement, NoDensityIsLostWhereVelocityIsStoredOnlyInIt) {
  const test::TemporaryFolder folder;
  const MovingBalls one{{dvec3(3.5, -2, 11)}, {dvec3(2, -0.75, 0.5)}};
  const MovingBalls two{{dvec3(-12, 0, 0), dvec3(14, 3, 1)}, {dvec3(-1.5, 1, 0), dvec3(2, 0.5, -1)}};
  const auto check = [&](const MovingBalls& balls, const openvdb::GridPtrVec& velocity, double tolerance,
                         const std::string& what) {
    openvdb::GridPtrVec grids = {balls.density_grid()};
    grids.insert(grids.end(), velocity.begin(), velocity.end());
    write(folder / "v.vdb", grids);
    const ScalarField density = load_scalar(folder / "v.vdb", {});
    for (const double scale : {1.0, 2.0, 6.0}) {
      std::vector<std::string> notes;
      const Displacement d = load_displacement(folder / "v.vdb", "", density, {scale, 0.0, 1.0}, notes);
      EXPECT_TRUE(notes.empty()) << notes[0];
      balls.expect_moved(density, d, scale, tolerance, what + ", scale " + std::to_string(scale));
    }
    std::vector<std::string> notes;
    balls.expect_moved(density, load_displacement(folder / "v.vdb", "", density, {1.0, -0.5, 0.5}, notes), 1.0,
                       tolerance, what + ", around the frame");
  };
  for (const MovingBalls* balls : {&one, &two}) {
    const std::string of = balls == &one ? " of one" : " of two";
    check(*balls, {balls->velocity_grid()}, 0.005, "velocity where there is density" + of);
    check(*balls, {balls->velocity_grid(0.1f)}, 0.005, "velocity where there is more than a tenth" + of);
    check(*balls, {balls->velocity_grid(0, true)}, 0.005, "zeros stored around" + of);
  }
  auto staggered = one.velocity_grid();
  staggered->setGridClass(openvdb::GRID_STAGGERED);
  check(one, {staggered}, 0.005, "staggered");

  // A lattice of its own, twice as coarse.
  auto coarse = openvdb::Vec3SGrid::create();
  coarse->setName("velocity");
  coarse->setTransform(openvdb::math::Transform::createLinearTransform(2 * MovingBalls::kVoxel));
  one.each_voxel(0, [&](const ivec3& v) {
    if (one.density(dvec3(v)) > 0) coarse->tree().setValue({v.x >> 1, v.y >> 1, v.z >> 1}, one.velocity(dvec3(v)));
  });
  check(one, {coarse}, 0.005, "a coarse lattice");

  // Vectors of doubles, and three grids by the names that programs give them.
  auto doubles = openvdb::Vec3DGrid::create();
  doubles->setName("v");
  doubles->setTransform(coarse->transform().copy());
  for (auto it = coarse->cbeginValueOn(); it; ++it) doubles->tree().setValue(it.getCoord(), openvdb::Vec3d(*it));
  check(one, {doubles}, 0.005, "doubles");
  for (const std::string name : {"vel.x", "velocity_X", "vx"}) {
    openvdb::GridPtrVec parts;
    for (int c = 0; c < 3; ++c) {
      auto part = openvdb::FloatGrid::create();
      part->setName(name.substr(0, name.size() - 1) + static_cast<char>(name.back() + c));
      part->setTransform(openvdb::math::Transform::createLinearTransform(MovingBalls::kVoxel));
      const auto whole = one.velocity_grid();
      for (auto it = whole->cbeginValueOn(); it; ++it) part->tree().setValue(it.getCoord(), (*it)[c]);
      parts.push_back(part);
    }
    check(one, parts, 0.005, name);
  }
}

// What stands still beside what moves is left where it is: density without a velocity has none.
TEST(LoadDisplacement, DensityWithoutVelocityStandsStill) {
  const test::TemporaryFolder folder;
  const MovingBalls balls{{dvec3(-12, 0, 0), dvec3(14, 3, 1)}, {dvec3(-1.5, 1, 0), dvec3(0)}};
  const auto velocity = balls.velocity_grid();
  for (auto it = velocity->beginValueOn(); it; ++it)
    if (*it == openvdb::Vec3s(0.0f)) it.setValueOff();
  write(folder / "v.vdb", {balls.density_grid(), velocity});
  const ScalarField density = load_scalar(folder / "v.vdb", {});
  std::vector<std::string> notes;
  const Displacement d = load_displacement(folder / "v.vdb", "", density, {1.0, 0.0, 1.0}, notes);
  balls.expect_moved(density, d, 1.0, 0.005, "one stands");
}

TEST(LoadDisplacement, MadVelocitiesEndWithANote) {
  const test::TemporaryFolder folder;
  const MovingBalls ball{{dvec3(0)}, {dvec3(1e7, 3, 0)}};
  write(folder / "v.vdb", {ball.density_grid(), ball.velocity_grid()});
  const ScalarField density = load_scalar(folder / "v.vdb", {});
  std::vector<std::string> notes;
  const Displacement d = load_displacement(folder / "v.vdb", "", density, {1.0, 0.0, 1.0}, notes);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_TRUE(holds(notes[0], "grid 'vel' moves the density by up to 4e+07 voxels")) << notes[0];
  EXPECT_LT(d.field.bytes() + d.envelope.bytes(), 200e6);

  // Neighbours that fly apart to all sides may arrive anywhere around.
  const MovingBalls storm{{dvec3(0), dvec3(5, 0, 0), dvec3(0, 5, 5)},
                          {dvec3(300, -200, 100), dvec3(-200, 300, -300), dvec3(100, 0, 300)}};
  write(folder / "s.vdb", {storm.density_grid(), storm.velocity_grid()});
  notes.clear();
  const Displacement wild =
      load_displacement(folder / "s.vdb", "", load_scalar(folder / "s.vdb", {}), {1.0, -0.5, 0.5}, notes);
  ASSERT_EQ(notes.size(), 1u);
  EXPECT_TRUE(holds(notes[0], "it is followed for")) << notes[0];
  EXPECT_LT(wild.field.bytes() + wild.envelope.bytes(), 1e9);
}

}  // namespace
}  // namespace brume
