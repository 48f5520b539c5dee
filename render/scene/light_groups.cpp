#include "render/scene/light_groups.h"

#include <algorithm>

#include "image/layers.h"

namespace brume {
namespace {

constexpr const char* kRest = "rest";

bool emits(const VolumeSettings& v) {
  return v.emission != dvec3(0) || v.temperature_grid != "none" || v.flame_grid != "none";
}

/// Gives everything its group.
class Sorter {
 public:
  Sorter(LightGroups& groups, bool each) : groups_(groups), each_(each) {}

  /// Called with all names that the scene says before any other, so that no name of ours is one of them.
  void announce(const std::string& group) {
    if (!group.empty()) place_of(group);
  }
  size_t operator()(const std::string& group, bool shines, const std::string& kind) {
    if (!group.empty()) return place_of(group);
    if (!shines) return 0;
    if (!each_) return place_of(kRest);
    std::string name = kind;
    for (int number = 2; find(name) != groups_.names.end(); ++number) name = kind + "_" + std::to_string(number);
    return place_of(name);
  }

 private:
  std::vector<std::string>::iterator find(const std::string& name) {
    return std::find(groups_.names.begin(), groups_.names.end(), name);
  }
  size_t place_of(const std::string& name) {
    auto found = find(name);
    if (found == groups_.names.end()) found = groups_.names.insert(found, name);
    return static_cast<size_t>(found - groups_.names.begin());
  }

  LightGroups& groups_;
  bool each_;
};

}  // namespace

LightGroups light_groups_of(const Scene& scene) {
  LightGroups groups;
  const bool each = scene.render.light_groups;
  Sorter sort(groups, each);
  const EnvironmentSettings& sky = scene.environment;
  const auto visit = [&](const auto& take_sky, const auto& take_light, const auto& take_surface,
                         const auto& take_volume) {
    take_sky(sky.group, sky.radiance != dvec3(0), "sky");
    for (const LightSettings& l : scene.lights) take_light(l.group, true, l.type);
    for (const SurfaceSettings& s : scene.surfaces) take_surface(s.group, s.radiance != dvec3(0), "mesh");
    for (const VolumeSettings& v : scene.volumes) take_volume(v.group, emits(v), "fire");
  };
  const auto announce = [&](const std::string& group, bool, const std::string&) { sort.announce(group); };
  visit(announce, announce, announce, announce);
  if (groups.names.empty() && !each) return groups;
  const auto into = [&](std::vector<size_t>& places) {
    return [&](const std::string& group, bool shines, const std::string& kind) {
      places.push_back(sort(group, shines, kind));
    };
  };
  visit([&](const std::string& group, bool shines,
            const std::string& kind) { groups.environment = sort(group, shines, kind); },
        into(groups.lights), into(groups.surfaces), into(groups.volumes));
  return groups;
}

std::string what_forbids_group(std::string_view name) {
  if (name.empty()) return "is empty";
  if (name == kRest) return "is the layer of all light without a group";
  const auto fits = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
  };
  if (!std::all_of(name.begin(), name.end(), fits)) return "has other characters than letters, digits, _ and -";
  for (const std::string_view which : {statistic::mean_variance, statistic::half_a, statistic::half_b})
    if (name == which || name.starts_with("bucket_")) return "is the name of a statistic";
  return "";
}

}  // namespace brume
