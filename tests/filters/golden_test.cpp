// Values computed independently of this code, in double precision (docs/methods.md, Gradient kernel), and identities
// that hold exactly.

#include <gtest/gtest.h>

#include <cmath>

#include "base/rng.h"
#include "tests/support/reference_window_filters.h"
#include "filters/window/lab_window.h"

namespace brume::kernels {
namespace {

constexpr int kSize = 41, kMiddle = 20, kRadius = 6;

ReferenceImage flat(double value) {
  ReferenceImage image{kSize, kSize, {}, {}, {}};
  image.value.assign(kSize * kSize, dvec3(value, 0, 0));
  image.gradient.assign(kSize * kSize, dvec3(0, 0, 1));
  return image;
}
ReferenceImage step(double height) {
  ReferenceImage image = flat(20);
  for (int y = 0; y < kSize; ++y)
    for (int x = kMiddle; x < kSize; ++x) image.value[static_cast<size_t>(y * kSize + x)].x += height;
  return image;
}
ReferenceImage spike(double height) {
  ReferenceImage image = flat(60);
  image.value[kMiddle * kSize + kMiddle].x += height;
  return image;
}

const GradientWeights kPaper{{2, 10}, 3, GradientVariant::kAdd, 1, 0.1f};
const Bilateral kBilateral{2, 20}, kExtended{3, 10};
double left_of_edge(const std::vector<dvec3>& out) {
  return out[kMiddle * kSize + kMiddle - 1].x - 20;
}
double at_spike(const std::vector<dvec3>& out) {
  return out[kMiddle * kSize + kMiddle].x - 60;
}
double beside_spike(const std::vector<dvec3>& out) {
  return out[kMiddle * kSize + kMiddle + 1].x - 60;
}

TEST(Golden, StepOf60) {
  EXPECT_NEAR(left_of_edge(reference_gradient_kernel(step(60), kRadius, kPaper)), 15.01, 0.006);
  EXPECT_NEAR(left_of_edge(reference_bilateral(step(60), kRadius, kBilateral)), 0.44, 0.006);
  EXPECT_NEAR(left_of_edge(reference_extended_bilateral(step(60), kRadius, kExtended)), 3.63, 0.006);
  EXPECT_NEAR(left_of_edge(reference_gaussian(step(60), kRadius, 2)), 24.01, 0.006);
  // w_G = 0.8 everywhere, its lowest value at sigma_G = 3: the gate variant with equal opacities says so.
  ReferenceImage image = step(60);
  image.opacity.assign(kSize * kSize, 1.0);
  EXPECT_NEAR(left_of_edge(reference_gradient_kernel(image, kRadius, {{2, 10}, 3, GradientVariant::kGate, 0.8f, 0.1f})),
              13.72, 0.006);
}

TEST(Golden, StepOf30) {
  EXPECT_NEAR(left_of_edge(reference_gradient_kernel(step(30), kRadius, kPaper)), 7.57, 0.006);
  EXPECT_NEAR(left_of_edge(reference_bilateral(step(30), kRadius, kBilateral)), 5.34, 0.006);
  EXPECT_NEAR(left_of_edge(reference_extended_bilateral(step(30), kRadius, kExtended)), 8.72, 0.006);
  EXPECT_NEAR(left_of_edge(reference_gaussian(step(30), kRadius, 2)), 12.01, 0.006);
}

TEST(Golden, SpikeOf140) {
  const ReferenceImage image = spike(140);
  EXPECT_NEAR(at_spike(reference_gradient_kernel(image, kRadius, kPaper)), 10.74, 0.006);
  EXPECT_NEAR(at_spike(reference_bilateral(image, kRadius, kBilateral)), 140.0, 0.006);
  EXPECT_NEAR(at_spike(reference_extended_bilateral(image, kRadius, kExtended)), 0.00, 0.006);
  EXPECT_NEAR(at_spike(reference_gaussian(image, kRadius, 2)), 5.58, 0.006);
  EXPECT_NEAR(beside_spike(reference_gradient_kernel(image, kRadius, kPaper)), 2.51, 0.006);
  EXPECT_NEAR(beside_spike(reference_gaussian(image, kRadius, 2)), 4.93, 0.006);
  EXPECT_NEAR(beside_spike(reference_bilateral(image, kRadius, kBilateral)), 0.000, 0.0006);
  EXPECT_NEAR(beside_spike(reference_extended_bilateral(image, kRadius, kExtended)), 0.000, 0.0006);
  const TrilateralWeights trilateral{{2, 10}, 40, 50};
  EXPECT_NEAR(at_spike(reference_trilateral(image, kRadius, trilateral)), 0.00, 0.006);
}

double noise_out(const std::vector<dvec3>& out) {
  double sum = 0;
  for (int y = 8; y < 112; ++y)
    for (int x = 8; x < 112; ++x) {
      const dvec3 d = out[static_cast<size_t>(y) * 120 + x] - dvec3(60, 0, 0);
      sum += glm::dot(d, d);
    }
  return std::sqrt(sum / (104 * 104));
}

TEST(Golden, FlatNoise) {
  for (const auto& [rms, expected] :
       {std::pair(8.60, std::array{1.43, 0.90, 1.46, 1.23}), {4.32, std::array{.63, .44, .65, .62}}}) {
    ReferenceImage image{120, 120, {}, {}, {}};
    Rng rng(12);
    const auto normal = [&] { return std::sqrt(2 * rng.exponential()) * portable_sincos_2pi(rng.uniform()).cos; };
    for (int i = 0; i < 120 * 120; ++i)
      image.value.push_back(dvec3(60, 0, 0) + dvec3(normal(), normal(), normal()) * (rms / std::sqrt(3.0)));
    image.gradient.assign(120 * 120, dvec3(0, 0, 1));
    // The estimate's own scatter on 104 x 104 correlated pixels is about 3 %.
    EXPECT_NEAR(noise_out(reference_bilateral(image, kRadius, kBilateral)), expected[0], 0.1 * expected[0]);
    EXPECT_NEAR(noise_out(reference_extended_bilateral(image, kRadius, kExtended)), expected[1], 0.1 * expected[1]);
    EXPECT_NEAR(noise_out(reference_gradient_kernel(image, kRadius, kPaper)), expected[2], 0.1 * expected[2]);
    EXPECT_NEAR(noise_out(reference_gaussian(image, kRadius, 2)), expected[3], 0.1 * expected[3]);
  }
}

ReferenceImage noisy_cloud(bool gradients) {
  Rng rng(3);
  ReferenceImage image{kSize, kSize, {}, {}, {}};
  for (int i = 0; i < kSize * kSize; ++i) {
    image.value.push_back({60 + 30 * rng.uniform(), 20 * rng.uniform(), 10 * rng.uniform()});
    image.gradient.push_back(gradients ? glm::normalize(dvec3(rng.uniform() - .5, rng.uniform() - .5, rng.uniform()))
                                       : dvec3(0));
  }
  return image;
}

// The additive filter is lambda B + (1 - lambda) S: a bilateral filter and a gradient-weighted blur.
TEST(GradientKernel, SplitsIntoBilateralAndGradientWeightedBlur) {
  const ReferenceImage image = noisy_cloud(true);
  for (const float sigma : {3.0f, 0.2f}) {
    const GradientWeights weights{{2, 10}, sigma, GradientVariant::kAdd, 1, 0.1f};
    const auto out = reference_gradient_kernel(image, kRadius, weights);
    for (int y = 0; y < kSize; y += 3)
      for (int x = 0; x < kSize; x += 3) {
        dvec3 b(0), s(0);
        double sum_b = 0, sum_s = 0;
        for (int qy = std::max(0, y - kRadius); qy <= std::min(kSize - 1, y + kRadius); ++qy)
          for (int qx = std::max(0, x - kRadius); qx <= std::min(kSize - 1, x + kRadius); ++qx) {
            const double w_d = std::exp(-((x - qx) * (x - qx) + (y - qy) * (y - qy)) / 8.0);
            const dvec3 d = image.at(x, y) - image.at(qx, qy);
            const double w_l = std::exp(-glm::dot(d, d) / 200.0);
            const double apart = 1 - glm::dot(image.gradient[static_cast<size_t>(y * kSize + x)],
                                              image.gradient[static_cast<size_t>(qy * kSize + qx)]);
            const double w_g = std::exp(-apart * apart / (2.0 * sigma * sigma));
            b += w_d * w_l * image.at(qx, qy);
            sum_b += w_d * w_l;
            s += w_d * w_g * image.at(qx, qy);
            sum_s += w_d * w_g;
          }
        const double lambda = sum_b / (sum_b + sum_s);
        EXPECT_LT(
            glm::distance(out[static_cast<size_t>(y * kSize + x)], lambda * (b / sum_b) + (1 - lambda) * (s / sum_s)),
            1e-6);
      }
  }
}

TEST(GradientKernel, RotatingAllDirectionsChangesNothing) {
  ReferenceImage image = noisy_cloud(true);
  const GradientWeights weights{{2, 10}, 0.2f, GradientVariant::kAdd, 1, 0.1f};
  const auto before = reference_gradient_kernel(image, kRadius, weights);
  const Frame turn(glm::normalize(dvec3(1, 2, -2)));
  for (dvec3& g : image.gradient) g = turn.to_world(g);
  const auto after = reference_gradient_kernel(image, kRadius, weights);
  for (size_t i = 0; i < before.size(); ++i) EXPECT_LT(glm::distance(before[i], after[i]), 1e-9);
}

TEST(GradientKernel, WithoutDirectionsItIsTheBilateralBitForBit) {
  const ReferenceImage image = noisy_cloud(false);
  WorkImage guide(kSize, kSize, kRadius, 3), gradient(kSize, kSize, kRadius, 4), a(kSize, kSize, kRadius, 3), b = a;
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x)
      for (int c = 0; c < 3; ++c)
        guide.channels[static_cast<size_t>(c)].row(y)[x] = static_cast<float>(image.at(x, y)[c]);
    guide.extend_row(y);
    gradient.extend_row(y);
  }
  for (const GradientVariant variant : {GradientVariant::kAdd, GradientVariant::kMultiply}) {
    for (int y = 0; y < kSize; ++y) {
      bilateral_row({kRadius, &guide, &guide, &a, nullptr, {}, {}}, {2, 10}, y);
      gradient_kernel_row({kRadius, &guide, &guide, &b, nullptr, {}, {}}, {{2, 10}, 3, variant, 1, 0.1f}, gradient,
                          nullptr, y);
    }
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < kSize; ++y)
        for (int x = 0; x < kSize; ++x) ASSERT_EQ(a.channels[c].row(y)[x], b.channels[c].row(y)[x]);
  }
}

// docs/methods.md, Extended bilateral: with f~ in both sums the result stays within the window's range and follows an
// added constant.
TEST(ExtendedBilateral, StaysInRangeAndFollowsAConstant) {
  const ReferenceImage image = spike(140);
  const auto out = reference_extended_bilateral(image, kRadius, {2, 5});
  ReferenceImage shifted = image;
  for (dvec3& v : shifted.value) v += 7.0;
  const auto moved = reference_extended_bilateral(shifted, kRadius, {2, 5});
  for (size_t i = 0; i < out.size(); ++i) {
    EXPECT_GE(out[i].x, 60 - 1e-9);
    EXPECT_LE(out[i].x, 200 + 1e-9);
    EXPECT_LT(glm::distance(moved[i], out[i] + 7.0), 1e-9);
  }
}

}  // namespace
}  // namespace brume::kernels
