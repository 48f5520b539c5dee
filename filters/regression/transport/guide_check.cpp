#include "filters/regression/transport/guide_check.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>

#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/inputs/extremes.h"
#include "filters/inputs/guide_layers.h"
#include "filters/inputs/half_pair.h"
#include "filters/regression/transport/lattice_regression.h"

namespace brume {
namespace {

constexpr float kLeastOpacity = 1e-3f;   // of a pixel of the medium
constexpr float kAlmostNothing = 1e-7f;  // weight of pixels that are predicted and not known
constexpr double kRidge = 2e-3, kGlobalRidge = 1e-4;
constexpr int kBlock = 16;  // side of the squares whose errors count as independent [px]

/// Two pictures that know nothing of each other's noise, and where each is known.
struct Trials {
  Plane a, b, weight_a, weight_b;
  bool halves;

  Trials(const Layers& frame, const Task& task) : halves(has_halves(frame, layer::beauty)) {
    const int width = frame.width(), height = frame.height();
    const FrameSpace space(frame);
    if (halves) {
      a = luminance_of(frame.rgb(layer::beauty, statistic::half_a), space, task);
      b = luminance_of(frame.rgb(layer::beauty, statistic::half_b), space, task);
      weight_a = weight_b = Plane(width, height, 1.0f);
      return;
    }
    a = b = luminance_of(frame.rgb(layer::beauty), space, task);
    weight_a = weight_b = Plane(width, height, kAlmostNothing);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) ((x + y) % 2 == 0 ? weight_a : weight_b)(x, y) = 1;
  }
  /// Squared error of the mean of both fits at a pixel, plus noise that is the same for all fits: each is held against
  /// what it did not know.
  double squared_error(const Plane& fit_a, const Plane& fit_b, int x, int y) const {
    const double of_a = static_cast<double>(b(x, y)) - fit_a(x, y), of_b = static_cast<double>(a(x, y)) - fit_b(x, y);
    const double apart = static_cast<double>(fit_a(x, y)) - fit_b(x, y);
    if (halves) return 0.5 * (of_a * of_a + of_b * of_b) - 0.25 * apart * apart;
    return weight_b(x, y) == 1 ? of_a * of_a : of_b * of_b;
  }
  /// The same where a pixel is left as it is.
  double squared_error_of_data(int x, int y) const {
    if (halves) return squared_error(a, b, x, y);
    // Noise twice: once of the pixel, once of what it is held against. Source of the mask: Immerkaer 1996, Fast noise
    // variance estimation.
    const int l = std::max(0, x - 1), r = std::min(a.width() - 1, x + 1);
    const int u = std::max(0, y - 1), d = std::min(a.height() - 1, y + 1);
    const double response = static_cast<double>(a(l, u) + a(r, u) + a(l, d) + a(r, d)) -
                            2.0 * static_cast<double>(a(x, u) + a(x, d) + a(l, y) + a(r, y)) +
                            4.0 * static_cast<double>(a(x, y));
    return response * response / 18;
  }
};

using Columns = std::vector<const Plane*>;

Plane fitted(const Plane& target, const Columns& columns, const Plane& weight, double window, const Task& task) {
  LatticeProblem problem;
  for (const Plane* column : columns) problem.columns.push_back({column});
  problem.columns = standardised(std::move(problem.columns), weight, task);
  problem.targets = {&target};
  problem.weight = &weight;
  const bool whole = window == 0;
  return std::move(
      lattice_regression(problem, {window, whole ? kGlobalRidge : kRidge, whole ? 0.0 : 1.0}, task).front());
}

struct Stage {
  double window;  // deviation [px]; 0: the frame
  const Columns* columns;
};

/// Fits in narrower and narrower windows, each to what the one before leaves.
/// @param mask  outside, pixels are left as they are
/// @param first  where to leave the mean of the first fit
/// @return  squared errors of the best of them
Plane best_errors(const Trials& trials, const std::vector<Stage>& stages, const Plane& mask, Plane& first,
                  const Task& task) {
  const int width = mask.width(), height = mask.height();
  Plane fit_a(width, height), fit_b(width, height), best;
  double least = std::numeric_limits<double>::infinity();
  for (const Stage& stage : stages) {
    const auto refine = [&](Plane& fit, Plane left, const Plane& weight) {
      add_to(left, -1, fit, task);
      add_to(fit, 1, fitted(left, *stage.columns, weight, stage.window, task), task);
    };
    refine(fit_a, trials.a, trials.weight_a);
    refine(fit_b, trials.b, trials.weight_b);
    if (&stage == &stages.front())
      first = make_plane(width, height, quiet(task), [&](int x, int y) { return 0.5f * (fit_a(x, y) + fit_b(x, y)); });
    Plane errors(width, height);
    double sum = 0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const double e = mask(x, y) > 0 ? trials.squared_error(fit_a, fit_b, x, y) : trials.squared_error_of_data(x, y);
        errors(x, y) = static_cast<float>(e);
        sum += e;
      }
    if (!(sum < least)) continue;
    least = sum;
    best = std::move(errors);
  }
  return best;
}

}  // namespace

