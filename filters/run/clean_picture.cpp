#include "filters/run/clean_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>
#include <list>

#include "base/error.h"
#include "base/text.h"
#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"
#include "filters/inputs/planes.h"
#include "filters/patch/picture_noise.h"
#include "filters/run/add_up.h"
#include "image/exr_copy.h"

namespace brume {
namespace {

constexpr const char *kRest = "the rest", *kOtherLights = "the other lights";

std::string type_of(const ExrInfo& file, const std::string& channel) {
  const auto it = std::find_if(file.channels.begin(), file.channels.end(),
                               [&](const ExrInfo::Channel& c) { return c.name == channel; });
  return it == file.channels.end() ? "" : it->type;  // colours made of luminance and chroma have none
}

std::string name_of_layer(const std::string& channel) {
  const std::string layer = channel.substr(0, channel.rfind('.'));
  return layer == channel ? "RGB" : layer.substr(layer.rfind('.') + 1);
}

bool is_uniform(const Plane& plane) {
  const float value = plane(0, 0);
  for (int y = 0; y < plane.height(); ++y)
    for (const float v : plane.pixels(y))
      if (v != value) return false;
  return true;
}

bool has_variance(const Layers& frame) {
  return frame.has(layer::beauty, statistic::mean_variance) || has_halves(frame, layer::beauty);
}

float median(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Gives a variance of unstated level that of the picture's own second differences, and one that only counts samples
/// which met a surface their estimate where it is 0.
void settle_variance(const ForeignSignal& signal, Layers& frame, std::vector<std::string>& notes, const Task& task) {
  if (!frame.has(layer::beauty, statistic::mean_variance)) return;
  const bool unstated = signal.variance->meaning == VarianceMeaning::kUnstated;
  if (!unstated && !signal.variance->of_surfaces) return;
  const RgbPlanes mean = frame.rgb(layer::beauty);
  const Rgb spatial = picture_variance(mean, quiet(task));
  const auto variance = frame.add_rgb(layer::beauty, statistic::mean_variance);
  if (unstated) {
    std::vector<float> ratios;
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < frame.height(); ++y)
        for (int x = 0; x < frame.width(); ++x)
          if ((*variance[c])(x, y) > 0 && spatial[c](x, y) > 0)
            ratios.push_back(spatial[c](x, y) / (*variance[c])(x, y));
    const float scale = ratios.empty() ? 1.0f : median(std::move(ratios));
    for (Plane* plane : variance)
      for (int y = 0; y < frame.height(); ++y)
        for (float& v : plane->pixels(y)) v *= scale;
    notes.push_back(fmt::format(
        "the variance of {} is taken as a pattern whose level the picture's own noise gives (times {:.3g}): the file does not say whether it is of samples or of their mean",
        signal.name, scale));
  }
  if (!signal.variance->of_surfaces) return;
  size_t lit = 0, without = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const vec3 m = color_at(mean, x, y);
      const vec3 v = color_at({variance[0], variance[1], variance[2]}, x, y);
      const vec3 s(spatial[0](x, y), spatial[1](x, y), spatial[2](x, y));
      if (m == vec3(0)) continue;
      ++lit;
      if (v != vec3(0) || !(luminance(s) > 1e-6f * luminance(m * m))) continue;
      ++without;
      for (int c = 0; c < 3; ++c) (*variance[static_cast<size_t>(c)])(x, y) = s[c];
    }
  if (without > 0)
    notes.push_back(fmt::format(
        "{:.3g} % of the lit pixels of {} have no variance in the file; theirs is estimated from the picture",
        100.0 * static_cast<double>(without) / static_cast<double>(lit), signal.name));
}

/// Estimates the variance of features that come without, so that a noisy one is not taken for a clean one.
void estimate_features(Layers& frame, const Task& task) {
  for (const LayerName& l : {layer::albedo, layer::normal}) {
    if (!frame.has(l) || frame.has(l, statistic::mean_variance)) continue;
    const Rgb variance = picture_variance(frame.rgb(l), quiet(task));
    for (size_t c = 0; c < 3; ++c) frame.set(l.channel_of(statistic::mean_variance, c), variance[c]);
  }
}

/// Passes as they are stored, in their order: signals[i] is planes[i].
struct Parts {
  std::vector<ForeignSignal> signals;
  std::vector<RgbPlanes> planes;
  std::vector<RgbPlanes> factors;  // null: none

