#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "render/scene/scene.h"

namespace brume {

/// A scene's volumes, the air of its sky among them, and where they stand. Those that cannot share all that a medium is
/// with their instances stand there as so many volumes.
class VolumePlaces {
 public:
  /// @throws InputError: what places_of throws; tints that make an albedo above 1, time offsets of a volume without a
  ///         table `time`, too many places of a volume that needs copies
  explicit VolumePlaces(const Scene& scene);

  Scene world;                             ///< the scene with a volume for each copy
  std::vector<size_t> volume;              ///< by volume of the world: its number in the scene
  std::vector<InstanceList> instances;     ///< likewise; without matrices: the volume stands at its own place
  std::vector<std::vector<size_t>> lists;  ///< likewise: of each of those places, or of a copy, the number of its list

 private:
  void add_air(const Scene& scene);
  void add_instances(const Scene& scene, size_t i);
  void add_copies(const VolumeSettings& v, size_t i, const InstanceList& places, const std::vector<size_t>& of);
  void add(const VolumeSettings& v, size_t number);
};

}  // namespace brume
