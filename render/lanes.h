#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "render/lights.h"
#include "render/path_layers.h"

// What the kernels of render/wavefront.h share: the scene and the paths in single precision, one array per member.

namespace brume {

constexpr size_t kPool = 2048;   // paths in flight per thread: their state stays in the second-level cache
constexpr size_t kPadding = 64;  // lists may be read past their end, up to a vector: into slots that nobody owns
constexpr size_t kMostSuns = 16;

/// A LaneGrid as the kernels need it.
struct LaneCells {
  const float* majorant;
  const int32_t* brick;
  const float* values;
  float nx, ny, nz;
  int32_t nz_int;
  float cell, inverse_cell;  // voxels along a cell
  int32_t stored;            // values along a brick
};

/// The scene, in single precision; the cells are the medium's.
struct LaneScene : LaneCells {
  const uint8_t* distances;
  const int32_t* surface_cell;
  float sigma;  // extinction per density
  float local_from_world[3][3];
  float gradient_to_world[3][3];
  float least_gradient;                  // per voxel: below it, wider differences are needed
  float first_sigma;                     // the same of the first flight's majorants, which may be looser
  float g = 0;                           // of the phase function, where it is Henyey-Greenstein's
  const PhaseFunction* phase = nullptr;  // the others
  float albedo[3];
  bool coloured;  // another albedo at every point
  int roulette_start;
  int max_events;
  bool interpolate;
  float surface_density;

