// Frames between frames: closed forms of moving and spreading densities, withheld frames of a simulation, and totals.

#include "volume/between_frames.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

/// A field of a function in a box of voxels, one voxel being one world unit.
ScalarField field_of(const VoxelBox& box, const std::function<double(const dvec3&)>& value,
                     const dmat4& world_from_index = dmat4(1)) {
  ScalarField field;
  field.world_from_index = world_from_index;
  field.summary.box = box;
  field.bricks = test::make_bricks(box, [&](const ivec3& v) {
    return static_cast<float>(value(dvec3(world_from_index * glm::dvec4(dvec3(v), 1.0))));
  });
  return field;
}

/// A velocity that is known everywhere in a box.
StoredVelocity velocity_of(const VoxelBox& box, const std::function<dvec3(const dvec3&)>& value) {
  StoredVelocity velocity;
  velocity.name = "velocity";
  for (int c = 0; c < 3; ++c) {
    StoredVelocity::Component& component = velocity.components[static_cast<size_t>(c)];
    component.box = box;
    component.values = test::make_bricks(box, [&](const ivec3& v) { return static_cast<float>(value(dvec3(v))[c]); });
    component.stored = test::constant_box(box.lo, box.hi);
  }
  return velocity;
}

double voxel(const ScalarField& field, const ivec3& v) {
  return static_cast<double>(field.bricks.empty() ? 0.0f : field.bricks.voxel(v - field.bricks.origin()));
}

/// Calls visit(v) for the voxels of a box.
template <class Visit>
void each_voxel(const VoxelBox& box, const Visit& visit) {
  for (int x = box.lo.x; x <= box.hi.x; ++x)
    for (int y = box.lo.y; y <= box.hi.y; ++y)
      for (int z = box.lo.z; z <= box.hi.z; ++z) visit(ivec3(x, y, z));
}

double total(const ScalarField& field, const VoxelBox& box) {
  double sum = 0;
  each_voxel(box, [&](const ivec3& v) { sum += voxel(field, v); });
  return sum * std::abs(glm::determinant(dmat3(field.world_from_index)));
}

double smooth_ball(const dvec3& p, double radius) {
  return std::exp(-glm::dot(p, p) / (radius * radius));
}

const VoxelBox kWide{ivec3(-24), ivec3(24)};
const VoxelBox kBall{ivec3(-16), ivec3(16)};

TEST(BetweenFrames, ABallIsWhereItMovesTo) {
  const dvec3 move(5, -3, 2);
  const VoxelBox reached{kBall.lo + ivec3(0, -3, 0), kBall.hi + ivec3(5, 0, 2)};
  const ScalarField first = field_of(kBall, [](const dvec3&p) { return smooth_ball(p, 5); }),
                    second = field_of(reached, [&](const dvec3&p) { return 1.5 * smooth_ball(p - move, 5); });
  const StoredVelocity velocity = velocity_of(kWide, [&](const dvec3&) { return move / 2.0; });
  for (const double share : {0.0, 0.3, 0.5, 1.0}) {
    std::vector<std::string> notes;
    const BetweenFrames between(first, velocity, second, velocity, {.share = share, .frames = 1, .scale = 2}, notes);
    const ScalarField density = between.density();
    EXPECT_TRUE(notes.empty());
    double worst = 0;
    each_voxel(reached, [&](const ivec3& v) {
      const double expected = (1 + 0.5 * share) * smooth_ball(dvec3(v) - share * move, 5);
      worst = std::max(worst, std::abs(voxel(density, v) - expected));
    });
    // Cubic interpolation of this ball between voxels errs by up to 0.004; a blend of the two frames by 0.5.
    EXPECT_LT(worst, 0.008) << share;
    const double expected = (1 - share) * total(first, kWide) + share * total(second, kWide);
    EXPECT_NEAR(total(density, kWide) / expected, 1, 1e-5) << share;
    EXPECT_LT(between.misfit(), 0.9);
  }
}

