#include "render/guides/mesh_light.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/guides/lit_surface.h"
#include "render/guides/sharp_light.h"

namespace brume {
namespace {

constexpr double kClear = 1 - 1e-4;  // of the way to a disc: shadow rays end before the mesh

constexpr size_t kCandidates = 16;  // for each disc
constexpr size_t kGroups = 16;      // of all meshes together, at least one of each

/// Mean of max(0, cosine) over cosines that are spread evenly around a mean.
double facing_share(double mean, double spread) {
  if (mean >= spread) return mean;
  return mean <= -spread ? 0 : (mean + spread) * (mean + spread) / (4 * spread);
}

/// Calls visit(irradiance across the direction, direction, disc) for the discs of a group that shine at a point.
template <class Group, class Visit>
void each_disc(const Group& group, const dvec3& p, const Visit& visit) {
  for (const auto& disc : group) {
    const dvec3 to = disc.p - p;
    const double distance2 = glm::dot(to, to);
    if (!(distance2 > 0)) continue;
    const dvec3 towards = to / std::sqrt(distance2);
    const double cosine = -glm::dot(towards, disc.normal);
    const double facing = facing_share(cosine, disc.spread) + (disc.two_sided ? facing_share(-cosine, disc.spread) : 0);
    // As of a disc on its axis, also where it is near.
    if (facing > 0) visit(disc.radiance * (disc.area * facing / (distance2 + disc.area / kPi)), towards, disc);
  }
}

/// The disc of a group that shines brightest at a point, which shadows and media are looked up for; null where none
/// does.
template <class Group>
auto brightest(const Group& group, const dvec3& p) {
  const typename Group::value_type* found = nullptr;
  double most = 0;
  each_disc(group, p, [&](const dvec3& irradiance, const dvec3&, const auto& disc) {
    if (const double own = in_colour(irradiance, kGrey); own > most) {
      most = own;
      found = &disc;
    }
  });
  return found;
}

/// Puts discs that lie and face alike side by side: halves along the longest side, of places and normals.
/// @param by_normal  how much of the longest side of places a change of the normal by 1 counts
template <class Disc>
void order(Disc* discs, size_t count, size_t together, double by_normal) {
  if (count <= together) return;
  dvec3 lo(kFar), hi(-kFar), normal_lo(1), normal_hi(-1);
  for (size_t i = 0; i < count; ++i) {
    lo = glm::min(lo, discs[i].p);
    hi = glm::max(hi, discs[i].p);
    normal_lo = glm::min(normal_lo, discs[i].normal);
    normal_hi = glm::max(normal_hi, discs[i].normal);
  }
  const dvec3 size = hi - lo, turn = by_normal * max_component(size) * (normal_hi - normal_lo);
  int axis = 0;
  const auto side = [&](int a) { return a < 3 ? size[a] : turn[a - 3]; };
  for (int a = 1; a < 6; ++a)
    if (side(a) > side(axis)) axis = a;
  const auto place = [&](const Disc& disc) { return axis < 3 ? disc.p[axis] : disc.normal[axis - 3]; };
  std::stable_sort(discs, discs + count, [&](const Disc& a, const Disc& b) { return place(a) < place(b); });
  const size_t half = (count / together + 1) / 2 * together;
  order(discs, half, together, by_normal);
  order(discs + half, count - half, together, by_normal);
}

}  // namespace

EmittingMeshes::EmittingMeshes(std::string guide_name, const dvec3& guide_colour, const Surfaces& surfaces,
                               const std::vector<uint32_t>& meshes)
    : GuideLight(std::move(guide_name), guide_colour) {
  for (const uint32_t mesh : meshes) spread(surfaces, mesh, std::max<size_t>(1, kGroups / meshes.size()));
}

// Many candidates: the middles of equal shares of the area, triangle by triangle; in a large one on a sequence that
// fills it evenly. Then one for all that lie and face alike.
void EmittingMeshes::spread(const Surfaces& surfaces, uint32_t surface, size_t groups) {
  const TriangleMesh& mesh = surfaces.mesh(surface);
  const dmat4 moved = mesh.moves() ? mesh.moved(Surfaces::kMiddle) : dmat4(1.0);
  double area = 0;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) area += mesh.area(i);
  const size_t count = groups * kOfGroup * kCandidates;
  const double each = area / static_cast<double>(count);
  const EmissionShare share = surfaces.emission_share(surface);
  std::vector<Disc> discs;
  double before = 0;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto [a, b, c] = mesh.corners(i);
    const double own = mesh.area(i);
    const bool last = i + 1 == mesh.triangles.size();
    for (int k = 1; discs.size() < count; ++k) {
      if ((static_cast<double>(discs.size()) + 0.5) * each > before + own && !last) break;
      constexpr double kFirst = 0.7548776662466927, kSecond = 0.5698402909980532;  // of the plastic number
      dvec2 u = own > each ? static_cast<double>(k) * dvec2(kFirst, kSecond) : dvec2(1.0 / 3);
      u -= glm::floor(u);
      if (u.x + u.y > 1) u = 1.0 - u;
      const dvec3 p = a + u.x * (b - a) + u.y * (c - a);
      const SurfaceSettings& settings = surfaces.settings(surface);
      dvec3 radiance = settings.radiance;
      if (share) radiance *= share(static_cast<uint32_t>(i), u.x, u.y);
      discs.push_back({dvec3(moved * glm::dvec4(p, 1.0)), mesh.normal(i), radiance, double{kCandidates} * each, 0,
                       settings.two_sided});
    }
    before += own;
  }
  order(discs.data(), count, kOfGroup * kCandidates, 0);
  for (size_t g = 0; g < groups; ++g) {
    order(discs.data() + g * kOfGroup * kCandidates, kOfGroup * kCandidates, kCandidates, 1);
    Group& group = groups_.emplace_back();
    for (size_t k = 0; k < kOfGroup; ++k) {
      const Disc* const alike = discs.data() + (g * kOfGroup + k) * kCandidates;
      group[k] = alike[kCandidates / 2];
      group[k].normal = dvec3(0);
      for (size_t i = 0; i < kCandidates; ++i) group[k].normal += alike[i].normal / double{kCandidates};
      group[k].spread = std::sqrt(3 * std::max(0.0, 1 - glm::dot(group[k].normal, group[k].normal)));
    }
  }
}

