#include <fmt/format.h>

#include <cmath>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/frame.h"
#include "base/error.h"
#include "base/output_file.h"
#include "base/text.h"
#include "filters/api/requirements.h"

namespace brume::app {
namespace {

struct Options {
  std::string input, output, layer;
  PictureOptions picture;
};

/// What is shown as red, green and blue.
struct Shown {
  std::array<Plane, 3> made;  // of a layer that is not colours
  RgbPlanes rgb{};
  bool radiance = true;
};

/// Colours as they are, one channel as grey, vectors by the magnitudes of their components.
/// @throws InputError for a layer that the frame does not have
Shown show_layer(const Options& o, const Layers& frame) {
  const std::string name = o.layer == "beauty" ? "" : o.layer;
  Shown shown;
  for (const std::string_view letters : {"RGB", "rgb"})
    if (const LayerName colours{name, letters, ""}; frame.has(colours)) {
      shown.rgb = frame.rgb(colours);
      return shown;
    }
  shown.radiance = false;
  for (const std::string_view letters : {"XYZ", "xyz"}) {
    const LayerName vectors{name, letters, ""};
    if (!frame.has(vectors)) continue;
    for (size_t c = 0; c < 3; ++c) {
      shown.made[c] = frame.at(vectors.channel(c));
      for (int y = 0; y < frame.height(); ++y)
        for (float& v : shown.made[c].pixels(y)) v = std::abs(v);
      shown.rgb[c] = &shown.made[c];
    }
    return shown;
  }
  for (const std::string_view only : {"A", "Y", "Z", "V"})
    if (const Plane* plane = frame.find(LayerName{name, only, ""}.channel(0))) {
      shown.rgb = {plane, plane, plane};
      return shown;
    }
  if (const Plane* plane = frame.find(name)) {  // a channel by its whole name
    shown.rgb = {plane, plane, plane};
    return shown;
  }
  throw InputError(fmt::format("{}: has no layer '{}' to show; it has: {} (--layer, or a channel by its whole name)",
                               o.input, name.empty() ? "beauty" : name, join(layer_names(frame))));
}

int run(const Options& o, const Common& common) {
  const std::filesystem::path inputs[] = {o.input};
  check_writable(o.output, inputs, ".png");
  o.picture.check();
  const Layers frame = read_frame(ExrFile(o.input), make_host(common));
  const Shown shown = show_layer(o, frame);
  if (const std::optional<Chromaticities> space = frame.chromaticities(); space && shown.radiance)
    rec709_from(*space, o.input);                 // refuses what is none
  Layers colours(frame.width(), frame.height());  // for the exposure, which may be measured
  if (shown.radiance) colours.header = frame.header;
  for (size_t c = 0; c < 3; ++c) colours.set(layer::beauty.channel(c), *shown.rgb[c]);
  o.picture.write(o.output, frame, shown.rgb, choose_exposure(o.picture.exposure, colours), shown.radiance);
  print(o.output + "\n");
  return kDone;
}

}  // namespace

void add_picture(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command = add_command(app, common, "picture", "a PNG of an EXR, or of one of its layers");
  command("frame", o.input, "EXR, by brume or another renderer")->required();
  command("-o,--output", o.output, "PNG to write: what lies inside the display window")->required();
  command(
      "--layer", o.layer,
      "layer to show, the beauty without it; statistics too: indirect.half_a. Single channels, which may be called by their whole names, become grey, vectors the magnitudes of their components");
  add_picture_options(command, o.picture,
                      "number, header (1 for what is no radiance), or auto: the 99th luminance percentile becomes 1");
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