  struct LaneSun {
    float x[3], y[3], z[3];  // a frame around its axis, world space
    float one_minus_cos, pdf, share_end, share;
    float radiance[3];
    bool delta;
  };
  LaneSun suns[kMostSuns];
  size_t sun_count = 0;
  /// Sampled by the remaining share of the choice; null where none is.
  const Environment* environment = nullptr;
  float environment_share = 0;
  /// All of them, where one has a place and the choice between them depends on the point; else null, and the above.
  const Lights* lights = nullptr;
  const Medium* medium;
  bool flights_end = false;  // on a light
};

/// State of the paths of one thread, one array per member.
struct LanePool {
  template <class T>
  using Column = std::array<T, kPool + kPadding>;
  Column<float> ox, oy, oz;    // position: local coordinates of the bricks
  Column<float> dx, dy, dz;    // direction: world, unit
  Column<float> lx, ly, lz;    // the same in local coordinates
  Column<float> sx, sy, sz;    // direction of the shadow ray, local
  Column<float> tr, tg, tb;    // throughput
  Column<float> cr, cg, cb;    // what the shadow ray brings if nothing dims it
  Column<float> reach;         // where a flight ends on a light at the latest; only where flights_end
  Column<float> shadow_reach;  // how far the sample of the light is; only where LaneScene::lights
  Column<float> pdf;           // of the last direction
  Column<float> transmittance;
  Column<float> passed;  // share of the camera ray that passed the medium
  Column<float> direct_r, direct_g, direct_b, indirect_r, indirect_g, indirect_b;
  Column<uint32_t> s0, s1, s2, s3;  // generator: xoshiro128++
  Column<uint32_t> events;
  Column<uint32_t> request;  // which of the batch
};

/// A list of slots, padded so that whole vectors can be read.
struct SlotList {
  std::array<int32_t, kPool + kPadding> slot;
  size_t count = 0;
  void pad() {
    std::fill(slot.begin() + static_cast<std::ptrdiff_t>(count),
              slot.begin() + static_cast<std::ptrdiff_t>(count + kPadding), static_cast<int32_t>(kPool));
  }
  void push(int32_t s) { slot[count++] = s; }
};

/// Points whose density gradient is wanted.
struct LanePoints {
  LanePool::Column<float> x, y, z;     // local coordinates of the bricks
  LanePool::Column<float> gx, gy, gz;  // its direction, world space; 0 where it is too small to tell
  SlotList slots;                      // whose they are
};

/// What walks along the camera rays leave for the layers, by slot.
struct LaneCamera {
  LanePool::Column<float> begin;                              ///< ray parameter where the walk to the surface begins
  LanePool::Column<float> covered;                            ///< 1 where the ray meets the surface
  LanePool::Column<float> gx, gy, gz;                         ///< direction of the density gradient there, world space
  LanePool::Column<float> depth;                              ///< optical depth, clamped at 50
  std::array<LanePool::Column<float>, kMarchedPoints> point;  ///< ray parameters, -1 past the end
};

/// Where rays meet the medium's surface: between two ray parameters.
struct LaneMeetings {
  LanePool::Column<float> outside, inside;
  LanePool::Column<float> below, above;  // the densities there; negative where that was not looked up
  SlotList slots;
};

/// The rays of one pixel in a list, so close to each other that they are walked together: see LaneGrid::Meeting.
struct LaneBundle {
  size_t begin, end;
  int axis, layer;
};

/// A field that glows: its cells, and the emission coefficient as a function of its value, linear between entries.
struct LaneGlow : LaneCells {
  std::array<const float*, 3> colour;  // the entries, by channel
  float lowest, scale, last;           // of the values; entries per value; number of the last entry
};

/// Stretches of flights that lie in such a field, by slot.
struct LaneStretches {
  LanePool::Column<float> ox, oy, oz, dx, dy, dz;  ///< rays in local coordinates of the field
  LanePool::Column<float> end;                     ///< ray parameter
  LanePool::Column<float> stride;                  ///< voxels that one look-up stands for
  LanePool::Column<float> r, g, b;                 ///< the result
};

/// A sample of one of the lights from a point, without radiance where another is in its way.
LightSample sample_lights(const Lights& lights, const dvec3& p, double choice, const dvec2& u);

// The kernels, for the best instruction set of the machine.

/// Flies the rays of a list to their next real collision, whose position becomes the path's, or out of the grid, or to
/// their reach.
void lanes_fly(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList& hits, SlotList& escapes,
               uint64_t& lookups);

/// Leaves the transmittance along each shadow ray, as far as its reach, in `transmittance`, by ratio tracking.
void lanes_shadow(const LaneScene& scene, LanePool& pool, const SlotList& rays, uint64_t& lookups);

/// Finds where the density along each ray first reaches `surface_density`, voxel by voxel from `begin` on, and adds it
/// to the meetings.
void lanes_find_surface(const LaneScene& scene, const LanePool& pool, const SlotList& rays, const LaneCamera& camera,
                        LaneMeetings& meetings);

/// The same for bundles, half a layer of voxels at a time.
void lanes_find_surface(const LaneScene& scene, const LanePool& pool, const SlotList& rays,
                        std::span<const LaneBundle> bundles, LaneMeetings& meetings);

/// The points half a voxel behind the surface, where central differences see the medium on both sides.
void lanes_surface_points(const LaneScene& scene, const LanePool& pool, LaneMeetings& meetings, LanePoints& points);

/// Forced first collisions: flies the camera rays through the whole grid or to their reach, leaves their transmittance
/// in `passed`, and scatters the rest of each at one of its tentative collisions, its throughput being the share that
/// is scattered. Rays with nothing to scatter escape.
///
/// Where the medium is thin, most flights would pass it: here each of them brings its light.
/// Source: our combination of ratio tracking with reservoir sampling of the tentative collisions; the aim is that of
/// Villemin, Wrenninge, Fong 2018, Efficient Unbiased Rendering of Thin Participating Media.
void lanes_fly_first(const LaneScene& scene, LanePool& pool, const SlotList& rays, SlotList& hits, SlotList& escapes,
                     uint64_t& lookups);

/// Optical depth of each ray from one look-up per voxel length, at an offset drawn for the ray, of one voxel by its
/// trilinear weight: without bias. The points lie where exp(-optical depth) passes a random level in each quarter of
/// [0, 1]. Draws from a copy of the path's generator.
void lanes_march(const LaneScene& scene, LanePool& pool, const SlotList& rays, LaneCamera& camera);

/// Central differences of the interpolated density, as volume/gradient.h.
void lanes_gradient(const LaneScene& scene, LanePoints& points);

/// The integral of the emission coefficient along each stretch: one look-up for each stride, all of them at the same
/// place in it, which is drawn for each stretch.
void lanes_glow(const LaneGlow& glow, LanePool& pool, const SlotList& rays, LaneStretches& stretches);

/// The event at the end of a flight: absorption, a sample of one light, roulette, a new direction.
/// @param shadows  those whose light sample is worth a shadow ray   @param alive  those that go on
void lanes_scatter(const LaneScene& scene, LanePool& pool, SlotList& slots, SlotList& shadows, SlotList& alive,
                   uint64_t& capped_paths, double& capped_throughput);

}  // namespace brume
