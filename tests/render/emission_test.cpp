// What media emit: closed forms, black bodies and ramps.

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "base/text.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/holds.h"
#include "tests/support/media_scenes.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::solid;
using test::through_the_middle;

// Of light that starts evenly inside an absorbing ball, the share that escapes: the power through the surface, seen by
// an orthographic camera that frames the ball, over the power emitted.
TEST(Emission, EscapeProbabilityOfABall) {
  for (const auto& [a, expected] : {std::pair(.5, .707277), {1., .527252}, {2., .332418}, {5., .147001}}) {
    Scene s = through_the_middle(32);
    s.camera.type = "orthographic";
    s.camera.width = 2;
    s.volumes.push_back(solid("sphere", a, 0));
    s.volumes[0].emission = dvec3(1);
    const test::Mean m = test::mean_radiance(PreparedScene(s, {}).render(400, 5, {}).layers);
    // Power out: 4 pi times the mean over the square times its area 4; emitted: 4 pi times the volume.
    const double share = m.value.x * 4 / (4 * kPi / 3), error = m.error.x * 4 / (4 * kPi / 3);
    EXPECT_NEAR(share, expected, 4.5 * error) << a;
    EXPECT_LT(4.5 * error, 0.01 * expected);
  }
}

// Radiance through the centre of a ball that glows and absorbs: Le (1 - exp(-2 sigma R)), noise of the flights only.
TEST(Emission, OfAnAbsorbingBall) {
  for (const double a : {0.1, 1.0, 3.0}) {
    Scene s = through_the_middle();
    s.volumes.push_back(solid("sphere", a, 0.0));
    s.volumes[0].emission = dvec3(a, 2 * a, 0);  // Kirchhoff: sigma_a Le with Le = (1, 2, 0)
    const test::Mean m = test::mean_radiance(PreparedScene(s, {}).render(2000, 3, {}).layers);
    const double exact = 1 - std::exp(-2 * a);
    EXPECT_NEAR(m.value.x, exact, 4.5 * m.error.x + 1e-7) << a;
    EXPECT_NEAR(m.value.y, 2 * exact, 4.5 * m.error.y + 1e-7) << a;
    EXPECT_EQ(m.value.z, 0);
    EXPECT_LT(4.5 * m.error.x, 0.02 * exact);
  }
}

// Emission does not need extinction: a clear ball that glows has the chord's length times its coefficient, without
// noise.
TEST(Emission, WithoutExtinctionHasNoNoise) {
  Scene s = through_the_middle();
  s.volumes.push_back(solid("sphere", 0.0, 0.0));
  s.volumes[0].emission = dvec3(0.7);
  const Layers f = PreparedScene(s, {}).render(4, 1, {}).layers;
  EXPECT_NEAR(f.at("R")(3, 3), 1.4f, 1e-5f);
  EXPECT_LT(f.at("mean_variance.R")(3, 3), 1e-9f);
  EXPECT_EQ(f.at("A")(3, 3), 0.0f);
}

// Equilibrium furnace: a medium in balance with a sky of 1, whatever it is made of, shows 1 everywhere. A grid, an
// overlapping ball, grey and chromatic extinction. 5 standard errors are below 0.6 %.
TEST(Emission, InBalanceWithTheSkyIsInvisible) {
  for (const bool chromatic : {false, true}) {
    Scene s = test::scene_of(test::source("data/volumes/smoke.vdb"), 20, 0.6, 0.3);
    s.environment.radiance = dvec3(1);
    VolumeSettings& v = s.volumes[0];
    if (chromatic) v.sigma_t = dvec3(20, 8, 3);
    v.emission = v.sigma_t * (dvec3(1) - v.albedo);
    VolumeSettings ball = solid("sphere", 0.8, 0.5);
    ball.object_to_world = test::translation(s.camera.look_at);
    ball.emission = ball.sigma_t * 0.5;
    s.volumes.push_back(ball);
    const RenderResult r = PreparedScene(s, {}).render(400, 1, {});
    const test::Mean m = test::mean_radiance(r.layers);
    EXPECT_GT(r.report.counters.tracking.collisions, 100000u);
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(m.value[c], 1.0, 5 * m.error[c]) << (chromatic ? "chromatic" : "grey") << " channel " << c;
      EXPECT_LT(5 * m.error[c], 0.006);
    }
  }
}

