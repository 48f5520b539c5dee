// Seconds per 1280 x 960 frame of every filter, preparation included, on all of the machine's threads and on one; and
// of OpenCV's bilateral filter, non-local means and guided filter on the same picture, window and threads, where it is
// installed. Targets on two cores: docs/performance.md.

#include <benchmark/benchmark.h>
#include <hwy/targets.h>
#include <malloc.h>

#include <cmath>
#include <cstdio>
#ifdef BRUME_OPENCV
#include <opencv2/imgproc.hpp>
#include <opencv2/photo.hpp>
#include <opencv2/ximgproc/edge_filter.hpp>
#endif

#include "base/error.h"
#include "base/rng.h"
#include "filters/api/registry.h"
#include "filters/run/apply.h"

namespace brume {
namespace {

constexpr int kWidth = 1280, kHeight = 960;

/// Noise on a slope, a third of it medium, as the demo scenes show it, with every statistic and feature.
const Layers& frame() {
  static const Layers result = [] {
    Layers f(kWidth, kHeight);
    Rng rng(1);
    const auto fill = [&](const std::string& name, auto value) {
      Plane& p = f.add(name);
      for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
          p(x, y) = std::hypot(x - 640, y - 480) < 420 ? static_cast<float>(value(x, y)) : 0.0f;
    };
    const auto noise = [&](int, int) { return 0.2 + 0.5 * rng.uniform(); };
    for (const LayerName& l : {layer::direct, layer::indirect, layer::beauty})
      for (size_t c = 0; c < 3; ++c) {
        for (const std::string_view which : {std::string_view(), statistic::half_a, statistic::half_b})
          fill(l.channel_of(which, c), noise);
        for (const std::string_view bucket : statistic::buckets)
          fill(l.channel_of(bucket, c), [&](int, int) { return 1.4 * rng.uniform(); });
        fill(l.channel_of(statistic::mean_variance, c), [](int, int) { return 0.02; });
      }
    for (const LayerName& l : {layer::coverage, layer::alpha}) fill(l.channel(0), [](int, int) { return 1; });
    for (const LayerName& l : {layer::optical_depth, layer::gradient, layer::gradient_transmittance_weighted,
                               layer::scatter_depth, layer::scatter_share, layer::single, layer::flash})
      for (size_t c = 0; c < l.channels.size(); ++c) {
        const auto smooth = [&](int x, int y) {
          return 0.5 + 0.4 * std::sin(0.01 * x * (1.0 + static_cast<double>(c)) + 0.013 * y) + 0.02 * rng.uniform();
        };
        for (const std::string_view which : {std::string_view(), statistic::half_a, statistic::half_b})
          fill(l.channel_of(which, c), smooth);
        fill(l.channel_of(statistic::mean_variance, c), [](int, int) { return 3e-5; });
      }
    return f;
  }();
  return result;
}

// As the program does: planes are recycled, not asked of the system anew.
const bool recycling = mallopt(M_MMAP_THRESHOLD, 32 << 20) && mallopt(M_TRIM_THRESHOLD, 1 << 30);

void run(benchmark::State& state, const FilterSettings& filter, int threads, BackgroundRule background) {
  const Layers& input = frame();  // made before the clock starts
  for (auto _ : state)
    benchmark::DoNotOptimize(apply_filter(filter, input, {Component::kIndirect, background}, {threads, {}, nullptr}));
  state.SetLabel(hwy::TargetName(hwy::SupportedTargets() & -hwy::SupportedTargets()));
}

const bool registered = [] {
  for (const FilterEntry* e : all_filters()) {
    if (e->records == FilterEntry::Records::kNeeds) continue;
    std::vector<FilterSettings> variants = {*e};
    try {
      variants[0].weights();
    } catch (const InputError& error) {
      std::fprintf(stderr, "left out: %s\n", error.what());
      continue;
    }
    for (const Parameter& p : e->parameters)
      if (p.name == "variant" || p.name == "domain" || p.name == "average" || p.name == "buffers" ||
          p.name == "choose" || p.name == "estimate")
        for (const std::string& choice : p.choices)
          if (Parameter::text(variants[0].get(p)) != choice) {
            variants.emplace_back(*e);
            variants.back().set(p.name, choice);
          }
    std::vector<std::pair<std::string, FilterSettings>> named;
    for (const FilterSettings& f : variants) {
      std::string name = e->name;
      for (const Parameter& p : e->parameters)
        if (!p.choices.empty() && f.get(p) != variants[0].get(p))
          name += " " + p.name + "=" + Parameter::text(f.get(p));
      named.emplace_back(name, f);
    }
    // What was published stays what it is, so that its time can be compared over the years.
    if (!e->find_preset("paper").settings.empty()) {
      named.emplace_back(e->name + " preset=paper", FilterSettings(*e));
      named.back().second.set("preset", "paper");
    }
    for (const auto& [name, f] : named) {
      for (const int threads : {0, 1})
        benchmark::RegisterBenchmark(
            (name + (threads ? ", 1 thread" : ", all threads")).c_str(),
            [f = f, threads](benchmark::State& s) { run(s, f, threads, BackgroundRule::kDefault); })
            ->Unit(benchmark::kMillisecond)
            ->UseRealTime();
    }
  }
  return true;
}();

#ifdef BRUME_OPENCV
cv::Mat picture(int type) {
  cv::Mat m(kHeight, kWidth, type == CV_8U ? CV_8UC3 : CV_32FC3);
  const RgbPlanes p = frame().rgb(layer::indirect);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (int c = 0; c < 3; ++c) {
        const float v = (*p[static_cast<size_t>(c)])(x, y);
        if (type == CV_8U)
          m.at<cv::Vec3b>(y, x)[c] = static_cast<uint8_t>(255 * std::min(v, 1.0f));
        else
          m.at<cv::Vec3f>(y, x)[c] = v;
      }
  return m;
}

void opencv(benchmark::State& state, const std::function<void()>& job) {
  cv::setNumThreads(static_cast<int>(state.range(0)));
  for (auto _ : state) job();
}

const bool opencv_registered = [] {
  const auto add = [](const char* name, std::function<void()> job) {
    for (const int threads : {cv::getNumberOfCPUs(), 1})
      benchmark::RegisterBenchmark(
          (std::string("OpenCV ") + name + (threads == 1 ? ", 1 thread" : ", all threads")).c_str(),
          [job](benchmark::State& s) { opencv(s, job); })
          ->Arg(threads)
          ->Unit(benchmark::kMillisecond)
          ->UseRealTime();
  };
  add("bilateralFilter, float, 13 x 13", [] {
    static const cv::Mat in = picture(CV_32F);
    cv::Mat out;
    cv::bilateralFilter(in, out, 13, 0.2, 2);
  });
  add("fastNlMeansDenoising, 8 bit, 21 x 21, 7 x 7", [] {
    static const cv::Mat in = picture(CV_8U);
    cv::Mat out;
    cv::fastNlMeansDenoising(in, out, 10, 7, 21);
  });
  add("guidedFilter, float, 3-channel guide, r = 5", [] {
    static const cv::Mat in = picture(CV_32F);
    cv::Mat out;
    cv::ximgproc::guidedFilter(in, in, out, 5, 1e-3);
  });
  return true;
}();
#endif

}  // namespace
}  // namespace brume
