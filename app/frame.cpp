#include "app/frame.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>

#include "image/exr_io.h"
#include "image/foreign.h"

namespace brume::app {

Layers read_frame(const Common& common, const std::string& path, const std::set<std::string>& wanted) {
  Layers frame = read_exr(path, [&](const std::string& name) { return wanted.empty() || wanted.contains(name); });
  if (wanted.contains("R") && !frame.has(layer::beauty)) frame = read_exr(path);
  const std::string recognised = adopt_foreign_layers(frame);
  if (!recognised.empty() && !common.quiet) note(recognised);
  return frame;
}

Layers read_outline(const std::string& path) {
  Layers outline(1, 1);
  const ExrInfo info = read_exr_info(path);
  outline.header = info.header;
  for (const ExrInfo::Channel& channel : info.channels) outline.add(channel.name);
  adopt_foreign_layers(outline);
  return outline;
}

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

void PictureOptions::add_to(CLI::App& command, const std::string& exposure_help) {
  command.add_option("--exposure", exposure, exposure_help)->check(exposure_validator())->capture_default_str();
  command
      .add_option("--tone", tone,
                  "of the PNG: clip what is brighter than white, or filmic, which bends it there softly")
      ->check(CLI::IsMember({"clip", "filmic"}))
      ->capture_default_str();
}

void PictureOptions::write(const std::string& path, const Layers& frame, const RgbPlanes& rgb,
                           double exposure_factor) const {
  Layers colours(frame.width(), frame.height());
  colours.lie_like(frame);
  for (size_t c = 0; c < 3; ++c) colours.set(layer::beauty.channel(c), *rgb[c]);
  const PixelWindow shown = frame.data_window().common(frame.display_window());
  if (!shown.empty() && shown != frame.data_window()) colours = colours.cut(shown);
  write_png(path,
            to_picture(colours.rgb(layer::beauty), exposure_factor, tone == "filmic" ? Tone::kFilmic : Tone::kClip));
}

}  // namespace brume::app
