#include "filters/regression/transport/input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/text.h"

namespace brume {

RegressionInput::RegressionInput(const FilterFrame& frame, const Plane& one, float share_, const Task& task)
    : known(frame, one, task),
      share(share_),
      halves(frame.half_a[0] != nullptr && (frame.samples == 0 || frame.samples >= 2)),
      half_a(halves ? frame.half_a : frame.signal),
      half_b(halves ? frame.half_b : frame.signal) {
  if (frame.samples > 0 && frame.sample_count)
    samples = make_plane(frame.width(), frame.height(), quiet(task),
                         [&](int x, int y) { return static_cast<float>(frame.samples_at(x, y) / frame.samples); });
}

void RegressionInput::weigh_by(const Plane& brightness, float power, const Task& task) {
  double sum = 0, count = 0;
  for (int y = 0; y < brightness.height(); ++y)
    for (int x = 0; x < brightness.width(); ++x)
      if (known.mask(x, y) > 0) {
        sum += static_cast<double>(std::max(0.0f, brightness(x, y)));
        ++count;
      }
  const float scale = sum > 0 ? static_cast<float>(count / sum) : 0.0f;
  weight = make_plane(brightness.width(), brightness.height(), quiet(task), [&](int x, int y) {
    if (!(known.mask(x, y) > 0)) return 0.0f;
    const float pixel = samples.empty() ? share : share * samples(x, y);
    return pixel * std::pow(scale * std::max(0.0f, brightness(x, y)) + kDark, -power);
  });
}

RegressionInputs inputs_of(float frames, const FilterFrame& frame, const Plane& one, const Task& task) {
  RegressionInputs inputs;
  inputs.emplace_back(frame, one, 1.0f, task);
  for (const FilterFrame* other : frame.nearby) {
    const float apart = static_cast<float>(other->distance) / frames;
    const float samples =
        frame.samples > 0 && other->samples > 0 ? static_cast<float>(other->samples / frame.samples) : 1.0f;
    inputs.emplace_back(*other, one, samples * std::exp(-0.5f * apart * apart), task);
    if (inputs.back().known.names != inputs[0].known.names)
      throw InputError(fmt::format(
          "the frame at {:+} of the sequence: its guides are {}, those of the frame to clean {}; record the same layers in every frame",
          other->distance, join(inputs.back().known.names), join(inputs[0].known.names)));
  }
  return inputs;
}

void fit(const RegressionInputs& inputs, const FitStep& step,
         const std::function<std::array<RgbPlanes, 2>(const RegressionInput&)>& halves, const TakeFit& take,
         const Task& task) {
  const auto solve = [&](const std::vector<size_t>& colours) {
    const auto pixels = [&](const RegressionInput& q) {
      LatticePixels known{q.known[step.columns].of[colours[0]], {}, &q.weight};
      const auto [a, b] = halves(q);
      for (const size_t c : colours) known.targets.insert(known.targets.end(), {a[c], b[c]});
      return known;
    };
    const auto hand_on = [&](size_t i, std::vector<Plane> found) {
      for (size_t k = 0; k < found.size() / 2; ++k)
        take(k / colours.size(), i, colours[k % colours.size()], std::move(found[2 * k]), std::move(found[2 * k + 1]));
    };
    LatticeProblem problem{pixels(inputs[0]), step.free};
    for (size_t i = 1; i < inputs.size(); ++i) problem.nearby.push_back(pixels(inputs[i]));
    const auto nearby = [&](size_t i, std::vector<Plane> found) { hand_on(i + 1, std::move(found)); };
    hand_on(0, lattice_regression(problem, step.window, task, nearby));
  };
  if (inputs[0].known[step.columns].coloured)
    for (size_t c = 0; c < 3; ++c) solve({c});
  else
    solve({0, 1, 2});
}

}  // namespace brume
