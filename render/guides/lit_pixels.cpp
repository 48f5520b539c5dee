#include "render/guides/lit_pixels.h"

#include <algorithm>
#include <cmath>

namespace brume {
namespace {

constexpr int kSides[] = {8, 4};        // of squares [px], the ones that are tried first
constexpr int kUses = 4;                // rays of a pixel that share light
constexpr double kAlikeNormals = 0.98;  // cosine
constexpr double kFlat = 0.15;          // distance off the middle's plane, of that from the middle
// Of all light in the middle: what corners may differ by, and what lies between them may be wrong by, in each group.
constexpr double kAlike = 0.4, kExact = 0.02;
// What light differs by from what lies between the pixels on either side, of the largest, where shadows end, and the
// points across that it is then found at.
constexpr double kShadowEdge = 0.1;
constexpr int kEdgeAcross = 3;

}  // namespace

void LitPixels::begin_tile() {
  places_.clear();
  smooth_.clear();
  at_edges_.clear();
}

bool LitPixels::Place::fits(const SurfaceHit& hit, const ShadedPoint& at) const {
  return surface == hit.surface && inside == at.inside && glm::dot(normal, at.normal) > kAlikeNormals;
}

LitPixels::Place LitPixels::lit(const SurfaceHit& hit, const ShadedPoint& at) const {
  Place place{hit.surface, at.inside, at.p, at.normal, {}};
  const SurfaceLight::Around around = march_.surfaces_.around(at);
  place.light.scattered = around.scattered;
  for (const auto& group : march_.fields_.lights())
    place.light.groups.push_back(group->onto(march_.surfaces_, around, at.p, at.normal));
  return place;
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
  const auto all = [](const Place& place) {
    double sum = in_colour(place.light.scattered, kGrey);
    for (const Lit& light : place.light.groups) sum += in_colour(light.direct + light.indirect, kGrey);
    return sum;
  };
  const auto alike = [&](const Place& other) {
    return other.surface == own.surface && other.inside == own.inside &&
           glm::dot(other.normal, own.normal) > kAlikeNormals;
  };
  const double here = all(own);
  for (const ivec2& step : {ivec2(1, 0), ivec2(0, 1)}) {
    const Place &before = place(pixel - step, ray, across), &behind = place(pixel + step, ray, across);
    if (!alike(before) || !alike(behind)) continue;
    const double a = all(before), b = all(behind);
    if (std::abs(0.5 * (a + b) - here) > kShadowEdge * std::max({a, b, here})) return true;
  }
  return false;
}

LitPixels::Light LitPixels::mean_around(const Place& own, const ivec2& pixel, int ray, int across) const {
  Light sum{std::vector<Lit>(own.light.groups.size())};
  double count = 0;
  for (int i = 0; i < kEdgeAcross * kEdgeAcross; ++i) {
    CameraSample sample = march_.rays_.sample(pixel, ray, across);
    const dvec2 point = (dvec2(i % kEdgeAcross, i / kEdgeAcross) + 0.5) / static_cast<double>(kEdgeAcross);
    sample.film += sample.cell * (point - 0.5);
    const Place there = 2 * i + 1 == kEdgeAcross * kEdgeAcross ? own : place_along(sample);
    if (there.surface != own.surface || there.inside != own.inside) continue;
    sum.scattered += there.light.scattered;
    for (size_t k = 0; k < sum.groups.size(); ++k) sum.groups[k].add(dvec3(1), there.light.groups[k]);
    ++count;
  }
  sum.scattered /= count;
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
  double all = in_colour(middle.light.scattered, kGrey);
  for (const Lit& light : middle.light.groups) all += in_colour(light.direct + light.indirect, kGrey);
  const auto alike = [&](const auto& of) {
    const double here = of(middle.light);
    double mean = 0;
    for (const Place* const corner : corners) {
      const double there = of(corner->light);
      if (std::abs(there - here) > kAlike * all) return false;
      mean += 0.25 * there;
    }
    return std::abs(mean - here) <= kExact * all;
  };
  if (!alike([](const Light& light) { return in_colour(light.scattered, kGrey); })) return false;
  for (size_t k = 0; k < middle.light.groups.size(); ++k)
    if (!alike([&](const Light& light) { return in_colour(light.groups[k].direct, kGrey); }) ||
        !alike([&](const Light& light) { return in_colour(light.groups[k].indirect, kGrey); }))
      return false;
  return known->second = true;
}

bool LitPixels::between(const ivec2& pixel, int ray, int across, const SurfaceHit& hit, const ShadedPoint& at) {
  for (const int side : kSides) {
    const ivec2 first(glm::floor(dvec2(pixel) / static_cast<double>(side)) * static_cast<double>(side));
    if (!smooth(first, side, ray, across) || !place(first + side / 2, ray, across).fits(hit, at)) continue;
    const dvec2 f = dvec2(pixel - first) / static_cast<double>(side);
    light_.groups.assign(march_.fields_.lights().size(), Lit());
    light_.scattered = dvec3(0);
    for (int c = 0; c < 4; ++c) {
      const Light& corner = place(first + side * ivec2(c % 2, c / 2), ray, across).light;
      const dvec3 weight((c % 2 ? f.x : 1 - f.x) * (c / 2 ? f.y : 1 - f.y));
      light_.scattered += weight * corner.scattered;
      for (size_t k = 0; k < light_.groups.size(); ++k) light_.groups[k].add(weight, corner.groups[k]);
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
    light_ = at_shadow_edge(own, pixel, ray, across) ? mean_around(own, pixel, ray, across) : own.light;
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
