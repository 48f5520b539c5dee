#include "render/world/atmosphere_sky.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "base/parallel_for.h"
#include "render/world/atmosphere.h"
#include "render/world/camera.h"
#include "render/world/sky.h"
#include "volume/medium.h"

namespace brume {
namespace {

constexpr double kLeastAltitude = 1;  // metres: just above the ground
constexpr double kAirUpwards = 0.1;   // of how far it reaches to the sides
constexpr double kKilolux = 128;      // of the sun before the atmosphere, as Preetham's has

Atmosphere atmosphere_of(const EnvironmentSettings& s) {
  return Atmosphere(s.turbidity, s.ground_albedo);
}
double altitude_of(const EnvironmentSettings& s) {
  return std::max(kLeastAltitude, s.altitude);
}

/// The box of the scene's own air around the eye, in metres, axes right, forward, up. It is flat: haze is seen towards
/// the horizon, and guides have so many nodes for all of it.
HomogeneousShape air_box(const EnvironmentSettings& s) {
  const double reach = s.air * s.metres_per_unit, up = kAirUpwards * reach;
  return {HomogeneousShape::Shape::kBox, {-reach, -reach, -std::min(altitude_of(s), reach)}, {reach, reach, up}};
}

}  // namespace

AtmosphereSky::AtmosphereSky(const Scene& scene, const Task& task) {
  const EnvironmentSettings& s = scene.environment;
  const SkyFrame frame(s.up);
  const dvec3 towards = glm::normalize(s.sun_direction);
  const double sun_sine = glm::dot(towards, frame.up);
  const Atmosphere atmosphere = atmosphere_of(s);
  const AtmosphereLight light(atmosphere, sun_sine, task);

  // From here on in metres around the eye: x, y to the right and forward in the frame, z up.
  const dvec3 eye{0, 0, Atmosphere::kGround + altitude_of(s)};
  const dvec3 sun{glm::dot(towards, frame.right), glm::dot(towards, frame.forward), sun_sine};
  const HomogeneousShape box = air_box(s);
  const auto begin = [&](const dvec3& d) { return s.air > 0 ? eye + box.intersect({dvec3(0), d}).second * d : eye; };

  // Both sides of the sun are alike: rows of elevations by angles to its azimuth, finer near it.
  constexpr int kWidth = 1024, kHeight = 512, kTurns = 97;
  const double azimuth = std::atan2(sun.x, sun.y);
  std::vector<dvec3> half(static_cast<size_t>(kHeight) * kTurns);
  parallel_for(kHeight, quiet(task), [&](int y) {
    const double theta = kPi * (y + 0.5) / kHeight;
    for (int k = 0; k < kTurns; ++k) {
      const double u = k / (kTurns - 1.0), phi = azimuth + kPi * u * u;
      const dvec3 d{std::sin(theta) * std::sin(phi), std::sin(theta) * std::cos(phi), std::cos(theta)};
      dvec3 from = begin(d);
      // On the sea the box ends where the ground is.
      if (const double r = glm::length(from); r < Atmosphere::kGround + kLeastAltitude)
        from *= (Atmosphere::kGround + kLeastAltitude) / r;
      half[static_cast<size_t>(y) * kTurns + k] = kKilolux * light.radiance(from, d, sun);
    }
  });
  picture_ = Layers(kWidth, kHeight);
  const auto rgb = picture_.add_rgb(layer::beauty);
  for (int x = 0; x < kWidth; ++x) {
    double away = std::abs(2 * kPi * ((x + 0.5) / kWidth - 0.5) - azimuth);
    if (away > kPi) away = 2 * kPi - away;
    const double place = std::sqrt(away / kPi) * (kTurns - 1);
    const int k = std::min(static_cast<int>(place), kTurns - 2);
    for (int y = 0; y < kHeight; ++y) {
      const dvec3* const at = half.data() + static_cast<size_t>(y) * kTurns + k;
      const dvec3 L = glm::mix(at[0], at[1], place - k);
      for (size_t c = 0; c < 3; ++c) (*rgb[c])(x, y) = static_cast<float>(L[static_cast<int>(c)]);
    }
  }

  sun_.type = "sun";
  sun_.direction = s.sun_direction;
  sun_.visible_to_camera = s.visible_to_camera;
  // Strips of the disc from its lower to its upper edge.
  constexpr int kStrips = 16;
  const double radius = 0.5 * sun_.angular_diameter * kPi / 180, elevation = std::asin(std::clamp(sun_sine, -1.0, 1.0));
  dvec3 mean(0);
  double whole = 0;
  for (int i = 0; i < kStrips; ++i) {
    const double h = -1 + 2 * (i + 0.5) / kStrips, wide = std::sqrt(1 - h * h), a = elevation + h * radius;
    const double turn = std::atan2(sun.x, sun.y);
    const dvec3 d{std::cos(a) * std::sin(turn), std::cos(a) * std::cos(turn), std::sin(a)};
    mean += wide * light.transmittance(begin(d), d);
    whole += wide;
  }
  sun_.irradiance = kKilolux * s.radiance * WorkingSpace(scene.film.color_space).of_rec709(mean) / whole;
}

std::vector<VolumeSettings> air_of(const Scene& scene) {
  const EnvironmentSettings& s = scene.environment;
  if (s.sky != "atmosphere" || !(s.air > 0)) return {};
  const Atmosphere atmosphere = atmosphere_of(s);
  const SkyFrame frame(s.up);
  const dvec3 eye = Camera(scene.camera, scene.film.width, scene.film.height).position(0);
  const HomogeneousShape box = air_box(s);
  VolumeSettings air;
  air.shape = "layer";
  air.lo = box.lo / s.metres_per_unit;
  air.hi = box.hi / s.metres_per_unit;
  air.object_to_world = dmat4(dmat3(frame.right, frame.forward, frame.up));
  air.object_to_world[3] = glm::dvec4(eye, 1);
  air.up = {0, 0, 1};
  air.base_height = -altitude_of(s) / s.metres_per_unit;
  VolumeSettings aerosol = air;
  air.sigma_t = atmosphere.air * s.metres_per_unit;
  air.albedo = dvec3(1);
  air.phase = "rayleigh";
  air.scale_height = Atmosphere::kAirScale / s.metres_per_unit;
  aerosol.sigma_t = atmosphere.aerosol * s.metres_per_unit;
  aerosol.albedo = dvec3(atmosphere.aerosol_albedo);
  aerosol.g = atmosphere.aerosol_g;
  aerosol.scale_height = Atmosphere::kAerosolScale / s.metres_per_unit;
  return {air, aerosol};
}

}  // namespace brume
