#include "render/guides/guide_march.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/attenuation.h"
#include "render/guides/guide_layers.h"
#include "render/guides/guide_pixel.h"

namespace brume {
namespace {

// Of the largest density in a voxel: gradients below it count less, because their direction means little.
constexpr double kGentleGradient = 0.03;
constexpr double kStepGrowth = 0.25;  // of the step for each free path behind the eye's first ones
constexpr double kGrowingDepth = 2, kLongestStep = 4;
// Of a step where a pixel has several rays, as far as the medium at the last one was thinner than this.
constexpr double kManyRaysStride = 1.5, kThinStep = 0.03;
constexpr double kSketchStride = 2;  // of all steps
// The same at most, where all media are homogeneous and no lamp is near, as far as such a step is as thin as this.
constexpr double kEvenStride = 4, kEvenThickness = 0.02;
// Transmittances of four rays that stand for sixteen differ by less.
constexpr double kAlike = 0.02;
// What shares one look at the light: as many first steps, of no more extinction than this.
constexpr double kLightSteps = 2, kLightThickness = 0.12;
// What shares one look at the fields of nodes: as much of the way between nodes, of no more extinction than this.
constexpr double kNodesPerLook = 0.5, kNodeThickness = 0.5;
constexpr double kOpaque = 2e-3;  // transmittance of an eighth of the extinction at which a ray ends
constexpr double kFar = 1e30;
constexpr double kNarrow = 0.99;     // mean cosine of directions that count as one
constexpr int kMostRaysAcross = 4;   // of a pixel that shows the edge of a surface or light
constexpr double kEdgeCosine = 0.9;  // between the normals at a pixel's corners
constexpr int kTile = 16;            // px
constexpr int kMostUnseen = 8;       // surfaces that a camera ray goes through
constexpr size_t kOrders = SolvedLight::kFirstOrder.size();

double henyey_greenstein(double g, double c) {
  return HenyeyGreenstein{g}.value(c);
}

vec3 tinted(const dvec3& colour, double value) {
  return vec3(colour * value);
}

}  // namespace

GuideMarch::GuideMarch(const PathContext& context, const std::vector<GuideMedia>& media, const LightFields& fields,
                       GuideColour colour, const Camera& camera, double step_voxels, bool sketch)
    : context_(context),
      media_(media),
      fields_(fields),
      colour_(colour),
      camera_(camera),
      sketch_(sketch),
      step_((sketch ? kSketchStride : 1) * step_voxels * media[0].voxel()),
      node_fields_(fields, media[0], colour) {
  const dvec3 middle = 0.5 * (media[0].lo() + media[0].hi());
  reference_depth_ = glm::distance(camera.ray(dvec2(0)).o, middle);
  double densest = 0;
  for (const Medium& m : media[0].media())
    densest = std::max(densest, m.maximum_density() * in_colour(m.coefficients().sigma_t, colour));
  gentle_ = std::max(kGentleGradient * densest / media[0].voxel(), 1e-300);
  double even = 0;
  for (const Medium& m : media[0].media())
    if (m.homogeneous()) even += in_colour(m.coefficients().sigma_t, colour);
  if (even > 0) even_stride_ = std::clamp(kEvenThickness / (even * step_), 1.0, kEvenStride);
  for (const SolvedLight& g : fields.lights())
    if (g.group.kind == LightGroup::Kind::kLocal) even_stride_ = 1;
  if (colour == kGrey && !media[0].media().empty()) tint_ = OrderTint(media[0].tint(0));
  // Of light of many tints, that of suns and of nodes are coloured together.
  if (!media[0].mixed_tints()) look_apart_ = kNodesPerLook * fields.lattice().spacing;
}

bool GuideMarch::blurred() const {
  return camera_.has_lens() || camera_.moves() || media_.size() > 1;
}

int GuideMarch::rays_across() const {
  if (blurred()) return 2;
  const dvec3 middle = 0.5 * (media_[0].lo() + media_[0].hi());
  const dvec2 pixel = 0.5 * dvec2(camera_.film_size());
  const Ray a = camera_.ray(pixel), b = camera_.ray(pixel + 1.0);
  const double distance = glm::distance(a.o, middle);
  return glm::distance(a.at(distance), b.at(distance)) > 0.75 * std::sqrt(2.0) * media_[0].voxel() ? 2 : 1;
}

void GuideMarch::record(const ivec2& corner, Layers& frame, const Task& task) {
  node_fields_.fill(camera_, task);
  gather_light(task);
  const GuideLayers layers(frame, fields_.lights(), colour_,
                           {.emission = !media_[0].emissions().empty(),
                            .surfaces = context_.surfaces != nullptr,
                            .mirrors = !node_light_.empty()});
  const int across = sketch_ ? 1 : rays_across();
  // Rays of a square of pixels cross the same bricks and nodes.
  const ivec2 size(frame.width(), frame.height()), tiles = (size + kTile - 1) / kTile;
  parallel_for(tiles.x * tiles.y, task, [&](int tile) {
    Pixel pixel(*this);
    GuideSums& sums = pixel.sums;
    const ivec2 from = kTile * ivec2(tile % tiles.x, tile / tiles.x), to = glm::min(from + kTile, size);
    for (int y = from.y; y < to.y; ++y)
      for (int x = from.x; x < to.x; ++x) {
        const int rays = trace_pixel(corner + ivec2(x, y), across, pixel);
        collect_fields(sums);
        if (sums.opacity > 0) {
          const double mean = sums.depth / sums.opacity;
          sums.spread = sums.opacity * std::sqrt(std::max(0.0, sums.depth2 / sums.opacity - mean * mean));
        }
        layers.store(x, y, sums, predicted_direct(sums), predicted_indirect(sums), 1.0 / rays);
      }
  });
}

GuideMarch::Eye GuideMarch::eye(const ivec2& pixel, int ray, int across) const {
  Eye eye;
  eye.cell = 1.0 / across;
  eye.film = dvec2(pixel) + eye.cell * (dvec2(ray % across, ray / across) + 0.5);
  if (sketch_) eye.time = 0.5;
  if (across == 1) return eye;
  eye.stride = kManyRaysStride;
  if (!blurred()) {
    eye.offset = ray % 4 / 4.0;
  } else if (across == 2) {
    // Opposite sides of the lens, as far from its middle as its points are on average.
    eye.lens = dvec2(0.5) + 0.35 * (dvec2(ray * 2 / 4, ray % 2) * 2.0 - 1.0);
    eye.time = ((ray * 3 + 1) % 4 + 0.5) / 4;
    eye.offset = ray / 4.0;
  } else {
    // Sixteen points of the lens and as many times, in an order unlike the rays'.
    eye.lens = (dvec2(ray * 7 % 16, ray * 11 % 16) + 0.5) / 16.0;
    eye.time = ((ray * 5 + 3) % 16 + 0.5) / 16;
    eye.offset = ray * 3 % 16 / 16.0;
  }
  return eye;
}

bool GuideMarch::shows_edge(const ivec2& pixel) const {
  std::optional<SurfaceHit> first;
  const FiniteLight* first_light = nullptr;
  // Through the rim of a lens, and at both ends of the shutter.
  for (int corner = 0; corner < 4; ++corner) {
    const dvec2 square(corner % 2, corner / 2);
    const Ray ray = camera_.ray(dvec2(pixel) + square, square, corner == 0 || corner == 3 ? 0.0 : 1.0);
    const std::optional<SurfaceHit> hit = first_seen(ray);
    const FiniteLight* const light = context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/true).first;
    if (corner == 0) {
      first = hit;
      first_light = light;
    } else if (light != first_light || hit.has_value() != first.has_value() ||
               (hit && (hit->surface != first->surface || glm::dot(hit->shading, first->shading) < kEdgeCosine))) {
      return true;
    }
  }
  return false;
}

