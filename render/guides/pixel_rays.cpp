#include "render/guides/pixel_rays.h"

#include <cmath>

namespace brume {
namespace {

// Of a step where a pixel has several rays, as far as the medium is thin.
constexpr double kManyRaysStride = 1.5;
constexpr double kEdgeCosine = 0.9;  // between the normals at a pixel's corners
constexpr int kMostUnseen = 8;       // surfaces that a camera ray goes through

}  // namespace

PixelRays::PixelRays(const PathContext& context, const Camera& camera, const GuideMedia& media, bool moving,
                     bool sketch)
    : context_(context), camera_(camera), blurred_(camera.has_lens() || camera.moves() || moving), sketch_(sketch) {
  if (sketch) return;
  const dvec3 middle = 0.5 * (media.lo() + media.hi());
  const dvec2 pixel = 0.5 * dvec2(camera_.film_size());
  const Ray a = camera_.ray(pixel), b = camera_.ray(pixel + 1.0);
  const double distance = glm::distance(a.o, middle);
  if (blurred_ || glm::distance(a.at(distance), b.at(distance)) > 0.75 * std::sqrt(2.0) * media.grain() * media.voxel())
    across_ = 2;
}

CameraSample PixelRays::sample(const ivec2& pixel, int ray, int across) const {
  CameraSample s;
  s.cell = 1.0 / across;
  s.film = dvec2(pixel) + s.cell * (dvec2(ray % across, ray / across) + 0.5);
  if (sketch_) s.time = 0.5;
  if (across == 1) return s;
  s.stride = kManyRaysStride;
  if (!blurred_) {
    s.offset = ray % 4 / 4.0;
  } else if (across == 2) {
    // Opposite sides of the lens, as far from its middle as its points are on average.
    s.lens = dvec2(0.5) + 0.35 * (dvec2(ray * 2 / 4, ray % 2) * 2.0 - 1.0);
    s.time = ((ray * 3 + 1) % 4 + 0.5) / 4;
    s.offset = ray / 4.0;
  } else {
    // Sixteen points of the lens and as many times, in an order unlike the rays'.
    s.lens = (dvec2(ray * 7 % 16, ray * 11 % 16) + 0.5) / 16.0;
    s.time = ((ray * 5 + 3) % 16 + 0.5) / 16;
    s.offset = ray * 3 % 16 / 16.0;
  }
  return s;
}

bool PixelRays::shows_edge(const ivec2& pixel) const {
  std::optional<SurfaceHit> first;
  const FiniteLight* first_light = nullptr;
  // Through the rim of a lens, and at both ends of the shutter.
  for (int corner = 0; corner < 4; ++corner) {
    const dvec2 square(corner % 2, corner / 2);
    const Ray ray = camera_.ray(dvec2(pixel) + square, square, corner == 0 || corner == 3 ? 0.0 : 1.0);
    const std::optional<SurfaceHit> hit = first_hit(ray);
    const FiniteLight* const light = context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/true).first;
    if (corner == 0) {
      first = hit;
      first_light = light;
    } else if (light != first_light || hit.has_value() != first.has_value() ||
               (hit && (hit->surface != first->surface || glm::dot(hit->shading, first->shading) < kEdgeCosine))) {
      return true;
    }
  }
  return false;
}

std::optional<SurfaceHit> PixelRays::first_hit(const Ray& ray) const {
  if (!context_.surfaces) return std::nullopt;
  double from = 0;
  for (int unseen = 0; unseen < kMostUnseen; ++unseen) {
    std::optional<SurfaceHit> hit =
        context_.surfaces->intersect({ray.at(from), ray.d}, kFar, Surfaces::kMiddle, /*camera=*/true);
    if (!hit) break;
    hit->t += from;
    if (context_.surfaces->settings(hit->surface).role != "shadow_catcher") return hit;
    from = hit->t + 2 * hit->margin;
  }
  return std::nullopt;
}

}  // namespace brume
