#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "base/vec.h"

// Constant boxes, cut up for the nodes and cells that a grid is built of.

namespace brume {

/// A constant box in a part of space, from whose lowest voxel it is counted.
struct ConstantPart {
  ivec3 lo, hi;
  float value;
};

/// Makes lists for one part of space equal where the part is the same: what is replaced is left out, neighbours of one
/// value are joined.
/// @param width  voxels along the part, whose voxels are 0 .. width
void normalise(std::vector<ConstantPart>& list, int width);

/// Which of a list of boxes reach which of the parts that a space is cut into.
class Distribution {
 public:
  /// @param parts  along each axis, each 2^bits voxels wide and of one voxel more
  Distribution(const std::vector<ConstantPart>& list, const ivec3& parts, int bits);
  std::span<const uint32_t> of(size_t part) const {
    return {members_.data() + first_[part], first_[part + 1] - first_[part]};
  }

 private:
  std::vector<size_t> first_;
  std::vector<uint32_t> members_;
};

}  // namespace brume
