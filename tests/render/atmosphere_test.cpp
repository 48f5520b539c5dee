// The light of an atmosphere (render/world/atmosphere.h) against a path tracer of the same air, aerosol, ozone and
// ground, which shares their densities alone; the sky, sun and air that a scene is given.

#include "render/world/atmosphere.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "base/math.h"
#include "base/parallel_for.h"
#include "base/rng.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "render/world/atmosphere_sky.h"
#include "tests/support/error_of.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

constexpr double kGround = Atmosphere::kGround, kTop = Atmosphere::kTop;

/// Paths of one colour through the atmosphere, in double precision: delta tracking, light of the sun at every event.
class PlainTracer {
 public:
  PlainTracer(Atmosphere a, const dvec3& sun, int colour) : a_(a), sun_(sun), c_(colour) {
    sigma_maj_ = a.air[c_] + a.aerosol[c_] + a.ozone[c_];
  }

  /// Mean radiance and its standard error. The first event of each path lies in one of as many parts of the ray.
  std::pair<double, double> radiance(const dvec3& p, const dvec3& d, int paths, uint64_t seed) const {
    double ground = hits(p, d, kGround);
    const bool meets = ground >= 0;
    const double length = meets ? ground : hits(p, d, kTop);
    constexpr int kSteps = 4000;
    std::vector<double> depth{0};  // in x, t = length x^2
    for (int i = 0; i < kSteps; ++i) {
      const double x0 = i / double{kSteps}, x1 = (i + 1) / double{kSteps}, x = 0.5 * (x0 + x1);
      depth.push_back(depth.back() + extinction(p + length * x * x * d) * length * (x1 * x1 - x0 * x0));
    }
    Rng rng(mix64(seed));
    double sum = 0, squares = 0;
    constexpr int kGroups = 50;
    for (int group = 0; group < kGroups; ++group) {
      double of_group = 0;
      for (int i = 0; i < paths / kGroups; ++i) {
        const double x = (i + rng.uniform()) / (paths / kGroups), at = x * kSteps;
        const auto k = std::min(static_cast<size_t>(at), static_cast<size_t>(kSteps - 1));
        const double tau = depth[k] + (at - static_cast<double>(k)) * (depth[k + 1] - depth[k]);
        const double weight = std::exp(-tau) * 2 * x * length;
        of_group += weight * extinction(p + length * x * x * d) * event(p + length * x * x * d, d, rng);
      }
      of_group /= paths / kGroups;
      sum += of_group;
      squares += of_group * of_group;
    }
    const double mean = sum / kGroups, error = std::sqrt((squares / kGroups - mean * mean) / (kGroups - 1));
    if (!meets) return {mean, error};
    double from_ground = 0;
    const int many = paths / 4;
    for (int i = 0; i < many; ++i) from_ground += on_ground(p + length * d, rng) / many;
    return {mean + std::exp(-depth.back()) * from_ground, error + 0.01 * std::exp(-depth.back()) * from_ground};
  }

  double transmittance(const dvec3& p, const dvec3& d) const {
    if (hits(p, d, kGround) >= 0) return 0;
    const double length = hits(p, d, kTop), middle = std::clamp(-glm::dot(p, d), 0.0, length);
    double tau = 0;
    constexpr int kSteps = 60;
    for (const double part : {length - middle, -middle})
      for (int i = 0; i < kSteps; ++i) {
        const double x0 = i / double{kSteps}, x1 = (i + 1) / double{kSteps}, x = 0.5 * (x0 + x1);
        tau += extinction(p + (middle + part * x * x) * d) * std::abs(part) * (x1 * x1 - x0 * x0);
      }
    return std::exp(-tau);
  }

