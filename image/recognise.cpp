// Which renderer wrote a file, by the names of its channels. docs/frames.md says where each name was found.

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <map>
#include <set>

#include "base/text.h"
#include "image/exr_views.h"
#include "image/foreign.h"

namespace brume {
namespace {

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

/// A layer's name as it is compared: without case, blanks, hyphens and underlines, and without the name of V-Ray before
/// it. "diffusealbedo" for "Diffuse Albedo", "zdepth" for "VRayZDepth".
std::string plain(const std::string& layer) {
  std::string text = lower(layer);
  std::erase_if(text, [](char c) { return c == ' ' || c == '-' || c == '_'; });
  return text.starts_with("vray") && text.size() > 4 ? text.substr(4) : text;
}

/// The channels of one view of a file, and what can be asked of them. A prefix is empty or ends with a dot. Channels
/// are looked up by the view's names and returned by the file's.
class Channels {
 public:
  explicit Channels(const ExrView& view) {
    for (const ExrView::Channel& c : view.channels) {
      in_file_[c.name] = c.in_file;
      if (c.type == "half") half_.insert(c.in_file);
    }
    // A frame has colours in place of luminance and chroma.
    for (const ExrView::Channel& c : view.channels) {
      if (!c.name.ends_with("RY")) continue;
      const std::string prefix = c.name.substr(0, c.name.size() - 2);
      if (!has(prefix + "Y") || !has(prefix + "BY") || has(prefix + "R")) continue;
      const std::string file_prefix = c.in_file.substr(0, c.in_file.size() - 2);
      for (const char* colour : {"R", "G", "B"}) {
        in_file_[prefix + colour] = file_prefix + colour;
        if (half_.contains(file_prefix + "Y")) half_.insert(file_prefix + colour);
      }
      for (const char* part : {"Y", "RY", "BY"}) in_file_.erase(prefix + part);
    }
  }
  explicit Channels(const ExrInfo& file) : Channels(whole(file)) {}

  bool has(const std::string& name) const { return in_file_.contains(name); }
  /// By the file's name.
  bool is_half(const std::string& in_file) const { return half_.contains(in_file); }
  const std::string& in_file(const std::string& name) const { return in_file_.at(name); }

  std::optional<ChannelTriple> colour(const std::string& prefix) const {
    return first_of(prefix, {{{"R", "G", "B"}}, {{"r", "g", "b"}}, {{"red", "green", "blue"}}});
  }
  std::optional<ChannelTriple> vector(const std::string& prefix) const {
    return first_of(prefix, {{{"X", "Y", "Z"}}, {{"x", "y", "z"}}, {{"R", "G", "B"}}, {{"r", "g", "b"}}});
  }
  /// A layer of one channel: of its name alone, or with any letter behind a dot.
  std::string single(const std::string& layer) const {
    if (has(layer)) return in_file(layer);
    const std::vector<std::string> inside = below(layer + ".");
    return inside.size() == 1 ? in_file(inside[0]) : "";
  }
  std::vector<std::string> below(const std::string& prefix) const {
    std::vector<std::string> names;
    for (const auto& [name, own] : in_file_)
      if (name.starts_with(prefix)) names.push_back(name);
    return names;
  }
  bool any(const auto& accepts) const {
    return std::any_of(in_file_.begin(), in_file_.end(), [&](const auto& c) { return accepts(c.first); });
  }
  /// What stands before `tail` in the names that end with it.
  std::vector<std::string> before(const std::string& tail) const {
    std::vector<std::string> prefixes;
    for (const auto& [name, own] : in_file_)
      if (name.ends_with(tail) && (name.size() == tail.size() || name[name.size() - tail.size() - 1] == '.'))
        prefixes.push_back(name.substr(0, name.size() - tail.size()));
    return prefixes;
  }
  /// Layers directly below a prefix, without dots: "albedo" for "left.albedo.R" below "left.".
  std::set<std::string> layers(const std::string& prefix) const {
    std::set<std::string> names;
    for (const std::string& name : below(prefix)) {
      const std::string rest = name.substr(prefix.size());
      const size_t dot = rest.rfind('.');
      names.insert(dot == std::string::npos ? rest : rest.substr(0, dot));
    }
    return names;
  }

