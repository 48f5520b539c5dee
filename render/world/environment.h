#pragma once
#include <string>
#include <vector>

#include "image/color_space.h"
#include "image/layers.h"
#include "render/world/light.h"

namespace brume {

/// Constant radiance, or a lat-long picture sampled in proportion to luminance and solid angle; the picture may be a
/// file or an analytic sky.
class Environment : public InfiniteLight {
 public:
  Environment() : InfiniteLight(true) {}
  /// Values that are not usable are repaired and told in notes() (image/usable_colors.h).
  /// @param space  of the settings' radiance
  /// @throws InputError: unreadable file, no RGB in it, chromaticities that are none
  explicit Environment(const EnvironmentSettings& settings, const WorkingSpace& space = {}, const Task& task = {});
  /// Of a sky that is a picture already, in linear Rec. 709.
  Environment(const EnvironmentSettings& settings, Layers sky, const WorkingSpace& space);

  bool black() const { return picture_.empty() && radiance_ == dvec3(0); }
  bool constant() const { return picture_.empty(); }
  bool uniform(const RayCone&) const override { return constant(); }
  dvec3 radiance(const dvec3& d) const override;
  LightSample sample(const dvec2& u) const;
  LightSample sample(const dvec3&, const dvec2& u) const override { return sample(u); }
  double pdf(const dvec3& d) const override;
  double importance(const dvec3&) const override { return kPi * luminance(mean_); }
  size_t bytes() const { return picture_.size() * sizeof(vec3) + (row_cdf_.size() + cdf_.size()) * sizeof(double); }
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  void set_picture(const Layers& picture, const EnvironmentSettings& settings);
  dvec2 to_picture(const dvec3& d) const;  // in [0, 1)^2
  dvec3 from_picture(const dvec2& uv) const;

  dvec3 radiance_{0}, mean_{0};
  int width_ = 0, height_ = 0;
  std::vector<vec3> picture_;
  std::vector<double> row_cdf_, cdf_;  // inclusive sums, each ending in 1
  dmat3 picture_from_world_{1};
  double rotation_ = 0;
  std::vector<std::string> notes_;
};

}  // namespace brume
