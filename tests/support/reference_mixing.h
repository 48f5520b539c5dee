#pragma once
#include <functional>
#include <vector>

#include "tests/support/reference_regression.h"

namespace brume::test {

/// A share of each pixel, and how many standard errors a gain must exceed there.
struct ReferenceRegion {
  Values share;
  double sure;
};

/// The definition of how a result is moved to candidates (docs/transport_regression.md, Mixing): in double precision,
/// every window summed pixel by pixel, and nothing shared with the filter. For frames of one tile, 64 x 64 pixels.
class ReferenceMixing {
 public:
  using Candidate = std::function<Halves(const Halves& result)>;

  /// @param weight  of squared errors at each pixel
  ReferenceMixing(int width, Halves data, Values weight, std::vector<ReferenceRegion> regions);
  /// What a result misses of the data, averaged over a Gaussian window, added to it.
  Candidate local_mean(double s) const;
  /// @param late  a candidate once those that were taken have been tried again
  Halves mixed(Halves result, std::vector<Candidate> candidates, const Halves& late) const;

 private:
  struct Gain;

  Eigen::MatrixXd window(double s) const;
  Gain gain_of_step(const Halves& from, const Halves& to) const;
  Halves round(const Halves& result, std::vector<Candidate>& candidates, double& gained) const;

  Values x_, y_;
  Halves data_;
  Values weight_;
  std::vector<ReferenceRegion> regions_;
};

}  // namespace brume::test
