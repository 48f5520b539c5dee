#include "tests/support/frames.h"

#include <cmath>

#include "base/rng.h"

namespace brume::test {

double chance(int x, int y, uint64_t purpose) {
  return Rng(hash_combine(hash_combine(purpose, static_cast<uint64_t>(x)), static_cast<uint64_t>(y))).uniform();
}

/// Whether a pixel's k-th bucket lies above its mean: every other one.
bool is_up(int x, int y, size_t c, size_t k) {
  return (k + (chance(x, y, 14 + c) < 0.5)) % 2 == 0;
}

void put(Layers& frame, const LayerName& l, std::string_view statistic, const Value& value) {
  for (size_t c = 0; c < l.channels.size(); ++c) {
    Plane& p = frame.add(l.channel_of(statistic, c));
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) p(x, y) = value(x, y, c);
  }
}

void put_with_statistics(Layers& frame, const LayerName& l, double variance, const Value& value, double spread) {
  if (spread < 0) spread = variance;
  put(frame, l, "", value);
  put(frame, l, statistic::mean_variance, [&](int, int, size_t) { return static_cast<float>(variance); });
  const auto bucket = [&](int x, int y, size_t c, size_t k) {
    return value(x, y, c) + static_cast<float>(std::sqrt(7 * spread)) * (is_up(x, y, c, k) ? 1.0f : -1.0f);
  };
  for (size_t k = 0; k < 8; ++k)
    put(frame, l, statistic::buckets[k], [&](int x, int y, size_t c) { return bucket(x, y, c, k); });
  const float half = static_cast<float>(std::sqrt(spread));
  for (const auto& [name, sign] : {std::pair(statistic::half_a, 1.0f), {statistic::half_b, -1.0f}})
    put(frame, l, name, [&, sign = sign](int x, int y, size_t c) {
      return value(x, y, c) + sign * (chance(x, y, 18 + c) < 0.5 ? half : -half);
    });
}

Layers frame_of(int width, int height, const Value& indirect, double variance, double spread) {
  Layers frame(width, height);
  put_with_statistics(frame, layer::indirect, variance, indirect, spread);
  put_with_statistics(frame, layer::direct, 1e-6,
                      [](int x, int y, size_t) { return 0.01f * static_cast<float>(x + y); });
  put_with_statistics(frame, layer::beauty, variance,
                      [&](int x, int y, size_t c) { return indirect(x, y, c) + 0.01f * static_cast<float>(x + y); });
  for (const LayerName& l : {layer::gradient, layer::gradient_transmittance_weighted})
    put(frame, l, "", [](int x, int y, size_t c) {
      return std::array{0.6f, 0.8f * (x % 2 ? 1.0f : -1.0f), y % 5 ? 0.1f : 0.0f}[c];
    });
  put(frame, layer::coverage, "", [](int x, int, size_t) { return x % 7 == 0 ? 0.0f : 1.0f; });
  put(frame, layer::alpha, "", [](int x, int, size_t) { return x % 7 == 0 ? 0.0f : 0.5f; });
  put_with_statistics(frame, layer::transmittance, 1e-5,
                      [](int x, int, size_t) { return 0.5f + 0.4f * std::sin(0.2f * static_cast<float>(x)); });
  put_with_statistics(frame, layer::flash, 1e-5,
                      [](int x, int y, size_t) { return 0.5f + 0.4f * std::sin(0.2f * static_cast<float>(x - y)); });
  put(frame, layer::sample_count, "", [](int, int, size_t) { return 8.0f; });
  return frame;
}

