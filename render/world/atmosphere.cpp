#include "render/world/atmosphere.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "base/parallel_for.h"

namespace brume {
namespace {

constexpr double kGround = Atmosphere::kGround, kTop = Atmosphere::kTop;
constexpr int kColumnHeights = 100, kColumnCosines = 128;  // entries of the table of columns
constexpr int kOrders = 5;                                 // that are marched; those beyond are a geometric series
// A step of a ray climbs by this share of the height over which the air changes: of rays that are looked along, and of
// those that solve. A ray counts as climbing by kFlattest of its length at least, so that level ones have steps, too.
constexpr double kStep = 0.2, kCoarseStep = 0.5, kFlattest = 0.02;

double rayleigh_phase(double c) {
  return 3 / (16 * kPi) * (1 + c * c);
}
double aerosol_phase(double g, double c) {
  const double d = 1 + g * g - 2 * g * c;
  return (1 - g * g) / (4 * kPi * d * std::sqrt(d));
}

/// Where a ray leaves a sphere around the origin that it begins in.
double exit_of(double radius, const dvec3& p, const dvec3& d) {
  const double b = glm::dot(p, d), c = (glm::length(p) - radius) * (glm::length(p) + radius);
  return -b + std::sqrt(std::max(0.0, b * b - c));
}
/// Where a ray meets the ground; negative where it does not.
double ground_at(const dvec3& p, const dvec3& d) {
  const double b = glm::dot(p, d), r = glm::length(p), c = (r - kGround) * (r + kGround);
  const double within = b * b - c;
  if (!(b < 0) || !(within > 0)) return -1;
  return std::max(0.0, c / (-b + std::sqrt(within)));  // the nearer root, without cancellation
}

/// The elevation of a row of directions, as its sine: x in -1 .. 1, finer at the horizon.
double sine_of_row(double x) {
  return std::sin(0.5 * kPi * x * std::sqrt(std::abs(x)));
}
double row_of_sine(double sine) {
  const double share = std::asin(std::clamp(sine, -1.0, 1.0)) / (0.5 * kPi);
  return std::cbrt(share * share) * (share < 0 ? -1 : 1);
}
double height_of(double u) {
  return (kTop - kGround) * u * u;
}

// Tables hold fourth roots: light changes by orders of magnitude with height and the sun's angle, and roots are far
// nearer to lines.
vec3 root_of(const vec3& v) {
  return glm::sqrt(glm::sqrt(v));
}
vec3 of_root(const vec3& v) {
  const vec3 square = v * v;
  return square * square;
}

/// Between two entries of a table, the place in it clamped.
struct Between {
  int i;
  double f;
  Between(double place, int count) {
    const double c = std::clamp(place, 0.0, static_cast<double>(count - 1));
    i = std::min(static_cast<int>(c), count - 2);
    f = c - i;
  }
};

/// A direction whose azimuth is `turn` times a half turn from the sun's. @param row  of the elevations, in -1 .. 1
dvec3 direction_at(double row, double turn) {
  const double z = sine_of_row(row), across = std::sqrt(1 - z * z);
  const SinCos a = portable_sincos_2pi(turn / 2);
  return {across * a.cos, across * a.sin, z};
}

}  // namespace

Atmosphere::Atmosphere(double turbidity, double albedo) : ground_albedo(albedo) {
  constexpr double kMicrometres[3] = {0.680, 0.550, 0.440};
  const double depth = (turbidity - 1) * air.y * kAirScale;
  for (int c = 0; c < 3; ++c) aerosol[c] = depth / kAerosolScale * std::pow(kMicrometres[c] / kMicrometres[1], -1.3);
}

dvec3 Atmosphere::densities(double height) {
  const double h = std::max(0.0, height);
  return {std::exp(-h / kAirScale), std::exp(-h / kAerosolScale),
          std::max(0.0, 1 - std::abs(h - kOzoneMiddle) / kOzoneHalfWidth)};
}

/// Where the tables are asked: four entries and their weights.
struct AtmosphereLight::Place {
  size_t entry[4];
  double weight[4];
  Between sun;
};

AtmosphereLight::AtmosphereLight(const Atmosphere& atmosphere, double sun_sine, const Task& task)
    : atmosphere_(atmosphere) {
  // Light that is seen comes from so near that the sun's height is much the same there; near the horizon it matters.
  constexpr double kDegree = kPi / 180;
  const double middle = std::asin(std::clamp(sun_sine, -1.0, 1.0));
  const double step = middle < 15 * kDegree ? 2 : 5;
  for (double a = -16; a <= 16; a += step) suns_.push_back(middle + a * kDegree);
  make_columns();
  solve(task);
}

// Integrals of the densities along rays that do not meet the ground, from a height on: by the root of how far their
// cosine is above that of the horizon.
void AtmosphereLight::make_columns() {
  columns_.resize(static_cast<size_t>(kColumnHeights * kColumnCosines));
  for (int i = 0; i < kColumnHeights; ++i)
    for (int k = 0; k < kColumnCosines; ++k) {
      const double r = kGround + height_of(i / (kColumnHeights - 1.0)), u = k / (kColumnCosines - 1.0);
      const double horizon = -std::sqrt(std::max(0.0, 1 - kGround / r * (kGround / r)));
      const double cosine = horizon + (1 - horizon) * u * u;
      const dvec3 p{0, 0, r}, d{std::sqrt(std::max(0.0, 1 - cosine * cosine)), 0, cosine};
      const double end = exit_of(kTop, p, d), lowest = std::max(0.0, -r * cosine);
      // Simpson's rule in a variable that is fine at the lowest point, on both sides of it.
      dvec3 sum(0);
      const auto integrate = [&](double length, double sign) {
        constexpr int kSteps = 100;
        for (int j = 0; j <= kSteps; ++j) {
          const double x = j / double{kSteps}, weight = j == 0 || j == kSteps ? 1 : j % 2 ? 4 : 2;
          const double t = lowest + sign * length * x * x;
          sum += weight * 2 * x * length / (3 * kSteps) * Atmosphere::densities(glm::length(p + t * d) - kGround);
        }
      };
      integrate(end - lowest, 1);
      if (lowest > 0) integrate(lowest, -1);
      columns_[static_cast<size_t>(i * kColumnCosines + k)] = vec3(glm::log(glm::max(sum, dvec3(1e-20))));
    }
}

dvec3 AtmosphereLight::column(double r, double cosine) const {
  const double horizon = -std::sqrt(std::max(0.0, 1 - kGround / r * (kGround / r)));
  const Between h(std::sqrt(std::max(0.0, r - kGround) / (kTop - kGround)) * (kColumnHeights - 1), kColumnHeights);
  const double above = std::clamp((cosine - horizon) / (1 - horizon), 0.0, 1.0);
  const Between k(std::sqrt(above) * (kColumnCosines - 1), kColumnCosines);
  const vec3* const at = columns_.data() + h.i * kColumnCosines + k.i;
  const auto f = static_cast<float>(k.f);
  const vec3 low = glm::mix(at[0], at[1], f), high = glm::mix(at[kColumnCosines], at[kColumnCosines + 1], f);
  return glm::exp(dvec3(glm::mix(low, high, static_cast<float>(h.f))));
}

dvec3 AtmosphereLight::transmittance(const dvec3& p, const dvec3& d) const {
  if (ground_at(p, d) >= 0) return dvec3(0);
  const double r = std::max(glm::length(p), kGround);
  if (r >= kTop) return dvec3(1);
  return glm::exp(-atmosphere_.extinction(column(r, glm::dot(p, d) / r)));
}

AtmosphereLight::Place AtmosphereLight::place(double r, double sun_sine) const {
  const Between h(std::sqrt(std::max(0.0, r - kGround) / (kTop - kGround)) * (kHeights - 1), kHeights);
  const double angle = std::asin(std::clamp(sun_sine, -1.0, 1.0));
  const Between k((angle - suns_[0]) / (suns_[1] - suns_[0]), static_cast<int>(suns_.size()));
  return {{index(h.i, k.i), index(h.i, k.i + 1), index(h.i + 1, k.i), index(h.i + 1, k.i + 1)},
          {(1 - h.f) * (1 - k.f), (1 - h.f) * k.f, h.f * (1 - k.f), h.f * k.f},
          k};
}

/// Of all orders but the first, towards a direction.
/// @param cosine  to the zenith   @param cos_azimuth  of the angle between its azimuth and the sun's
AtmosphereLight::Mean AtmosphereLight::scattered(const Place& place, double cosine, double cos_azimuth) const {
  const Between row((0.5 + 0.5 * row_of_sine(cosine)) * kElevations - 0.5, kElevations);
  const Between turn(std::acos(std::clamp(cos_azimuth, -1.0, 1.0)) / kPi * kAzimuths - 0.5, kAzimuths);
  Mean sum{};
  for (int corner = 0; corner < 4; ++corner) {
    const Mean* const at = scattered_.data() + place.entry[corner] * kDirections + row.i * kAzimuths + turn.i;
    for (size_t kind = 0; kind < 2; ++kind) {
      const auto f = static_cast<float>(turn.f);
      const vec3 low = glm::mix(at[0][kind], at[1][kind], f),
                 high = glm::mix(at[kAzimuths][kind], at[kAzimuths + 1][kind], f);
      sum[kind] += static_cast<float>(place.weight[corner]) * glm::mix(low, high, static_cast<float>(row.f));
    }
  }
  return {of_root(sum[0]), of_root(sum[1])};
}

dvec3 AtmosphereLight::ground_irradiance(const Place& place, const std::vector<vec3>& of) const {
  const auto i = static_cast<size_t>(place.sun.i);
  return dvec3(of_root(glm::mix(root_of(of[i]), root_of(of[i + 1]), static_cast<float>(place.sun.f))));
}

/// Light scattered along a ray, and what is behind it.
struct AtmosphereLight::Ahead {
  dvec3 L{0}, transmittance{1};
  dvec3 end;  ///< on the ground or the top
  bool meets_ground;
};

/// @param source  of a point, the densities there: scattered light per metre
template <class Source>
AtmosphereLight::Ahead AtmosphereLight::march(const dvec3& p, const dvec3& d, double coarseness,
                                              const Source& source) const {
  const double ground = ground_at(p, d);
  Ahead ahead;
  ahead.meets_ground = ground >= 0;
  const double length = ahead.meets_ground ? ground : exit_of(kTop, p, d);
  ahead.end = p + length * d;
  for (double t = 0; t < length;) {
    const dvec3 from = p + t * d;
    const double r = glm::length(from), h = r - kGround, climb = std::abs(glm::dot(from, d)) / r;
    // How far the height changes much: the air's scale grows with it, as ozone and aerosol give way to the air.
    const double scale = Atmosphere::kAerosolScale + 0.3 * std::max(h, 0.0);
    const double step = std::min(coarseness * scale / std::max(climb, kFlattest), length - t);
    const dvec3 middle = p + (t + 0.5 * step) * d;
    const dvec3 amounts = Atmosphere::densities(glm::length(middle) - kGround);
    const dvec3 sigma = atmosphere_.extinction(amounts), passes = glm::exp(-step * sigma);
    dvec3 seen;  // integral of the transmittance over the step
    for (int c = 0; c < 3; ++c) seen[c] = sigma[c] * step > 1e-6 ? (1 - passes[c]) / sigma[c] : step;
    ahead.L += ahead.transmittance * seen * source(middle, amounts);
    ahead.transmittance *= passes;
    t += step;
  }
  return ahead;
}

/// Of all orders but the first, from a point towards a direction.
AtmosphereLight::Mean AtmosphereLight::scattered(const dvec3& p, const dvec3& d, const dvec3& sun) const {
  const double r = glm::length(p);
  const dvec3 up = p / r;
  const double cosine = glm::dot(d, up), sun_sine = glm::dot(sun, up);
  const double across = std::sqrt(std::max(1e-12, (1 - cosine * cosine) * (1 - sun_sine * sun_sine)));
  return scattered(place(r, sun_sine), cosine, (glm::dot(d, sun) - cosine * sun_sine) / across);
}

/// What the ground at the end of a ray reflects. @param irradiance  of the ground, by sun
dvec3 AtmosphereLight::ground_radiance(const Ahead& ahead, const dvec3& sun,
                                       const std::vector<vec3>& irradiance) const {
  if (!ahead.meets_ground) return dvec3(0);
  return ahead.transmittance * atmosphere_.ground_albedo / kPi *
         ground_irradiance(place(kGround, glm::dot(sun, ahead.end) / glm::length(ahead.end)), irradiance);
}

/// The directions of the tables: on one side of the sun's azimuth, which is that of x.
struct AtmosphereLight::Directions {
  std::vector<dvec3> d;
  std::vector<double> solid;  ///< solid angle of each and its mirror image

