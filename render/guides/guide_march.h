#pragma once
#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"
#include "render/guides/guide_media.h"
#include "render/guides/guide_sums.h"
#include "render/guides/light_fields.h"
#include "render/guides/lit_surface.h"
#include "render/guides/node_fields.h"
#include "render/guides/ray_march.h"
#include "render/transport/integrator.h"
#include "render/world/camera.h"

namespace brume {

class GuideLayers;
class MediaLine;

/// Camera rays through the light of LightFields, for one colour: one ray for each pixel that is small against voxels,
/// four for larger ones, sixteen at edges of surfaces; through a lens or where anything moves four, or sixteen where
/// those four differ. A sketch has one for each pixel, in steps twice as long.
class GuideMarch {
 public:
  GuideMarch(const PathContext& context, const std::vector<GuideMedia>& media, const LightFields& fields,
             GuideColour colour, const Camera& camera, double step_voxels, bool sketch, const Task& task);

  /// Told of pixels from..to of the window that are in the frame, from any thread, one at a time.
  using Marched = std::function<void(const ivec2& from, const ivec2& to)>;
  /// Adds the layers of the pixels from `corner` on to `frame`.
  void record(const ivec2& corner, Layers& frame, const Task& task) const { record({this}, corner, frame, task, {}); }
  /// The same of several colours, tile by tile.
  /// @param done  null, or told of each tile; they come from the middle of the window outwards then
  static void record(const std::vector<const GuideMarch*>& colours, const ivec2& corner, Layers& frame,
                     const Task& task, const Marched& done);

 private:
  struct Pixel;
  struct Piece;
  class Tile;
  /// A camera ray, the size of the square of film that it stands for [px], and how it is marched: by steps so many
  /// times longer than those of a pixel's only ray, the first one shortened by a share of it, so that the steps
  /// of a pixel's rays lie between one another.
  struct Eye {
    dvec2 film, lens{0.5};
    double time = 0, cell = 1, stride = 1, offset = 0;
  };
  /// What a ray sees, by the events that the light has gone through on it: none, or more.
  struct Seen {
    dvec3 straight{0}, scattered{0};
    void add(const dvec3& weight, const Seen& other) {
      straight += weight * other.straight;
      scattered += weight * other.scattered;
    }
  };
  struct Way;
  /// Whether rays of one pixel differ by more than where they meet the film.
  bool blurred() const;
  /// Rays of a pixel along each of its sides, where nothing is blurred.
  int rays_across() const;
  /// Whether a pixel's corners see unlike surfaces or lights.
  bool shows_edge(const ivec2& pixel) const;
  /// The first surface on a camera ray that such rays see.
  std::optional<SurfaceHit> first_seen(const Ray& ray) const;
  /// One of a pixel's rays. @param across  of them along each of its sides
  Eye eye(const ivec2& pixel, int ray, int across) const;
  /// Transmittance of what lies before a point; and what light has more from there that was only scattered by forward
  /// peaks, which count as straight on.
  struct Passed {
    double straight = 1, peaks = 0;
  };
  /// What the march knows of the media at one of the shutter's times.
  const MarchScene& scene_at(size_t time) const { return marched_[time].scene; }
  /// @param straight  length of a piece of a ray times its transmittance   @param scaled  the same without the forward
  ///                  peak   @param depth  optical depth before it
  void add_emission(const dvec3& coefficient, double straight, double scaled, double depth, GuideSums& sums) const;
  /// Of the only medium, or of one with that mean cosine.
  /// @param spread  mean cosine of the light's directions to their middle, which `cosine` is of
  double phase_value(const GuideMedia& media, double cosine, double g, double spread) const;
  void look_from(const GuideMedia& media, double cosine, double g, double spread, size_t group, Pixel& pixel) const;
  /// The same of parallel light where the mean cosine changes from place to place.
  void look_from_sun(const GuideMedia& media, const Ray& ray, double g, size_t group, Pixel& pixel) const;
  /// Which of the shutter's times media are of.
  size_t time_of(const GuideMedia& media) const { return static_cast<size_t>(&media - media_.data()); }
  /// Where the light of what is at a point was solved: it may move.
  dvec3 in_light(const GuideMedia& media, const dvec3& p) const;
  /// Adds light of nodes that a piece of a ray scatters towards the eye.
  void add_fields(const Piece& wide, const GuideMedia& media, const Ray& ray, Pixel& pixel) const;
  /// The same of a sun or lamp, whose direction and optical depth are known.
  void add_sharp_light(const Piece& piece, const GuideMedia& media, const Ray& ray, size_t group, Pixel& pixel) const;
  void collect_fields(GuideSums& sums) const;

