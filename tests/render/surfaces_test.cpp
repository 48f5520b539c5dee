#include "render/world/surfaces.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/info.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>

#include "base/error.h"
#include "base/running_statistics.h"
#include "image/exr_io.h"
#include "image/picture_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

/// A ball of quadrilaterals as OBJ, outside out.
void write_ball(const std::filesystem::path& path, double radius, int n = 48, bool normals = false) {
  std::ofstream f(path);
  const int rings = n / 2;
  for (int j = 0; j <= rings; ++j)
    for (int i = 0; i < n; ++i) {
      const double theta = kPi * j / rings, phi = 2 * kPi * i / n;
      f << "v " << radius * std::sin(theta) * std::cos(phi) << ' ' << radius * std::sin(theta) * std::sin(phi) << ' '
        << radius * std::cos(theta) << '\n';
      if (normals)
        f << "vn " << std::sin(theta) * std::cos(phi) << ' ' << std::sin(theta) * std::sin(phi) << ' '
          << std::cos(theta) << '\n';
    }
  const auto corner = [&](int v) { return normals ? fmt::format("{}//{}", v + 1, v + 1) : fmt::format("{}", v + 1); };
  for (int j = 0; j < rings; ++j)
    for (int i = 0; i < n; ++i)
      f << "f " << corner(j * n + i) << ' ' << corner((j + 1) * n + i) << ' ' << corner((j + 1) * n + (i + 1) % n)
        << ' ' << corner(j * n + (i + 1) % n) << '\n';
}

const char* const kFloor =
    "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

class SurfaceTest : public ::testing::Test {
 protected:
  SurfaceTest() {
    write_ball(folder_ / "ball.obj", 1.0);
    test::write_file(folder_ / "floor.obj", kFloor);
  }
  Scene scene(const char* mesh) {
    Scene s;
    s.film.width = s.film.height = 16;
    s.camera.position = dvec3(0, -6, 3);
    s.camera.fov = 26;
    s.surfaces.emplace_back();
    s.surfaces[0].file = folder_ / mesh;
    return s;
  }
  test::TemporaryFolder folder_;
};

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

// For every kind of surface and incidence: the sampled weight is f cos / pdf, and the density integrates to the share
// of samples that carry anything.
TEST(Bsdf, WeightsAreValuesOverDensities) {
  Rng rng(1);
  for (const Bsdf::Kind kind :
       {Bsdf::Kind::kDiffuse, Bsdf::Kind::kConductor, Bsdf::Kind::kDielectric, Bsdf::Kind::kCoated})
    for (const double roughness : {0.25, 0.5, 0.9})
      for (const bool inside : {false, true})
        for (const double cos_o : {0.1, 0.5, 0.95}) {
          const CoatAlbedo coat(roughness * roughness, 1.5);
          const Bsdf bsdf{kind, dvec3(0.7), roughness, 1.5, dvec3(0.4), &coat};
          const dvec3 wo(std::sqrt(1 - cos_o * cos_o), 0, cos_o);
          RunningStatistics sampled, uniform, pdf;
          for (int i = 0; i < 40000; ++i) {
            Bsdf::Sample s;
            const bool ok = bsdf.sample(wo, inside, {rng.uniform(), rng.uniform(), rng.uniform()}, s);
            if (ok) {
              ASSERT_NEAR(s.pdf, bsdf.pdf(wo, s.wi, inside), 1e-6 * s.pdf + 1e-9);
              const dvec3 value = bsdf.value(wo, s.wi, inside);
              if (s.pdf > 1e-6) {
                ASSERT_NEAR(s.weight.x, value.x / s.pdf, 2e-3 * s.weight.x + 1e-6);
              }
            }
            sampled.add(ok ? s.weight.x : 0.0);
            const dvec3 wi = test::random_direction(rng);
            uniform.add(bsdf.value(wo, wi, inside).x * 4 * kPi);
            pdf.add(bsdf.pdf(wo, wi, inside) * 4 * kPi);
          }
          EXPECT_NEAR(sampled.mean, uniform.mean, 5 * std::sqrt(sampled.mean_variance() + uniform.mean_variance()))
              << static_cast<int>(kind) << " " << roughness << " " << inside << " " << cos_o;
          EXPECT_LE(pdf.mean, 1 + 5 * std::sqrt(pdf.mean_variance()));
          EXPECT_GE(pdf.mean, 0.5);
        }
}

