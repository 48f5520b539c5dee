#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/regression/transport/cascade.h"
#include "filters/regression/transport/error_estimate.h"
#include "filters/regression/transport/local_lines.h"
#include "filters/regression/transport/mixing.h"
#include "filters/regression/transport/outliers.h"
#include "filters/regression/transport/stacking.h"

namespace brume {
namespace {

struct TransportRegression {
  float window = 16;
  float ridge = 2e-3f, ridge_per_pixel = 1;
  float stacking_window = 28, caution = 5000;
  float limit = 8;
  float weight_power = 1.2f;
  float frames = 2;
};

// Gaussian windows of local means of what a result misses [px], and of the brightness that errors are relative to.
constexpr double kLocalMeans[] = {1, 2, 4}, kLightWindow = 1.5;
// Standard errors by which fits and data must be better than what guides predict before they take weight from it.
constexpr double kDoubt = 0.5;
// With fewer samples per pixel, fits of many columns in narrow windows only follow the noise, and so do local lines,
// unless the guides fail so that more than this share of the data's squared error is left.
constexpr double kFewSamples = 8, kMostLeft = 0.15;

void say_what_is_missing(const FilterFrame& frame, bool guided, bool halves, std::vector<std::string>& notes) {
  const bool foreign = !frame.layers.text(kForeignRenderer).empty();
  if (!guided && !frame.all_guides)
    notes.push_back(fmt::format(
        "the frame has no guides: two to four times the error of a frame with them, and more than other filters leave. {}",
        foreign ? "Make them with: brume guides --like FRAME.exr --scene SCENE.toml -o GUIDES.exr"
                : "Record them with: brume render SCENE -o OUT.exr --layers direct,indirect,guides"));
  if (!halves)
    notes.push_back(fmt::format(
        "{} to judge by: fits are judged by pixels left out, which takes the noise of neighbouring pixels to be independent",
        frame.layers.number("samplesPerPixel").value_or(frame.samples) == 1 ? "one sample per pixel makes no two halves"
                                                                            : "the frame has no half images"));
}

/// The result within a box plus what it misses of the data, averaged over a Gaussian window of so many pixels.
HalfPair with_local_mean(const HalfPair& result, const HalfPair& data, const Box& box, double window,
                         const Task& task) {
  const auto corrected = [&](const Rgb& half, const Rgb& of) {
    Rgb out;
    for (size_t c = 0; c < 3; ++c) {
      out[c] = make_plane(half[c].width(), half[c].height(), quiet(task),
                          [&](int x, int y) { return of[c](box.x0 + x, box.y0 + y) - half[c](x, y); });
      out[c] = gaussian_blur(out[c], window, task);
      add_to(out[c], 1, half[c], task);
    }
    return out;
  };
  return {corrected(result.a, data.a), corrected(result.b, data.b)};
}

/// Squared error of a result, its bias and its noise as both halves show them, over that of the data.
double error_left(const HalfPair& result, const HalfPair& data, const Plane& weight) {
  double left = 0, noise = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < weight.height(); ++y)
      for (int x = 0; x < weight.width(); ++x) {
        const float a = data.a[c](x, y), b = data.b[c](x, y), ta = result.a[c](x, y), tb = result.b[c](x, y);
        left += static_cast<double>(weight(x, y) * ((a - ta) * (b - tb) + 0.25f * (ta - tb) * (ta - tb)));
        noise += static_cast<double>(weight(x, y) * 0.25f * (a - b) * (a - b));
      }
  return noise > 0 ? left / noise : 0.0;
}

/// Moves what the fits say together to what single fits, the data and their local means say where those prove better.
/// @param over_frames  of a sequence, the data with the noise of its frames' mean
/// @param few          whether there are few samples
void improve(HalfPair& result, const std::vector<StoredPair>& candidates, const HalfPair& data,
             const std::optional<HalfPair>& over_frames, const TransportColumns& known, bool few, const Task& task) {
  const int width = known.mask.width(), height = known.mask.height();
  // Relative errors, as CIE-Lab sees them.
  const Plane light = gaussian_blur(brightness(result, known.space, task), kLightWindow, task);
  double sum = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) sum += known.mask(x, y) * std::abs(static_cast<double>(light(x, y)));
  const float scale = sum > 0 ? static_cast<float>(sum_of(known.mask) / sum) : 0.0f;
  const Plane weight = make_plane(width, height, quiet(task), [&](int x, int y) {
    return known.mask(x, y) > 0 ? std::pow(scale * std::abs(light(x, y)) + 0.05f, -4.0f / 3) : 0.0f;
  });
  const std::vector<MixingRegion> regions = regions_of(known.mask, known.surfaces, task);
  std::vector<Proposal> proposals;
  for (const StoredPair& candidate : candidates)
    proposals.emplace_back([&candidate, &task](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& {
      candidate.read(box, room, task);
      return room;
    });
  proposals.emplace_back(
      [&data](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& { return room = cut(data, box); });
  if (over_frames)
    proposals.emplace_back([&over_frames](const HalfPair&, const Box& box, HalfPair& room) -> const HalfPair& {
      return room = cut(*over_frames, box);
    });
  const HalfPair& averaged = over_frames ? *over_frames : data;
  for (const double window : kLocalMeans)
    proposals.emplace_back(
        [&averaged, window, &task](const HalfPair& now, const Box& box, HalfPair& room) -> const HalfPair& {
          return room = with_local_mean(now, averaged, box, window, task);
        });
  const LateProposal lines = [&](const Box& box, const Plane& wanted) {
    std::vector<Plane> features;
    for (const Plane& feature : known.features)
      features.push_back(Plane::view(feature, box.x0, box.y0, box.width(), box.height()));
    return local_lines(cut(data, box), pointers(features), wanted, task);
  };
  const bool with_lines = !few || error_left(result, data, weight) > kMostLeft;
  mix(result, proposals, with_lines ? lines : nullptr, {view(data.a), view(data.b), weight, regions}, task);
}

void run(const TransportRegression& p, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const int width = frame.width(), height = frame.height();
  const Plane one(width, height, 1.0f);
  RegressionInputs inputs = inputs_of(p.frames, frame, one, task);
  RegressionInput& own = inputs[0];
  const TransportColumns& known = own.known;
  if (out.notes) say_what_is_missing(frame, known.guided, own.halves, *out.notes);
  const double samples = std::max(1.0, frame.samples);
  const bool few = frame.samples > 0 && frame.samples < kFewSamples;
  const double limit = static_cast<double>(p.limit) * std::max(1.0, std::pow(samples / 16, 0.25));
  // Noise grows with light that paths find; direct light holds background, too, so that its brightness says nothing.
  const float power = frame.name == layer::direct ? 0.0f : p.weight_power;
  const bool blurred = known.guided && frame.name == layer::indirect;
  ClampedHalves clamped = draw_outliers_in(inputs, power, limit, blurred, task);
  task.report(0.2);

  std::optional<HalfPair> over_frames;
  const std::vector<StoredPair> candidates =
      cascade(inputs, {p.window, p.ridge, p.ridge_per_pixel, power, !few}, over_frames, task);
  own.left = {};
  const bool predicted = !known.expected[0].empty();
  // Beside what guides predict, fits are chosen by relative errors, those of direct light, too.
  if (predicted) own.weigh_by(own.level, p.weight_power, task);
  // The data are a candidate themselves: with many samples nothing is nearer to the truth.
  const HalfPair data{std::move(clamped.a), std::move(clamped.b)};
  HalfPair chosen = blend(
      candidates, data,
      stacking_weights(
          candidates, data, own.weight,
          {static_cast<double>(p.stacking_window), static_cast<double>(p.caution), predicted ? kDoubt : 0.0}, task),
      task);
  task.report(0.7);
  improve(chosen, candidates, data, over_frames, known, few, task);
  Rgb clean = mean(chosen, task);
  redistribute_energy(clamped.taken, clean, known.mask, task);
  for (size_t c = 0; c < 3; ++c) add_to(clean[c], 1, clamped.points[c], task);
  if (!known.expected[0].empty())
    keep_within_known(frame.signal, known.expected, known.mask, frame.name == layer::direct, clean, task);
  if (!own.halves && !known.surfaces.share.empty())
    keep_within_neighbours(frame.signal, known.surfaces.share, clean, task);
  for (size_t c = 0; c < 3; ++c)
    for_each_pixel(width, height, quiet(task), [&](int x, int y) {
      (*out[c])(x, y) = known.mask(x, y) > 0 ? clean[c](x, y) : (*frame.signal[c])(x, y);
    });
  task.report(1);
  if (!out.products) return;
  Plane error = squared_error(chosen, data, regions_of(known.mask, known.surfaces, task), task);
  (*out.products)[layer::clean_error.channel(0)] = std::move(error);
}

/// Squares, of the parts together, to a root mean square error.
void settle(Layers& layers) {
  Plane& error = *layers.find(layer::clean_error.channel(0));
  for (int y = 0; y < error.height(); ++y)
    for (float& v : error.pixels(y))
      if (v != 0) v = std::sqrt(std::max(0.0f, v));
}

const FilterEntry entry =
    declare<TransportRegression>(
        "transport_regression",
        "Local linear regression of direct and indirect light, each by itself, on noise-free guides that the renderer computes from the volume.")
        .merit(108, "first of all, where the renderer's guides are recorded (`--layers direct,indirect,guides`)")
        .source(
            "our own, docs/transport_regression.md; local regression on features: Bitterli et al. 2016; stacking: Breiman 1996")
        .notes(
            "The light that no path has to find is computed without noise (`guide.*`); what is left to the data are a few coefficients in every window. Each half image is fitted, in one window for the frame, then what that leaves in narrower and narrower ones, and the halves say how much of each fit, and of the data, is best where. Frames without guides are cleaned with the features they have, at two to four times the error: nfor does better there.")
        .statistics(Statistics::kNone, Statistics::kHalves)
        .no_variance()
        .guides()
        .stored_guides()
        .can_use(layer::transmittance, layer::gradient, layer::gradient_transmittance_weighted, layer::albedo,
                 layer::normal, layer::depth)
        .parts()
        .within(cleaned_box)
        .seeded()
        .paper("")
        .produces(layer::clean_error)
        .settles(settle)
        .param("window", &TransportRegression::window, {2, 100}, "px",
               "deviation of the widest Gaussian window; the others are a half and a quarter of it", {12, 16, 24})
        .param("ridge", &TransportRegression::ridge, {0, 100}, "1", "pull of scaled coefficients towards 0",
               {0.002, 0.02})
        .param("ridge-per-pixel", &TransportRegression::ridge_per_pixel, {0, 1000}, "1",
               "the same, over the window's effective number of pixels", {1, 10})
        .param("stacking-window", &TransportRegression::stacking_window, {2, 200}, "px",
               "deviation of the Gaussian in which fits are weighed against each other")
        .param("caution", &TransportRegression::caution, {0, 1e6}, "1",
               "pull of these weights towards the frame's, in pixels")
        .param(
            "limit", &TransportRegression::limit, {1, 1e9}, "1",
            "deviations above a first fit to which outliers are drawn in, at up to 16 samples per pixel; their light is given to the neighbourhood")
        .param(
            "weight-power", &TransportRegression::weight_power, {0, 2}, "1",
            "in what cleans all but the direct light, pixels weigh as their brightness to minus this power: 2 is constant relative noise, 4/3 what CIE-Lab sees")
        .param("frames", &TransportRegression::frames, {0.1, 100}, "frames",
               "of a sequence: deviation of the Gaussian over frames that share coefficients")
        .sequences(3)
        .scratch(80)
        .apron([](const TransportRegression&) { return 1 << 20; })
        .run(run);
const Registration registration(entry);

}  // namespace
}  // namespace brume
