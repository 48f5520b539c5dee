// Displays of OpenColorIO configurations, against closed forms of what they say.
#include "image/display.h"

#include <OpenColorIO/OpenColorIO.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/text.h"
#include "image/color_space.h"
#include "image/picture_io.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace brume {
namespace {

/// A configuration whose reference space has a name of its own, with a film of a shoulder that breaks, and two looks.
std::string configuration(const std::string& space, const std::string& roles) {
  return R"(ocio_profile_version: 2
search_path: luts
strictparsing: true
roles:
  default: )" +
         space + "\n" + roles + R"(
displays:
  Monitor:
    - !<View> {name: Plain, colorspace: gamma}
    - !<View> {name: Dark, colorspace: gamma, looks: half}
  Projector:
    - !<View> {name: Linear, colorspace: )" +
         space + R"(}
active_displays: [Monitor, Projector]
looks:
  - !<Look>
    name: half
    process_space: )" +
         space + R"(
    transform: !<CDLTransform> {slope: [0.5, 0.5, 0.5]}
  - !<Look>
    name: warm
    process_space: )" +
         space + R"(
    transform: !<CDLTransform> {slope: [1.5, 1, 0.5]}
colorspaces:
  - !<ColorSpace>
    name: )" +
         space + R"(
    bitdepth: 32f
  - !<ColorSpace>
    name: gamma
    bitdepth: 32f
    from_scene_reference: !<ExponentTransform> {value: [2.2, 2.2, 2.2, 1], direction: inverse}
)";
}

class Displays : public ::testing::Test {
 protected:
  DisplaySetting setting(const std::string& text) {
    test::write_file(folder_ / "config.ocio", text);
    return {.config = (folder_ / "config.ocio").string()};
  }
  static dvec3 shown(const Display& display, const dvec3& light) {
    std::array<float, 3> rgb = {static_cast<float>(light.x), static_cast<float>(light.y), static_cast<float>(light.z)};
    display.apply(rgb);
    return {rgb[0], rgb[1], rgb[2]};
  }
  static void expect_near(const dvec3& got, const dvec3& expected, double tolerance = 1e-4) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(got[c], expected[c], tolerance) << "channel " << c;
  }
  test::TemporaryFolder folder_;
};

dvec3 gamma(const dvec3& v) {
  return {std::pow(v.x, 1 / 2.2), std::pow(v.y, 1 / 2.2), std::pow(v.z, 1 / 2.2)};
}

TEST_F(Displays, DefaultsAndNamesChooseTheView) {
  DisplaySetting asked = setting(configuration("lin_rec709", ""));
  const dvec3 light(0.02, 0.3, 0.9);
  const Display plain(asked);
  EXPECT_EQ(plain.setting().display, "Monitor");
  EXPECT_EQ(plain.setting().view, "Plain");
  EXPECT_EQ(plain.setting().space, "lin_rec709");
  expect_near(shown(plain, light), gamma(light));
  expect_near(shown(plain, {-1, 4, 0}), {0, 1, 0});
  asked.view = "dark";  // names are found whatever their case
  expect_near(shown(Display(asked), light), gamma(0.5 * light));
  asked.look = "warm";  // in the place of the view's own
  expect_near(shown(Display(asked), {0.2, 0.3, 0.4}), gamma({0.3, 0.3, 0.2}));
  asked.look = "warm,half";
  expect_near(shown(Display(asked), {0.2, 0.3, 0.4}), gamma({0.15, 0.15, 0.1}));
  asked = {.config = asked.config, .display = "Projector"};
  expect_near(shown(Display(asked), light), light);
}

TEST_F(Displays, LightComesByAcesWhereNoSpaceIsRec709) {
  DisplaySetting asked = setting(configuration("studio", "  aces_interchange: studio\n"));
  asked.display = "Projector";
  const Display display(asked);
  EXPECT_EQ(display.setting().space, "");
  const dmat3 rec709 = *rec709_from(kAces, "ACES");
  const dvec3 light(0.4, 0.25, 0.1);
  expect_near(rec709 * shown(display, light), light);
  expect_near(shown(display, dvec3(0.5)), dvec3(0.5));
  asked.space = "studio";  // somebody knows better
  expect_near(shown(Display(asked), light), light);
}

TEST_F(Displays, PicturesAreTheViewOfEachPixel) {
  Layers frame(3, 2);
  const auto planes = frame.add_rgb(layer::beauty);
  for (size_t c = 0; c < 3; ++c)
    for (int x = 0; x < 3; ++x) (*planes[c])(x, 1) = 0.1f * static_cast<float>(c + 1) * static_cast<float>(x + 1);
  (*planes[1])(0, 0) = std::numeric_limits<float>::quiet_NaN();
  (*planes[2])(1, 0) = std::numeric_limits<float>::infinity();
  const Picture picture =
      to_picture(std::as_const(frame).rgb(layer::beauty), 2, Display(setting(configuration("lin_rec709", ""))));
  for (int x = 0; x < 3; ++x)
    for (int c = 0; c < 3; ++c)
      EXPECT_EQ(picture.rgb[static_cast<size_t>(3 * (3 + x) + c)],
                std::lround(255 * std::min(1.0, std::pow(0.2 * (c + 1) * (x + 1), 1 / 2.2))));
  const std::array<uint8_t, 3> magenta = {255, 0, 255};
  for (size_t x = 0; x < 2; ++x)
    for (size_t c = 0; c < 3; ++c) EXPECT_EQ(picture.rgb[3 * x + c], magenta[c]);
  EXPECT_EQ(picture.rgb[7], 0);
}

TEST_F(Displays, WhatIsNotThereIsNamedWithWhatIs) {
  const auto error = [](const DisplaySetting& asked) { return test::error_of([&] { Display{asked}; }); };
  const auto expect = [](const std::string& found, const std::string& part) {
    EXPECT_NE(found.find(part), std::string::npos) << found;
  };
  const DisplaySetting good = setting(configuration("lin_rec709", ""));
  DisplaySetting asked = good;
  asked.display = "TV";
  expect(error(asked), "has no display 'TV'; it has: Monitor, Projector (--display)");
  asked = good;
  asked.view = "Linear";
  expect(error(asked), "the display 'Monitor' has no view 'Linear'; it has: Plain, Dark (--view)");
  asked = good;
  asked.look = "cold";
  expect(error(asked), "has no look 'cold'; it has: half, warm (--look)");
  asked = good;
  asked.space = "sRGB";
  expect(error(asked), "has no colour space 'sRGB'; it has: lin_rec709, gamma (--ocio-space)");
  expect(error(setting(configuration("studio", ""))),
         "lacks the role aces_interchange; say which it is (--ocio-space): studio, gamma");
  expect(error(setting("film: noir\n")), "not an OpenColorIO configuration");
  expect(error({.config = (folder_ / "gone.ocio").string()}), "gone.ocio");
  if (OCIO_NAMESPACE::GetVersionHex() < 0x02020000)
    expect(error({.config = "ocio://default"}), "brings no configurations, as it does since 2.2; expected a file");
  std::string text = configuration("lin_rec709", "") + R"(  - !<ColorSpace>
    name: film
    from_scene_reference: !<FileTransform> {src: film.cube}
)";
  text = replaced(text, "colorspace: gamma, looks: half", "colorspace: film");
  asked = setting(text);
  EXPECT_EQ(error(asked), "") << "what is not used may be missing";
  asked.view = "Dark";
  expect(error(asked), "the view 'Dark' of the display 'Monitor' does not work: ");
  expect(error(asked), "film.cube");
}

}  // namespace
}  // namespace brume