  // guide_surfaces.cpp: what surfaces reflect.
  void add_surface(const Eye& eye, const Ray& ray, const SurfaceHit& hit, const Passed& passed, const GuideMedia& media,
                   MediaLine& line, GuideSums& sums) const;
  /// A point of a surface as its shading sees it.
  struct Shaded {
    dvec3 on, p;       ///< on the surface, and a margin in front of it
    dvec3 normal, wo;  ///< the normal lies on the side of wo, which points back along the ray
    bool inside;       ///< of the solid
    Bsdf bsdf;
    Frame frame;
    dvec3 to_frame(const dvec3& d) const { return {glm::dot(d, frame.x), glm::dot(d, frame.y), glm::dot(d, frame.z)}; }
  };
  Shaded shaded(const Ray& ray, const SurfaceHit& hit) const;
  Surroundings surroundings() const;
  /// Light of a group that a surface reflects once.
  Lit light_on(const Shaded& at, size_t group) const;
  /// What a diffuse surface reflects of all light that was scattered or reflected before it arrives in any direction.
  dvec3 indirect_light_on(const Shaded& at) const;
  dvec3 highlight(const Shaded& at, const Light& light) const;

  // guide_mirrors.cpp: rays that go on from metals and glass.
  void gather_light(const Task& task);
  Seen look(const Ray& ray, const GuideMedia& media, MediaLine& line, const Way& way) const;
  Seen bounce(const Shaded& at, const SurfaceHit& hit, const GuideMedia& media, MediaLine& line, const Way& way) const;
  Passed see_media(const Ray& ray, const GuideMedia& media, MediaLine& line, double t_max, double spread,
                   Seen& seen) const;
  dvec3 lights_ahead(const Ray& ray, const FiniteLight* light, double distance, const Way& way) const;
  Seen mirrored(const Eye& eye, const Shaded& at, const SurfaceHit& hit, const GuideMedia& media,
                MediaLine& line) const;
  dvec3 colour_of(const SolvedLight& light) const { return light.group.colour_in(colour_); }

  // guide_prediction.cpp: all of them together.
  /// Of light that several media of unlike tints scatter at one place, what is predicted of it.
  void add_tinted(const Piece& piece, const float* fields, Pixel& pixel) const;
  vec3 predicted_direct(const GuideSums& sums) const;
  vec3 predicted_indirect(const GuideSums& sums) const;

  const PathContext& context_;
  const std::vector<GuideMedia>& media_;
  const LightFields& fields_;
  const GuideColour colour_;
  const Camera& camera_;
  const bool sketch_;
  static constexpr int kMostRaysAcross = 4;  // of a pixel that shows the edge of a surface or light
  double step_ = 1;                          // [world units]
  double even_stride_ = 1, reference_depth_ = 0;
  double gentle_gradient_ = 0;  // of the extinction per step
  double look_apart_ = 0;       // between two look-ups of the fields at nodes [steps]

  /// As the march reads them, at one time of the shutter.
  struct MarchedMedia {
    std::vector<LaneGrid> cells;
    std::vector<MarchedGrid> grids;
    std::vector<MarchedSun> suns;
    std::vector<MarchedFields::Group> groups;
    MarchScene scene;
  };
  MarchedMedia marched(size_t time) const;
  std::vector<MarchedMedia> marched_;

  OrderTint tint_;  // of the first medium
  NodeFields node_fields_;
  // On the coarse lattice, in every colour: moments of the light scattered once, but for suns and lamps with guides of
  // their own, and of the light scattered more often. Empty where no surface mirrors or refracts.
  NodeValues node_light_;
};

}  // namespace brume