// A coat over a base that absorbs nothing loses nothing, from whichever side it is looked at; light may be sent either
// way.
TEST(Bsdf, CoatsAreReciprocalAndLoseNothing) {
  Rng rng(3);
  for (const double roughness : {0.0, 0.2, 0.5, 1.0})
    for (const double ior : {1.05, 1.5, 2.5}) {
      Bsdf bsdf{Bsdf::Kind::kCoated, dvec3(1), roughness, ior};
      const CoatAlbedo coat(bsdf.alpha(), ior);
      bsdf.coat = &coat;
      for (const double cos_o : {0.05, 0.3, 0.7, 1.0}) {
        const dvec3 wo(std::sqrt(1 - cos_o * cos_o), 0, cos_o);
        RunningStatistics reflected;
        for (int i = 0; i < 20000; ++i) {
          Bsdf::Sample s;
          const bool ok = bsdf.sample(wo, false, {rng.uniform(), rng.uniform(), rng.uniform()}, s);
          reflected.add(ok ? s.weight.x : 0.0);
          if (!ok || s.wi.z < 1e-3) continue;
          const double there = bsdf.value(wo, s.wi, false).x * wo.z, back = bsdf.value(s.wi, wo, false).x * s.wi.z;
          ASSERT_NEAR(there, back, 1e-6 * there);
        }
        EXPECT_NEAR(reflected.mean, 1, 5 * std::sqrt(reflected.mean_variance()) + 4e-3)
            << roughness << " " << ior << " " << cos_o;
      }
    }
}

