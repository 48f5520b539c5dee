#include "render/transport/lit_balls.h"

#include <algorithm>
#include <cmath>

#include "base/golden_ratio.h"
#include "render/transport/estimator.h"
#include "render/transport/media_flights.h"
#include "render/world/light_tree.h"
#include "render/world/surfaces.h"

namespace brume {
namespace {

constexpr double kDepth = 0.5;  // mean optical depth of a ball's radius
constexpr double kSize = 0.25;  // its largest radius, as a share of the medium's
// Lamps are left to flights where the smoke along a ball's radius scatters a smaller share of their light, and where
// that is a smaller share of all light at the ball's rim.
constexpr double kLeastScattering = 0.02, kLeastShare = 0.01;

double grey(const dvec3& colour) {
  return (colour.x + colour.y + colour.z) / 3;
}

/// The k-th of n points that are spread evenly over a square.
dvec2 spread(int k, int n) {
  return {(k + 0.5) / n, std::fmod(kGoldenRatio * k, 1.0)};
}

/// Extinction and scattering of all media at a point, grey.
dvec2 coefficients_at(std::span<const Medium> media, const dvec3& p) {
  dvec2 sum(0);
  for (const Medium& any : media)
    any.each_around(p, [&](const Medium& m, size_t) {
      const double density = m.density(m.to_local(p));
      if (!(density > 0)) return;
      const dvec3 sigma_t = m.coefficients().sigma_t * density;
      sum += dvec2(grey(sigma_t), grey(sigma_t * m.albedo(p)));
    });
  return sum;
}

/// Evenly over the sphere.
dvec3 direction(const dvec2& u) {
  const double z = 1 - 2 * u.x, s = std::sqrt(std::max(0.0, 1 - z * z));
  const SinCos phi = portable_sincos_2pi(u.y);
  return {s * phi.cos, s * phi.sin, z};
}

/// Mean coefficients along the radii of a ball.
dvec2 mean_coefficients(std::span<const Medium> media, const dvec3& centre, double radius) {
  constexpr int kPoints = 512;
  constexpr double kPlastic = 0.7548776662466927;  // 1 / the plastic number: even beside multiples of the golden ratio
  dvec2 sum(0);
  for (int k = 0; k < kPoints; ++k) {
    const double r = std::fmod(0.5 + k * kPlastic, 1.0);
    sum += coefficients_at(media, centre + radius * r * direction(spread(k, kPoints)));
  }
  return sum / static_cast<double>(kPoints);
}

/// About what all lights bring to a point.
double importance_of_all(const Lights& lights, const dvec3& p) {
  double all = 0;
  for (const Light* light : lights.choice().lights()) all += light->importance(p);
  return all;
}

}  // namespace

std::vector<LitBall> choose_lit_balls(std::span<const Medium> media, const Lights& lights,
                                      std::span<const NearLight> near_lights, std::string_view setting) {
  std::vector<LitBall> balls;
  if (setting == "off" || lights.choice().lights().size() > LightTree::kFew) return balls;
  double most = 0;
  for (const Medium& m : media) most = std::max(most, m.bounding_sphere().radius);
  for (const PointLight* light : lights.points()) {
    const dvec3 centre = *light->centre();
    const bool near = std::any_of(near_lights.begin(), near_lights.end(),
                                  [&](const NearLight& other) { return other.light == light; });
    if (near) continue;
    double radius = kSize * most;
    dvec2 mean = mean_coefficients(media, centre, radius);
    if (mean.x * radius > kDepth) {
      radius *= std::max(0.25, kDepth / (mean.x * radius));
      mean = mean_coefficients(media, centre, radius);
    }
    if (!(mean.y * radius > kLeastScattering)) continue;
    // On the rim, from the lamp and from all lights.
    double from_lamp = 0, from_all = 0;
    constexpr int kDirections = 64;
    for (int k = 0; k < kDirections; ++k) {
      const dvec3 p = centre + radius * direction(spread(k, kDirections));
      from_lamp += light->importance(p) / kDirections;
      from_all += importance_of_all(lights, p) / kDirections;
    }
    const LitBall ball{light, centre, radius, mean.x, mean.y * radius * from_lamp * radius * radius};
    if (ball.importance(radius) > kLeastShare * from_all) balls.push_back(ball);
  }
  return balls;
}

BallSamples::BallSamples(const PathContext& context, PathStates& paths, WorldPaths& world, MediaFlights& flights)
    : c_(context), p_(paths), w_(world), flights_(flights) {
  drawn_.clear();
}

BallSamples::Chances BallSamples::chances(const dvec3& vertex) const {
  Chances of;
  bool inside = false;  // where their light is seldom the most, but has the most noise
  for (const LitBall& ball : c_.plan.lit_balls) {
    const double h = ball.distance(vertex);
    of.total += ball.importance(h);
    inside = inside || h < ball.radius;
  }
  if (inside) return of;
  const double all = importance_of_all(*c_.lights, vertex);
  if (of.total < all) of.any = of.total / all;
  return of;
}

void BallSamples::leave(size_t i) {
  const WorldPaths::Past& past = w_.past[i];
  came_[i] = {w_.from_vertex(i).o, p_.events[i] > 0 && !past.specular, static_cast<double>(p_.pdf[i])};
}

void BallSamples::weigh(const SlotList& shadows) {
  for (const size_t i : shadows)
    p_.contribution.set(i,
                        p_.contribution[i] * static_cast<float>(share_of_flights(i, w_.sampled_light[i], w_.ray[i].o)));
}

double BallSamples::share_of_flights(size_t i, const Light* light, const dvec3& p) const {
  if (!came_[i].scattered) return 1;
  for (const LitBall& ball : c_.plan.lit_balls) {
    if (ball.light != light) continue;
    const dvec3 from_lamp = p - ball.centre, back = p - came_[i].from;
    const double h = ball.distance(came_[i].from), density = ball.density(h, glm::length(from_lamp));
    if (!(density > 0)) return 1;
    return balance(came_[i].pdf, chances(came_[i].from).of(ball, h) * density * glm::dot(back, back) / ball.sigma_t);
  }
  return 1;
}

bool BallSamples::draw_point(size_t i, const dvec3& vertex, uint32_t events, Point& point) {
  if (events + 1 > static_cast<uint32_t>(c_.max_events)) return false;
  PathGenerator numbers(p_, i);
  const std::vector<LitBall>& balls = c_.plan.lit_balls;
  const Chances chances = this->chances(vertex);
  double left = numbers.uniform() * chances.total / chances.any;
  if (left >= chances.total) return false;
  size_t k = 0;
  for (; k + 1 < balls.size(); ++k) {
    const double importance = balls[k].importance(balls[k].distance(vertex));
    if (left < importance) break;
    left -= importance;
  }
  point.ball = &balls[k];
  const double h = balls[k].distance(vertex);
  const dvec2 u = numbers.pair();
  const double r = balls[k].sample(h, numbers.uniform());
  point.density = chances.of(balls[k], h) * balls[k].density(h, r);
  point.p = balls[k].centre + r * direction(u);
  const dvec3 to = point.p - vertex;
  point.distance = glm::length(to);
  if (!(point.distance > 0 && r > 0)) return false;
  point.wi = to / point.distance;
  return true;
}

void BallSamples::add(size_t i, const Scattering& scattering, const Point& point) {
  if (scattering.value == dvec3(0)) return;
  const LitBall& ball = *point.ball;
  const LightSample lamp = ball.light->sample(point.p, dvec2(0.5));
  if (!(lamp.pdf > 0) || lamp.radiance == dvec3(0)) return;
  dvec3 source(0);
  for (const Medium& any : media_at(c_, w_.time[i]))
    any.each_around(point.p, [&](const Medium& m, size_t) {
      const double density = m.density(m.to_local(point.p));
      if (density > 0)
        source +=
            m.coefficients().sigma_t * (density * m.phase().value(glm::dot(point.wi, lamp.wi))) * m.albedo(point.p);
    });
  const double density = point.density;
  const double rival = density * point.distance * point.distance / ball.sigma_t;
  const dvec3 L = scattering.value * source * lamp.radiance *
                  (balance(rival, scattering.pdf) / (density * point.distance * point.distance));
  if (L == dvec3(0)) return;
  to_point_[i] = {{scattering.from, point.wi}, point.distance};
  to_lamp_[i] = {{point.p, lamp.wi}, lamp.distance};
  if (c_.lights->blocked(to_point_[i].ray, point.distance, nullptr) ||
      c_.lights->blocked(to_lamp_[i].ray, lamp.distance, ball.light))
    return;
  lamp_[i] = ball.light;
  light_.set(i, vec3(L));
  drawn_.push(i);
}

void BallSamples::trace() {
  pass(to_lamp_, true);
  pass(to_point_, false);
  for (const size_t i : drawn_) deposit(p_, w_, i, light_[i], p_.events[i] + 1, lamp_[i]->group);
  drawn_.clear();
}

/// What surfaces and media leave on one leg of the way. Between two vertices a flight that goes straight through glass
/// has one more there, so only lamps shine through it.
void BallSamples::pass(std::array<Leg, kPool>& legs, bool from_lamp) {
  drawn_.keep_if([&](size_t i) {
    w_.shadow[i] = legs[i].ray;
    w_.shadow_end[i] = legs[i].end;
    p_.transmittance[i] = 1;
    if (!c_.surfaces) return true;
    const Surfaces::Passage passage = c_.surfaces->passage(legs[i].ray, legs[i].end * (1.0 - 1e-4), w_.time[i]);
    if (passage.light == dvec3(0) || (passage.straight && !from_lamp)) return false;
    light_.set(i, light_[i] * vec3(passage.light));
    return true;
  });
  flights_.shadow(drawn_);
  drawn_.keep_if([&](size_t i) {
    vec3 left = light_[i] * p_.transmittance[i];
    if (c_.plan.chromatic) left *= p_.shadow_colour[i];
    light_.set(i, left);
    return left != vec3(0);
  });
}

}  // namespace brume
