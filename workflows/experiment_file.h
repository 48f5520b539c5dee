#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "evaluate/protocol/external_filter.h"
#include "evaluate/protocol/settings.h"

namespace brume {

/// A scene of an experiment.
struct ExperimentScene {
  std::filesystem::path file;
  std::string name;              ///< empty: the scene's own
  std::vector<std::string> set;  ///< "camera.fov=30"
};

/// A filter of an experiment: one of brume's, or a command.
struct ExperimentFilter {
  std::string filter, parameters, label;
  std::vector<std::string> features;
  bool guides = true;
  double time_limit = 0;
  bool study = true;
  std::string command;              ///< empty: `filter` is one of brume's
  std::vector<std::string> layers;  ///< that the command reads beside the colour
  bool statistics = false;
  double memory_limit = 0;  ///< GB; 0: none
  std::vector<std::filesystem::path> depends;
  std::filesystem::path folder;  ///< of the experiment's file, where the command runs

  /// One of brume's as the command line names it: "NAME" or "NAME:parameter=value,...".
  static ExperimentFilter of(const std::string& text);
};

/// The layers that filters which are not brume's can ask for, beside "guides".
std::vector<LayerName> layers_to_ask_for();

/// A command of an experiment as a filter. @throws InputError
ExternalFilter filter_of_command(const ExperimentFilter& filter);

/// Frames of another renderer.
struct ExperimentFrames {
  std::string name;
  std::filesystem::path reference, second_reference;
  std::vector<std::filesystem::path> noisy;
  int spp = 1;
  double exposure = 0;
};

/// Frames of a moving scene, one after another.
struct ExperimentSequence {
  std::filesystem::path file;
  std::string name;              ///< empty: the scene's own
  std::string frames;            ///< "1-16"
  std::vector<std::string> set;  ///< as of a scene
};

/// What brume evaluate is to do, as a file says it or the command line.
struct Experiment : ExperimentSettings {
  int size = 0;
  std::string component = "indirect", background = "default";
  std::vector<ExperimentScene> scenes;
  std::vector<ExperimentFilter> filters;
  std::vector<ExperimentFrames> frames;
  std::vector<ExperimentSequence> sequences;
};

/// Whether a file is an experiment rather than a scene: TOML with scenes, frames or sequences.
bool is_experiment(const std::filesystem::path& path);

/// @throws InputError: no TOML, unknown keys (the nearest one), values out of range, missing files
Experiment read_experiment(const std::filesystem::path& path);

/// An experiment from its file, or of scene files at the defaults.
/// @throws InputError: as read_experiment; an experiment among other files
Experiment open_experiment(const std::vector<std::filesystem::path>& files);

/// docs/experiment.md: every table and key, from the declarations that parse them.
std::string experiment_reference();

}  // namespace brume
