// transport_regression against its definition, stage by stage, on frames of every kind of scene.

#include "tests/support/reference_regression.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "filters/inputs/filter_frame.h"
#include "filters/regression/transport/cascade.h"
#include "filters/regression/transport/outliers.h"
#include "filters/regression/transport/stacking.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/halves.h"

namespace brume {
namespace {

using test::Halves, test::apart, test::halves_of;

/// What the filter makes of a signal before it is mixed.
struct Filtered {
  Halves data, stacked;
  std::vector<Halves> candidates;

  Filtered(const Layers& frame, const LayerName& signal) {
    FilterFrame given{signal, frame.rgb(signal), frame.rgb(signal), frame};
    given.half_a = frame.rgb(signal, statistic::half_a);
    given.half_b = frame.rgb(signal, statistic::half_b);
    given.samples = *frame.number("samplesPerPixel");
    const Plane one(frame.width(), frame.height(), 1.0f);
    const float power = signal == layer::direct ? 0.0f : 1.2f;
    RegressionInputs inputs = inputs_of(2, given, one, {});
    ClampedHalves drawn_in = draw_outliers_in(inputs, power, 8, signal == layer::indirect, {});
    const HalfPair halves{std::move(drawn_in.a), std::move(drawn_in.b)};
    std::optional<HalfPair> over_frames;
    const std::vector<StoredPair> fits = cascade(inputs, {16, 2e-3, 1, power}, over_frames, {});
    inputs[0].weigh_by(inputs[0].level, 1.2f, {});
    const std::vector<Plane> weights = stacking_weights(fits, halves, inputs[0].weight, {28, 5000, 0.5}, {});
    data = halves_of(halves);
    stacked = halves_of(blend(fits, halves, weights, {}));
    for (const StoredPair& fit : fits) {
      HalfPair room = halves;
      fit.read({0, 0, frame.width(), frame.height()}, room, {});
      candidates.push_back(halves_of(room));
    }
    candidates.push_back(data);
  }
};

class EveryScene : public testing::TestWithParam<const char*> {};

// Relative to the noise that is taken away. In one window, the frame, the filter rounds sums in float and stores fits
// in 16 bits; in others its windows are sums over blocks, too, and its coefficients lie between nodes.
TEST_P(EveryScene, IsFittedAsDefined) {
  constexpr double kOutliers = 0.004, kFrame = 0.001, kWindows = 0.06, kStacked = 0.06;
  constexpr size_t kWholeFrame[] = {0, 1, 4, 5};  // the prediction, and fits to the frame
  Scene scene = read_scene(test::source(GetParam()));
  scene.film.width = 32;
  scene.film.height = 24;
  const Layers frame =
      PreparedScene(scene, LayerRequest::of({"direct", "indirect", "guides"}, true)).render(8, 3).layers;
  for (const LayerName& signal : {layer::direct, layer::indirect}) {
    SCOPED_TRACE(signal.name);
    const test::ReferenceRegression defined = test::reference_regression(frame, signal);
    const Filtered filtered(frame, signal);
    const double noise = apart(defined.stacked, defined.data, defined.mask);
    EXPECT_LT(apart(filtered.data, defined.data, defined.mask), kOutliers * noise);
    ASSERT_EQ(filtered.candidates.size(), defined.candidates.size());
    for (size_t i = 0; i + 1 < defined.candidates.size(); ++i) {
      const bool whole = std::find(std::begin(kWholeFrame), std::end(kWholeFrame), i) != std::end(kWholeFrame);
      EXPECT_LT(apart(filtered.candidates[i], defined.candidates[i], defined.mask), (whole ? kFrame : kWindows) * noise)
          << "candidate " << i;
    }
    EXPECT_LT(apart(filtered.stacked, defined.stacked, defined.mask), kStacked * noise);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Scenes, EveryScene,
    testing::Values("data/scenes/cloud.toml", "data/scenes/fire.toml", "bench/scenes/coloured_smoke.toml",
                    "bench/scenes/solid_smoke.toml", "bench/scenes/general/behind_glass.toml",
                    "bench/scenes/general/cloud_in_haze.toml", "bench/scenes/general/coloured_cloud.toml",
                    "bench/scenes/general/fire_room.toml", "bench/scenes/general/floor_and_balls.toml",
                    "bench/scenes/general/inside_cloud.toml", "bench/scenes/general/lens.toml"));

}  // namespace
}  // namespace brume
