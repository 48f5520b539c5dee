#include "filters/apply.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "filters/planes.h"
#include "filters/registry.h"
#include "filters/requirements.h"

namespace brume {
namespace {

float median_of_finite_neighbours(const Plane& plane, int x, int y) {
  std::vector<float> values;
  for (int qy = std::max(0, y - 1); qy <= std::min(plane.height() - 1, y + 1); ++qy)
    for (int qx = std::max(0, x - 1); qx <= std::min(plane.width() - 1, x + 1); ++qx)
      if (std::isfinite(plane(qx, qy))) values.push_back(plane(qx, qy));
  if (values.empty()) return 0.0f;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Plane repaired_plane(const Plane& plane, std::set<std::pair<int, int>>& bad) {
  Plane result = plane;
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x)
      if (!std::isfinite(plane(x, y))) {
        result(x, y) = median_of_finite_neighbours(plane, x, y);
        bad.insert({x, y});
      }
  return result;
}

double mean_of(const Plane& plane) {
  double sum = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y)) sum += v;
  return sum / (static_cast<double>(plane.width()) * plane.height());
}

/// What is decided once for the whole frame before its tiles are filtered.
struct Run {
  const FilterSettings& filter;
  const ApplyOptions& options;
  const FeaturePlan& features;
  ivec2 frame_size;
  bool mask = false;  // medium and background apart
};

/// What is measured once for the whole of a signal.
struct SignalLevel {
  double typical_luminance = 0, lab_noise = 0;
};

/// A frame that is read: the one to clean, or another of the sequence. Not copied unless it has something to repair.
class Source {
 public:
  Source(const SequenceFrame& frame, const std::set<std::string>& readable, const Task& task)
      : distance(frame.distance), records(frame.records), frame_(frame.layers) {
    for (const std::string& name : readable)
      if (frame.layers->find(name)) channels_.push_back(name);
    std::vector<char> damaged(channels_.size());
    parallel_for(static_cast<int>(channels_.size()), quiet(task), [&](int i) {
      damaged[static_cast<size_t>(i)] = count_not_finite(frame.layers->at(channels_[static_cast<size_t>(i)])) > 0;
    });
    std::set<std::pair<int, int>> bad;
    for (size_t i = 0; i < channels_.size(); ++i)
      if (damaged[i]) {
        if (bad.empty()) fixed_ = *frame.layers;
        fixed_.set(channels_[i], repaired_plane(frame.layers->at(channels_[i]), bad));
      }
    repaired = bad.size();
    if (const Plane* count = layers().find(layer::sample_count.channel(0))) samples = mean_of(*count);
  }
  const Layers& layers() const { return repaired ? fixed_ : *frame_; }
  size_t channels() const { return channels_.size(); }
  /// What is read of a part of it.
  Layers crop_to(const Box& box) const {
    Layers part(box.width(), box.height());
    for (const std::string& name : channels_) part.set(name, crop(layers().at(name), box));
    return part;
  }

  int distance;
  RecordReader* records;
  double samples = 0;   // per pixel
  size_t repaired = 0;  // pixels

 private:
  const Layers* frame_;
  Layers fixed_;
  std::vector<std::string> channels_;
};

/// The part of the frames that is filtered at once.
struct Tile {
  Box outer, interior;                 // with its apron in the frame; without it, in the tile
  std::vector<const Layers*> sources;  // the frame to clean first
};

struct TileTotals {
  size_t not_finite = 0;
  double energy = 0;
  size_t outliers = 0;
  std::set<std::pair<int, int>> repaired_records;
};

/// One signal of a tile with its statistics: views of the layers, and what had to be made.
struct Signal {
  NoisySignal own;
  RgbPlanes mean{}, variance{}, half_a{}, half_b{};
  std::vector<RgbPlanes> buckets;
  Plane removed;  // luminance that the outlier rule took, where there is one
};

Rgb copied(const RgbPlanes& from) {
  return {*from[0], *from[1], *from[2]};
}

