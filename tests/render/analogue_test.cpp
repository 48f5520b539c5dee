// A second opinion: an analogue tracer that shares no code with the renderer's estimators but the density look-up. It
// takes tiny absorption by chance, one global majorant, no next-event estimation, no Sobol points, its own phase
// sampling.

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/running_statistics.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

/// Direct and indirect radiance of one path from the eye, absorbed by chance.
struct Analogue {
  const Medium& medium;
  double albedo, g;
  dvec3 sun_axis;
  double sun_cosine, sun_radiance, sky;
  std::mt19937_64 generator{42};
  std::uniform_real_distribution<double> uniform{0.0, 1.0};

  double radiance(const dvec3& d, bool seen) const {
    return sky + (!seen && glm::dot(d, sun_axis) >= sun_cosine ? sun_radiance : 0.0);
  }

  std::pair<double, int> trace(dvec3 o, dvec3 d) {
    const double majorant = medium.extinction_per_density() * medium.bricks().maximum();
    const Medium::Sphere bound = medium.bounding_sphere();
    for (int events = 0;;) {
      o += d * (-std::log1p(-uniform(generator)) / majorant);
      const dvec3 away = o - bound.centre;
      if (glm::length(away) > bound.radius && glm::dot(away, d) > 0) return {radiance(d, events == 0), events};
      if (uniform(generator) * majorant >= medium.sigma_t(medium.to_local(o))) continue;
      if (uniform(generator) >= albedo) return {0.0, events};
      // Textbook inversion of Henyey and Greenstein, and an arbitrary perpendicular.
      const double t = (1 - g * g) / (1 - g + 2 * g * uniform(generator)), c = (1 + g * g - t * t) / (2 * g);
      const dvec3 side = glm::normalize(glm::cross(d, std::abs(d.x) < 0.5 ? dvec3(1, 0, 0) : dvec3(0, 1, 0)));
      const double phi = 2 * kPi * uniform(generator);
      d = glm::normalize(c * d + std::sqrt(std::max(0.0, 1 - c * c)) *
                                     (std::cos(phi) * side + std::sin(phi) * glm::cross(d, side)));
      ++events;
    }
  }
};

// On a real smoke and a real cloud, direct and indirect apart. Sum of both errors below 1.5 % of each component at one
// standard error: a bias of 5 % of either would be found.
TEST(Analogue, TheTracerAgreesWithIt) {
  for (const char* volume : {"data/volumes/smoke.vdb", "data/volumes/cloud.vdb"}) {
    const bool cloud = std::string(volume).find("cloud") != std::string::npos;
    Scene scene = test::scene_of(test::source(volume), cloud ? 12 : 18, cloud ? 0.97 : 0.8, cloud ? 0.6 : 0.2);
    scene.environment.radiance = dvec3(0.3);
    LightSettings sun;
    sun.type = "sun";
    sun.direction = dvec3(-0.5, -0.6, 0.7);
    sun.irradiance = dvec3(2);
    sun.angular_diameter = 60;  // wide enough for phase sampling to find
    scene.lights.push_back(sun);
    scene.camera.fov = 12;
    const PreparedScene prepared(scene, {});
    const RenderResult r = prepared.render(600, 3, {});
    const test::Mean direct = test::mean_radiance(r.layers, layer::direct),
                     indirect = test::mean_radiance(r.layers, layer::indirect);

    const double half_angle = 30 * kPi / 180;
    Analogue analogue{*prepared.medium(),
                      scene.volumes[0].albedo.x,
                      scene.volumes[0].g,
                      glm::normalize(sun.direction),
                      std::cos(half_angle),
                      2 / (kPi * std::sin(half_angle) * std::sin(half_angle)),
                      0.3};
    const Camera camera(scene.camera, scene.film.width, scene.film.height, prepared.world_shift());
    RunningStatistics d, i;
    for (int n = 0; n < 1000000; ++n) {
      const Ray ray = camera.ray({analogue.uniform(analogue.generator) * scene.film.width,
                                  analogue.uniform(analogue.generator) * scene.film.height});
      const auto [radiance, events] =
          analogue.trace(ray.o + ray.d * (glm::distance(ray.o, prepared.medium()->bounding_sphere().centre) -
                                          prepared.medium()->bounding_sphere().radius),
                         ray.d);
      d.add(events < 2 ? radiance : 0.0);
      i.add(events < 2 ? 0.0 : radiance);
    }
    EXPECT_NEAR(direct.value.x, d.mean, 4 * std::hypot(direct.error.x, std::sqrt(d.mean_variance()))) << volume;
    EXPECT_NEAR(indirect.value.x, i.mean, 4 * std::hypot(indirect.error.x, std::sqrt(i.mean_variance()))) << volume;
    EXPECT_LT(std::hypot(direct.error.x, std::sqrt(d.mean_variance())), 0.015 * d.mean);
    EXPECT_LT(std::hypot(indirect.error.x, std::sqrt(i.mean_variance())), 0.015 * i.mean);
  }
}

}  // namespace
}  // namespace brume
