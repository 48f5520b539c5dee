#include "tests/support/reference_mixing.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace brume::test {

using Eigen::MatrixXd;

ReferenceMixing::ReferenceMixing(int width, Halves data, Values weight, std::vector<ReferenceRegion> regions)
    : x_(weight.size()),
      y_(weight.size()),
      data_(std::move(data)),
      weight_(std::move(weight)),
      regions_(std::move(regions)) {
  for (int i = 0; i < weight_.size(); ++i) x_[i] = i % width, y_[i] = i / width;
}

/// G(q - p) of every two pixels, cut off at 3 deviations, its sum over the picture 1.
MatrixXd ReferenceMixing::window(double s) const {
  MatrixXd g(x_.size(), x_.size());
  for (int p = 0; p < g.rows(); ++p) {
    const Values u = x_ - x_[p], v = y_ - y_[p];
    g.row(p) =
        (u.abs().max(v.abs()) <= std::ceil(3 * s)).cast<double>() * (-(u.square() + v.square()) / (2 * s * s)).exp();
    g.row(p) /= g.row(p).sum();
  }
  return g;
}

ReferenceMixing::Candidate ReferenceMixing::local_mean(double s) const {
  return [this, g = window(s)](const Halves& result) {
    Halves sum = result;
    for (size_t half = 0; half < 2; ++half)
      for (size_t c = 0; c < 3; ++c) sum[half][c] += (g * (data_[half][c] - result[half][c]).matrix()).array();
    return sum;
  };
}

/// What a share s of a step changes at each pixel: the squared error falls by 2 s gain - s^2 loss.
struct ReferenceMixing::Gain {
  Values gain, loss;
};

ReferenceMixing::Gain ReferenceMixing::gain_of_step(const Halves& from, const Halves& to) const {
  Gain sum{Values::Zero(x_.size()), Values::Zero(x_.size())};
  for (size_t c = 0; c < 3; ++c) {
    const Values &ta = from[0][c], &tb = from[1][c], da = to[0][c] - ta, db = to[1][c] - tb;
    sum.gain += weight_ / 3 * (((data_[1][c] - ta) * da + (data_[0][c] - tb) * db) / 2 + (tb - ta) * (db - da) / 4);
    sum.loss += weight_ / 3 * ((da + db) / 2).square();
  }
  // No single pixel decides: the largest thousandth is cut.
  std::vector<double> sizes;
  for (const double g : sum.gain)
    if (g != 0) sizes.push_back(std::abs(g));
  if (sizes.empty()) return sum;
  const auto rank = sizes.begin() + static_cast<std::ptrdiff_t>(0.999 * static_cast<double>(sizes.size() - 1));
  std::nth_element(sizes.begin(), rank, sizes.end());
  sum.gain = sum.gain.max(-*rank).min(*rank);
  return sum;
}

/// Each pixel takes the candidate, window and share of the largest sure gain, region by region; leaves the candidates
/// that any pixel took. @param gained  of the squared error, in all
Halves ReferenceMixing::round(const Halves& result, std::vector<Candidate>& candidates, double& gained) const {
  struct Best {
    Values gain, share, candidate;
  };
  const Values zero = Values::Zero(x_.size());
  std::vector<Best> best(regions_.size(), {zero, zero, zero - 1});
  std::vector<Halves> steps;
  for (const Candidate& candidate : candidates) steps.push_back(candidate(result));
  for (const double s : {3, 6, 12, 28}) {
    const MatrixXd g = window(s);
    for (size_t m = 0; m < steps.size(); ++m) {
      const Gain step = gain_of_step(result, steps[m]);
      for (size_t r = 0; r < regions_.size(); ++r) {
        const Values& in_region = regions_[r].share;
        const Values n = (g * in_region.matrix()).array(), pixels = 4 * std::numbers::pi * s * s * n;
        const auto mean = [&](const Values& v) -> Values { return (g * (in_region * v).matrix()).array() / n; };
        const Values b = mean(step.gain), variance = (mean(step.gain.square()) - b.square()).max(0.0),
                     largest = (mean(step.gain.pow(4)) * pixels).pow(0.25),
                     low = b - regions_[r].sure * (variance / pixels).sqrt() - 1.5 * largest / pixels,
                     a = mean(step.loss).max(1e-30), share = (low / a).min(1.0), gain = share * (2 * low - share * a);
        const auto better = (n > 1e-6 && in_region > 0 && low > 0 && gain > best[r].gain).eval();
        best[r].share = better.select(share, best[r].share);
        best[r].candidate = better.select(static_cast<double>(m), best[r].candidate);
        best[r].gain = better.select(gain, best[r].gain);
      }
    }
  }
  gained = 0;
  Halves moved = result;
  std::vector<Candidate> taken;
  const MatrixXd smooth = window(1.5);
  for (size_t m = 0; m < steps.size(); ++m) {
    bool any = false;
    for (size_t r = 0; r < regions_.size(); ++r) {
      const Values &in_region = regions_[r].share, mine = (best[r].candidate == static_cast<double>(m)).cast<double>();
      any |= mine.sum() > 0;
      gained += (mine * in_region * best[r].gain).sum();
      const Values around = (smooth * in_region.matrix()).array(),
                   share = (smooth * (mine * in_region * best[r].share).matrix()).array();
      const Values s = (around > 0 && weight_ > 0).select(in_region * share / around, 0.0);
      for (size_t half = 0; half < 2; ++half)
        for (size_t c = 0; c < 3; ++c) moved[half][c] += s * (steps[m][half][c] - result[half][c]);
    }
    if (any) taken.push_back(candidates[m]);
  }
  candidates = taken;
  return moved;
}

Halves ReferenceMixing::mixed(Halves result, std::vector<Candidate> candidates, const Halves& late) const {
  const auto noise = [&] {
    double sum = 0;
    for (size_t c = 0; c < 3; ++c) sum += (weight_ * (result[0][c] - result[1][c]).square() / 12).sum();
    return sum;
  };
  const double usual = noise();
  // Whether it gained more than a twentieth of the noise.
  const auto next_round = [&](std::vector<Candidate>& from) {
    if (from.empty()) return false;
    const double before = std::max(noise(), usual);
    double gained = 0;
    result = round(result, from, gained);
    return gained > 0.05 * before;
  };
  if (!next_round(candidates)) return result;
  candidates.push_back([&](const Halves&) { return late; });
  for (int i = 0; i < 3 && next_round(candidates); ++i) {
  }
  return result;
}

}  // namespace brume::test
