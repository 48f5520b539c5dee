#include "image/recognise/channels.h"

namespace brume::recognition {
namespace {

/// The channels of a pass under its name in Blender up to 4 or its name since 5.
std::optional<ChannelTriple> cycles_pass(const Channels& file, const std::string& view, const char* old_name,
                                         const char* new_name) {
  const auto old = file.colour(view + old_name + ".");
  return old ? old : file.colour(view + new_name + ".");
}

/// Passes of surfaces: direct and indirect light, to be multiplied by the surface's colour.
void add_cycles_surfaces(const Channels& file, const std::string& view, ForeignFrame& picture) {
  const std::pair<const char*, const char*> kinds[] = {
      {"Diff", "Diffuse"}, {"Gloss", "Glossy"}, {"Trans", "Transmission"}, {"Subsurface", "Subsurface"}};
  for (const auto& [old_kind, new_kind] : kinds) {
    const auto named = [&, old_kind = old_kind, new_kind = new_kind](const std::string& o, const std::string& n) {
      return cycles_pass(file, view, (old_kind + o).c_str(), (new_kind + n).c_str());
    };
    const auto colour = named("Col", " Color"), direct = named("Dir", " Direct"), indirect = named("Ind", " Indirect");
    if (!colour) continue;
    if (direct)
      picture.passes.push_back({.name = old_kind + std::string("Dir"), .channels = *direct, .factor = colour});
    if (indirect)
      picture.passes.push_back(
          {.name = old_kind + std::string("Ind"), .channels = *indirect, .factor = colour, .indirect = true});
  }
}

void add_cycles_media(const Channels& file, const std::string& view, ForeignFrame& picture) {
  struct Pass {
    const char *old_name, *new_name;
    bool indirect;
  };
  for (const Pass& p : {Pass{"VolumeDir", "Volume Direct", false}, Pass{"VolumeInd", "Volume Indirect", true},
                        Pass{"Env", "Environment", false}, Pass{"Emit", "Emission", false}})
    if (const auto channels = cycles_pass(file, view, p.old_name, p.new_name))
      picture.passes.push_back({.name = p.old_name, .channels = *channels, .indirect = p.indirect});
}

}  // namespace

std::vector<ForeignFrame> cycles(const Channels& file, const ExrInfo& info) {
  std::vector<ForeignFrame> pictures;
  for (const std::string& view : file.before("Combined.R")) {
    const auto combined = file.colour(view + "Combined.");
    if (!combined) continue;
    ForeignFrame p{.renderer = "Blender Cycles multilayer", .view = without_dot(view), .target = *combined};
    const auto noisy = file.colour(view + "Noisy Image.");
    p.color = {.name = noisy ? "Noisy Image" : "Combined", .channels = noisy ? *noisy : *combined};
    if (noisy) p.remarks.push_back("Combined was denoised by Blender; it is made anew from Noisy Image and the passes");
    add_cycles_surfaces(file, view, p);
    add_cycles_media(file, view, p);
    add_lights(file, view, "Combined_", p);
    add_alpha(file, p, view + "Combined.");
    add_vector(p, layer::albedo, file.colour(view + "Denoising Albedo."));
    add_vector(p, layer::normal, file.vector(view + "Denoising Normal."));
    const std::string depth = file.single(view + "Denoising Depth");
    add_depth(p, depth.empty() ? file.single(view + "Depth") : depth);
    p.samples = header_number(info, "cycles." + p.view + ".samples");
    p.sample_count = file.single(view + "Debug Sample Count");
    p.count_is_share = true;
    pictures.push_back(std::move(p));
  }
  return pictures;
}

}  // namespace brume::recognition
