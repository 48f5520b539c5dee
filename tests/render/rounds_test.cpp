// Renders in rounds towards a target error, without a renderer or a clock: how many samples they take, and whether what
// they say of the time left holds.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/rng.h"
#include "render/session/round_progress.h"
#include "workflows/error_curve.h"

namespace brume {
namespace {

/// A filter whose squared error is samples^-decay, seen with some uncertainty.
struct Picture {
  double decay, uncertainty;
  double pace = 1e-3, filter = 2;  // seconds of a sample, and of an estimate
  double error(double samples) const { return std::pow(samples, -0.5 * decay); }
  double samples_for(double target) const { return std::pow(target, -2 / decay); }
};

struct Said {
  int round;
  double fraction, left, when;  // left: by the session; when: it was said
};

struct Rounds {
  std::vector<Said> said;
  double samples = 0, seconds = 0;
  int rounds = 0;
};

/// What render_session.cpp and Cleaner do, in few lines.
Rounds simulate(const Picture& picture, double first, double target, uint64_t seed) {
  Rounds run;
  ErrorCurve curve;
  RoundProgress progress;
  Rng rng(seed);
  for (double goal = first;; ++run.rounds) {
    const double before = run.samples, fresh = goal - before;
    for (int i = 0; i < 10; ++i) {
      const double left = progress.seconds_left(run.samples, i * fresh / 10, i * fresh / 10 * picture.pace);
      if (left > 0) run.said.push_back({run.rounds, run.seconds / (run.seconds + left), left, run.seconds});
      run.samples += fresh / 10, run.seconds += fresh / 10 * picture.pace;
    }
    progress.add_sampling(fresh, fresh * picture.pace);
    const double seen = picture.error(run.samples) * (1 + picture.uncertainty * (2 * rng.uniform() - 1));
    run.seconds += picture.filter;
    progress.add_estimate(picture.filter);
    if (seen <= target) return run;
    curve.add(run.samples, seen);
    const double needed = curve.samples_needed(target);
    const RoundsLeft left = rounds_left(needed / run.samples, 1.1, 2);
    progress.expect(needed, left.rounds);
    goal = run.samples * left.growth;
  }
}

TEST(RendersInRounds, SayHowMuchTimeIsLeftWithinAFactorOfTwo) {
  int all = 0, within = 0;
  for (const double decay : {0.5, 0.6, 0.7, 0.8, 0.9, 1.0})
    for (uint64_t seed = 1; seed <= 20; ++seed) {
      const Picture picture{decay, 0.03};
      const Rounds run = simulate(picture, 1e3, picture.error(3e4), seed);
      for (const Said& s : run.said) {
        const double actual = run.seconds - s.when;
        EXPECT_FALSE(s.fraction > 0.9 && actual > 0.35 * run.seconds) << "decay " << decay << ", round " << s.round;
        if (s.round >= 2) ++all, within += s.left < 2 * actual && actual < 2 * s.left;
      }
    }
  EXPECT_GT(within, 0.9 * all) << "of " << all;
}

TEST(RendersInRounds, EndSoonAfterTheTargetIsReached) {
  for (const double decay : {0.5, 0.6, 0.7, 0.8, 0.9, 1.0})
    for (uint64_t seed = 1; seed <= 20; ++seed) {
      const Picture picture{decay, 0.01};
      const Rounds run = simulate(picture, 1e3, picture.error(3e4), seed);
      EXPECT_GT(run.samples, 0.9 * 3e4) << decay;
      EXPECT_LT(run.samples, 1.4 * 3e4) << decay;
      EXPECT_LE(run.rounds, 8) << decay;
    }
}

TEST(ErrorCurve, LearnsHowFastErrorsFall) {
  ErrorCurve curve;
  EXPECT_EQ(curve.decay(), ErrorCurve::kUsualDecay);
  EXPECT_EQ(curve.samples_needed(0.1), 0) << "nothing is known";
  for (const double samples : {100, 200, 400, 800, 1600}) curve.add(samples, std::pow(samples, -0.25));
  EXPECT_NEAR(curve.decay(), 0.5, 0.05);
  // A quarter of the error for 2^(2 / 0.5) = 16 times the samples, and the margin.
  EXPECT_NEAR(curve.samples_needed(0.5 * std::pow(1600, -0.25)) / (16 * 1600), 1.1, 0.2);
}

TEST(ErrorCurve, ExpectsEverMoreSamplesWhereErrorsStandStill) {
  ErrorCurve curve;
  double last = 0;
  for (const double samples : {100, 200, 400, 800, 1600}) {
    curve.add(samples, 0.08);
    EXPECT_GT(curve.samples_needed(0.04), 1.9 * last);
    last = curve.samples_needed(0.04);
  }
  EXPECT_GT(last, 100 * 1600);
  EXPECT_TRUE(std::isfinite(last));
}

TEST(RoundsLeft, AreOfEqualGrowth) {
  EXPECT_EQ(rounds_left(8, 1.1, 2).rounds, 3);
  EXPECT_NEAR(rounds_left(8, 1.1, 2).growth, 2, 1e-9);
  EXPECT_EQ(rounds_left(2.25, 1.1, 2).rounds, 2);
  EXPECT_NEAR(rounds_left(2.25, 1.1, 2).growth, 1.5, 1e-9);
  EXPECT_EQ(rounds_left(1.01, 1.1, 2).rounds, 1);
  EXPECT_NEAR(rounds_left(1.01, 1.1, 2).growth, 1.1, 1e-9);
}

TEST(RoundProgress, CountsSamplesAndEstimates) {
  RoundProgress progress;
  EXPECT_LT(progress.seconds_left(0, 0, 0), 0) << "nothing is known";
  progress.add_sampling(100, 10);
  progress.add_estimate(3);
  EXPECT_LT(progress.seconds_left(100, 0, 0), 0);
  progress.expect(400, 2);
  EXPECT_NEAR(progress.seconds_left(100, 0, 0), 30 + 2 * 3, 1e-9);
  EXPECT_NEAR(progress.seconds_left(200, 100, 30), 200 * 0.2 + 2 * 3, 1e-9) << "slower than before";
  EXPECT_NEAR(progress.seconds_left(500, 400, 40), 2 * 3, 1e-9) << "the filter still runs";
  progress.expect(1600, 4);
  EXPECT_NEAR(progress.seconds_left(400, 0, 0), 120 + 4 * 3, 1e-9) << "a round missed the target";
}

}  // namespace
}  // namespace brume
