#include "render/guides/guide_march.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/guides/attenuation.h"
#include "render/guides/forward_peak.h"
#include "render/guides/media_line.h"
#include "render/world/bsdf.h"

namespace brume {
namespace {

// Of the largest density in a voxel: gradients below it count less, because their direction means little.
constexpr double kGentleGradient = 0.03;
constexpr double kStepGrowth = 0.25;  // of the step for each free path behind the eye's first two
constexpr double kLongestStep = 4;
// Of a step where a pixel has several rays, as far as the medium at the last one was thinner than this.
constexpr double kManyRaysStride = 1.5, kThinStep = 0.03;
// The same at most, where all media are homogeneous and no lamp is near, as far as such a step is as thin as this.
constexpr double kEvenStride = 4, kEvenThickness = 0.02;
// Transmittances of four rays that stand for sixteen differ by less.
constexpr double kAlike = 0.02;
// What shares one look at the light: as many first steps, of no more extinction than this.
constexpr double kLightSteps = 2, kLightThickness = 0.12;
constexpr double kOpaque = 2e-3;  // transmittance of an eighth of the extinction at which a ray ends
constexpr double kFar = 1e30;
constexpr double kCapMeanCosine = 0.96;  // of a cap of a 24th of the sphere
constexpr double kNarrow = 0.99;         // mean cosine of directions that count as one
constexpr int kMostRaysAcross = 4;       // of a pixel that shows the edge of a surface or light
constexpr double kEdgeCosine = 0.9;      // between the normals at a pixel's corners
constexpr int kMostUnseen = 8;           // surfaces that a camera ray goes through
constexpr std::array<const char*, 6> kOrderNames = {"order2", "order3", "order4", "order6", "order9", "tail"};
constexpr size_t kOrders = kOrderNames.size();
// Octaves: the same light with a half, a quarter, an eighth of the extinction and of the anisotropy.
// Source: Wrenninge, Kulla, Lundqvist 2013, Oz: The Great and Volumetric.
constexpr std::array<const char*, 3> kOctaveNames = {"half", "quarter", "eighth"};
constexpr std::array<const char*, 4> kSoftNames = {"soft2", "soft4", "soft8", "soft16"};

bool sharp(const GroupLight& g) {
  return g.group.kind == LightGroup::Kind::kSun || g.group.kind == LightGroup::Kind::kLocal;
}
bool is_sky(const GroupLight& g) {
  return g.group.kind == LightGroup::Kind::kSky;
}

/// Whether the light was scattered before it entered the media.
bool from_surfaces(const GroupLight& g) {
  return g.group.kind == LightGroup::Kind::kSurfaces;
}

double henyey_greenstein(double g, double c) {
  return HenyeyGreenstein{g}.value(c);
}

/// Four numbers at once, which compilers do not find by themselves here.
using Four = float __attribute__((vector_size(16)));
Four four_at(const float* values) {
  Four four;
  std::memcpy(&four, values, sizeof four);
  return four;
}

vec3 tinted(const dvec3& colour, double value) {
  return vec3(colour * value);
}

}  // namespace

/// What one pixel gathers; every ray adds to it.
struct GuideMarch::Sums {
  std::vector<double> value;  // as outputs_
  vec3 emission{0}, emission_once{0}, behind{0}, background{0}, normal{0}, surface_albedo{0};
  vec3 indirect{0}, mirrored{0}, mirrored_indirect{0}, material{0};
  double surface_depth = 0, depth2 = 0;
  std::vector<vec3> surface;  // by group
  // Fields times the weight of what is seen of them, with the whole extinction and without the forward peak.
  std::vector<float> plain, scaled;
  std::vector<std::array<double, 4>> phases;  // of a group's light, towards the eye: no sum
  std::vector<ForwardPeak> peaks;             // the same
  std::vector<double> phase_g;                // mean cosines that those of suns were made for on this ray
  // Of media of unlike tints: light in all colours, and of a group at one place what is predicted; the last tint seen.
  dvec3 tinted_direct{0}, tinted_indirect{0};
  struct AtOnePlace {
    double single = 0, forward = 0;
  };
  std::vector<AtOnePlace> here;
  OrderTint tint;

