#pragma once
#include <memory>
#include <string>
#include <vector>

#include "base/progress.h"
#include "render/scene/scene.h"
#include "volume/emission.h"
#include "volume/medium.h"

namespace brume {

/// The volumes of a scene, loaded: fields, the media that scatter, the fields that emit.
class SceneMedia {
 public:
  SceneMedia() = default;
  /// @throws InputError: what the loaders throw
  SceneMedia(const Scene& scene, const Task& task);

  /// Subtracted from all world positions, so that far from the world's origin nothing is lost.
  const dvec3& world_shift() const { return world_shift_; }
  /// Those with any extinction in them.
  const std::vector<Medium>& media() const { return media_; }
  /// What of the scene a medium is.
  struct Origin {
    size_t volume;                  ///< its number in the scene
    std::vector<size_t> instances;  ///< of each of its instances, or of itself as a copy: the number of [[instances]]
  };
  const std::vector<Origin>& origins() const { return origins_; }
  const std::vector<EmissionField>& emissions() const { return emissions_; }
  /// The volume of the scene that each of them is of.
  const std::vector<size_t>& emission_volumes() const { return emission_volumes_; }
  /// Encloses them all; what the camera looks at where there is none.
  Medium::Sphere bounds() const { return bounds_; }
  const std::vector<std::string>& notes() const { return notes_; }

  struct Part {
    std::string name;
    size_t bytes;
  };
  /// What was loaded and what it takes in memory.
  const std::vector<Part>& parts() const { return parts_; }

 private:
  struct Volume;
  class Loader;

  // Fields sit behind pointers: media refer to them.
  std::vector<std::shared_ptr<Volume>> volumes_;
  std::vector<std::shared_ptr<const Instances>> instances_;
  std::vector<std::shared_ptr<const Detail>> details_;
  std::vector<Medium> media_;
  std::vector<Origin> origins_;  // by medium
  std::vector<EmissionField> emissions_;
  std::vector<size_t> emission_volumes_;
  dvec3 world_shift_{0};
  bool shifted_ = false;
  Medium::Sphere bounds_;
  std::vector<std::string> notes_;
  std::vector<Part> parts_;
};

}  // namespace brume