  void add(const ForeignSignal& signal, const Layers& file) {
    const auto of = [&](const ChannelTriple& c) {
      return RgbPlanes{file.find(c[0]), file.find(c[1]), file.find(c[2])};
    };
    signals.push_back(signal);
    planes.push_back(of(signal.channels));
    factors.push_back(signal.factor ? of(*signal.factor) : RgbPlanes{});
  }
  float sum(size_t c, int x, int y) const {
    float sum = 0, group = 0;
    bool first = true;
    for (size_t i = 0; i < signals.size(); ++i) {
      const float value = (*planes[i][c])(x, y);
      const bool goes_on = i > 0 && factors[i][c] && factors[i][c] == factors[i - 1][c];
      group = goes_on ? group + value : value;
      const bool last = i + 1 == signals.size() || !factors[i][c] || factors[i + 1][c] != factors[i][c];
      if (!last) continue;
      const float term = factors[i][c] ? group * (*factors[i][c])(x, y) : group;
      sum = first ? term : sum + term;
      first = false;
    }
    return sum;
  }
  float sum_of_sizes(size_t c, int x, int y) const {
    float sum = 0;
    for (size_t i = 0; i < signals.size(); ++i)
      sum += std::abs((*planes[i][c])(x, y) * (factors[i][c] ? (*factors[i][c])(x, y) : 1.0f));
    return sum;
  }
  /// @param name_of  a signal's name
  std::string text(const std::function<std::string(const ForeignSignal&)>& name_of) const {
    std::vector<std::string> terms, group;
    for (size_t i = 0; i < signals.size(); ++i) {
      group.push_back(name_of(signals[i]));
      if (i + 1 < signals.size() && signals[i].factor && signals[i + 1].factor == signals[i].factor) continue;
      if (signals[i].factor) {
        const std::string sum = group.size() > 1 ? "(" + join(group, " + ") + ")" : group[0];
        terms.push_back(sum + " * " + name_of_layer(signals[i].factor->front()));
      } else {
        terms.push_back(group[0]);
      }
      group.clear();
    }
    return join(terms, " + ");
  }
};

/// Takes the passes away from the picture. @return whether more than rounding is left
bool subtract(const Parts& parts, const std::array<Plane*, 3>& picture, bool half) {
  const float tolerance = half ? 4e-3f : 1e-4f;
  bool any = false;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < picture[c]->height(); ++y)
      for (int x = 0; x < picture[c]->width(); ++x) {
        float& value = (*picture[c])(x, y);
        const float whole = value;
        value -= parts.sum(c, x, y);
        any |= std::abs(value) > tolerance * (std::abs(whole) + parts.sum_of_sizes(c, x, y)) + 1e-6f;
      }
  return any;
}

void add_unique(std::vector<std::string>& list, const std::string& text) {
  if (!text.empty() && std::find(list.begin(), list.end(), text) == list.end()) list.push_back(text);
}

/// Everything that the filter is given beside its signal.
Layers surroundings(const ForeignFrame& picture, const Layers& file, const std::set<std::string>& extra) {
  Layers frame(file.width(), file.height());
  frame.lie_like(file);
  frame.header = file.header;
  if (!picture.of_brume) frame.header[kForeignRenderer] = picture.renderer;
  const std::vector<std::string> own = picture.channels();
  for (const std::string& name : extra) {
    // Parts of the picture under brume's names would be cleaned in place of the signal.
    if (name.find('.') == std::string::npos || name.starts_with("direct.") || name.starts_with("indirect.")) continue;
    // It may be another eye's.
    if (picture.one_of_views && !is_guide(name)) continue;
    const Plane* plane = file.find(name);
    if (plane && !std::binary_search(own.begin(), own.end(), name)) frame.set(name, *plane);
  }
  adopt_features(picture, file, frame);
  if (const Plane* alpha = picture.alpha.empty() ? nullptr : file.find(picture.alpha)) {
    Plane usable = *alpha;  // 1, which hides nothing, where it is no number
    for (int y = 0; y < usable.height(); ++y)
      for (float& v : usable.pixels(y))
        if (!std::isfinite(v)) v = 1;
    frame.set(layer::alpha.channel(0), std::move(usable));
  }
  return frame;
}

