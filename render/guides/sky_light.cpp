#include "render/guides/sky_light.h"

#include <algorithm>

#include "render/guides/lit_surface.h"

namespace brume {
namespace {

/// Where surfaces stand between the sky and the media.
void hide_sky(const GuideMedia& media, const Surfaces& surfaces, std::vector<double>& incoming) {
  // Sky visible from the corners of a box half as large as the media's.
  const dvec3 middle = 0.5 * (media.lo() + media.hi()), half = 0.25 * (media.hi() - media.lo());
  for (size_t k = 0; k < incoming.size(); ++k) {
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 p = middle + half * dvec3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      if (!surfaces.intersect({p, -ScatteringSolver::directions()[k]}, kFar)) sum += incoming[k];
    }
    incoming[k] = sum / 8;
  }
}

}  // namespace

Radiance SkyLight::arriving(const LightSolve& solve) {
  const Environment& sky = *solve.lights.environment();
  const GuideColour own = solve.colour == kGrey ? channel : solve.colour;
  incoming_ = means_near(ScatteringSolver::directions(), sky.constant(),
                         [&](const dvec3& d) { return in_colour(sky.radiance(-d), own); });
  if (solve.surfaces) hide_sky(solve.media(), *solve.surfaces, incoming_);
  if (solve.sky.empty()) solve.sky = solve.solver.arriving();
  return solve.solver.entering(incoming_);
}

Lit SkyLight::onto(const LitSurfaces& around, const dvec3& p, const dvec3& normal) const {
  return around.ambient_light ? Lit{around.ambient_light->onto(p, normal).sky * share(), dvec3(0)} : Lit();
}

}  // namespace brume
