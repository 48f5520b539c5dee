#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace brume {

/// Mutual information of pairs of columns, in nats, from histograms of up to kBins bins. A column is binned once; every
/// joint count is then a population count of two bit sets.
class MutualInformation {
 public:
  static constexpr int kBins = 7, kMostSamples = 4096;

  /// @param samples  of each column, at most kMostSamples
  explicit MutualInformation(size_t samples);

  /// Bins a column of mean 0 and deviation 1 by rounding, what lies beyond 3 in the last bins. A constant column
  /// carries no information. @return its number
  size_t add(std::span<const float> column);
  size_t columns() const { return bins_used_.size(); }

  /// sum p(x, y) log(p(x, y) / (p(x) p(y))) over the bins that hold anything.
  /// @param corrected  less what independent columns of this length have on average, (Bx - 1)(By - 1) / (2 N); at least
  /// 0
  double operator()(size_t a, size_t b, bool corrected) const;

 private:
  const uint64_t* mask(size_t column, int bin) const {
    return masks_.data() + (column * kBins + static_cast<size_t>(bin)) * words_;
  }

  size_t samples_, words_;
  const double* logs_;  // n log n
  std::vector<uint64_t> masks_;
  std::vector<int> counts_;     // of each column and bin
  std::vector<int> bins_used_;  // of each column
};

}  // namespace brume