void read_signal(Signal& s, const Layers& layers, const LayerName& name, const Run& run, const Task& task) {
  const FilterEntry& entry = run.filter.entry();
  const bool limits = run.options.outliers != Outliers::kKeep;
  s.mean = layers.rgb(name);
  const bool halves = layers.has(name, statistic::half_a) && layers.has(name, statistic::half_b);
  if (halves) s.half_a = layers.rgb(name, statistic::half_a), s.half_b = layers.rgb(name, statistic::half_b);
  if (entry.can_use_statistics >= Statistics::kVariance || limits) {
    if (run.options.noise == NoiseSource::kSpatial)
      s.own.variance = spatial_variance(s.mean, task);
    else if (layers.has(name, statistic::mean_variance))
      s.own.variance = corrected_variance(s.mean, layers.rgb(name, statistic::mean_variance), s.half_a, s.half_b,
                                          layers.find(layer::sample_count.channel(0)), task);
    else if (halves)
      s.own.variance = variance_of_halves(s.mean, s.half_a, s.half_b, task);
    if (!s.own.variance[0].empty()) s.variance = view(s.own.variance);
  }
  if (layers.has(name, statistic::buckets[0]))
    for (const std::string_view bucket : statistic::buckets) s.buckets.push_back(layers.rgb(name, bucket));
  if (!limits || !s.variance[0]) return;
  s.own.mean = copied(s.mean), s.mean = view(s.own.mean);
  if (halves) {
    s.own.half_a = copied(s.half_a), s.half_a = view(s.own.half_a);
    s.own.half_b = copied(s.half_b), s.half_b = view(s.own.half_b);
  }
  for (RgbPlanes& bucket : s.buckets) s.own.buckets.push_back(copied(bucket));
  for (size_t i = 0; i < s.buckets.size(); ++i) s.buckets[i] = view(s.own.buckets[i]);
  s.removed = limit_outliers(s.own, run.options.outliers, task);
}

/// Everything that a filter is given of one frame, and what it points to.
struct Prepared {
  Signal signal;
  std::vector<Feature> features;
  FilterFrame frame;

  Prepared(const Run& run, const Source& source, const Layers& layers, const LayerName& name, const Task& task)
      : frame{name, {}, {}, layers, run.options.exposure} {
    const FilterEntry& entry = run.filter.entry();
    read_signal(signal, layers, name, run, task);
    if (run.filter.uses_features())
      features = run.features.build(
          layers, {entry.can_use_statistics >= Statistics::kVariance, entry.can_use_statistics >= Statistics::kHalves},
          task);
    frame.signal = frame.values = signal.mean;
    if (run.mask && entry.background) frame.medium = &layers.at(layer::coverage.channel(0));
    frame.variance = signal.variance;
    frame.half_a = signal.half_a, frame.half_b = signal.half_b;
    frame.buckets = signal.buckets;
    frame.features = &features;
    frame.together = !run.options.carried.empty();
    frame.samples = source.samples;
    frame.sample_count = layers.find(layer::sample_count.channel(0));
    frame.records = source.records;
    frame.frame_size = run.frame_size;
  }
  Prepared(const Prepared&) = delete;
};

