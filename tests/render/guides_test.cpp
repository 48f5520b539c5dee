// Guides: what a camera ray can know without a random number, against closed forms and the path tracer.

#include "render/guides/guides.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "render/guides/attenuation.h"
#include "render/guides/scattering_solver.h"
#include "render/guides/sun_depth.h"
#include "render/guides/sweep.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

double sum_of(const Layers& frame, const std::string& channel) {
  double sum = 0;
  const Plane& plane = frame.at(channel);
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) sum += v;
  return sum;
}

Layers render(const Scene& scene, const std::vector<std::string>& layers, int spp = 1) {
  return PreparedScene(scene, LayerRequest::of(layers, false)).render(spp, 1).layers;
}

Layers guides_of(const Scene& scene, double step = 0.7, int threads = 0) {
  const PreparedScene prepared(scene, LayerRequest::of({"direct"}, false));
  Layers frame(scene.film.width, scene.film.height);
  const Task task{threads};
  Guides(prepared.context(), 1, scene.film.width * scene.film.height, task, step)
      .record(prepared.camera(), {0, 0}, frame, task);
  return frame;
}

/// A ball of radius 1 at the origin in a sun, seen along y.
Scene ball(double sigma_t, double g) {
  Scene s;
  s.name = "ball";
  s.camera.position = {0, -6, 0};
  s.camera.fov = 24;
  s.film.width = s.film.height = 40;
  s.volumes.emplace_back();
  VolumeSettings& v = s.volumes[0];
  v.shape = "sphere";
  v.lo = dvec3(-1);
  v.hi = dvec3(1);
  v.sigma_t = dvec3(sigma_t);
  v.albedo = dvec3(0.9);
  v.g = g;
  LightSettings sun;
  sun.type = "sun";
  sun.direction = {0.6, -0.5, 0.62};
  sun.irradiance = dvec3(2);
  sun.angular_diameter = 0;
  s.lights.push_back(sun);
  return s;
}

TEST(Guides, OpacityIsWhatTheTracerDoesNotSeeThrough) {
  for (const char* name : {"cloud", "smoke"}) {
    const Layers frame = render(test::demo(name, 64), {"transmittance", "guides"}, 64);
    const double expected = 64.0 * 64.0 - sum_of(frame, "transmittance.R");
    EXPECT_NEAR(sum_of(frame, "guide.opacity.Y") / expected, 1.0, 0.01) << name;
  }
}

// Along each ray: sigma_s p(cos) E exp(-sigma_t (t + s)), t and s being the chords to the eye and to the sun.
TEST(Guides, SingleScatteringOfABallIsItsClosedForm) {
  for (const double sigma : {0.01, 1.0, 5.0})
    for (const double g : {0.0, 0.6}) {
      const Scene scene = ball(sigma, g);
      const Layers frame = guides_of(scene);
      const Camera camera(scene.camera, scene.film.width, scene.film.height);
      const dvec3 sun = glm::normalize(scene.lights[0].direction);
      const auto exit = [](const dvec3& p, const dvec3& d) {
        const double b = glm::dot(p, d);
        return -b + std::sqrt(std::max(0.0, b * b + 1 - glm::dot(p, p)));
      };
      for (const int x : {12, 20, 26}) {
        const Ray ray = camera.ray({x + 0.5, 18.5});
        const double b = glm::dot(ray.o, ray.d), root = std::sqrt(b * b + 1 - glm::dot(ray.o, ray.o));
        constexpr int kSteps = 20000;
        double expected = 0;
        for (int i = 0; i < kSteps; ++i) {
          const double t = (i + 0.5) / kSteps * 2 * root;
          const dvec3 p = ray.at(-b - root + t);
          expected += std::exp(-sigma * (t + exit(p, sun))) * 2 * root / kSteps;
        }
        expected *= sigma * 0.9 * 2 * HenyeyGreenstein{g}.value(glm::dot(sun, ray.d));
        EXPECT_NEAR(frame.at("guide.single.sun.Y")(x, 18) / expected, 1.0, 0.02) << sigma << " " << g << " " << x;
      }
    }
}

