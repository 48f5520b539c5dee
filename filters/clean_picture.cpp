#include "filters/clean_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <list>

#include "base/error.h"
#include "base/text.h"
#include "filters/planes.h"
#include "filters/requirements.h"
#include "image/exr_copy.h"

namespace brume {
namespace {

constexpr const char* kRest = "the rest";

std::string type_of(const ExrInfo& file, const std::string& channel) {
  const auto it = std::find_if(file.channels.begin(), file.channels.end(),
                               [&](const ExrInfo::Channel& c) { return c.name == channel; });
  return it == file.channels.end() ? "half" : it->type;  // colours made of luminance and chroma have no type
}

void round_as_stored(const ExrInfo& file, const std::string& channel, Plane& values) {
  if (type_of(file, channel) == "half") round_to_half(values);
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

/// Gives a variance of unstated level that of the picture's own second differences, and pixels with light but without
/// variance their estimate. Some renderers count only the samples that met a surface.
void settle_variance(const ForeignSignal& signal, Layers& frame, std::vector<std::string>& notes, const Task& task) {
  if (!frame.has(layer::beauty, statistic::mean_variance)) return;
  const RgbPlanes mean = frame.rgb(layer::beauty);
  const Rgb spatial = spatial_variance(mean, quiet(task));
  const auto variance = frame.add_rgb(layer::beauty, statistic::mean_variance);
  if (signal.variance->meaning == VarianceMeaning::kUnstated) {
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
    notes.push_back(
        fmt::format("the variance of {} is taken as a pattern whose level the picture's own noise gives (times "
                    "{:.3g}): the file does not say whether it is of samples or of their mean",
                    signal.name, scale));
  }
  size_t lit = 0, without = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const vec3 m((*mean[0])(x, y), (*mean[1])(x, y), (*mean[2])(x, y));
      const vec3 v((*variance[0])(x, y), (*variance[1])(x, y), (*variance[2])(x, y));
      const vec3 s(spatial[0](x, y), spatial[1](x, y), spatial[2](x, y));
      if (m == vec3(0)) continue;
      ++lit;
      if (v != vec3(0) || luminance(s) <= 1e-6f * luminance(m * m)) continue;
      ++without;
      for (int c = 0; c < 3; ++c) (*variance[static_cast<size_t>(c)])(x, y) = s[c];
    }
  if (without > 0)
    notes.push_back(
        fmt::format("{:.3g} % of the lit pixels of {} have no variance in the file; theirs is estimated from "
                    "the picture",
                    100.0 * static_cast<double>(without) / static_cast<double>(lit), signal.name));
}

/// Estimates the variance of features that come without, so that a noisy one is not taken for a clean one.
void estimate_features(Layers& frame, const Task& task) {
  for (const LayerName& l : {layer::albedo, layer::normal}) {
    if (!frame.has(l) || frame.has(l, statistic::mean_variance)) continue;
    const Rgb variance = spatial_variance(frame.rgb(l), quiet(task));
    for (size_t c = 0; c < 3; ++c) frame.set(l.channel_of(statistic::mean_variance, c), variance[c]);
  }
}

/// Passes as they are stored, in their order: signals[i] is planes[i].
struct Parts {
  std::vector<ForeignSignal> signals;
  std::vector<std::array<const Plane*, 3>> planes;
  std::vector<std::array<const Plane*, 3>> factors;  // null: none

