#pragma once
#include <array>
#include <vector>

#include "render/integrator.h"
#include "render/lanes.h"
#include "volume/lane_grid.h"

// The scene as the kernels of render/lanes.h need it.

namespace brume {

void set_cells(LaneCells& cells, const LaneGrid& grid);

/// Refers to the context's grid, media and lights. @param context  of a plan that fits the lanes
LaneScene lane_scene(const PathContext& context);

/// A field that glows, as the kernels need it.
struct GlowField {
  GlowField(const EmissionField& field, const LaneGrid& grid);
  GlowField(const GlowField&) = delete;  // the lanes refer to its table

  const Medium& shape;
  Solid box;
  std::array<std::vector<float>, 3> table;
  LaneGlow lanes{};
};

}  // namespace brume