int GuideMarch::trace_pixel(const ivec2& at, int across, Pixel& pixel) const {
  if (!sketch_ && context_.surfaces && across < kMostRaysAcross && shows_edge(at)) across = kMostRaysAcross;
  pixel.sums.clear();
  double least = 1, most = 0;
  bool alike = true;
  std::optional<uint32_t> surface;
  for (int r = 0; r < across * across; ++r) {
    const Eye ray = eye(at, r, across);
    const auto moment = static_cast<size_t>(ray.time * static_cast<double>(media_.size()));
    const Met met = trace(ray, media_[moment], pixel.lines[moment], pixel);
    if (r == 0) surface = met.surface;
    alike = alike && met.surface == surface;
    least = std::min(least, met.passed);
    most = std::max(most, met.passed);
  }
  if (across == 2 && blurred() && !(alike && most - least < kAlike)) return trace_pixel(at, kMostRaysAcross, pixel);
  return across * across;
}

std::optional<SurfaceHit> GuideMarch::first_seen(const Ray& ray) const {
  if (!context_.surfaces) return std::nullopt;
  double from = 0;
  for (int unseen = 0; unseen < kMostUnseen; ++unseen) {
    std::optional<SurfaceHit> hit =
        context_.surfaces->intersect({ray.at(from), ray.d}, kFar, Surfaces::kMiddle, /*camera=*/true);
    if (!hit) break;
    hit->t += from;
    if (context_.surfaces->settings(hit->surface).role == "visible") return hit;
    from = hit->t + 2 * hit->margin;
  }
  return std::nullopt;
}

