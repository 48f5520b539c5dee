#include "evaluate/report/page.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "evaluate/report/page_bundle.h"
#include "evaluate/report/report.h"
#include "image/packed_half.h"

namespace brume {
namespace {

Layers flat(float value) {
  Layers frame(4, 3);
  for (Plane* plane : frame.add_rgb(layer::beauty)) plane->fill(value);
  return frame;
}

/// Two methods whose pictures are the same, and a name that would end a script.
Evaluation two_methods() {
  Evaluation e;
  e.settings.spp = {4};
  e.settings.seeds = 1;
  e.settings.provenance.command = "brume evaluate '</script>&amp;'";
  SceneResult scene;
  scene.name = "<b>smoke</b>";
  scene.width = 4;
  scene.height = 3;
  scene.reference = flat(0.5f);
  for (const char* filter : {"", "bilateral"}) {
    MethodResult m;
    m.filter = filter;
    m.tuning = *filter ? Tuning::kDefault : Tuning::kNone;
    m.spp = 4;
    m.errors = {std::vector<Errors>(1), std::vector<Errors>(1)};
    m.example = flat(0.25f);
    scene.methods.push_back(std::move(m));
  }
  e.scenes.push_back(std::move(scene));
  return e;
}

std::string between(const std::string& text, const std::string& from, const std::string& to) {
  const size_t start = text.find(from) + from.size();
  return text.substr(start, text.find(to, start) - start);
}

size_t count(const std::string& text, const std::string& word) {
  size_t found = 0;
  for (size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++found;
  return found;
}

TEST(Page, HoldsTheResultsAndEachPictureOnce) {
  if (!page_is_built_in()) GTEST_SKIP() << "this build has no page, for want of Node.js or its packages";
  const std::string html = results_page(two_methods());
  const auto results = nlohmann::json::parse(between(html, "id=\"results\">", "</script>"));
  EXPECT_EQ(results["command"], "brume evaluate '</script>&amp;'");
  EXPECT_EQ(results["rows"].size(), 2u);
  const auto pictures = nlohmann::json::parse(between(html, "id=\"pictures\">", "</script>"));
  ASSERT_EQ(pictures.size(), 3u);
  EXPECT_EQ(pictures[0]["method"], "reference");
  EXPECT_EQ(pictures[0]["data"], 0);
  EXPECT_EQ(pictures[1]["data"], 1);
  EXPECT_EQ(pictures[2]["data"], 1);
  EXPECT_EQ(count(html, "id=\"picture-"), 2u);
  EXPECT_NE(html.find("<title>brume: &lt;b>smoke&lt;/b></title>"), std::string::npos);
  EXPECT_EQ(count(html, "<script"), count(html, "</script>") + count(std::string(page_script), "<script"));
}

// What the page follows stands in results.json for each region and metric: the page computes no number.
TEST(Page, HasAnswersFrontsAndTimesForEachRegionMetricAndSetting) {
  Evaluation e = two_methods();
  SceneResult& scene = e.scenes[0];
  scene.mask = Mask(12, 1);
  MethodResult more = scene.methods[1];
  more.spp = 16;
  scene.methods.push_back(more);
  more = scene.methods[0];
  more.spp = 16;
  scene.methods.push_back(more);
  for (size_t i = 0; i < scene.methods.size(); ++i) {
    MethodResult& m = scene.methods[i];
    m.render_seconds = m.spp;
    m.filter_seconds = m.filter.empty() ? 0 : 1;
    for (const size_t region : {0u, 1u}) {
      m.errors[region].resize(2);
      for (Errors& own : m.errors[region]) {
        own.lab_rms = (m.filter.empty() ? 8.0 : 3.0) / m.spp * (region ? 4 : 1);
        own.psnr = 20 + m.spp;
      }
    }
  }
  scene.reference_errors.resize(2);
  scene.reference_errors[0].lab_rms = 0.25;
  scene.reference_errors[1].lab_rms = 0.5;
  for (Errors& own : scene.reference_errors) own.pixels = 12;
  const auto results = nlohmann::json::parse(json_report(e));
  EXPECT_EQ(results["scenes"][0]["reference_errors"]["medium"]["lab_rms"], 0.5);
  EXPECT_FALSE(results["scenes"][0]["reference_errors"]["frame"].contains("ssim"));
  const auto found = [&](const char* list, const char* region, const char* metric, const char* setting = nullptr) {
    for (const auto& group : results[list])
      if (group["region"] == region && group["metric"] == metric && (!setting || group["setting"] == setting))
        return group;
    ADD_FAILURE() << list << " has none of " << region << " " << metric;
    return nlohmann::json();
  };
  for (const char* region : {"frame", "medium"})
    for (const char* metric : {"lab_rms", "psnr"}) {
      for (const char* setting : {"", "default"}) {
        EXPECT_EQ(found("overall", region, metric, setting)["methods"].size(), 2u);
        EXPECT_FALSE(found("pareto", region, metric, setting)["front"].empty());
      }
      EXPECT_FALSE(found("time_to_error", region, metric)["times"].empty());
    }
  const auto best = found("overall", "medium", "lab_rms", "default")["methods"][0];
  EXPECT_EQ(best["method"], "bilateral_default");
  EXPECT_NEAR(best["value"].get<double>(), 4 * 3.0 / 8, 1e-9) << "of 4 and 16 samples";
  EXPECT_EQ(found("time_to_error", "medium", "lab_rms")["times"][0]["error"], 5);
  EXPECT_EQ(found("time_to_error", "frame", "lab_rms")["times"][0]["error"], 2);
}

TEST(Page, IsRefusedWhereItIsNotBuiltIn) {
  if (page_is_built_in()) GTEST_SKIP() << "this build has its page";
  EXPECT_THROW(results_page(two_methods()), std::logic_error);
}

TEST(PackedHalf, SmoothPicturesTakeFewBytesAndExtremesAreTaken) {
  Layers ramp(256, 64);
  for (Plane* plane : ramp.add_rgb(layer::beauty))
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 256; ++x) (*plane)(x, y) = 1.0f + static_cast<float>(x) / 256.0f;
  EXPECT_LT(pack_half(ramp.rgb(layer::beauty)).size(), 600u);
  // Beyond the largest half, infinite and empty.
  EXPECT_EQ(pack_half(flat(1e9f).rgb(layer::beauty)), pack_half(flat(65504.0f).rgb(layer::beauty)));
  EXPECT_EQ(pack_half(flat(-1e9f).rgb(layer::beauty)), pack_half(flat(-65504.0f).rgb(layer::beauty)));
  Layers nothing(0, 0);
  nothing.add_rgb(layer::beauty);
  EXPECT_FALSE(pack_half(nothing.rgb(layer::beauty)).empty());
}

}  // namespace
}  // namespace brume
