#pragma once
#include "image/layers.h"
#include "image/pixel_statistics.h"
#include "render/integrator.h"

namespace brume {

/// Turns path samples into layers. One sample lands in exactly one pixel (box filter): splatting would correlate
/// neighbours and break every statistic.
class Film {
 public:
  // Order of a sample's numbers: beauty 3, direct 3, indirect 3, gradient 3, coverage, transmittance.
  static constexpr size_t kValues = 14;
  using Pixel = PixelStatistics<kValues>;

  Film(int width, int height, const LayerRequest& request);

  /// False for a sample that is not finite: rejected whole, and to be counted.
  static bool add(Pixel& pixel, const PathSample& sample, size_t half);
  /// Writes a finished pixel. Different pixels may be stored from different threads.
  void store(int x, int y, const Pixel& pixel, uint32_t invalid);

  Layers take() { return std::move(layers_); }

 private:
  struct Target {
    Plane *mean, *mean_variance, *half_a, *half_b;
    size_t value;
    bool complement;  // alpha = 1 - transmittance
  };
  void record(const LayerName& name, size_t first_value, bool statistics, bool complement = false);

  Layers layers_;
  std::vector<Target> targets_;
  std::array<Plane*, 3> beauty_;
  Plane *sample_count_, *invalid_count_;
};

}  // namespace brume
