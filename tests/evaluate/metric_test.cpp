#include "evaluate/metric.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/rng.h"

namespace brume {
namespace {

struct Rgb {
  std::array<Plane, 3> planes;
  Rgb(int w, int h, float value) : planes{Plane(w, h, value), Plane(w, h, value), Plane(w, h, value)} {}
  RgbPlanes view() const { return {&planes[0], &planes[1], &planes[2]}; }
};

TEST(Compare, EqualPicturesHaveNoError) {
  const Rgb a(7, 5, 0.4f);
  for (const auto& [name, value] : listed(compare(a.view(), a.view(), {}))) EXPECT_EQ(value, 0.0) << name;
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
  // One pixel of 100 in 400 x 400 gives 1.16 unclipped and 0.10 clipped, from L* = 60.
  const float grey = 0.2812f;
  Rgb x(400, 400, grey), r(400, 400, grey);
  for (Plane& p : x.planes) p(10, 10) = 100.0f;
  const Errors e = compare(x.view(), r.view(), {});
  EXPECT_NEAR(e.lab_rms, 0.10, 0.005);
  EXPECT_NEAR(e.lab_rms_unclipped, 1.16, 0.005);
  EXPECT_EQ(compare(x.view(), r.view(), {0.01, true}).lab_rms, compare(x.view(), r.view(), {0.01, false}).lab_rms);
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
  EXPECT_THROW(compare(x.view(), Rgb(4, 4, 0.2f).view(), {}), InputError);
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

}  // namespace
}  // namespace brume
