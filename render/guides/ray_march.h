#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "render/transport/lane_scene.h"

// Camera rays through the media, a vector of them side by side, in single precision. Lengths along a ray are in steps
// (GuideMarch's), from a place near where the ray enters the media; extinctions are per step.

namespace brume {

inline constexpr size_t kMostMarchedGrids = 4, kMostMarchedSuns = 2;

/// A medium that is a still grid of one albedo.
struct MarchedGrid {
  LaneCells cells;
  float extinction;       ///< per density
  float albedo, g;        ///< mean cosine of the phase function
  float inverse_maximum;  ///< of the density
  float tint[3];          ///< of light scattered once
  float gradient[3][3];   ///< from the change of the density per voxel to that of the extinction per step, world axes
};

/// Parallel light in a single medium, whose angle does not change along a ray.
struct MarchedSun {
  const uint16_t* roots;  ///< of optical depths, on a lattice (SunDepth)
  int32_t n[3];           ///< nodes along a column, and across; columns lie in rows
  float root_step;
  float irradiance;
  bool shadowed;  ///< by surfaces: RayMarchHost::sun_visible knows by how much
};

/// Light that is kept at the nodes of a lattice, several fields interleaved.
struct MarchedFields {
  const float* values = nullptr;  ///< of the first node, x slowest; vectors may be read beyond the last node's
  int32_t n[3] = {};              ///< nodes
  int32_t count = 0;              ///< fields
  /// Of which more is wanted than MarchedRay::plain and scaled have.
  struct Group {
    int32_t tail;
    int32_t single = -1, forward = -1;  ///< of the sky
  };
  std::span<const Group> groups;
  static constexpr int32_t kMost = 64;  ///< of fields; arrays of sums have room for so many
};

/// What does not change from ray to ray.
struct MarchScene {
  std::span<const MarchedGrid> grids;  ///< of all media; empty: RayMarchHost::look knows what is there
  std::span<const MarchedSun> suns;    ///< whose light is added up here
  MarchedFields fields;                ///< without values: RayMarchHost::fields is called
  bool other_lights;                   ///< RayMarchHost::light is to be called for more suns and lamps
  bool emits;                          ///< RayMarchHost::emit is to be called
  bool mixed_tints;                    ///< pieces keep the tint of what scatters
  bool even;                           ///< homogeneous stretches are crossed faster: RayMarchHost::even_steps
  float scaled_extinction;             ///< share of the extinction without the forward peak
  float gentle_gradient;               ///< below which gradients count less
  float look_apart;                    ///< between two look-ups of the fields at nodes [steps]
};

/// A ray, how it is marched, and what was found along it.
struct MarchedRay {
  struct Place {
    float start[3], along[3];  ///< at 0, and its change per step
  };
  std::array<Place, kMostMarchedGrids> grid;  ///< [voxels]
  struct Sun {
    Place place;     ///< on its lattice
    float phase[4];  ///< phase function with the mean cosine, a half, a quarter, an eighth of it
    float peak[8];   ///< ForwardPeak::coefficients
  };
  std::array<Sun, kMostMarchedSuns> sun;
  Place nodes;  ///< on the fields' lattice
  struct FieldSums {
    float tail[3] = {}, single = 0, forward = 0;  ///< weighted by w2, w4, w8; by albedo times w and scaled
  };
  float *plain = nullptr, *scaled = nullptr;  ///< to which fields are added, weighted by w and by MarchedPiece::scaled
  FieldSums* groups = nullptr;                ///< likewise
  float stride = 1;                           ///< steps are so many times longer, except in thick media
  float offset = 0;                           ///< share of a step by which the first one is shortened
  /// Of [begin, end) in which anything may be found: in order and apart from one another.
  uint32_t first_part = 0, last_part = 0;

  float passed = 1, passed_scaled = 1;  ///< transmittance, and the same without the forward peak
  float seen = 0;                       ///< 1 - transmittance, sum of the weights of
  float first = 0;                      ///< where anything was seen first
  float distance = 0, distance2 = 0;    ///< from there, and its square
  float density = 0;                    ///< share of the largest
  float gradient[3] = {};               ///< of the extinction, its direction
  struct SunLight {
    float single = 0, forward = 0, octave[3] = {}, soft[4] = {};  ///< as GroupSums
  };
  std::array<SunLight, kMostMarchedSuns> light;
};

/// A piece of a ray whose light is looked up at once: weights of what is seen of it, with the extinction, a half, a
/// quarter, an eighth of it, and without the forward peak; sums over it, weighted by thickness.
struct MarchedPiece {
  float begin, end;
  float w, w2, w4, w8, scaled;
  float thickness, distance, depth, albedo, g;
  float tint[3];  ///< times albedo
};

/// What the march cannot do side by side. Rays are named by their place in the list.
class RayMarchHost {
 public:
  virtual ~RayMarchHost() = default;
  struct Point {
    float extinction = 0, density = 0, albedo = 0, g = 0;  ///< as of MarchedGrid, of all media together
    float tint[3] = {1, 1, 1};
    float gradient[3] = {};  ///< of the extinction, world axes
  };
  virtual Point look(size_t ray, float t) = 0;
  /// How many steps can be taken at once from t on.
  virtual float even_steps(size_t ray, float t, float end) = 0;
  /// @param straight  length of what emits times its transmittance   @param scaled  the same without the forward peak
  /// @param depth     optical depth before it
  virtual void emit(size_t ray, float t, float straight, float scaled, float depth) = 0;
  virtual float sun_visible(size_t ray, size_t sun, float t) = 0;
  /// Adds the light of suns and lamps that are not in MarchScene::suns.
  virtual void light(size_t ray, const MarchedPiece& piece) = 0;
  /// Adds light that is kept at nodes.
  virtual void fields(size_t ray, const MarchedPiece& piece) = 0;
};

/// Marches rays to their ends. What is found of a ray does not depend on the others, nor on the instruction set; the
/// calls of `host` for one ray come in order.
/// @param parts  pairs of begin and end
void march_rays(const MarchScene& scene, std::span<MarchedRay> rays, std::span<const float> parts, RayMarchHost& host);

}  // namespace brume
