#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/guides/ray_march.cpp"
#include "render/guides/ray_march.h"

#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>

#include "render/guides/forward_peak.h"
#include "volume/lane_grid.h"

HWY_BEFORE_NAMESPACE();
namespace brume::HWY_NAMESPACE {

#include "render/transport/cell_walk.h"
#include "render/transport/detail_noise.h"
// In this order.
#include "render/guides/march_lanes.h"
#include "render/guides/march_light.h"
#include "render/guides/march_media.h"

// Steps grow by this share for each unit of optical depth that a ray has behind it beyond the first ones, up to a
// longest one: little is seen of what is deep.
constexpr float kStepGrowth = 0.25f, kGrowingDepth = 2, kLongestStep = 4;
// Optical thickness of a step of the ray's stride below which steps are that long; in thicker media they are 1 long.
constexpr float kThinStep = 0.03f;
// Suns and lamps are looked up once for so many steps, or for a segment of this optical thickness.
constexpr float kLightSteps = 2, kLightThickness = 0.12f;
// Fields at nodes are looked up once for a segment of this optical thickness, or as long as nodes are apart.
constexpr float kNodeThickness = 0.5f;
// Transmittance at which a ray ends; where octaves are wanted, that of an eighth of the extinction.
constexpr float kOpaque = 6e-3f;

/// 1 - e^-x for x >= 0, relative error below 3e-7 for small x, too.
HWY_INLINE V one_minus_attenuation(V x) {
  const SplitExponential e(-x);
  return 1.0f - e.power - e.power * e.rest;
}

/// What a step of each ray meets.
struct Step {
  M active;               // lanes with a ray
  V stride;               // the length of steps here where none grows
  V begin, middle, next;  // of the step; the next one begins where it ends
  V length;
  MediaPoint media;  // in its middle
  V thickness;       // optical
  M dense;           // lanes that meet a medium
  M beside_lamp;     // lanes whose step is short because a small lamp is near
};

/// What a step takes of the transmittances before it.
struct StepWeights {
  V w[kOctaves];  // of the extinction, a half, a quarter, an eighth of it
  V scale;        // share of the extinction without the forward peak
  V scaled;       // of that share of the extinction
};

/// As many rays as there are lanes, from where they enter the media to where they end.
/// Members that call scalar code are inlined: in functions of their own GCC 12 left the upper halves of vector
/// registers full before such calls, which made that code three times as slow (MarchScene::add_scattered: a tenth of
/// the guides).
class RayMarch {
 public:
  RayMarch(const MarchScene& scene, const MarchedFields& fields, MarchBatch& batch)
      : scene_(scene),
        fields_(fields),
        batch_(batch),
        to_lights_(static_cast<float>(fields.table.lattice.spacing / scene.nodes.spacing)),
        lights_origin_((fields.table.lattice.origin - scene.nodes.origin) / scene.nodes.spacing),
        media_(scene) {}

  void run() {
    for (size_t lane = 0; lane < hn::Lanes(D()); ++lane) refill(lane);
    while (busy_) step();
  }

 private:
  // A ray enters a lane, goes on to the next of its parts, leaves.
  void refill(size_t lane);
  void begin_part(size_t lane);
  void end_parts(M ended, M opaque);
  void finish(size_t lane);
  // A step.
  HWY_INLINE void step();
  HWY_INLINE Step next_step() const;
  HWY_INLINE V step_length(M active, V t, V stride) const;
  V longest_step_near_lamps(V t) const;
  HWY_INLINE StepWeights weights(const Step& step) const;
  HWY_INLINE V unpeaked_share(V albedo, V g) const;
  HWY_INLINE V peaks_before_middle(const Step& step, V scale) const {
    return peaks_.load() + 0.5f * (step.thickness * (1.0f - scale));
  }
  HWY_INLINE void add_to_segment(const Step& step, const StepWeights& weights);
  HWY_INLINE void keep_for_deep_picture(const Step& step, V w) const;
  HWY_INLINE void add_emission(const Step& step, const StepWeights& weights) const;
  HWY_INLINE void add_to_layers(const Step& step, V w);
  HWY_INLINE V of_no_holdout(const Step& step, V v) const { return scene_.holdouts ? v * step.media.seen : v; }
  // The light of a segment.
  void add_light(M mask);
  HWY_INLINE void add_sharp_light(size_t light, M mask);
  HWY_INLINE void update_terms(size_t light, V distance, V depth, M mask);
  void add_fields(M mask);
  HWY_INLINE void add_weighted_fields(GuideSums& sums, const float* at, float albedo, size_t lane) const;
  HWY_INLINE void add_coloured_light(MarchedRay& ray, const float* at, float albedo, size_t lane);
  HWY_INLINE V3 place_at_nodes(M mask, V t) const;

