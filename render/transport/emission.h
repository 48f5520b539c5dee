#pragma once
#include <array>
#include <memory>
#include <span>
#include <vector>

#include "render/transport/lane_scene.h"
#include "render/transport/local_rays.h"
#include "render/transport/path_states.h"
#include "render/world/field_light.h"

namespace brume {

/// An emitting field: its cells, and its EmissionRamp.
struct EmissionCells : LaneCells {
  std::array<const float*, 3> colour;  ///< the ramp's entries, by channel
  int32_t last;                        ///< the last entry that has another behind it
  bool blackbody;
  float offset, scale;          ///< from values to kelvin
  const float* stops;           ///< of colours, one for each entry
  const float* inverse_widths;  ///< 1 / the distance from a stop to the next; 0 where they coincide
  float unit;                   ///< lane_unit() of the field
  const float* densities;       ///< FieldLight::densities(); null where the field is no light
};

/// The parts of flights inside an emitting field, by slot.
struct EmissionSegments {
  LocalRays rays;        ///< in the field's coordinates and lane units
  Column<float> stride;  ///< length of a stratum [voxels]
  /// From the path's last vertex to where the part begins, in lane units; and what times FieldLight::densities() and
  /// the squared distance is how many times denser light samples of the vertex are there than directions. 0: there are
  /// none.
  Column<float> before, rival;
  Column3 emitted;  ///< the result
};

/// The same rays through one of the media that dim what they see.
struct DimmedSegments {
  const LaneScene* medium;
  /// In a grid the parts inside it, in its coordinates and lane units. In a homogeneous shape only `end`: the optical
  /// depth of all of it.
  LocalRays rays;
  /// Ray parameters there, or the optical depth in the shape: scale * ray parameter inside the emitting field + offset.
  Column<float> scale, offset;
};

/// An EmissionField as the kernels need it.
struct LaneEmission {
  /// @param grid   of its values
  /// @param light  that it is; null where it is none
  LaneEmission(const EmissionField& emission, const LaneGrid& grid, const FieldLight* light);
  /// Whether it can hold a field: a still grid that single precision resolves.
  static bool fits(const EmissionField& emission) {
    return !emission.moves() && !emission.shape().homogeneous() && LaneGrid::fits(emission.shape().bricks());
  }
  LaneEmission(const LaneEmission&) = delete;  // the cells refer to its table
  LaneEmission& operator=(const LaneEmission&) = delete;

  const FieldLight* light;
  size_t number = 0;  ///< of the field in the scene
  LocalBox box;
  std::array<std::vector<float>, 3> table;
  std::vector<float> stops, inverse_widths;
  EmissionCells cells{};
};

/// The integral of the emission coefficient along each segment, by stratified sampling: one look-up per stratum of
/// `stride` voxels, all at the same relative offset, which is drawn once per segment. Where light samples of the path's
/// last vertex find the field, too, each look-up has its weight against them.
void lanes_emission(const EmissionCells& cells, PathStates& paths, const SlotList& rays, EmissionSegments& segments);

/// What of it arrives at the rays' origins through media that stand still: the same strata, each dimmed by the
/// transmittance to its look-up, which is exact: density is trilinear, a cubic along a ray within a voxel, and two
/// points integrate it (Gauss). Rays of little transmittance play Russian roulette.
void lanes_seen_emission(const EmissionCells& cells, std::span<const std::unique_ptr<DimmedSegments>> media,
                         PathStates& paths, const SlotList& rays, EmissionSegments& segments);

}  // namespace brume