Radiance EmittingMeshes::arriving(const LightSolve& solve) {
  const ScatteringSolver& solver = solve.solver;
  Radiance light = solver.nothing<Radiance>();
  for (const Group& group : groups_) {
    const LightShares shares(solve, [&](const dvec3& p) {
      const Disc* const disc = brightest(group, p);
      return disc ? kClear * (disc->p - p) : dvec3(0);
    });
    solver.each_node([&](int x, int y, int z, size_t i) {
      if (solver.extinction()[i] == 0) return;
      const dvec3 p = solver.lattice().node(x, y, z);
      const double share = shares.at(p) / (4 * kPi);
      if (!(share > 0)) return;
      each_disc(group, p, [&](const dvec3& irradiance, const dvec3& towards, const Disc&) {
        const double mean = share * in_colour(irradiance, solve.colour);
        light[0][i] += static_cast<float>(mean);
        for (int a = 0; a < 3; ++a) light[static_cast<size_t>(a) + 1][i] -= static_cast<float>(mean * towards[a]);
      });
    });
  }
  return light;
}

Lit EmittingMeshes::onto(const LitSurfaces& surfaces, const SurfaceLight::Around&, const dvec3& p,
                         const dvec3& normal) const {
  const auto passage = [&](const Disc& disc) {
    const dvec3 to = disc.p - p;
    const double distance = glm::length(to);
    return distance > 0 ? surfaces.surfaces->passage({p, to / distance}, kClear * distance).light : dvec3(1);
  };
  const auto lights = [&](const Group& group, const auto& open) {
    dvec3 sum(0);
    each_disc(group, p, [&](const dvec3& irradiance, const dvec3& towards, const Disc& disc) {
      if (const double cosine = glm::dot(towards, normal); cosine > 0) sum += cosine * irradiance * open(disc);
    });
    return sum;
  };
  // Shadows of one disc for its group; of each where neighbouring groups differ.
  struct Arriving {
    const Group* group;
    const Disc* brightest;
    dvec3 irradiance, open;
  };
  static thread_local std::vector<Arriving> arriving;
  arriving.clear();
  for (const Group& group : groups_)
    if (const dvec3 irradiance = lights(group, [](const Disc&) { return dvec3(1); }); irradiance != dvec3(0)) {
      const Disc* const disc = brightest(group, p);
      arriving.push_back({&group, disc, irradiance, passage(*disc)});
    }
  Lit lit;
  for (size_t i = 0; i < arriving.size(); ++i) {
    const Arriving& a = arriving[i];
    const bool alike =
        (i == 0 || arriving[i - 1].open == a.open) && (i + 1 == arriving.size() || arriving[i + 1].open == a.open);
    const dvec3 light = alike ? a.irradiance * a.open : lights(*a.group, passage);
    if (light == dvec3(0)) continue;
    const dvec3 to = a.brightest->p - p;
    const double distance = glm::length(to);
    lit.add(light / kPi, surfaces.shares(p, to / distance, distance));
  }
  return lit;
}

}  // namespace brume
