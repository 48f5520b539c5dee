#include "render/transport/group_lights.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "image/light_layers.h"
#include "render/transport/estimator.h"
#include "render/transport/near_light.h"

namespace brume {
namespace {

// Vertices of a path at which groups are sampled: in dense clouds, where paths are long, more would cost more than they
// are worth.
constexpr uint32_t kVertices = 4;
// Of more lights the probability of each is not asked for at every vertex.
constexpr size_t kMostLights = 32;

/// Whether found() is told of it wherever a path meets it.
bool is_found(const Light& light) {
  return dynamic_cast<const InfiniteLight*>(&light) || dynamic_cast<const FiniteLight*>(&light);
}

}  // namespace

bool GroupLights::wanted(const PathContext& context) {
  const Lights& lights = *context.lights;
  const std::vector<const Light*>& sampled = lights.choice().lights();
  const std::vector<std::string>& layers = context.plan.layers.names;
  if (std::find(layers.begin(), layers.end(), kLightAimed) == layers.end()) return false;
  if (!context.plan.light_sampling || sampled.size() > kMostLights) return false;
  return std::any_of(sampled.begin(), sampled.end(), [&](const Light* l) { return l->group != sampled[0]->group; });
}

GroupLights::GroupLights(const PathContext& context, PathStates& paths, WorldPaths& world, MediaFlights& flights,
                         SurfaceEvents* surfaces, const BallSamples* balls)
    : c_(context),
      p_(paths),
      w_(world),
      flights_(flights),
      surfaces_(surfaces),
      balls_(balls),
      lights_(c_.lights->choice().lights()),
      first_(w_.groups + 1),
      apart_(kPool * w_.groups),
      sampled_(kPool),
      knows_shares_(kPool),
      shares_(kPool * lights_.size()),
      arrival_(kPool),
      own_(kPool),
      of_path_(kPool),
      aimed_(w_.groups) {
  std::stable_sort(lights_.begin(), lights_.end(), [](const Light* a, const Light* b) { return a->group < b->group; });
  for (const Light* light : lights_) {
    ++first_[light->group + 1];
    is_found_.push_back(is_found(*light));
  }
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
}

std::span<const Light* const> GroupLights::lights_of(size_t group) const {
  return std::span(lights_).subspan(first_[group], first_[group + 1] - first_[group]);
}

void GroupLights::start(size_t slot) {
  std::fill_n(apart_.begin() + static_cast<std::ptrdiff_t>(slot * w_.groups), w_.groups, GroupLight{});
}

void GroupLights::begin_vertices(std::span<const PathRequest> requests, const SlotList& hits, const SlotList& met) {
  const auto prepare = [&](const SlotList& from, SlotList& to) {
    to.clear();
    for (const size_t i : from) {
      sampled_[i] = p_.events[i] < kVertices;
      knows_shares_[i] = false;
      if (!sampled_[i]) continue;
      to.push(i);
      w_.sampled_group[i] = w_.groups;
      PathGenerator rng(p_, i);
      const PathGenerator::State of_path = rng.state();
      const SampleKey& key = requests[p_.request[i]].key;
      rng.seed(hash_combine(hash_combine(key.pixel_hash(), key.sample), 0x67726f75u + p_.events[i]));
      own_[i] = rng.state();
      rng.set(of_path);
    }
  };
  prepare(hits, hits_);
  prepare(met, met_);
  for (const size_t i : hits_) arrival_[i] = {p_.throughput[i], p_.d[i]};
  for (auto& aimed : aimed_) aimed.clear();
}

void GroupLights::take_from_picture(size_t slot, const vec3& L) {
  if (!sampled_[slot]) return;
  if (!knows_shares_[slot]) find_shares(slot, place_in_medium(slot), samples_fields(slot));
  const size_t group = w_.sampled_group[slot];
  const double share = share_of_group(slot, group);
  // The balance heuristic has the light sample's pdf with and without the choice of the group; lights that keep the
  // picture's weights have none.
  const auto light = std::find(lights_.begin(), lights_.end(), w_.sampled_light[slot]);
  const bool found = light == lights_.end() || is_found_[static_cast<size_t>(light - lights_.begin())];
  const double weight = found ? share / (share + static_cast<double>(p_.mis[slot]) * (1 - share)) : share;
  GroupLight& own = apart_[slot * w_.groups + group];
  (is_direct(p_.events[slot]) ? own.direct : own.indirect) -= static_cast<float>(1 - weight) * L;
}

void GroupLights::trace() {
  for (const SlotList* list : {&hits_, &met_})
    for (const size_t i : *list) {
      PathGenerator rng(p_, i);
      of_path_[i] = rng.state();
      rng.set(own_[i]);
    }
  for (size_t group = 0; group < w_.groups; ++group) {
    shadows_.clear();
    for (const size_t i : hits_)
      if (samples(i, group) && aim_from_medium(i, group)) shadows_.push(i);
    for (const auto& [i, light] : aimed_[group]) {
      surfaces_->take(i, light);
      shadows_.push(i);
    }
    if (surfaces_) surfaces_->shadow(shadows_);
    flights_.shadow(shadows_);
    for (const size_t i : shadows_) {
      vec3 L = p_.contribution[i] * p_.transmittance[i];
      if (c_.plan.chromatic) L *= p_.shadow_colour[i];
      GroupLight& own = apart_[i * w_.groups + group];
      (is_direct(p_.events[i]) ? own.direct : own.indirect) += L;
    }
  }
  for (const SlotList* list : {&hits_, &met_})
    for (const size_t i : *list) PathGenerator(p_, i).set(of_path_[i]);
}

void GroupLights::found(size_t slot, const Light& light, const dvec3& p, bool fields,
                        const std::function<dvec3(double probability)>& weighted) {
  if (p_.events[slot] > kVertices) return;
  const double share = c_.lights->choice(fields).probability(light, p);
  if (!(share > 0)) return;
  const dvec3 more = weighted(share / probability_of_group(light.group, p, fields)) - weighted(share);
  GroupLight& own = apart_[slot * w_.groups + light.group];
  (is_direct(p_.events[slot]) ? own.direct : own.indirect) += p_.throughput[slot] * vec3(more);
}

/// That the picture chooses one of its lights.
double GroupLights::probability_of_group(size_t group, const dvec3& p, bool fields) const {
  const std::span<const Light* const> lights = lights_of(group);
  std::array<double, kMostLights> shares;
  c_.lights->choice(fields).probabilities(lights, p, shares.data());
  return std::accumulate(shares.begin(), shares.begin() + static_cast<std::ptrdiff_t>(lights.size()), 0.0);
}

void GroupLights::find_shares(size_t slot, const dvec3& p, bool fields) {
  c_.lights->choice(fields).probabilities(lights_, p, shares_.data() + slot * lights_.size());
  knows_shares_[slot] = true;
}

double GroupLights::share_of_group(size_t slot, size_t group) const {
  const double* const shares = shares_.data() + slot * lights_.size();
  return std::accumulate(shares + first_[group], shares + first_[group + 1], 0.0);
}

/// One of the group's lights, as likely among them as the picture chooses it. Those that paths find elsewhere than in
/// found() keep the picture's weights: the radiance is times the probability of the group, so that the sample can be
/// taken for the picture's.
LightSample GroupLights::sample_of(size_t group, size_t slot, const dvec3& p) {
  PathGenerator rng(p_, slot);
  const double choice = rng.uniform();
  const dvec2 u = rng.pair();
  const double* const shares = shares_.data() + slot * lights_.size();
  const double sum = share_of_group(slot, group);
  double left = choice * sum;
  size_t k = first_[group];
  while (k + 1 < first_[group + 1] && left >= shares[k]) left -= shares[k++];
  if (!(shares[k] > 0)) return {};
  LightSample sample = lights_[k]->sample(p, u);
  sample.light = lights_[k];
  if (is_found_[k]) {
    sample.pdf *= shares[k] / sum;
  } else {
    sample.pdf *= shares[k];
    sample.radiance *= sum;
  }
  return sample;
}

const Medium& GroupLights::medium_at(size_t i) const {
  return c_.media[c_.plan.one_grid ? size_t{0} : static_cast<size_t>(w_.medium[i])];
}

/// Once the path has scattered there.
dvec3 GroupLights::place_in_medium(size_t i) const {
  return c_.plan.one_grid ? c_.media[0].to_world(dvec3(p_.flight.o[i])) : w_.ray[i].o;
}

bool GroupLights::samples_fields(size_t i) const {
  return c_.plan.samples_fields(c_.plan.one_grid ? size_t{0} : static_cast<size_t>(w_.medium[i]));
}

bool GroupLights::aim_from_medium(size_t i, size_t group) {
  const bool grid = c_.plan.one_grid, fields = samples_fields(i);
  const Medium& medium = medium_at(i);
  const dvec3 p = place_in_medium(i);
  if (!knows_shares_[i]) find_shares(i, p, fields);
  const LightSample light = sample_of(group, i, p);
  if (!(light.pdf > 0) || c_.lights->blocked({p, light.wi}, light.distance, light.light)) return false;
  const double phase = medium.phase().value(glm::dot(glm::normalize(dvec3(arrival_[i].d)), light.wi));
  const bool aims = c_.plan.aims_at_fire && fields;
  const double pdf = aims ? c_.lights->field_cones(p).mixed(phase, light.wi) : phase;
  const double mis = light.delta ? 1.0 : balance(light.pdf, pdf);
  const dvec3 albedo = medium.instances() ? medium.albedo(static_cast<size_t>(w_.instance[i]), p) : medium.albedo(p);
  const double flown = balls_ ? balls_->share_of_flights(i, light.light, p) : 1.0;
  const double share = far_share(c_.plan.near_lights, light.light, p) * flown * phase * mis / light.pdf;
  const dvec3 L = dvec3(arrival_[i].throughput) * albedo * light.radiance * share;
  if (!(max_component(L) > 0)) return false;
  p_.contribution.set(i, vec3(L));
  p_.transmittance[i] = 1;
  p_.mis[i] = static_cast<float>(mis);
  w_.shadow_end[i] = light.distance;
  if (grid) {
    const double unit = flights_.scene(0).unit;
    p_.shadow.d.set(i, vec3(medium.placement().local_from_world() * light.wi * unit));
    p_.shadow.end[i] = static_cast<float>(std::min(light.distance / unit, 1e30));
  } else {
    w_.shadow[i] = {p, light.wi};
  }
  return true;
}

}  // namespace brume
