#include "render/transport/flight_emission.h"

#include <algorithm>

#include "render/transport/estimator.h"

namespace brume {

FlightEmission::FlightEmission(const PathContext& context, PathStates& paths, WorldPaths& world, Buffers& buffers)
    : c_(context), p_(paths), w_(world), b_(buffers) {
  for (size_t f = 0; f < c_.emissions.size(); ++f) {
    const EmissionField& field = c_.emissions[f];
    if (LaneEmission::fits(field))
      in_lanes_.emplace_back(field, c_.emission_grids[f], c_.lights->field(f)).number = f;
    else
      one_by_one_.push_back(f);
  }
}

bool FlightEmission::may_meet(const Ray& ray) const {
  return std::any_of(c_.emissions.begin(), c_.emissions.end(), [&](const EmissionField& field) {
    const Medium& shape = field.shape();
    const auto [lo, hi] = shape.support();
    const HomogeneousShape box{HomogeneousShape::Shape::kBox, lo, hi};
    const auto [enters, leaves] = shape.homogeneous().value_or(box).intersect(shape.to_local(ray));
    return field.moves() || std::max(enters, 0.0) < leaves;
  });
}

void FlightEmission::see(const SlotList& slots, const MediaFlights& flights) {
  b_.camera.clear();
  for (const size_t i : slots)
    if (p_.events[i] == 0 && !b_.again[i]) b_.camera.push(i);
  if (b_.camera.count > 0)
    for (const LaneEmission& field : in_lanes_) see(field, flights);
}

void FlightEmission::see(const LaneEmission& field, const MediaFlights& flights) {
  b_.rays.clear();
  enter_box(field.box, w_.ray, w_.end, b_.camera, b_.segments.rays, b_.point, b_.rays);
  for (const size_t i : b_.rays) b_.segments.stride[i] = static_cast<float>(emission_stride(0));
  while (b_.dimmed.size() < flights.count()) b_.dimmed.push_back(std::make_unique<DimmedSegments>());
  b_.dimmed.resize(flights.count());
  for (size_t m = 0; m < flights.count(); ++m) dim(field, m, flights.scene(m));
  lanes_seen_emission(field.cells, b_.dimmed, p_, b_.rays, b_.segments);
  for (const size_t i : b_.rays) add(i, field.number, b_.segments.emitted[i]);
}

/// Where camera rays that see a field cross a medium.
void FlightEmission::dim(const LaneEmission& field, size_t number, const LaneScene& scene) {
  DimmedSegments& dimmed = *b_.dimmed[number];
  dimmed.medium = &scene;
  const Medium& medium = c_.media[number];
  for (const size_t i : b_.rays) {
    dimmed.rays.end[i] = medium.homogeneous() ? 0 : -1;  // nothing is in the way
    dimmed.rays.o.set(i, vec3(0));
    dimmed.rays.d.set(i, vec3(1));
    dimmed.scale[i] = dimmed.offset[i] = 0;
  }
  if (medium.homogeneous()) {
    const double sigma = medium.extinction_per_density();
    for (const size_t i : b_.rays) {
      const auto [enters, leaves] = medium.homogeneous()->intersect(medium.to_local(w_.ray[i]));
      const double begin = std::max(enters, 0.0), end = std::min(leaves, w_.end[i]);
      if (!(begin < end)) continue;
      dimmed.rays.end[i] = static_cast<float>(sigma * (end - begin));
      dimmed.scale[i] = static_cast<float>(sigma * field.box.unit);
      dimmed.offset[i] = static_cast<float>(sigma * (b_.point[i] - begin));
    }
    return;
  }
  const auto [lo, hi] = medium.support();
  const LocalBox box{&medium.placement().to_local(), false, lo, hi, medium.walked_shift(), scene.unit};
  b_.in_medium.clear();
  enter_box(box, w_.ray, w_.end, b_.rays, dimmed.rays, b_.medium_point, b_.in_medium);
  for (const size_t i : b_.in_medium) {
    dimmed.scale[i] = static_cast<float>(field.box.unit / scene.unit);
    dimmed.offset[i] = static_cast<float>((b_.point[i] - b_.medium_point[i]) / scene.unit);
  }
}

void FlightEmission::add(std::initializer_list<const SlotList*> slots) {
  for (const LaneEmission& field : in_lanes_) add_in_lanes(field, slots);
  for (const size_t field : one_by_one_) add_one_by_one(field, slots);
}

/// Adds light that is emitted along the flight of a path.
void FlightEmission::add(size_t i, size_t field, const vec3& emitted) {
  const vec3 L = p_.throughput[i] * emitted;
  if (p_.events[i] > 0) return deposit(p_, w_, i, L, p_.events[i], c_.lights->group_of_emission(field));
  b_.seen[i] += L;
  // Groups keep sums over the ray's paths.
  w_.add_to_group(i, c_.lights->group_of_emission(field), b_.paths[i] * L, /*direct=*/true);
}

/// How many times denser light samples of a path's last vertex are than directions, per density of the light and
/// squared distance. Straight through glass they alone count.
double FlightEmission::rival(size_t i, const FieldLight& light) const {
  const WorldPaths::Past& past = w_.past_of(i, c_.plan);
  if (p_.events[i] == 0 || !c_.plan.light_sampling || !past.samples_fields) return 0;
  if (past.straight) return 1e30;
  if (past.specular) return 0;
  const dvec3 vertex = w_.ray[i].o - past.passed * w_.ray[i].d;
  return c_.lights->choice().probability(light, vertex) / static_cast<double>(p_.pdf[i]);
}

/// Of what a field emits at a point of a path's flight, against light samples.
double FlightEmission::weight(size_t i, size_t field, double t) const {
  const FieldLight* const light = c_.lights->field(field);
  if (!light || p_.events[i] == 0) return 1;
  const double r = w_.past_of(i, c_.plan).passed + t;
  return 1 / (1 + rival(i, *light) * light->density(w_.ray[i].at(t)) * r * r);
}

void FlightEmission::add_in_lanes(const LaneEmission& field, std::initializer_list<const SlotList*> slots) {
  EmissionSegments& segments = b_.segments;
  b_.rays.clear();
  for (const SlotList* list : slots) enter_box(field.box, w_.ray, w_.end, *list, segments.rays, b_.point, b_.rays);
  if (c_.plan.seen_emission) b_.rays.keep_if([&](size_t i) { return p_.events[i] > 0; });
  for (const size_t i : b_.rays) {
    segments.stride[i] = static_cast<float>(emission_stride(p_.events[i]));
    if (!field.light) continue;
    const double unit = field.box.unit;
    segments.before[i] = static_cast<float>((w_.past_of(i, c_.plan).passed + b_.point[i]) / unit);
    segments.rival[i] = static_cast<float>(rival(i, *field.light) * unit * unit);
  }
  lanes_emission(field.cells, p_, b_.rays, segments);
  for (const size_t i : b_.rays) add(i, field.number, segments.emitted[i]);
}

void FlightEmission::add_one_by_one(size_t number, std::initializer_list<const SlotList*> slots) {
  const EmissionField& field = c_.emissions[number];
  for (const SlotList* list : slots)
    for (const size_t i : *list) {
      if (!field.shape().homogeneous()) {
        Rng rng = PathGenerator(p_, i).stream();
        add(i, number, vec3(field.integrate(w_.ray[i], 0, w_.end[i], emission_stride(p_.events[i]), w_.time[i], rng)));
        continue;
      }
      const auto [begin, end] = field.inside(w_.ray[i], 0, w_.end[i], w_.time[i]);
      if (!(begin < end)) continue;
      double part = end - begin;
      if (p_.events[i] > 0 && c_.lights->field(number))
        part *= weight(i, number, begin + PathGenerator(p_, i).uniform() * (end - begin));
      add(i, number, vec3(field.coefficient() * part));
    }
}

void FlightEmission::add_by_channel(const SlotList& slots, MediaFlights::Flown& flown) {
  b_.rays.clear();
  for (const size_t i : slots) {
    if (c_.plan.seen_emission && p_.events[i] == 0) continue;
    Rng rng = PathGenerator(p_, i).stream();
    EmittingPoint point;
    for (size_t f = 0; f < c_.emissions.size(); ++f) {
      point.source = f;
      c_.emissions[f].offer(w_.ray[i], 0, w_.end[i], emission_stride(p_.events[i]), w_.time[i], rng, point);
    }
    if (!point.any()) continue;
    b_.point[i] = point.t();
    b_.field[i] = point.chosen_source();
    b_.emitted[i] = vec3(point.value() * weight(i, point.chosen_source(), point.t()));
    b_.rays.push(i);
  }
  flown.passing(b_.rays, b_.point, b_.passing);
  for (const size_t i : b_.rays) {
    add(i, b_.field[i], vec3(channel_weights(p_, i, dvec3(b_.passing[i]))) * b_.emitted[i]);
  }
}

}  // namespace brume
