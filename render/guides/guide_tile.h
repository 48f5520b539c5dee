#pragma once
#include <vector>

#include "render/guides/guide_march.h"
#include "render/guides/lit_pixels.h"
#include "render/guides/mirrored_rays.h"

namespace brume {

class GuideLayers;

/// A square of pixels whose rays are marched together: they cross the same bricks and nodes.
class GuideTile {
 public:
  static constexpr int kSide = 16;  // px

  /// @param deep  takes the pixels' parts; null: they are not made
  explicit GuideTile(const GuideMarch& march, DeepRecord* deep = nullptr);
  /// Traces the pixels from..to and stores them.
  void record(const ivec2& corner, const ivec2& from, const ivec2& to, const GuideLayers& layers);

 private:
  /// What a pixel's rays met, and how many they are.
  struct Traced {
    ivec2 at{0};
    int across = 1;
    double least = 1, most = 0;  ///< transmittance
    bool alike = true;
    std::optional<uint32_t> surface = {};
    double darkest = kFar, brightest = 0;  ///< sky behind
    bool near_lamp = false;
    bool sky_alone = true;  ///< nothing else is there
  };
  /// A camera ray and what ends it.
  struct CameraRay {
    size_t pixel;
    int number;  ///< of the pixel's rays
    CameraSample sample;
    std::optional<SurfaceHit> hit;
    const FiniteLight* light;
    double distance;  ///< to the light
  };

  /// Adds pixels of metals whose highlights are unlike those beside them.
  /// @param plain  pixels that are traced   @param width  of the tile
  void find_beams(const std::vector<size_t>& plain, int width, std::vector<size_t>& found) const;
  void find_highlight_edges(const std::vector<size_t>& plain, int width, std::vector<size_t>& found) const;
  void trace(const std::vector<size_t>& pixels, int across);
  /// One ray of each of the pixels.
  void trace_rays(const std::vector<size_t>& pixels, int ray, int across);
  void begin(size_t pixel, int ray, const CameraSample& sample, const MarchScene& scene);
  void end(const CameraRay& ray, const MarchedRay& marched);
  /// Looks through more of a lens at the sky alone.
  /// Sets GuideSums::shares.
  void find_shares(size_t pixel);
  void even_sky(size_t pixel);
  void add_media(const MarchedRay& marched, GuideSums& sums) const;
  /// @return what it reflects, as far as that is known before its mirrors are followed
  vec3 add_surface(const CameraRay& ray, const MarchedRay& marched, GuideSums& sums);
  /// Lit by every light through the media, and by the sky; metals, glass and coats show what they mirror.
  vec3 add_reflected(const CameraRay& ray, const ShadedPoint& at, double transmittance, double peaks, GuideSums& sums);

  const GuideMarch& march_;
  LitPixels lit_;
  MirroredRays mirrored_;
  std::vector<GuideSums> pixels_;
  std::vector<Traced> traced_;
  DeepRecord* const deep_;
  DeepPixels deep_pixels_;
  std::vector<std::vector<DeepRay>> deep_rays_;  // of each pixel; those of its rays are in use
  // Of the rays that are marched now, which all have one time of the shutter.
  std::vector<CameraRay> rays_;
  MarchBatch batch_;
};

}  // namespace brume
