#include "image/foreign.h"

#include <fmt/format.h>

namespace brume {
namespace {

// The prefix "LAYER." of the first channel named "LAYER.Combined.R"; layer names may hold dots and spaces.
std::string cycles_prefix(const Layers& layers) {
  static const std::string tail = "Combined.R";
  for (const auto& [name, plane] : layers.channels())
    if (name.ends_with("." + tail)) return name.substr(0, name.size() - tail.size());
  return "";
}

}  // namespace

std::string adopt_foreign_layers(Layers& layers) {
  if (layers.has(layer::beauty)) return "";
  const std::string prefix = cycles_prefix(layers);
  if (prefix.empty()) return "";
  const char rgb[] = {'R', 'G', 'B'};
  bool split = true;
  for (size_t c = 0; c < 3; ++c) {
    const Plane* combined = layers.find(fmt::format("{}Combined.{}", prefix, rgb[c]));
    if (!combined) return "";
    const Plane* indirect = layers.find(fmt::format("{}VolumeInd.{}", prefix, rgb[c]));
    if (indirect) {
      Plane direct = *combined;
      for (int y = 0; y < direct.height(); ++y)
        for (int x = 0; x < direct.width(); ++x) direct(x, y) -= (*indirect)(x, y);
      layers.set(layer::direct.channel(c), std::move(direct));
      layers.set(layer::indirect.channel(c), *indirect);
    }
    split = split && indirect;
    layers.set(layer::beauty.channel(c), *combined);
  }
  if (const Plane* alpha = layers.find(prefix + "Combined.A")) layers.set(layer::alpha.channel(0), *alpha);
  return fmt::format("read as Blender Cycles multilayer '{}': Combined{}", prefix.substr(0, prefix.size() - 1),
                     split ? ", VolumeInd as indirect, the rest as direct" : " only; no VolumeInd pass to split off");
}

}  // namespace brume