/// The frame without its beauty and what belongs to that.
Layers without_signal(Layers frame) {
  std::set<std::string> signal;
  for (const auto which : {std::string_view(), statistic::mean_variance, statistic::half_a, statistic::half_b})
    for (const std::string& name : layer::beauty.channel_names(which)) signal.insert(name);
  Layers rest(frame.width(), frame.height());
  rest.lie_like(frame);
  rest.header = frame.header;
  for (const std::string& name : frame.names())
    if (!signal.contains(name)) rest.set(name, std::move(*frame.find(name)));
  return rest;
}

/// Adds what light groups leave of their picture to the file, and to them, unless it is rounding.
void add_other_lights(ForeignFrame& picture, Layers& file, const ExrInfo& info) {
  if (picture.lights.empty()) return;
  ForeignSignal others{.name = kOtherLights, .channels = {}};
  Parts parts;
  bool half = type_of(info, picture.color.channels[0]) == "half";
  for (const ForeignSignal& light : picture.lights) {
    parts.add(light, file);
    half |= type_of(info, light.channels[0]) == "half";
  }
  std::array<Plane*, 3> planes{};
  for (size_t c = 0; c < 3; ++c) {
    others.channels[c] = std::string("brume.other_lights.") + layer::beauty.channels[c];
    file.set(others.channels[c], *file.find(picture.color.channels[c]));
    planes[c] = file.find(others.channels[c]);
  }
  if (subtract(parts, planes, half)) picture.lights.push_back(others);
}

/// A power of two that brings the mean luminance of a very dark picture to about 1 / 8, where filters' guards against
/// division by nothing are small; 1 for others.
float lift_of(const Layers& file, const ChannelTriple& channels, const FrameSpace& space) {
  constexpr double kDark = 1.0 / 1024;
  const RgbPlanes rgb{file.find(channels[0]), file.find(channels[1]), file.find(channels[2])};
  double sum = 0, count = 0;
  for (int y = 0; y < file.height(); ++y)
    for (int x = 0; x < file.width(); ++x)
      if (const double light = std::abs(space.luminance(color_at(rgb, x, y))); std::isfinite(light))
        sum += light, ++count;
  const double mean = count > 0 ? sum / count : 0;
  if (!(mean > 0 && mean < kDark)) return 1;
  return static_cast<float>(std::exp2(std::min(-3 - std::floor(std::log2(mean)), 60.0)));
}

void scale(Plane& plane, float factor) {
  for (int y = 0; y < plane.height(); ++y)
    for (float& v : plane.pixels(y)) v *= factor;
}

/// Times a factor the beauty and what belongs to it.
void scale_signal(Layers& frame, float factor) {
  if (factor == 1) return;
  for (const auto which : {std::string_view(), statistic::half_a, statistic::half_b, statistic::mean_variance})
    for (const std::string& name : layer::beauty.channel_names(which))
      if (Plane* const plane = frame.find(name))
        scale(*plane, which == statistic::mean_variance ? factor * factor : factor);
}

/// Runs the filter on one signal after another and puts what comes out in its place, rounded as it is stored. Planes
/// that are not needed any more are given back early, so that large frames fit.
class SignalFilter {
 public:
  SignalFilter(const FilterSettings& filter, const ForeignFrame& picture, Layers& file, const ExrInfo& info,
               const ApplyOptions& options, const Task& task, CleanPicture& result, Plane whole)
      : filter_(filter),
        picture_(picture),
        file_(file),
        info_(info),
        options_(options),
        others_(options.sequence),
        result_(result),
        lift_(lift_of(file, picture.color.channels, FrameSpace(file))),
        whole_(std::move(whole)) {
    scale(whole_, lift_);
    options_.component = Component::kAll;
    options_.exposure /= static_cast<double>(lift_);
    options_.sequence.clear();
    extra_ = readable_channels(filter, options_, file);
    frame_ = surroundings(picture, file, extra_);
    ForeignFrame light = picture;
    light.features.clear();
    light.alpha.clear();
    const std::vector<std::string> still_read = light.channels();
    for (const std::string& name : file.names())
      if (!std::binary_search(still_read.begin(), still_read.end(), name)) *file.find(name) = Plane();
    if (filter.uses_features()) estimate_features(frame_, task);
  }

