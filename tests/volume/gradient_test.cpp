#include "volume/gradient.h"

#include <gtest/gtest.h>

#include "tests/support/volumes.h"

namespace brume {
namespace {

// A linear field in the world: its gradient is known under any affine map, sheared and mirrored ones too.
TEST(DensityGradient, IsTheWorldGradientUnderAnyAffineTransform) {
  Rng rng(1);
  for (int i = 0; i < 50; ++i) {
    const dmat4 m = test::random_affine(rng);
    const dvec3 slope = 0.01 * test::random_direction(rng);
    const BrickGrid grid = test::make_bricks({{0, 0, 0}, {20, 20, 20}}, [&](const ivec3& v) {
      return static_cast<float>(5 + glm::dot(slope, dvec3(m * glm::dvec4(dvec3(v), 1.0))));
    });
    const Medium medium(grid, m, 1, dvec3(1), 0);
    const dvec3 p = test::random_point(rng, dvec3(4), dvec3(16));
    const auto g = density_gradient(medium, p - dvec3(grid.origin()));
    ASSERT_TRUE(g);
    EXPECT_LT(glm::distance(*g, slope), 2e-3 * glm::length(slope));
  }
}

TEST(DensityGradient, IsUndefinedWhereTheMediumIsFlat) {
  const BrickGrid grid = test::constant_box({0, 0, 0}, {30, 30, 30});
  const Medium medium(grid, dmat4(1.0), 1, dvec3(1), 0);
  EXPECT_FALSE(density_gradient(medium, dvec3(15.2) - dvec3(grid.origin())));
  // Four voxels from the wall the widened stencil sees it.
  const auto g = density_gradient(medium, dvec3(27.5, 15, 15) - dvec3(grid.origin()));
  ASSERT_TRUE(g);
  EXPECT_LT(glm::distance(glm::normalize(*g), dvec3(-1, 0, 0)), 1e-6);
}

TEST(FindSurface, MeetsASphereWhereItsDensityPassesIso) {
  const double radius = 12;
  const BrickGrid grid = test::make_bricks({{0, 0, 0}, {40, 40, 40}}, [&](const ivec3& v) {
    return static_cast<float>(std::max(0.0, 1 - glm::distance(dvec3(v), dvec3(20)) / radius));
  });
  const Medium medium(grid, test::scaling(dvec3(0.1)), 1, dvec3(1), 0);
  Rng rng(2);
  for (int i = 0; i < 200; ++i) {
    const dvec3 d = test::random_direction(rng);
    const Ray world{dvec3(2.0) - 7.0 * d, d};
    const auto t = find_isosurface(medium, medium.to_local(world), 0.25f);
    ASSERT_TRUE(t);
    EXPECT_NEAR(glm::distance(world.at(*t), dvec3(2.0)), 0.75 * radius * 0.1, 0.01);
    const auto g = density_gradient(medium, medium.to_local(world.at(*t + 0.05)));
    ASSERT_TRUE(g);
    EXPECT_GT(glm::dot(glm::normalize(*g), d), 0.99) << "the gradient points inwards, along a ray through the centre";
  }
  EXPECT_FALSE(find_isosurface(medium, medium.to_local(Ray{dvec3(-1, -1, 0), dvec3(0, 0, 1)}), 0.25f));
  EXPECT_EQ(find_isosurface(medium, medium.to_local(Ray{dvec3(2), dvec3(0, 0, 1)}), 0.25f), 0.0) << "a camera inside";
}

}  // namespace
}  // namespace brume
