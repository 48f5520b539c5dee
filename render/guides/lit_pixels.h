#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <tuple>
#include <vector>

#include "render/guides/guide_march.h"

namespace brume {

/// Light on the first diffuse surfaces that camera rays meet, by group. It is smooth but for shadows' edges: found at
/// the corners and in the middle of squares of pixels, and between the corners where all five fit together; elsewhere
/// at each ray, or at more points of what a ray stands for where a shadow's edge goes through it. Of the many rays of a
/// pixel at an edge of surfaces a few that meet the same surface share it.
class LitPixels {
 public:
  explicit LitPixels(const GuideMarch& march) : march_(march) {}

  /// What a surface of albedo 1 reflects.
  struct Light {
    std::vector<Lit> groups;
    dvec3 scattered{0};                       ///< as SurfaceLight::Around
    std::vector<dvec3> of_light_groups = {};  ///< what of that and of what surfaces send is of each light group
  };
  /// Forgets what another tile's pixels see.
  void begin_tile();
  /// At the diffuse surface that a ray of a pixel meets. Valid until the next call.
  /// @param ray  as PixelRays::sample
  const Light& at(const ivec2& pixel, int ray, int across, const SurfaceHit& hit, const ShadedPoint& at);

 private:
  /// Where a ray of a pixel ends, if that is on a diffuse surface.
  struct Place {
    std::optional<uint32_t> surface;
    bool inside = false;
    dvec3 p{0}, normal{0};
    Light light;
    std::vector<double> wholes = {};  ///< grey: of each light group, and of all light
    int uses = 0;

    bool fits(const SurfaceHit& hit, const ShadedPoint& at) const;
    bool alike(const Place& other) const;
  };
  using Pixel = std::tuple<int, int, int>;        // and number of its ray
  using Square = std::tuple<int, int, int, int>;  // its first pixel, its side, number of the rays
  Place lit(const SurfaceHit& hit, const ShadedPoint& at) const;
  std::vector<double> wholes_of(const Light& light) const;
  /// Which of the wholes a guide light is a part of: the last where it is of several groups.
  size_t whole_of(size_t guide_light) const;
  const Place& place(const ivec2& pixel, int ray, int across);
  /// What a camera ray shows, if it ends on a diffuse surface.
  Place place_along(const CameraSample& sample) const;
  /// Whether light between the corners of a square is known. @param first  its pixel with the lowest coordinates
  bool smooth(const ivec2& first, int side, int ray, int across);

  /// Whether light there does not lie between that of the pixels beside it. @param own  of the ray
  bool at_shadow_edge(const Place& own, const ivec2& pixel, int ray, int across);
  /// Whether other points of the lens show other light of the same surface. @param own  of the ray
  bool differs_over_lens(const Place& own, const ivec2& pixel, int ray, int across);
  /// Mean over what a ray stands for. @param own  of the ray
  Light mean_around(const Place& own, const ivec2& pixel, int ray, int across) const;
  /// Between the corners of a square; false where that is not smooth.
  bool between(const ivec2& pixel, int ray, int across, const SurfaceHit& hit, const ShadedPoint& at);

  const GuideMarch& march_;
  std::map<Pixel, Place> places_;
  std::map<Square, bool> smooth_;
  std::map<std::pair<int, int>, std::vector<Place>> at_edges_;  // of pixels
  Light light_;                                                 // of one ray
};

}  // namespace brume