GuideCheck check_guides(const Layers& given, const Task& task) {
  Layers frame(given.width(), given.height());
  frame.header = given.header;
  for (const auto& [name, plane] : given.channels()) {
    Plane& copy = frame.add(name);
    for (int y = 0; y < plane.height(); ++y)
      for (int x = 0; x < plane.width(); ++x) copy(x, y) = std::isfinite(plane(x, y)) ? plane(x, y) : 0.0f;
  }
  limit_extremes(frame, layer::beauty, find_extremes(frame, layer::beauty, task), task);
  const int width = frame.width(), height = frame.height();
  const Plane one(width, height, 1.0f);
  std::deque<Plane> made;
  Columns guides = {&one}, features = {&one}, few = {&one};
  Plane mask(width, height);  // where guides see something
  for (const Guide& guide : guides_of(frame)) {
    if (guide.kind == GuideClass::kPredicted || guide.kind == GuideClass::kMaterial) continue;
    if (guide.kind == GuideClass::kOpacity) few.push_back(&guide.channels[0].plane());
    const bool of_medium = guide.kind == GuideClass::kOpacity;
    if (of_medium || guide.kind == GuideClass::kSurface || guide.name == "normal")
      for (const ChannelView& channel : guide.channels)
        for_each_pixel(width, height, quiet(task), [&](int x, int y) {
          if (const float v = channel.plane()(x, y); of_medium ? v > kLeastOpacity : v != 0) mask(x, y) = 1;
        });
    if (guide.coloured)
      guides.push_back(&made.emplace_back(
          luminance_of({&guide.channels[0].plane(), &guide.channels[1].plane(), &guide.channels[2].plane()},
                       FrameSpace(frame), task)));
    else
      for (const ChannelView& channel : guide.channels) guides.push_back(&channel.plane());
  }
  for (const LayerName& l : find_filter("transport_regression").can_use)
    if (frame.has(l))
      for (const std::string& channel : l.channel_names()) features.push_back(&frame.at(channel));

  const Trials trials(frame, task);
  Plane level(width, height), ignored;
  few.push_back(&level);
  const Plane of_guides = best_errors(trials, {{0, &guides}, {16, &guides}, {4, &few}}, mask, level, task);
  const Plane of_features = best_errors(
      trials, {{0, &features}, {16, &features}, {8, &features}, {4, &features}, {2, &features}}, one, ignored, task);

  GuideCheck check;
  const double pixels = static_cast<double>(width) * height;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      check.guides += static_cast<double>(of_guides(x, y)) / pixels;
      check.features += static_cast<double>(of_features(x, y)) / pixels;
    }
  const double mean = check.guides - check.features;
  double squares = 0;
  for (int by = 0; by < height; by += kBlock)
    for (int bx = 0; bx < width; bx += kBlock) {
      double sum = 0;
      for (int y = by; y < std::min(height, by + kBlock); ++y)
        for (int x = bx; x < std::min(width, bx + kBlock); ++x)
          if (mask(x, y) > 0)
            sum += static_cast<double>(of_guides(x, y)) - static_cast<double>(of_features(x, y)) - mean;
      squares += sum * sum;
    }
  check.standard_error = std::sqrt(squares) / pixels;
  return check;
}

}  // namespace brume
