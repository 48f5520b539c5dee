// Scenes on which the renderer was once seen to be wrong, stuck or blind: each says what the right answer is.

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>

#include "image/exr_io.h"
#include "render/session/renderer.h"
#include "render/transport/wavefront.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

constexpr VoxelBox kBlock{{2, 2, 2}, {17, 17, 17}};

/// White noise, the roughest density there is.
float noise(const ivec3& v) {
  const uint64_t cell = (static_cast<uint64_t>(v.x) * 1000 + v.y) * 1000 + v.z;
  return static_cast<float>(mix64(cell + 1) >> 40) * 0x1p-24f;
}

class HardCases : public ::testing::Test {
 protected:
  std::filesystem::path block(const std::function<float(const ivec3&)>& density) {
    const std::filesystem::path file = folder_ / "block.vdb";
    test::write_affine_vdb(file, kBlock, dmat4(1.0), density);
    return file;
  }
  /// The block from a corner, `scale` times as large, with a sky.
  Scene scene(const std::filesystem::path& volume, double sigma_t, double scale = 1) {
    Scene s;
    s.name = "hard";
    s.camera.position = scale * dvec3(-30, -12, 24);
    s.camera.look_at = scale * dvec3(9.5);
    s.camera.fov = 35;
    s.film.width = s.film.height = 24;
    s.environment.radiance = dvec3(0.2);
    s.volumes.emplace_back();
    s.volumes[0].file = volume;
    s.volumes[0].sigma_t = dvec3(sigma_t / scale);
    s.volumes[0].albedo = dvec3(0.9);
    s.volumes[0].object_to_world = test::scaling(dvec3(scale));
    return s;
  }
  static void add_sun(Scene& s, double diameter) {
    LightSettings sun;
    sun.type = "sun";
    sun.direction = dvec3(0.05, 0.02, 1);
    sun.irradiance = dvec3(3);
    sun.angular_diameter = diameter;
    s.lights.push_back(sun);
  }
  static Layers render(const Scene& s, int spp, const std::vector<std::string>& layers = {"direct", "indirect"}) {
    return PreparedScene(s, LayerRequest::of(layers, false)).render(spp, 1).layers;
  }
  static double mean(const Layers& frame, const char* channel) {
    const Plane& p = frame.at(channel);
    double sum = 0;
    for (int y = 0; y < p.height(); ++y)
      for (int x = 0; x < p.width(); ++x) sum += p(x, y);
    return sum / (p.width() * p.height());
  }

  test::TemporaryFolder folder_;
};

// A lamp that one path in a hundred thousand finds: at first every pixel is black, and none is known to be.
TEST_F(HardCases, ATargetErrorIsNotReachedByABlackPicture) {
  Scene s = scene(block(noise), 0.6);
  s.environment.radiance = dvec3(0);
  s.render.light_sampling = "none";
  LightSettings lamp;
  lamp.type = "sphere";
  lamp.position = dvec3(9, 9, 40);
  lamp.radius = 0.5;
  lamp.radiance = dvec3(20000);
  s.lights.push_back(lamp);
  RenderJob job;
  job.spp = 96;
  job.target_error = 0.05;
  const RenderResult r = PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(job);
  EXPECT_EQ(r.report.samples_per_pixel, 96);
  EXPECT_GT(*r.report.error, 0.05);
  EXPECT_GT(*r.layers.number("estimatedRelativeError"), 0.05);
}

// The estimate is the error, where everything has been seen: against a frame of many samples.
TEST_F(HardCases, TheEstimatedErrorIsTheErrorOfAnOrdinaryPicture) {
  Scene s = scene(block([](const ivec3&) { return 1.0f; }), 0.3);
  add_sun(s, 0.5);
  const PreparedScene prepared(s, LayerRequest::of({"direct", "indirect"}, true));
  const Layers exact = prepared.render(4096, 2).layers;
  for (const int spp : {16, 64, 256}) {
    const RenderResult r = prepared.render(spp, 3);
    double sum = 0;
    for (int y = 0; y < 24; ++y)
      for (int x = 0; x < 24; ++x)
        for (const char* c : {"R", "G", "B"}) {
          const double e = exact.at(c)(x, y), d = r.layers.at(c)(x, y) - e;
          sum += d * d / (e * e + 0.01);
        }
    // What every window borrows from the whole picture makes it cautious while there are few samples.
    const double ratio = *r.report.error / std::sqrt(sum / (3 * 24 * 24));
    EXPECT_GT(ratio, 0.85) << spp << " samples";
    EXPECT_LT(ratio, spp < 64 ? 1.4 : 1.2) << spp << " samples";
  }
}

