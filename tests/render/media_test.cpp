// Media beyond one grey grid: homogeneous shapes, overlaps, chromatic extinction, emission, presets, motion.

#include "render/world/media.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "base/error.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

VolumeSettings solid(const char* shape, double sigma_t, double albedo) {
  VolumeSettings v;
  v.shape = shape;
  v.lo = dvec3(-1);
  v.hi = dvec3(1);
  v.sigma_t = dvec3(sigma_t);
  v.albedo = dvec3(albedo);
  return v;
}

/// Looks along +y through the origin with a narrow view.
Scene through_the_middle(int size = 8) {
  Scene s;
  s.film.width = s.film.height = size;
  s.camera.position = dvec3(0, -20, 0);
  s.camera.fov = 0.02;
  return s;
}

/// Looks at a ball of radius 1.2 around the origin.
Scene overview(int size = 24) {
  Scene s = through_the_middle(size);
  s.camera.position = dvec3(2, -9, 3);
  s.camera.fov = 15;
  return s;
}

LightSettings sun(const dvec3& direction, double irradiance, double diameter = 0) {
  LightSettings l;
  l.type = "sun";
  l.direction = direction;
  l.irradiance = dvec3(irradiance);
  l.angular_diameter = diameter;
  return l;
}

// Exact spheres, closed forms and quadrature of docs/methods.md, Closed forms; 64 x 4000 paths: a bias of 1 % (2 % at a
// = 5) would be found.
TEST(HomogeneousMedium, SingleScatteringInASphere) {
  struct Row {
    double a, side, back, forward;
  };
  for (const Row& row : {Row{.5, .034331, .034404, .029275}, Row{1, .033304, .039060, .021539},
                         Row{2, .022542, .039775, .005830}, Row{5, .011159, .039789, .000036}}) {
    const std::pair<dvec3, double> cases[] = {{{0, 0, 1}, row.side}, {{0, -1, 0}, row.back}, {{0, 1, 0}, row.forward}};
    for (const auto& [to_light, expected] : cases) {
      Scene s = through_the_middle();
      s.volumes.push_back(solid("sphere", row.a, 1.0));
      s.lights.push_back(sun(to_light, 1));
      const test::Mean m = test::mean_radiance(
          PreparedScene(s, LayerRequest::of({"single"}, true)).render(4000, 2, {}).layers, layer::single);
      EXPECT_NEAR(m.value.x, expected, 4.5 * m.error.x + 1e-6) << row.a << ", light from " << to_light.y;
      EXPECT_LT(4.5 * m.error.x, 0.02 * expected + 5e-6);
    }
  }
}

// A slab so deep that it has no other side, lit and seen along its normal: w / (8 pi) H(1)^2 (docs/methods.md,
// Closed forms). 256 x 4000 paths: a bias of 1 % would be found.
TEST(HomogeneousMedium, SemiInfiniteSlabs) {
  for (const auto& [albedo, expected] : {std::pair(0.5, .031148), {0.8, .081306}, {0.9, .122572}, {0.99, .240863}}) {
    Scene s = through_the_middle(16);
    s.camera.position = dvec3(0, 0, 100);
    s.camera.up = dvec3(0, 1, 0);
    s.camera.fov = 0.01;
    s.volumes.push_back(solid("box", 1, albedo));
    s.volumes[0].lo = dvec3(-1e6, -1e6, -60);
    s.volumes[0].hi = dvec3(1e6, 1e6, 0);
    s.lights.push_back(sun({0, 0, 1}, 1));
    const test::Mean m = test::mean_radiance(PreparedScene(s, {}).render(4000, 4, {}).layers);
    EXPECT_NEAR(m.value.x, expected, 4.5 * m.error.x + 5e-7) << albedo;
    EXPECT_LT(4.5 * m.error.x, 0.012 * expected);
  }
}