  float sum(size_t c, int x, int y) const {
    float sum = 0, group = 0;
    for (size_t i = 0; i < signals.size(); ++i) {
      const float value = (*planes[i][c])(x, y);
      const bool goes_on = i > 0 && factors[i][c] && factors[i][c] == factors[i - 1][c];
      group = goes_on ? group + value : value;
      const bool last = i + 1 == signals.size() || !factors[i][c] || factors[i + 1][c] != factors[i][c];
      if (!last) continue;
      const float term = factors[i][c] ? group * (*factors[i][c])(x, y) : group;
      sum = i == 0 ? term : sum + term;
    }
    return sum;
  }
  float sum_of_sizes(size_t c, int x, int y) const {
    float sum = 0;
    for (size_t i = 0; i < signals.size(); ++i)
      sum += std::abs((*planes[i][c])(x, y) * (factors[i][c] ? (*factors[i][c])(x, y) : 1.0f));
    return sum;
  }
  std::string text() const {
    std::vector<std::string> terms, group;
    for (size_t i = 0; i < signals.size(); ++i) {
      group.push_back(signals[i].name);
      if (i + 1 < signals.size() && signals[i].factor && signals[i + 1].factor == signals[i].factor) continue;
      if (signals[i].factor) {
        const std::string& factor = (*signals[i].factor)[0];
        const std::string layer = factor.substr(0, factor.rfind('.'));
        terms.push_back(fmt::format("({}) * {}", join(group, " + "), layer.substr(layer.rfind('.') + 1)));
      } else {
        terms.push_back(group[0]);
      }
      group.clear();
    }
    return join(terms, " + ");
  }
};

/// What the passes leave of the picture; nothing where that is only rounding.
std::optional<Rgb> rest_of(const Layers& file, const ForeignFrame& picture, const Parts& parts, bool half) {
  const float tolerance = half ? 4e-3f : 1e-4f;
  const int width = file.width(), height = file.height();
  Rgb rest{Plane(width, height), Plane(width, height), Plane(width, height)};
  bool any = false;
  for (size_t c = 0; c < 3; ++c) {
    const Plane& whole = file.at(picture.color.channels[c]);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        const float left = whole(x, y) - parts.sum(c, x, y);
        rest[c](x, y) = left;
        any |= std::abs(left) > tolerance * (std::abs(whole(x, y)) + parts.sum_of_sizes(c, x, y)) + 1e-6f;
      }
  }
  return any ? std::optional<Rgb>(std::move(rest)) : std::nullopt;
}

void add_unique(std::vector<std::string>& list, const std::string& text) {
  if (!text.empty() && std::find(list.begin(), list.end(), text) == list.end()) list.push_back(text);
}

/// Runs the filter on one signal after another.
class SignalFilter {
 public:
  SignalFilter(const FilterSettings& filter, const PictureInFile& picture, const std::vector<PictureInFile>& others,
               const ApplyOptions& options, CleanPicture& result)
      : filter_(filter), picture_(picture), others_(others), options_(options), result_(result) {
    options_.component = Component::kAll;
    options_.records = picture.records;
    for (const std::string& name : readable_channels(filter, options_, Layers(1, 1))) extra_.insert(name);
  }

