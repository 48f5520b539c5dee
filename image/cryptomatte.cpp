#include "image/cryptomatte.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "base/error.h"
#include "base/text.h"

namespace brume {
namespace {

using nlohmann::json;

constexpr std::string_view kPrefix = "cryptomatte/";
constexpr const char *kHash = "MurmurHash3_32", *kConversion = "uint32_to_float32";

uint32_t mixed(uint32_t k) {
  return std::rotl(k * 0xcc9e2d51u, 15) * 0x1b873593u;
}

/// "name": "0123abcd", ... @throws json::exception, InputError
std::map<std::string, float> parse_manifest(const std::string& text) {
  std::map<std::string, float> manifest;
  const json all = json::parse(text);
  for (const auto& [name, hex] : all.items()) {
    const float id = matte_of_hex(hex.get<std::string>());
    if (id == 0)
      throw InputError(fmt::format("'{}' has the number {}; expected eight hexadecimal digits", name, hex.dump()));
    manifest[name] = id;
  }
  return manifest;
}

void take_manifest(MatteLayer& layer, const std::string& text) {
  try {
    layer.manifest = parse_manifest(text);
  } catch (const json::exception& error) {
    layer.problem = fmt::format("its manifest is no JSON: {}", error.what());
  } catch (const InputError& error) {
    layer.problem = fmt::format("its manifest cannot be read: {}", error.what());
  }
}

/// Which number of "NAME07.r" a channel has, 4 * 7 + 0; -1 where it is none of the layer's.
int place_of(const std::string& channel, const std::string& layer) {
  if (!channel.starts_with(layer)) return -1;
  const std::string_view rest = std::string_view(channel).substr(layer.size());
  const size_t dot = rest.find('.');
  if (dot == 0 || dot == std::string_view::npos) return -1;
  int number = 0;
  const auto [end, error] = std::from_chars(rest.data(), rest.data() + dot, number);
  if (error != std::errc() || end != rest.data() + dot || number < 0 || number > 999) return -1;
  const std::string letter = lower(std::string(rest.substr(dot + 1)));
  for (const auto& [name, place] :
       {std::pair("r", 0), {"g", 1}, {"b", 2}, {"a", 3}, {"red", 0}, {"green", 1}, {"blue", 2}, {"alpha", 3}})
    if (letter == name) return 4 * number + place;
  return -1;
}

/// Whether `*` in a pattern can stand for something so that it is the text.
bool matches(std::string_view pattern, std::string_view text) {
  if (pattern.empty()) return text.empty();
  if (pattern[0] != '*') return !text.empty() && pattern[0] == text[0] && matches(pattern.substr(1), text.substr(1));
  for (size_t i = 0; i <= text.size(); ++i)
    if (matches(pattern.substr(1), text.substr(i))) return true;
  return false;
}

std::string last_part(const std::string& name) {
  return name.substr(name.rfind('.') + 1);
}

std::vector<std::string> names_of(const MatteLayer& layer) {
  std::vector<std::string> names;
  for (const auto& [name, id] : layer.manifest) names.push_back(name);
  return names;
}

bool has_all(const MatteLayer& layer, const std::vector<std::string>& names) {
  const std::vector<std::string> own = names_of(layer);
  return std::all_of(names.begin(), names.end(), [&](const std::string& name) {
    return std::any_of(own.begin(), own.end(),
                       [&](const std::string& one) { return one == name || matches(name, one); });
  });
}

}  // namespace

uint32_t matte_hash(std::string_view name) {
  uint32_t h = 0;
  const auto byte = [&](size_t i) { return static_cast<uint32_t>(static_cast<unsigned char>(name[i])); };
  const size_t whole = name.size() / 4 * 4;
  for (size_t i = 0; i < whole; i += 4) {
    h ^= mixed(byte(i) | byte(i + 1) << 8 | byte(i + 2) << 16 | byte(i + 3) << 24);
    h = std::rotl(h, 13) * 5 + 0xe6546b64u;
  }
  uint32_t rest = 0;
  for (size_t i = name.size(); i > whole; --i) rest = rest << 8 | byte(i - 1);
  h ^= mixed(rest) ^ static_cast<uint32_t>(name.size());
  h = (h ^ h >> 16) * 0x85ebca6bu;
  h = (h ^ h >> 13) * 0xc2b2ae35u;
  return h ^ h >> 16;
}

float matte_id(std::string_view name) {
  uint32_t bits = matte_hash(name);
  const uint32_t exponent = bits >> 23 & 255;
  if (exponent == 0 || exponent == 255) bits ^= 1u << 23;
  return std::bit_cast<float>(bits);
}

std::string matte_hex(float id) {
  return fmt::format("{:08x}", std::bit_cast<uint32_t>(id));
}

float matte_of_hex(std::string_view hex) {
  uint32_t bits = 0;
  const auto [end, error] = std::from_chars(hex.data(), hex.data() + hex.size(), bits, 16);
  return error == std::errc() && end == hex.data() + hex.size() && hex.size() == 8 ? std::bit_cast<float>(bits) : 0;
}

std::vector<MatteLayer> matte_layers(const std::map<std::string, Attribute>& header,
                                     const std::vector<std::string>& channels) {
  std::vector<MatteLayer> layers;
  for (const auto& [attribute, value] : header) {
    if (!attribute.starts_with(kPrefix) || !attribute.ends_with("/name")) continue;
    const auto* const name = std::get_if<std::string>(&value);
    if (!name || name->empty()) continue;
    MatteLayer layer{*name, attribute.substr(kPrefix.size(), attribute.size() - kPrefix.size() - 5)};
    const auto own = [&](const char* what) -> std::string {
      const auto found = header.find(fmt::format("{}{}/{}", kPrefix, layer.key, what));
      const auto* const text = found == header.end() ? nullptr : std::get_if<std::string>(&found->second);
      return text ? *text : "";
    };
    for (const auto& [what, expected] : {std::pair("hash", kHash), {"conversion", kConversion}})
      if (const std::string found = own(what); found != expected && !found.empty())
        layer.problem = fmt::format("its {} is {}; expected {}", what, found, expected);
    if (const std::string manifest = own("manifest"); !manifest.empty() && layer.problem.empty())
      take_manifest(layer, manifest);
    layer.manifest_file = own("manif_file");
    std::map<int, std::string> places;
    for (const std::string& channel : channels)
      if (const int place = place_of(channel, layer.name); place >= 0) places[place] = channel;
    for (const auto& [place, channel] : places)
      if (const auto coverage = places.find(place + 1); place % 2 == 0 && coverage != places.end())
        layer.ranks.emplace_back(channel, coverage->second);
    if (layer.ranks.empty() && layer.problem.empty())
      layer.problem = fmt::format("the file has no channels {}00.r and .g", layer.name);
    layers.push_back(std::move(layer));
  }
  std::sort(layers.begin(), layers.end(), [](const MatteLayer& a, const MatteLayer& b) { return a.name < b.name; });
  return layers;
}

std::vector<std::string> matte_channels(const Layers& frame) {
  std::vector<std::string> channels;
  for (const MatteLayer& layer : matte_layers(frame.header, frame.names()))
    for (const auto& [number, coverage] : layer.ranks) channels.insert(channels.end(), {number, coverage});
  return channels;
}

void read_manifests(std::vector<MatteLayer>& layers, const std::filesystem::path& picture) {
  for (MatteLayer& layer : layers) {
    if (layer.manifest_file.empty() || !layer.manifest.empty()) continue;
    const std::filesystem::path path = picture.parent_path() / layer.manifest_file;
    std::ifstream stream(path, std::ios::binary);
    if (!stream) {
      layer.problem = fmt::format("its manifest {} cannot be read", path.string());
      continue;
    }
    take_manifest(layer, {std::istreambuf_iterator<char>(stream), {}});
  }
}

void add_matte_layer(const std::string& name, int levels, const std::vector<std::string>& names,
                     const std::vector<std::vector<MatteShare>>& shares, Layers& frame) {
  const std::string prefix = fmt::format("{}{}/", kPrefix, matte_hex(matte_id(name)).substr(0, 7));
  json manifest = json::object();
  for (const std::string& one : names) manifest[one] = matte_hex(matte_id(one));
  frame.header[prefix + "name"] = name;
  frame.header[prefix + "hash"] = std::string(kHash);
  frame.header[prefix + "conversion"] = std::string(kConversion);
  frame.header[prefix + "manifest"] = manifest.dump();
  std::vector<Plane*> planes;  // a number, a coverage, and so on
  for (int layer = 0; 2 * layer < levels; ++layer)
    for (const char letter : {'r', 'g', 'b', 'a'})
      planes.push_back(&frame.add(fmt::format("{}{:02d}.{}", name, layer, letter)));
  const auto width = static_cast<size_t>(frame.width());
  for (size_t pixel = 0; pixel < shares.size(); ++pixel) {
    std::vector<MatteShare> ranks = shares[pixel];
    std::sort(ranks.begin(), ranks.end(), [](const MatteShare& a, const MatteShare& b) {
      return std::pair(-a.coverage, std::bit_cast<uint32_t>(a.id)) <
             std::pair(-b.coverage, std::bit_cast<uint32_t>(b.id));
    });
    ranks.resize(std::min(ranks.size(), static_cast<size_t>(levels)));
    const auto x = static_cast<int>(pixel % width), y = static_cast<int>(pixel / width);
    for (size_t k = 0; k < ranks.size(); ++k) {
      (*planes[2 * k])(x, y) = ranks[k].id;
      (*planes[2 * k + 1])(x, y) = ranks[k].coverage;
    }
  }
}

Plane matte(const Layers& frame, const MatteLayer& layer, const std::vector<float>& ids) {
  std::set<uint32_t> wanted;
  for (const float id : ids) wanted.insert(std::bit_cast<uint32_t>(id));
  Plane sum(frame.width(), frame.height());
  for (const auto& [number, coverage] : layer.ranks) {
    const Plane &id = frame.at(number), &share = frame.at(coverage);
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x)
        if (wanted.contains(std::bit_cast<uint32_t>(id(x, y)))) sum(x, y) += share(x, y);
  }
  return sum;
}

