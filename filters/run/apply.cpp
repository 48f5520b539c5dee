#include "filters/run/apply.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/text.h"
#include "filters/api/requirements.h"
#include "filters/patch/picture_noise.h"
#include "filters/run/filter_signal.h"

namespace brume {
namespace {

double light_of(const Layers& layers, const std::vector<LayerName>& signals) {
  double light = 0;
  const FrameSpace space(layers);
  for (const LayerName& name : signals) {
    const RgbPlanes p = layers.rgb(name);
    for (int y = 0; y < layers.height(); ++y)
      for (int x = 0; x < layers.width(); ++x) light += space.luminance(color_at(p, x, y));
  }
  return std::max(light, 1e-30);
}

double noise_level(const Layers& layers, const LayerName& signal, const ApplyOptions& options, const Plane* medium,
                   const Task& task) {
  const RgbPlanes mean = layers.rgb(signal);
  const FrameSpace space(layers);
  if (options.noise == NoiseSource::kSpatial) {
    const Rgb variance = picture_variance(mean, task);
    return lab_noise(mean, view(variance), {}, {}, options.exposure, medium, space);
  }
  if (has_halves(layers, signal))
    return lab_noise(mean, {}, layers.rgb(signal, statistic::half_a), layers.rgb(signal, statistic::half_b),
                     options.exposure, medium, space);
  return lab_noise(mean, layers.rgb(signal, statistic::mean_variance), {}, {}, options.exposure, medium, space);
}

void tell_extremes(const Source& source, ApplyReport& report) {
  std::vector<LayerName> signals;
  Extremes all;
  for (const auto& [name, found] : source.extremes) {
    signals.push_back({name, "RGB", ""});
    all.limited += found.limited;
    all.kept += found.kept;
    all.taken += found.taken;
    all.lost += found.lost;
  }
  report.extreme_pixels = all.limited + all.kept;
  const double percent = 100 / (light_of(source.layers(), signals) + all.lost);
  if (all.limited > 0)
    report.notes.push_back(fmt::format(
        "{} pixel{} that one sample makes far brighter than all around {} limited: of {:.3g} % of the light {:.3g} % went to the neighbourhood, {:.3g} % is lost (--outliers keep leaves them)",
        all.limited, all.limited == 1 ? "" : "s", all.limited == 1 ? "was" : "were", percent * all.taken,
        percent * (all.taken - all.lost), percent * all.lost));
  if (all.kept > 0)
    report.notes.push_back(
        fmt::format("{} pixel{} far brighter than all around, by more than one sample, {} kept as {}", all.kept,
                    all.kept == 1 ? "" : "s", all.kept == 1 ? "is" : "are", all.kept == 1 ? "it is" : "they are"));
}

void tell_weights(const Source& source, ApplyReport& report) {
  size_t outside = 0;
  for (const auto& [name, weight] : source.weights) outside = std::max(outside, weight.outside);
  if (outside == 0 || !source.goes_on()) return;
  report.notes.push_back(
      fmt::format("alpha says without noise that {:.3g} % of the pixels show nothing: they stay black",
                  100.0 * static_cast<double>(outside) /
                      (static_cast<double>(source.layers().width()) * source.layers().height())));
}

void report_sources(const std::vector<Source>& sources, ApplyReport& report) {
  tell_weights(sources[0], report);
  for (const Source& s : sources) report.repaired_pixels += s.repaired;
  if (report.repaired_pixels)
    report.notes.push_back(fmt::format(
        "{} pixels were NaN or infinite and were replaced by the median of their neighbours", report.repaired_pixels));
  tell_extremes(sources[0], report);
}

/// The parameters as they are used: carried layers must add up, which averages in CIE-Lab do not.
FilterSettings usable_settings(const FilterSettings& requested, const ApplyOptions& options, ApplyReport& report) {
  FilterSettings filter = requested;
  const Parameter* average = filter.entry().find("average");
  if (!average || options.carried.empty() || Parameter::text(filter.get(*average)) == "linear") return filter;
  filter.set("average", "linear");
  report.notes.push_back("average = linear, because layers that are carried along must add up");
  return filter;
}

FeaturePlan plan_features(const FilterSettings& filter, const Layers& source, const ApplyOptions& options,
                          const Task& task, ApplyReport& report) {
  if (!filter.uses_features()) return {};
  FeaturePlan features = FeaturePlan::choose(source, options.features, filter.preferred_features(), task);
  report.notes.push_back(features.note());
  return features;
}

/// Whether pixels without coverage are treated apart.
bool separates_background(const FilterEntry& filter, const Layers& source, const ApplyOptions& options,
                          ApplyReport& report) {
  const bool by_paper = options.background == BackgroundRule::kDefault && filter.background;
  if (options.background != BackgroundRule::kBilateral && !by_paper) return false;
  if (source.has(layer::coverage)) return true;
  report.notes.push_back("no coverage layer: every pixel is filtered as medium");
  return false;
}

std::vector<SignalLevel> measure_levels(const Run& run, const Layers& source, const Task& task, ApplyReport& report) {
  std::vector<SignalLevel> levels;
  for (const LayerName& name : signals_of(run.options)) {
    SignalLevel& level = levels.emplace_back();
    level.typical_luminance = typical_luminance(source.rgb(name));
    if (!run.filter.uses_noise_level()) continue;
    level.lab_noise = noise_level(source, name, run.options, source.find(layer::coverage.channel(0)), task);
    report.notes.push_back(fmt::format("noise of '{}': {:.3g} Lab units", name.label(), level.lab_noise));
  }
  return levels;
}

Totals filter_tiles(const Run& run, const std::vector<Source>& sources, const TilePlan& plan,
                    const std::vector<SignalLevel>& levels, Gathered& gathered, const Task& task) {
  const std::vector<LayerName> signals = signals_of(run.options);
  const double jobs = static_cast<double>(plan.count()) * static_cast<double>(signals.size());
  Totals totals;
  double done = 0;
  for (int index = 0; index < plan.count(); ++index) {
    Tile tile = plan.tile(index, gathered.layers);
    std::vector<Layers> crops;
    if (plan.cuts(gathered.layers))
      for (const Source& s : sources) crops.push_back(s.crop_to(tile.outer));
    for (size_t i = 0; i < sources.size(); ++i)
      tile.sources.push_back(crops.empty() ? &sources[i].layers() : &crops[i]);
    for (size_t s = 0; s < signals.size(); ++s, ++done)
      filter_signal(run, sources, tile, signals[s], levels[s], s == 0, gathered, totals,
                    share(task, done / jobs, (done + 1) / jobs));
  }
  task.check();
  return totals;
}

void add_layer(const Gathered::Target& sum, const RgbPlanes& other) {
  for (size_t c = 0; c < 3; ++c)
    for_each_pixel({0, 0, sum[c]->width(), sum[c]->height()},
                   [&](int x, int y) { (*sum[c])(x, y) += (*other[c])(x, y); });
}

/// Filter, parameters, and what was done around them.
void describe(std::map<std::string, Attribute>& header, const Run& run, double seconds, size_t extremes) {
  const ApplyOptions& options = run.options;
  const FilterEntry& entry = run.filter.entry();
  header["biased"] = "true: filtered by " + entry.name;
  header["filter"] = entry.name;
  header["filterParameters"] = run.filter.text();
  header["filterComponent"] = std::string(options.component == Component::kIndirect   ? "indirect; direct added back"
                                          : options.component == Component::kSeparate ? "direct and indirect apart"
                                                                                      : "all");
  header["filterBackground"] = std::string(run.mask ? "bilateral sigma-domain=2 sigma-range=20" : "as the medium");
  header["filterExposure"] = static_cast<float>(options.exposure);
  header["filterSeconds"] = static_cast<float>(seconds);
  header["filterSource"] = entry.source;
  if (!options.sequence.empty()) {
    std::vector<std::string> distances;
    for (const SequenceFrame& other : options.sequence) distances.push_back(fmt::format("{:+}", other.distance));
    header["filterFrames"] = join(distances);
  }
  if (run.filter.uses_features()) header["filterFeatures"] = run.features.note();
  if (options.noise == NoiseSource::kSpatial) header["filterNoise"] = std::string("estimated from the picture");
  if (limits_outliers(options) || extremes > 0)
    header["filterOutliers"] = std::string(options.outliers == Outliers::kClamp          ? "clamped"
                                           : options.outliers == Outliers::kRedistribute ? "redistributed"
                                                                                         : "extremes limited");
}

void report_totals(const Totals& totals, const Run& run, const Layers& source, ApplyReport& report) {
  for (const std::string& note : totals.notes)
    if (std::find(report.notes.begin(), report.notes.end(), note) == report.notes.end()) report.notes.push_back(note);
  report.repaired_records = totals.repaired_records.size();
  if (report.repaired_records)
    report.notes.push_back(fmt::format(
        "recorded samples of {} pixels were NaN or infinite and were replaced by the mean of the pixel's other samples",
        report.repaired_records));
  report.not_finite_results = totals.not_finite;
  if (totals.not_finite)
    report.notes.push_back(
        fmt::format("{} pixels were out of the filter's range and kept their input", totals.not_finite));
  if (totals.outliers)
    report.notes.push_back(
        fmt::format("{} outlier pixels were limited; {:.3g} % of the light was {}", totals.outliers,
                    100 * totals.energy / light_of(source, signals_of(run.options)),
                    run.options.outliers == Outliers::kClamp ? "lost" : "moved to their neighbours"));
}

}  // namespace

Layers apply_filter(const FilterSettings& requested, const Layers& frame, const ApplyOptions& wanted, const Task& task,
                    ApplyReport* report) {
  ApplyOptions options = options_for(requested.entry(), frame, wanted);
  // Sums over frames have one order.
  std::sort(options.sequence.begin(), options.sequence.end(),
            [](const SequenceFrame& a, const SequenceFrame& b) { return a.distance < b.distance; });
  check_requirements(requested, frame, options);
  ApplyReport local;
  ApplyReport& r = report ? *report : local;
  r = {};
  const Stopwatch watch;

  const std::vector<Source> sources = read_sources(requested, frame, options, task);
  report_sources(sources, r);
  const Layers& source = sources[0].layers();
  const FilterSettings filter = usable_settings(requested, options, r);
  const FeaturePlan features = plan_features(filter, source, options, task, r);
  const Run run{filter, options, features, ivec2(frame.width(), frame.height()),
                separates_background(filter.entry(), source, options, r)};
  const TilePlan tiles = plan_tiles(run, frame, sources);
  const std::vector<SignalLevel> levels = measure_levels(run, sources[0].recorded(), task, r);

  Gathered gathered(run, frame);
  const Totals totals = filter_tiles(run, sources, tiles, levels, gathered, task);
  if (filter.entry().settle) filter.entry().settle(gathered.layers);
  r.tiles = static_cast<size_t>(tiles.count());
  r.seconds = watch.seconds();

  if (options.component == Component::kIndirect) add_layer(gathered.sum, source.rgb(layer::direct));
  if (const Plane* alpha = source.find(layer::alpha.channel(0))) gathered.layers.set(layer::alpha.channel(0), *alpha);
  report_totals(totals, run, source, r);
  describe(gathered.layers.header, run, r.seconds, r.extreme_pixels);
  return std::move(gathered.layers);
}

}  // namespace brume
