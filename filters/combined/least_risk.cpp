// Several ways to clean a picture, of which each pixel gets the mixture that the data prove best, and the data
// themselves where none is proven better. docs/least_risk.md tells the method.

#include <algorithm>
#include <cmath>
#include <deque>

#include "base/error.h"
#include "base/math.h"
#include "base/rng.h"
#include "filters/api/registry.h"
#include "filters/patch/neighbourhood.h"
#include "filters/regression/guided_filter.h"
#include "filters/regression/regression.h"
#include "filters/regression/transport/mixing.h"
#include "filters/regression/transport/stacking.h"

namespace brume {
namespace {

enum class Network { kAuto, kNone };

struct LeastRisk {
  float window = 12, caution = 300, sure = 2;
  Network network = Network::kAuto;
};

constexpr float kStep = 0.25f;        // of the noise, over which a result's slope along it is measured
constexpr double kLightWindow = 1.5;  // of the brightness that errors are relative to [px]
// Gaussians: deviation of the narrowest [px]; each other is wider by the root of two.
constexpr double kNarrowest = 0.7;
constexpr int kGaussians = 7;
// Regression on features: half widths of windows [px], ridge of features of range 1.
constexpr int kFitRadii[] = {3, 8};
constexpr float kRidge = 1e-3f;
// Means over alike surroundings: half width of the search [px], deviations still taken as equal.
constexpr int kSearchRadius = 6;
constexpr float kStrengths[] = {0.35f, 0.5f};
// Lines over alike surroundings, and features cleaned for them by their own: the same.
constexpr int kLineRadius = 7, kFeatureRadius = 5, kFeaturePatch = 3;
constexpr float kLineStrength = 1.5f, kFeatureStrength = 0.5f;

Rgb rgb_of(std::vector<Plane> planes) {
  return {std::move(planes[0]), std::move(planes[1]), std::move(planes[2])};
}

std::vector<const Plane*> planes_of(const Rgb& rgb) {
  return {&rgb[0], &rgb[1], &rgb[2]};
}

/// a + factor * b
Rgb sum(const Rgb& a, float factor, const Rgb& b, const Task& task) {
  Rgb out = a;
  for (size_t c = 0; c < 3; ++c) add_to(out[c], factor, b[c], task);
  return out;
}

/// Another draw of the noise that the picture has: half of what its halves differ by; without halves normal numbers of
/// its variance, alike in all colours.
Rgb noise_of(const FilterFrame& frame, float sign, const Task& task) {
  Rgb noise;
  if (!frame.half_a[0]) {
    for (size_t c = 0; c < 3; ++c)
      noise[c] = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
        const ivec2 at = frame.origin + ivec2(x, y);
        Rng random(SampleKey{.pixel = static_cast<uint32_t>(at.y * frame.frame_size.x + at.x)});
        const double length = std::sqrt(-2 * std::log(random.uniform()));
        return static_cast<float>(length * std::cos(2 * kPi * random.uniform())) *
               std::sqrt((*frame.variance[c])(x, y));
      });
    return noise;
  }
  for (size_t c = 0; c < 3; ++c)
    noise[c] = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
      return 0.5f * sign * ((*frame.half_a[c])(x, y) - (*frame.half_b[c])(x, y));
    });
  return noise;
}

/// A picture and its noise, as what each candidate is made from: the picture, and the picture moved along the noise.
class Data {
  const Task& task_;

 public:
  Data(const FilterFrame& frame, const Task& task)
      : task_(task),
        sign(frame.half_a[0] && sum_of(*frame.half_a[1]) < sum_of(*frame.half_b[1]) ? -1.0f : 1.0f),
        noise(noise_of(frame, sign, task)),
        here{*frame.signal[0], *frame.signal[1], *frame.signal[2]},
        moved(sum(here, kStep, noise, task)),
        halves(halves_of(here, noise)) {}

