#include "render/guides/surface_light.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/attenuation.h"
#include "render/guides/lattice.h"
#include "render/guides/lit_surface.h"
#include "render/guides/scattering_solver.h"
#include "render/guides/sky_cells.h"

namespace brume {
namespace {

constexpr int kProbesAcross[] = {32, 24, 20, 16, 12, 8};  // the longest side, as many as there may be
constexpr size_t kMostProbes = 3000;
constexpr size_t kBrightRays = 32;    // from each observer
constexpr double kBright = 4;         // of the mean radiance that observers see of surfaces
constexpr double kLeastReach = 1e-3;  // of a point's part
constexpr double kNegligible = 1e-3;  // of all reflections, for the last one
constexpr int kMostReflections = 64;
constexpr double kWidestCone = 0.5;  // half angle of what a ray stands for [rad]
constexpr double kUneven = 0.2;      // mean deviation from the mean share of the sky

/// How far the facets of a metal that a cone of directions meets are apart as seen along its middle: by its normals
/// and by the cone's own width [rad].
double facets_apart(const Surfaces& surfaces, const Ray& ray, const SurfaceHit& hit, double half_angle) {
  constexpr double kUnknown = 0.5;  // where the cone goes beyond the metal's rim
  const Frame frame(ray.d);
  double apart = 0;
  for (const dvec3& aside : {frame.x, frame.y}) {
    const auto there = surfaces.intersect({ray.o, glm::normalize(ray.d + std::tan(half_angle) * aside)}, kFar);
    apart =
        std::max(apart, there && there->surface == hit.surface ? glm::distance(there->shading, hit.shading) : kUnknown);
  }
  return apart + 0.5 * half_angle;
}

}  // namespace

SurfaceLight::SurfaceLight(const GuideMedia& media, const Surfaces& surfaces, const AmbientLight& nodes,
                           const Task& task)
    : surfaces_(surfaces),
      points_(surfaces, media, task),
      light_(points_.points().size()),
      groups_(nodes.groups()),
      scattered_of_groups_(light_.size() * groups_),
      looked_at_(light_.size(), 0.0) {
  for (const SurfacePoints::Point& point : points_.points())
    at_points_.add(point.p, Frame(point.normal), at_points_.all().size());
  place_probes(media, nodes);
  into_media_.resize(at_probes_.all().size());
  into_media_of_groups_.assign(into_media_.size() * groups_, dvec3(0));
  at_points_.look(surfaces, points_, nodes, task);
  at_probes_.look(surfaces, points_, nodes, task);
  for (size_t i = 0; i < light_.size(); ++i) {
    double sum = 0;
    for (size_t k = 0; k < at_points_.rays(); ++k) sum += 1 / static_cast<double>(at_points_.seen_by(i)[k].distance);
    SurfacePoints::Point& point = points_.points()[i];
    point.reach = std::max(static_cast<double>(at_points_.rays()) / sum, kLeastReach * std::sqrt(point.area));
  }
  find_sky_seen();
}

// Of media that reach far around all surfaces, where these send them any light to speak of.
std::pair<dvec3, dvec3> SurfaceLight::lit_box(const GuideMedia& media) {
  constexpr double kFarAround = 2, kReach = 1.5;  // times as large; sizes of what holds all surfaces
  dvec3 lo(kFar), hi(-kFar);
  for (const SurfacePoints::Point& point : points_.points()) {
    lo = glm::min(lo, point.p);
    hi = glm::max(hi, point.p);
  }
  const double size = max_component(hi - lo);
  lo = glm::max(media.lo(), lo - kReach * size);
  hi = glm::min(media.hi(), hi + kReach * size);
  far_around_ =
      glm::all(glm::lessThan(lo, hi)) && max_component(media.hi() - media.lo()) > kFarAround * max_component(hi - lo);
  return far_around_ ? std::pair(lo, hi) : std::pair(media.lo(), media.hi());
}

void SurfaceLight::place_probes(const GuideMedia& media, const AmbientLight& nodes) {
  const Lattice& lattice = nodes.lattice();
  const auto [lo, hi] = lit_box(media);
  for (const int across : kProbesAcross) {
    // In the middle of cells: no probe stands on a floor below the media.
    grid_ = ProbeGrid(lo, hi, across);
    probe_.assign(static_cast<size_t>(grid_.count()), -1);
    for (int x = 0; x < lattice.n.x; ++x)
      for (int y = 0; y < lattice.n.y; ++y)
        for (int z = 0; z < lattice.n.z; ++z) {
          if (!(nodes.extinction(x, y, z) > 0)) continue;
          const dvec3 middle = lattice.node(x, y, z), half = 0.5 * lattice.spacing * lattice.cell(x, y, z);
          const dvec3 first = grid_.inside(middle - half), last = grid_.inside(middle + half);
          // Steps from probe to probe, but no more of them than spacings.
          const dvec3 steps =
              glm::clamp(glm::ceil((last - first) / grid_.spacing()), dvec3(1), glm::ceil(lattice.cell(x, y, z)));
          for (double i = 0; i <= steps.x; ++i)
            for (double j = 0; j <= steps.y; ++j)
              for (double k = 0; k <= steps.z; ++k)
                for (const int probe : grid_.around(first + (last - first) * dvec3(i, j, k) / steps).probe)
                  probe_[static_cast<size_t>(probe)] = 0;
        }
    if (static_cast<size_t>(std::count(probe_.begin(), probe_.end(), 0)) <= kMostProbes) break;
  }
  for (size_t i = 0; i < probe_.size(); ++i) {
    if (probe_[i] < 0) continue;
    probe_[i] = static_cast<int>(at_probes_.all().size());
    at_probes_.add(grid_.at(static_cast<int>(i)), Frame({0, 0, 1}), i);
  }
}

template <class Visit>
void SurfaceLight::each_probe(const dvec3& world, const Visit& visit) const {
  constexpr double kHidden = 1e-3;
  ProbeGrid::Around around = grid_.around(world);
  double sum = 0;
  for (size_t k = 0; k < 8; ++k) {
    const int probe = probe_[static_cast<size_t>(around.probe[k])];
    if (probe < 0)
      around.weight[k] = 0;
    else if (!at_probes_.all()[static_cast<size_t>(probe)].outside)
      around.weight[k] *= kHidden;
    sum += around.weight[k];
  }
  for (size_t k = 0; k < 8 && sum > 0; ++k)
    if (around.weight[k] > 0)
      visit(static_cast<size_t>(probe_[static_cast<size_t>(around.probe[k])]), around.weight[k] / sum);
}

void SurfaceLight::find_sky_seen() {
  const std::vector<dvec3>& bins = ScatteringSolver::directions();
  sky_seen_at_.resize(at_probes_.all().size());
  for (size_t i = 0; i < sky_seen_at_.size(); ++i) {
    SkySeen count{};
    double all = 0;
    for (size_t k = 0; k < at_probes_.rays(); ++k) {
      const dvec3 d = at_probes_.direction(i, k);
      size_t nearest = 0;
      for (size_t b = 1; b < bins.size(); ++b)
        if (glm::dot(bins[b], d) < glm::dot(bins[nearest], d)) nearest = b;
      ++count[nearest];
      if (at_probes_.seen_by(i)[k].point != Observers::kSky) continue;
      ++sky_seen_at_[i][nearest];
      ++all;
    }
    for (size_t b = 0; b < bins.size(); ++b) {
      double& share = sky_seen_at_[i][b];
      share = count[b] > 0 ? share / count[b] : all / static_cast<double>(at_probes_.rays());
      sky_seen_[b] += share / static_cast<double>(sky_seen_at_.size());
    }
  }
  double sum = 0, apart = 0, farthest = 0;
  for (const double share : sky_seen_) sum += share;
  for (const SkySeen& seen : sky_seen_at_) {
    double own = 0;
    for (size_t b = 0; b < bins.size(); ++b) own += std::abs(seen[b] - sky_seen_[b]);
    apart += own / static_cast<double>(sky_seen_at_.size());
    farthest = std::max(farthest, own);
  }
  // Where media reach far around surfaces, few of the probes are near them, but much of what is seen is.
  sky_seen_unevenly_ = (far_around_ ? farthest : apart) > kUneven * sum;
}

SurfaceLight::SkySeen SurfaceLight::sky_seen(const dvec3& world) const {
  SkySeen mean{};
  each_probe(world, [&](size_t probe, double weight) {
    for (size_t b = 0; b < mean.size(); ++b) mean[b] += weight * sky_seen_at_[probe][b];
  });
  return mean;
}

void SurfaceLight::gather(const AmbientLight& nodes, const SkyParts& sky, int sky_group, const Task& task) {
  const SkyCells radiance(sky);
  parallel_for(static_cast<int>(light_.size()), quiet(task), [&](int i) {
    const auto at = static_cast<size_t>(i);
    AtPoint& light = light_[at];
    light.sky = light.sky_by_peaks = light.emitted = light.scattered = {};
    Flux* const of_groups = scattered_of_groups_.data() + at * groups_;
    std::fill_n(of_groups, groups_, Flux());
    std::vector<dvec3> scattered_of_groups(groups_);
    for (size_t k = 0; k < at_points_.rays(); ++k) {
      const Observers::Seen& seen = at_points_.seen_by(at)[k];
      const dvec3 d = at_points_.direction(at, k);
      // Share of the hemisphere by the cosine, over the cosine.
      const double share = 1 / (kPi * at_points_.density_of_ray(k));
      const AmbientLight::Incident incident =
          nodes.along(at_points_.all()[at].p, d, static_cast<double>(seen.distance), scattered_of_groups);
      for (size_t g = 0; g < groups_; ++g) of_groups[g].add(share * scattered_of_groups[g], d);
      light.emitted.add(share * incident.emitted, d);
      light.scattered.add(share * incident.scattered, d);
      if (seen.point != Observers::kSky) continue;
      const dvec3 from_sky = share * radiance(d);
      light.sky.add(incident.transmittance * from_sky, d);
      const dvec3 by_peaks = std::max(0.0, incident.scaled_transmittance - incident.transmittance) * from_sky;
      light.sky_by_peaks.add(by_peaks, d);
      if (groups_ > 0 && sky_group >= 0) of_groups[sky_group].add(by_peaks, d);
    }
  });
}

// Points that are much brighter than what is seen of surfaces on average; of many, some stand for all.
void SurfaceLight::find_bright(const std::vector<dvec3>& radiosity) {
  std::vector<double> seen(radiosity.size(), 0.0);
  double sum = 0;
  for (const Observers* observers : {&at_points_, &at_probes_})
    for (const Observers::Seen& s : observers->seen())
      if (s.point >= 0) {
        ++seen[static_cast<size_t>(s.point)];
        sum += in_colour(radiosity[static_cast<size_t>(s.point)], kGrey);
      }
  const double mean = sum / static_cast<double>(at_points_.seen().size() + at_probes_.seen().size());
  std::vector<double> power(radiosity.size(), 0.0);
  double all = 0;
  for (size_t i = 0; i < radiosity.size(); ++i) {
    const double own = in_colour(radiosity[i], kGrey);
    if (seen[i] == 0 || !(own > kBright * mean)) continue;
    power[i] = own * points_.points()[i].area;
    all += power[i];
  }
  double next = 0.5;
  for (size_t i = 0; i < power.size(); ++i) {
    if (!(power[i] > 0)) continue;
    const double share = std::min(1.0, power[i] / all * kBrightRays);
    looked_at_[i] = share / points_.points()[i].area;
    next -= share;
    if (next > 0) continue;
    next += 1;
    bright_.push_back(i);
  }
}

SurfaceLight::Radiosity SurfaceLight::black() const {
  return {std::vector<dvec3>(light_.size(), dvec3(0)), std::vector<dvec3>(light_.size() * groups_, dvec3(0))};
}

SurfaceLight::Arriving SurfaceLight::nothing_arriving() const {
  return {std::vector<Flux>(light_.size()), std::vector<Flux>(light_.size() * groups_),
          std::vector<AtProbe>(into_media_.size()), std::vector<dvec3>(into_media_.size() * groups_, dvec3(0))};
}

void SurfaceLight::send(const Radiosity& radiosity, bool bright, const AmbientLight& nodes, Arriving& to,
                        const Task& task) const {
  const auto of_groups = [&](size_t point) { return radiosity.of_groups.data() + point * groups_; };
  // Calls add(light, direction, factor, groups): the light of the groups is what is at `groups`, times the factor.
  const auto towards = [&](const Observers& observers, size_t i, const auto& add) {
    const Observers::Observer& observer = observers.all()[i];
    observers.each_point(i, [&](size_t point, const dvec3& share, size_t k) {
      const dvec3 d = observers.direction(i, k);
      double density = observers.density_of_ray(k);
      if (bright && looked_at_[point] > 0) {
        const SurfacePoints::Point& there = points_.points()[point];
        const double distance = static_cast<double>(observers.seen_by(i)[k].distance);
        density += looked_at_[point] * distance * distance / std::max(1e-3, -glm::dot(d, there.normal));
      }
      add(share * radiosity.all[point] / density, d, share / density, of_groups(point));
    });
    if (!bright) return;
    for (const Observers::Mirrored& m : observer.mirrored) {
      const double transmittance = static_cast<double>(observers.seen_by(i)[m.ray].transmittance),
                   density = observers.density_of_ray(m.ray);
      add(transmittance * m.own / density, observers.direction(i, m.ray), dvec3(transmittance / density),
          m.own_of_groups.data());
    }
    for (const size_t point : bright_) {
      const SurfacePoints::Point& there = points_.points()[point];
      const dvec3 to_it = there.p - observer.p;
      const double distance2 = glm::dot(to_it, to_it), distance = std::sqrt(distance2);
      if (!(distance2 > 0)) continue;
      const dvec3 d = to_it / distance;
      const double facing = -glm::dot(d, there.normal), cosine = glm::dot(d, observer.frame.z);
      if (!(facing > 0) || (observers.see_hemispheres() && !(cosine > 0))) continue;
      const dvec3 left = surfaces_.passage({observer.p, d}, distance).light;
      if (left == dvec3(0)) continue;
      const double density = looked_at_[point] * distance2 / facing + observers.density(cosine);
      const dvec3 share = attenuation(nodes.depth(observer.p, d, distance)) * left;
      add(share * radiosity.all[point] / density, d, share / density, of_groups(point));
    }
  };
  parallel_for(static_cast<int>(to.at_points.size()), quiet(task), [&](int i) {
    const auto at = static_cast<size_t>(i);
    towards(at_points_, at, [&](const dvec3& light, const dvec3& d, const dvec3& factor, const dvec3* groups) {
      to.at_points[at].add(light / kPi, d);
      for (size_t g = 0; g < groups_; ++g) to.at_points_of_groups[at * groups_ + g].add(factor * groups[g] / kPi, d);
    });
  });
  parallel_for(static_cast<int>(to.at_probes.size()), quiet(task), [&](int i) {
    const auto at = static_cast<size_t>(i);
    AtProbe& sum = to.at_probes[at];
    towards(at_probes_, at, [&](const dvec3& light, const dvec3& d, const dvec3& factor, const dvec3* groups) {
      sum.mean += light / (4 * kPi);
      sum.flux.add(light / (4 * kPi), -d);
      for (size_t g = 0; g < groups_; ++g) to.at_probes_of_groups[at * groups_ + g] += factor * groups[g] / (4 * kPi);
    });
  });
}

SurfaceLight::Radiosity SurfaceLight::later_reflections(const std::vector<Flux>& arriving,
                                                        const std::vector<Flux>& of_groups, const Task& task) const {
  Radiosity radiosity = black(), next = black(), sum = black();
  const auto add = [&] {
    double own = 0;
    for (size_t i = 0; i < sum.all.size(); ++i) {
      sum.all[i] += radiosity.all[i];
      own += points_.points()[i].area * in_colour(radiosity.all[i], kGrey);
    }
    for (size_t i = 0; i < sum.of_groups.size(); ++i) sum.of_groups[i] += radiosity.of_groups[i];
    return own;
  };
  for (size_t i = 0; i < arriving.size(); ++i) {
    const SurfacePoints::Point& point = points_.points()[i];
    radiosity.all[i] = point.albedo * arriving[i].onto(point.normal);
    for (size_t k = i * groups_; k < (i + 1) * groups_; ++k)
      radiosity.of_groups[k] = point.albedo * of_groups[k].onto(point.normal);
  }
  double all = add();
  for (int reflection = 1; reflection < kMostReflections; ++reflection) {
    parallel_for(static_cast<int>(light_.size()), quiet(task), [&](int i) {
      const auto at = static_cast<size_t>(i);
      const dvec3& albedo = points_.points()[at].albedo;
      const auto rays = static_cast<double>(at_points_.rays());
      dvec3* const groups = next.of_groups.data() + at * groups_;
      std::fill_n(groups, groups_, dvec3(0));
      dvec3 light(0);
      at_points_.each_point(at, [&](size_t point, const dvec3& share, size_t) {
        light += share * radiosity.all[point];
        for (size_t g = 0; g < groups_; ++g) groups[g] += share * radiosity.of_groups[point * groups_ + g];
      });
      next.all[at] = albedo * light / rays;
      for (size_t g = 0; g < groups_; ++g) groups[g] *= albedo / rays;
    });
    std::swap(radiosity, next);
    const double own = add();
    all += own;
    if (own <= kNegligible * all) break;
  }
  return sum;
}

void SurfaceLight::exchange(const LitSurfaces& lit, const AmbientLight& nodes, const Task& task) {
  Radiosity radiosity = black();
  parallel_for(static_cast<int>(light_.size()), quiet(task), [&](int i) {
    const auto at = static_cast<size_t>(i);
    const auto& samples = points_.points()[at].samples;
    std::vector<dvec3> of_groups(groups_);
    for (const auto& [ray, hit] : samples) {
      radiosity.all[at] += lit.reflected(ray, hit, 0, of_groups) / static_cast<double>(samples.size());
      for (size_t g = 0; g < groups_; ++g)
        radiosity.of_groups[at * groups_ + g] += of_groups[g] / static_cast<double>(samples.size());
    }
  });
  for (Observers* const observers : {&at_points_, &at_probes_})
    parallel_for(static_cast<int>(observers->all().size()), quiet(task), [&](int i) {
      std::vector<dvec3> of_groups(groups_);
      for (Observers::Mirrored& m : observers->all()[static_cast<size_t>(i)].mirrored) {
        m.own_of_groups.assign(groups_, dvec3(0));
        // Few rays stand for all of a metal: highlights much narrower than what one stands for would be missed or
        // found by chance.
        double half_angle = std::sqrt(1 / (kPi * observers->density_of_ray(m.ray)));
        dvec3 left(1);
        for (const auto& [ray, hit] : m.metals) {
          const double apart = facets_apart(surfaces_, ray, hit, std::min(half_angle, kWidestCone));
          m.own += left * lit.reflected(ray, hit, apart, of_groups);
          for (size_t g = 0; g < groups_; ++g) m.own_of_groups[g] += left * of_groups[g];
          left *= surfaces_.bsdf(hit).albedo;
          half_angle = 2 * apart;
        }
      }
    });
  find_bright(radiosity.all);
  Arriving arriving = nothing_arriving();
  arriving.at_probes = std::move(into_media_);
  send(radiosity, /*bright=*/true, nodes, arriving, task);
  send(later_reflections(arriving.at_points, arriving.at_points_of_groups, task), /*bright=*/false, nodes, arriving,
       task);
  for (size_t i = 0; i < light_.size(); ++i) light_[i].reflected = arriving.at_points[i];
  reflected_of_groups_ = std::move(arriving.at_points_of_groups);
  into_media_ = std::move(arriving.at_probes);
  into_media_of_groups_ = std::move(arriving.at_probes_of_groups);
}

void SurfaceLight::answer(const AmbientLight& nodes, const Task& task) {
  constexpr double kLargestRatio = 0.95;
  std::vector<Flux> scattered(light_.size());
  parallel_for(static_cast<int>(light_.size()), quiet(task), [&](int i) {
    const auto at = static_cast<size_t>(i);
    for (size_t k = 0; k < at_points_.rays(); ++k) {
      const dvec3 d = at_points_.direction(at, k);
      const auto distance = static_cast<double>(at_points_.seen_by(at)[k].distance);
      scattered[at].add(
          nodes.along(at_points_.all()[at].p, d, distance).scattered / (kPi * at_points_.density_of_ray(k)), d);
    }
  });
  Arriving more = nothing_arriving();
  const std::vector<Flux> of_no_group(light_.size() * groups_);
  send(later_reflections(scattered, of_no_group, task), /*bright=*/false, nodes, more, task);
  double before = 0, after = 0;
  for (size_t i = 0; i < into_media_.size(); ++i) {
    before += in_colour(into_media_[i].mean, kGrey);
    after += in_colour(more.at_probes[i].mean, kGrey);
  }
  // Each time as much less; of each light group as much of what there is.
  const double times = before > 0 ? 1 / (1 - std::min(after / before, kLargestRatio)) : 0;
  const auto grown = [](const dvec3& from, const dvec3& to) {
    dvec3 ratio(1);
    for (int c = 0; c < 3; ++c)
      if (from[c] > 0) ratio[c] = to[c] / from[c];
    return ratio;
  };
  for (size_t i = 0; i < into_media_.size(); ++i) {
    const dvec3 mean = into_media_[i].mean;
    into_media_[i].mean += times * more.at_probes[i].mean;
    for (size_t a = 0; a < 3; ++a) into_media_[i].flux.axis[a] += times * more.at_probes[i].flux.axis[a];
    for (size_t g = 0; g < groups_; ++g) into_media_of_groups_[i * groups_ + g] *= grown(mean, into_media_[i].mean);
  }
  for (size_t i = 0; i < light_.size(); ++i) {
    const dvec3& normal = points_.points()[i].normal;
    const dvec3 reflected = light_[i].reflected.onto(normal);
    for (size_t a = 0; a < 3; ++a) light_[i].reflected.axis[a] += times * more.at_points[i].axis[a];
    const dvec3 ratio = grown(reflected, light_[i].reflected.onto(normal));
    for (size_t g = 0; g < groups_; ++g)
      for (dvec3& axis : reflected_of_groups_[i * groups_ + g].axis) axis *= ratio;
  }
}

dvec3 SurfaceLight::colour() const {
  dvec3 sum(0);
  for (const AtProbe& probe : into_media_) sum += probe.mean;
  const double mean = in_colour(sum, kGrey);
  return mean > 0 ? sum / mean : dvec3(0);
}

std::array<double, 4> SurfaceLight::at(const dvec3& world, GuideColour colour) const {
  std::array<double, 4> moments{};
  each_probe(world, [&](size_t probe, double weight) {
    moments[0] += weight * in_colour(into_media_[probe].mean, colour);
    for (size_t a = 0; a < 3; ++a) moments[a + 1] += weight * in_colour(into_media_[probe].flux.axis[a], colour);
  });
  return moments;
}

void SurfaceLight::shares(const dvec3& world, std::span<dvec3> of_groups) const {
  std::fill(of_groups.begin(), of_groups.end(), dvec3(0));
  dvec3 sum(0);
  each_probe(world, [&](size_t probe, double weight) {
    sum += weight * into_media_[probe].mean;
    for (size_t g = 0; g < of_groups.size(); ++g) of_groups[g] += weight * into_media_of_groups_[probe * groups_ + g];
  });
  for (dvec3& own : of_groups)
    for (int c = 0; c < 3; ++c) own[c] = sum[c] > 0 ? own[c] / sum[c] : 0.0;
}

SurfaceLight::Around SurfaceLight::onto(const dvec3& p, const dvec3& normal, std::span<dvec3> of_groups) const {
  const SurfacePoints::Around around = points_.around(p, normal);
  for (size_t g = 0; g < of_groups.size(); ++g) {
    Flux own;
    for (size_t k = 0; k < around.count; ++k) {
      const size_t at = static_cast<size_t>(around.point[k]) * groups_ + g;
      for (size_t a = 0; a < 3; ++a) {
        own.axis[a] += around.weight[k] * scattered_of_groups_[at].axis[a];
        if (!reflected_of_groups_.empty()) own.axis[a] += around.weight[k] * reflected_of_groups_[at].axis[a];
      }
    }
    of_groups[g] = own.onto(normal);
  }
  AtPoint mean;
  for (size_t k = 0; k < around.count; ++k) {
    const AtPoint& own = light_[static_cast<size_t>(around.point[k])];
    for (Flux AtPoint::*kind :
         {&AtPoint::sky, &AtPoint::sky_by_peaks, &AtPoint::emitted, &AtPoint::scattered, &AtPoint::reflected})
      for (size_t a = 0; a < 3; ++a) (mean.*kind).axis[a] += around.weight[k] * (own.*kind).axis[a];
  }
  return {mean.sky.onto(normal), mean.emitted.onto(normal),
          mean.scattered.onto(normal) + mean.sky_by_peaks.onto(normal), mean.reflected.onto(normal)};
}

}  // namespace brume
