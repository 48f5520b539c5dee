#include "render/guides/lit_pixels.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

constexpr int kSides[] = {8, 4};        // of squares [px], the ones that are tried first
constexpr int kUses = 4;                // rays of a pixel that share light
constexpr double kAlikeNormals = 0.98;  // cosine
constexpr double kFlat = 0.15;          // distance off the middle's plane, of that from the middle
// Of the whole light in the middle: what corners may differ by, and what lies between them may be wrong by, from each
// guide light.
constexpr double kAlike = 0.4, kExact = 0.02;
constexpr double kLeastWhole = 0.01;  // of a light group, of all light
// What light differs by from what lies between the pixels on either side, of the largest, where shadows end, and the
// points across that it is then found at; the same between points of a lens.
constexpr double kShadowEdge = 0.1;

/// Whether a whole differs from what is expected of it by too much of the largest nearby.
bool apart(double whole, double expected, double largest) {
  return std::abs(expected - whole) > kShadowEdge * largest;
}

}  // namespace

LitPixels::LitPixels(const GuideMarch& march) : march_(march), lights_of_part_(march.fields_.groups() + 1) {
  const auto& lights = march.fields_.lights();
  for (size_t k = 0; k < lights.size(); ++k) {
    const int group = lights[k]->group_number;
    const bool of_group = march.fields_.groups() > 0 && group >= 0;
    (of_group ? lights_of_part_[static_cast<size_t>(group)] : lights_of_part_.back()).push_back(k);
  }
}

void LitPixels::begin_tile() {
  places_.clear();
  squares_.clear();
  at_edges_.clear();
}

bool LitPixels::Place::fits(const SurfaceHit& hit, const ShadedPoint& at) const {
  return surface == hit.surface && inside == at.inside && glm::dot(normal, at.normal) > kAlikeNormals;
}

bool LitPixels::Place::alike(const Place& other) const {
  return other.surface == surface && other.inside == inside && glm::dot(other.normal, normal) > kAlikeNormals;
}

LitPixels::Light LitPixels::no_light() const {
  return {std::vector<Lit>(march_.fields_.lights().size()), dvec3(0),
          std::vector<dvec3>(march_.fields_.groups(), dvec3(0))};
}

LitPixels::Place LitPixels::unlit(const SurfaceHit& hit, const ShadedPoint& at) {
  return {hit.surface, at.inside, at.p, at.normal};
}

void LitPixels::look_around(Place& place, const Place* like) const {
  place.light = no_light();
  place.known.assign(parts(), false);
  place.wholes.assign(parts(), 0);
  if (like) {
    place.around = like->around;
    place.light.of_light_groups = like->light.of_light_groups;
  } else {
    place.around = march_.surfaces_.surface_light->onto(place.p, place.normal, place.light.of_light_groups);
  }
  place.light.scattered = place.around.scattered;
}

const LitPixels::Light& LitPixels::lit(Place& place, size_t part) const {
  if (place.known.empty()) look_around(place, nullptr);
  if (place.known[part]) return place.light;
  place.known[part] = true;
  double& whole = place.wholes[part];
  whole = in_colour(is_of_group(part) ? place.light.of_light_groups[part] : place.light.scattered, kGrey);
  for (const size_t k : lights_of_part_[part]) {
    Lit& light = place.light.groups[k];
    light = march_.fields_.lights()[k]->onto(march_.surfaces_, place.around, place.p, place.normal);
    whole += in_colour(light.direct + light.indirect, kGrey);
  }
  return place.light;
}

double LitPixels::whole(Place& place, size_t part) const {
  lit(place, part);
  return place.wholes[part];
}

double LitPixels::whole(Place& place) const {
  double all = whole(place, parts() - 1);
  for (size_t part = 0; is_of_group(part); ++part) {
    lit(place, part);
    for (const size_t k : lights_of_part_[part])
      all += in_colour(place.light.groups[k].direct + place.light.groups[k].indirect, kGrey);
  }
  return all;
}

LitPixels::Place& LitPixels::place(const ivec2& pixel, int ray, int across) {
  const auto [known, fresh] = places_.try_emplace({pixel.x, pixel.y, ray});
  if (fresh) known->second = place_along(march_.rays_.sample(pixel, ray, across));
  return known->second;
}