// Without an end: what glows evenly is everywhere as bright as it emits over its absorption, whatever it scatters; of a
// lamp e^-depth arrives, of the sky and of suns nothing.
TEST(HomogeneousMedium, Everywhere) {
  Scene s = through_the_middle();
  s.volumes.push_back(solid("everywhere", 0.2, 0.5));
  s.volumes[0].g = 0.5;
  s.volumes[0].emission = dvec3(0.06);
  s.environment.radiance = dvec3(1000);
  s.lights.push_back(sun({0, 1, 0}, 1000));
  const PreparedScene glow(s, {});
  const test::Mean m = test::mean_radiance(glow.render(2000, 6, {}).layers);
  EXPECT_NEAR(m.value.x, 0.6, 4.5 * m.error.x);
  EXPECT_LT(4.5 * m.error.x, 0.01 * 0.6);
  EXPECT_TRUE(std::any_of(glow.notes().begin(), glow.notes().end(), [](const std::string& note) {
    return note.rfind("a volume is everywhere: no light of the environment or a sun", 0) == 0;
  }));

  s.volumes[0] = solid("everywhere", 0.1, 0);
  LightSettings lamp;
  lamp.type = "sphere";
  lamp.radius = 5;
  lamp.radiance = dvec3(2);
  lamp.position = dvec3(0, 10, 0);
  lamp.visible_to_camera = true;
  s.lights.push_back(lamp);
  EXPECT_NEAR(test::mean_radiance(PreparedScene(s, {}).render(400, 6, {}).layers).value.x, 2 * std::exp(-2.5), 0.02);
}

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

// Swap a narrow camera and a small lamp: what travels between them is the same (docs/methods.md, Closed forms). The
// medium is a real cloud under any transform; each sees the other's cone only.
TEST(Reciprocity, CameraAndLampChangePlaces) {
  const auto transported = [](const dvec3& eye, const dvec3& lamp, int64_t seed) {
    Scene s = test::scene_of(test::source("data/volumes/smoke.vdb"), 12, 0.8, 0.5);
    const dvec3 centre = s.camera.look_at;
    s.camera.position = centre + eye;
    s.camera.fov = 30;
    LightSettings spot;
    spot.type = "spot";
    spot.position = centre + lamp;
    spot.direction = -lamp;
    spot.intensity = dvec3(100);
    spot.cone_angle = 30;
    spot.cone_softness = 0;
    s.lights.push_back(spot);
    s.film.width = s.film.height = 48;
    const Layers f = PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(150, seed, {}).layers;
    // Flux into a cone of 15 degrees around the view: pixels weighted by their solid angle.
    const double half = std::tan(15 * kPi / 180);
    double sum = 0, variance = 0;
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 48; ++x) {
        const double u = ((x + 0.5) / 24 - 1) * half, v = ((y + 0.5) / 24 - 1) * half, r2 = u * u + v * v;
        if (r2 > half * half) continue;
        const double w = 1 / std::pow(1 + r2, 1.5);
        sum += w * f.at("R")(x, y);
        variance += w * w * f.at("mean_variance.R")(x, y);
      }
    return std::pair(sum, std::sqrt(variance));
  };
  const dvec3 a(0.5, -7, 1), b(5, 3.5, 3);
  const auto [there, error_there] = transported(a, b, 1);
  const auto [back, error_back] = transported(b, a, 2);
  EXPECT_GT(there, 0);
  // The rim of the cone falls on whole pixels: 1 % for that.
  EXPECT_NEAR(there, back, 4.5 * std::hypot(error_there, error_back) + 0.01 * there);
  EXPECT_LT(4.5 * std::hypot(error_there, error_back), 0.05 * there);
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

// Each channel of a chromatic medium is the monochrome medium with that channel's coefficients; here they differ by 16,
// and none of them may be so noisy that the test says nothing.
TEST(ChromaticMedium, EachChannelIsItsMonochromeRun) {
  const dvec3 sigma(8, 2, 0.5), albedo(0.9, 0.99, 0.5);
  Scene s = overview();
  s.environment.radiance = dvec3(0.3);
  s.lights.push_back(sun({-0.5, -0.6, 0.7}, 2, 2));
  s.volumes.push_back(solid("sphere", 1, 1));
  s.volumes[0].sigma_t = sigma;
  s.volumes[0].albedo = albedo;
  s.volumes[0].g = 0.4;
  const auto render = [&](int64_t seed) {
    return PreparedScene(s, LayerRequest::of({"direct", "indirect", "transmittance"}, true))
        .render(600, seed, {})
        .layers;
  };
  const Layers all = render(1);
  for (int c = 0; c < 3; ++c) {
    s.volumes[0].sigma_t = dvec3(sigma[c]);
    s.volumes[0].albedo = dvec3(albedo[c]);
    const Layers one = render(2 + c);
    for (const LayerName& l : {layer::direct, layer::indirect, layer::transmittance}) {
      const test::Mean m = test::mean_radiance(all, l), n = test::mean_radiance(one, l);
      const double error = std::hypot(m.error[c], n.error[c]);
      EXPECT_NEAR(m.value[c], n.value[c], 4.5 * error) << l.label() << " channel " << c;
      EXPECT_LT(4.5 * error, 0.05 * n.value[c] + 1e-3) << l.label() << " channel " << c;
    }
  }
}

