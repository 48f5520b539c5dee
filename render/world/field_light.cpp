#include "render/world/field_light.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "base/parallel_for.h"

namespace brume {
namespace {

/// Where both techniques are about as good: at so many mean square distances of its light from its centre.
constexpr double kNear = 16;

double volume_of(const Medium& shape) {
  const HomogeneousShape& s = *shape.homogeneous();
  const dvec3 edges = s.hi - s.lo;
  const double filled = s.shape == HomogeneousShape::Shape::kSphere ? kPi / 6 : 1.0;
  return filled * edges.x * edges.y * edges.z * shape.voxel_volume();
}

/// Sum of the squared edges of a box, in world space.
double squared_edges(const Medium& shape, const dvec3& size) {
  double sum = 0;
  for (int a = 0; a < 3; ++a) {
    dvec3 edge(0);
    edge[a] = size[a];
    const dvec3 across = shape.to_world(edge) - shape.to_world(dvec3(0));
    sum += glm::dot(across, across);
  }
  return sum;
}

}  // namespace

FieldLight::FieldLight(const EmissionField& field, std::span<const Medium> media, const Task& task) : field_(field) {
  const Medium& shape = field_.shape();
  if (shape.empty()) return;
  if (!shape.homogeneous()) {
    measure_bricks(media, task);
    return;
  }
  const HomogeneousShape& s = *shape.homogeneous();
  const double volume = volume_of(shape);
  intensity_ = luminance(field_.coefficient()) * volume;
  length_ = std::cbrt(volume);
  centre_ = shape.to_world(0.5 * (s.lo + s.hi));
  const double per_axis = s.shape == HomogeneousShape::Shape::kSphere ? 1.0 / 20 : 1.0 / 12;
  spread_ = per_axis * squared_edges(shape, s.hi - s.lo);
  balls_ = FieldBalls({{intensity_, centre_, spread_}}, media);
}

/// The power of each voxel, from the emission at its corners.
void FieldLight::measure_bricks(std::span<const Medium> media, const Task& task) {
  const Medium& shape = field_.shape();
  const BrickGrid& grid = shape.bricks();
  const int n = grid.cell_size(), Y = grid.stored(), X = Y * Y;
  const size_t values = grid.brick_values();
  densities_.resize(values * grid.brick_count());
  const size_t rows = static_cast<size_t>(n) * n;
  rows_.resize(rows * grid.brick_count());
  struct Moments {
    double sum = 0, squares = 0;
    dvec3 first{0};
    double second = 0;
  };
  std::vector<Moments> bricks(grid.brick_count());
  parallel_for(static_cast<int>(bricks.size()), task, [&](int number) {
    const BrickGrid::Cell cell{static_cast<uint32_t>(number) + 1, 0};
    const float* const v = grid.brick(cell);
    std::vector<float> corner(values);
    for (size_t i = 0; i < values; ++i)
      corner[i] = static_cast<float>(luminance(field_.ramp()(static_cast<double>(v[i]))));
    float* const power = densities_.data() + static_cast<size_t>(number) * values;
    Moments& m = bricks[static_cast<size_t>(number)];
    float* row = rows_.data() + static_cast<size_t>(number) * rows;
    for (int x = 0; x < n; ++x)
      for (int y = 0; y < n; ++y) {
        for (int z = 0; z < n; ++z) {
          const int i = x * X + y * Y + z;
          const float* const c = corner.data() + i;
          const float mean = (c[0] + c[1] + c[Y] + c[Y + 1] + c[X] + c[X + 1] + c[X + Y] + c[X + Y + 1]) / 8;
          if (!(mean > 0)) continue;
          power[i] = mean;
          const double p = static_cast<double>(mean);
          const dvec3 at = shape.to_world(dvec3(x, y, z) + 0.5) - shape.to_world(dvec3(0));
          m.sum += p;
          m.squares += p * p;
          m.first += p * at;
          m.second += p * glm::dot(at, at);
        }
        *row++ = static_cast<float>(m.sum);
      }
  });
  Moments all;
  const double voxel_spread = squared_edges(shape, dvec3(1)) / 12;
  std::vector<FieldBalls::Glow> glows;
  ivec3 c;
  for (c.x = 0; c.x < grid.cells().x; ++c.x)
    for (c.y = 0; c.y < grid.cells().y; ++c.y)
      for (c.z = 0; c.z < grid.cells().z; ++c.z) {
        const uint32_t brick = grid.cell(c).brick;
        if (brick == 0 || !(bricks[brick - 1].sum > 0)) continue;
        const Moments& own = bricks[brick - 1];
        const dvec3 corner = shape.to_world(dvec3(c * n));
        all.sum += own.sum;
        all.squares += own.squares;
        all.first += own.sum * corner + own.first;
        all.second += own.sum * glm::dot(corner, corner) + 2.0 * glm::dot(corner, own.first) + own.second;
        cells_.push_back({c, all.sum});
        const dvec3 middle = own.first / own.sum;
        glows.push_back({own.sum * shape.voxel_volume(), corner + middle,
                         std::max(0.0, own.second / own.sum - glm::dot(middle, middle)) + voxel_spread});
      }
  if (!(all.sum > 0)) return;
  const double voxel = shape.voxel_volume();
  intensity_ = all.sum * voxel;
  length_ = std::cbrt(all.sum * all.sum / all.squares * voxel);
  centre_ = all.first / all.sum;
  spread_ = std::max(0.0, all.second / all.sum - glm::dot(centre_, centre_));
  const auto scale = static_cast<float>(length_ / intensity_);
  for (float& d : densities_) d *= scale;
  balls_ = FieldBalls(std::move(glows), media);
}

double FieldLight::seldom_found(const dvec3& p, double spread) const {
  const double squared = glm::dot(centre_ - p, centre_ - p) + spread, far = squared / (squared + kNear * spread_);
  return std::min(1.0, 2 * far * far);
}

double FieldLight::irradiance(const dvec3& p) const {
  const dvec3 to = centre_ - p;
  return intensity_ > 0 ? intensity_ / (glm::dot(to, to) + spread_) : 0.0;
}

double FieldLight::importance(const dvec3& p) const {
  return irradiance(p) * seldom_found(p);
}

double FieldLight::density(const dvec3& world) const {
  const Medium& shape = field_.shape();
  const dvec3 local = shape.to_local(world);
  if (shape.homogeneous()) return shape.homogeneous()->contains(local) ? length_ / volume_of(shape) : 0.0;
  const BrickGrid& grid = shape.bricks();
  const dvec3 end(grid.cells() * grid.cell_size());
  if (densities_.empty() || !glm::all(glm::greaterThanEqual(local, dvec3(0))) || !glm::all(glm::lessThan(local, end)))
    return 0;
  const ivec3 voxel(local), c = voxel / grid.cell_size(), at = voxel - c * grid.cell_size();
  const uint32_t brick = grid.cell(c).brick;
  if (brick == 0) return 0;
  const int Y = grid.stored();
  return static_cast<double>(
      densities_[(brick - 1) * grid.brick_values() + static_cast<size_t>((at.x * Y + at.y) * Y + at.z)]);
}

/// A point, the density of drawing it times length(), and what is emitted there.
dvec3 FieldLight::draw(Rng& rng, double& density, dvec3& emission) const {
  const Medium& shape = field_.shape();
  if (const auto& s = shape.homogeneous()) {
    dvec3 in_cube;  // of the shape's box, from -1 to 1
    do {
      for (int a = 0; a < 3; ++a) in_cube[a] = 2 * rng.uniform() - 1;
    } while (s->shape == HomogeneousShape::Shape::kSphere && glm::dot(in_cube, in_cube) > 1);
    density = length_ / volume_of(shape);
    emission = field_.coefficient();
    return shape.to_world(0.5 * (s->lo + s->hi) + 0.5 * in_cube * (s->hi - s->lo));
  }
  const double share = rng.uniform() * cells_.back().sum;
  const auto lit = std::upper_bound(cells_.begin(), cells_.end() - 1, share,
                                    [](double u, const LitCell& cell) { return u < cell.sum; });
  const BrickGrid& grid = shape.bricks();
  const BrickGrid::Cell& cell = grid.cell(lit->cell);
  const int n = grid.cell_size(), Y = grid.stored(), X = Y * Y;
  const float* const own = densities_.data() + (cell.brick - 1) * grid.brick_values();
  // First the row of voxels, then the voxel in it.
  const float* const rows = rows_.data() + (cell.brick - 1) * static_cast<size_t>(n) * n;
  const auto u = static_cast<float>(rng.uniform() * static_cast<double>(rows[n * n - 1]));
  const auto r = static_cast<int>(std::upper_bound(rows, rows + n * n - 1, u) - rows);
  const float* const row = own + r / n * X + r % n * Y;
  float left = 0;
  for (int k = 0; k < n; ++k) left += row[k];
  left *= static_cast<float>(rng.uniform());
  int z = -1;
  for (int k = 0; k < n && (z < 0 || !(left < row[z])); ++k) {
    if (!(row[k] > 0)) continue;
    if (z >= 0) left -= row[z];
    z = k;
  }
  density = static_cast<double>(row[z]);
  const dvec3 local =
      dvec3(lit->cell * n + ivec3(r / n, r % n, z)) + dvec3(rng.uniform(), rng.uniform(), rng.uniform());
  emission = field_.ramp()(static_cast<double>(grid.lookup_in(cell, lit->cell, local)));
  return shape.to_world(local);
}

LightSample FieldLight::sample(const dvec3& p, const dvec2& u) const {
  LightSample s;
  if (!(intensity_ > 0)) return s;
  Rng rng(hash_combine(std::bit_cast<uint64_t>(u.x), std::bit_cast<uint64_t>(u.y)));
  double density = 0;
  dvec3 emission;
  const dvec3 to = draw(rng, density, emission) - p;
  const double squared = glm::dot(to, to);
  if (!(squared > 0)) return s;
  s.distance = std::sqrt(squared);
  s.wi = to / s.distance;
  s.radiance = emission * length_;
  s.pdf = density * squared;
  return s;
}

}  // namespace brume