// The first surface that is seen, with the medium in front of it.
GuideMarch::Met GuideMarch::trace(const Eye& eye, const GuideMedia& media, MediaLine& line, Pixel& pixel) const {
  const Ray ray = camera_.ray(eye.film, eye.lens, eye.time);
  const std::optional<SurfaceHit> hit = first_seen(ray);
  const auto [light, distance] = context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/true);
  const double t_end = light ? distance : hit ? hit->t : kFar;
  const Passed passed = march(eye, ray, media, line, t_end, pixel);
  GuideSums& sums = pixel.sums;
  if (light) {
    sums.background += tinted(light->radiance(ray, distance), passed.straight);
  } else if (hit) {
    add_surface(eye, ray, *hit, passed, media, line, sums);
  } else {
    for (const InfiniteLight* sky : context_.lights->infinite())
      if (sky->visible()) sums.background += tinted(sky->radiance(ray.d), passed.straight);
  }
  return {passed.straight, hit && !light ? std::optional(hit->surface) : std::nullopt};
}

GuideMarch::Passed GuideMarch::march(const Eye& eye, const Ray& ray, const GuideMedia& media, MediaLine& line,
                                     double t_max, Pixel& pixel) const {
  static thread_local std::vector<std::pair<double, double>> parts, uneven;
  media.intervals(ray, t_max, parts);
  if (parts.empty()) return {};
  const bool some_even = even_stride_ > 1;
  if (some_even) media.uneven_intervals(ray, t_max, uneven);
  auto ahead = uneven.begin();
  line.follow(ray);
  const bool emits = !media.emissions().empty(), mixed = media.mixed_tints();
  const double scale = fields_.scaled_extinction();
  const double step = eye.stride * step_;
  double passed = 1, passed2 = 1, passed4 = 1, passed8 = 1, passed_scaled = 1, depth = 0, sigma_t = 0;
  double seen = 0, seen_depth = 0, seen_depth2 = 0, seen_density = 0;
  dvec3 seen_gradient(0);
  Piece piece, wide;
  for (size_t k = 0; k < pixel.views.size(); ++k) {
    pixel.views[k].g = std::numeric_limits<double>::quiet_NaN();
    const Sun* const sun = fields_.lights()[k].group.sun;
    if (!sun) continue;
    pixel.views[k].sun = fields_.lights()[k].sun[time_of(media)].line(ray);
    if (media.media().size() == 1) look_from(media, glm::dot(sun->axis(), ray.d), media.mean_cosine(0), 1, k, pixel);
  }

  for (const auto& [begin, end] : parts) {
    // Steps of neighbouring pixels begin at the same distances from the eye, wherever their cells begin.
    double t = (std::floor(begin / step - eye.offset) + eye.offset) * step;
    double piece_end = t;
    while (t < end && passed8 > kOpaque) {
      const double own_step = sigma_t * step < kThinStep ? step : step_, light_step = kLightSteps * own_step;
      // A branch, which is predicted, so that the next look does not wait for the extinction of the last.
      double length = own_step;
      if (depth > kGrowingDepth) length *= std::min(kLongestStep, 1 + kStepGrowth * (depth - kGrowingDepth));
      if (some_even) {
        while (ahead != uneven.end() && ahead->second <= t) ++ahead;
        const double free = (ahead == uneven.end() ? end : std::min(end, ahead->first)) - t;
        length = std::max(length, step * std::min(even_stride_, std::floor(free / step)));
      }
      if (t < begin) length -= begin - std::exchange(t, begin);
      length = std::min(length, end - t);
      const double middle = t + 0.5 * length;
      t += length;
      if (middle > t_max) break;
      dvec3 gradient;
      const GuideMedia::Point point = line.at(middle, gradient);
      const dvec3 emission = emits ? media.emission(ray.at(middle)) : dvec3(0);
      const double thickness = point.sigma_t * length;
      sigma_t = point.sigma_t;
      if (!(thickness > 0)) {
        if (emits) add_emission(emission, passed * length, passed_scaled * length, depth, pixel.sums);
        continue;
      }
      if (middle >= piece_end || piece.thickness > kLightThickness) {
        add_light(piece, media, ray, wide, pixel);
        piece = {};
        piece.begin = t - length;
        piece_end = (std::floor(middle / light_step - eye.offset) + 1 + eye.offset) * light_step;
      }
      const double q8 = attenuation(thickness / 8), q4 = q8 * q8, q2 = q4 * q4, q = q2 * q2;
      const double q_scaled = attenuation(thickness * scale);
      const double w = passed * (1 - q);
      piece.end = t;
      piece.w += w;
      piece.w2 += passed2 * (1 - q2);
      piece.w4 += passed4 * (1 - q4);
      piece.w8 += passed8 * (1 - q8);
      piece.scaled += passed_scaled * (1 - q_scaled);
      piece.thickness += thickness;
      piece.distance += thickness * middle;
      piece.depth += thickness * (depth + 0.5 * thickness);
      piece.albedo += thickness * point.albedo;
      piece.g += thickness * point.g;
      if (mixed) piece.tint += thickness * point.albedo * point.tint;
      if (emits)
        add_emission(emission, w / point.sigma_t, passed_scaled * (1 - q_scaled) / (point.sigma_t * scale),
                     depth + 0.5 * thickness, pixel.sums);
      passed *= q;
      passed2 *= q2;
      passed4 *= q4;
      passed8 *= q8;
      passed_scaled *= q_scaled;
      depth += thickness;

      const double from_middle = middle - reference_depth_;
      seen += w;
      seen_depth += w * from_middle;
      seen_depth2 += w * from_middle * from_middle;
      seen_gradient += w / (glm::length(gradient) + gentle_) * gradient;
      seen_density += w * point.density;
    }
  }
  add_light(piece, media, ray, wide, pixel);
  add_fields(wide, media, ray, pixel);
  GuideSums& sums = pixel.sums;
  sums.opacity += seen;
  sums.depth += seen_depth;
  sums.depth2 += seen_depth2;
  sums.gradient += seen_gradient;
  sums.density += seen_density;
  return {passed, std::max(0.0, passed_scaled - passed)};
}