// Alpha is the mean of the colours' opacities, not one of them: of a box that red passes nearly whole, and blue hardly.
TEST(ChromaticMedium, AlphaIsTheMeanOfTheColours) {
  Scene s = through_the_middle();
  s.environment.radiance = dvec3(1);
  s.volumes.push_back(solid("box", 1, 0.5));
  s.volumes[0].sigma_t = dvec3(0.05, 0.5, 2);
  const Layers frame = PreparedScene(s, LayerRequest::of({"transmittance"}, true)).render(400, 1, {}).layers;
  const RgbPlanes left = frame.rgb(layer::transmittance);
  double mean = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const double alpha = frame.at("A")(x, y);
      EXPECT_NEAR(alpha, 1 - ((*left[0])(x, y) + (*left[1])(x, y) + (*left[2])(x, y)) / 3.0, 1e-6) << x << ", " << y;
      mean += alpha / (frame.width() * frame.height());
    }
  EXPECT_NEAR(mean, 1 - (std::exp(-0.1) + std::exp(-1.0) + std::exp(-4.0)) / 3, 0.01);
}

// Colours of light never run away: albedo 1 in every channel and a sky of 1 give 1 on average, and no sample above 3,
// since the balance heuristic over the hero channels bounds the weights by their number.
TEST(ChromaticMedium, WeightsStayBounded) {
  Scene s = test::scene_of(test::source("data/volumes/cloud.vdb"), 1, 1, 0.6);
  s.volumes[0].sigma_t = dvec3(30, 10, 1);
  s.environment.radiance = dvec3(1);
  const PreparedScene prepared(s, {});
  const test::Mean m = test::mean_radiance(prepared.render(400, 1, {}).layers);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(m.value[c], 1.0, 5 * m.error[c]) << c;
  for (int x = 0; x < 24; ++x)
    for (uint32_t k = 0; k < 200; ++k) {
      const PathSample sample = prepared.replay(5, x, 12, k);
      EXPECT_LE(max_component(sample.beauty), 3.0 + 1e-9);
    }
}

// Two copies of half the density on top of each other are one medium (docs/methods.md, Closed forms), also when the
// other half is a homogeneous ball in two parts.
TEST(SeveralMedia, SuperpositionIsOneMedium) {
  Scene s = test::scene_of(test::source("data/volumes/smoke.vdb"), 20, 0.8, 0.5);
  s.environment.radiance = dvec3(0.2, 0.3, 0.5);
  s.lights.push_back(sun({-0.5, -0.6, 0.7}, 3, 0.5));
  const Layers one = PreparedScene(s, {}).render(300, 1, {}).layers;
  s.volumes[0].sigma_t = dvec3(13);
  s.volumes.push_back(s.volumes[0]);
  s.volumes[1].sigma_t = dvec3(7);
  const Layers two = PreparedScene(s, {}).render(300, 2, {}).layers;
  for (const LayerName& l : {layer::direct, layer::indirect, layer::transmittance}) {
    const test::Mean a = test::mean_radiance(one, l), b = test::mean_radiance(two, l);
    EXPECT_NEAR(a.value.x, b.value.x, 4.5 * std::hypot(a.error.x, b.error.x)) << l.label();
    EXPECT_LT(4.5 * b.error.x, 0.04 * a.value.x) << l.label();
  }
}

