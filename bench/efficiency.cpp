// Equal-time error of a scene: efficiency = 1 / (relMSE x seconds), relMSE = mean((x - mean)^2 / (mean^2 + 0.01)) over
// the pixels that show a medium (alpha above 0.5 %).
//
//   brume_efficiency SCENE.toml [--spp 16] [--seeds 4] [--threads 0] [--processor-time] [-D key=value ...]
//   brume_efficiency SCENE.toml --frames A.exr B.exr ... --seconds S     another renderer's frames, S seconds each
//   brume_efficiency SCENE.toml --parts            and the errors of the parts that add up to the picture, by
//   themselves
//
// The error of a frame is its variance, from pairs of independent frames: no reference is needed but for the
// denominator and the mask, and its noise does not enter. The interval is 1.96 standard errors over the seeds.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/running_statistics.h"
#include "image/exr_io.h"
#include "image/foreign.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"

namespace brume {
namespace {

using Frame = std::array<Plane, 3>;

Frame planes_of(const Layers& layers, const LayerName& name = layer::beauty) {
  Frame f;
  const auto rgb = layers.rgb(name);
  for (size_t c = 0; c < 3; ++c) f[c] = *rgb[c];
  return f;
}

/// What adds up to the picture.
constexpr std::array kParts = {layer::background, layer::emission, layer::single, layer::surface, layer::indirect};

/// The relative error of frames, from pairs of them, over the pixels that the mask shows.
RunningStatistics error_of(const std::vector<Frame>& frames, const Frame& mean, const Plane& alpha, size_t& pixels) {
  RunningStatistics errors;
  for (size_t a = 0; a + 1 < frames.size(); a += 2) {
    double sum = 0;
    pixels = 0;
    for (int y = 0; y < alpha.height(); ++y)
      for (int x = 0; x < alpha.width(); ++x) {
        if (alpha(x, y) <= 0.005f) continue;
        ++pixels;
        for (size_t c = 0; c < 3; ++c) {
          const double d = frames[a][c](x, y) - frames[a + 1][c](x, y), m = mean[c](x, y);
          sum += 0.5 * d * d / (m * m + 0.01) / 3.0;
        }
      }
    errors.add(sum / static_cast<double>(pixels));
  }
  return errors;
}

/// The mean of the pictures, with its standard error.
std::string mean_of(const std::vector<Frame>& frames) {
  RunningStatistics means;
  for (const Frame& f : frames) {
    double sum = 0;
    for (const Plane& plane : f)
      for (int y = 0; y < plane.height(); ++y)
        for (int x = 0; x < plane.width(); ++x) sum += plane(x, y);
    means.add(sum / (3.0 * f[0].width() * f[0].height()));
  }
  return fmt::format("{:.6f} +- {:.6f}", means.mean, std::sqrt(means.mean_variance()));
}

int run(int argc, char** argv) {
  std::string scene_path;
  std::vector<std::string> overrides, frames;
  int spp = 16, seeds = 4, threads = 0;
  double seconds = 0;
  bool processor_time = false, parts = false;
  for (int i = 1; i < argc; ++i) {
    const std::string a = argv[i];
    const auto value = [&] {
      if (i + 1 >= argc) throw InputError(a + " needs a value");
      return std::string(argv[++i]);
    };
    if (a == "--spp")
      spp = std::stoi(value());
    else if (a == "--seeds")
      seeds = std::stoi(value());
    else if (a == "--threads")
      threads = std::stoi(value());
    else if (a == "--seconds")
      seconds = std::stod(value());
    else if (a == "--processor-time")
      processor_time = true;
    else if (a == "--parts")
      parts = true;
    else if (a == "-D")
      overrides.push_back(value());
    else if (a == "--frames")
      while (i + 1 < argc && argv[i + 1][0] != '-') frames.emplace_back(argv[++i]);
    else
      scene_path = a;
  }
  std::vector<std::string> asked;
  if (parts)
    for (const LayerName& part : kParts) asked.emplace_back(part.name);
  const PreparedScene scene(read_scene(scene_path, overrides), LayerRequest::of(asked, false));
  const Task task{threads, {}, nullptr};
  std::vector<Frame> measured;
  std::array<std::vector<Frame>, kParts.size()> measured_parts;
  double paths = 0, lookups = 0, collisions = 0, total_seconds = 0;
  Layers mask_frame;
  if (frames.empty()) {
    scene.render(1, 999, task);  // warms the caches up
    for (int s = 0; s < seeds; ++s) {
      RenderResult r = scene.render(spp, 1000 + s, task);
      const double took = processor_time ? r.report.cpu_seconds : r.report.seconds;
      measured.push_back(planes_of(r.layers));
      if (parts)
        for (size_t k = 0; k < kParts.size(); ++k) measured_parts[k].push_back(planes_of(r.layers, kParts[k]));
      paths += static_cast<double>(r.report.counters.paths);
      lookups += static_cast<double>(r.report.counters.tracking.lookups);
      collisions += static_cast<double>(r.report.counters.tracking.collisions);
      total_seconds += took;
    }
  } else {
    for (const std::string& path : frames) {
      Layers f = read_exr(path);
      adopt_foreign_layers(f);
      measured.push_back(planes_of(f));
    }
    total_seconds = seconds * static_cast<double>(frames.size());
  }
  // The denominator and the mask come from a longer render of our own.
  const Layers reference = scene.render(std::max(64, spp), 77, task).layers;
  const Frame mean = planes_of(reference);
  const Plane& alpha = reference.at("A");

  const double time = total_seconds / static_cast<double>(measured.size());
  size_t pixels = 0;
  const RunningStatistics errors = error_of(measured, mean, alpha, pixels);
  const double efficiency = 1.0 / (errors.mean * time);
  const double half_width =
      errors.count > 1 ? 1.96 * std::sqrt(errors.mean_variance()) / errors.mean * efficiency : 0.0;
  fmt::print("{:<16} relMSE {:.5f} over {:.1f} % of the pixels, {:.3f} s: efficiency {:.3g} +- {:.2g}",
             scene.scene().name, errors.mean,
             100.0 * static_cast<double>(pixels) / static_cast<double>(alpha.width() * alpha.height()), time,
             efficiency, half_width);
  if (paths > 0)
    fmt::print("; {:.3g} paths/s, {:.3g} look-ups/s, {:.2f} look-ups per scattering, {:.2f} scatterings per path",
               paths / total_seconds, lookups / total_seconds, lookups / std::max(collisions, 1.0), collisions / paths);
  fmt::print("\n");
  if (parts)
    for (size_t k = 0; k < kParts.size(); ++k)
      fmt::print("  {:<10} {:.5f}, mean {}\n", kParts[k].name, error_of(measured_parts[k], mean, alpha, pixels).mean,
                 mean_of(measured_parts[k]));
  return 0;
}

}  // namespace
}  // namespace brume

int main(int argc, char** argv) {
  try {
    return brume::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
