#include "filters/run/filter_signal.h"

#include <cmath>
#include <memory>

#include "base/peak_memory.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/patch/picture_noise.h"

namespace brume {
namespace {

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
  const bool limits = limits_outliers(run.options);
  s.mean = layers.rgb(name);
  const bool halves = has_halves(layers, name);
  if (halves) {
    s.half_a = layers.rgb(name, statistic::half_a);
    s.half_b = layers.rgb(name, statistic::half_b);
  }
  if ((entry.can_use_statistics >= Statistics::kVariance && entry.signal_variance) || limits) {
    if (run.options.noise == NoiseSource::kSpatial)
      s.own.variance = picture_variance(s.mean, task);
    else if (layers.has(name, statistic::mean_variance))
      s.own.variance = corrected_variance(s.mean, layers.rgb(name, statistic::mean_variance), s.half_a, s.half_b,
                                          layers.find(layer::sample_count.channel(0)), task);
    else if (halves)
      s.own.variance = variance_of_halves(s.mean, s.half_a, s.half_b, task);
    if (!halves && run.options.noise == NoiseSource::kLayers && !s.own.variance[0].empty())
      limit_variance(s.own.variance, s.mean, task);
    if (!s.own.variance[0].empty()) s.variance = view(s.own.variance);
  }
  if (layers.has(name, statistic::buckets[0]))
    for (const std::string_view bucket : statistic::buckets) s.buckets.push_back(layers.rgb(name, bucket));
  if (!limits || !s.variance[0]) return;
  s.own.mean = copied(s.mean);
  s.mean = view(s.own.mean);
  if (halves) {
    s.own.half_a = copied(s.half_a);
    s.half_a = view(s.own.half_a);
    s.own.half_b = copied(s.half_b);
    s.half_b = view(s.own.half_b);
  }
  for (RgbPlanes& bucket : s.buckets) s.own.buckets.push_back(copied(bucket));
  for (size_t i = 0; i < s.buckets.size(); ++i) s.buckets[i] = view(s.own.buckets[i]);
  s.removed = limit_outliers(s.own, run.options.outliers, FrameSpace(layers), task);
}

/// Everything that a filter is given of one frame, and what it points to.
struct Prepared {
  Signal signal;
  std::vector<Feature> features;
  Plane whole;  // a view
  FilterFrame frame;

