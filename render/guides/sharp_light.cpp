#include "render/guides/sharp_light.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/guides/light_rim.h"
#include "render/guides/lit_surface.h"

namespace brume {
namespace {

// Of the depth towards a sun; among instances as many as they may take beside one volume's memory.
constexpr size_t kMostSunNodes = 16000000, kMostSunNodesOfInstances = 14000000;

template <class... Answers>
struct Answer : Answers... {
  using Answers::operator()...;
};

ArrivingLight from_middle(const Light& light, const dvec3& p) {
  const LightSample s = light.sample(p, dvec2(0.5));
  return s.pdf > 0 ? ArrivingLight{s.wi, s.distance, s.radiance / s.pdf} : ArrivingLight();
}

/// Round lamps are seen along their axis, flat ones in their middle.
ArrivingLight from_lamp(const FiniteLight& lamp, const dvec3& p) {
  const dvec3 to = lamp.centre() ? *lamp.centre() - p : dvec3(0);
  const double distance = glm::length(to);
  if (!(distance > 0)) return from_middle(lamp, p);
  const Ray ray{p, to / distance};
  const double t = lamp.intersect(ray);
  return {ray.d, t, lamp.radiance(ray, t) / lamp.pdf(ray, t), std::max(0.0, distance - t)};
}

/// What arrives from a lamp in the cube around a node, on average: where the lamp is near, it differs much from place
/// to place. Nothing is lit inside the lamp.
ArrivingLight mean_over_cube(const KnownLight& light, const dvec3& node, double size) {
  constexpr int kAcross = 4;
  constexpr double kNear = 2.5;  // sizes
  ArrivingLight mean = arriving_light(light, node);
  const dvec3* const centre = base_of(light).centre();
  if (!centre || glm::distance(*centre, node) > kNear * size) return mean;
  const double share = 1.0 / (kAcross * kAcross * kAcross);
  mean.irradiance = mean.towards = dvec3(0);
  for (int i = 0; i < kAcross * kAcross * kAcross; ++i) {
    const dvec3 place(i % kAcross, i / kAcross % kAcross, i / (kAcross * kAcross));
    const dvec3 p = node + size * ((place + 0.5) / static_cast<double>(kAcross) - 0.5);
    const ArrivingLight here = arriving_light(light, p);
    if (here.distance > glm::distance(*centre, p)) continue;
    mean.irradiance += share * here.irradiance;
    mean.towards += share * in_colour(here.irradiance, kGrey) * here.towards;
  }
  const double all = in_colour(mean.irradiance, kGrey);
  mean.towards = all > 0 ? mean.towards / all : dvec3(0);
  return mean;
}

/// Optical depth from a point along a direction, through the lattice's own extinction, a spacing a step.
double depth_along(const ScatteringSolver& solver, const dvec3& from, const dvec3& towards, double distance) {
  const Lattice& lattice = solver.lattice();
  const dvec3 start = lattice.to_spacings(from), end = lattice.last_place();
  const double length = distance / lattice.spacing;
  const int steps = static_cast<int>(std::min(std::ceil(length), 4096.0));
  double depth = 0;
  for (int s = 0; s < steps; ++s) {
    const double share = std::min(1.0, length - s);
    const dvec3 q = start + towards * (s + 0.5 * share);
    if (glm::any(glm::lessThan(q, dvec3(0))) || glm::any(glm::greaterThan(q, end))) break;
    const ivec3 node = ivec3(glm::round(lattice.to_nodes(q)));
    depth += share * static_cast<double>(solver.extinction()[lattice.index(node.x, node.y, node.z)]);
  }
  return depth;
}

/// Whether there are media between a node of the coarse lattice and the next ones.
bool any_media_near(const ScatteringSolver& solver, const dvec3& p) {
  constexpr int kBetween = 2;  // nodes of the fine lattice
  const Lattice& lattice = solver.lattice();
  const ivec3 node(glm::round(lattice.to_lattice(p)));
  const ivec3 lo = glm::max(node - kBetween, ivec3(0)), hi = glm::min(node + kBetween, lattice.n - 1);
  for (int x = lo.x; x <= hi.x; ++x)
    for (int y = lo.y; y <= hi.y; ++y)
      for (int z = lo.z; z <= hi.z; ++z)
        if (solver.extinction()[lattice.index(x, y, z)] > 0) return true;
  return false;
}

/// Adds light along one direction.
void add_beam(Radiance& light, size_t node, double irradiance, const dvec3& towards) {
  const double mean = irradiance / (4 * kPi);
  light[0][node] += static_cast<float>(mean);
  for (int a = 0; a < 3; ++a) light[static_cast<size_t>(a) + 1][node] -= static_cast<float>(mean * towards[a]);
  if (light.known() == 4) return;
  const std::array<float, kMostMoments> factors = moments_of(-towards);
  for (size_t a = 4; a < light.known(); ++a) light[a][node] += static_cast<float>(mean) * factors[a];
}

/// Adds a lamp's light at a node.
/// @param share   what surfaces and media leave of it
/// @param stands  in place of its own colour, where it stands for several
void add_lamp(const LightSolve& solve, const KnownLight& light, size_t node, const dvec3& p, double share,
              Radiance& arriving, const dvec3* stands = nullptr) {
  const ArrivingLight mean = mean_over_cube(light, p, solve.solver.lattice().spacing);
  const dvec3 irradiance = stands ? luminance(mean.irradiance) * *stands : mean.irradiance;
  add_beam(arriving, node, in_colour(irradiance, solve.colour) * share, mean.mean_cosine() * mean.towards);
}

/// Whether all of a ball shines on a surface, which then is lit as along its axis, by what it sends times its mean
/// cosine.
bool ball_above(const KnownLight& lamp, const ArrivingLight& all, const dvec3& normal) {
  if (!base_of(lamp).centre() || !(all.radius > 0)) return false;
  return glm::dot(all.towards, normal) > all.radius / (all.distance + all.radius);
}

/// What a surface reflects of a light by points of it: few, or more where parts of it are hidden.
Lit lamp_onto(const KnownLight& lamp, const LitSurfaces& surfaces, const dvec3& p, const dvec3& normal) {
  constexpr int kFewAcross = 2;
  const bool wide = has_extent(lamp);
  const ArrivingLight all = arriving_light(lamp, p);
  const bool whole_ball = ball_above(lamp, all, normal);
  const auto shines = [&](const LightSample& s) {
    return s.pdf > 0 && glm::dot(s.wi, normal) > 0 && s.radiance != dvec3(0);
  };
  bool any = !wide || whole_ball;
  for (int i = 0; i < kRimPoints && !any; ++i) any = shines(at_rim(lamp, p, i));
  if (!any) return {};
  const std::optional<dvec3> alike = wide ? left_alike(lamp, surfaces, p) : std::nullopt;
  if (alike == dvec3(0)) return {};
  Lit sum;
  if (alike && whole_ball) {
    sum.add(glm::dot(all.towards, normal) / kPi * all.mean_cosine() * all.irradiance * *alike,
            surfaces.shares(p, all.towards, all.distance));
    return sum;
  }
  const int across = !wide ? 1 : alike ? kFewAcross : kPenumbraAcross;
  for (int i = 0; i < across * across; ++i) {
    const LightSample s = base_of(lamp).sample(p, (dvec2(i % across, i / across) + 0.5) / static_cast<double>(across));
    if (!shines(s)) continue;
    const dvec3 open = alike ? *alike : surfaces.open({p, s.wi}, std::min(s.distance, kFar), base_of(lamp));
    if (open == dvec3(0)) continue;
    sum.add(glm::dot(s.wi, normal) / (kPi * s.pdf * across * across) * s.radiance * open,
            surfaces.shares(p, s.wi, s.distance));
  }
  return sum;
}

}  // namespace

ArrivingLight arriving_light(const KnownLight& light, const dvec3& p) {
  return std::visit(Answer{[](const Sun* sun) {
                             return ArrivingLight{sun->axis(), kFar, sun->irradiance()};
                           },
                           [&](const FiniteLight* lamp) { return from_lamp(*lamp, p); },
                           [&](const PointLight* lamp) { return from_middle(*lamp, p); }},
                    light);
}

const char* guide_word(const KnownLight& light) {
  return std::visit(Answer{[](const Sun*) { return "sun"; },
                           [](const FiniteLight* lamp) { return lamp->centre() ? "sphere" : "rectangle"; },
                           [](const PointLight*) { return "point"; }},
                    light);
}

bool has_extent(const KnownLight& light) {
  return std::visit(Answer{[](const Sun* sun) { return !sun->delta(); }, [](const FiniteLight*) { return true; },
                           [](const PointLight*) { return false; }},
                    light);
}

std::optional<MetLight> met_by(const Ray& ray, const KnownLight& light) {
  using Met = std::optional<MetLight>;
  return std::visit(Answer{[&](const Sun* sun) {
                             return Met({sun->radiance(ray.d), sun->pdf(ray.d)});
                           },
                           [&](const FiniteLight* lamp) {
                             const double t = lamp->intersect(ray);
                             return t > 0 ? Met({lamp->radiance(ray, t), lamp->pdf(ray, t)}) : Met();
                           },
                           [](const PointLight*) { return Met(); }},
                    light);
}

double ArrivingLight::mean_cosine() const {
  const double sine = radius / (distance + radius);
  return radius > 0 ? 0.5 * (1 + std::sqrt(std::max(0.0, 1 - sine * sine))) : 1;
}

bool ArrivingLight::small() const {
  constexpr double kSmall = 0.2;  // of the distance of its middle: all directions are alike
  return !(distance > 0) || radius < kSmall * (distance + radius);
}

double ArrivingLight::mean_depth() const {
  const double mean = small() ? 0 : transmittance(depth);
  return mean > 0 ? -portable_log(mean) : depth;
}

double ArrivingLight::transmittance(double shortest) const {
  constexpr int kRings = 4;
  if (small()) return attenuation(shortest);
  const double middle = distance + radius;
  const double cap = 1 - std::sqrt(1 - radius / middle * (radius / middle));
  double sum = 0;
  for (int ring = 0; ring < kRings; ++ring) {
    const double cosine = 1 - cap * (ring + 0.5) / kRings;
    const double way =
        middle * cosine - std::sqrt(std::max(0.0, radius * radius - middle * middle * (1 - cosine * cosine)));
    sum += attenuation(shortest * way / distance);
  }
  return sum / kRings;
}

Lit SunLight::onto(const LitSurfaces& surfaces, const SurfaceLight::Around&, const dvec3& p,
                   const dvec3& normal) const {
  Lit lit;
  const ArrivingLight light = at(p);
  const double cosine = glm::dot(light.towards, normal);
  if (cosine > 0) lit.add(cosine / kPi * light.irradiance, surfaces.transmitted(light_, light, p));
  return lit;
}

ArrivingLight SunLight::at(const dvec3& p) const {
  ArrivingLight light = arriving_light(light_, p);
  light.depth = depth_[depth_.size() / 2].at(p);
  return light;
}

Radiance SunLight::arriving(const LightSolve& solve) {
  depth_.reserve(solve.times.size());
  for (const GuideMedia& m : solve.times) {
    const std::optional<dvec3> moved = depth_.empty() ? std::nullopt : m.moved_since(solve.times[0]);
    depth_.push_back(moved ? depth_[0].moved(*moved)
                           : SunDepth(m, solve.colour, towards(), m.voxel(),
                                      m.instances() ? kMostSunNodesOfInstances : kMostSunNodes, solve.task));
  }
  const ScatteringSolver& solver = solve.solver;
  lattice_ = solver.lattice();
  if (solve.surfaces) visible_ = NodeValues(lattice_.size());
  Radiance light = solver.nothing<Radiance>();
  solver.each_node([&](int x, int y, int z, size_t i) {
    const dvec3 p = lattice_.node(x, y, z);
    const double share = solve.passage({p, towards()}, kFar);
    if (solve.surfaces) visible_[i] = static_cast<float>(share);
    if (solver.extinction()[i] == 0) return;
    const double depth = solver.mean_scale() * static_cast<double>(depth_[depth_.size() / 2].at(p));
    add_beam(light, i, in_colour(irradiance(), solve.colour) * share * attenuation(depth), towards());
  });
  return light;
}

size_t SunLight::bytes() const {
  size_t sum = visible_.size() * sizeof(float);
  for (const SunDepth& depth : depth_)
    if (&depth == &depth_[0] || depth.roots() != depth_[0].roots()) sum += depth.bytes();
  return sum;
}

Lit LampLight::onto(const LitSurfaces& surfaces, const SurfaceLight::Around&, const dvec3& p,
                    const dvec3& normal) const {
  return lamp_onto(light_, surfaces, p, normal);
}

ArrivingLight LampLight::at(const dvec3& p) const {
  ArrivingLight light = arriving_light(light_, p);
  light.depth = interpolated(lattice_, depth_, p);
  return light;
}

Radiance LampLight::arriving(const LightSolve& solve) {
  lattice_ = solve.solver.lattice();
  depth_ = NodeValues(lattice_.size());
  if (solve.surfaces) visible_ = NodeValues(lattice_.size());
  Radiance light = solve.solver.nothing<Radiance>(solve.solver.moments());
  solve.solver.each_node([&](int x, int y, int z, size_t i) {
    const dvec3 p = lattice_.node(x, y, z);
    const ArrivingLight here = arriving_light(light_, p);
    const double share = solve.passage({p, here.towards}, here.distance);
    const double depth = depth_along(solve.solver, p, here.towards, here.distance);
    add_lamp(solve, light_, i, p, share * here.transmittance(solve.solver.mean_scale() * depth), light);
    depth_[i] = static_cast<float>(depth);
    if (solve.surfaces) visible_[i] = static_cast<float>(share);
  });
  return light;
}

namespace {

/// Lights that share their guides. Many lamps are known by some of them that stand for all, wherever they are asked
/// for.
class OtherLights final : public GuideLight {
 public:
  OtherLights(const dvec3& mean, const std::vector<KnownLight>& lights, GuideColour only)
      : GuideLight("others", mean, only) {
    std::vector<const Light*> lamps;
    for (const KnownLight& light : lights) {
      const bool lamp = base_of(light).place().has_value();
      if (lamp) lamps.push_back(&base_of(light));
      (lamp ? lamps_ : single_).push_back(light);
    }
    if (lamps_.size() > kFewLamps) {
      tree_ = LightTree(std::move(lamps));
    } else {
      single_ = lights;
      lamps_.clear();
    }
  }

