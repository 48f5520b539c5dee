#include "render/guides/matte_pixels.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "render/scene/matte_names.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

VolumeSettings volume(const std::string& shape, const dvec3& lo, const dvec3& hi, const dvec3& sigma_t) {
  VolumeSettings v;
  v.shape = shape;
  v.lo = lo;
  v.hi = hi;
  v.sigma_t = sigma_t;
  v.albedo = dvec3(0.5);
  return v;
}

VolumeSettings smoke(const std::string& name, const dvec3& at, double sigma_t) {
  VolumeSettings v;
  v.file = test::source("data/volumes/smoke.vdb");
  v.name = name;
  v.sigma_t = dvec3(sigma_t);
  v.object_to_world = dmat4(1);
  v.object_to_world[3] = glm::dvec4(at, 1);
  return v;
}

class MattePixels : public ::testing::Test {
 protected:
  MattePixels() {
    scene_.camera.type = "orthographic";
    scene_.camera.position = dvec3(0, -5, 0);
    scene_.camera.width = 2;
    scene_.film.width = scene_.film.height = 16;
    scene_.environment.radiance = dvec3(1);
  }
  MatteRecord record() {
    const PreparedScene prepared(scene_, LayerRequest::of({}, false));
    RenderJob job;
    job.spp = 1;
    job.mattes = true;
    return *prepared.render(job).mattes;
  }
  /// A thing's share of a pixel.
  float share(const MatteRecord& record, const std::string& object, int x, int y) const {
    float sum = 0;
    for (const auto& s : record.pixels[static_cast<size_t>(y) * scene_.film.width + x])
      if (record.things[s.thing].object == object) sum += s.coverage;
    return sum;
  }
  float alpha(const MatteRecord& record, int x, int y) const {
    float sum = 0;
    for (const auto& s : record.pixels[static_cast<size_t>(y) * scene_.film.width + x]) sum += s.coverage;
    return sum;
  }
  Scene scene_;
  test::TemporaryFolder folder_;
};

// Two boxes along y that overlap in the middle third, of one extinction for each colour.
TEST_F(MattePixels, OverlappingVolumesShareByTheirExtinction) {
  scene_.volumes = {volume("box", dvec3(-2, 0, -2), dvec3(2, 2, 2), dvec3(0.3, 0.6, 0.9)),
                    volume("box", dvec3(-2, 1, -2), dvec3(2, 3, 2), dvec3(1.0, 0.5, 0.25))};
  scene_.volumes[0].name = "a";
  scene_.volumes[1].name = "b";
  const MatteRecord found = record();
  double a = 0, b = 0, left = 0;
  for (int c = 0; c < 3; ++c) {
    const double sa = scene_.volumes[0].sigma_t[c], sb = scene_.volumes[1].sigma_t[c];
    const double first = std::exp(-sa), both = first * std::exp(-sa - sb);
    a += (1 - first + (first - both) * sa / (sa + sb)) / 3;
    b += ((first - both) * sb / (sa + sb) + both * (1 - std::exp(-sb))) / 3;
    left += both * std::exp(-sb) / 3;
  }
  EXPECT_NEAR(share(found, "a", 8, 8), a, 1e-6);
  EXPECT_NEAR(share(found, "b", 8, 8), b, 1e-6);
  EXPECT_NEAR(alpha(found, 3, 12), 1 - left, 1e-6);
}

// The same by paths: the alpha of one volume where the other is a holdout is what it covers. 6,000 samples: five
// deviations are 0.033 of a pixel, less than 0.0015 of the mean.
TEST_F(MattePixels, AlphaBehindHoldoutsIsTheMatte) {
  scene_.camera.type = "perspective";
  scene_.camera.position = dvec3(0, -8, 1);
  scene_.camera.look_at = dvec3(0, 0, 1);
  scene_.camera.fov = 20;
  scene_.film.width = scene_.film.height = 10;
  scene_.volumes = {smoke("near", dvec3(0), 20), smoke("far", dvec3(-0.7, 0.5, 0.1), 10)};
  const MatteRecord mattes = record();
  for (const int kept : {0, 1}) {
    scene_.volumes[static_cast<size_t>(kept)].role = "visible";
    scene_.volumes[static_cast<size_t>(1 - kept)].role = "holdout";
    const Layers frame = PreparedScene(scene_, LayerRequest::of({}, false)).render(6000, 1, {}).layers;
    const MatteRecord held = record();
    double difference = 0, most = 0, covered = 0;
    for (int y = 0; y < 10; ++y)
      for (int x = 0; x < 10; ++x) {
        const double matte = share(mattes, kept == 0 ? "near" : "far", x, y), by_paths = frame.at("A")(x, y);
        difference += (matte - by_paths) / 100;
        most = std::max(most, std::abs(matte - by_paths));
        covered += matte / 100;
        EXPECT_NEAR(alpha(held, x, y), matte, 1e-6) << "a holdout covers nothing, and the other what it did";
      }
    EXPECT_GT(covered, 0.02);
    EXPECT_LT(most, 0.033 + 0.01) << kept;  // and of what 89 rays miss
    EXPECT_LT(std::abs(difference), 0.0015 + 5e-4) << kept;
  }
}

