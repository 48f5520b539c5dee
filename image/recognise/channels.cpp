#include "image/recognise/channels.h"

#include <charconv>

#include "base/text.h"

namespace brume::recognition {
namespace {

ExrView whole(const ExrInfo& file) {
  ExrView all;
  for (const ExrInfo::Channel& c : file.channels) all.channels.push_back({c.name, c.name, c.type});
  return all;
}

}  // namespace

std::string plain(const std::string& layer) {
  std::string text = lower(layer);
  std::erase_if(text, [](char c) { return c == ' ' || c == '-' || c == '_'; });
  return text.starts_with("vray") && text.size() > 4 ? text.substr(4) : text;
}

Channels::Channels(const ExrView& view) {
  for (const ExrView::Channel& c : view.channels) {
    in_file_[c.name] = c.in_file;
    if (c.type == "half") half_.insert(c.in_file);
  }
  // A frame has colours in place of luminance and chroma.
  for (const ExrView::Channel& c : view.channels) {
    if (!c.name.ends_with("RY")) continue;
    const std::string prefix = c.name.substr(0, c.name.size() - 2);
    if (!has(prefix + "Y") || !has(prefix + "BY") || has(prefix + "R")) continue;
    const std::string file_prefix = c.in_file.substr(0, c.in_file.size() - 2);
    for (const char* colour : {"R", "G", "B"}) {
      in_file_[prefix + colour] = file_prefix + colour;
      if (half_.contains(file_prefix + "Y")) half_.insert(file_prefix + colour);
    }
    for (const char* part : {"Y", "RY", "BY"}) in_file_.erase(prefix + part);
  }
}

Channels::Channels(const ExrInfo& file) : Channels(whole(file)) {}

std::optional<ChannelTriple> Channels::colour(const std::string& prefix) const {
  return first_of(prefix, {{{"R", "G", "B"}}, {{"r", "g", "b"}}, {{"red", "green", "blue"}}});
}

std::optional<ChannelTriple> Channels::vector(const std::string& prefix) const {
  return first_of(prefix, {{{"X", "Y", "Z"}}, {{"x", "y", "z"}}, {{"R", "G", "B"}}, {{"r", "g", "b"}}});
}

std::string Channels::single(const std::string& layer) const {
  if (has(layer)) return in_file(layer);
  const std::vector<std::string> inside = below(layer + ".");
  return inside.size() == 1 ? in_file(inside[0]) : "";
}

std::vector<std::string> Channels::below(const std::string& prefix) const {
  std::vector<std::string> names;
  for (const auto& [name, own] : in_file_)
    if (name.starts_with(prefix)) names.push_back(name);
  return names;
}

std::vector<std::string> Channels::before(const std::string& tail) const {
  std::vector<std::string> prefixes;
  for (const auto& [name, own] : in_file_)
    if (name.ends_with(tail) && (name.size() == tail.size() || name[name.size() - tail.size() - 1] == '.'))
      prefixes.push_back(name.substr(0, name.size() - tail.size()));
  return prefixes;
}

std::set<std::string> Channels::layers(const std::string& prefix) const {
  std::set<std::string> names;
  for (const std::string& name : below(prefix)) {
    const std::string rest = name.substr(prefix.size());
    const size_t dot = rest.rfind('.');
    names.insert(dot == std::string::npos ? rest : rest.substr(0, dot));
  }
  return names;
}

std::optional<ChannelTriple> Channels::first_of(const std::string& prefix,
                                                const std::vector<ChannelTriple>& endings) const {
  for (const ChannelTriple& e : endings)
    if (has(prefix + e[0]) && has(prefix + e[1]) && has(prefix + e[2]))
      return ChannelTriple{in_file(prefix + e[0]), in_file(prefix + e[1]), in_file(prefix + e[2])};
  return std::nullopt;
}

std::vector<std::string> listed(const ChannelTriple& channels) {
  return {channels.begin(), channels.end()};
}

std::string layer_in_file(const std::string& channel) {
  const size_t dot = channel.rfind('.');
  return dot == std::string::npos ? "" : channel.substr(0, dot);
}

std::string without_dot(const std::string& prefix) {
  return prefix.ends_with(".") ? prefix.substr(0, prefix.size() - 1) : prefix;
}

double header_number(const ExrInfo& file, const std::string& key) {
  const auto it = file.header.find(key);
  if (it == file.header.end()) return 0;
  if (const int* i = std::get_if<int>(&it->second)) return *i;
  if (const float* f = std::get_if<float>(&it->second)) return static_cast<double>(*f);
  const auto* text = std::get_if<std::string>(&it->second);
  double value = 0;
  if (text) std::from_chars(text->data(), text->data() + text->size(), value);
  return value;
}

void add_vector(ForeignFrame& picture, const LayerName& layer, const std::optional<ChannelTriple>& channels) {
  if (channels) picture.features.push_back({layer, listed(*channels)});
}

void add_depth(ForeignFrame& picture, const std::string& channel) {
  if (!channel.empty()) picture.features.push_back({layer::depth, {channel}});
}

void add_lights(const Channels& file, const std::string& view, const std::string& prefix, ForeignFrame& picture,
                const std::set<std::string>& others) {
  for (const std::string& layer : file.layers(view)) {
    if (!layer.starts_with(prefix)) continue;
    const std::string group = layer.substr(prefix.size());
    if (const auto channels = file.colour(view + layer + "."); channels && !others.contains(group))
      picture.lights.push_back({.name = layer, .channels = *channels, .group = group});
  }
}

void add_alpha(const Channels& file, ForeignFrame& picture, const std::string& prefix) {
  for (const char* name : {"A", "a", "alpha"})
    if (picture.alpha.empty() && file.has(prefix + name)) picture.alpha = file.in_file(prefix + name);
}

}  // namespace brume::recognition