// Volumes of one file are read once; all that is done with its grids, motion and fire too, is as of files apart.
TEST(SeveralMedia, EqualFilesAreReadOnce) {
  const test::TemporaryFolder folder;
  Scene s = test::scene_of(test::source("data/volumes/fire.vdb"), 3, 0.5, 0.2);
  s.film.width = s.film.height = 16;
  s.volumes[0].flame_grid = "auto";
  s.volumes.push_back(s.volumes[0]);
  s.volumes[1].object_to_world[3] = glm::dvec4(1, 0.5, 0, 1);
  s.volumes[1].sigma_t = dvec3(1);
  Scene apart = s;
  apart.volumes[1].file = folder / "copy.vdb";
  std::filesystem::copy_file(s.volumes[0].file, apart.volumes[1].file);
  EXPECT_EQ(SceneMedia(s, {}).parts().size(), 2u);
  EXPECT_EQ(SceneMedia(apart, {}).parts().size(), 4u);
  for (Scene* scene : {&s, &apart}) {
    scene->camera.shutter = dvec2(0, 0.001);
    scene->volumes[0].velocity_grid = scene->volumes[1].velocity_grid = "auto";
  }
  test::expect_same_bits(PreparedScene(s, {}).render(4, 1, {}).layers,
                         PreparedScene(apart, {}).render(4, 1, {}).layers);
}

// The flash image: the direct component plus a lamp's share that makes up for the indirect light that is left out.
TEST(Flash, MakesUpForTheIndirectLight) {
  Scene s = read_scene(test::source("data/scenes/cloud.toml"));
  s.film.width = s.film.height = 48;
  const Layers f = PreparedScene(s, LayerRequest::of({"direct", "indirect", "flash"}, true)).render(32, 1, {}).layers;
  const test::Mean flash = test::mean_radiance(f, layer::flash), direct = test::mean_radiance(f, layer::direct),
                   indirect = test::mean_radiance(f, layer::indirect);
  EXPECT_NEAR(flash.value.y - direct.value.y, indirect.value.y, 0.15 * indirect.value.y);
  EXPECT_GT(*f.number("flashIntensity"), 0);
  EXPECT_LT(flash.error.y, std::hypot(direct.error.y, indirect.error.y))
      << "the lamp is less noisy than what it replaces";
}

TEST(Flash, ReliefIsWhatIsAskedFor) {
  Scene s = read_scene(test::source("data/scenes/cloud.toml"));
  s.film.width = s.film.height = 40;
  // The lamp's part, over what every path with a scattering would bring without any relief.
  const auto lamp = [&](const std::string& relief) {
    s.render.flash_relief = relief;
    const Layers f = PreparedScene(s, LayerRequest::of({"direct", "indirect", "flash", "scatter_share"}, false))
                         .render(16, 1, {})
                         .layers;
    std::vector<double> values;
    for (int y = 0; y < 40; ++y)
      for (int x = 0; x < 40; ++x)
        if (const double share = f.at(layer::scatter_share.channel(0))(x, y); share > 0.9)
          values.push_back((f.at("flash.G")(x, y) - f.at("direct.G")(x, y)) / share / *f.number("flashIntensity"));
    double mean = 0, squares = 0;
    for (const double v : values) mean += v / static_cast<double>(values.size());
    for (const double v : values) squares += (v - mean) * (v - mean) / static_cast<double>(values.size());
    return std::pair(mean, std::sqrt(squares) / mean);
  };
  const auto none = lamp("none"), falloff = lamp("falloff"), gradient = lamp("gradient"), both = lamp("both"),
             offset = lamp("offset");
  EXPECT_LT(none.second, 1e-4) << "a plain lamp shows opacity only";
  EXPECT_GT(falloff.second, 0.02) << "depth";
  EXPECT_NEAR(falloff.first, none.first, 0.3 * none.first) << "1 in the middle of the medium";
  EXPECT_GT(gradient.second, 0.02);
  EXPECT_LT(gradient.first, none.first) << "shading takes light away";
  EXPECT_NEAR(both.first, gradient.first, 0.3 * none.first);
  EXPECT_LT(offset.first, 0.8 * both.first) << "the medium is in the lamp's way";
  EXPECT_GT(offset.second, both.second) << "shadows";
}

