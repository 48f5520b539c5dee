#include <algorithm>
#include <map>
#include <string>

#include "render/guides/guide_light.h"
#include "render/guides/lit_surface.h"
#include "render/guides/mesh_light.h"
#include "render/guides/sharp_light.h"
#include "render/guides/sky_light.h"

namespace brume {
namespace {

// Lights beyond these share one group: each costs a sweep of the lattice for every order, and a filter dozens of
// guides.
constexpr size_t kMostSuns = 2, kMostLamps = 2, kMostMeshes = 2;

dvec3 of_mean_one(const dvec3& colour) {
  const double mean = in_colour(colour, kGrey);
  return mean > 0 ? colour / mean : dvec3(1);
}

/// What the media emit.
class GlowLight final : public GuideLight {
 public:
  GlowLight() : GuideLight("glow", dvec3(1)) {}
  Radiance arriving(const LightSolve& solve) override {
    const Lattice& lattice = solve.solver.lattice();
    NodeValues emission(lattice.size());
    std::vector<dvec3> sums(static_cast<size_t>(lattice.n.x), dvec3(0));
    solve.solver.each_node([&](int x, int y, int z, size_t i) {
      const dvec3 here = solve.media().emission(lattice.node(x, y, z));
      sums[static_cast<size_t>(x)] += here;
      emission[i] = static_cast<float>(in_colour(here, solve.colour) * lattice.spacing);
    });
    dvec3 colours(0);
    for (const dvec3& sum : sums) colours += sum;
    colour = of_mean_one(colours);
    return solve.solver.emitted(emission);
  }
  Lit onto(const LitSurfaces&, const SurfaceLight::Around& around, const dvec3&, const dvec3&) const override {
    return {around.emitted, dvec3(0)};
  }
};

class LightFromSurfaces final : public GuideLight {
 public:
  explicit LightFromSurfaces(const dvec3& mean) : GuideLight("surfaces", mean) {}
  bool from_surfaces() const override { return true; }
  Radiance arriving(const LightSolve& solve) override {
    Radiance light = solve.solver.nothing<Radiance>();
    solve.solver.each_node([&](int x, int y, int z, size_t i) {
      if (solve.solver.extinction()[i] == 0) return;
      const std::array<double, 4> moments = solve.surface_light->at(solve.solver.lattice().node(x, y, z), solve.colour);
      for (size_t a = 0; a < 4; ++a) light[a][i] = static_cast<float>(moments[a]);
    });
    return light;
  }
  Lit onto(const LitSurfaces&, const SurfaceLight::Around& around, const dvec3&, const dvec3&) const override {
    return {dvec3(0), around.reflected};
  }
};

struct Candidate {
  KnownLight light;
  dvec3 colour;
  double importance;
};

/// Lights that share their guides.
struct Others {
  std::vector<KnownLight> lights;
  dvec3 colour{0};
};

/// In grey media lights of many colours are three, their red, green and blue.
void add_others(const Others& of, const dvec3& middle, GuideColour colour,
                std::vector<std::unique_ptr<GuideLight>>& guides) {
  constexpr double kAlike = 0.1;  // of the mean colour
  const std::vector<KnownLight>& others = of.lights;
  const dvec3 mean = of_mean_one(of.colour);
  const bool alike = std::all_of(others.begin(), others.end(), [&](const KnownLight& light) {
    const dvec3 apart = of_mean_one(arriving_light(light, middle).irradiance) - mean;
    return max_component(glm::abs(apart)) < kAlike;
  });
  if (alike || colour != kGrey) {
    guides.push_back(other_lights(mean, others, kGrey));
    return;
  }
  for (GuideColour channel = 0; channel < 3; ++channel) {
    dvec3 own(0);
    own[channel] = 1;
    guides.push_back(other_lights(own, others, channel));
  }
}

void set_group(GuideLight& guide, const Lights& lights, size_t group) {
  guide.light_group = lights.group_name(group);
  guide.group_number = lights.groups().empty() ? -1 : static_cast<int>(group);
}

/// The strongest emissive meshes, each a light; all others are one, or one for each light group.
void add_meshes(const Lights& lights, const Surfaces& surfaces, const dvec3& middle,
                std::vector<std::unique_ptr<GuideLight>>& guides) {
  const auto group_of = [&](uint32_t mesh) { return lights.mesh(surfaces.light_of(mesh)).group; };
  std::vector<std::pair<double, uint32_t>> meshes;  // importance
  for (uint32_t i = 0; i < surfaces.count(); ++i)
    if (surfaces.settings(i).radiance != dvec3(0))
      meshes.push_back({lights.mesh(surfaces.light_of(i)).importance(middle), i});
  std::stable_sort(meshes.begin(), meshes.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<std::vector<std::pair<double, uint32_t>>> together;
  for (size_t k = 0; k < meshes.size(); ++k) {
    const auto own =
        std::find_if(together.begin() + static_cast<std::ptrdiff_t>(std::min(k, kMostMeshes)), together.end(),
                     [&](const auto& other) { return group_of(other[0].second) == group_of(meshes[k].second); });
    (own == together.end() ? together.emplace_back() : *own).push_back(meshes[k]);
  }
  for (size_t k = 0; k < together.size(); ++k) {
    std::vector<uint32_t> own;
    dvec3 colour(0);
    for (const auto& [importance, mesh] : together[k]) {
      own.push_back(mesh);
      colour += importance * of_mean_one(surfaces.settings(mesh).radiance);
    }
    guides.push_back(std::make_unique<EmittingMeshes>(k == 0 ? "mesh" : "mesh_" + std::to_string(k + 1),
                                                      of_mean_one(colour), surfaces, own));
    set_group(*guides.back(), lights, group_of(own[0]));
  }
}

}  // namespace

std::vector<std::unique_ptr<GuideLight>> guide_lights(const Lights& lights, const SkyParts& sky,
                                                      const Surfaces* surfaces, const GuideMedia& media,
                                                      GuideColour colour) {
  const dvec3 middle = 0.5 * (media.lo() + media.hi());
  std::vector<Candidate> candidates;
  const auto add = [&](const auto& light) {
    if (const double importance = light.importance(middle); importance > 0)
      candidates.push_back({&light, of_mean_one(arriving_light(&light, middle).irradiance), importance});
  };
  for (const Sun* sun : lights.suns()) add(*sun);
  for (const auto& sun : sky.suns()) add(*sun);
  for (const FiniteLight* lamp : lights.finite()) add(*lamp);
  for (const PointLight* lamp : lights.points()) add(*lamp);
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.importance > b.importance; });

