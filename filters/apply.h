#pragma once
#include "filters/filter.h"

namespace brume {

enum class Component { kIndirect, kAll };
enum class BackgroundRule { kBilateral, kFilter };

/// What of a frame is filtered, and how it is put together again.
struct ApplyOptions {
  Component component = Component::kIndirect;  ///< indirect: clean that layer, add direct back untouched
  BackgroundRule background = BackgroundRule::kBilateral;
  double exposure = 1.0;
};

struct ApplyReport {
  double seconds = 0;             ///< of the filter, conversions included
  size_t repaired_pixels = 0;     ///< not finite in a layer that was read
  size_t not_finite_results = 0;  ///< pixels the filter could not finish; they kept their input
  std::vector<std::string> notes;
};

/// The layers a run reads: the component's, the filter's, coverage.
std::vector<LayerName> required_layers(const FilterEntry& filter, const ApplyOptions& options);

/// Cleans a frame. The result holds R G B, A where the frame has it, and the header with the filter and every
/// parameter. Non-finite pixels are replaced by the median of their finite neighbours before the filter and counted.
/// @throws InputError when a needed layer is missing: names all of them, and the command that records them
Layers apply_filter(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options, const Task& task,
                    ApplyReport* report = nullptr);

}  // namespace brume
