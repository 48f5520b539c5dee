#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>

#include "evaluate/metrics/metric.h"
#include "filters/run/apply.h"

namespace brume {

struct ExternalFilter;

/// One line of a comparison: a filter, and the parameters that make it this line rather than another of the same
/// filter.
struct Contender {
  FilterSettings settings;
  std::vector<std::string> fixed;  ///< parameters that the search leaves alone
  std::string label;               ///< "gradient_kernel", "gradient_kernel mul"
  std::optional<FilterSettings>
      paper{};  ///< as published; none where parameters are fixed, which is our own choice, or nobody published any
  std::vector<std::string> features{};  ///< that it is given, as `denoise --features`; empty: those of its own choice
  bool guides = true;                   ///< whether it is given guides, where it reads them
  double time_limit = 0;                ///< seconds on a frame; 0: the experiment's
  bool study = true;                    ///< whether ablation and sensitivity look at it
  /// Where it is no filter of brume's (external_filter.h); `settings` then has no parameters and is of a declaration
  /// that this keeps.
  std::shared_ptr<const ExternalFilter> external{};

  /// Whether a run with these settings, its own or found ones, reads guides.
  bool reads_guides(const FilterSettings& run) const;
  /// Whether a search tries the candidates of a parameter.
  bool searches(const Parameter& parameter) const;
  /// Everything that decides what a search finds, as text.
  std::string key() const;
};

/// "NAME" or "NAME:parameter=value,...". @throws InputError
Contender parse_contender(const std::string& text);
/// Every filter at its defaults that needs no records, and what its declaration also compares.
std::vector<Contender> all_contenders();

/// Every setting that the search of a contender may try: each candidate of each searched parameter, the rest as the
/// contender has them.
std::vector<FilterSettings> candidate_settings(const Contender& contender);

/// The parameters of a search's result that lie on the edge of their candidates: there the optimum may be further out.
std::vector<std::string> on_the_edge(const Contender& contender, const FilterSettings& found);

/// A noisy frame whose truth is known. Remembers the error of each setting, so that none runs twice.
class TuningFrame {
 public:
  /// @param key  everything that decides the frame and its reference, as text
  TuningFrame(Layers frame, std::filesystem::path records, ApplyOptions options, LabRms metric, std::string key = "")
      : frame_(std::move(frame)),
        records_(std::move(records)),
        options_(std::move(options)),
        metric_(std::move(metric)),
        key_(std::move(key)) {}
  const std::string& key() const { return key_; }
  /// The squared Lab error of each setting. Settings run in parallel, each on one thread; filters that hold much at a
  /// time one after another on all of them.
  std::vector<double> squared_errors(const Contender& contender, const std::vector<FilterSettings>& settings,
                                     const Task& task);

 private:
  double measure(const Contender& contender, const FilterSettings& settings, const Task& task) const;

  Layers frame_;
  std::filesystem::path records_;
  ApplyOptions options_;
  LabRms metric_;
  std::string key_;
  std::map<std::string, double> known_;  // by contender and parameters
};

/// The setting with the smallest geometric mean of the errors over some frames.
///
/// Every combination of the candidates where there are few of them. Elsewhere by coordinates, from the better of the
/// defaults and the published parameters and from some random places: one parameter after another takes the best of its
/// candidates, round by round until a round changes nothing, four at most. A value changes only for a smaller error, so
/// that the result does not depend on the order of equals.
/// @param restarts  random places to begin from
FilterSettings search(const Contender& contender, const std::vector<TuningFrame*>& frames, int restarts,
                      const Task& task);

}  // namespace brume
