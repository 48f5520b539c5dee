#pragma once
#include <vector>

namespace brume {

/// How the error of a clean picture falls with its samples, from the rounds so far: error^2 ~ samples^-decay.
class ErrorCurve {
 public:
  /// Of a tile's squared error, until rounds tell: a little less than the 1 of a picture without a filter.
  static constexpr double kUsualDecay = 0.8;

  void add(double samples, double error);
  /// The line through logarithms of all rounds, held to kUsualDecay as much as by two rounds, one of them with twice
  /// the samples of the other; between 0.15 and 0.9.
  double decay() const;
  /// Samples until the error is `target`, from the last round on: a tenth more than the curve says, as half of all
  /// rounds would otherwise end just above it.
  double samples_needed(double target) const;

 private:
  struct Point {
    double log_samples, log_square;
  };
  std::vector<Point> points_;
};

/// Rounds until a target is reached: all of them multiply the samples by the same factor, `most` at the most.
struct RoundsLeft {
  int rounds;
  double growth;
};
/// @param growth  of the number of samples until the target is reached
RoundsLeft rounds_left(double growth, double least, double most);

}  // namespace brume
