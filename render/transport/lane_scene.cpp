#include "render/transport/lane_scene.h"

#include <algorithm>
#include <cmath>

#include "volume/gradient.h"

namespace brume {

void set_cells(LaneCells& c, const LaneGrid& grid) {
  c.majorant = grid.majorant.data();
  c.brick = grid.brick.data();
  c.values = grid.values;
  c.nx = static_cast<float>(grid.nx);
  c.ny = static_cast<float>(grid.ny);
  c.nz = static_cast<float>(grid.nz);
  c.nz_int = grid.nz;
  c.cell = static_cast<float>(grid.cell_size);
  c.inverse_cell = 1.0f / std::max(c.cell, 1.0f);
  c.stored = grid.cell_size + 1;
}

double lane_unit(const Medium& medium) {
  return std::exp2(std::round(std::log2(medium.voxel_size())));
}

namespace {

void set_medium(LaneScene& s, const Medium& medium, double first_majorant) {
  s.unit = lane_unit(medium);
  s.sigma = static_cast<float>(medium.extinction_per_density() * s.unit);
  s.first_sigma = static_cast<float>(medium.extinction_per_density() * s.unit * first_majorant);
  const dmat3& m = medium.placement().local_from_world();
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      s.local_from_world[row][column] = static_cast<float>(m[column][row] * s.unit);
  for (int column = 0; column < 3; ++column) {
    dvec3 axis(0);
    axis[column] = 1;
    const dvec3 g = medium.gradient_to_world(axis);
    for (int row = 0; row < 3; ++row) s.gradient_to_world[row][column] = static_cast<float>(g[row] * s.unit);
  }
  s.least_gradient = static_cast<float>(kLeastGradient * medium.maximum_density() / medium.majorant_factor());
  s.coloured = medium.coloured() || (medium.instances() && medium.instances()->tinted());
  if (medium.phase().is_henyey_greenstein())
    s.g = static_cast<float>(medium.phase().first.g);
  else
    s.phase = &medium.phase();
  s.chromatic = medium.chromatic();
  for (int c = 0; c < 3; ++c) {
    s.albedo[c] = static_cast<float>(medium.albedo()[c]);
    s.extinction_ratio[c] = static_cast<float>(medium.extinction_ratio()[c]);
  }
  s.medium = &medium;
}

void set_displacement(LaneScene& s, const Displacement& displacement, const DisplacedLaneGrid& grids) {
  s.displaced = true;
  set_cells(s.density, grids.density);
  for (size_t a = 0; a < 3; ++a) {
    set_cells(s.displacement[a], grids.displacement[a]);
    s.origin_shift[a] = static_cast<float>(displacement.origin_shift[static_cast<int>(a)]);
  }
  s.open = static_cast<float>(displacement.open);
  s.close = static_cast<float>(displacement.close);
}

void set_lights(LaneScene& s, const Lights& lights, bool recorded) {
  if (lights.local() || s.samples_fields || recorded || lights.suns().size() > kMostLaneSuns) {
    s.lights = &lights;
    return;
  }
  double end = 0;
  const dvec3 anywhere(0);
  for (const Sun* sun : lights.suns()) {
    const double share = lights.choice(false).probability(*sun, anywhere);
    if (!(share > 0)) continue;
    LaneScene::SunLight& lane_sun = s.suns[s.sun_count++];
    const Frame frame(sun->axis());
    for (int a = 0; a < 3; ++a) {
      lane_sun.x[a] = static_cast<float>(frame.x[a]);
      lane_sun.y[a] = static_cast<float>(frame.y[a]);
      lane_sun.z[a] = static_cast<float>(frame.z[a]);
      lane_sun.radiance[a] = static_cast<float>(sun->delta() ? sun->irradiance()[a] : sun->disc_radiance()[a]);
    }
    lane_sun.delta = sun->delta();
    lane_sun.group = sun->group;
    lane_sun.one_minus_cos = sun->delta() ? 0.0f : static_cast<float>(sun->one_minus_cos());
    lane_sun.pdf = sun->delta() ? 1.0f : static_cast<float>(1.0 / (2.0 * kPi * sun->one_minus_cos()));
    lane_sun.share = static_cast<float>(share);
    lane_sun.share_end = static_cast<float>(end += share);
  }
  const double share = lights.choice(false).probability(*lights.environment(), anywhere);
  if (share > 0) {
    s.environment = lights.environment();
    s.environment_share = static_cast<float>(share);
  }
}

}  // namespace

LaneScene lane_scene(const PathContext& context, size_t number, WorldPaths& world) {
  const Medium& medium = context.media[number];
  LaneScene s{};
  if (context.plan.media[number] == Precision::kLanes) {
    const LaneGrid& grid = context.lane_grids[number];
    set_cells(s, grid);
    s.distances = grid.distances.data();
    s.isosurface_cell = grid.isosurface_cell.data();
    s.isosurface_density = static_cast<float>(context.isosurface_density * medium.maximum_density());
    if (const Displacement* const d = medium.displacement()) set_displacement(s, *d, context.displaced_grids[number]);
    if (medium.detail()) {
      s.detail = lane_detail(*medium.detail());
      s.detail.cells = s;
      if (const LaneGrid& small = context.displaced_grids[number].density; small.values && !s.displaced) {
        set_cells(s.detail.cells, small);
        s.detail.cells.stored = s.stored;
      }
    }
  }
  set_medium(s, medium, context.plan.first_collision.majorant);
  s.stop = context.stop;
  s.roulette_start = context.roulette_start;
  s.max_events = context.max_events;
  s.interpolate = context.plan.interpolate;
  s.samples_fields = context.plan.samples_fields(number);
  s.aims_at_fields = context.plan.aims_at_fire && s.samples_fields;
  if (context.plan.light_sampling) set_lights(s, *context.lights, context.plan.layers.records);
  s.near_lights = context.plan.near_lights;
  s.world = &world;
  s.grouped = !context.lights->groups().empty();
  s.keeps_local = context.plan.one_grid;
  s.flights_end = !s.keeps_local || context.plan.finite_lights;
  s.shadows_end = !s.keeps_local || s.lights != nullptr;
  return s;
}

}  // namespace brume
