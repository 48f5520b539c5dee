// Scenes drawn from seeds (tests/support/random_scene.h): predicted against traced light, and clean frames against
// noisy ones. BRUME_SCENES=N takes the seeds 1 to N (20 that hold every kind unless set), BRUME_SCENES_FROM another
// first one, and BRUME_SCENES_KEEP a folder that keeps the scenes and their files, to be rendered by hand.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <vector>

#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/random_scene.h"
#include "workflows/clean.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

uint64_t number(const char* variable, uint64_t otherwise) {
  const char* const wanted = std::getenv(variable);
  return wanted ? std::strtoull(wanted, nullptr, 10) : otherwise;
}

class RandomScene : public ::testing::TestWithParam<uint64_t> {
 public:
  fs::path folder() const {
    const char* const kept = std::getenv("BRUME_SCENES_KEEP");
    return kept ? fs::path(kept) : folder_.path();
  }
  static std::vector<uint64_t> seeds() {
    if (!std::getenv("BRUME_SCENES")) return {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 19, 26, 31, 34, 37};
    std::vector<uint64_t> list(number("BRUME_SCENES", 0));
    std::iota(list.begin(), list.end(), number("BRUME_SCENES_FROM", 1));
    return list;
  }

 private:
  test::TemporaryFolder folder_;
};

constexpr int kBlock = 4;

/// Sums over the pixels of a block.
double block_sum(const Plane& plane, int bx, int by) {
  double sum = 0;
  for (int y = by; y < by + kBlock; ++y)
    for (int x = bx; x < bx + kBlock; ++x) sum += plane(x, y);
  return sum;
}

float least(const Plane& plane) {
  float value = plane(0, 0);
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) value = std::min(value, v);
  return value;
}

/// How a prediction differs from the traced light, over the blocks that a medium fills and in which the traced light is
/// known well enough to judge by.
struct Difference {
  double error = 0;  ///< root mean square of the difference over that of the light, without what noise makes of it
  double noise = 0;  ///< how far the traced light's noise alone would reach
  double mean = 0;   ///< the prediction's mean over that of the light
  int values = 0;    ///< of blocks and channels
};

/// @param factor  the prediction is taken times this
Difference difference(const Layers& frame, const LayerName& traced, const std::string& predicted, double factor = 1) {
  constexpr double kKnown = 0.3;  // noise of a block relative to its light
  double squares = 0, variance = 0, light = 0, sum = 0, sum_traced = 0;
  Difference result;
  const Plane& opacity = frame.at(frame.find("guide.opacity.Y") ? "guide.opacity.Y" : "guide.opacity.G");
  for (int by = 0; by + kBlock <= frame.height(); by += kBlock)
    for (int bx = 0; bx + kBlock <= frame.width(); bx += kBlock) {
      if (block_sum(opacity, bx, by) < 0.2 * kBlock * kBlock) continue;
      for (size_t c = 0; c < 3; ++c) {
        const double t = block_sum(frame.at(traced.channel(c)), bx, by),
                     p = factor * block_sum(frame.at(predicted + "." + "RGB"[c]), bx, by),
                     v = block_sum(frame.at(traced.channel_of(statistic::mean_variance, c)), bx, by);
        if (!(v < kKnown * kKnown * t * t)) continue;
        ++result.values;
        squares += (p - t) * (p - t);
        variance += v;
        light += t * t;
        sum += p;
        sum_traced += t;
      }
    }
  if (light > 0) {
    result.error = std::sqrt(std::max(0.0, squares - variance) / light);
    result.noise = std::sqrt(variance / light);
    result.mean = sum / sum_traced;
  }
  return result;
}

/// What the guides of scenes of a kind may be wrong by; a scene may what the most lenient of its kinds may. The aim is
/// 0.05, and 0.1 behind glass. Beyond the seeds that are tested by default, 41 and 44 exceed it: droplets and sharp
/// lobes in the light of a spot and of a point, predicted twice as bright.
struct Limit {
  const char* kind;
  double direct, indirect;            ///< error
  double direct_mean, indirect_mean;  ///< factor between the means, either way
};
constexpr Limit kLimits[] = {{"", 0.12, 0.22, 1.2, 1.4},
                             {"two lobes", 0.27, 0.5, 1.25, 2},
                             {"mie", 0.26, 0.7, 1.2, 2},
                             {"mesh light", 0.8, 0.6, 1.25, 1.5},
                             {"mesh inside", 0.12, 0.31, 1.2, 1.5},
                             {"camera inside", 0.26, 0.36, 1.2, 1.4}};

