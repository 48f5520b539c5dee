#pragma once
#include <string>
#include <vector>

#include "filters/inputs/noise.h"
#include "image/layers.h"
#include "image/sample_records.h"

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
  const Plane* whole = nullptr;  ///< luminance of the picture that it is a part of; null: it is all there is
  RecordReader* records = nullptr;
  std::vector<SequenceFrame> sequence = {};  ///< for filters that look through time
  bool keep_parts = false;  ///< store the direct and indirect light, where they are cleaned by themselves, as
                            ///< clean_direct and clean_indirect, whatever the filter
  bool all_guides = false;  ///< the frame has the guides of its scene: nobody need be told how to record them
  int tile = 0;  ///< side of the squares that are filtered one after another [px]; 0: as large as memory allows
};

}  // namespace brume
