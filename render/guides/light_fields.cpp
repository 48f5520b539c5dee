#include "render/guides/light_fields.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/guides/lit_surface.h"
#include "render/guides/media_line.h"

namespace brume {
namespace {

constexpr int kLastOrder = 64;
// Between nodes, at a detail of 1: as many voxels, or more where light goes farther.
constexpr double kVoxelsPerNode = 2, kMostVoxelsPerNode = 4, kFreePathsPerNode = 0.5;
// Of them at a detail of 1, where media are large: as many for each pixel, within limits.
constexpr double kNodesPerPixel = 12, kFewestNodes = 2.5e5;
constexpr double kMostNodes = 1e6, kMostNodesInDetail = 4e6;
constexpr size_t kMostSunNodes = 16000000;
constexpr double kNegligible = 2e-3;    // of all orders together, for the last one
constexpr double kLargestRatio = 0.99;  // of an order to the one before, in the tail
constexpr double kUnseen = 1e30;        // world units
constexpr double kFineOrder = 2;        // scatterings of the orders on fine nodes, on average

/// Averages of the sky over the directions nearest to each of the solver's, where light travels from it.
std::vector<double> sky_radiance(const Environment& sky, GuideColour colour) {
  const std::vector<dvec3>& directions = ScatteringSolver::directions();
  std::vector<double> sum(directions.size(), 0.0), count(directions.size(), 0.0);
  for (const dvec3& d : sky.constant() ? directions : spiral_of_directions(4096)) {
    size_t nearest = 0;
    for (size_t k = 1; k < directions.size(); ++k)
      if (glm::dot(directions[k], d) > glm::dot(directions[nearest], d)) nearest = k;
    sum[nearest] += in_colour(sky.radiance(-d), colour);
    ++count[nearest];
  }
  for (size_t k = 0; k < sum.size(); ++k) sum[k] /= std::max(1.0, count[k]);
  return sum;
}

/// Where surfaces stand between the sky and the media.
void hide_sky(const GuideMedia& media, const Surfaces& surfaces, std::vector<double>& incoming) {
  // Sky visible from the corners of a box half as large as the media's.
  const dvec3 middle = 0.5 * (media.lo() + media.hi()), half = 0.25 * (media.hi() - media.lo());
  for (size_t k = 0; k < incoming.size(); ++k) {
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const dvec3 p = middle + half * dvec3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
      if (!surfaces.intersect({p, -ScatteringSolver::directions()[k]}, kUnseen)) sum += incoming[k];
    }
    incoming[k] = sum / 8;
  }
}

/// Over a cube around a point.
dvec3 mean_emission(const GuideMedia& media, const dvec3& middle, double size) {
  dvec3 sum(0);
  for (int corner = 0; corner < 8; ++corner)
    sum += media.emission(middle + 0.25 * size * dvec3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1));
  return 0.125 * sum;
}

dvec3 of_mean_one(const dvec3& colour) {
  const double mean = in_colour(colour, kGrey);
  return mean > 0 ? colour / mean : dvec3(1);
}

/// Of what the media scatter, over a cube around a point.
dvec3 mean_tint(const GuideMedia& media, const dvec3& middle, double size) {
  MediaLine line(media, kGrey);
  dvec3 sum(0);
  double scattered = 0;
  for (int edge = 0; edge < 4; ++edge) {
    line.follow({middle + 0.25 * size * dvec3(edge & 1 ? 1 : -1, edge & 2 ? 1 : -1, -1), {0, 0, 0.5 * size}});
    for (int end = 0; end < 2; ++end) {
      const GuideMedia::Point point = line.at(end);
      scattered += point.sigma_t * point.albedo;
      sum += point.sigma_t * point.albedo * point.tint;
    }
  }
  return scattered > 0 ? sum / scattered : dvec3(1);
}

/// Optical depth from a point along a direction, through the lattice's own extinction, a node a step.
double depth_along(const ScatteringSolver& solver, const dvec3& from, const dvec3& towards, double distance) {
  const Lattice& lattice = solver.lattice();
  const dvec3 start = lattice.to_lattice(from);
  const double length = distance / lattice.spacing;
  const int steps = static_cast<int>(std::min(std::ceil(length), 4096.0));
  double depth = 0;
  for (int s = 0; s < steps; ++s) {
    const double share = std::min(1.0, length - s);
    const dvec3 q = start + towards * (s + 0.5 * share);
    if (glm::any(glm::lessThan(q, dvec3(0))) || glm::any(glm::greaterThan(q, dvec3(lattice.n - 1)))) break;
    const ivec3 node = ivec3(glm::round(q));
    depth += share * static_cast<double>(solver.extinction()[lattice.index(node.x, node.y, node.z)]);
  }
  return depth;
}

