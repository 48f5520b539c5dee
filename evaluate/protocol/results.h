#pragma once
#include <array>
#include <map>
#include <optional>

#include "evaluate/metrics/metric.h"
#include "evaluate/metrics/statistics.h"
#include "evaluate/protocol/settings.h"

namespace brume {

/// How a method's parameters came about.
enum class Tuning {
  kNone,      ///< unfiltered path tracing
  kPaper,     ///< the filter's preset `paper`: as published
  kDefault,   ///< our defaults
  kSearched,  ///< found by the search on a separate noisy frame of the same scene and spp
  kTransfer,  ///< found by the same search on the other scenes of this run
};
const char* tuning_name(Tuning tuning);

/// The pixels over which an error is taken.
enum class Region { kFrame, kMedium };
inline constexpr std::array<Region, 2> kRegions = {Region::kFrame, Region::kMedium};
const char* region_name(Region region);

/// By what pictures are judged.
struct Judgement {
  Region region = Region::kFrame;
  size_t metric = kLabRms;  ///< place in all_metrics()
  const MetricInfo& info() const { return all_metrics()[metric]; }
};

/// By region and seed.
using RegionErrors = std::array<std::vector<Errors>, 2>;

/// One line of the table: a method at one spp.
struct MethodResult {
  std::string filter;  ///< the contender's label; empty: unfiltered
  Tuning tuning = Tuning::kNone;
  int spp = 0;
  std::string parameters;
  std::string command;                         ///< of a filter that is not brume's; empty: it is
  std::vector<std::string> edges;              ///< searched parameters that ended on the edge of their candidates
  RegionErrors errors;                         ///< of the picture; reference noise removed
  std::map<std::string, RegionErrors> lights;  ///< of `direct`, `indirect` and light groups, `light.NAME`, where they
                                               ///< are clean by themselves; single pixels' metrics alone
  double render_seconds = 0, guide_seconds = 0, filter_seconds = 0;  ///< of a frame, median over the seeds
  std::optional<double> exchange_seconds =
      {};                             ///< of handing a frame to a filter that is not brume's, not in the above
  std::optional<double> peak_bytes;   ///< memory that the filter held at most beside its input
  bool reads_guides = false;          ///< whether its features or the filter itself are made from guides
  std::string failed;                 ///< why there are no numbers; empty: there are
  std::vector<std::string> pictures;  ///< in the cache, one for each seed
  Layers example;                     ///< of the first seed: R G B
  double seconds() const { return render_seconds + guide_seconds + filter_seconds; }

  void forget_errors() {
    errors = {};
    lights.clear();
  }
  std::string label() const { return filter.empty() ? "path tracing" : filter; }
  /// What tells it from the other methods, in file names and tables for programs: "noisy", "gradient_kernel_mul_paper".
  std::string id() const;
  std::vector<double> values(Region region, double Errors::*metric) const;
  std::vector<double> values(const Judgement& by) const {
    return values_of(errors[static_cast<size_t>(by.region)], by.metric);
  }
  MeanInterval interval(Region region, double Errors::*metric) const { return mean_interval(values(region, metric)); }
  /// Lab RMS of the light groups, in the mean, by seed; nothing where there are none.
  std::vector<double> passes(Region region) const;
  /// Lab RMS.
  MeanInterval whole() const { return interval(Region::kFrame, &Errors::lab_rms); }
  MeanInterval medium() const { return interval(Region::kMedium, &Errors::lab_rms); }
};

/// A filter with a layer left out, or alone.
struct AblationResult {
  std::string layer;
  bool alone = false;
  MethodResult result;  ///< its id is that of the method with all layers
};

/// A filter with one parameter changed.
struct SensitivityResult {
  std::string parameter, value;
  MethodResult result;  ///< its id is that of the method that it belongs to
};

struct SceneResult {
  std::string name, hash;
  LabPolicy policy;
  int width = 0, height = 0;
  double medium_share = 0;  ///< of the frame's pixels
  int references = 2;
  int reference_spp = 0;     ///< 0: unknown
  double reference_rms = 0;  ///< Lab RMS noise of one reference, whole frame; 0 where there is one only
  /// Of one reference against the mean of both, by region: half of their difference, whose noise is as large as that of
  /// the mean. Single pixels' metrics alone; nothing where there is one reference only.
  std::vector<Errors> reference_errors;
  double reference_seconds = 0;
  Layers reference;  ///< mean of the two, R G B and coverage
  Mask mask;
  std::vector<MethodResult> methods;
  std::vector<AblationResult> ablation;
  std::vector<SensitivityResult> sensitivity;
  const MethodResult* find(const std::string& filter, Tuning tuning, int spp) const;
  /// Whether it is our default again under the name of the publication.
  bool repeats_default(const MethodResult& method) const;
  /// What noise alone makes the mean of the references differ from the true picture by, expected; nothing where it
  /// cannot be told: of one reference, over no pixels, in a metric that no law of noise is known of.
  std::optional<double> reference_error(const Judgement& by) const;
};

/// The sample counts of a scene's lines, in order.
std::vector<int> spp_of(const SceneResult& scene);

/// A method on a sequence.
struct SequenceMethod {
  std::string filter;  ///< the contender's label; empty: unfiltered
  int spp = 0;
  int frame_window = 0;  ///< frames on either side that it looks into
  std::string parameters;
  struct Values {
    std::vector<double> lab_rms, temporal_error, flicker;  ///< over all frames, by seed; evaluate/metrics/temporal.h
  };
  std::array<Values, 2> regions;  ///< nothing for the medium where no frame shows one
  double filter_seconds = 0;      ///< of a frame, median
  std::string failed;             ///< why there are no numbers; empty: there are
};

struct SequenceResult {
  std::string name;
  std::vector<int> frames;
  std::vector<std::string> hashes;  ///< of the frames' scenes
  LabPolicy policy;
  int width = 0, height = 0;
  std::array<double, 2> reference_change{};  ///< RMS in Lab from frame to frame, by region
  std::vector<SequenceMethod> methods;
};

struct Evaluation {
  EvaluationSettings settings;
  std::vector<SceneResult> scenes;
  std::vector<SequenceResult> sequences = {};
  /// What was done, and what lay in the cache.
  struct Work {
    int rendered = 0, frames_found = 0, filtered = 0, results_found = 0;
  } work;
};

}  // namespace brume
