#pragma once
#include <array>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "render/guides/guide_media.h"
#include "render/guides/scattering_solver.h"
#include "render/guides/sky_parts.h"
#include "render/guides/surface_light.h"
#include "render/world/lights.h"
#include "render/world/surfaces.h"

namespace brume {

struct LitSurfaces;
class SharpLight;
class SkyLight;

/// Radiance by the events that it comes from: the reflection alone, or scattering before it.
struct Lit {
  dvec3 direct{0}, indirect{0};
  void add(const dvec3& factor, const Lit& other) {
    direct += factor * other.direct;
    indirect += factor * other.indirect;
  }
};

/// A scene whose light inside the media is being solved.
struct LightSolve {
  const std::vector<GuideMedia>& times;  ///< of the shutter; the light is that of the middle
  const SkyParts& sky_parts;
  const Surfaces* surfaces;  ///< null where there are none
  GuideColour colour;
  ScatteringSolver& solver;  ///< of the fine lattice
  const Lattice& coarse;
  const SurfaceLight* surface_light;  ///< null where there are no surfaces
  SkyShares& sky;                     ///< made for the first light that needs it
  Task task;

  const GuideMedia& media() const { return times[times.size() / 2]; }
  /// Share that surfaces leave of light, the mean of the colours.
  double passage(const Ray& ray, double distance) const {
    return surfaces ? in_colour(surfaces->passage(ray, distance).light, kGrey) : 1;
  }
};

/// One way of light into the media: a light, or several that share their guides because a frame has no use for guides
/// of each. A new way is a class in a file of its own, and a line in guide_lights().
class GuideLight {
 public:
  /// Orders of scattering that share a guide, each up to the next; the last one is all the rest. From the fourth on
  /// they live on the coarse lattice.
  static constexpr std::array<int, 6> kFirstOrder = {2, 3, 4, 6, 9, 14};
  static constexpr size_t kFineGuides = 3;

  /// @param colour  of mean 1: what a grey guide is multiplied by to be seen
  GuideLight(std::string guide_name, const dvec3& guide_colour, GuideColour only = kGrey)
      : name(std::move(guide_name)), channel(only), colour(guide_colour) {}
  virtual ~GuideLight() = default;
  GuideLight(const GuideLight&) = delete;
  GuideLight& operator=(const GuideLight&) = delete;

  /// Its light in the media before any scattering there.
  virtual Radiance arriving(const LightSolve& solve) = 0;
  /// What a diffuse surface of albedo 1 reflects of it at a point in front of it. @param around  the light there
  virtual Lit onto(const LitSurfaces& surfaces, const SurfaceLight::Around& around, const dvec3& p,
                   const dvec3& normal) const = 0;

  /// Light from one known direction at each point; null for any other.
  virtual const SharpLight* sharp() const { return nullptr; }
  /// Light from infinitely far away, known by its direction; null for any other.
  virtual const SkyLight* sky() const { return nullptr; }
  /// Whether it was scattered before it entered the media.
  virtual bool from_surfaces() const { return false; }
  virtual size_t bytes() const { return 0; }

  dvec3 colour_in(GuideColour guide) const { return guide == kGrey ? colour : dvec3(1); }

  /// Of its guides: "sun", "key-sun" where it is of the light group "key".
  std::string layer_name() const { return light_group.empty() ? name : light_group + "-" + name; }

  const std::string name;        ///< "sun", "sphere_2", "others", "sky", "glow", "surfaces"
  std::string light_group = {};  ///< of Lights::groups; empty: of none, or of several
  int group_number = -1;         ///< of that; -1: of none, or of several
  const GuideColour channel;  ///< the only one that it has light of, or kGrey: of a sky of many colours in grey media
  dvec3 colour;
  Radiance unscattered;        ///< arriving(); empty where that is known by direction
  std::vector<Source> orders;  ///< for each of kFirstOrder, scattered
};

/// The lights of a scene by their guides: suns and lamps one by one while they are few, the weaker ones together;
/// everything infinitely far but the suns is the sky; what the media emit is a group, too.
/// @param surfaces  null where there are none
/// @param colour    that they are wanted in: for kGrey a sky of many colours is three groups, its red, green and blue
std::vector<std::unique_ptr<GuideLight>> guide_lights(const Lights& lights, const SkyParts& sky,
                                                      const Surfaces* surfaces, const GuideMedia& media,
                                                      GuideColour colour);
/// What surfaces send into the media, once LightSolve::surface_light is known.
std::unique_ptr<GuideLight> light_from_surfaces(const dvec3& colour);

}  // namespace brume