/// What arrives from a lamp in the cube around a node, on average: where the lamp is near, it differs much from place
/// to place. Nothing is lit inside the lamp.
LocalLight mean_over_cube(const Light& light, const dvec3& node, double size) {
  constexpr int kAcross = 4;
  constexpr double kNear = 2.5;  // sizes
  LocalLight mean = local_light(light, node);
  const dvec3* const centre = light.centre();
  if (!centre || glm::distance(*centre, node) > kNear * size) return mean;
  const double share = 1.0 / (kAcross * kAcross * kAcross);
  mean.irradiance = mean.towards = dvec3(0);
  for (int i = 0; i < kAcross * kAcross * kAcross; ++i) {
    const dvec3 place(i % kAcross, i / kAcross % kAcross, i / (kAcross * kAcross));
    const dvec3 p = node + size * ((place + 0.5) / static_cast<double>(kAcross) - 0.5);
    const LocalLight here = local_light(light, p);
    if (here.distance > glm::distance(*centre, p)) continue;
    mean.irradiance += share * here.irradiance;
    mean.towards += share * in_colour(here.irradiance, kGrey) * here.towards;
  }
  const double all = in_colour(mean.irradiance, kGrey);
  mean.towards = all > 0 ? mean.towards / all : dvec3(0);
  return mean;
}

/// Moments of light along one direction.
void add_beam(Moments& light, size_t node, double irradiance, const dvec3& towards) {
  const double mean = irradiance / (4 * kPi);
  light[0][node] += static_cast<float>(mean);
  for (int a = 0; a < 3; ++a) light[static_cast<size_t>(a) + 1][node] -= static_cast<float>(mean * towards[a]);
}

/// Mean free path where light is scattered: the mean extinction at scatterings, inverted. Infinite where none is.
double free_path(const GuideMedia& media, GuideColour colour, const Task& task) {
  const Lattice probes =
      Lattice::over(media.lo(), media.hi(), kMostVoxelsPerNode * media.voxel(), static_cast<size_t>(kMostNodes));
  std::vector<dvec2> sums(static_cast<size_t>(probes.n.x), dvec2(0));
  parallel_for(probes.n.x, quiet(task), [&](int x) {
    MediaLine line(media, colour);
    for (int y = 0; y < probes.n.y; ++y) {
      line.follow({probes.node(x, y, 0), {0, 0, probes.spacing}});
      for (int z = 0; z < probes.n.z; ++z) {
        const double extinction = line.at(z).sigma_t;
        sums[static_cast<size_t>(x)] += dvec2(extinction, extinction * extinction);
      }
    }
  });
  dvec2 sum(0);
  for (const dvec2& s : sums) sum += s;
  return sum.y > 0 ? sum.x / sum.y : std::numeric_limits<double>::infinity();
}

}  // namespace

double LightFields::most_nodes(double pixels) {
  return std::clamp(kNodesPerPixel * pixels, kFewestNodes, kMostNodes);
}

