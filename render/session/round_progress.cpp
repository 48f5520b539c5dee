#include "render/session/round_progress.h"

#include <algorithm>

namespace brume {

void RoundProgress::add_sampling(double samples, double seconds) {
  constexpr double kMemory = 0.5;  // samples move to tiles that are slower or faster than the mean
  samples_ = kMemory * samples_ + samples;
  sampling_seconds_ = kMemory * sampling_seconds_ + seconds;
}

double RoundProgress::seconds_left(double samples, double round_samples, double round_seconds) const {
  const double paced = samples_ + round_samples;
  if (!(needed_ > 0) || !(paced > 0)) return -1;
  const double per_sample = (sampling_seconds_ + round_seconds) / paced;
  return std::max(0.0, needed_ - samples) * per_sample + rounds_ * estimate_seconds_;
}

}  // namespace brume
