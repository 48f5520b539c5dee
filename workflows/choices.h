#pragma once
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/text.h"
#include "filters/run/apply.h"

namespace brume {

/// What an option may say, and what each word stands for.
template <class Value>
struct Choices {
  std::string option;
  std::vector<std::pair<std::string, Value>> choices;

  std::vector<std::string> names() const {
    std::vector<std::string> names;
    for (const auto& [name, value] : choices) names.push_back(name);
    return names;
  }
  /// @throws InputError naming the choices
  Value of(const std::string& text) const {
    for (const auto& [name, value] : choices)
      if (name == text) return value;
    throw InputError(option + " '" + text + "': expected one of " + join(names()));
  }
};

inline const Choices<Component> kComponents{
    "component", {{"all", Component::kAll}, {"indirect", Component::kIndirect}, {"separate", Component::kSeparate}}};
inline const Choices<BackgroundRule> kBackgrounds{"background",
                                                  {{"default", BackgroundRule::kDefault},
                                                   {"bilateral", BackgroundRule::kBilateral},
                                                   {"filter", BackgroundRule::kFilter}}};
inline const Choices<NoiseSource> kNoiseSources{"noise",
                                                {{"layers", NoiseSource::kLayers}, {"spatial", NoiseSource::kSpatial}}};
inline const Choices<Outliers> kOutlierRules{"outliers",
                                             {{"extreme", Outliers::kExtreme},
                                              {"clamp", Outliers::kClamp},
                                              {"redistribute", Outliers::kRedistribute},
                                              {"keep", Outliers::kKeep}}};
inline const Choices<LayerName> kColourLayers{"carry",
                                              {{"direct", layer::direct},
                                               {"indirect", layer::indirect},
                                               {"background", layer::background},
                                               {"emission", layer::emission},
                                               {"single", layer::single},
                                               {"surface", layer::surface},
                                               {"catcher", layer::catcher},
                                               {"catcher_unshadowed", layer::catcher_unshadowed}}};

}  // namespace brume
