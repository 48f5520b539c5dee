// Fog that falls off with height in scenes: closed forms, furnaces, the same density as a stack of even boxes, guides.

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "render/world/media.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/reference_frame.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

VolumeSettings fog(double sigma_t, double albedo, double base, double scale) {
  VolumeSettings v;
  v.shape = "layer";
  v.lo = v.hi = dvec3(0);
  v.sigma_t = dvec3(sigma_t);
  v.albedo = dvec3(albedo);
  v.base_height = base;
  v.scale_height = scale;
  return v;
}

Scene looking(const dvec3& from, const dvec3& d, int size = 8, double fov = 0.02) {
  Scene s;
  s.film.width = s.film.height = size;
  s.camera.position = from;
  s.camera.look_at = from + d;
  if (std::abs(glm::normalize(d).z) > 0.9) s.camera.up = dvec3(0, 1, 0);
  s.camera.fov = fov;
  return s;
}

// Black fog without an end before a sky of 1: what passes of it, from below the base, in it and above, at all angles.
// 64 x 4000 paths; the guides have it without noise. Level, nothing passes below the base.
TEST(FogLayer, DimsTheSkyAsItsClosedForm) {
  for (const double height : {-0.5, 1.0, 4.0})
    for (const double angle : {90.0, 30.0, 4.0, -5.0}) {
      const double a = angle * kPi / 180;
      Scene s = looking({3, 2, height}, {std::cos(a), 0, std::sin(a)});
      s.environment.radiance = dvec3(1);
      s.volumes.push_back(fog(0.2, 0, 0.5, 2));
      const bool guides = angle == 30 && height == 1;
      const PreparedScene scene(
          s, guides ? LayerRequest::of({"direct", "guides"}, true) : LayerRequest::of({"direct"}, true));
      const Layers frame = scene.render(4000, 3, {}).layers;
      const test::Mean m = test::mean_radiance(frame);
      const double full = std::max(0.0, 0.5 - height) / std::sin(a), above = std::max(0.0, height - 0.5) / 2;
      const double depth = angle > 0 ? 0.2 * (full + 2 * std::exp(-above) / std::sin(a)) : 0;
      if (angle > 0) {
        EXPECT_NEAR(m.value.x, std::exp(-depth), 4.5 * m.error.x + 1e-3) << height << " " << angle;
        if (guides) {
          EXPECT_NEAR(frame.at("guide.opacity.Y")(4, 4), 1 - std::exp(-depth), 0.01) << height << " " << angle;
        }
      } else {
        EXPECT_LT(m.value.x, 0.45) << "of what lies below it reaches ten free paths or two scales down";
      }
    }
}

// Albedo 1 under a sky of 1: nothing is lost, whatever the layer's direction and the phase function.
TEST(FogLayer, IsAFurnace) {
  for (const char* phase : {"henyey_greenstein", "rayleigh", "fournier_forand"}) {
    Scene s = looking({-4, -1, 1}, {4, 1, -1}, 16, 40);
    s.environment.radiance = dvec3(1);
    s.render.light_sampling = "none";
    s.volumes.push_back(fog(dvec3(2).x, 1, -0.3, 0.7));
    s.volumes[0].lo = dvec3(-1);
    s.volumes[0].hi = dvec3(1, 1, 2);
    s.volumes[0].up = {0.3, -0.2, 1};
    s.volumes[0].phase = phase;
    const Layers frame = PreparedScene(s, {}).render(16, 5, {}).layers;
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < 16; ++x) ASSERT_NEAR(frame.at("R")(x, y), 1, 1e-5);
  }
}

