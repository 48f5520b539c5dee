// Which layer of another renderer's frame plays which part, said by the user. docs/frames.md describes the file.

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/text.h"
#include "render/scene/toml_table.h"
#include "workflows/open_frame.h"

namespace brume {
namespace {

/// One table of the map, whose layers are looked up in the file.
class MapTable {
 public:
  MapTable(const toml::value& table, const ExrInfo& file) : table_(table) {
    for (const ExrInfo::Channel& c : file.channels) {
      channels_.insert(c.name);
      const size_t dot = c.name.rfind('.');
      layers_.insert(dot == std::string::npos ? c.name : c.name.substr(0, dot));
      if (c.type == "uint") whole_numbers_.insert(c.name);
    }
  }

  bool has(const std::string& key) {
    known_.insert(key);
    return table_.contains(key);
  }
  std::string text(const std::string& key) {
    if (!has(key)) return "";
    const toml::value& v = table_.at(key);
    if (!v.is_string()) fail_at(fmt::format("'{}' is no text", key), v, "expected text in quotes");
    return toml::get<std::string>(v);
  }
  /// Channels of a layer by its name, or named one by one.
  std::optional<ChannelTriple> triple(const std::string& key) {
    if (!has(key)) return std::nullopt;
    return triple_of(key, table_.at(key));
  }
  ChannelTriple triple_of(const std::string& key, const toml::value& v) {
    if (v.is_array()) {
      if (v.as_array().size() != 3 ||
          std::any_of(v.as_array().begin(), v.as_array().end(), [](const auto& c) { return !c.is_string(); }))
        fail_at(fmt::format("'{}' is no layer", key), v, "expected a layer's name, or three channels' in brackets");
      ChannelTriple channels;
      for (size_t c = 0; c < 3; ++c) channels[c] = channel_named(v.as_array()[c]);
      const size_t different = std::set<std::string>(channels.begin(), channels.end()).size();
      if (different == 2)
        fail_at(fmt::format("'{}' names a channel twice", key), v, "expected three channels, or one three times: grey");
      return channels;
    }
    if (!v.is_string())
      fail_at(fmt::format("'{}' is no layer", key), v, "expected a layer's name, or three channels' in brackets");
    const std::string layer = toml::get<std::string>(v), prefix = layer.empty() ? "" : layer + ".";
    for (const ChannelTriple& c :
         {ChannelTriple{"R", "G", "B"}, {"r", "g", "b"}, {"X", "Y", "Z"}, {"x", "y", "z"}, {"red", "green", "blue"}})
      if (channels_.contains(prefix + c[0]) && channels_.contains(prefix + c[1]) && channels_.contains(prefix + c[2])) {
        const ChannelTriple found{prefix + c[0], prefix + c[1], prefix + c[2]};
        for (const std::string& name : found) refuse_ids(name, v);
        return found;
      }
    const std::vector<std::string> layers(layers_.begin(), layers_.end());
    fail_at(
        fmt::format("the file has no layer '{}' of three channels R G B or X Y Z{}", layer, suggestion(layer, layers)),
        v, "name a layer of the file, or its three channels in brackets");
  }
  std::string channel(const std::string& key) {
    if (!has(key)) return "";
    const toml::value& v = table_.at(key);
    if (!v.is_string()) fail_at(fmt::format("'{}' is no text", key), v, "expected a channel's name in quotes");
    for (const char* ending : {"", ".Z", ".z", ".Y", ".X", ".x", ".R", ".A", ".V", ".T"})
      if (channels_.contains(toml::get<std::string>(v) + ending)) return toml::get<std::string>(v) + ending;
    return channel_named(v);
  }
  double number(const std::string& key) {
    if (!has(key)) return 0;
    const toml::value& v = table_.at(key);
    const double n = v.is_integer() ? static_cast<double>(v.as_integer()) : v.is_floating() ? v.as_floating() : 0;
    if (!(n > 0)) fail_at(fmt::format("'{}' is out of range", key), v, "expected a number above 0");
    return n;
  }
  bool flag(const std::string& key) {
    if (!has(key)) return false;
    if (!table_.at(key).is_boolean())
      fail_at(fmt::format("'{}' is no boolean", key), table_.at(key), "expected true or false");
    return table_.at(key).as_boolean();
  }
  const toml::value& at(const std::string& key) const { return table_.at(key); }

