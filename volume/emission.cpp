#include "volume/emission.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <optional>

namespace brume {
namespace {

// CIE 1931 2-degree colour matching functions, from 380 nm by 10 nm.
constexpr double kFirst = 380, kStep = 10;  // [nm]
constexpr std::array<std::array<double, 3>, 41> kColourMatching = {{
    {0.001368, 0.000039, 0.00645},
    {0.004243, 0.00012, 0.02005},
    {0.01431, 0.000396, 0.06785},
    {0.04351, 0.00121, 0.2074},
    {0.13438, 0.004, 0.6456},
    {0.2839, 0.0116, 1.3856},
    {0.34828, 0.023, 1.74706},
    {0.3362, 0.038, 1.77211},
    {0.2908, 0.06, 1.6692},
    {0.19536, 0.09098, 1.28764},
    {0.09564, 0.13902, 0.81295},
    {0.03201, 0.20802, 0.46518},
    {0.0049, 0.323, 0.272},
    {0.0093, 0.503, 0.1582},
    {0.06327, 0.71, 0.07825},
    {0.1655, 0.862, 0.04216},
    {0.2904, 0.954, 0.0203},
    {0.43345, 0.99495, 0.00875},
    {0.5945, 0.995, 0.0039},
    {0.7621, 0.952, 0.0021},
    {0.9163, 0.87, 0.00165},
    {1.0263, 0.757, 0.0011},
    {1.0622, 0.631, 0.0008},
    {1.0026, 0.503, 0.00034},
    {0.85445, 0.381, 0.00019},
    {0.6424, 0.265, 0.00005},
    {0.4479, 0.175, 0.00002},
    {0.2835, 0.107, 0},
    {0.1649, 0.061, 0},
    {0.0874, 0.032, 0},
    {0.04677, 0.017, 0},
    {0.0227, 0.00821, 0},
    {0.011359, 0.004102, 0},
    {0.00579, 0.002091, 0},
    {0.002899, 0.001047, 0},
    {0.00144, 0.00052, 0},
    {0.00069, 0.000249, 0},
    {0.000332, 0.00012, 0},
    {0.000166, 0.00006, 0},
    {0.000083, 0.00003, 0},
    {0.000042, 0.000015, 0},
}};

/// Linear Rec. 709, negative where the colour lies outside of it.
dvec3 unclipped_blackbody(double kelvin) {
  constexpr double kC1 = 1.191042972e-16, kC2 = 1.438776877e-2;  // 2 h c^2 [W m^2], h c / k [m K]
  dvec3 xyz(0);
  double weight = 0;
  for (size_t i = 0; i < kColourMatching.size(); ++i) {
    const double m = (kFirst + kStep * static_cast<double>(i)) * 1e-9;
    const double planck = kC1 / (m * m * m * m * m * std::expm1(kC2 / (m * kelvin))) * 1e-9;  // per nm
    const dvec3 bar(kColourMatching[i][0], kColourMatching[i][1], kColourMatching[i][2]);
    xyz += planck * bar;
    weight += bar.y;
  }
  xyz /= weight;
  return {3.2404542 * xyz.x - 1.5371385 * xyz.y - 0.4985314 * xyz.z,
          -0.9692660 * xyz.x + 1.8760108 * xyz.y + 0.0415560 * xyz.z,
          0.0556434 * xyz.x - 0.2040259 * xyz.y + 1.0572252 * xyz.z};
}

}  // namespace

dvec3 blackbody(double kelvin) {
  return kelvin >= 500 ? glm::max(unclipped_blackbody(kelvin), dvec3(0)) : dvec3(0);
}

EmissionRamp EmissionRamp::of_blackbody(double offset, double scale, double highest, double intensity, bool planck,
                                        const std::optional<dmat3>& from_rec709) {
  static const double reference = luminance(blackbody(6500));
  const auto black_body = [&](double kelvin) {
    const dvec3 rec709 = kelvin >= 500 ? unclipped_blackbody(kelvin) : dvec3(0);
    const double y = luminance(rec709);
    dvec3 colour = glm::max(from_rec709 ? *from_rec709 * rec709 : rec709, dvec3(0));
    if (!planck && y > 0) colour *= 5.670374419e-8 * 1e-6 / kPi * kelvin * kelvin * kelvin * kelvin * reference / y;
    return colour * (intensity / reference);
  };
  EmissionRamp ramp;
  ramp.offset_ = static_cast<float>(offset);
  ramp.scale_ = static_cast<float>(scale);
  const float hottest = std::max(static_cast<float>(offset + scale * highest), kColdest);
  const size_t count = ((std::bit_cast<uint32_t>(hottest) - kColdestBits) >> kEntryBits) + 2;
  for (size_t i = 0; i < count; ++i)
    ramp.entries_.push_back(
        black_body(static_cast<double>(std::bit_cast<float>(kColdestBits + (static_cast<uint32_t>(i) << kEntryBits)))));
  return ramp;
}

EmissionRamp EmissionRamp::of_colours(const std::vector<std::pair<double, dvec3>>& stops, double intensity) {
  EmissionRamp ramp;
  for (const auto& [value, colour] : stops) {
    ramp.stops_.push_back(value);
    ramp.entries_.push_back(colour * intensity);
  }
  if (stops.size() == 1) {
    ramp.stops_.push_back(stops[0].first);
    ramp.entries_.push_back(ramp.entries_[0]);
  }
  return ramp;
}

dvec3 EmissionRamp::operator()(double value) const {
  size_t i = 0;
  double f = 0;
  if (is_blackbody()) {
    const auto kelvin = static_cast<float>(offset_ + scale_ * value);
    if (!(value > 0) || !(kelvin >= kColdest)) return dvec3(0);  // outside of the grid nothing could emit
    const uint32_t bits = std::bit_cast<uint32_t>(kelvin) - kColdestBits;
    i = std::min<size_t>(bits >> kEntryBits, entries_.size() - 2);
    f = (bits & ((1u << kEntryBits) - 1)) * std::ldexp(1.0, -kEntryBits);
  } else {
    // The last stop at or below the value, but not the last of all.
    const auto above = std::upper_bound(stops_.begin() + 1, stops_.end() - 1, value);
    i = static_cast<size_t>(above - stops_.begin()) - 1;
    const double width = stops_[i + 1] - stops_[i];
    f = width > 0 ? std::clamp((value - stops_[i]) / width, 0.0, 1.0) : 0.0;
  }
  return entries_[i] + (entries_[i + 1] - entries_[i]) * f;
}

EmissionField EmissionField::at_time(double time) const {
  EmissionField moved = *this;
  moved.shape_ = shape_.at_time(time);
  return moved;
}

/// Calls visitor(t, part) for each look-up of the integral along a ray.
template <class Visit>
void EmissionField::visit(const Ray& world, double t_min, double t_max, double stride, double time, Rng& rng,
                          Visit&& visitor) const {
  std::optional<Medium> moved;
  if (moves()) moved = shape_.at_time(time);
  const Medium& shape = moved ? *moved : shape_;
  const Ray local = shape.to_local(world);
  const double step = stride / glm::length(local.d);
  MajorantWalk walk = shape.walk(local, t_min, t_max);
  MajorantWalk::Segment s;
  while (walk.next(s)) {
    const double length = s.t1 - s.t0;
    const int count = std::max(1, static_cast<int>(std::ceil(length / step - 1e-9)));
    const double width = length / count;
    for (int i = 0; i < count; ++i) {
      const double t = s.t0 + (i + rng.uniform()) * width;
      visitor(t, ramp_(shape.density(s, local.at(t))) * width);
    }
  }
}

dvec3 EmissionField::integrate(const Ray& world, double t_min, double t_max, double stride, double time,
                               Rng& rng) const {
  if (shape_.homogeneous()) {
    const auto [t0, t1] = inside(world, t_min, t_max, time);
    return coefficient_ * std::max(0.0, t1 - t0);
  }
  dvec3 sum(0);
  visit(world, t_min, t_max, stride, time, rng, [&](double, const dvec3& part) { sum += part; });
  return sum;
}

void EmissionField::offer(const Ray& world, double t_min, double t_max, double stride, double time, Rng& rng,
                          EmittingPoint& point) const {
  if (shape_.homogeneous()) {
    const auto [t0, t1] = inside(world, t_min, t_max, time);
    if (t0 < t1) point.offer(t0 + rng.uniform() * (t1 - t0), coefficient_ * (t1 - t0), rng);
    return;
  }
  visit(world, t_min, t_max, stride, time, rng, [&](double t, const dvec3& part) { point.offer(t, part, rng); });
}

std::pair<double, double> EmissionField::inside(const Ray& world, double t_min, double t_max, double time) const {
  const auto [t0, t1] = shape_.homogeneous()->intersect(shape_.placement_at(time).to_local(world));
  return {std::max(t0, t_min), std::min(t1, t_max)};
}

}  // namespace brume
