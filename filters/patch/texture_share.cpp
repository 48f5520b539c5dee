#include "filters/patch/texture_share.h"

#include <algorithm>
#include <cmath>

#include "filters/inputs/half_pair.h"
#include "filters/patch/second_differences.h"

namespace brume {
namespace {

// Half width of the squares over which densities are measured [px].
constexpr int kRadius = 16;
// How far an octave's density must be above that of the finest before it counts at all, and counts in full: white noise
// scatters by .1. Less does, where the octave beyond has more by a quarter still.
constexpr float kDoubt = 1.2f, kDoubtOfBoth = 1.05f, kSure = 0.3f, kBeyond = 1.25f;
// Times what a power law says that texture has in the finest octave.
constexpr float kMargin = 2.5f;
// Fixed points of the noise are looked for from below.
constexpr int kRounds = 6;

/// What texture has in the finest octave, as a share of the next one's, by the growth g from that to the third. For
/// densities of f^-a in frequency f, a in .5 to 4, as the masks of picture_noise.cpp and least_product weigh them:
/// g = 1.4, 2.1, 4.3, 9, 19 and shares of .64, .40, .14, .044, .011.
float finest_share(float growth) {
  const float g = std::log(std::clamp(growth, 1.0f, 1000.0f)), smooth = std::max(0.0f, g - 2.2f);
  return std::exp(-1.2f * g - 0.105f * g * g - 2.5f * smooth * smooth);
}

/// The least noise that agrees with the densities of three octaves.
float least_noise(float finest, float second, float third) {
  float noise = 0;
  for (int round = 0; round < kRounds; ++round) {
    const float share = std::min(0.99f, kMargin * finest_share((third - noise) / (second - noise)));
    noise = std::clamp((finest - share * second) / (1 - share), 0.0f, finest);
  }
  return noise;
}

}  // namespace

Plane share_of_noise(const Rgb& variance, const RgbPlanes& picture, const Task& task) {
  Plane finest, second, third;
  const auto add = [&](Plane& sum, Plane plane) {
    if (sum.empty())
      sum = std::move(plane);
    else
      add_to(sum, 1, plane, task);
  };
  for (size_t c = 0; c < 3; ++c) {
    const Plane once = halved_detail(*picture[c], 1, task);
    // Single bright samples are in the finest octave more than in the others, which does not make the rest texture.
    const Plane peaks = least_product(*picture[c], 1, kWhiteAt1, kRadius, task, kVeryFarAbove);
    const Plane level = box_mean(variance[c], kRadius, task);
    add(finest, make_plane(level.width(), level.height(), quiet(task),
                           [&](int x, int y) { return std::max(level(x, y), peaks(x, y)); }));
    add(second, least_product(once, 2, kWhiteAt2, kRadius, task));
    add(third, least_product(halved_detail(once, 2, task), 4, kWhiteAt4, kRadius, task));
  }
  return make_plane(finest.width(), finest.height(), quiet(task), [&](int x, int y) {
    const float d1 = finest(x, y), d2 = second(x, y), d3 = third(x, y);
    if (!(d1 > 0 && d2 > d1)) return 1.0f;
    const float above = std::max(d2 / d1 - kDoubt, std::min(d2, d3 / kBeyond) / d1 - kDoubtOfBoth);
    return 1 - std::clamp(above / kSure, 0.0f, 1.0f) * (1 - least_noise(d1, d2, d3) / d1);
  });
}

}  // namespace brume