TEST_F(HardCases, ATargetThatIsReachedEndsTheRender) {
  Scene s = scene(block([](const ivec3&) { return 1.0f; }), 0.3);
  RenderJob job;
  job.spp = 100000;
  job.target_error = 0.1;
  const RenderResult r = PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(job);
  EXPECT_LT(r.report.samples_per_pixel, 4096);
  EXPECT_LE(*r.report.error, 0.1);
}

// All numbers scale with the world by powers of two: not one bit of the picture may depend on it.
TEST_F(HardCases, TheWorldMayBeOfAnySize) {
  const auto picture = [&](double scale, const char* majorants) {
    Scene s = scene(block(noise), 0.6, scale);
    add_sun(s, 0.5);
    s.render.majorants = majorants;
    return render(s, 4, {"direct", "indirect", "gradient", "coverage"});
  };
  for (const char* majorants : {"cells", "global"}) {
    const Layers ordinary = picture(1, majorants);
    EXPECT_GT(mean(ordinary, "R"), 0.1);
    for (const int power : {-73, -40, 40, 73})
      test::expect_same_bits(ordinary, picture(std::ldexp(1.0, power), majorants),
                             "2^" + std::to_string(power) + ", majorants " + majorants);
  }
}

// The same where paths live in the world: two grids across one another, one of a colour, and a shape around them.
TEST_F(HardCases, AWorldOfSeveralMediaMayBeOfAnySize) {
  const auto picture = [&](double scale) {
    Scene s = scene(block(noise), 0.3, scale);
    add_sun(s, 0.5);
    s.volumes.push_back(s.volumes[0]);
    s.volumes[1].object_to_world = test::translation(dvec3(scale * 6, 0, 0)) * s.volumes[1].object_to_world;
    s.volumes[1].sigma_t = dvec3(0.2, 0.3, 0.5) / scale;
    VolumeSettings fog;
    fog.shape = "sphere";
    fog.lo = scale * dvec3(-6);
    fog.hi = scale * dvec3(26);
    fog.sigma_t = dvec3(0.02 / scale);
    fog.albedo = dvec3(0.8);
    s.volumes.push_back(fog);
    const PreparedScene prepared(s, LayerRequest::of({"direct", "indirect", "gradient", "coverage"}, false));
    EXPECT_FALSE(prepared.plan().one_grid);
    return prepared.render(4, 1).layers;
  };
  const Layers ordinary = picture(1);
  EXPECT_GT(mean(ordinary, "R"), 0.1);
  for (const int power : {-73, -40, 40, 73})
    test::expect_same_bits(ordinary, picture(std::ldexp(1.0, power)), "2^" + std::to_string(power));
}

// A hundred million mean free paths across a voxel: more than single precision can tell apart.
TEST_F(HardCases, FlightsThroughExtremelyDenseMediaEnd) {
  Scene s = scene(block([](const ivec3&) { return 1.0f; }), 1e8);
  s.volumes[0].albedo = dvec3(0.5);
  const PreparedScene prepared(s, LayerRequest::of({"direct", "indirect"}, false));
  EXPECT_EQ(prepared.plan().media, std::vector{Precision::kDouble});
  const double dense = mean(prepared.render(64, 1).layers, "R");
  s.volumes[0].sigma_t = dvec3(1e4);  // as opaque
  EXPECT_NEAR(dense, mean(render(s, 64), "R"), 0.01 * dense);
}

TEST_F(HardCases, ATinySunIsAParallelOne) {
  Scene s = scene(block(noise), 0.6);
  add_sun(s, 0);
  const Layers parallel = render(s, 4);
  s.lights[0].angular_diameter = 1e-18;
  test::expect_same_bits(parallel, render(s, 4));
}

// Haze of 1e-7 of the density that the same cells hold elsewhere: its share of a collision is below what 24 bits tell.
TEST_F(HardCases, ForcedCollisionsSeeHazeBesideDenseVoxels) {
  Scene s = scene(block([](const ivec3& v) { return v.x < 8 || v.x > 11 ? 1.0f : 1e-7f; }), 1250);
  s.camera.type = "orthographic";
  s.camera.position = dvec3(9.5, 9.5, 60);
  s.camera.look_at = dvec3(9.5, 9.5, 0);
  s.camera.up = dvec3(0, 1, 0);
  s.camera.width = 0.5;
  s.environment.radiance = dvec3(0);
  s.volumes[0].albedo = dvec3(1);
  add_sun(s, 0);
  s.lights[0].direction = dvec3(1, 0.1, 0.05);
  s.film.width = s.film.height = 8;
  s.render.first_collision = "forced";
  const PreparedScene prepared(s, LayerRequest::of({"direct", "indirect", "transmittance"}, false));
  ASSERT_TRUE(prepared.plan().first_collision.forced);
  const double optical_depth = 1250 * 1e-7 * 16;  // fifteen voxels and, on either side, one that falls to 0
  const double passed = mean(prepared.render(256, 1).layers, "transmittance.R");
  EXPECT_NEAR(1 - passed, -std::expm1(-optical_depth), 0.01 * optical_depth);
}

