#include "render/scene/volume_time.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/sequence.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr double kNearlyWhole = 1e-6;  // frames: so near a file's own frame it is taken

/// What a sequence has on disk, in words.
std::string files_text(const fs::path& name, const std::vector<int>& files) {
  return files.empty() ? fmt::format("there is no file {}", name.string())
                       : fmt::format("there are files of the frames {}", frames_text(files));
}

}  // namespace

double volume_frame(const VolumeTime& time, double scene_frame) {
  const auto& rows = time.frame;
  if (rows.empty()) return time.offset + scene_frame * time.fps / time.scene_fps;
  const auto above = std::find_if(rows.begin(), rows.end(), [&](const auto& row) { return row[0] > scene_frame; });
  if (above == rows.begin()) return time.offset + rows.front()[1];
  if (above == rows.end()) return time.offset + rows.back()[1];
  const auto& a = *(above - 1);
  const auto& b = *above;
  return time.offset + a[1] + (b[1] - a[1]) * ((scene_frame - a[0]) / (b[0] - a[0]));
}

std::optional<SequencePlace> place_in_sequence(double frame, int first, int last, const std::string& beyond) {
  const double nearest = std::round(frame);
  if (std::abs(frame - nearest) < kNearlyWhole) frame = nearest;
  SequencePlace place;
  if (frame < first || frame > last) {
    if (beyond == "error" || beyond == "empty") return std::nullopt;
    const double length = last - first;
    if (beyond == "hold" || length == 0) {
      place.before = place.after = frame < first ? first : last;
      place.direction = 0;
      return place;
    }
    const auto wrapped = [&](double period) {
      const double along = std::fmod(frame - first, period);
      return along < 0 ? along + period : along;
    };
    if (beyond == "loop") {
      frame = first + wrapped(length + 1);
    } else {
      const double along = wrapped(2 * length);
      if (along > length) place.direction = -1;
      frame = first + std::min(along, 2 * length - along);
    }
  }
  place.before = static_cast<int>(std::floor(frame));
  place.share = frame - place.before;
  place.after = place.share == 0 ? place.before : place.before == last ? first : place.before + 1;
  return place;
}

std::optional<FilePlace> place_among_files(const SequencePlace& place, std::span<const int> files,
                                           const std::string& missing) {
  const auto there = [&](int frame) { return std::binary_search(files.begin(), files.end(), frame); };
  if (there(place.before) && there(place.after)) return FilePlace{place.before, place.after, place.share, 1};
  if (missing == "error") return std::nullopt;
  const auto above = std::upper_bound(files.begin(), files.end(), place.before);
  const int before = above == files.begin() ? files.front() : *(above - 1);
  if (missing == "hold" || above == files.begin() || above == files.end() || place.after < place.before)
    return FilePlace{before, before, 0, 1};
  const double frames = *above - before;
  const double share = (place.before - before + place.share) / frames;
  return FilePlace{before, share > 0 ? *above : before, share, frames};
}

std::vector<int> frames_in_time(const VolumeSettings& v) {
  const auto file = v.moment.names.find("file");
  const auto pattern = file == v.moment.names.end() ? std::nullopt : FramePattern::of(file->second);
  return pattern ? pattern->frames_on_disk() : std::vector<int>();
}

void set_in_time(VolumeSettings& v, const std::vector<int>& files, int frame, const dvec2& shutter,
                 const FailAtKey& fail) {
  const VolumeTime& t = v.time;
  const auto name = [&](const char* key) {
    const auto found = v.moment.names.find(key);
    return found == v.moment.names.end() ? fs::path() : found->second;
  };
  const auto pattern = FramePattern::of(name("file"));
  if (!pattern)
    return fail("file", "'time' of a volume that is no sequence",
                "expected a name with the place of its frame's number, such as \"smoke.####.vdb\"");
  const std::string there = files_text(pattern->name(), files);
  if (files.empty()) return fail("file", "'file' names a sequence without files", there);
  const int first = t.first >= 0 ? t.first : files.front(), last = t.last >= 0 ? t.last : files.back();
  if (last < first)
    return fail("time", fmt::format("the sequence ends with frame {}, before it begins with {}", last, first),
                there + "; expected others as first and last");
  v.moment.later = nullptr;
  v.moment.none = false;
  v.moment.share = 0;
  v.moment.frames = 1;
  const auto take = [&](VolumeSettings& volume, int number) {
    for (const auto& [key, file] : kVolumeFiles)
      if (const auto sequence = FramePattern::of(name(key))) volume.*file = sequence->path(number);
  };
  v.moment.frame = volume_frame(t, frame);
  const std::string which = fmt::format("frame {} of the scene is frame {:.6g} of the volume", frame, v.moment.frame);
  const std::optional<SequencePlace> place = place_in_sequence(v.moment.frame, first, last, t.beyond);
  if (!place && t.beyond == "empty") {
    v.moment.none = true;
    return take(v, files.front());
  }
  if (!place)
    return fail("time", fmt::format("{}, outside of its sequence, {} .. {}", which, first, last),
                there + "; set beyond to hold, loop, ping_pong or empty, or another offset");
  const std::optional<FilePlace> found = place_among_files(*place, files, t.missing);
  if (!found)
    return fail("time", fmt::format("{}, and a file for that is missing", which),
                there + "; set missing to hold or between");
  const bool opens = shutter.y > shutter.x;
  const double per_frame =
      opens ? (volume_frame(t, frame + shutter.y) - volume_frame(t, frame + shutter.x)) / (shutter.y - shutter.x) : 1;
  v.moment.rate = place->direction * per_frame;
  take(v, t.between == "nearest" && found->share >= 0.5 ? found->after : found->before);
  if (t.between == "nearest" || found->share == 0) return;
  auto later = std::make_shared<VolumeSettings>(v);
  take(*later, found->after);
  for (const auto& [key, file] : kVolumeFiles) {
    std::error_code ignored;
    if (const fs::path& path = (*later).*file; !path.empty() && !fs::exists(path, ignored))
      return fail(key, fmt::format("'{}' of the volume's next frame is {}: no such file", key, path.string()),
                  "expected a file for each frame");
  }
  v.moment.share = found->share;
  v.moment.frames = found->frames;
  v.moment.later = std::move(later);
}

}  // namespace brume
