#include "image/recognise/channels.h"

namespace brume::recognition {

std::vector<ForeignFrame> arnold(const Channels& file, const ExrInfo&) {
  const auto colour = file.colour("").has_value() ? file.colour("") : file.colour("RGBA.");
  std::optional<ChannelTriple> variance;
  for (const char* name : {"variance.", "RGBA_variance."})
    if (!variance) variance = file.colour(name);
  const bool media = file.colour("volume_direct.") && file.colour("volume_indirect.");
  if (!colour) return {};
  ForeignFrame p{.renderer = "Arnold", .target = *colour};
  add_lights(file, "", "RGBA_", p, kNoLightGroups);
  if (!(variance || media || file.colour("denoise_albedo.") || !p.lights.empty())) return {};
  if (const auto layer = file.colour("RGBA."); layer && *layer != *colour) p.alike.push_back(*layer);
  p.color = {.name = "RGBA", .channels = *colour};
  if (variance) p.color.variance = {.channels = listed(*variance), .meaning = VarianceMeaning::kUnstated};
  const auto add_pass = [&](const std::string& name, bool indirect) {
    const auto channels = file.colour(name + ".");
    if (!channels) return;
    ForeignSignal& pass =
        p.passes.emplace_back(ForeignSignal{.name = name, .channels = *channels, .indirect = indirect});
    if (const auto own = file.colour(name + "_variance."))
      pass.variance = {.channels = listed(*own), .meaning = VarianceMeaning::kUnstated};
  };
  // One set of parts only: others are the same light, cut another way.
  if (media) {
    add_pass("volume_direct", false);
    add_pass("volume_indirect", true);
  } else if (file.colour("direct.") && file.colour("indirect.")) {
    add_pass("direct", false);
    add_pass("indirect", true);
  }
  add_alpha(file, p, "");
  if (p.alpha.empty()) add_alpha(file, p, "RGBA.");
  for (const char* name : {"denoise_albedo.", "diffuse_albedo."})
    if (p.features.empty()) add_vector(p, layer::albedo, file.colour(name));
  add_vector(p, layer::normal, file.vector("N."));
  add_depth(p, file.single("Z"));
  return {p};
}

}  // namespace brume::recognition
