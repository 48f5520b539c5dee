#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>

#include "render/scene/scene.h"

namespace brume {

/// The frame of a volume at a frame of the scene, fractions and all, wherever its sequence begins and ends.
double volume_frame(const VolumeTime& time, double scene_frame);

/// A frame within a sequence that begins and ends.
struct SequencePlace {
  int before = 0, after = 0;  ///< the files on either side; equal at a file's own frame
  double share = 0;           ///< of the way from one to the other
  int direction = 1;          ///< in which the sequence runs there: 1, -1, or 0 where it is held
};

/// Where a frame is in a sequence, by what `beyond` says of those outside; nothing for such a frame where that is
/// "error" or "empty".
std::optional<SequencePlace> place_in_sequence(double frame, int first, int last, const std::string& beyond);

/// The place among the files that there are, by what `missing` says.
/// @param files  rising, at least one   @return nothing where a file is not there and that is "error"
struct FilePlace {
  int before = 0, after = 0;
  double share = 0, frames = 1;  ///< frames: of the sequence between the two
};
std::optional<FilePlace> place_among_files(const SequencePlace& place, std::span<const int> files,
                                           const std::string& missing);

/// Of a volume's files: the keys that name them.
struct VolumeFileKey {
  const char* key;
  std::filesystem::path VolumeSettings::*file;
};
inline constexpr VolumeFileKey kVolumeFiles[] = {{"file", &VolumeSettings::file},
                                                 {"albedo_file", &VolumeSettings::albedo_file},
                                                 {"temperature_file", &VolumeSettings::temperature_file},
                                                 {"flame_file", &VolumeSettings::flame_file},
                                                 {"velocity_file", &VolumeSettings::velocity_file}};

/// Ends with an error at a key of the volume or of its table `time`.
using FailAtKey = std::function<void(const std::string& key, const std::string& message, const std::string& expected)>;

/// The frames whose files there are, by the names in the volume's moment.
std::vector<int> frames_in_time(const VolumeSettings& volume);

/// Has a volume's files be those of the frame that its table `time` says, and sets its moment, whose names say where.
/// @param files  as frames_in_time gives them
/// @param frame, shutter  of the scene
void set_in_time(VolumeSettings& volume, const std::vector<int>& files, int frame, const dvec2& shutter,
                 const FailAtKey& fail);

}  // namespace brume
