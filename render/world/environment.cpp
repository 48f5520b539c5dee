#include "render/world/environment.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "image/cube_map.h"
#include "image/picture_io.h"
#include "image/usable_colors.h"
#include "render/world/sky.h"

namespace brume {
namespace {

Layers in_space(Layers sky, const WorkingSpace& space) {
  if (space.from_rec709) convert_colors(sky, *space.from_rec709, [](const std::string&) { return true; });
  return sky;
}

}  // namespace

Environment::Environment(const EnvironmentSettings& s, const WorkingSpace& space, const Task& task)
    : InfiniteLight(s.visible_to_camera), radiance_(s.radiance), mean_(s.radiance) {
  if (s.sky == "preetham") {
    set_picture(in_space(preetham_sky(s), space), s);
    return;
  }
  if (s.file.empty()) return;
  const std::string name = s.file.string();
  UsablePicture read = read_usable_picture(s.file, space, task);
  notes_ = std::move(read.notes);
  Layers picture = std::move(read.layers);
  if (is_cube_map(picture)) {
    picture = lat_long_of_cube(picture, name, task);
    notes_.push_back(
        fmt::format("{}: is a cube map: taken as the lat-long picture of {} x {} whose middle is its +Z face", name,
                    picture.width(), picture.height()));
  }
  if (picture.width() != 2 * picture.height())
    notes_.push_back(fmt::format("{}: is {} x {}; a lat-long picture is twice as wide as high", name, picture.width(),
                                 picture.height()));
  set_picture(picture, s);
}

Environment::Environment(const EnvironmentSettings& s, Layers sky, const WorkingSpace& space)
    : InfiniteLight(s.visible_to_camera), radiance_(s.radiance), mean_(s.radiance) {
  set_picture(in_space(std::move(sky), space), s);
}

void Environment::set_picture(const Layers& picture, const EnvironmentSettings& s) {
  width_ = picture.width();
  height_ = picture.height();
  const std::string name = s.file.string();
  const auto rgb = picture.rgb(layer::beauty);
  picture_.resize(static_cast<size_t>(width_) * height_);
  for (int y = 0; y < height_; ++y)
    for (int x = 0; x < width_; ++x) {
      vec3& texel = picture_[static_cast<size_t>(y) * width_ + x];
      for (int c = 0; c < 3; ++c) {
        const double v = (*rgb[static_cast<size_t>(c)])(x, y) * s.radiance[c];
        texel[c] = static_cast<float>(std::min(v, static_cast<double>(std::numeric_limits<float>::max())));
      }
    }

  if (!(glm::length(s.up) > 0)) throw InputError("[environment] up is zero; expected a direction");
  const dvec3 up = glm::normalize(s.up);
  // The picture's middle faces +y where up is z, and -z where up is y, as tools with those axes expect.
  const dvec3 reference = std::abs(up.z) > 0.5 ? dvec3(0, 1, 0) : dvec3(0, 0, -1);
  const dvec3 right = glm::normalize(glm::cross(reference, up)), forward = glm::cross(up, right);
  picture_from_world_ = glm::transpose(dmat3(right, forward, up));
  rotation_ = s.sky == "none" ? s.rotation / 360.0 : 0.0;  // a sky is where its sun is

  // Texels weighted by the largest neighbour, because the look-up is bilinear and sampling should not miss its slopes.
  cdf_.resize(picture_.size());
  row_cdf_.resize(static_cast<size_t>(height_));
  double total = 0;
  mean_ = dvec3(0);
  double solid_angle = 0;
  for (int y = 0; y < height_; ++y) {
    const double band = std::cos(kPi * y / height_) - std::cos(kPi * (y + 1) / height_);
    double row = 0;
    for (int x = 0; x < width_; ++x) {
      double weight = 0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const int ny = std::clamp(y + dy, 0, height_ - 1), nx = (x + dx + width_) % width_;
          weight = std::max(weight, static_cast<double>(luminance(picture_[static_cast<size_t>(ny) * width_ + nx])));
        }
      row += weight;
      cdf_[static_cast<size_t>(y) * width_ + x] = row;
      mean_ += dvec3(picture_[static_cast<size_t>(y) * width_ + x]) * band;
      solid_angle += band;
    }
    for (int x = 0; x < width_; ++x) {
      double& value = cdf_[static_cast<size_t>(y) * width_ + x];
      value = row > 0 ? value / row : (x + 1.0) / width_;
    }
    total += row * band;
    row_cdf_[static_cast<size_t>(y)] = total;
  }
  mean_ /= solid_angle;
  const vec3* brightest = &*std::max_element(picture_.begin(), picture_.end(),
                                             [](const vec3& a, const vec3& b) { return luminance(a) < luminance(b); });
  const auto row_of = static_cast<int>((brightest - picture_.data()) / width_);
  const double band_of = std::cos(kPi * row_of / height_) - std::cos(kPi * (row_of + 1) / height_);
  const double share = luminance(dvec3(*brightest)) * band_of / (solid_angle * luminance(mean_));
  if (share > 0.5 && width_ * height_ > 64)
    notes_.push_back(fmt::format("{}: one texel holds {:.0f} % of the light; a [[lights]] sun in its place is exact",
                                 name, 100 * share));
  for (double& value : row_cdf_) value = total > 0 ? value / total : 1.0;
  if (!(total > 0)) {
    picture_.clear();  // a black picture lights nothing
    radiance_ = mean_ = dvec3(0);
  }
}

