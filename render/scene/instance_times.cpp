#include "render/scene/instance_times.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>

#include "base/error.h"
#include "base/missing_file.h"
#include "render/scene/instance_files.h"
#include "render/scene/matte_names.h"
#include "render/scene/volume_time.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostFrames = 256;  // of one volume at once: each has grids of its own

/// What places must share to be of one volume; nothing where there is none.
using Shown = std::tuple<bool, fs::path, fs::path, double, double, double>;

Shown shown(const VolumeSettings& v) {
  const VolumeMoment& m = v.moment;
  if (m.none) return {true, {}, {}, 0, 0, 0};
  const double detail = carries_detail(v) ? m.frame : 0;  // it moves on where files stay
  return {false, v.file, m.later ? m.later->file : fs::path(), m.later ? m.share : 0, m.rate, detail};
}

/// The entries of one volume, taken apart by the frames that their places show.
class Spread {
 public:
  Spread(Scene& scene, size_t volume, std::string matte)
      : scene_(scene),
        volume_(volume),
        matte_(std::move(matte)),
        original_(scene.volumes[volume]),
        files_(frames_in_time(original_)) {}

  void add(InstanceSettings entry, InstanceList places, const std::string& name) {
    if (!original_.time.given)
      throw InputError(fmt::format(
          "{}: its places have time offsets, and its volume is no sequence with a table time; add time = {{ beyond = \"loop\" }} to it, or such",
          name));
    std::map<size_t, InstanceList> parts;  // by volume
    for (size_t i = 0; i < places.matrices.size(); ++i) {
      InstanceList& part = parts[volume_at(places.time_offsets.empty() ? 0 : places.time_offsets[i], name, i)];
      part.matrices.push_back(places.matrices[i]);
      part.densities.push_back(places.densities[i]);
      part.tints.push_back(places.tints[i]);
    }
    entry.matrices.clear();
    entry.file.clear();
    entry.object_to_world = dmat4(1);
    entry.density = 1, entry.tint = dvec3(1), entry.time_offset = 0;
    if (entry.name.empty()) entry.name = matte_;
    for (auto& [volume, part] : parts) {
      entry.volume = static_cast<int>(volume);
      entry.arrays_content = check_places(name, part);
      entry.arrays = std::make_shared<const InstanceList>(std::move(part));
      scene_.instances.push_back(entry);
    }
  }

 private:
  /// The number of the volume for places of an offset; a new one where none shows the same.
  size_t volume_at(double offset, const std::string& name, size_t place) {
    if (const auto known = by_offset_.find(offset); known != by_offset_.end()) return known->second;
    VolumeSettings v = original_;
    v.time.offset += offset;
    set_in_time(v, files_, scene_.render.frame, scene_.camera.shutter,
                [&](const std::string&, const std::string& message, const std::string& expected) {
                  throw InputError(
                      fmt::format("{}: place {}, its time offset {}: {}; {}", name, place, offset, message, expected));
                });
    const auto [at, fresh] = by_shown_.try_emplace(shown(v), scene_.volumes.size());
    for (const auto& [key, file] : kVolumeFiles)
      if (const fs::path& path = v.*file; fresh && !path.empty() && !v.moment.none) check_exists(path);
    if (fresh && by_shown_.size() > kMostFrames)
      throw InputError(fmt::format(
          "{}: its places show more than {} frames of their volume at once; expected at most that: between = \"nearest\" of its time shows those of files alone",
          name, kMostFrames));
    if (fresh && by_shown_.size() == 1) {
      at->second = volume_;
      v.name = matte_;
      scene_.volumes[volume_] = v;
    } else if (fresh) {
      v.name = matte_;
      scene_.volumes.push_back(v);
    }
    return by_offset_[offset] = at->second;
  }

  Scene& scene_;
  const size_t volume_;
  const std::string matte_;
  const VolumeSettings original_;
  const std::vector<int> files_;
  std::map<double, size_t> by_offset_;
  std::map<Shown, size_t> by_shown_;
};

void leave_out_absent_volumes(Scene& scene) {
  std::vector<int> place;
  for (const VolumeSettings& v : scene.volumes)
    place.push_back(
        v.moment.none ? -1 : static_cast<int>(std::count_if(place.begin(), place.end(), [](int k) { return k >= 0; })));
  std::erase_if(scene.volumes, [](const VolumeSettings& v) { return v.moment.none; });
  std::erase_if(scene.instances, [&](const InstanceSettings& s) { return place[static_cast<size_t>(s.volume)] < 0; });
  for (InstanceSettings& s : scene.instances) s.volume = place[static_cast<size_t>(s.volume)];
}

}  // namespace

void set_instances_in_time(Scene& scene) {
  // Files are read here only where they may hold offsets that mean anything.
  std::vector<InstanceList> lists(scene.instances.size());
  std::vector<bool> spread(scene.volumes.size(), false);
  for (size_t k = 0; k < lists.size(); ++k) {
    const InstanceSettings& s = scene.instances[k];
    const auto volume = static_cast<size_t>(s.volume);
    const bool offset = s.time_offset != 0 || (s.arrays && !s.arrays->time_offsets.empty());
    if (!offset && (s.file.empty() || !scene.volumes[volume].time.given)) continue;
    lists[k] = places_of(s, fmt::format("instances.{}", k));
    if (!lists[k].time_offsets.empty()) spread[volume] = true;
  }
  if (std::find(spread.begin(), spread.end(), true) != spread.end()) {
    const std::vector<std::string> mattes = MatteNames(scene).volumes;
    const std::vector<InstanceSettings> entries = std::exchange(scene.instances, {});
    std::map<size_t, Spread> volumes;
    for (size_t k = 0; k < entries.size(); ++k) {
      const auto volume = static_cast<size_t>(entries[k].volume);
      const std::string name = fmt::format("instances.{}", k);
      if (!spread[volume]) {
        scene.instances.push_back(entries[k]);
        continue;
      }
      Spread& parts = volumes.try_emplace(volume, scene, volume, mattes[volume]).first->second;
      parts.add(entries[k], lists[k].matrices.empty() ? places_of(entries[k], name) : std::move(lists[k]), name);
    }
  }
  leave_out_absent_volumes(scene);
}

}  // namespace brume
