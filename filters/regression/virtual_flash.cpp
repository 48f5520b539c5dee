#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "base/error.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/patch/neighbourhood.h"
#include "filters/patch/student.h"

namespace brume {
namespace {

enum class Second { kRecentred, kStrict };
enum class RangeKernel { kNoise, kLiteral };
enum class Guide { kFlash, kDirect, kSignal };
enum class Agreement { kOne, kEither };

struct VirtualFlash {
  int small_radius = 3, large_radius = 7, patch_radius = 2;
  float small_confidence = 0.998f, large_confidence = 0.99f, strength = 0.7f;
  Second second = Second::kRecentred;
  RangeKernel range = RangeKernel::kNoise;
  Guide guide = Guide::kDirect;
  Agreement agreement = Agreement::kEither;
};

// The patch's Gaussian [px].
constexpr double kPatchSigma = 1.5;

std::vector<float> gaussian_patch(int radius) {
  std::vector<float> taps;
  for (int j = -radius; j <= radius; ++j)
    taps.push_back(static_cast<float>(std::exp(-j * j / (2 * kPatchSigma * kPatchSigma))));
  return taps;
}

/// The square of Student's quantile for each pixel's number of samples.
Plane squared_quantiles(const FilterFrame& frame, double confidence) {
  // With one sample there is no interval to speak of: t takes everything. Unknown counts are taken as many.
  const auto squared = [confidence](double samples) {
    if (samples > 0 && samples < 1.5) return 1e18f;
    const double t = student_quantile(confidence, samples > 0 ? std::max(1.0, samples - 1) : 1e9);
    return static_cast<float>(std::min(t * t, 1e18));
  };
  if (!frame.sample_count) return Plane(frame.width(), frame.height(), squared(frame.samples));
  std::unordered_map<float, float> known;
  Plane out(frame.width(), frame.height());
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const float samples = (*frame.sample_count)(x, y);
      const auto [entry, fresh] = known.try_emplace(samples);
      if (fresh) entry->second = squared(std::max(1.0, static_cast<double>(samples)));
      out(x, y) = entry->second;
    }
  return out;
}

/// Squared half width of the confidence interval of each pixel's mean.
Rgb squared_intervals(const FilterFrame& frame, double confidence, const Task& task) {
  const Plane factor = squared_quantiles(frame, confidence);
  Rgb out;
  for (size_t c = 0; c < 3; ++c)
    out[c] = make_plane(frame.width(), frame.height(), quiet(task),
                        [&](int x, int y) { return std::min(factor(x, y) * (*frame.variance[c])(x, y), 1e37f); });
  return out;
}

/// Smoothly varying picture whose patches say what is alike, and the noise of its pixels.
struct FlashImage {
  Rgb mean, variance;
};

FlashImage flash_image(const VirtualFlash& p, const FilterFrame& frame) {
  FlashImage flash;
  const auto take = [&](const RgbPlanes& mean, const RgbPlanes& variance) {
    for (size_t c = 0; c < 3; ++c) {
      flash.mean[c] = *mean[c];
      flash.variance[c] = *variance[c];
    }
  };
  const LayerName& source = p.guide == Guide::kDirect ? layer::direct : layer::flash;
  if (p.guide == Guide::kSignal) {
    take(frame.signal, frame.variance);
  } else {
    for (const std::string_view which : {std::string_view(), statistic::mean_variance})
      if (!frame.layers.has(source, which))
        throw InputError(fmt::format(
            "filter virtual_flash: guide={} needs the layer '{}' and its variance, which the frame does not have. {}",
            source.label(), source.label(),
            way_to(
                "Record them with: brume render SCENE -o OUT.exr --layers direct,indirect,flash; or take guide=signal",
                frame.layers, "take guide=signal, or ")));
    take(frame.layers.rgb(source), frame.layers.rgb(source, statistic::mean_variance));
  }
  return flash;
}

/// 8 mean V_F: twice the square of sigma_r = 2 sqrt(mean V_F), the Euclidean distance between patches being squared.
float literal_range(const FlashImage& flash) {
  double noise = 0, pixels = 0;
  for (const Plane& v : flash.variance)
    for (int y = 0; y < v.height(); ++y)
      for (const float value : v.pixels(y)) {
        noise += value;
        pixels += 1.0 / 3.0;
      }
  return static_cast<float>(std::max(2 * 4 * noise / pixels, 1e-30));
}

/// The frames of a sequence in their order, the one that is cleaned among them.
struct Stack {
  std::vector<const FilterFrame*> frames;
  std::vector<int> times;  // distance from the one that is cleaned
  std::vector<FlashImage> flash;
  size_t own = 0;

