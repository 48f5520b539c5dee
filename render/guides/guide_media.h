#pragma once
#include <array>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "base/progress.h"
#include "volume/emission.h"
#include "volume/medium.h"

namespace brume {

/// Which colour channel guides are computed for: 0, 1, 2, or the mean of all three.
using GuideColour = int;
inline constexpr GuideColour kGrey = -1;
/// Farther than anything [world units].
inline constexpr double kFar = 1e30;
double in_colour(const dvec3& rgb, GuideColour colour);

/// The media and emitting fields of a scene as guides see them, at one time of the shutter: extinction, albedo and
/// density at any world point, the extinctions of several media being added.
class GuideMedia {
 public:
  GuideMedia(std::span<const Medium> media, std::span<const EmissionField> emissions, double time,
             const Task& task = {});

  bool empty() const { return media_.empty() && emissions_.empty(); }
  /// Whether one colour's guides differ from another's by more than the albedo's tint.
  bool coloured() const { return coloured_; }
  /// Whether that tint changes from place to place.
  bool mixed_tints() const { return mixed_tints_; }
  /// How much more than the mean a medium's albedo gives each colour by one scattering.
  const dvec3& tint(size_t medium) const { return constants_[medium].tint; }
  /// Box around everything, world space.
  const dvec3& lo() const { return lo_; }
  const dvec3& hi() const { return hi_; }
  /// Of the finest grid [world units].
  double voxel() const { return voxel_; }
  /// As solvers look them up: without detail.
  const std::vector<Medium>& media() const { return media_; }
  /// One of them as rays of the camera see it.
  const Medium& detailed(size_t medium) const {
    return displaced_[medium].detail() ? displaced_[medium] : media_[medium];
  }
  /// Width of a bump and a hollow of the finest detail, as a share of voxel(); 1 where nothing is finer than that.
  double grain() const;
  /// Whether any medium is a holdout: it hides what is behind it and is not seen itself.
  bool holdouts() const { return holdouts_; }
  /// Whether some stand at many places.
  bool instances() const { return instances_; }
  const std::vector<EmissionField>& emissions() const { return emissions_; }
  /// Mean cosine of a medium's phase function.
  double mean_cosine(size_t medium) const { return mean_cosine_[medium]; }

  /// What does not change from point to point of a medium.
  struct Constants {
    std::array<double, 4> per_density{}, albedo{};  ///< by colour, kGrey first
    double inverse_maximum = 0;
    dvec3 tint{1};
  };
  const Constants& constants(size_t medium) const { return constants_[medium]; }

  /// What scatters at a point.
  struct Point {
    double sigma_t = 0;      ///< [1 / world unit]
    double albedo = 0;       ///< single-scattering albedo
    double g = 0;            ///< mean cosine
    double density = 0;      ///< as a share of the medium's maximum, the largest of them
    dvec3 tint{1};           ///< of the light scattered here; only in grey
    double seen = 1;         ///< share of sigma_t that is of no holdout
    double seen_albedo = 0;  ///< albedo of that share; only where there are holdouts
  };
  Point at(const dvec3& world, GuideColour colour) const;
  /// Scattering coefficient of one medium [1 / world unit].
  double scattering(size_t medium, const dvec3& world, GuideColour colour) const;
  /// Emission coefficient [radiance / world unit].
  dvec3 emission(const dvec3& world) const;

  /// Where what scatters at a world point is at another time of the shutter: that of `other`, of the same scene.
  dvec3 followed(const dvec3& world, const GuideMedia& other) const;
  /// The same of one of the media, wherever it is.
  dvec3 moved(size_t medium, const dvec3& world, const GuideMedia& other) const {
    return other.displaced_[medium].to_world(displaced_[medium].to_local(world));
  }

  /// How far all media have moved since another time of the shutter, where they have only moved, and all alike.
  std::optional<dvec3> moved_since(const GuideMedia& other) const;

  /// The parts of a world ray in which anything may be found, in order and apart from one another.
  /// @param uneven  only those in which anything changes from voxel to voxel; elsewhere media are homogeneous
  void intervals(const Ray& ray, double t_max, std::vector<std::pair<double, double>>& parts,
                 bool uneven = false) const;

 private:
  friend class MediaLine;
  Medium resampled(const Medium& medium, double time, const Task& task);

  std::vector<std::shared_ptr<BrickGrid>> resampled_;  // of those that are displaced
  std::vector<Medium> media_, displaced_;              // as they are looked up, and before they were resampled
  std::vector<EmissionField> emissions_;
  std::vector<Constants> constants_;
  std::vector<double> mean_cosine_;
  bool coloured_ = false, mixed_tints_ = false, instances_ = false, holdouts_ = false;
  dvec3 lo_{0}, hi_{0};
  double voxel_ = 0;
};

}  // namespace brume