  Sums(size_t values, size_t groups, size_t fields)
      : value(values, 0.0),
        surface(groups, vec3(0)),
        plain(fields, 0.0f),
        scaled(fields, 0.0f),
        phases(groups),
        peaks(groups),
        phase_g(groups),
        here(groups) {}
  void clear() {
    std::fill(value.begin(), value.end(), 0.0);
    std::fill(plain.begin(), plain.end(), 0.0f);
    std::fill(scaled.begin(), scaled.end(), 0.0f);
    std::fill(surface.begin(), surface.end(), vec3(0));
    emission = emission_once = behind = background = normal = surface_albedo = indirect = mirrored = mirrored_indirect =
        material = vec3(0);
    tinted_direct = tinted_indirect = dvec3(0);
    surface_depth = depth2 = 0;
  }
};

GuideMarch::GuideMarch(const PathContext& context, const std::vector<GuideMedia>& media, const LightFields& fields,
                       GuideColour colour, const Camera& camera, double step_voxels)
    : context_(context),
      media_(media),
      fields_(fields),
      colour_(colour),
      camera_(camera),
      step_(step_voxels * media[0].voxel()) {
  const dvec3 middle = 0.5 * (media[0].lo() + media[0].hi());
  reference_depth_ = glm::distance(camera.ray(dvec2(0)).o, middle);
  double densest = 0;
  for (const Medium& m : media[0].media())
    densest = std::max(densest, m.maximum_density() * in_colour(m.coefficients().sigma_t, colour));
  gentle_ = std::max(kGentleGradient * densest / media[0].voxel(), 1e-300);
  if (media[0].media().size() == 1)
    cap_phase_ =
        CapPhase(media[0].media()[0].phase(), 1.0 / static_cast<double>(ScatteringSolver::directions().size()));
  double even = 0;
  for (const Medium& m : media[0].media())
    if (m.homogeneous()) even += in_colour(m.coefficients().sigma_t, colour);
  if (even > 0) even_stride_ = std::clamp(kEvenThickness / (even * step_), 1.0, kEvenStride);
  for (const GroupLight& g : fields.groups())
    if (g.group.kind == LightGroup::Kind::kLocal) even_stride_ = 1;
  if (colour == kGrey && !media[0].media().empty()) tint_ = OrderTint(media[0].tint(0));
  lay_out();
}

void GuideMarch::lay_out() {
  const char letter = colour_ == kGrey ? 'Y' : "RGB"[colour_];
  outputs_ = {{"opacity", letter}, {"depth", 'Z'},    {"spread", 'Z'}, {"gradient", 'X'},
              {"gradient", 'Y'},   {"gradient", 'Z'}, {"density", 'Y'}};
  for (const GroupLight& g : fields_.groups()) {
    const std::string& name = g.group.name;
    Slots s;
    const auto add = [&](const std::string& what) {
      outputs_.push_back({what, g.group.channel == kGrey ? letter : "RGB"[g.group.channel]});
      return outputs_.size() - 1;
    };
    const auto add_all = [&](const auto& list) {
      const size_t first = outputs_.size();
      for (const char* what : list) add("multiple." + name + "_" + what);
      return first;
    };
    const auto fields = [&](size_t count) {
      const size_t first = field_count_;
      field_count_ += count;
      return first;
    };
    s.single = add(from_surfaces(g) ? "multiple." + name + "_once" : "single." + name);
    if (sharp(g)) {
      s.octave = add_all(kOctaveNames);
      s.soft = add_all(kSoftNames);
    } else if (is_sky(g)) {
      s.soft = add_all(std::array{"soft2", "soft4"});
    }
    s.forward = add("multiple." + name + "_forward");
    s.orders = add_all(kOrderNames);
    s.flux = add("multiple." + name + "_flux");
    s.tail = add_all(std::array{"tail_half", "tail_quarter", "tail_eighth"});
    s.field_orders = fields(kOrders + 1);
    if (is_sky(g))
      s.field_single = fields(3), s.field_forward = fields(1);
    else if (!sharp(g))
      s.field_single = fields(1);
    if (!g.depth.empty()) s.field_depth = fields(1);
    if (!g.visible.empty()) s.field_visible = fields(1);
    slots_.push_back(s);
  }
  field_count_ = (field_count_ + 3) / 4 * 4;
  if (field_count_ > kMostFields) throw std::logic_error("more lights have guides of their own than the march holds");
}

namespace {

/// What the sky's light from each direction of travel adds at a node, for radiance 1 outside.
struct SkyAtNode {
  static constexpr size_t kMost = 32;
  std::array<double, kMost> single{}, forward{}, root{}, fourth_root{};
};

/// Of one medium, for cosines from -1 to 1.
std::vector<ForwardPeak> tabulated_peaks(double g) {
  constexpr int kSteps = 4096;
  std::vector<ForwardPeak> peaks;
  for (int i = 0; i <= kSteps; ++i) peaks.emplace_back(g, 2.0 * i / kSteps - 1);
  return peaks;
}

}  // namespace

// The light that leaves each node towards the eye, all groups beside one another.
void GuideMarch::interleave(const Task& task) {
  const Lattice& lattice = fields_.lattice();
  const Lattice& coarse = fields_.coarse_lattice();
  const ivec3 n = lattice.n;
  const auto& directions = ScatteringSolver::directions();
  const auto count = static_cast<double>(directions.size());
  node_fields_ = NodeValues(static_cast<size_t>(n.x) * n.y * n.z * field_count_);
  const bool one = media_[0].media().size() == 1;
  std::vector<std::vector<ForwardPeak>> peaks;  // of each medium
  for (size_t m = 0; m < media_[0].media().size() && !fields_.sky().empty(); ++m)
    peaks.push_back(tabulated_peaks(media_[0].mean_cosine(m)));
  std::vector<std::vector<double>> roots(slots_.size());  // of each group's incoming light
  for (size_t k = 0; k < slots_.size(); ++k)
    for (const double light : fields_.groups()[k].incoming) roots[k].push_back(std::sqrt(light));
  const auto peak_of = [&](double g, double cosine) {
    for (size_t m = 0; m < peaks.size(); ++m) {
      if (!one && std::abs(g - media_[0].mean_cosine(m)) > 1e-6) continue;
      const double last = static_cast<double>(peaks[m].size()) - 1;
      return peaks[m][static_cast<size_t>(std::clamp(0.5 * (cosine + 1), 0.0, 1.0) * last + 0.5)];
    }
    return ForwardPeak(g, cosine);
  };
  const auto sky_at = [&](size_t i, const dvec3& p, const dvec3& view) {
    const double g = one ? 0 : media_[0].at(p, colour_).g;
    SkyAtNode at;
    double weights = 0;
    for (size_t d = 0; d < directions.size(); ++d) {
      const double c = glm::dot(directions[d], -view), share = fields_.sky()(i, d);
      const double weight = one ? cap_phase_.value(c) : henyey_greenstein(kCapMeanCosine * g, c);
      weights += weight;
      if (!(share > 0)) continue;
      at.single[d] = weight * share;
      const double depth = (1 - fields_.scaled_extinction()) * std::max(0.0, -portable_log(share));
      if (depth > 0) at.forward[d] = 4 * kPi / count * share * peak_of(g, c).repeated(depth);
      at.root[d] = std::sqrt(share) / count;
      at.fourth_root[d] = std::sqrt(std::sqrt(share)) / count;
    }
    for (size_t d = 0; d < directions.size(); ++d) {
      at.single[d] /= weights;
      at.forward[d] += at.single[d];
    }
    return at;
  };
  parallel_for(n.x, quiet(task), [&](int x) {
    for (int y = 0; y < n.y; ++y)
      for (int z = 0; z < n.z; ++z) {
        const size_t i = lattice.index(x, y, z);
        if (!fields_.near()[i]) continue;
        float* const out = node_fields_.data() + ((static_cast<size_t>(x) * n.y + y) * n.z + z) * field_count_;
        const dvec3 p = lattice.node(x, y, z), view = camera_.view_direction(p);
        const dvec3 step = 0.75 * coarse.spacing * view;
        const NodeWeights here(coarse, p), before(coarse, p - step), behind(coarse, p + step);
        const SkyAtNode sky = fields_.sky().empty() ? SkyAtNode{} : sky_at(i, p, view);
        const auto towards_eye = [&](const Moments& light, const auto& at) {
          const double flux = view.x * at(light[1]) + view.y * at(light[2]) + view.z * at(light[3]);
          return static_cast<float>(std::max(0.0, at(light[0]) - flux));
        };
        const auto at_node = [&](const NodeValues& values) { return static_cast<double>(values[i]); };
        const auto coarsely = [&](const NodeValues& values) { return static_cast<double>(here(values)); };
        for (size_t k = 0; k < slots_.size(); ++k) {
          const GroupLight& g = fields_.groups()[k];
          const Slots& s = slots_[k];
          for (size_t order = 0; order < kOrders; ++order)
            out[s.field_orders + order] = order < GroupLight::kFineGuides ? towards_eye(g.orders[order], at_node)
                                                                          : towards_eye(g.orders[order], coarsely);
          const NodeValues& tail = g.orders.back()[0];
          out[s.field_orders + kOrders] = behind(tail) - before(tail);
          if (is_sky(g)) {
            double single = 0, forward = 0, root = 0, fourth_root = 0;
            for (size_t d = 0; d < directions.size(); ++d) {
              single += g.incoming[d] * sky.single[d];
              forward += g.incoming[d] * sky.forward[d];
              root += roots[k][d] * sky.root[d];
              fourth_root += std::sqrt(roots[k][d]) * sky.fourth_root[d];
            }
            out[s.field_single] = static_cast<float>(single);
            out[s.field_forward] = static_cast<float>(forward);
            out[s.field_single + 1] = static_cast<float>(root);
            out[s.field_single + 2] = static_cast<float>(fourth_root);
          } else if (!sharp(g)) {
            out[s.field_single] = towards_eye(g.once, at_node);
          }
          if (!g.depth.empty()) out[s.field_depth] = g.depth[i];
          if (!g.visible.empty()) out[s.field_visible] = g.visible[i];
        }
      }
  });
}

void GuideMarch::interpolate(const dvec3& world, float* values) const {
  const ivec3 n = fields_.lattice().n;
  const dvec3 p = glm::clamp(fields_.lattice().to_lattice(world), dvec3(0), dvec3(n - 1));
  const ivec3 i = glm::min(ivec3(p), n - 2);
  const vec3 f(p - dvec3(i)), e = 1.0f - f;
  const size_t z = field_count_, y = z * static_cast<size_t>(n.z), x = y * static_cast<size_t>(n.y);
  const float* const node = node_fields_.data() + i.x * x + i.y * y + i.z * z;
  const float weight[8] = {e.x * e.y * e.z, e.x * e.y * f.z, e.x * f.y * e.z, e.x * f.y * f.z,
                           f.x * e.y * e.z, f.x * e.y * f.z, f.x * f.y * e.z, f.x * f.y * f.z};
  const size_t offset[8] = {0, z, y, y + z, x, x + z, x + y, x + y + z};
  for (size_t m = 0; m < field_count_; m += 4) {
    Four sum = weight[0] * four_at(node + m);
    for (size_t c = 1; c < 8; ++c) sum += weight[c] * four_at(node + offset[c] + m);
    std::memcpy(values + m, &sum, sizeof sum);
  }
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
  interleave(task);
  gather_light(task);
  const auto layer_of = [&](const std::string& name, char channel) -> Plane& {
    return frame.add("guide." + name + "." + channel);
  };
  const bool first = colour_ == kGrey || colour_ == 0;
  // Where the sums go; null for what another colour has recorded already.
  std::vector<Plane*> planes;
  for (size_t i = 0; i < outputs_.size(); ++i) {
    const bool once = i > kOpacity && i < kBaseCount;
    planes.push_back(once && !first ? nullptr : &layer_of(outputs_[i].name, outputs_[i].channel));
  }
  const std::vector<size_t> channels =
      colour_ == kGrey ? std::vector<size_t>{0, 1, 2} : std::vector<size_t>{static_cast<size_t>(colour_)};
  const bool surfaces = context_.surfaces != nullptr, glows = !media_[0].emissions().empty();
  std::array<Plane*, 3> emission{}, background{}, albedo{}, direct{}, indirect{}, normal{}, lit_indirect{}, mirrored{},
      mirrored_indirect{}, material{}, emission_once{}, behind{};
  std::vector<std::array<Plane*, 3>> lit(slots_.size());
  for (const size_t c : channels) {
    if (glows) emission[c] = &layer_of("emission", "RGB"[c]);
    if (glows) emission_once[c] = &layer_of("single.emission", "RGB"[c]);
    if (glows || surfaces) behind[c] = &layer_of("multiple.behind", "RGB"[c]);
    background[c] = &layer_of("background", "RGB"[c]);
    direct[c] = &layer_of("predicted_direct", "RGB"[c]);
    indirect[c] = &layer_of("predicted_indirect", "RGB"[c]);
    if (!surfaces) continue;
    albedo[c] = &layer_of("surface_albedo", "RGB"[c]);
    lit_indirect[c] = &layer_of("surface.indirect", "RGB"[c]);
    for (size_t g = 0; g < lit.size(); ++g) {
      const LightGroup& group = fields_.groups()[g].group;
      if (from_surfaces(fields_.groups()[g])) continue;
      if (group.channel == kGrey || group.channel == static_cast<int>(c))
        lit[g][c] = &layer_of("surface." + group.name, "RGB"[c]);
    }
    if (node_light_.empty()) continue;
    mirrored[c] = &layer_of("surface.mirrored", "RGB"[c]);
    mirrored_indirect[c] = &layer_of("surface.mirrored_indirect", "RGB"[c]);
  }
  Plane* surface_depth = nullptr;
  if (surfaces && first) {
    for (size_t a = 0; a < 3; ++a) {
      normal[a] = &layer_of("normal", "XYZ"[a]);
      material[a] = &layer_of("surface_material", "RGB"[a]);
    }
    surface_depth = &layer_of("surface_depth", 'Z');
  }

  const int across = rays_across();
  parallel_for(frame.height(), task, [&](int y) {
    Sums sums(outputs_.size(), slots_.size(), field_count_);
    std::vector<MediaLine> lines;  // as media_
    for (const GuideMedia& media : media_) lines.emplace_back(media, colour_);
    for (int x = 0; x < frame.width(); ++x) {
      const int rays = trace_pixel(corner + ivec2(x, y), across, lines, sums);
      collect_fields(sums);
      const double share = 1.0 / rays;
      const double opacity = sums.value[kOpacity];
      if (opacity > 0) {
        const double mean = sums.value[kDepth] / opacity;
        sums.value[kSpread] = opacity * std::sqrt(std::max(0.0, sums.depth2 / opacity - mean * mean));
      }
      for (size_t i = 0; i < planes.size(); ++i)
        if (planes[i]) (*planes[i])(x, y) = static_cast<float>(share * sums.value[i]);
      const auto store = [&](const std::array<Plane*, 3>& to, const vec3& value) {
        for (int c = 0; c < 3; ++c)
          if (Plane* const plane = to[static_cast<size_t>(c)]) (*plane)(x, y) = static_cast<float>(share) * value[c];
      };
      store(emission, sums.emission);
      store(emission_once, sums.emission_once);
      store(behind, sums.behind);
      store(background, sums.background);
      store(direct, predicted_direct(sums));
      store(indirect, predicted_indirect(sums));
      store(albedo, sums.surface_albedo);
      store(lit_indirect, sums.indirect);
      store(normal, sums.normal);
      store(material, sums.material);
      store(mirrored, sums.mirrored);
      store(mirrored_indirect, sums.mirrored_indirect);
      for (size_t g = 0; g < lit.size(); ++g) store(lit[g], sums.surface[g]);
      if (surface_depth) (*surface_depth)(x, y) = static_cast<float>(share * sums.surface_depth);
    }
  });
}

GuideMarch::Eye GuideMarch::eye(const ivec2& pixel, int ray, int across) const {
  Eye eye;
  eye.cell = 1.0 / across;
  eye.film = dvec2(pixel) + eye.cell * (dvec2(ray % across, ray / across) + 0.5);
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

int GuideMarch::trace_pixel(const ivec2& pixel, int across, std::vector<MediaLine>& lines, Sums& sums) const {
  if (context_.surfaces && across < kMostRaysAcross && shows_edge(pixel)) across = kMostRaysAcross;
  sums.clear();
  double least = 1, most = 0;
  bool alike = true;
  std::optional<uint32_t> surface;
  for (int r = 0; r < across * across; ++r) {
    const Eye ray = eye(pixel, r, across);
    const auto moment = static_cast<size_t>(ray.time * static_cast<double>(media_.size()));
    const Met met = trace(ray, media_[moment], lines[moment], sums);
    if (r == 0) surface = met.surface;
    alike = alike && met.surface == surface;
    least = std::min(least, met.passed);
    most = std::max(most, met.passed);
  }
  if (across == 2 && blurred() && !(alike && most - least < kAlike))
    return trace_pixel(pixel, kMostRaysAcross, lines, sums);
  return across * across;
}

std::optional<SurfaceHit> GuideMarch::first_seen(const Ray& ray) const {
  if (!context_.surfaces) return std::nullopt;
  double from = 0;
  for (int unseen = 0; unseen < kMostUnseen; ++unseen) {
    std::optional<SurfaceHit> hit = context_.surfaces->intersect({ray.at(from), ray.d}, kFar);
    if (!hit) break;
    hit->t += from;
    if (context_.surfaces->settings(hit->surface).role == "visible") return hit;
    from = hit->t + 2 * hit->margin;
  }
  return std::nullopt;
}

// The first surface that is seen, with the medium in front of it.
GuideMarch::Met GuideMarch::trace(const Eye& eye, const GuideMedia& media, MediaLine& line, Sums& sums) const {
  const Ray ray = camera_.ray(eye.film, eye.lens, eye.time);
  const std::optional<SurfaceHit> hit = first_seen(ray);
  const auto [light, distance] = context_.lights->nearest(ray, hit ? hit->t : kFar, /*seen=*/true);
  const double t_end = light ? distance : hit ? hit->t : kFar;
  const Passed passed = march(eye, ray, media, line, t_end, sums);
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

/// A piece of a ray whose light is looked up once: weights of what is seen of it, with the extinction, a half, a
/// quarter, an eighth of it, and without the forward peak; and means over it.
struct GuideMarch::Piece {
  double w = 0, w2 = 0, w4 = 0, w8 = 0, scaled = 0;
  double thickness = 0, distance = 0, depth = 0, albedo = 0, g = 0;  // the last four times thickness
  dvec3 tint{0};                                                     // the same times albedo
};

GuideMarch::Passed GuideMarch::march(const Eye& eye, const Ray& ray, const GuideMedia& media, MediaLine& line,
                                     double t_max, Sums& sums) const {
  static thread_local std::vector<std::pair<double, double>> parts, uneven;
  media.intervals(ray, t_max, parts);
  if (parts.empty()) return {};
  const bool some_even = even_stride_ > 1;
  if (some_even) media.uneven_intervals(ray, t_max, uneven);
  auto ahead = uneven.begin();
  line.follow(ray);
  const bool glows = !media.emissions().empty(), mixed = media.mixed_tints();
  const double scale = fields_.scaled_extinction();
  const double step = eye.stride * step_;
  double passed = 1, passed2 = 1, passed4 = 1, passed8 = 1, passed_scaled = 1, depth = 0, sigma_t = 0;
  double seen = 0, seen_depth = 0, seen_depth2 = 0, seen_density = 0;
  dvec3 seen_gradient(0);
  Piece piece;
  std::fill(sums.phase_g.begin(), sums.phase_g.end(), std::numeric_limits<double>::quiet_NaN());
  for (size_t k = 0; k < slots_.size(); ++k)
    if (const Sun* const sun = fields_.groups()[k].group.sun; sun && media.media().size() == 1)
      look_from(media, glm::dot(sun->axis(), ray.d), media.mean_cosine(0), 1, k, sums);

  for (const auto& [begin, end] : parts) {
    // Steps of neighbouring pixels begin at the same distances from the eye, wherever their cells begin.
    double t = (std::floor(begin / step - eye.offset) + eye.offset) * step;
    double piece_end = t;
    while (t < end && passed8 > kOpaque) {
      const double own_step = sigma_t * step < kThinStep ? step : step_, light_step = kLightSteps * own_step;
      double length = own_step * std::min(kLongestStep, 1 + kStepGrowth * std::max(0.0, depth - 2));
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
      const dvec3 glow = glows ? media.glow(ray.at(middle)) : dvec3(0);
      const double thickness = point.sigma_t * length;
      sigma_t = point.sigma_t;
      if (!(thickness > 0)) {
        if (glows) add_glow(glow, passed * length, passed_scaled * length, depth, sums);
        continue;
      }
      if (middle >= piece_end || piece.thickness > kLightThickness) {
        light_of(piece, media, ray, sums);
        piece = {};
        piece_end = (std::floor(middle / light_step - eye.offset) + 1 + eye.offset) * light_step;
      }
      const double q8 = attenuation(thickness / 8), q4 = q8 * q8, q2 = q4 * q4, q = q2 * q2;
      const double q_scaled = attenuation(thickness * scale);
      const double w = passed * (1 - q);
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
      if (glows)
        add_glow(glow, w / point.sigma_t, passed_scaled * (1 - q_scaled) / (point.sigma_t * scale),
                 depth + 0.5 * thickness, sums);
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
  light_of(piece, media, ray, sums);
  std::vector<double>& out = sums.value;
  out[kOpacity] += seen;
  out[kDepth] += seen_depth;
  sums.depth2 += seen_depth2;
  for (int a = 0; a < 3; ++a) out[kGradient + static_cast<size_t>(a)] += seen_gradient[a];
  out[kDensity] += seen_density;
  return {passed, std::max(0.0, passed_scaled - passed)};
}

// Seen straight on, and after one scattering or more by forward peaks.
void GuideMarch::add_glow(const dvec3& glow, double straight, double scaled, double depth, Sums& sums) const {
  const double once = std::min(straight * (1 - fields_.scaled_extinction()) * depth, std::max(0.0, scaled - straight));
  sums.emission += tinted(glow, straight);
  sums.emission_once += tinted(glow, once);
  sums.behind += tinted(glow, std::max(0.0, scaled - straight - once));
}

double GuideMarch::phase_value(const GuideMedia& media, double cosine, double g, double spread) const {
  if (spread < kNarrow) return henyey_greenstein(spread * g, cosine);
  return media.media().size() == 1 ? media.media()[0].phase().value(cosine) : henyey_greenstein(g, cosine);
}

// Its phase function, octaves and forward peak.
void GuideMarch::look_from(const GuideMedia& media, double cosine, double g, double spread, size_t group,
                           Sums& sums) const {
  sums.phases[group] = {phase_value(media, cosine, g, spread), henyey_greenstein(g / 2, cosine),
                        henyey_greenstein(g / 4, cosine), henyey_greenstein(g / 8, cosine)};
  sums.peaks[group] = ForwardPeak(g, cosine);
}

dvec3 GuideMarch::in_light(const GuideMedia& media, const dvec3& p) const {
  const GuideMedia& solved = media_[media_.size() / 2];
  return &media == &solved ? p : media.followed(p, solved);
}

void GuideMarch::look_from_sun(const GuideMedia& media, const Ray& ray, double g, size_t group, Sums& sums) const {
  // In steps, so that it seldom changes.
  constexpr double kSteps = 1024;
  const double rounded = std::round(g * kSteps) / kSteps;
  if (sums.phase_g[group] == rounded) return;
  sums.phase_g[group] = rounded;
  look_from(media, glm::dot(fields_.groups()[group].group.sun->axis(), ray.d), rounded, 1, group, sums);
}

void GuideMarch::light_of(const Piece& piece, const GuideMedia& media, const Ray& ray, Sums& sums) const {
  if (!(piece.thickness > 0)) return;
  std::vector<double>& out = sums.value;
  const dvec3 here = ray.at(piece.distance / piece.thickness), p = in_light(media, here);
  const double albedo = piece.albedo / piece.thickness, g_mean = piece.g / piece.thickness;
  const auto w = static_cast<float>(piece.w), scaled = static_cast<float>(piece.scaled);
  alignas(16) float fields[kMostFields];
  interpolate(p, fields);
  for (size_t i = 0; i < field_count_; ++i) sums.plain[i] += w * fields[i];
  for (size_t i = 0; i < field_count_; ++i) sums.scaled[i] += scaled * fields[i];
  for (size_t k = 0; k < slots_.size(); ++k) {
    const GroupLight& g = fields_.groups()[k];
    const Slots& s = slots_[k];
    const double tail = fields[s.field_orders + kOrders - 1];
    out[s.tail] += piece.w2 * tail;
    out[s.tail + 1] += piece.w4 * tail;
    out[s.tail + 2] += piece.w8 * tail;
    if (is_sky(g)) {
      const double single = piece.w * albedo * fields[s.field_single];
      const double forward = piece.scaled / fields_.scaled_extinction() * albedo * fields[s.field_forward] - single;
      out[s.single] += single;
      out[s.forward] += forward;
      sums.here[k] = {single, forward};
      continue;
    }
    if (!sharp(g)) {
      // These fields are per extinction without the forward peak.
      const double single = fields_.scaled_extinction() * piece.w * fields[s.field_single];
      sums.here[k] = {single, std::max(0.0, piece.scaled * fields[s.field_single] - single)};
      continue;
    }
    double irradiance, tau, arriving;
    if (g.group.sun) {
      irradiance = in_colour(g.group.sun->irradiance(), colour_);
      tau = g.sun[time_of(media)].at(here);
      arriving = attenuation(tau);
      // Of a sun in one medium the angle does not change along the ray.
      if (media.media().size() > 1) look_from_sun(media, ray, g_mean, k, sums);
    } else {
      const LocalLight light = local_light(*g.group.lights[0], p);
      irradiance = in_colour(light.irradiance, colour_);
      tau = fields[s.field_depth];
      arriving = light.transmittance(tau);
      look_from(media, glm::dot(light.towards, ray.d), g_mean, light.mean_cosine(), k, sums);
    }
    if (!g.visible.empty()) irradiance *= fields[s.field_visible];
    irradiance *= albedo;
    const std::array<double, 4>& phase = sums.phases[k];
    const double v16 = attenuation(tau / 16), v8 = v16 * v16, v4 = v8 * v8, v2 = v4 * v4;
    const double single = piece.w * irradiance * phase[0] * arriving;
    out[s.single] += single;
    const double peak = (1 - fields_.scaled_extinction()) * (tau + piece.depth / piece.thickness);
    const double forward = piece.w * irradiance * arriving * sums.peaks[k].repeated(peak);
    out[s.forward] += forward;
    sums.here[k] = {single, forward};
    out[s.octave] += piece.w2 * irradiance * phase[1] * v2;
    out[s.octave + 1] += piece.w4 * irradiance * phase[2] * v4;
    out[s.octave + 2] += piece.w8 * irradiance * phase[3] * v8;
    const double even = piece.w * irradiance / (4 * kPi);
    out[s.soft] += even * v2;
    out[s.soft + 1] += even * v4;
    out[s.soft + 2] += even * v8;
    out[s.soft + 3] += even * v16;
  }
  if (media.mixed_tints()) add_tinted(piece, fields, sums);
}

void GuideMarch::add_tinted(const Piece& piece, const float* fields, Sums& sums) const {
  if (!(piece.albedo > 0)) return;
  // In steps, so that it seldom changes.
  constexpr double kSteps = 4096;
  const dvec3 tint = glm::round(piece.tint / piece.albedo * kSteps) / kSteps;
  if (tint != sums.tint.once()) sums.tint = OrderTint(tint);
  for (size_t k = 0; k < slots_.size(); ++k) {
    const GroupLight& g = fields_.groups()[k];
    const dvec3 colour = colour_of(g), once = sums.here[k].single * sums.tint.once();
    dvec3 more = sums.here[k].forward * sums.tint.forward();
    for (size_t order = 0; order < kOrders; ++order)
      more += piece.scaled * fields[slots_[k].field_orders + order] * sums.tint.of_guide(order);
    (from_surfaces(g) ? sums.tinted_indirect : sums.tinted_direct) += colour * once;
    sums.tinted_indirect += colour * more;
  }
}

// What is a field times a weight has been summed for all fields at once.
void GuideMarch::collect_fields(Sums& sums) const {
  std::vector<double>& out = sums.value;
  for (size_t k = 0; k < slots_.size(); ++k) {
    const GroupLight& g = fields_.groups()[k];
    const Slots& s = slots_[k];
    for (size_t order = 0; order < kOrders; ++order) out[s.orders + order] = sums.scaled[s.field_orders + order];
    out[s.flux] = sums.scaled[s.field_orders + kOrders];
    // These fields are per extinction without the forward peak.
    const double once = fields_.scaled_extinction() * sums.plain[s.field_single];
    if (!sharp(g) && !is_sky(g)) out[s.forward] = std::max(0.0, sums.scaled[s.field_single] - once);
    if (is_sky(g)) {
      out[s.soft] = sums.plain[s.field_single + 1];
      out[s.soft + 1] = sums.plain[s.field_single + 2];
    } else if (!sharp(g)) {
      out[s.single] = once;
    }
  }
}

vec3 GuideMarch::predicted_direct(const Sums& sums) const {
  vec3 light = sums.background + sums.emission + sums.emission_once + sums.mirrored + vec3(sums.tinted_direct);
  const bool mixed = media_[0].mixed_tints();
  for (size_t k = 0; k < slots_.size(); ++k) {
    const GroupLight& g = fields_.groups()[k];
    if (from_surfaces(g)) continue;
    light += sums.surface[k];
    if (!mixed) light += tinted(tint_.once() * colour_of(g), sums.value[slots_[k].single]);
  }
  return light;
}

vec3 GuideMarch::predicted_indirect(const Sums& sums) const {
  vec3 light = sums.indirect + sums.mirrored_indirect + sums.behind + vec3(sums.tinted_indirect);
  if (media_[0].mixed_tints()) return light;
  for (size_t k = 0; k < slots_.size(); ++k) {
    const GroupLight& g = fields_.groups()[k];
    light += tinted(tint_.forward() * colour_of(g), sums.value[slots_[k].forward]);
    if (from_surfaces(g)) light += tinted(tint_.once() * colour_of(g), sums.value[slots_[k].single]);
    for (size_t order = 0; order < kOrders; ++order)
      light += tinted(tint_.of_guide(order) * colour_of(g), sums.value[slots_[k].orders + order]);
  }
  return light;
}

GuideMarch::Shaded GuideMarch::shaded(const Ray& ray, const SurfaceHit& hit) const {
  const bool front = glm::dot(hit.normal, ray.d) < 0;
  // As the tracer: the shading normal's angles, but the geometry's side.
  const dvec3 outside = front ? hit.normal : -hit.normal, smooth = front ? hit.shading : -hit.shading;
  const dvec3 normal = glm::dot(-ray.d, smooth) > 1e-4 ? smooth : outside;
  const dvec3 p = ray.at(hit.t);
  return {p, Surfaces::leave(hit, p, -ray.d), normal, -ray.d, !front, context_.surfaces->bsdf(hit), Frame(normal)};
}

// Lit by every light's irradiance through the medium, and by the sky; metals and glass show what they mirror.
void GuideMarch::add_surface(const Eye& eye, const Ray& ray, const SurfaceHit& hit, const Passed& passed,
                             const GuideMedia& media, MediaLine& line, Sums& sums) const {
  const Shaded at = shaded(ray, hit);
  const double straight = passed.straight;
  sums.normal += tinted(at.normal, straight);
  sums.surface_albedo += tinted(at.bsdf.albedo, straight);
  sums.surface_depth += straight * (hit.t - reference_depth_);
  sums.material[static_cast<int>(at.bsdf.kind)] += static_cast<float>(straight);
  if (!at.inside) sums.background += tinted(context_.surfaces->settings(hit.surface).radiance, straight);
  dvec3 indirect = indirect_light_on(at), leaving(0);
  for (size_t k = 0; k < slots_.size() && !at.bsdf.delta(); ++k) {
    const Lit light = light_on(at, k);
    sums.surface[k] += tinted(light.direct, straight);
    leaving += light.direct;
    indirect += light.indirect;
  }
  sums.indirect += tinted(indirect, straight);
  leaving += indirect;
  if (at.bsdf.kind != Bsdf::Kind::kDiffuse) {
    const Seen seen = mirrored(eye, at, hit, media, line);
    sums.mirrored += tinted(seen.straight, straight);
    sums.mirrored_indirect += tinted(seen.scattered, straight);
    leaving += seen.straight + seen.scattered;
  }
  sums.behind += tinted(leaving, passed.peaks);
}

Surroundings GuideMarch::surroundings() const {
  return {fields_.lattice(), fields_.scaled_extinction(), *context_.lights,       *context_.surfaces,
          colour_,           fields_.ambient_light(),     fields_.surface_light()};
}

dvec3 GuideMarch::indirect_light_on(const Shaded& at) const {
  const AmbientLight* const ambient = fields_.ambient_light();
  if (!ambient || at.bsdf.kind != Bsdf::Kind::kDiffuse) return dvec3(0);
  return at.bsdf.albedo * ambient->onto(at.p, at.normal).scattered;
}

Lit GuideMarch::light_on(const Shaded& at, size_t group) const {
  const GroupLight& g = fields_.groups()[group];
  Lit light;
  if (at.bsdf.kind == Bsdf::Kind::kDiffuse) {
    light.add(at.bsdf.albedo, diffuse_light(g, surroundings(), at.p, at.normal));
  } else if (sharp(g)) {
    const Beam beam = beam_at(g, surroundings(), at.p);
    if (glm::dot(beam.towards, at.normal) > 0 && beam.passed.direct != dvec3(0))
      light.add(highlight(at, *g.group.lights[0]), beam.passed);
  }
  return light;
}

}  // namespace brume
