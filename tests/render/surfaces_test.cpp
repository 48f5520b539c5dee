#include "render/world/surfaces.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/info.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "image/exr_io.h"
#include "image/picture_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/surface_scenes.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::SurfaceTest;
using test::write_ball;

TEST_F(SurfaceTest, LeaveAllThreadsToTheProgram) {
  // Embree tells TBB how many threads there are, for as long as its device lives.
  const Surfaces surfaces(scene("ball.obj").surfaces, dvec3(0));
  EXPECT_GE(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism),
            static_cast<size_t>(tbb::info::default_concurrency()));
}

// Surfaces that absorb nothing under a sky of 1 cannot be seen, whatever they do to directions. Polished ones are
// exact; rough microfacets lose what bounces between facets, so they are not held to 1.
TEST_F(SurfaceTest, WhiteFurnace) {
  struct Case {
    const char* material;
    double roughness;
    const char* sampling;
  };
  for (const Case& c : {Case{"diffuse", 0.5, "none"}, Case{"diffuse", 0.5, "all"}, Case{"conductor", 0.0, "none"},
                        Case{"dielectric", 0.0, "none"}, Case{"dielectric", 0.0, "all"}, Case{"coated", 0.3, "none"},
                        Case{"coated", 0.7, "all"}}) {
    Scene s = scene("ball.obj");
    s.surfaces[0].material = c.material;
    s.surfaces[0].albedo = dvec3(1);
    s.surfaces[0].roughness = c.roughness;
    s.environment.radiance = dvec3(1);
    s.render.light_sampling = c.sampling;
    const test::Mean m = test::mean_radiance(PreparedScene(s, {}).render(200, 1, {}).layers);
    EXPECT_NEAR(m.value.x, 1.0, 5 * m.error.x + 1e-6) << c.material << " " << c.sampling;
    if (std::string(c.sampling) == "none" && c.material != std::string("coated")) {
      EXPECT_LT(m.error.x, 1e-6) << "each path is exactly 1";
    }
  }
}

// A ball on a floor under a lamp, moved far away, and as large or small as numbers allow.
TEST_F(SurfaceTest, NothingDependsOnWhereAndHowLargeTheWorldIs) {
  const auto picture = [&](double scale, double shift) {
    Scene s = scene("ball.obj");
    s.surfaces.emplace_back();
    s.surfaces[1].file = folder_ / "floor.obj";
    const dvec3 away(shift, 0, 0);
    for (SurfaceSettings& surface : s.surfaces)
      surface.object_to_world = translation(away) * test::scaling(dvec3(scale));
    s.surfaces[0].object_to_world = s.surfaces[0].object_to_world * translation(dvec3(0, 0, 1));
    s.camera.position = scale * s.camera.position + away;
    s.camera.look_at = away;
    LightSettings lamp;
    lamp.type = "sphere";
    lamp.position = scale * dvec3(2, -1, 4) + away;
    lamp.radius = 0.5 * scale;
    lamp.radiance = dvec3(20);
    s.lights.push_back(lamp);
    return PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(64, 1).layers;
  };
  const Layers ordinary = picture(1, 0);
  for (const int power : {-60, -20, 20, 60})
    test::expect_same_bits(ordinary, picture(std::ldexp(1.0, power), 0), "2^" + std::to_string(power));
  // The same paths, but for roundings of positions: what differs is far below any noise.
  const double mean = test::mean_radiance(ordinary).value.x;
  for (const double shift : {1e5, 1e6, -3e7})
    EXPECT_NEAR(test::mean_radiance(picture(1, shift)).value.x, mean, 1e-4 * mean) << shift;
}