  std::optional<ForeignVariance> variance() {
    const auto channels = triple("variance");
    if (!channels) {
      if (has("variance_is"))
        fail_at("'variance_is' stands without 'variance'", table_.at("variance_is"),
                "name the layer: variance = \"...\"");
      return std::nullopt;
    }
    static const std::vector<std::pair<std::string, VarianceMeaning>> meanings = {
        {"mean", VarianceMeaning::kOfMean},
        {"samples", VarianceMeaning::kOfSamples},
        {"second moment", VarianceMeaning::kSecondMoment},
        {"unstated", VarianceMeaning::kUnstated}};
    ForeignVariance result{.channels = {channels->begin(), channels->end()}, .meaning = VarianceMeaning::kUnstated};
    if (!has("variance_is")) return result;
    const std::string said = text("variance_is");
    std::vector<std::string> names;
    for (const auto& [name, meaning] : meanings) {
      if (name == said) {
        result.meaning = meaning;
        return result;
      }
      names.push_back(name);
    }
    fail_at(fmt::format("'variance_is' cannot be '{}'{}", said, suggestion(said, names)), table_.at("variance_is"),
            "expected what the variance is of");
  }
  std::optional<std::array<ChannelTriple, 2>> halves() {
    if (!has("halves")) return std::nullopt;
    const toml::value& v = table_.at("halves");
    if (!v.is_array() || v.as_array().size() != 2)
      fail_at("'halves' are not two", v, "expected two layers: [\"even\", \"odd\"]");
    return std::array{triple_of("halves", v.as_array()[0]), triple_of("halves", v.as_array()[1])};
  }
  void reject_unknown() const {
    const std::vector<std::string> known(known_.begin(), known_.end());
    for (const auto& [key, value] : table_.as_table())
      if (!known_.contains(key))
        fail_at(fmt::format("unknown key '{}'{}", key, suggestion(key, known)), value, "not a key of a map");
  }

 private:
  std::string channel_named(const toml::value& v) {
    const std::string name = toml::get<std::string>(v);
    const std::vector<std::string> channels(channels_.begin(), channels_.end());
    if (!channels_.contains(name))
      fail_at(fmt::format("the file has no channel '{}'{}", name, suggestion(name, channels)), v,
              "name a channel of the file");
    refuse_ids(name, v);
    return name;
  }
  void refuse_ids(const std::string& channel, const toml::value& v) const {
    if (whole_numbers_.contains(channel) || lower(channel).find("crypto") != std::string::npos)
      fail_at(fmt::format("channel {} holds identities, which are never filtered", channel), v,
              "expected a layer of light");
  }

  const toml::value& table_;
  std::set<std::string> channels_, layers_, whole_numbers_, known_;
};

ForeignFrame picture_of(const toml::value& root, const ExrInfo& file) {
  MapTable table(root, file);
  ForeignFrame picture;
  picture.renderer = table.has("renderer") ? table.text("renderer") : "a frame by its map";
  const auto colour = table.triple("color");
  if (!colour) fail_at("the map has no 'color'", root, "add color = \"LAYER\" or [\"R\", \"G\", \"B\"]");
  picture.target = *colour;
  picture.color = {.name = "color", .channels = *colour, .variance = table.variance(), .halves = table.halves()};
  picture.alpha = table.channel("alpha");
  for (const LayerName& l : {layer::albedo, layer::normal, layer::position})
    if (const auto channels = table.triple(std::string(l.name)))
      picture.features.push_back({l, {channels->begin(), channels->end()}});
  if (const std::string depth = table.channel("depth"); !depth.empty())
    picture.features.push_back({layer::depth, {depth}});
  picture.sample_count = table.channel("sample_count");
  picture.samples = table.number("samples");
  if (table.has("passes")) {
    const toml::value& passes = table.at("passes");
    if (!passes.is_array()) fail_at("'passes' is no list", passes, "expected [[passes]] with layer = ...");
    for (const toml::value& entry : passes.as_array()) {
      if (!entry.is_table()) fail_at("a pass is no table", entry, "expected [[passes]] with layer = ...");
      MapTable pass(entry, file);
      const auto channels = pass.triple("layer");
      if (!channels) fail_at("a pass has no 'layer'", entry, "add layer = ...");
      const auto is_same = [&](const ForeignSignal& other) { return other.channels == *channels; };
      if (*channels == *colour || std::any_of(picture.passes.begin(), picture.passes.end(), is_same))
        fail_at(*channels == *colour ? "a pass is the picture itself" : "a pass is named twice", pass.at("layer"),
                "expected a part of 'color'");
      const std::string name = (*channels)[0].substr(0, (*channels)[0].rfind('.'));
      picture.passes.push_back({.name = name,
                                .channels = *channels,
                                .variance = pass.variance(),
                                .halves = pass.halves(),
                                .factor = pass.triple("factor"),
                                .indirect = pass.flag("indirect")});
      pass.reject_unknown();
    }
  }
  if (table.has("lights")) {
    const toml::value& lights = table.at("lights");
    if (!lights.is_array())
      fail_at("'lights' is no list", lights, "expected layers of light groups: [\"key\", \"rim\"]");
    for (const toml::value& entry : lights.as_array()) {
      const ChannelTriple channels = table.triple_of("lights", entry);
      const std::string name = channels[0].substr(0, channels[0].rfind('.'));
      picture.lights.push_back({.name = name, .channels = channels, .group = name});
    }
  }
  table.reject_unknown();
  return picture;
}

}  // namespace

std::vector<ForeignFrame> read_map(const std::filesystem::path& map, const ExrInfo& file) {
  const std::string path = map.string();
  std::ifstream stream(path, std::ios::binary);
  check_exists(map);
  if (!stream) throw InputError(fmt::format("{}: cannot be opened", path));
  return {picture_of(parse_toml(stream, path), file)};
}

}  // namespace brume
