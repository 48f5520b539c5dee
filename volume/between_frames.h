#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "volume/displacement.h"
#include "volume/vdb_io.h"

namespace brume {

/// A time between two frames of a sequence.
struct TimeBetween {
  double share = 0;   ///< of the way from the first frame to the second, 0 .. 1
  double frames = 1;  ///< of the sequence from one to the other
  double scale = 1;   ///< world units of the file per frame, for one unit of stored velocity
};

/// What a field of a sequence is between two of its frames.
///
/// Both are carried to that time along the velocities, which are those of the two frames mixed by time: where a point
/// comes from and where it goes is followed in midpoint steps of at most half a frame. What is found there in each
/// frame (cubic, within the eight voxels around) is mixed by time, too. Fields of different lattices meet on that of
/// the first frame, or of the second where its voxels are smaller.
///
/// Nothing is known of sources: what appears or vanishes between the two fades.
/// Proof: tests/volume/between_frames_test.cpp
class BetweenFrames {
 public:
  /// @param first, second  must outlive it; each with its velocity, as it is stored
  /// @throws InputError: as displacement_over
  BetweenFrames(const ScalarField& first, const StoredVelocity& first_velocity, const ScalarField& second,
                const StoredVelocity& second_velocity, const TimeBetween& time, std::vector<std::string>& notes,
                const Task& task = {});
  /// Without velocities: the two fade into each other where they are.
  BetweenFrames(const ScalarField& first, const ScalarField& second, const TimeBetween& time);
  ~BetweenFrames();

  /// A quantity per volume, such as a density: what the flow spreads thins, and the total is that of the two frames,
  /// mixed by time.
  ScalarField density(const Task& task = {}) const;
  /// A quantity of the stuff that moves, such as a temperature: the flow changes no value.
  ScalarField intensity(const Task& task = {}) const;
  /// The velocity at that time, on the field's lattice, in world units per frame.
  StoredVelocity velocity(const Task& task = {}) const;

  /// How well the first frame, carried all the way, meets the second: root mean square difference, as a share of that
  /// of the first frame where it is. Above 1 the velocities are not those of this motion, or not in this unit.
  double misfit(const Task& task = {}) const;
  /// The factor on `scale` that brings the least misfit, by straight steps back from the second frame.
  double best_factor(const Task& task = {}) const;

 private:
  class Inside;
  std::unique_ptr<const Inside> inside_;
};

/// What is between two scalar fields, as BetweenFrames::intensity() makes it.
using FieldBetween = std::function<ScalarField(const ScalarField& first, const ScalarField& second)>;

/// The same for each component of a colour. Where one of the frames has no colour, the other's counts alone.
VectorField colour_between(const VectorField& first, const VectorField& second, const FieldBetween& between,
                           const Task& task = {});

}  // namespace brume
