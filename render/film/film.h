#pragma once
#include <vector>

#include "base/progress.h"
#include "image/exr_io.h"
#include "image/layers.h"
#include "image/pixel_statistics.h"
#include "render/transport/path_sample.h"

namespace brume {

/// Turns path samples into layers. One sample lands in exactly one pixel (box filter): splatting would correlate
/// neighbours and break every statistic.
///
/// The picture is cut into tiles; each has its sums while samples go into it, and they may be dropped once it is
/// finished. Different tiles may be used from different threads.
class Film {
 public:
  static constexpr int kTile = 16;

  Film(int width, int height, const LayerRequest& request);

  int width() const { return width_; }
  int height() const { return height_; }
  int tile_count() const { return tiles_.x * tiles_.y; }
  struct Bounds {
    int x0, y0, x1, y1;
    int width() const { return x1 - x0; }
    int pixels() const { return (x1 - x0) * (y1 - y0); }
  };
  Bounds bounds(int tile) const;

  /// Samples taken of each pixel of a tile.
  uint32_t taken(int tile) const { return state_[static_cast<size_t>(tile)].taken; }
  void set_taken(int tile, uint32_t samples) { state_[static_cast<size_t>(tile)].taken = samples; }
  /// The values of a sample that the film keeps, as many as a row has.
  size_t row_size() const { return offsets_.size(); }
  void pack(const PathSample& sample, float* row) const;
  /// Adds samples of one pixel of a tile, rows one after the other, the first one's index being `first`. What is not
  /// finite is rejected, a whole sample at once, and counted.
  /// @return the rejected rows' numbers
  std::vector<uint32_t> add(int tile, int pixel, const float* rows, uint32_t count, uint32_t first);
  /// Computes a tile's pixels from its sums.
  void develop(int tile);
  /// Forgets a tile's sums: no more samples can be added.
  void drop(int tile);

  /// Estimated relative error of the beauty: root of the mean over pixels of mean_variance / (mean^2 + 0.01 white^2).
  /// Means and variances are pooled over windows of 7 x 7 pixels, because a pixel whose few samples happen to be equal
  /// is not known to be exact; and every window borrows 256 samples' worth of the whole picture's variance, because
  /// what is rare may not have been seen in it yet. Infinite while pixels have fewer than 8 samples, and while no light
  /// was found at all. Needs statistics.
  double relative_error(double exposure, int threads = 0) const;

  const Layers& layers() const { return layers_; }
  Layers take() { return std::move(layers_); }

  /// The sums as 32-bit words in channels "state.*" of `layers`, so that a frame can go on or be merged elsewhere; what
  /// develop() computed is in there too.
  void save_state(Layers& layers, const Task& task = {}) const;
  /// The same channels for write_exr, made as they are written. The film must outlive it.
  WordRows state_rows() const;
  /// Adds the sums of a saved state to this film's. @throws InputError naming what does not fit; Interrupted
  void merge_state(const Layers& saved, const std::string& name, const Task& task = {});

  /// Memory of the layers, and of the sums of all tiles at once.
  static double layer_bytes(int width, int height, const LayerRequest& request);
  static double state_bytes(int width, int height, const LayerRequest& request);

 private:
  struct TileState {
    std::vector<double> sums;
    std::vector<uint32_t> counts;  // of the valid samples, by group, for each pixel
    std::vector<uint32_t> invalid;
    uint32_t taken = 0;
    bool developed = false;  // its pixels are no longer 0 as they began
  };
  struct Target {
    Plane *mean, *mean_variance, *half_a, *half_b;
    std::vector<Plane*> buckets;
    size_t value;
    bool complement;  // alpha = 1 - what is transmitted
  };
  void record(const LayerName& name, size_t offset, bool complement = false);
  TileState& opened(int tile);
  /// Calls put(channel, pixel of the tile, word) for all words of a tile's sums.
  template <class Put>
  void visit_state(int tile, const Put& put) const;
  size_t state_words() const { return 2 * sums_.doubles() + sums_.groups() + 1; }

  int width_, height_;
  ivec2 tiles_;
  LayerRequest request_;
  Layers layers_;
  std::vector<size_t> offsets_;  // of each value in a PathSample; then in PathSample::groups
  size_t own_values_ = 0;        // how many are of the sample itself
  std::vector<Target> targets_;
  std::array<Plane*, 3> beauty_{};
  size_t direct_ = SIZE_MAX, indirect_ = SIZE_MAX;  // which values hold them
  Plane *sample_count_, *invalid_count_;
  PixelSums sums_;
  std::vector<TileState> state_;
};

}  // namespace brume