/// Filters one signal of a tile (with its apron) and adds the result to `sums`; `carried` hold the other layers'
/// results.
void filter_signal(const Run& run, const std::vector<Source>& sources, const Tile& tile, const LayerName& name,
                   const SignalLevel& level, const FilterOutput& sums, const std::vector<FilterOutput>& carried,
                   const std::map<std::string, Plane*>& products, const Task& task, TileTotals& totals) {
  const FilterEntry& entry = run.filter.entry();
  const Layers& layers = *tile.sources[0];
  const int width = layers.width(), height = layers.height();
  const Box& interior = tile.interior;
  const ivec2 origin{tile.outer.x0, tile.outer.y0};
  std::vector<std::unique_ptr<Prepared>> prepared;
  for (size_t i = 0; i < sources.size(); ++i) {
    prepared.push_back(std::make_unique<Prepared>(run, sources[i], *tile.sources[i], name, task));
    FilterFrame& f = prepared.back()->frame;
    f.origin = origin;
    f.repaired_records = &totals.repaired_records;
    f.typical_luminance = level.typical_luminance;
    f.lab_noise = level.lab_noise;
  }
  FilterFrame& frame = prepared[0]->frame;
  for (size_t i = 1; i < sources.size(); ++i) frame.nearby.push_back({sources[i].distance, &prepared[i]->frame});
  if (const Plane& removed = prepared[0]->signal.removed; !removed.empty())
    for (int y = interior.y0; y < interior.y1; ++y)
      for (int x = interior.x0; x < interior.x1; ++x)
        totals.energy += removed(x, y), totals.outliers += removed(x, y) > 0;

  std::map<std::string, Plane> produced;
  const size_t jobs = 1 + carried.size();
  for (size_t j = 0; j < jobs; ++j) {
    Rgb out{Plane(width, height), Plane(width, height), Plane(width, height)};
    const FilterOutput target = {&out[0], &out[1], &out[2]};
    frame.products = j == 0 && !products.empty() ? &produced : nullptr;
    if (j > 0)
      for (size_t i = 0; i < sources.size(); ++i)
        prepared[i]->frame.values = tile.sources[i]->rgb(run.options.carried[j - 1]);
    const Task part = share(task, static_cast<double>(j) / static_cast<double>(jobs),
                            static_cast<double>(j + 1) / static_cast<double>(jobs));
    run.filter.run(frame, target, part);
    task.check();
    if (run.mask && !entry.background) {
      const Plane& coverage = layers.at(layer::coverage.channel(0));
      FilterSettings bilateral(find_filter("bilateral"));
      bilateral.set("preset", "paper");
      bilateral.set("average", "linear");
      Rgb other{Plane(width, height), Plane(width, height), Plane(width, height)};
      bilateral.run(frame, {&other[0], &other[1], &other[2]}, quiet(task));
      for (size_t c = 0; c < 3; ++c)
        for (int y = 0; y < height; ++y)
          for (int x = 0; x < width; ++x)
            if (coverage(x, y) == 0) out[c](x, y) = other[c](x, y);
    }
    for (int y = interior.y0; y < interior.y1; ++y)
      for (int x = interior.x0; x < interior.x1; ++x) {
        const bool finite = std::isfinite(out[0](x, y)) && std::isfinite(out[1](x, y)) && std::isfinite(out[2](x, y));
        totals.not_finite += !finite;
        for (size_t c = 0; c < 3; ++c) {
          const float value = finite ? out[c](x, y) : (*frame.values[c])(x, y);
          if (j == 0)
            (*sums[c])(x + origin.x, y + origin.y) += value;
          else
            (*carried[j - 1][c])(x + origin.x, y + origin.y) = value;
        }
      }
  }
  for (const auto& [channel, target] : products)
    for (int y = interior.y0; y < interior.y1; ++y)
      for (int x = interior.x0; x < interior.x1; ++x)
        (*target)(x + origin.x, y + origin.y) = produced.at(channel)(x, y);
}

double noise_level(const Layers& layers, const LayerName& signal, const ApplyOptions& options, const Plane* medium,
                   const Task& task) {
  const RgbPlanes mean = layers.rgb(signal);
  if (options.noise == NoiseSource::kSpatial) {
    const Rgb variance = spatial_variance(mean, task);
    return lab_noise(mean, view(variance), {}, {}, options.exposure, medium);
  }
  const bool halves = layers.has(signal, statistic::half_a) && layers.has(signal, statistic::half_b);
  if (halves)
    return lab_noise(mean, {}, layers.rgb(signal, statistic::half_a), layers.rgb(signal, statistic::half_b),
                     options.exposure, medium);
  return lab_noise(mean, layers.rgb(signal, statistic::mean_variance), {}, {}, options.exposure, medium);
}

double light_of(const Layers& layers, const std::vector<LayerName>& signals) {
  double light = 0;
  for (const LayerName& name : signals) {
    const RgbPlanes p = layers.rgb(name);
    for (int y = 0; y < layers.height(); ++y)
      for (int x = 0; x < layers.width(); ++x) light += luminance(vec3((*p[0])(x, y), (*p[1])(x, y), (*p[2])(x, y)));
  }
  return std::max(light, 1e-30);
}

// What a run may always hold, however little it reads [bytes]: tiles cost work for their aprons.
constexpr double kFreeMemory = 5e8;
constexpr int kSmallestTile = 128;

