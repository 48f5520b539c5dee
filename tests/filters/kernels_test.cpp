// The vector code against its scalar definition, on every instruction set this machine has.

#include <gtest/gtest.h>

#include <cmath>

#include "base/rng.h"
#include "filters/kernels/lab.h"
#include "filters/kernels/moments.h"
#include "tests/support/reference_window_filters.h"
#include "filters/window/lab_window.h"
#include "image/color.h"
#include "tests/support/targets.h"

namespace brume::kernels {
namespace {

using test::EveryTarget;
INSTANTIATE_TEST_SUITE_P(Isa, EveryTarget, ::testing::ValuesIn(test::targets()), test::target_name);

/// A picture with an edge, a slope, noise, spikes, and directions some of which are undefined.
ReferenceImage make_image(int width, int height, uint64_t seed) {
  Rng rng(seed);
  ReferenceImage image{width, height, {}, {}, {}};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      dvec3 v(x > width / 2 ? 70 : 20, 5.0 * y / height, -10);
      for (int c = 0; c < 3; ++c) v[c] += 6 * (rng.uniform() - 0.5);
      if (rng.uniform() < 0.02) v += 140.0;
      image.value.push_back(dvec3(vec3(v)));
      const dvec3 g(rng.uniform() - 0.5, rng.uniform() - 0.5, rng.uniform() - 0.2);
      image.gradient.push_back(rng.uniform() < 0.2 ? dvec3(0) : dvec3(vec3(glm::normalize(g))));
      image.opacity.push_back(static_cast<float>(rng.uniform()));
    }
  return image;
}

WorkImage work_image(const ReferenceImage& image, int radius) {
  WorkImage w(image.width, image.height, radius, 3);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x)
      for (int c = 0; c < 3; ++c) w.channels[static_cast<size_t>(c)].row(y)[x] = static_cast<float>(image.at(x, y)[c]);
    w.extend_row(y);
  }
  return w;
}

WorkImage gradient_image(const ReferenceImage& image, int radius) {
  WorkImage w(image.width, image.height, radius, 4);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const dvec3 g = image.gradient[static_cast<size_t>(y) * image.width + x];
      for (int c = 0; c < 3; ++c) w.channels[static_cast<size_t>(c)].row(y)[x] = static_cast<float>(g[c]);
      w.channels[3].row(y)[x] = g == dvec3(0) ? 0.0f : 1.0f;
    }
    w.extend_row(y);
  }
  return w;
}

/// Largest difference, in Lab units of values up to about 200.
double difference(const WorkImage& out, const std::vector<dvec3>& reference) {
  double worst = 0;
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x)
      for (int c = 0; c < 3; ++c) {
        const double d =
            out.channels[static_cast<size_t>(c)].row(y)[x] - reference[static_cast<size_t>(y) * out.width() + x][c];
        worst = std::max(worst, std::isnan(d) ? INFINITY : std::abs(d));
      }
  return worst;
}

// The stated bound: 1e-3 Lab units at values up to 200, 5 parts in a million.
constexpr double kBound = 1e-3;

const std::pair<int, int> kSizes[] = {{1, 1}, {1, 9}, {9, 1}, {13, 1}, {2, 2}, {33, 17}, {64, 20}};

TEST_P(EveryTarget, BilateralIsItsDefinition) {
  for (const auto& [w, h] : kSizes)
    for (const int radius : {0, 1, 6, 9}) {
      const ReferenceImage image = make_image(w, h, 1);
      const WorkImage guide = work_image(image, radius);
      WorkImage out(w, h, radius, 3);
      for (const Bilateral s : {Bilateral{2, 20}, {0.5f, 3}, {3, 0}, {0, 10}, {2, 1e-7f}}) {
        for (int y = 0; y < h; ++y) bilateral_row({radius, &guide, &guide, &out, nullptr, {}, {}}, s, y);
        EXPECT_LT(difference(out, reference_bilateral(image, radius, s)), kBound)
            << w << " x " << h << " radius " << radius;
      }
    }
}

TEST_P(EveryTarget, GaussianIsItsDefinition) {
  for (const auto& [w, h] : kSizes)
    for (const float sigma : {0.5f, 2.0f, 0.0f}) {
      const ReferenceImage image = make_image(w, h, 2);
      EXPECT_LT(
          difference(gaussian(work_image(image, 6), 6, sigma, {1, {}, nullptr}), reference_gaussian(image, 6, sigma)),
          kBound);
    }
}

