#include "filters/regression/cascade.h"

#include "filters/regression/half_pairs.h"
#include "filters/regression/lattice_regression.h"

namespace brume {
namespace {

// Ridges per pixel of the fits to the whole frame, one after another: what few samples can tell of many columns first.
constexpr double kRidgesOfFrame[] = {1e4, 1};

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
  void refine(ColourColumns TransportColumns::*which, const LatticeWindow& window) {
    const auto take = [&](size_t i, size_t c, Plane a, Plane b) {
      RegressionInput& q = inputs[i];
      q.explain(c, a, b, task);
      if (i > 0) return;
      add_to(sum.a[c], 1, a, task);
      add_to(sum.b[c], 1, b, task);
    };
    regress(inputs, which, left_of(inputs, inputs.size()), window, take, task);
    candidates.emplace_back(sum, task);
  }
  /// The same, after which only the candidates stay.
  void refine_aside(ColourColumns TransportColumns::*which, const std::vector<LatticeWindow>& windows) {
    std::vector<HalfPair> left;
    for (const RegressionInput& q : inputs) left.push_back(q.left);
    HalfPair before = sum;
    for (const LatticeWindow& window : windows) refine(which, window);
    sum = std::move(before);
    for (size_t i = 0; i < left.size(); ++i) inputs[i].left = std::move(left[i]);
  }
};

/// The fits of the frame to clean, and the mean over all frames of what their fits miss.
HalfPair mean_over_frames(const RegressionInputs& inputs, const HalfPair& fits, const Task& task) {
  float shares = 0;
  for (const RegressionInput& q : inputs) shares += q.share;
  HalfPair mean = fits;
  for (const RegressionInput& q : inputs)
    for (size_t c = 0; c < 3; ++c) {
      add_to(mean.a[c], q.share / shares, q.left.a[c], task);
      add_to(mean.b[c], q.share / shares, q.left.b[c], task);
    }
  return mean;
}

}  // namespace

std::vector<StoredPair> cascade(RegressionInputs& inputs, const CascadeSettings& settings,
                                std::optional<HalfPair>& over_frames, const Task& task) {
  Fits fits(inputs, task);
  std::vector<HalfPair> before;
  for (const RegressionInput& q : inputs) before.push_back(q.left);
  const auto window = [&](double deviation) {
    return LatticeWindow{deviation, settings.ridge, settings.ridge_per_pixel};
  };
  const double widest = settings.window;
  fits.refine(&TransportColumns::predicted, {0, kGlobalRidge, 0});
  fits.refine_aside(&TransportColumns::shape, {window(widest), window(widest / 2), window(widest / 4)});
  task.report(0.35);
  for (RegressionInput& q : inputs) q.known.all.free = 0;
  for (const double ridge : kRidgesOfFrame) fits.refine(&TransportColumns::all, {0, kGlobalRidge, ridge});
  weigh_by_fits(inputs, settings.power, before, task);
  before.clear();
  fits.refine(&TransportColumns::all, window(widest));
  task.report(0.5);
  fits.refine(&TransportColumns::medium, window(widest / 2));
  fits.refine(&TransportColumns::few, window(widest / 4));
  task.report(0.6);
  if (inputs.size() == 1) return std::move(fits.candidates);
  over_frames = mean_over_frames(inputs, fits.sum, task);
  // What the frame shows that those nearby do not, as where a light changes.
  while (inputs.size() > 1) inputs.pop_back();
  fits.refine(&TransportColumns::all, window(widest));
  return std::move(fits.candidates);
}

}  // namespace brume
