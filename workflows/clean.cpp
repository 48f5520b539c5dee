#include "workflows/clean.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/peak_memory.h"
#include "base/rng.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/inputs/features.h"
#include "filters/inputs/guide_layers.h"
#include "filters/run/clean_lights.h"
#include "image/light_layers.h"
#include "image/packed_plane.h"
#include "workflows/clean_parts.h"
#include "workflows/error_curve.h"

namespace brume {
namespace {

// Of a tile's squared error: it falls like samples to the power of -kDecay.
constexpr double kDecay = ErrorCurve::kUsualDecay;
// A round takes between a tenth more and twice as many samples as there are, so that errors are known before they are
// acted on and few pictures are cleaned.
constexpr double kLeastGrowth = 1.1, kMostGrowth = 2;
constexpr double kMostShare = 16;  // samples of a tile over the mean's

bool makes(const FilterEntry& filter, const LayerName& layer) {
  return std::find(filter.produces.begin(), filter.produces.end(), layer) != filter.produces.end();
}

ApplyOptions options_of(double exposure, Outliers outliers) {
  ApplyOptions options;
  options.component = Component::kAll;
  options.exposure = exposure;
  options.outliers = outliers;
  options.all_guides = true;
  return options;
}

/// A small frame of noise with the layers that will be recorded, on which a filter can be tried.
Layers trial_frame(const LayerRequest& request, int samples) {
  constexpr int kSize = 16;
  Layers trial(kSize, kSize);
  trial.header["samplesPerPixel"] = samples;
  Rng rng(1);
  const auto add = [&](const LayerName& l, std::string_view which = "") {
    for (const std::string& channel : l.channel_names(which)) {
      Plane& plane = trial.add(channel);
      for (int y = 0; y < kSize; ++y)
        for (float& v : plane.pixels(y)) v = static_cast<float>(rng.uniform());
    }
  };
  const auto add_recorded = [&](const LayerName& l) {
    add(l);
    if (request.statistics)
      for (const auto which : {statistic::mean_variance, statistic::half_a, statistic::half_b}) add(l, which);
    if (request.buckets)
      for (const auto which : statistic::buckets) add(l, which);
  };
  add_recorded(layer::beauty);
  for (const RecordedLayer& l : recordable_layers())
    if (request.has(l.name)) add_recorded(l.name);
  for (const LayerName& l : FeaturePlan::sources())
    if (request.guides && is_guide(l.name)) add(l);
  return trial;
}

}  // namespace

Cleaner::Cleaner(const std::string& filter, double exposure, Host host, Outliers outliers)
    : filter_(parse_filter(filter)), exposure_(exposure), outliers_(outliers), host_(std::move(host)) {}

bool Cleaner::estimates_error() const {
  return makes(filter_.entry(), layer::clean_error);
}

LayerRequest Cleaner::request(const LayerRequest& wanted, int samples) {
  const FilterEntry& entry = filter_.entry();
  if (entry.records == FilterEntry::Records::kNeeds)
    throw InputError(fmt::format(
        "--clean-filter {}: needs the record of every sample; render with --records, then brume denoise", entry.name));
  LayerRequest request = wanted;
  keep_guides_ = wanted.guides;
  const auto record = [&](const LayerName& l) {
    if (!l.name.empty() && !request.has(l)) request.names.emplace_back(l.name);
  };
  for (const LayerName& l : {layer::direct, layer::indirect}) record(l);
  for (const LayerName& l : entry.needs) record(l);
  request.statistics = true;
  record({kLightAimed, "", ""});
  request.buckets = request.buckets || entry.statistics == Statistics::kBuckets;
  const std::vector<std::string> preferred = filter_.preferred_features();
  request.guides =
      request.guides || entry.guides || std::any_of(preferred.begin(), preferred.end(), FeaturePlan::is_of_guides);
  if (!request.guides) {  // what it would miss without them
    std::vector<LayerName> helpful = entry.can_use;
    if (filter_.uses_features())
      helpful.insert(helpful.end(), FeaturePlan::sources().begin(), FeaturePlan::sources().end());
    for (const RecordedLayer& l : recordable_layers())
      if (std::find(helpful.begin(), helpful.end(), l.name) != helpful.end()) record(l.name);
  }
  try {
    apply_filter(filter_, trial_frame(request, samples), options_of(exposure_, outliers_), {});
  } catch (const InputError& error) {
    throw InputError(fmt::format("--clean-filter {}: {}", entry.name, error.what()));
  }
  return request;
}

bool Cleaner::may_store(const std::string& channel) const {
  return !keep_guides_ && filter_.entry().stored_guides && is_only_fitted(channel);
}

Layers Cleaner::clean(Layers frame) {
  return clean(std::move(frame), false);
}

Layers Cleaner::clean_with_parts(Layers frame) {
  return clean(std::move(frame), true);
}

Layers Cleaner::clean(Layers frame, bool parts) {
  ApplyReport report;
  const ApplyOptions options = options_of(exposure_, outliers_);
  const Task task = host_.task(filter_.entry().name);
  const bool saves = saves_memory(static_cast<size_t>(frame.width()) * frame.height());
  // What the filter does not read is kept in little memory while it runs.
  std::map<std::string, PackedPlane> aside;
  const std::set<std::string> readable = readable_channels(filter_, options, frame);
  for (const auto& [name, plane] : frame.channels())
    if (saves && !readable.contains(name)) aside.try_emplace(name, plane, task);
  for (const auto& [name, plane] : aside) frame.remove(name);
  Layers clean = apply_filter(filter_, frame, options, task, &report);
  if (saves) give_back_freed_memory();
  while (!aside.empty()) {  // one after the other, so that none is there twice
    const auto one = aside.extract(aside.begin());
    frame.set(one.key(), one.mapped().unpacked(task));
  }
  for (const std::string& line : report.notes) host_.note(line);
  seconds_ += report.seconds;
  Layers all = frame.without_channels();
  const auto own = [&](const std::string& name) { return frame.find(name) != nullptr; };
  for (const auto& [name, plane] : clean.channels())
    if (!own(name)) all.set(name, std::move(*clean.find(name)));
  std::vector<std::string> unwanted;
  for (const auto& [name, plane] : frame.channels()) {
    if (!keep_guides_ && (is_guide(name) || is_predicted_light(name) || is_aimed_light(name))) unwanted.push_back(name);
    all.set(name, std::move(*frame.find(name)));
  }
  for (size_t c = 0; c < 3; ++c) {
    const std::string raw = layer::beauty.channel(c);
    all.set(layer::noisy.channel(c), std::move(*all.find(raw)));
    all.set(raw, std::move(*clean.find(raw)));
  }
  if (parts) {
    const Stopwatch watch;
    for (const auto& [name, plane] : frame.stored()) all.set_stored(name, plane);
    clean_lights(filter_, options, all, all, host_.silent());  // first: what the parts add up to
    clean_parts(filter_, options, all, host_.silent());
    seconds_ += watch.seconds();
  }
  for (const std::string& name : unwanted) all.remove(name);
  for (const auto& [name, plane] : frame.stored()) all.remove(name);
  for (const auto& [key, value] : clean.header) all.header[key] = value;

  error_ = -1;
  if (estimates_error()) {
    const Plane& error = all.at(layer::clean_error.channel(0));
    const Plane light = luminance_of(all.rgb(layer::beauty), FrameSpace(all), host_.silent());
    double sum = 0;
    for (int y = 0; y < error.height(); ++y)
      for (int x = 0; x < error.width(); ++x) sum += relative_square(error(x, y), light(x, y));
    error_ = std::sqrt(sum / (static_cast<double>(error.width()) * error.height()));
    all.header["estimatedCleanError"] = static_cast<float>(error_);
  }
  return all;
}

void Cleaner::clean_lights_of_picture() {
  const Stopwatch watch;
  clean_lights(filter_, options_of(exposure_, outliers_), picture_, picture_, host_.silent());
  seconds_ += watch.seconds();
}

double Cleaner::relative_square(double error, double luminance) const {
  const double mean = luminance * exposure_;
  return error * error * exposure_ * exposure_ / (mean * mean + 0.01);
}

NextRound Cleaner::next_round(const RenderRound& round, double target) {
  picture_ = clean(round.frame);
  const Layers& all = picture_;
  const bool known = estimates_error();
  if (known && target > 0 && error_ <= target) return {};
  const Film& film = round.film;
  const auto tiles = static_cast<size_t>(film.tile_count());
  std::vector<double> pixels(tiles), taken(tiles), wanted(tiles, 0.0);
  double total = 0, all_pixels = 0;
  for (size_t t = 0; t < tiles; ++t) {
    pixels[t] = film.bounds(static_cast<int>(t)).pixels();
    taken[t] = film.taken(static_cast<int>(t));
    total += pixels[t] * taken[t];
    all_pixels += pixels[t];
  }
  NextRound next;
  double growth = kMostGrowth;
  if (known && target > 0) {
    ErrorCurve curve;
    for (const RoundError& e : round.earlier) curve.add(e.samples, e.error);
    curve.add(total, error_);
    next.error = error_;
    next.samples_needed = curve.samples_needed(target);
    const RoundsLeft left = rounds_left(next.samples_needed / total, kLeastGrowth, kMostGrowth);
    next.rounds_needed = left.rounds;
    growth = left.growth;
  }
  growth = std::min(growth, round.most_growth);
  if (!(growth > 1)) return {};

  const Plane light = luminance_of(all.rgb(layer::beauty), FrameSpace(all), host_.silent());
  const Plane* const error = known ? all.find(layer::clean_error.channel(0)) : nullptr;
  const Plane* const map = all.find(layer::sampling_map.channel(0));
  for (size_t t = 0; t < tiles; ++t) {
    const Film::Bounds b = film.bounds(static_cast<int>(t));
    double sum = 0;
    for (int y = b.y0; y < b.y1; ++y)
      for (int x = b.x0; x < b.x1; ++x)
        sum += error ? relative_square((*error)(x, y), light(x, y)) : map ? (*map)(x, y) : 1.0;
    // Minimises sum E_t (n_t / taken_t)^-decay at a given sum of n_t.
    wanted[t] = error ? std::pow(sum / pixels[t] * std::pow(taken[t], kDecay), 1 / (1 + kDecay)) : sum / pixels[t];
  }
  // What a tile has already it keeps; the others share the rest in proportion.
  const double budget = growth * total;
  double lowest = 0, highest = 1e30;
  std::vector<uint32_t>& goals = next.goals;
  goals.resize(tiles);
  for (int step = 0; step < 200; ++step) {
    const double factor = std::sqrt(std::max(lowest, 1e-30) * highest);
    double sum = 0;
    for (size_t t = 0; t < tiles; ++t) {
      const double fresh = error ? factor * wanted[t] : taken[t] + factor * wanted[t];
      const double goal = std::clamp(fresh, taken[t], std::max(taken[t], kMostShare * budget / all_pixels));
      goals[t] = static_cast<uint32_t>(std::min(goal + 0.5, 1e9));
      sum += pixels[t] * goal;
    }
    (sum > budget ? highest : lowest) = factor;
  }
  const bool gains = std::any_of(goals.begin(), goals.end(), [&, t = size_t{0}](uint32_t goal) mutable {
    return goal > film.taken(static_cast<int>(t++));
  });
  return gains ? next : NextRound();
}

}  // namespace brume
