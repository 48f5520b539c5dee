// Paths and look-ups per second of the demo scenes, one and all threads, with and without statistics and layers.

#include <benchmark/benchmark.h>

#include "render/scene/scene_io.h"
#include "render/session/renderer.h"

namespace brume {
namespace {

void render(benchmark::State& state, const char* name, int threads, const LayerRequest& layers) {
  Scene scene = read_scene(std::string(BRUME_SOURCE) + "/data/scenes/" + name + ".toml");
  scene.film.width = scene.film.height = 200;
  const PreparedScene prepared(scene, layers);
  double paths = 0, lookups = 0, scatterings = 0;
  int64_t seed = 1;
  for (auto _ : state) {
    const RenderResult r = prepared.render(4, seed++, {threads, {}, nullptr});
    paths += static_cast<double>(r.report.counters.paths);
    lookups += static_cast<double>(r.report.counters.tracking.lookups);
    scatterings += static_cast<double>(r.report.counters.tracking.collisions);
  }
  state.counters["paths/s"] = benchmark::Counter(paths, benchmark::Counter::kIsRate);
  state.counters["lookups/s"] = benchmark::Counter(lookups, benchmark::Counter::kIsRate);
  state.counters["lookups/scattering"] = lookups / scatterings;
}

const LayerRequest kBeautyOnly{{}, false};

BENCHMARK_CAPTURE(render, cloud_all_threads, "cloud", 0, LayerRequest{})->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(render, cloud_1_thread, "cloud", 1, LayerRequest{})->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(render, cloud_beauty_only, "cloud", 0, kBeautyOnly)->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(render, smoke_all_threads, "smoke", 0, LayerRequest{})->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(render, smoke_1_thread, "smoke", 1, LayerRequest{})->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(render, smoke_beauty_only, "smoke", 0, kBeautyOnly)->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace brume
