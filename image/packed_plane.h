#pragma once
#include <vector>

#include "base/progress.h"
#include "image/plane.h"

namespace brume {

/// A plane that is kept aside, bit for bit: pieces of a row that hold one value take the memory of one.
class PackedPlane {
 public:
  PackedPlane(const Plane& plane, const Task& task);
  Plane unpacked(const Task& task) const;

 private:
  struct Row {
    std::vector<bool> constant;  // by piece
    std::vector<float> values;   // one of each constant piece, all of the others
  };
  int width_;
  std::vector<Row> rows_;
};

}  // namespace brume
