#pragma once
#include "evaluate/protocol/protocol.h"

namespace brume {

/// A method over several scenes and sample counts at once.
struct OverallMethod {
  const MethodResult* method = nullptr;  ///< on the first of them
  double value = 0;                      ///< mean of the metric, see Overall::geometric
  /// How many times less error than the unfiltered frames have; nothing where means are not geometric.
  std::optional<double> times_less_than_noisy;
  double seconds = 0, most_seconds = 0;  ///< of guides and filter on a frame: mean, and most
  std::optional<double> most_bytes;      ///< memory beside the input
  bool reads_guides = false;             ///< on any frame
  /// Places in Overall::methods of the worse ones that the seeds cannot tell from it: paired over the seeds, 5 % over
  /// all comparisons with it, after Holm.
  std::vector<size_t> level_with;
};

/// What guides and filter of a frame may take where an answer is wanted soon [s].
inline constexpr double kQuick = 0.5;

/// Which method is the best over all scenes and sample counts, those of one setting and unfiltered path tracing.
struct Overall {
  std::vector<std::string> scenes;
  std::vector<int> spp;
  size_t seeds = 0;
  /// Whether means over scenes and sample counts are geometric, so that a scene of large errors does not decide alone;
  /// arithmetic where higher is better, or an error is zero.
  bool geometric = true;
  std::vector<OverallMethod> methods;  ///< the best first
  /// Methods with no number on one of the frames, by id, and why.
  std::vector<std::pair<std::string, std::string>> left_out;
};

/// Nothing where no scene has such pixels or methods, or where zero is the metric's best value: biases of opposite
/// signs have no useful mean.
/// @param setting  nothing: all of them
std::optional<Overall> overall(const Evaluation& evaluation, const Judgement& by, std::optional<Tuning> setting);

}  // namespace brume
