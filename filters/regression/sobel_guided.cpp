#include <algorithm>
#include <cmath>

#include "filters/api/registry.h"
#include "filters/patch/neighbourhood.h"
#include "filters/patch/selection.h"
#include "filters/regression/bandwidth.h"
#include "filters/regression/guided_filter.h"

namespace brume {
namespace {

enum class Spikes { kLiteral, kKeep };

struct SobelGuided {
  int radius = 10;
  float epsilon = 1e-3f;
  float gamma_1 = 0.4f, gamma_2 = 0.3f, gamma_3 = 0.4f;
  Spikes spikes = Spikes::kKeep;
  FeatureSet feature_set = FeatureSet::kScalar;
};

// Widths tried for the fit of bias and variance, and feature parameters that compete (Liu et al. 2018, section 5).
constexpr std::array<double, 5> kAlphas = {0.1, 1, 2, 4, 8};
constexpr std::array<float, 3> kFeatureSigmas = {0.25f, 0.6f, 0.8f};
constexpr double kLargestAlpha = 8, kSmallestAlpha = 0.1;
// Most that the gradient adds to a feature's tolerance, and the least tolerance of all: squares of the features' range.
constexpr float kLargestGradient = 0.01f, kFeatureFloor = 1e-4f;
constexpr int kPrefilterRadius = 3, kErrorRadius = 1, kWinnerRadius = 3;
constexpr float kLargestError = 1e3f, kLargestNeed = 1e6f, kLargestShare = 8;

/// Sobel's 5 x 5 mask, so scaled that a ramp of one unit per pixel gives 1.
Plane sobel(const Plane& in, bool along_x, const Task& task) {
  static constexpr float kSmooth[] = {1 / 16.f, 4 / 16.f, 6 / 16.f, 4 / 16.f, 1 / 16.f};
  static constexpr float kSlope[] = {-1 / 8.f, -2 / 8.f, 0, 2 / 8.f, 1 / 8.f};
  const int width = in.width(), height = in.height();
  const auto mirror = [](int i, int n) {
    if (n == 1) return 0;
    while (i < 0 || i >= n) i = i < 0 ? -i : 2 * (n - 1) - i;
    return i;
  };
  return make_plane(width, height, quiet(task), [&](int x, int y) {
    float sum = 0;
    for (int j = -2; j <= 2; ++j) {
      float row = 0;
      for (int i = -2; i <= 2; ++i)
        row += (along_x ? kSlope : kSmooth)[i + 2] * in(mirror(x + i, width), mirror(y + j, height));
      sum += (along_x ? kSmooth : kSlope)[j + 2] * row;
    }
    return sum;
  });
}

/// The largest gradient of any feature; of a vector its norm over the channels.
Plane gradient_image(const std::vector<Feature>& features, int width, int height, const Task& task) {
  Plane largest(width, height);
  for (const Feature& f : features) {
    Plane squares(width, height);
    for (const Plane& channel : f.mean)
      for (const bool along_x : {true, false}) {
        const Plane g = sobel(channel, along_x, task);
        for_each_pixel(width, height, quiet(task), [&](int x, int y) { squares.row(y)[x] += g(x, y) * g(x, y); });
      }
    for_each_pixel(width, height, quiet(task),
                   [&](int x, int y) { largest.row(y)[x] = std::max(largest(x, y), std::sqrt(squares(x, y))); });
  }
  return largest;
}

/// How much each pixel is trusted as a neighbour: spikes not at all, what surrounds them half.
Plane trust(const Plane& light, const Plane& gradient, double exposure, const Task& task) {
  const int width = light.width(), height = light.height();
  Plane spikes = make_plane(width, height, quiet(task), [&](int x, int y) {
    double sum = 0, squares = 0;
    int n = 0;
    for (int qy = std::max(0, y - 2); qy <= std::min(height - 1, y + 2); ++qy)
      for (int qx = std::max(0, x - 2); qx <= std::min(width - 1, x + 2); ++qx) {
        sum += light(qx, qy);
        squares += static_cast<double>(light(qx, qy)) * light(qx, qy);
        ++n;
      }
    if (n < 4) return 0.0f;
    const double mean = sum / n, deviation = std::sqrt(std::max(0.0, squares / n - mean * mean));
    // As published, brightness is compared with a gradient of features; white being 1, both have a range of one.
    return exposure * std::abs(mean - light(x, y)) > std::max(static_cast<double>(gradient(x, y)), exposure * deviation)
               ? 1.0f
               : 0.0f;
  });
  // Windows of 11 x 11 centred on a spike; the paper's 10 x 10 has no centre.
  const Plane near = box_mean(spikes, 5, task);
  return make_plane(width, height, quiet(task), [&](int x, int y) {
    return spikes(x, y) > 0 ? 0.0f : near(x, y) > 1e-6f ? 0.5f : 1.0f;
  });
}

/// A map of the samples to take next: `need` scaled to a mean of one, no pixel getting more than kLargestShare.
Plane allot_samples(Plane need) {
  const double pixels = static_cast<double>(need.width()) * need.height();
  double scale = 1;
  // What the cap takes from some goes to the others.
  for (int round = 0; round < 32; ++round) {
    double capped = 0, rest = 0;
    for (int y = 0; y < need.height(); ++y)
      for (const float v : need.pixels(y))
        (v * scale >= kLargestShare ? capped : rest) += v * scale >= kLargestShare ? 1 : v;
    const double next = rest > 0 ? (pixels - capped * kLargestShare) / rest : scale;
    if (std::abs(next - scale) <= 1e-9 * next) break;
    scale = next;
  }
  for (int y = 0; y < need.height(); ++y)
    for (float& v : need.pixels(y)) v = std::min(static_cast<float>(v * scale), kLargestShare);
  return need;
}

std::vector<const Plane*> averaged_planes(const FilterFrame& frame) {
  std::vector<const Plane*> planes(frame.signal.begin(), frame.signal.end());
  if (frame.carries()) planes.insert(planes.end(), frame.values.begin(), frame.values.end());
  return planes;
}

/// The features after their own filter, and how far apart they may be.
class SmoothFeatures {
 public:
  SmoothFeatures(const SobelGuided& p, const std::vector<Feature>& features, const Plane& gradient, const Task& task) {
    const Plane* const gradient_guide[] = {&gradient};
    variances_.reserve(features.size());
    for (const Feature& f : features) {
      means_.push_back(guided_filter(pointers(f.mean), gradient_guide, kPrefilterRadius, p.epsilon, quiet(task)));
      variances_.push_back(sum_of(f.variance));
      // One constant for each kind, in the paper's order: texture, normal, depth.
      const float gamma = f.name == "gradient" || f.name == "normal"               ? p.gamma_2
                          : f.name == "scatter-depth" || f.name == "surface-depth" ? p.gamma_3
                                                                                   : p.gamma_1;
      gammas_.push_back(1 / (2 * gamma * gamma));
    }
    tolerance_ = make_plane(gradient.width(), gradient.height(), quiet(task), [&](int x, int y) {
      return std::min(gradient(x, y) * gradient(x, y), kLargestGradient) + kFeatureFloor;
    });
  }
  const std::vector<std::vector<Plane>>& means() const { return means_; }
  /// Each feature's distance times its own constant.
  WeightModel model_for_widths() const { return model(gammas_); }
  /// Plain distances, for candidates that scale all of them alike.
  WeightModel model_for_candidates() const { return model(std::vector<float>(gammas_.size(), 1.0f)); }