  /// A result and its slope along the noise, as the two halves that a linear filter would make of the picture plus and
  /// minus the noise: products of the one's result with the other's data then are Stein's estimate of the risk.
  HalfPair halves_of(const Rgb& result, const Rgb& slope) const {
    return {sum(result, 1, slope, task_), sum(result, -1, slope, task_)};
  }
  HalfPair halves_along(const Rgb& result_here, const Rgb& result_moved) const {
    return halves_of(result_here, slope(result_here, result_moved));
  }
  Rgb slope(const Rgb& result_here, const Rgb& result_moved) const {
    Rgb out = sum(result_moved, -1, result_here, task_);
    for (Plane& plane : out)
      for_each_pixel(plane.width(), plane.height(), quiet(task_), [&](int x, int y) { plane(x, y) /= kStep; });
    return out;
  }

  const float sign;  ///< of half A in the noise, which makes its sum positive, whichever half is which
  const Rgb noise, here, moved;
  const HalfPair halves;
};

/// Gaussians and the Gaussians of what they leave, 2 G - G G, whose bias is of the fourth order of their width.
/// @param slope  of the picture along the noise
void add_gaussians(const Data& data, const Rgb& picture, const Rgb& slope, std::vector<StoredPair>& candidates,
                   const Task& task) {
  const auto blurred = [&](int k) {
    const double deviation = kNarrowest * std::pow(2, 0.5 * k);
    const auto blur = [&](const Rgb& of) {
      Rgb out;
      for (size_t c = 0; c < 3; ++c) out[c] = gaussian_blur(of[c], deviation, task);
      return out;
    };
    return data.halves_of(blur(picture), blur(slope));
  };
  HalfPair narrow = blurred(0);
  for (int k = 1; k <= kGaussians; ++k) {
    HalfPair wide = blurred(k);
    HalfPair twice = narrow;
    add_to(twice, 1, narrow, task);
    add_to(twice, -1, wide, task);
    candidates.emplace_back(twice, task);
    narrow = std::move(wide);
  }
}

/// What tells pixels apart, noise that it has averaged away over what is alike in it; and the same of features moved
/// along their noise, which is often the picture's, as that of opacity.
struct SmoothFeatures {
  std::vector<Plane> here, moved;

  SmoothFeatures(const FilterFrame& frame, const Data& data, const Task& task) {
    for (const Feature& f : *frame.features) {
      const bool noisy =
          std::any_of(f.variance.begin(), f.variance.end(), [](const Plane& v) { return any_above_0(v); });
      std::vector<Plane> along = f.mean;
      for (size_t i = 0; i < along.size() && noisy; ++i) {
        add_to(along[i], data.sign * 0.5f * kStep, f.half_a[i], task);
        add_to(along[i], data.sign * -0.5f * kStep, f.half_b[i], task);
      }
      for (const auto& [to, mean] :
           {std::pair(&here, &f.mean), std::pair(&moved, static_cast<const std::vector<Plane>*>(&along))})
        for (Plane& plane : noisy ? smooth(*mean, f.variance, task) : std::vector(*mean))
          to->push_back(std::move(plane));
    }
  }

 private:
  static std::vector<Plane> smooth(const std::vector<Plane>& mean, const std::vector<Plane>& variance,
                                   const Task& task) {
    WeightModel model;
    model.distances.push_back(noise_distance(pointers(mean), pointers(variance), kFeaturePatch, kFeatureStrength));
    return weighted_average(model, square_window(kFeatureRadius), pointers(mean), quiet(task)).values;
  }
};

/// In every window a linear function of the features, where there are any.
void add_fits(const Data& data, const SmoothFeatures& features, std::vector<StoredPair>& candidates, const Task& task) {
  if (features.here.empty()) return;
  for (const int radius : kFitRadii) {
    const auto fit = [&](const Rgb& noisy, const std::vector<Plane>& by) {
      return rgb_of(guided_filter(view(noisy), pointers(by), radius, kRidge, quiet(task)));
    };
    candidates.emplace_back(data.halves_along(fit(data.here, features.here), fit(data.moved, features.moved)), task);
  }
}