Records::Records(const Layers& frame) {
  RecordLayout layout;
  layout.width = frame.width();
  layout.height = frame.height();
  layout.samples = 8;
  layout.fields = {{"film", 2},       {"lens", 2},        {"time", 1},        {"flight_1", 1},
                   {"flight_2", 1},   {"direction_1", 3}, {"direction_2", 3}, {"light_1", 1},
                   {"light_uv_1", 2}, {"position_1", 3},  {"position_2", 3},  {"surface_gradient", 3},
                   {"gradient_1", 3}, {"albedo", 3},      {"density_1", 1},   {"light_transmittance_1", 1},
                   {"normal", 3},     {"flags", 1},       {"unscattered", 3}, {"single", 3},
                   {"indirect", 3}};
  const auto number = [&](const RecordLayout::Field& field, size_t c, int x, int y, size_t k) {
    const auto random = [&](uint64_t i) { return static_cast<float>(chance(x, y, 100 + 16 * i + k)); };
    const auto bucket = [&](const LayerName& l) { return frame.at(l.channel_of(statistic::buckets[k], c))(x, y); };
    if (field.name == "film") return static_cast<float>(c == 0 ? x : y) + random(c);
    if (field.name == "flight_1")
      return 0.5f * (random(2) + (frame.at(layer::indirect.channel_of(statistic::buckets[k], 0))(x, y) >
                                          frame.at("indirect.R")(x, y)
                                      ? 1.0f
                                      : 0.0f));
    if (field.name == "direction_1" || field.name == "light_uv_1") return random(3 + c);
    if (field.name == "position_1") return 0.1f * static_cast<float>(x) + random(6 + c);
    if (field.name == "unscattered") return bucket(layer::direct);
    if (field.name == "indirect") return bucket(layer::indirect);
    return 0.0f;
  };
  const auto path = folder.path() / "x.records";
  RecordWriter writer(path, layout);
  for (int tile = 0; tile < layout.tile_count(); ++tile) {
    std::vector<float> block;
    const RecordLayout::Bounds b = layout.bounds(tile);
    for (int y = b.y0; y < b.y1; ++y)
      for (int x = b.x0; x < b.x1; ++x)
        for (size_t k = 0; k < 8; ++k)
          for (const RecordLayout::Field& field : layout.fields)
            for (size_t c = 0; c < static_cast<size_t>(field.components); ++c)
              block.push_back(number(field, c, x, y, k));
    writer.write(tile, block);
  }
  writer.commit();
  reader.emplace(path);
}

Layers noisy_frame(int width, int height, uint64_t seed) {
  std::vector<float> noise;
  Rng rng(seed);
  for (int i = 0; i < width * height * 3; ++i) noise.push_back(static_cast<float>(0.2 + 0.4 * rng.uniform()));
  return frame_of(width, height, [&](int x, int y, size_t c) {
    return noise[static_cast<size_t>(y * width + x) * 3 + c] + (x > width / 2 ? 0.5f : 0.0f);
  });
}

double normal(int x, int y, uint64_t purpose) {
  return std::sqrt(-2 * std::log(1 - chance(x, y, 2 * purpose + 1))) *
         std::cos(6.283185307179586 * chance(x, y, 2 * purpose));
}

Layers sampled_frame(int width, int height, int samples, double deviation, uint64_t seed, const Value& truth) {
  return sampled_frame(width, height, samples, seed, truth, [&](int x, int y, size_t c, Rng& rng) {
    const double radius = std::sqrt(2 * rng.exponential());
    return truth(x, y, c) + deviation * radius * portable_sincos_2pi(rng.uniform()).cos;
  });
}

Layers sampled_frame(int width, int height, int samples, uint64_t seed, const Value& truth, const Sample& sample) {
  Layers frame = frame_of(width, height, truth);
  put(frame, layer::sample_count, "", [&](int, int, size_t) { return static_cast<float>(samples); });
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        Rng rng(hash_combine(hash_combine(mix64(seed * 3 + c), static_cast<uint64_t>(x)), static_cast<uint64_t>(y)));
        double sum = 0, squares = 0, bucket[8] = {}, bucket_count[8] = {};
        for (int s = 0; s < samples; ++s) {
          const double v = sample(x, y, c, rng);
          sum += v, squares += v * v, bucket[s % 8] += v, ++bucket_count[s % 8];
        }
        const double n = samples, mean = sum / n;
        double a = 0, b = 0, na = 0, nb = 0;
        for (int k = 0; k < 8; ++k) {
          (k % 2 == 0 ? a : b) += bucket[k], (k % 2 == 0 ? na : nb) += bucket_count[k];
          (*frame.add_rgb(layer::indirect, statistic::buckets[static_cast<size_t>(k)])[c])(x, y) =
              static_cast<float>(bucket_count[k] > 0 ? bucket[k] / bucket_count[k] : mean);
        }
        (*frame.add_rgb(layer::indirect)[c])(x, y) = static_cast<float>(mean);
        (*frame.add_rgb(layer::indirect, statistic::mean_variance)[c])(x, y) =
            static_cast<float>(n > 1 ? std::max(0.0, squares - sum * mean) / (n - 1) / n : 0.0);
        (*frame.add_rgb(layer::indirect, statistic::half_a)[c])(x, y) = static_cast<float>(na > 0 ? a / na : mean);
        (*frame.add_rgb(layer::indirect, statistic::half_b)[c])(x, y) = static_cast<float>(nb > 0 ? b / nb : mean);
        (*frame.add_rgb(layer::beauty)[c])(x, y) = static_cast<float>(mean + (*frame.rgb(layer::direct)[c])(x, y));
      }
  return frame;
}

}  // namespace brume::test
