#include "image/foreign.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/text.h"
#include "image/color.h"

namespace brume {
namespace {

constexpr float kNothingMet = 1e9f;  // depth

/// A channel of the file under another name; one that several names share is copied.
void give(const Layers& file, const std::string& channel, const std::string& name, Layers& frame) {
  frame.set(name, file.at(channel));
}

bool has_all(const Layers& file, const std::vector<std::string>& channels) {
  return std::all_of(channels.begin(), channels.end(), [&](const std::string& c) { return file.find(c) != nullptr; });
}

bool has_all(const Layers& file, const ChannelTriple& channels) {
  return std::all_of(channels.begin(), channels.end(), [&](const std::string& c) { return file.find(c) != nullptr; });
}

/// How many samples a pixel has; 0: unknown.
class SampleCounts {
 public:
  SampleCounts(const ForeignFrame& picture, const Layers& frame)
      : plane_(frame.find(layer::sample_count.channel(0))), samples_(picture.samples) {}
  bool known() const { return plane_ || samples_ > 0; }
  double at(int x, int y) const { return plane_ ? static_cast<double>((*plane_)(x, y)) : samples_; }

 private:
  const Plane* plane_;
  double samples_;
};

/// Variance of the mean, from what the file has; `mean` is the signal's.
float variance_of_mean(VarianceMeaning meaning, float value, float mean, double n) {
  switch (meaning) {
    case VarianceMeaning::kOfSamples:
      return n > 0 ? static_cast<float>(value / n) : 0.0f;
    case VarianceMeaning::kSecondMoment:
      return n > 1 ? static_cast<float>(std::max(0.0, value - static_cast<double>(mean) * mean) / (n - 1)) : 0.0f;
    default:
      return value;
  }
}

dmat3 matrix_to_xyz() {
  static constexpr double kWhite[] = {0.95047, 1.0, 1.08883};
  dmat3 m;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) m[column][row] = LabMatrices::xyz_from_rgb[row][column] * kWhite[row];
  return m;
}

void multiply(const dmat3& matrix, const std::array<Plane*, 3>& planes) {
  for (int y = 0; y < planes[0]->height(); ++y)
    for (int x = 0; x < planes[0]->width(); ++x) {
      const dvec3 v = matrix * dvec3((*planes[0])(x, y), (*planes[1])(x, y), (*planes[2])(x, y));
      for (int c = 0; c < 3; ++c) (*planes[static_cast<size_t>(c)])(x, y) = static_cast<float>(v[c]);
    }
}

/// @param means  of the layer, one for each of its channels   @return why it could not be used; empty where it could
std::string adopt_variance(const ForeignFrame& picture, const ForeignVariance& variance, const LayerName& layer,
                           const std::string& name, const Layers& file, Layers& frame) {
  if (!has_all(file, variance.channels) || (variance.xyz && !has_all(file, *variance.xyz))) return "";
  const SampleCounts counts(picture, frame);
  const bool needs_count =
      variance.meaning == VarianceMeaning::kOfSamples || variance.meaning == VarianceMeaning::kSecondMoment;
  if (needs_count && !counts.known())
    return fmt::format(
        "the {} of {} cannot be used, because the file does not say how many samples a pixel has; say it with --samples",
        variance.meaning == VarianceMeaning::kOfSamples ? "variance of the samples" : "second moment", name);
  std::vector<Plane> planes(layer.channels.size(), Plane(frame.width(), frame.height()));
  std::vector<const Plane*> values, means;
  for (size_t c = 0; c < planes.size(); ++c) {
    values.push_back(&file.at(variance.channels[c]));
    means.push_back(variance.xyz ? &file.at((*variance.xyz)[c]) : &frame.at(layer.channel(c)));
  }
  const dmat3 to_rgb = glm::inverse(matrix_to_xyz());
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const double n = needs_count ? counts.at(x, y) : 0;
      for (size_t c = 0; c < planes.size(); ++c)
        planes[c](x, y) = variance_of_mean(variance.meaning, (*values[c])(x, y), (*means[c])(x, y), n);
      if (!variance.xyz) continue;
      const dvec3 deviation =
          to_rgb * dvec3(std::sqrt(std::max(0.0f, planes[0](x, y))), std::sqrt(std::max(0.0f, planes[1](x, y))),
                         std::sqrt(std::max(0.0f, planes[2](x, y))));
      for (int c = 0; c < 3; ++c)
        planes[static_cast<size_t>(c)](x, y) = static_cast<float>(deviation[c] * deviation[c]);
    }
  for (size_t c = 0; c < planes.size(); ++c)
    frame.set(layer.channel_of(statistic::mean_variance, c), std::move(planes[c]));
  return "";
}

}  // namespace

void rgb_from_xyz(const std::array<Plane*, 3>& planes) {
  multiply(glm::inverse(matrix_to_xyz()), planes);
}

void xyz_from_rgb(const std::array<Plane*, 3>& planes) {
  multiply(matrix_to_xyz(), planes);
}

