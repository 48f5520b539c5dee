#include "filters/run/apply.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/peak_memory.h"
#include "base/text.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/inputs/alpha_weight.h"
#include "filters/inputs/extremes.h"
#include "filters/inputs/guide_layers.h"
#include "filters/inputs/planes.h"
#include "filters/run/alignment.h"

namespace brume {
namespace {

/// The median of the finite pixels among the 3 x 3; not finite where there are none.
float median_of_finite_neighbours(const Plane& plane, int x, int y) {
  std::vector<float> values;
  for (int qy = std::max(0, y - 1); qy <= std::min(plane.height() - 1, y + 1); ++qy)
    for (int qx = std::max(0, x - 1); qx <= std::min(plane.width() - 1, x + 1); ++qx)
      if (std::isfinite(plane(qx, qy))) values.push_back(plane(qx, qy));
  if (values.empty()) return plane(x, y);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Holes are closed from their rims inward; a plane without any finite pixel becomes 0.
Plane repaired_plane(const Plane& plane, std::set<std::pair<int, int>>& bad) {
  Plane result = plane;
  std::vector<ivec2> rim;
  size_t holes = 0;
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x)
      if (!std::isfinite(plane(x, y))) {
        ++holes;
        bad.insert({x, y});
        if (std::isfinite(median_of_finite_neighbours(plane, x, y))) rim.emplace_back(x, y);
      }
  if (holes == static_cast<size_t>(plane.width()) * static_cast<size_t>(plane.height()))
    return Plane(plane.width(), plane.height());
  while (!rim.empty()) {
    // Every pixel of a rim is made from what was there before it.
    std::vector<float> values;
    for (const ivec2& p : rim) values.push_back(median_of_finite_neighbours(result, p.x, p.y));
    for (size_t i = 0; i < rim.size(); ++i) result(rim[i].x, rim[i].y) = values[i];
    std::set<std::pair<int, int>> next;
    for (const ivec2& p : rim)
      for (int y = std::max(0, p.y - 1); y <= std::min(plane.height() - 1, p.y + 1); ++y)
        for (int x = std::max(0, p.x - 1); x <= std::min(plane.width() - 1, p.x + 1); ++x)
          if (!std::isfinite(result(x, y))) next.insert({x, y});
    rim.clear();
    for (const auto& [x, y] : next) rim.emplace_back(x, y);
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

/// Whether alpha has noise by what is known of the frame: by its statistics, or as brume's own, which is an estimate.
bool is_noisy_alpha(const Layers& frame) {
  constexpr double kFew = 0.01;  // share of the pixels that are partly covered
  const Plane* const alpha = frame.find(layer::alpha.channel(0));
  const Plane* const variance = frame.find(layer::alpha.channel_of(statistic::mean_variance, 0));
  if (!alpha || !variance) return frame.header.contains("sceneHash");
  double partial = 0, noisy = 0;
  for (int y = 0; y < alpha->height(); ++y)
    for (int x = 0; x < alpha->width(); ++x) {
      if (!((*alpha)(x, y) > 0 && (*alpha)(x, y) < 1)) continue;
      ++partial;
      noisy += (*variance)(x, y) > 0;
    }
  return noisy > kFew * partial;
}

/// A frame that is read: the one to clean, or another of the sequence. Not copied unless it has something to repair.
class Source {
 public:
  /// @param limited  signals whose extremes are limited
  /// @throws InputError for a signal without a finite pixel
  Source(const SequenceFrame& frame, const std::set<std::string>& readable, const std::vector<LayerName>& signals,
         const std::vector<LayerName>& limited, const Task& task)
      : distance(frame.distance), records(frame.records), frame_(frame.layers) {
    for (const std::string& name : readable)
      if (frame.layers->find(name)) channels_.push_back(name);
    std::vector<char> damaged(channels_.size());
    parallel_for(static_cast<int>(channels_.size()), quiet(task), [&](int i) {
      damaged[static_cast<size_t>(i)] = count_not_finite(frame.layers->at(channels_[static_cast<size_t>(i)])) > 0;
    });
    for (const LayerName& signal : signals)
      for (const std::string& name : signal.channel_names())
        if (const Plane* plane = frame.layers->find(name);
            plane &&
            count_not_finite(*plane) == static_cast<size_t>(plane->width()) * static_cast<size_t>(plane->height()))
          throw InputError(
              fmt::format("channel {}: all {} x {} pixels are NaN or infinite, so that there is nothing to clean", name,
                          plane->width(), plane->height()));
    std::set<std::pair<int, int>> bad;
    for (size_t i = 0; i < channels_.size(); ++i)
      if (damaged[i]) own_copy().set(channels_[i], repaired_plane(frame.layers->at(channels_[i]), bad));
    repaired = bad.size();
    for (const LayerName& signal : limited)
      if (const std::vector<Extreme> found = find_extremes(layers(), signal, task); !found.empty())
        extremes[signal.name] = limit_extremes(own_copy(), signal, found, task);
    if (const Plane* count = layers().find(layer::sample_count.channel(0))) samples = mean_of(*count);
  }
  const Layers& layers() const { return own_ ? fixed_ : *frame_; }
  /// The same without what go_on_outside() made of it.
  const Layers& as_recorded() const { return goes_on_ ? (own_before_ ? before_ : *frame_) : layers(); }
  /// Weighs signals by an alpha that tells without noise where they have light.
  /// @param goes_on  makes them go on outside of there, as filters are to see them
  /// @param carried  layers that go on where the first signal does
  void weigh_by_alpha(const std::vector<LayerName>& signals, const std::vector<LayerName>& carried, bool goes_on,
                      const Task& task) {
    const Plane* const alpha = layers().find(layer::alpha.channel(0));
    if (!alpha) return;
    goes_on = goes_on && !is_noisy_alpha(layers());
    const Plane* const opacity = layers().find(guide_layer::opacity.channel(0));
    std::map<std::string, Plane> changed;
    for (const LayerName& signal : signals) {
      AlphaWeight weight = alpha_weight(*alpha, layers().rgb(signal), opacity, task);
      if (weight.weight.empty()) continue;
      if (goes_on) {
        const EdgeFill fill(weight.weight, task);
        std::vector<std::string> names;
        for (const std::string& name : channels_)
          if (is_channel_of(signal, name)) names.push_back(name);
        if (&signal == &signals.front())
          for (const LayerName& l : carried)
            for (const std::string& name : l.channel_names()) names.push_back(name);
        for (const std::string& name : names)
          if (const Plane* plane = layers().find(name)) changed[name] = fill.filled(*plane, task);
      }
      weights[signal.name] = std::move(weight);
    }
    if (!changed.empty()) go_on_outside(std::move(changed));
  }
  bool goes_on() const { return goes_on_; }
  size_t channels() const { return channels_.size(); }
  /// Brings what is read of it to where it is in the frame to clean, channel by channel.
  void align_with(const Source& target, const Alignment& alignment, const Task& task) {
    Layers aligned(layers().width(), layers().height());
    aligned.header = layers().header;
    aligned.lie_like(layers());
    for (const std::string& name : channels_)
      if (const Plane* own = target.layers().find(name))
        aligned.set(name, alignment.bring(layers().at(name), *own, task));
    fixed_ = std::move(aligned);
    own_ = true;
  }
  /// What is read of a part of it: views, where its rows are aligned.
  Layers crop_to(const Box& box) const {
    Layers part(box.width(), box.height());
    part.header = layers().header;
    const bool aligned = static_cast<size_t>(box.x0) % Plane::kLine == 0;
    for (const std::string& name : channels_) {
      const Plane& whole = layers().at(name);
      part.set(name, aligned ? Plane::view(whole, box.x0, box.y0, box.width(), box.height()) : crop(whole, box));
    }
    for (const auto& [name, plane] : layers().stored())
      part.set_stored(name, plane.view(box.x0, box.y0, box.width(), box.height()));
    return part;
  }

  int distance;
  RecordReader* records;
  double samples = 0;                               // per pixel
  size_t repaired = 0;                              // pixels
  std::map<std::string_view, Extremes> extremes;    // by signal
  std::map<std::string_view, AlphaWeight> weights;  // by signal; none: alpha says nothing

 private:
  /// Whether it is a mean of all or some samples of a signal.
  static bool is_channel_of(const LayerName& signal, const std::string& name) {
    std::vector<std::string_view> means = {"", statistic::half_a, statistic::half_b};
    means.insert(means.end(), statistic::buckets.begin(), statistic::buckets.end());
    for (const std::string_view which : means)
      for (const std::string& channel : signal.channel_names(which))
        if (channel == name) return true;
    return false;
  }
  void go_on_outside(std::map<std::string, Plane> changed) {
    goes_on_ = true;
    own_before_ = own_;
    if (own_) before_ = std::move(fixed_);
    const Layers& from = as_recorded();
    Layers now(from.width(), from.height());
    now.header = from.header;
    now.lie_like(from);
    for (const auto& [name, plane] : from.channels())
      if (!changed.contains(name)) now.set(name, Plane::view(plane, 0, 0, plane.width(), plane.height()));
    for (auto& [name, plane] : changed) now.set(name, std::move(plane));
    for (const auto& [name, plane] : from.stored()) now.set_stored(name, plane.view(0, 0, from.width(), from.height()));
    fixed_ = std::move(now);
    own_ = true;
  }
  Layers& own_copy() {
    if (!own_) fixed_ = *frame_;
    own_ = true;
    return fixed_;
  }

  bool own_ = false;  // fixed_ is what there is
  const Layers* frame_;
  Layers fixed_;
  bool goes_on_ = false, own_before_ = false;
  Layers before_;  // what fixed_ was before it went on outside
  std::vector<std::string> channels_;
};

/// The part of the frames that is filtered at once.
struct Tile {
  Box outer, interior;                 // with its apron in the frame; without it, in the tile
  std::vector<const Layers*> sources;  // the frame to clean first
};

/// Where the results of all tiles are gathered.
struct Gathered {
  Layers layers;
  FilterOutput sum;                                // of the component's signals
  std::map<std::string_view, FilterOutput> parts;  // by signal, of a filter that cleans the parts apart
  std::vector<FilterOutput> carried;               // as options.carried
  std::map<std::string, Plane*> products;          // by full channel name

  Gathered(const Run& run, const Layers& frame) : layers(frame.width(), frame.height()) {
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
};

struct Totals {
  size_t not_finite = 0;
  double energy = 0;  // that the outlier rule took
  size_t outliers = 0;
  std::set<std::pair<int, int>> repaired_records;
  std::vector<std::string> notes;  // of the filter
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
  const bool limits = limits_outliers(run.options);
  s.mean = layers.rgb(name);
  const bool halves = has_halves(layers, name);
  if (halves) {
    s.half_a = layers.rgb(name, statistic::half_a);
    s.half_b = layers.rgb(name, statistic::half_b);
  }
  if ((entry.can_use_statistics >= Statistics::kVariance && entry.signal_variance) || limits) {
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
  s.removed = limit_outliers(s.own, run.options.outliers, task);
}

/// Everything that a filter is given of one frame, and what it points to.
struct Prepared {
  Signal signal;
  std::vector<Feature> features;
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
                       const SignalLevel& level, Totals& totals, const Task& task) {
  PreparedFrames prepared;
  for (size_t i = 0; i < sources.size(); ++i) {
    prepared.push_back(std::make_unique<Prepared>(run, sources[i], *tile.sources[i], name, task));
    FilterFrame& f = prepared.back()->frame;
    f.distance = sources[i].distance;
    f.origin = {tile.outer.x0, tile.outer.y0};
    f.repaired_records = &totals.repaired_records;
    f.all_guides = run.options.all_guides;
    f.notes = i == 0 ? &totals.notes : nullptr;
    f.typical_luminance = level.typical_luminance;
    f.lab_noise = level.lab_noise;
  }
  for (size_t i = 1; i < sources.size(); ++i) prepared[0]->frame.nearby.push_back(&prepared[i]->frame);
  return prepared;
}

/// Calls visit(x, y) for the pixels of a box.
template <class Visit>
void for_each_pixel(const Box& box, const Visit& visit) {
  for (int y = box.y0; y < box.y1; ++y)
    for (int x = box.x0; x < box.x1; ++x) visit(x, y);
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
  bilateral.run(frame, {&other[0], &other[1], &other[2]}, quiet(task));
  for (size_t c = 0; c < 3; ++c)
    for_each_pixel({0, 0, width, height}, [&](int x, int y) {
      if (coverage(x, y) == 0) out[c](x, y) = other[c](x, y);
    });
}

/// Runs the filter once over a tile. Pixels that it could not finish keep their input and are counted.
Rgb filtered(const Run& run, const FilterFrame& frame, const Box& interior, const Task& task, Totals& totals) {
  const int width = frame.width(), height = frame.height();
  Rgb out{Plane(width, height), Plane(width, height), Plane(width, height)};
  run.filter.run(frame, {&out[0], &out[1], &out[2]}, task);
  task.check();
  if (run.filter.entry().box) give_back_freed_memory();  // of a whole frame's work, before whole planes are written
  if (run.mask && !run.filter.entry().background) clean_background(frame, out, task);
  for_each_pixel(interior, [&](int x, int y) {
    if (std::isfinite(out[0](x, y)) && std::isfinite(out[1](x, y)) && std::isfinite(out[2](x, y))) return;
    ++totals.not_finite;
    for (size_t c = 0; c < 3; ++c) out[c](x, y) = (*frame.values[c])(x, y);
  });
  return out;
}

/// Filters one signal of a tile and adds the result to the sum; the first signal's weights also filter the carried
/// layers, and its run leaves the products.
void filter_signal(const Run& run, const std::vector<Source>& sources, const Tile& tile, const LayerName& name,
                   const SignalLevel& level, bool first_signal, Gathered& gathered, Totals& totals, const Task& task) {
  const PreparedFrames prepared = prepare(run, sources, tile, name, level, totals, task);
  FilterFrame& frame = prepared[0]->frame;
  const Box& interior = tile.interior;
  if (const Plane& removed = prepared[0]->signal.removed; !removed.empty())
    for_each_pixel(interior, [&](int x, int y) {
      totals.energy += removed(x, y);
      totals.outliers += removed(x, y) > 0;
    });

  const size_t carried = first_signal ? gathered.carried.size() : 0;
  const auto part = [&](size_t job) {
    const double jobs = static_cast<double>(1 + carried);
    return share(task, static_cast<double>(job) / jobs, static_cast<double>(job + 1) / jobs);
  };
  const ivec2 origin = frame.origin;
  const auto store = [&](const Plane& from, Plane& to) {
    for_each_pixel(interior, [&](int x, int y) { to(x + origin.x, y + origin.y) = from(x, y); });
  };
  const auto add = [&](const Plane& from, Plane& to) {
    for_each_pixel(interior, [&](int x, int y) { to(x + origin.x, y + origin.y) += from(x, y); });
  };
  std::map<std::string, Plane> produced;
  const bool parts = run.filter.entry().parts;
  if ((first_signal || parts) && !gathered.products.empty()) frame.products = &produced;
  const auto weight = sources[0].weights.find(name.name);
  const auto weigh = [&](Rgb& values) {
    if (weight == sources[0].weights.end()) return;
    const Plane& by = weight->second.weight;
    for (Plane& plane : values)
      for_each_pixel(interior, [&](int x, int y) {
        const float w = by(x + origin.x, y + origin.y);
        plane(x, y) *= sources[0].goes_on() ? w : static_cast<float>(w > 0);
      });
  };
  Rgb clean = filtered(run, frame, interior, part(0), totals);
  weigh(clean);
  if (const auto found = sources[0].extremes.find(name.name);
      found != sources[0].extremes.end() && !found->second.aside[0].empty())
    for (size_t c = 0; c < 3; ++c)
      for_each_pixel(interior,
                     [&](int x, int y) { clean[c](x, y) += found->second.aside[c](x + origin.x, y + origin.y); });
  for (size_t c = 0; c < 3; ++c) add(clean[c], *gathered.sum[c]);
  const auto kept = gathered.parts.find(name.name);
  if (kept != gathered.parts.end())
    for (size_t c = 0; c < 3; ++c) store(clean[c], *kept->second[c]);
  if (run.filter.entry().box)
    for (size_t c = 0; c < 3; ++c) {
      const auto extremes = sources[0].extremes.find(name.name);
      const Plane* const aside = extremes != sources[0].extremes.end() ? &extremes->second.aside[c] : nullptr;
      for (const Plane* from : {sources[0].layers().rgb(name)[c], aside}) {
        if (!from || from->empty()) continue;
        add_around(tile.outer, *from, *gathered.sum[c]);
        if (kept != gathered.parts.end()) add_around(tile.outer, *from, *kept->second[c]);
      }
    }
  if (frame.products)
    for (const auto& [channel, target] : gathered.products) {
      if (first_signal)
        store(produced.at(channel), *target);
      else
        add(produced.at(channel), *target);
    }
  frame.products = nullptr;

  for (size_t j = 0; j < carried; ++j) {
    for (size_t i = 0; i < sources.size(); ++i)
      prepared[i]->frame.values = tile.sources[i]->rgb(run.options.carried[j]);
    Rgb values = filtered(run, frame, interior, part(j + 1), totals);
    weigh(values);
    for (size_t c = 0; c < 3; ++c) store(values[c], *gathered.carried[j][c]);
  }
}

double noise_level(const Layers& layers, const LayerName& signal, const ApplyOptions& options, const Plane* medium,
                   const Task& task) {
  const RgbPlanes mean = layers.rgb(signal);
  if (options.noise == NoiseSource::kSpatial) {
    const Rgb variance = spatial_variance(mean, task);
    return lab_noise(mean, view(variance), {}, {}, options.exposure, medium);
  }
  if (has_halves(layers, signal))
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

/// How a frame is cut, or the only box that is filtered.
struct TilePlan {
  int side, apron;  // [px]
  int across, down;
  std::optional<Box> box = {};

  int count() const { return across * down; }
  bool cuts(const Layers& frame) const {
    return count() > 1 || (box && (box->width() < frame.width() || box->height() < frame.height()));
  }
  /// One of them, its layers not yet cut out.
  Tile tile(int index, const Layers& frame) const {
    if (box) return {*box, {0, 0, box->width(), box->height()}, {}};
    const int tx = index % across, ty = index / across;
    const Box inner{tx * side, ty * side, std::min(frame.width(), (tx + 1) * side),
                    std::min(frame.height(), (ty + 1) * side)};
    const Box outer = inner.grown(apron, frame.width(), frame.height());
    return {outer, {inner.x0 - outer.x0, inner.y0 - outer.y0, inner.x1 - outer.x0, inner.y1 - outer.y0}, {}};
  }
};

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
  int tile = filter.box ? longest : options.tile;
  if (tile == 0)
    // A frame that fits as a whole has no apron.
    tile = whole * pixels <= budget ? longest
                                    : std::max(kSmallestTile, static_cast<int>(std::sqrt(budget / tiled)) - 2 * apron);
  tile = std::clamp(tile, 1, longest);
  const double side = std::min<double>(tile + 2.0 * apron, longest);
  peak = read + written + (tile == longest ? whole : tiled) * side * std::min<double>(side, shortest);
  return tile;
}

/// Where any signal of any frame may change.
Box box_of(const Run& run, const std::vector<Source>& sources) {
  Box all{run.frame_size.x, run.frame_size.y, 0, 0};
  for (const Source& s : sources)
    for (const LayerName& signal : signals_of(run.options)) {
      const Box box = run.filter.entry().box(s.layers(), signal);
      if (box.width() <= 0) continue;
      all = {std::min(all.x0, box.x0), std::min(all.y0, box.y0), std::max(all.x1, box.x1), std::max(all.y1, box.y1)};
    }
  return all.width() > 0 ? all : Box{0, 0, 1, 1};
}

/// @throws InputError when the machine has not the memory
TilePlan plan_tiles(const Run& run, const Layers& frame, const std::vector<Source>& sources) {
  const FilterEntry& entry = run.filter.entry();
  const int apron = run.filter.apron() + (entry.can_use_statistics > Statistics::kNone ? kNoiseReach : 0) +
                    (limits_outliers(run.options) ? kOutlierReach : 0);
  size_t channels = 0;
  for (const Source& s : sources) channels += s.channels();
  double peak = 0;
  const int side = choose_tile(entry, frame, run.options, channels, apron, peak);
  if (peak > physical_memory())
    throw InputError(
        fmt::format("filter {} would hold {:.1f} GB for this frame in tiles of {} px, this machine has {:.1f} GB{}",
                    entry.name, peak / 1e9, side, physical_memory() / 1e9,
                    side > kSmallestTile ? fmt::format("; try --tile {}", kSmallestTile) : ""));
  TilePlan plan{side, apron, (frame.width() + side - 1) / side, (frame.height() + side - 1) / side};
  if (entry.box) plan.box = box_of(run, sources);
  return plan;
}

/// Brings the frames nearby to where the frame to clean is.
void align(std::vector<Source>& sources, const LayerName& signal, const Task& task) {
  for (size_t i = 1; i < sources.size(); ++i)
    sources[i].align_with(sources[0], find_alignment(sources[0].layers(), sources[i].layers(), signal, task), task);
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

std::vector<Source> read_sources(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options,
                                 const Task& task, ApplyReport& report) {
  const std::set<std::string> readable = readable_channels(filter, options, frame);
  const std::vector<LayerName> signals = signals_of(options);
  // What is carried along would keep the light that is taken from what carries it.
  const std::vector<LayerName> limited =
      options.outliers == Outliers::kExtreme && options.carried.empty() ? signals : std::vector<LayerName>();
  std::vector<Source> sources;
  sources.reserve(1 + options.sequence.size());
  sources.emplace_back(SequenceFrame{0, &frame, options.records}, readable, signals, limited, task);
  for (const SequenceFrame& other : options.sequence) sources.emplace_back(other, readable, signals, limited, task);
  // Guides know where a medium ends; records are of the picture as it is.
  const auto is_there = [&](const std::string& name) { return is_guide(name) && frame.find(name); };
  const bool guided =
      filter.entry().guides && (std::any_of(readable.begin(), readable.end(), is_there) || !frame.stored().empty());
  const bool recorded = filter.entry().records != FilterEntry::Records::kNo && options.records;
  for (Source& s : sources) s.weigh_by_alpha(signals, options.carried, !guided && !recorded, task);
  tell_weights(sources[0], report);
  if (filter.entry().aligned) align(sources, signals[0], task);
  for (const Source& s : sources) report.repaired_pixels += s.repaired;
  if (report.repaired_pixels)
    report.notes.push_back(fmt::format(
        "{} pixels were NaN or infinite and were replaced by the median of their neighbours", report.repaired_pixels));
  tell_extremes(sources[0], report);
  return sources;
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

void add_layer(const FilterOutput& sum, const RgbPlanes& other) {
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

  const std::vector<Source> sources = read_sources(requested, frame, options, task, r);
  const Layers& source = sources[0].layers();
  const FilterSettings filter = usable_settings(requested, options, r);
  const FeaturePlan features = plan_features(filter, source, options, task, r);
  const Run run{filter, options, features, ivec2(frame.width(), frame.height()),
                separates_background(filter.entry(), source, options, r)};
  const TilePlan tiles = plan_tiles(run, frame, sources);
  const std::vector<SignalLevel> levels = measure_levels(run, sources[0].as_recorded(), task, r);

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
