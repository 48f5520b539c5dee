#pragma once
#include <memory>
#include <optional>
#include <span>

#include "base/error.h"
#include "evaluate/protocol/tuning.h"

namespace brume {

/// What somebody else's filter is given: one signal to clean and what it asked for.
struct ExternalInput {
  /// R G B are the signal that is cleaned, be it the whole picture or a part of it; with statistics under their own
  /// names (mean_variance.R, half_a.R, half_b.R). Beside it alpha, coverage and the layers that were asked for.
  const Layers& frame;
  int spp = 0;            ///< of the frame
  int64_t seed = 0;       ///< of the frame
  double time_limit = 0;  ///< seconds; 0: none
  double time_used = 0;   ///< of it, by the signals of this frame before
};

/// What it made of it.
struct ExternalOutput {
  Layers picture;                         ///< R G B
  double seconds = 0;                     ///< that the filter took
  double exchange_seconds = 0;            ///< that brume took to hand over the frame and to take back the picture
  std::optional<double> peak_bytes = {};  ///< nothing: to be measured around it, as for filters of brume's own
};

/// A filter took more time or memory than it may.
struct LimitPassed : InputError {
  using InputError::InputError;
};

/// A filter that is no part of brume: a program, or a function of whoever calls the protocol.
struct ExternalFilter {
  /// Adds what a layer's name asks for; "guides" is all guides.
  /// @param known  the layers that a frame can have   @param where  that names it   @throws InputError
  void ask_for(const std::string& name, std::span<const LayerName> known, const std::string& where);

  std::string kind;               ///< "command", "function"
  std::string words;              ///< the command, or the function's name, for tables
  std::string key;                ///< everything that decides its result beside the frame
  std::vector<LayerName> layers;  ///< that it reads beside the signal
  bool guides = false;            ///< whether it reads the layers guide.*
  bool statistics = false;        ///< whether it reads variance and halves of the signal and its layers
  double memory_limit = 0;        ///< bytes that it may hold; 0: no limit
  /// @throws LimitPassed; InputError when it fails; Interrupted
  std::function<ExternalOutput(const ExternalInput& input, const Task& task)> run;
};

/// A line of a comparison that is somebody else's filter. It stands where others do under each setting: there is
/// nothing that a search could change, nor a study leave out.
Contender external_contender(ExternalFilter filter, std::string label);

/// Runs of an external filter as if it were one of brume's, for apply_filter: of each signal of a frame one.
class ExternalRun {
 public:
  ExternalRun(const Contender& contender, int spp, int64_t seed, double time_limit);
  ExternalRun(const ExternalRun&) = delete;
  FilterSettings settings() const { return FilterSettings(entry_); }

  /// What all runs took together.
  double seconds = 0, exchange_seconds = 0;
  std::optional<double> peak_bytes;

 private:
  void clean(const FilterFrame& frame, const FilterOutput& out, const Task& task);

  std::shared_ptr<const ExternalFilter> filter_;
  FilterEntry entry_;
  int spp_;
  int64_t seed_;
  double time_limit_;
};

}  // namespace brume
