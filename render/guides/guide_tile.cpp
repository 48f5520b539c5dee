#include "render/guides/guide_tile.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "render/guides/guide_layers.h"
#include "render/guides/ray_march.h"

namespace brume {
namespace {

// Transmittances of four rays that stand for sixteen differ by less.
constexpr double kAlike = 0.02;
// Where the darkest sky that a lens turns to a pixel is a smaller share of the brightest, so many show more of it;
// where the media are thicker, they cost too much.
constexpr double kAlikeSky = 0.95, kClear = 0.9;
// The same of a sky with nothing before it, where rays cost little.
constexpr double kEvenSky = 0.995;
// Highlights of a metal that differ from those of a pixel beside it by more, of all that both show, need sixteen rays.
constexpr double kHighlightEdge = 0.1;
// The same of light that media beside a small lamp scatter once.
constexpr double kBeamEdge = 0.1;

vec3 scaled(const dvec3& colour, double value) {
  return vec3(colour * value);
}

}  // namespace

GuideTile::GuideTile(const GuideMarch& march, DeepRecord* deep)
    : march_(march), lit_(march), mirrored_(march), deep_(deep), deep_rays_(deep ? kSide * kSide : 0) {
  for (int i = 0; i < kSide * kSide; ++i) pixels_.emplace_back(march.fields_.lights().size(), march.fields_.groups());
}

void GuideTile::record(const ivec2& corner, const ivec2& from, const ivec2& to, const GuideLayers& layers) {
  traced_.clear();
  lit_.begin_tile();
  mirrored_.begin_tile();
  const PixelRays& rays = march_.rays_;
  const int across = rays.across();
  std::vector<size_t> plain, at_edges;
  for (int y = from.y; y < to.y; ++y)
    for (int x = from.x; x < to.x; ++x) {
      const ivec2 at = corner + ivec2(x, y);
      const bool edge = !march_.sketch_ && march_.context_.surfaces && rays.shows_edge(at);
      (edge ? at_edges : plain).push_back(traced_.size());
      traced_.push_back({at});
    }
  trace(plain, across);
  if (across > 1 && rays.blurred())
    for (const size_t p : plain) {
      const Traced& found = traced_[p];
      if (rays.has_lens() && found.sky_alone) {
        if (found.darkest < kEvenSky * found.brightest) even_sky(p);
        continue;
      }
      const bool sky = !found.surface && found.least > kClear && found.darkest < kAlikeSky * found.brightest;
      if (sky || !(found.alike && found.most - found.least < kAlike)) at_edges.push_back(p);
    }
  if (!march_.sketch_)
    for (const size_t p : plain)
      if (pixels_[p].mirrored_edge && traced_[p].across == across) at_edges.push_back(p);
  if (!march_.sketch_) {
    find_highlight_edges(plain, to.x - from.x, at_edges);
    find_beams(plain, to.x - from.x, at_edges);
  }
  std::sort(at_edges.begin(), at_edges.end());
  at_edges.erase(std::unique(at_edges.begin(), at_edges.end()), at_edges.end());
  trace(at_edges, PixelRays::kMostAcross);

  size_t p = 0;
  for (int y = from.y; y < to.y; ++y)
    for (int x = from.x; x < to.x; ++x, ++p) {
      pixels_[p].collect(march_.fields_, march_.node_fields_);
      if (!pixels_[p].shares.empty()) find_shares(p);
      const auto count = static_cast<size_t>(traced_[p].across * traced_[p].across);
      layers.store(x, y, pixels_[p], 1.0 / static_cast<double>(count));
      if (deep_)
        deep_->store(traced_[p].at, march_.colour_,
                     deep_pixels_.of_rays(std::span(deep_rays_[p]).first(count),
                                          vec3(pixels_[p].mirrored + pixels_[p].mirrored_indirect),
                                          deep_->most(march_.colour_)));
    }
}

// Of the place that is seen on average: what surfaces send into media varies little along a ray.
void GuideTile::find_shares(size_t pixel) {
  GuideSums& sums = pixels_[pixel];
  std::fill(sums.shares.begin(), sums.shares.end(), vec3(0));
  if (!(sums.opacity > 0)) return;
  const Ray ray = march_.rays_.ray(march_.rays_.sample(traced_[pixel].at, 0, 1));
  std::vector<dvec3> shares(sums.shares.size());
  march_.fields_.surface_light()->shares(ray.at(march_.reference_depth_ + sums.depth / sums.opacity), shares);
  for (size_t g = 0; g < shares.size(); ++g) sums.shares[g] = vec3(shares[g]);
}

// The facets of a mesh each show their own part of a lamp: its highlight ends where they meet, within pixels.
void GuideTile::find_highlight_edges(const std::vector<size_t>& plain, int width, std::vector<size_t>& found) const {
  const auto brightness = [&](size_t p) {
    double sum = 0;
    for (const vec3& light : pixels_[p].surface) sum += in_colour(dvec3(light), kGrey);
    return sum;
  };
  const auto metal = [&](size_t p) {
    const bool known = traced_[p].least <= traced_[p].most;
    return known && pixels_[p].material[static_cast<int>(Bsdf::Kind::kConductor)] > 0;
  };
  for (const size_t p : plain) {
    if (!metal(p)) continue;
    for (const size_t beside : {p + 1, p + static_cast<size_t>(width)}) {
      const bool next = beside < traced_.size() && (beside != p + 1 || (p + 1) % static_cast<size_t>(width) != 0);
      if (!next || !metal(beside)) continue;
      const double a = brightness(p), b = brightness(beside);
      const double all = in_colour(pixels_[p].mirrored + pixels_[beside].mirrored, kGrey) + a + b;
      if (std::abs(a - b) > kHighlightEdge * all) found.insert(found.end(), {p, beside});
    }
  }
}

// Beside a spot its beam is as narrow as a pixel.
void GuideTile::find_beams(const std::vector<size_t>& plain, int width, std::vector<size_t>& found) const {
  const auto once = [&](size_t p) {
    double sum = 0;
    for (const MarchedLight& light : march_.scenes_[0].lights)
      if (!light.sun) sum += pixels_[p].groups[light.group].single;
    return sum;
  };
  for (const size_t p : plain) {
    if (!traced_[p].near_lamp) continue;
    for (const size_t beside : {p + 1, p + static_cast<size_t>(width)}) {
      const bool next = beside < traced_.size() && (beside != p + 1 || (p + 1) % static_cast<size_t>(width) != 0);
      if (!next) continue;
      const double a = once(p), b = once(beside);
      if (std::abs(a - b) > kBeamEdge * (a + b)) found.insert(found.end(), {p, beside});
    }
  }
}

void GuideTile::trace(const std::vector<size_t>& pixels, int across) {
  if (pixels.empty()) return;
  for (const size_t p : pixels) {
    pixels_[p].clear();
    traced_[p] = {traced_[p].at, across};
  }
  for (int ray = 0; ray < across * across; ++ray) trace_rays(pixels, ray, across);
}

void GuideTile::trace_rays(const std::vector<size_t>& pixels, int ray, int across) {
  rays_.clear();
  batch_.clear();
  batch_.deep = deep_ != nullptr;
  const double time = march_.rays_.sample(traced_[pixels[0]].at, ray, across).time;
  const MarchScene& scene = march_.scenes_[static_cast<size_t>(time * static_cast<double>(march_.scenes_.size()))];
  for (const size_t p : pixels) begin(p, ray, march_.rays_.sample(traced_[p].at, ray, across), scene);
  march_rays(scene, {march_.node_fields_.table(), &march_.node_fields_.slots(), /*octaves=*/true}, batch_);
  for (size_t i = 0; i < rays_.size(); ++i) end(rays_[i], batch_.rays[i]);
  mirrored_.follow(scene);
}

// The first surface or light that is seen ends a ray.
void GuideTile::begin(size_t pixel, int number, const CameraSample& sample, const MarchScene& scene) {
  const Ray ray = march_.rays_.ray(sample);
  const std::optional<SurfaceHit> hit = march_.rays_.first_hit(ray);
  const auto [light, distance] = march_.context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/true);
  rays_.push_back({pixel, number, sample, hit, light, distance});
  const double t_max = light ? distance : hit ? hit->t : kFar;
  MarchedRay& marched =
      scene.aim({ray, t_max, pixels_[pixel], sample.stride, sample.offset}, march_.fields_.lattice(), batch_);
  traced_[pixel].near_lamp |= marched.lamps > 0 && !marched.misses();
  if (!deep_) return;
  std::vector<DeepRay>& deep = deep_rays_[pixel];
  if (deep.size() <= static_cast<size_t>(number)) deep.emplace_back();
  DeepRay& own = deep[static_cast<size_t>(number)];
  own.begin();
  marched.deep = &own.media;
  marched.tint = march_.tint_;
  const auto depth = [&](double t) { return march_.rays_.depth(sample, ray.at(t)); };
  own.z = depth(marched.start);
  own.z_per_step = depth(marched.start + scene.steps.length) - own.z;
  if (light || hit) own.end_z = depth(light ? distance : hit->t);
}