// Embree says which triangle a ray hits; where on it does not carry Embree's roundings, which differ by instruction
// set.
TEST_F(SurfaceTest, HitsLieOnTheirTrianglesInDoublePrecision) {
  Scene s = scene("ball.obj");
  const Surfaces surfaces(s.surfaces, dvec3(0));
  Rng rng(1);
  int hits = 0;
  for (int i = 0; i < 10000; ++i) {
    const dvec3 o = 30.0 * test::random_direction(rng);
    const dvec3 aim = test::random_point(rng, dvec3(-0.7), dvec3(0.7));
    const Ray ray{o, glm::normalize(aim - o)};
    const auto hit = surfaces.intersect(ray, 1e9);
    if (!hit) continue;
    ++hits;
    const dvec3 corner = surfaces.mesh(0).corners(hit->triangle)[0];
    ASSERT_LT(std::abs(glm::dot(ray.at(hit->t) - corner, hit->normal)), 1e-13);
    // And a ray that leaves it outwards from a convex body meets nothing.
    const dvec3 off = Surfaces::leave(*hit, ray.at(hit->t), hit->normal);
    ASSERT_FALSE(surfaces.intersect({off, glm::normalize(hit->normal + 0.99 * ray.d)}, 1e9)) << i;
  }
  EXPECT_GT(hits, 5000);
}

bool says(const PreparedScene& prepared, const std::string& part) {
  return std::any_of(prepared.notes().begin(), prepared.notes().end(),
                     [&](const std::string& note) { return note.find(part) != std::string::npos; });
}

// A mirror whose edge reflects as its middle does is as grey as that all over.
TEST_F(SurfaceTest, EdgesHaveTheirReflectance) {
  Scene s = scene("ball.obj");
  s.environment.radiance = dvec3(1);
  s.surfaces[0].roughness = 0;
  s.surfaces[0].material = "conductor";
  s.surfaces[0].albedo = s.surfaces[0].edge_albedo = dvec3(0.6);
  s.film.width = s.film.height = 24;
  const auto darkest_and_brightest = [&] {
    const Layers f = PreparedScene(s, {}).render(16, 1, {}).layers;
    double low = 2, high = 0;
    for (int y = 0; y < 24; ++y)
      for (int x = 0; x < 24; ++x) {
        if (f.at("A")(x, y) < 1) continue;
        low = std::min(low, static_cast<double>(f.at("R")(x, y)));
        high = std::max(high, static_cast<double>(f.at("R")(x, y)));
      }
    return std::pair(low, high);
  };
  const auto [low, high] = darkest_and_brightest();
  EXPECT_NEAR(low, 0.6, 1e-5);
  EXPECT_NEAR(high, 0.6, 1e-5);
  s.surfaces[0].edge_albedo = dvec3(1);
  EXPECT_GT(darkest_and_brightest().second, 0.65) << "reflects all at the rim";
}

// What a square that moves from -2 to 2 covers of a point's time: a closed form, and what stands behind shows through.
TEST_F(SurfaceTest, MovesOverTheShutter) {
  test::write_file(folder_ / "square.obj", "v -1 -9 1\nv 1 -9 1\nv 1 9 1\nv -1 9 1\nf 1 2 3 4\n");
  Scene s = scene("square.obj");
  s.camera.type = "orthographic";
  s.camera.position = dvec3(0, 0, 9), s.camera.look_at = dvec3(0), s.camera.up = dvec3(0, 1, 0);
  s.camera.width = 8;
  s.environment.radiance = dvec3(1);
  s.film.width = 16, s.film.height = 4;
  s.surfaces[0].albedo = dvec3(0);
  s.surfaces[0].object_to_world = translation(dvec3(-2, 0, 0));
  s.surfaces[0].object_to_world_end = translation(dvec3(2, 0, 0));
  s.camera.shutter = {-0.25, 0.25};
  const Layers f = PreparedScene(s, {}).render(4096, 1, {}).layers;
  for (int x = 0; x < 16; ++x) {
    double covered = 0;  // mean over the pixel of the time
    for (int k = 0; k < 50; ++k) {
      const double p = -4 + (x + (k + 0.5) / 50) * 0.5;  // covered while its middle is within 1
      covered += std::max(0.0, std::min(2.0, p + 1) - std::max(-2.0, p - 1)) / 4 / 50;
    }
    for (int y = 0; y < 4; ++y) {
      const double error = std::sqrt(covered * (1 - covered) / 4096);
      EXPECT_NEAR(f.at("A")(x, y), covered, 5 * error + 1e-3) << x;
      EXPECT_NEAR(f.at("R")(x, y), 1 - covered, 5 * error + 1e-3) << x;
    }
  }
  s.camera.shutter = {0, 0};
  const PreparedScene still(s, {});
  EXPECT_TRUE(says(still, "a surface moves but camera.shutter opens and closes at once"));
  EXPECT_EQ(still.render(4, 1, {}).layers.at("A")(4, 2), 1.0f) << "where it starts";
}