// Seen straight on, and after one scattering or more by forward peaks.
void GuideMarch::add_emission(const dvec3& coefficient, double straight, double scaled, double depth,
                              GuideSums& sums) const {
  const double once = std::min(straight * (1 - fields_.scaled_extinction()) * depth, std::max(0.0, scaled - straight));
  sums.emission += tinted(coefficient, straight);
  sums.emission_once += tinted(coefficient, once);
  sums.behind += tinted(coefficient, std::max(0.0, scaled - straight - once));
}

double GuideMarch::phase_value(const GuideMedia& media, double cosine, double g, double spread) const {
  if (spread < kNarrow) return henyey_greenstein(spread * g, cosine);
  return media.media().size() == 1 ? media.media()[0].phase().value(cosine) : henyey_greenstein(g, cosine);
}

// Its phase function, octaves and forward peak.
void GuideMarch::look_from(const GuideMedia& media, double cosine, double g, double spread, size_t group,
                           Pixel& pixel) const {
  pixel.views[group].phase = {phase_value(media, cosine, g, spread), henyey_greenstein(g / 2, cosine),
                              henyey_greenstein(g / 4, cosine), henyey_greenstein(g / 8, cosine)};
  pixel.views[group].peak = ForwardPeak(g, cosine);
}

dvec3 GuideMarch::in_light(const GuideMedia& media, const dvec3& p) const {
  const GuideMedia& solved = media_[media_.size() / 2];
  return &media == &solved ? p : media.followed(p, solved);
}

