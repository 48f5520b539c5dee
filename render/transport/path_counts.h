#pragma once
#include <cstdint>
#include <vector>

#include "base/progress.h"

namespace brume {

class Camera;
struct PathContext;
struct Scene;

/// How many paths go on from the camera rays of each part of the picture (CameraSplits).
class PathCounts {
 public:
  /// One for each ray.
  PathCounts() = default;
  /// The same for all rays. @param count  1 to kMost
  explicit PathCounts(int count) : most_(count), mean_(count), counts_(1, static_cast<uint8_t>(count)) {}

  int at(int x, int y) const {
    if (counts_.size() == 1) return most_;
    const int column = x * columns_ / width_, row = y * rows_ / height_;
    return counts_[static_cast<size_t>(row) * static_cast<size_t>(columns_) + static_cast<size_t>(column)];
  }
  /// @param pixel  SampleKey::pixel
  int of_pixel(uint32_t pixel) const {
    const auto width = static_cast<uint32_t>(width_);
    return at(static_cast<int>(pixel % width), static_cast<int>(pixel / width));
  }
  int most() const { return most_; }
  double mean() const { return mean_; }

  static constexpr int kMost = 16;

 private:
  friend PathCounts choose_path_counts(const PathContext&, const Scene&, const Camera&, const Task&);
  int width_ = 1, height_ = 1;  // of the film
  int columns_ = 1, rows_ = 1;
  int most_ = 1;
  double mean_ = 1;
  std::vector<uint8_t> counts_ = {1};  // row by row
};

/// Counts with which a picture has the least error for its time, by what a few paths over it find: more where light
/// after the camera ray is noisy and paths are cheap, compared with what the ray itself costs and with the noise of
/// what it sees. They are a constant of the scene and its camera, so paths stay unbiased.
///
/// Source: the optimum is that of Bolin and Meyer 1997, An Error Metric for Monte Carlo Ray Tracing, and of Rath et al.
/// 2022, EARS: Efficiency-Aware Russian Roulette and Splitting, here for the camera ray alone.
/// Proof: tests/render/path_counts_test.cpp
/// @param context  whose plan integrates emission along camera rays
PathCounts choose_path_counts(const PathContext& context, const Scene& scene, const Camera& camera, const Task& task);

}  // namespace brume
