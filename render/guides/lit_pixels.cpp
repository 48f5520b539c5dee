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

void LitPixels::begin_tile() {
  places_.clear();
  smooth_.clear();
  at_edges_.clear();
}

bool LitPixels::Place::fits(const SurfaceHit& hit, const ShadedPoint& at) const {
  return surface == hit.surface && inside == at.inside && glm::dot(normal, at.normal) > kAlikeNormals;
}

bool LitPixels::Place::alike(const Place& other) const {
  return other.surface == surface && other.inside == inside && glm::dot(other.normal, normal) > kAlikeNormals;
}

LitPixels::Place LitPixels::lit(const SurfaceHit& hit, const ShadedPoint& at) const {
  Place place{hit.surface, at.inside, at.p, at.normal, {}};
  place.light.of_light_groups.resize(march_.fields_.groups());
  const SurfaceLight::Around around = march_.surfaces_.around(at, place.light.of_light_groups);
  place.light.scattered = around.scattered;
  for (const auto& group : march_.fields_.lights())
    place.light.groups.push_back(group->onto(march_.surfaces_, around, at.p, at.normal));
  place.wholes = wholes_of(place.light);
  return place;
}

size_t LitPixels::whole_of(size_t guide_light) const {
  const size_t groups = march_.fields_.groups();
  const int group = march_.fields_.lights()[guide_light]->group_number;
  return groups && group >= 0 ? static_cast<size_t>(group) : groups;
}

std::vector<double> LitPixels::wholes_of(const Light& light) const {
  std::vector<double> wholes;
  for (const dvec3& of_group : light.of_light_groups) wholes.push_back(in_colour(of_group, kGrey));
  double all = in_colour(light.scattered, kGrey);
  wholes.push_back(0);
  for (size_t k = 0; k < light.groups.size(); ++k) {
    const double from = in_colour(light.groups[k].direct + light.groups[k].indirect, kGrey);
    wholes[whole_of(k)] += from;
    all += from;
  }
  wholes.back() = all;
  for (double& whole : wholes) whole = std::max(whole, kLeastWhole * all);
  return wholes;
}

const LitPixels::Place& LitPixels::place(const ivec2& pixel, int ray, int across) {
  const auto [known, fresh] = places_.try_emplace({pixel.x, pixel.y, ray});
  if (fresh) known->second = place_along(march_.rays_.sample(pixel, ray, across));
  return known->second;
}

LitPixels::Place LitPixels::place_along(const CameraSample& sample) const {
  const Ray along = march_.rays_.ray(sample);
  const std::optional<SurfaceHit> hit = march_.rays_.first_hit(along);
  if (!hit || march_.context_.lights->nearest(along, hit->t, /*seen=*/true).first) return {};
  const ShadedPoint at(*march_.context_.surfaces, along, *hit);
  return at.diffuse() ? lit(*hit, at) : Place();
}

bool LitPixels::at_shadow_edge(const Place& own, const ivec2& pixel, int ray, int across) {
  for (const ivec2& step : {ivec2(1, 0), ivec2(0, 1)}) {
    const Place &before = place(pixel - step, ray, across), &behind = place(pixel + step, ray, across);
    if (!own.alike(before) || !own.alike(behind)) continue;
    for (size_t g = 0; g < own.wholes.size(); ++g) {
      const double a = before.wholes[g], b = behind.wholes[g], here = own.wholes[g];
      if (apart(here, 0.5 * (a + b), std::max({a, b, here}))) return true;
    }
  }
  return false;
}

bool LitPixels::differs_over_lens(const Place& own, const ivec2& pixel, int ray, int across) {
  if (across == 1 || !march_.rays_.has_lens()) return false;
  for (int other = 0; other < across * across; ++other) {
    if (other == ray) continue;
    const Place& there = place(pixel, other, across);
    if (!own.alike(there)) continue;
    for (size_t g = 0; g < own.wholes.size(); ++g)
      if (apart(own.wholes[g], there.wholes[g], std::max(own.wholes[g], there.wholes[g]))) return true;
  }
  return false;
}

LitPixels::Light LitPixels::mean_around(const Place& own, const ivec2& pixel, int ray, int across) const {
  Light sum{std::vector<Lit>(own.light.groups.size())};
  sum.of_light_groups.assign(own.light.of_light_groups.size(), dvec3(0));
  double count = 0;
  constexpr int kParts = PixelRays::kParts * PixelRays::kParts;
  for (int i = 0; i < kParts; ++i) {
    const Place there = 2 * i + 1 == kParts ? own : place_along(march_.rays_.part(pixel, ray, across, i));
    if (there.surface != own.surface || there.inside != own.inside) continue;
    sum.scattered += there.light.scattered;
    for (size_t k = 0; k < sum.groups.size(); ++k) sum.groups[k].add(dvec3(1), there.light.groups[k]);
    for (size_t g = 0; g < sum.of_light_groups.size(); ++g) sum.of_light_groups[g] += there.light.of_light_groups[g];
    ++count;
  }
  sum.scattered /= count;
  for (dvec3& light : sum.of_light_groups) light /= count;
  for (Lit& light : sum.groups) {
    light.direct /= count;
    light.indirect /= count;
  }
  return sum;
}

