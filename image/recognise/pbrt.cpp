#include "image/recognise/channels.h"

namespace brume::recognition {

std::vector<ForeignFrame> pbrt(const Channels& file, const ExrInfo& info) {
  const auto colour = file.colour(""), variance = file.colour("Variance.");
  // Names since 2021, and those before.
  const auto normal = [&](const std::string& name) {
    const auto dotted = file.vector(name + ".");
    return dotted ? dotted : file.vector(name);
  };
  const bool surfaces = file.colour("Albedo.") && normal("Ns") && normal("P");
  if (!colour || !(surfaces || (variance && file.colour("RelativeVariance.")))) return {};
  ForeignFrame p{.renderer = "pbrt-v4 G-buffer film", .target = *colour};
  p.color = {.name = "RGB", .channels = *colour};
  if (variance)
    p.color.variance = {.channels = listed(*variance), .meaning = VarianceMeaning::kOfSamples, .of_surfaces = true};
  add_alpha(file, p, "");
  add_vector(p, layer::albedo, file.colour("Albedo."));
  add_vector(p, layer::normal, normal("Ns"));
  add_vector(p, layer::position, normal("P"));
  p.samples = header_number(info, "samplesPerPixel");
  return {p};
}

}  // namespace brume::recognition
