#include "image/usable_colors.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/text.h"

namespace brume {
namespace {

std::string counted(size_t count, const char* what) {
  return fmt::format("{} {} value{}", count, what, count == 1 ? "" : "s");
}

/// Removes what the header says of the colour space, after pixels have been converted to another.
void forget_space(Layers& picture) {
  for (const char* key : {"chromaticities", "acesImageContainerFlag", "colorInteropID", "oiio:ColorSpace"})
    picture.header.erase(key);
}

/// Replaces negative values by 0. @return how many there were
size_t clip_negatives(const std::array<Plane*, 3>& rgb) {
  size_t count = 0;
  for (Plane* plane : rgb)
    for (int y = 0; y < plane->height(); ++y)
      for (float& v : plane->pixels(y)) {
        if (!(v < 0)) continue;
        v = 0;
        ++count;
      }
  return count;
}

}  // namespace

std::vector<std::string> repair_colors(Layers& picture, const std::string& name, const WorkingSpace& space) {
  const std::array<Plane*, 3> rgb = picture.add_rgb(layer::beauty);
  const std::optional<Chromaticities> own = picture.chromaticities();
  std::optional<dmat3> conversion = own ? rec709_from(*own, name) : std::nullopt;
  if (own && name_of(*own) == name_of(space.chromaticities))
    conversion.reset();
  else if (space.from_rec709)
    conversion = *space.from_rec709 * conversion.value_or(dmat3(1));
  size_t nans = 0, infinite = 0, negative = 0;
  float largest = 0;
  for (const Plane* plane : rgb)
    for (int y = 0; y < plane->height(); ++y)
      for (const float v : plane->pixels(y))
        if (std::isfinite(v)) largest = std::max(largest, v);
  for (Plane* plane : rgb)
    for (int y = 0; y < plane->height(); ++y)
      for (float& v : plane->pixels(y)) {
        if (std::isfinite(v)) continue;
        ++(std::isnan(v) ? nans : v > 0 ? infinite : negative);
        v = v > 0 ? largest : 0.0f;  // false for NaN too
      }
  size_t outside = 0;
  if (conversion) {
    constexpr double kMost = std::numeric_limits<float>::max();
    for (int y = 0; y < picture.height(); ++y)
      for (int x = 0; x < picture.width(); ++x) {
        const dvec3 v = *conversion * dvec3((*rgb[0])(x, y), (*rgb[1])(x, y), (*rgb[2])(x, y));
        // What rounding made a little negative is no colour outside.
        const double rounding = 1e-6 * max_component(glm::abs(v));
        for (int c = 0; c < 3; ++c)
          (*rgb[static_cast<size_t>(c)])(x, y) =
              v[c] < 0 && v[c] >= -rounding ? 0.0f : static_cast<float>(std::clamp(v[c], -kMost, kMost));
      }
    outside = clip_negatives(rgb);
  } else {
    negative += clip_negatives(rgb);
  }
  std::vector<std::string> repaired, notes;
  if (nans) repaired.push_back(counted(nans, "NaN"));
  if (negative) repaired.push_back(counted(negative, "negative"));
  if (!repaired.empty()) notes.push_back(fmt::format("{}: {} became 0", name, join(repaired, " and ")));
  if (infinite)
    notes.push_back(
        fmt::format("{}: {} became the largest finite one, {:g}", name, counted(infinite, "infinite"), largest));
  if (conversion && (own || outside))
    notes.push_back(
        fmt::format("{}: its colours are {}: converted to linear {}, white to white{}", name,
                    name_of(own.value_or(kRec709)), name_of(space.chromaticities),
                    outside ? fmt::format("; {} outside of it became 0", counted(outside, "negative")) : ""));
  forget_space(picture);
  return notes;
}

void convert_colors(Layers& frame, const dmat3& matrix, const std::function<bool(const std::string&)>& wanted) {
  std::vector<std::string> names;
  for (const auto& [channel, plane] : frame.channels())
    if (channel == "R" || channel.ends_with(".R"))
      names.push_back(channel == "R" ? "" : channel.substr(0, channel.size() - 2));
  for (const std::string& name : names) {
    const LayerName layer{name, "RGB", ""};
    if (!frame.has(layer) || !wanted(name)) continue;
    const std::array<Plane*, 3> rgb = frame.add_rgb(layer);
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const dvec3 v = matrix * dvec3((*rgb[0])(x, y), (*rgb[1])(x, y), (*rgb[2])(x, y));
        for (int c = 0; c < 3; ++c) (*rgb[static_cast<size_t>(c)])(x, y) = static_cast<float>(v[c]);
      }
  }
}

std::string convert_to_rec709(Layers& frame, const std::string& name) {
  const std::optional<Chromaticities> space = frame.chromaticities();
  const std::optional<dmat3> matrix = space ? rec709_from(*space, name) : std::nullopt;
  if (!matrix) return "";
  convert_colors(frame, *matrix, [](const std::string& layer) {
    return !layer.ends_with(statistic::mean_variance) && layer != "transmittance" && !layer.ends_with("material");
  });
  forget_space(frame);
  return name_of(*space);
}

}  // namespace brume
