// Volumes that hide what is behind them and are not seen.

#include <gtest/gtest.h>

#include <cmath>

#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/reference_frame.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

VolumeSettings box(double near, double far, const dvec3& sigma_t, const char* role = "visible") {
  VolumeSettings v;
  v.shape = "box";
  v.lo = dvec3(-3, near, -3);
  v.hi = dvec3(3, far, 3);
  v.sigma_t = sigma_t;
  v.albedo = dvec3(0);
  v.role = role;
  return v;
}

Scene scene() {
  Scene s;
  s.camera.type = "orthographic";
  s.camera.position = dvec3(0, -5, 0);
  s.camera.width = 2;
  s.film.width = s.film.height = 8;
  s.environment.radiance = dvec3(0.5);
  return s;
}

dvec3 mean_of(const Layers& frame, const char* layer) {
  dvec3 sum(0);
  const RgbPlanes rgb = frame.rgb(LayerName{layer, "RGB", ""});
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        sum[static_cast<int>(c)] += (*rgb[c])(x, y) / (static_cast<double>(frame.width()) * frame.height());
  return sum;
}

double mean_alpha(const Layers& frame) {
  double sum = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x)
      sum += frame.at("A")(x, y) / (static_cast<double>(frame.width()) * frame.height());
  return sum;
}

// A holdout from 0 to 1, fog that glows from 2 to 3, the sky behind: what is seen is dimmed by both,
// transmittance is all but what the fog covers behind the holdout, colour by colour. 64 pixels of 2,000 paths: five
// standard errors are at most 0.007.
TEST(HoldoutVolumes, HideWhatIsBehindThem) {
  Scene s = scene();
  const dvec3 held(0.3, 0.6, 0.9), fog(0.7, 0.5, 0.2);
  s.volumes = {box(0, 1, held, "holdout"), box(2, 3, fog)};
  s.volumes[0].emission = dvec3(5);  // which is not seen
  s.volumes[1].emission = dvec3(0.4);
  const Layers frame = PreparedScene(s, LayerRequest::of({"transmittance"}, false)).render(2000, 1, {}).layers;
  const dvec3 light = mean_of(frame, ""), left = mean_of(frame, "transmittance");
  for (int c = 0; c < 3; ++c) {
    const double passes = std::exp(-held[c]), covers = -std::expm1(-fog[c]);
    EXPECT_NEAR(1 - left[c], passes * covers, 0.007) << c;
    EXPECT_NEAR(light[c], passes * (0.4 / fog[c] * covers + (1 - covers) * 0.5), 0.007) << c;
  }
}

TEST(HoldoutVolumes, InFrontOfEverythingLeaveNothing) {
  Scene s = scene();
  s.volumes = {box(0, 1, dvec3(50), "holdout")};
  const Layers frame = PreparedScene(s, LayerRequest::of({}, false)).render(8, 1, {}).layers;
  EXPECT_EQ(mean_alpha(frame), 0);
  EXPECT_EQ(mean_of(frame, ""), dvec3(0)) << "not the sky either";
}

/// Smoke in front of and behind held out smoke over a floor, lit by a sun, a lamp and a sky.
Scene smokes() {
  Scene s;
  s.film.width = 32, s.film.height = 24;
  s.camera.position = dvec3(0, -7, 2), s.camera.look_at = dvec3(0, 0, 1);
  s.camera.fov = 34;
  s.environment.radiance = dvec3(0.4, 0.45, 0.5);
  const auto add = [&](const dvec3& at, double sigma_t, const char* role) {
    VolumeSettings v;
    v.file = test::source("data/volumes/smoke.vdb");
    v.sigma_t = dvec3(sigma_t);
    v.albedo = dvec3(0.9, 0.8, 0.7);
    v.object_to_world = test::translation(at);
    v.role = role;
    s.volumes.push_back(v);
  };
  add(dvec3(0.2, 0, 0), 4, "visible");
  add(dvec3(0, 0.5, 0.1), 5, "holdout");
  SurfaceSettings& floor = s.surfaces.emplace_back();
  floor.file = test::source("data/meshes/floor.obj");
  LightSettings sun;
  sun.type = "sun", sun.direction = dvec3(-0.6, -0.4, 0.7), sun.irradiance = dvec3(2), sun.angular_diameter = 5;
  LightSettings lamp;
  lamp.type = "point", lamp.position = dvec3(0.5, 0.3, 1), lamp.intensity = dvec3(0.3);
  s.lights = {sun, lamp};
  return s;
}

TEST(HoldoutVolumes, AreWhatTheDefinitionSays) {
  for (const bool colours : {false, true}) {
    Scene s = smokes();
    if (colours) s.volumes[1].sigma_t = dvec3(3, 4, 5);
    const test::Agreement a = test::agreement(s, 160, 1);
    EXPECT_LT(a.worst, test::kSigmas) << a.text();
    EXPECT_LT(a.detectable, 0.08) << a.text();
  }
}

// The floor in front of the smoke's foot, which no ray sees through it.
TEST(HoldoutVolumes, ThrowTheirShadowsAndScatterLight) {
  Scene s = smokes();
  s.volumes.erase(s.volumes.begin());
  s.volumes[0].object_to_world = test::translation(dvec3(0, 0, 3));  // above the picture
  s.lights.resize(1);
  s.camera.look_at = dvec3(0, -1, -1);
  const auto light = [&](const char* role) {
    s.volumes[0].role = role;
    return PreparedScene(s, LayerRequest::of({}, false)).render(32, 1, {}).layers;
  };
  const Layers held = light("holdout"), seen = light("visible");
  s.volumes.clear();
  const Layers without = PreparedScene(s, LayerRequest::of({}, false)).render(32, 1, {}).layers;
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 32; ++x) ASSERT_EQ(held.at("R")(x, y), seen.at("R")(x, y)) << x << " " << y;
  EXPECT_NE(mean_of(held, ""), mean_of(without, ""));
}

}  // namespace
}  // namespace brume