LitPixels::Place LitPixels::place_along(const CameraSample& sample) const {
  const Ray along = march_.rays_.ray(sample);
  const std::optional<SurfaceHit> hit = march_.rays_.first_hit(along);
  if (!hit || march_.context_.lights->nearest(along, hit->t, /*seen=*/true).first) return {};
  const ShadedPoint at(*march_.context_.surfaces, along, *hit);
  return at.diffuse() ? unlit(*hit, at) : Place();
}

bool LitPixels::at_shadow_edge(Place& own, const ivec2& pixel, int ray, int across, size_t part, double least) {
  for (const ivec2& step : {ivec2(1, 0), ivec2(0, 1)}) {
    Place &before = place(pixel - step, ray, across), &behind = place(pixel + step, ray, across);
    if (!own.alike(before) || !own.alike(behind)) continue;
    const double a = std::max(whole(before, part), least), b = std::max(whole(behind, part), least),
                 here = std::max(whole(own, part), least);
    if (apart(here, 0.5 * (a + b), std::max({a, b, here}))) return true;
  }
  return false;
}

bool LitPixels::differs_over_lens(Place& own, const ivec2& pixel, int ray, int across, size_t part, double least) {
  if (across == 1 || !march_.rays_.has_lens()) return false;
  for (int other = 0; other < across * across; ++other) {
    if (other == ray) continue;
    Place& there = place(pixel, other, across);
    if (!own.alike(there)) continue;
    const double a = std::max(whole(own, part), least), b = std::max(whole(there, part), least);
    if (apart(a, b, std::max(a, b))) return true;
  }
  return false;
}

void LitPixels::add(const Light& other, const dvec3& weight, size_t part) {
  for (const size_t k : lights_of_part_[part]) light_.groups[k].add(weight, other.groups[k]);
  if (is_of_group(part)) return;
  light_.scattered += weight * other.scattered;
  for (size_t g = 0; g < light_.of_light_groups.size(); ++g)
    light_.of_light_groups[g] += weight * other.of_light_groups[g];
}

void LitPixels::add_mean_around(Place& own, const ivec2& pixel, int ray, int across, const std::vector<size_t>& parts) {
  double count = 0;
  constexpr int kParts = PixelRays::kParts * PixelRays::kParts;
  for (int i = 0; i < kParts; ++i) {
    Place beside = 2 * i + 1 == kParts ? Place() : place_along(march_.rays_.part(pixel, ray, across, i));
    Place& there = 2 * i + 1 == kParts ? own : beside;
    if (there.surface != own.surface || there.inside != own.inside) continue;
    if (told_apart() && there.known.empty()) look_around(there, &own);
    for (const size_t part : parts) add(lit(there, part), dvec3(1), part);
    ++count;
  }
  for (const size_t part : parts) {
    if (!is_of_group(part)) light_.scattered /= count;
    for (const size_t k : lights_of_part_[part]) {
      light_.groups[k].direct /= count;
      light_.groups[k].indirect /= count;
    }
  }
}

ivec2 LitPixels::first_of_square(const ivec2& pixel, int side) {
  return ivec2(glm::floor(dvec2(pixel) / static_cast<double>(side)) * static_cast<double>(side));
}

bool LitPixels::flat(const ivec2& first, int side, int ray, int across) {
  const Place& middle = this->middle(first, side, ray, across);
  if (!middle.surface) return false;
  for (int c = 0; c < 4; ++c) {
    const Place& there = corner(first, side, c, ray, across);
    const dvec3 to = there.p - middle.p;
    if (!there.alike(middle) || std::abs(glm::dot(to, middle.normal)) > kFlat * glm::length(to)) return false;
  }
  return true;
}

bool LitPixels::smooth(const ivec2& first, int side, int ray, int across, size_t part) {
  const auto [at, fresh] = squares_.try_emplace({first.x, first.y, side, ray});
  Square& square = at->second;
  if (fresh) {
    square.flat = flat(first, side, ray, across);
    square.smooth.resize(parts());
  }
  if (!square.flat) return false;
  std::optional<bool>& known = square.smooth[part];
  if (!known) known = find_smooth(first, side, ray, across, part);
  return *known;
}

