#pragma once
#include <vector>

#include "render/guides/guide_pixel.h"
#include "render/guides/ray_march.h"

namespace brume {

/// A square of pixels whose rays are marched together: they cross the same bricks and nodes.
class GuideMarch::Tile final : RayMarchHost {
 public:
  static constexpr int kSide = 16;  // px

  explicit Tile(const GuideMarch& march);
  /// Traces the pixels from..to and stores them. @param across  rays of a pixel along each of its sides
  void record(const ivec2& corner, const ivec2& from, const ivec2& to, int across, const GuideLayers& layers);

 private:
  /// What a pixel's rays met, and how many they are.
  struct Traced {
    ivec2 at{0};
    int across = 1;
    double least = 1, most = 0;
    bool alike = true;
    std::optional<uint32_t> surface = {};
  };
  /// A camera ray on its way to what ends it.
  struct CameraRay {
    size_t pixel;
    Eye eye;
    Ray ray;
    std::optional<SurfaceHit> hit;
    const FiniteLight* light;
    double distance;       ///< to the light
    double start = 0;      ///< where the march counts its steps from
    bool in_hole = false;  ///< it ends on a holdout
  };

  void trace(const std::vector<size_t>& pixels, int across);
  /// One ray of each of the pixels.
  void trace_rays(const std::vector<size_t>& pixels, int ray, int across);
  void begin(size_t pixel, const Eye& eye);
  /// @return where the march is to end
  double find_end(CameraRay& ray) const;
  void set_parts(CameraRay& ray, MarchedRay& marched, double t_max);
  void set_places(const CameraRay& ray, MarchedRay& marched);
  void end(const CameraRay& ray, const MarchedRay& marched);
  Piece piece_of(const CameraRay& ray, const MarchedPiece& piece) const;
  dvec3 point(const CameraRay& ray, float t) const { return ray.ray.at(ray.start + march_.step_ * t); }

  Point look(size_t ray, float t) override;
  float even_steps(size_t ray, float t, float end) override;
  void emit(size_t ray, float t, float straight, float scaled, float depth) override;
  float sun_visible(size_t ray, size_t sun, float t) override;
  void light(size_t ray, const MarchedPiece& piece) override;
  void fields(size_t ray, const MarchedPiece& piece) override;

  const GuideMarch& march_;
  std::vector<Pixel> pixels_;
  std::vector<Traced> traced_;
  std::vector<MediaLine> lines_;  // by time of the shutter, for what surfaces mirror
  // Of the rays that are marched now, which all have one time of the shutter.
  const GuideMedia* media_ = nullptr;
  std::vector<CameraRay> rays_;
  std::vector<MarchedRay> marched_;
  std::vector<float> parts_;
  std::vector<std::pair<double, double>> intervals_;
  std::vector<std::vector<std::pair<double, double>>> uneven_;  // by ray: where media are not homogeneous
};

}  // namespace brume