 private:
  WeightModel model(const std::vector<float>& scales) const {
    WeightModel model;
    for (size_t k = 0; k < means_.size(); ++k) {
      Distance d;
      d.kind = Distance::Kind::kRatio;
      d.guide = pointers(means_[k]);
      d.variance = {&variances_[k]};
      d.own = &tolerance_;
      d.floor = kFeatureFloor;
      d.scale = scales[k];
      model.distances.push_back(std::move(d));
    }
    return model;
  }

  std::vector<std::vector<Plane>> means_;
  std::vector<Plane> variances_;
  std::vector<float> gammas_;
  Plane tolerance_;
};

/// Each pixel's width, from curves through bias and variance at five of them.
Plane fitted_widths(const FilterFrame& frame, const SmoothFeatures& features, const Plane& light, const Plane& noise,
                    const std::vector<Offset>& window, const Task& task) {
  const int width = frame.width(), height = frame.height();
  std::vector<Variant> widths(kAlphas.size());
  for (size_t i = 0; i < kAlphas.size(); ++i) {
    const auto a = static_cast<float>(kAlphas[i]);
    for (const Offset& o : window) {
      const float r2 = static_cast<float>(o.dx * o.dx + o.dy * o.dy), radius = std::max(1.0f, 2.5f * a);
      const bool inside = static_cast<float>(std::max(std::abs(o.dx), std::abs(o.dy))) <= radius;
      widths[i].offsets.push_back(inside ? std::exp(-r2 / (2 * a * a)) : 0.0f);
    }
  }
  const Plane* const lights[] = {&light};
  const std::vector<Averages> tried =
      weighted_averages(features.model_for_widths(), window, widths, lights, &noise, task);
  std::vector<Plane> bias;
  for (const Averages& a : tried)
    bias.push_back(
        box_mean(make_plane(width, height, quiet(task), [&](int x, int y) { return a.values[0](x, y) - light(x, y); }),
                 1, task));
  const Plane alpha = make_plane(width, height, quiet(task), [&](int x, int y) {
    std::array<double, kAlphas.size()> b, v;
    for (size_t i = 0; i < kAlphas.size(); ++i) {
      b[i] = bias[i](x, y);
      v[i] = tried[i].noise(x, y);
    }
    const double n = std::max(frame.samples_at(x, y), 1.0);
    return static_cast<float>(best_pixel_width({kAlphas, b, v, n}, kSmallestAlpha, kLargestAlpha));
  });
  return gaussian_blur(alpha, 1, task);
}

/// A cross bilateral filter for each feature parameter: of the signal, and behind it of what is carried along.
std::vector<Averages> filter_candidates(const FilterFrame& frame, const SmoothFeatures& features, const Plane& alpha,
                                        const Plane& trusted, const Plane& noise, const std::vector<Offset>& window,
                                        const Task& task) {
  const int width = frame.width(), height = frame.height();
  const Plane place =
      make_plane(width, height, quiet(task), [&](int x, int y) { return 1 / (2 * alpha(x, y) * alpha(x, y)); });
  std::vector<Variant> variants;
  for (const float s : kFeatureSigmas) variants.push_back({1 / (2 * s * s), &place, {}});
  WeightModel model = features.model_for_candidates();
  if (!trusted.empty()) model.trust = &trusted;
  const std::vector<const Plane*> averaged = averaged_planes(frame);
  std::vector<Averages> candidates = weighted_averages(model, window, variants, averaged, &noise, task);
  if (trusted.empty()) return candidates;
  // Where no neighbour is trusted the 5 x 5 box of all stands in for the median, which no layer can be carried through.
  for (size_t c = 0; c < averaged.size(); ++c) {
    const Plane around = box_mean(*averaged[c], 2, task);
    for (Averages& a : candidates)
      for_each_pixel(width, height, quiet(task), [&](int x, int y) {
        if (a.weight(x, y) < 1e-8f) a.values[c](x, y) = around(x, y);
      });
  }
  return candidates;
}

/// What candidates are judged by: the picture guided by whichever feature explains it best.
/// @param dim  least brightness that a misfit is compared with
Rgb reference_picture(const SobelGuided& p, const FilterFrame& frame, const SmoothFeatures& features,
                      const Plane& light, float dim, const Task& task) {
  Rgb reference;
  std::vector<std::vector<Plane>> guided;
  std::vector<Plane> misfit;
  for (const std::vector<Plane>& f : features.means()) {
    guided.push_back(guided_filter(frame.signal, pointers(f), kPrefilterRadius, p.epsilon, quiet(task)));
    const Plane fit = luminance_of({&guided.back()[0], &guided.back()[1], &guided.back()[2]}, frame.space, task);
    misfit.push_back(box_mean(
        make_plane(light.width(), light.height(), quiet(task),
                   [&](int x, int y) { return std::abs(fit(x, y) - light(x, y)) / (std::abs(light(x, y)) + dim); }),
        2, task));
  }
  if (guided.empty()) {
    for (size_t c = 0; c < 3; ++c) reference[c] = box_mean(*frame.signal[c], kPrefilterRadius, task);
    return reference;
  }
  const std::vector<Plane> best = winners(misfit, task);
  for (size_t c = 0; c < 3; ++c) {
    std::vector<const Plane*> values;
    for (const std::vector<Plane>& g : guided) values.push_back(&g[c]);
    reference[c] = blend(values, best, task);
  }
  return reference;
}

/// A map for each candidate, of how much of it is taken: errors against the reference and winners both smoothed by
/// guided filters.
/// @param dark  least squared brightness that an error is compared with
std::vector<Plane> choice_maps(const SobelGuided& p, const std::vector<Averages>& candidates, const Rgb& reference,
                               float dark, const Task& task) {
  std::vector<Plane> errors;
  for (const Averages& a : candidates) {
    const Plane error = make_plane(reference[0].width(), reference[0].height(), quiet(task), [&](int x, int y) {
      float sum = 0;
      for (size_t c = 0; c < 3; ++c) {
        const float r = reference[c](x, y), d = a.values[c](x, y) - r;
        sum += d * d / (r * r + dark);
      }
      return sum < 3 * kLargestError ? sum / 3 : kLargestError;  // NaN, which huge pixels leave, counts as large
    });
    const Plane* const self[] = {&error};
    errors.push_back(std::move(guided_filter(self, self, kErrorRadius, p.epsilon, quiet(task))[0]));
  }
  std::vector<Plane> maps;
  for (const Plane& won : winners(errors, task)) {
    const Plane* const self[] = {&won};
    maps.push_back(std::move(guided_filter(self, self, kWinnerRadius, p.epsilon, quiet(task))[0]));
  }
  return maps;
}

/// How much each pixel would gain from more samples: its change and what is left of its noise, over its brightness.
Plane sampling_need(const Plane& clean, const Plane& light, const Plane& noise_left, float dark, const Task& task) {
  const Plane need = make_plane(clean.width(), clean.height(), quiet(task), [&](int x, int y) {
    const float d = clean(x, y) - light(x, y), c = clean(x, y);
    const float v = (d * d + noise_left(x, y)) / (c * c + dark);
    return v < kLargestNeed ? v : kLargestNeed;
  });
  return box_mean(need, 1, task);
}

void run(const SobelGuided& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  // The published 0.001 beside squared brightness belongs to pictures whose white is 1.
  const float dark = 1e-3f / static_cast<float>(frame.exposure * frame.exposure),
              dim = 1e-3f / static_cast<float>(frame.exposure);
  const Plane gradient = gradient_image(*frame.features, frame.width(), frame.height(), task);
  const SmoothFeatures features(p, *frame.features, gradient, task);
  task.report(0.05);

  const Plane light = luminance_of(frame.signal, frame.space, task);
  const Plane noise = make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
    const auto s = [&](size_t c) { return std::sqrt((*frame.variance[c])(x, y)); };
    const float sum = frame.space.luminance(vec3(s(0), s(1), s(2)));
    return sum * sum;
  });
  const Plane trusted = p.spikes == Spikes::kKeep ? Plane() : trust(light, gradient, frame.exposure, task);
  const std::vector<Offset> window = square_window(p.radius);
  const Plane alpha = fitted_widths(frame, features, light, noise, window, share(task, 0.05, 0.35));
  const std::vector<Averages> candidates =
      filter_candidates(frame, features, alpha, trusted, noise, window, share(task, 0.35, 0.9));
  const Rgb reference = reference_picture(p, frame, features, light, dim, task);
  const std::vector<Plane> maps = choice_maps(p, candidates, reference, dark, task);
  const size_t offset = frame.carries() ? 3 : 0;
  for (size_t c = 0; c < 3; ++c) {
    std::vector<const Plane*> values;
    for (const Averages& a : candidates) values.push_back(&a.values[c + offset]);
    *out[c] = blend(values, maps, task);
  }
  if (out.products) {
    std::vector<const Plane*> noises;
    for (const Averages& a : candidates) noises.push_back(&a.noise);
    (*out.products)[layer::sampling_map.channel(0)] = sampling_need(
        luminance_of({out[0], out[1], out[2]}, frame.space, task), light, blend(noises, maps, task), dark, task);
  }
  task.report(1);
}