 private:
  /// Where a ray from inside meets a sphere; the ground: from outside, negative where it does not.
  static double hits(const dvec3& p, const dvec3& d, double radius) {
    const double b = glm::dot(p, d), c = glm::dot(p, p) - radius * radius, within = b * b - c;
    if (radius == kTop) return -b + std::sqrt(std::max(0.0, within));
    return within > 0 && b < 0 ? std::max(0.0, -b - std::sqrt(within)) : -1;
  }
  dvec3 amounts(const dvec3& p) const { return Atmosphere::densities(glm::length(p) - kGround); }
  double extinction(const dvec3& p) const {
    const dvec3 n = amounts(p);
    return a_.air[c_] * n.x + a_.aerosol[c_] * n.y + a_.ozone[c_] * n.z;
  }
  static double rayleigh(double c) { return 3 / (16 * kPi) * (1 + c * c); }
  double henyey(double c) const {
    const double g = a_.aerosol_g;
    return (1 - g * g) / (4 * kPi * std::pow(1 + g * g - 2 * g * c, 1.5));
  }
  static dvec3 around(const dvec3& axis, double cosine, Rng& rng) {
    const SinCos turn = portable_sincos_2pi(rng.uniform());
    const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
    return glm::normalize(Frame(axis).to_world({sine * turn.cos, sine * turn.sin, cosine}));
  }

  /// Light that a collision at p sends back along d, of all orders: per extinction.
  double event(const dvec3& p, const dvec3& d, Rng& rng) const {
    const dvec3 n = amounts(p);
    const double by_air = a_.air[c_] * n.x, by_aerosol = a_.aerosol_albedo * a_.aerosol[c_] * n.y,
                 all = by_air + by_aerosol, sigma = extinction(p);
    if (!(all > 0)) return 0;
    const double c = glm::dot(d, sun_);
    const double light = (by_air * rayleigh(c) + by_aerosol * henyey(c)) * transmittance(p, sun_) / sigma;
    // Roulette with the albedo.
    if (!(rng.uniform() < all / sigma)) return light;
    double cosine;
    if (rng.uniform() < by_air / all) {
      do cosine = 2 * rng.uniform() - 1;
      while (2 * rng.uniform() > 1 + cosine * cosine);
    } else {
      const double g = a_.aerosol_g, s = (1 - g * g) / (1 - g + 2 * g * rng.uniform());
      cosine = (1 + g * g - s * s) / (2 * g);
    }
    return light + along(p, around(d, cosine, rng), rng);
  }
  double on_ground(const dvec3& p, Rng& rng) const {
    const dvec3 up = glm::normalize(p), above = up * (kGround + 0.01);
    const double light = a_.ground_albedo / kPi * std::max(0.0, glm::dot(up, sun_)) * transmittance(above, sun_);
    if (!(rng.uniform() < a_.ground_albedo)) return light;
    return light + along(above, around(up, std::sqrt(rng.uniform()), rng), rng);
  }
  double along(const dvec3& from, const dvec3& d, Rng& rng) const {
    const double ground = hits(from, d, kGround), end = ground >= 0 ? ground : hits(from, d, kTop);
    for (double t = 0;;) {
      t += rng.exponential() / sigma_maj_;
      if (!(t < end)) return ground >= 0 ? on_ground(from + end * d, rng) : 0;
      const dvec3 p = from + t * d;
      if (rng.uniform() < extinction(p) / sigma_maj_) return event(p, d, rng);
    }
  }

  Atmosphere a_;
  dvec3 sun_;
  int c_;
  double sigma_maj_;
};

struct Look {
  double turbidity, sun, elevation, azimuth;  ///< degrees; azimuth from the sun's
  int paths;
};

dvec3 towards(double elevation, double azimuth) {
  const double e = elevation * kPi / 180, a = azimuth * kPi / 180;
  return {std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e)};
}