TEST_P(EveryTarget, ExtendedBilateralIsItsDefinition) {
  for (const auto& [w, h] : kSizes)
    for (const Bilateral s : {Bilateral{3, 10}, {2, 40}, {1, 1e6f}}) {
      const ReferenceImage image = make_image(w, h, 3);
      const WorkImage guide = work_image(image, 6), smooth = gaussian(guide, 6, s.sigma_domain, {1, {}, nullptr});
      WorkImage out(w, h, 6, 3);
      for (int y = 0; y < h; ++y) extended_bilateral_row({6, &guide, &guide, &out, nullptr, {}, {}}, s, smooth, y);
      EXPECT_LT(difference(out, reference_extended_bilateral(image, 6, s)), 3 * kBound) << w << " x " << h;
    }
}

TEST_P(EveryTarget, GradientKernelIsItsDefinition) {
  for (const auto& [w, h] : kSizes) {
    const ReferenceImage image = make_image(w, h, 4);
    const WorkImage guide = work_image(image, 6), gradient = gradient_image(image, 6);
    PaddedPlane opacity(w, h, 6);
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) opacity.row(y)[x] = static_cast<float>(image.opacity[static_cast<size_t>(y) * w + x]);
      opacity.extend_row(y);
    }
    WorkImage out(w, h, 6, 3);
    for (const GradientVariant variant : {GradientVariant::kAdd, GradientVariant::kMultiply, GradientVariant::kGate})
      for (const float sigma : {3.0f, 0.2f}) {
        const GradientWeights s{{2, 10}, sigma, variant, 1.5f, 0.1f};
        for (int y = 0; y < h; ++y)
          gradient_kernel_row({6, &guide, &guide, &out, nullptr, {}, {}}, s, gradient, &opacity, y);
        EXPECT_LT(difference(out, reference_gradient_kernel(image, 6, s)), kBound)
            << w << " x " << h << " variant " << static_cast<int>(variant);
      }
  }
}

TEST_P(EveryTarget, TrilateralIsItsDefinition) {
  for (const auto& [w, h] : kSizes) {
    const ReferenceImage image = make_image(w, h, 5);
    const WorkImage guide = work_image(image, 6);
    PaddedPlane road(w, h, 6);
    WorkImage out(w, h, 6, 3);
    for (int y = 0; y < h; ++y) {
      road_row(guide, road, y);
      for (int x = 0; x < w; ++x) ASSERT_NEAR(road.row(y)[x], reference_road(image, x, y), 1e-3);
    }
    for (const TrilateralWeights s : {TrilateralWeights{{2, 10}, 40, 50}, {{1, 40}, 5, 10}}) {
      for (int y = 0; y < h; ++y) trilateral_row({6, &guide, &guide, &out, nullptr, {}, {}}, s, road, y);
      EXPECT_LT(difference(out, reference_trilateral(image, 6, s)), kBound) << w << " x " << h;
    }
  }
}

TEST_P(EveryTarget, BackgroundPixelsGetTheBilateralFilter) {
  const ReferenceImage image = make_image(40, 12, 6);
  const WorkImage guide = work_image(image, 6);
  PaddedPlane medium(40, 12, 6);
  for (int y = 0; y < 12; ++y) {
    for (int x = 0; x < 40; ++x) medium.row(y)[x] = x % 3 == 0 ? 0.0f : 0.25f;
    medium.extend_row(y);
  }
  WorkImage out(40, 12, 6, 3);
  for (int y = 0; y < 12; ++y)
    bilateral_row({6, &guide, &guide, &out, &medium, WindowInput::Background::kBilateral, {2, 20}}, {1, 5}, y);
  const auto inside = reference_bilateral(image, 6, {1, 5}), outside = reference_bilateral(image, 6, {2, 20});
  std::vector<dvec3> expected;
  for (size_t i = 0; i < inside.size(); ++i) expected.push_back(i % 40 % 3 == 0 ? outside[i] : inside[i]);
  EXPECT_LT(difference(out, expected), kBound);
}

