#include "render/world/lights.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/rng.h"
#include "base/running_statistics.h"
#include "image/exr_io.h"
#include "render/world/sky.h"
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

// The irradiance of a square lamp on a facing plane right below its middle is a closed form; samples, densities and
// intersections agree; nothing comes from behind.
TEST(RectangleLight, IrradianceIsTheClosedForm) {
  LightSettings settings;
  settings.type = "rectangle";
  settings.position = {0, 0, 2}, settings.edge_x = {0, 2, 0}, settings.edge_y = {2, 0, 0};
  settings.radiance = dvec3(3);
  const RectangleLight light(settings, dvec3(0));
  // Form factor of a parallel rectangle over its corner, four times: sides a = b = 1 at distance 2.
  const double a = 0.5, root = std::sqrt(1 + a * a);
  const double factor = 4 * (1 / (2 * kPi)) * 2 * (a / root * std::atan(a / root));
  Rng rng(4);
  RunningStatistics e, found;
  for (int i = 0; i < 200000; ++i) {
    const LightSample l = light.sample(dvec3(0), {rng.uniform(), rng.uniform()});
    const Ray ray{dvec3(0), l.wi};
    ASSERT_NEAR(light.intersect(ray), l.distance, 1e-9);
    ASSERT_NEAR(light.pdf(ray, l.distance), l.pdf, 1e-9 * l.pdf);
    e.add(l.radiance.x * l.wi.z / l.pdf);
    // And by directions that know nothing of the lamp.
    const dvec3 d = test::random_direction(rng);
    const double t = light.intersect({dvec3(0), d});
    found.add(t > 0 ? light.radiance({dvec3(0), d}, t).x * std::max(0.0, d.z) * 4 * kPi : 0.0);
  }
  EXPECT_NEAR(e.mean, 3 * kPi * factor, 5 * std::sqrt(e.mean_variance()) + 1e-6);
  EXPECT_NEAR(found.mean, 3 * kPi * factor, 5 * std::sqrt(found.mean_variance()));
  EXPECT_EQ(light.sample(dvec3(0, 0, 5), {0.3, 0.6}).radiance, dvec3(0)) << "its back is black";
}

TEST(PointLight, FallsOffWithTheSquareAndSpotsFade) {
  LightSettings settings;
  settings.type = "point";
  settings.position = {0, 0, 3}, settings.intensity = {9, 18, 0};
  const LightSample at = PointLight(settings, dvec3(0)).sample(dvec3(0), {0.1, 0.2});
  EXPECT_TRUE(at.delta);
  EXPECT_NEAR(glm::distance(at.radiance, dvec3(1, 2, 0)), 0, 1e-12);
  settings.type = "spot";
  settings.direction = {0, 0, -1}, settings.cone_angle = 60, settings.cone_softness = 0.5;
  const PointLight spot(settings, dvec3(0));
  EXPECT_NEAR(spot.sample(dvec3(0), {0, 0}).radiance.x, 1, 1e-12);
  EXPECT_EQ(spot.sample(dvec3(3, 0, 0), {0, 0}).radiance, dvec3(0)) << "45 degrees off the axis";
  const double faded = spot.sample(dvec3(3 * std::tan(22 * kPi / 180), 0, 0), {0, 0}).radiance.x;
  EXPECT_GT(faded, 0.05);
  EXPECT_LT(faded, 0.8);
  // With the cosine to its axis, too.
  settings.cosine_falloff = true;
  const PointLight cosine(settings, dvec3(0));
  EXPECT_NEAR(cosine.sample(dvec3(0), {0, 0}).radiance.x, 1, 1e-12);
  for (const double degrees : {10.0, 22.0}) {
    const dvec3 p(3 * std::tan(degrees * kPi / 180), 0, 0);
    const double plain = spot.sample(p, {0, 0}).radiance.x;
    EXPECT_NEAR(cosine.sample(p, {0, 0}).radiance.x, plain * std::cos(degrees * kPi / 180), 1e-12);
  }
}

