#pragma once
#include <array>
#include <optional>

#include "render/scene/scene.h"
#include "volume/ray_cone.h"

namespace brume {

/// Perspective or orthographic, with a thin lens and a straight motion over the shutter.
/// @throws InputError when its vectors do not span a frame, or the EXR it is taken from has no camera
class Camera {
 public:
  /// @param world_shift  subtracted from the position: the renderer's origin lies near the volume
  Camera(const CameraSettings& settings, int width, int height, const dvec3& world_shift = dvec3(0));

  /// The ray through the film point (x, y) in pixels, (0, 0) being the top left corner; unit direction.
  /// @param lens  uniform in [0, 1)^2   @param time  in [0, 1] of the shutter
  Ray ray(const dvec2& film, const dvec2& lens = kLensMiddle, double time = 0) const;
  /// The point of [0, 1)^2 that a ray through the middle of the lens has.
  static constexpr dvec2 kLensMiddle{0.0};
  /// The point of [0, 1)^2 whose place on the lens lies in a direction from its middle and has so much of the lens'
  /// area nearer to the middle. @param turn, share  in [0, 1)
  dvec2 lens_at(double turn, double share) const;

  /// All rays of a block of pixels, bounded in every direction; nothing for a camera that moves.
  /// @param end  exclusive
  std::optional<RayCone> ray_cone(const ivec2& begin, const ivec2& end) const;

  /// Where a ray through the point p goes as the shutter opens, through the middle of the lens; unit.
  dvec3 view_direction(const dvec3& p) const {
    return orthographic_ ? open_.forward : glm::normalize(p - (open_.position - world_shift_));
  }

  /// Distance of a point along the camera's axis. @param time  in [0, 1] of the shutter
  double depth(const dvec3& p, double time) const {
    const Pose pose = at(time);
    return glm::dot(p - (pose.position - world_shift_), pose.forward);
  }
  /// The film point [px] at which a point is seen through the middle of the lens; nothing for one that is not ahead.
  /// @param time  in [0, 1] of the shutter
  std::optional<dvec2> film_of(const dvec3& p, double time) const;
  /// The same of what is infinitely far away in a direction; nothing for an orthographic camera.
  std::optional<dvec2> film_of_direction(const dvec3& d, double time) const;
  /// In world coordinates. @param time  in [0, 1] of the shutter
  dvec3 position(double time) const { return at(time).position; }

  ivec2 film_size() const { return {width_, height_}; }
  bool moves() const { return moves_; }
  bool has_lens() const { return lens_radius_ > 0; }

  /// In Imath's convention (row vectors), for the EXR header: camera space looks along -z, y up; NDC spans -1 .. 1. As
  /// the shutter opens.
  std::array<float, 16> world_to_camera() const;
  std::array<float, 16> world_to_ndc() const;

 private:
  struct Pose {
    dvec3 position{0}, right{0}, up{0}, forward{0};
  };
  static Pose pose(const dvec3& position, const dvec3& look_at, const dvec3& up);
  Pose at(double time) const;
  dvec2 film_point(const dvec2& film) const;  // coordinates along right and up
  dvec2 film_of_point(const dvec2& point) const;
  dvec2 lens_point(const dvec2& u) const;

  Pose open_;
  dvec3 look_at_, up_, position_end_, look_at_end_, up_end_, world_shift_;
  bool moves_ = false, orthographic_ = false;
  dvec2 half_;      // half extents of the film plane: at distance 1, or in scene units
  dvec2 shift_{0};  // of the point ahead from the middle of the picture, in half extents
  double lens_radius_ = 0, focus_distance_ = 0;
  int blades_ = 0;
  double blade_rotation_ = 0;
  int width_, height_;
};

}  // namespace brume
