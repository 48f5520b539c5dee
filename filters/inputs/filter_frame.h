#pragma once
#include <algorithm>
#include <vector>

#include "filters/inputs/features.h"
#include "filters/inputs/planes.h"
#include "image/frame_space.h"
#include "image/layers.h"
#include "image/sample_records.h"

namespace brume {

/// What a filter is given: one signal to clean, and what it declared to read. Everything finite, all of one size.
struct FilterFrame {
  LayerName name;    ///< of the signal
  RgbPlanes signal;  ///< linear RGB: what the weights are made from
  RgbPlanes values;  ///< what is averaged: the signal, or a layer that is carried along with the signal's weights
  const Layers& layers;
  double exposure = 1.0;         ///< from radiance to display; perceptual filters work on signal * exposure
  const Plane* whole = nullptr;  ///< luminance of the picture that the signal is a part of; null: not known
  /// Coverage, where the rest of the picture is to be treated as background: pixels at 0 get the bilateral filter with
  /// the gradient-kernel paper's settings. Null: the filter treats every pixel.
  const Plane* medium = nullptr;

  RgbPlanes variance{};  ///< of the pixel mean, ready to divide by (filters/inputs/noise.h); null unless declared
  RgbPlanes half_a{}, half_b{};                    ///< of the signal; null unless declared or absent
  std::vector<RgbPlanes> buckets = {};             ///< eight, or none
  const std::vector<Feature>* features = nullptr;  ///< never null where declared; may be empty
  bool together = false;                ///< other layers are carried in this run: all must get the very same weights
  double samples = 0;                   ///< per pixel, mean over the frame; 0: unknown
  const Plane* sample_count = nullptr;  ///< of each pixel; null: unknown
  double typical_luminance = 0;         ///< of the whole frame's signal (filters/inputs/noise.h)
  double lab_noise = 0;                 ///< of the whole frame's signal (filters/inputs/noise.h); 0 unless declared
  RecordReader* records = nullptr;      ///< null where none were given, unless needed
  int distance = 0;                     ///< in frames, to the one that is cleaned: before < 0 < after
  std::vector<const FilterFrame*> nearby = {};  ///< of its sequence, by distance; none for a still
  bool all_guides = false;                      ///< it has the guides of its scene, which may be none
  ivec2 origin{0};                              ///< of this tile in the frame
  ivec2 frame_size{0};
  FrameSpace space = FrameSpace(layers);  ///< of its colours

  bool carries() const { return values != signal; }
  /// How many samples a pixel's mean is made of; 0: unknown.
  double samples_at(int x, int y) const { return sample_count ? static_cast<double>((*sample_count)(x, y)) : samples; }
  int width() const { return signal[0]->width(); }
  int height() const { return signal[0]->height(); }
};

/// A frame and those nearby in their order.
inline std::vector<const FilterFrame*> in_order(const FilterFrame& frame) {
  std::vector<const FilterFrame*> frames = frame.nearby;
  frames.push_back(&frame);
  std::sort(frames.begin(), frames.end(),
            [](const FilterFrame* a, const FilterFrame* b) { return a->distance < b->distance; });
  return frames;
}

}  // namespace brume