// Adds what the march found, and what ends the ray. Behind a holdout there is nothing.
void GuideTile::end(const CameraRay& ray, const MarchedRay& marched) {
  GuideSums& sums = pixels_[ray.pixel];
  const double transmittance = marched.transmittance;
  if (marched.opacity > 0) add_media(marched, sums);
  const vec3 before = sums.background;
  DeepRay* const deep = deep_ ? &deep_rays_[ray.pixel][static_cast<size_t>(ray.number)] : nullptr;
  if (deep && march_.media_[0].holdouts()) {
    deep->left = 1 - marched.opacity;
    deep->held = std::max(deep->left - marched.transmittance, 0.0f);
  } else if (deep) {
    deep->left = marched.transmittance;
  }
  if (ray.light) {
    sums.background += scaled(ray.light->radiance(marched.ray, ray.distance), transmittance);
    if (deep) deep->end = DeepRay::End::kLight;
  } else if (!ray.hit) {
    for (const InfiniteLight* sky : march_.context_.lights->infinite())
      if (sky->visible()) sums.background += scaled(sky->radiance(marched.ray.d), transmittance);
  } else if (march_.context_.surfaces->settings(ray.hit->surface).role != "holdout") {
    const vec3 light = add_surface(ray, marched, sums);
    if (deep) {
      deep->end = DeepRay::End::kSurface;
      deep->surface = ray.hit->surface;
      deep->light = light;
      if (march_.context_.surfaces->settings(ray.hit->surface).material != "diffuse")
        deep->mirrors = marched.scaled_transmittance;
    }
  }
  if (deep) deep->light += sums.background - before;
  Traced& pixel = traced_[ray.pixel];
  const std::optional<uint32_t> surface = ray.hit && !ray.light ? std::optional(ray.hit->surface) : std::nullopt;
  const bool first_ray = pixel.most < pixel.least;
  if (first_ray) pixel.surface = surface;
  pixel.alike = pixel.alike && surface == pixel.surface;
  pixel.least = std::min(pixel.least, transmittance);
  pixel.most = std::max(pixel.most, transmittance);
  pixel.sky_alone = pixel.sky_alone && !ray.hit && !ray.light && marched.misses();
  if (ray.hit || ray.light) return;
  const double sky = in_colour(dvec3(sums.background - before), kGrey);
  pixel.darkest = std::min(pixel.darkest, sky);
  pixel.brightest = std::max(pixel.brightest, sky);
}

