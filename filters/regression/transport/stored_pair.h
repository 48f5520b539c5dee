#pragma once
#include <array>
#include <vector>

#include "filters/inputs/half_pair.h"
#include "image/stored_plane.h"

namespace brume {

/// A result on two independent halves, stored so.
struct StoredPair {
  std::array<StoredPlane, 3> a, b;

  StoredPair(const HalfPair& pair, const Task& task);
  int width() const { return a[0].width(); }
  int height() const { return a[0].height(); }
  /// What lies within a box.
  void read(const Box& box, HalfPair& out, const Task& task) const;
};

/// Both halves of candidates and, last, of the data, blended with one set of maps.
HalfPair blend(const std::vector<StoredPair>& candidates, const HalfPair& data, const std::vector<Plane>& maps,
               const Task& task);

}  // namespace brume
