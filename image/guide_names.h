#pragma once
#include <string>
#include <string_view>
#include <utility>

#include "image/layers.h"

// The layers of guides: render/guides records them, filters/ tells their classes by them, the viewer lists them, and
// docs/guides.md shows this table (tests/image/guide_names_test.cpp).

namespace brume {

/// What every name of a guide layer begins with.
inline constexpr std::string_view kGuidePrefix = "guide.";

/// What a guide says about a pixel. Materials tell pixels apart and explain no light.
enum class GuideClass {
  kOpacity,
  kSingle,
  kMultiple,
  kEmission,
  kBackground,
  kSurface,
  kGeometry,
  kPredicted,
  kMaterial
};

/// A layer, or one for each of several lights: LIGHT stands for its name. Channels "Y" are "R", "G", "B" where guides
/// are chromatic.
struct GuideName : LayerName {
  GuideClass kind;
  std::string_view unit;
  std::string_view list;  ///< of the viewer, that it stands in
};

namespace guide_row {
inline constexpr std::string_view kRadiance = "W/(m^2 sr)", kLength = "scene units";

constexpr GuideName shape(std::string_view name, std::string_view channels, std::string_view unit,
                          std::string_view meaning) {
  return {{name, channels, meaning}, GuideClass::kGeometry, unit, "shape of the media"};
}
constexpr GuideName once(std::string_view name, std::string_view channels, std::string_view meaning) {
  return {{name, channels, meaning}, GuideClass::kSingle, kRadiance, "scattered once"};
}
constexpr GuideName often(std::string_view name, std::string_view meaning, std::string_view channels = "Y") {
  return {{name, channels, meaning}, GuideClass::kMultiple, kRadiance, "scattered more often"};
}
constexpr GuideName surface(std::string_view name, std::string_view meaning) {
  return {{name, "RGB", meaning}, GuideClass::kSurface, kRadiance, "surfaces"};
}
constexpr GuideName of_surface(std::string_view name, std::string_view channels, GuideClass kind, std::string_view unit,
                               std::string_view meaning) {
  return {{name, channels, meaning}, kind, unit, "surfaces"};
}
constexpr GuideName predicted(std::string_view name, GuideClass kind, std::string_view meaning) {
  return {{name, "RGB", meaning}, kind, kRadiance, "predicted"};
}
}  // namespace guide_row

// w, w2, w4, w8: the share of the eye's ray that ends in a segment of it, with the extinction, a half, a quarter, an
// eighth of it. V: transmittance towards the light. p: phase function. E: irradiance.
inline constexpr GuideName kGuideNames[] = {
    {{"guide.opacity", "Y", "sum of w: 1 - transmittance"}, GuideClass::kOpacity, "1", "shape of the media"},
    guide_row::shape("guide.depth", "Z", guide_row::kLength,
                     "opacity times the mean distance, from the middle of the media away from the eye"),
    guide_row::shape("guide.spread", "Z", guide_row::kLength, "opacity times the standard deviation of that distance"),
    guide_row::shape("guide.gradient", "XYZ", "1",
                     "w times the direction of the extinction's gradient; flat density counts less"),
    guide_row::shape("guide.density", "Y", "1", "w times density, as a share of the largest"),
    guide_row::once("guide.single.LIGHT", "Y", "light of LIGHT scattered once: w E p V"),
    guide_row::once("guide.single.emission", "RGB", "the media's emission, scattered once by a forward peak"),
    guide_row::often("guide.multiple.LIGHT_once",
                     "light of LIGHT (surfaces) scattered for the first time in the media"),
    guide_row::often("guide.multiple.LIGHT_half", "octave of LIGHT, a sun or lamp: w2 E p(g/2) V^(1/2)"),
    guide_row::often("guide.multiple.LIGHT_quarter", "octave of LIGHT: w4 E p(g/4) V^(1/4)"),
    guide_row::often("guide.multiple.LIGHT_eighth", "octave of LIGHT: w8 E p(g/8) V^(1/8)"),
    guide_row::often("guide.multiple.LIGHT_soft2",
                     "LIGHT scattered evenly: w E V^(1/2) / 4 pi; of the sky the mean root of its transmittance"),
    guide_row::often("guide.multiple.LIGHT_soft4",
                     "LIGHT scattered evenly: w E V^(1/4) / 4 pi; of the sky the mean fourth root"),
    guide_row::often("guide.multiple.LIGHT_soft8", "LIGHT scattered evenly: w E V^(1/8) / 4 pi"),
    guide_row::often("guide.multiple.LIGHT_soft16", "LIGHT scattered evenly: w E V^(1/16) / 4 pi"),
    guide_row::often(
        "guide.multiple.LIGHT_forward",
        "light of LIGHT scattered once at an angle, and any number of times nearly straight on, by forward peaks"),
    guide_row::often("guide.multiple.LIGHT_order2", "light of LIGHT scattered twice"),
    guide_row::often("guide.multiple.LIGHT_order3", "light of LIGHT scattered three times"),
    guide_row::often("guide.multiple.LIGHT_order4", "light of LIGHT scattered 4 or 5 times"),
    guide_row::often("guide.multiple.LIGHT_order6", "light of LIGHT scattered 6 to 8 times"),
    guide_row::often("guide.multiple.LIGHT_order9", "light of LIGHT scattered 9 to 13 times"),
    guide_row::often("guide.multiple.LIGHT_tail", "light of LIGHT scattered more often"),
    guide_row::often("guide.multiple.LIGHT_flux", "how the tail of LIGHT changes along the ray"),
    guide_row::often("guide.multiple.LIGHT_tail_half", "the tail of LIGHT, weighted by w2"),
    guide_row::often("guide.multiple.LIGHT_tail_quarter", "the tail of LIGHT, weighted by w4"),
    guide_row::often("guide.multiple.LIGHT_tail_eighth", "the tail of LIGHT, weighted by w8"),
    guide_row::often("guide.multiple.behind",
                     "surfaces and emission seen through forward peaks, less what is seen of them unscattered", "RGB"),
    guide_row::predicted("guide.emission", GuideClass::kEmission, "the media's emission"),
    guide_row::predicted("guide.background", GuideClass::kBackground,
                         "sky, lights and emitting surfaces seen through the media"),
    guide_row::of_surface("guide.normal", "XYZ", GuideClass::kGeometry, "1",
                          "normal of the first surface, times transmittance"),
    guide_row::of_surface("guide.surface_depth", "Z", GuideClass::kGeometry, guide_row::kLength,
                          "depth of the first surface, times transmittance"),
    guide_row::of_surface("guide.surface_albedo", "RGB", GuideClass::kGeometry, "1",
                          "albedo of the first surface, times transmittance"),
    guide_row::of_surface("guide.surface_material", "RGB", GuideClass::kMaterial, "1",
                          "shares of diffuse, metal and glass, times transmittance"),
    guide_row::surface("guide.surface.LIGHT", "first surface lit by LIGHT, with the shadows of media and surfaces"),
    guide_row::surface("guide.surface.indirect", "first surface lit by what media scatter and other surfaces reflect"),
    guide_row::surface("guide.surface.mirrored", "lights, sky and emission seen in metal and glass"),
    guide_row::surface("guide.surface.mirrored_indirect", "everything else seen in metal and glass"),
    guide_row::predicted("guide.predicted_direct", GuideClass::kPredicted,
                         "sum of everything above that estimates direct light"),
    guide_row::predicted("guide.predicted_indirect", GuideClass::kPredicted,
                         "sum of everything above that estimates indirect light"),
};

/// The row of a name, to be asked by constants: another name is an error of the compiler.
consteval const GuideName& guide_named(std::string_view name) {
  for (const GuideName& guide : kGuideNames)
    if (guide.name == name) return guide;
  throw "no guide has this name";
}

/// The row of a layer in a frame, whatever its light is called, and what it is; null for one that is not in the table.
std::pair<const GuideName*, std::string> find_guide(std::string_view layer);

/// By the word after the prefix; one that is not in the table tells about geometry.
GuideClass guide_class(std::string_view layer);

/// Whether a channel belongs to a guide.
inline bool is_guide(std::string_view channel) {
  return channel.starts_with(kGuidePrefix);
}

}  // namespace brume
