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
      generators_(kPool) {
  std::stable_sort(lights_.begin(), lights_.end(), [](const Light* a, const Light* b) { return a->group < b->group; });
  for (const Light* light : lights_) ++first_[light->group + 1];
  std::partial_sum(first_.begin(), first_.end(), first_.begin());
}

std::span<const Light* const> GroupLights::lights_of(size_t group) const {
  return std::span(lights_).subspan(first_[group], first_[group + 1] - first_[group]);
}

void GroupLights::start(size_t slot) {
  std::fill_n(apart_.begin() + static_cast<std::ptrdiff_t>(slot * w_.groups), w_.groups, GroupLight{});
}

void GroupLights::sample(std::span<const PathRequest> requests, const SlotList& hits, const SlotList& met) {
  const auto prepare = [&](const SlotList& from, SlotList& to) {
    to.clear();
    for (const size_t i : from) {
      sampled_[i] = p_.events[i] < kVertices;
      knows_shares_[i] = false;
      if (!sampled_[i]) continue;
      to.push(i);
      PathGenerator rng(p_, i);
      generators_[i] = rng.state();
      const SampleKey& key = requests[p_.request[i]].key;
      rng.seed(hash_combine(hash_combine(key.pixel_hash(), key.sample), 0x67726f75u + p_.events[i]));
    }
  };
  prepare(hits, hits_);
  prepare(met, met_);
  for (size_t group = 0; group < w_.groups; ++group) {
    if (lights_of(group).empty()) continue;
    shadows_.clear();
    for (const size_t i : hits_)
      if (aim_from_medium(i, group)) shadows_.push(i);
    for (const size_t i : met_)
      if (surfaces_->aim(i, [&](const dvec3& p) { return sample_of(group, i, p, true); })) shadows_.push(i);
    if (surfaces_) surfaces_->shadow(shadows_);
    flights_.shadow(shadows_);
    for (const size_t i : shadows_) {
      vec3 L = p_.contribution[i] * p_.transmittance[i];
      if (c_.plan.chromatic) L *= p_.shadow_colour[i];
      GroupLight& own = apart_[i * w_.groups + group];
      (is_direct(p_.events[i] + 1) ? own.direct : own.indirect) += L;
    }
  }
  for (const SlotList* list : {&hits_, &met_})
    for (const size_t i : *list) PathGenerator(p_, i).set(generators_[i]);
}

void GroupLights::replace(size_t slot, const vec3& L) {
  if (!sampled_[slot]) return;
  GroupLight& own = apart_[slot * w_.groups + w_.sampled_group[slot]];
  (is_direct(p_.events[slot]) ? own.direct : own.indirect) -= L;
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

/// One of the group's lights, as likely among them as the picture chooses it. Those that paths find elsewhere than in
/// found() keep the picture's weights: the radiance is times the probability of the group, so that the sample can be
/// taken for the picture's.
LightSample GroupLights::sample_of(size_t group, size_t slot, const dvec3& p, bool fields) {
  PathGenerator rng(p_, slot);
  const double choice = rng.uniform();
  const dvec2 u = rng.pair();
  double* const of_slot = shares_.data() + slot * lights_.size();
  if (!knows_shares_[slot]) c_.lights->choice(fields).probabilities(lights_, p, of_slot);
  knows_shares_[slot] = true;
  const std::span<const Light* const> lights = lights_of(group);
  const double* const shares = of_slot + first_[group];
  const double sum = std::accumulate(shares, shares + lights.size(), 0.0);
  double left = choice * sum;
  size_t k = 0;
  while (k + 1 < lights.size() && left >= shares[k]) left -= shares[k++];
  if (!(shares[k] > 0)) return {};
  LightSample sample = lights[k]->sample(p, u);
  sample.light = lights[k];
  if (is_found(*lights[k])) {
    sample.pdf *= shares[k] / sum;
  } else {
    sample.pdf *= shares[k];
    sample.radiance *= sum;
  }
  return sample;
}

bool GroupLights::aim_from_medium(size_t i, size_t group) {
  const bool grid = c_.plan.one_grid;
  const auto number = grid ? size_t{0} : static_cast<size_t>(w_.medium[i]);
  const Medium& medium = c_.media[number];
  const dvec3 p = grid ? medium.to_world(dvec3(p_.flight.o[i])) : w_.ray[i].at(w_.end[i]);
  const LightSample light = sample_of(group, i, p, c_.plan.samples_fields(number));
  if (!(light.pdf > 0) || c_.lights->blocked({p, light.wi}, light.distance, light.light)) return false;
  const double phase = medium.phase().value(glm::dot(glm::normalize(dvec3(p_.d[i])), light.wi));
  const bool aims = c_.plan.aims_at_fire && c_.plan.samples_fields(number);
  const double pdf = aims ? c_.lights->field_cones(p).mixed(phase, light.wi) : phase;
  const double mis = light.delta ? 1.0 : balance(light.pdf, pdf);
  const dvec3 albedo = medium.instances() ? medium.albedo(static_cast<size_t>(w_.instance[i]), p) : medium.albedo(p);
  const double flown = balls_ ? balls_->share_of_flights(i, light.light, p) : 1.0;
  const double share = far_share(c_.plan.near_lights, light.light, p) * flown * phase * mis / light.pdf;
  const dvec3 L = dvec3(p_.throughput[i]) * albedo * light.radiance * share;
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
