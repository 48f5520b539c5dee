#pragma once
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "render/scene/scene.h"
#include "volume/between_frames.h"
#include "volume/vdb_io.h"

namespace brume {

/// The file that one of a volume's fields is read from: its own, or the density's.
const std::filesystem::path& file_of(const VolumeSettings& volume, GridUse use);

/// Where a volume says that its files' values lie.
Paging paging_of(const VolumeSettings& volume);

/// A grid of a volume's file beside its density, as the scene names it. Where that leaves it open ("auto") and the file
/// has none of the kind, an empty field with a note; so for a temperature in a file whose grid of flames is empty,
/// where it is what lifts the smoke and nothing burns.
/// @throws InputError: as load_scalar
ScalarField load_field(const VolumeSettings& volume, const std::string& name, GridUse use, const Task& task);

/// The same of a colour; without one its notes are all it holds.
VectorField load_colour_field(const std::filesystem::path& file, const std::string& name, const Task& task);

/// Reads the fields of a volume of files: of the frame that it shows, or of what is between two frames of its sequence.
class VolumeFields {
 public:
  /// @param volume, task  must outlive it   @param blurred  whether displacement() will be asked for
  /// @param notes         where lines on what was found go
  VolumeFields(const VolumeSettings& volume, bool blurred, std::vector<std::string>& notes, const Task& task)
      : v_(volume), blurred_(blurred), notes_(notes), task_(task) {}

  /// First, where there is a motion. @throws InputError: as load_scalar, displacement_over
  ScalarField density(const ScalarOptions& options);
  ScalarField temperature();
  ScalarField flame();
  VectorField colour();

  /// The motion of one of these fields over the shutter.
  /// @param open, close  in frames of the volume, around the time that is shown
  /// @throws InputError: as load_displacement
  Displacement displacement(const ScalarField& field, double open, double close);

 private:
  ScalarField between(const ScalarField& first, const ScalarField& second);
  TimeBetween time() const { return {v_.moment.share, v_.moment.frames, v_.velocity_scale}; }
  /// Whether there is a velocity in both frames to carry fields along.
  bool carried();
  void tell_misfit(const BetweenFrames& density);

  const VolumeSettings& v_;
  const bool blurred_;
  std::vector<std::string>& notes_;
  const Task& task_;
  bool asked_ = false;  // for velocities_
  std::optional<std::array<StoredVelocity, 2>> velocities_;
  std::optional<StoredVelocity> velocity_;  // at the time between the frames, world units per frame
};

}  // namespace brume