  void operator()(const ForeignSignal& signal, const Task& task) {
    add_unique(result_.notes, adopt_signal(picture_, signal, file_, frame_));
    scale_signal(frame_, lift_);
    settle_variance(signal, frame_, result_.notes, task);
    ApplyOptions options = options_;
    if (!whole_.empty() && !signal.factor) options.whole = &whole_;
    const bool is_pass = std::any_of(picture_.passes.begin(), picture_.passes.end(),
                                     [&](const ForeignSignal& pass) { return pass.channels == signal.channels; });
    if (is_pass) options.light = signal.indirect ? layer::indirect : layer::direct;
    if (!has_variance(frame_)) {
      options.noise = NoiseSource::kSpatial;
      estimated_.push_back(signal.name);
    }
    std::list<Layers> nearby;
    // What the passes of other frames leave is not known.
    const bool rest = signal.name == kRest || signal.name == kOtherLights;
    for (const SequenceFrame& other : rest ? std::vector<SequenceFrame>() : others_) {
      const Layers& theirs = nearby.emplace_back(neighbour(other, signal, task));
      options.sequence.push_back({other.distance, &theirs, other.records});
    }
    for (const std::string& channel : signal.channels) *file_.find(channel) = Plane();
    ApplyReport report;
    Layers clean = apply_filter(filter_, frame_, options, task, &report);
    frame_ = without_signal(std::move(frame_));
    for (size_t c = 0; c < 3; ++c) {
      Plane& values = *file_.find(signal.channels[c]);
      values = std::move(*clean.find(layer::beauty.channel(c)));
      scale(values, 1 / lift_);
      if (type_of(info_, signal.channels[c]) == "half" && signal.name != kRest) round_to_half(values);
    }
    result_.cleaned.push_back(signal.name);
    result_.seconds += report.seconds;
    for (const std::string& line : report.notes) said_of_[line].push_back(signal.name);
    for (const char* key : {"filter", "filterParameters", "filterBackground", "filterExposure", "filterSource",
                            "filterFrames", "filterFeatures", "filterOutliers"})
      if (const auto it = clean.header.find(key); it != clean.header.end()) result_.header[key] = it->second;
    if (const auto it = result_.header.find("filterExposure"); it != result_.header.end())
      it->second = static_cast<float>(options_.exposure * static_cast<double>(lift_));
  }

  /// What was said of several signals is said once, of all of them.
  void finish() {
    for (const auto& [line, names] : said_of_) add_unique(result_.notes, fmt::format("{}: {}", join(names), line));
    if (!estimated_.empty() && options_.noise != NoiseSource::kSpatial)
      add_unique(result_.notes,
                 fmt::format("no variance in the file for {}: estimated from the picture (--noise spatial)",
                             join(estimated_)));
  }

 private:
  /// The same signal of another frame of the sequence.
  Layers neighbour(const SequenceFrame& other, const ForeignSignal& signal, const Task& task) const {
    ForeignSignal theirs = other.picture->color;
    std::vector<ForeignSignal> all = cleaned_signals(*other.picture);
    all.insert(all.end(), other.picture->lights.begin(), other.picture->lights.end());
    for (const ForeignSignal& s : all)
      if (s.name == signal.name) theirs = s;
    std::vector<std::string> ignored;
    Layers frame = frame_of_signal(*other.picture, theirs, *other.layers, extra_);
    scale_signal(frame, lift_);
    settle_variance(theirs, frame, ignored, task);
    if (filter_.uses_features()) estimate_features(frame, task);
    return frame;
  }

