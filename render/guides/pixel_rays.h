#pragma once
#include <optional>

#include "render/guides/guide_media.h"
#include "render/transport/integrator.h"
#include "render/world/camera.h"

namespace brume {

/// One of a pixel's rays: where it meets film and lens, the size of the square of film that it stands for [px], and how
/// it is marched: by steps so many times longer than those of a pixel's only ray, the first one shortened by a share of
/// it, so that the steps of a pixel's rays lie between one another.
struct CameraSample {
  dvec2 film, lens = Camera::kLensMiddle;
  double time = 0, cell = 1, stride = 1, offset = 0;
};

/// Which rays a pixel has: one where it is small against voxels, four where it is larger, sixteen at edges of surfaces;
/// through a lens or where anything moves four, or sixteen where those four differ.
class PixelRays {
 public:
  /// @param sketch  one ray for each pixel
  PixelRays(const PathContext& context, const Camera& camera, const GuideMedia& media, bool moving, bool sketch);

  static constexpr int kMostAcross = 4;
  /// Rays of a pixel along each of its sides, where nothing more is known of it.
  int across() const { return across_; }
  /// Whether rays of one pixel differ by more than where they meet the film.
  bool blurred() const { return blurred_; }
  /// Whether a pixel's corners see unlike surfaces or lights.
  bool shows_edge(const ivec2& pixel) const;
  CameraSample sample(const ivec2& pixel, int ray, int across) const;
  /// Points along each side of what a ray stands for.
  static constexpr int kParts = 3;
  /// One of kParts^2 points of the film, and of the lens, that a ray stands for, the one in the middle being its own.
  CameraSample part(const ivec2& pixel, int ray, int across, int number) const;
  /// One of kSkyRays that show what a lens makes of the sky behind one pixel.
  static constexpr int kSkyRays = 64;
  Ray sky_ray(const ivec2& pixel, int number) const;
  bool has_lens() const { return camera_.has_lens(); }
  /// Along the camera's axis.
  double depth(const CameraSample& s, const dvec3& p) const { return camera_.depth(p, s.time); }
  Ray ray(const CameraSample& s) const { return camera_.ray(s.film, s.lens, s.time); }
  /// The first surface on a camera ray that such rays see.
  std::optional<SurfaceHit> first_hit(const Ray& ray) const;

 private:
  const PathContext& context_;
  const Camera& camera_;
  const bool blurred_, sketch_;
  int across_ = 1;
};

}  // namespace brume