/// Errors count relative to brightness, as CIE-Lab sees them: of the whole picture, where the signal is a part of it.
Plane weight_of_errors(const FilterFrame& frame, const Task& task) {
  const Plane light =
      gaussian_blur(frame.whole ? *frame.whole : luminance_of(frame.signal, frame.space, task), kLightWindow, task);
  double total = 0;
  for (int y = 0; y < light.height(); ++y)
    for (const float v : light.pixels(y)) total += std::abs(static_cast<double>(v));
  const auto scale = static_cast<float>(total > 0 ? static_cast<double>(light.width()) * light.height() / total : 0.0);
  return make_plane(light.width(), light.height(), quiet(task),
                    [&](int x, int y) { return std::pow(scale * std::abs(light(x, y)) + 0.05f, -4.0f / 3); });
}

HalfPair stacked(const std::vector<StoredPair>& candidates, const Data& data, const Plane& weight, const LeastRisk& p,
                 const Task& task) {
  return blend(candidates, data.halves,
               stacking_weights(candidates, data.halves, weight,
                                {static_cast<double>(p.window), static_cast<double>(p.caution)}, task),
               task);
}

/// A nearly clean picture, by which pixels in alike surroundings are found; and the same moved along the noise.
class Pilot {
 public:
  Pilot(const HalfPair& clean, const FilterFrame& frame, const Task& task)
      : here_(mean(clean, task)),
        moved_(sum(here_, kStep, sum(here_, -1, clean.b, task), task)),
        variance_(make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
          return (*frame.variance[0])(x, y) + (*frame.variance[1])(x, y) + (*frame.variance[2])(x, y);
        })) {}

  /// exp(-d / k^2), d the mean squared distance of 3 x 3 pixels to those of `there`, in units of the noisy pictures'
  /// variance. The noise of other frames does not move with this one's.
  WeightModel weights(float k, bool moved, const Pilot& there) const {
    WeightModel model;
    Distance& d = model.distances.emplace_back();
    d.kind = Distance::Kind::kRatio;
    d.guide = planes_of(moved ? moved_ : here_);
    d.variance = {&variance_};
    if (&there != this) {
      d.guide_there = planes_of(there.here_);
      d.variance_there = {&there.variance_};
    }
    d.floor = 1e-20f;
    d.scale = 1 / (k * k);
    d.patch = box_patch(1);
    return model;
  }

 private:
  Rgb here_, moved_;
  Plane variance_;
};

/// A frame of a sequence.
struct Frame {
  const FilterFrame& frame;
  Data data;
  SmoothFeatures features;
  HalfPair linear;  ///< what candidates make of it together that are linear, but for the features' noise
  Pilot pilot;      ///< the same: where alike surroundings are looked for
  Rgb moved;        ///< as it is, or moved, where it shows the frame to clean, along that frame's noise

  /// @param nearby  of the frame to clean: the others; else none
  /// @param cleaned  of the others: the frame to clean
  Frame(const FilterFrame& of, const LeastRisk& p, const std::deque<Frame>& nearby, const Data* cleaned,
        const Task& task)
      : frame(of),
        data(of, task),
        features(of, data, task),
        linear(stacked(linear_candidates(nearby, task), data, weight_of_errors(of, task), p, task)),
        pilot(linear, of, task),
        moved(cleaned ? moved_with(*cleaned, task) : data.moved) {}

  const Rgb& noisy(bool along) const { return along ? moved : data.here; }

