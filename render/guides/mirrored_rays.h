#pragma once
#include <deque>
#include <vector>

#include "render/guides/guide_march.h"

namespace brume {

/// What metals and glass show: rays that go on from them in fixed directions, until they meet something else. They are
/// marched as camera rays are, but that light which was scattered more often comes from a coarse table for all
/// directions. Each generation is marched together.
class MirroredRays {
 public:
  explicit MirroredRays(const GuideMarch& march);

  /// Queues the rays that show what a camera ray sees at a surface. @param transmittance  of the camera ray
  /// @param peaks  what it has more by forward peaks   @param pixel  gathers what they see
  void start(const CameraSample& camera, const ShadedPoint& at, const SurfaceHit& hit, double transmittance,
             double peaks, GuideSums& pixel);
  /// Follows all that are queued, and those that they become. @param scene  at their time
  void follow(const MarchScene& scene);

 private:
  /// Which lights a ray shows: those with guides of their own are told apart where a surface before has their
  /// highlights, or where small ones are looked for by more rays.
  enum class Shown { kNone, kUngrouped, kAll };
  struct Path {
    GuideSums* pixel;
    double transmittance, peaks;  ///< of the camera ray
    dvec3 throughput{1};          ///< of surfaces and media behind it
    double largest = 1;           ///< of the surfaces' throughput, the largest colour's
    double spread = 0;            ///< of the directions that it stands for [rad]
    int bounces = 0, faces = 0;
    bool again = false;  ///< it went on from a surface that was seen in another one: all it sees is indirect light
    Shown shown = Shown::kAll;
    bool only_lights = false;  ///< the media are not marched
  };
  struct Queued {
    Path path;
    Ray ray;
  };
  void scatter(const ShadedPoint& at, const SurfaceHit& hit, const Path& path);
  void end(const Queued& queued, const std::optional<SurfaceHit>& hit, const FiniteLight* light, double distance,
           const MarchedRay& marched);
  /// Of a ray that meets no surface: the light that it ends on, or everything infinitely far.
  dvec3 lights_ahead(const Ray& ray, const FiniteLight* light, double distance, const Path& path) const;
  /// Adds radiance that comes straight from a light, or from anything else.
  void add(const Path& path, const dvec3& direct, const dvec3& indirect) const;

  const GuideMarch& march_;
  std::deque<Queued> queue_;
  // Of those that are marched now.
  MarchBatch batch_;
  std::vector<GuideSums> sums_;
};

}  // namespace brume
