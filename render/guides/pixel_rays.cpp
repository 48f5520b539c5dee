#include "render/guides/pixel_rays.h"

#include <cmath>

#include "base/golden_ratio.h"

namespace brume {
namespace {

// Of a step where a pixel has several rays, as far as the medium is thin.
constexpr double kManyRaysStride = 1.5;
constexpr double kEdgeCosine = 0.9;  // between the normals at a pixel's corners
constexpr int kMostUnseen = 8;       // surfaces that a camera ray goes through
// Sixteen rays, in fours: each four has a quarter of the pixel and of the lens, the first of it near their middles. So
// the first of all four stand for the pixel. Their squares of film (0 to 3 the top row), and sixteenths of a turn and
// of the area of the lens.
constexpr int kCells[] = {1, 4, 0, 5, 8, 13, 12, 9, 7, 2, 6, 3, 14, 11, 10, 15};
constexpr int kTurns[] = {1, 0, 3, 2, 5, 4, 7, 6, 9, 11, 8, 10, 13, 14, 12, 15};
constexpr int kAreas[] = {7, 8, 0, 13, 5, 9, 2, 12, 4, 1, 10, 15, 6, 3, 11, 14};
// Quarters of a turn of four rays: along x, and along y, film and lens are independent.
constexpr int kQuarters[] = {0, 2, 1, 3};
constexpr double kRim = 0.999;  // of the area of the lens

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
  const int cell = across == kMostAcross ? kCells[ray] : ray;
  s.film = dvec2(pixel) + s.cell * (dvec2(cell % across, cell / across) + 0.5);
  if (sketch_) s.time = 0.5;
  if (across == 1) return s;
  s.stride = kManyRaysStride;
  if (!blurred_) {
    s.offset = ray % 4 / 4.0;
  } else if (across == 2) {
    s.lens = camera_.lens_at((kQuarters[ray] + 0.5) / 4, 0.5);
    s.time = ((ray * 3 + 1) % 4 + 0.5) / 4;
    s.offset = ray / 4.0;
  } else {
    s.lens = camera_.lens_at((kTurns[ray] + 0.5) / 16, (kAreas[ray] + 0.5) / 16);
    s.time = ((ray * 5 + 3) % 16 + 0.5) / 16;
    s.offset = ray * 3 % 16 / 16.0;
  }
  return s;
}

CameraSample PixelRays::part(const ivec2& pixel, int ray, int across, int number) const {
  CameraSample s = sample(pixel, ray, across);
  // Each pair of film's x and y, the lens' area and its turn has all nine pairs of thirds.
  const int x = number % kParts, y = number / kParts;
  s.film += s.cell * ((dvec2(x, y) + 0.5) / static_cast<double>(kParts) - 0.5);
  if (across != 2 || !camera_.has_lens()) return s;
  constexpr double kAll = kParts * kParts;
  const int area = kParts * ((x + y + 2) % kParts) + x, turn = kParts * ((x + 2 * y + 1) % kParts) + y;
  s.lens = camera_.lens_at((kQuarters[ray] + (turn + 0.5) / kAll) / 4, (area + 0.5) / kAll);
  return s;
}

Ray PixelRays::sky_ray(const ivec2& pixel, int number) const {
  const auto turn = [number](double v) { return number * v - std::floor(number * v); };
  const dvec2 film(turn(0.8191725133961645), turn(0.6710436067037893));
  return camera_.ray(dvec2(pixel) + film, camera_.lens_at(turn(kGoldenRatio), (number + 0.5) / kSkyRays),
                     (number * 27 % kSkyRays + 0.5) / kSkyRays);
}

bool PixelRays::shows_edge(const ivec2& pixel) const {
  std::optional<SurfaceHit> first;
  const FiniteLight* first_light = nullptr;
  // Through the rim of a lens, and at both ends of the shutter.
  for (int corner = 0; corner < 4; ++corner) {
    const Ray ray = camera_.ray(dvec2(pixel) + dvec2(corner % 2, corner / 2), camera_.lens_at(corner / 4.0, kRim),
                                corner == 0 || corner == 3 ? 0.0 : 1.0);
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
