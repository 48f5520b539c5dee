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
/// pixel at an edge of surfaces a few that meet the same surface share it. The lights of each light group are found as
/// closely as that group needs, by themselves; light from all around of all groups together.
class LitPixels {
 public:
  explicit LitPixels(const GuideMarch& march);

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
  /// Where a ray of a pixel ends, if that is on a diffuse surface. Its light is found part by part.
  struct Place {
    std::optional<uint32_t> surface;
    bool inside = false;
    dvec3 p{0}, normal{0};
    SurfaceLight::Around around = {};
    Light light = {};
    std::vector<bool> known = {};     ///< by part
    std::vector<double> wholes = {};  ///< grey, by part; of a light group what it has of the last part, too
    int uses = 0;

    bool fits(const SurfaceHit& hit, const ShadedPoint& at) const;
    bool alike(const Place& other) const;
  };
  /// What is known of a square's parts.
  struct Square {
    bool flat = false;  ///< all of it on one surface
    std::vector<std::optional<bool>> smooth;
  };
  using Pixel = std::tuple<int, int, int>;            // and number of its ray
  using SquareName = std::tuple<int, int, int, int>;  // its first pixel, its side, number of the rays
  /// The lights of a light group are a part; the last one is light from all around, of whatever group, and the lights
  /// of none or of several.
  size_t parts() const { return lights_of_part_.size(); }
  bool is_of_group(size_t part) const { return part + 1 < parts(); }
  bool told_apart() const { return parts() > 1; }
  Light no_light() const;
  static Place unlit(const SurfaceHit& hit, const ShadedPoint& at);
  /// Prepares a place for its light to be found. @param like  has the same light from all around; or null
  void look_around(Place& place, const Place* like) const;
  const Light& lit(Place& place, size_t part) const;
  double whole(Place& place, size_t part) const;
  /// Of all light there.
  double whole(Place& place) const;
  Place& place(const ivec2& pixel, int ray, int across);
  /// What a camera ray shows, if it ends on a diffuse surface.
  Place place_along(const CameraSample& sample) const;
  static ivec2 first_of_square(const ivec2& pixel, int side);
  Place& middle(const ivec2& first, int side, int ray, int across) { return place(first + side / 2, ray, across); }
  Place& corner(const ivec2& first, int side, int c, int ray, int across) {
    return place(first + side * ivec2(c % 2, c / 2), ray, across);
  }
  /// Whether a square shows one surface. @param first  its pixel with the lowest coordinates
  bool flat(const ivec2& first, int side, int ray, int across);
  /// Whether light between the corners of a square is known.
  bool smooth(const ivec2& first, int side, int ray, int across, size_t part);
  bool find_smooth(const ivec2& first, int side, int ray, int across, size_t part);
  /// What a light group's light counts as at least around a pixel, so that nobody looks for what is not seen.
  double least_whole(const ivec2& pixel, int ray, int across);

  /// Whether light there does not lie between that of the pixels beside it. @param own  of the ray
  bool at_shadow_edge(Place& own, const ivec2& pixel, int ray, int across, size_t part, double least);
  /// Whether other points of the lens show other light of the same surface. @param own  of the ray
  bool differs_over_lens(Place& own, const ivec2& pixel, int ray, int across, size_t part, double least);
  /// Adds some parts' mean over what a ray stands for. @param own  of the ray
  void add_mean_around(Place& own, const ivec2& pixel, int ray, int across, const std::vector<size_t>& parts);
  /// Adds one between the corners of a square; false where that is not smooth.
  bool add_between(const ivec2& pixel, int ray, int across, const SurfaceHit& hit, const ShadedPoint& at, size_t part);
  /// Adds a part of other light.
  void add(const Light& other, const dvec3& weight, size_t part);

  const GuideMarch& march_;
  std::vector<std::vector<size_t>> lights_of_part_;  // guide lights
  std::map<Pixel, Place> places_;
  std::map<SquareName, Square> squares_;
  std::map<std::pair<int, int>, std::vector<Place>> at_edges_;  // of pixels
  Light light_;                                                 // of one ray
};

}  // namespace brume