// From 50 m above the ground, clear and hazy, day and twilight, sky and ground. A difference of 3 % and three times the
// tracer's noise, which is about 1 %, would be found, and of 1 % in the mean over all.
TEST(Atmosphere, IsTheLightOfAPathTracer) {
  const Look looks[] = {{2, 60, 80, 0, 5000},   {4, 60, 80, 0, 5000},    {2, 60, 2, 180, 20000},  {2, 20, 30, 0, 5000},
                        {4, 20, 8, 60, 20000},  {2, 20, -10, 60, 20000}, {4, 60, -40, 0, 20000},  {2, 5, 10, 30, 20000},
                        {4, 5, 60, 90, 40000},  {2, 0.5, 8, 20, 40000},  {2, 0.5, 70, 90, 40000}, {2, -3, 5, 0, 80000},
                        {2, -3, 30, 20, 80000}, {2, -3, 80, 90, 60000},  {2, -6, 8, 0, 80000}};
  constexpr size_t kLooks = std::size(looks);
  std::vector<dvec3> ours(kLooks), ratio(kLooks), error(kLooks);
  const dvec3 eye{0, 0, kGround + 50};
  std::map<std::pair<double, double>, AtmosphereLight> lights;  // by turbidity and sun
  for (size_t k = 0; k < kLooks; ++k) {
    const Look& look = looks[k];
    const auto light =
        lights.try_emplace({look.turbidity, look.sun}, Atmosphere(look.turbidity, 0.3), std::sin(look.sun * kPi / 180))
            .first;
    ours[k] = light->second.radiance(eye, towards(look.elevation, look.azimuth), towards(look.sun, 0));
  }
  parallel_for(static_cast<int>(kLooks) * 3, {}, [&](int i) {
    const auto k = static_cast<size_t>(i / 3);
    const Look& look = looks[k];
    const auto [mean, noise] = PlainTracer(Atmosphere(look.turbidity, 0.3), towards(look.sun, 0), i % 3)
                                   .radiance(eye, towards(look.elevation, look.azimuth), look.paths, mix64(i + 1));
    ratio[k][i % 3] = ours[k][i % 3] / mean;
    error[k][i % 3] = noise / mean;
  });
  double sum = 0, weights = 0;
  int known = 0;
  for (size_t k = 0; k < kLooks; ++k)
    for (int c = 0; c < 3; ++c) {
      const Look& l = looks[k];
      EXPECT_NEAR(ratio[k][c], 1, 0.03 + 3 * error[k][c])
          << "turbidity " << l.turbidity << ", sun at " << l.sun << ", looking to " << l.elevation << " up and "
          << l.azimuth << " aside, colour " << c << ", noise " << error[k][c];
      known += error[k][c] < 0.025;
      const double weight = 1 / (0.01 * 0.01 + error[k][c] * error[k][c]);
      sum += weight * ratio[k][c];
      weights += weight;
    }
  EXPECT_NEAR(sum / weights, 1, 0.01);
  EXPECT_GE(known, 36) << "of " << 3 * kLooks << " values are known well enough to tell";
}

// Towards the sun, from sea level to the top, against quadrature.
TEST(Atmosphere, DimsTheSun) {
  const Atmosphere atmosphere(3, 0.2);
  const AtmosphereLight light(atmosphere, 0.2);
  for (const double height : {1.0, 500.0, 5000.0, 40000.0})
    for (const double sine : {-0.02, 0.0, 0.01, 0.05, 0.2, 0.7, 1.0}) {
      const dvec3 p{0, 0, kGround + height}, d{std::sqrt(1 - sine * sine), 0, sine};
      for (int c = 0; c < 3; ++c) {
        const double expected = PlainTracer(atmosphere, d, c).transmittance(p, d);
        EXPECT_NEAR(light.transmittance(p, d)[c], expected, 0.01 * expected + 1e-4) << height << " " << sine;
      }
    }
}