// A ball that turns and grows keeps its shading: what it shows at each time is what a ball standing there shows.
TEST_F(SurfaceTest, MovingNormalsAreThoseOfTheStandingMesh) {
  write_ball(folder_ / "smooth.obj", 1.0, 12, true);
  const auto surface = [&](const dmat4& start) {
    Scene s = scene("smooth.obj");
    s.surfaces[0].object_to_world = start;
    return s.surfaces;
  };
  const dmat4 start = test::scaling({1, 0.6, 1}), end = translation(dvec3(0.4, 0.1, 0)) * test::scaling({1.4, 1, 0.7});
  std::vector<SurfaceSettings> moving = surface(start);
  moving[0].object_to_world_end = end;
  const Surfaces moves(moving, dvec3(0), true);
  for (const double time : {0.0, 0.3, 1.0}) {
    const Surfaces stands(surface(start * (1 - time) + end * time), dvec3(0));
    for (const dvec3& from : {dvec3(0.2, -6, 0.1), dvec3(-0.3, -6, 0.3)}) {
      const auto a = moves.intersect({from, {0, 1, 0}}, 100, time), b = stands.intersect({from, {0, 1, 0}}, 100);
      ASSERT_TRUE(a && b);
      EXPECT_NEAR(a->t, b->t, 1e-6);
      EXPECT_NEAR(glm::distance(a->normal, b->normal), 0, 1e-6);
      EXPECT_NEAR(glm::distance(a->shading, b->shading), 0, 1e-6);
    }
  }
  moving[0].object_to_world_end = test::scaling({-1, 1, 1});
  EXPECT_THROW(Surfaces(moving, dvec3(0), true), InputError) << "turned inside out";
}

// The camera looks through a box that it does not see, also where its bottom lies on the floor; light does not.
TEST_F(SurfaceTest, WhatTheCameraDoesNotSeeStillCastsShadows) {
  test::write_file(folder_ / "lid.obj", "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n");
  Scene s = scene("floor.obj");
  s.camera.position = dvec3(0, 0, 9), s.camera.look_at = dvec3(0), s.camera.up = dvec3(0, 1, 0);
  s.environment.radiance = dvec3(1);
  s.surfaces[0].albedo = dvec3(0.5);
  const auto lid = [&](double z) {
    SurfaceSettings surface = s.surfaces[0];
    surface.file = folder_ / "lid.obj";
    surface.object_to_world = translation(dvec3(0, 0, z));
    surface.visible_to_camera = false;
    surface.albedo = dvec3(0);
    return surface;
  };
  s.surfaces.push_back(lid(0));
  s.surfaces.push_back(lid(0.5));
  const Layers f = PreparedScene(s, LayerRequest::of({"depth"}, true)).render(256, 1, {}).layers;
  EXPECT_EQ(f.at("A")(8, 8), 1.0f) << "the floor is there";
  EXPECT_NEAR(f.at("depth.Z")(8, 8), 9, 0.01);
  EXPECT_LT(f.at("R")(8, 8), 0.25f) << "in the shadow of what is unseen";
  EXPECT_GT(f.at("R")(0, 0), 0.4f);
}