  Radiance arriving(const LightSolve& solve) override {
    Radiance light = solve.solver.nothing<Radiance>(solve.solver.moments());
    LightSolve own_colour = solve;
    if (solve.colour == kGrey) own_colour.colour = channel;
    for (const KnownLight& lamp : single_) {
      const LightShares shares(solve, [&](const dvec3& p) {
        const ArrivingLight here = arriving_light(lamp, p);
        return here.distance * here.towards;
      });
      each_lit_node(solve, shares,
                    [&](size_t i, const dvec3& p, double share) { add_lamp(own_colour, lamp, i, p, share, light); });
    }
    if (tree_.empty()) return light;
    const LightShares shares(solve, [&](const dvec3& p) {
      std::vector<LightTarget> targets;
      for (const LightTree::Stand& stand : tree_.stands(p, kDoubt)) {
        const ArrivingLight here = arriving_light(lamps_[stand.number], p);
        targets.push_back({here.distance * here.towards, luminance(here.irradiance) * luminance(stand.factor)});
      }
      return targets;
    });
    each_lit_node(solve, shares, [&](size_t i, const dvec3& p, double share) {
      for (const LightTree::Stand& stand : tree_.stands(p, kDoubt))
        add_lamp(own_colour, lamps_[stand.number], i, p, share, light, &stand.factor);
    });
    return light;
  }
  Lit onto(const LitSurfaces& surfaces, const SurfaceLight::Around&, const dvec3& p,
           const dvec3& normal) const override {
    Lit lit;
    const dvec3 own = channel == kGrey ? dvec3(1) : colour;
    for (const KnownLight& lamp : single_) lit.add(own, lamp_onto(lamp, surfaces, p, normal));
    if (tree_.empty()) return lit;
    for (const LightTree::Stand& stand : tree_.stands(p, kDoubt)) {
      const Lit of_one = lamp_onto(lamps_[stand.number], surfaces, p, normal);
      lit.add(own * stand.factor, {dvec3(luminance(of_one.direct)), dvec3(luminance(of_one.indirect))});
    }
    return lit;
  }

