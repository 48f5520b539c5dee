#include "render/film.h"

#include <cmath>

namespace brume {
namespace {

enum Value : size_t { kBeauty = 0, kDirect = 3, kIndirect = 6, kGradient = 9, kCoverage = 12, kTransmittance = 13 };

}  // namespace

Film::Film(int width, int height, const LayerRequest& request) : layers_(width, height) {
  record(layer::beauty, kBeauty, request.statistics);
  record(layer::alpha, kTransmittance, request.statistics, true);
  if (request.direct) record(layer::direct, kDirect, request.statistics);
  if (request.indirect) record(layer::indirect, kIndirect, request.statistics);
  if (request.gradient) record(layer::gradient, kGradient, request.statistics);
  if (request.coverage) record(layer::coverage, kCoverage, request.statistics);
  if (request.transmittance) record(layer::transmittance, kTransmittance, request.statistics);
  beauty_ = layers_.add_rgb(layer::beauty);
  sample_count_ = &layers_.add(layer::sample_count.channel(0));
  invalid_count_ = &layers_.add(layer::invalid_count.channel(0));
}

void Film::record(const LayerName& name, size_t first_value, bool statistics, bool complement) {
  for (size_t i = 0; i < name.channels.size(); ++i) {
    const auto plane = [&](std::string_view which) {
      return statistics ? &layers_.add(name.channel_of(which, i)) : nullptr;
    };
    // Extinction is grey, so one number fills the three channels of the transmittance.
    const size_t value = first_value == kTransmittance ? first_value : first_value + i;
    targets_.push_back({&layers_.add(name.channel(i)), plane(statistic::mean_variance), plane(statistic::half_a),
                        plane(statistic::half_b), value, complement});
  }
}

bool Film::add(Pixel& pixel, const PathSample& s, size_t half) {
  const dvec3 beauty = s.direct + s.indirect;
  const std::array<double, kValues> values = {beauty.x,     beauty.y,     beauty.z,     s.direct.x,     s.direct.y,
                                              s.direct.z,   s.indirect.x, s.indirect.y, s.indirect.z,   s.gradient.x,
                                              s.gradient.y, s.gradient.z, s.coverage,   s.transmittance};
  for (const double v : values)
    if (!std::isfinite(v)) return false;
  pixel.add(values, half);
  return true;
}

void Film::store(int x, int y, const Pixel& pixel, uint32_t invalid) {
  for (const Target& t : targets_) {
    const auto value = [&](double v) { return static_cast<float>(t.complement ? 1.0 - v : v); };
    (*t.mean)(x, y) = value(pixel.mean[t.value]);
    if (!t.mean_variance) continue;
    (*t.mean_variance)(x, y) = static_cast<float>(pixel.mean_variance(t.value));
    (*t.half_a)(x, y) = value(pixel.half_mean(0, t.value));
    (*t.half_b)(x, y) = value(pixel.half_mean(1, t.value));
  }
  // The sum of the stored floats, so that the passes add up to the beauty to the last bit.
  for (size_t c = 0; c < 3; ++c)
    (*beauty_[c])(x, y) = static_cast<float>(pixel.mean[kDirect + c]) + static_cast<float>(pixel.mean[kIndirect + c]);
  (*sample_count_)(x, y) = static_cast<float>(pixel.count);
  (*invalid_count_)(x, y) = static_cast<float>(invalid);
}

}  // namespace brume
