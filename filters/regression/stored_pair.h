#pragma once
#include <cstdint>
#include <vector>

#include "filters/patch/selection.h"

namespace brume {

/// A plane in half the memory: 11 significant bits, and in every run of 64 pixels of a row 30 powers of two below the
/// largest value there, below which values become 0. The same bits on every machine.
class StoredPlane {
 public:
  StoredPlane() = default;
  StoredPlane(const Plane& plane, const Task& task);

  int width() const { return width_; }
  int height() const { return height_; }
  /// @param out  `width` values
  void read_row(int y, float* out) const;
  void read(Plane& out, const Task& task) const;

 private:
  static constexpr int kRun = 64;
  void store_row(int y, const float* in);
  size_t runs() const { return static_cast<size_t>((width_ + kRun - 1) / kRun); }

  int width_ = 0, height_ = 0;
  std::vector<uint16_t> values_;    // sign, 5 bits of exponent, 10 of mantissa; exponent 0: the value 0
  std::vector<uint8_t> exponents_;  // of the largest value of each run, as in a float
};

/// A result on two independent halves, stored so.
struct StoredPair {
  std::array<StoredPlane, 3> a, b;

  StoredPair(const HalfPair& pair, const Task& task);
  int width() const { return a[0].width(); }
  int height() const { return a[0].height(); }
  void read(HalfPair& out, const Task& task) const;
};

/// Both halves of candidates and, last, of the data, blended with one set of maps.
HalfPair blend(const std::vector<StoredPair>& candidates, const HalfPair& data, const std::vector<Plane>& maps,
               const Task& task);

}  // namespace brume
