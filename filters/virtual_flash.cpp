#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "filters/neighbourhood.h"
#include "filters/registry.h"
#include "filters/student.h"

namespace brume {
namespace {

enum class Second { kRecentred, kStrict };
enum class RangeKernel { kNoise, kLiteral };
enum class Guide { kFlash, kDirect, kSignal };
enum class Agreement { kOne, kEither, kBoth };

struct VirtualFlash {
  int small_radius = 3, large_radius = 15, patch_radius = 2;
  float small_confidence = 0.998f, large_confidence = 0.99f, strength = 0.7f;
  Second second = Second::kRecentred;
  RangeKernel range = RangeKernel::kNoise;
  Guide guide = Guide::kFlash;
  Agreement agreement = Agreement::kOne;
};

// The patch's Gaussian [px].
constexpr double kPatchSigma = 1.5;

std::vector<float> gaussian_patch(int radius) {
  std::vector<float> taps;
  for (int j = -radius; j <= radius; ++j)
    taps.push_back(static_cast<float>(std::exp(-j * j / (2 * kPatchSigma * kPatchSigma))));
  return taps;
}

/// Squared half width of the confidence interval of each pixel's mean.
Rgb squared_intervals(const FilterFrame& frame, double confidence, const Task& task) {
  // With two samples or fewer there is no interval to speak of: t takes everything.
  const double dof = frame.samples > 0 ? std::max(1.0, frame.samples - 1) : 1e9;
  const double t = frame.samples > 0 && frame.samples < 1.5 ? 1e9 : student_quantile(confidence, dof);
  const float factor = static_cast<float>(std::min(t * t, 1e18));
  Rgb out;
  for (size_t c = 0; c < 3; ++c)
    out[c] = make_plane(frame.width(), frame.height(), quiet(task),
                        [&](int x, int y) { return std::min(factor * (*frame.variance[c])(x, y), 1e37f); });
  return out;
}

/// Smoothly varying picture whose patches say what is alike, and the noise of its pixels.
struct FlashImage {
  Rgb mean, variance;
};

FlashImage flash_image(const VirtualFlash& p, const FilterFrame& frame) {
  FlashImage flash;
  const auto take = [&](const RgbPlanes& mean, const RgbPlanes& variance) {
    for (size_t c = 0; c < 3; ++c) flash.mean[c] = *mean[c], flash.variance[c] = *variance[c];
  };
  const LayerName& source = p.guide == Guide::kDirect ? layer::direct : layer::flash;
  if (p.guide == Guide::kSignal) {
    take(frame.signal, frame.variance);
  } else {
    for (const std::string_view which : {std::string_view(), statistic::mean_variance})
      if (!frame.layers.has(source, which))
        throw InputError(
            fmt::format("filter virtual_flash: guide={} needs the layer '{}' and its variance, which the frame does "
                        "not have. Record "
                        "them with: brume render SCENE -o OUT.exr --layers direct,indirect,flash; or take guide=signal",
                        source.label(), source.label()));
    take(frame.layers.rgb(source), frame.layers.rgb(source, statistic::mean_variance));
  }
  return flash;
}

void run(const VirtualFlash& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const FlashImage flash = flash_image(p, frame);

  WeightModel model;
  Distance patch;
  if (p.range == RangeKernel::kNoise) {
    patch = noise_distance(view(flash.mean), view(flash.variance), 0, p.strength);
  } else {
    // sigma_r = 2 sqrt(mean V_F) of the Euclidean distance between patches.
    double noise = 0;
    for (const Plane& v : flash.variance)
      for (int y = 0; y < height; ++y)
        for (const float value : v.pixels(y)) noise += value;
    patch.kind = Distance::Kind::kRatio;
    patch.guide = {&flash.mean[0], &flash.mean[1], &flash.mean[2]};
    patch.floor = static_cast<float>(std::max(2 * 4 * noise / (static_cast<double>(width) * height), 1e-30));
  }
  patch.patch = gaussian_patch(p.patch_radius);
  model.distances.push_back(patch);

  const auto step = [&](const Rgb& values, const RgbPlanes& centre, const Rgb& intervals,
                        const std::vector<const Plane*>& averaged, int radius, const Task& part) {
    WeightModel homogeneous = model;
    Membership test;
    test.bound = p.agreement == Agreement::kOne      ? Membership::Bound::kOwn
                 : p.agreement == Agreement::kEither ? Membership::Bound::kLarger
                                                     : Membership::Bound::kSmaller;
    for (size_t c = 0; c < 3; ++c) {
      test.value.push_back(&values[c]);
      test.centre.push_back(centre[c]);
      test.squared_bound.push_back(&intervals[c]);
    }
    homogeneous.memberships.push_back(test);
    return weighted_average(homogeneous, gaussian_window(radius, (2 * radius + 1) / 3.0), averaged, part);
  };
  const auto with_values = [&](const RgbPlanes& signal, const std::vector<Plane>& values) {
    std::vector<const Plane*> planes(signal.begin(), signal.end());
    for (const Plane& v : values) planes.push_back(&v);
    return planes;
  };

  std::vector<Plane> carried;
  if (frame.carries())
    for (const Plane* v : frame.values) carried.push_back(*v);
  Rgb noisy;
  for (size_t c = 0; c < 3; ++c) noisy[c] = *frame.signal[c];
  const Rgb narrow = squared_intervals(frame, p.small_confidence, task),
            wide = squared_intervals(frame, p.large_confidence, task);
  std::vector<Plane> first =
      step(noisy, frame.signal, narrow, with_values(frame.signal, carried), p.small_radius, share(task, 0, 0.1)).values;
  Rgb once = {std::move(first[0]), std::move(first[1]), std::move(first[2])};
  if (frame.carries())
    for (size_t c = 0; c < 3; ++c) carried[c] = std::move(first[c + 3]);
  // Strict: around the noisy mean itself, so that the averages stay in its interval whatever the weights.
  if (p.second == Second::kStrict)
    for (size_t c = 0; c < 3; ++c)
      for_each_row(height, quiet(task), [&](int y) {
        for (int x = 0; x < width; ++x) {
          const float m = (*frame.signal[c])(x, y), h = std::sqrt(wide[c](x, y));
          once[c](x, y) = std::clamp(once[c](x, y), m - h, m + h);
        }
      });
  Averages last = step(once, p.second == Second::kStrict ? frame.signal : view(once), wide,
                       with_values(view(once), carried), p.large_radius, share(task, 0.1, 1));
  const size_t offset = frame.carries() ? 3 : 0;
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(last.values[c + offset]);

  if (frame.products)
    for (size_t c = 0; c < 3; ++c)
      (*frame.products)[layer::error_bound.channel(c)] = make_plane(width, height, quiet(task), [&](int x, int y) {
        // Full length L of an interval is twice its half width: L for strict; (L99.8 + L99 + L99) / 2 recentred.
        const float near = std::sqrt(narrow[c](x, y)), far = std::sqrt(wide[c](x, y));
        return p.second == Second::kStrict ? 2 * far : near + 2 * far;
      });
}

const FilterEntry entry =
    declare<VirtualFlash>("virtual_flash",
                          "Non-local means on the virtual flash image, over pixels that are statistically equal to the "
                          "centre, in two steps; with a bound of the error.")
        .source(
            "Moon, Jun, Lee, Kim, Hachisuka and Yoon 2013, Robust image denoising using a virtual flash image, "
            "equations 1 and 2, theorem 3.1, section 4; the flash "
            "image for media is ours")
        .notes(
            "A neighbour counts when its mean lies in the centre's Student confidence interval in all three channels. "
            "`second=strict` tests around the noisy mean, which makes the paper's bound hold: with the stated "
            "confidence the error is at most the interval's length. `recentred` tests around the first step's result, "
            "which removes freckles and has the longer bound. The bound is written as the layer `error_bound`. Guides: "
            "the flash image (direct light, and a lamp at the eye with falloff and relief from the density gradient, "
            "in "
            "place of the indirect light), direct light alone, or the signal itself.")
        .statistics(Statistics::kVariance)
        .can_use(layer::flash, layer::direct)
        .with_variance()
        .produces(layer::error_bound)
        .carries()
        .param("small-radius", &VirtualFlash::small_radius, {0, 30}, "px", "half width of the first step's window")
        .param("large-radius", &VirtualFlash::large_radius, {0, 40}, "px", "half width of the second step's window",
               {7, 15})
        .param("patch-radius", &VirtualFlash::patch_radius, {0, 8}, "px", "half width of a patch of the flash image")
        .param("small-confidence", &VirtualFlash::small_confidence, {0.5, 0.999999}, "1",
               "of the first step's intervals")
        .param("large-confidence", &VirtualFlash::large_confidence, {0.5, 0.999999}, "1",
               "of the second step's intervals", {0.9, 0.99, 0.999})
        .param("strength", &VirtualFlash::strength, {0.05, 100}, "1",
               "k, noise deviations of the flash image taken as equal", {0.5, 0.7, 1, 2})
        .param("second", &VirtualFlash::second, {"recentred", "strict"}, "what the second step's intervals lie around")
        .param("range", &VirtualFlash::range, {"noise", "literal"},
               "patch distance per pixel's noise, or one sigma for the picture as published")
        .param("guide", &VirtualFlash::guide, {"flash", "direct", "signal"}, "where patches are compared",
               {"flash", "direct"})
        .param("agreement", &VirtualFlash::agreement, {"one", "either", "both"},
               "whose interval must hold the other's mean: the centre's, either's or both")
        .scratch(40)
        .apron([](const VirtualFlash& p) { return p.small_radius + p.large_radius + 2 * p.patch_radius; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
