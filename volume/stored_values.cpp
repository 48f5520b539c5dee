#include "volume/stored_values.h"

#include <fmt/format.h>

#include <algorithm>

namespace brume {

void ValueScan::add(const ValueScan& other) {
  minimum = std::min(minimum, other.minimum);
  maximum = std::max(maximum, other.maximum);
  nans += other.nans;
  infinities += other.infinities;
  minus_infinities += other.minus_infinities;
  denormals += other.denormals;
  negatives += other.negatives;
}

void ValueScan::write(GridSummary& s) const {
  s.has_range = maximum >= minimum;
  s.minimum = s.has_range ? minimum : 0.0;
  s.maximum = s.has_range ? maximum : 0.0;
  s.nan_count = nans;
  s.infinite_count = infinities;
  s.minus_infinite_count = minus_infinities;
  s.denormal_count = denormals;
  s.negative_count = negatives;
}

DensityRule::DensityRule(const ScalarOptions& options, double largest)
    : remap_(options.remap),
      largest_(static_cast<float>(std::max(0.0, largest))),
      limit_(options.limit > 0 ? static_cast<float>(options.limit) : std::numeric_limits<float>::max()) {}

double DensityRule::remapped(double v) const {
  if (v <= remap_.front().first) return remap_.front().second;
  const auto above = std::lower_bound(remap_.begin(), remap_.end(), v,
                                      [](const std::pair<double, double>& point, double x) { return point.first < x; });
  if (above == remap_.end()) return remap_.back().second;
  const auto below = above - 1;
  const double f = (v - below->first) / (above->first - below->first);
  return below->second + f * (above->second - below->second);
}

std::vector<std::string> notes_of_values(const GridSummary& s, float largest) {
  std::vector<std::string> notes;
  const auto note = [&](uint64_t count, const char* what, const std::string& became) {
    if (count) notes.push_back(fmt::format("grid '{}': {} {} voxels became {}", s.name, count, what, became));
  };
  note(s.nan_count, "NaN", "0");
  note(s.negative_count, "negative", "0");
  note(s.minus_infinite_count, "negative infinite", "0");
  note(s.infinite_count - s.minus_infinite_count, "infinite",
       largest > 0 ? fmt::format("the largest finite value, {}", largest) : "0: no finite value is positive");
  note(s.denormal_count, "denormal", fmt::format("0, as all do below {:.2g}", kLeastDensity));
  return notes;
}

std::string note_of_limited(const GridSummary& s, uint64_t voxels, double limit) {
  return fmt::format("grid '{}': {} voxels above {} were limited to it", s.name, voxels, limit);
}

}  // namespace brume
