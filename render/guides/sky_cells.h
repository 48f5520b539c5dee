#pragma once
#include <vector>

#include "render/guides/sky_parts.h"

namespace brume {

/// The sky's mean radiance over cells of directions, for rays that are few.
class SkyCells {
 public:
  explicit SkyCells(const SkyParts& sky);
  /// RGB radiance of the cell around a direction.
  dvec3 operator()(const dvec3& d) const;

 private:
  bool constant_;
  std::vector<dvec3> cells_;
};

}  // namespace brume