/// A camera 500 m above the sea, a sky alone; lengths in kilometres.
Scene sky_scene(double elevation, double air) {
  Scene s;
  s.film.width = s.film.height = 8;
  s.camera.position = dvec3(3, -2, 4);
  const double e = elevation * kPi / 180;
  s.camera.look_at = s.camera.position + dvec3(0.6 * std::cos(e), 0.8 * std::cos(e), std::sin(e));
  s.camera.fov = 1;
  s.environment.sky = "atmosphere";
  s.environment.radiance = dvec3(1);
  s.environment.turbidity = 2.5;
  s.environment.sun_direction = dvec3(0.8, -0.3, 0.4);
  s.environment.altitude = 500;
  s.environment.air = air;
  s.environment.metres_per_unit = 1000;
  return s;
}

dvec3 seen(const Scene& s, int spp) {
  return test::mean_radiance(PreparedScene(s, {}).render(spp, 1, {}).layers).value;
}

// The picture that a scene is lit by is the solved light, and the sun what the air leaves of it.
TEST(AtmosphereSky, LightsScenes) {
  for (const double elevation : {50.0, 12.0, 3.0, -20.0}) {
    const Scene s = sky_scene(elevation, 0);
    const dvec3 sun = glm::normalize(s.environment.sun_direction), d = s.camera.look_at - s.camera.position;
    const AtmosphereLight light(Atmosphere(2.5, s.environment.ground_albedo), sun.z);
    const dvec3 eye{0, 0, kGround + 500}, expected = 128.0 * light.radiance(eye, d, sun), is = seen(s, 4);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(is[c], expected[c], 0.01 * expected[c]) << elevation << " " << c;
    const LightSettings of_sky = AtmosphereSky(s, {}).sun();
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(of_sky.irradiance[c], 128 * light.transmittance(eye, sun)[c], 0.01 * of_sky.irradiance[c]);
  }
}

// With the air around the camera as a medium of the scene the same sky is seen, through it.
TEST(AtmosphereSky, IsTheSameThroughTheScenesOwnAir) {
  for (const double elevation : {40.0, 5.0, 1.5}) {
    const dvec3 sky = seen(sky_scene(elevation, 0), 4), through = seen(sky_scene(elevation, 20), 2000);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(through[c], sky[c], 0.05 * sky[c]) << elevation << " " << c;
  }
}

TEST(AtmosphereSky, EndsWithTheSun) {
  Scene s = sky_scene(20, 0);
  double before = 1e9;
  for (const double degrees : {10.0, 1.0, -1.0, -4.0, -6.0}) {
    const double a = degrees * kPi / 180;
    s.environment.sun_direction = dvec3(0.6 * std::cos(a), 0.8 * std::cos(a), std::sin(a));
    const AtmosphereSky sky(s, {});
    EXPECT_EQ(max_component(sky.sun().irradiance) > 0, degrees > -0.8) << degrees;
    const double now = sky.picture().at("G")(512, 200);
    EXPECT_LT(now, before);
    EXPECT_GT(now, 0);
    before = now;
  }
}

TEST(AtmosphereSky, SaysWhatIsWrong) {
  const auto wrong = [](const std::string& keys) {
    return test::error_of(
        [&] { parse_scene("[camera]\nposition = [0, 0, 0]\nlook_at = [0, 1, 0]\n[environment]\n" + keys, "a.toml"); });
  };
  const auto holds = [](const std::string& text, const char* part) {
    return text.find(part) != std::string::npos ? ::testing::AssertionSuccess() : ::testing::AssertionFailure() << text;
  };
  EXPECT_EQ(wrong("sky = \"atmosphere\"\nsun_direction = [1, 0, -0.1]\nair = 3\n"), "");
  EXPECT_TRUE(holds(wrong("sky = \"atmosphere\"\nsun_direction = [1, 0, -0.2]\n"),
                    "'sun_direction' lies more than 6 degrees below the horizon"));
  EXPECT_TRUE(holds(wrong("sky = \"preetham\"\nair = 3\n"), "'air' has no meaning for sky = \"preetham\""));
  EXPECT_TRUE(holds(wrong("altitude = 3\n"), "'altitude' has no meaning for sky = \"none\""));
}

}  // namespace
}  // namespace brume
