#include "render/lights.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/rng.h"
#include "base/running_statistics.h"
#include "image/exr_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

LightSettings sun_settings(double diameter) {
  LightSettings s;
  s.type = "sun";
  s.direction = {0.3, -0.5, 0.8};
  s.irradiance = dvec3(3);
  s.angular_diameter = diameter;
  return s;
}

TEST(Sun, AFacingPlaneGetsItsIrradiance) {
  Rng rng(1);
  for (const double diameter : {0.001, 0.53, 20.0, 170.0}) {
    const Sun sun(sun_settings(diameter));
    const dvec3 axis = glm::normalize(dvec3(0.3, -0.5, 0.8));
    RunningStatistics s;
    for (int i = 0; i < 200000; ++i) {
      const LightSample l = sun.sample({rng.uniform(), rng.uniform()});
      s.add(l.radiance.x * glm::dot(l.wi, axis) / l.pdf);
    }
    EXPECT_NEAR(s.mean, 3.0, 5 * std::sqrt(s.mean_variance()) + 1e-6) << diameter;
    EXPECT_TRUE(sun.contains(axis));
    EXPECT_FALSE(sun.contains(-axis));
  }
  const LightSample parallel = Sun(sun_settings(0)).sample({0.3, 0.7});
  EXPECT_TRUE(parallel.delta);
  EXPECT_EQ(parallel.radiance, dvec3(3));
}

// Irradiance of a ball: pi L (R / d)^2 on a plane that faces it, from outside at any distance.
TEST(SphereLight, IrradianceIsTheClosedForm) {
  Rng rng(2);
  for (const double distance : {1.01, 1.5, 5.0, 1e4, 1e8}) {
    LightSettings s;
    s.type = "sphere";
    s.position = dvec3(0, 0, distance);
    s.radius = 1;
    s.radiance = dvec3(2);
    const SphereLight light(s, dvec3(0));
    const double exact = kPi * 2 / (distance * distance);
    RunningStatistics e;
    for (int i = 0; i < 100000; ++i) {
      const LightSample l = light.sample(dvec3(0), {rng.uniform(), rng.uniform()});
      EXPECT_NEAR(l.pdf, light.pdf(dvec3(0)), 1e-12 * l.pdf);
      EXPECT_NEAR(l.distance, light.intersect({dvec3(0), l.wi}) > 0 ? light.intersect({dvec3(0), l.wi}) : l.distance,
                  1e-6 * distance);
      e.add(l.radiance.x * std::max(0.0, l.wi.z) / l.pdf);
    }
    EXPECT_NEAR(e.mean / exact, 1.0, 5 * std::sqrt(e.mean_variance()) / exact + 1e-7) << distance;
  }
  LightSettings inside;
  inside.position = dvec3(0.2, 0, 0);
  inside.radius = 1;
  inside.radiance = dvec3(1);
  EXPECT_NEAR(SphereLight(inside, dvec3(0)).pdf(dvec3(0)), 1 / (4 * kPi), 1e-12);
  EXPECT_NEAR(SphereLight(inside, dvec3(0)).intersect({dvec3(0), dvec3(1, 0, 0)}), 1.2, 1e-12);
}

class LatLong : public ::testing::Test {
 protected:
  Environment load(int width, int height, const std::function<dvec3(int, int)>& texel, double rotation = 0,
                   const dvec3& up = {0, 0, 1}) {
    Layers picture(width, height);
    const auto rgb = picture.add_rgb(layer::beauty);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) (*rgb[static_cast<size_t>(c)])(x, y) = static_cast<float>(texel(x, y)[c]);
    write_exr(folder_ / "env.exr", picture);
    EnvironmentSettings s;
    s.file = folder_ / "env.exr";
    s.radiance = dvec3(1);
    s.rotation = rotation;
    s.up = up;
    return Environment(s);
  }
  test::TemporaryFolder folder_;
};

TEST_F(LatLong, OrientationIsAsDocumented) {
  const Environment env = load(64, 32, [](int x, int y) { return dvec3(x, y, 1); });
  const auto at = [](const Environment& e, const dvec3& d) { return e.radiance(glm::normalize(d)); };
  EXPECT_NEAR(at(env, {0, 0, 1}).y, 0, 0.5);
  EXPECT_NEAR(at(env, {0, 0, -1}).y, 31, 0.5);
  EXPECT_NEAR(at(env, {0, 1, 0}).x, 31.5, 0.01) << "the middle faces +y";
  EXPECT_NEAR(at(env, {1, 0, 0}).x, 47.5, 0.01) << "right of the middle is +x";
  const Environment turned = load(
      64, 32, [](int x, int y) { return dvec3(x, y, 1); }, 90);
  EXPECT_NEAR(at(turned, {-1, 0, 0}).x, 31.5, 0.01) << "a quarter turn counter-clockwise brings the middle to -x";
  const Environment y_up = load(64, 32, [](int x, int y) { return dvec3(x, y, 1); }, 0, {0, 1, 0});
  EXPECT_NEAR(at(y_up, {0, 0, -1}).x, 31.5, 0.01);
  EXPECT_NEAR(at(y_up, {0, 1, 0}).y, 0, 0.5);
}

TEST_F(LatLong, SamplesFollowTheDensityAndIntegrateTheLight) {
  // A dim sky, a bright spot over the seam, one black band.
  const Environment env = load(
      32, 16,
      [](int x, int y) { return y == 9              ? dvec3(0)
                                : x == 31 && y == 4 ? dvec3(500, 400, 300)
                                                    : dvec3(1, 2, 3); }, 33);
  Rng rng(3);
  RunningStatistics light, uniform, mass;
  for (int i = 0; i < 400000; ++i) {
    const LightSample l = env.sample({rng.uniform(), rng.uniform()});
    ASSERT_NEAR(glm::length(l.wi), 1, 1e-9);
    ASSERT_GT(l.pdf, 0);
    light.add(luminance(l.radiance) / l.pdf);
    const dvec3 d = test::random_direction(rng);
    uniform.add(luminance(env.radiance(d)) * 4 * kPi);
    mass.add(env.pdf(d) * 4 * kPi);
  }
  EXPECT_NEAR(mass.mean, 1, 5 * std::sqrt(mass.mean_variance())) << "the density integrates to 1";
  EXPECT_NEAR(light.mean, uniform.mean, 5 * std::sqrt(light.mean_variance() + uniform.mean_variance()));
  EXPECT_LT(light.sample_variance(), 0.2 * uniform.sample_variance()) << "importance sampling that pays";
}

TEST_F(LatLong, OneTexelOfAMillionAndABlackPictureAreSurvived) {
  const Environment hot = load(64, 32, [](int x, int y) { return x == 7 && y == 8 ? dvec3(1e6) : dvec3(0.1); });
  Rng rng(4);
  for (int i = 0; i < 10000; ++i) {
    const LightSample l = hot.sample({rng.uniform(), rng.uniform()});
    ASSERT_TRUE(std::isfinite(l.radiance.x / l.pdf));
  }
  EXPECT_TRUE(load(8, 4, [](int, int) { return dvec3(0); }).black());
}

}  // namespace
}  // namespace brume
