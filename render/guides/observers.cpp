#include "render/guides/observers.h"

#include <cmath>

#include "base/golden_ratio.h"
#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/attenuation.h"
#include "render/guides/lattice.h"

namespace brume {
namespace {

constexpr int kPointRays = 48, kProbeRays = 72;
constexpr int kMostPanes = 8;       // of glass that a ray goes through, or mirrors that turn it
constexpr double kMostBacks = 0.5;  // of an observer's rays, that meet surfaces from behind

SinCos golden_turn(size_t i) {
  const double turn = static_cast<double>(i) * kGoldenRatio;
  return portable_sincos_2pi(turn - std::floor(turn));
}

/// Unit vectors around z, their number per solid angle as the cosine.
std::vector<dvec3> spiral_by_cosine(int count) {
  std::vector<dvec3> directions;
  for (int i = 0; i < count; ++i) {
    const double sine2 = (i + 0.5) / count;
    const SinCos phi = golden_turn(static_cast<size_t>(i));
    directions.push_back({std::sqrt(sine2) * phi.cos, std::sqrt(sine2) * phi.sin, std::sqrt(1 - sine2)});
  }
  return directions;
}

}  // namespace

Observers Observers::at_surfaces() {
  return {/*hemispheres=*/true, spiral_by_cosine(kPointRays)};
}

Observers Observers::in_media() {
  return {/*hemispheres=*/false, spiral_of_directions(kProbeRays)};
}

void Observers::add(const dvec3& p, const Frame& frame, size_t turns) {
  const SinCos phi = golden_turn(turns);
  Frame turned = frame;
  turned.x = phi.cos * frame.x + phi.sin * frame.y;
  turned.y = phi.cos * frame.y - phi.sin * frame.x;
  all_.push_back({p, turned});
}

void Observers::look(const Surfaces& surfaces, const SurfacePoints& points, const AmbientLight& nodes,
                     const Task& task) {
  seen_.resize(all_.size() * rays());
  parallel_for(static_cast<int>(all_.size()), quiet(task), [&](int i) {
    Observer& observer = all_[static_cast<size_t>(i)];
    int backs = 0;
    for (size_t k = 0; k < rays(); ++k) {
      Seen& seen = seen_[static_cast<size_t>(i) * rays() + k];
      Ray ray{observer.p, direction(static_cast<size_t>(i), k)};
      const dvec3 towards = ray.d;
      double before = 0;  // of the way to the first surface that is not glass
      Mirrored mirrored{k};
      int point = kSky;
      for (int pane = 0; pane < kMostPanes; ++pane) {
        const auto hit = surfaces.intersect(ray, kFar);
        if (!hit) break;
        const bool straight = mirrored.metals.empty();
        if (straight) before += hit->t;
        Bsdf bsdf = surfaces.bsdf(*hit);
        if (bsdf.kind == Bsdf::Kind::kCoated) bsdf = bsdf.evened();
        const dvec3 there = ray.at(hit->t);
        if (bsdf.kind == Bsdf::Kind::kDielectric) {
          ray.o = Surfaces::leave(*hit, there, ray.d);
          continue;
        }
        const bool back = glm::dot(hit->normal, ray.d) > 0;
        if (straight) backs += back ? 1 : 0;
        if (bsdf.kind == Bsdf::Kind::kDiffuse) {
          point = bsdf.albedo == dvec3(0) ? kBlack : points.nearest(there, back ? -hit->normal : hit->normal);
          if (point < 0) point = kBlack;
          break;
        }
        mirrored.metals.push_back({ray, *hit});
        mirrored.share *= bsdf.albedo;
        ray.d = glm::reflect(ray.d, hit->normal);
        ray.o = Surfaces::leave(*hit, there, ray.d);
      }
      const bool straight = mirrored.metals.empty();
      if (straight && point == kSky) before = kFar;
      if (straight) {
        seen.point = point;
      } else {
        mirrored.point = point;
        observer.mirrored.push_back(std::move(mirrored));
      }
      seen.distance = static_cast<float>(before);
      seen.transmittance = static_cast<float>(attenuation(nodes.depth(observer.p, towards, before)));
    }
    observer.outside = backs < kMostBacks * static_cast<double>(rays());
  });
}

}  // namespace brume
