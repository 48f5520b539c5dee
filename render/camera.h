#pragma once
#include <array>

#include "render/scene.h"

namespace brume {

/// A pinhole camera. @throws InputError when its vectors do not span a frame
class Camera {
 public:
  /// @param world_shift  subtracted from the position: the renderer's origin lies near the volume
  Camera(const CameraSettings& settings, int width, int height, const dvec3& world_shift = dvec3(0));

  /// The ray through the film point (x, y) in pixels, (0, 0) being the top left corner; unit direction.
  Ray ray(const dvec2& film) const;

  /// In Imath's convention (row vectors), for the EXR header: camera space looks along -z, y up; NDC spans -1 .. 1.
  std::array<float, 16> world_to_camera() const;
  std::array<float, 16> world_to_ndc() const;

 private:
  dvec3 position_, world_position_, right_, up_, forward_;
  dvec2 half_;  // half extents of the film plane at distance 1
  int width_, height_;
};

}  // namespace brume
