#include "evaluate/metrics/statistics.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "filters/patch/student.h"

namespace brume {

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const size_t n = values.size();
  return n % 2 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

MeanInterval mean_interval(const std::vector<double>& values) {
  MeanInterval result{0, 0, values.size()};
  if (values.empty()) return result;
  const double n = static_cast<double>(values.size());
  for (const double v : values) result.mean += v / n;
  double squares = 0;
  for (const double v : values) squares += (v - result.mean) * (v - result.mean);
  if (values.size() > 1) result.half_width = student_quantile(0.95, n - 1) * std::sqrt(squares / (n - 1) / n);
  return result;
}

PairedDifference paired_difference(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() != b.size()) throw std::logic_error("paired differences of unequal numbers of seeds");
  std::vector<double> differences(a.size());
  std::transform(a.begin(), a.end(), b.begin(), differences.begin(), std::minus<>());
  PairedDifference result{mean_interval(differences)};
  if (a.size() < 2) return result;
  const double degrees = static_cast<double>(a.size() - 1);
  const double standard_error = result.difference.half_width / student_quantile(0.95, degrees);
  if (standard_error > 0)
    result.p_value = student_two_sided(result.difference.mean / standard_error, degrees);
  else
    result.p_value = result.difference.mean == 0 ? 1 : 0;
  return result;
}

std::vector<bool> holm_significant(const std::vector<double>& p_values, double level) {
  std::vector<size_t> order(p_values.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return p_values[a] < p_values[b]; });
  std::vector<bool> significant(p_values.size(), false);
  for (size_t i = 0; i < order.size(); ++i) {
    if (p_values[order[i]] > level / static_cast<double>(order.size() - i)) break;
    significant[order[i]] = true;
  }
  return significant;
}

}  // namespace brume
