// Single scattering in a homogeneous sphere against the values of docs/methods.md, Closed forms, and other closed forms
// that need a camera, a light and a medium together.

#include <gtest/gtest.h>

#include <cmath>

#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "volume/tracking.h"

namespace brume {
namespace {

constexpr int kRadius = 48;  // voxels; the sphere's rim is one voxel wide

class SphereTest : public ::testing::Test {
 protected:
  SphereTest() {
    test::write_affine_vdb(
        folder_ / "sphere.vdb", {ivec3(-kRadius - 1), ivec3(kRadius + 1)}, test::scaling(dvec3(1.0 / kRadius)),
        [](const ivec3& v) { return static_cast<float>(std::clamp(kRadius + 0.5 - glm::length(dvec3(v)), 0.0, 1.0)); });
  }
  /// Looks along +y through the centre; the light comes from `to_light`.
  Scene scene(double optical_radius, const dvec3& to_light, double g) {
    Scene s;
    s.film.width = s.film.height = 8;
    s.camera.position = dvec3(0, -20, 0);
    s.camera.look_at = dvec3(0);
    s.camera.fov = 0.02;
    s.volumes.emplace_back();
    s.volumes[0].file = folder_ / "sphere.vdb";
    s.volumes[0].sigma_t = dvec3(optical_radius);
    s.volumes[0].albedo = dvec3(1);
    s.volumes[0].g = g;
    LightSettings sun;
    sun.type = "sun";
    sun.direction = to_light;
    sun.irradiance = dvec3(1);
    sun.angular_diameter = 0;
    s.lights.push_back(sun);
    return s;
  }
  test::TemporaryFolder folder_;
};

/// Single scattering along the middle ray of the voxelised sphere, by quadrature over exact optical depths: no chance
/// in it.
double single_scattering(const PreparedScene& prepared, const dvec3& to_light) {
  const Medium& medium = *prepared.medium();
  const dvec3 shift = prepared.world_shift(), d(0, 1, 0);
  const int n = 2000;
  double sum = 0;
  for (int i = 0; i < n; ++i) {
    const dvec3 p = dvec3(0, -1.03 + 2.06 * (i + 0.5) / n, 0) - shift;
    const double sigma = medium.sigma_t(medium.to_local(p));
    if (sigma == 0) continue;
    const double tau = optical_depth(medium, medium.to_local(Ray{p, -d}), 10) +
                       optical_depth(medium, medium.to_local(Ray{p, glm::normalize(to_light)}), 10);
    sum += sigma * std::exp(-tau) * 2.06 / n;
  }
  return sum * medium.phase().value(to_light.y);
}

// The tracer against quadrature of the same voxels (64 x 4000 paths, 4.5 standard errors: a bias of 1 % would be found,
// at a = 5 of 2 %), and the quadrature against the closed forms, from which voxels of radius / 48 may differ by their
// rim.
TEST_F(SphereTest, SingleScatteringIsTheDirectLayer) {
  struct Row {
    double a, side, back, forward, rim;
  };
  for (const Row& row : {Row{.5, .034331, .034404, .029275, .01},
                         {1, .033304, .039060, .021539, .01},
                         {2, .022542, .039775, .005830, .02},
                         {5, .011159, .039789, .000036, .08}}) {
    for (const auto& [direction, exact] :
         {std::pair(dvec3(0, 0, 1), row.side), {dvec3(0, -1, 0), row.back}, {dvec3(0, 1, 0), row.forward}}) {
      for (const double g : {0.0, 0.5}) {
        const PreparedScene prepared(scene(row.a, direction, g), {});
        const test::Mean m = test::mean_radiance(prepared.render(4000, 2, {}).layers, layer::direct);
        // cos between propagation directions: light travels along -direction, then along -y to the eye.
        const double phase = 4 * kPi * HenyeyGreenstein{g}.value(direction.y);
        const double voxels = single_scattering(prepared, direction);
        EXPECT_NEAR(m.value.x, voxels, 4.5 * m.error.x + 1e-3 * voxels)
            << "a " << row.a << " light " << direction.y << " g " << g;
        EXPECT_NEAR(voxels, exact * phase, row.rim * exact * phase)
            << "a " << row.a << " light " << direction.y << " g " << g;
      }
    }
  }
}

TEST_F(SphereTest, TransmittanceLayerIsBeerLambert) {
  for (const double a : {0.25, 1.0, 2.5}) {
    const RenderResult r = PreparedScene(scene(a, dvec3(0, 0, 1), 0), {}).render(4000, 2, {});
    const test::Mean m = test::mean_radiance(r.layers, layer::transmittance);
    EXPECT_NEAR(m.value.x, std::exp(-2 * a), 4 * m.error.x + 0.004 * std::exp(-2 * a) * 2 * a);
  }
}

// A sphere light in a thin medium against next-event estimation's own alternative, phase sampling: two estimators that
// share nothing but the medium. 4 standard errors, below 3 %.
TEST_F(SphereTest, LightSamplingAndPhaseSamplingAgreeOnEveryLight) {
  for (const double g : {0.0, 0.7})
    for (const bool inside : {false, true}) {
      Scene s = scene(1.5, dvec3(0, 0, 1), g);
      s.lights.clear();
      s.camera.fov = 8;
      s.environment.radiance = dvec3(0.1, 0.2, 0.3);
      LightSettings ball;
      ball.type = "sphere";
      ball.position = inside ? dvec3(0.2, 0.3, 0.1) : dvec3(1.5, 0.5, 1.2);
      ball.radius = inside ? 0.15 : 0.5;
      ball.radiance = dvec3(5, 3, 1);
      s.lights.push_back(ball);
      LightSettings sun;
      sun.type = "sun";
      sun.direction = dvec3(-1, -1, 1);
      sun.irradiance = dvec3(1);
      sun.angular_diameter = 40;
      s.lights.push_back(sun);
      const auto mean = [&](const char* mode) {
        s.render.light_sampling = mode;
        return test::mean_radiance(PreparedScene(s, {}).render(3000, 7, {}).layers);
      };
      const test::Mean a = mean("auto"), b = mean("none"), c = mean("all");
      for (int k = 0; k < 3; ++k) {
        EXPECT_NEAR(a.value[k], b.value[k], 4.5 * std::hypot(a.error[k], b.error[k]))
            << "g " << g << " inside " << inside;
        EXPECT_NEAR(c.value[k], b.value[k], 4.5 * std::hypot(c.error[k], b.error[k]))
            << "g " << g << " inside " << inside;
        EXPECT_LT(4.5 * std::hypot(a.error[k], b.error[k]), 0.05 * a.value[k]);
      }
    }
}

}  // namespace
}  // namespace brume
