// Three filters against OpenCV's, each set up so that the two definitions are the same.

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/photo.hpp>
#include <opencv2/ximgproc/edge_filter.hpp>

#include "tests/support/reference_window_filters.h"
#include "filters/patch/neighbourhood.h"
#include "filters/regression/guided_filter.h"
#include "filters/window/lab_window.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

constexpr int kWidth = 96, kHeight = 64;

Plane picture() {
  Plane p(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      p(x, y) = static_cast<float>(40 + 20 * std::sin(0.1 * x) + (y > 30 ? 30 : 0) + 5 * test::normal(x, y, 1));
  return p;
}

cv::Mat to_cv(const Plane& p) {
  cv::Mat m(p.height(), p.width(), CV_32F);
  for (int y = 0; y < p.height(); ++y)
    for (int x = 0; x < p.width(); ++x) m.at<float>(y, x) = p(x, y);
  return m;
}

TEST(OpenCv, Bilateral) {
  const Plane p = picture();
  cv::Mat theirs;
  // OpenCV's window is a disc; at radius 6 and sigma 1.2 the corners it leaves out weigh less than e^-12.
  cv::bilateralFilter(to_cv(p), theirs, 13, 15, 1.2);
  const Plane* planes[] = {&p, &p, &p};
  const WorkImage values = padded(planes, 6);
  const Plane* one[] = {&p};
  const WorkImage guide = padded(one, 6);
  WorkImage out(kWidth, kHeight, 6, 3);
  kernels::WindowInput in;
  in.radius = 6;
  in.guide = &guide;
  in.values = &values;
  in.out = &out;
  for (int y = 0; y < kHeight; ++y) kernels::bilateral_row(in, {1.2f, 15}, y);
  for (int y = 6; y < kHeight - 6; ++y)
    for (int x = 6; x < kWidth - 6; ++x) ASSERT_NEAR(out.channels[0].row(y)[x], theirs.at<float>(y, x), 5e-3);
}

TEST(OpenCv, NonLocalMeans) {
  cv::Mat bytes(kHeight, kWidth, CV_8U), theirs;
  Plane p(kWidth, kHeight);
  const Plane source = picture();
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      bytes.at<uint8_t>(y, x) = static_cast<uint8_t>(std::lround(source(x, y)));
      p(x, y) = bytes.at<uint8_t>(y, x);
    }
  const float h = 8;
  cv::fastNlMeansDenoising(bytes, theirs, h, 7, 21);
  // Theirs: exp(-mean d^2 / h^2). Ours: exp(-(mean d^2 - 2 V) / (2 k^2 V)), the same for 2 k^2 V = h^2 and a large k.
  const float k = 100, v = h * h / (2 * k * k);
  const Plane noise(kWidth, kHeight, v);
  const Plane *guide[] = {&p}, *variance[] = {&noise};
  WeightModel model;
  model.distances.push_back(noise_distance(guide, variance, 3, k));
  const std::vector<Plane> ours = weighted_average(model, square_window(10), guide, {}).values;
  for (int y = 13; y < kHeight - 13; ++y)
    for (int x = 13; x < kWidth - 13; ++x) ASSERT_NEAR(ours[0](x, y), theirs.at<uint8_t>(y, x), 1.0) << x << " " << y;
}

TEST(OpenCv, GuidedFilter) {
  const Plane p = picture();
  std::vector<Plane> guide;
  std::vector<cv::Mat> channels;
  for (uint64_t c = 0; c < 3; ++c) {
    Plane g(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) g(x, y) = static_cast<float>(test::chance(x, y, 5 + c));
    channels.push_back(to_cv(g));
    guide.push_back(std::move(g));
  }
  cv::Mat color, theirs;
  cv::merge(channels, color);
  cv::ximgproc::guidedFilter(color, to_cv(p), theirs, 4, 0.01);
  const Plane* inputs[] = {&p};
  const std::vector<Plane> ours = guided_filter(inputs, pointers(guide), 4, 0.01f, {});
  // OpenCV extends borders by reflection; inside, away from them by two windows, the formulas are the same.
  for (int y = 9; y < kHeight - 9; ++y)
    for (int x = 9; x < kWidth - 9; ++x) ASSERT_NEAR(ours[0](x, y), theirs.at<float>(y, x), 2e-2);
}

}  // namespace
}  // namespace brume
