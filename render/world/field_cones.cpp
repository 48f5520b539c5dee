#include "render/world/field_cones.h"

#include <cmath>

#include "base/math.h"
#include "base/rng.h"
#include "render/world/light_kinds.h"

namespace brume {
namespace {

// Where fire brings all the light and its smoke scatters nearly all of that, so many directions are drawn towards it.
constexpr double kMostShare = 0.4;

// Balls of a field.
constexpr size_t kBalls = 8;

// Radius of a ball over the root of the mean square distance of its light from its centre: 1.3 is a ball of even
// emission. What is around it scatters its light.
constexpr double kWidth = 1.5;

// Points that tell a ball's optical depth.
constexpr int kDepthPoints = 256;

// Least square of a cone's sine: in a narrower one, directions in single precision would be too coarse.
constexpr double kLeastSine2 = 1e-6;

using Glow = FieldBalls::Glow;
using Part = std::vector<Glow>::iterator;

struct Moments {
  double sum = 0, squares = 0;
  dvec3 mean{0}, variance{0};

  Moments(Part begin, Part end) {
    for (Part g = begin; g != end; ++g) {
      sum += g->power;
      mean += g->power * g->centre;
    }
    mean /= sum;
    for (Part g = begin; g != end; ++g) {
      const dvec3 off = g->centre - mean;
      variance += g->power * (off * off + g->spread / 3);
    }
    variance /= sum;
  }
  double spread() const { return variance.x + variance.y + variance.z; }
};

/// Coefficient of scattering at a world point [1 / unit], at the shutter's start.
double scattering(const dvec3& p, std::span<const Medium> media) {
  double sum = 0;
  for (const Medium& m : media)
    m.each_around(p, [&](const Medium& one, size_t number) {
      const dvec3 albedo = m.instances() ? m.albedo(number, p) : m.albedo(p);
      sum += one.sigma_t(one.to_local(p)) * luminance(one.extinction_ratio() * albedo);
    });
  return sum;
}

/// Optical depth of scattering on a ball's mean chord.
double scattering_depth(const dvec3& centre, double radius, std::span<const Medium> media) {
  double sum = 0;
  Rng rng(1);
  for (int k = 0; k < kDepthPoints; ++k) {
    dvec3 p;
    do {
      for (int a = 0; a < 3; ++a) p[a] = 2 * rng.uniform() - 1;
    } while (glm::dot(p, p) > 1);
    sum += scattering(centre + radius * p, media);
  }
  return sum / kDepthPoints * radius * 4 / 3;
}

}  // namespace

dvec3 FieldCones::sample(double choice, const dvec2& u) const {
  size_t k = 0;
  while (k + 1 < count_ && choice >= cones_[k].chosen) ++k;
  return sample_cone(cones_[k].axis, cones_[k].one_minus_cos, u);
}

void FieldCones::add(const dvec3& axis, double one_minus_cos, double irradiance, double scattered) {
  irradiance_ += irradiance;
  const double chosen = irradiance * scattered;
  if (count_ == kMost || !(chosen > 0)) return;
  scattered_ += chosen;
  cones_[count_++] = {axis, one_minus_cos, chosen / (2 * kPi * one_minus_cos), scattered_};
}

void FieldCones::finish(double others) {
  for (size_t k = 0; k < count_; ++k) {
    cones_[k].density /= scattered_;
    cones_[k].chosen /= scattered_;
  }
  share_ = kMostShare * scattered_ / (irradiance_ + others);
}

FieldBalls::FieldBalls(std::vector<Glow> light, std::span<const Medium> media) {
  if (!light.empty()) divide(light.begin(), light.end(), kBalls);
  for (Ball& ball : balls_) {
    const double depth = scattering_depth(ball.centre, ball.radius, media);
    ball.scattered = depth / (1 + depth);
  }
}

bool FieldBalls::scatter() const {
  return std::any_of(balls_.begin(), balls_.end(), [](const Ball& ball) { return ball.scattered > 0; });
}

/// Divides light at its middle, across the axis along which it extends most, into so many parts of equal power.
void FieldBalls::divide(Part begin, Part end, size_t parts) {
  const Moments m(begin, end);
  if (parts == 1 || end - begin == 1) {
    balls_.push_back({m.mean, kWidth * std::sqrt(m.spread()), m.sum});
    return;
  }
  int axis = m.variance.x > m.variance.y ? 0 : 1;
  if (m.variance.z > m.variance[axis]) axis = 2;
  std::sort(begin, end, [axis](const Glow& a, const Glow& b) { return a.centre[axis] < b.centre[axis]; });
  double sum = begin->power;
  Part middle = begin + 1;
  while (middle + 1 != end && sum + 0.5 * middle->power < 0.5 * m.sum) sum += (middle++)->power;
  divide(begin, middle, parts / 2);
  divide(middle, end, parts - parts / 2);
}

void FieldBalls::add_cones(const dvec3& p, const dvec3& normal, FieldCones& cones) const {
  for (const Ball& ball : balls_) {
    const dvec3 to = ball.centre - p;
    const double squared = glm::dot(to, to), radius2 = ball.radius * ball.radius;
    if (!(squared > 0)) continue;
    const double sine2 = std::clamp(radius2 / squared, kLeastSine2, 1.0);
    const dvec3 axis = to / std::sqrt(squared);
    const bool around = normal == dvec3(0) || sine2 == 1;
    const double faces = around ? 1.0 : std::clamp(glm::dot(axis, normal) + std::sqrt(sine2), 0.0, 1.0);
    cones.add(axis, sine2 < 1 ? sine2 / (1 + std::sqrt(1 - sine2)) : 2.0, faces * ball.power / (squared + radius2),
              ball.scattered);
  }
}

}  // namespace brume
