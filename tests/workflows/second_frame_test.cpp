// Two renders of one frame by different seeds, as the halves of one.

#include "workflows/second_frame.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/error.h"
#include "filters/api/registry.h"
#include "image/exr_io.h"
#include "tests/support/files.h"
#include "tests/support/frames.h"
#include "workflows/denoise_frame.h"

namespace brume {
namespace {

constexpr int kSize = 48;

float truth(int x, int y) {
  return 0.3f + 0.004f * static_cast<float>(x) + (y > kSize / 2 ? 0.2f : 0.0f);
}

/// A picture as any renderer writes it, colours alone, under a prefix.
Layers picture(uint64_t seed, const std::string& prefix = "") {
  Layers frame(kSize, kSize);
  for (size_t c = 0; c < 3; ++c) {
    Plane& plane = frame.add(prefix + "RGB"[c]);
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x) plane(x, y) = truth(x, y) + 0.1f * static_cast<float>(test::normal(x, y, seed));
  }
  return frame;
}

double rms(const Layers& frame, const std::string& channel) {
  double sum = 0;
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x)
      sum += std::pow(static_cast<double>(frame.at(channel)(x, y)) - static_cast<double>(truth(x, y)), 2);
  return std::sqrt(sum / (kSize * kSize));
}

/// What brume denoise makes of two files, and what it says.
struct Denoised {
  test::TemporaryFolder folder;
  Layers clean;
  std::string error;

  Denoised(const Layers& a, const Layers& b, const std::string& filter) {
    const auto path = [&](const char* name) { return folder.path() / name; };
    write_exr(path("a.exr"), a);
    write_exr(path("b.exr"), b);
    DenoiseOptions options;
    if (!filter.empty()) options.filters = {parse_filter(filter)};
    try {
      FrameFiles files;
      files.frame = path("a.exr");
      files.second = path("b.exr");
      files.output = path("clean.exr");
      denoise_frame(files, options, {});
      clean = read_exr(path("clean.exr"));
    } catch (const InputError& e) {
      error = e.what();
    }
  }
};

TEST(SecondFrame, GivesAFrameOfColoursHalvesAndTwiceTheSamples) {
  // nfor runs on frames with halves alone.
  const Denoised done(picture(1), picture(2), "least_risk:network=none"), nfor(picture(1), picture(2), "nfor");
  EXPECT_EQ(nfor.error, "");
  EXPECT_LT(rms(done.clean, "R"), 0.02) << done.error;
  const Denoised wide(picture(1, "ViewLayer.Combined."), picture(2, "ViewLayer.Combined."), "least_risk:network=none");
  EXPECT_LT(rms(wide.clean, "ViewLayer.Combined.R"), 0.02) << wide.error;
}

TEST(SecondFrame, IsTheMeanWithVariancesAndCountsOfBoth) {
  Layers a = test::noisy_frame(kSize, kSize, 1), b = test::noisy_frame(kSize, kSize, 2);
  const std::string mean = layer::indirect.channel(1),
                    variance = layer::indirect.channel_of(statistic::mean_variance, 1);
  for (Layers* frame : {&a, &b}) {
    frame->set(layer::sample_count.channel(0), Plane(kSize, kSize, 16));
    frame->header["samplesPerPixel"] = 16;
  }
  const Layers first = a;
  join_second(a, b, halves_of_layers(a), {"a", "b"});
  EXPECT_EQ(a.at(mean)(7, 9), 0.5f * (first.at(mean)(7, 9) + b.at(mean)(7, 9)));
  EXPECT_EQ(a.at(layer::indirect.channel_of(statistic::half_a, 1))(7, 9), first.at(mean)(7, 9));
  EXPECT_EQ(a.at(layer::indirect.channel_of(statistic::half_b, 1))(7, 9), b.at(mean)(7, 9));
  EXPECT_EQ(a.at(variance)(7, 9), 0.25f * (first.at(variance)(7, 9) + b.at(variance)(7, 9)));
  EXPECT_EQ(a.at(layer::sample_count.channel(0))(7, 9), 32);
  EXPECT_EQ(a.number("samplesPerPixel"), 32);
}

TEST(SecondFrame, SaysWhatIsWrongWithIt) {
  const auto error = [](const Layers& a, const Layers& b) { return Denoised(a, b, "gaussian").error; };
  const auto holds = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  EXPECT_TRUE(holds(error(picture(1), picture(1)), "b.exr: it has the very pixels of"));
  EXPECT_TRUE(holds(error(picture(1), Layers(picture(2)).cut({{0, 0}, {40, 48}})), "it has the pixels 0,0,40,48"));
  EXPECT_TRUE(holds(error(picture(1), picture(2, "beauty.")), "it has no channel B"))
      << error(picture(1), picture(2, "beauty."));
  Layers a = picture(1), b = picture(2);
  a.header["sceneHash"] = std::string("1");
  b.header["sceneHash"] = std::string("2");
  EXPECT_TRUE(holds(error(a, b), "it is of another scene than"));
}

}  // namespace
}  // namespace brume