void GuideTile::even_sky(size_t pixel) {
  const int count = traced_[pixel].across * traced_[pixel].across;
  vec3 mean(0);
  for (int i = 0; i < PixelRays::kSkyRays; ++i) {
    const dvec3 d = march_.rays_.sky_ray(traced_[pixel].at, i).d;
    for (const InfiniteLight* sky : march_.context_.lights->infinite())
      if (sky->visible()) mean += scaled(sky->radiance(d), 1.0 / PixelRays::kSkyRays);
  }
  pixels_[pixel].background = mean * static_cast<float>(count);
  if (!deep_) return;
  for (int ray = 0; ray < count; ++ray) deep_rays_[pixel][static_cast<size_t>(ray)].light = mean;
}

void GuideTile::add_media(const MarchedRay& marched, GuideSums& sums) const {
  const double opacity = marched.opacity, step = march_.scenes_[0].steps.length;
  // Of the distance from the reference depth: the part up to where anything was seen first, and what lies behind.
  const double first = marched.start + step * marched.first - march_.reference_depth_;
  const double behind = step * marched.distance;
  sums.opacity += opacity;
  sums.depth += first * opacity + behind;
  sums.depth2 += first * first * opacity + 2 * first * behind + step * step * marched.distance2;
  sums.density += marched.density;
  sums.gradient += dvec3(marched.gradient);
}

