#pragma once
#include "base/vec.h"
#include "image/sample_records.h"

namespace brume {

/// The random choices of one path and the features of its events, for filters that work on samples one by one
/// (docs/methods.md, Random parameter filtering and Sample histograms).
/// Numbers of events that never came are 0; flags say which came.
struct PathRecord {
  vec2 film{0}, lens{0};
  float time = 0;
  // Random parameters. A flight's is the share of light it outlived, 1 - exp(-optical depth), 1 where it left the
  // media.
  float flight_1 = 1, flight_2 = 1;
  vec3 direction_1{0}, direction_2{0};  ///< world, after the event
  float light_1 = -1;                   ///< which light was sampled at the first event
  vec2 light_uv_1{0};
  // Features.
  vec3 position_1{0}, position_2{0};  ///< of the first two events, world space
  vec3 surface_gradient{0}, gradient_1{0};
  vec3 albedo{0};
  float density_1 = 0;
  float light_transmittance_1 = 0;  ///< of the first event's shadow ray
  vec3 normal{0};
  float flags = 0;  ///< 1: scattered, 2: scattered twice, 4: met a surface first, 8: met the medium's isosurface
  // Colour.
  vec3 unscattered{0}, single{0}, indirect{0};  ///< background, emission and surfaces lit directly; once; more

  static std::vector<RecordLayout::Field> fields();
  const float* values() const { return &film.x; }
};

}  // namespace brume
