#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "render/guides/deep_pixels.h"
#include "render/guides/guide_sums.h"
#include "render/guides/light_fields.h"
#include "render/guides/media_line.h"
#include "render/guides/node_fields.h"
#include "render/guides/sharp_light.h"
#include "render/transport/lane_scene.h"
#include "volume/lane_grid.h"

// What the march of guides reads (ray_march.h). Lengths along a ray are in steps, from a place near where the ray
// enters the media; extinctions are per step.

namespace brume {

inline constexpr size_t kMostMarchedGrids = 4, kMostMarchedShapes = 4, kMostSharpLights = 4;

/// The march's unit of length, and what is counted in it.
struct MarchSteps {
  /// @param voxels  of a step
  MarchSteps(const GuideMedia& media, const LightFields& fields, GuideColour colour, double voxels);

  double length;            ///< [world units]
  double even_stride = 1;   ///< steps that are taken at once through media of closed form
  float gentle_gradient;    ///< of the extinction, per step: below it, gradients count less
  float field_spacing = 0;  ///< between two look-ups of the fields at nodes
};

/// A medium that is a still grid of one albedo.
struct MarchedGrid {
  size_t medium;
  LaneGrid stored;
  LaneCells cells;        ///< of it
  float extinction;       ///< per density
  float albedo, g;        ///< mean cosine of the phase function
  float inverse_maximum;  ///< of the density
  float tint[3];          ///< of light scattered once
  float seen;             ///< 1, of a holdout 0
  float gradient[3][3];   ///< from the change of the density per voxel to that of the extinction per step, world axes
  LaneDetail detail;
};

/// A homogeneous medium of one density.
struct MarchedShape {
  size_t medium;
  float extinction;  ///< per step
  float albedo, g;
  float tint[3];
  float seen;
};

/// A sun or a lamp.
struct MarchedLight {
  size_t group;
  const SharpLight* light;
  const SunDepth* sun = nullptr;   ///< optical depths towards it that are looked up in vectors; null for a lamp
  float irradiance = 0;            ///< of a sun
  bool varies = true;              ///< along a ray, so that MarchScene::update_terms is asked at every segment
  const float* visible = nullptr;  ///< share that surfaces leave, at the fields' nodes; null: all of it
  const float* depth = nullptr;    ///< of a lamp: optical depth towards it, at the same nodes
};

/// What decides how much of a sun or lamp a point of a ray scatters towards the eye.
struct LightTerms {
  float irradiance = 0;
  float table_entry = 0;  ///< of a lamp whose phases are tabulated: the place in each of MarchScene::phase_tables
  float mean_depth = 0;   ///< of a lamp: of the mean transmittance of all directions to it
  float phase[4] = {};    ///< with the mean cosine, a half, a quarter, an eighth of it
  float peak[8] = {};     ///< ForwardPeak::coefficients
  double g = 0;           ///< that those of a sun were made for
  float single = 0, forward = 0;  ///< what the segments since fields were added last have of it
};

/// A ray, how it is marched, and what was found along it.
struct MarchedRay {
  struct Place {
    float start[3], along[3];  ///< where steps are counted from, and its change per step
  };
  Ray ray;
  double start = 0;                            ///< of the steps [world units]
  std::array<Place, kMostMarchedGrids> grid;   ///< [voxels]
  std::array<vec2, kMostMarchedShapes> shape;  ///< where it is inside, from..to
  std::array<Place, kMostSharpLights> light;   ///< on a sun's lattice
  std::array<LightTerms, kMostSharpLights> terms;
  Place nodes;                                    ///< on the fields' lattice, in spacings
  std::optional<MediaLine> line;                  ///< where media are not looked up in vectors
  std::vector<std::pair<double, double>> uneven;  ///< parts of the ray in media without a closed form
  double level = 0;                               ///< longest step through fog that falls off [world units]
  /// Small lamps that it passes within a few steps: where, and the squared distance there [steps^2].
  std::array<vec2, kMostSharpLights> lamp;
  uint32_t lamps = 0;
  float stride = 1;                        ///< steps are so many times longer, except in thick media
  float offset = 0;                        ///< share of a step by which the first one is shortened
  uint32_t first_part = 0, last_part = 0;  ///< of MarchBatch::parts
  GuideSums* sums = nullptr;               ///< to which light is added that fields at nodes and emission have
  OrderTint tint;                          ///< of the media; where they differ, of the last part lit
  DeepSteps* deep = nullptr;               ///< keeps what is seen of each step; null: nothing

  float transmittance = 1, scaled_transmittance = 1;  ///< scaled: without the forward peak
  float opacity = 0;                                  ///< sum of the weights of what is seen
  float first = 0;                                    ///< where anything was seen first
  float distance = 0, distance2 = 0;                  ///< from there, and its square
  float density = 0;                                  ///< share of the largest
  vec3 gradient{0};                                   ///< of the extinction, its direction

