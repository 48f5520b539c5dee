// Seconds per 400 x 400 frame of every filter, Lab conversion included, on all of the machine's threads and on one. The
// targets (two cores): bilateral and extended under 12 ms, gradient kernel under 20 ms, trilateral under 40 ms.

#include <benchmark/benchmark.h>
#include <hwy/targets.h>

#include <cmath>

#include "base/rng.h"
#include "filters/apply.h"
#include "filters/registry.h"

namespace brume {
namespace {

/// Noise on a slope, a third of it medium, as the demo scenes show it.
const Layers& frame() {
  static const Layers result = [] {
    Layers f(400, 400);
    Rng rng(1);
    for (const LayerName& l :
         {layer::direct, layer::indirect, layer::gradient, layer::coverage, layer::alpha, layer::beauty})
      for (size_t c = 0; c < l.channels.size(); ++c) {
        Plane& p = f.add(l.channel(c));
        for (int y = 0; y < 400; ++y)
          for (int x = 0; x < 400; ++x) {
            const bool medium = std::hypot(x - 200, y - 200) < 130;
            p(x, y) = l == layer::coverage || l == layer::alpha ? static_cast<float>(medium)
                      : medium                                  ? static_cast<float>(0.2 + 0.5 * rng.uniform())
                                                                : 0.0f;
          }
      }
    return f;
  }();
  return result;
}

void run(benchmark::State& state, const FilterSettings& filter, int threads, BackgroundRule background) {
  for (auto _ : state)
    benchmark::DoNotOptimize(
        apply_filter(filter, frame(), {Component::kIndirect, background, 1.0}, {threads, {}, nullptr}));
  state.SetLabel(hwy::TargetName(hwy::SupportedTargets() & -hwy::SupportedTargets()));
}

const bool registered = [] {
  for (const FilterEntry* e : all_filters()) {
    std::vector<FilterSettings> variants = {*e};
    for (const Parameter& p : e->parameters)
      if (p.name == "variant" || p.name == "domain" || p.name == "average")
        for (const std::string& choice : p.choices)
          if (Parameter::text(variants[0].get(p)) != choice) {
            variants.emplace_back(*e);
            variants.back().set(p.name, choice);
          }
    for (const FilterSettings& f : variants) {
      std::string name = e->name;
      for (const Parameter& p : e->parameters)
        if (!p.choices.empty() && f.get(p) != variants[0].get(p))
          name += " " + p.name + "=" + Parameter::text(f.get(p));
      for (const int threads : {0, 1})
        benchmark::RegisterBenchmark(
            (name + (threads ? ", 1 thread" : ", all threads")).c_str(),
            [f, threads](benchmark::State& s) { run(s, f, threads, BackgroundRule::kBilateral); })
            ->Unit(benchmark::kMillisecond)
            ->UseRealTime();
    }
  }
  return true;
}();

}  // namespace
}  // namespace brume
