#include "workflows/view/march_pace.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

constexpr double kAtOnce = 0.2;         // s: whole pictures that take longer are shown coarse before
constexpr double kFewestPixels = 6000;  // of a coarse picture, where they are marched within kAtOnce
constexpr double kLeastPixels = 1500;   // where not
constexpr double kFirstPace = 1e5;      // pixels a second of a coarse picture, until one has been measured
constexpr double kSlower = 10;          // a pixel of the whole picture over one of a coarse one, likewise
constexpr double kStepsFrom = 1;        // s: whole pictures that take longer come in steps
constexpr double kStepShare = 0.3;      // of the time that the whole picture takes, at most for a step

double pixels_of(const ivec2& size) {
  return 1.0 * size.x * size.y;
}

}  // namespace

void MarchPace::measure_coarse(const ivec2& size, double seconds) {
  coarse_ = pixels_of(size) / std::max(1e-3, seconds);
}

bool MarchPace::is_slow(const ivec2& whole) const {
  return whole_ <= 0 || pixels_of(whole) > kAtOnce * whole_;
}

double MarchPace::coarse_pace() const {
  return coarse_ > 0 ? coarse_ : kFirstPace;
}

ivec2 MarchPace::size_within(double seconds, const ivec2& whole) const {
  const double pace = coarse_pace();
  const double wanted = std::max({seconds * pace, std::min(kFewestPixels, kAtOnce * pace), kLeastPixels});
  const double share = std::sqrt(std::min(1.0, wanted / pixels_of(whole)));
  return glm::max(ivec2(glm::round(dvec2(whole) * share)), ivec2(1));
}

bool MarchPace::is_worth(const ivec2& coarse, const ivec2& whole) const {
  const double pace = coarse_pace();
  const double seconds = pixels_of(whole) / (whole_ > 0 ? whole_ : pace / kSlower);
  return seconds >= kStepsFrom && pixels_of(coarse) <= kStepShare * seconds * pace;
}

}  // namespace brume
