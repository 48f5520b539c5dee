#pragma once
#include <array>
#include <span>
#include <utility>
#include <vector>

#include "base/progress.h"
#include "render/guides/ambient_light.h"
#include "render/guides/guide_media.h"
#include "render/guides/observers.h"
#include "render/guides/probe_grid.h"
#include "render/guides/sky_parts.h"
#include "render/guides/surface_points.h"

namespace brume {

struct LitSurfaces;

/// Light from all around at points spread over the surfaces, and what they reflect of it to one another and into the
/// media, any number of times: radiosity, by rays whose ends are found once.
///
/// Each point looks along rays over its hemisphere, each probe of a grid in the media along rays all around. What they
/// meet is a point of a surface or the sky; media on the way attenuate it and add their own light. Small bright parts
/// of surfaces, as the sun's patch in a room, are looked at along rays of their own, too; both kinds of rays are
/// weighted by the balance heuristic.
class SurfaceLight {
 public:
  /// @param nodes  whose extinction is known
  SurfaceLight(const GuideMedia& media, const Surfaces& surfaces, const AmbientLight& nodes, const Task& task);

  /// RGB that a diffuse surface of albedo 1 reflects: of the sky and of emission, unscattered; of all light that was
  /// scattered in the media; and of what other surfaces send.
  struct Around {
    dvec3 sky{0}, emitted{0}, scattered{0}, reflected{0};
  };
  /// @param of_groups  gets what of `scattered` and `reflected` together is of each light group, or nothing
  Around onto(const dvec3& p, const dvec3& normal, std::span<dvec3> of_groups = {}) const;
  /// RGB shares that light groups have of the light that surfaces send to a place in the media.
  void shares(const dvec3& world, std::span<dvec3> of_groups) const;

  /// Finds what of the sky's and the nodes' light is at the points; called again when nodes have got more of it.
  /// @param sky_group  the sky's light group, or -1
  void gather(const AmbientLight& nodes, const SkyParts& sky, int sky_group, const Task& task);
  /// Finds what surfaces reflect of all that lights them from elsewhere.
  void exchange(const LitSurfaces& lit, const AmbientLight& nodes, const Task& task);
  /// Adds what they reflect of their own light after media have scattered it, any number of times.
  /// @param nodes  that scatter nothing but what surfaces sent into the media
  void answer(const AmbientLight& nodes, const Task& task);

  /// Of the light that surfaces send into the media, of mean 1; black where there is none.
  dvec3 colour() const;
  /// Moments of that light at a place, in a colour: mean radiance, mean flux.
  std::array<double, 4> at(const dvec3& world, GuideColour colour) const;

  /// Share of the sky that surfaces leave in the media, for each of ScatteringSolver::directions.
  using SkySeen = std::array<double, 24>;
  /// On average.
  const SkySeen& sky_seen() const { return sky_seen_; }
  SkySeen sky_seen(const dvec3& world) const;
  /// Whether it differs much from place to place, as behind a window.
  bool sky_seen_unevenly() const { return sky_seen_unevenly_; }

 private:
  /// Sums of light times the direction that it comes from: of them, what a diffuse surface of albedo 1 reflects follows
  /// for the normal of their hemisphere, and well enough for normals near it.
  struct Flux {
    std::array<dvec3, 3> axis{};
    void add(const dvec3& radiance, const dvec3& direction) {
      for (int a = 0; a < 3; ++a) axis[static_cast<size_t>(a)] += direction[a] * radiance;
    }
    dvec3 onto(const dvec3& normal) const {
      return glm::max(normal.x * axis[0] + normal.y * axis[1] + normal.z * axis[2], dvec3(0));
    }
  };
  /// At a point: of the sky, unscattered and by forward peaks; what media emit; what they scatter; what surfaces send.
  struct AtPoint {
    Flux sky, sky_by_peaks, emitted, scattered, reflected;
  };
  /// At a probe: what surfaces send, its mean and its flux against where it comes from.
  struct AtProbe {
    dvec3 mean{0};
    Flux flux;
  };

  /// What points send, and what arrives of it at points and probes; of all light, and of each light group: those of
  /// one point after the other.
  struct Radiosity {
    std::vector<dvec3> all, of_groups;
  };
  struct Arriving {
    std::vector<Flux> at_points, at_points_of_groups;
    std::vector<AtProbe> at_probes;
    std::vector<dvec3> at_probes_of_groups;  ///< their means
  };
  Arriving nothing_arriving() const;

  /// Puts probes where media are, as close together as their number allows.
  void place_probes(const GuideMedia& media, const AmbientLight& nodes);
  /// Calls visit(probe, weight), of sum 1, for the probes around a place.
  template <class Visit>
  void each_probe(const dvec3& world, const Visit& visit) const;
  std::pair<dvec3, dvec3> lit_box(const GuideMedia& media);
  void find_sky_seen();
  void find_bright(const std::vector<dvec3>& radiosity);
  Radiosity black() const;
  /// Adds what surfaces of a radiosity send to the points and probes. @param bright  look at bright parts
  void send(const Radiosity& radiosity, bool bright, const AmbientLight& nodes, Arriving& to, const Task& task) const;
  /// All later reflections of light that arrives at the points.
  Radiosity later_reflections(const std::vector<Flux>& arriving, const std::vector<Flux>& of_groups,
                              const Task& task) const;

  const Surfaces& surfaces_;
  SurfacePoints points_;
  ProbeGrid grid_;
  std::vector<int> probe_;  // of at_probes_, for each of the grid's; -1 far from media
  Observers at_points_ = Observers::at_surfaces(), at_probes_ = Observers::in_media();
  std::vector<AtPoint> light_;
  std::vector<AtProbe> into_media_;
  size_t groups_;
  std::vector<Flux> scattered_of_groups_, reflected_of_groups_;  // of AtPoint's; those of one point after the other
  std::vector<dvec3> into_media_of_groups_;                      // means, of one probe after the other
  std::vector<double> looked_at_;  // rays towards each point, per area around it; 0: it is not bright
  std::vector<size_t> bright_;     // points that there are such rays towards
  SkySeen sky_seen_{};
  std::vector<SkySeen> sky_seen_at_;                     // each probe
  bool sky_seen_unevenly_ = false, far_around_ = false;  // far_around_: media reach far around all surfaces
};

}  // namespace brume