Limit limit_of(const test::RandomScene& random) {
  Limit limit = kLimits[0];
  for (const Limit& l : kLimits)
    if (random.kinds.contains(l.kind)) {
      limit.direct = std::max(limit.direct, l.direct);
      limit.indirect = std::max(limit.indirect, l.indirect);
      limit.direct_mean = std::max(limit.direct_mean, l.direct_mean);
      limit.indirect_mean = std::max(limit.indirect_mean, l.indirect_mean);
    }
  return limit;
}

bool within(const Difference& d, double error, double mean) {
  return d.error <= error + 2 * d.noise && d.mean <= mean && d.mean >= 1 / mean;
}

/// Holds a prediction to its limits, and the limits to their purpose: they must turn away no light at all, and the same
/// prediction too bright or too dark by the square of the factor that its mean may be off by.
void expect_predicted(const Layers& frame, const LayerName& traced, const std::string& predicted, double error,
                      double mean) {
  const Difference d = difference(frame, traced, predicted);
  if (d.values == 0) return;  // no light there, or none that is known
  EXPECT_TRUE(within(d, error, mean)) << predicted << ": error " << d.error << ", limit " << error
                                      << " and twice the noise, " << d.noise << "; mean " << d.mean
                                      << ", factor allowed " << mean;
  for (const double factor : {0.0, 0.999 / (mean * mean), 1.001 * mean * mean})
    EXPECT_FALSE(within(difference(frame, traced, predicted, factor), error, mean))
        << predicted << ": nothing would be noticed of " << factor << " times it";
}

/// Mean squares of the difference of two pictures, in pixels brighter than 1 relative to them, so that a light that is
/// seen does not decide alone; and what of it is the noise of the second.
struct Distance {
  double squares = 0, noise = 0;
};

Distance distance(const Layers& picture, const Layers& reference) {
  Distance sum;
  const double values = 3.0 * reference.width() * reference.height();
  for (size_t c = 0; c < 3; ++c) {
    const Plane &truth = *reference.rgb(layer::beauty)[c], &seen = *picture.rgb(layer::beauty)[c],
                &variance = *reference.rgb(layer::beauty, statistic::mean_variance)[c];
    for (int y = 0; y < reference.height(); ++y)
      for (int x = 0; x < reference.width(); ++x) {
        const double unit = 1 / std::max(1.0f, truth(x, y)), d = (seen(x, y) - truth(x, y)) * unit;
        sum.squares += d * d / values;
        sum.noise += variance(x, y) * unit * unit / values;
      }
  }
  return sum;
}

TEST_P(RandomScene, IsPredictedByItsGuidesAndNeverWorseClean) {
  const test::RandomScene random = test::random_scene(GetParam(), folder());
  SCOPED_TRACE(random.text() + "\n" + random.toml);
  const PreparedScene scene(random.scene, LayerRequest::of({"direct", "indirect", "guides"}, true));
  const Layers frame = scene.render(128, 1, {}).layers;
  for (const auto& [name, plane] : frame.channels()) EXPECT_EQ(count_not_finite(plane), 0u) << name;
  for (const std::string part : {"direct", "indirect"})
    for (const char channel : {'R', 'G', 'B'})
      EXPECT_GE(least(frame.at("guide.predicted_" + part + "." + channel)), 0.0f) << part << " " << channel;
  const Difference direct = difference(frame, layer::direct, "guide.predicted_direct"),
                   indirect = difference(frame, layer::indirect, "guide.predicted_indirect");

  Cleaner cleaner("transport_regression", 1, {});
  const PreparedScene to_clean(random.scene, cleaner.request(LayerRequest::of({"direct", "indirect"}, true), 4));
  const Layers noisy = to_clean.render(4, 2, {}).layers, clean = cleaner.clean(noisy);
  const Distance before = distance(noisy, frame), after = distance(clean, frame);

  const Limit limit = limit_of(random);
  expect_predicted(frame, layer::direct, "guide.predicted_direct", limit.direct, limit.direct_mean);
  expect_predicted(frame, layer::indirect, "guide.predicted_indirect", limit.indirect, limit.indirect_mean);
  const double left = std::sqrt(std::max(0.0, after.squares - after.noise)),
               noise = std::sqrt(std::max(0.0, before.squares - before.noise));
  EXPECT_LE(left, 1.02 * noise + 0.1 * std::sqrt(after.noise));
  std::printf(
      "seed %llu: direct %.3f (noise %.3f, mean %.3f), indirect %.3f (noise %.3f, mean %.3f), clean %.3f of noisy: %s\n",
      static_cast<unsigned long long>(random.seed), direct.error, direct.noise, direct.mean, indirect.error,
      indirect.noise, indirect.mean, left / noise, random.text().c_str());
}
INSTANTIATE_TEST_SUITE_P(Seeds, RandomScene, ::testing::ValuesIn(RandomScene::seeds()),
                         [](const auto& seed) { return std::to_string(seed.param); });

}  // namespace
}  // namespace brume