// A half plane of any slope: its share of a pixel is known to a hundredth or two, on average far better.
TEST_F(MattePixels, EdgesOfSurfacesCoverTheirArea) {
  scene_.camera.width = 2;
  const double slope = 0.37;
  test::write_file(folder_ / "half.obj",
                   fmt::format("v -3 0 {}\nv 3 0 {}\nv 3 0 -9\nv -3 0 -9\nf 1 2 3 4\n", -3 * slope, 3 * slope));
  scene_.surfaces.emplace_back();
  scene_.surfaces[0].file = folder_ / "half.obj";
  const MatteRecord found = record();
  const double px = 2.0 / 16;
  double sum = 0, most = 0;
  for (int y = 0; y < 16; ++y)
    for (int x = 0; x < 16; ++x) {
      double area = 0;  // of the pixel below the line, by columns
      for (int k = 0; k < 4000; ++k) {
        const double u = -1 + px * (x + (k + 0.5) / 4000), bottom = 1 - px * (y + 1);
        area += std::clamp((slope * u - bottom) / px, 0.0, 1.0) / 4000;
      }
      const double error = share(found, "half", x, y) - area;
      sum += error;
      most = std::max(most, std::abs(error));
    }
  EXPECT_LT(most, 0.03);
  EXPECT_LT(std::abs(sum) / 256, 5e-4);
}

// Behind a box of fog a wall covers what the fog leaves; in front of it all.
TEST_F(MattePixels, SurfacesCoverWhatVolumesLeave) {
  test::write_file(folder_ / "wall.obj", "v -3 4 -3\nv 3 4 -3\nv 3 4 3\nv -3 4 3\nf 1 2 3 4\n");
  scene_.surfaces.emplace_back();
  scene_.surfaces[0].file = folder_ / "wall.obj";
  scene_.surfaces[0].material_name = "plaster";
  scene_.volumes = {volume("box", dvec3(-2, 0, -2), dvec3(2, 2, 2), dvec3(0.4))};
  MatteRecord found = record();
  EXPECT_NEAR(share(found, "wall", 5, 5), std::exp(-0.8), 1e-6);
  EXPECT_NEAR(share(found, "box", 5, 5), 1 - std::exp(-0.8), 1e-6);
  EXPECT_NEAR(alpha(found, 5, 5), 1, 1e-6);
  EXPECT_EQ(found.things[0].material, "plaster");
  EXPECT_EQ(found.things[1].material, "volume");
  scene_.surfaces[0].role = "holdout";
  found = record();
  EXPECT_EQ(share(found, "wall", 5, 5), 0);
  EXPECT_NEAR(alpha(found, 5, 5), 1 - std::exp(-0.8), 1e-6);
  scene_.surfaces[0].role = "shadow_catcher";
  EXPECT_EQ(share(record(), "wall", 5, 5), 0);
}

TEST_F(MattePixels, InstancesHaveTheirOwnNames) {
  scene_.volumes = {volume("sphere", dvec3(-0.4), dvec3(0.4), dvec3(3))};
  for (const double x : {-0.5, 0.5}) {
    InstanceSettings one;
    dmat4 m(1);
    m[3] = glm::dvec4(x, 0, 0, 1);
    one.matrices = {m};
    one.name = x < 0 ? "left" : "";
    scene_.instances.push_back(one);
  }
  const MatteRecord found = record();
  const double middle = 1 - std::exp(-3 * 0.8);
  EXPECT_NEAR(share(found, "left", 3, 7), middle, 0.02);
  EXPECT_EQ(share(found, "sphere", 3, 7), 0);
  EXPECT_NEAR(share(found, "sphere", 11, 7), middle, 0.02);
}

TEST(MatteNamesTest, AreStableAndTold) {
  Scene scene;
  const auto add = [&](const char* file, const char* name = "") {
    scene.volumes.emplace_back();
    scene.volumes.back().file = file;
    scene.volumes.back().name = name;
  };
  add("shot/smoke.0042.vdb");
  add("smoke_####.vdb");
  add("other.vdb", "smoke_3");
  add("smoke.vdb");
  add("0042.vdb");
  scene.volumes.push_back(volume("box", dvec3(0), dvec3(1), dvec3(1)));
  scene.surfaces.emplace_back();
  scene.surfaces[0].file = "smoke.obj";
  const MatteNames names(scene);
  EXPECT_EQ(names.volumes, (std::vector<std::string>{"smoke", "smoke_2", "smoke_3", "smoke_4", "0042", "box"}));
  EXPECT_EQ(names.surfaces, (std::vector<std::string>{"smoke_5"}));
  EXPECT_EQ(names.surface_materials, (std::vector<std::string>{"diffuse"}));
}

}  // namespace
}  // namespace brume