 private:
  static constexpr size_t kFewLamps = 64;
  static constexpr double kDoubt = 0.03;

  /// Calls visit(i, p, share) for the nodes in media that light reaches.
  template <class Visit>
  static void each_lit_node(const LightSolve& solve, const LightShares& shares, const Visit& visit) {
    solve.solver.each_node([&](int x, int y, int z, size_t i) {
      if (solve.solver.extinction()[i] == 0) return;
      const dvec3 p = solve.solver.lattice().node(x, y, z);
      if (const double share = shares.at(p); share > 0) visit(i, p, share);
    });
  }

  std::vector<KnownLight> single_, lamps_;
  LightTree tree_;  // of lamps_
};

}  // namespace

std::unique_ptr<GuideLight> other_lights(const dvec3& colour, const std::vector<KnownLight>& lights, GuideColour only) {
  return std::make_unique<OtherLights>(colour, lights, only);
}

void LightShares::look(const LightSolve& solve, const ivec3& node, const dvec3& to) {
  const double distance = glm::length(to);
  if (!(distance > 0)) return;
  const dvec3 p = lattice_.node(node.x, node.y, node.z), towards = to / distance;
  if (!any_media_near(solve.solver, p)) return;
  const size_t i = lattice_.index(node.x, node.y, node.z);
  open_[i] = static_cast<float>(solve.passage({p, towards}, distance));
  if (open_[i] > 0)
    depth_[i] = static_cast<float>(solve.solver.mean_scale() * depth_along(solve.solver, p, towards, distance));
}

void LightShares::look(const LightSolve& solve, const ivec3& node, const std::vector<LightTarget>& lights) {
  const dvec3 p = lattice_.node(node.x, node.y, node.z);
  if (!any_media_near(solve.solver, p)) return;
  double all = 0, open = 0, left = 0;
  for (const LightTarget& light : lights) {
    const double distance = glm::length(light.to);
    if (!(distance > 0)) continue;
    const dvec3 towards = light.to / distance;
    const double passes = light.weight * solve.passage({p, towards}, distance);
    all += light.weight;
    open += passes;
    if (passes > 0)
      left += passes * attenuation(solve.solver.mean_scale() * depth_along(solve.solver, p, towards, distance));
  }
  constexpr double kDeep = 700;  // nothing is left
  const size_t i = lattice_.index(node.x, node.y, node.z);
  open_[i] = static_cast<float>(all > 0 ? open / all : 0);
  depth_[i] = static_cast<float>(left > 0 ? -portable_log(left / open) : open > 0 ? kDeep : 0);
}

double LightShares::at(const dvec3& p) const {
  const NodeWeights around(lattice_, p);
  return static_cast<double>(around(open_)) * attenuation(static_cast<double>(around(depth_)));
}

}  // namespace brume
