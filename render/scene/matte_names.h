#pragma once
#include <string>
#include <vector>

#include "render/scene/scene.h"

namespace brume {

/// What the things of a scene are called in mattes: as the scene says, else by their files, without the number of a
/// frame, or by what they are; with a number behind it where another thing has that name.
struct MatteNames {
  explicit MatteNames(const Scene& scene);

  std::vector<std::string> volumes, instances, surfaces;  ///< by their numbers; of [[instances]] the volume's or own
  std::vector<std::string> volume_materials, surface_materials;
};

}  // namespace brume
