#include "workflows/frame_lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "base/error.h"
#include "image/light_layers.h"
#include "workflows/frame.h"
#include "workflows/open_frame.h"

namespace brume {
namespace {

ChannelTriple colours_of(const std::string& layer) {
  const std::string prefix = layer.empty() ? "" : layer + ".";
  return {prefix + "R", prefix + "G", prefix + "B"};
}

bool has_all(const Layers& frame, const ChannelTriple& channels) {
  return std::all_of(channels.begin(), channels.end(), [&](const std::string& c) { return frame.find(c) != nullptr; });
}

Layers mix_foreign(const Layers& frame, const ForeignFrame& picture, const FrameLights& lights, const LightMix& mix) {
  Layers mixed = frame.without_channels();
  std::set<std::string> left_out;
  for (const std::string& channel : picture.channels()) left_out.insert(channel);
  for (const std::string& kept : {picture.alpha, picture.sample_count}) left_out.erase(kept);
  for (const ForeignFeature& feature : picture.features)
    for (const std::string& channel : feature.channels) left_out.erase(channel);
  for (const auto& [name, plane] : frame.channels())
    if (!left_out.contains(name)) mixed.set(name, plane);
  const auto plane_of = [&](const std::string& channel) -> const Plane& { return frame.at(channel); };
  for (size_t c = 0; c < 3; ++c) {
    Plane sum = lights.mixed(mix, c, plane_of);
    mixed.set(layer::beauty.channel(c), sum);
    mixed.set(lights.picture[c], std::move(sum));
    for (const FrameLights::Group& group : lights.groups) {
      // A group by itself is a picture that is the whole of one group.
      const FrameLights alone{group.channels, {group}, true};
      mixed.set(group.channels[c], alone.mixed(mix, c, plane_of));
    }
  }
  mixed.header["lightMix"] = text_of_mix(mix);
  return mixed;
}

}  // namespace

std::vector<std::string> FrameLights::names() const {
  std::vector<std::string> all;
  for (const Group& group : groups) all.push_back(group.name);
  return all;
}

std::optional<ForeignFrame> picture_in(const ExrInfo& file, const std::filesystem::path& map) {
  if (map.empty() && is_brume_frame(file)) return std::nullopt;
  std::vector<ForeignFrame> pictures = map.empty() ? recognise(file) : read_map(map, file);
  if (pictures.empty()) return std::nullopt;
  return std::move(pictures.front());
}

std::vector<FrameLights> lights_in(const ExrInfo& file, const std::optional<ForeignFrame>& foreign) {
  if (foreign) {
    FrameLights lights{foreign->target, {}, false};
    for (const ForeignSignal& light : foreign->lights) lights.groups.push_back({light.group, light.channels});
    return lights.groups.empty() ? std::vector<FrameLights>() : std::vector{lights};
  }
  Layers outline(1, 1);
  for (const ExrInfo::Channel& channel : file.channels) outline.add(channel.name);
  std::vector<FrameLights> all;
  const std::vector<std::string> groups = light_groups_in(outline);
  const auto add = [&](const std::string& picture, const auto& layer_of) {
    FrameLights lights{colours_of(picture), {}, true};
    bool complete = !groups.empty() && has_all(outline, lights.picture);
    for (const std::string& group : groups) {
      lights.groups.push_back({group, colours_of(layer_of(group))});
      complete = complete && has_all(outline, lights.groups.back().channels);
    }
    if (complete) all.push_back(std::move(lights));
  };
  // A picture that is clean with groups that are not has the noisy one beside it, which they add up to.
  add("", [](const std::string& group) { return clean_light_layer(group); });
  add(has_all(outline, colours_of("noisy")) ? "noisy" : "",
      [](const std::string& group) { return light_layer(group); });
  return all;
}

Layers mixed_frame(const ExrFile& file, const std::filesystem::path& map, const LightMix& mix, const Host& host) {
  const std::optional<ForeignFrame> foreign = picture_in(file.info(), map);
  const std::vector<FrameLights> lights = lights_in(file.info(), foreign);
  if (!foreign || lights.empty()) return mix_lights(read_frame(file, host), mix);
  check_light_groups(mix, lights[0].names(), "the frame");
  return mix_foreign(file.read(), *foreign, lights[0], mix);
}

Layers mixed_frame(const Layers& frame, const LightMix& mix) {
  if (!light_groups_in(frame).empty()) return mix_lights(frame, mix);
  ExrInfo info;
  info.header = frame.header;
  for (const std::string& name : frame.names()) info.channels.push_back({name, "float", frame.data_window()});
  const std::optional<ForeignFrame> foreign = picture_in(info, {});
  const std::vector<FrameLights> lights = lights_in(info, foreign);
  if (!foreign || lights.empty()) return mix_lights(frame, mix);
  check_light_groups(mix, lights[0].names(), "the frame");
  return mix_foreign(frame, *foreign, lights[0], mix);
}

}  // namespace brume
