#pragma once
#include <array>

#include "render/transport/path_states.h"
#include "volume/instances.h"

namespace brume {

/// A grid as rays meet it: a box in coordinates of its own.
struct LocalBox {
  const Placement::ToLocal* to_local = nullptr;  ///< of all rays, or by slot
  bool by_slot = false;
  dvec3 lo{0}, hi{0};
  dvec3 shift{0};   ///< from the box's coordinates to those that the kernels walk in
  double unit = 1;  ///< of ray parameters in lanes
  /// The places of many such boxes; null: to_local says where it is.
  const Instance* instances = nullptr;
  const int32_t* instance = nullptr;  ///< by slot: which of them a ray is taken to
};

/// Takes rays to a grid's coordinates in double precision and clips them to its box; what is left fits in single
/// precision. The denser an instance, the shorter is the unit of ray parameters in it, so that kernels know one
/// extinction. Where a part ends only the ray's own end counts: walks through a grid end at its faces by themselves.
/// @param rays, ends  by slot; the latter ray parameters
/// @param slots       whose
/// @param to, begin   by slot: the parts inside, and the world ray parameters at which they begin
/// @param inside      gets the slots of the rays that meet the box
void enter_box(const LocalBox& box, const std::array<Ray, kPool>& rays, const std::array<double, kPool>& ends,
               const SlotList& slots, LocalRays& to, std::array<double, kPool>& begin, SlotList& inside);

}  // namespace brume
