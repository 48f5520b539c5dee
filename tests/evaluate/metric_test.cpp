#include "evaluate/metrics/metric.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/rng.h"
#include "evaluate/metrics/statistics.h"
#include "evaluate/metrics/temporal.h"
#include "evaluate/report/contact_sheet.h"
#include "image/color.h"

namespace brume {
namespace {

struct Rgb {
  std::array<Plane, 3> planes;
  Rgb(int w, int h, float value) : planes{Plane(w, h, value), Plane(w, h, value), Plane(w, h, value)} {}
  RgbPlanes view() const { return {&planes[0], &planes[1], &planes[2]}; }
};

TEST(Compare, EqualPicturesHaveNoError) {
  const Rgb a(7, 5, 0.4f);
  const Errors e = compare(a.view(), a.view(), {});
  for (const auto& [name, value] : listed(e))
    EXPECT_NEAR(value, name == "psnr" ? 100.0 : name == "ssim" ? 1.0 : 0.0, 1e-6) << name;
  EXPECT_EQ(e.lab_rms, 0.0);
  EXPECT_EQ(e.flip, 0.0);
}

TEST(Compare, HandComputedPair) {
  // White against mid grey: Lab (100, 0, 0) and (49.50, 0, 0); half of the pixels differ.
  Rgb x(2, 1, 0.18f), r(2, 1, 0.18f);
  for (Plane& p : x.planes) p(0, 0) = 1.0f;
  const Errors e = compare(x.view(), r.view(), {});
  EXPECT_NEAR(e.lab_rms, 50.504 / std::sqrt(2.0), 0.01) << "eq. 3 divides by pixels, not by channels";
  EXPECT_NEAR(e.mse, 0.82 * 0.82 / 2, 1e-6);
  EXPECT_NEAR(e.rel_mse, 0.82 * 0.82 / (0.18 * 0.18 + 0.01) / 2, 1e-5);
  EXPECT_NEAR(e.relative_bias, (1.18 - 0.36) / 0.36, 1e-6);
  EXPECT_NEAR(e.log_luminance_mse, std::pow(std::log(1 / 0.18), 2) / 2, 1e-5);
}

TEST(Compare, ClippingIsDeclaredAndFollowsExposure) {
  // docs/methods.md, Metrics: one pixel of 100 in 400 x 400 gives 1.16 unclipped and 0.10 clipped, from L* = 60.
  const float grey = 0.2812f;
  Rgb x(400, 400, grey), r(400, 400, grey);
  for (Plane& p : x.planes) p(10, 10) = 100.0f;
  const Errors e = compare(x.view(), r.view(), {});
  EXPECT_NEAR(e.lab_rms, 0.10, 0.005);
  EXPECT_NEAR(e.lab_rms_unclipped, 1.16, 0.005);
  EXPECT_EQ(compare(x.view(), r.view(), {0.01, true}).lab_rms, compare(x.view(), r.view(), {0.01, false}).lab_rms);
}

TEST(Compare, PsnrAndSsimAreThoseOfTheDisplaysCodes) {
  // Linear 0.2140 is shown as 0.5, 0.0331 as 0.2: PSNR is -20 log10 of 0.3.
  const Rgb x(12, 12, 0.21404f), r(12, 12, 0.033105f);
  const Errors e = compare(x.view(), r.view(), {});
  EXPECT_NEAR(e.psnr, -20 * std::log10(0.3), 1e-3);
  // Of constant pictures only the term of the means is left.
  EXPECT_NEAR(e.ssim, (2 * 0.5 * 0.2 + 1e-4) / (0.25 + 0.04 + 1e-4), 1e-5);
  EXPECT_NEAR(compare(x.view(), r.view(), {2.0, true}).psnr,
              -20 * std::log10(srgb_encode(0.42808) - srgb_encode(0.06621)), 1e-3)
      << "the exposure counts";
}

// A white pixel on black, against black: windows sum to one, so that the mean of the windows' means is the pixel's.
TEST(Compare, SsimOfOnePixelIsThatOfItsWindow) {
  Rgb x(21, 21, 0.0f);
  const Rgb r(21, 21, 0.0f);
  for (Plane& p : x.planes) p(10, 10) = 1.0f;
  Mask centre(21 * 21);
  centre[10 * 21 + 10] = 1;
  double sum = 0;
  for (int i = -5; i <= 5; ++i) sum += std::exp(-i * i / 4.5);
  const double weight = 1 / (sum * sum), c1 = 1e-4, c2 = 9e-4;
  const double expected = c1 * c2 / ((weight * weight + c1) * (weight - weight * weight + c2));
  EXPECT_NEAR(compare(x.view(), r.view(), {}, centre).ssim, expected, 1e-6);
}

TEST(Compare, SeveralRegionsAtOnceAreTheSameNumbers) {
  Rng rng(3);
  Rgb x(30, 20, 0), r(30, 20, 0);
  for (Rgb* p : {&x, &r})
    for (Plane& plane : p->planes)
      for (int y = 0; y < 20; ++y)
        for (float& v : plane.pixels(y)) v = static_cast<float>(rng.uniform());
  Mask mask(600);
  for (size_t i = 0; i < mask.size(); ++i) mask[i] = i % 7 == 0;
  const std::vector<Errors> both = compare_regions(x.view(), r.view(), {}, {{}, mask});
  const auto same = [](const Errors& a, const Errors& b) { return listed(a) == listed(b) && a.pixels == b.pixels; };
  EXPECT_TRUE(same(both[0], compare(x.view(), r.view(), {})));
  EXPECT_TRUE(same(both[1], compare(x.view(), r.view(), {}, mask)));
  EXPECT_TRUE(same(both[1], compare(x.view(), r.view(), {}, mask, nullptr, ErrorScope::kAll, {5, {}, nullptr})))
      << "for any number of threads";
}

TEST(Compare, AMaskCountsItsPixelsOnly) {
  Rgb x(4, 1, 0.2f), r(4, 1, 0.2f);
  for (Plane& p : x.planes) p(1, 0) = 0.5f;
  EXPECT_EQ(compare(x.view(), r.view(), {}, {1, 0, 1, 1}).lab_rms, 0.0);
  EXPECT_NEAR(compare(x.view(), r.view(), {}, {0, 1, 0, 0}).lab_rms, 2 * compare(x.view(), r.view(), {}).lab_rms, 1e-9);
}

TEST(Compare, NonFinitePixelsAreRefused) {
  Rgb x(4, 4, 0.2f);
  x.planes[1](2, 2) = std::numeric_limits<float>::quiet_NaN();
  try {
    compare(x.view(), Rgb(4, 4, 0.2f).view(), {});
    ADD_FAILURE() << "NaN was taken";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("the first at pixel 2,2"), std::string::npos) << error.what();
  }
  EXPECT_THROW(compare(Rgb(4, 4, 0.2f).view(), Rgb(5, 4, 0.2f).view(), {}), std::logic_error);
}

// A picture with noise of 0.02 against two references with noise of 0.05 each: one reference reports both together, two
// the picture's own. 40000 pixels: known to 2 %.
TEST(Compare, TwoReferencesTakeTheirNoiseOff) {
  Rng rng(1);
  const auto noisy = [&](double sigma) {
    Rgb p(200, 200, 0);
    for (Plane& plane : p.planes)
      for (int y = 0; y < 200; ++y)
        for (float& v : plane.pixels(y)) v = static_cast<float>(0.5 + sigma * std::sqrt(12.0) * (rng.uniform() - 0.5));
    return p;
  };
  const Rgb x = noisy(0.02), r1 = noisy(0.05), r2 = noisy(0.05), exact(200, 200, 0.5f);
  const RgbPlanes second = r2.view();
  const double truth = compare(x.view(), exact.view(), {}).lab_rms;
  EXPECT_GT(compare(x.view(), r1.view(), {}).lab_rms, 2 * truth);
  EXPECT_NEAR(compare(x.view(), r1.view(), {}, {}, &second).lab_rms, truth, 0.06 * truth);
  EXPECT_NEAR(compare(x.view(), r1.view(), {}, {}, &second).mse, 4e-4, 4e-5);
}

TEST(LabRmsForTuning, AgreesWithTheMetric) {
  Rng rng(2);
  Rgb x(50, 30, 0), a(50, 30, 0), b(50, 30, 0);
  for (Rgb* p : {&x, &a, &b})
    for (Plane& plane : p->planes)
      for (int y = 0; y < 30; ++y)
        for (float& v : plane.pixels(y)) v = static_cast<float>(1.3 * rng.uniform() - 0.1);
  Mask mask(1500);
  for (size_t i = 0; i < mask.size(); ++i) mask[i] = i % 3 != 0;
  const RgbPlanes second = b.view();
  for (const Mask& m : {Mask{}, mask}) {
    EXPECT_NEAR(LabRms(a.view(), nullptr, {0.8, true}, m)(x.view()),
                compare(x.view(), a.view(), {0.8, true}, m).lab_rms, 1e-3);
    EXPECT_NEAR(LabRms(a.view(), &second, {0.8, true}, m)(x.view()),
                compare(x.view(), a.view(), {0.8, true}, m, &second).lab_rms, 1e-3);
  }
}

TEST(MeanInterval, IsStudentsT) {
  const MeanInterval m = mean_interval({1, 2, 3, 4, 5});
  EXPECT_DOUBLE_EQ(m.mean, 3);
  EXPECT_NEAR(m.half_width, 2.7764 * std::sqrt(2.5 / 5), 1e-3);
  EXPECT_NEAR(mean_interval({1, 2, 3}).half_width, 4.3027 * std::sqrt(1.0 / 3), 1e-3);
  EXPECT_EQ(mean_interval({4}).half_width, 0);
}

TEST(TemporalError, IsHowThePictureChangesLessHowTheReferenceDoes) {
  TemporalError error(LabPolicy{});
  EXPECT_FALSE(error.result());
  const float pictures[] = {0.2f, 0.3f, 0.25f}, references[] = {0.2f, 0.22f, 0.3f};
  const auto lightness = [](float y) { return lab_from_rgb(dvec3(static_cast<double>(y))).x; };
  for (size_t i = 0; i < 3; ++i) error.add(Rgb(4, 3, pictures[i]).view(), Rgb(4, 3, references[i]).view(), nullptr, {});
  double errors = 0, changes = 0, reference = 0;
  for (size_t i = 1; i < 3; ++i) {
    const double x = lightness(pictures[i]) - lightness(pictures[i - 1]),
                 r = lightness(references[i]) - lightness(references[i - 1]);
    errors += (x - r) * (x - r);
    changes += x * x;
    reference += r * r;
  }
  const auto result = error.result();
  ASSERT_TRUE(result);
  EXPECT_EQ(result->pairs, 2);
  EXPECT_NEAR(result->temporal_error, std::sqrt(errors / 2), 1e-3);
  EXPECT_NEAR(result->flicker, std::sqrt(changes / 2) - std::sqrt(reference / 2), 1e-3);
  EXPECT_NEAR(result->reference, std::sqrt(reference / 2), 1e-3);
  const double last = std::abs((lightness(0.25f) - lightness(0.3f)) - (lightness(0.3f) - lightness(0.22f)));
  ASSERT_TRUE(error.last_change());
  EXPECT_NEAR((*error.last_change())(3, 2), last, 1e-3);
}

TEST(ContactSheet, ShowsAtMostTwelveFramesSmallEnough) {
  constexpr int kFrames = 30, kWidth = 700, kHeight = 300;
  ContactSheet sheet(LabPolicy{}, kFrames);
  TemporalError temporal(LabPolicy{});
  // Black, then a bright frame in the middle: what changes wrongly is there and in the one after.
  for (int i = 0; i < kFrames; ++i) {
    const Rgb picture(kWidth, kHeight, i == 15 ? 1.0f : 0.2f), reference(kWidth, kHeight, 0.2f);
    temporal.add(picture.view(), reference.view(), nullptr, {});
    sheet.add(i, picture.view(), reference.view(), 0, temporal.last_change());
  }
  const Picture drawn = sheet.draw();
  const int cell = kWidth / 3, row = kHeight / 3;  // 700 pixels are more than 320 by less than a factor of three
  EXPECT_NEAR(drawn.width, ContactSheet::kMostColumns * cell, ContactSheet::kMostColumns * 5);
  EXPECT_NEAR(drawn.height, 4 * row, 100);
  const auto bright = [&](int x, int y) {
    const size_t at = 3 * (static_cast<size_t>(y) * static_cast<size_t>(drawn.width) + static_cast<size_t>(x));
    return drawn.rgb[at] + drawn.rgb[at + 1] + drawn.rgb[at + 2];
  };
  // Frame 15 is the first of the seventh column: its error and its change shine, those of the others do not.
  const int pitch = (drawn.width + 4) / ContactSheet::kMostColumns;
  for (int column = 1; column < ContactSheet::kMostColumns; ++column)
    for (const int y : {26 + 2 * (row + 4) + row / 2, 26 + 3 * (row + 4) + row / 2})
      EXPECT_EQ(bright(column * pitch + cell / 2, y) > 300, column == 6) << column << ", " << y;
}

TEST(TemporalError, AConstantErrorDoesNotFlicker) {
  TemporalError error(LabPolicy{});
  for (int i = 0; i < 4; ++i) error.add(Rgb(4, 3, 0.5f).view(), Rgb(4, 3, 0.4f).view(), nullptr, Mask(12, 1));
  EXPECT_EQ(error.result()->temporal_error, 0);
  EXPECT_EQ(error.result()->flicker, 0);
}

}  // namespace
}  // namespace brume
