#include "render/guides/sky_parts.h"

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "render/guides/guide_media.h"

namespace brume {
namespace {

constexpr int kAround = 360, kUp = 180;  // cells of directions
constexpr int kInside = 2;               // directions in each of them, squared
constexpr size_t kMostSuns = 2;
constexpr double kBright = 5;              // times the mean
constexpr double kEdge = 1.3;              // times a sun's surroundings: what is left in its place
constexpr double kWide = 12, kClear = 18;  // degrees: where a sun ends, and its surroundings
constexpr double kLeastShare = 0.03;       // of all light

/// Of a sky's radiance within a sun's bounds.
dvec3 left_of(const dvec3& radiance, const dvec3& around) {
  return glm::min(radiance, kEdge * around);
}

double cosine_of(double degrees) {
  return portable_sincos_2pi(degrees / 360).cos;
}

}  // namespace

struct SkyParts::Cell {
  dvec3 d{0}, radiance{0};
  double solid_angle = 0, bright = 0;  ///< bright: mean of the colours, 0 once a sun has it
};

SkyParts::SkyParts(const Environment& sky) : sky_(sky) {
  if (sky.black() || sky.constant()) return;
  std::vector<Cell> cells(size_t{kAround} * kUp);
  double all = 0;
  for (size_t i = 0; i < cells.size(); ++i) {
    Cell& cell = cells[i];
    const int v = static_cast<int>(i) / kAround, u = static_cast<int>(i) % kAround;
    for (int k = 0; k < kInside * kInside; ++k) {
      const double z = 2 * (v + (k / kInside + 0.5) / kInside) / kUp - 1, r = std::sqrt(1 - z * z);
      const SinCos phi = portable_sincos_2pi((u + (k % kInside + 0.5) / kInside) / kAround);
      const dvec3 d(r * phi.cos, r * phi.sin, z);
      cell.d += d;
      cell.radiance += sky.radiance(d) / double{kInside * kInside};
    }
    cell.d = glm::normalize(cell.d);
    cell.solid_angle = 4 * kPi / static_cast<double>(cells.size());
    cell.bright = in_colour(cell.radiance, kGrey);
    all += cell.bright * cell.solid_angle;
  }
  for (size_t tries = 0; tries < 2 * kMostSuns && suns_.size() < kMostSuns; ++tries)
    if (!take_brightest(cells, all / (4 * kPi))) break;
}

bool SkyParts::take_brightest(std::vector<Cell>& cells, double mean) {
  const auto brightest =
      std::max_element(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) { return a.bright < b.bright; });
  if (!(brightest->bright > kBright * mean)) return false;
  dvec3 axis = brightest->d;
  const double wide = cosine_of(kWide), clear = cosine_of(kClear);
  const auto is_bright = [&](const Cell& cell) { return cell.bright > kBright * mean; };
  dvec3 middle(0);
  for (const Cell& cell : cells)
    if (is_bright(cell) && glm::dot(cell.d, axis) > wide) middle += cell.bright * cell.solid_angle * cell.d;
  axis = glm::normalize(middle);
  dvec3 around(0);
  double around_angle = 0;
  bool small = true;
  for (const Cell& cell : cells) {
    const double cosine = glm::dot(cell.d, axis);
    if (cosine < clear || cosine > wide) continue;
    small = small && !is_bright(cell);
    around += cell.solid_angle * cell.radiance;
    around_angle += cell.solid_angle;
  }
  around /= around_angle;
  const double highest = brightest->bright, base = in_colour(around, kGrey);
  dvec3 light(0);
  for (const Cell& cell : cells)
    if (glm::dot(cell.d, axis) > wide) light += cell.solid_angle * (cell.radiance - left_of(cell.radiance, around));
  const bool taken = small && in_colour(light, kGrey) > kLeastShare * 4 * kPi * mean;
  if (sun_.empty()) sun_.assign(cells.size(), -1);
  for (size_t i = 0; i < cells.size(); ++i) {
    if (!(glm::dot(cells[i].d, axis) > wide)) continue;
    if (taken) sun_[i] = static_cast<int>(suns_.size());
    cells[i].bright = 0;
  }
  if (!taken) return true;
  // As large as all of it would be if it were as bright as its brightest cell.
  const double angle = in_colour(light, kGrey) / (highest - base);
  LightSettings sun;
  sun.type = "sun";
  sun.direction = axis;
  sun.irradiance = light;
  // Of a disc of that solid angle.
  sun.angular_diameter = 2 * std::acos(1 - angle / (2 * kPi)) * 180 / kPi;
  suns_.push_back(std::make_unique<Sun>(sun));
  suns_.back()->group = sky_.group;
  around_.push_back(around);
  return true;
}

size_t SkyParts::cell_of(const dvec3& d) const {
  double turn = std::atan2(d.y, d.x) / (2 * kPi);
  turn -= std::floor(turn);
  const int u = std::clamp(static_cast<int>(turn * kAround), 0, kAround - 1),
            v = std::clamp(static_cast<int>(0.5 * (d.z + 1) * kUp), 0, kUp - 1);
  return static_cast<size_t>(v * kAround + u);
}

dvec3 SkyParts::radiance(const dvec3& d) const {
  const dvec3 whole = sky_.radiance(d);
  if (suns_.empty()) return whole;
  const int sun = sun_[cell_of(d)];
  return sun < 0 ? whole : left_of(whole, around_[static_cast<size_t>(sun)]);
}

}  // namespace brume
