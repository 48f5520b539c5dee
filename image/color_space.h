#pragma once
#include <array>
#include <optional>
#include <string>

#include "base/vec.h"

namespace brume {

/// CIE 1931 x, y of a linear RGB's red, green, blue and white, in this order: OpenEXR's attribute `chromaticities`,
/// Radiance's PRIMARIES.
using Chromaticities = std::array<float, 8>;

inline constexpr Chromaticities kRec709 = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};
/// ACES 2065-1 (AP0).
inline constexpr Chromaticities kAces = {0.7347f, 0.2653f, 0.0f, 1.0f, 0.0001f, -0.077f, 0.32168f, 0.33767f};

/// "ACEScg (AP1)" of a space that has a name, the eight numbers of another.
std::string name_of(const Chromaticities& space);

/// The space of a name that OpenImageIO and the Color Interop Forum give it: "lin_ap1_scene", "ACEScg". Nothing for
/// other names, and for Rec. 709.
std::optional<Chromaticities> space_of_name(std::string name);

/// From linear RGB of a space to linear Rec. 709: white stays white, by Bradford's adaptation. Nothing where the space
/// is Rec. 709 already, to 0.001.
/// @param where  whose it is, for the message
/// @throws InputError: numbers that are not finite, primaries on one line, a white outside of them
/// Source: SMPTE RP 177-1993; Lam 1985 in Lindbloom's form of the Bradford matrix.
std::optional<dmat3> rec709_from(const Chromaticities& space, const std::string& where);

/// The linear RGB whose numbers a scene's colours are, and its frames: [film] color_space.
struct WorkingSpace {
  Chromaticities chromaticities = kRec709;
  std::optional<dmat3> to_rec709 = {}, from_rec709 = {};  ///< nothing where the space is Rec. 709

  WorkingSpace() = default;
  /// @param name  one of kWorkingSpaces
  explicit WorkingSpace(const std::string& name);
  /// A colour of linear Rec. 709 in this space; what lies outside of it is 0 in a channel.
  dvec3 of_rec709(const dvec3& colour) const;
};

/// Names that OpenImageIO and the Color Interop Forum give to them.
inline constexpr std::array kWorkingSpaces = {"lin_rec709",   "lin_rec2020", "lin_p3d65",
                                              "lin_adobergb", "acescg",      "aces2065-1"};

}  // namespace brume