void GuideMarch::look_from_sun(const GuideMedia& media, const Ray& ray, double g, size_t group, Pixel& pixel) const {
  // In steps, so that it seldom changes.
  constexpr double kSteps = 1024;
  const double rounded = std::round(g * kSteps) / kSteps;
  if (pixel.views[group].g == rounded) return;
  pixel.views[group].g = rounded;
  look_from(media, glm::dot(fields_.lights()[group].group.sun->axis(), ray.d), rounded, 1, group, pixel);
}

void GuideMarch::add_light(const Piece& piece, const GuideMedia& media, const Ray& ray, Piece& wide,
                           Pixel& pixel) const {
  if (!(piece.thickness > 0)) return;
  for (size_t k = 0; k < pixel.views.size(); ++k)
    if (fields_.lights()[k].group.sharp()) add_sharp_light(piece, media, ray, k, pixel);
  const auto flush = [&] {
    add_fields(wide, media, ray, pixel);
    wide = {};
  };
  if (piece.end - wide.begin > 2 * look_apart_) flush();
  wide.add(piece);
  if (wide.end - wide.begin > look_apart_ || wide.thickness > kNodeThickness) flush();
}

void GuideMarch::add_fields(const Piece& wide, const GuideMedia& media, const Ray& ray, Pixel& pixel) const {
  if (!(wide.thickness > 0)) return;
  const double albedo = wide.albedo / wide.thickness;
  const auto w = static_cast<float>(wide.w), scaled = static_cast<float>(wide.scaled);
  alignas(16) float fields[NodeFields::kMost];
  node_fields_.interpolate(in_light(media, ray.at(wide.distance / wide.thickness)), fields);
  GuideSums& sums = pixel.sums;
  for (size_t i = 0; i < node_fields_.count(); ++i) sums.plain[i] += w * fields[i];
  for (size_t i = 0; i < node_fields_.count(); ++i) sums.scaled[i] += scaled * fields[i];
  for (size_t k = 0; k < sums.groups.size(); ++k) {
    const LightGroup& group = fields_.lights()[k].group;
    const NodeFields::Slots& s = node_fields_.of(k);
    GroupSums& out = sums.groups[k];
    Pixel::View& view = pixel.views[k];
    const double tail = fields[s.orders + kOrders - 1];
    out.tail[0] += wide.w2 * tail;
    out.tail[1] += wide.w4 * tail;
    out.tail[2] += wide.w8 * tail;
    if (group.sky()) {
      view.single = wide.w * albedo * fields[s.single];
      view.forward = wide.scaled / fields_.scaled_extinction() * albedo * fields[s.forward] - view.single;
      out.single += view.single;
      out.forward += view.forward;
    } else if (!group.sharp()) {
      // These fields are per extinction without the forward peak.
      view.single = fields_.scaled_extinction() * wide.w * fields[s.single];
      view.forward = std::max(0.0, wide.scaled * fields[s.single] - view.single);
    }
  }
  if (media.mixed_tints()) add_tinted(wide, fields, pixel);
}

