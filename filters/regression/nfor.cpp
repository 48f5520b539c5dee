#include <algorithm>
#include <deque>

#include "filters/api/registry.h"
#include "filters/patch/selection.h"
#include "filters/regression/regression.h"

namespace brume {
namespace {

struct Nfor {
  int search_radius = 9, patch_radius = 3;
  float strength_1 = 0.5f, strength_2 = 1;
  float final_strength = 1;
  FeatureSet feature_set = FeatureSet::kAll;
};

// Windows of the features' and the errors' own filters (Bitterli et al. 2016, section 5).
constexpr int kFeatureSearch = 5, kFeaturePatch = 3, kFinalFeatureSearch = 2, kErrorPatch = 1;
constexpr float kFeatureStrength = 0.5f, kErrorStrength = 1;

Rgb rgb_of(std::vector<Plane> planes) {
  return {std::move(planes[0]), std::move(planes[1]), std::move(planes[2])};
}

std::vector<Plane> scaled(const std::vector<Plane>& planes, float factor, const Task& task) {
  std::vector<Plane> out;
  for (const Plane& p : planes)
    out.push_back(make_plane(p.width(), p.height(), quiet(task), [&](int x, int y) { return factor * p(x, y); }));
  return out;
}

bool is_free_of_noise(const Feature& f) {
  for (const Plane& v : f.variance)
    for (int y = 0; y < v.height(); ++y)
      for (const float value : v.pixels(y))
        if (value > 0) return false;
  return true;
}

Plane mean_of(const Plane& a, const Plane& b, const Task& task) {
  return make_plane(a.width(), a.height(), quiet(task), [&](int x, int y) { return 0.5f * (a(x, y) + b(x, y)); });
}

Plane half_difference_squared(const Plane& a, const Plane& b, const Task& task) {
  return make_plane(a.width(), a.height(), quiet(task), [&](int x, int y) {
    const float d = a(x, y) - b(x, y);
    return 0.25f * d * d + 1e-12f;
  });
}

/// A frame whose features are filtered, each half with the other's weights, and the mean of both for the last step.
struct Prefiltered {
  const FilterFrame* frame;
  std::vector<Plane> features_a, features_b, final_features;
  Rgb variance;  // of a half

  Prefiltered(const FilterFrame& of, const Task& task) : frame(&of) {
    for (const Feature& f : *of.features) add(f, task);
    for (size_t c = 0; c < 3; ++c)
      variance[c] = make_plane(of.width(), of.height(), quiet(task),
                               [&](int x, int y) { return 2.0f * (*of.variance[c])(x, y); });
  }
  Noisy noisy_a() const { return {frame->half_a, view(variance)}; }
  Noisy noisy_b() const { return {frame->half_b, view(variance)}; }

