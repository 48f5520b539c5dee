#include "render/camera.h"

#include <cmath>

#include "base/error.h"
#include "base/math.h"

namespace brume {

Camera::Camera(const CameraSettings& s, int width, int height, const dvec3& world_shift)
    : position_(s.position - world_shift), world_position_(s.position), width_(width), height_(height) {
  const dvec3 view = s.look_at - s.position;
  if (!(glm::length(view) > 0))
    throw InputError("camera: position and look_at are the same point; expected a direction to look in");
  forward_ = glm::normalize(view);
  const dvec3 side = glm::cross(forward_, s.up);
  if (!(glm::length(side) > 1e-9 * glm::length(s.up)))
    throw InputError("camera: up is zero or parallel to the view; expected another direction");
  right_ = glm::normalize(side);
  up_ = glm::cross(right_, forward_);
  const double extent = std::tan(0.5 * s.fov * kPi / 180.0);
  const bool along_x = s.fov_axis == "x" || (s.fov_axis == "shorter" && width <= height);
  const double aspect = static_cast<double>(width) / height;
  half_ = along_x ? dvec2(extent, extent / aspect) : dvec2(extent * aspect, extent);
}

Ray Camera::ray(const dvec2& film) const {
  const double x = (2.0 * film.x / width_ - 1.0) * half_.x, y = (1.0 - 2.0 * film.y / height_) * half_.y;
  return {position_, glm::normalize(forward_ + x * right_ + y * up_)};
}

std::array<float, 16> Camera::world_to_camera() const {
  std::array<float, 16> m{};
  const dvec3 axes[3] = {right_, up_, -forward_};
  for (size_t column = 0; column < 3; ++column) {
    for (size_t row = 0; row < 3; ++row) m[row * 4 + column] = static_cast<float>(axes[column][static_cast<int>(row)]);
    m[12 + column] = static_cast<float>(-glm::dot(axes[column], world_position_));
  }
  m[15] = 1;
  return m;
}

std::array<float, 16> Camera::world_to_ndc() const {
  // x_ndc = x / (-z half.x): columns of the camera matrix, with the homogeneous coordinate taken from -z.
  const std::array<float, 16> c = world_to_camera();
  std::array<float, 16> m{};
  for (size_t row = 0; row < 4; ++row) {
    m[row * 4 + 0] = static_cast<float>(c[row * 4 + 0] / half_.x);
    m[row * 4 + 1] = static_cast<float>(c[row * 4 + 1] / half_.y);
    m[row * 4 + 2] = -c[row * 4 + 2];
    m[row * 4 + 3] = -c[row * 4 + 2];
  }
  return m;
}

}  // namespace brume