// Light of a sun or lamp, whose direction and optical depth are known.
void GuideMarch::add_sharp_light(const Piece& piece, const GuideMedia& media, const Ray& ray, size_t k,
                                 Pixel& pixel) const {
  const SolvedLight& solved = fields_.lights()[k];
  const double distance = piece.distance / piece.thickness, g_mean = piece.g / piece.thickness;
  Pixel::View& view = pixel.views[k];
  double irradiance, tau, arriving;
  if (solved.group.sun) {
    irradiance = in_colour(solved.group.sun->irradiance(), colour_);
    tau = solved.sun[time_of(media)].at(view.sun, distance);
    arriving = attenuation(tau);
    // Of a sun in one medium the angle does not change along the ray.
    if (media.media().size() > 1) look_from_sun(media, ray, g_mean, k, pixel);
  } else {
    const dvec3 here = in_light(media, ray.at(distance));
    const LocalLight light = local_light(*solved.group.lights[0], here);
    irradiance = in_colour(light.irradiance, colour_);
    tau = interpolated(fields_.lattice(), solved.depth, here);
    arriving = light.transmittance(tau);
    look_from(media, glm::dot(light.towards, ray.d), g_mean, light.mean_cosine(), k, pixel);
  }
  if (!solved.visible.empty())
    irradiance *= interpolated(fields_.lattice(), solved.visible, in_light(media, ray.at(distance)));
  irradiance *= piece.albedo / piece.thickness;
  GroupSums& out = pixel.sums.groups[k];
  const std::array<double, 4>& phase = view.phase;
  const double v16 = attenuation(tau / 16), v8 = v16 * v16, v4 = v8 * v8, v2 = v4 * v4;
  const double peak = (1 - fields_.scaled_extinction()) * (tau + piece.depth / piece.thickness);
  view.single = piece.w * irradiance * phase[0] * arriving;
  view.forward = piece.w * irradiance * arriving * view.peak.repeated(peak);
  out.single += view.single;
  out.forward += view.forward;
  out.octave[0] += piece.w2 * irradiance * phase[1] * v2;
  out.octave[1] += piece.w4 * irradiance * phase[2] * v4;
  out.octave[2] += piece.w8 * irradiance * phase[3] * v8;
  const double even = piece.w * irradiance / (4 * kPi);
  out.soft[0] += even * v2;
  out.soft[1] += even * v4;
  out.soft[2] += even * v8;
  out.soft[3] += even * v16;
}

// What is a field times a weight has been summed for all fields at once.
void GuideMarch::collect_fields(GuideSums& sums) const {
  for (size_t k = 0; k < sums.groups.size(); ++k) {
    const LightGroup& group = fields_.lights()[k].group;
    const NodeFields::Slots& s = node_fields_.of(k);
    GroupSums& out = sums.groups[k];
    for (size_t order = 0; order < kOrders; ++order) out.orders[order] = sums.scaled[s.orders + order];
    out.flux = sums.scaled[s.flux];
    if (group.sky()) {
      out.soft[0] = sums.plain[s.root];
      out.soft[1] = sums.plain[s.fourth_root];
    } else if (!group.sharp()) {
      // These fields are per extinction without the forward peak.
      out.single = fields_.scaled_extinction() * sums.plain[s.single];
      out.forward = std::max(0.0, sums.scaled[s.single] - out.single);
    }
  }
}

}  // namespace brume