  const FilterSettings& filter_;
  const ForeignFrame& picture_;
  Layers& file_;
  const ExrInfo& info_;
  ApplyOptions options_;  // for a signal
  const std::vector<SequenceFrame>& others_;
  CleanPicture& result_;
  std::set<std::string> extra_;
  const float lift_;                                         // factor on all light while it is filtered
  Plane whole_;                                              // luminance of all parts; empty: there are none
  Layers frame_;                                             // without a signal between two runs
  std::vector<std::string> estimated_;                       // signals without statistics
  std::map<std::string, std::vector<std::string>> said_of_;  // notes, by their text: of which signals
};

/// Cleans a picture in the order of its public members.
class PictureCleaner {
 public:
  /// @throws InputError where the picture is of whole numbers, or has nothing that may be cleaned
  PictureCleaner(const ForeignFrame& given, Layers& file, const ExrInfo& info, bool only_indirect, const Task& task)
      : given_(given), picture_(given), file_(file), info_(info), only_indirect_(only_indirect), task_(task) {
    add_other_lights(picture_, file, info);
    result_.notes = picture_.remarks;
    for (const std::string& name : picture_.channels())
      if (type_of(info, name) == "uint" && name != picture_.sample_count && name != picture_.alpha)
        throw InputError(fmt::format("channel {} holds whole numbers, which are no light", name));
    signals_ = cleaned_signals(picture_);
    if (std::none_of(signals_.begin(), signals_.end(), [&](const ForeignSignal& s) { return wanted(s); }))
      throw InputError("no pass is known to be light scattered more than once, which --component indirect cleans");
  }

  /// What passes leave of the picture becomes a signal of its own, in the picture's channels.
  void take_passes_apart() {
    if (!has_passes()) return;
    const auto colors = planes(picture_.color.channels);
    light_ = luminance_of({colors[0], colors[1], colors[2]}, FrameSpace(file_), task_);
    bool half = type_of(info_, picture_.color.channels[0]) == "half";
    for (const ForeignSignal& pass : picture_.passes) {
      parts_.add(pass, file_);
      half |= type_of(info_, pass.channels[0]) == "half";
    }
    if (!subtract(parts_, colors, half)) return;
    signals_.push_back({.name = kRest, .channels = picture_.color.channels});
    parts_.add(signals_.back(), file_);
    result_.notes.push_back(fmt::format(
        "the passes do not make up the whole of {}: what they leave is {} too, as a part of its own that no channel holds",
        picture_.color.name, only_indirect_ ? "kept" : "cleaned"));
  }

  void filter_signals(const FilterSettings& filter, const ApplyOptions& options) {
    SignalFilter clean(filter, picture_, file_, info_, options, task_, result_, std::move(light_));
    const auto count = static_cast<double>(signals_.size() + picture_.lights.size());
    double done = 0;
    const auto clean_next = [&](const ForeignSignal& signal, bool skipped) {
      if (!skipped) clean(signal, share(task_, done / count, (done + 1) / count));
      ++done;
    };
    for (const ForeignSignal& signal : signals_)
      clean_next(signal, !wanted(signal) || (has_passes() && is_uniform_signal(signal)));
    for (const ForeignSignal& light : picture_.lights) clean_next(light, is_uniform_signal(light));
    clean.finish();
  }

  /// The picture becomes the sum of its parts. @return that sum, where light groups are to add up to it
  std::array<Plane, 3> add_up_passes() {
    std::array<Plane, 3> sums;
    if (!has_passes()) return sums;
    const bool rest = signals_.size() > picture_.passes.size();
    for (size_t c = 0; c < 3; ++c) {
      Plane whole(file_.width(), file_.height());
      for (int y = 0; y < file_.height(); ++y)
        for (int x = 0; x < file_.width(); ++x) whole(x, y) = parts_.sum(c, x, y);
      if (type_of(info_, picture_.target[c]) == "half") round_to_half(whole);
      if (!picture_.lights.empty()) sums[c] = whole;
      if (rest) *file_.find(picture_.color.channels[c]) = Plane();
      result_.channels.push_back({picture_.target[c], std::move(whole)});
    }
    return sums;
  }