// A diffuse floor under the sun: albedo / pi E cos theta, exactly; the depth, normal and position layers; alpha 1.
TEST_F(SurfaceTest, LambertUnderTheSun) {
  Scene s = scene("floor.obj");
  s.surfaces[0].albedo = dvec3(0.5, 0.25, 1);
  LightSettings sun;
  sun.type = "sun";
  sun.direction = dvec3(0, 3, 4);
  sun.irradiance = dvec3(2);
  sun.angular_diameter = 0;
  s.lights.push_back(sun);
  s.camera.position = dvec3(0, 0, 5);
  s.camera.up = dvec3(0, 1, 0);
  const Layers f = PreparedScene(s, LayerRequest::of({"all"}, true)).render(4, 1, {}).layers;
  EXPECT_NEAR(f.at("surface.R")(8, 8), 0.5 / kPi * 2 * 0.8, 1e-6);
  EXPECT_NEAR(f.at("G")(3, 8), 0.25 / kPi * 2 * 0.8, 1e-6);
  EXPECT_NEAR(f.at("normal.Z")(8, 8), 1, 1e-6);
  EXPECT_NEAR(f.at("depth.Z")(8, 8), 5, 0.05);
  EXPECT_NEAR(f.at("position.Z")(2, 2), 0, 1e-4);
  EXPECT_NEAR(f.at("albedo.B")(8, 8), 1, 1e-6);
  EXPECT_EQ(f.at("A")(8, 8), 1.0f);
  EXPECT_EQ(f.at("single.R")(8, 8), 0.0f);
}

// The same rectangle as an analytic light and as a mesh that emits gives one picture, in a medium and on a floor.
// On both sides, too: a ceiling is above the lamp.
TEST_F(SurfaceTest, AMeshLightIsTheRectangleItLooksLike) {
  test::write_file(folder_ / "lamp.obj", "v -1 -1 3\nv -1 1 3\nv 1 1 3\nv 1 -1 3\nf 1 2 3 4\n");
  for (const bool two_sided : {false, true}) {
    Scene s = scene("floor.obj");
    s.surfaces.push_back(s.surfaces[0]);
    s.surfaces[1].object_to_world = translation(dvec3(0, 0, 5));
    VolumeSettings fog;
    fog.shape = "sphere";
    fog.lo = dvec3(-1.5, -1.5, 0);
    fog.hi = dvec3(1.5, 1.5, 2.5);
    fog.sigma_t = dvec3(0.8);
    fog.albedo = dvec3(0.9);
    s.volumes.push_back(fog);
    Scene with_mesh = s;
    with_mesh.surfaces.push_back({});
    with_mesh.surfaces[2].file = folder_ / "lamp.obj";
    with_mesh.surfaces[2].radiance = dvec3(3);
    with_mesh.surfaces[2].albedo = dvec3(0);
    with_mesh.surfaces[2].two_sided = two_sided;
    LightSettings lamp;
    lamp.type = "rectangle";
    lamp.position = dvec3(0, 0, 3);
    lamp.edge_x = dvec3(0, 2, 0);
    lamp.edge_y = dvec3(2, 0, 0);
    lamp.radiance = dvec3(3);
    lamp.visible_to_camera = true;
    lamp.two_sided = two_sided;
    s.lights.push_back(lamp);
    const Layers a = PreparedScene(s, {}).render(400, 1, {}).layers,
                 b = PreparedScene(with_mesh, {}).render(400, 2, {}).layers;
    for (const LayerName& l : {layer::direct, layer::indirect}) {
      const test::Mean m = test::mean_radiance(a, l), n = test::mean_radiance(b, l);
      EXPECT_GT(m.value.x, 0.01);
      EXPECT_NEAR(m.value.x, n.value.x, 4.5 * std::hypot(m.error.x, n.error.x)) << l.label();
      EXPECT_LT(4.5 * m.error.x, 0.05 * m.value.x);
    }
  }
}

