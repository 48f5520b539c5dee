#include "render/world/sky.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"

namespace brume {
namespace {

struct Perez {
  double a, b, c, d, e;
  double operator()(double cos_theta, double gamma) const {
    const double cos_gamma = std::cos(gamma);
    return (1.0 + a * std::exp(b / cos_theta)) * (1.0 + c * std::exp(d * gamma) + e * cos_gamma * cos_gamma);
  }
};

double sun_zenith_angle(const dvec3& sun, const dvec3& up) {
  // The model ends at the horizon.
  return std::min(std::acos(std::clamp(glm::dot(glm::normalize(sun), up), -1.0, 1.0)), 0.495 * kPi);
}

dvec3 rgb_of_xyy(double x, double y, double Y) {
  const double X = Y * x / y, Z = Y * (1.0 - x - y) / y;
  return glm::max(dvec3(3.2404542 * X - 1.5371385 * Y - 0.4985314 * Z, -0.9692660 * X + 1.8760108 * Y + 0.0415560 * Z,
                        0.0556434 * X - 0.2040259 * Y + 1.0572252 * Z),
                  dvec3(0));
}

}  // namespace

SkyFrame::SkyFrame(const dvec3& up_direction) : up(glm::normalize(up_direction)) {
  const dvec3 reference = std::abs(up.z) > 0.5 ? dvec3(0, 1, 0) : dvec3(0, 0, -1);
  right = glm::normalize(glm::cross(reference, up));
  forward = glm::cross(up, right);
}

Layers preetham_sky(const EnvironmentSettings& s) {
  const SkyFrame frame(s.up);
  const double t = s.turbidity, theta_s = sun_zenith_angle(s.sun_direction, frame.up);
  const Perez luminance_of{0.1787 * t - 1.4630, -0.3554 * t + 0.4275, -0.0227 * t + 5.3251, 0.1206 * t - 2.5771,
                           -0.0670 * t + 0.3703};
  const Perez x_of{-0.0193 * t - 0.2592, -0.0665 * t + 0.0008, -0.0004 * t + 0.2125, -0.0641 * t - 0.8989,
                   -0.0033 * t + 0.0452};
  const Perez y_of{-0.0167 * t - 0.2608, -0.0950 * t + 0.0092, -0.0079 * t + 0.2102, -0.0441 * t - 1.6537,
                   -0.0109 * t + 0.0529};
  const double chi = (4.0 / 9.0 - t / 120.0) * (kPi - 2.0 * theta_s);
  const double zenith_Y = std::max(0.0, (4.0453 * t - 4.9710) * std::tan(chi) - 0.2155 * t + 2.4192);
  const auto zenith = [&](const double(&m)[3][4]) {
    double value = 0;
    const double powers[3] = {t * t, t, 1.0};
    for (int i = 0; i < 3; ++i)
      value += powers[i] * (((m[i][0] * theta_s + m[i][1]) * theta_s + m[i][2]) * theta_s + m[i][3]);
    return value;
  };
  const double zenith_x = zenith({{0.00166, -0.00375, 0.00209, 0.0},
                                  {-0.02903, 0.06377, -0.03202, 0.00394},
                                  {0.11693, -0.21196, 0.06052, 0.25886}});
  const double zenith_y = zenith({{0.00275, -0.00610, 0.00317, 0.0},
                                  {-0.04214, 0.08970, -0.04153, 0.00516},
                                  {0.15346, -0.26756, 0.06670, 0.26688}});

  constexpr int kWidth = 512, kHeight = 256;
  Layers picture(kWidth, kHeight);
  const auto rgb = picture.add_rgb(layer::beauty);
  const dvec3 horizontal = s.sun_direction - glm::dot(s.sun_direction, frame.up) * frame.up;
  const dvec3 azimuth = glm::length(horizontal) > 1e-9 ? glm::normalize(horizontal) : frame.forward;
  const dvec3 sun = std::cos(theta_s) * frame.up + std::sin(theta_s) * azimuth;
  dvec3 irradiance(0);
  for (int y = 0; y < kHeight / 2; ++y) {
    const double theta = kPi * (y + 0.5) / kHeight, cos_theta = std::cos(theta);
    const double band = std::cos(kPi * y / kHeight) - std::cos(kPi * (y + 1) / kHeight);
    for (int x = 0; x < kWidth; ++x) {
      const double phi = 2.0 * kPi * ((x + 0.5) / kWidth - 0.5);
      const dvec3 d =
          cos_theta * frame.up + std::sin(theta) * (std::sin(phi) * frame.right + std::cos(phi) * frame.forward);
      const double gamma = std::acos(std::clamp(glm::dot(d, sun), -1.0, 1.0));
      const auto at = [&](const Perez& f, double at_zenith) {
        return at_zenith * f(cos_theta, gamma) / f(1.0, theta_s);
      };
      const dvec3 colour =
          rgb_of_xyy(at(x_of, zenith_x), at(y_of, zenith_y), std::max(0.0, at(luminance_of, zenith_Y)));
      for (size_t c = 0; c < 3; ++c) (*rgb[c])(x, y) = static_cast<float>(colour[static_cast<int>(c)]);
      irradiance += colour * cos_theta * band * (2.0 * kPi / kWidth);
    }
  }
  if (s.sky_sun) {
    EnvironmentSettings unit = s;
    unit.radiance = dvec3(1);
    irradiance += preetham_sun(unit).irradiance * std::max(0.0, glm::dot(glm::normalize(s.sun_direction), frame.up));
  }
  for (int y = kHeight / 2; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (size_t c = 0; c < 3; ++c)
        (*rgb[c])(x, y) = static_cast<float>(s.ground_albedo * irradiance[static_cast<int>(c)] / kPi);
  return picture;
}

LightSettings preetham_sun(const EnvironmentSettings& s, const WorkingSpace& space) {
  const dvec3 up = glm::normalize(s.up);
  const double theta = sun_zenith_angle(s.sun_direction, up), degrees = theta * 180.0 / kPi;
  const double mass = 1.0 / (std::cos(theta) + 0.15 * std::pow(93.885 - degrees, -1.253));
  const double beta = 0.04608365822050 * s.turbidity - 0.04586025928522;
  constexpr double kMicrometres[3] = {0.612, 0.549, 0.465}, kOzone[3] = {0.125, 0.085, 0.009};
  LightSettings sun;
  sun.type = "sun";
  sun.direction = s.sun_direction;
  sun.visible_to_camera = s.visible_to_camera;
  dvec3 left;
  for (int c = 0; c < 3; ++c) {
    const double um = kMicrometres[c];
    const double rayleigh = std::exp(-0.008735 * std::pow(um, -4.08) * mass);
    const double aerosol = std::exp(-beta * std::pow(um, -1.3) * mass);
    const double ozone = std::exp(-kOzone[c] * 0.35 * mass);
    left[c] = rayleigh * aerosol * ozone;
  }
  sun.irradiance = 128.0 * space.of_rec709(left) * s.radiance;  // 128 klux before the atmosphere
  return sun;
}

}  // namespace brume