std::vector<float> matte_ids(const MatteLayer& layer, const std::vector<std::string>& names) {
  std::vector<float> ids;
  for (const std::string& name : names) {
    if (layer.manifest.empty()) {
      ids.push_back(matte_id(name));
      continue;
    }
    const size_t before = ids.size();
    const auto own = layer.manifest.find(name);
    if (own != layer.manifest.end())
      ids.push_back(own->second);
    else
      for (const auto& [one, id] : layer.manifest)
        if (matches(name, one)) ids.push_back(id);
    if (ids.size() > before) continue;
    const std::vector<std::string> known = names_of(layer);
    throw InputError(
        fmt::format("{} has no '{}'{}; it has {}", layer.name, name, suggestion(name, known), join(known)));
  }
  return ids;
}

Plane matte_of(const Layers& frame, const std::vector<MatteLayer>& layers, const std::vector<std::string>& names,
               const std::string& wanted) {
  std::vector<const MatteLayer*> asked, found;
  std::vector<std::string> all;
  for (const MatteLayer& layer : layers) {
    all.push_back(layer.name);
    if (wanted.empty() || wanted == layer.name || wanted == last_part(layer.name)) asked.push_back(&layer);
  }
  if (layers.empty())
    throw InputError(
        "has no Cryptomatte; expected attributes cryptomatte/KEY/name, as --layers cryptomatte writes them");
  if (asked.empty())
    throw InputError(fmt::format("has no Cryptomatte {}{}; it has {}", wanted, suggestion(wanted, all), join(all)));
  for (const MatteLayer* layer : asked)
    if (has_all(*layer, names)) found.push_back(layer);
  if (found.empty()) found = asked;  // so that the error below says what it lacks
  if (found.size() > 1 && has_all(*found[0], names)) {
    std::vector<std::string> both;
    for (const MatteLayer* layer : found) both.push_back(layer->name);
    throw InputError(fmt::format("{} is in {}; expected one of them to be named", join(names), join(both, " and in ")));
  }
  if (found.size() > 1) {
    std::string text;
    for (const MatteLayer* layer : found) text += fmt::format("; {} has {}", layer->name, join(names_of(*layer)));
    throw InputError(fmt::format("no Cryptomatte has {}{}", join(names), text));
  }
  if (!found[0]->problem.empty()) throw InputError(fmt::format("{}: {}", found[0]->name, found[0]->problem));
  return matte(frame, *found[0], matte_ids(*found[0], names));
}

}  // namespace brume
