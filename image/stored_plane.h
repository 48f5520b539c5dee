#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/progress.h"
#include "base/vec.h"
#include "image/plane.h"

namespace brume {

/// A plane to read only, in half the memory and less. In each run of 64 pixels of a row values are kept as roots of
/// their distance from the lowest one, in 16 bits: within 1 / 65535 of the run's range, small ones much closer; of runs
/// with values of both signs as signed roots, within 1 / 16383 of the largest. Zeros stay zeros, runs of one value cost
/// nothing, and runs whose largest value outshines most of the others 5000 times, or whose values are not all finite,
/// are kept whole. The same bits on every machine.
class StoredPlane {
 public:
  StoredPlane() = default;
  StoredPlane(const Plane& plane, const Task& task) : StoredPlane(plane.width(), plane.height()) {
    set_rows(0, plane, task);
  }
  /// Of rows that are still to be set.
  StoredPlane(int width, int height)
      : rows_(std::make_shared<std::vector<Row>>(static_cast<size_t>(height))), width_(width), height_(height) {}
  /// Rows from y on; not to be called of a view, nor where there is one.
  void set_rows(int y, const Plane& rows, const Task& task);
  /// A rectangle of it, which shares its memory.
  StoredPlane view(int x0, int y0, int width, int height) const;

  int width() const { return width_; }
  int height() const { return height_; }
  /// The pixels from..to of a row. @param out  room for to - from values
  void read(int y, int from, int to, float* out) const;
  /// The whole of it. @param out  made anew where it has another size
  void read(Plane& out, const Task& task) const;
  /// Of the whole plane, also where this is a view.
  size_t bytes() const;

 private:
  static constexpr int kRun = 64;
  enum class Code : uint32_t { kConstant, kRoots, kSignedRoots, kWhole };
  struct Run {
    float base, range;
    uint32_t first;  ///< in the row's numbers
    Code code;
  };
  struct Row {
    std::vector<Run> runs;  // one alone, if it is constant, is all of the row
    std::vector<uint16_t> numbers;
  };
  static Row stored(const float* in, int width);

  std::shared_ptr<std::vector<Row>> rows_;
  ivec2 corner_{0};
  int width_ = 0, height_ = 0;
};

}  // namespace brume
