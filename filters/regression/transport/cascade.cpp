#include "filters/regression/transport/cascade.h"

#include "filters/regression/transport/outliers.h"

namespace brume {
namespace {

// Ridges per pixel of the fits to the whole frame, one after another: what few samples can tell of many columns first.
constexpr double kRidgesOfFrame[] = {1e4, 1};
constexpr int kLevelRadius = 1;  // over which the brightness found is averaged [px]

/// Fits to what the ones before leave, one after another.
struct Fits {
  RegressionInputs& inputs;
  const Task& task;
  HalfPair sum;                        // of all so far, of the frame to clean
  std::vector<StoredPair> candidates;  // the sum after each

  Fits(RegressionInputs& of, const Task& task_) : inputs(of), task(task_) {
    for (Rgb* half : {&sum.a, &sum.b})
      for (Plane& plane : *half) plane = Plane(of[0].known.mask.width(), of[0].known.mask.height());
  }
  void refine(const FitStep& step) {
    const auto left = [](const RegressionInput& q) { return std::array{view(q.left.a), view(q.left.b)}; };
    std::vector<std::vector<HalfPair>> found(1 + step.window.then.size(), std::vector<HalfPair>(inputs.size()));
    const auto keep = [&](size_t m, size_t i, size_t c, Plane a, Plane b) {
      found[m][i].a[c] = std::move(a);
      found[m][i].b[c] = std::move(b);
    };
    fit(inputs, step, left, keep, task);
    for (std::vector<HalfPair>& of_inputs : found) {
      for (size_t i = 0; i < inputs.size(); ++i) add_to(inputs[i].left, -1, of_inputs[i], task);
      add_to(sum, 1, of_inputs[0], task);
      of_inputs.clear();
      candidates.emplace_back(sum, task);
    }
  }
  /// The same, after which only the candidates stay.
  void refine_aside(const std::vector<FitStep>& steps) {
    std::vector<HalfPair> left;
    for (const RegressionInput& q : inputs) left.push_back(q.left);
    HalfPair before = sum;
    for (const FitStep& step : steps) refine(step);
    sum = std::move(before);
    for (size_t i = 0; i < left.size(); ++i) inputs[i].left = std::move(left[i]);
  }
};

/// Weighs pixels by the brightness that the fits found, averaged over a few pixels, as weights must not follow what a
/// guide holds of noise; and makes it a column of what is fitted in narrow windows.
/// @param data  what was left at first
void weigh_by_fits(RegressionInputs& inputs, float power, const std::vector<HalfPair>& data, const Task& task) {
  constexpr Fit kNarrow[] = {Fit::kMedium, Fit::kFew};
  for (size_t i = 0; i < inputs.size(); ++i) {
    RegressionInput& q = inputs[i];
    HalfPair found = data[i];
    add_to(found, -1, q.left, task);
    q.level = box_mean(brightness(found, q.known.space, task), kLevelRadius, task);
    q.weigh_by(q.level, power, task);
    for (const Fit narrow : kNarrow) q.known[narrow].add(q.level);
  }
  TransportColumns& own = inputs[0].known;
  for (const Fit narrow : kNarrow) own[narrow].standardise(inputs[0].weight, task);
  for (RegressionInput& q : inputs) q.known.scale_like(own);
}

/// The fits of the frame to clean, and the mean over all frames of what their fits miss.
HalfPair mean_over_frames(const RegressionInputs& inputs, const HalfPair& fits, const Task& task) {
  float shares = 0;
  for (const RegressionInput& q : inputs) shares += q.share;
  HalfPair mean = fits;
  for (const RegressionInput& q : inputs) add_to(mean, q.share / shares, q.left, task);
  return mean;
}

}  // namespace

std::vector<StoredPair> cascade(RegressionInputs& inputs, const CascadeSettings& settings,
                                std::optional<HalfPair>& over_frames, const Task& task) {
  Fits fits(inputs, task);
  std::vector<HalfPair> data;
  for (const RegressionInput& q : inputs) data.push_back(q.left);
  const auto window = [&](double share) {
    return LatticeWindow{settings.window * share, settings.ridge, settings.ridge_per_pixel};
  };
  if (const Rgb& expected = inputs[0].known.expected; !expected[0].empty())
    fits.candidates.emplace_back(HalfPair{expected, expected}, task);
  fits.refine({Fit::kPredicted, {0, kGlobalRidge, 0}, inputs[0].known[Fit::kPredicted].size()});
  std::vector<FitStep> shapes = {{Fit::kShape, window(1)}};
  if (settings.narrow_shapes) shapes.push_back({Fit::kShape, window(0.25)});
  fits.refine_aside(shapes);
  task.report(0.35);
  fits.refine({Fit::kAll, {0, kGlobalRidge, kRidgesOfFrame[0], {kRidgesOfFrame[1]}}});
  weigh_by_fits(inputs, settings.power, data, task);
  data.clear();
  fits.refine({Fit::kAll, window(1)});
  task.report(0.5);
  fits.refine({Fit::kMedium, window(0.5)});
  fits.refine({Fit::kFew, window(0.25)});
  task.report(0.6);
  if (inputs.size() == 1) return std::move(fits.candidates);
  over_frames = mean_over_frames(inputs, fits.sum, task);
  // What the frame shows that those nearby do not, as where a light changes.
  while (inputs.size() > 1) inputs.pop_back();
  fits.refine({Fit::kAll, window(1)});
  return std::move(fits.candidates);
}

}  // namespace brume