TEST(Blackbody, IsColdRedWhiteAndBlue) {
  EXPECT_EQ(blackbody(300), dvec3(0));
  const dvec3 candle = blackbody(1900), day = blackbody(6500), star = blackbody(15000);
  EXPECT_GT(candle.x, 3 * candle.y);
  EXPECT_EQ(candle.z, 0) << "outside of the gamut, clipped";
  EXPECT_NEAR(day.x / day.y, 1.0, 0.08);
  EXPECT_NEAR(day.z / day.y, 1.0, 0.08);
  EXPECT_GT(star.z, star.x);
  // Chromaticities of the CIE 1931 Planckian locus at 2500, 5000 and 10000 K: (x, y) from linear Rec. 709.
  for (const auto& [kelvin, x, y] :
       {std::tuple(2500.0, 0.4770, 0.4137), {5000.0, 0.3451, 0.3516}, {10000.0, 0.2807, 0.2884}}) {
    const dvec3 c = blackbody(kelvin);
    const dvec3 xyz{0.4124564 * c.x + 0.3575761 * c.y + 0.1804375 * c.z,
                    0.2126729 * c.x + 0.7151522 * c.y + 0.0721750 * c.z,
                    0.0193339 * c.x + 0.1191920 * c.y + 0.9503041 * c.z};
    const double sum = xyz.x + xyz.y + xyz.z;
    EXPECT_NEAR(xyz.x / sum, x, 5e-4) << kelvin;
    EXPECT_NEAR(xyz.y / sum, y, 5e-4) << kelvin;
  }
  // In the infrared tail the visible part grows much faster than T^4, far above much slower.
  EXPECT_GT(luminance(blackbody(2000)) / luminance(blackbody(1500)), 20);
}

// Whatever the range of the grid: the hottest voxel of another part of it must not make the glow coarser.
TEST(Emission, OfABlackBodyIsTabulatedToOneInTenThousand) {
  const double reference = luminance(blackbody(6500));
  Rng rng(1);
  for (const double highest : {1000.0, 9999.0, 1e6}) {
    const EmissionRamp ramp = EmissionRamp::of_blackbody(0, 1, highest, 1, true);
    for (int i = 0; i < 3000; ++i) {
      const double kelvin = 500 * std::pow(highest / 500, rng.uniform());
      const dvec3 exact = blackbody(kelvin) / reference, glow = ramp(kelvin);
      ASSERT_LT(max_component(glm::abs(glow - exact)), 1e-4 * max_component(exact)) << kelvin << " of " << highest;
    }
  }
  EXPECT_EQ(EmissionRamp::of_blackbody(1500, 1000, 1, 1, true)(0), dvec3(0)) << "no gas, no glow";
}

TEST(Emission, OfARampIsExactBetweenItsStops) {
  const EmissionRamp ramp = EmissionRamp::of_colours({{0, dvec3(0)}, {0.1, dvec3(1, 2, 3)}, {1000, dvec3(1, 2, 3)}}, 2);
  EXPECT_NEAR(ramp(0.05).y, 2, 1e-12);
  EXPECT_NEAR(ramp(0.1).y, 4, 1e-12);
  EXPECT_NEAR(ramp(7).y, 4, 1e-12);
  EXPECT_NEAR(ramp(2000).z, 6, 1e-12);
  EXPECT_NEAR(ramp(-1).z, 0, 1e-12);
  // Of many stops, too, among them two of one value.
  std::vector<std::pair<double, dvec3>> stops;
  for (int i = 0; i < 200; ++i) stops.emplace_back(0.1 * i * i, dvec3(i, 0.5 * i, 0));
  stops.emplace_back(stops.back().first, dvec3(7));
  stops.emplace_back(stops.back().first + 1, dvec3(7));
  const EmissionRamp fine = EmissionRamp::of_colours(stops, 1);
  for (const double i : {0.0, 0.5, 3.25, 17.0, 150.9, 198.99}) {
    const double at = std::floor(i), between = 0.1 * (at * at + (i - at) * (2 * at + 1));
    EXPECT_NEAR(fine(between).x, i, 1e-9);
  }
  EXPECT_NEAR(fine(1e9).z, 7, 1e-12);
}

