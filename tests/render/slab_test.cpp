// Finite isotropic slabs against the values of docs/methods.md, Closed forms. By reciprocity a camera that
// looks straight down at a slab under a uniform upper sky sees the plane albedo R for normal incidence; from below it
// sees what is transmitted.

#include <gtest/gtest.h>

#include "image/exr_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

struct Slab {
  double tau, albedo, reflected, diffuse, direct, up, down;
};
const Slab kSlabs[] = {{1, 1, .34133, .29079, .36788, .08575, .07847},
                       {1, .9, .26741, .22375, .36788, .06685, .06056},
                       {4, 1, .69093, .29076, .01832, .21281, .11000},
                       {10, 1, .85301, .14695, .00005, .27751, .05886}};

class SlabTest : public ::testing::Test {
 protected:
  /// A slab of thickness about 1 and of practically infinite width: the profile along z is free, only tau counts.
  Scene scene(const Slab& slab, bool from_above) {
    const auto path = folder_ / "slab.vdb";
    const dmat4 wide = test::scaling(dvec3(1e5, 1e5, 0.05));
    test::write_affine_vdb(path, {{-8, -8, -10}, {8, 8, 10}}, wide, [](const ivec3&) { return 1.0f; });
    Scene s;
    s.film.width = s.film.height = 16;
    s.camera.position = dvec3(0, 0, from_above ? 50 : -50);
    s.camera.look_at = dvec3(0);
    s.camera.up = dvec3(0, 1, 0);
    s.camera.fov = 0.01;
    s.volumes.emplace_back();
    s.volumes[0].file = path;
    s.volumes[0].albedo = dvec3(slab.albedo);
    // 21 planes of density 1 and a tent's half on either side: 21 voxels of 0.05.
    s.volumes[0].sigma_t = dvec3(slab.tau / (21 * 0.05));
    return s;
  }
  void upper_sky(Scene& s) {
    // The horizon lies between two rows, so that the bilinear look-up's ramp is narrow: one row of many.
    Layers sky(8, 4096);
    for (Plane* p : sky.add_rgb(layer::beauty))
      for (int y = 0; y < 2048; ++y)
        for (int x = 0; x < 8; ++x) (*p)(x, y) = 1.0f;
    write_exr(folder_ / "sky.exr", sky);
    s.environment.file = folder_ / "sky.exr";
    s.environment.radiance = dvec3(1);
  }
  static test::Mean render(const Scene& s, int spp) {
    LayerRequest layers;
    const RenderResult r = PreparedScene(s, layers).render(spp, 5, {});
    EXPECT_EQ(r.report.counters.capped_paths, 0u);
    return test::mean_radiance(r.layers);
  }
  test::TemporaryFolder folder_;
};

// 256 x 2000 paths: 3 standard errors are below 0.6 % of R; so a bias of 0.6 % would be found with probability one
// half, one of 1 % almost surely.
TEST_F(SlabTest, PlaneAlbedoAndTransmittanceUnderAUniformSky) {
  for (const Slab& slab : kSlabs) {
    Scene above = scene(slab, true), below = scene(slab, false);
    upper_sky(above);
    upper_sky(below);
    const test::Mean r = render(above, 2000), t = render(below, 2000);
    EXPECT_NEAR(r.value.x, slab.reflected, 3 * r.error.x + 3e-4) << "tau " << slab.tau << " albedo " << slab.albedo;
    EXPECT_LT(3 * r.error.x, 0.01 * slab.reflected);
    EXPECT_NEAR(t.value.x, slab.diffuse + slab.direct, 3 * t.error.x + 3e-4)
        << "tau " << slab.tau << " albedo " << slab.albedo;
  }
}

// The same slabs lit by a sun in the zenith, which only next-event estimation finds: radiance straight up and down.
TEST_F(SlabTest, RadianceUnderAZenithSun) {
  for (const double diameter : {0.0, 1.0})
    for (const Slab& slab : kSlabs) {
      for (const bool from_above : {true, false}) {
        Scene s = scene(slab, from_above);
        // The sun off the camera's axis by nothing: the camera itself casts no shadow.
        LightSettings sun;
        sun.type = "sun";
        sun.direction = dvec3(0, 0, 1);
        sun.irradiance = dvec3(1);
        sun.angular_diameter = diameter;
        s.lights.push_back(sun);
        const test::Mean m = render(s, 600);
        EXPECT_NEAR(m.value.x, from_above ? slab.up : slab.down, 3 * m.error.x + 2e-5)
            << "tau " << slab.tau << " albedo " << slab.albedo << " above " << from_above;
        EXPECT_LT(3 * m.error.x, 0.04 * (from_above ? slab.up : slab.down));
      }
    }
}

}  // namespace
}  // namespace brume