  std::vector<std::unique_ptr<GuideLight>> guides;
  std::map<std::string, int> named;
  size_t suns = 0, lamps = 0;
  std::map<size_t, Others> others;  // by light group
  const auto all_of_group = [&](size_t first, size_t group) {
    for (size_t k = first; k < guides.size(); ++k) set_group(*guides[k], lights, group);
  };
  for (const Candidate& c : candidates) {
    const bool sun = std::holds_alternative<const Sun*>(c.light);
    if (sun ? suns++ >= kMostSuns : lamps++ >= kMostLamps) {
      Others& own = others[base_of(c.light).group];
      own.lights.push_back(c.light);
      own.colour += c.importance * c.colour;
      continue;
    }
    std::string name = guide_word(c.light);
    if (const int number = ++named[name]; number > 1) name += "_" + std::to_string(number);
    if (sun)
      guides.push_back(std::make_unique<SunLight>(name, c.colour, c.light));
    else
      guides.push_back(std::make_unique<LampLight>(name, c.colour, c.light));
    all_of_group(guides.size() - 1, base_of(c.light).group);
  }
  for (const auto& [group, own] : others) {
    const size_t first = guides.size();
    add_others(own, middle, colour, guides);
    all_of_group(first, group);
  }
  if (surfaces) add_meshes(lights, *surfaces, middle, guides);
  const bool dark = lights.environment()->black();
  const size_t first_of_sky = guides.size();
  if (!dark && !sky.constant() && colour == kGrey) {
    for (GuideColour channel = 0; channel < 3; ++channel) {
      dvec3 own(0);
      own[channel] = 1;
      guides.push_back(std::make_unique<SkyLight>("sky", own, channel));
    }
  } else if (!dark) {
    dvec3 mean(0);
    for (const dvec3& d : {dvec3(1, 0, 0), dvec3(-1, 0, 0), dvec3(0, 1, 0), dvec3(0, -1, 0), dvec3(0, 0, 1)})
      mean += sky.radiance(d);
    guides.push_back(std::make_unique<SkyLight>("sky", of_mean_one(mean)));
  }
  all_of_group(first_of_sky, lights.environment()->group);
  if (!media.emissions().empty()) {
    guides.push_back(std::make_unique<GlowLight>());
    if (const auto group = lights.group_of_all_emissions()) all_of_group(guides.size() - 1, *group);
  }
  return guides;
}

std::unique_ptr<GuideLight> light_from_surfaces(const dvec3& colour) {
  return std::make_unique<LightFromSurfaces>(colour);
}

}  // namespace brume
