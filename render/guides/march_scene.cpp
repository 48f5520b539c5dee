#include "render/guides/march_scene.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/guides/forward_peak.h"

namespace brume {
namespace {

// Of the largest density in a voxel: gradients below it count less, because their direction means little.
constexpr double kGentleGradient = 0.03;
// Steps are as short as this share of the distance to a small lamp, within as many steps of it.
constexpr float kNearLamp = 8, kShortestStep = 1.0f / 32;
// Steps at once where all media are homogeneous, as far as they are as thin as this: so many in shadows that a sun
// casts through grids, elsewhere as far as the light at nodes is linear, of graded lattices farther; and of the
// distance to a lamp.
constexpr double kEvenStride = 12, kEvenThickness = 0.1, kEvenNodes = 0.5, kGradedNodes = 2, kEvenDistance = 1.0 / 16;
constexpr double kLayerStep = 0.25;    // of the scale height of a layer, that a step climbs at most
constexpr double kNodesPerLookUp = 1;  // of the spacing of nodes, between two look-ups of their fields
constexpr double kNarrow = 0.99;       // mean cosine of directions that count as one
// Rays count their steps from a multiple of so many, so that theirs and those of longer strides lie alike in all rays.
constexpr double kCountedSteps = 6;

void set_place(MarchedRay::Place& place, const dvec3& start, const dvec3& along) {
  for (int a = 0; a < 3; ++a) {
    place.start[a] = static_cast<float>(start[a]);
    place.along[a] = static_cast<float>(along[a]);
  }
}

bool looked_up_in_vectors(const Medium& m) {
  return !m.homogeneous() && !m.displacement() && !m.coloured() && !m.instances() && !m.bricks().empty() &&
         LaneGrid::fits(m.bricks());
}

bool of_one_density(const Medium& m) {
  return m.homogeneous() && !m.falls_off() && !m.coloured() && !m.instances();
}

/// @param step  the unit of length [world units]
MarchedShape marched_shape(const GuideMedia& media, size_t medium, GuideColour colour, double step) {
  const GuideMedia::Constants& c = media.constants(medium);
  const auto of = static_cast<size_t>(colour + 1);
  return {medium,
          static_cast<float>(c.per_density[of] * step),
          static_cast<float>(c.albedo[of]),
          static_cast<float>(media.mean_cosine(medium)),
          {static_cast<float>(c.tint.x), static_cast<float>(c.tint.y), static_cast<float>(c.tint.z)},
          media.media()[medium].holdout() ? 0.0f : 1.0f};
}

/// @param step  the unit of length [world units]
MarchedGrid marched_grid(const GuideMedia& media, size_t medium, GuideColour colour, double step) {
  const Medium& m = media.media()[medium];
  const GuideMedia::Constants& c = media.constants(medium);
  const auto of = static_cast<size_t>(colour + 1);
  const double extinction = c.per_density[of] * step;
  MarchedGrid grid{medium,
                   LaneGrid::of_values(m.bricks()),
                   {},
                   static_cast<float>(extinction),
                   static_cast<float>(c.albedo[of]),
                   static_cast<float>(media.mean_cosine(medium)),
                   static_cast<float>(c.inverse_maximum),
                   {static_cast<float>(c.tint.x), static_cast<float>(c.tint.y), static_cast<float>(c.tint.z)},
                   m.holdout() ? 0.0f : 1.0f,
                   {},
                   {}};
  set_cells(grid.cells, grid.stored);
  if (const Detail* const detail = m.detail()) {
    // What is narrower than half a step would be seen as noise.
    const double spacing = 0.5 * step / m.voxel_size() * detail->frequency();
    const int octaves = spacing > 0 ? 1 + static_cast<int>(std::floor(-std::log2(spacing))) : Detail::kMostOctaves;
    grid.detail = lane_detail(*detail, std::clamp(octaves, 0, Detail::kMostOctaves));
  }
  for (int axis = 0; axis < 3; ++axis) {
    dvec3 slope(0);
    slope[axis] = 1;
    const dvec3 gradient = extinction * step * m.gradient_to_world(slope);
    for (int a = 0; a < 3; ++a) grid.gradient[a][axis] = static_cast<float>(gradient[a]);
  }
  return grid;
}

double spacing_of(const SunDepth& depth) {
  double nodes = 0;  // for each world unit along the axis that the columns run along most
  for (int a = 0; a < 3; ++a) {
    dvec3 axis(0);
    axis[a] = 1;
    nodes = std::max(nodes, std::abs(depth.line({dvec3(0), axis}).along.x));
  }
  return 1 / nodes;
}

/// How far a ray goes until the height in a layer has changed by a part of its scale.
double longest_through_layers(const GuideMedia& media, const Ray& ray) {
  double longest = kFar;
  for (const Medium& m : media.media())
    if (m.falls_off())
      m.each_met(ray, kFar, [&](const Medium& one, size_t) {
        const double climb = std::abs(glm::dot(one.homogeneous()->falloff->slope, one.to_local(ray).d));
        longest = std::min(longest, climb > 0 ? kLayerStep / climb : kFar);
      });
  return longest;
}

}  // namespace

MarchSteps::MarchSteps(const GuideMedia& media, const LightFields& fields, GuideColour colour, double voxels)
    : length(voxels * media.voxel()) {
  double densest = 0, even = 0;
  for (const Medium& m : media.media()) {
    const double sigma_t = in_colour(m.coefficients().sigma_t, colour);
    densest = std::max(densest, m.maximum_density() * sigma_t);
    if (m.homogeneous()) even += sigma_t;
  }
  gentle_gradient = static_cast<float>(std::max(kGentleGradient * densest * length * length / media.voxel(), 1e-30));
  double most = (fields.lattice().planes ? kGradedNodes : kEvenNodes) * fields.lattice().spacing / length;
  // Wide layers of fog have wide lattices of depths towards suns: shadows are no finer than these.
  const bool layers =
      std::any_of(media.media().begin(), media.media().end(), [](const Medium& m) { return m.falls_off(); });
  for (const auto& light : fields.lights())
    if (light->sharp() && light->sharp()->sun() && media.media().size() > 1) {
      const double between = kEvenNodes * spacing_of(light->sharp()->sun()->depth(0)) / length;
      most = std::min(most, layers ? std::max(kEvenStride, between) : kEvenStride);
    }
  if (even > 0) even_stride = std::max(1.0, std::floor(std::min(kEvenThickness / (even * length), most)));
  // Light of many tints is coloured where it is scattered, of suns and of nodes together.
  if (!media.mixed_tints()) field_spacing = static_cast<float>(kNodesPerLookUp * fields.lattice().spacing / length);
}

MarchScene::MarchScene(const std::vector<GuideMedia>& media, size_t time, const LightFields& fields, GuideColour colour,
                       const MarchSteps& march_steps)
    : steps(march_steps),
      nodes(fields.lattice()),
      emits(!media[time].emissions().empty()),
      mixed_tints(media[time].mixed_tints()),
      holdouts(media[time].holdouts()),
      follows(time != media.size() / 2 && media[time].media().size() > 1),
      mixed_peaks(media[time].media().size() > 1),
      scaled_extinction(static_cast<float>(fields.scaled_extinction())),
      media_(media),
      own_(media[time]),
      fields_(fields),
      colour_(colour) {
  const std::vector<Medium>& all = own_.media();
  const auto even = static_cast<size_t>(std::count_if(all.begin(), all.end(), of_one_density));
  bool in_vectors = true;
  for (size_t i = 0; i < all.size(); ++i)
    in_vectors = in_vectors && (of_one_density(all[i]) || looked_up_in_vectors(own_.detailed(i)));
  if (even <= kMostMarchedShapes && all.size() - even <= kMostMarchedGrids && in_vectors)
    for (size_t i = 0; i < all.size(); ++i) {
      if (of_one_density(all[i]))
        shapes.push_back(marched_shape(own_, i, colour, steps.length));
      else
        grids.push_back(marched_grid(own_, i, colour, steps.length));
    }
  for (size_t k = 0; k < fields.lights().size(); ++k) {
    const SharpLight* const light = fields.lights()[k]->sharp();
    if (!light) continue;
    MarchedLight& to = lights.emplace_back(MarchedLight{k, light});
    to.visible = light->visible_at_nodes();
    to.depth = light->depth_at_nodes();
    if (!light->sun()) continue;
    to.sun = &light->sun()->depth(time);
    to.irradiance = static_cast<float>(in_colour(light->sun()->irradiance(), colour));
    to.varies = all.size() != 1;
  }
  const bool any_lamp = std::any_of(lights.begin(), lights.end(), [](const MarchedLight& l) { return !l.sun; });
  if (any_lamp && all.size() == 1) tabulate_phases();
}

void MarchScene::tabulate_phases() {
  constexpr auto kEntries = static_cast<size_t>(kPhaseEntries) + 1;
  phase_tables.resize(kEntries * (std::size(LightTerms().phase) + std::size(LightTerms().peak)));
  for (size_t i = 0; i < kEntries; ++i) {
    const double sine = static_cast<double>(i) / kPhaseEntries;
    LightTerms exact;
    set_phases(exact, 1 - 2 * sine * sine, own_.mean_cosine(0), 1);
    float* to = phase_tables.data() + i;
    for (const float phase : exact.phase) *std::exchange(to, to + kEntries) = phase;
    for (const float peak : exact.peak) *std::exchange(to, to + kEntries) = peak;
  }
}

MarchedRay& MarchScene::aim(const RayToMarch& aimed, const Lattice& table, MarchBatch& batch) const {
  MarchedRay& to = batch.rays.emplace_back();
  const Ray& ray = to.ray = aimed.ray;
  const double step = steps.length;
  to.stride = static_cast<float>(aimed.stride);
  to.offset = static_cast<float>(aimed.offset);
  to.sums = &aimed.sums;
  own_.intervals(ray, aimed.t_max, batch.intervals);
  if (!batch.intervals.empty())
    to.start = std::floor(batch.intervals[0].first / (kCountedSteps * step)) * kCountedSteps * step;
  to.first_part = static_cast<uint32_t>(batch.parts.size());
  for (const auto& [from, end] : batch.intervals) {
    const vec2 part((from - to.start) / step, (end - to.start) / step);
    if (part.x < part.y) batch.parts.push_back(part);
  }
  to.last_part = static_cast<uint32_t>(batch.parts.size());
  if (to.misses()) return to;
  if (steps.even_stride > 1) {
    own_.intervals(ray, aimed.t_max, to.uneven, /*uneven=*/true);
    to.level = longest_through_layers(own_, ray);
  }
  place_in_media(to);
  place_at_nodes(to, table);
  place_beside_lamps(to);
  place_towards_suns(to);
  return to;
}

/// Where the steps of a ray lie in grids and homogeneous media.
void MarchScene::place_in_media(MarchedRay& to) const {
  const double step = steps.length;
  for (size_t i = 0; i < grids.size(); ++i) {
    const Ray local = own_.media()[grids[i].medium].to_local(to.ray);
    set_place(to.grid[i], local.at(to.start), step * local.d);
  }
  for (size_t i = 0; i < shapes.size(); ++i) {
    const Medium& medium = own_.media()[shapes[i].medium];
    const auto [begin, end] = medium.homogeneous()->intersect(medium.to_local(to.ray));
    to.shape[i] = vec2((begin - to.start) / step, (end - to.start) / step);
  }
  if (grids.empty() && shapes.empty()) to.line.emplace(own_, colour_, /*detailed=*/true).follow(to.ray);
}

/// The only medium's light was solved where it was in the middle of the shutter, a line of it was a line there, too.
void MarchScene::place_at_nodes(MarchedRay& to, const Lattice& table) const {
  const GuideMedia& middle = media_[media_.size() / 2];
  const bool alone = own_.media().size() == 1;
  const dvec3 start = to.ray.at(to.start), end = to.ray.at(to.start + steps.length);
  const dvec3 lit_start = alone ? own_.moved(0, start, middle) : start,
              lit_end = alone ? own_.moved(0, end, middle) : end;
  set_place(to.nodes, table.to_spacings(lit_start), (lit_end - lit_start) / table.spacing);
}

void MarchScene::place_beside_lamps(MarchedRay& to) const {
  for (const MarchedLight& light : lights) {
    const dvec3* const lamp = light.sun ? nullptr : base_of(light.light->light()).centre();
    if (!lamp) continue;
    const dvec3 off = (*lamp - to.ray.at(to.start)) / steps.length;
    const double along = glm::dot(off, to.ray.d), squared = std::max(0.0, glm::dot(off, off) - along * along);
    if (squared < kNearLamp * kNearLamp) to.lamp[to.lamps++] = vec2(along, squared);
  }
}

void MarchScene::place_towards_suns(MarchedRay& to) const {
  for (size_t k = 0; k < lights.size(); ++k) {
    if (!lights[k].sun) continue;
    const SunDepth::Line line = lights[k].sun->line(to.ray);
    set_place(to.light[k], line.start + to.start * line.along, steps.length * line.along);
    LightTerms& terms = to.terms[k];
    terms.irradiance = lights[k].irradiance;
    terms.g = std::numeric_limits<double>::quiet_NaN();
    if (own_.media().size() == 1)
      set_phases(terms, glm::dot(lights[k].light->sun()->towards(), to.ray.d), own_.mean_cosine(0), 1);
  }
}

MarchScene::Point MarchScene::at(MarchedRay& ray, float t) const {
  dvec3 gradient;
  const double step = steps.length;
  const GuideMedia::Point found = ray.line->at(ray.start + step * t, gradient);
  return {static_cast<float>(step * found.sigma_t),
          static_cast<float>(holdouts ? found.seen_albedo : found.albedo),
          static_cast<float>(found.g),
          static_cast<float>(found.density),
          vec3(step * step * gradient),
          vec3(found.tint),
          static_cast<float>(found.seen)};
}

float MarchScene::step_near_lamps(const MarchedRay& ray, float t) {
  float longest = 1;
  for (uint32_t i = 0; i < ray.lamps; ++i) {
    const float along = t - ray.lamp[i].x;
    longest = std::min(longest, std::sqrt(along * along + ray.lamp[i].y) / kNearLamp);
  }
  return std::max(longest, kShortestStep);
}

float MarchScene::even_steps(const MarchedRay& ray, float t, float end) const {
  const double step = steps.length, from = ray.start + step * t;
  double to = ray.start + step * end;
  for (const auto& [begin, after] : ray.uneven)
    if (after > from) {
      to = std::min(to, begin);
      break;
    }
  double longest = std::min(to - from, ray.level);
  const dvec3 p = ray.ray.at(from);
  for (const MarchedLight& light : lights) {
    if (light.sun) continue;
    const dvec3* const centre = base_of(light.light->light()).centre();
    longest = centre ? std::min(longest, kEvenDistance * glm::distance(*centre, p)) : 0;
  }
  return static_cast<float>(
      std::min(steps.even_stride, std::floor(longest / (step * static_cast<double>(ray.stride)))));
}

// Emission that comes straight to the eye, and that which forward peaks scatter once or more on the way.
void MarchScene::emit(const MarchedRay& ray, float t, float straight, float by_peaks, float depth) const {
  const dvec3 emission = own_.emission(point(ray, t));
  if (emission == dvec3(0)) return;
  const double unscattered = steps.length * straight, all = steps.length * by_peaks;
  const double peaks = std::max(0.0, all - unscattered);
  const double once = std::min(unscattered * depth, peaks);
  ray.sums->emission += vec3(emission * unscattered);
  ray.sums->emission_once += vec3(emission * once);
  ray.sums->behind += vec3(emission * (peaks - once));
  if (ray.deep) ray.deep->steps.back().light += vec3(emission * (unscattered + peaks));
}

void MarchScene::set_phases(LightTerms& light, double cosine, double g, double spread) const {
  const bool one = own_.media().size() == 1;
  const double phase = spread < kNarrow ? HenyeyGreenstein{spread * g}.value(cosine)
                       : one            ? own_.media()[0].phase().value(cosine)
                                        : HenyeyGreenstein{g}.value(cosine);
  light.phase[0] = static_cast<float>(phase);
  for (int i = 1; i < 4; ++i) light.phase[i] = static_cast<float>(HenyeyGreenstein{g / (1 << i)}.value(cosine));
  const std::array<double, 8> peak = ForwardPeak(g, cosine).coefficients();
  std::copy(peak.begin(), peak.end(), light.peak);
}

MarchScene::Changed MarchScene::update_terms(MarchedRay& ray, size_t k, float t, float g, float depth) const {
  LightTerms& to = ray.terms[k];
  if (const SunLight* const sun = lights[k].light->sun()) {
    // In steps, so that it seldom changes.
    constexpr double kSteps = 1024;
    const double rounded = std::round(static_cast<double>(g) * kSteps) / kSteps;
    if (to.g == rounded) return Changed::kNothing;
    to.g = rounded;
    set_phases(to, glm::dot(sun->towards(), ray.ray.d), rounded, 1);
    return Changed::kAll;
  }
  ArrivingLight arriving = arriving_light(lights[k].light->light(), in_light(ray, t));
  arriving.depth = depth;
  to.irradiance = static_cast<float>(in_colour(arriving.irradiance, colour_));
  to.mean_depth = static_cast<float>(arriving.mean_depth());
  const double cosine = glm::dot(arriving.towards, ray.ray.d), spread = arriving.mean_cosine();
  // Of one medium, whose mean cosine is the same everywhere, the exact terms are interpolated.
  if (!phase_tables.empty() && spread >= kNarrow) {
    to.table_entry = static_cast<float>(std::sqrt(std::clamp(0.5 * (1 - cosine), 0.0, 1.0)) * kPhaseEntries);
    return Changed::kTableEntry;
  }
  set_phases(to, cosine, g, spread);
  return Changed::kAll;
}

dvec3 MarchScene::in_light(const MarchedRay& ray, float t) const {
  return own_.followed(point(ray, t), media_[media_.size() / 2]);
}

void MarchScene::set_tint(MarchedRay& ray, const dvec3& once) const {
  // In steps, so that it seldom changes.
  constexpr double kSteps = 4096;
  const dvec3 rounded = glm::round(once * kSteps) / kSteps;
  if (rounded != ray.tint.once()) ray.tint = OrderTint(rounded);
}

void MarchScene::add_scattered(const MarchedRay& ray, const MarchedFields& known, const ScatteringPart& part,
                               dvec3& direct, dvec3& indirect) const {
  const auto& [at, w, scaled, unpeaked, albedo] = part;
  const OrderTint& tint = ray.tint;
  size_t sharp = 0;
  for (size_t k = 0; k < fields_.lights().size(); ++k) {
    const GuideLight& group = *fields_.lights()[k];
    double single = 0, forward = 0;
    dvec3 more(0);
    if (group.sharp()) {
      single = ray.terms[sharp].single;
      forward = ray.terms[sharp++].forward;
    }
    if (known.groups) {
      const NodeFields::Slots& s = (*known.groups)[k];
      if (!group.sharp()) {
        single = static_cast<double>(w) * albedo * at[s.single];
        forward = static_cast<double>(unpeaked) * albedo * at[s.forward] - single;
      }
      for (size_t order = 0; order < GuideLight::kFirstOrder.size(); ++order)
        more += static_cast<double>(scaled) * at[s.orders + order] * tint.of_guide(order);
    }
    const dvec3 colour = group.colour_in(colour_);
    (group.from_surfaces() ? indirect : direct) += colour * single * tint.once();
    indirect += colour * (forward * tint.forward() + more);
  }
}

}  // namespace brume
