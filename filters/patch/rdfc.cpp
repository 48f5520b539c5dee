
#include "base/rng.h"
#include "filters/api/registry.h"
#include "filters/patch/neighbourhood.h"
#include "filters/patch/selection.h"

namespace brume {
namespace {

enum class Candidates { kWithColor, kPublished };

struct Rdfc {
  int search_radius = 10;
  float strength = 0.7f, feature_strength = 1;
  int second_pass = 1;
  Candidates candidates = Candidates::kWithColor;
  FeatureSet feature_set = FeatureSet::kScalar;
};

// Windows of the features' filter and of the error maps' (Rousselle, Manzi and Zwicker 2013, sections 4 and 5).
constexpr int kFeatureSearch = 5, kFeaturePatch = 3;
constexpr float kFeatureStrength = 1;
constexpr float kTau = 1e-3f, kFineTau = 1e-4f;

struct Candidate {
  int patch_radius;  // of the colour distance; -1: features alone
  float tau;         // of the features' distance; 0: colour alone
};
constexpr Candidate kPublished[] = {{1, kTau}, {3, kTau}, {-1, kFineTau}};
constexpr Candidate kWithColor[] = {{1, kTau}, {3, kTau}, {-1, kFineTau}, {1, 0}, {3, 0}};

Plane halves_noise(const Plane& a, const Plane& b, const Task& task) {
  return make_plane(a.width(), a.height(), quiet(task), [&](int x, int y) {
    const float d = a(x, y) - b(x, y);
    return 0.25f * d * d + 1e-12f;
  });
}

/// Features cleaned by non-local means, each half with the weights of the other, and the noise that is left.
std::vector<Feature> cleaned(const std::vector<Feature>& features, const Task& task) {
  std::vector<Feature> out;
  for (const Feature& f : features) {
    std::vector<Plane> variance;
    for (const Plane& v : f.variance)
      variance.push_back(make_plane(v.width(), v.height(), quiet(task), [&](int x, int y) { return 2 * v(x, y); }));
    const auto smooth = [&](const std::vector<Plane>& guide, const std::vector<Plane>& values) {
      WeightModel model;
      model.distances.push_back(noise_distance(pointers(guide), pointers(variance), kFeaturePatch, kFeatureStrength));
      return weighted_average(model, square_window(kFeatureSearch), pointers(values), quiet(task)).values;
    };
    Feature clean;
    clean.name = f.name;
    clean.half_a = smooth(f.half_b, f.half_a);
    clean.half_b = smooth(f.half_a, f.half_b);
    for (size_t c = 0; c < f.mean.size(); ++c) {
      clean.mean.push_back(make_plane(f.mean[c].width(), f.mean[c].height(), quiet(task), [&](int x, int y) {
        return 0.5f * (clean.half_a[c](x, y) + clean.half_b[c](x, y));
      }));
      clean.variance.push_back(box_mean(halves_noise(clean.half_a[c], clean.half_b[c], task), 1, task));
    }
    out.push_back(std::move(clean));
  }
  return out;
}

/// The candidates that compete; without features those with and without them are the same.
std::vector<Candidate> candidates_of(const Rdfc& p, bool features) {
  if (p.candidates == Candidates::kPublished || !features)
    return {std::begin(kPublished), std::end(kPublished) - (features ? 0 : 1)};
  return {std::begin(kWithColor), std::end(kWithColor)};
}

/// Distances of features with both tolerances.
struct FeatureModels {
  FeatureDistances coarse, fine;
};

/// Each candidate's halves, and its error at every pixel by Stein's risk.
struct Tried {
  std::vector<HalfPair> halves;
  std::vector<Plane> errors;
};

Tried try_candidates(const Rdfc& p, const FilterFrame& frame, const FeatureModels& features, bool any_features,
                     const Task& task) {
  const auto model_of = [&](const Candidate& candidate, const RgbPlanes& guide) {
    WeightModel model;
    model.join = WeightModel::Join::kLargest;
    if (candidate.patch_radius >= 0)
      model.distances.push_back(noise_distance(guide, frame.variance, candidate.patch_radius, p.strength));
    if (candidate.tau > 0) (candidate.tau == kTau ? features.coarse : features.fine).add_to(model);
    return model;
  };
  const std::vector<Offset> window = square_window(p.search_radius);
  const Nudged other = nudged(frame.signal, frame.variance, frame.origin, task);
  const float dark = 1e-6f / static_cast<float>(frame.exposure * frame.exposure);
  const std::vector<Candidate> candidates = candidates_of(p, any_features);
  const std::vector<const Plane*> halves = {frame.half_a[0], frame.half_a[1], frame.half_a[2],
                                            frame.half_b[0], frame.half_b[1], frame.half_b[2]};
  Tried tried;
  const double step = 1 / static_cast<double>(candidates.size());
  for (size_t i = 0; i < candidates.size(); ++i) {
    const double begin = static_cast<double>(i) * step;
    Averages f =
        weighted_average(model_of(candidates[i], frame.signal), window, halves, share(task, begin, begin + 0.6 * step));
    const Averages g = weighted_average(model_of(candidates[i], view(other.picture)), window, view(other.picture),
                                        share(task, begin + 0.6 * step, begin + step));
    tried.errors.push_back(make_plane(frame.width(), frame.height(), quiet(task), [&](int x, int y) {
      float sum = 0;
      for (size_t c = 0; c < 3; ++c) {
        const float v = (*frame.variance[c])(x, y), clean = 0.5f * (f.values[c](x, y) + f.values[c + 3](x, y));
        const float derivative = (g.values[c](x, y) - clean) / other.step[c](x, y);
        // In units of the noise and the picture, so that bright channels do not decide alone.
        sum += stein_risk(clean, (*frame.signal[c])(x, y), v, derivative) / (clean * clean + v + dark);
      }
      return sum;
    }));
    HalfPair& pair = tried.halves.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      pair.a[c] = std::move(f.values[c]);
      pair.b[c] = std::move(f.values[c + 3]);
    }
  }
  return tried;
}

/// Error maps, then the maps of the winners, smoothed with weights from the picture.
HalfPair best_of(const FilterFrame& frame, const Tried& tried, const Task& task) {
  WeightModel guide;
  guide.distances.push_back(noise_distance(frame.signal, frame.variance, kFeaturePatch, kFeatureStrength));
  const std::vector<Plane> errors =
      weighted_average(guide, square_window(1), pointers(tried.errors), quiet(task)).values;
  const std::vector<Plane> won = winners(errors, task);
  const std::vector<Plane> maps =
      weighted_average(guide, square_window(kFeatureSearch), pointers(won), quiet(task)).values;
  return blend(tried.halves, maps, task);
}

void run(const Rdfc& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const std::vector<Feature> features = cleaned(*frame.features, task);
  const FeatureModels models{{features, p.feature_strength, kTau, task},
                             {features, p.feature_strength, kFineTau, task}};
  task.report(0.15);
  const HalfPair chosen =
      best_of(frame, try_candidates(p, frame, models, !features.empty(), share(task, 0.15, 0.75)), task);
  Rgb mean, residual;
  for (size_t c = 0; c < 3; ++c) {
    mean[c] = make_plane(frame.width(), frame.height(), quiet(task),
                         [&](int x, int y) { return 0.5f * (chosen.a[c](x, y) + chosen.b[c](x, y)); });
    residual[c] = halves_noise(chosen.a[c], chosen.b[c], task);
  }
  task.report(0.8);
  if (p.second_pass == 0) {
    for (size_t c = 0; c < 3; ++c) *out[c] = std::move(mean[c]);
    task.report(1);
    return;
  }
  // A second, narrower pass cleans what the halves still differ by.
  WeightModel model;
  model.join = WeightModel::Join::kLargest;
  model.distances.push_back(noise_distance(view(mean), view(residual), kFeaturePatch, p.strength));
  if (p.candidates == Candidates::kPublished) models.fine.add_to(model);
  std::vector<Plane> clean =
      weighted_average(model, square_window(p.search_radius / 2), view(mean), share(task, 0.8, 1)).values;
  for (size_t c = 0; c < 3; ++c) *out[c] = std::move(clean[c]);
}

const FilterEntry entry =
    declare<Rdfc>(
        "rdfc",
        "Robust denoising with feature and colour information: three mixtures of both, chosen at each pixel by estimated risk.")
        .merit(4.7, "when some features help and others harm: it chooses at each pixel")
        .source("Rousselle, Manzi and Zwicker 2013, Robust Denoising using Feature and Color Information")
        .notes(
            "Weights are the smallest of the colour's and the features'. Candidates as published: colour patches of radius 1 and 3 with features, and features alone; in media, where no feature is flat, every one of them keeps noise, so that by default the two colour patches without features compete too. The derivative in the risk is taken with random signs on all pixels at once; the authors scale each pixel by 1.01, which is dead where it is black.")
        .statistics(Statistics::kHalves)
        .features()
        .feature_set(&Rdfc::feature_set)
        .paper("strength=0.45,feature-strength=0.6,feature-set=all,candidates=published")
        .seeded()
        .param("search-radius", &Rdfc::search_radius, {1, 40}, "px", "half width of the search window")
        .param("strength", &Rdfc::strength, {0.05, 100}, "1", "k_c, noise deviations of colour taken as equal",
               {0.45, 0.7, 1})
        .param("feature-strength", &Rdfc::feature_strength, {0.05, 100}, "1", "k_f, the same of features", {0.6, 1, 2})
        .param("second-pass", &Rdfc::second_pass, {0, 1}, "", "1: a narrower pass on the two halves' results")
        .param("candidates", &Rdfc::candidates, {"with-color", "published"},
               "colour alone competes too, or the three of the paper", {"with-color", "published"})
        .scratch(90)
        .apron([](const Rdfc& p) { return 8 + p.search_radius + 3 + 8 + p.search_radius / 2 + 3; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