  /// Makes light groups add up to the clean picture.
  void fit_lights(const std::array<Plane, 3>& sums) {
    if (picture_.lights.empty()) return;
    std::vector<std::array<Plane*, 3>> lights;
    for (const ForeignSignal& group : picture_.lights) lights.push_back(planes(group.channels));
    const auto whole = planes(picture_.color.channels);
    add_up_exactly(lights, {},
                   has_passes() ? RgbPlanes{&sums[0], &sums[1], &sums[2]} : RgbPlanes{whole[0], whole[1], whole[2]},
                   task_);
    for (const ForeignSignal& group : given_.lights)
      for (const std::string& channel : group.channels) {
        Plane& values = *file_.find(channel);
        if (type_of(info_, channel) == "half") round_to_half(values);
        result_.channels.push_back({channel, std::move(values)});
      }
  }

  CleanPicture result(const std::string& suffix) {
    const auto written_name = [&](const std::string& channel) {
      return name_of_layer(suffix.empty() ? channel : channel_beside(channel, suffix));
    };
    if (has_passes())
      result_.sum = fmt::format("{} = {}", written_name(picture_.target[0]), parts_.text([&](const ForeignSignal& s) {
        return was_cleaned(s) && !suffix.empty() ? written_name(s.channels[0]) : s.name;
      }));
    for (const ForeignSignal& signal : signals_) {
      if (!was_cleaned(signal)) continue;
      const ChannelTriple& target = has_passes() ? signal.channels : picture_.target;
      const size_t channels = target[0] == target[1] ? 1 : 3;  // grey
      for (size_t c = 0; c < channels; ++c)
        result_.channels.push_back({target[c], std::move(*file_.find(signal.channels[c]))});
    }
    return std::move(result_);
  }

 private:
  bool has_passes() const { return !picture_.passes.empty(); }
  bool wanted(const ForeignSignal& s) const { return !only_indirect_ || s.indirect; }
  bool was_cleaned(const ForeignSignal& s) const {
    return s.name != kRest &&
           std::find(result_.cleaned.begin(), result_.cleaned.end(), s.name) != result_.cleaned.end();
  }
  std::array<Plane*, 3> planes(const ChannelTriple& channels) const {
    return {file_.find(channels[0]), file_.find(channels[1]), file_.find(channels[2])};
  }
  bool is_uniform_signal(const ForeignSignal& signal) const {
    const auto colours = planes(signal.channels);
    return std::all_of(colours.begin(), colours.end(), [](const Plane* p) { return is_uniform(*p); });
  }

  const ForeignFrame& given_;
  ForeignFrame picture_;  // with what its light groups leave
  Layers& file_;
  const ExrInfo& info_;
  const bool only_indirect_;
  const Task& task_;
  std::vector<ForeignSignal> signals_;  // that may be cleaned: the passes and what they leave, or the picture
  Parts parts_;                         // whose sum the picture is, where it has passes
  Plane light_;                         // its luminance
  CleanPicture result_;
};

}  // namespace

std::string channel_beside(const std::string& channel, const std::string& suffix) {
  const size_t dot = channel.rfind('.');
  if (dot != std::string::npos) return channel.substr(0, dot) + suffix + channel.substr(dot);
  const auto letter = std::find_if(suffix.begin(), suffix.end(), [](unsigned char c) { return std::isalnum(c); });
  return std::string(letter, suffix.end()) + "." + channel;
}

std::vector<ForeignSignal> cleaned_signals(const ForeignFrame& picture) {
  return picture.passes.empty() ? std::vector<ForeignSignal>{picture.color} : picture.passes;
}

Layers frame_of_signal(const ForeignFrame& picture, const ForeignSignal& signal, const Layers& file,
                       const std::set<std::string>& extra) {
  Layers frame = surroundings(picture, file, extra);
  adopt_signal(picture, signal, file, frame);
  return frame;
}

CleanPicture clean_picture(const FilterSettings& filter, const ForeignFrame& picture, Layers file, const ExrInfo& info,
                           const ApplyOptions& options, const Task& task, const std::string& suffix) {
  PictureCleaner cleaner(picture, file, info, options.component == Component::kIndirect, task);
  cleaner.take_passes_apart();
  cleaner.filter_signals(filter, options);
  const std::array<Plane, 3> sums = cleaner.add_up_passes();
  cleaner.fit_lights(sums);
  return cleaner.result(suffix);
}

}  // namespace brume
