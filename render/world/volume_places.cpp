#include "render/world/volume_places.h"

#include <fmt/format.h>

#include <utility>

#include "base/error.h"
#include "render/scene/instance_files.h"
#include "render/world/atmosphere_sky.h"

namespace brume {
namespace {

constexpr size_t kMostCopies = 256;

/// Those of sequences are gone by now: such places stand in volumes of their own frame.
[[noreturn]] void refuse_time_offsets(size_t entry) {
  throw InputError(fmt::format(
      "instances.{}: its places have time offsets, and its volume no table time; expected that of a sequence", entry));
}

/// Empty where instances of a volume are places of one medium.
std::string why_copies(const VolumeSettings& v, const Scene& scene) {
  const bool blurred = scene.camera.shutter.y > scene.camera.shutter.x;
  if (v.emission != dvec3(0)) return "emits (emission)";
  if (v.temperature_grid != "none") return "emits (temperature_grid)";
  if (v.flame_grid != "none") return "emits (flame_grid)";
  if (v.sigma_t.x != v.sigma_t.y || v.sigma_t.x != v.sigma_t.z) return "has an extinction with a colour (sigma_t)";
  if (blurred && v.velocity_grid != "none") return "is blurred by its velocity (velocity_grid)";
  if (blurred && v.object_to_world_end != dmat4(0.0)) return "moves over the shutter (object_to_world_end)";
  return "";
}

}  // namespace

VolumePlaces::VolumePlaces(const Scene& scene) : world(scene) {
  world.volumes.clear();
  for (size_t i = 0; i < scene.volumes.size(); ++i) add_instances(scene, i);
  add_air(scene);
}

void VolumePlaces::add_air(const Scene& scene) {
  size_t number = scene.volumes.size();
  for (const VolumeSettings& v : air_of(scene)) add(v, number++);
}

void VolumePlaces::add_instances(const Scene& scene, size_t i) {
  const VolumeSettings& v = scene.volumes[i];
  InstanceList all;
  std::vector<size_t> of;  // by place: its list
  for (size_t k = 0; k < scene.instances.size(); ++k) {
    if (static_cast<size_t>(scene.instances[k].volume) != i) continue;
    const InstanceList some = places_of(scene.instances[k], fmt::format("instances.{}", k));
    if (!some.time_offsets.empty()) refuse_time_offsets(k);
    all.matrices.insert(all.matrices.end(), some.matrices.begin(), some.matrices.end());
    all.densities.insert(all.densities.end(), some.densities.begin(), some.densities.end());
    all.tints.insert(all.tints.end(), some.tints.begin(), some.tints.end());
    of.insert(of.end(), some.matrices.size(), k);
  }
  for (size_t k = 0; k < all.tints.size(); ++k)
    if (const double highest = max_component(v.albedo * all.tints[k]); highest > 1 + 1e-9)
      throw InputError(fmt::format(
          "volumes.{}: the tint of its instance {} makes an albedo of {:.6g}; expected at most 1", i, k, highest));
  const std::string why = why_copies(v, scene);
  if (all.matrices.empty() || why.empty()) {
    add(v, i);
    instances.back() = std::move(all);
    lists.back() = std::move(of);
    return;
  }
  if (all.matrices.size() > kMostCopies)
    throw InputError(fmt::format(
        "volumes.{}: it {}, and stands at {} places; expected at most {} of such a volume, or one that does not", i,
        why, all.matrices.size(), kMostCopies));
  add_copies(v, i, all, of);
}

void VolumePlaces::add_copies(const VolumeSettings& v, size_t i, const InstanceList& places,
                              const std::vector<size_t>& of) {
  for (size_t k = 0; k < places.matrices.size(); ++k) {
    VolumeSettings copy = v;
    copy.object_to_world = places.matrices[k] * v.object_to_world;
    if (v.object_to_world_end != dmat4(0.0)) copy.object_to_world_end = places.matrices[k] * v.object_to_world_end;
    copy.sigma_t *= places.densities[k];
    copy.emission *= places.densities[k];
    copy.albedo *= places.tints[k];
    add(copy, i);
    lists.back() = {of[k]};
  }
}

void VolumePlaces::add(const VolumeSettings& v, size_t number) {
  world.volumes.push_back(v);
  volume.push_back(number);
  instances.emplace_back();
  lists.emplace_back();
}

}  // namespace brume
