#include "apps/view/messages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>

#include "base/error.h"

namespace brume::web {
namespace {

using nlohmann::json;

const json& member(const json& message, const char* key) {
  const auto found = message.find(key);
  if (found == message.end()) throw InputError(fmt::format("a message has no \"{}\"", key));
  return *found;
}

double number(const json& message, const char* key) {
  const json& value = member(message, key);
  if (!value.is_number() || !std::isfinite(value.get<double>()))
    throw InputError(fmt::format("\"{}\" of a message is no number", key));
  return value.get<double>();
}

uint64_t whole_number(const json& message, const char* key) {
  const json& value = member(message, key);
  if (!value.is_number_unsigned()) throw InputError(fmt::format("\"{}\" of a message is no whole number from 0", key));
  return value.get<uint64_t>();
}

std::vector<std::string> texts(const json& message, const char* key, size_t most) {
  const json& value = member(message, key);
  if (!value.is_array() || value.size() > most ||
      !std::all_of(value.begin(), value.end(), [](const json& entry) { return entry.is_string(); }))
    throw InputError(fmt::format("\"{}\" of a message is no list of at most {} texts", key, most));
  return value.get<std::vector<std::string>>();
}

/// {"key": 2, "fill": [1, 0.8, 0.6]}: groups whose light is as rendered are left out.
LightMix mix_of(const json& value) {
  if (!value.is_object() || value.size() > kMostMixed)
    throw InputError(fmt::format("\"mix\" of a message is no object of at most {} light groups", kMostMixed));
  LightMix mix;
  for (const auto& [group, factor] : value.items()) {
    const auto is_gain = [](const json& v) {
      return v.is_number() && v.get<double>() >= 0 && v.get<double>() <= kMostGain;
    };
    const bool three = factor.is_array() && factor.size() == 3 && std::all_of(factor.begin(), factor.end(), is_gain);
    if (!three && !is_gain(factor))
      throw InputError(fmt::format(
          "\"mix\" of a message: expected a number from 0 to {:g}, or three of them, for each light group", kMostGain));
    const dvec3 gain = three ? dvec3(factor[0], factor[1], factor[2]) : dvec3(factor.get<double>());
    if (gain != dvec3(1)) mix[group] = gain;
  }
  return mix;
}

ViewLook look_of(const json& message) {
  ViewLook look;
  look.id = whole_number(message, "id");
  look.assignments = texts(message, "set", kMostAssignments);
  look.layers = texts(message, "layers", kMostLayers);
  const json& size = member(message, "size");
  if (!size.is_array() || size.size() != 2 || !size[0].is_number_integer() || !size[1].is_number_integer())
    throw InputError("\"size\" of a message is not two whole numbers");
  look.size = {size[0].get<int>(), size[1].get<int>()};
  if (look.size.x < 1 || look.size.y < 1 || look.size.x > kLargestSide || look.size.y > kLargestSide)
    throw InputError(
        fmt::format("a picture of {} x {} is asked for, expected 1 to {}", look.size.x, look.size.y, kLargestSide));
  look.moving = message.value("moving", json(false)) == json(true);
  if (message.contains("revision")) look.revision = whole_number(message, "revision");
  if (const auto mix = message.find("mix"); mix != message.end()) look.mix = mix_of(*mix);
  if (message.contains("samples"))
    look.most_samples = static_cast<int>(std::clamp<uint64_t>(whole_number(message, "samples"), 1, look.most_samples));
  if (const auto frame = message.find("frame"); frame != message.end() && !frame->is_null()) {
    if (!frame->is_number_integer()) throw InputError("\"frame\" of a message is no whole number");
    look.frame = frame->get<int>();
  }
  return look;
}

const char* name_of(SceneKey::Type type) {
  using Type = SceneKey::Type;
  static const std::map<Type, const char*> names = {
      {Type::kSwitch, "switch"}, {Type::kInteger, "integer"}, {Type::kNumber, "number"},  {Type::kChoice, "choice"},
      {Type::kVector, "vector"}, {Type::kColour, "color"},    {Type::kNumbers, "numbers"}};
  const auto found = names.find(type);
  return found == names.end() ? "text" : found->second;
}

json json_of(const SceneKey& key) {
  json field = {{"key", key.field.key},
                {"type", name_of(key.type)},
                {"value", std::visit([](const auto& value) { return json(value); }, key.value)},
                {"unit", key.field.unit},
                {"help", key.field.help}};
  if (std::isfinite(key.field.lowest)) field["lowest"] = key.field.lowest;
  if (std::isfinite(key.field.highest)) field["highest"] = key.field.highest;
  if (!key.field.choices.empty()) field["choices"] = key.field.choices;
  if (key.type == SceneKey::Type::kFile || key.type == SceneKey::Type::kTable) field["fixed"] = true;
  return field;
}

json json_of(const dvec3& v) {
  return {v.x, v.y, v.z};
}
json json_of(std::optional<double> v) {
  return v ? json(*v) : json(nullptr);
}

std::string dumped(const json& message) {
  // Names of files may be no UTF-8.
  return message.dump(-1, ' ', false, json::error_handler_t::replace);
}

}  // namespace

std::variant<ViewLook, ViewProbe> parse_message(std::string_view text) {
  if (text.size() > kLongestMessage) throw InputError("a message is too long");
  // Lists in lists would be parsed by recursion.
  int depth = 0;
  const json message = json::parse(
      text,
      [&](int level, json::parse_event_t, json&) {
        depth = std::max(depth, level);
        return level < 8;
      },
      false);
  if (message.is_discarded() || !message.is_object() || depth >= 8) throw InputError("a message is no JSON object");
  const json& type = member(message, "type");
  if (type == "look") return look_of(message);
  if (type == "probe") {
    const dvec2 at(number(message, "x"), number(message, "y"));
    if (glm::any(glm::lessThan(at, dvec2(0))) || glm::any(glm::greaterThan(at, dvec2(1))))
      throw InputError("a probe lies outside of the picture");
    return ViewProbe{whole_number(message, "id"), at};
  }
  throw InputError("the type of a message is neither \"look\" nor \"probe\"");
}

std::string text_of(const ViewSceneText& scene) {
  json layers = json::array(), tables = json::array();
  for (const auto& layer : scene.layers)
    layers.push_back({{"name", layer.name},
                      {"title", layer.title},
                      {"channels", layer.channels},
                      {"group", layer.group},
                      {"unit", layer.unit}});
  for (const auto& table : scene.tables) {
    json fields = json::array();
    for (const SceneKey& key : table.keys.keys) fields.push_back(json_of(key));
    json group = {{"path", table.keys.path}, {"title", table.title}, {"fields", fields}};
    if (!table.grids.empty()) group["grids"] = table.grids;
    if (table.depth) group["optical_depth"] = *table.depth;
    tables.push_back(std::move(group));
  }
  json message = {{"type", "scene"},
                  {"id", scene.id},
                  {"name", scene.name},
                  {"command", scene.command},
                  {"reloaded", scene.reloaded},
                  {"frames", scene.frames.empty() ? json(nullptr) : json(scene.frames)},
                  {"bounds", {json_of(scene.lo), json_of(scene.hi)}},
                  {"layers", layers},
                  {"notes", scene.notes},
                  {"left_out", scene.left_out},
                  {"groups", tables}};
  if (scene.of_frames) message["of"] = "frames";
  if (!scene.light_groups.empty()) message["light_groups"] = scene.light_groups;
  return dumped(message);
}

std::string progress_text(const ViewProgress& p) {
  constexpr std::array kNames = {"reading", "solving light", "marching", "sampling", "cleaning", "done"};
  return dumped({{"type", "progress"},
                 {"id", p.id},
                 {"stage", kNames[static_cast<size_t>(p.stage)]},
                 {"samples", p.samples},
                 {"goal", p.goal},
                 {"share", json_of(p.share)},
                 {"error", json_of(p.error)},
                 {"seconds", p.seconds}});
}

std::string elsewhere_text(uint64_t id) {
  return dumped({{"type", "progress"}, {"id", id}, {"stage", "elsewhere"}});
}

std::string problem_text(const ViewProblem& problem) {
  json message = {{"type", "problem"}, {"id", problem.id}, {"text", problem.text}, {"lasting", problem.lasting}};
  if (problem.grids.empty()) return dumped(message);
  json grids = json::array();
  for (const GridChoice& grid : problem.grids)
    grids.push_back({{"name", grid.name}, {"type", grid.type}, {"usable", grid.usable}});
  message["grid_key"] = problem.grid_key;
  message["grids"] = std::move(grids);
  return dumped(message);
}

std::string assignments_text(const std::vector<std::string>& assignments) {
  return dumped(assignments);
}

std::string point_text(uint64_t id, std::optional<dvec3> position) {
  return dumped({{"type", "point"}, {"id", id}, {"position", position ? json_of(*position) : json(nullptr)}});
}

std::string bytes_of(const ViewPicture& p) {
  static_assert(std::endian::native == std::endian::little);
  json about = {{"id", p.id},           {"layer", p.layer},       {"width", p.width},
                {"height", p.height},   {"channels", p.channels}, {"stage", p.predicted ? "predicted" : "clean"},
                {"full", p.full},       {"samples", p.samples},   {"error", json_of(p.error)},
                {"seconds", p.seconds}, {"exposure", p.exposure}, {"frame", p.frame ? json(*p.frame) : json(nullptr)}};
  if (p.misses_mix) about["mixed"] = false;
  std::string header = dumped(about);
  header.resize((header.size() + 3) / 4 * 4, ' ');
  const auto length = static_cast<uint32_t>(header.size());
  std::string bytes(4 + header.size() + 2 * p.halves.size(), '\0');
  std::memcpy(bytes.data(), &length, 4);
  std::memcpy(bytes.data() + 4, header.data(), header.size());
  std::memcpy(bytes.data() + 4 + header.size(), p.halves.data(), 2 * p.halves.size());
  return bytes;
}

}  // namespace brume::web
