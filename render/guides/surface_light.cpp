#include "render/guides/surface_light.h"

#include <cmath>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/attenuation.h"

namespace brume {
namespace {

constexpr int kProbesAcross = 24;  // the longest side
constexpr int kDirections = 96;
constexpr int kMostPanes = 8;  // of glass that a ray goes through, or mirrors that turn it

}  // namespace

SurfaceLight::SurfaceLight(const GuideMedia& media, const Surfaces& surfaces, const Reflected& reflected,
                           const AmbientLight& ambient_light, const Task& task)
    // In the middle of cells: no probe stands on a floor below the media.
    : grid_(media.lo(), media.hi(), kProbesAcross), probes_(static_cast<size_t>(grid_.count())) {
  const std::vector<dvec3> directions = spiral_of_directions(kDirections);
  parallel_for(grid_.count(), quiet(task), [&](int i) {
    const dvec3 p = grid_.at(i);
    Probe& probe = probes_[static_cast<size_t>(i)];
    for (const dvec3& direction : directions) {
      Ray ray{p, direction};
      dvec3 left(1.0 / kDirections);
      double before = 0;  // of the way through the media, to the first surface that is not glass
      bool straight = true;
      for (int pane = 0; pane < kMostPanes; ++pane) {
        const auto hit = surfaces.intersect(ray, kFar);
        if (!hit) break;
        if (straight) before += hit->t;
        const Bsdf bsdf = surfaces.bsdf(*hit);
        const dvec3 there = ray.at(hit->t);
        if (bsdf.kind == Bsdf::Kind::kDielectric) {
          ray.o = Surfaces::leave(*hit, there, ray.d);
          continue;
        }
        straight = false;
        const dvec3 light = left * reflected(ray, *hit);
        if (bsdf.kind != Bsdf::Kind::kConductor) {
          const dvec3 arriving = light * attenuation(ambient_light.depth(p, direction, before));
          probe.cube.add(arriving, direction);
          probe.light[0] += arriving;
          for (int a = 0; a < 3; ++a) probe.light[a + 1] -= arriving * direction[a];
          break;
        }
        // What a metal mirrors of other surfaces.
        left *= bsdf.albedo;
        ray.d = glm::reflect(ray.d, hit->normal);
        ray.o = Surfaces::leave(*hit, there, ray.d);
      }
    }
  });
  for (const Probe& probe : probes_) colour_ += probe.light[0];
  const double mean = in_colour(colour_, kGrey);
  colour_ = mean > 0 ? colour_ / mean : dvec3(0);
}

std::array<double, 4> SurfaceLight::at(const dvec3& world, GuideColour colour) const {
  const ProbeGrid::Around around = grid_.around(world);
  std::array<double, 4> moments{};
  for (size_t k = 0; k < 8; ++k)
    for (size_t a = 0; a < 4; ++a)
      moments[a] += around.weight[k] * in_colour(probes_[static_cast<size_t>(around.probe[k])].light[a], colour);
  return moments;
}

dvec3 SurfaceLight::onto(const dvec3& world, const dvec3& normal) const {
  const ProbeGrid::Around around = grid_.before(world, normal, [](int) { return true; });
  dvec3 sum(0);
  for (size_t k = 0; k < 8; ++k)
    sum += around.weight[k] * probes_[static_cast<size_t>(around.probe[k])].cube.onto(normal);
  return sum;
}

}  // namespace brume