const FilterEntry entry =
    declare<SobelGuided>(
        "sobel_guided",
        "Cross bilateral filter over features that a guided filter has cleaned along their Sobel gradients, its width fitted at every pixel.")
        .merit(2.8, "to learn where more samples are worth most: it writes `sampling_map`")
        .source(
            "Liu, Zheng, Zheng and Yuan 2018, Removing Monte Carlo noise using a Sobel operator and a guided image filter, sections 4 to 6")
        .notes(
            "The published fit takes the width 0.1 px into the variance's law of 1 / a^2, which a kernel that small does not follow, and leaves out the fitted constant of the bias; a fit that did neither lost on every frame tried. The published spike test (`spikes=literal`), one deviation, takes a third of plain noise for spikes; the default `keep` keeps the light of all. Media features: opacity, albedo and single scattering for the texture, the density gradient for the normal, depth for depth. The layer `sampling_map` says where the next samples are worth most.")
        .statistics(Statistics::kVariance)
        .features()
        .feature_set(&SobelGuided::feature_set)
        .paper("gamma-1=0.2,feature-set=all,spikes=literal")
        .carries()
        .produces(layer::sampling_map)
        .settles([](Layers& result) {
          const std::string channel = layer::sampling_map.channel(0);
          result.set(channel, allot_samples(result.at(channel)));
        })
        .param("radius", &SobelGuided::radius, {1, 40}, "px", "half width of the largest window", {10, 20})
        .param("epsilon", &SobelGuided::epsilon, {1e-8, 100}, "feature^2", "of the guided filters")
        .param("gamma-1", &SobelGuided::gamma_1, {0.01, 100}, "deviations",
               "of opacity, albedo and single scattering while the width is fitted", {0.2, 0.4})
        .param("gamma-2", &SobelGuided::gamma_2, {0.01, 100}, "deviations", "of the density gradient and the normal",
               {0.3, 1, 3})
        .param("gamma-3", &SobelGuided::gamma_3, {0.01, 100}, "deviations", "of depth")
        .param("spikes", &SobelGuided::spikes, {"literal", "keep"}, "what is taken for a spike", {"literal", "keep"})
        .scratch(90)
        .apron([](const SobelGuided& p) { return p.radius + 24; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
