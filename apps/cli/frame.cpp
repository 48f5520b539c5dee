#include "apps/cli/frame.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <cstdlib>

#include "base/error.h"

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

void add_size_option(const Verb& command, std::vector<std::string>& overrides) {
  const auto set = [&overrides](const std::string& text) {
    int width = 0, height = 0;
    const char* const end = text.data() + text.size();
    const auto [cross, wrong] = std::from_chars(text.data(), end, width);
    if (wrong != std::errc() || cross == end || *cross != 'x' ||
        std::from_chars(cross + 1, end, height) != std::from_chars_result{end, std::errc()})
      throw InputError(fmt::format("--size {}: expected WIDTHxHEIGHT [px], for example 1920x1080", text));
    overrides.push_back(fmt::format("film.width={}", width));
    overrides.push_back(fmt::format("film.height={}", height));
  };
  command->add_option_function<std::string>("--size", set, "pixels of the picture instead of the scene's: 1920x1080");
}

void add_picture_options(const Verb& command, PictureOptions& options, const std::string& exposure_help) {
  command("--exposure", options.exposure, exposure_help)->check(exposure_validator())->capture_default_str();
  command("--tone", options.tone,
          "of the PNG: clip what is brighter than white, or filmic, which bends it there softly")
      ->check(CLI::IsMember({"clip", "filmic"}))
      ->default_str("clip");
  add_display_options(command, options, "the PNG is shown");
}

void add_display_options(const Verb& command, PictureOptions& options, const std::string& shown) {
  DisplaySetting& display = options.display;
  command(
      "--ocio", display.config,
      fmt::format(
          "OpenColorIO configuration through which {}, or none; else the one that $OCIO names, unless --tone is given",
          shown));
  command("--display", display.display, "display of the configuration")->default_str("its own default");
  command("--view", display.view, "view of that display")->default_str("its own default");
  command("--look", display.look, "look in the place of the view's");
  command("--ocio-space", display.space, "the configuration's name of linear Rec. 709")->default_str("found by itself");
}

}  // namespace brume::app
