#include "filters/regression/regression_input.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/text.h"
#include "filters/regression/half_pairs.h"
#include "filters/regression/lattice_regression.h"

namespace brume {
namespace {

constexpr int kLevelRadius = 1;
// From neighbours that are more times as bright, as in a highlight, less is taken over.
constexpr float kBrighter = 2;

/// share * samples / (brightness + a share of its mean)^power within the mask, both relative to their means.
/// @param samples  of each pixel, relative to the mean; empty: alike
Plane weight_of(const Plane& level, const Plane& mask, float power, float share, const Plane& samples,
                const Task& task) {
  double sum = 0, count = 0;
  for (int y = 0; y < level.height(); ++y)
    for (int x = 0; x < level.width(); ++x)
      if (mask(x, y) > 0) {
        sum += static_cast<double>(std::max(0.0f, level(x, y)));
        ++count;
      }
  const float scale = sum > 0 ? static_cast<float>(count / sum) : 0.0f;
  return make_plane(level.width(), level.height(), quiet(task), [&](int x, int y) {
    if (!(mask(x, y) > 0)) return 0.0f;
    const float pixel = samples.empty() ? share : share * samples(x, y);
    return pixel * std::pow(scale * std::max(0.0f, level(x, y)) + kDark, -power);
  });
}

/// Two inputs from one, for frames without halves: each has the pixels of one colour of a chessboard, and between
/// them what the fit says there and the mean of what it misses at the four neighbours, less where the fit
/// is much brighter there. Their noise is independent where the noise of neighbouring pixels is.
HalfPair chessboard_halves(const Rgb& data, const Rgb& fit, const Plane& mask, const Task& task) {
  const int width = mask.width(), height = mask.height();
  constexpr int kNext[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
  HalfPair out{data, data};
  for_each_row(height, quiet(task), [&](int y) {
    for (int x = 0; x < width; ++x) {
      if (!(mask(x, y) > 0)) continue;
      Rgb& half = (x + y) % 2 == 0 ? out.b : out.a;
      const auto share_of = [&](size_t c, int u, int v) {
        const float here = std::abs(fit[c](x, y)), there = std::abs(fit[c](u, v));
        return there > kBrighter * here ? kBrighter * here / there : 1.0f;
      };
      for (size_t c = 0; c < 3; ++c) {
        float missed = 0, count = 0;
        for (const auto& [dx, dy] : kNext) {
          const int u = x + dx, v = y + dy;
          if (u < 0 || v < 0 || u >= width || v >= height || !(mask(u, v) > 0)) continue;
          missed += share_of(c, u, v) * (data[c](u, v) - fit[c](u, v));
          ++count;
        }
        half[c](x, y) = fit[c](x, y) + (count > 0 ? missed / count : 0.0f);
      }
    }
  });
  return out;
}

}  // namespace

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

void regress(const RegressionInputs& inputs, ColourColumns TransportColumns::*which, const std::vector<Halves>& targets,
             const LatticeWindow& window, const TakeFit& take, const Task& task) {
  const auto solve = [&](const std::vector<size_t>& colours) {
    const auto pixels = [&](size_t i) {
      LatticePixels known{(inputs[i].known.*which).of[colours[0]], {}, &inputs[i].weight};
      for (const size_t c : colours) {
        known.targets.push_back(targets[i].a[c]);
        known.targets.push_back(targets[i].b[c]);
      }
      return known;
    };
    const auto hand_on = [&](size_t i, std::vector<Plane> found) {
      for (size_t k = 0; k < colours.size(); ++k)
        take(i, colours[k], std::move(found[2 * k]), std::move(found[2 * k + 1]));
    };
    LatticeProblem problem{pixels(0), (inputs[0].known.*which).free};
    for (size_t i = 1; i < targets.size(); ++i) problem.nearby.push_back(pixels(i));
    const auto nearby = [&](size_t i, std::vector<Plane> found) { hand_on(i + 1, std::move(found)); };
    hand_on(0, lattice_regression(problem, window, task, nearby));
  };
  if ((inputs[0].known.*which).coloured)
    for (size_t c = 0; c < 3; ++c) solve({c});
  else
    solve({0, 1, 2});
}

std::vector<Halves> left_of(const RegressionInputs& inputs, size_t count) {
  std::vector<Halves> left;
  for (size_t i = 0; i < count; ++i) left.push_back({view(inputs[i].left.a), view(inputs[i].left.b)});
  return left;
}

ClampedHalves clamped_inputs(RegressionInputs& inputs, float power, double limit, const Task& task) {
  std::vector<Halves> seen;
  for (RegressionInput& q : inputs) {
    q.weight = weight_of(q.known.bright, q.known.mask, power, q.share, q.samples, task);
    seen.push_back(q.seen);
  }
  TransportColumns& own = inputs[0].known;
  for (ColourColumns* columns : {&own.predicted, &own.shape, &own.all}) columns->standardise(inputs[0].weight, task);
  for (RegressionInput& q : inputs) q.known.scale_like(own);
  std::vector<HalfPair> fits(inputs.size());
  const auto keep = [&](size_t i, size_t c, Plane a, Plane b) {
    fits[i].a[c] = std::move(a);
    fits[i].b[c] = std::move(b);
  };
  regress(inputs, &TransportColumns::all, seen, {0, kGlobalRidge, 0}, keep, task);
  ClampedHalves own_data;
  for (size_t i = 0; i < inputs.size(); ++i) {
    RegressionInput& q = inputs[i];
    ClampedHalves clamped = clamp_outliers(q.seen.a, q.seen.b, mean(fits[i], task), brightness(fits[i], task),
                                           q.known.mask, limit, q.halves, task);
    q.left = q.halves ? HalfPair{std::move(clamped.a), std::move(clamped.b)}
                      : chessboard_halves(clamped.a, fits[i].a, q.known.mask, task);
    fits[i] = {};
    if (i == 0) own_data = {q.left.a, q.left.b, std::move(clamped.taken), std::move(clamped.points)};
  }
  return own_data;
}

void weigh_by_fits(RegressionInputs& inputs, float power, const std::vector<HalfPair>& before, const Task& task) {
  for (size_t i = 0; i < inputs.size(); ++i) {
    RegressionInput& q = inputs[i];
    HalfPair fit = before[i];
    for (size_t c = 0; c < 3; ++c) {
      add_to(fit.a[c], -1, q.left.a[c], task);
      add_to(fit.b[c], -1, q.left.b[c], task);
    }
    q.level = box_mean(brightness(fit, task), kLevelRadius, task);
    q.weight = weight_of(q.level, q.known.mask, power, q.share, q.samples, task);
    q.known.few.add(q.level);
    q.known.medium.add(q.level);
  }
  TransportColumns& own = inputs[0].known;
  own.few.standardise(inputs[0].weight, task);
  own.medium.standardise(inputs[0].weight, task);
  for (RegressionInput& q : inputs) q.known.scale_like(own);
}

}  // namespace brume
