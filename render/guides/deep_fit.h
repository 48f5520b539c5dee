#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "base/vec.h"

namespace brume {

/// What a pixel shows along its depth, at some depths in order.
struct DeepKnot {
  float z;
  bool behind;  ///< what is at this depth; else in front of it
  float left;   ///< transmittance up to here
  vec3 light;   ///< that comes from before here
};

/// The fewest volumes and points, one behind the other, that show the knots of a pixel within a bound.
///
/// A volume's transmittance is an exponential of the depth, so that its logarithm is a line, which has to stay inside
/// the tube that the bound leaves around the logarithm of the knots'. From each volume's begin the slopes that do are
/// an interval that shrinks from knot to knot: the volume ends in front of the first knot that leaves none. The
/// transmittance at ends of volumes may be anywhere in the tube, which needs seven tenths of the volumes that ends on
/// the curve need. Light inside of a volume goes with what it takes of the transmittance, and has a tube and slopes of
/// its own. Source: "swing filter", Elmeleegy and others 2009, Online Piece-wise Linear Approximation of Numerical
/// Streams
class DeepFit {
 public:
  /// A volume between two knots, or a point, from a knot to the one behind it.
  struct Piece {
    size_t from, to;
    float left;  ///< transmittance at its end
  };

  /// @param knots  in order; the last one's transmittance is kept
  void begin(std::span<const DeepKnot> knots);
  /// @param bound  of transmittance; of light as a share of all, kLight times it
  std::span<const Piece> pieces(float bound);
  /// Of the fewest, or as near as so many can. @param most  at least the points and what lies between them
  std::span<const Piece> pieces(float bound, size_t most);

 private:
  static constexpr float kLight = 4;

  size_t end_of_volume(size_t from, float log_left, float bound);
  bool empty_between(size_t from, size_t to) const;

  std::span<const DeepKnot> knots_;
  std::vector<float> log_left_, light_, low_, high_;  // logarithms of transmittance, its tube; shares of the light
  float slope_ = 0;                                   // of the volume found last
  std::vector<Piece> pieces_, best_;
};

}  // namespace brume
