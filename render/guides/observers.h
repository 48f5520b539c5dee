#pragma once
#include <utility>
#include <vector>

#include "base/progress.h"
#include "render/guides/ambient_light.h"
#include "render/guides/surface_points.h"

namespace brume {

/// Observers on surfaces or in media, and what each of them sees along its rays, which is found once, whatever lights
/// it. All have rays in the same directions of their frames.
class Observers {
 public:
  static constexpr int kSky = -1, kBlack = -2;  ///< instead of points

  /// What an observer sees along one of its rays.
  struct Seen {
    float distance = 0, transmittance = 1;  ///< of the media, but for the forward peak
    int point = kBlack;                     ///< of the surface points
  };
  /// What metals show in a ray.
  struct Mirrored {
    size_t ray;
    std::vector<std::pair<Ray, SurfaceHit>> metals = {};  ///< one behind the other
    dvec3 own{0};                                         ///< what they send of lights that shine on them
    std::vector<dvec3> own_of_groups = {};
    dvec3 share{1};      ///< of what is seen in them
    int point = kBlack;  ///< that is
  };
  struct Observer {
    dvec3 p;
    Frame frame;
    std::vector<Mirrored> mirrored = {};
    bool outside = true;  ///< of solids
  };

  /// Rays over the hemispheres of surfaces, spread by the cosine.
  static Observers at_surfaces();
  /// Rays over whole spheres, spread evenly.
  static Observers in_media();

  /// @param turns  of a golden angle around the frame's z, so that observers side by side do not look alike
  void add(const dvec3& p, const Frame& frame, size_t turns);
  /// Finds what all of them see.
  void look(const Surfaces& surfaces, const SurfacePoints& points, const AmbientLight& nodes, const Task& task);

  std::vector<Observer>& all() { return all_; }
  const std::vector<Observer>& all() const { return all_; }
  /// Along all rays, of one observer after the other.
  const std::vector<Seen>& seen() const { return seen_; }
  const Seen* seen_by(size_t i) const { return seen_.data() + i * directions_.size(); }
  size_t rays() const { return directions_.size(); }
  dvec3 direction(size_t i, size_t ray) const { return all_[i].frame.to_world(directions_[ray]); }
  bool see_hemispheres() const { return hemispheres_; }
  /// Rays per solid angle. @param cosine  to the normal
  double density(double cosine) const {
    return static_cast<double>(rays()) * (hemispheres_ ? cosine / kPi : 1 / (4 * kPi));
  }
  double density_of_ray(size_t ray) const { return density(directions_[ray].z); }

  /// Calls visit(point, share of its light that arrives, ray) for all points that an observer sees.
  template <class Visit>
  void each_point(size_t i, const Visit& visit) const {
    const Seen* const seen = seen_by(i);
    for (size_t k = 0; k < rays(); ++k)
      if (seen[k].point >= 0) visit(static_cast<size_t>(seen[k].point), dvec3(seen[k].transmittance), k);
    for (const Mirrored& m : all_[i].mirrored)
      if (m.point >= 0)
        visit(static_cast<size_t>(m.point), static_cast<double>(seen[m.ray].transmittance) * m.share, m.ray);
  }

 private:
  Observers(bool hemispheres, std::vector<dvec3> directions)
      : hemispheres_(hemispheres), directions_(std::move(directions)) {}

  bool hemispheres_;
  std::vector<dvec3> directions_;  // in the frames of observers
  std::vector<Observer> all_;
  std::vector<Seen> seen_;
};

}  // namespace brume
