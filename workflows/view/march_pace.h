#pragma once
#include "base/vec.h"

namespace brume {

/// How many pixels a second of a scene's predicted pictures are marched, as measured, and which sizes follow from that.
class MarchPace {
 public:
  /// Another scene is shown.
  void forget() { *this = {}; }
  /// The same scene with other light, whose whole picture may take another time.
  void forget_whole() { whole_ = 0; }
  void measure_coarse(const ivec2& size, double seconds);
  void measure_whole(double pixels_per_second) { whole_ = pixels_per_second; }

  /// A whole picture of this size is not there at once, or nobody knows.
  bool is_slow(const ivec2& whole) const;
  /// The size of a coarse picture of that shape that is marched in so many seconds, at most the whole one's.
  ivec2 size_within(double seconds, const ivec2& whole) const;
  /// Whether a coarser picture is worth its time on the way to the whole one.
  bool is_worth(const ivec2& coarse, const ivec2& whole) const;

 private:
  double coarse_pace() const;

  double coarse_ = 0, whole_ = 0;  // pixels a second; 0: not measured
};

}  // namespace brume
