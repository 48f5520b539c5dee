#include "workflows/mix_lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "base/error.h"
#include "base/text.h"
#include "filters/api/filter.h"
#include "image/guide_names.h"
#include "image/light_layers.h"
#include "render/scene/light_groups.h"
#include "render/scene/scene_io.h"
#include "render/scene/scene_outline.h"

namespace brume {
namespace {

// Light, as far as no group has it by itself.
constexpr std::string_view kLight[] = {"beauty", "direct",  "indirect",         "background",        "emission",
                                       "single", "surface", "surface_emission", "volume_indirect",   "surface_indirect",
                                       "noisy",  "flash",   "catcher",          "catcher_unshadowed"};

constexpr std::string_view kGiveGroups = "give lights a group in the scene, or set light_groups = true in [render]";

/// The layer of a channel, without its statistic and without "clean_".
std::string_view layer_of(std::string_view channel) {
  if (channel == "R" || channel == "G" || channel == "B") return "beauty";
  channel = channel.substr(0, channel.find('.'));
  if (channel.starts_with("clean_")) channel.remove_prefix(6);
  const auto is = [&](std::string_view which) { return channel == which; };
  const bool of_beauty = is(statistic::mean_variance) || is(statistic::half_a) || is(statistic::half_b) ||
                         std::any_of(statistic::buckets.begin(), statistic::buckets.end(), is) || is("error");
  return of_beauty ? "beauty" : channel;
}

/// The group of a channel of its light; empty for another.
std::string group_of(std::string_view channel) {
  if (channel.starts_with("clean_")) channel.remove_prefix(6);
  if (!channel.starts_with(kLightPrefix)) return "";
  channel.remove_prefix(kLightPrefix.size());
  return std::string(channel.substr(0, channel.find('.')));
}

dvec3 factor_of(const LightMix& mix, const std::string& group) {
  const auto found = mix.find(group);
  return found == mix.end() ? dvec3(1) : found->second;
}

Plane times(const Plane& plane, double factor) {
  Plane out(plane.width(), plane.height());
  for (int y = 0; y < plane.height(); ++y)
    for (int x = 0; x < plane.width(); ++x) out(x, y) = static_cast<float>(factor * static_cast<double>(plane(x, y)));
  return out;
}

}  // namespace

void add_to_mix(LightMix& mix, const std::string& assignment) {
  const auto wrong = [&] {
    return InputError(fmt::format("'{}': expected GROUP=FACTOR or GROUP=R,G,B with numbers of at least 0", assignment));
  };
  const size_t equals = assignment.find('=');
  if (equals == 0 || equals == std::string::npos) throw wrong();
  std::vector<double> numbers;
  for (const std::string& word : split(assignment.substr(equals + 1), ',')) {
    double& number = numbers.emplace_back();
    const char* const end = word.data() + word.size();
    const auto read = std::from_chars(word.data(), end, number);
    if (read.ec != std::errc() || read.ptr != end || !(number >= 0) || number > 1e30) throw wrong();
  }
  if (numbers.size() != 1 && numbers.size() != 3) throw wrong();
  const dvec3 factor = numbers.size() == 1 ? dvec3(numbers[0]) : dvec3(numbers[0], numbers[1], numbers[2]);
  const auto [entry, added] = mix.try_emplace(assignment.substr(0, equals), dvec3(1));
  entry->second *= factor;
}

void check_light_groups(const LightMix& mix, const std::vector<std::string>& groups, const std::string& of) {
  for (const auto& [group, factor] : mix) {
    if (std::find(groups.begin(), groups.end(), group) != groups.end()) continue;
    if (groups.empty()) throw InputError(fmt::format("no light group '{}': {} has none; {}", group, of, kGiveGroups));
    throw InputError(
        fmt::format("no light group '{}'{}; {} has: {}", group, suggestion(group, groups), of, join(groups)));
  }
}

bool is_light_of_all_groups(std::string_view channel) {
  const std::string_view layer = layer_of(channel);
  return is_guide(channel) || std::find(std::begin(kLight), std::end(kLight), layer) != std::end(kLight);
}

std::string text_of_mix(const LightMix& mix) {
  std::vector<std::string> said;
  for (const auto& [group, factor] : mix)
    said.push_back(fmt::format("{} = {}, {}, {}", group, factor.x, factor.y, factor.z));
  return join(said, "; ");
}

Layers mix_lights(const Layers& frame, const LightMix& mix) {
  const std::vector<std::string> groups = light_groups_in(frame);
  if (groups.empty()) throw InputError(fmt::format("has no light groups to mix; {}", kGiveGroups));
  check_light_groups(mix, groups, "the frame");
  Layers mixed = frame.without_channels();
  for (const auto& [name, plane] : frame.channels()) {
    const std::string group = group_of(name);
    if (group.empty()) {
      if (!is_light_of_all_groups(name)) mixed.set(name, plane);
      continue;
    }
    const size_t colour = std::string_view("RGB").find(name.back());
    if (colour == std::string_view::npos) continue;
    const double factor = factor_of(mix, group)[static_cast<int>(colour)];
    const bool variance = name.find(statistic::mean_variance) != std::string::npos;
    mixed.set(name, times(plane, variance ? factor * factor : factor));
  }
  const auto sum = [&](const auto& layer_of_group, const LayerName& target) {
    const auto to = mixed.add_rgb(target);
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < frame.height(); ++y)
        for (int x = 0; x < frame.width(); ++x) {
          double light = 0;
          for (const std::string& group : groups)
            light += static_cast<double>(mixed.at(layer_of_group(group) + "." + target.channels[c])(x, y));
          (*to[c])(x, y) = static_cast<float>(light);
        }
  };
  const bool clean = std::all_of(groups.begin(), groups.end(), [&](const std::string& group) {
    return frame.find(clean_light_layer(group) + ".R") != nullptr;
  });
  if (clean) {
    sum(clean_light_layer, layer::beauty);
    sum(light_layer, layer::noisy);
  } else {
    sum(light_layer, layer::beauty);
  }
  mixed.header["lightMix"] = text_of_mix(mix);
  return mixed;
}