// A coarse ball with vertex normals is shaded like a round one: its normals are the ball's, under any transform, and no
// light is made at the seams of its triangles.
TEST_F(SurfaceTest, VertexNormalsMakeACoarseBallRound) {
  write_ball(folder_ / "smooth.obj", 1.0, 12, true);
  Scene s = scene("smooth.obj");
  s.film.width = s.film.height = 48;
  s.camera.look_at = dvec3(0);
  s.surfaces[0].albedo = dvec3(1);
  s.environment.radiance = dvec3(1);
  s.surfaces[0].object_to_world =
      dmat4(1.5, 0, 0, 0, 0, -1, 0, 0, 0, 0.3, 1, 0, 0, 0, 0, 1);  // squeezed, sheared, mirrored
  const dmat3 from_world = glm::inverse(dmat3(s.surfaces[0].object_to_world));
  const auto wrong = [&](const char* normals) {
    s.surfaces[0].normals = normals;
    const Layers frame = PreparedScene(s, LayerRequest::of({"normal", "position"}, true)).render(4, 1, {}).layers;
    double sum = 0;
    int seen = 0;
    for (int y = 0; y < 48; ++y)
      for (int x = 0; x < 48; ++x) {
        if (frame.at("A")(x, y) < 1 || frame.at("position.mean_variance.X")(x, y) > 1e-3f) continue;
        const auto at = [&](const std::string& l, const char* c) { return static_cast<double>(frame.at(l + c)(x, y)); };
        const dvec3 n(at("normal", ".X"), at("normal", ".Y"), at("normal", ".Z"));
        const dvec3 p(at("position", ".X"), at("position", ".Y"), at("position", ".Z"));
        const dvec3 round = glm::normalize(glm::transpose(from_world) * (from_world * p));
        sum += glm::length(glm::normalize(n) - round);
        ++seen;
      }
    EXPECT_GT(seen, 200);
    return sum / seen;
  };
  EXPECT_LT(wrong("smooth"), 0.04);
  EXPECT_GT(wrong("flat"), 0.1);
  s.surfaces[0].normals = "smooth";
  const test::Mean m = test::mean_radiance(PreparedScene(s, {}).render(64, 1, {}).layers);
  EXPECT_LE(m.value.x, 1 + 1e-6);
  EXPECT_GT(m.value.x, 0.99) << "of the sky's light, lost where shading and triangles disagree";
}

// A picture on the floor: linear from EXR as it is, from PNG decoded; v runs up.
TEST_F(SurfaceTest, TexturesColourTheAlbedo) {
  Layers picture(2, 2);
  const auto rgb = picture.add_rgb(layer::beauty);
  (*rgb[0])(0, 0) = (*rgb[1])(1, 0) = (*rgb[2])(0, 1) = 1.0f;  // red, green; blue, black
  write_exr(folder_ / "t.exr", picture);
  write_png(folder_ / "t.png", to_picture(picture.rgb(layer::beauty)));
  for (const char* name : {"t.exr", "t.png"}) {
    Scene s = scene("floor.obj");
    s.surfaces[0].albedo = dvec3(0.5);
    s.surfaces[0].albedo_texture = folder_ / name;
    s.environment.radiance = dvec3(1);
    // Straight down on the middle of the upper left quarter of the square: the first texel.
    s.camera.position = dvec3(-25, 25, 10);
    s.camera.look_at = dvec3(-25, 25, 0);
    s.camera.up = dvec3(0, 1, 0);
    s.camera.fov = 1;
    const Layers f = PreparedScene(s, LayerRequest::of({"albedo"}, true)).render(4, 1, {}).layers;
    EXPECT_NEAR(f.at("albedo.R")(8, 8), 0.5f, 0.01f) << name;
    EXPECT_NEAR(f.at("albedo.G")(8, 8), 0.0f, 0.01f) << name;
  }
}

TEST_F(SurfaceTest, TexelsThatAreNoAlbedoAreCountedAndTold) {
  Layers picture(2, 2);
  const auto rgb = picture.add_rgb(layer::beauty);
  for (Plane* plane : rgb) plane->fill(0.5f);
  (*rgb[0])(0, 0) = std::numeric_limits<float>::quiet_NaN();
  (*rgb[1])(0, 0) = 1.5f;
  (*rgb[2])(0, 0) = -0.5f;
  write_exr(folder_ / "t.exr", picture);
  Scene s = scene("floor.obj");
  s.surfaces[0].albedo = dvec3(1);
  s.surfaces[0].albedo_texture = folder_ / "t.exr";
  s.environment.radiance = dvec3(1);
  s.camera.position = dvec3(-25, 25, 10);
  s.camera.look_at = dvec3(-25, 25, 0);
  s.camera.up = dvec3(0, 1, 0);
  s.camera.fov = 1;
  const PreparedScene prepared(s, LayerRequest::of({"albedo"}, true));
  const Layers f = prepared.render(4, 1, {}).layers;
  EXPECT_NEAR(f.at("albedo.R")(8, 8), 0.0f, 0.02f);
  EXPECT_NEAR(f.at("albedo.G")(8, 8), 1.0f, 0.02f);
  EXPECT_NEAR(f.at("albedo.B")(8, 8), 0.0f, 0.02f);
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) ASSERT_EQ(f.at("invalid_count.Y")(x, y), 0.0f);
  const auto told = [&](const char* part) {
    return std::any_of(prepared.notes().begin(), prepared.notes().end(),
                       [&](const std::string& note) { return note.find(part) != std::string::npos; });
  };
  EXPECT_TRUE(told("t.exr: 1 NaN value and 1 negative value became 0"));
  EXPECT_TRUE(told("t.exr: 1 values above 1 became 1"));
}

