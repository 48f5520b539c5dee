#include "render/scene/matte_names.h"

#include <fmt/format.h>

#include <set>
#include <string_view>

namespace brume {
namespace {

/// "smoke" of smoke.0042.vdb and of smoke_####.vdb; a name that is nothing but a number stays.
std::string stem_of(const std::filesystem::path& file) {
  const std::string stem = file.stem().string();
  size_t end = stem.find_last_not_of("0123456789#");
  if (end != std::string::npos) end = stem.find_last_not_of("._-", end);
  return end == std::string::npos ? stem : stem.substr(0, end + 1);
}

std::string kind_of(const VolumeSettings& v) {
  if (v.shape != "grid") return v.shape;
  return v.file.empty() ? "volume" : stem_of(v.file);
}

std::string kind_of(const SurfaceSettings& s) {
  return s.file.empty() ? "mesh" : stem_of(s.file);
}

}  // namespace

MatteNames::MatteNames(const Scene& scene) {
  std::set<std::string> taken;
  for (const VolumeSettings& v : scene.volumes) taken.insert(v.name);
  for (const InstanceSettings& s : scene.instances) taken.insert(s.name);
  for (const SurfaceSettings& s : scene.surfaces) taken.insert(s.name);
  const auto name_of = [&](const auto& thing) {
    if (!thing.name.empty()) return thing.name;
    const std::string kind = kind_of(thing);
    std::string name = kind;
    for (int number = 2; taken.contains(name); ++number) name = fmt::format("{}_{}", kind, number);
    taken.insert(name);
    return name;
  };
  for (const VolumeSettings& v : scene.volumes) {
    volumes.push_back(name_of(v));
    volume_materials.push_back(!v.material_name.empty() ? v.material_name : v.preset == "none" ? "volume" : v.preset);
  }
  for (const InstanceSettings& s : scene.instances)
    instances.push_back(s.name.empty() ? volumes.at(static_cast<size_t>(s.volume)) : s.name);
  for (const SurfaceSettings& s : scene.surfaces) {
    surfaces.push_back(name_of(s));
    surface_materials.push_back(s.material_name.empty() ? s.material : s.material_name);
  }
}

}  // namespace brume
