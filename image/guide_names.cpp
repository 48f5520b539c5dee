#include "image/guide_names.h"

#include <algorithm>

namespace brume {
namespace {

constexpr std::string_view kLight = "LIGHT";

std::string_view first_word(std::string_view layer) {
  layer.remove_prefix(std::min(layer.size(), kGuidePrefix.size()));
  return layer.substr(0, layer.find('.'));
}

}  // namespace

std::pair<const GuideName*, std::string> find_guide(std::string_view layer) {
  // The longest name that fits: "_tail_half" before "_half".
  const GuideName* found = nullptr;
  std::string_view light;
  for (const GuideName& guide : kGuideNames) {
    if (guide.name == layer) return {&guide, std::string(guide.meaning)};
    const size_t at = guide.name.find(kLight);
    if (at == std::string_view::npos || (found && found->name.size() > guide.name.size())) continue;
    const std::string_view before = guide.name.substr(0, at), after = guide.name.substr(at + kLight.size());
    if (layer.size() <= before.size() + after.size() || !layer.starts_with(before) || !layer.ends_with(after)) continue;
    found = &guide;
    light = layer.substr(at, layer.size() - before.size() - after.size());
  }
  if (!found) return {nullptr, ""};
  std::string meaning(found->meaning), name(light);
  std::replace(name.begin(), name.end(), '_', ' ');
  if (const size_t at = meaning.find(kLight); at != std::string::npos) meaning.replace(at, kLight.size(), name);
  return {found, meaning};
}

GuideClass guide_class(std::string_view layer) {
  for (const GuideName& guide : kGuideNames)
    if (first_word(guide.name) == first_word(layer)) return guide.kind;
  return GuideClass::kGeometry;
}

}  // namespace brume
