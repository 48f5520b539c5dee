#pragma once
#include <string>
#include <vector>

#include "render/guides/guide_media.h"
#include "render/world/lights.h"

namespace brume {

/// A light, or several that share their guides because a frame has no use for guides of each.
struct LightGroup {
  enum class Kind { kSun, kLocal, kOthers, kSky, kEmission, kSurfaces } kind = Kind::kSky;
  std::string name;                  ///< of its guides: "sun", "sphere_2", "others", "sky", "glow", "surfaces"
  const Sun* sun = nullptr;          ///< of kSun
  std::vector<const Light*> lights;  ///< one of kSun and kLocal, several of kOthers
  dvec3 colour{1};                   ///< of mean 1: what a grey guide is multiplied by to be seen
  GuideColour channel = kGrey;       ///< or the only one that it has light of: of a sky of many colours in grey media
  dvec3 colour_in(GuideColour guide) const { return guide == kGrey ? colour : dvec3(1); }
  bool sky() const { return kind == Kind::kSky; }
  /// Whether its light comes from one known direction at each point.
  bool sharp() const { return kind == Kind::kSun || kind == Kind::kLocal; }
  /// Whether its light was scattered before it entered the media.
  bool from_surfaces() const { return kind == Kind::kSurfaces; }
  /// What the group has of light whose colours are known.
  dvec3 share() const { return channel == kGrey ? dvec3(1) : colour; }
};

/// The lights of a scene by their guides: suns and local lights one by one while they are few, the weaker ones
/// together; everything infinitely far but the suns is the sky; what the media emit is a group, too.
/// @param colour  that they are wanted in: for kGrey a sky of many colours is three groups, its red, green and blue
std::vector<LightGroup> light_groups(const Lights& lights, const GuideMedia& media, GuideColour colour);

/// Irradiance-like: what arrives at a point from a local light, along one direction towards its middle.
struct LocalLight {
  dvec3 towards{0};  ///< unit
  double distance = 0;
  dvec3 irradiance{0};  ///< in empty space, across that direction
  double radius = 0;    ///< of a sphere; its middle lies as much farther
  /// Mean over the directions towards it, of which `depth` is the optical depth along the shortest.
  double transmittance(double depth) const;
  /// Optical depth of that mean.
  double mean_depth(double depth) const;
  /// Mean cosine of the directions towards it to that of its middle: 1 of a small or distant one.
  double mean_cosine() const;

 private:
  bool small() const;
};
LocalLight local_light(const Light& light, const dvec3& p);

}  // namespace brume
