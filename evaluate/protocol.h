#pragma once
#include <filesystem>
#include <functional>

#include "evaluate/metric.h"
#include "evaluate/tuning.h"

namespace brume {

/// A rendered frame and what it cost.
struct TimedFrame {
  Layers layers;
  double seconds = 0;
  std::filesystem::path records;  ///< of every sample; empty: not kept
};

/// One scene to evaluate. The protocol does not know who renders it.
struct EvaluationScene {
  std::string name;
  double exposure = 1.0;
  /// `records`: the file to write what happened to each sample to; empty: none.
  std::function<TimedFrame(int spp, int64_t seed, const std::filesystem::path& records, const Task& task)> render;
  /// The same picture with nothing beside it but coverage: for references, which no filter reads.
  std::function<TimedFrame(int spp, int64_t seed, const Task& task)> render_reference;
};

struct EvaluationSettings {
  std::vector<int> spp = {16, 36, 64};
  int seeds = 5;
  int reference_spp = 4096;  ///< of each of the two references
  bool tune = true;
  std::vector<Contender> contenders;
  BackgroundRule background = BackgroundRule::kDefault;
  Component component = Component::kIndirect;
  std::filesystem::path records;  ///< folder for the records of the noisy frames, where a contender reads them
};

/// How a method's parameters came about.
enum class Tuning {
  kNone,      ///< unfiltered path tracing
  kPaper,     ///< the filter's preset `paper`: as published
  kDefault,   ///< our defaults
  kSearched,  ///< found by the search on a separate noisy frame of the same scene and spp
  kTransfer,  ///< found by the same search on the other scenes of this run
};
const char* tuning_name(Tuning tuning);

/// One line of the table: a method at one spp.
struct MethodResult {
  std::string filter;  ///< the contender's label; empty: unfiltered
  Tuning tuning = Tuning::kNone;
  int spp = 0;
  std::string parameters;
  std::vector<std::string> edges;  ///< searched parameters that ended on the edge of their candidates
  MeanInterval whole, medium;      ///< Lab RMS over the seeds; reference noise removed
  MeanInterval rel_mse_medium;
  double relative_bias = 0;  ///< over the medium, mean of the seeds
  double render_seconds = 0, filter_seconds = 0;
  std::vector<double> whole_by_seed;  ///< for paired comparisons
  Layers example;                     ///< of the first seed: R G B
  std::string label() const { return filter.empty() ? "path tracing" : filter; }
};

struct SceneResult {
  std::string name;
  LabPolicy policy;
  int width = 0, height = 0;
  double medium_share = 0;  ///< of the frame's pixels
  int reference_spp = 0;
  double reference_rms = 0;  ///< Lab RMS noise of one reference, whole frame
  double reference_seconds = 0;
  Layers reference;  ///< mean of the two, R G B and coverage
  Mask mask;
  std::vector<MethodResult> methods;
  const MethodResult* find(const std::string& filter, Tuning tuning, int spp) const;
};

struct Evaluation {
  EvaluationSettings settings;
  std::vector<SceneResult> scenes;
  std::string machine;
};

/// How many stages evaluate() will announce.
size_t stage_count(const EvaluationSettings& settings, size_t scenes);

/// What the noisy frames must hold for these settings.
struct RecordedData {
  std::vector<std::string> layers;
  bool statistics = false, buckets = false, records = false;
};
RecordedData data_to_record(const EvaluationSettings& settings);

/// Runs the protocol of the gradient-kernel paper's Table 1. `stage(name)` gives each step its own task.
Evaluation evaluate(const std::vector<EvaluationScene>& scenes, const EvaluationSettings& settings,
                    const std::function<Task(const std::string&)>& stage);

/// Processor and thread count, for tables.
std::string machine_name();

}  // namespace brume