// Everything that is predicted, against the tracer: the sun and the sky, once and many times scattered.
TEST(Guides, PredictedLightOfThinSmokeIsTheTracersWithinThreePercent) {
  const Layers frame = render(test::demo("smoke", 64), {"direct", "indirect", "guides"}, 256);
  for (const char* channel : {"R", "G", "B"}) {
    const std::string c = std::string(".") + channel;
    EXPECT_NEAR(sum_of(frame, "guide.predicted_direct" + c) / sum_of(frame, "direct" + c), 1.0, 0.01) << channel;
    EXPECT_NEAR(sum_of(frame, "guide.predicted_indirect" + c) / sum_of(frame, "indirect" + c), 1.0, 0.03) << channel;
  }
}

TEST(Guides, HalfTheStepChangesNothingByMoreThanAHundredth) {
  const Scene scene = test::demo("cloud", 64);
  const Layers whole = guides_of(scene), half = guides_of(scene, 0.35);
  for (const std::string& name : whole.names()) {
    const Plane &a = whole.at(name), &b = half.at(name);
    float largest = 0, difference = 0;
    double squares = 0;
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x) {
        largest = std::max(largest, std::abs(a(x, y)));
        difference = std::max(difference, std::abs(a(x, y) - b(x, y)));
        squares += std::pow(a(x, y) - b(x, y), 2);
      }
    // The direction of the trilinear field's gradient jumps from voxel to voxel: single pixels may turn.
    const float allowed = name.find("gradient") != std::string::npos ? 0.2f : 0.015f;
    EXPECT_LE(difference, allowed * largest) << name;
    EXPECT_LE(std::sqrt(squares / (64 * 64)), 0.1 * allowed * largest) << name;
  }
}

// Rays from rough metal take long steps: relative to what is seen in it, root mean square.
TEST(Guides, HalfTheStepChangesWhatIsMirroredByLessThanAThousandth) {
  for (const char* const file : {"floor_and_balls", "fire_room", "behind_glass"}) {
    Scene scene = read_scene(test::source(std::string("bench/scenes/general/") + file + ".toml"));
    scene.film.width = 64;
    scene.film.height = 48;
    const Layers whole = guides_of(scene), half = guides_of(scene, 0.35);
    for (const std::string& name : whole.names()) {
      if (!name.starts_with("guide.surface.mirrored")) continue;
      const Plane &a = whole.at(name), &b = half.at(name);
      double squares = 0, all = 0;
      for (int y = 0; y < a.height(); ++y)
        for (int x = 0; x < a.width(); ++x) {
          squares += std::pow(a(x, y) - b(x, y), 2);
          all += std::pow(b(x, y), 2);
        }
      EXPECT_LE(std::sqrt(squares), 1e-3 * std::sqrt(all)) << file << ": " << name;
    }
  }
}

TEST(Guides, AreTheSameForAnyNumberOfThreads) {
  const Scene scene = test::demo("smoke", 32);
  test::expect_same_bits(guides_of(scene, 0.7, 1), guides_of(scene, 0.7, 3));
}

// Rays are marched 1, 4, 8 or 16 side by side.
TEST(Guides, AreTheSameOnEveryInstructionSet) {
  Scene sphere_lit = ball(3, 0.5);
  LightSettings lamp;
  lamp.type = "sphere";
  lamp.position = {1.5, -1, 0};
  lamp.radius = 0.1;
  lamp.radiance = dvec3(40);
  sphere_lit.lights.push_back(lamp);
  for (const Scene& scene : {test::demo("cloud", 32), test::demo("fire", 32), sphere_lit}) {
    const PreparedScene prepared(scene, LayerRequest::of({"direct"}, false));
    const Guides guides(prepared.context(), 1, 32 * 32);
    const auto marched = [&] {
      Layers frame(scene.film.width, scene.film.height);
      guides.record(prepared.camera(), {0, 0}, frame, {});
      return frame;
    };
    const Layers best = marched();
    test::on_every_target(
        [&](const std::string& name) { test::expect_same_bits(best, marched(), scene.name + " " + name); });
  }
}

