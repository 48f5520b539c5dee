#pragma once
#include <cstddef>
#include <vector>

namespace brume {

double median(std::vector<double> values);

/// Mean and half width of the two-sided 95 % confidence interval of the mean, by Student's t.
struct MeanInterval {
  double mean = 0, half_width = 0;
  size_t count = 0;
};
MeanInterval mean_interval(const std::vector<double>& values);

/// Two methods on the same frames: the differences a - b of each seed.
struct PairedDifference {
  MeanInterval difference;
  /// Of differences this far from zero where there is none in truth, two-sided paired t-test; 1 for a single seed.
  double p_value = 1;
};
/// @throws std::logic_error for different numbers of seeds
PairedDifference paired_difference(const std::vector<double>& a, const std::vector<double>& b);

/// Which of several p-values are significant together: the chance that any of them is so by accident is at most
/// `level`. Source: Holm 1979, A Simple Sequentially Rejective Multiple Test Procedure.
std::vector<bool> holm_significant(const std::vector<double>& p_values, double level = 0.05);

}  // namespace brume