 private:
  std::optional<ChannelTriple> first_of(const std::string& prefix, const std::vector<ChannelTriple>& endings) const {
    for (const ChannelTriple& e : endings)
      if (has(prefix + e[0]) && has(prefix + e[1]) && has(prefix + e[2]))
        return ChannelTriple{in_file(prefix + e[0]), in_file(prefix + e[1]), in_file(prefix + e[2])};
    return std::nullopt;
  }
  static ExrView whole(const ExrInfo& file) {
    ExrView all;
    for (const ExrInfo::Channel& c : file.channels) all.channels.push_back({c.name, c.name, c.type});
    return all;
  }

  std::map<std::string, std::string> in_file_;  // by the view's names
  std::set<std::string> half_;                  // of the file's names
};

std::vector<std::string> listed(const ChannelTriple& channels) {
  return {channels.begin(), channels.end()};
}

/// The layer that channels lie in; empty on top.
std::string layer_in_file(const std::string& channel) {
  const size_t dot = channel.rfind('.');
  return dot == std::string::npos ? "" : channel.substr(0, dot);
}

/// How a layer is told to a user.
std::string shown(const ChannelTriple& channels) {
  const std::string layer = layer_in_file(channels[0]);
  return !layer.empty() ? layer : channels[0] == channels[1] ? channels[0] : "RGB";
}

std::string without_dot(const std::string& prefix) {
  return prefix.ends_with(".") ? prefix.substr(0, prefix.size() - 1) : prefix;
}

/// A number in the header, as one or as text.
double header_number(const ExrInfo& file, const std::string& key) {
  const auto it = file.header.find(key);
  if (it == file.header.end()) return 0;
  if (const int* i = std::get_if<int>(&it->second)) return *i;
  if (const float* f = std::get_if<float>(&it->second)) return static_cast<double>(*f);
  const auto* text = std::get_if<std::string>(&it->second);
  double value = 0;
  if (text) std::from_chars(text->data(), text->data() + text->size(), value);
  return value;
}

void add_vector(ForeignFrame& picture, const LayerName& layer, const std::optional<ChannelTriple>& channels) {
  if (channels) picture.features.push_back({layer, listed(*channels)});
}

void add_depth(ForeignFrame& picture, const std::string& channel) {
  if (!channel.empty()) picture.features.push_back({layer::depth, {channel}});
}

void add_alpha(const Channels& file, ForeignFrame& picture, const std::string& prefix) {
  for (const char* name : {"A", "a", "alpha"})
    if (picture.alpha.empty() && file.has(prefix + name)) picture.alpha = file.in_file(prefix + name);
}

// --- Blender Cycles multilayer: VIEWLAYER.PASS.CHANNEL, the view layer's name being anything.

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

// --- pbrt-v4, G-buffer film.

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

// --- Mitsuba 3: the integrators aov and moment.

/// The second moment of a layer: of its colours, or of its CIE XYZ.
std::optional<ForeignVariance> mitsuba_moment(const Channels& file, const std::string& prefix) {
  const auto squares = file.colour("m2_" + prefix);
  if (squares && !prefix.empty())
    return ForeignVariance{.channels = listed(*squares), .meaning = VarianceMeaning::kSecondMoment};
  // Beside colours on top stands the moment of the integrator inside, of one name that the user chose.
  std::vector<std::string> inside;
  for (const std::string& name : file.before("X"))
    if (name.starts_with("m2_") && (prefix.empty() || name == "m2_" + prefix)) inside.push_back(name.substr(3));
  for (const std::string& layer : inside) {
    const auto xyz = file.vector(layer), moment = file.vector("m2_" + layer);
    // An integrator's name stands alone; those of its layers follow it.
    if (xyz && moment && std::count(layer.begin(), layer.end(), '.') == 1)
      return ForeignVariance{.channels = listed(*moment), .meaning = VarianceMeaning::kSecondMoment, .xyz = xyz};
  }
  return std::nullopt;
}

std::vector<ForeignFrame> mitsuba(const Channels& file, const ExrInfo& info) {
  const bool moments = file.any([](const std::string& name) { return name.starts_with("m2_"); });
  const std::vector<std::string> distances = file.before("T");
  if (!moments && distances.empty()) return {};
  std::vector<std::string> prefixes;
  if (file.colour("")) prefixes.push_back("");
  for (const std::string& prefix : file.before("A"))
    if (!prefix.empty() && !prefix.starts_with("m2_") && file.colour(prefix)) prefixes.push_back(prefix);
  std::vector<ForeignFrame> pictures;
  for (const std::string& prefix : prefixes) {
    ForeignFrame p{.renderer = "Mitsuba 3", .view = without_dot(prefix), .target = *file.colour(prefix)};
    p.color = {.name = prefix.empty() ? "RGB" : without_dot(prefix), .channels = p.target};
    p.color.variance = mitsuba_moment(file, prefix);
    add_alpha(file, p, prefix);
    if (distances.size() == 1) add_depth(p, distances[0] + "T");
    for (const char* name : {"samplesPerPixel", "spp", "sample_count"})
      if (p.samples <= 0) p.samples = header_number(info, name);
    pictures.push_back(std::move(p));
  }
  return pictures;
}

// --- RenderMan: statistics by suffixes, `_mse` being the variance of the mean.

std::optional<ForeignVariance> renderman_variance(const Channels& file, const std::string& layer, bool vector) {
  const auto channels = [&](const std::string& name) {
    return vector ? file.vector(name + ".") : file.colour(name + ".");
  };
  const bool beauty = layer == "Ci";
  for (const std::string& name : beauty ? std::vector<std::string>{"Ci_mse", "mse"} : std::vector{layer + "_mse"})
    if (const auto mse = channels(name))
      return ForeignVariance{.channels = listed(*mse), .meaning = VarianceMeaning::kOfMean};
  for (const std::string& name : beauty ? std::vector<std::string>{"Ci_var", "variance"} : std::vector{layer + "_var"})
    if (const auto var = channels(name))
      return ForeignVariance{.channels = listed(*var), .meaning = VarianceMeaning::kOfSamples};
  return std::nullopt;
}

void add_renderman_statistics(const Channels& file, const std::string& layer, ForeignSignal& signal) {
  signal.variance = renderman_variance(file, layer, false);
  const auto even = file.colour(layer + "_even."), odd = file.colour(layer + "_odd.");
  if (even && odd) signal.halves = {*even, *odd};
}

std::vector<ForeignFrame> renderman(const Channels& file, const ExrInfo& info) {
  const bool typical = file.any([](const std::string& name) {
    const std::string layer = name.substr(0, name.rfind('.'));
    return layer == "mse" || layer == "sampleCount" || layer.ends_with("_mse") || layer.ends_with("_var") ||
           layer.ends_with("_even");
  });
  const auto ci = file.colour("Ci."), top = file.colour("");
  if (!(ci || top) || !(ci || typical)) return {};
  ForeignFrame p{.renderer = "RenderMan", .target = ci ? *ci : *top};
  if (ci && top) p.alike.push_back(*top);
  p.color = {.name = ci ? "Ci" : "RGB", .channels = p.target};
  add_renderman_statistics(file, "Ci", p.color);
  for (const char* name : {"diffuse", "specular"})
    if (const auto channels = file.colour(name + std::string("."))) {
      ForeignSignal& pass = p.passes.emplace_back(ForeignSignal{.name = name, .channels = *channels});
      add_renderman_statistics(file, name, pass);
    }
  add_alpha(file, p, ci ? "Ci." : "");
  if (p.alpha.empty()) p.alpha = file.single("a");
  if (const auto albedo = file.colour("albedo."))
    p.features.push_back({layer::albedo, listed(*albedo), renderman_variance(file, "albedo", false)});
  if (const auto normal = file.vector("normal."))
    p.features.push_back({layer::normal, listed(*normal), renderman_variance(file, "normal", true)});
  add_depth(p, file.single("zfiltered"));
  p.sample_count = file.single("sampleCount");
  p.samples = header_number(info, "samplesPerPixel");
  return {p};
}

// --- Arnold with the denoiser's layers.

std::vector<ForeignFrame> arnold(const Channels& file, const ExrInfo&) {
  const auto colour = file.colour("").has_value() ? file.colour("") : file.colour("RGBA.");
  std::optional<ChannelTriple> variance;
  for (const char* name : {"variance.", "RGBA_variance."})
    if (!variance) variance = file.colour(name);
  const bool media = file.colour("volume_direct.") && file.colour("volume_indirect.");
  if (!colour || !(variance || media || file.colour("denoise_albedo."))) return {};
  ForeignFrame p{.renderer = "Arnold", .target = *colour};
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

// --- Brume's own: what docs/methods.md calls them.

ForeignSignal brume_signal(const Channels& file, const LayerName& layer) {
  const auto named = [&](std::string_view statistic) {
    return ChannelTriple{layer.channel_of(statistic, 0), layer.channel_of(statistic, 1),
                         layer.channel_of(statistic, 2)};
  };
  ForeignSignal signal{.name = layer.label(), .channels = named(""), .indirect = layer == layer::indirect};
  const auto there = [&](const ChannelTriple& c) { return file.has(c[0]) && file.has(c[1]) && file.has(c[2]); };
  if (there(named(statistic::mean_variance)))
    signal.variance = {.channels = listed(named(statistic::mean_variance)), .meaning = VarianceMeaning::kOfMean};
  if (there(named(statistic::half_a)) && there(named(statistic::half_b)))
    signal.halves = {named(statistic::half_a), named(statistic::half_b)};
  return signal;
}

std::vector<ForeignFrame> brume_frame(const Channels& file, const ExrInfo& info) {
  if (!is_brume_frame(info) || !file.colour("")) return {};
  ForeignFrame p{.renderer = "a frame by brume", .of_brume = true, .target = *file.colour("")};
  p.color = brume_signal(file, layer::beauty);
  if (file.colour("direct.") && file.colour("indirect."))
    p.passes = {brume_signal(file, layer::direct), brume_signal(file, layer::indirect)};
  add_alpha(file, p, "");
  p.sample_count = file.single("sample_count");
  p.samples = header_number(info, "samplesPerPixel");
  return {p};
}

// --- Anything else with a colour and layers of common names.

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
const std::set<std::string> kVariance = {"variance", "rgbavariance", "colorvariance"};

void add_common_layers(const Channels& file, const std::set<std::string>& prefixes, ForeignFrame& p) {
  const auto keep = [](std::vector<std::string> names, const auto& accepts) {
    std::erase_if(names, [&](const std::string& name) { return !accepts(name); });
    return names;
  };
  const auto is_colour = [&](const std::string& name) { return file.colour(name + ".").has_value(); };
  const auto is_vector = [&](const std::string& name) { return file.vector(name + ".").has_value(); };
  const auto is_single = [&](const std::string& name) { return !file.single(name).empty(); };
  const auto triple_in_file = [&](const std::string& name) { return layer_in_file((*file.vector(name + "."))[0]); };
  const auto single_in_file = [&](const std::string& name) { return file.single(name); };
  std::vector<std::string> albedo = keep(called(file, prefixes, kAlbedo), is_colour);
  if (albedo.empty()) albedo = keep(called(file, prefixes, kOtherAlbedo), is_colour);
  const auto colour_in_file = [&](const std::string& name) { return layer_in_file((*file.colour(name + "."))[0]); };
  choose(p, "albedo", albedo, colour_in_file,
         [&](const std::string& name) { add_vector(p, layer::albedo, file.colour(name + ".")); });
  choose(p, "normal", keep(called(file, prefixes, kNormal), is_vector), triple_in_file,
         [&](const std::string& name) { add_vector(p, layer::normal, file.vector(name + ".")); });
  choose(p, "depth", keep(called(file, prefixes, kDepth), is_single), single_in_file,
         [&](const std::string& name) { add_depth(p, file.single(name)); });
  if (!p.color.variance)
    choose(p, "variance", keep(called(file, prefixes, kVariance), is_colour), colour_in_file,
           [&](const std::string& name) {
             p.color.variance = {.channels = listed(*file.colour(name + ".")), .meaning = VarianceMeaning::kUnstated};
           });
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
  }
  for (const std::string& eye : eyes) found.push_back(picture_of_colours(file, info, eye, true));
  if (!found.empty()) return found;
  const std::set<std::string> layers = file.layers("");
  const bool colours = std::any_of(layers.begin(), layers.end(),
                                   [&](const std::string& layer) { return file.colour(layer + ".").has_value(); });
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

/// Of a file whose parts have names that say nothing: the only one whose colours have no other role.
std::vector<ForeignFrame> only_unnamed_part(const Channels& file, const ExrInfo& info) {
  std::vector<std::string> candidates;
  for (const std::string& layer : file.layers("")) {
    const std::string name = plain(layer);
    const bool other = kAlbedo.contains(name) || kOtherAlbedo.contains(name) || kNormal.contains(name) ||
                       kDepth.contains(name) || kVariance.contains(name) || name.find("crypto") != std::string::npos ||
                       name.find("normal") != std::string::npos || name.find("position") != std::string::npos ||
                       name.find("motion") != std::string::npos || name == "p" || name == "uv" || name == "st";
    if (!other && file.colour(layer + ".")) candidates.push_back(layer);
  }
  if (candidates.size() != 1) return {};
  ForeignFrame p = picture_of_colours(file, info, candidates[0] + ".", false);
  p.remarks.push_back(
      fmt::format("{} is taken for the picture: of the parts it is the only one of colours whose name "
                  "says nothing else; --map names another (docs/frames.md)",
                  p.color.name));
  return {p};
}

void remark_on_types(const Channels& file, ForeignFrame& picture) {
  const auto check = [&](const std::optional<ForeignVariance>& variance, const std::string& name) {
    if (variance && std::any_of(variance->channels.begin(), variance->channels.end(),
                                [&](const std::string& c) { return file.is_half(c); }))
      picture.remarks.push_back(fmt::format(
          "the variance of {} is stored in 16 bits, which hold nothing below 6e-8 or above 65504: write statistics in 32 bits",
          name));
  };
  check(picture.color.variance, picture.color.name);
  for (const ForeignSignal& pass : picture.passes) check(pass.variance, pass.name);
}

}  // namespace

bool is_brume_frame(const ExrInfo& file) {
  const auto software = file.header.find("software");
  if (software != file.header.end() && software->second == Attribute(std::string("brume"))) return true;
  const Channels channels(file);
  return (channels.colour("direct.") && channels.colour("indirect.") && channels.colour("") &&
          !channels.colour("variance.")) ||
         channels.any([](const std::string& name) { return name.find("mean_variance.") != std::string::npos; });
}

namespace {

std::vector<ForeignFrame> recognise_view(const Channels& channels, const ExrInfo& file, bool whole) {
  if (whole)
    if (std::vector<ForeignFrame> own = brume_frame(channels, file); !own.empty()) return own;
  for (const auto& renderer : {cycles, pbrt, mitsuba, arnold, renderman, common}) {
    std::vector<ForeignFrame> pictures = renderer(channels, file);
    if (pictures.empty()) continue;
    if (renderer == mitsuba)
      for (ForeignFrame& picture : pictures) add_common_layers(channels, {""}, picture);
    return pictures;
  }
  return {};
}

}  // namespace

std::vector<ForeignFrame> recognise(const ExrInfo& file) {
  const std::vector<ExrView> views = views_of(file);
  const bool one = views.size() == 1;
  std::vector<ForeignFrame> all;
  const auto add = [&](const auto& pictures_in) {
    for (const ExrView& view : views) {
      const Channels channels(view);
      std::vector<ForeignFrame> pictures = pictures_in(channels);
      for (ForeignFrame& p : pictures) {
        remark_on_types(channels, p);
        p.one_of_views = !one;
        if (!view.name.empty()) p.view = p.view.empty() ? view.name : p.view + " " + view.name;
        all.push_back(std::move(p));
      }
    }
  };
  add([&](const Channels& c) { return recognise_view(c, file, one && file.parts.size() < 2); });
  if (all.empty() && file.parts.size() > 1) add([&](const Channels& c) { return only_unnamed_part(c, file); });
  return all;
}

}  // namespace brume