// Directions come as often as the density says: counted in cells of equal solid angle on either side.
TEST(Bsdf, DirectionsHaveTheirDensity) {
  constexpr int kAcross = 8, kAround = 12, kDraws = 200000, kPoints = 64;
  for (const Bsdf::Kind kind : {Bsdf::Kind::kConductor, Bsdf::Kind::kDielectric, Bsdf::Kind::kCoated})
    for (const double roughness : {0.6, 0.9})
      for (const double cos_o : {0.3, 0.9}) {
        const CoatAlbedo coat(roughness * roughness, 1.5);
        const Bsdf bsdf{kind, dvec3(0.7), roughness, 1.5, dvec3(1), &coat};
        const dvec3 wo(std::sqrt(1 - cos_o * cos_o), 0, cos_o);
        std::vector<double> expected(2 * kAcross * kAround + 1), counted(expected.size());
        double all = 0;
        for (int cell = 0; cell < 2 * kAcross * kAround; ++cell) {
          double sum = 0;
          for (int k = 0; k < kPoints * kPoints; ++k) {
            const double z = -1 + (cell / kAround + (k % kPoints + 0.5) / kPoints) / kAcross;
            const double phi = (cell % kAround + (k / kPoints + 0.5) / kPoints) * 2 * kPi / kAround;
            const double r = std::sqrt(1 - z * z);
            sum += bsdf.pdf(wo, {r * std::cos(phi), r * std::sin(phi), z}, false);
          }
          expected[static_cast<size_t>(cell)] = sum / (kPoints * kPoints) * 2 * kPi / (kAcross * kAround) * kDraws;
          all += expected[static_cast<size_t>(cell)];
        }
        expected.back() = kDraws - all;  // that carry nothing
        Rng rng(7);
        for (int i = 0; i < kDraws; ++i) {
          Bsdf::Sample s;
          if (!bsdf.sample(wo, false, {rng.uniform(), rng.uniform(), rng.uniform()}, s)) {
            ++counted.back();
            continue;
          }
          const double phi = std::atan2(s.wi.y, s.wi.x), turn = (phi < 0 ? phi + 2 * kPi : phi) / (2 * kPi);
          const int row = std::clamp(static_cast<int>((s.wi.z + 1) * kAcross), 0, 2 * kAcross - 1);
          ++counted[static_cast<size_t>(row * kAround + std::min(static_cast<int>(turn * kAround), kAround - 1))];
        }
        double chi2 = 0;
        int cells = 0;
        for (size_t i = 0; i < expected.size(); ++i) {
          if (expected[i] < 20) continue;
          chi2 += (counted[i] - expected[i]) * (counted[i] - expected[i]) / expected[i];
          ++cells;
        }
        // Mean and deviation of the distribution; the cells' integrals are wrong by a little, too.
        EXPECT_LT(chi2, cells + 5 * std::sqrt(2.0 * cells))
            << static_cast<int>(kind) << " " << roughness << " " << cos_o;
      }
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

// A picture on the floor: linear from EXR as it is, from PNG decoded; v runs up.
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

TEST_F(SurfaceTest, SmokeBehindGlassIsSeen) {
  Scene s = scene("ball.obj");
  s.surfaces[0].material = "dielectric";
  s.surfaces[0].roughness = 0;
  VolumeSettings fog;
  fog.shape = "sphere";
  fog.lo = dvec3(-0.5);
  fog.hi = dvec3(0.5);
  fog.sigma_t = dvec3(50);
  fog.albedo = dvec3(0);
  s.volumes.push_back(fog);
  s.environment.radiance = dvec3(1);
  const Layers f = PreparedScene(s, {}).render(512, 1, {}).layers;
  EXPECT_LT(f.at("R")(8, 8), 0.2f) << "black smoke in the middle, but for reflections";
  EXPECT_GT(f.at("R")(8, 8), 0.03f);
  EXPECT_EQ(f.at("R")(0, 0), 1.0f);
  EXPECT_FALSE(says(PreparedScene(s, {}), "through dielectric meshes"));
  LightSettings point;
  point.type = "point";
  point.position = dvec3(3);
  point.intensity = dvec3(1);
  s.lights.push_back(point);
  EXPECT_TRUE(says(PreparedScene(s, {}), "through dielectric meshes"));
}

// Glass that hardly bends anything: light sampling through it gives what paths through it find, each light once, and
// points as well. 5 standard errors are below 8 %.
TEST_F(SurfaceTest, StraightShadowsOfClearGlassLoseNothing) {
  struct Case {
    const char* light;
    bool traced;  // the reference; else no glass at all
  };
  for (const Case& c : {Case{"sphere", true}, Case{"sun", true}, Case{"mesh", true}, Case{"point", false}}) {
    Scene s = scene("ball.obj");
    s.surfaces[0].material = "dielectric";
    s.surfaces[0].roughness = 0;
    s.surfaces[0].ior = 1.0001;
    s.surfaces[0].albedo = dvec3(c.traced ? 0.7 : 1);
    VolumeSettings fog;
    fog.shape = "sphere";
    fog.lo = dvec3(-0.8);
    fog.hi = dvec3(0.8);
    fog.sigma_t = dvec3(2);
    fog.albedo = dvec3(0.9);
    s.volumes.push_back(fog);
    LightSettings light;
    light.type = c.light;
    light.direction = light.position = dvec3(1, -1, 2.5);
    light.angular_diameter = 50;
    light.irradiance = light.intensity = dvec3(3);
    light.radius = 1;
    light.radiance = dvec3(4);
    light.visible_to_camera = true;
    if (std::string(c.light) == "mesh") {
      s.surfaces.push_back(s.surfaces[0]);
      s.surfaces[1].material = "diffuse";
      s.surfaces[1].radiance = dvec3(4);
      s.surfaces[1].object_to_world = test::translation(light.position + dvec3(0, 0, 0.2));
    } else {
      s.lights.push_back(light);
    }
    const auto render = [&](const char* shadow, int64_t seed) {
      s.surfaces[0].shadow = shadow;
      const RenderResult r = PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(4000, seed, {});
      EXPECT_EQ(r.layers.text("biased").substr(0, 4), std::string(shadow) == "straight" ? "true" : "fals");
      return r.layers;
    };
    const Layers straight = render("straight", 1);
    if (!c.traced) s.surfaces[0].object_to_world = test::translation({0, 0, -1000});
    const Layers reference = render("traced", 2);
    // The glass is an event of its own: behind it all light is indirect.
    const test::Mean a = test::mean_radiance(straight, layer::indirect);
    const test::Mean b = test::mean_radiance(reference, c.traced ? layer::indirect : layer::beauty);
    const double error = 5 * std::hypot(a.error.x, b.error.x);
    EXPECT_NEAR(a.value.x, b.value.x, error) << c.light;
    EXPECT_LT(error, 0.08 * b.value.x) << c.light;
  }
}

// What light sampling cannot see past is left to paths, before and after straight glass: other glass and mirrors. 5
// standard errors are below 3 %, and without that care 7 and 3.5 % of the light were lost.
TEST_F(SurfaceTest, StraightShadowsLeaveTheRestToPaths) {
  for (const char* inner : {"dielectric", "conductor"}) {
    Scene s = scene("ball.obj");
    s.camera.position = dvec3(0, -7, 3);
    s.camera.fov = 50;
    s.surfaces[0].material = "dielectric";
    s.surfaces[0].roughness = 0;
    s.surfaces[0].ior = 1.0001;
    s.surfaces[0].albedo = dvec3(1);
    s.surfaces.push_back(s.surfaces[0]);
    s.surfaces[1].material = inner;
    for (int a = 0; a < 3; ++a) s.surfaces[1].object_to_world[a][a] = 0.7;
    s.surfaces.push_back({});
    s.surfaces[2].file = folder_ / "floor.obj", s.surfaces[2].object_to_world = test::translation({0, 0, -1.1});
    s.surfaces[2].albedo = dvec3(0.8);
    LightSettings lamp;
    lamp.type = "sphere";
    lamp.position = dvec3(0.5, 0, 4);
    lamp.radius = 1;
    lamp.radiance = dvec3(4);
    s.lights.push_back(lamp);
    const auto render = [&](const char* shadow, int64_t seed) {
      s.surfaces[0].shadow = shadow;
      return test::mean_radiance(PreparedScene(s, {}).render(8000, seed, {}).layers);
    };
    const test::Mean a = render("straight", 1), b = render("traced", 2);
    const double error = 5 * std::hypot(a.error.x, b.error.x);
    EXPECT_NEAR(a.value.x, b.value.x, error) << inner;
    EXPECT_LT(error, 0.03 * b.value.x) << inner;
  }
}

TEST(LoadMesh, ReadsObjAndPlyOfAllKinds) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "a.obj", kFloor);
  const std::string header =
      "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n";
  test::write_file(folder / "a.ply",
                   "ply\nformat ascii 1.0\n" + header + "-50 -50 0\n50 -50 0\n50 50 0\n-50 50 0\n4 0 1 2 3\n");
  std::string binary = "ply\nformat binary_little_endian 1.0\n" + header;
  for (const float v : {-50.f, -50.f, 0.f, 50.f, -50.f, 0.f, 50.f, 50.f, 0.f, -50.f, 50.f, 0.f})
    binary.append(reinterpret_cast<const char*>(&v), 4);
  binary += '\4';
  for (const int32_t v : {0, 1, 2, 3}) binary.append(reinterpret_cast<const char*>(&v), 4);
  test::write_file(folder / "b.ply", binary);
  for (const char* name : {"a.obj", "a.ply", "b.ply"}) {
    const TriangleMesh mesh = load_mesh(folder / name, dmat4(1));
    ASSERT_EQ(mesh.triangles.size(), 2u) << name;
    EXPECT_NEAR(mesh.area(0) + mesh.area(1), 1e4, 1e-3);
    EXPECT_NEAR(mesh.normal(0).z, 1, 1e-6);
    EXPECT_NEAR(load_mesh(folder / name, test::scaling(dvec3(1, 1, -1))).normal(0).z, -1, 1e-6)
        << "a mirror keeps the outside outside: what pointed up now points down";
  }
}

