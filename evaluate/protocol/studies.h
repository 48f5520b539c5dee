#pragma once
#include "evaluate/protocol/protocol.h"
#include "evaluate/protocol/result_store.h"

namespace brume {

/// One input that a filter can do without: a feature, or a layer.
struct StudiedLayer {
  std::string name;
  bool is_feature;
  std::string label;  ///< of tables: a guide is one layer there, whether it is read as such or as a feature
};

/// What a filter with these settings reads of a frame beside the picture's own light and can be taken from it: the
/// features that it is given, and, where it reads them, each group of guides (guide.opacity, guide.single, ...).
std::vector<StudiedLayer> layers_to_study(const Contender& contender, const FilterSettings& settings,
                                          const Layers& frame, const Task& task);

/// How a filter is run without one of them, or with that one alone.
/// @param run  as it is run with all
FilterRun without_layer(const FilterRun& run, const std::vector<StudiedLayer>& all, size_t index);
FilterRun with_layer_alone(const FilterRun& run, const std::vector<StudiedLayer>& all, size_t index);

/// Settings that differ from some in one parameter, which takes each of its candidates and the value it has.
struct StudiedParameter {
  std::string name;
  std::vector<std::pair<std::string, FilterSettings>> values;  ///< in the candidates' order
};
std::vector<StudiedParameter> parameters_to_study(const Contender& contender, const FilterSettings& settings);

}  // namespace brume