// A flow away from the middle by a tenth of the distance per frame thins a density and changes no temperature.
TEST(BetweenFrames, WhatSpreadsThins) {
  constexpr double kRate = 0.4, kRadius = 4;
  const double wider = std::exp(kRate), thinner = std::exp(-3 * kRate);
  const ScalarField first = field_of(kWide, [](const dvec3&p) { return smooth_ball(p, kRadius); }),
                    second = field_of(kWide, [&](const dvec3&p) { return thinner * smooth_ball(p, kRadius * wider); }),
                    hot_first = field_of(kBall, [](const dvec3&p) { return glm::length(p) < 6 ? 700.0 : 0.0; }),
                    hot_second =
                        field_of(kBall, [&](const dvec3&p) { return glm::length(p) < 6 * wider ? 700.0 : 0.0; });
  const StoredVelocity velocity = velocity_of(kWide, [](const dvec3& p) { return kRate * p; });
  std::vector<std::string> notes;
  const TimeBetween middle{.share = 0.5};
  const ScalarField density = BetweenFrames(first, velocity, second, velocity, middle, notes).density();
  for (const ivec3& v : {ivec3(0), ivec3(5, 0, 0), ivec3(-3, 6, 2)}) {
    const double expected = std::sqrt(thinner) * smooth_ball(dvec3(v), kRadius * std::sqrt(wider));
    EXPECT_NEAR(voxel(density, v), expected, 0.01);
  }
  const ScalarField hot = BetweenFrames(hot_first, velocity, hot_second, velocity, middle, notes).intensity();
  EXPECT_NEAR(voxel(hot, ivec3(0)), 700, 1e-3);
  EXPECT_NEAR(voxel(hot, ivec3(0, 6, 0)), 700, 1e-3) << "beyond the first frame's ball, which has grown";
  EXPECT_NEAR(voxel(hot, ivec3(0, 9, 0)), 0, 1e-3);
}

TEST(BetweenFrames, WithoutVelocitiesFramesAreMixed) {
  const ScalarField first = field_of(kBall, [](const dvec3&p) { return smooth_ball(p, 5); }),
                    second = field_of(kBall, [](const dvec3&p) { return smooth_ball(p - dvec3(6, 0, 0), 4); });
  const ScalarField density = BetweenFrames(first, second, {.share = 0.25}).density();
  each_voxel(kBall, [&](const ivec3& v) {
    ASSERT_NEAR(voxel(density, v), 0.75 * voxel(first, v) + 0.25 * voxel(second, v), 1e-6);
  });
}

// The second frame has voxels of half the size, elsewhere in index space: they are those of what is between.
TEST(BetweenFrames, LatticesMayDiffer) {
  const dmat4 fine = test::translation(dvec3(3, 0, -1)) * test::scaling(dvec3(0.5));
  const VoxelBox fine_box{ivec3(-28), ivec3(28)};
  const auto value = [](const dvec3& p) { return smooth_ball(p, 4); };
  const dvec3 move(4, 0, 0);
  const ScalarField first = field_of(kBall, value), second = field_of(
                                                        fine_box, [&](const dvec3&p) { return value(p - move); }, fine);
  const StoredVelocity velocity = velocity_of(kWide, [&](const dvec3&) { return move; });
  std::vector<std::string> notes;
  const ScalarField density = BetweenFrames(first, velocity, second, velocity, {.share = 0.5}, notes).density();
  EXPECT_EQ(density.world_from_index, fine);
  for (const dvec3& p : {dvec3(2, 0, 0), dvec3(5, 1, -3), dvec3(0, 0.5, 3)}) {
    const ivec3 v(glm::round(dvec3(glm::inverse(fine) * glm::dvec4(p, 1.0))));
    const dvec3 there(fine * glm::dvec4(dvec3(v), 1.0));
    EXPECT_NEAR(voxel(density, v), value(there - 0.5 * move), 0.01);
  }
  EXPECT_NEAR(total(density, {ivec3(-60), ivec3(60)}),
              0.5 * (total(first, kWide) + total(second, {ivec3(-44), ivec3(44)})), 1);
}

TEST(BetweenFrames, AFrameWithoutAnythingFadesIn) {
  const ScalarField none, ball = field_of(kBall, [](const dvec3&p) { return smooth_ball(p, 5); });
  const StoredVelocity velocity = velocity_of(kWide, [](const dvec3&) { return dvec3(2, 0, 0); });
  std::vector<std::string> notes;
  const ScalarField density = BetweenFrames(none, {}, ball, velocity, {.share = 0.5}, notes).density();
  EXPECT_NEAR(voxel(density, ivec3(-1, 0, 0)), 0.5, 1e-3) << "half of it, on its way";
  EXPECT_TRUE(BetweenFrames(none, {}, none, {}, {.share = 0.5}, notes).density().bricks.empty());
}

