#pragma once
#include <vector>

#include "render/guides/guide_media.h"
#include "render/transport/lane_scene.h"
#include "volume/lane_grid.h"

namespace brume {

/// The extinction of media, looked up at many points side by side (SIMD).
class LaneMedia {
 public:
  LaneMedia(const GuideMedia& media, GuideColour colour);

  /// Parallel lines, as many as there are lanes at most, from `start` on. World space.
  struct Lines {
    static constexpr int kMost = 16;
    dvec3 start, across;  ///< across: from each line to the next
    dvec3 along;          ///< towards where the light comes from
    double length;        ///< between the nodes of a line
    int nodes, inner;     ///< inner: samples from each node to the next
  };
  /// Optical depths of the nodes of lines towards their last ones: of all lines at the first node, then at the second.
  void depths(const Lines& lines, float* depths) const;

  /// Whether all media are the same everywhere but for densities that are looked up in vectors.
  bool even() const;
  /// Extinction of one medium at points along a line, as many as fill whole vectors. @param step  to the next point
  void extinctions(size_t medium, const dvec3& start, const dvec3& step, std::vector<float>& values) const;

  struct Part {
    const Medium* medium;
    double sigma_t;   ///< per density [1 / world unit]
    LaneGrid stored;  ///< of still grids
    LaneCells cells{};
    bool grid = false;
  };

 private:
  std::vector<Part> parts_;
};

/// A displaced density at points of a finer lattice, side by side.
class DisplacedSamples {
 public:
  /// @param time  of the shutter's
  DisplacedSamples(const Medium& medium, double time);
  /// Whether single precision is enough.
  static bool fits(const Medium& medium);
  /// At across^3 points from a voxel on, local coordinates, x slowest. @param across  whole voxels and one point
  void sample(const dvec3& first, int per_voxel, int across, float* values) const;

 private:
  DisplacedLaneGrid grids_;
  LaneScene scene_{};
  float frame_;
};

}  // namespace brume