// With many lights, one of them is chosen by what it would give at the point: probabilities sum to 1, and the estimate
// of the sum of all is right where each light is met.
TEST(Lights, ChoiceFollowsTheEstimatedContribution) {
  Scene scene;
  for (int i = 0; i < 40; ++i) {
    LightSettings l;
    l.type = i % 2 ? "sphere" : "point";
    l.position = {std::cos(0.7 * i) * (1 + 0.3 * i), std::sin(0.7 * i) * (1 + 0.3 * i), 0.2 * (i % 7)};
    l.radius = 0.05;
    l.radiance = dvec3(20);
    l.intensity = dvec3(1 + i % 3);
    scene.lights.push_back(l);
  }
  scene.lights.push_back(sun_settings(1));
  Lights lights(scene, dvec3(0));
  lights.finish("auto");
  ASSERT_EQ(lights.choice().count(), 41u);
  const dvec3 p(0.4, 0.1, 0.3);
  double sum = 0, exact = 0;
  for (const SphereLight* light : [&] {
         std::vector<const SphereLight*> spheres;
         for (const FiniteLight* f : lights.finite()) spheres.push_back(static_cast<const SphereLight*>(f));
         return spheres;
       }()) {
    sum += lights.choice().probability(*light, p);
    exact += 20 / light->pdf(p);
  }
  for (const PointLight* light : lights.points()) {
    sum += lights.choice().probability(*light, p);
    exact += light->sample(p, {0, 0}).radiance.x;
  }
  sum += lights.choice().probability(*lights.suns()[0], p);
  exact += lights.suns()[0]->disc_radiance().x / lights.suns()[0]->pdf(lights.suns()[0]->axis());
  EXPECT_NEAR(sum, 1, 1e-12);
  Rng rng(5);
  RunningStatistics s;
  for (int i = 0; i < 100000; ++i) {
    const double choice = rng.uniform(), u = rng.uniform();
    const LightSample l = lights.choice().sample(p, choice, {u, rng.uniform()});
    s.add(l.radiance.x / l.pdf);
  }
  EXPECT_NEAR(s.mean, exact, 5 * std::sqrt(s.mean_variance()));
  EXPECT_LT(std::sqrt(s.sample_variance()), 1.5 * exact) << "lights are chosen by what they give";
}

// Preetham's zenith luminance, a brighter ring around the sun, a sky bluer than its sun.
TEST(Sky, IsPreethams) {
  EnvironmentSettings settings;
  settings.sky = "preetham";
  settings.turbidity = 3;
  settings.radiance = dvec3(1);
  settings.sun_direction = {std::sin(0.8), 0, std::cos(0.8)};
  const Environment sky(settings);
  const double chi = (4.0 / 9 - 3.0 / 120) * (kPi - 1.6);
  const double zenith = (4.0453 * 3 - 4.9710) * std::tan(chi) - 0.2155 * 3 + 2.4192;
  EXPECT_NEAR(luminance(sky.radiance(dvec3(0, 0, 1))), zenith, 0.02 * zenith);
  const dvec3 near_sun = glm::normalize(settings.sun_direction), opposite(-near_sun.x, 0, near_sun.z);
  EXPECT_GT(luminance(sky.radiance(near_sun)), 2 * luminance(sky.radiance(opposite)));
  const dvec3 blue = sky.radiance(dvec3(0, 0, 1));
  EXPECT_GT(blue.z, 1.2 * blue.x);
  const LightSettings sun = preetham_sun(settings);
  EXPECT_GT(sun.irradiance.x, sun.irradiance.z);
  EXPECT_GT(luminance(sun.irradiance), 50) << "tens of klux";
  EXPECT_LT(luminance(sun.irradiance), 128);
  const dvec3 ground = sky.radiance(dvec3(0.1, 0.3, -0.9));
  EXPECT_NEAR(ground.y, sky.radiance(dvec3(-0.5, 0.3, -0.6)).y, 1e-6);
  settings.sky_sun = false;
  const dvec3 shaded = Environment(settings).radiance(dvec3(0.1, 0.3, -0.9));
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(ground[c] - shaded[c], settings.ground_albedo * sun.irradiance[c] * std::cos(0.8) / kPi, 1e-5);
}