bool LitPixels::smooth(const ivec2& first, int side, int ray, int across) {
  const auto [known, fresh] = smooth_.try_emplace({first.x, first.y, side, ray}, false);
  if (!fresh) return known->second;
  const Place& middle = place(first + side / 2, ray, across);
  if (!middle.surface) return false;
  std::array<const Place*, 4> corners;
  for (int c = 0; c < 4; ++c) {
    const Place& corner = *(corners[static_cast<size_t>(c)] = &place(first + side * ivec2(c % 2, c / 2), ray, across));
    const dvec3 to = corner.p - middle.p;
    if (corner.surface != middle.surface || corner.inside != middle.inside ||
        glm::dot(corner.normal, middle.normal) < kAlikeNormals ||
        std::abs(glm::dot(to, middle.normal)) > kFlat * glm::length(to))
      return false;
  }
  const auto alike = [&](double whole, const auto& of) {
    const double here = of(middle.light);
    double mean = 0;
    for (const Place* const corner : corners) {
      const double there = of(corner->light);
      if (std::abs(there - here) > kAlike * whole) return false;
      mean += 0.25 * there;
    }
    return std::abs(mean - here) <= kExact * whole;
  };
  const std::vector<double>& wholes = middle.wholes;
  if (march_.fields_.groups() == 0 &&
      !alike(wholes.back(), [](const Light& light) { return in_colour(light.scattered, kGrey); }))
    return false;
  for (size_t g = 0; g < march_.fields_.groups(); ++g)
    if (!alike(wholes[g], [&](const Light& light) { return in_colour(light.of_light_groups[g], kGrey); })) return false;
  for (size_t k = 0; k < middle.light.groups.size(); ++k) {
    const double whole = wholes[whole_of(k)];
    if (!alike(whole, [&](const Light& light) { return in_colour(light.groups[k].direct, kGrey); }) ||
        !alike(whole, [&](const Light& light) { return in_colour(light.groups[k].indirect, kGrey); }))
      return false;
  }
  return known->second = true;
}

bool LitPixels::between(const ivec2& pixel, int ray, int across, const SurfaceHit& hit, const ShadedPoint& at) {
  for (const int side : kSides) {
    const ivec2 first(glm::floor(dvec2(pixel) / static_cast<double>(side)) * static_cast<double>(side));
    if (!smooth(first, side, ray, across) || !place(first + side / 2, ray, across).fits(hit, at)) continue;
    const dvec2 f = dvec2(pixel - first) / static_cast<double>(side);
    light_.groups.assign(march_.fields_.lights().size(), Lit());
    light_.scattered = dvec3(0);
    light_.of_light_groups.assign(march_.fields_.groups(), dvec3(0));
    for (int c = 0; c < 4; ++c) {
      const Light& corner = place(first + side * ivec2(c % 2, c / 2), ray, across).light;
      const dvec3 weight((c % 2 ? f.x : 1 - f.x) * (c / 2 ? f.y : 1 - f.y));
      light_.scattered += weight * corner.scattered;
      for (size_t k = 0; k < light_.groups.size(); ++k) light_.groups[k].add(weight, corner.groups[k]);
      for (size_t g = 0; g < light_.of_light_groups.size(); ++g)
        light_.of_light_groups[g] += weight * corner.of_light_groups[g];
    }
    return true;
  }
  return false;
}

const LitPixels::Light& LitPixels::at(const ivec2& pixel, int ray, int across, const SurfaceHit& hit,
                                      const ShadedPoint& at) {
  if (across < PixelRays::kMostAcross) {
    if (between(pixel, ray, across, hit, at)) return light_;
    const Place& own = place(pixel, ray, across);
    const bool edge = at_shadow_edge(own, pixel, ray, across) || differs_over_lens(own, pixel, ray, across);
    light_ = edge ? mean_around(own, pixel, ray, across) : own.light;
    return light_;
  }
  std::vector<Place>& known = at_edges_[{pixel.x, pixel.y}];
  const auto fits = [&](const Place& place) { return place.uses < kUses && place.fits(hit, at); };
  auto found = std::find_if(known.begin(), known.end(), fits);
  if (found == known.end()) found = known.insert(found, lit(hit, at));
  ++found->uses;
  return found->light;
}

}  // namespace brume