// A layer against the same density in 60 even boxes on top of each other, each of its mean density: light of a sun, a
// sky and a lamp within, scattered often. A difference of 4 % of the mean would be found.
TEST(FogLayer, IsAStackOfEvenBoxes) {
  Scene s = looking({0, -9, 2}, {0, 9, -0.8}, 16, 30);
  s.environment.radiance = dvec3(0.3, 0.4, 0.5);
  LightSettings sun;
  sun.type = "sun";
  sun.direction = dvec3(0.6, 0.2, 0.4);
  sun.irradiance = dvec3(2);
  s.lights.push_back(sun);
  LightSettings lamp;
  lamp.type = "point";
  lamp.position = dvec3(0.5, 0, 0.4);
  lamp.intensity = dvec3(2, 1, 0.5);
  s.lights.push_back(lamp);
  for (const dvec3& sigma_t : {dvec3(0.9), dvec3(0.5, 0.9, 1.4)}) {
    VolumeSettings layer = fog(0, 0.9, 0.2, 0.8);
    layer.sigma_t = sigma_t;
    layer.g = 0.5;
    layer.lo = dvec3(-2, -2, -0.5);
    layer.hi = dvec3(2, 2, 3);
    s.volumes = {layer};
    const test::Mean ours = test::mean_radiance(PreparedScene(s, {}).render(600, 7, {}).layers);
    s.volumes.clear();
    constexpr int kBoxes = 60;
    for (int i = 0; i < kBoxes; ++i) {
      VolumeSettings box = layer;
      box.shape = "box";
      box.lo.z = layer.lo.z + (layer.hi.z - layer.lo.z) * i / kBoxes;
      box.hi.z = layer.lo.z + (layer.hi.z - layer.lo.z) * (i + 1) / kBoxes;
      const auto below = [&](double z) {  // integral of the density from the base
        const double h = z - layer.base_height;
        return h < 0 ? h : layer.scale_height * (1 - std::exp(-h / layer.scale_height));
      };
      box.sigma_t *= (below(box.hi.z) - below(box.lo.z)) / (box.hi.z - box.lo.z);
      s.volumes.push_back(box);
    }
    const test::Mean stack = test::mean_radiance(PreparedScene(s, {}).render(300, 8, {}).layers);
    for (int c = 0; c < 3; ++c) {
      const double error = std::hypot(ours.error[c], stack.error[c]);
      EXPECT_NEAR(ours.value[c], stack.value[c], 4.5 * error) << c;
      EXPECT_LT(4.5 * error, 0.04 * stack.value[c]);
    }
  }
}

// Beside clouds in a grid, as an overlapping, chromatic, moving and turned medium: against the definition.
TEST(FogLayer, AgreesWithTheDefinition) {
  const test::TemporaryFolder folder;
  test::write_affine_vdb(folder.path() / "ball.vdb", {ivec3(-10), ivec3(10)}, test::scaling(dvec3(0.1)),
                         [](const ivec3& v) { return std::max(0.0f, 10 - static_cast<float>(glm::length(dvec3(v)))); });
  Scene s = looking({0, -6, 1}, {0, 6, -0.6}, 24, 30);
  s.environment.radiance = dvec3(0.3);
  LightSettings lamp;
  lamp.type = "sphere";
  lamp.position = dvec3(0.2, -0.9, 0.9);
  lamp.radius = 0.2;
  lamp.radiance = dvec3(9);
  s.lights.push_back(lamp);
  VolumeSettings cloud;
  cloud.file = folder.path() / "ball.vdb";
  cloud.sigma_t = dvec3(0.3);
  VolumeSettings layer = fog(0.4, 0.8, -0.5, 0.6);
  layer.up = {0, 0.1, 1};
  layer.g = 0.3;
  VolumeSettings moving = layer;
  moving.lo = dvec3(-1.2, -1, -1);
  moving.hi = dvec3(0.5, 1, 1.5);
  moving.phase = "fournier_forand";
  moving.g = 0;
  moving.size_slope = 4.2;
  moving.sigma_t = dvec3(0.5, 0.9, 1.2);
  moving.object_to_world_end = test::translation(dvec3(0.5, 0, 0.3));
  for (const bool all : {false, true}) {
    s.volumes = {cloud, layer};
    if (all) {
      s.volumes.push_back(moving);
      s.camera.shutter = dvec2(0, 1);
    }
    const test::Agreement a = test::agreement(s, 320, 1);
    EXPECT_LT(a.worst, test::kSigmas) << a.text();
    EXPECT_LT(a.detectable, 0.06) << a.text();
  }
}

/// Mean of a layer's three channels over the picture.
double mean_of(const Layers& frame, const std::string& name) {
  double sum = 0;
  for (const char c : {'R', 'G', 'B'}) {
    const Plane& plane = frame.at(name.empty() ? std::string(1, c) : name + "." + c);
    for (int y = 0; y < plane.height(); ++y)
      for (const float v : plane.pixels(y)) sum += v / (3.0 * plane.width() * plane.height());
  }
  return sum;
}

// Fog over a floor under sun and sky, seen from above and from within: its direct light within 4 %, the rest
// within 30 % (it is predicted a fifth too bright).
TEST(FogLayer, IsPredictedByItsGuides) {
  for (const double eye : {0.4, 3.0}) {
    Scene s = looking({0, -8, eye}, {0, 8, -0.3 * eye + 0.2}, 24, 50);
    s.environment.radiance = dvec3(0.3, 0.4, 0.5);
    LightSettings sun;
    sun.type = "sun";
    sun.direction = dvec3(0.6, 0.5, 0.4);
    sun.irradiance = dvec3(2);
    s.lights.push_back(sun);
    s.surfaces.emplace_back();
    s.surfaces[0].file = test::source("data/meshes/floor.obj");
    s.surfaces[0].object_to_world = test::scaling(dvec3(10));
    s.volumes.push_back(fog(0.25, 0.95, 0, 0.9));
    s.volumes[0].lo = dvec3(-12, -10, -1);
    s.volumes[0].hi = dvec3(12, 20, 6);
    s.volumes[0].g = 0.3;
    const Layers frame =
        PreparedScene(s, LayerRequest::of({"direct", "indirect", "guides"}, true)).render(128, 3, {}).layers;
    const double direct = mean_of(frame, "direct"), indirect = mean_of(frame, "indirect");
    EXPECT_NEAR(mean_of(frame, "guide.predicted_direct"), direct, 0.04 * direct) << eye;
    EXPECT_NEAR(mean_of(frame, "guide.predicted_indirect"), indirect, 0.3 * indirect) << eye;
  }
}