  bool misses() const { return first_part == last_part; }
};

/// A ray before it is known what it meets.
struct RayToMarch {
  Ray ray;
  double t_max;
  GuideSums& sums;
  double stride = 1, offset = 0;  ///< as MarchedRay has them
};

/// Rays that are marched together; all have one time of the shutter.
struct MarchBatch {
  std::vector<MarchedRay> rays;
  std::vector<vec2> parts;  ///< of rays, from..to, in which anything may be found: in order and apart from one another
  std::vector<std::pair<double, double>> intervals;  // while a ray is aimed
  bool deep = false;                                 ///< some rays keep what is seen of each step

  void clear() {
    rays.clear();
    parts.clear();
  }
};

/// The fields that a march adds up.
struct MarchedFields {
  const NodeTable& table;
  const std::vector<NodeFields::Slots>* groups;  ///< of the lights; null: of no light in particular
  bool octaves;                                  ///< whether rays go on until an eighth of the extinction is opaque
};

/// Part of a ray that scatters light: fields at its middle, and its weights (docs/guides.md).
struct ScatteringPart {
  const float* fields;
  float w, scaled;  ///< with the extinction, and with that without the forward peak
  float unpeaked;   ///< scaled, of the whole extinction
  float albedo;
};

/// Media and lights at one time of the shutter, in one colour.
class MarchScene {
 public:
  MarchScene(const std::vector<GuideMedia>& media, size_t time, const LightFields& fields, GuideColour colour,
             const MarchSteps& steps);

  const MarchSteps steps;
  const Lattice& nodes;              ///< of what is known of lights
  std::vector<MarchedGrid> grids;    ///< and
  std::vector<MarchedShape> shapes;  ///< are all media; both empty: media are looked up point by point
  std::vector<MarchedLight> lights;  ///< suns and lamps with guides of their own
  bool emits, mixed_tints;
  bool holdouts;            ///< some media hide what is behind them and are not seen
  bool follows;             ///< light was solved where each of several media stood at another time
  bool mixed_peaks;         ///< media differ in their forward peaks
  float scaled_extinction;  ///< share of the extinction without the forward peak, on average

  /// A ray to march, in the batch. @param table  the lattice of the fields that are looked up along it
  MarchedRay& aim(const RayToMarch& ray, const Lattice& table, MarchBatch& batch) const;

  // What the march asks point by point, t steps from the start of a ray.
  struct Point {
    float extinction, albedo, g, density;  ///< of all media together
    vec3 gradient, tint;                   ///< the gradient of the extinction, world axes
    float seen;                            ///< share of the extinction that is of no holdout; albedo is of that
  };
  Point at(MarchedRay& ray, float t) const;
  /// The longest step beside small lamps, in steps: short beside the distance from them.
  static float step_near_lamps(const MarchedRay& ray, float t);
  /// How many steps can be taken at once from t on.
  float even_steps(const MarchedRay& ray, float t, float end) const;
  /// Adds emission. @param straight  length of what emits times its transmittance
  /// @param by_peaks  the same where forward peaks dim nothing   @param depth  optical depth of peaks before it
  void emit(const MarchedRay& ray, float t, float straight, float by_peaks, float depth) const;
  /// What changed in the terms of a light: nothing; all; all but phases and peaks, which are to be looked up at
  /// LightTerms::table_entry.
  enum class Changed { kNothing, kAll, kTableEntry };
  /// Sets ray.terms of a light. @param g  mean cosine there   @param depth  of a lamp: optical depth towards its middle
  Changed update_terms(MarchedRay& ray, size_t light, float t, float g, float depth) const;
  /// Where one medium is lit by lamps: phases and peaks of light from nearly one direction, at evenly spaced sines of
  /// half the angle from 0 to 1; one table after the other.
  std::vector<float> phase_tables;
  static constexpr int kPhaseEntries = 4096;  ///< entries of a table, less one
  /// Where the light of what is there was solved: it may move. World space
  dvec3 in_light(const MarchedRay& ray, float t) const;
  /// Makes the tint of a ray that of media which give light so much of each colour by one scattering.
  void set_tint(MarchedRay& ray, const dvec3& once) const;
  /// Adds light that a part of a ray scatters, coloured by the ray's tint.
  void add_scattered(const MarchedRay& ray, const MarchedFields& known, const ScatteringPart& part, dvec3& direct,
                     dvec3& indirect) const;

 private:
  dvec3 point(const MarchedRay& ray, float t) const { return ray.ray.at(ray.start + steps.length * t); }
  void place_in_media(MarchedRay& to) const;
  void place_at_nodes(MarchedRay& to, const Lattice& table) const;
  void place_beside_lamps(MarchedRay& to) const;
  void place_towards_suns(MarchedRay& to) const;
  void tabulate_phases();
  /// Phase function, octaves and forward peak. @param spread  mean cosine of the light's directions around their mean
  void set_phases(LightTerms& terms, double cosine, double g, double spread) const;

  const std::vector<GuideMedia>& media_;
  const GuideMedia& own_;  // of the time
  const LightFields& fields_;
  const GuideColour colour_;
};

}  // namespace brume
