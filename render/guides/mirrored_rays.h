#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <utility>
#include <vector>

#include "render/guides/guide_march.h"

namespace brume {

/// What metals and glass show: rays that go on from them in fixed directions, until they meet something else. They are
/// marched as camera rays are, but that light which was scattered more often comes from a coarse table for all
/// directions. Each generation is marched together.
///
/// Suns and lamps that smooth surfaces show are small against a pixel. They are looked for by many rays that meet
/// surfaces alone, in squares of 4 x 4 pixels, pixels, quarters and sixteenths of them, each where rays through the
/// corners end near a light.
class MirroredRays {
 public:
  explicit MirroredRays(const GuideMarch& march);

  /// Forgets what the corners of another tile's pixels show.
  void begin_tile() { corners_.clear(); }
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
    GuideSums* pixel = nullptr;
    double transmittance = 1, peaks = 0;  ///< of the camera ray
    dvec3 throughput{1};                  ///< of surfaces and media behind it
    double largest = 1;                   ///< of the surfaces' throughput, the largest colour's
    double spread = 0;                    ///< of the directions that it stands for [rad]
    int bounces = 0, faces = 0;
    bool again = false;  ///< it went on from a surface that was seen in another one: all it sees is indirect light
    Shown shown = Shown::kAll;
    int camera_rays = 1, camera_ray = 0;  ///< of its pixel, if they are many; they share the rays of a rough surface
    bool off_sharp_metal = false;         ///< it comes from there straight to where it ends
    uint64_t branches = 1;                ///< a binary digit for each surface so far: whether it went through
    bool may_go_on() const;
  };
  struct Queued {
    Path path;
    Ray ray;
  };
  /// Calls visit(path, ray) for the directions of a lobe, or both of smooth glass.
  template <class Visit>
  void branch(const ShadedPoint& at, const SurfaceHit& hit, const Path& path, const Visit& visit) const;
  void scatter(const ShadedPoint& at, const SurfaceHit& hit, const Path& path);
  /// What a ray meets first.
  struct Met {
    std::optional<SurfaceHit> hit;
    const FiniteLight* light;
    double distance;  ///< to either
  };
  Met meet(const Ray& ray) const;
  void end(const Queued& queued, const Met& met, const MarchedRay& marched);
  /// Of a ray that meets no surface: the light that it ends on, or everything infinitely far.
  /// @param marched  whether the media were; else they attenuate suns and lamps, and the sky is left out
  dvec3 lights_ahead(const Ray& ray, const Met& met, Shown shown, bool marched) const;

  /// Looks for suns and lamps in the square of film that a camera ray stands for. @param path  of the camera ray
  void show_lights(const CameraSample& camera, uint32_t surface, Path path);
  /// A square of film, counted in the smallest of them, of which there are four along a pixel's side.
  struct Square {
    ivec2 first;
    int side;
  };
  void show_lights(const Square& square, const CameraSample& camera, uint32_t surface, const Path& path);
  /// Calls end(path, ray, met) for all rays that smooth surfaces alone turn.
  template <class End>
  void follow_smooth(const ShadedPoint& at, const SurfaceHit& hit, const Path& path, const End& end) const;
  /// Where a ray through a corner of a square ends, and how it came there.
  struct CornerEnd {
    uint64_t branches;
    Ray ray;
  };
  /// None where the surface there is not smooth.
  const std::vector<CornerEnd>& ends_at(const ivec2& corner);
  bool may_show_lights(const Square& square);
  bool light_within(const Ray& ray, double spread) const;
  /// Adds radiance that comes straight from a light, or from anything else.
  void add(const Path& path, const dvec3& direct, const dvec3& indirect) const;

  const GuideMarch& march_;
  std::deque<Queued> queue_;
  // Of those that are marched now.
  MarchBatch batch_;
  std::vector<GuideSums> sums_;
  std::map<std::pair<int, int>, std::vector<CornerEnd>>
      corners_;  // of squares in the tile's pixels, as far as they were asked for
};

}  // namespace brume