TEST_P(EveryTarget, LabIsItsDefinitionAndInverts) {
  Rng rng(7);
  alignas(64) float rgb[3][48], lab[3][48], back[3][48];
  double worst_lab = 0, worst_back = 0;
  for (int round = 0; round < 300; ++round) {
    const double scale = std::pow(10.0, 8 * rng.uniform() - 6);
    for (auto& row : rgb)
      for (float& v : row) v = static_cast<float>(scale * (rng.uniform() * 1.1 - 0.1));
    lab_from_rgb_row({rgb[0], rgb[1], rgb[2]}, 0.7f, {lab[0], lab[1], lab[2]}, 33);
    rgb_from_lab_row({lab[0], lab[1], lab[2]}, 0.7f, {back[0], back[1], back[2]}, 33);
    for (int x = 0; x < 33; ++x) {
      const dvec3 exact = lab_from_rgb(dvec3(rgb[0][x], rgb[1][x], rgb[2][x]) * 0.7);
      const double size = std::max(100.0, glm::length(exact));
      for (int c = 0; c < 3; ++c) {
        worst_lab = std::max(worst_lab, std::abs(lab[c][x] - exact[c]) / size);
        worst_back =
            std::max(worst_back, std::abs(static_cast<double>(back[c][x]) - rgb[c][x]) / std::max(scale, 1e-3));
      }
    }
  }
  EXPECT_LT(worst_lab, 3e-6) << "of 100 Lab units, or of the value beyond";
  EXPECT_LT(worst_back, 2e-5);
}

TEST_P(EveryTarget, ProductsOfColumnsAreTheirSums) {
  Rng rng(8);
  for (const size_t columns : {1u, 5u, 16u, 37u}) {
    constexpr size_t kTargets = 6, kPixels = 23;
    const size_t stride = (columns + kTargets + 15) / 16 * 16;
    std::vector<float> vectors(kPixels * stride);
    for (float& v : vectors) v = static_cast<float>(rng.uniform() - 0.3);
    std::vector<float> products(product_floats(columns, stride), 0.5f);
    add_products(vectors.data(), kPixels, stride, columns, products.data());
    for (size_t i = 0; i < columns; ++i)
      for (size_t j = i; j < columns + kTargets; ++j) {
        double expected = 0.5;
        for (size_t p = 0; p < kPixels; ++p)
          expected += static_cast<double>(vectors[p * stride + i]) * static_cast<double>(vectors[p * stride + j]);
        ASSERT_LT(product_index(i, j, stride), products.size());
        ASSERT_NEAR(products[product_index(i, j, stride)], expected, 1e-5) << columns << " " << i << " " << j;
      }
  }
}

TEST_P(EveryTarget, PredictionsAreSumsOverNodesAndColumns) {
  Rng rng(9);
  constexpr size_t kWidth = 11, kNodes = 4, kTargets = 3, kStride = 32, kNode = kTargets * kStride + 16;
  std::vector<float> coefficients(kNodes * kNode), vectors(kWidth * kStride), weights(3 * kWidth);
  std::vector<int> nodes(3 * kWidth);
  for (auto* list : {&coefficients, &vectors, &weights})
    for (float& v : *list) v = static_cast<float>(rng.uniform() - 0.4);
  for (int& n : nodes) n = static_cast<int>(kNodes * rng.uniform());
  std::vector<float> out(kTargets * kWidth);
  float* const rows[] = {out.data(), out.data() + kWidth, out.data() + 2 * kWidth};
  predict_row(vectors.data(), kWidth,
              {coefficients.data(), nodes.data(), weights.data(), kNode, kTargets, kStride, kStride, kStride}, rows);
  for (size_t t = 0; t < kTargets; ++t)
    for (size_t x = 0; x < kWidth; ++x) {
      double expected = 0;
      for (size_t n = 0; n < 3; ++n)
        for (size_t k = 0; k < kStride; ++k)
          expected +=
              static_cast<double>(weights[3 * x + n]) *
              static_cast<double>(coefficients[static_cast<size_t>(nodes[3 * x + n]) * kNode + t * kStride + k]) *
              static_cast<double>(vectors[x * kStride + k]);
      ASSERT_NEAR(rows[t][x], expected, 1e-5);
    }
}

}  // namespace
}  // namespace brume::kernels
