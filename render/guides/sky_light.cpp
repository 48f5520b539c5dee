#include "render/guides/sky_light.h"

#include <algorithm>

#include "render/guides/lit_surface.h"

namespace brume {
namespace {

/// Moments of the sky's light at the nodes where surfaces hide other parts of it from each.
/// @param shares  that media leave of it
Radiance behind_surfaces(const LightSolve& solve, const SkyShares& shares, const std::vector<double>& incoming) {
  const auto& directions = ScatteringSolver::directions();
  Radiance light = solve.solver.nothing<Radiance>();
  solve.solver.each_node([&](int x, int y, int z, size_t i) {
    if (solve.solver.extinction()[i] == 0) return;
    const SurfaceLight::SkySeen seen = solve.surface_light->sky_seen(solve.solver.lattice().node(x, y, z));
    for (size_t d = 0; d < directions.size(); ++d) {
      const auto radiance =
          static_cast<float>(incoming[d] * seen[d] / static_cast<double>(directions.size())) * shares(i, d);
      light[0][i] += radiance;
      for (int a = 0; a < 3; ++a)
        light[static_cast<size_t>(a) + 1][i] += radiance * static_cast<float>(directions[d][a]);
    }
  });
  return light;
}

/// What surfaces leave of what media leave of the sky.
void hide(const LightSolve& solve, SkyShares& sky) {
  solve.solver.each_node([&](int x, int y, int z, size_t i) {
    const SurfaceLight::SkySeen seen = solve.surface_light->sky_seen(solve.solver.lattice().node(x, y, z));
    for (size_t d = 0; d < seen.size(); ++d) sky.set(i, d, static_cast<float>(seen[d]) * sky(i, d));
  });
}

}  // namespace

Radiance SkyLight::arriving(const LightSolve& solve) {
  const SkyParts& sky = solve.sky_parts;
  const GuideColour own = solve.colour == kGrey ? channel : solve.colour;
  incoming_ = means_near(ScatteringSolver::directions(), sky.constant(),
                         [&](const dvec3& d) { return in_colour(sky.radiance(-d), own); });
  const bool unevenly = solve.surface_light && solve.surface_light->sky_seen_unevenly();
  if (solve.sky.empty()) {
    solve.sky = solve.solver.arriving(/*peaks=*/false);
    if (unevenly) hide(solve, solve.sky);
  }
  if (unevenly) return behind_surfaces(solve, solve.solver.arriving(/*peaks=*/true), incoming_);
  for (size_t d = 0; solve.surface_light && d < incoming_.size(); ++d)
    incoming_[d] *= solve.surface_light->sky_seen()[d];
  return solve.solver.entering(incoming_);
}

Lit SkyLight::onto(const LitSurfaces&, const SurfaceLight::Around& around, const dvec3&, const dvec3&) const {
  return {around.sky * share(), dvec3(0)};
}

}  // namespace brume