// Next to a homogeneous medium of no consequence, media are looked up point by point, in double precision, and the
// sun's light is added up so. What the sky sends is left out: of several media its phase function is another
// approximation; density, too, of which the largest counts.
TEST(Guides, OfMediaLookedUpSideBySideAreThoseLookedUpPointByPoint) {
  for (const char* name : {"cloud", "smoke"}) {
    Scene scene = test::demo(name, 48);
    const Layers side_by_side = guides_of(scene);
    VolumeSettings faint = scene.volumes[0];
    faint.shape = "box";
    faint.file.clear();
    faint.grid.clear();
    const PreparedScene prepared(scene, LayerRequest::of({"direct"}, false));
    const Medium::Sphere sphere = prepared.context().media[0].bounding_sphere();
    faint.lo = sphere.centre + prepared.world_shift() - 0.1 * sphere.radius;
    faint.hi = sphere.centre + prepared.world_shift() + 0.1 * sphere.radius;
    faint.object_to_world = dmat4(1);
    faint.sigma_t = dvec3(1e-9);
    scene.volumes.push_back(faint);
    const Layers point_by_point = guides_of(scene);
    for (const std::string& layer : side_by_side.names()) {
      if (layer == "guide.density.Y" || layer == "guide.single.sky.Y" || layer == "guide.multiple.sky_forward.Y")
        continue;
      const Plane &a = side_by_side.at(layer), &b = point_by_point.at(layer);
      double squares = 0, difference = 0;
      for (int y = 0; y < a.height(); ++y)
        for (int x = 0; x < a.width(); ++x) {
          squares += std::pow(static_cast<double>(b(x, y)), 2);
          difference += std::pow(static_cast<double>(a(x, y) - b(x, y)), 2);
        }
      EXPECT_LE(std::sqrt(difference), 5e-3 * std::sqrt(squares) + 1e-6) << name << " " << layer;
    }
  }
}

TEST(Guides, OfACropAreThoseOfTheWhole) {
  const PreparedScene scene(test::demo("smoke", 48), LayerRequest::of({"guides"}, false));
  RenderJob job;
  job.spp = 1;
  const Layers whole = scene.render(job).layers;
  job.crop = RenderJob::Crop{10, 5, 30, 33};
  const Layers part = scene.render(job).layers;
  for (const std::string& name : part.names()) {
    if (!name.starts_with("guide.")) continue;
    for (int y = 0; y < part.height(); ++y)
      for (int x = 0; x < part.width(); ++x)
        ASSERT_EQ(part.at(name)(x, y), whole.at(name)(x + 10, y + 5)) << name << " " << x << " " << y;
  }
}

TEST(Guides, AreTheSameWhereSomeAreStored) {
  Scene scene = test::demo("fire", 40);
  scene.film.height = 150;
  const PreparedScene prepared(scene, LayerRequest::of({"direct"}, false));
  const Guides guides(prepared.context(), 1, 40 * 150);
  Layers whole(40, 150), parted(40, 150);
  guides.record(prepared.camera(), {0, 0}, whole, {});
  const auto is_stored = [](const std::string& channel) { return channel.starts_with("guide.multiple."); };
  guides.record_stored(prepared.camera(), {0, 0}, parted, {}, is_stored);
  EXPECT_GT(parted.stored().size(), 10u);
  Layers kept(40, 150);
  for (const auto& [name, plane] : whole.channels()) {
    if (!is_stored(name)) {
      kept.set(name, plane);
      continue;
    }
    Plane back;
    parted.stored().at(name).read(back, {});
    for (int y = 0; y < 150; ++y) {
      float most = 0;
      for (const float v : plane.pixels(y)) most = std::max(most, std::abs(v));
      for (int x = 0; x < 40; ++x) ASSERT_NEAR(back(x, y), plane(x, y), most / 16383) << name << " " << x << " " << y;
    }
  }
  test::expect_same_bits(kept, parted);
}

// Who watches gets each pixel once, and in the end the bits of who waits: grey, and of three colours.
TEST(Guides, AreTheSameForWhoWatchesThemCome) {
  for (const char* name : {"fire", "coloured_smoke"}) {
    Scene scene = test::demo(std::string(name) == "fire" ? "fire" : "smoke", 90);
    if (std::string(name) == "coloured_smoke") scene.volumes[0].sigma_t *= dvec3(0.5, 1, 1.5);
    const PreparedScene prepared(scene, LayerRequest::of({"direct"}, false));
    const ivec2 size(scene.film.width, scene.film.height);
    const Guides guides(prepared.context(), 1, size.x * size.y);
    Layers whole(size.x, size.y), watched(size.x, size.y);
    guides.record(prepared.camera(), {0, 0}, whole, {});
    Plane times(size.x, size.y);
    int calls = 0;
    guides.record_watched(prepared.camera(), watched, {}, [&](const ivec2& from, const ivec2& to) {
      ++calls;
      for (int y = from.y; y < to.y; ++y)
        for (int x = from.x; x < to.x; ++x) ++times(x, y);
    });
    EXPECT_GT(calls, 1) << name;
    for (int y = 0; y < size.y; ++y)
      for (int x = 0; x < size.x; ++x) ASSERT_EQ(times(x, y), 1) << name << " " << x << " " << y;
    test::expect_same_bits(whole, watched);
  }
}

