#pragma once
#include <string>
#include <vector>

#include "evaluate/protocol/tuning.h"

namespace brume {

/// Who made the numbers, for every table and picture.
struct Provenance {
  std::string version, commit, command;
  std::string processor;
  int threads = 0;  ///< that rendered and filtered
};

/// What is rendered, searched and studied: what an experiment says, key by key.
struct ExperimentSettings {
  std::string name, text;  ///< of the experiment, and of its file
  std::vector<int> spp = {16, 36, 64};
  int seeds = 5;
  int reference_spp = 4096;  ///< of each of the two references
  /// Share of the best method's error to which the noise of the mean of the references is brought by doubling their
  /// samples, up to most_reference_spp; 0: they stay as they are.
  double reference_noise = 0;
  int most_reference_spp = 1 << 16;
  bool tune = true;
  int restarts = 2;         ///< of searches in large spaces, from random places
  double time_limit = 0;    ///< seconds of a filter on a frame, after which it has failed; 0: none
  bool time_layers = true;  ///< methods that read few layers are charged for a render that records only these
  bool ablation = false, sensitivity = false;
  std::vector<int> study_spp;        ///< of these two; empty: the one in the middle
  std::vector<std::string> metrics;  ///< ids to report; empty: all
};

/// The same with all that decides how it is run.
struct EvaluationSettings : ExperimentSettings {
  std::vector<Contender> contenders;
  BackgroundRule background = BackgroundRule::kDefault;
  Component component = Component::kIndirect;
  bool all_layers = false;  ///< frames hold what any filter may read, so that a new one needs no new frames
  Provenance provenance;
};

/// What readers must know where only the indirect light is to be cleaned and some filters clean the direct light by
/// themselves, too; empty: nothing.
std::string remark_on_parts(const EvaluationSettings& settings);

/// The same of filters that are not brume's: what they are, and what is not done with them.
std::string remark_on_others(const EvaluationSettings& settings);

/// Whether parameters are searched or changed, or layers left out.
bool is_any_searched(const EvaluationSettings& settings);

/// Whether a metric is among those that are reported.
bool is_reported(const EvaluationSettings& settings, const std::string& metric);

/// What frames must hold beside their colours.
struct RecordedData {
  std::vector<std::string> layers;  ///< by name, in order
  bool statistics = false, buckets = false, records = false;
  std::string text() const;
  friend bool operator==(const RecordedData&, const RecordedData&) = default;
};

/// What references hold.
RecordedData data_of_references();

/// What the noisy frames must hold for these settings.
RecordedData data_to_record(const EvaluationSettings& settings);

/// What the machine calls its processor.
std::string processor_name();

}  // namespace brume
