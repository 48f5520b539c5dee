#include "tests/support/reference_frame.h"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "base/parallel_for.h"
#include "base/running_statistics.h"
#include "render/world/camera.h"
#include "tests/support/reference_tracer.h"

namespace brume::test {
namespace {

constexpr int kBlock = 8;

const std::vector<std::string> kLayers = {"direct",        "indirect", "background",    "emission", "single", "surface",
                                          "transmittance", "coverage", "scatter_depth", "albedo",   "normal", "depth"};

/// A mean over pixels and the variance of it, summed.
struct Sum {
  double value = 0, variance = 0;
};

/// Statistics of every member of a PathSample in one pixel.
using Pixel = std::vector<RunningStatistics>;

std::vector<Pixel> reference_pixels(const PreparedScene& scene, int spp, int64_t seed) {
  const Camera camera = scene.camera();
  const int width = scene.scene().film.width, height = scene.scene().film.height;
  std::vector<Pixel> pixels(static_cast<size_t>(width) * height, Pixel(sizeof(PathSample) / sizeof(double)));
  parallel_for(height, {}, [&](int y) {
    for (int x = 0; x < width; ++x)
      for (int k = 0; k < spp; ++k) {
        const PathRequest request = scene.request(camera, seed, x, y, static_cast<uint32_t>(k));
        const PathSample sample = reference_path(scene.context(), request);
        Pixel& pixel = pixels[static_cast<size_t>(y * width + x)];
        for (size_t i = 0; i < pixel.size(); ++i) pixel[i].add(sample.values()[i]);
      }
  });
  return pixels;
}

}  // namespace

std::string Agreement::text() const {
  return fmt::format("{:.2f} standard errors at {}, of {} means; a bias of {:.2f} % would be found", worst, where,
                     compared, 100 * detectable);
}

Agreement agreement(const Scene& scene, int spp, int64_t seed) {
  const PreparedScene prepared(scene, LayerRequest::of(kLayers, true));
  const Layers frame = prepared.render(spp, seed, {}).layers;
  const std::vector<Pixel> reference = reference_pixels(prepared, spp, seed + 1);
  const int width = frame.width(), height = frame.height();
  Agreement result;
  const auto compare = [&](const RecordedLayer& l, size_t channel, int x0, int y0, int x1, int y1) {
    const Plane &mean = frame.at(l.name.channel(channel)),
                &variance = frame.at(l.name.channel_of(statistic::mean_variance, channel));
    Sum a, b;
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x) {
        a.value += mean(x, y);
        a.variance += variance(x, y);
        const RunningStatistics& r = reference[static_cast<size_t>(y * width + x)][l.offset + channel];
        b.value += r.mean;
        b.variance += r.mean_variance();
      }
    // Frames are in single precision, and what happens to a path in a hundred thousand is left out.
    const double rounding = 1e-4 * std::abs(b.value) + 1e-5 * (x1 - x0) * (y1 - y0);
    const double error = std::sqrt(a.variance + b.variance);
    const double off = std::max(0.0, std::abs(a.value - b.value) - rounding) / std::max(error, 1e-12);
    ++result.compared;
    if (off > result.worst) {
      result.worst = off;
      result.where = fmt::format("{} {}, pixels {}..{}, {}..{}: {:.5g} instead of {:.5g}", l.name.label(),
                                 l.name.channels[channel], x0, x1, y0, y1, a.value, b.value);
    }
  };
  for (const RecordedLayer& l : recordable_layers()) {
    if (!prepared.plan().layers.has(l.name)) continue;
    for (size_t c = 0; c < l.name.channels.size(); ++c) {
      compare(l, c, 0, 0, width, height);
      for (int y = 0; y + kBlock <= height; y += kBlock)
        for (int x = 0; x + kBlock <= width; x += kBlock) compare(l, c, x, y, x + kBlock, y + kBlock);
    }
  }
  double light = 0, variance = 0;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const RunningStatistics& r = reference[static_cast<size_t>(y * width + x)][1];  // green of the beauty
      light += r.mean;
      variance += r.mean_variance() + frame.at(layer::beauty.channel_of(statistic::mean_variance, 1))(x, y);
    }
  result.detectable = kSigmas * std::sqrt(variance) / light;
  return result;
}

}  // namespace brume::test
