#include "filters/per_sample/mutual_information.h"

#include <algorithm>
#include <cmath>

#include "filters/kernels/joint_counts.h"

namespace brume {
namespace {

/// n log n for n up to the longest column.
const std::vector<double>& logarithms() {
  static const std::vector<double> table = [] {
    std::vector<double> t = {0.0};
    for (int i = 1; i <= MutualInformation::kMostSamples; ++i) t.push_back(i * std::log(i));
    return t;
  }();
  return table;
}

}  // namespace

MutualInformation::MutualInformation(size_t samples)
    : samples_(samples), words_((samples + 63) / 64), logs_(logarithms().data()) {}

size_t MutualInformation::add(std::span<const float> column) {
  const size_t number = columns();
  masks_.resize(masks_.size() + kBins * words_);
  counts_.resize(counts_.size() + kBins);
  kernels::bin_bits(column.data(), samples_, kBins, words_, masks_.data() + number * kBins * words_,
                    counts_.data() + number * kBins);
  int used = 0;
  for (size_t b = 0; b < kBins; ++b) used += counts_[number * kBins + b] > 0;
  bins_used_.push_back(used);
  return number;
}

double MutualInformation::operator()(size_t a, size_t b, bool corrected) const {
  if (bins_used_[a] < 2 || bins_used_[b] < 2) return 0;
  int joint[kBins * kBins];
  kernels::joint_counts(mask(a, 0), mask(b, 0), counts_.data() + a * kBins, counts_.data() + b * kBins, kBins, words_,
                        joint);
  // With counts n: (sum n_xy log n_xy - sum n_x log n_x - sum n_y log n_y + N log N) / N.
  const double n = static_cast<double>(samples_);
  double sum = logs_[samples_];
  for (size_t i = 0; i < kBins; ++i)
    sum -= logs_[static_cast<size_t>(counts_[a * kBins + i])] + logs_[static_cast<size_t>(counts_[b * kBins + i])];
  for (const int count : joint) sum += logs_[static_cast<size_t>(count)];
  double information = sum / n;
  if (corrected) information -= (bins_used_[a] - 1) * (bins_used_[b] - 1) / (2 * n);
  return std::max(information, 0.0);
}

}  // namespace brume
