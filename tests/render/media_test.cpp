// Media beyond one grey grid: homogeneous shapes, overlaps, chromatic extinction, presets.

#include "render/world/media.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/media_scenes.h"
#include "tests/support/volumes.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

using test::overview;
using test::solid;
using test::sun;
using test::through_the_middle;

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

}  // namespace
}  // namespace brume