LightFields::LightFields(const std::vector<GuideMedia>& times, const Lights& lights, const Surfaces* surfaces,
                         GuideColour colour, double detail, double pixels, const Task& task) {
  const GuideMedia& media = times[times.size() / 2];
  const double wanted = kFreePathsPerNode * free_path(media, colour, task) / media.voxel();
  const double voxels = std::clamp(wanted, kVoxelsPerNode, kMostVoxelsPerNode) / detail;
  const double most = std::min(most_nodes(pixels) * detail * detail * detail, kMostNodesInDetail);
  fine_ = Lattice::over(media.lo(), media.hi(), voxels * media.voxel(), static_cast<size_t>(most));
  coarse_ = Lattice::over(media.lo(), media.hi(), 2 * fine_.spacing, static_cast<size_t>(most));
  ScatteringSolver solver(fine_, media, colour, task), coarse(coarse_, solver, task);
  near_ = solver.near_media();
  scale_ = solver.mean_scale();
  colour_ = colour;
  if (colour == kGrey && !media.media().empty()) tint_ = OrderTint(media.tint(0));
  if (surfaces) {
    ambient_light_.emplace(media, coarse_, scale_);
    if (colour == kGrey && media.mixed_tints()) node_tints_.resize(ambient_light_->nodes().size());
    coarse.each_node([&](int x, int y, int z, size_t i) {
      const size_t at = ambient_light_->index(x, y, z);
      AmbientLight::Node& node = ambient_light_->nodes()[at];
      node.extinction = coarse.scaled_extinction()[i];
      if (!node_tints_.empty()) node_tints_[at] = vec3(mean_tint(media, coarse_.node(x, y, z), coarse_.spacing));
      if (media.emissions().empty()) return;
      const vec3 emission(mean_emission(media, coarse_.node(x, y, z), coarse_.spacing) * coarse_.spacing);
      node.emitted = {emission.x, emission.y, emission.z};
    });
  }
  const auto scaled_transmittance = [&](double depth) { return attenuation(depth * scale_); };
  const Task own = quiet(task);

  std::vector<LightGroup> groups = light_groups(lights, media, colour);
  lights_.reserve(groups.size());
  for (LightGroup& group : groups) {
    SolvedLight g;
    g.group = group;
    Moments arriving;
    switch (group.kind) {
      case LightGroup::Kind::kSun: {
        const dvec3 towards = group.sun->axis();
        for (const GuideMedia& m : times) g.sun.emplace_back(m, colour, towards, m.voxel(), kMostSunNodes, own);
        if (surfaces) g.visible = NodeValues(fine_.size());
        arriving = solver.nothing();
        const double irradiance = in_colour(group.sun->irradiance(), colour);
        solver.each_node([&](int x, int y, int z, size_t i) {
          const dvec3 p = fine_.node(x, y, z);
          double share = 1;
          if (surfaces) {
            share = in_colour(surfaces->passage({p, towards}, kUnseen).light, kGrey);
            g.visible[i] = static_cast<float>(share);
          }
          if (solver.extinction()[i] == 0) return;
          add_beam(arriving, i, irradiance * share * scaled_transmittance(g.sun_in_middle().at(p)), towards);
        });
        break;
      }
      case LightGroup::Kind::kLocal:
      case LightGroup::Kind::kOthers: {
        arriving = solver.nothing();
        const bool alone = group.kind == LightGroup::Kind::kLocal;
        if (alone) g.depth = NodeValues(fine_.size());
        if (alone && surfaces) g.visible = NodeValues(fine_.size());
        solver.each_node([&](int x, int y, int z, size_t i) {
          const dvec3 p = fine_.node(x, y, z);
          for (const Light* light : group.lights) {
            const LocalLight l = local_light(*light, p);
            double share = 1, depth = 0;
            if (surfaces) share = in_colour(surfaces->passage({p, l.towards}, l.distance).light, kGrey);
            depth = depth_along(solver, p, l.towards, l.distance);
            if (alone) g.depth[i] = static_cast<float>(depth);
            if (!g.visible.empty()) g.visible[i] = static_cast<float>(share);
            const LocalLight mean = mean_over_cube(*light, p, fine_.spacing);
            add_beam(arriving, i, in_colour(mean.irradiance, colour) * share * l.transmittance(scale_ * depth),
                     mean.mean_cosine() * mean.towards);
          }
        });
        break;
      }
      case LightGroup::Kind::kSky: {
        g.incoming = sky_radiance(*lights.environment(), colour == kGrey ? group.channel : colour);
        if (surfaces) hide_sky(media, *surfaces, g.incoming);
        if (sky_.empty()) sky_ = solver.arriving();
        arriving = solver.entering(g.incoming);
        break;
      }
      case LightGroup::Kind::kEmission: {
        NodeValues emission(fine_.size());
        std::vector<dvec3> sums(static_cast<size_t>(fine_.n.x), dvec3(0));
        solver.each_node([&](int x, int y, int z, size_t i) {
          const dvec3 here = media.emission(fine_.node(x, y, z));
          sums[static_cast<size_t>(x)] += here;
          emission[i] = static_cast<float>(in_colour(here, colour) * fine_.spacing);
        });
        dvec3 colours(0);
        for (const dvec3& sum : sums) colours += sum;
        arriving = solver.emitted(emission);
        g.group.colour = of_mean_one(colours);
        break;
      }
      case LightGroup::Kind::kSurfaces:
        break;  // not among those of light_groups()
    }
    solve(g, std::move(arriving), solver, coarse);
    lights_.push_back(std::move(g));
    task.check();
  }
  if (surfaces) add_surface_light(media, lights, *surfaces, colour, solver, coarse, own);
  node_tints_ = {};
}

void LightFields::add_surface_light(const GuideMedia& media, const Lights& lights, const Surfaces& surfaces,
                                    GuideColour colour, ScatteringSolver& fine, ScatteringSolver& coarse,
                                    const Task& task) {
  ambient_light_->gather(surfaces, *lights.environment(), task);
  const LitSurfaces lit{lights_, fine_, scale_, lights, &surfaces, colour, &*ambient_light_, nullptr};
  const SurfaceLight& light = surface_light_.emplace(
      media, surfaces, [&](const Ray& ray, const SurfaceHit& hit) { return lit.reflected(ray, hit); }, *ambient_light_,
      task);
  if (light.colour() == dvec3(0)) {
    surface_light_.reset();
    return;
  }
  SolvedLight g;
  g.group = {LightGroup::Kind::kSurfaces, "surfaces", nullptr, {}, light.colour()};
  Moments arriving = fine.nothing();
  fine.each_node([&](int x, int y, int z, size_t i) {
    if (fine.extinction()[i] == 0) return;
    const std::array<double, 4> moments = light.at(fine_.node(x, y, z), colour);
    for (size_t a = 0; a < 4; ++a) arriving[a][i] = static_cast<float>(moments[a]);
  });
  solve(g, std::move(arriving), fine, coarse);
  lights_.push_back(std::move(g));
  ambient_light_->gather(surfaces, *lights.environment(), task);
}

