#include "filters/guide_layers.h"

#include <map>

namespace brume {
namespace {

GuideClass kind_of(std::string_view name) {
  const std::string_view first = name.substr(0, name.find('.'));
  if (first == "opacity") return GuideClass::kOpacity;
  if (first == "single") return GuideClass::kSingle;
  if (first == "multiple") return GuideClass::kMultiple;
  if (first == "emission") return GuideClass::kEmission;
  if (first == "background") return GuideClass::kBackground;
  if (first == "surface") return GuideClass::kSurface;
  return GuideClass::kGeometry;
}

}  // namespace

std::vector<Guide> guides_of(const Layers& frame) {
  std::map<std::string, std::map<char, const Plane*>> found;
  for (const auto& [channel, plane] : frame.channels()) {
    const size_t dot = channel.rfind('.');
    if (!is_guide(channel) || dot < kGuidePrefix.size() || dot + 2 != channel.size()) continue;
    found[channel.substr(kGuidePrefix.size(), dot - kGuidePrefix.size())][channel.back()] = &plane;
  }
  std::vector<Guide> guides;
  for (const auto& [name, channels] : found) {
    Guide guide{name, kind_of(name), false, {}};
    guide.coloured = channels.size() == 3 && channels.count('R') && channels.count('G') && channels.count('B');
    if (guide.coloured)
      guide.channels = {channels.at('R'), channels.at('G'), channels.at('B')};
    else
      for (const auto& [letter, plane] : channels) guide.channels.push_back(plane);
    guides.push_back(std::move(guide));
  }
  return guides;
}

}  // namespace brume