 private:
  void add(const Feature& f, const Task& task) {
    std::vector<Plane> fa, fb;
    if (is_free_of_noise(f)) {
      fa = f.half_a;
      fb = f.half_b;
    } else {
      const std::vector<Plane> twice = scaled(f.variance, 2, task);
      const auto smooth = [&](const std::vector<Plane>& guide, const std::vector<Plane>& values) {
        WeightModel model;
        model.distances.push_back(noise_distance(pointers(guide), pointers(twice), kFeaturePatch, kFeatureStrength));
        return weighted_average(model, square_window(kFeatureSearch), pointers(values), quiet(task)).values;
      };
      fa = smooth(f.half_b, f.half_a);
      fb = smooth(f.half_a, f.half_b);
    }
    // For the last step both halves are averaged and smoothed; half their squared difference is the noise left.
    std::vector<Plane> mean, residual;
    for (size_t c = 0; c < fa.size(); ++c) {
      mean.push_back(mean_of(fa[c], fb[c], task));
      residual.push_back(half_difference_squared(fa[c], fb[c], task));
    }
    WeightModel model;
    model.distances.push_back(noise_distance(pointers(mean), pointers(residual), kFeaturePatch, kFeatureStrength));
    for (Plane& plane : weighted_average(model, square_window(kFinalFeatureSearch), pointers(mean), quiet(task)).values)
      final_features.push_back(std::move(plane));
    for (Plane& plane : fa) features_a.push_back(std::move(plane));
    for (Plane& plane : fb) features_b.push_back(std::move(plane));
  }
};

std::vector<const Plane*> list(const RgbPlanes& planes) {
  return {planes.begin(), planes.end()};
}

void run(const Nfor& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  // Step 1: the features, of the frame to clean first.
  std::deque<Prefiltered> frames;
  frames.emplace_back(frame, task);
  for (const FilterFrame* other : frame.nearby) frames.emplace_back(*other, task);
  task.report(0.1);

  // Step 2: regress each half with weights and features of the other.
  const float strengths[] = {p.strength_1, p.strength_2};
  std::vector<HalfPair> candidates;
  for (size_t k = 0; k < 2; ++k) {
    const auto regress = [&](bool half_a, int step) {
      const auto weights_from = [&](const Prefiltered& f) { return half_a ? f.noisy_b() : f.noisy_a(); };
      std::vector<RegressionFrame> stack;
      for (const Prefiltered& f : frames) {
        RegressionFrame& of = stack.emplace_back();
        of.model.distances.push_back(
            noise_distance(weights_from(frames[0]), weights_from(f), p.patch_radius, strengths[k]));
        of.features = pointers(half_a ? f.features_b : f.features_a);
        of.values = list(half_a ? f.frame->half_a : f.frame->half_b);
      }
      return rgb_of(
          collaborative_regression(stack, p.search_radius, share(task, 0.1 + 0.17 * step, 0.1 + 0.17 * (step + 1))));
    };
    candidates.push_back(
        {regress(/*half_a=*/true, static_cast<int>(2 * k)), regress(/*half_a=*/false, static_cast<int>(2 * k + 1))});
  }

  // Step 3: per pixel the candidate with the smaller error, which each half measures on the other.
  HalfPair chosen = select_by_halves(candidates, frame.half_a, frame.half_b, frame.variance,
                                     {p.search_radius, kErrorPatch, kErrorStrength}, frame.signal, quiet(task));
  task.report(0.8);

  // Step 4: one more regression on their mean, whose noise is what the halves still differ by.
  Rgb mean, residual;
  for (size_t c = 0; c < 3; ++c) {
    mean[c] = mean_of(chosen.a[c], chosen.b[c], task);
    residual[c] = half_difference_squared(chosen.a[c], chosen.b[c], task);
  }
  RegressionFrame last;
  last.model.distances.push_back(noise_distance(view(mean), view(residual), p.patch_radius, p.final_strength));
  last.features = pointers(frames[0].final_features);
  last.values = list(view(mean));
  std::vector<Plane> result = collaborative_regression({&last, 1}, p.search_radius, share(task, 0.8, 1));
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(result[c]);
}

const FilterEntry entry =
    declare<Nfor>(
        "nfor",
        "Nonlinearly weighted first-order regression: in every window a line in position and features, weighted by non-local means.")
        .merit(5.6, "first: the cleanest result from what `brume render` records by itself; the slowest but one")
        .source("Bitterli et al. 2016, algorithm 1")
        .notes(
            "Two strengths of the colour weights are tried on each half image with the weights of the other, the better is chosen at each pixel by the error that each half measures on the other, and a last regression cleans their mean. Where the authors' pseudocode takes the weights from the same half, their text and we take them from the other, whose noise is independent.")
        .statistics(Statistics::kHalves)
        .features()
        .aligned_sequences()
        .feature_set(&Nfor::feature_set)
        .paper("")
        .preset("guides", "for the guides that the renderer computes, found on the same scenes as the defaults",
                "feature-set=guides,strength-1=0.8,strength-2=4,final-strength=4")
        .param("search-radius", &Nfor::search_radius, {1, 20}, "px", "half width of a window")
        .param("patch-radius", &Nfor::patch_radius, {0, 8}, "px", "half width of a patch")
        .param("strength-1", &Nfor::strength_1, {0.05, 100}, "1", "k of the first candidate", {0.5, 0.8})
        .param("strength-2", &Nfor::strength_2, {0.05, 100}, "1", "k of the second candidate", {1, 2})
        .param("final-strength", &Nfor::final_strength, {0.05, 100}, "1", "k of the last regression", {1, 2})
        .scratch(70)
        .apron([](const Nfor& p) { return 4 * p.search_radius + 3 * p.patch_radius + 12; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
