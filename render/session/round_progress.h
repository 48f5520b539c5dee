#pragma once

namespace brume {

/// How far a render in rounds has come: the seconds it took over those and the seconds that are left.
///
/// What is left are the samples until the target is reached, at the pace of the last rounds, and for each round that
/// may still come the work between two rounds (the filter that estimates the error). Where a round shows that more
/// samples are needed than was thought, the fraction falls: a bar that stood still would promise too much.
/// It reads no clock: tests/render/rounds_test.cpp feeds it seconds.
class RoundProgress {
 public:
  /// A round took this many samples, in so many seconds.
  void add_sampling(double samples, double seconds);
  /// After it the error was estimated, in so many seconds.
  void add_estimate(double seconds) { estimate_seconds_ = seconds; }
  /// @param samples_needed  of all pixels together, those taken included; 0: unknown
  /// @param rounds          that it takes to get there
  void expect(double samples_needed, int rounds) { needed_ = samples_needed, rounds_ = rounds; }

  /// @param samples        taken so far, of all pixels together
  /// @param round_samples  those of them that are this round's, and
  /// @param round_seconds  the time they took; 0: between rounds
  /// @return  below 0 where nothing is known
  double seconds_left(double samples, double round_samples, double round_seconds) const;

 private:
  double samples_ = 0, sampling_seconds_ = 0;  // the last rounds, older ones counting less
  double estimate_seconds_ = 0, needed_ = 0;
  int rounds_ = 0;
};

}  // namespace brume
