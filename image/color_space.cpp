#include "image/color_space.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "base/error.h"
#include "base/text.h"

namespace brume {
namespace {

bool same(const Chromaticities& a, const Chromaticities& b) {
  return std::equal(a.begin(), a.end(), b.begin(), [](float p, float q) { return std::abs(p - q) <= 1e-3f; });
}

const std::pair<const char*, Chromaticities> kNamed[] = {
    {"Rec. 709", kRec709},
    {"Rec. 2020", {0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f}},
    {"P3 (D65)", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.3127f, 0.3290f}},
    {"P3 (DCI)", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.314f, 0.351f}},
    {"P3 (D60)", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.32168f, 0.33767f}},
    {"ACES 2065-1 (AP0)", kAces},
    {"ACEScg (AP1)", {0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f}},
    {"Adobe RGB", {0.640f, 0.330f, 0.210f, 0.710f, 0.150f, 0.060f, 0.3127f, 0.3290f}},
    {"CIE XYZ", {1, 0, 0, 1, 0, 0, 1.0f / 3, 1.0f / 3}},
    {"Radiance's RGB", {0.640f, 0.330f, 0.290f, 0.600f, 0.150f, 0.060f, 1.0f / 3, 1.0f / 3}},
};

/// X, Y, Z of a chromaticity, of sum 1.
dvec3 xyz(const Chromaticities& space, size_t colour) {
  const double x = space[2 * colour], y = space[2 * colour + 1];
  return {x, y, 1.0 - x - y};
}

/// White has luminance 1. @throws InputError
dmat3 xyz_from_rgb(const Chromaticities& space, const std::string& where) {
  const auto fail = [&](const char* why) {
    throw InputError(fmt::format("{}: chromaticities {}: {}; expected x, y of red, green, blue and white", where,
                                 name_of(space), why));
  };
  if (!std::all_of(space.begin(), space.end(), [](float v) { return std::abs(v) < 1e3f; }))
    fail("not all of them are numbers that colours have");
  const dmat3 primaries(xyz(space, 0), xyz(space, 1), xyz(space, 2));
  if (!(std::abs(glm::determinant(primaries)) > 1e-5)) fail("red, green and blue lie on one line");
  const dvec3 white = xyz(space, 3);
  if (!(white.x > 0 && white.y > 1e-3 && white.z > 0)) fail("its white is no colour");
  const dvec3 shares = glm::inverse(primaries) * (white / white.y);
  if (!(shares.x > 0 && shares.y > 0 && shares.z > 0)) fail("its white lies outside of red, green and blue");
  return {primaries[0] * shares.x, primaries[1] * shares.y, primaries[2] * shares.z};
}

}  // namespace

std::string name_of(const Chromaticities& space) {
  for (const auto& [name, known] : kNamed)
    if (same(space, known)) return name;
  return fmt::format("{:g} {:g}, {:g} {:g}, {:g} {:g}, white {:g} {:g}", space[0], space[1], space[2], space[3],
                     space[4], space[5], space[6], space[7]);
}

std::optional<Chromaticities> space_of_name(std::string name) {
  name = lower(std::move(name));
  if (name.ends_with("_scene")) name.resize(name.size() - 6);
  static const std::pair<const char*, const char*> names[] = {
      {"lin_ap1", "ACEScg (AP1)"},         {"acescg", "ACEScg (AP1)"},   {"lin_ap0", "ACES 2065-1 (AP0)"},
      {"aces2065-1", "ACES 2065-1 (AP0)"}, {"lin_rec2020", "Rec. 2020"}, {"lin_p3d65", "P3 (D65)"},
      {"lin_adobergb", "Adobe RGB"}};
  for (const auto& [word, space] : names)
    if (name == word)
      for (const auto& [known, chromaticities] : kNamed)
        if (std::string_view(known) == space) return chromaticities;
  return std::nullopt;
}

std::optional<dmat3> rec709_from(const Chromaticities& space, const std::string& where) {
  if (same(space, kRec709)) return std::nullopt;
  // Columns: what X, Y and Z each give to the three cone responses.
  const dmat3 bradford(0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296);
  const dmat3 from = xyz_from_rgb(space, where), to = xyz_from_rgb(kRec709, where);
  const dvec3 cones = bradford * (to * dvec3(1)) / (bradford * (from * dvec3(1)));
  const dmat3 scaled(dvec3(cones.x, 0, 0), dvec3(0, cones.y, 0), dvec3(0, 0, cones.z));
  return glm::inverse(to) * glm::inverse(bradford) * scaled * bradford * from;
}

WorkingSpace::WorkingSpace(const std::string& name) {
  if (const std::optional<Chromaticities> known = space_of_name(name)) chromaticities = *known;
  to_rec709 = rec709_from(chromaticities, name);
  if (to_rec709) from_rec709 = glm::inverse(*to_rec709);
}

dvec3 WorkingSpace::of_rec709(const dvec3& colour) const {
  return from_rec709 ? glm::max(*from_rec709 * colour, dvec3(0)) : colour;
}

}  // namespace brume