  Stack(const VirtualFlash& p, const FilterFrame& frame) {
    for (const FilterFrame* f : in_order(frame)) {
      if (f == &frame) own = frames.size();
      frames.push_back(f);
      times.push_back(f->distance);
      flash.push_back(flash_image(p, *f));
    }
  }
  /// The frame at a time; frames.size() if the stack has none.
  size_t at(int time) const { return static_cast<size_t>(std::find(times.begin(), times.end(), time) - times.begin()); }
};

/// Distances of the patches around a pixel of frame i and one of frame j: cubes as far as the stack reaches.
WeightModel patch_distances(const VirtualFlash& p, const Stack& stack, size_t i, size_t j) {
  WeightModel model;
  model.join = WeightModel::Join::kPatch;
  const std::vector<float> taps = gaussian_patch(p.patch_radius);
  float total = 0;
  for (int k = -p.patch_radius; k <= p.patch_radius; ++k) {
    const size_t a = stack.at(stack.times[i] + k), b = stack.at(stack.times[j] + k);
    if (a == stack.frames.size() || b == stack.frames.size()) continue;
    const FlashImage &here = stack.flash[a], &there = stack.flash[b];
    Distance d;
    if (p.range == RangeKernel::kNoise) {
      d = noise_distance(view(here.mean), view(here.variance), 0, p.strength);
      if (a != b)
        for (size_t c = 0; c < 3; ++c) d.variance_there.push_back(&there.variance[c]);
    } else {
      d.kind = Distance::Kind::kRatio;
      d.guide = {&here.mean[0], &here.mean[1], &here.mean[2]};
      d.floor = literal_range(stack.flash[stack.own]);
    }
    if (a != b)
      for (size_t c = 0; c < 3; ++c) d.guide_there.push_back(&there.mean[c]);
    d.patch = taps;
    d.scale = taps[static_cast<size_t>(k + p.patch_radius)];
    total += d.scale;
    model.distances.push_back(std::move(d));
  }
  for (Distance& d : model.distances) d.scale /= total;
  return model;
}

/// One step of the filter on its way through the stack: what each frame's intervals lie around, and what they hold.
struct Step {
  std::vector<Rgb> values, intervals;
  std::vector<RgbPlanes> centres;
  std::vector<std::vector<Plane>> carried;  // beside the values; empty: nothing
};

/// Frame i of a step, averaged over its homogeneous pixels in all frames within `frame_window`.
std::vector<Plane> average(const VirtualFlash& p, const Stack& stack, const Step& step, size_t i, int radius,
                           int frame_window, const Task& task) {
  const auto planes = [&](size_t j) {
    std::vector<const Plane*> list;
    for (const Plane& v : step.values[j]) list.push_back(&v);
    if (!step.carried.empty())
      for (const Plane& v : step.carried[j]) list.push_back(&v);
    return list;
  };
  const double sigma = (2 * radius + 1) / 3.0;
  std::vector<Slice> slices;
  for (size_t j = 0; j < stack.frames.size(); ++j) {
    const int apart = stack.times[j] - stack.times[i];
    if (std::abs(apart) > frame_window) continue;
    Slice& slice = slices.emplace_back();
    slice.model = patch_distances(p, stack, i, j);
    slice.offsets = gaussian_window(radius, sigma);
    for (Offset& o : slice.offsets) o.weight *= static_cast<float>(std::exp(-apart * apart / (2 * sigma * sigma)));
    slice.values = planes(j);
    Membership test;
    test.bound = p.agreement == Agreement::kOne ? Membership::Bound::kOwn : Membership::Bound::kLarger;
    for (size_t c = 0; c < 3; ++c) {
      test.value.push_back(&step.values[j][c]);
      test.centre.push_back(step.centres[i][c]);
      test.squared_bound.push_back(&step.intervals[i][c]);
      if (j != i) test.squared_bound_there.push_back(&step.intervals[j][c]);
    }
    slice.model.memberships.push_back(std::move(test));
  }
  return average_over_frames(slices, planes(i), task);
}

void run(const VirtualFlash& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const Stack stack(p, frame);
  const size_t frames = stack.frames.size();
  const bool strict = p.second == Second::kStrict;

  Step first, second;
  for (const FilterFrame* f : stack.frames) {
    first.values.push_back({*f->signal[0], *f->signal[1], *f->signal[2]});
    first.centres.push_back(f->signal);
    first.intervals.push_back(squared_intervals(*f, p.small_confidence, task));
    second.intervals.push_back(squared_intervals(*f, p.large_confidence, task));
    if (frame.carries()) first.carried.push_back({*f->values[0], *f->values[1], *f->values[2]});
  }
  for (size_t i = 0; i < frames; ++i) {
    const double share_of_first = frames > 1 ? 0.3 : 0.1, one = share_of_first / static_cast<double>(frames);
    const double begin = one * static_cast<double>(i);
    std::vector<Plane> once =
        average(p, stack, first, i, p.small_radius, p.small_radius, share(task, begin, begin + one));
    second.values.push_back({std::move(once[0]), std::move(once[1]), std::move(once[2])});
    if (frame.carries()) second.carried.push_back({std::move(once[3]), std::move(once[4]), std::move(once[5])});
    if (!strict) continue;
    // Around the noisy mean itself, so that the averages stay in its interval whatever the weights.
    const RgbPlanes& signal = stack.frames[i]->signal;
    for (size_t c = 0; c < 3; ++c)
      for_each_pixel(width, height, quiet(task), [&](int x, int y) {
        const float m = (*signal[c])(x, y), h = std::sqrt(second.intervals[i][c](x, y));
        second.values[i][c](x, y) = std::clamp(second.values[i][c](x, y), m - h, m + h);
      });
  }
  for (size_t i = 0; i < frames; ++i)
    second.centres.push_back(strict ? stack.frames[i]->signal : view(second.values[i]));
  std::vector<Plane> last =
      average(p, stack, second, stack.own, p.large_radius, p.large_radius, share(task, frames > 1 ? 0.3 : 0.1, 1));
  const size_t offset = frame.carries() ? 3 : 0;
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(last[c + offset]);

  if (!out.products) return;
  // The truth lies within the interval around the noisy mean, and the result as far from that mean as it does.
  const Rgb& squared = second.intervals[stack.own];
  for (size_t c = 0; c < 3; ++c)
    (*out.products)[layer::error_bound.channel(c)] = make_plane(width, height, quiet(task), [&](int x, int y) {
      return std::abs((*out[c])(x, y) - (*frame.signal[c])(x, y)) + std::sqrt(squared[c](x, y));
    });
}

const FilterEntry entry =
    declare<VirtualFlash>(
        "virtual_flash",
        "Non-local means on the virtual flash image, over pixels that are statistically equal to the centre, in two steps; with a bound of the error.")
        .merit(3.4, "for sequences, and where a bound of the error is wanted: it writes `error_bound`")
        .source(
            "Moon, Jun, Lee, Kim, Hachisuka and Yoon 2013, Robust image denoising using a virtual flash image, equations 1 and 2, theorem 3.1, section 4; the flash image for media is ours")
        .notes(
            "A neighbour counts when its mean lies in the centre's Student confidence interval in all three channels. `second=strict` tests around the noisy mean, as the paper's bound asks for: the error is at most the interval's length. `recentred` tests around the first step's result, which removes freckles. The layer `error_bound` is the distance from the noisy mean to the result, plus half the length of the interval of `large-confidence` around that mean: the error is no more wherever the truth lies in the interval, with any setting, and the bound is never longer than the paper's. It held for 99 % of pixels with normal samples, and for 97 to 99 % of a cloud's, whose light is skewed (the intervals alone cover 85 to 97 %). Guides: the flash image (direct light, and a lamp at the eye with falloff and relief from the density gradient, in place of the indirect light), direct light alone, or the signal itself. With frames before and after, windows and patches become cubes as far as those frames reach (section 4); the paper takes five on either side, and the bound needs them to be sampled independently.")
        .paper("guide=flash,agreement=one,large-radius=15,second=strict,range=literal")
        .statistics(Statistics::kVariance)
        .can_use(layer::flash, layer::direct)
        .with_variance()
        .produces(layer::error_bound)
        .sequences()
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
        .param("second", &VirtualFlash::second, {"recentred", "strict"}, "what the second step's intervals lie around",
               {"recentred", "strict"})
        .param("range", &VirtualFlash::range, {"noise", "literal"},
               "patch distance per pixel's noise, or one sigma for the picture as published", {"noise", "literal"})
        .param("guide", &VirtualFlash::guide, {"flash", "direct", "signal"}, "where patches are compared",
               {"flash", "direct", "signal"})
        .param("agreement", &VirtualFlash::agreement, {"one", "either"},
               "whose interval must hold the other's mean: the centre's or either's", {"one", "either"})
        .scratch(90)
        .apron([](const VirtualFlash& p) { return p.small_radius + p.large_radius + 2 * p.patch_radius; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
