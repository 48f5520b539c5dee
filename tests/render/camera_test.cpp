#include "render/world/camera.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/math.h"
#include "base/rng.h"
#include "image/exr_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

CameraSettings settings() {
  CameraSettings s;
  s.position = dvec3(1, -5, 2);
  s.look_at = dvec3(0.5, 0, 1);
  return s;
}

CameraSettings with_lens(int blades) {
  CameraSettings s = settings();
  s.lens_radius = 0.3;
  s.focus_distance = 4;
  s.blades = blades;
  s.blade_rotation = 12;
  return s;
}

TEST(Camera, OrthographicRaysAreParallelAndAsWideAsAsked) {
  CameraSettings s = settings();
  s.type = "orthographic";
  s.width = 3;
  const Camera camera(s, 60, 40);
  const Ray left = camera.ray({0, 20}), right = camera.ray({60, 20}), top = camera.ray({30, 0});
  EXPECT_EQ(left.d, right.d);
  EXPECT_NEAR(glm::distance(left.o, right.o), 3, 1e-12);
  EXPECT_NEAR(glm::distance(top.o, camera.ray({30, 40}).o), 2, 1e-12);
  EXPECT_NEAR(glm::dot(top.d, glm::normalize(s.look_at - s.position)), 1, 1e-12);
}

// What lies a quarter of the width to the right, and a tenth of the height below, is in the middle of the picture.
TEST(Camera, AShiftMovesThePictureWithoutTurning) {
  for (const char* type : {"perspective", "orthographic"})
    for (const double radius : {0.0, 0.2}) {
      CameraSettings s = settings();
      s.type = type;
      s.width = 3;
      s.lens_radius = radius;
      const Camera straight(s, 60, 40);
      s.shift = {0.25, -0.1};
      const Camera shifted(s, 60, 40);
      for (const dvec2& film : {dvec2(0, 0), dvec2(30, 20), dvec2(44, 33)}) {
        const Ray a = shifted.ray(film, {0.3, 0.8}), b = straight.ray(film + dvec2(15, 4), {0.3, 0.8});
        EXPECT_NEAR(glm::distance(a.o, b.o), 0, 1e-12) << type;
        EXPECT_NEAR(glm::distance(a.d, b.d), 0, 1e-12) << type;
      }
    }
}

// Pixels 1.5 times as wide as high: the picture is as wide as asked for, and a third less high.
TEST(Camera, PixelsNeedNotBeSquare) {
  CameraSettings s = settings();
  s.type = "orthographic";
  s.width = 3;
  s.pixel_aspect = 1.5;
  const auto across = [](const Camera& c) { return glm::distance(c.ray({0, 20}).o, c.ray({60, 20}).o); };
  const auto down = [](const Camera& c) { return glm::distance(c.ray({30, 0}).o, c.ray({30, 40}).o); };
  const Camera along_x(s, 60, 40);
  EXPECT_NEAR(across(along_x), 3, 1e-12);
  EXPECT_NEAR(down(along_x), 2 / 1.5, 1e-12);
  s.fov_axis = "y";
  const Camera along_y(s, 60, 40);
  EXPECT_NEAR(across(along_y), 3 * 1.5 * 1.5, 1e-12);
  EXPECT_NEAR(down(along_y), 3, 1e-12);
}

// Also of pixels that span tens of degrees. And no cone of a pinhole is wider than what its corners need.
TEST(Camera, ABeamHoldsEveryRayOfItsPixel) {
  Rng rng(2);
  for (const char* type : {"perspective", "orthographic"})
    for (const double radius : {0.0, 0.4})
      for (const int width : {5, 300}) {
        CameraSettings s = settings();
        s.type = type;
        s.width = 3;
        s.fov = 100;
        s.lens_radius = radius;
        s.blades = rng.uniform() < 0.5 ? 0 : 5;
        s.shift = {0.4, -0.3};
        s.pixel_aspect = 0.7;
        const Camera camera(s, width, width);
        const int x = width / 5, y = width - 1;
        const std::optional<RayCone> cone = camera.ray_cone({x, y}, {x + 1, y + 1});
        ASSERT_TRUE(cone);
        double widest = 0;
        for (int i = 0; i < 2000; ++i) {
          const bool corner = i < 4;
          const dvec2 film = corner ? dvec2(i & 1, i >> 1) : dvec2(rng.uniform(), rng.uniform());
          const Ray ray = camera.ray(dvec2(x, y) + film, {rng.uniform(), rng.uniform()});
          ASSERT_LE(glm::distance(ray.o, cone->middle.o), cone->apart + 1e-12);
          ASSERT_LE(glm::distance(ray.d, cone->middle.d), cone->apart_per_t + 1e-12);
          widest = std::max(widest, glm::distance(ray.d, cone->middle.d));
        }
        EXPECT_LT(cone->apart_per_t, (radius > 0 ? 2.0 : 1.0 + 1e-9) * widest + 1e-12);
      }
  CameraSettings moving = settings();
  moving.position_end = {1, -4, 2}, moving.shutter = {0, 0.5};
  EXPECT_FALSE(Camera(moving, 10, 10).ray_cone({0, 0}, {1, 1}));
}