// A block that emits by a ramp or by its heat, in grey and in chromatic media, beside a voxel that stretches the grid's
// range.
TEST(Emission, DoesNotDependOnTheRangeOfTheGrid) {
  const test::TemporaryFolder folder;
  const VoxelBox box{{0, 0, 0}, {31, 15, 15}};
  const auto glow = [&](const char* name, float value, float elsewhere, const auto& set) {
    test::write_affine_vdb(folder / name, box, dmat4(1.0), [&](const ivec3& v) {
      return v.x < 16 ? value : v == ivec3(30, 8, 8) ? elsewhere : 0.0f;
    });
    Scene s;
    s.camera.type = "orthographic";
    s.camera.position = dvec3(7.5, 7.5, 40);
    s.camera.look_at = dvec3(7.5, 7.5, 0);
    s.camera.up = dvec3(0, 1, 0);
    s.camera.width = 6;
    s.film.width = s.film.height = 4;
    s.volumes.emplace_back();
    s.volumes[0].file = folder / name;
    s.volumes[0].albedo = dvec3(0);
    set(s.volumes[0]);
    std::array<double, 2> seen{};
    for (const bool grey : {false, true}) {
      s.volumes[0].sigma_t = grey ? dvec3(1e-9) : dvec3(1e-9, 2e-9, 3e-9);
      const PreparedScene prepared(s, LayerRequest::of({"emission"}, true));
      seen[grey] = test::mean_radiance(prepared.render(256, 1).layers, layer::emission).value.x;
    }
    return seen;
  };
  const auto by_ramp = [](VolumeSettings& v) {
    v.flame_grid = "density";
    v.flame_ramp = {{0, 0, 0, 0}, {0.1, 1, 1, 1}, {1000, 1, 1, 1}};
  };
  const auto by_heat = [](VolumeSettings& v) {
    v.temperature_grid = "density";
    v.blackbody_intensity = 1e6;
  };
  // Sixteen voxels of 1, and on either side a tenth of the one in which the value falls to 0 is dimmer.
  for (const double seen : glow("ramp.vdb", 1, 1000, by_ramp)) EXPECT_NEAR(seen, 16.9, 0.02);
  const auto cold = glow("cold.vdb", 1000, 0, by_heat), hot = glow("hot.vdb", 1000, 9999, by_heat);
  for (const size_t grey : {0, 1}) EXPECT_NEAR(hot[grey] / cold[grey], 1, 1e-4);
  EXPECT_NEAR(cold[0] / cold[1], 1, 0.01);
}

TEST(Temperature, OfAFileWithoutFlamesGlowsWhereItIsNamed) {
  const test::TemporaryFolder folder;
  const auto one = [](const ivec3&) { return 1.0f; };
  test::write_grids_vdb(folder / "smoke.vdb", {{0, 0, 0}, {7, 7, 7}},
                        {{"density", one}, {"temperature", one}, {"flame", {}}});
  Scene s = test::scene_of(folder / "smoke.vdb", 10, 0.5, 0);
  s.volumes[0].temperature_scale = 2000;
  s.volumes[0].temperature_grid = "auto";
  const PreparedScene smoke(s, {});
  EXPECT_FALSE(smoke.plan().emission);
  EXPECT_TRUE(test::holds(join(smoke.notes(), "\n"), "grid 'flame' holds no flames"));
  s.volumes[0].temperature_grid = "temperature";
  EXPECT_TRUE(PreparedScene(s, {}).plan().emission);
}

TEST(Temperature, TooColdToGlowIsSaidWithItsRange) {
  Scene s = test::scene_of(test::source("data/volumes/fire.vdb"), 10, 0.5, 0);
  s.volumes[0].temperature_grid = "auto";
  const PreparedScene cold(s, {});
  ASSERT_FALSE(cold.plan().emission);
  bool said = false;
  for (const std::string& note : cold.notes())
    said = said || (note.find("2.99") != std::string::npos && note.find("too cold to glow") != std::string::npos);
  EXPECT_TRUE(said);
  s.volumes[0].temperature_scale = 800;
  const PreparedScene hot(s, {});
  EXPECT_TRUE(hot.plan().emission);
  const test::Mean m = test::mean_radiance(hot.render(50, 1, {}).layers);
  EXPECT_GT(m.value.x, 2 * m.value.y) << "fire is red";
}

}  // namespace
}  // namespace brume
