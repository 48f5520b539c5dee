#include "render/guides/media_line.h"

#include <algorithm>
#include <bit>
#include <limits>

namespace brume {
namespace {

/// Any medium's density, and its gradient from half a voxel on either side; local space. Gradients know no detail.
double general_density(const Medium& medium, const dvec3& p, bool detailed, dvec3* gradient) {
  if (gradient && !medium.homogeneous())
    for (int a = 0; a < 3; ++a) {
      dvec3 step(0);
      step[a] = 0.5;
      (*gradient)[a] = medium.smooth_density(p + step) - medium.smooth_density(p - step);
    }
  return detailed ? medium.density(p) : medium.smooth_density(p);
}

float lerp(float a, float b, float t) {
  return a + t * (b - a);
}

/// Of values at the corners of a voxel, `x` and `y` floats apart along these axes, at the place f in it. The gradient
/// jumps where voxels meet.
[[gnu::always_inline]] inline float trilinear(const float* b, size_t x, size_t y, const vec3& f, dvec3* gradient) {
  // Edges along z, then faces, then the cube.
  const float z00 = lerp(b[0], b[1], f.z), z01 = lerp(b[y], b[y + 1], f.z), z10 = lerp(b[x], b[x + 1], f.z),
              z11 = lerp(b[x + y], b[x + y + 1], f.z);
  const float y0 = lerp(z00, z01, f.y), y1 = lerp(z10, z11, f.y);
  if (gradient) {
    const float dz0 = lerp(b[1] - b[0], b[y + 1] - b[y], f.y),
                dz1 = lerp(b[x + 1] - b[x], b[x + y + 1] - b[x + y], f.y);
    *gradient = {y1 - y0, lerp(z01 - z00, z11 - z10, f.x), lerp(dz0, dz1, f.x)};
  }
  return lerp(y0, y1, f.x);
}

}  // namespace

MediaLine::MediaLine(const GuideMedia& media, GuideColour colour, bool detailed)
    : media_(media), colour_(colour), detailed_(detailed) {
  for (size_t i = 0; i < media.media().size(); ++i)
    if (!media.media()[i].instances()) locals_.push_back(local_of(detailed ? media.detailed(i) : media.media()[i], i));
  still_ = locals_.size();
  one_ = media.media().size() == 1 && still_ == 1 && !locals_[0].medium->coloured();
}

MediaLine::Local MediaLine::local_of(const Medium& medium, size_t number) const {
  Local local{&medium, number};
  if (detailed_) local.detail = medium.detail();
  if (medium.homogeneous() || medium.displacement()) return local;
  local.bricks = &medium.bricks();
  local.cell_bits = std::countr_zero(static_cast<unsigned>(local.bricks->cell_size()));
  return local;
}

/// The instances of a medium that the line meets.
void MediaLine::add_instances(const Medium& medium, size_t number) {
  const Instances& all = *medium.instances();
  const double per_density = media_.constants_[number].per_density[static_cast<size_t>(colour_ + 1)];
  all.each_met(ray_, kUnbounded, [&](size_t i) {
    Local& local = locals_.emplace_back(local_of(medium, number));
    local.instance = &all[i];
    local.extinction = per_density * all[i].density;
    const dvec3 albedo = medium.albedo() * all[i].tint;
    local.albedo = in_colour(albedo, colour_);
    local.tint = local.albedo > 0 ? albedo / in_colour(albedo, kGrey) : dvec3(1);
    local.ray = all[i].to_local(ray_);
    find_extent(local);
  });
}

void MediaLine::follow(const Ray& ray) {
  ray_ = ray;
  locals_.resize(still_, Local{nullptr, 0});
  for (Local& local : locals_) {
    local.ray = local.medium->to_local(ray);
    find_extent(local);
  }
  if (!media_.instances()) return;
  for (size_t i = 0; i < media_.media().size(); ++i)
    if (media_.media()[i].instances()) add_instances(media_.media()[i], i);
}

// Where the line crosses the box around the medium, with a margin: where the medium ends exactly is found by look-ups.
void MediaLine::find_extent(Local& local) {
  const auto [lo, hi] = local.medium->support();
  local.begin = -std::numeric_limits<double>::infinity();
  local.end = -local.begin;
  for (int a = 0; a < 3; ++a) {
    if (local.ray.d[a] == 0) continue;
    const double margin = 1e-9 * (hi[a] - lo[a]), inverse = 1 / local.ray.d[a];
    const double t0 = (lo[a] - margin - local.ray.o[a]) * inverse, t1 = (hi[a] + margin - local.ray.o[a]) * inverse;
    local.begin = std::max(local.begin, std::min(t0, t1));
    local.end = std::min(local.end, std::max(t0, t1));
  }
}

[[gnu::always_inline]] inline double MediaLine::density(Local& local, double t, dvec3* gradient) {
  if (t < local.begin || t > local.end) return 0;
  const dvec3 p = local.ray.at(t);
  if (!local.bricks) return general_density(*local.medium, p, local.detail != nullptr, gradient);
  const BrickGrid& grid = *local.bricks;
  const dvec3 &lo = grid.support_lo(), &hi = grid.support_hi();
  if (!(p.x > lo.x && p.y > lo.y && p.z > lo.z && p.x < hi.x && p.y < hi.y && p.z < hi.z)) return 0;
  const ivec3 voxel(p), cell = voxel >> local.cell_bits;
  if (cell != local.coordinates) {
    local.coordinates = cell;
    local.cell = &grid.cell(cell);
  }
  if (local.cell->brick == 0) return 0;
  const ivec3 inside = voxel & ((1 << local.cell_bits) - 1);
  const size_t y = static_cast<size_t>(grid.stored()), x = y * y;
  const float* const values = grid.brick(*local.cell) + inside.x * x + inside.y * y + inside.z;
  const auto found = static_cast<double>(trilinear(values, x, y, vec3(p - dvec3(voxel)), gradient));
  return local.detail && found > 0 ? found * local.detail->factor(p) : found;
}

[[gnu::noinline]] double MediaLine::coloured_albedo(const Local& local, double t) const {
  const auto number = static_cast<size_t>(local.instance - local.medium->instances()->data());
  return in_colour(local.medium->albedo(number, ray_.at(t)), colour_);
}

GuideMedia::Point MediaLine::look_up(double t, dvec3* gradient) {
  GuideMedia::Point point;
  if (gradient) *gradient = dvec3(0);
  dvec3 slope(0);
  dvec3* const wanted = gradient ? &slope : nullptr;
  const auto colour = static_cast<size_t>(colour_ + 1);
  if (one_) {
    const double found = density(locals_[0], t, wanted);
    if (!(found > 0)) return point;
    const GuideMedia::Constants& c = media_.constants_[0];
    if (gradient) *gradient = c.per_density[colour] * locals_[0].medium->gradient_to_world(slope);
    return {found * c.per_density[colour],
            c.albedo[colour],
            media_.mean_cosine_[0],
            found * c.inverse_maximum,
            c.tint,
            locals_[0].medium->holdout() ? 0.0 : 1.0,
            c.albedo[colour]};
  }
  double scattered = 0, forward = 0, seen = 0, seen_scattered = 0;
  dvec3 tint(0);
  for (Local& local : locals_) {
    const Medium& m = *local.medium;
    const double found = density(local, t, wanted);
    if (!(found > 0)) continue;
    const GuideMedia::Constants& c = media_.constants_[local.number];
    const Instance* const one = local.instance;
    const double per_density = one ? local.extinction : c.per_density[colour];
    const double sigma = found * per_density;
    if (gradient)
      *gradient += per_density * (one ? glm::transpose(one->to_local.matrix) * slope : m.gradient_to_world(slope));
    const double albedo = m.coloured() ? one ? coloured_albedo(local, t) : in_colour(m.albedo(ray_.at(t)), colour_)
                          : one ? local.albedo
                                       : c.albedo[colour];
    const double sigma_s = sigma * albedo;
    point.sigma_t += sigma;
    scattered += sigma_s;
    if (!m.holdout()) seen += sigma, seen_scattered += sigma_s;
    forward += sigma_s * media_.mean_cosine_[local.number];
    tint += sigma_s * (one ? local.tint : c.tint);
    point.density = std::max(point.density, found * c.inverse_maximum);
  }
  if (point.sigma_t > 0) point.albedo = scattered / point.sigma_t;
  if (media_.holdouts()) {
    if (point.sigma_t > 0) point.seen = seen / point.sigma_t;
    if (seen > 0) point.seen_albedo = seen_scattered / seen;
  }
  if (scattered > 0) {
    point.g = forward / scattered;
    point.tint = tint / scattered;
  }
  return point;
}

}  // namespace brume
