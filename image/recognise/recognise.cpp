// Which renderer wrote a file, by the names of its channels.

#include <fmt/format.h>

#include <set>
#include <string_view>

#include "base/text.h"
#include "image/recognise/channels.h"

namespace brume {
namespace {

using namespace recognition;

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

/// Names that programs put light groups under, or that users choose, with the group's name behind: no renderer writes
/// them by itself, so what they hold is for a map to say.
bool may_be_light_group(const std::string& layer) {
  const std::string name = lower(layer);
  for (const std::string_view before : {"beauty", "rgba", "rgb", "ci", "light", "lights", "lightgroup", "light_group",
                                        "lightselect", "light_select", "light_pass", "light_id", "lg", "lpe"}) {
    if (!name.starts_with(before) || name.size() < before.size() + 2) continue;
    const std::string_view rest = std::string_view(name).substr(before.size());
    if (std::string_view("_- ").find(rest[0]) != std::string_view::npos &&
        !kNoLightGroups.contains(std::string(rest.substr(1))))
      return true;
  }
  return false;
}

void remark_on_lights(const Channels& file, ForeignFrame& picture) {
  if (!picture.lights.empty()) return;
  std::set<std::string> used;
  const auto use = [&](const ChannelTriple& channels) { used.insert(channels[0]); };
  const auto use_signal = [&](const ForeignSignal& signal) {
    use(signal.channels);
    if (signal.variance) used.insert(signal.variance->channels[0]);
    if (signal.halves)
      for (const ChannelTriple& half : *signal.halves) use(half);
  };
  use(picture.target);
  for (const ChannelTriple& other : picture.alike) use(other);
  use_signal(picture.color);
  for (const ForeignSignal& pass : picture.passes) use_signal(pass);
  std::vector<std::string> names;
  for (const std::string& layer : file.layers("")) {
    const auto channels = file.colour(layer + ".");
    if (channels && !used.contains((*channels)[0]) && may_be_light_group(layer))
      names.push_back(fmt::format("\"{}\"", layer_in_file((*channels)[0])));
  }
  if (names.empty()) return;
  picture.remarks.push_back(fmt::format(
      "{} may be light groups, and stay as they are; cleaned, to add up to the clean picture, they are with a mapping "
      "file: lights = [{}] (--map, docs/frames.md)",
      join(names), join(names)));
}

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

bool is_brume_frame(const ExrInfo& file) {
  const auto software = file.header.find("software");
  if (software != file.header.end() && software->second == Attribute(std::string("brume"))) return true;
  const Channels channels(file);
  return (channels.colour("direct.") && channels.colour("indirect.") && channels.colour("") &&
          !channels.colour("variance.")) ||
         channels.any([](const std::string& name) { return name.find("mean_variance.") != std::string::npos; });
}

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
        if (!p.of_brume) remark_on_lights(channels, p);
        p.one_of_views = !one;
        if (!view.name.empty()) p.view = p.view.empty() ? view.name : p.view + " " + view.name;
        all.push_back(std::move(p));
      }
    }
  };
  add([&](const Channels& c) { return recognise_view(c, file, one && file.parts.size() < 2); });
  if (all.empty()) add([&](const Channels& c) { return only_colours(c, file); });
  return all;
}

}  // namespace brume