  Rgb operator()(const ForeignSignal& signal, const Task& task) {
    Layers frame = prepared(picture_, signal, task, &result_.notes);
    return run(signal, std::move(frame), task);
  }
  /// The same of planes that are in no file.
  Rgb operator()(const ForeignSignal& signal, Rgb planes, const Task& task) {
    Layers frame = prepared(picture_, picture_.picture->color, task, nullptr);
    Layers bare(frame.width(), frame.height());
    bare.lie_like(frame);
    bare.header = frame.header;
    for (const auto& [name, plane] : frame.channels())
      if (!is_of_beauty(name)) bare.set(name, plane);
    for (size_t c = 0; c < 3; ++c) bare.set(layer::beauty.channel(c), std::move(planes[c]));
    return run(signal, std::move(bare), task);
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
  static bool is_of_beauty(const std::string& name) {
    for (const auto which : {std::string_view(), statistic::mean_variance, statistic::half_a, statistic::half_b})
      for (const std::string& channel : layer::beauty.channel_names(which))
        if (channel == name) return true;
    return false;
  }
  Layers prepared(const PictureInFile& picture, const ForeignSignal& signal, const Task& task,
                  std::vector<std::string>* notes) const {
    std::vector<std::string> ignored;
    Layers frame = frame_of_signal(picture, signal, extra_, notes ? notes : &ignored);
    settle_variance(signal, frame, notes ? *notes : ignored, task);
    if (filter_.uses_features()) estimate_features(frame, task);
    return frame;
  }
  Rgb run(const ForeignSignal& signal, Layers frame, const Task& task) {
    ApplyOptions options = options_;
    if (!has_variance(frame)) {
      options.noise = NoiseSource::kSpatial;
      estimated_.push_back(signal.name);
    }
    std::list<Layers> nearby;
    for (const PictureInFile& other : others_) {
      Layers& theirs = nearby.emplace_back(prepared(other, of_name(*other.picture, signal), task, nullptr));
      options.sequence.push_back({other.distance, &theirs, other.records});
    }
    ApplyReport report;
    Layers clean = apply_filter(filter_, frame, options, task, &report);
    result_.seconds += report.seconds;
    for (const std::string& line : report.notes) said_of_[line].push_back(signal.name);
    for (const char* key : {"filter", "filterParameters", "filterBackground", "filterExposure", "filterSource",
                            "filterFrames", "filterFeatures", "filterOutliers"})
      if (const auto it = clean.header.find(key); it != clean.header.end()) result_.header[key] = it->second;
    return {*clean.find("R"), *clean.find("G"), *clean.find("B")};
  }
  static ForeignSignal of_name(const ForeignFrame& picture, const ForeignSignal& like) {
    for (const ForeignSignal& s : cleaned_signals(picture))
      if (s.name == like.name) return s;
    return picture.color;
  }

  const FilterSettings& filter_;
  const PictureInFile& picture_;
  const std::vector<PictureInFile>& others_;
  ApplyOptions options_;
  CleanPicture& result_;
  std::set<std::string> extra_;
  std::vector<std::string> estimated_;                       // signals without statistics
  std::map<std::string, std::vector<std::string>> said_of_;  // notes, by their text: of which signals
};

}  // namespace

std::vector<ForeignSignal> cleaned_signals(const ForeignFrame& picture) {
  return picture.passes.empty() ? std::vector<ForeignSignal>{picture.color} : picture.passes;
}

Layers frame_of_signal(const PictureInFile& in, const ForeignSignal& signal, const std::set<std::string>& extra,
                       std::vector<std::string>* notes) {
  const Layers& file = *in.file;
  Layers frame(file.width(), file.height());
  frame.lie_like(file);
  frame.header = file.header;
  const std::vector<std::string> own = in.picture->channels();
  for (const std::string& name : extra) {
    // Parts of the picture under brume's names would be cleaned in place of the signal.
    if (name.find('.') == std::string::npos || name.starts_with("direct.") || name.starts_with("indirect.")) continue;
    const Plane* plane = file.find(name);
    if (plane && !std::binary_search(own.begin(), own.end(), name)) frame.set(name, *plane);
  }
  adopt_features(*in.picture, file, frame);
  const std::string unusable = adopt_signal(*in.picture, signal, file, frame);
  if (notes) add_unique(*notes, unusable);
  return frame;
}

CleanPicture clean_picture(const FilterSettings& filter, const PictureInFile& in, const ExrInfo& file,
                           const std::vector<PictureInFile>& others, const ApplyOptions& options, const Task& task) {
  const ForeignFrame& picture = *in.picture;
  const Layers& planes = *in.file;
  CleanPicture result;
  result.notes = picture.remarks;
  for (const std::string& name : picture.channels())
    if (type_of(file, name) == "uint" && name != picture.sample_count)
      throw InputError(fmt::format("channel {} holds whole numbers, which are no light", name));
  SignalFilter clean(filter, in, others, options, result);

  Parts parts;
  std::list<Plane> kept;
  for (const ForeignSignal& pass : picture.passes) {
    parts.signals.push_back(pass);
    const auto views = [&](const ChannelTriple& channels) {
      return std::array{planes.find(channels[0]), planes.find(channels[1]), planes.find(channels[2])};
    };
    parts.planes.push_back(views(pass.channels));
    parts.factors.push_back(pass.factor ? views(*pass.factor) : std::array<const Plane*, 3>{});
  }
  const bool half = type_of(file, picture.color.channels[0]) == "half" ||
                    std::any_of(picture.passes.begin(), picture.passes.end(),
                                [&](const ForeignSignal& pass) { return type_of(file, pass.channels[0]) == "half"; });
  std::optional<Rgb> rest;
  if (!picture.passes.empty()) rest = rest_of(planes, picture, parts, half);
  const bool only_indirect = options.component == Component::kIndirect;
  const auto wanted = [&](const ForeignSignal& s) { return !only_indirect || s.indirect; };
  const std::vector<ForeignSignal> signals = cleaned_signals(picture);
  if (std::none_of(signals.begin(), signals.end(), wanted))
    throw InputError("no pass is known to be light scattered more than once, which --component indirect cleans");
  const double jobs = static_cast<double>(signals.size() + rest.has_value());
  double done = 0;
  const auto next = [&] {
    const Task part = share(task, done / jobs, (done + 1) / jobs);
    ++done;
    return part;
  };

  std::vector<Rgb> stored(signals.size());
  for (size_t i = 0; i < signals.size(); ++i) {
    const ForeignSignal& signal = signals[i];
    const Task part = next();
    const bool uniform = std::all_of(signal.channels.begin(), signal.channels.end(),
                                     [&](const std::string& c) { return is_uniform(planes.at(c)); });
    if (!wanted(signal) || (uniform && !picture.passes.empty())) continue;
    stored[i] = clean(signal, part);
    result.cleaned.push_back(signal.name);
    if (picture.passes.empty()) break;
    for (size_t c = 0; c < 3; ++c) {
      round_as_stored(file, signal.channels[c], stored[i][c]);
      parts.planes[i][c] = &stored[i][c];
    }
  }
  if (picture.passes.empty()) {
    for (size_t c = 0; c < 3; ++c) {
      if (c > 0 && picture.target[c] == picture.target[0]) break;  // grey
      round_as_stored(file, picture.target[c], stored[0][c]);
      result.channels.push_back({picture.target[c], std::move(stored[0][c])});
    }
  } else {
    if (rest) {
      ForeignSignal left{.name = kRest, .channels = {}};
      if (!only_indirect) {
        rest = clean(left, std::move(*rest), next());
        result.cleaned.push_back(kRest);
      }
      result.notes.push_back(
          fmt::format("the passes do not make up the whole of {}: what they leave is {} too, as a part "
                      "of its own that no channel holds",
                      picture.color.name, only_indirect ? "kept" : "cleaned"));
      parts.signals.push_back(left);
      parts.planes.push_back({&(*rest)[0], &(*rest)[1], &(*rest)[2]});
      parts.factors.push_back({});
    }
    const std::string& target = picture.target[0];
    const std::string layer = target.substr(0, target.rfind('.'));
    result.sum = fmt::format("{} = {}", layer == target ? "RGB" : layer.substr(layer.rfind('.') + 1), parts.text());
    for (size_t c = 0; c < 3; ++c) {
      Plane whole(planes.width(), planes.height());
      for (int y = 0; y < planes.height(); ++y)
        for (int x = 0; x < planes.width(); ++x) whole(x, y) = parts.sum(c, x, y);
      round_as_stored(file, picture.target[c], whole);
      result.channels.push_back({picture.target[c], std::move(whole)});
    }
    for (size_t i = 0; i < signals.size(); ++i)
      for (size_t c = 0; c < 3; ++c)
        if (!stored[i][c].empty()) result.channels.push_back({signals[i].channels[c], std::move(stored[i][c])});
  }
  clean.finish();
  return result;
}

}  // namespace brume
