#pragma once
#include "evaluate/protocol/protocol.h"

namespace brume {

/// The methods of a scene that no other one beats in both time and error: in order of their seconds.
std::vector<const MethodResult*> pareto_front(const SceneResult& scene);

/// How long a method takes to an error.
struct TimeToError {
  std::string method;  ///< MethodResult::id
  double error = 0;    ///< Lab RMS, whole frame
  double seconds = 0;  ///< render, guides and filter
  /// How many times faster than path tracing, whose error falls as 1 / sqrt(spp), and than the gradient kernel with the
  /// same setting; nothing where that never gets there.
  std::optional<double> over_path_tracing, over_gradient_kernel;
};

/// For each method of a scene and each error 1, 2 or 5 times a power of ten that it passes between its smallest and
/// largest sample count: seconds from a line through the neighbouring sample counts, both axes logarithmic.
std::vector<TimeToError> times_to_error(const SceneResult& scene);

}  // namespace brume