vec3 GuideTile::add_surface(const CameraRay& ray, const MarchedRay& marched, GuideSums& sums) {
  const ShadedPoint at(*march_.context_.surfaces, marched.ray, *ray.hit);
  const double transmittance = marched.transmittance,
               peaks = std::max(0.0, static_cast<double>(marched.scaled_transmittance) - transmittance);
  sums.normal += scaled(at.normal, transmittance);
  sums.surface_albedo += scaled(at.bsdf.albedo, transmittance);
  sums.surface_depth += transmittance * (ray.hit->t - march_.reference_depth_);
  sums.material[static_cast<int>(at.bsdf.kind)] += static_cast<float>(transmittance);
  sums.background += scaled(march_.context_.surfaces->emitted(*ray.hit, !at.inside), transmittance);
  vec3 light = add_reflected(ray, at, transmittance, peaks, sums);
  if (at.gloss) light += add_reflected(ray, at.with(*at.gloss), transmittance, peaks, sums);
  return light;
}

vec3 GuideTile::add_reflected(const CameraRay& ray, const ShadedPoint& at, double transmittance, double peaks,
                              GuideSums& sums) {
  const Traced& pixel = traced_[ray.pixel];
  const LitPixels::Light* const lit =
      at.diffuse() ? &lit_.at(pixel.at, ray.number, pixel.across, *ray.hit, at) : nullptr;
  dvec3 indirect = lit ? at.bsdf.albedo * lit->scattered : dvec3(0), leaving(0);
  const auto add_to_group = [&](size_t group, const dvec3& direct_light, const dvec3& indirect_light) {
    sums.from_surfaces[group] += scaled(indirect_light, transmittance) + scaled(direct_light + indirect_light, peaks);
  };
  for (size_t g = 0; lit && g < sums.from_surfaces.size(); ++g)
    add_to_group(g, dvec3(0), at.bsdf.albedo * lit->of_light_groups[g]);
  for (size_t k = 0; k < sums.groups.size() && !at.bsdf.delta(); ++k) {
    Lit light;
    if (lit)
      light.add(at.bsdf.albedo, lit->groups[k]);
    else
      light = march_.surfaces_.light_on(at, {}, *march_.fields_.lights()[k]);
    sums.surface[k] += scaled(light.direct, transmittance);
    leaving += light.direct;
    indirect += light.indirect;
    const int group = march_.fields_.lights()[k]->group_number;
    if (group >= 0 && !sums.from_surfaces.empty())
      add_to_group(static_cast<size_t>(group), light.direct, light.indirect);
  }
  sums.indirect += scaled(indirect, transmittance);
  sums.behind += scaled(leaving + indirect, peaks);
  if (!at.diffuse()) mirrored_.start(ray.sample, at, *ray.hit, transmittance, peaks, sums);
  return scaled(leaving + indirect, transmittance + peaks);
}

}  // namespace brume
