#include <fmt/format.h>

#include <array>

#include "base/text.h"
#include "image/recognise/channels.h"

namespace brume::recognition {
namespace {

// As plain() makes them. C: Karma and Mantra; Ci: RenderMan, 3Delight; RGB_color: V-Ray; FinalImage: Unreal.
const std::set<std::string> kColour = {"rgba", "rgb",  "beauty", "color",    "colour",     "c",
                                       "ci",   "main", "left",   "rgbcolor", "finalimage", "right"};
// What may be a picture where there is none of these.
const std::set<std::string> kOtherColour = {"combined", "final", "image", "masterlayer", "render"};

/// The layers below the prefixes whose names mean the same; each with what is before it.
std::vector<std::string> called(const Channels& file, const std::set<std::string>& prefixes,
                                const std::set<std::string>& names) {
  std::vector<std::string> found;
  for (const std::string& prefix : prefixes)
    for (const std::string& layer : file.layers(prefix))
      if (names.contains(plain(layer))) found.push_back(prefix + layer);
  std::sort(found.begin(), found.end());
  found.erase(std::unique(found.begin(), found.end()), found.end());
  return found;
}

/// @param in_file  the name of a candidate in the file
void choose(ForeignFrame& picture, const std::string& role, const std::vector<std::string>& candidates,
            const auto& in_file, const auto& take) {
  if (candidates.size() == 1) take(candidates[0]);
  if (candidates.size() < 2) return;
  std::vector<std::string> names;
  for (const std::string& candidate : candidates) names.push_back(in_file(candidate));
  picture.conflicts.push_back(
      fmt::format("the {} could be any of {}; say which in a mapping file: {} = \"{}\" (--map, docs/frames.md)", role,
                  join(names), role, names[0]));
}

// Names of features, as plain() makes them. The second ones of albedo count where there is none of the first.
const std::set<std::string> kAlbedo = {"albedo", "alb", "diffusealbedo", "denoisealbedo", "denoisingalbedo"};
const std::set<std::string> kOtherAlbedo = {"diffusefilter", "basecolor", "diffcol", "diffusecolor"};
const std::set<std::string> kNormal = {"normal", "normals", "n", "nrm", "nn", "shnormal", "denoisingnormal"};
const std::set<std::string> kDepth = {"depth", "z", "zdepth", "distance"};
// What a name of a medium's pass holds: VolumeLighting (Redshift), VRayAtmosphere, volume_direct (Arnold).
constexpr std::array kMedia = {"vol", "atmos", "fog", "smoke", "fire", "cloud", "medium", "media"};
const std::set<std::string> kVariance = {"variance", "rgbavariance", "colorvariance"};

/// How a layer is told to a user.
std::string shown(const ChannelTriple& channels) {
  const std::string layer = layer_in_file(channels[0]);
  return !layer.empty() ? layer : channels[0] == channels[1] ? channels[0] : "RGB";
}

/// A picture of colours below a prefix, with the layers of common names beside it.
ForeignFrame picture_of_colours(const Channels& file, const ExrInfo& info, const std::string& prefix, bool eye) {
  ForeignFrame p{.renderer = "a frame of colours", .view = without_dot(prefix), .target = *file.colour(prefix)};
  p.color = {.name = shown(p.target), .channels = p.target};
  add_alpha(file, p, prefix);
  const std::string parent =
      prefix.find('.') + 1 < prefix.size() ? prefix.substr(0, without_dot(prefix).rfind('.') + 1) : std::string();
  if (p.alpha.empty())
    if (const auto layers = called(file, {prefix, eye ? prefix : parent}, {"alpha"}); layers.size() == 1)
      p.alpha = file.single(layers[0]);
  add_common_layers(file, {prefix, eye ? prefix : parent}, p);
  p.samples = header_number(info, "samplesPerPixel");
  return p;
}

}  // namespace

void add_common_layers(const Channels& file, const std::set<std::string>& prefixes, ForeignFrame& p) {
  const auto keep = [](std::vector<std::string> names, const auto& accepts) {
    std::erase_if(names, [&](const std::string& name) { return !accepts(name); });
    return names;
  };
  const auto is_colour = [&](const std::string& name) { return file.colour(name + ".").has_value(); };
  const auto is_vector = [&](const std::string& name) { return file.vector(name + ".").has_value(); };
  const auto is_single = [&](const std::string& name) { return !file.single(name).empty(); };
  const auto is_depth = [&](const std::string& name) {  // not the third coordinate of X Y Z
    const std::string prefix = name.ends_with("Z") ? name.substr(0, name.size() - 1) : "";
    return is_single(name) && !(name == prefix + "Z" && file.has(prefix + "X") && file.has(prefix + "Y"));
  };
  const auto triple_in_file = [&](const std::string& name) { return layer_in_file((*file.vector(name + "."))[0]); };
  const auto single_in_file = [&](const std::string& name) { return file.single(name); };
  std::vector<std::string> albedo = keep(called(file, prefixes, kAlbedo), is_colour);
  if (albedo.empty()) albedo = keep(called(file, prefixes, kOtherAlbedo), is_colour);
  const auto colour_in_file = [&](const std::string& name) { return layer_in_file((*file.colour(name + "."))[0]); };
  choose(p, "albedo", albedo, colour_in_file,
         [&](const std::string& name) { add_vector(p, layer::albedo, file.colour(name + ".")); });
  choose(p, "normal", keep(called(file, prefixes, kNormal), is_vector), triple_in_file,
         [&](const std::string& name) { add_vector(p, layer::normal, file.vector(name + ".")); });
  choose(p, "depth", keep(called(file, prefixes, kDepth), is_depth), single_in_file,
         [&](const std::string& name) { add_depth(p, file.single(name)); });
  if (!p.color.variance)
    choose(p, "variance", keep(called(file, prefixes, kVariance), is_colour), colour_in_file,
           [&](const std::string& name) {
             p.color.variance = {.channels = listed(*file.colour(name + ".")), .meaning = VarianceMeaning::kUnstated};
           });
}

std::vector<ForeignFrame> common(const Channels& file, const ExrInfo& info) {
  std::vector<std::string> pictures, eyes;  // prefixes
  if (file.colour("")) pictures.push_back("");
  const auto find = [&](const std::set<std::string>& names) {
    for (const std::string& layer : file.layers("")) {
      const std::string last = plain(layer.substr(layer.rfind('.') + 1));
      if (!names.contains(last) || !file.colour(layer + ".")) continue;
      (last == "left" || last == "right" ? eyes : pictures).push_back(layer + ".");
    }
  };
  find(kColour);
  if (pictures.empty() && eyes.empty()) find(kOtherColour);
  std::vector<ForeignFrame> found;
  if (!pictures.empty()) {
    ForeignFrame& p = found.emplace_back(picture_of_colours(file, info, pictures[0], false));
    for (size_t i = 1; i < pictures.size(); ++i) p.alike.push_back(*file.colour(pictures[i]));
    add_lights(file, "", "C_", p, kNoLightGroups);  // Karma's, split by LPE tags
    add_lights(file, "", "VRayLightSelect_", p, kNoLightGroups);
  }
  if (pictures.empty() && eyes.empty() && file.colour("."))  // .R .G .B
    found.push_back(picture_of_colours(file, info, ".", false));
  for (const std::string& eye : eyes) found.push_back(picture_of_colours(file, info, eye, true));
  if (!found.empty()) return found;
  const std::set<std::string> layers = file.layers("");
  const bool colours = std::any_of(layers.begin(), layers.end(),
                                   [&](const std::string& layer) { return file.colour(layer + ".").has_value(); });
  if (!colours && file.has("X") && file.has("Y") && file.has("Z")) {
    ForeignFrame p{.renderer = "CIE XYZ colours",
                   .cie_xyz = true,
                   .target = {file.in_file("X"), file.in_file("Y"), file.in_file("Z")}};
    p.color = {.name = "XYZ", .channels = p.target};
    p.remarks.push_back(
        "X Y Z are taken for CIE XYZ colours; of positions or normals they are no picture (--map names one, docs/frames.md)");
    add_alpha(file, p, "");
    add_common_layers(file, {""}, p);
    p.samples = header_number(info, "samplesPerPixel");
    found.push_back(std::move(p));
    return found;
  }
  if (!colours && file.has("Y")) {
    const std::string& grey = file.in_file("Y");
    ForeignFrame p{.renderer = "a grey frame", .target = {grey, grey, grey}};
    p.color = {.name = shown(p.target), .channels = p.target};
    add_alpha(file, p, "");
    add_common_layers(file, {""}, p);
    found.push_back(std::move(p));
  }
  return found;
}

std::vector<ForeignFrame> only_colours(const Channels& file, const ExrInfo& info) {
  std::vector<std::string> candidates, of_media;
  for (const std::string& layer : file.layers("")) {
    const std::string name = plain(layer);
    const bool other = kAlbedo.contains(name) || kOtherAlbedo.contains(name) || kNormal.contains(name) ||
                       kDepth.contains(name) || kVariance.contains(name) || name.find("crypto") != std::string::npos ||
                       name.find("normal") != std::string::npos || name.find("position") != std::string::npos ||
                       name.find("motion") != std::string::npos || name == "p" || name == "uv" || name == "st";
    if (other || !file.colour(layer + ".")) continue;
    candidates.push_back(layer);
    if (std::any_of(kMedia.begin(), kMedia.end(),
                    [&](const char* word) { return name.find(word) != std::string::npos; }))
      of_media.push_back(layer);
  }
  if (of_media.size() == 1 || info.parts.size() < 2) candidates = of_media;
  if (candidates.size() != 1) return {};
  ForeignFrame p = picture_of_colours(file, info, candidates[0] + ".", false);
  p.remarks.push_back(
      fmt::format("{} is taken for the picture: it is the only layer of colours that could be one; "
                  "--map names another (docs/frames.md)",
                  p.color.name));
  return {p};
}

}  // namespace brume::recognition
