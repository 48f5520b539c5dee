#pragma once
#include "evaluate/protocol/protocol.h"

namespace brume {

/// The methods of a scene that no other one beats in both time and error: in order of their seconds.
/// @param setting  only methods of this setting, and unfiltered path tracing; nothing: all of them, those that repeat
///                 our defaults under another name aside
std::vector<const MethodResult*> pareto_front(const SceneResult& scene, const Judgement& by = {},
                                              std::optional<Tuning> setting = {});

/// How long a method takes to an error.
struct TimeToError {
  const MethodResult* method;  ///< at its smallest sample count
  double error = 0;            ///< in the metric's unit
  double seconds = 0;          ///< render, guides and filter
  /// How many times faster than path tracing, whose noise falls as 1 / sqrt(spp), and than the gradient kernel with the
  /// same setting; nothing where that never gets there, or where no law of the metric's noise is known.
  std::optional<double> over_path_tracing, over_gradient_kernel;
};

/// For each method of a scene and each error 1, 2 or 5 times a power of ten (of a PSNR every 2 or 5 dB) that it passes
/// between its smallest and largest sample count: seconds from a line through the neighbouring sample counts, both axes
/// logarithmic.
std::vector<TimeToError> times_to_error(const SceneResult& scene, const Judgement& by = {});

}  // namespace brume
