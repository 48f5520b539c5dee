#pragma once
#include "filters/api/filter.h"
#include "filters/inputs/noise.h"

namespace brume {

enum class Component {
  kIndirect,  ///< clean `indirect`, add `direct` back untouched: the rule of the papers
  kAll,       ///< clean the beauty
  kSeparate,  ///< clean `direct` and `indirect`, each by itself, and add them
};
enum class BackgroundRule {
  kDefault,    ///< the gradient-kernel paper's for the filters compared there, none for the others
  kBilateral,  ///< pixels without coverage get the bilateral filter
  kFilter,     ///< every pixel gets the filter
};

struct ForeignFrame;

/// A frame of a sequence beside the one that is cleaned.
struct SequenceFrame {
  int distance = 0;  ///< in frames: before < 0 < after
  const Layers* layers = nullptr;
  RecordReader* records = nullptr;        ///< of every sample; null: none
  const ForeignFrame* picture = nullptr;  ///< of another renderer: what the layers mean; null: they have brume's names
};

/// What of a frame is filtered, what is done before, and how it is put together again.
struct ApplyOptions {
  Component component = Component::kIndirect;
  BackgroundRule background = BackgroundRule::kDefault;
  double exposure = 1.0;
  NoiseSource noise = NoiseSource::kLayers;
  Outliers outliers = Outliers::kExtreme;
  std::vector<std::string> features = {};  ///< names of features.h; empty: all that the frame has; "none": none
  /// Layers filtered with the weights of the component and stored under their own names, so that passes which sum to it
  /// before the filter sum to it after.
  std::vector<LayerName> carried = {};
  /// Which light the beauty of a frame is, where it is a part: direct or indirect; no name: the whole.
  LayerName light = {};
  RecordReader* records = nullptr;
  std::vector<SequenceFrame> sequence = {};  ///< for filters that look through time
  bool keep_parts = false;  ///< store the direct and indirect light, where they are cleaned by themselves, as
                            ///< clean_direct and clean_indirect, whatever the filter
  bool all_guides = false;  ///< the frame has the guides of its scene: nobody need be told how to record them
  int tile = 0;  ///< side of the squares that are filtered one after another [px]; 0: as large as memory allows
};

struct ApplyReport {
  double seconds = 0;             ///< of the filter, conversions included
  size_t repaired_pixels = 0;     ///< not finite in a layer that was read
  size_t extreme_pixels = 0;      ///< of the frame to clean, limited or kept (filters/inputs/extremes.h)
  size_t repaired_records = 0;    ///< pixels with recorded samples that were not finite
  size_t not_finite_results = 0;  ///< pixels the filter could not finish; they kept their input
  size_t tiles = 1;
  std::vector<std::string> notes;
};

/// Cleans a frame. The result holds R G B, A where the frame has it, the carried layers, and the header with the filter
/// and every parameter. Non-finite pixels are replaced by the median of their finite neighbours before the filter, from
/// the rim of a hole inward, and counted. Frames that need more room than a quarter of the layers read are filtered
/// tile by tile.
/// @throws InputError when a needed layer or statistic is missing: names all of them, and the command that records
/// them;
///                    for another frame of the sequence too; when a signal has no finite pixel; when the machine has
///                    not the memory
Layers apply_filter(const FilterSettings& filter, const Layers& frame, const ApplyOptions& options, const Task& task,
                    ApplyReport* report = nullptr);

}  // namespace brume
