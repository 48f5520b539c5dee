#include "apps/cli/frame.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>

namespace brume::app {

CLI::Validator exposure_validator() {
  const auto check = [](const std::string& text) {
    char* end = nullptr;
    const double value = std::strtod(text.c_str(), &end);
    const bool number = !text.empty() && *end == '\0' && value > 0 && std::isfinite(value);
    return number || text == "header" || text == "auto"
               ? std::string()
               : fmt::format("'{}': expected header, auto or a number above 0", text);
  };
  return CLI::Validator(check, "");
}

void add_picture_options(const Verb& command, PictureOptions& options, const std::string& exposure_help) {
  command("--exposure", options.exposure, exposure_help)->check(exposure_validator())->capture_default_str();
  command("--tone", options.tone,
          "of the PNG: clip what is brighter than white, or filmic, which bends it there softly")
      ->check(CLI::IsMember({"clip", "filmic"}))
      ->capture_default_str();
}

}  // namespace brume::app
