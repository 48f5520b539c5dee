#include "volume/emission.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>

namespace brume {
namespace {

// CIE 1931 2-degree colour matching functions, sums of piecewise Gaussians.
dvec3 colour_matching(double nm) {
  const auto lobe = [nm](double peak, double centre, double below, double above) {
    const double t = (nm - centre) * (nm < centre ? below : above);
    return peak * std::exp(-0.5 * t * t);
  };
  return {lobe(0.362, 442.0, 0.0624, 0.0374) + lobe(1.056, 599.8, 0.0264, 0.0323) + lobe(-0.065, 501.1, 0.0490, 0.0382),
          lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
          lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725)};
}

}  // namespace

dvec3 blackbody(double kelvin) {
  if (!(kelvin >= 500)) return dvec3(0);
  constexpr double kC1 = 1.191042972e-16, kC2 = 1.438776877e-2;  // 2 h c^2 [W m^2], h c / k [m K]
  dvec3 xyz(0);
  double weight = 0;
  for (double nm = 360; nm <= 830; nm += 5) {
    const double m = nm * 1e-9;
    const double planck = kC1 / (m * m * m * m * m * std::expm1(kC2 / (m * kelvin))) * 1e-9;  // per nm
    const dvec3 bar = colour_matching(nm);
    xyz += planck * bar;
    weight += bar.y;
  }
  xyz /= weight;
  const dvec3 rgb{3.2404542 * xyz.x - 1.5371385 * xyz.y - 0.4985314 * xyz.z,
                  -0.9692660 * xyz.x + 1.8760108 * xyz.y + 0.0415560 * xyz.z,
                  0.0556434 * xyz.x - 0.2040259 * xyz.y + 1.0572252 * xyz.z};
  return glm::max(rgb, dvec3(0));
}

EmissionRamp EmissionRamp::of_blackbody(double offset, double scale, double highest, double intensity, bool planck) {
  static const double reference = luminance(blackbody(6500));
  const auto black_body = [&](double kelvin) {
    dvec3 colour = blackbody(kelvin);
    const double y = luminance(colour);
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
    while (i + 2 < stops_.size() && value >= stops_[i + 1]) ++i;
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

/// The part of a ray in a homogeneous shape.
std::pair<double, double> EmissionField::inside(const Ray& world, double t_min, double t_max, double time) const {
  const auto [t0, t1] = shape_.homogeneous()->intersect(shape_.placement_at(time).to_local(world));
  return {std::max(t0, t_min), std::min(t1, t_max)};
}

}  // namespace brume