dvec2 Environment::to_picture(const dvec3& d) const {
  const dvec3 p = picture_from_world_ * d;
  double u = 0.5 + std::atan2(p.x, p.y) / (2.0 * kPi) + rotation_;
  u -= std::floor(u);
  return {std::min(u, 1.0 - 1e-16), std::acos(std::clamp(p.z, -1.0, 1.0)) / kPi};
}

dvec3 Environment::from_picture(const dvec2& uv) const {
  double u = uv.x - 0.5 - rotation_;
  u -= std::floor(u);
  const SinCos theta = portable_sincos_2pi(0.5 * uv.y), phi = portable_sincos_2pi(u);
  return glm::transpose(picture_from_world_) * dvec3(theta.sin * phi.sin, theta.sin * phi.cos, theta.cos);
}

dvec3 Environment::radiance(const dvec3& d) const {
  if (picture_.empty()) return radiance_;
  const dvec2 uv = to_picture(d);
  const double x = uv.x * width_ - 0.5, y = std::clamp(uv.y * height_ - 0.5, 0.0, height_ - 1.0);
  const double fx = x - std::floor(x), fy = y - std::floor(y);
  const int x0 = (static_cast<int>(std::floor(x)) + width_) % width_, x1 = (x0 + 1) % width_;
  const int y0 = static_cast<int>(y), y1 = std::min(y0 + 1, height_ - 1);
  const auto texel = [&](int tx, int ty) { return dvec3(picture_[static_cast<size_t>(ty) * width_ + tx]); };
  return (texel(x0, y0) * (1 - fx) + texel(x1, y0) * fx) * (1 - fy) +
         (texel(x0, y1) * (1 - fx) + texel(x1, y1) * fx) * fy;
}

double Environment::pdf(const dvec3& d) const {
  if (picture_.empty()) return 1.0 / (4.0 * kPi);
  const dvec2 uv = to_picture(d);
  const int x = std::min(static_cast<int>(uv.x * width_), width_ - 1),
            y = std::min(static_cast<int>(uv.y * height_), height_ - 1);
  const double* row = &cdf_[static_cast<size_t>(y) * width_];
  const double p_row = row_cdf_[static_cast<size_t>(y)] - (y > 0 ? row_cdf_[static_cast<size_t>(y) - 1] : 0.0);
  const double p_texel = row[x] - (x > 0 ? row[x - 1] : 0.0);
  const double band = std::cos(kPi * y / height_) - std::cos(kPi * (y + 1) / height_);
  return p_row * p_texel * width_ / (2.0 * kPi * band);
}

LightSample Environment::sample(const dvec2& u) const {
  if (picture_.empty()) {
    const double z = 1.0 - 2.0 * u.x, r = std::sqrt(std::max(0.0, (1.0 - z) * (1.0 + z)));
    const SinCos phi = portable_sincos_2pi(u.y);
    return {{r * phi.cos, r * phi.sin, z}, radiance_, 1.0 / (4.0 * kPi), kUnbounded, false};
  }
  const auto pick = [](const double* begin, int count, double xi, double& within) {
    const int i = std::min(static_cast<int>(std::upper_bound(begin, begin + count, xi) - begin), count - 1);
    const double before = i > 0 ? begin[i - 1] : 0.0;
    within = std::clamp((xi - before) / (begin[i] - before), 0.0, 1.0 - 1e-12);
    return i;
  };
  double fy, fx;
  const int y = pick(row_cdf_.data(), height_, u.y, fy);
  const int x = pick(&cdf_[static_cast<size_t>(y) * width_], width_, u.x, fx);
  // Uniform in solid angle within the texel: cos theta is linear.
  const double top = std::cos(kPi * y / height_), bottom = std::cos(kPi * (y + 1) / height_);
  const double v = std::acos(std::clamp(top + fy * (bottom - top), -1.0, 1.0)) / kPi;
  const dvec3 d = glm::normalize(from_picture({(x + fx) / width_, v}));
  return {d, radiance(d), pdf(d), kUnbounded, false};
}

}  // namespace brume