std::vector<std::string> assignments_of_mix(const std::string& text, const std::filesystem::path& path,
                                            const LightMix& mix) {
  const Scene scene = parse_scene_alone(text, path);
  const LightGroups groups = light_groups_of(scene);
  check_light_groups(mix, groups.names, "the scene");
  std::vector<std::string> assignments;
  const auto multiply = [&](const std::string& table, const char* key, const dvec3& value, const dvec3& factor) {
    if (value == dvec3(0) || factor == dvec3(1)) return;
    const dvec3 v = value * factor;
    assignments.push_back(fmt::format("{}.{}=[{}, {}, {}]", table, key, v.x, v.y, v.z));
  };
  const auto multiply_number = [&](const std::string& table, const char* key, double value, const dvec3& factor) {
    if (factor == dvec3(1)) return;
    if (factor.x != factor.y || factor.x != factor.z)
      throw InputError(fmt::format("{}.{} has no colour: a mix can only make it brighter or darker", table, key));
    assignments.push_back(fmt::format("{}.{}={}", table, key, value * factor.x));
  };
  const auto factor_at = [&](size_t group) {
    return groups.names.empty() ? dvec3(1) : factor_of(mix, groups.names[group]);
  };
  multiply("environment", "radiance", scene.environment.radiance, factor_at(groups.environment));
  // Entries that are not enabled count in a table's number, but are not in the scene.
  std::map<std::string, std::vector<std::string>> tables;
  for (const SceneTable& table : outline_scene(text, path)) {
    const SceneKey* const enabled = table.find("enabled");
    if (enabled && std::get<bool>(enabled->value))
      tables[table.path.substr(0, table.path.find('.'))].push_back(table.path);
  }
  for (size_t i = 0; i < scene.lights.size(); ++i) {
    const LightSettings& l = scene.lights[i];
    const dvec3 factor = factor_at(groups.lights.empty() ? 0 : groups.lights[i]);
    multiply(tables["lights"][i], "irradiance", l.irradiance, factor);
    multiply(tables["lights"][i], "radiance", l.radiance, factor);
    multiply(tables["lights"][i], "intensity", l.intensity, factor);
  }
  for (size_t i = 0; i < scene.surfaces.size(); ++i)
    multiply(tables["surfaces"][i], "radiance", scene.surfaces[i].radiance,
             factor_at(groups.surfaces.empty() ? 0 : groups.surfaces[i]));
  for (size_t i = 0; i < scene.volumes.size(); ++i) {
    const VolumeSettings& v = scene.volumes[i];
    const dvec3 factor = factor_at(groups.volumes.empty() ? 0 : groups.volumes[i]);
    multiply(tables["volumes"][i], "emission", v.emission, factor);
    if (v.temperature_grid != "none")
      multiply_number(tables["volumes"][i], "blackbody_intensity", v.blackbody_intensity, factor);
    if (v.flame_grid != "none") multiply_number(tables["volumes"][i], "flame_intensity", v.flame_intensity, factor);
  }
  return assignments;
}

}  // namespace brume
