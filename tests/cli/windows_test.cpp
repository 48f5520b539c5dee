// Crops and overscan: what lies outside the data window is absent, not black.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "image/exr_io.h"
#include "image/picture_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using nlohmann::json;
using test::run_brume;

constexpr ivec2 kDisplay{40, 30};

class Windows : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  /// A grey frame with a slope of `slope` per pixel of the display window, over a data window.
  std::string frame(const std::string& name, const PixelWindow& data, float slope = 0,
                    const ivec2& display = kDisplay) {
    Layers layers(data.width(), data.height());
    layers.origin = data.lo;
    layers.display = display;
    for (Plane* plane : layers.add_rgb(layer::beauty))
      for (int y = 0; y < data.height(); ++y)
        for (int x = 0; x < data.width(); ++x) (*plane)(x, y) = 0.5f + slope * static_cast<float>(x + data.lo.x);
    write_exr(folder_ / name, layers);
    return path(name);
  }
  test::TemporaryFolder folder_;
};

TEST_F(Windows, ACropIsCleanedWithoutTheBlackAroundIt) {
  const PixelWindow crop{{5, 3}, {21, 15}};
  const std::string in = frame("crop.exr", crop);
  for (const std::string filter : {"gaussian", "bilateral", "a_trous"}) {
    const auto r = run_brume("denoise " + in + " -q -f " + filter + " -o " + path("clean.exr"));
    ASSERT_EQ(r.status, 0) << r.err;
    const Layers clean = read_exr(folder_ / "clean.exr");
    EXPECT_EQ(clean.data_window(), crop);
    EXPECT_EQ(clean.display_window(), (PixelWindow{{0, 0}, kDisplay}));
    for (int y = 0; y < clean.height(); ++y)
      for (int x = 0; x < clean.width(); ++x) ASSERT_NEAR(clean.at("G")(x, y), 0.5f, 1e-4f) << filter;
  }
}

TEST_F(Windows, OverscanIsCleanedAndKept) {
  const PixelWindow wide{{-6, -4}, {46, 34}};
  const std::string in = frame("wide.exr", wide);
  const auto r = run_brume("denoise " + in + " -q -f gaussian -o " + path("clean.exr") + " --png " + path("clean.png"));
  ASSERT_EQ(r.status, 0) << r.err;
  const Layers clean = read_exr(folder_ / "clean.exr");
  EXPECT_EQ(clean.data_window(), wide);
  EXPECT_EQ(clean.display_window(), (PixelWindow{{0, 0}, kDisplay}));
  EXPECT_NEAR(clean.at("R")(0, 0), 0.5f, 1e-5f);
  const Layers shown = read_any_picture(folder_ / "clean.png");
  EXPECT_EQ(ivec2(shown.width(), shown.height()), kDisplay) << "a PNG shows the display window";
}

TEST_F(Windows, ADisplayWindowThatBeginsElsewhereIsKept) {
  Layers layers(8, 6);
  layers.origin = {12, 13};
  layers.display = {20, 10};
  layers.display_origin = {10, 12};
  layers.add_rgb(layer::beauty);
  write_exr(folder_ / "a.exr", layers);
  const auto r = run_brume("denoise " + path("a.exr") + " -q -f gaussian -o " + path("b.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  const Layers clean = read_exr(folder_ / "b.exr");
  EXPECT_EQ(clean.data_window(), layers.data_window());
  EXPECT_EQ(clean.display_window(), layers.display_window());
  const auto info = run_brume("info " + path("b.exr"));
  EXPECT_NE(info.out.find("data window 12,13,20,19, display window 10,12,30,22"), std::string::npos) << info.out;
}

TEST_F(Windows, PicturesAreComparedWhereBothHavePixels) {
  const float slope = 0.01f;
  const std::string whole = frame("whole.exr", {{0, 0}, kDisplay}, slope),
                    crop = frame("crop.exr", {{5, 3}, {21, 15}}, slope),
                    wide = frame("wide.exr", {{-6, -4}, {46, 34}}, slope),
                    corner = frame("corner.exr", {{18, 10}, {40, 30}}, slope);
  const auto compared = [&](const std::string& a, const std::string& b) {
    const auto r = run_brume("compare --json " + a + " " + b);
    EXPECT_EQ(r.status, 0) << r.err;
    return json::parse(r.out);
  };
  for (const auto& [other, window] :
       {std::pair(whole, json{5, 3, 21, 15}), {wide, json{5, 3, 21, 15}}, {corner, json{18, 10, 21, 15}}}) {
    const json j = compared(crop, other);
    EXPECT_EQ(j["window"], window);
    EXPECT_EQ(j["metrics"]["lab_rms"], 0.0);
    EXPECT_EQ(j["metrics"]["pixels"],
              (window[2].get<int>() - window[0].get<int>()) * (window[3].get<int>() - window[1].get<int>()));
  }
  const auto text = run_brume("compare " + crop + " " + whole);
  EXPECT_NE(text.out.find("over the common data window 5,3,21,15; the display window is 0,0,40,30"), std::string::npos)
      << text.out;
}

TEST_F(Windows, PicturesWithoutACommonPixelAreRefused) {
  const std::string left = frame("left.exr", {{0, 0}, {10, 30}}), right = frame("right.exr", {{20, 0}, {40, 30}}),
                    other = frame("other.exr", {{0, 0}, {10, 30}}, 0, {50, 30});
  const auto apart = run_brume("compare " + left + " " + right);
  EXPECT_EQ(apart.status, 2);
  EXPECT_NE(apart.err.find("has pixels in 0,0,10,30"), std::string::npos) << apart.err;
  EXPECT_NE(apart.err.find("in 20,0,40,30: none is in both"), std::string::npos) << apart.err;
  const auto sizes = run_brume("compare " + left + " " + other);
  EXPECT_EQ(sizes.status, 2);
  EXPECT_NE(sizes.err.find("is 40 x 30"), std::string::npos) << sizes.err;
  EXPECT_NE(sizes.err.find("is 50 x 30; expected one size"), std::string::npos) << sizes.err;
}

TEST_F(Windows, ASequencesFramesShareTheirDataWindow) {
  for (const int number : {1, 2}) {
    Layers layers(16, 12);
    layers.origin = {number, 0};
    layers.display = kDisplay;
    for (const LayerName& l : {layer::beauty, layer::flash}) layers.add_rgb(l);
    write_exr(folder_ / ("shot." + std::to_string(number) + ".exr"), layers);
  }
  const auto r = run_brume("denoise " + path("shot.1.exr") +
                           " -q -f virtual_flash --noise spatial --extra-frames 1 -o " + path("out.exr"));
  EXPECT_EQ(r.status, 2);
  EXPECT_NE(r.err.find("its data window is 2,0,18,12, that of the frame to clean 1,0,17,12"), std::string::npos)
      << r.err;
}

}  // namespace
}  // namespace brume