// Points of a lens by area and direction: even in both, they fill it as uniform ones do.
TEST(Camera, ItsLensHasAMiddleAndPlacesByDirection) {
  for (const int blades : {0, 5, 6}) {
    const CameraSettings s = with_lens(blades);
    const Camera lens(s, 60, 40);
    EXPECT_LT(glm::distance(lens.ray({50, 9}).o, s.position), 1e-12);
    const double rim = glm::distance(lens.ray({50, 9}, lens.lens_at(0, 1 - 1e-9)).o, s.position);
    EXPECT_NEAR(rim, 0.3, 1e-6) << "a corner, where the polygon has one";
    dvec3 mean(0);
    double second = 0;
    const int n = 60;
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < n; ++k) {
        const dvec3 o = lens.ray({50, 9}, lens.lens_at((i + 0.5) / n, (k + 0.5) / n)).o - s.position;
        mean += o / static_cast<double>(n * n);
        second += glm::dot(o, o) / (n * n);
      }
    EXPECT_LT(glm::length(mean), 1e-6) << blades;
    const double exact = blades == 0 ? 0.045 : 0.09 * (2 + std::cos(2 * kPi / blades)) / 6;
    EXPECT_NEAR(second, exact, 1e-4) << blades;
  }
}

// All rays of one film point meet in the plane of focus, and their origins fill the aperture.
TEST(Camera, ALensFocuses) {
  Rng rng(1);
  for (const int blades : {0, 6}) {
    CameraSettings s = with_lens(blades);
    const Camera lens(s, 60, 40);
    s.lens_radius = 0;
    const Camera pinhole(s, 60, 40);
    const Ray centre = pinhole.ray({50, 9});
    const dvec3 forward = glm::normalize(s.look_at - s.position);
    const dvec3 focus = centre.at(4 / glm::dot(centre.d, forward));
    dvec3 mean(0);
    double second = 0;
    const int n = 20000;
    for (int i = 0; i < n; ++i) {
      const Ray r = lens.ray({50, 9}, {rng.uniform(), rng.uniform()});
      ASSERT_LE(glm::distance(r.o, s.position), 0.3 + 1e-9);
      ASSERT_NEAR(glm::length(glm::cross(focus - r.o, r.d)), 0, 1e-9);
      mean += (r.o - s.position) / static_cast<double>(n);
      second += glm::dot(r.o - s.position, r.o - s.position) / n;
    }
    EXPECT_NEAR(glm::length(mean), 0, 0.006);
    // Mean square radius: R^2 / 2 of a disc, R^2 (2 + cos(2 pi / n)) / 6 of a polygon.
    const double exact = blades == 0 ? 0.045 : 0.09 * (2 + std::cos(2 * kPi / blades)) / 6;
    EXPECT_NEAR(second, exact, 0.0008);
  }
}

TEST(Camera, MovesOverTheShutter) {
  CameraSettings s = settings();
  s.shutter = {0, 1};
  s.position_end = {2, -5, 2};
  const Camera camera(s, 60, 40);
  EXPECT_TRUE(camera.moves());
  s.shutter = {0, 0};
  EXPECT_FALSE(Camera(s, 60, 40).moves());
  EXPECT_NEAR(camera.ray({30, 20}, dvec2(0.5), 0.5).o.x, 1.5, 1e-12);
  EXPECT_NEAR(camera.ray({30, 20}, dvec2(0.5), 1.0).o.x, 2.0, 1e-12);
  // Rolling about its view by a quarter: what was right is up.
  CameraSettings roll = settings();
  roll.position = dvec3(0, -5, 0), roll.look_at = dvec3(0), roll.up = {0, 0, 1};
  roll.shutter = {0, 1};
  roll.up_end = {1, 0, 0};
  const Camera rolling(roll, 60, 60);
  EXPECT_TRUE(rolling.moves());
  EXPECT_NEAR(glm::distance(rolling.ray({60, 30}, dvec2(0.5), 0).d, rolling.ray({30, 0}, dvec2(0.5), 1).d), 0, 1e-12);
}

