#pragma once
#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "image/exr_views.h"
#include "image/foreign.h"

// What the files share that know the names of one renderer each. docs/frames.md says where each name was found.

namespace brume::recognition {

/// A layer's name as it is compared: without case, blanks, hyphens and underlines, and without the name of V-Ray before
/// it. "diffusealbedo" for "Diffuse Albedo", "zdepth" for "VRayZDepth".
std::string plain(const std::string& layer);

/// The channels of one view of a file, and what can be asked of them. A prefix is empty or ends with a dot. Channels
/// are looked up by the view's names and returned by the file's.
class Channels {
 public:
  explicit Channels(const ExrView& view);
  explicit Channels(const ExrInfo& file);

  bool has(const std::string& name) const { return in_file_.contains(name); }
  /// By the file's name.
  bool is_half(const std::string& in_file) const { return half_.contains(in_file); }
  const std::string& in_file(const std::string& name) const { return in_file_.at(name); }

  std::optional<ChannelTriple> colour(const std::string& prefix) const;
  std::optional<ChannelTriple> vector(const std::string& prefix) const;
  /// A layer of one channel: of its name alone, or with any letter behind a dot.
  std::string single(const std::string& layer) const;
  std::vector<std::string> below(const std::string& prefix) const;
  bool any(const auto& accepts) const {
    return std::any_of(in_file_.begin(), in_file_.end(), [&](const auto& c) { return accepts(c.first); });
  }
  /// What stands before `tail` in the names that end with it.
  std::vector<std::string> before(const std::string& tail) const;
  /// Layers directly below a prefix, without dots: "albedo" for "left.albedo.R" below "left.".
  std::set<std::string> layers(const std::string& prefix) const;

 private:
  std::optional<ChannelTriple> first_of(const std::string& prefix, const std::vector<ChannelTriple>& endings) const;

  std::map<std::string, std::string> in_file_;  // by the view's names
  std::set<std::string> half_;                  // of the file's names
};

std::vector<std::string> listed(const ChannelTriple& channels);
/// The layer that channels lie in; empty on top.
std::string layer_in_file(const std::string& channel);
std::string without_dot(const std::string& prefix);
/// A number in the header, as one or as text.
double header_number(const ExrInfo& file, const std::string& key);

void add_vector(ForeignFrame& picture, const LayerName& layer, const std::optional<ChannelTriple>& channels);
void add_depth(ForeignFrame& picture, const std::string& channel);
/// Light groups: layers of colours below a view whose names begin with `prefix`, the group's name behind it.
/// @param others  what may stand behind it and is no light group
void add_lights(const Channels& file, const std::string& view, const std::string& prefix, ForeignFrame& picture,
                const std::set<std::string>& others = {});
/// What renderers call pictures beside one that are no light groups: "RGBA_variance".
inline const std::set<std::string> kNoLightGroups = {
    "variance", "var",    "mse",      "denoised", "denoise", "albedo",     "unshadowed", "even",     "odd",
    "normal",   "depth",  "position", "motion",   "direct",  "indirect",   "diffuse",    "specular", "transmission",
    "emission", "volume", "sss",      "coat",     "sheen",   "background", "shadow"};
void add_alpha(const Channels& file, ForeignFrame& picture, const std::string& prefix);
/// Features and variance by names that many renderers give them.
void add_common_layers(const Channels& file, const std::set<std::string>& prefixes, ForeignFrame& picture);

// The pictures in a view of a file; none where another renderer wrote it.

/// Blender Cycles multilayer: VIEWLAYER.PASS.CHANNEL, the view layer's name being anything.
std::vector<ForeignFrame> cycles(const Channels& file, const ExrInfo& info);
/// pbrt-v4, G-buffer film.
std::vector<ForeignFrame> pbrt(const Channels& file, const ExrInfo& info);
/// Mitsuba 3: the integrators aov and moment.
std::vector<ForeignFrame> mitsuba(const Channels& file, const ExrInfo& info);
/// RenderMan: statistics by suffixes, `_mse` being the variance of the mean.
std::vector<ForeignFrame> renderman(const Channels& file, const ExrInfo& info);
/// Arnold with the denoiser's layers.
std::vector<ForeignFrame> arnold(const Channels& file, const ExrInfo& info);
/// Brume's own: what docs/methods.md calls them.
std::vector<ForeignFrame> brume_frame(const Channels& file, const ExrInfo& info);
/// Anything else with a colour and layers of common names.
std::vector<ForeignFrame> common(const Channels& file, const ExrInfo& info);
/// A medium's pass alone; else, of parts whose names say nothing, the only one whose colours have no other role.
std::vector<ForeignFrame> only_colours(const Channels& file, const ExrInfo& info);

}  // namespace brume::recognition
