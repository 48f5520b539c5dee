#include <gtest/gtest.h>

#include <cmath>

#include "base/error.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "render/world/surfaces.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

// Surfaces with an alpha, and those that let light through to their other side, against closed forms.

namespace brume {
namespace {

const char* const kSquare =
    "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

class CutoutTest : public ::testing::Test {
 protected:
  CutoutTest() { test::write_file(folder_ / "square.obj", kSquare); }
  SurfaceSettings& add(Scene& s, double height) const {
    SurfaceSettings& square = s.surfaces.emplace_back();
    square.file = folder_ / "square.obj";
    square.albedo = dvec3(0);
    square.object_to_world = translation(dvec3(0, 0, height));
    return square;
  }
  /// Straight down on what lies around the origin.
  static Scene seen_from_above() {
    Scene s;
    s.film.width = s.film.height = 32;
    s.camera.position = dvec3(0, 0, 20);
    s.camera.up = dvec3(0, 1, 0);
    s.camera.fov = 20;
    return s;
  }
  static void add_sun(Scene& s, const dvec3& towards, double irradiance) {
    LightSettings sun;
    sun.type = "sun";
    sun.direction = towards;
    sun.irradiance = dvec3(irradiance);
    sun.angular_diameter = 0;
    s.lights.push_back(sun);
  }
  static test::Mean mean_of(const Scene& s, int spp = 64) {
    return test::mean_radiance(PreparedScene(s, {}).render(spp, 1).layers);
  }
  /// Left half clear, right half opaque.
  std::filesystem::path mask() const {
    Layers picture(64, 4);
    const auto rgb = picture.add_rgb(layer::beauty);
    for (int y = 0; y < 4; ++y)
      for (int x = 32; x < 64; ++x) (*rgb[0])(x, y) = 1.0f;
    write_exr(folder_ / "mask.exr", picture);
    return folder_ / "mask.exr";
  }
  test::TemporaryFolder folder_;
};

// Two black squares over a sky of 1: of camera rays (1 - .3) (1 - .6) pass. A bias of 2 % would show.
TEST_F(CutoutTest, CameraRaysPassByTheirShare) {
  Scene s = seen_from_above();
  s.environment.radiance = dvec3(1);
  add(s, 0).alpha = 0.3;
  add(s, -1).alpha = 0.6;
  const test::Mean m = mean_of(s, 256);
  EXPECT_LT(m.error.x, 0.002);
  EXPECT_NEAR(m.value.x, 0.7 * 0.4, 5 * m.error.x);
}

TEST_F(CutoutTest, ShadowRaysAreDimmedExactly) {
  Scene s;
  add(s, 0).alpha = 0.25;
  add(s, 1).alpha = 0.4;
  SurfaceSettings& masked = add(s, 2);
  masked.alpha = 0.5;
  masked.alpha_texture = mask();
  const Surfaces surfaces(s.surfaces, dvec3(0));
  for (const double x : {-20.0, 20.0}) {
    const Ray ray{dvec3(x, 3, 10), glm::normalize(dvec3(0.1, 0.2, -1))};
    EXPECT_NEAR(surfaces.passage(ray, 100).light.x, 0.75 * 0.6 * (x < 0 ? 1 : 0.5), 1e-12) << x;
    EXPECT_NEAR(surfaces.passage(ray, 8.3).light.x, x < 0 ? 1 : 0.5, 1e-12) << "the first alone";
  }
}

// A floor under a veil of alpha .4, under a steep sun: what the floor reflects comes through the veil twice.
TEST_F(CutoutTest, AFloorUnderAVeil) {
  Scene s = seen_from_above();
  add(s, 0).albedo = dvec3(0.5);
  add(s, 1).alpha = 0.4;
  const dvec3 towards = glm::normalize(dvec3(0.3, 0.2, 1));
  add_sun(s, towards, 2);
  const test::Mean m = mean_of(s, 256);
  EXPECT_NEAR(m.value.x, 0.6 * 0.6 * 0.5 * 2 * towards.z / kPi, 5 * m.error.x + 1e-7);
  EXPECT_LT(m.error.x, 0.001);
}

TEST_F(CutoutTest, MasksCutOutWhatTheySay) {
  Scene s = seen_from_above();
  s.environment.radiance = dvec3(1);
  add(s, 0).alpha_texture = mask();
  const Layers f = PreparedScene(s, {}).render(16, 1).layers;
  EXPECT_EQ(f.at("R")(4, 16), 1.0f);
  EXPECT_EQ(f.at("R")(28, 16), 0.0f);
}

// The same ray is met or passed alike whoever asks, and alpha 1 is a surface without one, bit for bit.
TEST_F(CutoutTest, FollowsFromTheRayAlone) {
  Scene s;
  add(s, 0).alpha = 0.5;
  const Surfaces surfaces(s.surfaces, dvec3(0));
  int met = 0;
  for (int i = 0; i < 1000; ++i) {
    const Ray ray{dvec3(0, 0, 10), glm::normalize(dvec3(0.001 * i, 0.3, -1))};
    const bool first = surfaces.intersect(ray, 100).has_value();
    met += first;
    ASSERT_EQ(surfaces.intersect(ray, 100).has_value(), first);
  }
  EXPECT_NEAR(met, 500, 80);
}

// Lit from behind by parallel light E: translucence E cos / pi; from in front albedo E cos / pi.
TEST_F(CutoutTest, TranslucentSurfacesAreLitFromBothSides) {
  for (const double side : {1.0, -1.0}) {
    Scene s = seen_from_above();
    SurfaceSettings& leaf = add(s, 0);
    leaf.albedo = dvec3(0.3);
    leaf.translucence = dvec3(0.6, 0.5, 0.1);
    const dvec3 towards = glm::normalize(dvec3(0.3, 0.2, side));
    add_sun(s, towards, 2);
    const dvec3 expected = (side > 0 ? leaf.albedo : leaf.translucence) * (2 * std::abs(towards.z) / kPi);
    const test::Mean m = mean_of(s);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(m.value[c], expected[c], 5 * m.error[c] + 1e-6) << side << " " << c;
  }
}

// What takes nothing cannot be seen under a sky of 1, by whichever way light is sampled.
TEST_F(CutoutTest, WhiteFurnace) {
  for (const char* const sampling : {"none", "all"}) {
    Scene s = seen_from_above();
    s.camera.position = dvec3(3, -15, 9);
    s.environment.radiance = dvec3(1);
    s.render.light_sampling = sampling;
    for (int i = 0; i < 3; ++i) {
      SurfaceSettings& leaf = add(s, i - 1.0);
      leaf.albedo = dvec3(0.7, 0.5, 0.0);
      leaf.translucence = dvec3(1) - leaf.albedo;
      leaf.alpha = 0.7;
    }
    const test::Mean m = mean_of(s, 200);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(m.value[c], 1.0, 5 * m.error[c] + 1e-6) << sampling << " " << c;
    EXPECT_LT(m.error.x, 0.02);
  }
}

// A lamp with a picture and an alpha over a floor: light sampling and paths that end on it by chance, which know
// nothing of one another, agree; a bias of 2 % would show. And the camera sees the picture, by its alpha.
TEST_F(CutoutTest, LampsWithPicturesLightAlikeByEverySampling) {
  Layers picture(8, 8);
  const auto rgb = picture.add_rgb(layer::beauty);
  for (int y = 0; y < 8; ++y)
    for (int x = 0; x < 8; ++x) {
      (*rgb[0])(x, y) = static_cast<float>(x) / 7;
      (*rgb[1])(x, y) = y < 4 ? 1.0f : 0.1f;
      (*rgb[2])(x, y) = 0.5f;
    }
  write_exr(folder_ / "glow.exr", picture);
  const auto lit = [&](const char* sampling) {
    Scene s = seen_from_above();
    s.camera.position = dvec3(0, -12, 6);
    s.camera.look_at = dvec3(0, 0, 0.5);
    s.render.light_sampling = sampling;
    add(s, 0).albedo = dvec3(0.5);
    SurfaceSettings& lamp = add(s, 1.5);
    lamp.object_to_world = lamp.object_to_world * test::scaling(dvec3(0.02));
    lamp.radiance = dvec3(5, 4, 3);
    lamp.radiance_texture = folder_ / "glow.exr";
    lamp.alpha = 0.8;
    lamp.alpha_texture = mask();
    lamp.two_sided = true;
    return mean_of(s, 4096);
  };
  const test::Mean by_chance = lit("none"), by_lamp = lit("all");
  for (int c = 0; c < 3; ++c) {
    const double error = std::hypot(by_chance.error[c], by_lamp.error[c]);
    EXPECT_LT(error, 0.004 * by_lamp.value[c]);
    EXPECT_NEAR(by_chance.value[c], by_lamp.value[c], 5 * error) << c;
  }
  Scene s = seen_from_above();
  SurfaceSettings& lamp = add(s, 0);
  lamp.radiance = dvec3(2);
  lamp.radiance_texture = folder_ / "glow.exr";
  lamp.alpha = 0.25;
  const test::Mean m = mean_of(s, 256);
  EXPECT_NEAR(m.value.z, 0.25, 5 * m.error.z);
  EXPECT_LT(m.error.z, 0.002);
}

TEST_F(CutoutTest, WhatHasNoMeaningIsRefused) {
  const auto refused = [&](const std::string& keys, const std::string& why) {
    const std::filesystem::path path = folder_ / "s.toml";
    test::write_file(
        path, "[camera]\nposition = [0, 0, 5]\nlook_at = [0, 0, 0]\n[[surfaces]]\nfile = \"square.obj\"\n" + keys);
    try {
      read_scene(path);
      ADD_FAILURE() << keys;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
  };
  refused("albedo = 0.8\ntranslucence = 0.3\n", "albedo and translucence are 1.1 together");
  refused("material = \"conductor\"\ntranslucence = 0.3\n", "'translucence' has no meaning for a conductor surface");
  refused("radiance_texture = \"mask.exr\"\n", "'radiance_texture' has no meaning without 'radiance'");
  refused("alpha = 1.5\n", "alpha");
}

}  // namespace
}  // namespace brume
