#include "evaluate/protocol/external_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/text.h"
#include "filters/inputs/guide_layers.h"

namespace brume {
namespace {

/// What the protocol asks of a filter: what it is called and what it reads.
FilterEntry entry_of(const ExternalFilter& filter, const std::string& label) {
  FilterEntry entry;
  entry.name = label;
  entry.summary = filter.words;
  entry.source = filter.words;
  entry.needs = filter.layers;
  entry.guides = filter.guides;
  if (filter.statistics) entry.can_use_statistics = Statistics::kHalves;
  entry.variances = filter.statistics;
  // Once, on the whole frame.
  entry.box = [](const Layers& frame, const LayerName&) { return Box{0, 0, frame.width(), frame.height()}; };
  entry.apron = [](const std::any&) { return 0; };
  return entry;
}

constexpr std::string_view kStatistics[] = {statistic::mean_variance, statistic::half_a, statistic::half_b};

/// What the filter gets to see of a frame: what it asked for, and nothing that others did.
Layers visible_frame(const ExternalFilter& filter, const FilterFrame& f) {
  Layers frame(f.width(), f.height());
  frame.lie_like(f.layers);
  for (const auto& [name, value] : f.layers.header)
    if (!name.starts_with("evaluation")) frame.header[name] = value;  // those are the cache's
  const auto copy = [&](const LayerName& from, const LayerName& to, std::string_view which = "") {
    for (size_t c = 0; c < from.channels.size(); ++c)
      if (const Plane* plane = f.layers.find(from.channel_of(which, c))) frame.set(to.channel_of(which, c), *plane);
  };
  const auto copy_layer = [&](const LayerName& from, const LayerName& to) {
    copy(from, to);
    if (filter.statistics)
      for (const std::string_view which : kStatistics) copy(from, to, which);
  };
  for (const LayerName& l : {layer::alpha, layer::coverage}) copy(l, l);
  if (filter.statistics) copy(layer::sample_count, layer::sample_count);
  for (const LayerName& l : filter.layers) copy_layer(l, l);
  if (filter.guides)
    for (const auto& [name, plane] : f.layers.channels())
      if (is_guide(name)) frame.set(name, plane);
  copy_layer(f.name, layer::beauty);
  for (size_t c = 0; c < 3; ++c) frame.set(layer::beauty.channel(c), *f.signal[c]);
  return frame;
}

void check_picture(const Layers& picture, const Layers& frame) {
  if (!picture.has(layer::beauty))
    throw InputError(fmt::format("its picture has no channels R, G, B; it has: {}",
                                 picture.names().empty() ? "none" : join(picture.names())));
  if (picture.width() != frame.width() || picture.height() != frame.height())
    throw InputError(fmt::format("its picture has {} x {} pixels, expected {} x {} as the frame", picture.width(),
                                 picture.height(), frame.width(), frame.height()));
  size_t bad = 0;
  ivec2 first{0};
  const RgbPlanes rgb = picture.rgb(layer::beauty);
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x)
      if (!std::all_of(rgb.begin(), rgb.end(), [&](const Plane* p) { return std::isfinite((*p)(x, y)); }))
        if (bad++ == 0) first = {x, y};
  if (bad > 0)
    throw InputError(
        fmt::format("{} of the {} pixels of its picture are NaN or infinite, the first in column {}, row {}", bad,
                    picture.width() * picture.height(), first.x, first.y));
}

}  // namespace

void ExternalFilter::ask_for(const std::string& name, std::span<const LayerName> known, const std::string& where) {
  if (name == "guides" || is_guide(name)) {
    guides = true;
    return;
  }
  const auto found = std::find_if(known.begin(), known.end(), [&](const LayerName& l) { return l.name == name; });
  if (found == known.end()) {
    std::vector<std::string> names;
    for (const LayerName& l : known) names.emplace_back(l.name);
    names.emplace_back("guides");
    throw InputError(fmt::format("no layer '{}' for {}{}", name, where, suggestion(name, names)));
  }
  if (std::find(layers.begin(), layers.end(), *found) == layers.end()) layers.push_back(*found);
}

Contender external_contender(ExternalFilter filter, std::string label) {
  std::vector<std::string> layers;
  for (const LayerName& l : filter.layers) layers.emplace_back(l.name);
  filter.key +=
      fmt::format("\nlayers {}\nguides {}, statistics {}", join(layers, " "), filter.guides, filter.statistics);
  struct Held {
    ExternalFilter filter;
    FilterEntry entry;
  };
  FilterEntry entry = entry_of(filter, label);
  const auto held = std::make_shared<Held>(Held{std::move(filter), std::move(entry)});
  Contender contender{FilterSettings(held->entry), {}, std::move(label)};
  contender.external = {held, &held->filter};
  contender.guides = held->filter.guides;
  contender.study = false;
  return contender;
}

ExternalRun::ExternalRun(const Contender& contender, int spp, int64_t seed, double time_limit)
    : filter_(contender.external), entry_(contender.settings.entry()), spp_(spp), seed_(seed), time_limit_(time_limit) {
  entry_.run = [this](const std::any&, const FilterFrame& frame, const FilterOutput& out, const Task& task) {
    clean(frame, out, task);
  };
}

void ExternalRun::clean(const FilterFrame& frame, const FilterOutput& out, const Task& task) {
  const auto too_late = [&] { throw LimitPassed(fmt::format("took longer than {:g} s", time_limit_)); };
  if (time_limit_ > 0 && seconds >= time_limit_) too_late();
  const Layers visible = visible_frame(*filter_, frame);
  const ExternalOutput result = filter_->run({visible, spp_, seed_, time_limit_, seconds}, task);
  seconds += result.seconds;
  exchange_seconds += result.exchange_seconds;
  if (result.peak_bytes) peak_bytes = std::max(peak_bytes.value_or(0.0), *result.peak_bytes);
  check_picture(result.picture, visible);
  if (time_limit_ > 0 && seconds > time_limit_) too_late();
  const RgbPlanes rgb = result.picture.rgb(layer::beauty);
  for (size_t c = 0; c < 3; ++c) *out[c] = *rgb[c];
}

}  // namespace brume