/// Side of the tiles, and what the run holds at its height [bytes].
/// @param channels  that the filter reads, of all frames together
int choose_tile(const FilterEntry& filter, const Layers& frame, const ApplyOptions& options, size_t channels, int apron,
                double& peak) {
  constexpr double kPrepared = 12;  // variance, result, background [planes]
  const double pixels = static_cast<double>(frame.width()) * frame.height();
  const double frames = static_cast<double>(1 + options.sequence.size());
  const double read = 4.0 * pixels * frames * static_cast<double>(frame.channels().size());
  double results = 4.0 + 3.0 * static_cast<double>(options.carried.size());
  for (const LayerName& l : filter.produces) results += static_cast<double>(l.channels.size());
  const double written = 4.0 * pixels * results;
  const double whole = 4.0 * frames * (filter.scratch + kPrepared);  // per pixel of the frame at once
  const double tiled = whole + 4.0 * static_cast<double>(channels);  // per pixel of a tile, which is cut out first
  const double budget = std::max(0.25 * read, kFreeMemory);
  const int longest = std::max(frame.width(), frame.height()), shortest = std::min(frame.width(), frame.height());
  int tile = options.tile;
  if (tile == 0)
    // A frame that fits as a whole has no apron.
    tile = whole * pixels <= budget ? longest
                                    : std::max(kSmallestTile, static_cast<int>(std::sqrt(budget / tiled)) - 2 * apron);
  tile = std::clamp(tile, 1, longest);
  const double side = std::min<double>(tile + 2.0 * apron, longest);
  peak = read + written + (tile == longest ? whole : tiled) * side * std::min<double>(side, shortest);
  return tile;
}

}  // namespace

