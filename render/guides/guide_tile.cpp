#include "render/guides/guide_tile.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "render/guides/guide_layers.h"

namespace brume {
namespace {

constexpr double kFar = 1e30;
// Transmittances of four rays that stand for sixteen differ by less.
constexpr double kAlike = 0.02;
// Rays count their steps from a multiple of so many, so that theirs and those of longer strides lie alike in all rays.
constexpr double kCountedSteps = 6;

void set_place(MarchedRay::Place& place, const dvec3& start, const dvec3& along) {
  for (int a = 0; a < 3; ++a) {
    place.start[a] = static_cast<float>(start[a]);
    place.along[a] = static_cast<float>(along[a]);
  }
}

}  // namespace

GuideMarch::Tile::Tile(const GuideMarch& march) : march_(march) {
  for (int i = 0; i < kSide * kSide; ++i) pixels_.emplace_back(march);
  for (const GuideMedia& media : march.media_) lines_.emplace_back(media, march.colour_);
}

void GuideMarch::Tile::record(const ivec2& corner, const ivec2& from, const ivec2& to, int across,
                              const GuideLayers& layers) {
  traced_.clear();
  std::vector<size_t> plain, at_edges;
  for (int y = from.y; y < to.y; ++y)
    for (int x = from.x; x < to.x; ++x) {
      const ivec2 at = corner + ivec2(x, y);
      const bool edge =
          !march_.sketch_ && march_.context_.surfaces && across < kMostRaysAcross && march_.shows_edge(at);
      (edge ? at_edges : plain).push_back(traced_.size());
      traced_.push_back({at});
    }
  trace(plain, across);
  if (across == 2 && march_.blurred())
    for (const size_t p : plain)
      if (!(traced_[p].alike && traced_[p].most - traced_[p].least < kAlike)) at_edges.push_back(p);
  trace(at_edges, kMostRaysAcross);

  size_t p = 0;
  for (int y = from.y; y < to.y; ++y)
    for (int x = from.x; x < to.x; ++x, ++p) {
      GuideSums& sums = pixels_[p].sums;
      march_.collect_fields(sums);
      if (sums.opacity > 0) {
        const double mean = sums.depth / sums.opacity;
        sums.spread = sums.opacity * std::sqrt(std::max(0.0, sums.depth2 / sums.opacity - mean * mean));
      }
      layers.store(x, y, sums, march_.predicted_direct(sums), march_.predicted_indirect(sums),
                   1.0 / (traced_[p].across * traced_[p].across));
    }
}

void GuideMarch::Tile::trace(const std::vector<size_t>& pixels, int across) {
  if (pixels.empty()) return;
  for (const size_t p : pixels) {
    pixels_[p].sums.clear();
    traced_[p] = {traced_[p].at, across};
  }
  for (int ray = 0; ray < across * across; ++ray) trace_rays(pixels, ray, across);
}

void GuideMarch::Tile::trace_rays(const std::vector<size_t>& pixels, int ray, int across) {
  rays_.clear();
  marched_.clear();
  parts_.clear();
  uneven_.clear();
  const double time = march_.eye(traced_[pixels[0]].at, ray, across).time;
  const auto moment = static_cast<size_t>(time * static_cast<double>(march_.media_.size()));
  media_ = &march_.media_[moment];
  for (const size_t p : pixels) begin(p, march_.eye(traced_[p].at, ray, across));
  march_rays(march_.scene_at(moment), marched_, parts_, *this);
  for (size_t i = 0; i < rays_.size(); ++i) end(rays_[i], marched_[i]);
}

void GuideMarch::Tile::begin(size_t pixel, const Eye& eye) {
  CameraRay& ray = rays_.emplace_back(
      CameraRay{pixel, eye, march_.camera_.ray(eye.film, eye.lens, eye.time), std::nullopt, nullptr, 0});
  MarchedRay& marched = marched_.emplace_back();
  marched.stride = static_cast<float>(eye.stride);
  marched.offset = static_cast<float>(eye.offset);
  const double t_max = find_end(ray);
  set_parts(ray, marched, t_max);
  if (marched.first_part == marched.last_part) return;
  set_places(ray, marched);
  if (march_.scene_at(march_.time_of(*media_)).grids.empty()) {
    pixels_[pixel].line.emplace(*media_, march_.colour_);
    pixels_[pixel].line->follow(ray.ray);
  }
}

// The first surface or light that is seen. Behind a holdout there is nothing.
double GuideMarch::Tile::find_end(CameraRay& ray) const {
  ray.hit = march_.first_seen(ray.ray);
  std::tie(ray.light, ray.distance) =
      march_.context_.lights->nearest(ray.ray, ray.hit ? ray.hit->t : kFar, /*seen=*/true);
  ray.in_hole = ray.hit && !ray.light && march_.context_.surfaces->settings(ray.hit->surface).role == "holdout";
  return ray.light ? ray.distance : ray.hit ? ray.hit->t : kFar;
}

void GuideMarch::Tile::set_parts(CameraRay& ray, MarchedRay& marched, double t_max) {
  media_->intervals(ray.ray, t_max, intervals_);
  const double step = march_.step_;
  if (!intervals_.empty()) ray.start = std::floor(intervals_[0].first / (kCountedSteps * step)) * kCountedSteps * step;
  marched.first_part = static_cast<uint32_t>(parts_.size() / 2);
  for (const auto& [from, to] : intervals_) {
    const auto first = static_cast<float>((from - ray.start) / step),
               last = static_cast<float>((to - ray.start) / step);
    if (first < last) parts_.insert(parts_.end(), {first, last});
  }
  marched.last_part = static_cast<uint32_t>(parts_.size() / 2);
  if (march_.even_stride_ > 1) media_->uneven_intervals(ray.ray, t_max, uneven_.emplace_back());
}

void GuideMarch::Tile::set_places(const CameraRay& ray, MarchedRay& marched) {
  const double step = march_.step_;
  const size_t moment = march_.time_of(*media_);
  const MarchScene& scene = march_.scene_at(moment);
  for (size_t i = 0; i < scene.grids.size(); ++i) {
    const Ray local = media_->media()[i].to_local(ray.ray);
    set_place(marched.grid[i], local.at(ray.start), step * local.d);
  }
  Pixel& pixel = pixels_[ray.pixel];
  const Lattice& nodes = march_.fields_.lattice();
  set_place(marched.nodes, nodes.to_lattice(ray.ray.at(ray.start)), step / nodes.spacing * ray.ray.d);
  marched.plain = pixel.sums.plain.data();
  marched.scaled = pixel.sums.scaled.data();
  marched.groups = pixel.sums.fields.data();
  for (size_t k = 0, sun = 0; k < pixel.views.size(); ++k) {
    pixel.views[k].g = std::numeric_limits<double>::quiet_NaN();
    const SolvedLight& light = march_.fields_.lights()[k];
    if (!light.group.sun || scene.suns.empty()) continue;
    march_.look_from(*media_, glm::dot(light.group.sun->axis(), ray.ray.d), media_->mean_cosine(0), 1, k, pixel);
    MarchedRay::Sun& to = marched.sun[sun++];
    const SunDepth::Line line = light.sun[moment].line(ray.ray);
    set_place(to.place, line.start + ray.start * line.along, step * line.along);
    std::copy(pixel.views[k].phase.begin(), pixel.views[k].phase.end(), to.phase);
    const std::array<double, 8> peak = pixel.views[k].peak.coefficients();
    std::copy(peak.begin(), peak.end(), to.peak);
  }
}

// Adds what the march found, and what ends the ray.
void GuideMarch::Tile::end(const CameraRay& ray, const MarchedRay& marched) {
  GuideSums& sums = pixels_[ray.pixel].sums;
  const double straight = marched.passed;
  if (marched.seen > 0) {
    const double seen = marched.seen, step = march_.step_;
    // Of the distance from the reference depth: the part up to where anything was seen first, and what lies behind.
    const double first = ray.start + step * marched.first - march_.reference_depth_;
    const double behind = step * marched.distance;
    sums.opacity += seen;
    sums.depth += first * seen + behind;
    sums.depth2 += first * first * seen + 2 * first * behind + step * step * marched.distance2;
    sums.density += marched.density;
    sums.gradient += dvec3(marched.gradient[0], marched.gradient[1], marched.gradient[2]);
    for (size_t k = 0, sun = 0; k < sums.groups.size(); ++k) {
      if (!march_.fields_.lights()[k].group.sun || march_.scene_at(march_.time_of(*media_)).suns.empty()) continue;
      const MarchedRay::SunLight& light = marched.light[sun++];
      GroupSums& group = sums.groups[k];
      group.single += light.single;
      group.forward += light.forward;
      for (size_t i = 0; i < 3; ++i) group.octave[i] += light.octave[i];
      for (size_t i = 0; i < 4; ++i) group.soft[i] += light.soft[i];
    }
  }
  if (ray.light) {
    sums.background += vec3(ray.light->radiance(ray.ray, ray.distance) * straight);
  } else if (ray.hit && !ray.in_hole) {
    const double peaks = std::max(0.0, static_cast<double>(marched.passed_scaled) - straight);
    march_.add_surface(ray.eye, ray.ray, *ray.hit, {straight, peaks}, *media_, lines_[march_.time_of(*media_)], sums);
  } else if (!ray.in_hole) {
    for (const InfiniteLight* sky : march_.context_.lights->infinite())
      if (sky->visible()) sums.background += vec3(sky->radiance(ray.ray.d) * straight);
  }
  Traced& pixel = traced_[ray.pixel];
  const std::optional<uint32_t> surface = ray.hit && !ray.light ? std::optional(ray.hit->surface) : std::nullopt;
  const bool first_ray = pixel.most < pixel.least;
  if (first_ray) pixel.surface = surface;
  pixel.alike = pixel.alike && surface == pixel.surface;
  pixel.least = std::min(pixel.least, straight);
  pixel.most = std::max(pixel.most, straight);
}

GuideMarch::Piece GuideMarch::Tile::piece_of(const CameraRay& ray, const MarchedPiece& p) const {
  const double thickness = p.thickness;
  const dvec3 tint(p.tint[0], p.tint[1], p.tint[2]);
  return {p.w,
          p.w2,
          p.w4,
          p.w8,
          p.scaled,
          thickness,
          ray.start + march_.step_ * (p.distance / thickness),
          p.depth / thickness,
          p.albedo / thickness,
          p.g / thickness,
          p.albedo > 0 ? tint / static_cast<double>(p.albedo) : dvec3(1)};
}

RayMarchHost::Point GuideMarch::Tile::look(size_t i, float t) {
  const CameraRay& ray = rays_[i];
  const double step = march_.step_;
  dvec3 gradient;
  const GuideMedia::Point found = pixels_[ray.pixel].line->at(ray.start + step * t, gradient);
  Point point{static_cast<float>(step * found.sigma_t), static_cast<float>(found.density),
              static_cast<float>(found.albedo), static_cast<float>(found.g)};
  for (int a = 0; a < 3; ++a) {
    point.tint[a] = static_cast<float>(found.tint[a]);
    point.gradient[a] = static_cast<float>(step * step * gradient[a]);
  }
  return point;
}

float GuideMarch::Tile::even_steps(size_t i, float t, float end) {
  const double step = march_.step_, from = rays_[i].start + step * t;
  double to = rays_[i].start + step * end;
  for (const auto& [begin, after] : uneven_[i])
    if (after > from) {
      to = std::min(to, begin);
      break;
    }
  return static_cast<float>(std::min(march_.even_stride_, std::floor((to - from) / (step * rays_[i].eye.stride))));
}

void GuideMarch::Tile::emit(size_t i, float t, float straight, float scaled, float depth) {
  const dvec3 emission = media_->emission(point(rays_[i], t));
  if (emission != dvec3(0))
    march_.add_emission(emission, march_.step_ * straight, march_.step_ * scaled, depth, pixels_[rays_[i].pixel].sums);
}

float GuideMarch::Tile::sun_visible(size_t i, size_t sun, float t) {
  for (const SolvedLight& light : march_.fields_.lights())
    if (light.group.sun && sun-- == 0)
      return interpolated(march_.fields_.lattice(), light.visible, march_.in_light(*media_, point(rays_[i], t)));
  return 1;
}

void GuideMarch::Tile::light(size_t i, const MarchedPiece& marched) {
  const CameraRay& ray = rays_[i];
  const bool suns = march_.scene_at(march_.time_of(*media_)).suns.empty();
  const Piece piece = piece_of(ray, marched);
  for (size_t k = 0; k < march_.fields_.lights().size(); ++k) {
    const LightGroup& group = march_.fields_.lights()[k].group;
    if (group.sharp() && (suns || !group.sun)) march_.add_sharp_light(piece, *media_, ray.ray, k, pixels_[ray.pixel]);
  }
}

void GuideMarch::Tile::fields(size_t i, const MarchedPiece& piece) {
  march_.add_fields(piece_of(rays_[i], piece), *media_, rays_[i].ray, pixels_[rays_[i].pixel]);
}

}  // namespace brume
