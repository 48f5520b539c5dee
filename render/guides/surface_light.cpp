#include "render/guides/surface_light.h"

#include <cmath>

#include "base/math.h"
#include "base/parallel_for.h"

namespace brume {
namespace {

constexpr int kProbesAcross = 24;  // the longest side
constexpr int kDirections = 96;
constexpr int kMostPanes = 8;  // of glass that a ray goes through, or mirrors that turn it
constexpr double kFar = 1e30;

}  // namespace

SurfaceLight::SurfaceLight(const GuideMedia& media, const Surfaces& surfaces, const Reflected& reflected,
                           const Transmittance& transmittance, const Task& task) {
  const dvec3 size = media.hi() - media.lo();
  const double spacing = max_component(size) / kProbesAcross;
  n_ = glm::clamp(ivec3(glm::round(size / spacing)), ivec3(1), ivec3(kProbesAcross));
  spacing_ = size / dvec3(n_);
  // In the middle of cells: none stands on a floor below the media.
  lo_ = media.lo() + 0.5 * spacing_;
  probes_.resize(static_cast<size_t>(n_.x) * n_.y * n_.z);
  const std::vector<dvec3> directions = spiral_of_directions(kDirections);
  parallel_for(static_cast<int>(probes_.size()), quiet(task), [&](int i) {
    const ivec3 place(i / (n_.y * n_.z), i / n_.z % n_.y, i % n_.z);
    const dvec3 p = lo_ + spacing_ * dvec3(place);
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
          const dvec3 arriving = light * transmittance(p, direction, before);
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

template <class Weight>
SurfaceLight::Probe SurfaceLight::between(const dvec3& world, const Weight& weight) const {
  const dvec3 p = glm::clamp((world - lo_) / spacing_, dvec3(0), dvec3(n_ - 1));
  const ivec3 i = glm::clamp(ivec3(p), ivec3(0), glm::max(n_ - 2, ivec3(0)));
  const dvec3 f = p - dvec3(i);
  Probe sum;
  double total = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const ivec3 o(corner >> 2, corner >> 1 & 1, corner & 1), q = glm::min(i + o, n_ - 1);
    const double linear = (o.x ? f.x : 1 - f.x) * (o.y ? f.y : 1 - f.y) * (o.z ? f.z : 1 - f.z);
    const double w = linear * weight(lo_ + spacing_ * dvec3(q));
    total += w;
    for (size_t a = 0; a < 4; ++a) sum.light[a] += w * probe(q).light[a];
  }
  for (dvec3& light : sum.light) light = total > 0 ? light / total : dvec3(0);
  return sum;
}

std::array<double, 4> SurfaceLight::at(const dvec3& world, GuideColour colour) const {
  const Probe found = between(world, [](const dvec3&) { return 1.0; });
  std::array<double, 4> moments;
  for (size_t a = 0; a < 4; ++a) moments[a] = in_colour(found.light[a], colour);
  return moments;
}

dvec3 SurfaceLight::onto(const dvec3& world, const dvec3& normal) const {
  // Probes behind the surface know nothing of what it faces.
  constexpr double kBehind = 1e-3;
  const Probe found = between(world, [&](const dvec3& at) { return glm::dot(at - world, normal) > 0 ? 1.0 : kBehind; });
  // Of radiance that is linear in the direction, less than none of which is none.
  return glm::max(dvec3(0), found.light[0] - 2.0 * (normal.x * found.light[1] + normal.y * found.light[2] +
                                                    normal.z * found.light[3]));
}

}  // namespace brume
