#include "render/renderer.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.h"
#include "base/parallel_for.h"
#include "render/film.h"

namespace brume {
namespace {

constexpr int kTile = 16;

dmat4 translation(const dvec3& t) {
  dmat4 m(1.0);
  m[3] = glm::dvec4(t, 1.0);
  return m;
}

SampleKey key_of(const Scene& scene, int64_t seed, int x, int y, uint32_t sample) {
  return {static_cast<uint64_t>(seed), static_cast<uint32_t>(scene.render.frame),
          static_cast<uint32_t>(y * scene.film.width + x), sample};
}

PathSample take_sample(const PathContext& context, TracePath trace, const Camera& camera, const SampleKey& key, int x,
                       int y, PathCounters& counters) {
  const Sobol sobol(key);
  Rng rng(key);
  return trace(context, camera.ray(dvec2(x, y) + sobol.pair(0)), sobol, rng, counters);
}

}  // namespace

PreparedScene::PreparedScene(Scene scene, const LayerRequest& layers, const Task& task) : scene_(std::move(scene)) {
  Medium::Sphere bounds{scene_.camera.look_at, 1.0};
  if (!scene_.volumes.empty()) {
    const VolumeSettings& v = scene_.volumes[0];
    field_ = std::make_unique<DensityField>(load_density(v.file, {v.grid, v.convert_level_set}, task));
    notes_ = field_->notes;
    check_transform(v.object_to_world, "object_to_world");
    const dmat4 world_from_index = v.object_to_world * field_->world_from_index * translation(v.index_offset);
    // All positions are kept relative to the volume, so that far from the world's origin nothing is lost.
    if (!field_->bricks.empty()) {
      const dvec3 middle =
          0.5 * (field_->bricks.support_lo() + field_->bricks.support_hi()) + dvec3(field_->bricks.origin());
      world_shift_ = dvec3(world_from_index * glm::dvec4(middle, 1.0));
    }
    medium_.emplace(field_->bricks, translation(-world_shift_) * world_from_index, v.sigma_t, v.albedo, v.g);
    if (!field_->bricks.empty()) bounds = medium_->bounding_sphere();
  }
  lights_ = Lights(scene_, bounds, world_shift_);
  if (scene_.render.light_sampling == "none")
    for (const LightSettings& light : scene_.lights)
      if (light.type == "sun" && light.angular_diameter == 0)
        throw InputError(
            "light_sampling = \"none\" cannot find exactly parallel light; give the sun an angular_diameter above 0");
  if (scene_.volumes.empty()) notes_.push_back("the scene has no [[volumes]]: there is nothing to scatter light");
  if (lights_.environment.black() && scene_.lights.empty())
    notes_.push_back("the scene has no light: the picture will be black");
  context_.medium = medium();
  context_.lights = &lights_;
  context_.plan = make_plan(lights_, medium(), layers);
  context_.max_events = scene_.render.max_events;
  context_.roulette_start = scene_.render.roulette_start;
  if (medium_) context_.surface_density = static_cast<float>(scene_.render.surface_density * field_->bricks.maximum());
}

RenderResult PreparedScene::render(int spp, int64_t seed, const Task& task) const {
  const int width = scene_.film.width, height = scene_.film.height;
  const double needed = context_.plan.film_bytes(width, height), available = physical_memory();
  if (needed > 0.8 * available)
    throw InputError(
        fmt::format("a film of {} x {} needs {:.1f} GB for its layers, this machine has {:.1f} GB; make it smaller, "
                    "or record fewer layers or no statistics",
                    width, height, needed / 1e9, available / 1e9));
  const Camera camera(scene_.camera, width, height, world_shift_);
  const TracePath trace = select_path_tracer(context_.plan);
  Film film(width, height, context_.plan.layers);

  const ivec2 tiles{(width + kTile - 1) / kTile, (height + kTile - 1) / kTile};
  struct TileReport {
    PathCounters counters;
    uint64_t invalid = 0;
    std::optional<RenderReport::Where> first_invalid;
  };
  std::vector<TileReport> reports(static_cast<size_t>(tiles.x) * tiles.y);
  const Stopwatch wall;
  const double cpu_start = cpu_seconds();
  parallel_for(tiles.x * tiles.y, task, [&](int tile) {
    TileReport& report = reports[static_cast<size_t>(tile)];
    const int x0 = tile % tiles.x * kTile, y0 = tile / tiles.x * kTile;
    for (int y = y0; y < std::min(y0 + kTile, height); ++y)
      for (int x = x0; x < std::min(x0 + kTile, width); ++x) {
        Film::Pixel pixel;
        uint32_t invalid = 0;
        for (uint32_t s = 0; s < static_cast<uint32_t>(spp); ++s) {
          if (s % 64 == 0 && task.cancelled()) return;
          const PathSample sample =
              take_sample(context_, trace, camera, key_of(scene_, seed, x, y, s), x, y, report.counters);
          if (Film::add(pixel, sample, s & 1u)) continue;
          ++invalid;
          if (!report.first_invalid) report.first_invalid = {x, y, s};
        }
        report.invalid += invalid;
        film.store(x, y, pixel, invalid);
      }
  });

  RenderResult result;
  RenderReport& total = result.report;
  total.seconds = wall.seconds();
  total.cpu_seconds = cpu_seconds() - cpu_start;
  for (const TileReport& r : reports) {  // in tile order: the sums do not depend on the threads
    total.counters.merge(r.counters);
    total.invalid_samples += r.invalid;
    if (!total.first_invalid) total.first_invalid = r.first_invalid;
  }
  result.layers = film.take();
  auto& header = result.layers.header;
  header["scene"] = scene_.name;
  header["sceneHash"] = scene_.hash;
  header["seed"] = std::to_string(seed);
  header["frame"] = scene_.render.frame;
  header["samplesPerPixel"] = spp;
  header["sampleFirst"] = 0;
  header["sampleEnd"] = spp;
  header["sampleTotal"] = spp;
  header["exposure"] = static_cast<float>(scene_.film.exposure);
  header["renderTimeSeconds"] = static_cast<float>(total.seconds);
  header["cpuSeconds"] = static_cast<float>(total.cpu_seconds);
  header["invalidSampleCount"] = static_cast<int>(std::min<uint64_t>(total.invalid_samples, INT32_MAX));
  header["estimators"] = std::string(
      !context_.plan.medium           ? "no medium"
      : !context_.plan.light_sampling ? "delta tracking; phase sampling only"
                                      : "delta tracking; ratio tracking; next-event estimation with balance heuristic");
  header["biased"] = std::string(total.counters.capped_paths ? "true: paths were cut at max_events" : "false");
  header["varianceConvention"] = std::string("mean_variance is the variance of the pixel mean: sample variance / n");
  header["worldToCamera"] = camera.world_to_camera();
  header["worldToNDC"] = camera.world_to_ndc();
  return result;
}

PathSample PreparedScene::replay(int64_t seed, int x, int y, uint32_t sample) const {
  const Camera camera(scene_.camera, scene_.film.width, scene_.film.height, world_shift_);
  PathCounters counters;
  return take_sample(context_, select_path_tracer(context_.plan), camera, key_of(scene_, seed, x, y, sample), x, y,
                     counters);
}

std::string RenderReport::summary() const {
  const double paths = static_cast<double>(counters.paths), lookups = static_cast<double>(counters.tracking.lookups);
  std::string text = fmt::format(
      "{:.3g} paths in {} ({} of processor time): {:.3g} paths/s, {:.3g} look-ups/s, {:.1f} scatterings per path, "
      "longest {}\n",
      paths, format_duration(seconds), format_duration(cpu_seconds), paths / seconds, lookups / seconds,
      static_cast<double>(counters.tracking.collisions) / paths, counters.longest);
  if (counters.capped_paths)
    text += fmt::format("warning: {} paths were cut at max_events, carrying {:.3g} of the throughput of all paths\n",
                        counters.capped_paths, counters.capped_throughput / paths);
  if (invalid_samples)
    text += fmt::format("warning: {} samples were not finite and were left out; the first: --replay {},{},{}\n",
                        invalid_samples, first_invalid->x, first_invalid->y, first_invalid->sample);
  if (counters.tracking.majorant_violations)
    text += fmt::format("warning: {} look-ups passed their majorant: a bug, please report it\n",
                        counters.tracking.majorant_violations);
  return text;
}

}  // namespace brume
