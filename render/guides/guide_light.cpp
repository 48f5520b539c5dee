// The light that a piece of a camera ray scatters towards the eye.

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "render/guides/attenuation.h"
#include "render/guides/guide_march.h"
#include "render/guides/guide_pixel.h"

namespace brume {
namespace {

constexpr double kNarrow = 0.99;  // mean cosine of directions that count as one
constexpr size_t kOrders = SolvedLight::kFirstOrder.size();

double henyey_greenstein(double g, double c) {
  return HenyeyGreenstein{g}.value(c);
}

vec3 tinted(const dvec3& colour, double value) {
  return vec3(colour * value);
}

}  // namespace

// Emission that comes straight to the eye, and that which forward peaks scatter once or more on the way.
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

void GuideMarch::add_fields(const Piece& wide, const GuideMedia& media, const Ray& ray, Pixel& pixel) const {
  const auto w = static_cast<float>(wide.w), scaled = static_cast<float>(wide.scaled);
  alignas(16) float fields[NodeFields::kMost];
  node_fields_.interpolate(in_light(media, ray.at(wide.distance)), fields);
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
      view.single = wide.w * wide.albedo * fields[s.single];
      view.forward = wide.scaled / fields_.scaled_extinction() * wide.albedo * fields[s.forward] - view.single;
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
  const dvec3 here = in_light(media, ray.at(piece.distance));
  Pixel::View& view = pixel.views[k];
  double irradiance, tau, arriving;
  if (solved.group.sun) {
    irradiance = in_colour(solved.group.sun->irradiance(), colour_);
    tau = solved.sun[time_of(media)].at(ray.at(piece.distance));
    arriving = attenuation(tau);
    // Of a sun in one medium the angle does not change along the ray.
    if (media.media().size() > 1) look_from_sun(media, ray, piece.g, k, pixel);
  } else {
    const LocalLight light = local_light(*solved.group.lights[0], here);
    irradiance = in_colour(light.irradiance, colour_);
    tau = interpolated(fields_.lattice(), solved.depth, here);
    arriving = light.transmittance(tau);
    look_from(media, glm::dot(light.towards, ray.d), piece.g, light.mean_cosine(), k, pixel);
  }
  if (!solved.visible.empty()) irradiance *= interpolated(fields_.lattice(), solved.visible, here);
  irradiance *= piece.albedo;
  GroupSums& out = pixel.sums.groups[k];
  const std::array<double, 4>& phase = view.phase;
  const double v16 = attenuation(tau / 16), v8 = v16 * v16, v4 = v8 * v8, v2 = v4 * v4;
  const double peak = (1 - fields_.scaled_extinction()) * (tau + piece.depth);
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
    // What the march looked up by itself.
    const MarchedRay::FieldSums& own = sums.fields[k];
    for (size_t i = 0; i < 3; ++i) out.tail[i] += own.tail[i];
    out.single += own.single;
    out.forward += own.forward / fields_.scaled_extinction() - own.single;
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
