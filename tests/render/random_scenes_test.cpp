// Scenes drawn from seeds (tests/support/random_scene.h): predicted against traced light, and clean frames against
// noisy ones. BRUME_SCENES says how many seeds (16 unless set); BRUME_SCENES_FROM the first of them; BRUME_SCENES_KEEP
// names a folder that keeps the scenes and their files, to be rendered by hand.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <optional>

#include "base/progress.h"
#include "render/frame/renderer.h"
#include "tests/support/files.h"
#include "tests/support/random_scene.h"
#include "work/clean.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

uint64_t number(const char* variable, uint64_t otherwise) {
  const char* const wanted = std::getenv(variable);
  return wanted ? std::strtoull(wanted, nullptr, 10) : otherwise;
}

class RandomScenes : public ::testing::Test {
 protected:
  fs::path folder() const {
    const char* const kept = std::getenv("BRUME_SCENES_KEEP");
    return kept ? fs::path(kept) : folder_.path();
  }
  /// Calls test(scene) for each seed; the scene is printed where it fails.
  template <class Test>
  void for_each_seed(const Test& test) {
    const uint64_t first = number("BRUME_SCENES_FROM", 1), count = number("BRUME_SCENES", 16);
    for (uint64_t seed = first; seed < first + count; ++seed) {
      const test::RandomScene random = test::random_scene(seed, folder());
      SCOPED_TRACE("seed " + std::to_string(seed) + ": " + random.text() + "\n" + random.toml);
      test(random);
    }
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

/// Relative error of a prediction over the blocks that a medium fills: root of the mean square of its difference from
/// the traced light, without what the traced light's noise makes of it, over that of the traced light; and how far the
/// noise alone would reach.
struct Difference {
  double error = 0, noise = 0, ratio = 0;
  int blocks = 0;
};

Difference difference(const Layers& frame, const LayerName& traced, const std::string& predicted) {
  double squares = 0, variance = 0, light = 0, sum = 0, sum_traced = 0;
  Difference result;
  const Plane& opacity = frame.at(frame.find("guide.opacity.Y") ? "guide.opacity.Y" : "guide.opacity.G");
  for (int by = 0; by + kBlock <= frame.height(); by += kBlock)
    for (int bx = 0; bx + kBlock <= frame.width(); bx += kBlock) {
      if (block_sum(opacity, bx, by) < 0.2 * kBlock * kBlock) continue;
      ++result.blocks;
      for (size_t c = 0; c < 3; ++c) {
        const double t = block_sum(frame.at(traced.channel(c)), bx, by),
                     p = block_sum(frame.at(predicted + "." + "RGB"[c]), bx, by);
        squares += (p - t) * (p - t);
        variance += block_sum(frame.at(traced.channel_of(statistic::mean_variance, c)), bx, by);
        light += t * t;
        sum += p;
        sum_traced += t;
      }
    }
  if (light > 0) {
    result.error = std::sqrt(std::max(0.0, squares - variance) / light);
    result.noise = std::sqrt(variance / light);
    result.ratio = sum / sum_traced;
  }
  return result;
}

/// Sum of the squared differences of two pictures, tone mapped, and what of it is the noise of the second.
struct Distance {
  double squares = 0, noise = 0;
};

Distance distance(const RgbPlanes& picture, const Layers& reference) {
  const RgbPlanes truth = reference.rgb(layer::beauty),
                  variance = reference.rgb(layer::beauty, statistic::mean_variance);
  // Relative to the pixel where it is brighter than 1: a light that is seen is not to decide alone.
  Distance sum;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < reference.height(); ++y)
      for (int x = 0; x < reference.width(); ++x) {
        const double t = (*truth[c])(x, y), unit = 1 / std::max(1.0, t), d = ((*picture[c])(x, y) - t) * unit;
        sum.squares += d * d;
        sum.noise += (*variance[c])(x, y) * unit * unit;
      }
  return sum;
}

TEST_F(RandomScenes, GuidesPredictTheTracedLight) {
  for_each_seed([](const test::RandomScene& random) {
    double seconds[3] = {cpu_seconds()};
    const PreparedScene scene(random.scene, LayerRequest::of({"direct", "indirect", "guides"}, true));
    scene.guides(128);
    seconds[1] = cpu_seconds();
    const Layers frame = scene.render(128, 1, {}).layers;
    seconds[2] = cpu_seconds();
    for (const auto& [name, plane] : frame.channels()) EXPECT_EQ(count_not_finite(plane), 0u) << name;
    const Difference direct = difference(frame, layer::direct, "guide.predicted_direct"),
                     indirect = difference(frame, layer::indirect, "guide.predicted_indirect");
    Cleaner cleaner(
        "transport_regression", 1, [](const std::string&) { return Task(); }, [](const std::string&) {});
    const PreparedScene to_clean(random.scene, cleaner.request(LayerRequest::of({"direct", "indirect"}, true), 4));
    const Layers noisy = to_clean.render(4, 2, {}).layers, clean = cleaner.clean(noisy);
    const Distance before = distance(noisy.rgb(layer::beauty), frame),
                   after = distance(clean.rgb(layer::beauty), frame);
    const double gain =
        std::sqrt(std::max(0.0, after.squares - after.noise) / std::max(1e-9, before.squares - before.noise));
    std::printf(
        "%4llu t %5.1f g %5.1f clean %5.3f (%5.3f) %3d direct %5.3f (%5.3f) x%5.3f indirect %5.3f (%5.3f) x%5.3f  %s\n",
        static_cast<unsigned long long>(random.seed), seconds[2] - seconds[1], seconds[1] - seconds[0], gain,
        std::sqrt(after.noise / before.squares), direct.blocks, direct.error, direct.noise, direct.ratio,
        indirect.error, indirect.noise, indirect.ratio, random.text().c_str());
    std::fflush(stdout);
  });
}

}  // namespace
}  // namespace brume