TEST(BetweenFrames, AWrongUnitOfVelocityIsFound) {
  const dvec3 move(5, 1, 0);
  const ScalarField first = field_of(kBall, [](const dvec3&p) { return smooth_ball(p, 4); }),
                    second = field_of(kBall, [&](const dvec3&p) { return smooth_ball(p - move, 4); });
  const StoredVelocity velocity = velocity_of(kWide, [&](const dvec3&) { return 24.0 * move; });
  std::vector<std::string> notes;
  const BetweenFrames by_second(first, velocity, second, velocity, {.share = 0.5, .scale = 0.1}, notes);
  EXPECT_GT(by_second.misfit(), 1);
  EXPECT_NEAR(0.1 * by_second.best_factor() * 24, 1, 0.2);
}

TEST(BetweenFrames, AColourKeepsItsHueToItsEdge) {
  const auto painted = [&](const dvec3& at, const dvec3& colour) {
    VectorField field;
    for (int c = 0; c < 3; ++c)
      field.bricks.parts[static_cast<size_t>(c)] = test::make_bricks(
          kBall, [&](const ivec3& v) { return glm::length(dvec3(v) - at) < 6 ? static_cast<float>(colour[c]) : 0.0f; });
    return field;
  };
  const dvec3 colour(0.9, 0.5, 0.1);
  const VectorField first = painted(dvec3(0), colour), second = painted(dvec3(8, 0, 0), colour);
  const VectorField still = colour_between(first, second, [](const ScalarField& a, const ScalarField& b) {
    return BetweenFrames(a, b, {.share = 0.5}).intensity();
  });
  const auto at = [&](const ivec3& v) { return still.bricks.lookup(dvec3(v - still.bricks.parts[0].origin())); };
  for (const ivec3& v : {ivec3(-4, 0, 0), ivec3(4, 0, 0), ivec3(12, 0, 0)})
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(at(v)[c], colour[c], 1e-5);
  EXPECT_EQ(at(ivec3(0, 12, 0)), dvec3(0));
}

// Frames of a simulation that are withheld, two and four frames apart from those that they are made of. At most 0.6 of
// the error of a linear blend over neighbours; what is reached is 0.40 .. 0.46.
TEST(BetweenFrames, WithheldFramesAreMetBetterThanByABlend) {
  if (test::shared("volumes/sequence").empty()) GTEST_SKIP() << "needs ../shared";
  const auto file = [](int frame) { return test::shared(fmt::format("volumes/sequence/smoke_seq_{:04}.vdb", frame)); };
  const VoxelBox box{ivec3(0), ivec3(63)};
  const auto rms = [&](const ScalarField& a, const ScalarField& b) {
    double sum = 0;
    each_voxel(box, [&](const ivec3& v) { sum += std::pow(voxel(a, v) - voxel(b, v), 2); });
    return std::sqrt(sum);
  };
  const auto share_of_error = [&](const char* grid, int frame, int apart) {
    const ScalarOptions options{.grid = grid};
    const int before = frame - apart / 2, after = frame + apart / 2;
    const ScalarField first = load_scalar(file(before), options), second = load_scalar(file(after), options),
                      truth = load_scalar(file(frame), options);
    const StoredVelocity first_velocity = load_velocity(file(before), "velocity"),
                         second_velocity = load_velocity(file(after), "velocity");
    std::vector<std::string> notes;
    const TimeBetween time{.share = 0.5, .frames = 1.0 * apart, .scale = 0.068 * 0.0375};
    const BetweenFrames between(first, first_velocity, second, second_velocity, time, notes);
    const bool density = std::string(grid) == "density";
    const ScalarField made = density ? between.density() : between.intensity();
    if (density) {
      EXPECT_NEAR(total(made, {ivec3(-32), ivec3(95)}) / (0.5 * (total(first, box) + total(second, box))), 1, 1e-5);
      EXPECT_LT(between.misfit(), 1);
    }
    return rms(made, truth) / rms(BetweenFrames(first, second, time).intensity(), truth);
  };
  EXPECT_LT(share_of_error("density", 23, 2), 0.5);
  EXPECT_LT(share_of_error("density", 36, 2), 0.5);
  EXPECT_LT(share_of_error("temperature", 29, 2), 0.6);
  EXPECT_LT(share_of_error("density", 30, 4), 0.62);
}

}  // namespace
}  // namespace brume
