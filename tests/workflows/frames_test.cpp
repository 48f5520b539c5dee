// What front ends call: one after another and at once, with options of their own.

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <mutex>

#include "base/error.h"
#include "filters/api/registry.h"
#include "image/exr_io.h"
#include "tests/support/files.h"
#include "workflows/denoise_frame.h"
#include "workflows/frame.h"
#include "workflows/render_frame.h"

namespace brume {
namespace {

RenderOptions small_render(int64_t seed, const std::string& clean_filter) {
  RenderOptions options;
  options.scene = test::source("data/scenes/smoke.toml");
  options.overrides = {"film.width=40", "film.height=32"};
  options.spp = 4;
  options.seed = seed;
  options.clean_filter = clean_filter;
  if (seed % 2 == 0) options.crop = "3,5,31,29";
  return options;
}

DenoiseOptions filtered_by(const std::string& filter, Component component) {
  DenoiseOptions options;
  if (!filter.empty()) options.filters = {parse_filter(filter)};
  options.how.component = component;
  return options;
}

/// What a front end is told, word by word.
struct Listener {
  std::mutex mutex;
  std::vector<std::string> words, stages;
  double least = 1, most = 0;
  Host host{.threads = 2};

  Listener() {
    host.tell = [this](Host::Word, const std::string& text) {
      const std::scoped_lock lock(mutex);
      words.push_back(text);
    };
    host.progress = [this](const std::string& stage) {
      stages.push_back(stage);
      return [this](double fraction) {
        const std::scoped_lock lock(mutex);
        least = std::min(least, fraction);
        most = std::max(most, fraction);
      };
    };
  }
};

void expect_same(const Layers& a, const Layers& b, const std::string& what) {
  ASSERT_EQ(a.names(), b.names()) << what;
  ASSERT_EQ(a.data_window(), b.data_window()) << what;
  for (const auto& [name, plane] : a.channels())
    for (int y = 0; y < plane.height(); ++y)
      for (int x = 0; x < plane.width(); ++x)
        ASSERT_EQ(plane(x, y), b.at(name)(x, y)) << what << ", " << name << " at " << x << ", " << y;
}

/// Two different calls alone, again after one another, then at once and again.
template <class Call>
void expect_independent(const Call& first, const Call& second) {
  const Layers a = first(), b = second();
  expect_same(first(), a, "a second call");
  for (int round = 0; round < 2; ++round) {
    auto other = std::async(std::launch::async, second);
    expect_same(first(), a, "beside another");
    expect_same(other.get(), b, "in a thread of its own");
  }
}

TEST(Workflows, RendersAtOnceHaveTheBitsOfEachAlone) {
  using Call = std::function<Layers()>;
  expect_independent<Call>([] { return render_frame(small_render(1, "transport_regression"), {.threads = 2}).layers; },
                           [] { return render_frame(small_render(2, ""), {.threads = 1}).layers; });
}

TEST(Workflows, DenoisedFramesAtOnceHaveTheBitsOfEachAlone) {
  RenderOptions options = small_render(1, "");
  options.layers.guides = true;
  const Layers frame = render_frame(options, {}).layers, other = render_frame(small_render(2, ""), {}).layers;
  using Call = std::function<Layers()>;
  expect_independent<Call>(
      [&] { return denoise_frame(frame, nullptr, filtered_by("", Component::kAll), {.threads = 2}); },
      [&] { return denoise_frame(other, nullptr, filtered_by("nl_means", Component::kIndirect), {.threads = 1}); });
}

TEST(Workflows, FilesAtOnceAreThoseOfEachAlone) {
  const test::TemporaryFolder folder;
  RenderOptions render = small_render(1, "");
  render.output = folder / "noisy.####.exr";
  ASSERT_TRUE(render_sequence(render, {1, 2, 3}, {}).well());
  const auto clean = [&](const std::string& to, const DenoiseOptions& options) {
    FrameFiles files;
    files.frame = folder / "noisy.####.exr";
    files.output = folder / (to + ".####.exr");
    return denoise_sequence(files, {1, 2, 3}, options, {.threads = 1});
  };
  const DenoiseOptions one = filtered_by("nl_means", Component::kAll), two = filtered_by("bilateral", Component::kAll);
  ASSERT_TRUE(clean("a", one).well() && clean("b", two).well());
  auto other = std::async(std::launch::async, [&] { return clean("d", two); });
  EXPECT_TRUE(clean("c", one).well());
  EXPECT_EQ(other.get().done, (std::vector<int>{1, 2, 3}));
  for (const auto& [alone, beside] : {std::pair("a", "c"), {"b", "d"}})
    for (const std::string frame : {".0001.exr", ".0002.exr", ".0003.exr"})
      expect_same(read_exr(folder / (beside + frame)), read_exr(folder / (alone + frame)), frame);
}

TEST(Workflows, FilesAndMemoryGiveTheSamePicture) {
  const test::TemporaryFolder folder;
  RenderOptions render = small_render(1, "");
  render.output = folder / "noisy.exr";
  const Layers frame = render_frame(render, {}).layers;
  FrameFiles files;
  files.frame = render.output;
  files.output = folder / "clean.exr";
  const DenoiseOptions options = filtered_by("", Component::kAll);
  denoise_frame(files, options, {});
  expect_same(read_exr(files.output), denoise_frame(frame, nullptr, options, {}), "from memory");
}

TEST(Workflows, GuidesTakeTheColoursOfTheirFrame) {
  Layers guides(2, 1), frame(2, 1);
  for (const char* name : {"guide.predicted_direct", "guide.surface_material"})
    for (Plane* plane : guides.add_rgb({name, "RGB", ""})) plane->fill(0.5f);
  guides.find("guide.predicted_direct.R")->fill(1);
  guides.find("guide.surface_material.R")->fill(1);
  guides.add("guide.normal.X", 0.25f);
  frame.add_rgb(layer::beauty);
  frame.header["chromaticities"] = Chromaticities{0.713f, 0.293f, 0.165f, 0.83f, 0.128f, 0.044f, 0.32168f, 0.33767f};
  add_guides(guides, {"guides", "the frame"}, frame);
  // Half of Rec. 709's red in ACEScg, on top of grey 0.5.
  EXPECT_NEAR(frame.at("guide.predicted_direct.R")(1, 0), 0.5 + 0.5 * 0.6131, 1e-3);
  EXPECT_NEAR(frame.at("guide.predicted_direct.G")(1, 0), 0.5 + 0.5 * 0.0702, 1e-3);
  EXPECT_NEAR(frame.at("guide.predicted_direct.B")(1, 0), 0.5 + 0.5 * 0.0206, 1e-3);
  EXPECT_EQ(frame.at("guide.surface_material.R")(1, 0), 1.0f);
  EXPECT_EQ(frame.at("guide.normal.X")(1, 0), 0.25f);
  frame.header.clear();
  add_guides(guides, {"guides", "the frame"}, frame);
  EXPECT_EQ(frame.at("guide.predicted_direct.R")(1, 0), 1.0f) << "Rec. 709 as it is";
}

TEST(Workflows, TellAndPrintNothing) {
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  Listener listener;
  const RenderedFrame rendered = render_frame(small_render(1, "nl_means"), listener.host);
  EXPECT_EQ(testing::internal::GetCapturedStdout() + testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(rendered.end, FrameEnd::kDone);
  EXPECT_EQ(listener.stages, (std::vector<std::string>{"render smoke", "nl_means"}));
  EXPECT_EQ(listener.most, 1);
  EXPECT_LT(listener.least, 1);
  EXPECT_FALSE(listener.words.empty());
}

TEST(Workflows, StopWhenTheyAreTold) {
  std::atomic<bool> stop{true};
  EXPECT_THROW(render_frame(small_render(1, ""), {.threads = 2, .cancel = &stop}), Interrupted);
  const Layers frame = render_frame(small_render(1, ""), {}).layers;
  EXPECT_THROW(denoise_frame(frame, nullptr, filtered_by("nl_means", Component::kAll), {.cancel = &stop}), Interrupted);
}

}  // namespace
}  // namespace brume
