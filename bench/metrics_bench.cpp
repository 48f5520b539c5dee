// Metrics on a 4K frame: docs/performance.md.

#include <benchmark/benchmark.h>

#include <cmath>

#include "evaluate/metrics/flip.h"
#include "evaluate/metrics/metric.h"
#include "evaluate/metrics/similarity.h"

namespace brume {
namespace {

constexpr int kWidth = 3840, kHeight = 2160;

struct Frame {
  std::array<Plane, 3> planes;
  RgbPlanes view() const { return {&planes[0], &planes[1], &planes[2]}; }
};

Frame frame(float noise) {
  Frame result;
  for (size_t c = 0; c < 3; ++c) {
    result.planes[c] = Plane(kWidth, kHeight);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        result.planes[c](x, y) = 0.4f + 0.3f * std::sin(0.01f * static_cast<float>(x + 2 * y)) +
                                 noise * static_cast<float>((x * 7919 + y * 104729) % 1000 - 500) / 500;
  }
  return result;
}

// Made before the clock runs.
const Frame kTest = frame(0.1f), kReference = frame(0.0f);

void pixel_metrics(benchmark::State& state) {
  for (auto _ : state)
    benchmark::DoNotOptimize(compare(kTest.view(), kReference.view(), {}, {}, nullptr, ErrorScope::kPixels));
}
void ssim(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(ssim_map(kTest.view(), kReference.view(), 1, {}));
}
void flip(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(flip_map(kTest.view(), kReference.view(), {}));
}
void hdr_flip(benchmark::State& state) {
  state.counters["exposures"] = static_cast<double>(hdr_flip_exposures(kReference.view()).size());
  for (auto _ : state) benchmark::DoNotOptimize(hdr_flip_map(kTest.view(), kReference.view(), {}));
}
BENCHMARK(pixel_metrics)->Name("metrics/pixels_4k")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK(ssim)->Name("metrics/ssim_4k")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK(flip)->Name("metrics/flip_4k")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK(hdr_flip)->Name("metrics/hdr_flip_4k")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

}  // namespace
}  // namespace brume