void LightFields::add_to_ambient(const SolvedLight& light, const Moments& fine_orders, const ScatteringSolver& fine,
                                 const ScatteringSolver& coarse) {
  const dvec3 colour = light.group.colour_in(colour_);
  const Moments fine_source = coarse.source_from(fine, fine_orders);
  coarse.each_node([&](int x, int y, int z, size_t i) {
    const size_t at = ambient_light_->index(x, y, z);
    AmbientLight::Node& node = ambient_light_->nodes()[at];
    const OrderTint tint = node_tints_.empty() ? tint_ : OrderTint(dvec3(node_tints_[at]));
    const auto add = [&](const dvec3& own, const Moments& source, float share) {
      const vec3 seen(colour * own);
      for (size_t moment = 0; moment < 4; ++moment)
        for (int c = 0; c < 3; ++c)
          node.scattered[3 * moment + static_cast<size_t>(c)] += share * seen[c] * source[moment][i];
    };
    add(tint.at(kFineOrder), fine_source, 1);
    for (size_t g = SolvedLight::kFineGuides; g < light.orders.size(); ++g)
      add(tint.of_guide(g), light.orders[g], coarse.scaled_extinction()[i]);
  });
}

void LightFields::solve(SolvedLight& light, Moments scattered, ScatteringSolver& fine, ScatteringSolver& coarse) {
  constexpr auto& first = SolvedLight::kFirstOrder;
  for (size_t g = 0; g < first.size(); ++g)
    light.orders.push_back(g < SolvedLight::kFineGuides ? fine.nothing() : coarse.nothing());
  fine.scatter(scattered);
  if (light.group.kind == LightGroup::Kind::kOthers || light.group.kind == LightGroup::Kind::kEmission ||
      light.group.kind == LightGroup::Kind::kSurfaces)
    light.once = scattered;
  Moments fine_orders;
  if (ambient_light_) fine_orders = scattered;
  size_t g = 0;
  const auto gather = [&](const ScatteringSolver& solver, int order) {
    if (order == first[g])
      solver.copy(scattered, light.orders[g]);
    else
      solver.add(scattered, light.orders[g]);
  };
  for (int order = 2; order < first[SolvedLight::kFineGuides]; ++order) {
    fine.transport(scattered);
    fine.scatter(scattered);
    if (order >= first[g + 1]) ++g;
    gather(fine, order);
    if (ambient_light_) fine.add(scattered, fine_orders);
  }
  const Moments source = coarse.source_from(fine, scattered);
  scattered = coarse.nothing();
  NodeValues before;
  double sum = 0;
  for (int order = first[SolvedLight::kFineGuides]; order <= kLastOrder; ++order) {
    const bool begins = order == first[SolvedLight::kFineGuides];
    before = scattered[0];
    if (begins)
      coarse.transport_source(source, scattered);
    else
      coarse.transport(scattered);
    coarse.scatter(scattered);
    if (g + 1 < first.size() && order >= first[g + 1]) ++g;
    gather(coarse, order);
    const double own = coarse.total(scattered);
    sum += own;
    if (!begins && own <= kNegligible * sum) break;
  }
  Moments& tail = light.orders.back();
  for (size_t i = 0; i < tail[0].size(); ++i) {
    const float ratio = std::clamp(scattered[0][i] / (before[i] + 1e-20f), 0.0f, static_cast<float>(kLargestRatio));
    for (size_t a = 0; a < 4; ++a) tail[a][i] += scattered[a][i] * ratio / (1 - ratio);
  }
  if (ambient_light_) add_to_ambient(light, fine_orders, fine, coarse);
}

size_t LightFields::bytes() const {
  size_t floats = 0, others = sky_.bytes();
  for (const SolvedLight& g : lights_) {
    floats += g.depth.size() + g.visible.size();
    for (const NodeValues& v : g.once) floats += v.size();
    for (const Moments& order : g.orders)
      for (const NodeValues& v : order) floats += v.size();
    for (const SunDepth& sun : g.sun) others += sun.bytes();
  }
  return floats * sizeof(float) + others;
}

}  // namespace brume