  Prepared(const Run& run, const Source& source, const Layers& layers, const LayerName& name, const Task& task)
      : frame{run.options.light.name.empty() ? name : run.options.light, {}, {}, layers, run.options.exposure} {
    const FilterEntry& entry = run.filter.entry();
    read_signal(signal, layers, name, run, task);
    if (run.filter.uses_features())
      features = run.features.build(
          layers, {entry.can_use_statistics >= Statistics::kVariance, entry.can_use_statistics >= Statistics::kHalves},
          task);
    frame.signal = frame.values = signal.mean;
    if (run.mask && entry.background) frame.medium = &layers.at(layer::coverage.channel(0));
    frame.variance = signal.variance;
    frame.half_a = signal.half_a;
    frame.half_b = signal.half_b;
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

using PreparedFrames = std::vector<std::unique_ptr<Prepared>>;

/// One signal of a tile, in the frame to clean, which comes first, and in those nearby.
PreparedFrames prepare(const Run& run, const std::vector<Source>& sources, const Tile& tile, const LayerName& name,
                       const SignalLevel& level, const Task& task) {
  PreparedFrames prepared;
  for (size_t i = 0; i < sources.size(); ++i) {
    prepared.push_back(std::make_unique<Prepared>(run, sources[i], *tile.sources[i], name, task));
    FilterFrame& f = prepared.back()->frame;
    f.distance = sources[i].distance;
    f.origin = {tile.outer.x0, tile.outer.y0};
    f.all_guides = run.options.all_guides;
    if (i == 0 && run.options.whole) {
      const Box& b = tile.outer;
      prepared[0]->whole = Plane::view(*run.options.whole, b.x0, b.y0, b.width(), b.height());
      f.whole = &prepared[0]->whole;
    }
    f.typical_luminance = level.typical_luminance;
    f.lab_noise = level.lab_noise;
  }
  for (size_t i = 1; i < sources.size(); ++i) prepared[0]->frame.nearby.push_back(&prepared[i]->frame);
  return prepared;
}

/// Adds to a plane what lies outside of a box. Nothing is written where nothing is added, so that planes of zeros take
/// no memory.
void add_around(const Box& box, const Plane& from, Plane& to) {
  for (int y = 0; y < from.height(); ++y) {
    const bool beside = y < box.y0 || y >= box.y1;
    for (int x = 0; x < from.width(); ++x)
      if ((beside || x < box.x0 || x >= box.x1) && from(x, y) != 0) to(x, y) += from(x, y);
  }
}

/// Replaces what a filter made of the pixels without coverage, for filters that do not know of them.
void clean_background(const FilterFrame& frame, Rgb& out, const Task& task) {
  const Plane& coverage = frame.layers.at(layer::coverage.channel(0));
  const int width = frame.width(), height = frame.height();
  FilterSettings bilateral(find_filter("bilateral"));
  bilateral.set("preset", "paper");
  bilateral.set("average", "linear");
  Rgb other{Plane(width, height), Plane(width, height), Plane(width, height)};
  bilateral.run(frame, {{&other[0], &other[1], &other[2]}}, quiet(task));
  for (size_t c = 0; c < 3; ++c)
    for_each_pixel({0, 0, width, height}, [&](int x, int y) {
      if (coverage(x, y) == 0) out[c](x, y) = other[c](x, y);
    });
}

/// Runs the filter once over a tile. Pixels that it could not finish keep their input and are counted.
Rgb filtered(const Run& run, const FilterFrame& frame, const Box& interior, Totals& totals,
             std::map<std::string, Plane>* products, const Task& task) {
  const int width = frame.width(), height = frame.height();
  Rgb out{Plane(width, height), Plane(width, height), Plane(width, height)};
  run.filter.run(frame, {{&out[0], &out[1], &out[2]}, products, &totals.notes, &totals.repaired_records}, task);
  task.check();
  // Of a whole frame's work, before whole planes are written.
  if (run.filter.entry().box && saves_memory(static_cast<size_t>(width) * height)) give_back_freed_memory();
  if (run.mask && !run.filter.entry().background) clean_background(frame, out, task);
  for_each_pixel(interior, [&](int x, int y) {
    if (std::isfinite(out[0](x, y)) && std::isfinite(out[1](x, y)) && std::isfinite(out[2](x, y))) return;
    ++totals.not_finite;
    for (size_t c = 0; c < 3; ++c) out[c](x, y) = (*frame.values[c])(x, y);
  });
  return out;
}

/// Where a tile's results belong in the frame.
struct Place {
  const Tile& tile;
  const Source& source;
  const LayerName& name;

  void add(const Plane& from, Plane& to) const {
    for_each_pixel(tile.interior, [&](int x, int y) { to(tile.outer.x0 + x, tile.outer.y0 + y) += from(x, y); });
  }
  /// What was given to the filter as if it went on outside of its edges ends there again.
  void weigh_by_alpha(Rgb& values) const {
    const auto found = source.weights.find(name.name);
    if (found == source.weights.end()) return;
    for (Plane& plane : values)
      for_each_pixel(tile.interior, [&](int x, int y) {
        const float w = found->second.weight(tile.outer.x0 + x, tile.outer.y0 + y);
        plane(x, y) *= source.goes_on() ? w : static_cast<float>(w > 0);
      });
  }
  /// What was taken from extreme pixels and belongs to them; null: nothing.
  const Rgb* aside() const {
    const auto found = source.extremes.find(name.name);
    return found != source.extremes.end() && !found->second.aside[0].empty() ? &found->second.aside : nullptr;
  }
  void give_back_extremes(Rgb& values) const {
    if (const Rgb* const rest = aside())
      for (size_t c = 0; c < 3; ++c)
        for_each_pixel(tile.interior,
                       [&](int x, int y) { values[c](x, y) += (*rest)[c](tile.outer.x0 + x, tile.outer.y0 + y); });
  }
  /// The input, where the filter runs on a box alone.
  void add_input_around(size_t c, Plane& to) const {
    add_around(tile.outer, *source.layers().rgb(name)[c], to);
    if (const Rgb* const rest = aside()) add_around(tile.outer, (*rest)[c], to);
  }
};

}  // namespace

Gathered::Gathered(const Run& run, const Layers& frame) : layers(frame.width(), frame.height()) {
  layers.header = frame.header;
  layers.lie_like(frame);
  sum = layers.add_rgb(layer::beauty);
  for (const LayerName& l : run.options.carried) carried.push_back(layers.add_rgb(l));
  if (run.options.keep_parts || (run.filter.entry().parts && run.options.component == Component::kSeparate))
    for (const LayerName& signal : signals_of(run.options)) {
      if (signal.name == layer::direct.name) parts[signal.name] = layers.add_rgb(layer::clean_direct);
      if (signal.name == layer::indirect.name) parts[signal.name] = layers.add_rgb(layer::clean_indirect);
    }
  for (const LayerName& l : run.filter.entry().produces)
    for (const std::string& channel : l.channel_names()) products[channel] = &layers.add(channel);
}

void filter_signal(const Run& run, const std::vector<Source>& sources, const Tile& tile, const LayerName& name,
                   const SignalLevel& level, bool first_signal, Gathered& gathered, Totals& totals, const Task& task) {
  const PreparedFrames prepared = prepare(run, sources, tile, name, level, task);
  const FilterFrame& frame = prepared[0]->frame;
  const Place place{tile, sources[0], name};
  if (const Plane& removed = prepared[0]->signal.removed; !removed.empty())
    for_each_pixel(tile.interior, [&](int x, int y) {
      totals.energy += removed(x, y);
      totals.outliers += removed(x, y) > 0;
    });

  const size_t carried = first_signal ? gathered.carried.size() : 0;
  const auto part = [&](size_t job) {
    const double jobs = static_cast<double>(1 + carried);
    return share(task, static_cast<double>(job) / jobs, static_cast<double>(job + 1) / jobs);
  };
  const bool produces = (first_signal || run.filter.entry().parts) && !gathered.products.empty();
  std::map<std::string, Plane> products;
  Rgb clean = filtered(run, frame, tile.interior, totals, produces ? &products : nullptr, part(0));
  place.weigh_by_alpha(clean);
  place.give_back_extremes(clean);
  std::vector<Gathered::Target> targets = {gathered.sum};
  if (const auto kept = gathered.parts.find(name.name); kept != gathered.parts.end()) targets.push_back(kept->second);
  for (const Gathered::Target& target : targets)
    for (size_t c = 0; c < 3; ++c) {
      place.add(clean[c], *target[c]);
      if (run.filter.entry().box) place.add_input_around(c, *target[c]);
    }
  if (produces)
    for (const auto& [channel, target] : gathered.products) place.add(products.at(channel), *target);

  for (size_t j = 0; j < carried; ++j) {
    for (size_t i = 0; i < sources.size(); ++i)
      prepared[i]->frame.values = tile.sources[i]->rgb(run.options.carried[j]);
    Rgb values = filtered(run, frame, tile.interior, totals, nullptr, part(j + 1));
    place.weigh_by_alpha(values);
    for (size_t c = 0; c < 3; ++c) place.add(values[c], *gathered.carried[j][c]);
  }
}

}  // namespace brume