// Without an end it reaches a thousand times as far as it is thick: under the sky, then under the sun alone, over a
// floor that ends and that nothing but the fog lies beyond, thin and thick, level and tilted.
TEST(FogLayer, WithoutAnEndIsPredictedByItsGuides) {
  struct Case {
    double sigma_t;
    bool sky;
    dvec3 up;
  };
  for (const Case& c :
       {Case{0.15, true, {0, 0, 1}}, {0.15, false, {0, 0, 1}}, {0.6, true, {0, 0, 1}}, {0.15, true, {-0.2, 0.07, 1}}}) {
    Scene s = looking({-1.8, -4.3, 1.8}, {1.9, 4.4, -0.6}, 24, 30);
    if (c.sky) s.environment.radiance = dvec3(1);
    LightSettings sun;
    sun.type = "sun";
    sun.direction = dvec3(-0.7, 0, 0.9);
    sun.irradiance = dvec3(2);
    if (!c.sky) s.lights.push_back(sun);
    s.surfaces.emplace_back();
    s.surfaces[0].file = test::source("data/meshes/floor.obj");
    s.surfaces[0].albedo = dvec3(0.4);
    s.volumes.push_back(fog(c.sigma_t, 0.9, 0.7, 0.25));
    s.volumes[0].g = 0.5;
    s.volumes[0].up = {c.up.x, c.up.y, c.up.z};
    const Layers frame =
        PreparedScene(s, LayerRequest::of({"direct", "indirect", "guides"}, true)).render(64, 3, {}).layers;
    const double direct = mean_of(frame, "direct"), indirect = mean_of(frame, "indirect");
    EXPECT_NEAR(mean_of(frame, "guide.predicted_direct"), direct, 0.06 * direct) << c.sigma_t << c.sky << c.up.x;
    const double bound = c.up == dvec3(0, 0, 1) ? 0.16 : 0.25;
    EXPECT_NEAR(mean_of(frame, "guide.predicted_indirect"), indirect, bound * indirect) << c.sigma_t << c.sky << c.up.x;
  }
}

std::string wrong(const std::string& keys) {
  return test::error_of(
      [&] { parse_scene("[camera]\nposition = [0, 0, 0]\nlook_at = [0, 1, 0]\n[[volumes]]\n" + keys, "a.toml"); });
}

TEST(FogLayer, SaysWhatIsWrong) {
  const auto holds = [](const std::string& text, const char* part) {
    return text.find(part) != std::string::npos ? ::testing::AssertionSuccess() : ::testing::AssertionFailure() << text;
  };
  EXPECT_EQ(wrong("shape = \"layer\"\nscale_height = 3\n"), "");
  EXPECT_TRUE(holds(wrong("shape = \"layer\"\nlo = [0, 0, 0]\n"), "'lo' stands without 'hi'"));
  EXPECT_TRUE(holds(wrong("shape = \"layer\"\nlo = [0, 0, 0]\nhi = [1, 0, 1]\n"), "'lo' is not below 'hi'"));
  EXPECT_TRUE(holds(wrong("shape = \"layer\"\nlo = [0, 0, 0]\nhi = [0, 0, 0]\n"), "'lo' is not below 'hi'"));
  EXPECT_TRUE(holds(wrong("shape = \"layer\"\nup = [0, 0, 0]\n"), "'up' is no direction"));
  EXPECT_TRUE(holds(wrong("shape = \"layer\"\nemission = 1\n"), "a layer cannot emit"));
  EXPECT_TRUE(holds(wrong("shape = \"layer\"\nscale_height = 0\n"), "'scale_height'"));
  EXPECT_TRUE(holds(wrong("shape = \"box\"\nbase_height = 0\n"), "'base_height' has no meaning for shape = \"box\""));
  EXPECT_TRUE(holds(wrong("shape = \"layer\"\nobject_to_world = [[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]\n"),
                    "'object_to_world' stands beside a layer without an end"));
  EXPECT_TRUE(holds(wrong("shape = \"box\"\nphase = \"mie\"\nsize_slope = 4\n"),
                    "'size_slope' has no meaning for phase = \"mie\""));
  EXPECT_TRUE(holds(wrong("shape = \"box\"\nphase = \"fournier_forand\"\ng = 0.5\n"), "'g' stands beside"));
}

}  // namespace
}  // namespace brume