// What an orthographic camera sees of a notched polygon is its area.
TEST_F(SurfaceTest, ConcavePolygonsCoverTheirArea) {
  test::write_file(folder_ / "arrow.obj", "v 1 0 0\nv 0.3 0 0.3\nv 0 0 1\nv 0 0 0\nf 1 2 3 4\n");
  test::write_file(
      folder_ / "u.obj",
      "v 0 0 0\nv 1 0 0\nv 1 0 1\nv .75 0 1\nv .75 0 .25\nv .25 0 .25\nv .25 0 1\nv 0 0 1\nf 8 7 6 5 4 3 2 1\n");
  for (const auto& [name, area] : {std::pair("arrow.obj", 0.3), std::pair("u.obj", 0.625)}) {
    Scene s = scene(name);
    s.camera.type = "orthographic";
    s.camera.position = dvec3(0.5, -4, 0.5);
    s.camera.look_at = dvec3(0.5, 0, 0.5);
    s.camera.width = 1.2;
    s.film.width = s.film.height = 60;
    const Layers f = PreparedScene(s, LayerRequest::of({"surface_share"}, true)).render(16, 1, {}).layers;
    double sum = 0;
    for (int y = 0; y < 60; ++y)
      for (int x = 0; x < 60; ++x) sum += f.at("surface_share.A")(x, y);
    EXPECT_NEAR(sum * std::pow(1.2 / 60, 2), area, 0.003) << name;
  }
}

TEST_F(SurfaceTest, HoldoutsCutHolesAndCatchersGatherShadows) {
  Scene s = scene("floor.obj");
  s.environment.radiance = dvec3(0.5);
  s.surfaces[0].role = "holdout";
  Layers f = PreparedScene(s, {}).render(4, 1, {}).layers;
  EXPECT_EQ(f.at("A")(8, 12), 0.0f);
  EXPECT_EQ(f.at("R")(8, 12), 0.0f) << "nothing, not the sky";

  s.surfaces[0].role = "shadow_catcher";
  LightSettings sun;
  sun.type = "sun";
  sun.direction = dvec3(0, 0, 1);
  sun.irradiance = dvec3(2);
  s.lights.push_back(sun);
  VolumeSettings fog;
  fog.shape = "sphere";
  fog.lo = dvec3(-1, -1, 1);
  fog.hi = dvec3(1, 1, 3);
  fog.sigma_t = dvec3(1);
  fog.albedo = dvec3(0);
  s.volumes.push_back(fog);
  s.camera.position = dvec3(0, -8, 8);
  EXPECT_TRUE(says(PreparedScene(s, {}), "a shadow catcher is unseen in the picture itself"));
  f = PreparedScene(s, LayerRequest::of({"all"}, true)).render(64, 1, {}).layers;
  // Straight below the fog's middle the sun comes through exp(-2); the sky from around is dimmed too.
  const double lit = f.at("catcher.R")(8, 8), free = f.at("catcher_unshadowed.R")(8, 8);
  EXPECT_NEAR(free, 0.5 / kPi * 2 + 0.5 * 0.5, 0.06);
  EXPECT_LT(lit, 0.75 * free);
  EXPECT_NEAR(f.at("R")(0, 15), 0.5f, 1e-6f) << "the plate is not hidden: the sky is behind";
  EXPECT_EQ(f.at("A")(0, 15), 0.0f);
}

}  // namespace
}  // namespace brume