TEST(Presets, AreTheirToolsCoefficients) {
  const test::TemporaryFolder folder;
  const auto volume = [&](const std::string& keys) {
    test::write_file(folder / "s.toml",
                     "[camera]\nposition = [0, -5, 0]\nlook_at = [0, 0, 0]\n[[volumes]]\nshape = \"box\"\n" + keys);
    return read_scene(folder / "s.toml").volumes[0];
  };
  // sigma_s = density color, sigma_a = density (1 - color) (1 - sqrt(absorption_color)).
  const VolumeSettings p = volume("preset = \"principled\"\ndensity = 4\ncolor = 0.5\nabsorption_color = 0.25\n");
  EXPECT_NEAR(p.sigma_t.x, 4 * (0.5 + 0.5 * 0.5), 1e-12);
  EXPECT_NEAR(p.albedo.x, 0.5 / 0.75, 1e-12);
  // transparent is what is left after its depth at density 1.
  const VolumeSettings a = volume(
      "preset = \"standard_volume\"\ndensity = 2\ntransparent = 0.5\ntransparent_depth = 3\n"
      "scatter = 0.8\nscatter_color = [1, 0.5, 0]\n");
  EXPECT_NEAR(std::exp(-a.sigma_t.y * 3 / 2), 0.5, 1e-12);
  EXPECT_NEAR(a.albedo.y, 0.4, 1e-12);
  const VolumeSettings rounded = volume("sigma_s = [15.84, 15.84, 16.28]\nsigma_a = [6.16, 6.159999, 5.72]\n");
  EXPECT_EQ(rounded.sigma_t.x, rounded.sigma_t.y) << "numbers that add up but for their rounding are one extinction";
  EXPECT_EQ(rounded.sigma_t.x, rounded.sigma_t.z);
  const VolumeSettings parts = volume("sigma_a = 1\nsigma_s = [3, 0, 1]\n");
  EXPECT_EQ(parts.sigma_t, dvec3(4, 1, 2));
  EXPECT_EQ(parts.albedo, dvec3(0.75, 0, 0.5));
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

// The motion of the medium over the shutter: a velocity that is the same everywhere is a straight motion of the volume;
// both against the mean of pictures of the volume standing at times of the shutter. No majorant may be passed.
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

TEST(MotionBlur, VelocityIsTheMotionItDescribes) {
  const auto path = test::shared("volumes/sequence/smoke_seq_0030.vdb");
  if (path.empty()) GTEST_SKIP() << "no sequence beside the project";
  Scene s = test::scene_of(path, 15, 0.8, 0.2);
  s.camera.fov = 40;
  s.environment.radiance = dvec3(0.3);
  s.lights.push_back(sun({-0.5, -0.6, 0.7}, 2, 0.5));
  Scene moved = s;
  const dvec3 shift(0.4, 0.1, 0.2);
  moved.camera.shutter = {0, 1};
  moved.volumes[0].object_to_world_end = test::translation(shift);
  const PreparedScene prepared(moved, {});
  EXPECT_TRUE(prepared.plan().moving_media);
  const Layers blurred = prepared.render(400, 1, {}).layers;
  double sum = 0, error = 0;
  constexpr int kTimes = 8;
  for (int k = 0; k < kTimes; ++k) {
    s.volumes[0].object_to_world = test::translation(shift * ((k + 0.5) / kTimes));
    const test::Mean m = test::mean_radiance(PreparedScene(s, {}).render(100, 10 + k, {}).layers);
    sum += m.value.x / kTimes;
    error += m.error.x * m.error.x / (kTimes * kTimes);
  }
  const test::Mean m = test::mean_radiance(blurred);
  EXPECT_NEAR(m.value.x, sum, 4.5 * std::hypot(m.error.x, std::sqrt(error)));

  Scene flowing = s;
  flowing.volumes[0].object_to_world = dmat4(1);
  flowing.camera.shutter = {-0.5, 0.5};
  flowing.volumes[0].velocity_grid = "auto";
  flowing.volumes[0].velocity_scale = 0.068 * 0.0375;
  const PreparedScene flow(flowing, {});
  ASSERT_NE(flow.medium()->displacement(), nullptr);
  const RenderResult r = flow.render(50, 1, {});
  EXPECT_EQ(r.report.counters.tracking.majorant_violations, 0u);
  EXPECT_EQ(r.report.invalid_samples, 0u);
  EXPECT_GT(r.report.counters.tracking.collisions, 1000u);
}

// On a grid made for it: density of a ball, the same velocity everywhere.
TEST(MotionBlur, AConstantVelocityShiftsTheDensity) {
  const test::TemporaryFolder folder;
  const auto ball = [](const ivec3& v) { return static_cast<float>(std::max(0.0, 1 - glm::length(dvec3(v)) / 8)); };
  test::write_affine_vdb(folder / "ball.vdb", {ivec3(-9), ivec3(9)}, test::scaling(dvec3(0.1)), ball);
  test::write_velocity_vdb(folder / "v.vdb", folder / "ball.vdb", {ivec3(-20), ivec3(20)}, dvec3(0.5, 0, 0));
  const ScalarField density = load_scalar(folder / "v.vdb", {});
  std::vector<std::string> notes;
  const Displacement d = load_displacement(folder / "v.vdb", "", density, {1.0, 0.0, 2.0}, notes);
  Medium medium(density.bricks, density.world_from_index, 1.0, dvec3(1), 0);
  medium.set_displacement(d);
  EXPECT_TRUE(medium.moves());
  const Medium late = medium.at_time(0.5);  // one frame after the density's time: 0.5 world units along x
  for (const dvec3& p : {dvec3(0.5, 0, 0), dvec3(0.3, 0.2, -0.1), dvec3(0, 0, 0), dvec3(-0.2, 0, 0)})
    EXPECT_NEAR(late.density(late.to_local(p)), ball(ivec3(0)) * medium.density(medium.to_local(p - dvec3(0.5, 0, 0))),
                1e-5);
  // Bounds hold at every time along random rays.
  Rng rng(3);
  TrackingCounters counters;
  for (int i = 0; i < 3000; ++i) {
    const Medium m = medium.at_time(rng.uniform());
    const dvec3 dir = test::random_direction(rng);
    const Ray ray{test::random_point(rng, dvec3(-0.5), dvec3(1.5)) - 5.0 * dir, dir};
    estimate_transmittance(m, m.to_local(ray), 100, rng, counters);
  }
  EXPECT_EQ(counters.majorant_violations, 0u);
  EXPECT_GT(counters.lookups, 500u);
}

// What glows moves with what scatters: a flame in a flow, on the density's lattice or its own, and a moving volume,
// leave the same streak; it lies half the way further on than the flame at rest.
TEST(MotionBlur, GlowMovesToo) {
  const test::TemporaryFolder folder;
  const auto ball = [](const ivec3& v) { return static_cast<float>(std::max(0.0, 1 - glm::length(dvec3(v)) / 8)); };
  test::write_affine_vdb(folder / "ball.vdb", {ivec3(-9), ivec3(9)}, test::scaling(dvec3(0.1)), ball);
  test::write_velocity_vdb(folder / "v.vdb", folder / "ball.vdb", {ivec3(-20), ivec3(20)}, dvec3(1, 0, 0));
  Scene still = test::scene_of(folder / "v.vdb", 0, 0, 0);
  still.film.width = still.film.height = 24;
  still.camera.position = dvec3(0.4, -8, 0);
  still.camera.look_at = dvec3(0.4, 0, 0);
  still.camera.fov = 30;
  still.volumes[0].emission = dvec3(1);
  struct Streak {
    double light = 0, place = 0;
  };
  const auto streak = [](const Scene& s) {
    const Layers frame = PreparedScene(s, {}).render(400, 1, {}).layers;
    Streak k;
    for (int y = 0; y < 24; ++y)
      for (int x = 0; x < 24; ++x) {
        k.light += frame.at("R")(x, y);
        k.place += frame.at("R")(x, y) * (x + 0.5);
      }
    k.place /= k.light;
    return k;
  };
  const Streak rest = streak(still);
  Scene flows = still;
  flows.camera.shutter = {0, 1};
  Scene moves = flows;
  flows.volumes[0].velocity_grid = "auto";
  moves.volumes[0].object_to_world_end = test::translation({1, 0, 0});
  Scene flame = flows;
  flame.volumes[0].emission = dvec3(0);
  flame.volumes[0].flame_grid = "density";
  flame.volumes[0].flame_intensity = 1;
  Scene flame_rest = still;
  flame_rest.volumes[0].emission = dvec3(0);
  flame_rest.volumes[0].flame_grid = "density";
  const double pixel = 2 * 8 * std::tan(15 * kPi / 180) / 24;  // of the film, at the ball
  for (const Scene& s : {flows, moves}) {
    const Streak k = streak(s);
    EXPECT_NEAR(k.light / rest.light, 1, 0.02);
    EXPECT_NEAR((k.place - rest.place) * pixel, 0.5, 0.02);
  }
  EXPECT_NEAR((streak(flame).place - streak(flame_rest).place) * pixel, 0.5, 0.02);

  Scene box = still;
  box.volumes[0].file.clear();
  box.volumes[0].shape = "sphere";
  const Streak box_rest = streak(box);
  box.camera.shutter = {0, 1};
  box.volumes[0].object_to_world_end = test::translation({1, 0, 0});
  EXPECT_NEAR((streak(box).place - box_rest.place) * pixel, 0.5, 0.02) << "a shape that only glows";
}

TEST(Remap, GoesThroughTheCurve) {
  const test::TemporaryFolder folder;
  test::write_affine_vdb(folder / "a.vdb", {ivec3(0), ivec3(9)}, dmat4(1),
                         [](const ivec3& v) { return static_cast<float>(v.x); });
  ScalarOptions options;
  options.remap = {{0, 0}, {2, 0}, {4, 1}, {8, 10}};
  const ScalarField field = load_scalar(folder / "a.vdb", options);
  const auto at = [&](int x) { return field.bricks.voxel(ivec3(x, 5, 5) - field.bricks.origin()); };
  EXPECT_EQ(at(1), 0.0f);
  EXPECT_EQ(at(3), 0.5f);
  EXPECT_EQ(at(6), 5.5f);
  EXPECT_EQ(at(9), 10.0f);
}

// Delta tracking takes a step for each free path of the cell's largest density: a damaged voxel would make them
// endless.
TEST(MajorantCost, DamagedVoxelsAreToldBeforeRenderingWithTheKeyThatLimitsThem) {
  const test::TemporaryFolder folder;
  const auto with_voxel = [&](float value) {
    test::write_affine_vdb(folder / "a.vdb", {ivec3(0), ivec3(23)}, dmat4(1), [&](const ivec3& v) {
      return v == ivec3(12, 11, 10) ? value : 0.5f + 0.5f * static_cast<float>((v.x + v.y) % 2);
    });
    return test::scene_of(folder / "a.vdb", 0.3, 0.9, 0);
  };
  const auto notes = [](const Scene& s) {
    std::string all;
    const PreparedScene prepared(s, {});
    for (const std::string& note : prepared.notes()) all += note + "\n";
    return all;
  };
  EXPECT_EQ(notes(with_voxel(1e3f)).find("max_density"), std::string::npos) << "bright, and no hindrance";
  const std::string slow = notes(with_voxel(1e9f));
  EXPECT_NE(slow.find("may take 2e+09 steps, and the render be slow"), std::string::npos) << slow;
  EXPECT_NE(slow.find("99.99 % 1; if the rest is damage, limit it: -D volumes.0.max_density=1"), std::string::npos);
  Scene s = with_voxel(6.5e32f);
  std::string endless;
  try {
    PreparedScene(s, {});
  } catch (const InputError& error) {
    endless = error.what();
  }
  EXPECT_NE(endless.find("a.vdb: grid 'density' holds densities up to 6.5e+32"), std::string::npos) << endless;
  EXPECT_NE(endless.find("which never ends"), std::string::npos) << endless;
  s.volumes[0].max_density = 1;
  EXPECT_NE(notes(s).find("1 voxels above 1 were limited to it"), std::string::npos);
  const Layers limited = PreparedScene(s, {}).render(4, 1, {}).layers;
  test::expect_same_bits(limited, PreparedScene(with_voxel(1), {}).render(4, 1, {}).layers);
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
