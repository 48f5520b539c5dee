#include "filters/inputs/guide_layers.h"

#include <map>

namespace brume {
namespace {

/// Whether `b` is `a` times a number, to the rounding of the numbers.
bool proportional(const ChannelView& a, const ChannelView& b) {
  double aa = 0, ab = 0, bb = 0;
  std::vector<float> room_a(static_cast<size_t>(a.width())), room_b(room_a.size());
  for (int y = 0; y < a.height(); ++y) {
    const float *const in_a = a.row(y, 0, a.width(), room_a.data()), *const in_b =
                                                                         b.row(y, 0, b.width(), room_b.data());
    for (int x = 0; x < a.width(); ++x) {
      const double u = static_cast<double>(in_a[x]), v = static_cast<double>(in_b[x]);
      aa += u * u;
      ab += u * v;
      bb += v * v;
    }
  }
  return aa > 0 ? ab * ab >= (1 - 1e-8) * aa * bb : bb == 0;
}

}  // namespace

bool is_only_fitted(std::string_view channel) {
  if (!is_guide(channel)) return false;
  const std::string_view name = channel.substr(kGuidePrefix.size());
  const GuideClass kind = guide_class(channel.substr(0, channel.rfind('.')));
  return kind == GuideClass::kSingle || kind == GuideClass::kMultiple ||
         (kind == GuideClass::kGeometry && !name.starts_with("depth") && !name.starts_with("normal"));
}

std::vector<Guide> guides_of(const Layers& frame) {
  std::map<std::string, std::map<char, ChannelView>> found;
  const auto find_in = [&](const auto& channels) {
    for (const auto& [channel, plane] : channels) {
      const size_t dot = channel.rfind('.');
      if (!is_guide(channel) || dot < kGuidePrefix.size() || dot + 2 != channel.size()) continue;
      found[channel.substr(kGuidePrefix.size(), dot - kGuidePrefix.size())].emplace(channel.back(), &plane);
    }
  };
  find_in(frame.channels());
  find_in(frame.stored());
  std::vector<Guide> guides;
  for (const auto& [name, channels] : found) {
    Guide guide{name, guide_class(std::string(kGuidePrefix) + name), false, {}};
    guide.coloured = channels.size() == 3 && channels.count('R') && channels.count('G') && channels.count('B');
    if (guide.coloured && guide.kind != GuideClass::kPredicted && proportional(channels.at('G'), channels.at('R')) &&
        proportional(channels.at('G'), channels.at('B'))) {
      guide.coloured = false;
      guide.channels = {channels.at('G')};
    } else if (guide.coloured)
      guide.channels = {channels.at('R'), channels.at('G'), channels.at('B')};
    else
      for (const auto& [letter, channel] : channels) guide.channels.push_back(channel);
    guides.push_back(std::move(guide));
  }
  return guides;
}

}  // namespace brume