  const MarchScene& scene_;
  const MarchedFields& fields_;
  MarchBatch& batch_;
  // From places on the lattice of the fields to those on the one of what is known of lights.
  const float to_lights_;
  const vec3 lights_origin_;
  size_t next_ = 0;    // of the batch
  uint32_t busy_ = 0;  // lanes with a ray, a bit each
  uint32_t near_ = 0;  // of those the ones whose ray passes a lamp
  RayLanes rays_;
  uint32_t part_[hn::MaxLanes(D())] = {};  // of MarchBatch::parts
  Lane begin_, end_;                       // of that part
  Lane stride_, offset_, t_;
  Lane light_segment_end_;
  MediaLanes media_;
  Line nodes_;
  LightLanes light_[kMostSharpLights];
  Lane transmittance_[kOctaves], scaled_transmittance_;
  Lane depth_, peaks_;  // optical depth so far; and of forward peaks alone
  Lane extinction_;     // at the last step
  Lane opacity_, first_, distance_, distance2_, density_;
  Lanes3 gradient_;
  Segment light_segment_, node_segment_;  // whose light of suns and lamps, and of fields at nodes, is not added yet
};

/// Gives a lane the next ray, past those that meet nothing.
void RayMarch::refill(size_t lane) {
  busy_ &= ~(1u << lane);
  while (next_ < batch_.rays.size() && batch_.rays[next_].misses()) ++next_;
  if (next_ == batch_.rays.size()) return;
  MarchedRay& ray = batch_.rays[next_++];
  rays_.ray[lane] = &ray;
  busy_ |= 1u << lane;
  media_.begin(lane, ray);
  nodes_.set(lane, ray.nodes);
  for (size_t k = 0; k < scene_.lights.size(); ++k) light_[k].begin(lane, ray.light[k], ray.terms[k]);
  near_ = ray.lamps > 0 ? near_ | 1u << lane : near_ & ~(1u << lane);
  stride_[lane] = ray.stride;
  offset_[lane] = ray.offset;
  for (Lane& one : transmittance_) one[lane] = 1;
  scaled_transmittance_[lane] = 1;
  for (Lane* sum : {&depth_, &peaks_, &extinction_, &opacity_, &first_, &distance_, &distance2_, &density_})
    (*sum)[lane] = 0;
  gradient_.set(lane, vec3(0));
  light_segment_.clear_lane(lane);
  node_segment_.clear_lane(lane);
  part_[lane] = ray.first_part;
  begin_part(lane);
}

/// Steps of neighbouring pixels begin at the same distances from the eye, wherever their cells begin.
void RayMarch::begin_part(size_t lane) {
  const vec2& part = batch_.parts[part_[lane]];
  begin_[lane] = part.x;
  end_[lane] = part.y;
  t_[lane] = (std::floor(part.x / stride_[lane] - offset_[lane]) + offset_[lane]) * stride_[lane];
  light_segment_end_[lane] = t_[lane];
}

void RayMarch::end_parts(M ended, M opaque) {
  uint32_t finished = bits_of(opaque);
  rays_.for_each(hn::AndNot(opaque, ended), [&](size_t lane, MarchedRay& ray) {
    if (++part_[lane] == ray.last_part)
      finished |= 1u << lane;
    else
      begin_part(lane);
  });
  if (!finished) return;
  const M done = mask_of(finished);
  add_light(done);
  add_fields(done);
  rays_.for_each(done, [&](size_t lane, MarchedRay&) { finish(lane); });
}

void RayMarch::finish(size_t lane) {
  MarchedRay& ray = *rays_.ray[lane];
  ray.transmittance = transmittance_[0][lane];
  ray.scaled_transmittance = scaled_transmittance_[lane];
  ray.opacity = opacity_[lane];
  ray.first = first_[lane];
  ray.distance = distance_[lane];
  ray.distance2 = distance2_[lane];
  ray.density = density_[lane];
  ray.gradient = gradient_[lane];
  if (ray.opacity > 0)
    for (size_t k = 0; k < scene_.lights.size(); ++k) light_[k].add_to(ray.sums->groups[scene_.lights[k].group], lane);
  refill(lane);
}

HWY_INLINE void RayMarch::step() {
  const D d;
  const Step step = next_step();
  extinction_.store(step.active, hn::IfThenElseZero(step.active, step.media.extinction));

  const M ends = hn::Or(step.middle >= light_segment_end_.load(), light_segment_.thickness.load() > kLightThickness);
  const M full = hn::And(step.dense, hn::Or(ends, step.beside_lamp));
  if (!hn::AllFalse(d, full)) {
    add_light(full);
    light_segment_.clear(full);
    light_segment_.begin.store(full, step.begin);
    const V offset = offset_.load(), length = kLightSteps * step.stride;
    light_segment_end_.store(full, (hn::Floor(step.middle / length - offset) + 1.0f + offset) * length);
  }

  const StepWeights w = weights(step);
  const V w_seen = of_no_holdout(step, w.w[0]);
  if (batch_.deep) keep_for_deep_picture(step, w_seen);
  if (scene_.emits) add_emission(step, w);
  add_to_segment(step, w);
  add_to_layers(step, w_seen);
  for (size_t k = 0; k < kOctaves; ++k) transmittance_[k].store(transmittance_[k].load() - w.w[k]);
  scaled_transmittance_.store(scaled_transmittance_.load() - w.scaled);
  depth_.add(step.thickness);
  peaks_.add(step.thickness * (1.0f - w.scale));
  t_.store(step.active, step.next);

  // Where steps are lost in rounding the part has ended, too.
  const M ended = hn::And(step.active, hn::Or(step.next >= end_.load(), step.next <= step.begin));
  const M opaque = hn::And(step.active, transmittance_[fields_.octaves ? kOctaves - 1 : 0].load() <= kOpaque);
  if (!hn::AllFalse(d, hn::Or(ended, opaque))) end_parts(ended, opaque);
}

HWY_INLINE Step RayMarch::next_step() const {
  const V zero = hn::Zero(D());
  Step step;
  step.active = mask_of(busy_);
  const V t = t_.load(), own_stride = stride_.load(), end = end_.load();
  step.stride = hn::IfThenElse(extinction_.load() * own_stride < kThinStep, own_stride, set(1.0f));
  const V whole = step_length(step.active, t, step.stride);
  // A part's first step begins where the part does, and is as long as what is left of the step; where nothing is, of
  // the next one.
  const V late = hn::Max(begin_.load() - t, zero), rest = whole - late;
  step.begin = t + late;
  step.length = hn::Min(hn::IfThenElse(rest > zero, rest, rest + 1.0f), end - step.begin);
  step.beside_lamp = zero > zero;
  if (near_ & busy_) {
    const V longest = longest_step_near_lamps(step.begin);
    step.beside_lamp = longest < 1.0f;
    step.length = hn::IfThenElse(step.beside_lamp, hn::Min(step.length, longest), step.length);
  }
  step.middle = step.begin + 0.5f * step.length;
  step.next = step.begin + step.length;
  step.media = media_.at(rays_, step.active, step.middle);
  step.thickness = hn::Max(hn::IfThenElseZero(step.active, step.media.extinction) * step.length, zero);
  step.dense = step.thickness > zero;
  return step;
}

HWY_INLINE V RayMarch::step_length(M active, V t, V stride) const {
  const V deeper = hn::Max(depth_.load() - kGrowingDepth, hn::Zero(D()));
  const V length = stride * hn::Min(set(kLongestStep), 1.0f + kStepGrowth * deeper);
  if (!(scene_.steps.even_stride > 1)) return length;
  Lane steps;
  rays_.for_each(active, t, [&](size_t lane, MarchedRay& ray, float from) {
    steps[lane] = scene_.even_steps(ray, from, end_[lane]);
  });
  return hn::Max(length, stride_.load() * steps.load());
}

/// As MarchScene has it, of the rays that pass a lamp; else 1.
V RayMarch::longest_step_near_lamps(V t) const {
  Lane longest;
  longest.store(set(1.0f));
  rays_.for_each(mask_of(near_ & busy_), t, [&](size_t lane, MarchedRay& ray, float from) {
    longest[lane] = MarchScene::step_near_lamps(ray, from);
  });
  return longest.load();
}

/// The share of the extinction that is left without forward peaks, as peak_weight() has it; where there is one medium,
/// that of the fields.
HWY_INLINE V RayMarch::unpeaked_share(V albedo, V g) const {
  if (!scene_.mixed_peaks) return set(scene_.scaled_extinction);
  const V positive = hn::Max(g, hn::Zero(D())),
          share = hn::Min(set(1.0f), positive * (1 / static_cast<float>(kNarrowPeak)));
  const V squares = share * share;
  return 1.0f - albedo * (positive * positive * squares * squares);
}

/// T (1 - e^-x), where x of each octave is twice that of the one behind it: 1 - q^2 = (1 - q) (2 - (1 - q)).
HWY_INLINE StepWeights RayMarch::weights(const Step& step) const {
  V taken[kOctaves];
  taken[3] = one_minus_attenuation(step.thickness * 0.125f);
  for (size_t k = 3; k-- > 0;) taken[k] = taken[k + 1] * (2.0f - taken[k + 1]);
  StepWeights to;
  for (size_t k = 0; k < kOctaves; ++k) to.w[k] = transmittance_[k].load() * taken[k];
  to.scale = unpeaked_share(step.media.albedo, step.media.g);
  // Without a forward peak both are the same to the last bit.
  const bool whole = hn::AllTrue(D(), to.scale == 1.0f);
  to.scaled = scaled_transmittance_.load() * (whole ? taken[0] : one_minus_attenuation(step.thickness * to.scale));
  return to;
}

HWY_INLINE void RayMarch::add_to_segment(const Step& step, const StepWeights& weights) {
  Segment& to = light_segment_;
  const V thickness = of_no_holdout(step, step.thickness), scattered = thickness * step.media.albedo;
  to.end.store(step.dense, step.next);
  for (size_t k = 0; k < kOctaves; ++k) to.w[k].add(of_no_holdout(step, weights.w[k]));
  to.scaled.add(of_no_holdout(step, weights.scaled));
  to.unpeaked.add(of_no_holdout(step, weights.scaled / weights.scale));
  to.thickness.add(thickness);
  to.distance.add(thickness * step.middle);
  to.peaks.add(thickness * peaks_before_middle(step, weights.scale));
  to.albedo.add(scattered);
  to.g.add(thickness * step.media.g);
  if (!scene_.mixed_tints) return;
  to.tint[0].add(scattered * step.media.tint.x);
  to.tint[1].add(scattered * step.media.tint.y);
  to.tint[2].add(scattered * step.media.tint.z);
}

/// What holdouts take covers nothing, so it counts as left.
HWY_INLINE void RayMarch::keep_for_deep_picture(const Step& step, V w) const {
  Lane begin, end, taken, left;
  begin.store(step.begin);
  end.store(step.next);
  taken.store(w);
  left.store(scene_.holdouts ? 1.0f - opacity_.load() - w : transmittance_[0].load() - w);
  rays_.for_each(scene_.emits ? step.active : step.dense, [&](size_t lane, MarchedRay& ray) {
    if (ray.deep) ray.deep->add(begin[lane], end[lane], taken[lane], left[lane]);
  });
}

HWY_INLINE void RayMarch::add_emission(const Step& step, const StepWeights& weights) const {
  Lane straight, by_peaks, before;
  const V inverse = 1.0f / hn::Max(step.media.extinction, set(1e-37f));
  straight.store(hn::IfThenElse(step.dense, weights.w[0] * inverse, transmittance_[0].load() * step.length));
  by_peaks.store(
      hn::IfThenElse(step.dense, weights.scaled / weights.scale * inverse, scaled_transmittance_.load() * step.length));
  before.store(peaks_before_middle(step, weights.scale));
  rays_.for_each(step.active, step.middle, [&](size_t lane, MarchedRay& ray, float t) {
    scene_.emit(ray, t, straight[lane], by_peaks[lane], before[lane]);
  });
}

HWY_INLINE void RayMarch::add_to_layers(const Step& step, V w) {
  // Distances from where anything was seen first keep what rounding would take from their squares' mean.
  first_.store(hn::And(step.dense, opacity_.load() <= 0.0f), step.middle);
  const V behind = step.middle - first_.load();
  opacity_.add(w);
  distance_.add(w * behind);
  distance2_.add(w * behind * behind);
  density_.add(w * step.media.density);
  const V3& gradient = step.media.gradient;
  gradient_.store(gradient_.load() + w / (length(gradient) + scene_.steps.gentle_gradient) * gradient);
}

/// Adds the light that segments scatter towards the eye: of suns and lamps at once, fields at nodes when the segments
/// since they were looked up last are as long as nodes are apart.
void RayMarch::add_light(M mask) {
  mask = hn::And(mask, light_segment_.thickness.load() > 0.0f);
  if (hn::AllFalse(D(), mask)) return;
  const float spacing = scene_.steps.field_spacing;
  const auto longer = [&](const Lane& end, float than) {
    return hn::And(mask, end.load() - node_segment_.begin.load() > than);
  };
  add_fields(longer(light_segment_.end, 2 * spacing));
  for (size_t k = 0; k < scene_.lights.size(); ++k) add_sharp_light(k, mask);
  node_segment_.join(light_segment_, mask);
  const M thick = hn::And(mask, node_segment_.thickness.load() > kNodeThickness);
  add_fields(hn::Or(longer(node_segment_.end, spacing), thick));
}

HWY_INLINE void RayMarch::add_sharp_light(size_t k, M mask) {
  const MarchedLight& known = scene_.lights[k];
  const Segment& segment = light_segment_;
  const V inverse = segment.inverse_thickness(), distance = segment.distance.load() * inverse;
  V visible = set(1.0f), depth = hn::Zero(D());
  if (known.visible || known.depth) {
    const V3 place = place_at_nodes(mask, distance) * to_lights_ +
                     V3{set(lights_origin_.x), set(lights_origin_.y), set(lights_origin_.z)};
    const LatticeCell cell(to_nodes(scene_.nodes, place), scene_.nodes.n);
    if (known.visible) visible = between_nodes(scene_.nodes, known.visible, cell, mask);
    if (known.depth) depth = between_nodes(scene_.nodes, known.depth, cell, mask);
  }
  if (known.varies) update_terms(k, distance, depth, mask);
  LightLanes& light = light_[k];
  const V tau = known.sun ? depth_towards(*known.sun, light.place.at(distance), mask) : depth;
  const V scale = unpeaked_share(segment.albedo.load() * inverse, segment.g.load() * inverse);
  light.add(segment, known.sun != nullptr, visible, tau, scale, mask);
}

/// Terms of a light that are not the same all along a ray, where the segments are.
HWY_INLINE void RayMarch::update_terms(size_t k, V distance, V depth, M mask) {
  LightLanes& light = light_[k];
  Lane g, depths, entry;
  g.store(light_segment_.g.load() * light_segment_.inverse_thickness());
  depths.store(depth);
  uint32_t tabulated = 0;
  rays_.for_each(mask, distance, [&](size_t lane, MarchedRay& ray, float t) {
    const MarchScene::Changed changed = scene_.update_terms(ray, k, t, g[lane], depths[lane]);
    const LightTerms& terms = ray.terms[k];
    if (changed == MarchScene::Changed::kAll) light.set_terms(lane, terms);
    if (changed != MarchScene::Changed::kTableEntry) return;
    light.irradiance[lane] = terms.irradiance;
    light.mean_depth[lane] = terms.mean_depth;
    entry[lane] = terms.table_entry;
    tabulated |= 1u << lane;
  });
  if (tabulated) light.look_up_phases(scene_.phase_tables.data(), entry.load(), mask_of(tabulated));
}

/// Adds the fields at nodes, whose light segments scatter. Lanes find the weights of the eight nodes around them side
/// by side; then each has its fields interpolated, a vector of them at a time.
void RayMarch::add_fields(M mask) {
  mask = hn::And(mask, node_segment_.thickness.load() > 0.0f);
  const D d;
  if (hn::AllFalse(d, mask)) return;
  const NodeTable& table = fields_.table;
  const ivec3& n = table.lattice.n;
  const V inverse = node_segment_.inverse_thickness();
  const LatticeCell cell(to_nodes(table.lattice, place_at_nodes(mask, node_segment_.distance.load() * inverse)), n);
  HWY_ALIGN int32_t first[hn::MaxLanes(DI())];
  hn::Store((cell.node[0] * n.y + cell.node[1]) * n.z + cell.node[2], DI(), first);
  Lane weight[8], albedo;
  for (int corner = 0; corner < 8; ++corner) {
    const auto along = [&](int axis, int bit) { return corner & bit ? cell.f[axis] : 1.0f - cell.f[axis]; };
    weight[corner].store(along(0, 4) * along(1, 2) * along(2, 1));
  }
  albedo.store(node_segment_.albedo.load() * inverse);

  const size_t count = table.count, y = count * static_cast<size_t>(n.z), x = y * static_cast<size_t>(n.y);
  rays_.for_each(mask, [&](size_t lane, MarchedRay& ray) {
    GuideSums& to = *ray.sums;
    const float* const base = table.values.data() + static_cast<size_t>(first[lane]) * count;
    const V w = set(node_segment_.w[0][lane]), scaled = set(node_segment_.scaled[lane]);
    V corners[8];
    for (size_t c = 0; c < 8; ++c) corners[c] = set(weight[c][lane]);
    HWY_ALIGN float at[NodeTable::kMost];
    for (size_t m = 0; m < count; m += hn::Lanes(d)) {
      const auto corner = [&](size_t c, size_t offset) { return corners[c] * hn::LoadU(d, base + m + offset); };
      V sum = corner(0, 0) + corner(1, count);
      sum = sum + (corner(2, y) + corner(3, y + count));
      sum = sum + (corner(4, x) + corner(5, x + count));
      sum = sum + (corner(6, x + y) + corner(7, x + y + count));
      hn::Store(sum, d, at + m);
      hn::StoreU(hn::LoadU(d, to.plain.data() + m) + w * sum, d, to.plain.data() + m);
      hn::StoreU(hn::LoadU(d, to.scaled.data() + m) + scaled * sum, d, to.scaled.data() + m);
    }
    add_weighted_fields(to, at, albedo[lane], lane);
    if ((scene_.mixed_tints || ray.deep) && node_segment_.albedo[lane] > 0)
      add_coloured_light(ray, at, albedo[lane], lane);
  });
  node_segment_.clear(mask);
}

/// What of the fields has other weights than w and scaled.
HWY_INLINE void RayMarch::add_weighted_fields(GuideSums& sums, const float* at, float albedo, size_t lane) const {
  const Segment& s = node_segment_;
  for (size_t g = 0; fields_.groups && g < fields_.groups->size(); ++g) {
    const NodeFields::Slots& slots = (*fields_.groups)[g];
    GuideSums::FieldSums& to = sums.fields[g];
    const float tail = at[slots.tail()];
    for (size_t k = 1; k < kOctaves; ++k) to.tail[k - 1] += s.w[k][lane] * tail;
    if (!slots.forward) continue;
    to.single += s.w[0][lane] * albedo * at[slots.single];
    to.forward += s.unpeaked[lane] * albedo * at[slots.forward];
  }
}

/// All light of a segment at once, in colour: where media have unlike tints, and for deep pictures.
HWY_INLINE void RayMarch::add_coloured_light(MarchedRay& ray, const float* at, float albedo, size_t lane) {
  const Segment& s = node_segment_;
  for (size_t k = 0; k < scene_.lights.size(); ++k) {
    ray.terms[k].single = std::exchange(light_[k].recent_single[lane], 0.0f);
    ray.terms[k].forward = std::exchange(light_[k].recent_forward[lane], 0.0f);
  }
  if (scene_.mixed_tints)
    scene_.set_tint(ray,
                    dvec3(s.tint[0][lane], s.tint[1][lane], s.tint[2][lane]) / static_cast<double>(s.albedo[lane]));
  const ScatteringPart part{at, s.w[0][lane], s.scaled[lane], s.unpeaked[lane], albedo};
  if (scene_.mixed_tints) scene_.add_scattered(ray, fields_, part, ray.sums->tinted_direct, ray.sums->tinted_indirect);
  if (!ray.deep) return;
  dvec3 direct(0), indirect(0);
  scene_.add_scattered(ray, fields_, part, direct, indirect);
  ray.deep->light_up(s.end[lane], part.w, vec3(direct + indirect));
}

/// On the fields' lattice, in spacings, where the light was solved.
HWY_INLINE V3 RayMarch::place_at_nodes(M mask, V t) const {
  if (!scene_.follows) return nodes_.at(t);
  Lanes3 moved;
  rays_.for_each(mask, t, [&](size_t lane, MarchedRay& ray, float at) {
    moved.set(lane, vec3(fields_.table.lattice.to_spacings(scene_.in_light(ray, at))));
  });
  return moved.load();
}

void MarchRays(const MarchScene& scene, const MarchedFields& fields, MarchBatch& batch) {
  RayMarch(scene, fields, batch).run();
}

}  // namespace brume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace brume {

HWY_EXPORT(MarchRays);

void march_rays(const MarchScene& scene, const MarchedFields& fields, MarchBatch& batch) {
  HWY_DYNAMIC_DISPATCH(MarchRays)(scene, fields, batch);
}

}  // namespace brume
#endif