std::vector<std::string> ForeignFrame::channels() const {
  std::vector<std::string> names;
  const auto add = [&](const auto& list) {
    for (const std::string& name : list)
      if (!name.empty()) names.push_back(name);
  };
  const auto add_variance = [&](const std::optional<ForeignVariance>& variance) {
    if (!variance) return;
    add(variance->channels);
    if (variance->xyz) add(*variance->xyz);
  };
  const auto add_signal = [&](const ForeignSignal& signal) {
    add(signal.channels);
    add_variance(signal.variance);
    if (signal.halves)
      for (const ChannelTriple& half : *signal.halves) add(half);
    if (signal.factor) add(*signal.factor);
  };
  add_signal(color);
  for (const ForeignSignal& pass : passes) add_signal(pass);
  for (const ForeignSignal& light : lights) add_signal(light);
  for (const ForeignFeature& feature : features) {
    add(feature.channels);
    add_variance(feature.variance);
  }
  add(std::array{sample_count, alpha});
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

std::string ForeignFrame::label() const {
  return view.empty() ? renderer : fmt::format("{} '{}'", renderer, view);
}

std::string adopt_signal(const ForeignFrame& picture, const ForeignSignal& signal, const Layers& file, Layers& frame) {
  const std::array<std::string_view, 2> halves = {statistic::half_a, statistic::half_b};
  for (size_t c = 0; c < 3; ++c) give(file, signal.channels[c], layer::beauty.channel(c), frame);
  if (signal.halves && has_all(file, (*signal.halves)[0]) && has_all(file, (*signal.halves)[1]))
    for (size_t h = 0; h < 2; ++h)
      for (size_t c = 0; c < 3; ++c) give(file, (*signal.halves)[h][c], layer::beauty.channel_of(halves[h], c), frame);
  return signal.variance ? adopt_variance(picture, *signal.variance, layer::beauty, signal.name, file, frame) : "";
}

void adopt_features(const ForeignFrame& picture, const Layers& file, Layers& frame) {
  if (const Plane* count = picture.sample_count.empty() ? nullptr : file.find(picture.sample_count);
      count && !(picture.count_is_share && picture.samples <= 0)) {
    Plane& samples = frame.add(layer::sample_count.channel(0));
    const double scale = picture.count_is_share ? picture.samples : 1.0;
    for (int y = 0; y < samples.height(); ++y)
      for (int x = 0; x < samples.width(); ++x) samples(x, y) = static_cast<float>(scale * (*count)(x, y));
  }
  if (picture.samples > 0) frame.header["samplesPerPixel"] = static_cast<int>(picture.samples);
  for (const ForeignFeature& feature : picture.features) {
    if (!has_all(file, feature.channels)) continue;
    for (size_t c = 0; c < feature.channels.size(); ++c)
      give(file, feature.channels[c], feature.layer.channel(c), frame);
    if (feature.layer == layer::depth) {
      Plane& depth = *frame.find(layer::depth.channel(0));
      for (int y = 0; y < depth.height(); ++y)
        for (float& z : depth.pixels(y))
          if (!(z < kNothingMet)) z = 0;
    }
    if (feature.variance) adopt_variance(picture, *feature.variance, feature.layer, feature.layer.label(), file, frame);
  }
}

std::string channels_text(const ExrInfo& file) {
  constexpr size_t kMost = 24;  // layers
  std::vector<std::string> order;
  std::map<std::string, std::string> letters;  // by layer
  for (const ExrInfo::Channel& c : file.channels) {
    const size_t dot = c.name.rfind('.');
    // Of a name that begins or ends with a dot, the dot is shown.
    const bool whole = dot == std::string::npos || dot == 0 || dot + 1 == c.name.size();
    const std::string layer = whole ? "" : c.name.substr(0, dot);
    std::string& list = letters[layer];
    if (list.empty()) order.push_back(layer);
    list += (list.empty() ? "" : " ") + c.name.substr(whole ? 0 : dot + 1);
  }
  std::vector<std::string> words;
  for (const std::string& layer : order) {
    if (words.size() == kMost) {
      words.push_back(fmt::format("and {} more layers", order.size() - kMost));
      break;
    }
    words.push_back(layer.empty() ? letters[layer] : fmt::format("{}: {}", layer, letters[layer]));
  }
  return words.empty() ? "none" : join(words, "; ");
}

std::string adopt_foreign_layers(Layers& layers, const ExrInfo* file) {
  if (layers.has(layer::beauty)) return "";
  ExrInfo info;
  info.header = layers.header;
  for (const std::string& name : layers.names()) info.channels.push_back({name, "float", layers.data_window()});
  const std::vector<ForeignFrame> pictures = recognise(file ? *file : info);
  if (pictures.empty()) return "";
  const ForeignFrame& picture = pictures.front();
  bool all = has_all(layers, picture.target);  // not where only some layers were read
  for (const ForeignSignal& pass : picture.passes) all = all && has_all(layers, pass.channels);
  if (!all) return "";
  bool split = false;
  for (size_t c = 0; c < 3; ++c) {
    const Plane& beauty = layers.at(picture.target[c]);
    Plane indirect(layers.width(), layers.height()), direct = beauty;
    for (const ForeignSignal& pass : picture.passes) {
      if (!pass.indirect || pass.factor) continue;
      split = true;
      const Plane& part = layers.at(pass.channels[c]);
      for (int y = 0; y < direct.height(); ++y)
        for (int x = 0; x < direct.width(); ++x) {
          indirect(x, y) += part(x, y);
          direct(x, y) -= part(x, y);
        }
    }
    if (split) {
      layers.set(layer::direct.channel(c), std::move(direct));
      layers.set(layer::indirect.channel(c), std::move(indirect));
    }
    layers.set(layer::beauty.channel(c), beauty);
  }
  if (picture.cie_xyz)
    rgb_from_xyz({layers.find(layer::beauty.channel(0)), layers.find(layer::beauty.channel(1)),
                  layers.find(layer::beauty.channel(2))});
  if (!picture.alpha.empty() && layers.find(picture.alpha))
    layers.set(layer::alpha.channel(0), layers.at(picture.alpha));
  const std::string said = fmt::format("read as {}: {}{}", picture.label(), picture.color.name,
                                       split ? ", scattered more than once as indirect, the rest as direct" : "");
  return pictures.size() == 1 ? said : fmt::format("{}; the first of {} pictures in the file", said, pictures.size());
}

}  // namespace brume
