#include "render/world/bsdf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/running_statistics.h"
#include "tests/support/surface_scenes.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

// For every kind of surface and incidence: the sampled weight is f cos / pdf, and the density integrates to the share
// of samples that carry anything.
TEST(Bsdf, WeightsAreValuesOverDensities) {
  Rng rng(1);
  for (const Bsdf::Kind kind :
       {Bsdf::Kind::kDiffuse, Bsdf::Kind::kConductor, Bsdf::Kind::kDielectric, Bsdf::Kind::kCoated})
    for (const double roughness : {0.25, 0.5, 0.9})
      for (const bool inside : {false, true})
        for (const double cos_o : {0.1, 0.5, 0.95}) {
          const CoatAlbedo coat(roughness * roughness, 1.5);
          const Bsdf bsdf{kind, dvec3(0.7), roughness, 1.5, dvec3(0.4), &coat};
          const dvec3 wo(std::sqrt(1 - cos_o * cos_o), 0, cos_o);
          RunningStatistics sampled, uniform, pdf;
          for (int i = 0; i < 40000; ++i) {
            Bsdf::Sample s;
            const bool ok = bsdf.sample(wo, inside, {rng.uniform(), rng.uniform(), rng.uniform()}, s);
            if (ok) {
              ASSERT_NEAR(s.pdf, bsdf.pdf(wo, s.wi, inside), 1e-6 * s.pdf + 1e-9);
              const dvec3 value = bsdf.value(wo, s.wi, inside);
              if (s.pdf > 1e-6) {
                ASSERT_NEAR(s.weight.x, value.x / s.pdf, 2e-3 * s.weight.x + 1e-6);
              }
            }
            sampled.add(ok ? s.weight.x : 0.0);
            const dvec3 wi = test::random_direction(rng);
            uniform.add(bsdf.value(wo, wi, inside).x * 4 * kPi);
            pdf.add(bsdf.pdf(wo, wi, inside) * 4 * kPi);
          }
          EXPECT_NEAR(sampled.mean, uniform.mean, 5 * std::sqrt(sampled.mean_variance() + uniform.mean_variance()))
              << static_cast<int>(kind) << " " << roughness << " " << inside << " " << cos_o;
          EXPECT_LE(pdf.mean, 1 + 5 * std::sqrt(pdf.mean_variance()));
          EXPECT_GE(pdf.mean, 0.5);
        }
}

// A coat over a base that absorbs nothing loses nothing, from whichever side it is looked at; light may be sent either
// way.
TEST(Bsdf, CoatsAreReciprocalAndLoseNothing) {
  Rng rng(3);
  for (const double roughness : {0.0, 0.2, 0.5, 1.0})
    for (const double ior : {1.05, 1.5, 2.5}) {
      Bsdf bsdf{Bsdf::Kind::kCoated, dvec3(1), roughness, ior};
      const CoatAlbedo coat(bsdf.alpha(), ior);
      bsdf.coat = &coat;
      for (const double cos_o : {0.05, 0.3, 0.7, 1.0}) {
        const dvec3 wo(std::sqrt(1 - cos_o * cos_o), 0, cos_o);
        RunningStatistics reflected;
        for (int i = 0; i < 20000; ++i) {
          Bsdf::Sample s;
          const bool ok = bsdf.sample(wo, false, {rng.uniform(), rng.uniform(), rng.uniform()}, s);
          reflected.add(ok ? s.weight.x : 0.0);
          if (!ok || s.wi.z < 1e-3) continue;
          const double there = bsdf.value(wo, s.wi, false).x * wo.z, back = bsdf.value(s.wi, wo, false).x * s.wi.z;
          ASSERT_NEAR(there, back, 1e-6 * there);
        }
        EXPECT_NEAR(reflected.mean, 1, 5 * std::sqrt(reflected.mean_variance()) + 4e-3)
            << roughness << " " << ior << " " << cos_o;
      }
    }
}

// Directions come as often as the density says: counted in cells of equal solid angle on either side.
TEST(Bsdf, DirectionsHaveTheirDensity) {
  constexpr int kAcross = 8, kAround = 12, kDraws = 200000, kPoints = 64;
  for (const Bsdf::Kind kind : {Bsdf::Kind::kConductor, Bsdf::Kind::kDielectric, Bsdf::Kind::kCoated})
    for (const double roughness : {0.6, 0.9})
      for (const double cos_o : {0.3, 0.9}) {
        const CoatAlbedo coat(roughness * roughness, 1.5);
        const Bsdf bsdf{kind, dvec3(0.7), roughness, 1.5, dvec3(1), &coat};
        const dvec3 wo(std::sqrt(1 - cos_o * cos_o), 0, cos_o);
        std::vector<double> expected(2 * kAcross * kAround + 1), counted(expected.size());
        double all = 0;
        for (int cell = 0; cell < 2 * kAcross * kAround; ++cell) {
          double sum = 0;
          for (int k = 0; k < kPoints * kPoints; ++k) {
            const double z = -1 + (cell / kAround + (k % kPoints + 0.5) / kPoints) / kAcross;
            const double phi = (cell % kAround + (k / kPoints + 0.5) / kPoints) * 2 * kPi / kAround;
            const double r = std::sqrt(1 - z * z);
            sum += bsdf.pdf(wo, {r * std::cos(phi), r * std::sin(phi), z}, false);
          }
          expected[static_cast<size_t>(cell)] = sum / (kPoints * kPoints) * 2 * kPi / (kAcross * kAround) * kDraws;
          all += expected[static_cast<size_t>(cell)];
        }
        expected.back() = kDraws - all;  // that carry nothing
        Rng rng(7);
        for (int i = 0; i < kDraws; ++i) {
          Bsdf::Sample s;
          if (!bsdf.sample(wo, false, {rng.uniform(), rng.uniform(), rng.uniform()}, s)) {
            ++counted.back();
            continue;
          }
          const double phi = std::atan2(s.wi.y, s.wi.x), turn = (phi < 0 ? phi + 2 * kPi : phi) / (2 * kPi);
          const int row = std::clamp(static_cast<int>((s.wi.z + 1) * kAcross), 0, 2 * kAcross - 1);
          ++counted[static_cast<size_t>(row * kAround + std::min(static_cast<int>(turn * kAround), kAround - 1))];
        }
        double chi2 = 0;
        int cells = 0;
        for (size_t i = 0; i < expected.size(); ++i) {
          if (expected[i] < 20) continue;
          chi2 += (counted[i] - expected[i]) * (counted[i] - expected[i]) / expected[i];
          ++cells;
        }
        // Mean and deviation of the distribution; the cells' integrals are wrong by a little, too.
        EXPECT_LT(chi2, cells + 5 * std::sqrt(2.0 * cells))
            << static_cast<int>(kind) << " " << roughness << " " << cos_o;
      }
}

}  // namespace
}  // namespace brume