 private:
  std::vector<StoredPair> linear_candidates(const std::deque<Frame>& nearby, const Task& task) const {
    std::vector<StoredPair> candidates;
    add_gaussians(data, data.here, data.noise, candidates, task);
    add_fits(data, features, candidates, task);
    if (nearby.empty()) return candidates;
    Rgb here = data.here, along = data.moved;
    const float share = 1.0f / static_cast<float>(nearby.size() + 1);
    for (size_t c = 0; c < 3; ++c) {
      for (const Frame& other : nearby) {
        add_to(here[c], 1, other.noisy(false)[c], task);
        add_to(along[c], 1, other.noisy(true)[c], task);
      }
      for (Plane* const sum : {&here[c], &along[c]})
        for_each_pixel(sum->width(), sum->height(), quiet(task), [&](int x, int y) { (*sum)(x, y) *= share; });
    }
    add_gaussians(data, here, data.slope(here, along), candidates, task);
    return candidates;
  }
  /// Where nothing of another frame was found, alignment shows the frame to clean.
  Rgb moved_with(const Data& cleaned, const Task& task) const {
    Rgb out = data.here;
    for_each_pixel(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
      for (size_t c = 0; c < 3; ++c)
        if (data.here[c](x, y) != cleaned.here[c](x, y)) return;
      for (size_t c = 0; c < 3; ++c) out[c](x, y) = cleaned.moved[c](x, y);
    });
    return out;
  }
};

/// Means over pixels in alike surroundings, in all frames, one candidate for each strength.
void add_means_of_alike(const Frame& own, const std::deque<Frame>& nearby, std::vector<StoredPair>& candidates,
                        const Task& task) {
  const std::vector<Offset> window = square_window(kSearchRadius);
  const auto means = [&](bool moved, const Task& part) {
    std::vector<Rgb> found;
    if (nearby.empty()) {
      std::vector<Variant> variants;
      for (const float k : kStrengths) variants.push_back({1 / (k * k), nullptr, {}});
      for (Averages& of : weighted_averages(own.pilot.weights(1, moved, own.pilot), window, variants,
                                            view(own.noisy(moved)), nullptr, part))
        found.push_back(rgb_of(std::move(of.values)));
      return found;
    }
    for (const float k : kStrengths) {
      std::vector<Slice> slices;
      const auto add = [&](const Frame& f) {
        slices.push_back({own.pilot.weights(k, moved, f.pilot), window, planes_of(f.noisy(moved))});
      };
      add(own);
      for (const Frame& other : nearby) add(other);
      found.push_back(rgb_of(average_over_frames(slices, view(own.noisy(moved)), part)));
    }
    return found;
  };
  const std::vector<Rgb> here = means(false, share(task, 0, 0.5)), moved = means(true, share(task, 0.5, 1));
  for (size_t i = 0; i < here.size(); ++i) candidates.emplace_back(own.data.halves_along(here[i], moved[i]), task);
}

/// In every window a line in position and features, over pixels in alike surroundings, in all frames.
void add_lines(const Frame& own, const std::deque<Frame>& nearby, std::vector<StoredPair>& candidates,
               const Task& task) {
  if (own.features.here.empty()) return;
  const auto lines = [&](bool moved, const Task& part) {
    std::vector<RegressionFrame> windows;
    const auto add = [&](const Frame& f, const std::vector<Plane>& features) {
      windows.push_back(
          {own.pilot.weights(kLineStrength, moved, f.pilot), pointers(features), planes_of(f.noisy(moved))});
    };
    add(own, moved ? own.features.moved : own.features.here);
    for (const Frame& other : nearby) add(other, other.features.here);
    return rgb_of(collaborative_regression(windows, kLineRadius, part));
  };
  const Rgb here = lines(false, share(task, 0, 0.5));
  candidates.emplace_back(own.data.halves_along(here, lines(true, share(task, 0.5, 1))), task);
}

/// Which of Open Image Denoise's weights are there; empty: none, or they are not wanted.
std::string weights_in_use(const LeastRisk& p) {
  const FilterEntry& network = find_filter("oidn");
  try {
    return p.network == Network::kAuto ? network.weights(network.defaults) : "";
  } catch (const InputError&) {
    return "";
  }
}

