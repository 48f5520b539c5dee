#include "filters/run/source.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.h"
#include "base/parallel_for.h"
#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"
#include "filters/inputs/holes.h"

namespace brume {
namespace {

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

/// Whether it is a mean of all or some samples of a signal.
bool is_channel_of(const LayerName& signal, const std::string& name) {
  std::vector<std::string_view> means = {"", statistic::half_a, statistic::half_b};
  means.insert(means.end(), statistic::buckets.begin(), statistic::buckets.end());
  for (const std::string_view which : means)
    for (const std::string& channel : signal.channel_names(which))
      if (channel == name) return true;
  return false;
}

/// Brings the frames nearby to where the frame to clean is.
void align(std::vector<Source>& sources, const LayerName& signal, const Task& task) {
  for (size_t i = 1; i < sources.size(); ++i)
    sources[i].align_with(sources[0], find_alignment(sources[0].layers(), sources[i].layers(), signal, task), task);
}

}  // namespace

Source::Source(const SequenceFrame& frame, const std::set<std::string>& readable, const std::vector<LayerName>& signals,
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
    if (damaged[i]) own_copy().set(channels_[i], without_holes(frame.layers->at(channels_[i]), bad));
  repaired = bad.size();
  for (const LayerName& signal : limited)
    if (const std::vector<Extreme> found = find_extremes(layers(), signal, task); !found.empty())
      extremes[signal.name] = limit_extremes(own_copy(), signal, found, task);
  if (const Plane* count = layers().find(layer::sample_count.channel(0)))
    samples = sum_of(*count) / (static_cast<double>(count->width()) * count->height());
}

void Source::weigh_by_alpha(const std::vector<LayerName>& signals, const std::vector<LayerName>& carried, bool goes_on,
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
  if (changed.empty()) return;
  goes_on_ = true;
  const Layers& from = recorded();
  given_.emplace(from.width(), from.height());
  given_->header = from.header;
  given_->lie_like(from);
  for (const auto& [name, plane] : from.channels())
    given_->set(name, Plane::view(plane, 0, 0, plane.width(), plane.height()));
  for (auto& [name, plane] : changed) given_->set(name, std::move(plane));
  for (const auto& [name, plane] : from.stored())
    given_->set_stored(name, plane.view(0, 0, from.width(), from.height()));
}

void Source::align_with(const Source& target, const Alignment& alignment, const Task& task) {
  Layers aligned(layers().width(), layers().height());
  aligned.header = layers().header;
  aligned.lie_like(layers());
  for (const std::string& name : channels_)
    if (const Plane* own = target.layers().find(name))
      aligned.set(name, alignment.bring(layers().at(name), *own, task));
  given_ = std::move(aligned);
}

Layers Source::crop_to(const Box& box) const {
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

std::vector<Source> read_sources(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options,
                                 const Task& task) {
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
  if (filter.entry().aligned) align(sources, signals[0], task);
  return sources;
}

}  // namespace brume
