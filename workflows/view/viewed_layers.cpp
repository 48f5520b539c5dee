#include "workflows/view/viewed_layers.h"

#include <algorithm>
#include <set>
#include <utility>

#include "image/light_layers.h"

namespace brume {
namespace {

/// The channels of a layer: RGB, XYZ or one; empty: it is not there.
std::vector<std::string> channels_of(const Layers& frame, const std::string& name) {
  std::vector<std::string> channels;
  for (const std::string_view letters : {"RGB", "XYZ", "Y", "Z", "A"}) {
    channels.clear();
    for (const char c : letters)
      if (std::string channel = name.empty() ? std::string(1, c) : name + "." + c; frame.find(channel))
        channels.push_back(std::move(channel));
    if (channels.size() == letters.size()) return channels;
  }
  return {};
}

/// Of several layers, which are added up: those that are there.
std::vector<std::vector<std::string>> sets_of(const Layers& frame, const std::vector<std::string>& names) {
  std::vector<std::vector<std::string>> sets;
  for (const std::string& name : names)
    if (std::vector<std::string> channels = channels_of(frame, name); !channels.empty())
      sets.push_back(std::move(channels));
  return sets;
}

const std::vector<std::string> kAllLight = {"direct", "indirect"};

/// The part of light that a layer holds; empty: it is no light of the picture.
std::vector<std::string> parts_of(const std::string& layer) {
  if (layer == kViewedPicture || layer == "noisy") return kAllLight;
  if (layer == "direct" || layer == "clean_direct") return {"direct"};
  if (layer == "indirect" || layer == "clean_indirect") return {"indirect"};
  return {};
}

std::vector<std::string> predicted(const std::string& group, const std::vector<std::string>& parts) {
  std::vector<std::string> names;
  for (const std::string& part : parts) names.push_back(predicted_light_layer(group, part));
  return names;
}

void add_scaled(float* sum, const float* light, float factor, size_t count) {
  for (size_t x = 0; x < count; ++x) sum[x] += factor * light[x];
}

}  // namespace

std::vector<std::string> viewed_light_groups(const Layers& frame) {
  std::vector<std::string> groups = light_groups_in(frame);
  if (!groups.empty()) return groups;
  for (const auto& [name, plane] : frame.channels())
    if (is_predicted_light(name) && name.ends_with(".R")) {
      const std::string group =
          name.substr(kLightPrefix.size(), name.find('.', kLightPrefix.size()) - kLightPrefix.size());
      if (groups.empty() || groups.back() != group) groups.push_back(group);
    }
  return groups;
}

ViewedLayer::ViewedLayer(const Layers& frame, const std::string& layer, bool predicts, const LightMix& mix) {
  const std::vector<std::string> parts = parts_of(layer);
  if (layer == kViewedAlpha) {
    for (const char* channel :
         {"guide.opacity.Y", "guide.surface_material.R", "guide.surface_material.G", "guide.surface_material.B"})
      if (frame.find(channel)) whole_.push_back({channel});
    if (whole_.empty() && frame.find("A")) whole_ = {{"A"}};
  } else if (layer.starts_with(kLightPrefix)) {
    const std::string group = layer.substr(kLightPrefix.size());
    whole_ = sets_of(frame, predicts ? predicted(group, kAllLight) : std::vector{clean_light_layer(group)});
    if (const auto found = mix.find(group); found != mix.end()) groups_ = {{found->second, whole_}};
  } else if (predicts && !parts.empty() && layer != "noisy") {
    std::vector<std::string> names;
    for (const std::string& part : parts) names.push_back("guide.predicted_" + part);
    whole_ = sets_of(frame, names);
  } else {
    whole_ = sets_of(frame, {layer == kViewedPicture ? "" : layer});
  }
  if (!parts.empty() && !mix.empty() && !whole_.empty()) mix_groups(frame, layer, predicts, mix);
}

void ViewedLayer::mix_groups(const Layers& frame, const std::string& layer, bool predicts, const LightMix& mix) {
  const std::vector<std::string> groups = viewed_light_groups(frame);
  const auto take = [&](const auto& names_of) {
    groups_.clear();
    for (const std::string& group : groups) {
      const auto found = mix.find(group);
      groups_.push_back({found == mix.end() ? dvec3(1) : found->second, sets_of(frame, names_of(group))});
    }
    const auto missing = [](const Group& group) { return group.sets.empty(); };
    if (std::any_of(groups_.begin(), groups_.end(), missing)) groups_.clear();
    return !groups_.empty();
  };
  const auto rendered = [](const std::string& group) { return std::vector{light_layer(group)}; };
  const auto cleaned = [](const std::string& group) { return std::vector{clean_light_layer(group)}; };
  const std::vector<std::string> parts =
      predicts || layer == kViewedPicture ? parts_of(layer) : std::vector<std::string>();
  const auto by_guides = [&](const std::string& group) { return predicted(group, parts); };
  // A clean picture whose groups are not clean yet is mixed by what guides predict of them, which has no noise.
  const bool known = layer == "noisy"          ? take(rendered)
                     : predicts                ? take(by_guides)
                     : layer == kViewedPicture ? take(cleaned) || take(by_guides) || take(rendered)
                                               : false;
  misses_mix_ = !known;
}

std::vector<std::string> ViewedLayer::sources() const {
  std::set<std::string> all;
  const auto add = [&](const Sets& sets) {
    for (const auto& set : sets) all.insert(set.begin(), set.end());
  };
  add(whole_);
  for (const Group& group : groups_) add(group.sets);
  return {all.begin(), all.end()};
}

Plane ViewedLayer::plane(const Layers& frame, size_t channel) const {
  Plane whole = frame.at(whole_[0][channel]);
  const auto columns = static_cast<size_t>(whole.width());
  for (size_t other = 1; other < whole_.size(); ++other) {
    const Plane& more = frame.at(whole_[other][channel]);
    for (int y = 0; y < whole.height(); ++y) add_scaled(whole.row(y), more.row(y), 1, columns);
  }
  if (groups_.empty()) return whole;
  // Row by row, so that all of it stays in the cache: this runs for every step of a slider.
  std::vector<float> sum(columns), mixed(columns);
  double all = 0, all_mixed = 0;
  std::vector<std::pair<int, int>> black;
  for (int y = 0; y < whole.height(); ++y) {
    std::fill(sum.begin(), sum.end(), 0.0f);
    std::fill(mixed.begin(), mixed.end(), 0.0f);
    for (const Group& group : groups_)
      for (const auto& set : group.sets) {
        const float* const light = frame.at(set[channel]).row(y);
        add_scaled(sum.data(), light, 1, columns);
        add_scaled(mixed.data(), light, static_cast<float>(group.factor[static_cast<int>(channel)]), columns);
      }
    float* const row = whole.row(y);
    float of_row = 0, of_row_mixed = 0;
    for (size_t x = 0; x < columns; ++x) {
      of_row += sum[x];
      of_row_mixed += mixed[x];
      if (sum[x] > 0)
        row[x] *= mixed[x] / sum[x];
      else if (row[x] != 0)
        black.emplace_back(static_cast<int>(x), y);
    }
    all += static_cast<double>(of_row);
    all_mixed += static_cast<double>(of_row_mixed);
  }
  const float mean = all > 0 ? static_cast<float>(all_mixed / all) : 1.0f;
  for (const auto& [x, y] : black) whole(x, y) *= mean;
  return whole;
}

}  // namespace brume
