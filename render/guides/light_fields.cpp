#include "render/guides/light_fields.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "render/guides/guide_light.h"
#include "render/guides/lit_surface.h"
#include "render/guides/media_line.h"

namespace brume {
namespace {

constexpr int kLastAnswer = 64;  // order of light that only surfaces are to be sent
// Between nodes, at a detail of 1: as many voxels, or more where light goes farther.
constexpr double kVoxelsPerNode = 2, kMostVoxelsPerNode = 4, kFreePathsPerNode = 0.5;
// Of them at a detail of 1, where media are large: as many for each pixel, within limits.
constexpr double kNodesPerPixel = 12, kFewestNodes = 2.5e5;
constexpr double kMostNodes = 1e6, kMostNodesInDetail = 4e6;
// Around instances alone: the more of them, the less a lattice around all can tell of each. Their shadows, which show
// most, are in the finer SunDepth.
constexpr double kFewestAmongInstances = 1e5, kNodesTimesInstances = 1e8;
constexpr double kHomogeneousNodes = 12, kLayerNodes = 64, kSurfaceNodes = 6;  // of a graded lattice across them
constexpr double kUpright = 0.9999, kNearScales = 24;  // cosine of a layer's tilt; scale heights around its middle
constexpr size_t kMostRegions = 256;                   // that are told apart
constexpr double kGradedShare = 0.25, kMostGradedShare = 0.5;  // of the nodes of an even lattice that it has
constexpr double kMuchCloser = 0.5;                            // spacing over that of the even one
constexpr double kNegligible = 5e-3;                           // of all orders together, for the last one
constexpr double kNegligibleTail = 1e-3;    // the same of what one more order changes in the sum of the last ones
constexpr double kNegligibleAnswer = 0.02;  // the same of light that only surfaces are to be sent
constexpr double kLargestRatio = 0.99;      // of an order to the one before, in the tail
constexpr size_t kMostOfTail = 12;          // orders of the tail that its sum is made of
constexpr double kFineOrder = 2;            // mean number of scatterings of the orders that fine nodes hold

/// Over a box around a point.
dvec3 mean_emission(const GuideMedia& media, const dvec3& middle, const dvec3& size) {
  dvec3 sum(0);
  for (int corner = 0; corner < 8; ++corner)
    sum += media.emission(middle + 0.25 * size * dvec3(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1));
  return 0.125 * sum;
}

/// Of what the media scatter, over a box around a point.
dvec3 mean_tint(const GuideMedia& media, const dvec3& middle, const dvec3& size) {
  MediaLine line(media, kGrey);
  dvec3 sum(0);
  double scattered = 0;
  for (int edge = 0; edge < 4; ++edge) {
    line.follow({middle + 0.25 * size * dvec3(edge & 1 ? 1 : -1, edge & 2 ? 1 : -1, -1), {0, 0, 0.5 * size.z}});
    for (int end = 0; end < 2; ++end) {
      const GuideMedia::Point point = line.at(end);
      scattered += point.sigma_t * point.albedo;
      sum += point.sigma_t * point.albedo * point.tint;
    }
  }
  return scattered > 0 ? sum / scattered : dvec3(1);
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

/// Whether lamps and no sun shine into one medium. Their light is followed with second moments, which say more than a
/// broad forward peak does that counts as not scattered.
bool lamps_alone(const GuideMedia& media, const Lights& lights, const SkyParts& sky) {
  const dvec3 middle = 0.5 * (media.lo() + media.hi());
  const auto any_shines = [&](const auto& all) {
    return std::any_of(all.begin(), all.end(), [&](const auto& light) { return light->importance(middle) > 0; });
  };
  return media.media().size() == 1 && !any_shines(lights.suns()) && !any_shines(sky.suns()) &&
         (any_shines(lights.finite()) || any_shines(lights.points()));
}

LatticeRegion all_of(std::span<const LatticeRegion> regions) {
  LatticeRegion all = regions.front();
  for (const LatticeRegion& r : regions)
    all = {glm::min(all.lo, r.lo), glm::max(all.hi, r.hi), glm::min(all.spacing, r.spacing)};
  return all;
}

/// What limits how far apart nodes are: grids, homogeneous media, emissions, surfaces and lamps.
std::vector<LatticeRegion> lattice_regions(const GuideMedia& media, const Lights& lights, const Surfaces* surfaces,
                                           double spacing) {
  std::vector<LatticeRegion> regions;
  const auto add = [&](std::span<const dvec3> corners, double wanted, double across) {
    LatticeRegion& r = regions.emplace_back(LatticeRegion{corners[0], corners[0], dvec3(0)});
    for (const dvec3& p : corners) {
      r.lo = glm::min(r.lo, p);
      r.hi = glm::max(r.hi, p);
    }
    const dvec3 size = r.hi - r.lo;
    r.spacing = dvec3(std::max(spacing, std::min(wanted, max_component(size) / across)));
  };
  // Up and down as near as asked for; sideways, where light changes little in a layer, much farther apart. The planes
  // of one that is tilted cross all its heights: there only around its middle, where the eye is.
  const auto add_layer = [&](const Medium& layer, double free_path) {
    add(layer.corners(), kFar, 1);
    LatticeRegion& all = regions.back();
    const double sideways = std::max(kFreePathsPerNode * free_path, max_component(all.hi - all.lo) / kLayerNodes);
    const dvec3 slope = layer.gradient_to_world(layer.homogeneous()->falloff->slope);
    const double steepness = glm::length(slope);
    const dvec3 up = glm::abs(slope) / steepness;
    LatticeRegion near = all;
    for (int a = 0; a < 3; ++a)
      near.spacing[a] = std::max(spacing, std::min(sideways, spacing / std::max(up[a], 1e-9)));
    if (max_component(up) < kUpright) {
      all.spacing = dvec3(std::max(spacing, sideways));
      const dvec3 middle = 0.5 * (all.lo + all.hi);
      near.lo = glm::max(all.lo, middle - kNearScales / steepness);
      near.hi = glm::min(all.hi, middle + kNearScales / steepness);
      regions.push_back(near);
    } else {
      all = near;
    }
  };
  for (const Medium& m : media.media()) {
    const double free_path = 1 / (m.maximum_density() * in_colour(m.coefficients().sigma_t, kGrey));
    if (m.falls_off())
      add_layer(m, free_path);
    else if (m.homogeneous())
      add(m.corners(), kFreePathsPerNode * free_path, kHomogeneousNodes);
    else
      add(m.corners(), spacing / media.voxel() * m.voxel_size(), 1);
  }
  for (const EmissionField& e : media.emissions()) add(e.shape().corners(), spacing, 1);
  for (size_t i = 0; surfaces && i < surfaces->count(); ++i) {
    const std::vector<dvec3>& points = surfaces->mesh(static_cast<uint32_t>(i)).positions;
    if (!points.empty()) add(points, kFar, kSurfaceNodes);
  }
  for (const FiniteLight* const lamp : lights.finite())
    if (const dvec3* const centre = lamp->centre()) add({centre, 1}, spacing, 1);
  return regions.size() > kMostRegions ? std::vector{all_of(regions)} : regions;
}

/// With wide cells where media of closed form reach far around the others, or flat ones in layers: as close as is
/// wanted where it has far fewer nodes than an even lattice, much closer in layers for as many, as close for fewer;
/// else nothing.
std::optional<Lattice> graded_lattice(const GuideMedia& media, const Lights& lights, const Surfaces* surfaces,
                                      double wanted, const Lattice& even) {
  const bool layers =
      std::any_of(media.media().begin(), media.media().end(), [](const Medium& m) { return m.falls_off(); });
  const bool several = media.media().size() + media.emissions().size() > 1 && !media.instances();
  if (!layers && !several) return {};
  const double nodes = static_cast<double>(even.n.x) * even.n.y * even.n.z;
  const auto graded = [&](double spacing, double widest, double share) {
    return Lattice::graded(media.lo(), media.hi(), lattice_regions(media, lights, surfaces, spacing), spacing, widest,
                           static_cast<size_t>(share * nodes));
  };
  std::optional<Lattice> found;
  if (layers) found = graded(wanted, kMuchCloser * even.spacing, 1);
  if (!found) found = graded(wanted, even.spacing, kGradedShare);
  if (!found && several) found = graded(even.spacing, even.spacing, kMostGradedShare);
  return found;
}

/// The sum of all orders from one on, of a few that follow one another: weights of them that leave least of what the
/// sum and the next order of each part of it do not agree on. They are found in a small part of the orders that power
/// iteration takes. Source: Mesina 1977; Sidi 1991, Efficient implementation of reduced rank extrapolation.
class TailSum {
 public:
  TailSum(const ScatteringSolver& solver) : solver_(solver) {}

  void add(const Source& order) {
    orders_.push_back(order);
    if (orders_.size() < 2) return;
    NodeValues& change = changes_.emplace_back(order[0].size());
    const Source& before = orders_[orders_.size() - 2];
    for (size_t i = 0; i < change.size(); ++i) change[i] = before[0][i] - order[0][i];
    std::vector<double>& row = products_.emplace_back();
    for (const NodeValues& other : changes_) row.push_back(solver_.product(change, other));
    first_.push_back(solver_.product(change, orders_[0][0]));
    find_weights();
  }
  size_t count() const { return changes_.size(); }
  /// Of the mean radiance, as ScatteringSolver::total.
  double total() const {
    double sum = 0;
    for (size_t k = 0; k < weights_.size(); ++k) sum += weights_[k] * solver_.total(orders_[k]);
    return sum;
  }
  Source sum() const {
    Source result = solver_.nothing<Source>();
    for (size_t k = 0; k < weights_.size(); ++k)
      for (size_t a = 0; a < 4; ++a)
        for (size_t i = 0; i < result[a].size(); ++i)
          result[a][i] += static_cast<float>(weights_[k]) * orders_[k][a][i];
    return result;
  }

 private:
  /// By Cholesky's decomposition of the changes' products.
  void find_weights() {
    constexpr double kRounding = 1e-9;
    const size_t n = changes_.size();
    std::vector<std::vector<double>> root = products_;
    weights_ = first_;
    for (size_t i = 0; i < n; ++i) {
      root[i][i] *= 1 + kRounding;
      for (size_t j = 0; j <= i; ++j) {
        for (size_t k = 0; k < j; ++k) root[i][j] -= root[i][k] * root[j][k];
        root[i][j] = j < i ? root[i][j] / root[j][j] : std::sqrt(std::max(root[i][i], kRounding * products_[i][i]));
      }
      for (size_t k = 0; k < i; ++k) weights_[i] -= root[i][k] * weights_[k];
      weights_[i] /= root[i][i];
    }
    for (size_t i = n; i-- > 0;) {
      for (size_t k = i + 1; k < n; ++k) weights_[i] -= root[k][i] * weights_[k];
      weights_[i] /= root[i][i];
    }
  }

  const ScatteringSolver& solver_;
  std::vector<Source> orders_;
  std::vector<NodeValues> changes_;            // of the mean radiance, from each order to the next
  std::vector<std::vector<double>> products_;  // scalar products of the changes, the lower triangle
  std::vector<double> first_, weights_;        // products of the changes with the first one; weights of the orders
};

/// The nodes of a lattice around media of which each stands at many places; others have as many as they had.
double most_among_instances(const GuideMedia& media, double most) {
  double instances = 0;
  for (const Medium& m : media.media()) {
    if (!m.instances()) return most;
    instances += static_cast<double>(m.instances()->size());
  }
  return std::min(most, std::max(kFewestAmongInstances, kNodesTimesInstances / instances));
}

}  // namespace

double LightFields::most_nodes(double pixels) {
  return std::clamp(kNodesPerPixel * pixels, kFewestNodes, kMostNodes);
}

LightFields::LightFields(const std::vector<GuideMedia>& times, const Lights& lights, const Surfaces* surfaces,
                         GuideColour colour, double detail, double pixels, const Task& task)
    : sky_parts_(*lights.environment()) {
  const GuideMedia& media = times[times.size() / 2];
  const double wanted = kFreePathsPerNode * free_path(media, colour, task) / media.voxel();
  const double voxels = std::clamp(wanted, kVoxelsPerNode, kMostVoxelsPerNode) / detail;
  double most = most_nodes(pixels);
  if (media.instances() && media.emissions().empty()) most = most_among_instances(media, most);
  most = std::min(most * detail * detail * detail, kMostNodesInDetail);
  const auto lattice = [&] {
    return Lattice::over(media.lo(), media.hi(), voxels * media.voxel(), static_cast<size_t>(most));
  };
  fine_ = lattice();
  if (media.instances()) {  // often in a thin layer, whose rows are mostly padding
    most *= static_cast<double>(fine_.n.z) / fine_.row();
    fine_ = lattice();
  }
  if (const std::optional<Lattice> graded = graded_lattice(media, lights, surfaces, voxels * media.voxel(), fine_))
    fine_ = *graded;
  coarse_ = fine_.planes ? fine_.every_second()
                         : Lattice::over(media.lo(), media.hi(), 2 * fine_.spacing, static_cast<size_t>(most));
  ScatteringSolver solver(fine_, media, colour, task, lamps_alone(media, lights, sky_parts_)),
      coarse(coarse_, solver, task);
  near_ = solver.near_media();
  scale_ = solver.mean_scale();
  colour_ = colour;
  if (colour == kGrey && !media.media().empty()) tint_ = OrderTint(media.tint(0));
  if (surfaces) {
    const bool groups = !media.mixed_tints() && !lights.groups().empty();
    ambient_light_.emplace(coarse_, scale_, groups ? lights.groups().size() : 0);
    if (groups) sky_group_ = static_cast<int>(lights.environment()->group);
    if (groups) ambient_light_->set_group_of_emissions(lights.group_of_all_emissions());
    if (colour == kGrey && media.mixed_tints()) node_tints_.resize(ambient_light_->nodes().size());
    coarse.each_node([&](int x, int y, int z, size_t i) {
      const size_t at = ambient_light_->index(x, y, z);
      ambient_light_->extinctions()[at] = coarse.scaled_extinction()[i];
      const dvec3 cell = coarse_.spacing * coarse_.cell(x, y, z);
      if (!node_tints_.empty()) node_tints_[at] = vec3(mean_tint(media, coarse_.node(x, y, z), cell));
      if (media.emissions().empty()) return;
      const vec3 emission(mean_emission(media, coarse_.node(x, y, z), cell) * coarse_.spacing);
      ambient_light_->nodes()[at].emitted = {emission.x, emission.y, emission.z};
    });
  }
  if (surfaces) surface_light_.emplace(media, *surfaces, *ambient_light_, task);
  LightSolve solving{times, sky_parts_, surfaces, colour, solver, coarse_, surface_light(), sky_, quiet(task)};
  for (std::unique_ptr<GuideLight>& light : guide_lights(lights, sky_parts_, surfaces, media, colour)) {
    solve(*light, solving, coarse);
    lights_.push_back(std::move(light));
    task.check();
  }
  if (surfaces) add_surface_light(lights, solving, coarse);
  node_tints_ = {};
}

void LightFields::add_surface_light(const Lights& lights, LightSolve& solving, ScatteringSolver& coarse) {
  SurfaceLight& light = *surface_light_;
  light.gather(*ambient_light_, sky_parts_, sky_group_, solving.task);
  light.exchange({lights_, lights, scale_, sky_parts_, solving.surfaces, &*ambient_light_, &light}, *ambient_light_,
                 solving.task);
  if (light.colour() != dvec3(0)) {
    light.answer(scattered_by_media(light, coarse), solving.task);
    std::unique_ptr<GuideLight> group = light_from_surfaces(light.colour());
    solve(*group, solving, coarse);
    lights_.push_back(std::move(group));
  }
  light.gather(*ambient_light_, sky_parts_, sky_group_, solving.task);
}

AmbientLight LightFields::scattered_by_media(const SurfaceLight& light, ScatteringSolver& coarse) const {
  AmbientLight scattering = ambient_light_->dark();
  Radiance arriving = coarse.nothing<Radiance>();
  coarse.each_node([&](int x, int y, int z, size_t i) {
    if (coarse.extinction()[i] == 0) return;
    const std::array<double, 4> moments = light.at(coarse_.node(x, y, z), colour_);
    for (size_t a = 0; a < 4; ++a) arriving[a][i] = static_cast<float>(moments[a]);
  });
  Source scattered = coarse.scatter(std::move(arriving)), sum = scattered;
  double all = coarse.total(sum);
  for (int order = 2; order <= kLastAnswer; ++order) {
    scattered = coarse.scatter(coarse.transport(std::move(scattered)));
    coarse.add(scattered, sum);
    const double own = coarse.total(scattered);
    all += own;
    if (own <= kNegligibleAnswer * all) break;
  }
  const vec3 colour(light.colour() * tint_.at(kFineOrder));
  coarse.each_node([&](int x, int y, int z, size_t i) {
    AmbientLight::Node& node = scattering.nodes()[scattering.index(x, y, z)];
    for (size_t moment = 0; moment < 4; ++moment)
      for (int c = 0; c < 3; ++c)
        node.scattered[3 * moment + static_cast<size_t>(c)] =
            coarse.scaled_extinction()[i] * colour[c] * sum[moment][i];
  });
  return scattering;
}

void LightFields::add_to_ambient(const GuideLight& light, const Source& fine_orders, const ScatteringSolver& fine,
                                 const ScatteringSolver& coarse) {
  const dvec3 colour = light.colour_in(colour_);
  const Emission fine_emission = coarse.emission_from(fine, fine_orders);
  coarse.each_node([&](int x, int y, int z, size_t i) {
    const size_t at = ambient_light_->index(x, y, z);
    AmbientLight::Node& node = ambient_light_->nodes()[at];
    std::vector<dvec3> shares(ambient_light_->groups(), dvec3(0));  // that light groups have of the light
    if (light.from_surfaces() && !shares.empty()) surface_light_->shares(coarse_.node(x, y, z), shares);
    if (light.group_number >= 0 && !shares.empty()) shares[static_cast<size_t>(light.group_number)] = dvec3(1);
    const OrderTint tint = node_tints_.empty() ? tint_ : OrderTint(dvec3(node_tints_[at]));
    const auto add = [&](const dvec3& own, const auto& moments, float factor) {
      const vec3 rgb(colour * own);
      for (size_t moment = 0; moment < 4; ++moment)
        for (int c = 0; c < 3; ++c)
          node.scattered[3 * moment + static_cast<size_t>(c)] += factor * rgb[c] * moments[moment][i];
      for (size_t g = 0; g < shares.size(); ++g)
        if (shares[g] != dvec3(0)) ambient_light_->of_groups(at)[g] += factor * moments[0][i] * rgb * vec3(shares[g]);
    };
    add(tint.at(kFineOrder), fine_emission, 1);
    for (size_t g = GuideLight::kFineGuides; g < light.orders.size(); ++g)
      add(tint.of_guide(g), light.orders[g], coarse.scaled_extinction()[i]);
  });
}

void LightFields::solve(GuideLight& light, const LightSolve& solving, ScatteringSolver& coarse) {
  constexpr auto& first = GuideLight::kFirstOrder;
  ScatteringSolver& fine = solving.solver;
  Radiance arriving = light.arriving(solving);
  if (!light.sharp() && !light.sky()) light.unscattered = arriving;
  // Of a lamp's light, which may be a narrow beam, the first scattering is known better than by its moments.
  const bool beam = light.sharp() && !light.sharp()->sun() && fine.second_moments();
  Radiance of_beam = beam ? fine.transport_beam(arriving) : Radiance();
  const bool keeps_second = beam && !fine.has_peak();
  Source scattered = fine.scatter(std::move(arriving));
  for (size_t g = 0; g < first.size(); ++g)
    light.orders.push_back(g == 0 || (keeps_second && g < GuideLight::kFineGuides)
                               ? fine.nothing<Source>(scattered.known())
                               : (g < GuideLight::kFineGuides ? fine : coarse).nothing<Source>());
  Source fine_orders;
  if (ambient_light_) fine_orders = scattered;
  size_t g = 0;
  for (int order = 2; order < first[GuideLight::kFineGuides]; ++order) {
    scattered = fine.scatter(beam && order == 2 ? std::move(of_beam) : fine.transport(std::move(scattered)));
    if (order >= first[g + 1]) ++g;
    fine.add(scattered, light.orders[g]);
    if (!keeps_second) scattered.drop_second();
    if (ambient_light_) fine.add(scattered, fine_orders);
  }
  const Emission emission = coarse.emission_from(fine, std::exchange(scattered, {}));
  fine.release();
  NodeValues before;
  double sum = 0, tail_before = 0;
  TailSum tail(coarse);
  for (int order = first[GuideLight::kFineGuides];; ++order) {
    const bool begins = order == first[GuideLight::kFineGuides];
    if (begins) {
      scattered = coarse.scatter(coarse.transport(emission));
    } else {
      before = scattered[0];
      scattered = coarse.scatter(coarse.transport(std::move(scattered)));
    }
    if (g + 1 < first.size() && order >= first[g + 1]) ++g;
    if (order < first.back()) {
      coarse.add(scattered, light.orders[g]);
      const double own = coarse.total(scattered);
      sum += own;
      if (begins || own > kNegligible * sum) continue;
      // Each later order is as much less.
      Source& rest = light.orders.back();
      for (size_t i = 0; i < rest[0].size(); ++i) {
        const float ratio = std::clamp(scattered[0][i] / (before[i] + 1e-20f), 0.0f, static_cast<float>(kLargestRatio));
        for (size_t a = 0; a < 4; ++a) rest[a][i] += scattered[a][i] * ratio / (1 - ratio);
      }
      break;
    }
    tail.add(scattered);
    if (tail.count() == 0) continue;
    const double all = tail.total();
    if (tail.count() < kMostOfTail && std::abs(all - tail_before) > kNegligibleTail * (sum + all)) {
      tail_before = all;
      continue;
    }
    light.orders.back() = tail.sum();
    break;
  }
  coarse.release();
  if (ambient_light_) add_to_ambient(light, fine_orders, fine, coarse);
}

size_t LightFields::bytes() const {
  size_t floats = 0, others = sky_.bytes() + (ambient_light_ ? ambient_light_->bytes() : 0);
  for (const auto& light : lights_) {
    others += light->bytes();
    for (const NodeValues& v : light->unscattered) floats += v.size();
    for (const Source& order : light->orders)
      for (const NodeValues& v : order) floats += v.size();
  }
  return floats * sizeof(float) + others;
}

}  // namespace brume