Layers apply_filter(const FilterSettings& requested, const Layers& frame, const ApplyOptions& options, const Task& task,
                    ApplyReport* report) {
  const FilterEntry& entry = requested.entry();
  check_requirements(requested, frame, options);
  ApplyReport local;
  ApplyReport& r = report ? *report : local;
  r = {};
  const Stopwatch watch;

  const std::set<std::string> readable = readable_channels(requested, options);
  std::vector<Source> sources;
  sources.reserve(1 + options.sequence.size());
  sources.emplace_back(SequenceFrame{0, &frame, options.records}, readable, task);
  for (const SequenceFrame& other : options.sequence) sources.emplace_back(other, readable, task);
  for (const Source& s : sources) r.repaired_pixels += s.repaired;
  if (r.repaired_pixels)
    r.notes.push_back(fmt::format("{} pixels were NaN or infinite and were replaced by the median of their neighbours",
                                  r.repaired_pixels));
  const Layers& source = sources[0].layers();

  FilterSettings filter = requested;
  if (const Parameter* average = entry.find("average");
      average && !options.carried.empty() && Parameter::text(filter.get(*average)) != "linear") {
    filter.set("average", "linear");
    r.notes.push_back("average = linear, because layers that are carried along must add up");
  }
  const bool with_features = filter.uses_features();
  const FeaturePlan features =
      with_features ? FeaturePlan::choose(source, options.features, filter.preferred_features(), task) : FeaturePlan();
  if (with_features) r.notes.push_back(features.note());
  Run run{filter, options, features, {frame.width(), frame.height()}};
  const bool by_paper = options.background == BackgroundRule::kDefault && entry.background;
  if (options.background == BackgroundRule::kBilateral || by_paper) {
    run.mask = source.has(layer::coverage);
    if (!run.mask) r.notes.push_back("no coverage layer: every pixel is filtered as medium");
  }

  const int apron = filter.apron() + (entry.can_use_statistics > Statistics::kNone ? kNoiseReach : 0) +
                    (options.outliers != Outliers::kKeep ? kOutlierReach : 0);
  double peak = 0;
  size_t channels = 0;
  for (const Source& s : sources) channels += s.channels();
  const int tile = choose_tile(entry, frame, options, channels, apron, peak);
  if (peak > physical_memory())
    throw InputError(
        fmt::format("filter {} would hold {:.1f} GB for this frame in tiles of {} px, this machine has {:.1f} "
                    "GB{}",
                    entry.name, peak / 1e9, tile, physical_memory() / 1e9,
                    tile > kSmallestTile ? fmt::format("; try --tile {}", kSmallestTile) : ""));

  Layers result(frame.width(), frame.height());
  result.header = frame.header;
  result.origin = frame.origin, result.display = frame.display;
  const auto out = result.add_rgb(layer::beauty);
  std::vector<FilterOutput> carried;
  for (const LayerName& l : options.carried) carried.push_back(result.add_rgb(l));
  std::map<std::string, Plane*> products;
  for (const LayerName& l : entry.produces)
    for (const std::string& channel : l.channel_names()) products[channel] = &result.add(channel);
  const std::vector<LayerName> signals = signals_of(options);
  std::vector<SignalLevel> levels;
  for (const LayerName& name : signals) {
    SignalLevel& level = levels.emplace_back();
    level.typical_luminance = typical_luminance(source.rgb(name));
    if (!filter.uses_noise_level()) continue;
    level.lab_noise = noise_level(source, name, options, source.find(layer::coverage.channel(0)), task);
    r.notes.push_back(fmt::format("noise of '{}': {:.3g} Lab units", name.label(), level.lab_noise));
  }
  const int across = (frame.width() + tile - 1) / tile, down = (frame.height() + tile - 1) / tile;
  const size_t jobs = static_cast<size_t>(across * down) * signals.size();
  TileTotals totals;
  size_t job = 0;
  for (int ty = 0; ty < down; ++ty)
    for (int tx = 0; tx < across; ++tx) {
      const Box inner{tx * tile, ty * tile, std::min(frame.width(), (tx + 1) * tile),
                      std::min(frame.height(), (ty + 1) * tile)};
      Tile part{inner.grown(apron, frame.width(), frame.height()), {}, {}};
      part.interior = {inner.x0 - part.outer.x0, inner.y0 - part.outer.y0, inner.x1 - part.outer.x0,
                       inner.y1 - part.outer.y0};
      std::vector<Layers> crops;
      if (across * down > 1)
        for (const Source& s : sources) crops.push_back(s.crop_to(part.outer));
      for (size_t i = 0; i < sources.size(); ++i)
        part.sources.push_back(crops.empty() ? &sources[i].layers() : &crops[i]);
      for (size_t s = 0; s < signals.size(); ++s, ++job) {
        const double jobs_done = static_cast<double>(job), all = static_cast<double>(jobs);
        filter_signal(run, sources, part, signals[s], levels[s], out, s == 0 ? carried : std::vector<FilterOutput>(),
                      s == 0 ? products : std::map<std::string, Plane*>(),
                      share(task, jobs_done / all, (jobs_done + 1) / all), totals);
      }
    }
  task.check();
  if (entry.settle) entry.settle(result);
  r.tiles = static_cast<size_t>(across * down);
  r.seconds = watch.seconds();
  r.not_finite_results = totals.not_finite;

  const bool add_direct = options.component == Component::kIndirect;
  if (add_direct) {
    const RgbPlanes direct = source.rgb(layer::direct);
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < result.height(); ++y)
        for (int x = 0; x < result.width(); ++x) (*out[c])(x, y) += (*direct[c])(x, y);
  }
  r.repaired_records = totals.repaired_records.size();
  if (r.repaired_records)
    r.notes.push_back(
        fmt::format("recorded samples of {} pixels were NaN or infinite and were replaced by the mean of the pixel's "
                    "other samples",
                    r.repaired_records));
  if (r.not_finite_results)
    r.notes.push_back(
        fmt::format("{} pixels were out of the filter's range and kept their input", r.not_finite_results));
  if (totals.outliers)
    r.notes.push_back(fmt::format("{} outlier pixels were limited; {:.3g} % of the light was {}", totals.outliers,
                                  100 * totals.energy / light_of(source, signals),
                                  options.outliers == Outliers::kClamp ? "lost" : "moved to their neighbours"));
  if (const Plane* alpha = source.find(layer::alpha.channel(0))) result.set(layer::alpha.channel(0), *alpha);
  result.header["biased"] = "true: filtered by " + entry.name;
  result.header["filter"] = entry.name;
  result.header["filterParameters"] = filter.text();
  result.header["filterComponent"] = std::string(add_direct ? "indirect; direct added back"
                                                 : options.component == Component::kApart ? "direct and indirect apart"
                                                                                          : "all");
  result.header["filterBackground"] =
      std::string(run.mask ? "bilateral sigma-domain=2 sigma-range=20" : "as the medium");
  result.header["filterExposure"] = static_cast<float>(options.exposure);
  result.header["filterSeconds"] = static_cast<float>(r.seconds);
  result.header["filterSource"] = entry.source;
  if (!options.sequence.empty()) {
    std::vector<std::string> distances;
    for (const SequenceFrame& other : options.sequence) distances.push_back(fmt::format("{:+}", other.distance));
    result.header["filterFrames"] = join(distances);
  }
  if (with_features) result.header["filterFeatures"] = features.note();
  if (options.noise == NoiseSource::kSpatial) result.header["filterNoise"] = std::string("estimated from the picture");
  if (options.outliers != Outliers::kKeep)
    result.header["filterOutliers"] = std::string(options.outliers == Outliers::kClamp ? "clamped" : "redistributed");
  return result;
}

}  // namespace brume