TEST(Guides, OfChromaticMediaHaveColours) {
  Scene scene = ball(1, 0);
  scene.volumes[0].sigma_t = {0.5, 1, 2};
  const Layers frame = guides_of(scene);
  EXPECT_LT(frame.at("guide.opacity.R")(20, 20), frame.at("guide.opacity.B")(20, 20));
  EXPECT_TRUE(frame.find("guide.single.sun.G"));
  EXPECT_FALSE(frame.find("guide.single.sun.Y"));
}

TEST(Guides, AreFiniteThroughALensInMotionAndBehindGlass) {
  Scene scene = test::demo("cloud", 24);
  scene.camera.lens_radius = 0.1;
  scene.camera.shutter = {0, 1};
  scene.camera.position_end = {0.3, -6.2, 1.0};
  scene.surfaces.emplace_back();
  scene.surfaces[0].file = test::source("data/meshes/ball.obj");
  scene.surfaces[0].material = "dielectric";
  scene.surfaces[0].object_to_world = translation({0, -3, 1}) * test::scaling(dvec3(0.4));
  const Layers frame = guides_of(scene);
  for (const std::string& name : frame.names()) EXPECT_EQ(count_not_finite(frame.at(name)), 0u) << name;
  EXPECT_EQ(frame.at("guide.opacity.Y")(12, 12), 0.0f) << "of media before the first surface";
  EXPECT_GT(frame.at("guide.surface.mirrored_indirect.G")(12, 12), 0.05f) << "the cloud is seen through the glass";
}

// What is out of focus is spread to all sides: a ball's picture stays where it is.
TEST(Guides, AreSpreadEvenlyByALens) {
  Scene scene = ball(1, 0);
  scene.film.width = scene.film.height = 40;
  scene.camera.lens_radius = 0.2;
  scene.camera.focus_distance = 0.5 * glm::distance(scene.camera.position, scene.camera.look_at);
  const auto middle = [](const Layers& frame, const std::string& name) {
    dvec2 sum(0);
    double all = 0;
    const Plane& plane = frame.at(name);
    for (int y = 0; y < plane.height(); ++y)
      for (int x = 0; x < plane.width(); ++x) {
        sum += static_cast<double>(plane(x, y)) * dvec2(x, y);
        all += plane(x, y);
      }
    return sum / all;
  };
  for (const int blades : {0, 6}) {
    scene.camera.blades = blades;
    const dvec2 guide = middle(guides_of(scene), "guide.opacity.Y");
    EXPECT_LT(glm::distance(guide, middle(render(scene, {"direct"}, 64), "A")), 0.1) << blades;
  }
}

TEST(Guides, KnowWhatStandsBehindTheMediumAndItsShadow) {
  Scene scene = ball(1, 0);
  scene.surfaces.emplace_back();
  scene.surfaces[0].file = test::source("data/meshes/floor.obj");
  scene.surfaces[0].albedo = dvec3(0.5);
  scene.surfaces[0].object_to_world = translation({0, 0, -1.1});
  scene.film.width = scene.film.height = 64;
  scene.camera.fov = 40;
  const Layers frame = render(scene, {"surface", "guides"}, 64);
  EXPECT_NEAR(sum_of(frame, "guide.surface.sun.G") / sum_of(frame, "surface.G"), 1.0, 0.02);
}

