// A scene's own colour space ([film] color_space): what is a number of Rec. 709 elsewhere is converted to it, what the
// scene says is taken as it is, and the frame's header says which space it is.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "image/exr_io.h"
#include "image/usable_colors.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "render/world/environment.h"
#include "render/world/sky.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "volume/emission.h"

namespace brume {
namespace {

void expect_near(const dvec3& is, const dvec3& expected, double relative, const std::string& what) {
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(is[c], expected[c], relative * max_component(glm::abs(expected))) << what << ", channel " << c;
}

TEST(WorkingSpace, OfEveryNameKeepsWhite) {
  for (const char* name : kWorkingSpaces) {
    const WorkingSpace space{std::string(name)};
    EXPECT_EQ(space.from_rec709.has_value(), std::string(name) != "lin_rec709") << name;
    expect_near(space.of_rec709(dvec3(0.5)), dvec3(0.5), 1e-9, name);
    EXPECT_EQ(name_of(space.chromaticities) == name_of(kRec709), !space.from_rec709) << name;
  }
}

// The luminance of a body that glows red, which lies outside of Rec. 709, is right in a space that holds its colour.
TEST(WorkingSpace, HoldsBlackBodies) {
  const WorkingSpace acescg("acescg");
  const auto ramp = [](const std::optional<dmat3>& matrix) {
    return EmissionRamp::of_blackbody(0, 1, 7000, 1, true, matrix);
  };
  const EmissionRamp rec709 = ramp({}), wide = ramp(acescg.from_rec709);
  for (const double kelvin : {2500.0, 4000.0, 6500.0})
    expect_near(wide(kelvin), *acescg.from_rec709 * rec709(kelvin), 1e-6, fmt::format("{} K", kelvin));
  const dvec3 ember = wide(1000);
  EXPECT_GE(std::min({ember.x, ember.y, ember.z}), 0);
  EXPECT_LT((*acescg.to_rec709 * ember).z, 0) << "bluer than none in Rec. 709";
  EXPECT_EQ(rec709(1000).z, 0);
}

TEST(WorkingSpace, ConvertsSkiesAndTheirSuns) {
  const WorkingSpace acescg("acescg");
  EnvironmentSettings settings;
  settings.sky = "preetham";
  settings.radiance = dvec3(1);
  settings.sun_direction = {0.6, 0, 0.8};
  const Environment sky(settings), wide(settings, acescg);
  for (const dvec3& d : {dvec3(0, 0, 1), dvec3(-0.8, 0, 0.6), dvec3(0, 0.6, -0.8)})
    expect_near(wide.radiance(d), *acescg.from_rec709 * sky.radiance(d), 1e-5, "sky");
  expect_near(preetham_sun(settings, acescg).irradiance, *acescg.from_rec709 * preetham_sun(settings).irradiance, 1e-9,
              "sun");
  const dvec3 white = preetham_sun(settings, acescg).irradiance;
  settings.radiance = dvec3(1, 0, 2);  // a number of the scene: stays what it is
  expect_near(preetham_sun(settings, acescg).irradiance, white * dvec3(1, 0, 2), 1e-9, "sun in colour");
}

/// A floor under an even white sky, and nothing else: each pixel is an albedo.
class Floor : public ::testing::Test {
 protected:
  Layers seen(const std::string& space, const std::string& surface) const {
    test::write_file(folder_ / "floor.obj",
                     "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n");
    const Scene scene = parse_scene(fmt::format(R"([camera]
position = [0, -0.01, 1]
look_at = [0, 0, 0]
up = [0, 1, 0]
fov = 60
[film]
width = 8
height = 8
color_space = "{}"
[environment]
radiance = [1, 1, 1]
[[surfaces]]
file = "floor.obj"
{})",
                                                space, surface),
                                    folder_ / "scene.toml");
    return PreparedScene(scene, {}).render(4, 1, {}).layers;
  }
  void write_texture(const Chromaticities& space) const {
    Layers picture(4, 4);
    const auto rgb = picture.add_rgb(layer::beauty);
    rgb[0]->fill(0.6f);
    rgb[1]->fill(0.3f);
    rgb[2]->fill(0.1f);
    picture.header["chromaticities"] = space;
    write_exr(folder_ / "t.exr", picture);
  }
  test::TemporaryFolder folder_;
};

dvec3 pixel(const Layers& frame) {
  return {frame.at("R")(3, 4), frame.at("G")(3, 4), frame.at("B")(3, 4)};
}

TEST_F(Floor, IsWhatItsTextureSaysInAnySpace) {
  const WorkingSpace acescg("acescg"), p3("lin_p3d65");
  const std::string texture = "albedo = 1\nalbedo_texture = \"t.exr\"\n";
  const dvec3 stored(0.6, 0.3, 0.1);
  write_texture(kRec709);
  expect_near(pixel(seen("lin_rec709", texture)), stored, 2e-3, "Rec. 709 in Rec. 709");
  expect_near(pixel(seen("acescg", texture)), *acescg.from_rec709 * stored, 2e-3, "Rec. 709 in ACEScg");
  write_texture(acescg.chromaticities);
  expect_near(pixel(seen("acescg", texture)), stored, 2e-3, "ACEScg in ACEScg");
  expect_near(pixel(seen("lin_p3d65", texture)), *p3.from_rec709 * (*acescg.to_rec709 * stored), 2e-3, "ACEScg in P3");
}

TEST_F(Floor, KeepsTheNumbersOfTheSceneAndItsHeaderSaysWhatTheyAre) {
  const std::string albedo = "albedo = [0.6, 0.3, 0.1]\n";
  const Layers plain = seen("lin_rec709", albedo), wide = seen("acescg", albedo);
  expect_near(pixel(plain), {0.6, 0.3, 0.1}, 2e-3, "Rec. 709");
  expect_near(pixel(wide), {0.6, 0.3, 0.1}, 2e-3, "ACEScg");
  EXPECT_FALSE(plain.chromaticities());
  EXPECT_EQ(wide.chromaticities(), WorkingSpace("acescg").chromaticities);
}

TEST_F(Floor, IsRefusedInASpaceThatIsNotThere) {
  const std::string said = test::error_of([&] { seen("acesgc", ""); });
  EXPECT_NE(said.find("'color_space' cannot be 'acesgc'"), std::string::npos) << said;
  EXPECT_NE(said.find("acescg"), std::string::npos) << said;
}

}  // namespace
}  // namespace brume