  Directions() {
    for (int row = 0; row < kElevations; ++row)
      for (int turn = 0; turn < kAzimuths; ++turn) {
        const auto edge = [](int i) { return sine_of_row(2.0 * i / kElevations - 1); };
        d.push_back(direction_at(2 * (row + 0.5) / kElevations - 1, (turn + 0.5) / kAzimuths));
        solid.push_back((edge(row + 1) - edge(row)) * 2 * kPi / kAzimuths);
      }
  }
  /// Mean of the aerosol's phase function from the sun over the cell of a direction: its peak is narrower than a cell.
  static double mean_aerosol_phase(double g, const dvec3& sun, int direction) {
    constexpr int kParts = 5;
    double sum = 0;
    for (int i = 0; i < kParts * kParts; ++i) {
      const double row = direction / kAzimuths + (i / kParts + 0.5) / kParts,
                   turn = direction % kAzimuths + (i % kParts + 0.5) / kParts;
      sum += aerosol_phase(g, glm::dot(direction_at(2 * row / kElevations - 1, turn / kAzimuths), sun));
    }
    return sum / (kParts * kParts);
  }
  /// Which share of the light that comes from a direction and its mirror image goes to another: a row for each that it
  /// goes to, which adds up to one, as no light is lost.
  template <class Phase>
  std::vector<float> scattering_matrix(const Phase& phase) const {
    std::vector<float> matrix(kDirections * kDirections);
    for (size_t i = 0; i < kDirections; ++i) {
      double sum = 0;
      std::array<double, kDirections> row;
      for (size_t j = 0; j < kDirections; ++j) {
        const dvec3 mirrored = d[j] * dvec3(1, -1, 1);
        row[j] = 0.5 * solid[j] * (phase(glm::dot(d[i], d[j])) + phase(glm::dot(d[i], mirrored)));
        sum += row[j];
      }
      for (size_t j = 0; j < kDirections; ++j) matrix[i * kDirections + j] = static_cast<float>(row[j] / sum);
    }
    return matrix;
  }
};

/// Light of one order that arrives at a place of the tables.
struct AtmosphereLight::Arriving {
  std::array<vec3, kDirections> L;
  dvec3 down{0};  ///< irradiance from above, at the ground alone
};

/// @param first  whether light is scattered once; later orders are scattered from scattered_, which holds the one
/// before
/// @param lit    irradiance of the ground by the order before, by sun
AtmosphereLight::Arriving AtmosphereLight::arriving(bool first, int height, double angle, const Directions& directions,
                                                    const std::vector<vec3>& lit) const {
  const dvec3 sun{std::cos(angle), 0, std::sin(angle)};
  // Just inside: rays from the ground and the top do not begin outside.
  const double h = std::clamp(height_of(height / (kHeights - 1.0)), 1.0, kTop - kGround - 1);
  Arriving to;
  for (size_t i = 0; i < kDirections; ++i) {
    const dvec3& d = directions.d[i];
    const double rayleigh = rayleigh_phase(glm::dot(d, sun));
    const double aerosol = first ? Directions::mean_aerosol_phase(atmosphere_.aerosol_g, sun, static_cast<int>(i)) : 0;
    const auto source = [&](const dvec3& p, const dvec3& amounts) -> dvec3 {
      const dvec3 by_air = atmosphere_.air * amounts.x,
                  by_aerosol = atmosphere_.aerosol_albedo * atmosphere_.aerosol * amounts.y;
      if (first) return (by_air * rayleigh + by_aerosol * aerosol) * transmittance(p, sun);
      const Mean mean = scattered(p, d, sun);
      return by_air * dvec3(mean[0]) + by_aerosol * dvec3(mean[1]);
    };
    const Ahead ahead = march({0, 0, kGround + h}, d, kCoarseStep, source);
    const dvec3 light = ahead.L + ground_radiance(ahead, sun, lit);
    to.L[i] = vec3(light);
    if (height == 0 && d.z > 0) to.down += directions.solid[i] * d.z * light;
  }
  return to;
}

/// One order of scattering after the other; those after kOrders as a geometric series.
void AtmosphereLight::solve(const Task& task) {
  const Directions directions;
  const std::array<std::vector<float>, 2> matrices = {
      directions.scattering_matrix(rayleigh_phase),
      directions.scattering_matrix([&](double c) { return aerosol_phase(atmosphere_.aerosol_g, c); })};
  const size_t places = static_cast<size_t>(kHeights) * suns_.size();
  scattered_.assign(places * kDirections, Mean{});
  std::vector<Mean> total = scattered_, order(places * kDirections);
  std::vector<vec3> ground(suns_.size()), lit;  // irradiance by an order; by the one before, first by the sun
  for (const double angle : suns_) {
    const dvec3 sun{std::cos(angle), 0, std::sin(angle)};
    lit.emplace_back(transmittance({0, 0, kGround}, sun) * std::max(0.0, sun.z));
  }
  irradiance_ = lit;
  for (int n = 1; n <= kOrders; ++n) {
    parallel_for(static_cast<int>(places), quiet(task), [&](int number) {
      const auto at = static_cast<size_t>(number), sun = at % suns_.size();
      const auto height = static_cast<int>(at / suns_.size());
      const Arriving light = arriving(n == 1, height, suns_[sun], directions, lit);
      if (height == 0) ground[sun] = vec3(light.down);
      for (size_t i = 0; i < kDirections; ++i)
        for (size_t kind = 0; kind < 2; ++kind) {
          vec3 sum(0);
          const float* const row = matrices[kind].data() + i * kDirections;
          for (size_t j = 0; j < kDirections; ++j) sum += row[j] * light.L[j];
          order[at * kDirections + i][kind] = sum;
        }
    });
    dvec3 now(0), before(0);
    for (size_t k = 0; k < ground.size(); ++k) {
      now += dvec3(ground[k]);
      before += dvec3(lit[k]);
    }
    // The last one with all that follow, each the same share of the one before it.
    const dvec3 share = now / glm::max(before, dvec3(1e-30));
    const vec3 factor = n < kOrders ? vec3(1) : vec3(1.0 / (1.0 - glm::min(share, dvec3(0.9))));
    for (size_t i = 0; i < total.size(); ++i)
      for (size_t kind = 0; kind < 2; ++kind) {
        total[i][kind] += factor * order[i][kind];
        scattered_[i][kind] = root_of(order[i][kind]);
      }
    for (size_t k = 0; k < ground.size(); ++k) irradiance_[k] += factor * ground[k];
    lit = ground;
  }
  for (size_t i = 0; i < total.size(); ++i)
    for (size_t kind = 0; kind < 2; ++kind) scattered_[i][kind] = root_of(total[i][kind]);
}

dvec3 AtmosphereLight::radiance(const dvec3& p, const dvec3& d, const dvec3& sun) const {
  const double to_sun = glm::dot(d, sun);
  const double rayleigh = rayleigh_phase(to_sun), aerosol = aerosol_phase(atmosphere_.aerosol_g, to_sun);
  const Ahead ahead = march(p, d, kStep, [&](const dvec3& at, const dvec3& amounts) -> dvec3 {
    const dvec3 once = transmittance(at, sun);
    const Mean mean = scattered(at, d, sun);
    return atmosphere_.air * amounts.x * (rayleigh * once + dvec3(mean[0])) +
           atmosphere_.aerosol_albedo * atmosphere_.aerosol * amounts.y * (aerosol * once + dvec3(mean[1]));
  });
  return ahead.L + ground_radiance(ahead, sun, irradiance_);
}

}  // namespace brume