TEST(SunDepth, IsTheOpticalDepthTowardsTheSun) {
  const BrickGrid bricks = test::make_bricks({{0, 0, 0}, {30, 20, 24}}, [](const ivec3& v) {
    return 0.5f + 0.5f * std::sin(0.4f * static_cast<float>(v.x) + 0.3f * static_cast<float>(v.y * v.z) / 20);
  });
  const std::vector<Medium> media = {Medium(bricks, test::scaling(dvec3(0.1)), 3.0, dvec3(0.9), 0.0)};
  const GuideMedia guide_media(media, {}, 0);
  Rng rng(7);
  for (int i = 0; i < 6; ++i) {
    const dvec3 sun = test::random_direction(rng);
    const SunDepth depth(guide_media, kGrey, sun, 0.1, 1000000, {});
    for (int k = 0; k < 50; ++k) {
      const dvec3 p = test::random_point(rng, dvec3(0.1), dvec3(2.8, 1.8, 2.2));
      const double expected = optical_depth(media[0], media[0].to_local(Ray{p, sun}), 100);
      EXPECT_NEAR(depth.at(p), expected, 0.1 + 0.03 * expected) << i;
    }
  }
}

TEST(Attenuation, IsTheExponential) {
  for (double depth = 0; depth < 720; depth += depth < 2 ? 1e-3 : 0.37)
    EXPECT_NEAR(attenuation(depth), std::exp(-depth), 1e-8 * std::exp(-depth) + 1e-300) << depth;
}

class Sweep : public test::EveryTarget {};

// A slab across the sweep's axis: what enters is attenuated by the whole depth, what is emitted saturates.
TEST_P(Sweep, ThroughASlabIsTheClosedForm) {
  SweepDomain domain{{40, 9, 11}, 16};
  std::vector<float> thickness(domain.size(), 0.0f), light(domain.size(), 1.0f), glow(domain.size(), 0.0f);
  const auto at = [&](int x, int y, int z) { return (static_cast<size_t>(x) * 9 + y) * 16 + z; };
  for (int x = 10; x < 30; ++x)
    for (int y = 0; y < 9; ++y)
      for (int z = 0; z < 11; ++z) {
        thickness[at(x, y, z)] = 0.2f;
        glow[at(x, y, z)] = 0.2f * 3;
      }
  SweepMedia media{thickness.data(), {}, 0};
  SweepBeam beam{{1, 0, 0}, {1, 0, 0, 0}, 1, light.data()};
  std::vector<float> moments[4];
  for (auto& m : moments) m.assign(domain.size(), 0.0f);
  const std::array<float*, 4> sums = {moments[0].data(), moments[1].data(), moments[2].data(), moments[3].data()};
  beam.factor = {0.5f, 0, -2, 0};
  const std::array both = {beam, beam};
  sweep(domain, media, both, sums);
  EXPECT_NEAR(light[at(35, 4, 5)], std::exp(-4.0), 1e-4);
  EXPECT_FLOAT_EQ(moments[0][at(35, 4, 5)], light[at(35, 4, 5)]);
  EXPECT_FLOAT_EQ(moments[2][at(35, 4, 5)], -4 * light[at(35, 4, 5)]);

  media.source[0] = glow.data();
  media.sources = 1;
  const SweepBeam back{{-1, 0, 0}, {1, 0, 0, 0}, 0, light.data()};
  sweep(domain, media, {&back, 1}, {});
  EXPECT_NEAR(light[at(4, 4, 5)], 3 * (1 - std::exp(-4.0)), 0.01);
}
INSTANTIATE_TEST_SUITE_P(Targets, Sweep, ::testing::ValuesIn(test::targets()), test::target_name);

// In an even sky a medium that absorbs nothing is invisible: all orders together are the sky again.
TEST(ScatteringSolver, KeepsTheEnergyOfAnEvenSky) {
  const BrickGrid bricks = test::constant_box({0, 0, 0}, {23, 23, 23});
  const std::vector<Medium> media = {Medium(bricks, dmat4(1.0), 0.15, dvec3(1), 0.5)};
  const GuideMedia guide_media(media, {}, 0);
  ScatteringSolver solver(Lattice::over(guide_media.lo(), guide_media.hi(), 1, 1000000), guide_media, kGrey, {});
  const std::vector<double> sky(ScatteringSolver::directions().size(), 1.0);
  Radiance light = solver.entering(sky), sum = light;
  for (int order = 1; order < 120; ++order) {
    light = solver.transport(solver.scatter(std::move(light)));
    solver.add(light, sum);
  }
  const Lattice& l = solver.lattice();
  for (const int x : {4, 8, 13}) EXPECT_NEAR(sum[0][l.index(x, l.n.y / 2, l.n.z / 2)], 1.0, 0.03) << x;
}

}  // namespace
}  // namespace brume