TEST(Camera, IsTakenFromAnExrHeader) {
  const test::TemporaryFolder folder;
  CameraSettings s = settings();
  s.up = dvec3(0.1, 0.2, 1);
  s.fov = 33;
  s.shift = {0.2, 0.15};
  s.pixel_aspect = 1.3;
  const Camera original(s, 60, 40);
  Layers frame(60, 40);
  frame.add_rgb(layer::beauty);
  frame.header["worldToCamera"] = original.world_to_camera();
  frame.header["worldToNDC"] = original.world_to_ndc();
  write_exr(folder / "frame.exr", frame);
  CameraSettings copy;
  copy.from_exr = folder / "frame.exr";
  const Camera camera(copy, 60, 40);
  for (const dvec2& film : {dvec2(0, 0), dvec2(30, 20), dvec2(60, 11)}) {
    const Ray a = original.ray(film), b = camera.ray(film);
    EXPECT_NEAR(glm::distance(a.o, b.o), 0, 1e-5);
    EXPECT_NEAR(glm::distance(a.d, b.d), 0, 1e-6);
  }
  EXPECT_THROW(Camera(copy, 90, 40), InputError) << "another shape";

  // Lens and motion are the scene's; while it turns, up is the header's.
  CameraSettings moving = s;
  moving.shutter = dvec2(0, 1);
  moving.position_end = {s.position.x + 0.5, s.position.y, s.position.z};
  moving.look_at_end = {s.look_at.x + 0.2, s.look_at.y + 0.1, s.look_at.z};
  moving.lens_radius = 0.1;
  const Camera in_motion(moving, 60, 40);
  moving.from_exr = folder / "frame.exr";
  for (const double time : {0.0, 0.3, 1.0}) {
    const Ray a = in_motion.ray(dvec2(11, 7), dvec2(0.9, 0.3), time),
              b = Camera(moving, 60, 40).ray(dvec2(11, 7), dvec2(0.9, 0.3), time);
    EXPECT_NEAR(glm::distance(a.o, b.o), 0, 2e-4) << time;
    EXPECT_NEAR(glm::distance(a.d, b.d), 0, 2e-4) << time;
  }

  // Orthographic; shifted, as by a film back; along +z, as RenderMan's matrices are.
  const auto adopted = [&](std::array<float, 16> to_camera, std::array<float, 16> to_ndc) {
    frame.header["worldToCamera"] = to_camera, frame.header["worldToNDC"] = to_ndc;
    write_exr(folder / "frame.exr", frame);
    CameraSettings c;
    c.from_exr = folder / "frame.exr";
    return Camera(c, 60, 40);
  };
  CameraSettings parallel = s;
  parallel.type = "orthographic";
  parallel.width = 3;
  const Camera flat(parallel, 60, 40), flat_copy = adopted(flat.world_to_camera(), flat.world_to_ndc());
  std::array<float, 16> shifted = original.world_to_ndc(), forwards = original.world_to_camera();
  for (size_t row = 0; row < 4; ++row) {
    shifted[row * 4] += 0.5f * shifted[row * 4 + 3];
    shifted[row * 4 + 1] -= 0.25f * shifted[row * 4 + 3];
    forwards[row * 4 + 2] = -forwards[row * 4 + 2];
  }
  std::array<float, 16> flat_forwards = flat.world_to_camera();
  for (size_t row = 0; row < 4; ++row) flat_forwards[row * 4 + 2] = -flat_forwards[row * 4 + 2];
  const Camera flat_ahead = adopted(flat_forwards, flat.world_to_ndc());
  const Camera moved = adopted(original.world_to_camera(), shifted), ahead = adopted(forwards, original.world_to_ndc());
  const Camera again = adopted(moved.world_to_camera(), moved.world_to_ndc());
  for (const dvec2& film : {dvec2(0, 0), dvec2(30, 20), dvec2(60, 11)}) {
    EXPECT_NEAR(glm::distance(flat.ray(film).o, flat_copy.ray(film).o), 0, 1e-5);
    EXPECT_NEAR(glm::distance(flat.ray(film).d, flat_copy.ray(film).d), 0, 1e-6);
    EXPECT_NEAR(glm::distance(original.ray(film).d, ahead.ray(film).d), 0, 1e-6);
    EXPECT_NEAR(glm::distance(flat.ray(film).d, flat_ahead.ray(film).d), 0, 1e-6);
    // Half an extent to the right and a quarter down: 15 and 5 pixels.
    EXPECT_NEAR(glm::distance(original.ray(film).d, moved.ray(film + dvec2(15, 5)).d), 0, 1e-6);
    EXPECT_NEAR(glm::distance(again.ray(film).d, moved.ray(film).d), 0, 1e-6);
  }
  Layers bare(4, 4);
  bare.add_rgb(layer::beauty);
  write_exr(folder / "bare.exr", bare);
  copy.from_exr = folder / "bare.exr";
  EXPECT_THROW(Camera(copy, 60, 40), InputError);
}

}  // namespace
}  // namespace brume