bool LitPixels::find_smooth(const ivec2& first, int side, int ray, int across, size_t part) {
  Place& middle = this->middle(first, side, ray, across);
  const double all = whole(middle);
  const auto whole_of = [&](size_t of) {
    return is_of_group(of) ? std::max(middle.wholes[of], kLeastWhole * all) : all;
  };
  std::array<const Light*, 4> corners;
  for (int c = 0; c < 4; ++c) corners[static_cast<size_t>(c)] = &lit(corner(first, side, c, ray, across), part);
  const auto alike = [&](double whole, const auto& of) {
    const double here = in_colour(of(middle.light), kGrey);
    double mean = 0;
    for (const Light* const light : corners) {
      const double there = in_colour(of(*light), kGrey);
      if (std::abs(there - here) > kAlike * whole) return false;
      mean += 0.25 * there;
    }
    return std::abs(mean - here) <= kExact * whole;
  };
  if (!is_of_group(part)) {
    if (!alike(all, [](const Light& light) { return light.scattered; })) return false;
    for (size_t g = 0; is_of_group(g); ++g)
      if (!alike(whole_of(g), [&](const Light& light) { return light.of_light_groups[g]; })) return false;
  }
  for (const size_t k : lights_of_part_[part])
    if (!alike(whole_of(part), [&](const Light& light) { return light.groups[k].direct; }) ||
        !alike(whole_of(part), [&](const Light& light) { return light.groups[k].indirect; }))
      return false;
  return true;
}

double LitPixels::least_whole(const ivec2& pixel, int ray, int across) {
  const int side = kSides[std::size(kSides) - 1];
  Place& middle = this->middle(first_of_square(pixel, side), side, ray, across);
  return kLeastWhole * whole(middle.surface ? middle : place(pixel, ray, across));
}

bool LitPixels::add_between(const ivec2& pixel, int ray, int across, const SurfaceHit& hit, const ShadedPoint& at,
                            size_t part) {
  for (const int side : kSides) {
    const ivec2 first = first_of_square(pixel, side);
    if (!smooth(first, side, ray, across, part) || !middle(first, side, ray, across).fits(hit, at)) continue;
    const dvec2 f = dvec2(pixel - first) / static_cast<double>(side);
    for (int c = 0; c < 4; ++c)
      add(corner(first, side, c, ray, across).light, dvec3((c % 2 ? f.x : 1 - f.x) * (c / 2 ? f.y : 1 - f.y)), part);
    return true;
  }
  return false;
}

const LitPixels::Light& LitPixels::at(const ivec2& pixel, int ray, int across, const SurfaceHit& hit,
                                      const ShadedPoint& at) {
  if (across < PixelRays::kMostAcross) {
    light_ = no_light();
    std::vector<size_t> uneven, edges;
    for (size_t part = 0; part < parts(); ++part)
      if (!add_between(pixel, ray, across, hit, at, part)) uneven.push_back(part);
    if (uneven.empty()) return light_;
    Place& own = place(pixel, ray, across);
    for (const size_t part : uneven) {
      const double least = is_of_group(part) ? least_whole(pixel, ray, across) : 0;
      const bool hard = is_of_group(part) || !told_apart();  // light from all around has no edges
      const bool edge = hard && (at_shadow_edge(own, pixel, ray, across, part, least) ||
                                 differs_over_lens(own, pixel, ray, across, part, least));
      if (edge)
        edges.push_back(part);
      else
        add(lit(own, part), dvec3(1), part);
    }
    if (!edges.empty()) add_mean_around(own, pixel, ray, across, edges);
    return light_;
  }
  std::vector<Place>& known = at_edges_[{pixel.x, pixel.y}];
  const auto fits = [&](const Place& place) { return place.uses < kUses && place.fits(hit, at); };
  auto found = std::find_if(known.begin(), known.end(), fits);
  if (found == known.end()) found = known.insert(found, unlit(hit, at));
  for (size_t part = 0; part < parts(); ++part) lit(*found, part);
  ++found->uses;
  return found->light;
}

}  // namespace brume