// Texels that are no light count as black, infinite ones as the brightest; sampling is right for what is left.
TEST_F(LatLong, TexelsThatAreNoLightAreCountedAndTold) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const auto plain = [](int x, int y) { return dvec3(1 + x, 1 + y, 3); };
  const Environment env = load(32, 16, [&](int x, int y) {
    if (x == 3) return dvec3(-0.0001, y == 2 ? -kInfinity : 1, std::nan(""));
    return x == 9 && y == 9 ? dvec3(kInfinity, 2, 2) : plain(x, y);
  });
  const Environment meant = load(32, 16, [&](int x, int y) {
    if (x == 3) return dvec3(0, y == 2 ? 0 : 1, 0);
    return x == 9 && y == 9 ? dvec3(32, 2, 2) : plain(x, y);
  });
  ASSERT_EQ(env.notes().size(), 2u);
  EXPECT_NE(env.notes()[0].find("env.exr: 16 NaN values and 17 negative values became 0"), std::string::npos)
      << env.notes()[0];
  EXPECT_NE(env.notes()[1].find("1 infinite value became the largest finite one, 32"), std::string::npos);
  EXPECT_TRUE(meant.notes().empty());
  Rng rng(8);
  for (int i = 0; i < 1000; ++i) {
    const dvec3 d = test::random_direction(rng);
    ASSERT_EQ(env.radiance(d), meant.radiance(d));
    ASSERT_EQ(env.pdf(d), meant.pdf(d));
    const dvec2 u(rng.uniform(), rng.uniform());
    ASSERT_EQ(env.sample(u).wi, meant.sample(u).wi);
  }
}

// Of a cube map whose faces have a colour each, +Z is where the middle of a lat-long picture is, +Y up, +X left.
TEST_F(LatLong, CubeMapsAreTakenAsOpenExrLaysThemOut) {
  constexpr int kSize = 16;
  Layers cube(kSize, 6 * kSize);
  const auto rgb = cube.add_rgb(layer::beauty);
  for (int y = 0; y < 6 * kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      for (size_t c = 0; c < 3; ++c) (*rgb[c])(x, y) = static_cast<float>(1 + y / kSize);
  cube.header["envmap"] = std::string("cube");
  write_exr(folder_ / "cube.exr", cube);
  EnvironmentSettings s;
  s.file = folder_ / "cube.exr";
  s.radiance = dvec3(1);
  const Environment env(s);
  const std::pair<dvec3, double> faces[] = {{{-1, 0, 0}, 1}, {{1, 0, 0}, 2}, {{0, 0, 1}, 3},
                                            {{0, 0, -1}, 4}, {{0, 1, 0}, 5}, {{0, -1, 0}, 6}};
  for (const auto& [d, value] : faces) EXPECT_NEAR(env.radiance(d).x, value, 1e-6) << d.x << ' ' << d.y << ' ' << d.z;
  ASSERT_EQ(env.notes().size(), 1u);
  EXPECT_NE(env.notes()[0].find("is a cube map"), std::string::npos);
}

// One texel of 1e6 in a dim sky: found by light sampling, said in the notes, and no path of a picture turns it into a
// firefly that the mean cannot bear.
TEST_F(LatLong, OneTexelOfAMillionIsSampledAndSaid) {
  const Environment sky = load(64, 32, [](int x, int y) { return dvec3(x == 20 && y == 5 ? 1e6 : 0.1); });
  ASSERT_EQ(sky.notes().size(), 1u);
  EXPECT_NE(sky.notes()[0].find("one texel holds"), std::string::npos);
  Rng rng(6);
  RunningStatistics s;
  for (int i = 0; i < 20000; ++i) {
    const double u = rng.uniform();
    const LightSample l = sky.sample({u, rng.uniform()});
    s.add(l.radiance.x / l.pdf);
  }
  EXPECT_NEAR(s.mean / (4 * sky.importance(dvec3(0))), 1, 0.15) << "up to the bilinear skirt of the texel";
  EXPECT_LT(std::sqrt(s.sample_variance()), 3 * s.mean);
}

}  // namespace
}  // namespace brume
