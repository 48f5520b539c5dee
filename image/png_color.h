#pragma once
#include <filesystem>
#include <optional>
#include <string>

#include "image/color_space.h"

namespace brume {

/// What a PNG says about its colours. Where it says that they are sRGB, or nothing, none of this is set.
struct PngColor {
  std::optional<double> gamma = {};                   ///< linear light is a value to the power of 1 / gamma (gAMA)
  std::optional<Chromaticities> chromaticities = {};  ///< cHRM
  std::string profile = {};                           ///< name of an ICC profile that is not sRGB's, or "cICP"
};

/// Reads the chunks before the pixels; nothing of files that are no PNG or end early.
/// Source: W3C Recommendation Portable Network Graphics, second edition, 11.3.3
PngColor read_png_color(const std::filesystem::path& path);

}  // namespace brume
