#include "render/transport/camera_splits.h"

#include <cstddef>

namespace brume {
namespace {

constexpr size_t kValues = offsetof(PathSample, groups) / sizeof(double);

}  // namespace

void CameraSplits::start(size_t slot, int count) {
  sums_[slot] = {count, 0, dvec3(0), dvec3(0), vec3(0), vec3(0)};
  if (!samples_.empty()) samples_[slot] = {};
}

bool CameraSplits::end(size_t slot, const End& end, const vec3& indirect, PathSample* sample) {
  Sums& s = sums_[slot];
  s.background += end.background;
  s.hole += end.hole;
  if (end.first_on_surface) s.surface_indirect += indirect - s.indirect;
  s.indirect = indirect;
  if (sample) {
    for (size_t k = 0; k < kValues; ++k) samples_[slot].values()[k] += sample->values()[k];
    // What the camera ray has recorded is every path's.
    PathSample next;
    next.optical_depth = sample->optical_depth;
    next.gradient_transmittance_weighted = sample->gradient_transmittance_weighted;
    *sample = next;
  }
  return ++s.ended < s.count;
}

PathSample CameraSplits::sample(size_t slot) const {
  if (samples_.empty()) return {};
  PathSample mean = samples_[slot];
  mean.groups = nullptr;
  for (size_t k = 0; k < kValues; ++k) mean.values()[k] *= share(slot);
  return mean;
}

}  // namespace brume