void add_network(const FilterFrame& frame, const Data& data, std::vector<StoredPair>& candidates, const Task& task) {
  const FilterSettings network(find_filter("oidn"));
  const auto result = [&](const Rgb& picture, const Task& part) {
    FilterFrame f = frame;
    f.signal = f.values = view(picture);
    Rgb out;
    network.run(f, {{&out[0], &out[1], &out[2]}}, part);
    return out;
  };
  const Rgb here = result(data.here, share(task, 0, 0.5));
  candidates.emplace_back(data.halves_along(here, result(data.moved, share(task, 0.5, 1))), task);
}

void run(const LeastRisk& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  std::deque<Frame> nearby;
  if (!frame.nearby.empty()) {
    const Data cleaned(frame, task);
    for (const FilterFrame* other : frame.nearby) nearby.emplace_back(*other, p, std::deque<Frame>(), &cleaned, task);
  }
  const Frame own(frame, p, nearby, nullptr, task);
  task.report(0.2);
  const Data& data = own.data;
  const Plane weight = weight_of_errors(frame, task);
  std::vector<StoredPair> candidates;
  candidates.emplace_back(own.linear, task);
  add_means_of_alike(own, nearby, candidates, share(task, 0.2, 0.4));
  // Without halves single bright samples are not known as noise, and lines follow them.
  if (frame.half_a[0]) add_lines(own, nearby, candidates, share(task, 0.4, 0.5));
  if (!weights_in_use(p).empty()) add_network(frame, data, candidates, share(task, 0.5, 0.9));

  // Stacking chooses by means over windows; where the data prove better on a smaller scale, or one candidate does, the
  // result is moved there.
  HalfPair result = stacked(candidates, data, weight, p, task);
  std::vector<Proposal> proposals;
  proposals.emplace_back(
      [&](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& { return room = cut(data.halves, box); });
  for (const StoredPair& candidate : candidates)
    proposals.emplace_back([&candidate, &task](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& {
      candidate.read(box, room, task);
      return room;
    });
  const std::vector<MixingRegion> regions = {{Plane(frame.width(), frame.height(), 1.0f), static_cast<double>(p.sure)}};
  mix(result, proposals, {}, {view(data.halves.a), view(data.halves.b), weight, regions}, task);
  Rgb clean = mean(result, task);
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(clean[c]);
  task.report(1);
}

const FilterEntry entry =
    declare<LeastRisk>("least_risk",
                       "Several ways to clean a picture, mixed pixel by pixel as an unbiased estimate of their error "
                       "says; the data where none is proven better.")
        .merit(7, "where the frame has no guides: with a variance or a second frame never worse than the noisy frame")
        .source(
            "our own, docs/least_risk.md; risk: Stein 1981, Ramani, Blu and Unser 2008; halves out of one picture: Leiner et al. 2023; stacking: Breiman 1996")
        .notes(
            "Candidates: Gaussians of seven widths, each with what it leaves added back; regression on the frame's features; means over alike surroundings, looked for in what those make together, and where there are halves and features lines over them; Open Image Denoise's network, where `./run oidn` has fetched its weights. Two half images show the noise; without them it is drawn from the variance, which without statistics is estimated from the picture.")
        .paper("")
        .statistics(Statistics::kVariance, Statistics::kHalves)
        .makes_halves()
        .features()
        .can_use(layer::albedo, layer::normal)
        .uses_weights(weights_in_use)
        .within([](const Layers& layers, const LayerName&) {
          return Box{0, 0, layers.width(), layers.height()};
        })
        .seeded()
        .aligned_sequences()
        .param("window", &LeastRisk::window, {1, 200}, "px",
               "deviation of the Gaussian in which candidates are weighed against each other")
        .param("caution", &LeastRisk::caution, {0, 1e6}, "1", "pull of these weights towards the frame's, in pixels")
        .param("sure", &LeastRisk::sure, {0, 100}, "1",
               "standard errors by which the data, or one candidate, must be proven better than the stack")
        .param("network", &LeastRisk::network, {"auto", "none"},
               "Open Image Denoise among the candidates: where its weights are there, or never")
        .scratch(60)
        .apron([](const LeastRisk&) { return 1 << 20; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
