// Small lights inside homogeneous media: their light along flights, against quadrature and against collisions alone.

#include "render/transport/near_light.h"

#include <gtest/gtest.h>

#include <cmath>

#include "render/session/renderer.h"

namespace brume {
namespace {

Scene lamp_in_fog(const char* type, double sigma_t) {
  Scene s;
  s.film.width = s.film.height = 12;
  s.camera.position = dvec3(0, -6, 0);
  s.camera.look_at = dvec3(0);
  s.camera.fov = 30;
  s.volumes.emplace_back();
  s.volumes[0].shape = "box";
  s.volumes[0].sigma_t = dvec3(sigma_t);
  s.volumes[0].albedo = dvec3(0.7);
  s.volumes[0].g = 0.3;
  for (int a = 0; a < 3; ++a) s.volumes[0].object_to_world[a][a] = 4;
  LightSettings lamp;
  lamp.type = type;
  lamp.position = dvec3(0.2, 0.3, -0.1);
  lamp.direction = dvec3(0, -1, -0.2);
  lamp.intensity = dvec3(2);
  lamp.radiance = dvec3(2000);
  lamp.radius = 0.01;
  s.lights.push_back(lamp);
  return s;
}

/// Light scattered once from the lamp as a point, by quadrature over angles, along the ray through (x, y) of the film.
double airlight(const PreparedScene& prepared, const Scene& s, const Ray& ray, double intensity) {
  const Medium& medium = *prepared.medium();
  const auto [t0, t1] = medium.homogeneous()->intersect(medium.to_local(ray));
  if (!(t1 > t0)) return 0;
  const double sigma = s.volumes[0].sigma_t.x;
  const dvec3 lamp = s.lights[0].position - prepared.world_shift();
  const double nearest = glm::dot(lamp - ray.o, ray.d), h = glm::length(lamp - ray.at(nearest));
  const double a = std::atan((t0 - nearest) / h), b = std::atan((t1 - nearest) / h);
  constexpr int kSteps = 300;
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double theta = a + (b - a) * (i + 0.5) / kSteps, t = nearest + h * std::tan(theta);
    const dvec3 to_lamp = lamp - ray.at(t);
    const double r = glm::length(to_lamp), phase = medium.phase().value(glm::dot(ray.d, to_lamp / r));
    sum += std::exp(-sigma * (t - t0 + r)) * phase / h;  // 1 / r^2 dt = dtheta / h
  }
  return sum * (b - a) / kSteps * sigma * s.volumes[0].albedo.x * intensity;
}

// Single scattering of a point light in fog of optical depth 0.2 to 6, for the same rays: to one part in a hundred.
TEST(NearLight, SingleScatteringIsTheAirlightIntegral) {
  for (const double sigma : {0.05, 0.5, 1.5}) {
    const Scene s = lamp_in_fog("point", sigma);
    const PreparedScene prepared(s, LayerRequest::of({"single"}, true));
    EXPECT_FALSE(prepared.plan().near_lights.empty());
    constexpr int kPaths = 1000;
    const Layers frame = prepared.render(kPaths, 1, {}).layers;
    const Camera camera(s.camera, 12, 12, prepared.world_shift());
    double expected = 0, found = 0;
    for (int y = 0; y < 12; ++y)
      for (int x = 0; x < 12; ++x) {
        for (uint32_t k = 0; k < kPaths; ++k)
          expected += airlight(prepared, s, prepared.request(camera, 1, x, y, k).ray, 2) / kPaths;
        found += frame.at("single.R")(x, y);
      }
    EXPECT_NEAR(found, expected, 0.01 * expected) << sigma;
  }
}

// The split changes no mean: points, spots and spheres; grey and chromatic; beside a second medium; seen by paths of
// every length. 4.5 standard errors of the collisions' estimate are below a quarter of the light, and far below of the
// direct.
TEST(NearLight, ChangesNoMean) {
  for (const char* type : {"point", "spot", "sphere"})
    for (const bool chromatic : {false, true})
      for (const bool overlap : {false, true}) {
        Scene s = lamp_in_fog(type, 0.8);
        if (chromatic) s.volumes[0].sigma_t = dvec3(1.2, 0.8, 0.3);
        if (overlap) {
          s.volumes.push_back(s.volumes[0]);
          s.volumes[1].shape = "sphere";
          s.volumes[1].sigma_t = dvec3(0.5);
          for (int a = 0; a < 3; ++a) s.volumes[1].object_to_world[a][a] = 2;
        }
        const auto light = [&](const char* setting, const LayerName& l, double& variance) {
          s.render.near_lights = setting;
          const Layers frame =
              PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(600, 4, {}).layers;
          double sum = 0;
          for (size_t c = 0; c < 3; ++c)
            for (int y = 0; y < 12; ++y)
              for (int x = 0; x < 12; ++x) {
                // The pixels around the lamp, whose collisions' estimate has no bounded variance, are the airlight
                // test's.
                if (std::abs(x - 6) < 2 && std::abs(y - 6) < 2) continue;
                sum += frame.at(l.channel(c))(x, y);
                variance += 3 * frame.at(l.channel_of(statistic::mean_variance, c))(x, y);
              }
          return sum;
        };
        for (const LayerName& l : {layer::direct, layer::indirect}) {
          double variance = 0;
          const double split = light("auto", l, variance), whole = light("off", l, variance);
          EXPECT_NEAR(split, whole, 4.5 * std::sqrt(variance)) << type << chromatic << overlap << l.label();
          EXPECT_LT(4.5 * std::sqrt(variance), (l == layer::direct ? 0.12 : 0.5) * whole)
              << type << chromatic << overlap << l.label();
        }
      }
}

// Only where it pays: lights outside, or in grids and in empty space, are left to collisions.
TEST(NearLight, IsTakenInsideHomogeneousMediaOnly) {
  Scene s = lamp_in_fog("point", 1);
  EXPECT_FALSE(PreparedScene(s, {}).plan().near_lights.empty());
  s.lights[0].position = dvec3(5, 0, 0);
  EXPECT_TRUE(PreparedScene(s, {}).plan().near_lights.empty());
  s = lamp_in_fog("point", 1);
  s.render.near_lights = "off";
  EXPECT_TRUE(PreparedScene(s, {}).plan().near_lights.empty());
}

}  // namespace
}  // namespace brume