TEST(LoadMesh, KeepsVertexNormalsWhereEveryVertexHasOne) {
  const test::TemporaryFolder folder;
  const std::string face = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 1 0 1\n";
  test::write_file(folder / "all.obj", face + "f 1//1 2//2 3//1\n");
  test::write_file(folder / "some.obj", face + "f 1//1 2//2 3\n");
  test::write_file(folder / "zero.obj", face + "vn 0 0 0\nf 1//1 2//2 3//3\n");
  test::write_file(
      folder / "all.ply",
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n0 0 0 0 0 2\n1 0 0 1 0 1\n0 1 0 0 0 2\n3 0 1 2\n");
  for (const char* name : {"all.obj", "all.ply"}) {
    const TriangleMesh mesh = load_mesh(folder / name, test::scaling(dvec3(2, 1, 1)));
    ASSERT_EQ(mesh.normals.size(), 3u) << name;
    EXPECT_NEAR(mesh.normals[0].z, 1, 1e-6) << "made unit";
    EXPECT_NEAR(mesh.normals[1].z / mesh.normals[1].x, 2, 1e-5) << "turned like a plane, not like an edge";
  }
  EXPECT_TRUE(load_mesh(folder / "some.obj", dmat4(1)).normals.empty());
  const TriangleMesh zero = load_mesh(folder / "zero.obj", dmat4(1));
  EXPECT_TRUE(zero.normals.empty());
  ASSERT_EQ(zero.notes.size(), 1u);
  EXPECT_NE(zero.notes[0].find("without a direction"), std::string::npos);
}

TEST(LoadMesh, BrokenFilesSayWhatIsWrong) {
  const test::TemporaryFolder folder;
  const auto error = [&](const std::string& name, const std::string& text) -> std::string {
    test::write_file(folder / name, text);
    try {
      load_mesh(folder / name, dmat4(1));
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  const auto holds = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  EXPECT_TRUE(holds(error("a.stl", "solid"), "neither PLY (by its first bytes) nor OBJ"));
  EXPECT_TRUE(holds(error("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
                    "none of its 1 faces can be used: the one in line 4 has vertices that are not there (9 of 3)"));
  EXPECT_TRUE(holds(error("b.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "no triangle with an area"));
  EXPECT_TRUE(holds(error("c.ply", "ply\nformat ascii 1.0\nelement vertex 3\n"), "header has no end"));
  EXPECT_TRUE(holds(error("d.ply", "ply\nformat binary_mixed_endian 1.0\nend_header\n"), "binary_mixed_endian"));
  EXPECT_TRUE(holds(
      error(
          "e.ply",
          "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\nabc"),
      "truncated"));
  EXPECT_TRUE(holds(error("f.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float a\nend_header\n0\n"),
                    "no x, y, z"));
  // Degenerate triangles beside a good one are dropped and counted; edges shared by three triangles are no matter.
  test::write_file(folder / "g.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 2\nf 1 2 4\nf 2 1 4\n");
  const TriangleMesh mesh = load_mesh(folder / "g.obj", dmat4(1));
  EXPECT_EQ(mesh.triangles.size(), 3u);
  EXPECT_TRUE(holds(mesh.notes.at(0), "1 degenerate"));
}

}  // namespace
}  // namespace brume