// One definition for every tracer and every size of pixels: the density reaches the threshold somewhere on the ray.
TEST_F(HardCases, CoverageOfARoughDensityIsTheSameForAll) {
  Scene s = scene(block(noise), 0.5);
  s.camera.fov = 30;
  const auto exact = [&] {
    s.film.width = s.film.height = 64;
    const PreparedScene prepared(s, LayerRequest::of({}, false));
    const Medium& medium = *prepared.medium();
    const double iso = s.render.surface_density * medium.maximum_density();
    const Camera camera = prepared.camera();
    double met = 0;
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x)
        for (uint32_t k = 0; k < 4; ++k) {
          const Ray ray = medium.to_local(prepared.request(camera, 1, x, y, k).ray);
          bool meets = false;
          for (double t = 10; t < 80 && !meets; t += 1.0 / 64) meets = medium.density(ray.at(t)) >= iso;
          met += meets;
        }
    return met / (64 * 64 * 4);
  }();
  for (const char* majorants : {"cells", "global"})
    for (const int size : {16, 64, 128}) {
      s.film.width = s.film.height = size;
      s.render.majorants = majorants;
      const double coverage = mean(render(s, 64 * 64 * 4 / (size * size), {"coverage"}), "coverage.A");
      EXPECT_NEAR(coverage, exact, size == 64 ? 2e-4 : 4e-3) << size << " pixels, majorants " << majorants;
    }
}

// What a flight asks while it is under way: majorants a hundred million times too large make it practically endless.
TEST_F(HardCases, EndlessFlightsListenToTheStopSignal) {
  for (const char* majorants : {"cells", "global"}) {
    Scene s = scene(block([](const ivec3&) { return 1e-3f; }), 1e-3);
    s.render.majorant_scale = 1e12;
    s.render.first_collision = "free";
    s.render.majorants = majorants;
    const PreparedScene prepared(s, LayerRequest::of({"direct", "indirect"}, false));
    std::atomic<bool> cancel{true};
    StopSignal stop{&cancel};
    PathContext context = prepared.context();
    context.stop = &stop;
    const PathRequest request = prepared.request(prepared.camera(), 1, 12, 12, 0);
    PathCounters counters;
    EXPECT_THROW(trace_paths(
                     context, {&request, 1}, [](size_t, const PathSample&) {}, counters),
                 Interrupted)
        << majorants;
  }
}

TEST_F(HardCases, TimeThatRunsOutInsideAFlightLeavesWhatThereIs) {
  Scene s = scene(block([](const ivec3&) { return 1e-3f; }), 1e-3);
  s.render.majorant_scale = 1e12;
  s.film.width = s.film.height = 4;
  RenderJob job;
  job.spp = 4;
  job.time_limit = 0.01;
  const RenderResult r = PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(job);
  EXPECT_EQ(r.report.samples_per_pixel, 0);
  EXPECT_EQ(mean(r.layers, "sample_count.Y"), 0);
}

// What a session did before is counted once, in every checkpoint it writes.
TEST_F(HardCases, AResumedRenderRemembersWhatWentWrong) {
  Scene s = scene(block([](const ivec3&) { return 1.0f; }), 2);
  s.render.max_events = 3;
  const PreparedScene prepared(s, LayerRequest::of({"direct", "indirect"}, true));
  const auto job_of = [&](int spp) {
    RenderJob job;
    job.spp = spp;
    job.program = "test";
    job.checkpoint = folder_ / "c.exr";
    return job;
  };
  const auto count = [](const Layers& frame, const char* key) { return *frame.number(key); };
  const Layers whole = prepared.render(job_of(8)).layers;
  EXPECT_GT(count(whole, "cappedPaths"), 0);
  EXPECT_EQ(count(read_exr_state(folder_ / "c.exr"), "cappedPaths"), count(whole, "cappedPaths"));

  prepared.render(job_of(4));
  Layers half = read_exr_state(folder_ / "c.exr");
  half.header["invalidSampleCount"] = 5;  // as if some had been
  write_exr(folder_ / "half.exr", half);
  RenderJob rest = job_of(8);
  rest.resume = folder_ / "half.exr";
  const Layers resumed = prepared.render(rest).layers, saved = read_exr_state(folder_ / "c.exr");
  for (const Layers* frame : {&resumed, &saved}) {
    EXPECT_EQ(count(*frame, "cappedPaths"), count(whole, "cappedPaths"));
    EXPECT_EQ(count(*frame, "invalidSampleCount"), 5);
  }
}

}  // namespace
}  // namespace brume
