#include "render/world/camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "base/math.h"
#include "image/exr_io.h"

namespace brume {
namespace {

/// What an EXR's header says about its camera beyond position and view.
struct Projection {
  bool orthographic = false;
  dvec2 half{0}, shift{0};
};

/// The camera of an EXR's header. @throws InputError
CameraMatrices read_matrices(const std::filesystem::path& path) {
  const ExrInfo info = read_exr_info(path);
  CameraMatrices matrices{path.string(), info.width, info.height, {}, {}};
  for (const auto& [key, target] :
       {std::pair("worldToCamera", &matrices.world_to_camera), {"worldToNDC", &matrices.world_to_ndc}}) {
    const auto it = info.header.find(key);
    const auto* m = it == info.header.end() ? nullptr : std::get_if<std::array<float, 16>>(&it->second);
    if (!m)
      throw InputError(
          fmt::format("{}: its header has no matrix {}; expected worldToCamera and worldToNDC", matrices.name, key));
    *target = *m;
  }
  return matrices;
}

/// Position, view and projection from the two matrices of an EXR's header (row vectors; the camera looks along -z, or
/// along +z as RenderMan's do). @param width, height  of the film
Projection adopt_matrices(CameraSettings& s, const CameraMatrices& matrices, int width, int height) {
  const std::string& name = matrices.name;
  // Of what the scene's camera looks at: where it focuses and how it turns may depend on it.
  const double distance = glm::distance(s.position, s.look_at);
  const double aspect = static_cast<double>(matrices.width) / matrices.height,
               film_aspect = static_cast<double>(width) / height;
  if (std::abs(film_aspect / aspect - 1) > 0.02)
    throw InputError(fmt::format("{}: is a picture of {} x {}, the film has {} x {}; expected a film of the same shape",
                                 name, matrices.width, matrices.height, width, height));
  const std::array<float, 16>&c = matrices.world_to_camera, &n = matrices.world_to_ndc;
  for (const auto& [key, matrix] : {std::pair("worldToCamera", &c), {"worldToNDC", &n}})
    if (!std::all_of(matrix->begin(), matrix->end(), [](float v) { return std::isfinite(v); }))
      throw InputError(fmt::format("{}: {} holds numbers that are not finite", name, key));
  // camera = world * M: the columns of the upper 3 x 3 are the camera's axes, the last row its shift.
  dvec3 axes[3];
  for (int column = 0; column < 3; ++column)
    for (int row = 0; row < 3; ++row) axes[column][row] = c[static_cast<size_t>(row * 4 + column)];
  const dvec3 shift(c[12], c[13], c[14]);
  const double scale = glm::length(axes[2]);
  if (!(scale > 0)) throw InputError(fmt::format("{}: worldToCamera is singular", name));
  const dmat3 world_from_camera = glm::inverse(glm::transpose(dmat3(axes[0], axes[1], axes[2])));
  const auto clip = [&](const dvec3& p) {
    glm::dvec4 h(0);
    for (int k = 0; k < 4; ++k) {
      const auto at = [&](size_t row) { return static_cast<double>(n[row * 4 + static_cast<size_t>(k)]); };
      h[k] = p.x * at(0) + p.y * at(1) + p.z * at(2) + at(3);
    }
    return h;
  };
  // A perspective camera's clip w grows with the distance ahead, an orthographic one's is the same everywhere.
  s.position = -(world_from_camera * shift);
  const dvec3 z = axes[2] / scale;
  const double before = clip(s.position - z).w, behind = clip(s.position + z).w;
  Projection projection;
  projection.orthographic = std::abs(before - behind) < 1e-6 * (std::abs(before) + std::abs(behind));
  const bool mirrored = glm::determinant(dmat3(axes[0], axes[1], axes[2])) < 0;
  const dvec3 forward = (projection.orthographic ? mirrored : behind > before) ? z : -z;
  s.look_at = s.position + forward;
  s.up = axes[1];
  const dvec3 right = glm::normalize(glm::cross(forward, s.up)), up = glm::cross(right, forward);
  const auto project = [&](const dvec3& p) {
    const glm::dvec4 h = clip(p);
    return dvec2(h) / h.w;
  };
  projection.shift = project(s.look_at);
  const dvec2 to_right = project(s.look_at + right) - projection.shift,
              to_up = project(s.look_at + up) - projection.shift;
  projection.half = {1.0 / to_right.x, 1.0 / to_up.y};
  if (!(projection.half.x > 0) || !(projection.half.y > 0) || !std::isfinite(projection.half.x) ||
      !std::isfinite(projection.half.y) || !(glm::length(projection.shift) < 1e3))
    throw InputError(
        fmt::format("{}: worldToNDC is neither a perspective nor a parallel projection of that camera", name));
  if (distance > 0) s.look_at = s.position + distance * forward;
  return projection;
}

dvec3 three(const std::vector<double>& v, const dvec3& otherwise) {
  return v.empty() ? otherwise : dvec3(v[0], v[1], v[2]);
}

}  // namespace

Camera::Camera(const CameraSettings& settings, int width, int height, const dvec3& world_shift)
    : world_shift_(world_shift), width_(width), height_(height) {
  CameraSettings s = settings;
  const double aspect = s.pixel_aspect * width / height;
  const bool along_x = s.fov_axis == "x" || (s.fov_axis == "shorter" && aspect <= 1);
  orthographic_ = s.type == "orthographic";
  const double extent = orthographic_ ? 0.5 * s.width : std::tan(0.5 * s.fov * kPi / 180.0);
  half_ = along_x ? dvec2(extent, extent / aspect) : dvec2(extent * aspect, extent);
  shift_ = -2.0 * s.shift;
  if (s.matrices || !s.from_exr.empty()) {
    const CameraMatrices matrices = s.matrices ? *s.matrices : read_matrices(s.from_exr);
    const Projection projection = adopt_matrices(s, matrices, width, height);
    orthographic_ = projection.orthographic;
    half_ = projection.half;
    shift_ = projection.shift;
  }
  look_at_ = s.look_at;
  up_ = s.up;
  open_ = pose(s.position, s.look_at, s.up);
  moves_ = s.shutter.y > s.shutter.x && (!s.position_end.empty() || !s.look_at_end.empty() || !s.up_end.empty());
  position_end_ = three(s.position_end, s.position);
  look_at_end_ = three(s.look_at_end, s.look_at);
  up_end_ = three(s.up_end, s.up);
  if (moves_) pose(position_end_, look_at_end_, up_end_);
  lens_radius_ = s.lens_radius;
  focus_distance_ = s.focus_distance > 0 ? s.focus_distance : glm::distance(s.position, s.look_at);
  blades_ = s.blades;
  blade_rotation_ = s.blade_rotation / 360.0;
}

Camera::Pose Camera::pose(const dvec3& position, const dvec3& look_at, const dvec3& up) {
  const dvec3 view = look_at - position;
  if (!(glm::length(view) > 0))
    throw InputError("camera: position and look_at are the same point; expected a direction to look in");
  Pose p;
  p.position = position;
  p.forward = glm::normalize(view);
  const dvec3 side = glm::cross(p.forward, up);
  if (!(glm::length(side) > 1e-9 * glm::length(up)))
    throw InputError("camera: up is zero or parallel to the view; expected another direction");
  p.right = glm::normalize(side);
  p.up = glm::cross(p.right, p.forward);
  return p;
}

Camera::Pose Camera::at(double time) const {
  if (!moves_ || time == 0) return open_;
  return pose(glm::mix(open_.position, position_end_, time), glm::mix(look_at_, look_at_end_, time),
              glm::mix(up_, up_end_, time));
}

dvec2 Camera::lens_at(double turn, double share) const {
  if (blades_ == 0) return {share, turn};
  const double sector = std::floor(turn * blades_);
  return {(sector + share) / blades_, turn * blades_ - sector};
}

dvec2 Camera::lens_point(const dvec2& u) const {
  if (blades_ == 0) {
    const double r = std::sqrt(u.x);
    const SinCos phi = portable_sincos_2pi(u.y);
    return {r * phi.cos, r * phi.sin};
  }
  // One triangle of the polygon, then a point in it.
  const double sector = std::floor(u.x * blades_), within = u.x * blades_ - sector, root = std::sqrt(within);
  const auto corner = [&](double k) {
    double turn = k / blades_ + blade_rotation_;
    turn -= std::floor(turn);
    const SinCos phi = portable_sincos_2pi(turn);
    return dvec2(phi.cos, phi.sin);
  };
  return root * ((1.0 - u.y) * corner(sector) + u.y * corner(sector + 1));
}

dvec2 Camera::film_point(const dvec2& film) const {
  return {(2.0 * film.x / width_ - 1.0 - shift_.x) * half_.x, (1.0 - 2.0 * film.y / height_ - shift_.y) * half_.y};
}

dvec2 Camera::film_of_point(const dvec2& point) const {
  return {0.5 * width_ * (point.x / half_.x + 1 + shift_.x), 0.5 * height_ * (1 - shift_.y - point.y / half_.y)};
}

std::optional<dvec2> Camera::film_of(const dvec3& p, double time) const {
  const Pose pose = at(time);
  const dvec3 from = p - (pose.position - world_shift_);
  const double ahead = orthographic_ ? 1 : glm::dot(from, pose.forward);
  if (!(ahead > 0)) return std::nullopt;
  return film_of_point(dvec2(glm::dot(from, pose.right), glm::dot(from, pose.up)) / ahead);
}

std::optional<dvec2> Camera::film_of_direction(const dvec3& d, double time) const {
  const Pose pose = at(time);
  const double ahead = glm::dot(d, pose.forward);
  if (orthographic_ || !(ahead > 0)) return std::nullopt;
  return film_of_point(dvec2(glm::dot(d, pose.right), glm::dot(d, pose.up)) / ahead);
}

Ray Camera::ray(const dvec2& film, const dvec2& lens, double time) const {
  const dvec2 point = film_point(film);
  const double x = point.x, y = point.y;
  const Pose p = at(time);
  const dvec3 eye = p.position - world_shift_;
  if (lens_radius_ == 0) {
    if (orthographic_) return {eye + x * p.right + y * p.up, p.forward};
    return {eye, glm::normalize(p.forward + x * p.right + y * p.up)};
  }
  const dvec2 l = lens_radius_ * lens_point(lens);
  const dvec3 offset = l.x * p.right + l.y * p.up;
  if (orthographic_) {
    const dvec3 start = eye + x * p.right + y * p.up;
    return {start + offset, glm::normalize(focus_distance_ * p.forward - offset)};
  }
  return {eye + offset, glm::normalize(focus_distance_ * (p.forward + x * p.right + y * p.up) - offset)};
}

// Directions point from the eye to a plane in front of it: those that differ from the middle one by at most an angle
// meet it in a convex region, which holds all of a polygon if it holds its corners. The lens lies within a square.
std::optional<RayCone> Camera::ray_cone(const ivec2& begin, const ivec2& end) const {
  if (moves_) return {};
  const double distance = lens_radius_ > 0 ? focus_distance_ : 1.0;
  const auto towards = [&](const dvec2& film, const dvec2& lens) {
    const dvec2 point = film_point(film);
    const dvec3 aim = orthographic_ ? open_.forward : open_.forward + point.x * open_.right + point.y * open_.up;
    return glm::normalize(distance * aim - lens_radius_ * (lens.x * open_.right + lens.y * open_.up));
  };
  const dvec2 centre = 0.5 * dvec2(begin + end), point = film_point(centre);
  RayCone cone{{open_.position - world_shift_, towards(centre, dvec2(0))}, lens_radius_, 0};
  if (orthographic_) {
    cone.middle.o += point.x * open_.right + point.y * open_.up;
    cone.apart += glm::distance(film_point(begin), point);
  }
  for (int corner = 0; corner < 4; ++corner)
    for (int side = 0; side < (lens_radius_ > 0 ? 4 : 1); ++side) {
      const dvec2 film(corner & 1 ? end.x : begin.x, corner & 2 ? end.y : begin.y);
      const dvec2 lens(side & 1 ? 1 : -1, side & 2 ? 1 : -1);
      cone.apart_per_t = std::max(cone.apart_per_t, glm::distance(towards(film, lens), cone.middle.d));
    }
  return cone;
}

std::array<float, 16> Camera::world_to_camera() const {
  std::array<float, 16> m{};
  const dvec3 axes[3] = {open_.right, open_.up, -open_.forward};
  for (size_t column = 0; column < 3; ++column) {
    for (size_t row = 0; row < 3; ++row) m[row * 4 + column] = static_cast<float>(axes[column][static_cast<int>(row)]);
    m[12 + column] = static_cast<float>(-glm::dot(axes[column], open_.position));
  }
  m[15] = 1;
  return m;
}

std::array<float, 16> Camera::world_to_ndc() const {
  // x_ndc = x / (-z half.x) + shift.x: columns of the camera matrix, with the homogeneous coordinate taken from -z; an
  // orthographic picture keeps its last column.
  const std::array<float, 16> c = world_to_camera();
  std::array<float, 16> m{};
  for (size_t row = 0; row < 4; ++row) {
    const float w = orthographic_ ? c[row * 4 + 3] : -c[row * 4 + 2];
    m[row * 4 + 0] = static_cast<float>(c[row * 4 + 0] / half_.x + shift_.x * w);
    m[row * 4 + 1] = static_cast<float>(c[row * 4 + 1] / half_.y + shift_.y * w);
    m[row * 4 + 2] = -c[row * 4 + 2];
    m[row * 4 + 3] = w;
  }
  return m;
}

}  // namespace brume
