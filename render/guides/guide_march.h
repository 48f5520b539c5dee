#pragma once
#include <array>
#include <string>
#include <vector>

#include "base/progress.h"
#include "image/layers.h"
#include "render/guides/guide_media.h"
#include "render/guides/light_fields.h"
#include "render/trace/integrator.h"
#include "render/world/camera.h"

namespace brume {

class MediaLine;

/// Camera rays through the light of LightFields, for one colour: one ray for each pixel that is small against voxels,
/// four for larger ones, sixteen where the camera has a lens or anything moves.
class GuideMarch {
 public:
  GuideMarch(const PathContext& context, const std::vector<GuideMedia>& media, const LightFields& fields,
             GuideColour colour, const Camera& camera, double step_voxels);

  /// Adds the layers of the pixels from `corner` on to `frame`.
  void record(const ivec2& corner, Layers& frame, const Task& task);

 private:
  struct Sums;
  struct Piece;
  /// Where a light's guides lie among the sums, and its fields among the interleaved ones.
  struct Slots {
    size_t single = 0, octave = 0, soft = 0, forward = 0, orders = 0, flux = 0, tail = 0;
    size_t field_orders = 0, field_single = 0, field_forward = 0, field_depth = 0, field_visible = 0;
  };
  enum Base : size_t { kOpacity, kDepth, kSpread, kGradient, kDensity = kGradient + 3, kBaseCount };

  void lay_out();
  void interleave(const Task& task);
  /// Rays of a pixel along each of its sides.
  int rays_across() const;
  void trace(const Ray& ray, const GuideMedia& media, MediaLine& line, Sums& sums) const;
  /// @return transmittance of what lies before t_max
  double march(const Ray& ray, const GuideMedia& media, MediaLine& line, double t_max, Sums& sums) const;
  void interpolate(const dvec3& world, float* values) const;
  void look_from(const GuideMedia& media, double cosine, double g, size_t group, Sums& sums) const;
  void light_of(const Piece& piece, const GuideMedia& media, const Ray& ray, Sums& sums) const;
  void collect_fields(Sums& sums) const;
  void add_surface(const Ray& ray, const SurfaceHit& hit, double passed, Sums& sums) const;
  dvec3 colour_of(const GroupLight& light) const;
  dvec3 tint() const;
  vec3 predicted_direct(const Sums& sums) const;
  vec3 predicted_indirect(const Sums& sums) const;

  const PathContext& context_;
  const std::vector<GuideMedia>& media_;
  const LightFields& fields_;
  const GuideColour colour_;
  const Camera& camera_;
  double step_ = 1, reference_depth_ = 0, gentle_ = 0;

  std::array<dvec3, GroupLight::kFirstOrder.size()> order_tint_{};  // what a colour makes of each guide of orders
  std::vector<Slots> slots_;                                        // for each group
  std::vector<std::string> names_;  // of the sums that are one number each, as layers without "guide."
  size_t field_count_ = 0;          // interleaved fields, a multiple of four
  NodeValues node_fields_;
};

}  // namespace brume
