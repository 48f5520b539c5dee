#include "render/renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <numeric>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "render/first_collision.h"
#include "render/render_state.h"
#include "render/wavefront.h"
#include "volume/gradient.h"

namespace brume {
namespace {

// Paths traced together: many enough to fill the lanes, few enough that their samples stay in the cache.
constexpr int kBatch = 16384;

void check_memory(double bytes, const std::string& what, const std::string& advice) {
  const double available = physical_memory();
  if (bytes > 0.8 * available)
    throw InputError(
        fmt::format("{} needs {:.1f} GB, this machine has {:.1f} GB; {}", what, bytes / 1e9, available / 1e9, advice));
}

}  // namespace

PreparedScene::PreparedScene(Scene scene, const LayerRequest& layers, const Task& task)
    : scene_(std::move(scene)), media_(scene_, task), lights_(scene_, media_.world_shift(), task) {
  notes_ = media_.notes();
  bool catcher = false;
  if (!scene_.surfaces.empty()) {
    surfaces_ = std::make_unique<Surfaces>(scene_.surfaces, media_.world_shift());
    const std::vector<std::string> notes = surfaces_->notes();
    notes_.insert(notes_.end(), notes.begin(), notes.end());
    for (uint32_t i = 0; i < surfaces_->count(); ++i) {
      if (scene_.surfaces[i].radiance != dvec3(0)) lights_.add_mesh(surfaces_->mesh(i), scene_.surfaces[i].radiance);
      catcher = catcher || scene_.surfaces[i].role == "shadow_catcher";
    }
  }
  const std::string& sampling = scene_.render.light_sampling;
  // A shadow catcher gathers light by light sampling alone, so the constant sky takes part in it.
  lights_.finish(catcher && sampling == "auto" ? "all" : sampling);
  if (sampling == "none" && lights_.any_delta())
    throw InputError(
        "light_sampling = \"none\" cannot find exactly parallel light or points; give the sun an angular_diameter "
        "above 0, "
        "or use spheres");
  if (catcher && !layers.has(layer::catcher))
    notes_.push_back(
        "a shadow catcher is unseen in the picture itself: record what it shows with --layers ...,catcher,"
        "catcher_unshadowed");
  if (catcher && (!media_.emissions().empty() || sampling == "none"))
    notes_.push_back(
        fmt::format("shadow catchers gather light by light sampling alone: {} not reach them",
                    sampling == "none" ? "with light_sampling = \"none\" light does" : "the media's glow does"));
  const bool glass = std::any_of(scene_.surfaces.begin(), scene_.surfaces.end(), [](const SurfaceSettings& s) {
    return s.material == "dielectric" && s.shadow == "traced";
  });
  if (glass && lights_.any_delta())
    notes_.push_back(
        "no path finds points, spots and exactly parallel suns through dielectric meshes: behind them their light is "
        "missing. Give them a radius or an angular_diameter, the larger the less noise, or the meshes shadow = "
        "\"straight\"");
  if (!(scene_.camera.shutter.y > scene_.camera.shutter.x) &&
      !(scene_.camera.position_end.empty() && scene_.camera.look_at_end.empty()))
    notes_.push_back("the camera moves but camera.shutter opens and closes at once: it stands where it starts");
  if (scene_.volumes.empty() && scene_.surfaces.empty())
    notes_.push_back("the scene has no [[volumes]]: there is nothing to scatter light");
  const std::vector<std::string> light_notes = lights_.notes();
  notes_.insert(notes_.end(), light_notes.begin(), light_notes.end());
  if (!lights_.any() && media_.emissions().empty())
    notes_.push_back("the scene has no light: the picture will be black");
  const Camera camera(scene_.camera, scene_.film.width, scene_.film.height, media_.world_shift());
  context_.media = media_.media();
  context_.emissions = media_.emissions();
  context_.lights = &lights_;
  context_.surfaces = surfaces_.get();
  context_.plan = make_plan(media_, lights_, surfaces_.get(), camera, layers);
  if (scene_.render.lanes != "off" && !layers.records &&
      fits_lanes(context_.plan, context_.media, context_.emissions, lights_)) {
    context_.plan.lanes = true;
    lane_grid_ = LaneGrid(context_.media[0].bricks(), scene_.render.majorant_scale);
    if (context_.plan.medium_surface) {
      const Medium& m = context_.media[0];
      lane_grid_.find_surface(m.bricks(), static_cast<float>(scene_.render.surface_density * m.maximum_density()),
                              task);
    }
    context_.lane_grid = &lane_grid_;
    for (const EmissionField& field : context_.emissions) glow_grids_.emplace_back(field.shape().bricks());
    context_.glow_grids = glow_grids_;
    context_.interpolate = scene_.render.lookup == "interpolated";
    if (!context_.plan.emission) {  // whose light is what a flight by chance meets before it ends
      std::vector<Ray> rays;
      for (const auto& [x, y] : coarse_pixels(24)) rays.push_back(request(camera, 0x5eedf1a5, x, y, 0).ray);
      const FirstCollision first = choose_first_collision(context_.media[0], rays, scene_.render.first_collision);
      context_.plan.forced_first = first.forced;
      context_.first_majorant = first.majorant;
    }
  }
  context_.max_events = scene_.render.max_events;
  context_.roulette_start = scene_.render.roulette_start;
  context_.surface_density = scene_.render.surface_density;
  context_.world_shift = media_.world_shift();
  context_.near_lights = choose_near_lights(context_.media, lights_, scene_.render.near_lights);
  context_.plan.near_lights = !context_.near_lights.empty();
  if (context_.plan.flash) calibrate_flash();
}

// A block of pixels is walked first, and its quarters from where it meets something, down to pixels. Blocks are the
// same in every window.
std::vector<PixelStart> PreparedScene::pixel_starts(const Camera& camera, const RenderJob::Crop& window,
                                                    const Task& task) const {
  constexpr int kBlock = 8;
  const int width = window.x1 - window.x0;
  std::vector<PixelStart> starts(static_cast<size_t>(width) * (window.y1 - window.y0));
  if (!context_.plan.lanes || camera.moves()) return starts;
  const auto rounded_down = [](double t) { return std::nextafter(static_cast<float>(t), 0.0f); };
  const auto visit = [&](const auto& self, const ivec2& corner, int size, const LaneGrid::Meeting& from) -> void {
    const auto inside = [](int begin, int extent, int low, int high) { return begin + extent > low && begin < high; };
    if (!inside(corner.x, size, window.x0, window.x1) || !inside(corner.y, size, window.y0, window.y1)) return;
    const LaneGrid::Meeting m =
        lane_grid_.first_meeting(context_.media[0].to_local(*camera.beam(corner, corner + size)), from);
    if (size > 1) {
      for (int k = 0; k < 4; ++k) self(self, corner + ivec2(k & 1, k >> 1) * (size / 2), size / 2, m);
      return;
    }
    starts[static_cast<size_t>(corner.y - window.y0) * width + (corner.x - window.x0)] = {
        rounded_down(m.medium), rounded_down(m.surface), static_cast<int16_t>(m.axis), static_cast<int16_t>(m.layer)};
  };
  const int first_row = window.y0 / kBlock, rows = (window.y1 - 1) / kBlock - first_row + 1;
  parallel_for(rows, task, [&](int row) {
    for (int x = window.x0 / kBlock * kBlock; x < window.x1; x += kBlock)
      visit(visit, {x, (first_row + row) * kBlock}, kBlock, {0, 0});
  });
  return starts;
}

PathRequest PreparedScene::request(const Camera& camera, int64_t seed, int x, int y, uint32_t sample,
                                   const PixelStart& start) const {
  PathRequest r;
  r.start = start;
  r.key = {static_cast<uint64_t>(seed), static_cast<uint32_t>(scene_.render.frame),
           static_cast<uint32_t>(y * scene_.film.width + x), sample};
  const Sobol sobol(r.key);
  const Plan& plan = context_.plan;
  if (plan.shutter) r.time = sobol.pair(2).x;
  r.ray = camera.ray(dvec2(x, y) + sobol.pair(0), plan.lens ? sobol.pair(1) : dvec2(0.5), r.time);
  return r;
}

std::vector<std::pair<int, int>> PreparedScene::coarse_pixels(int grid) const {
  std::vector<std::pair<int, int>> pixels;
  for (int j = 0; j < grid; ++j)
    for (int i = 0; i < grid; ++i)
      pixels.emplace_back((2 * i + 1) * scene_.film.width / (2 * grid), (2 * j + 1) * scene_.film.height / (2 * grid));
  return pixels;
}

// The lamp's strength replaces the indirect light that the flash image leaves out: estimated once, from a coarse grid
// of pixels with a seed of their own, so that it is a constant of the scene.
void PreparedScene::calibrate_flash() {
  const Medium& medium = *this->medium();
  const Camera camera(scene_.camera, scene_.film.width, scene_.film.height, world_shift());
  FlashLamp& lamp = context_.flash;
  lamp.distance =
      glm::distance(camera.ray({0.5 * scene_.film.width, 0.5 * scene_.film.height}).o, media_.bounds().centre);
  if (!(lamp.distance > 0)) lamp.distance = 1;
  const std::string& relief = scene_.render.flash_relief;
  lamp.falloff = relief != "none" && relief != "gradient";
  lamp.shading = relief != "none" && relief != "falloff";
  if (relief == "offset") {
    const double w = scene_.film.width, h = scene_.film.height;
    const auto across = [&](const dvec2& from, const dvec2& to) {
      return glm::normalize(camera.ray(to).at(lamp.distance) - camera.ray(from).at(lamp.distance));
    };
    lamp.offset = 0.2 * media_.bounds().radius *
                  glm::normalize(across({0, 0.5 * h}, {w, 0.5 * h}) + across({0.5 * w, h}, {0.5 * w, 0}));
  }
  lamp.intensity = 1;

  std::vector<PathRequest> requests;
  std::vector<double> steepness;
  for (const auto& [x, y] : coarse_pixels(48)) {
    for (uint32_t s = 0; s < 4; ++s) requests.push_back(request(camera, 0x5eedf1a5, x, y, s));
    const Ray local = medium.to_local(requests.back().ray);
    const auto t = find_surface(medium, local, static_cast<float>(context_.surface_density * medium.maximum_density()));
    if (!t) continue;
    if (const auto g = density_gradient(medium, local.at(*t + 0.5 / glm::length(local.d))))
      steepness.push_back(glm::length(*g));
  }
  if (!steepness.empty()) {
    const auto middle = steepness.begin() + static_cast<std::ptrdiff_t>(steepness.size() / 2);
    std::nth_element(steepness.begin(), middle, steepness.end());
    lamp.typical_gradient = *middle;
  }
  // Summed in the requests' order: the lamp is the same whatever the tracer's.
  std::vector<double> indirects(requests.size()), flashes(requests.size());
  PathCounters counters;
  const auto keep = [&](size_t i, const PathSample& s) {
    indirects[i] = luminance(s.indirect), flashes[i] = luminance(s.flash - s.direct);
  };
  select_path_tracer(context_.plan)(context_, requests, keep, counters);
  const double indirect = std::accumulate(indirects.begin(), indirects.end(), 0.0);
  const double flash = std::accumulate(flashes.begin(), flashes.end(), 0.0);
  lamp.intensity = flash > 0 ? indirect / flash : 0.0;
}

RenderResult PreparedScene::render(int spp, int64_t seed, const Task& task) const {
  RenderJob job;
  job.spp = spp, job.seed = seed;
  return render(job, task);
}

RenderResult PreparedScene::render(const RenderJob& job, const Task& task) const {
  const RenderJob::Crop window = job.crop.value_or(RenderJob::Crop{0, 0, scene_.film.width, scene_.film.height});
  const int width = window.x1 - window.x0, height = window.y1 - window.y0;
  const bool progressive =
      job.time_limit > 0 || job.target_error > 0 || !job.checkpoint.empty() || job.watch != nullptr;
  const bool keep = progressive || job.keep_state || !job.resume.empty();
  if (job.target_error > 0 && !context_.plan.layers.statistics)
    throw InputError("a target error needs statistics: without them no error is estimated");
  const LayerRequest& layers = context_.plan.layers;
  check_memory(Film::layer_bytes(width, height, layers) + (keep ? Film::state_bytes(width, height, layers) : 0.0),
               fmt::format("a film of {} x {}", width, height),
               "make it smaller, or record fewer layers or no statistics");

  const int first = static_cast<int>(static_cast<int64_t>(job.spp) * (job.part - 1) / job.parts);
  const int end = static_cast<int>(static_cast<int64_t>(job.spp) * job.part / job.parts);
  const Camera camera(scene_.camera, scene_.film.width, scene_.film.height, world_shift());
  const TracePaths trace = select_path_tracer(context_.plan);
  Film film(width, height, layers);
  RenderResult result;
  RenderReport& report = result.report;
  double seconds_before = 0, cpu_before = 0;
  const auto window_origin = ivec2(window.x0, window.y0), full = ivec2(scene_.film.width, scene_.film.height);
  if (!job.resume.empty()) {
    const Layers saved = read_exr_state(job.resume);
    Layers expected(width, height);
    describe(expected, camera, job, first, end, report);
    if (job.crop) expected.origin = window_origin, expected.display = full;
    check_same_render(saved, job.resume.string(), expected, "this render", /*same_samples=*/true);
    film.merge_state(saved, job.resume.string());
    for (int tile = 0; tile < film.tile_count(); ++tile) film.develop(tile);
    seconds_before = saved.number("renderTimeSeconds").value_or(0.0);
    cpu_before = saved.number("cpuSeconds").value_or(0.0);
    report.counters.capped_paths = static_cast<uint64_t>(saved.number("cappedPaths").value_or(0.0));
  }

  std::unique_ptr<RecordWriter> records;
  if (!job.records.empty()) {
    if (progressive || !job.resume.empty() || job.parts > 1)
      throw InputError(
          "sample records are written in one go: not with time, error, checkpoint, resume, part or viewer");
    RecordLayout layout{width,
                        height,
                        Film::kTile,
                        end - first,
                        PathRecord::fields(),
                        fmt::format("scene {} hash {} seed {}", scene_.name, scene_.hash, job.seed)};
    records = std::make_unique<RecordWriter>(job.records, layout);
  }

  struct TileReport {
    PathCounters counters;
    uint64_t invalid = 0;
    std::optional<RenderReport::Where> first_invalid;
  };
  std::vector<TileReport> reports(static_cast<size_t>(film.tile_count()));
  std::mutex watching;
  const Stopwatch wall;
  const double cpu_start = cpu_seconds();
  const auto elapsed = [&] { return seconds_before + wall.seconds(); };

  std::vector<PixelStart> starts;

  // One pass: every tile up to `goal` samples of each pixel.
  const auto pass = [&](uint32_t goal, const Task& pass_task) {
    parallel_for(film.tile_count(), pass_task, [&](int tile) {
      TileReport& r = reports[static_cast<size_t>(tile)];
      const Film::Bounds b = film.bounds(tile);
      static thread_local std::vector<PathRequest> requests;
      static thread_local std::vector<float> rows;
      const bool had_work = film.taken(tile) < goal;
      std::vector<PathRecord> tile_records(records ? static_cast<size_t>(b.pixels()) * goal : 0);
      while (film.taken(tile) < goal) {
        if (pass_task.cancelled()) return;
        const uint32_t start = film.taken(tile);
        const uint32_t count = std::min(goal - start, static_cast<uint32_t>(std::max(1, kBatch / b.pixels())));
        requests.clear();
        for (int y = b.y0; y < b.y1; ++y)
          for (int x = b.x0; x < b.x1; ++x)
            for (uint32_t s = start; s < start + count; ++s)
              requests.push_back(request(camera, job.seed, window.x0 + x, window.y0 + y,
                                         static_cast<uint32_t>(first) + s, starts[static_cast<size_t>(y) * width + x]));
        if (records)
          for (size_t i = 0; i < requests.size(); ++i) {
            PathRecord& record = tile_records[i / count * goal + requests[i].key.sample - static_cast<uint32_t>(first)];
            const Sobol sobol(requests[i].key);
            record.film = vec2(sobol.pair(0)), record.lens = vec2(sobol.pair(1));
            record.time = static_cast<float>(requests[i].time);
            requests[i].record = &record;
          }
        // What the film keeps of the samples, in the requests' order: the tracer hands them in as they end.
        const size_t row_size = film.row_size();
        rows.resize(requests.size() * row_size);
        trace(
            context_, requests, [&](size_t i, const PathSample& s) { film.pack(s, rows.data() + i * row_size); },
            r.counters);
        for (int pixel = 0; pixel < b.pixels(); ++pixel) {
          const size_t at = static_cast<size_t>(pixel) * count;
          const uint32_t index = requests[at].key.sample;
          const auto rejected = film.add(tile, pixel, rows.data() + at * row_size, count, index);
          r.invalid += rejected.size();
          if (!rejected.empty() && !r.first_invalid)
            r.first_invalid = {window.x0 + b.x0 + pixel % b.width(), window.y0 + b.y0 + pixel / b.width(),
                               index + rejected.front()};
        }
        film.set_taken(tile, start + count);
      }
      if (!had_work) return;
      if (records) {
        const float* const begin = tile_records.front().values();
        records->write(tile,
                       std::vector<float>(begin, begin + tile_records.size() * (sizeof(PathRecord) / sizeof(float))));
      }
      film.develop(tile);
      if (!keep) film.drop(tile);
      if (job.watch) {
        const std::lock_guard lock(watching);
        job.watch(film, tile);
      }
    });
  };

  const auto collect = [&] {
    const PathCounters resumed = report.counters;
    RenderReport total;
    total.counters.capped_paths = job.resume.empty() ? 0 : resumed.capped_paths;
    for (const TileReport& r : reports) {  // in tile order: the sums do not depend on the threads
      total.counters.merge(r.counters);
      total.invalid_samples += r.invalid;
      if (!total.first_invalid) total.first_invalid = r.first_invalid;
    }
    total.seconds = elapsed();
    total.cpu_seconds = cpu_before + cpu_seconds() - cpu_start;
    uint32_t fewest = UINT32_MAX;
    for (int tile = 0; tile < film.tile_count(); ++tile) fewest = std::min(fewest, film.taken(tile));
    total.samples_per_pixel = static_cast<int>(fewest);
    return total;
  };
  const auto finish = [&](Layers& frame, const RenderReport& r) {
    if (job.crop) frame.origin = window_origin, frame.display = full;
    describe(frame, camera, job, first, first + r.samples_per_pixel, r);
    if (job.stamp) job.stamp(frame);
  };
  CheckpointWriter checkpoint(job.checkpoint, job.warn);
  const auto write_checkpoint = [&] {
    Layers frame = film.layers();
    const RenderReport so_far = collect();
    finish(frame, so_far);
    for (int tile = 0; tile < film.tile_count(); ++tile)
      if (film.taken(tile) != static_cast<uint32_t>(so_far.samples_per_pixel))
        frame.header["interrupted"] = std::string("true: some tiles have more samples than samplesPerPixel");
    film.save_state(frame);
    return checkpoint.write(frame);
  };

  const auto total = static_cast<uint32_t>(end - first);
  uint32_t done = total;
  for (int tile = 0; tile < film.tile_count(); ++tile) done = std::min(done, film.taken(tile));
  const uint32_t resumed_at = done;
  double last_checkpoint = wall.seconds();
  try {
    if (done < total) starts = pixel_starts(camera, window, {task.threads, {}, task.cancel});
    while (done < total) {
      // Whole passes over the picture, longer and longer, but never so long that time or a checkpoint is overrun by
      // much.
      uint32_t goal = total;
      if (progressive) {
        const double per_sample = done > resumed_at ? wall.seconds() / (done - resumed_at) : 0.0;
        double length = std::max(1.0, 0.5 * (done - resumed_at));
        if (per_sample > 0) {
          length = std::min(length, std::max(1.0, 10.0 / per_sample));
          if (job.time_limit > 0) length = std::min(length, std::max(1.0, (job.time_limit - elapsed()) / per_sample));
        }
        goal = static_cast<uint32_t>(std::min<double>(total, done + length));
      }
      Task pass_task = task;
      if (task.progress)
        pass_task.progress = [&, from = done, to = goal](double f) {
          double fraction = total > resumed_at ? (from - resumed_at + f * (to - from)) / (total - resumed_at) : 1.0;
          if (job.time_limit > 0) fraction = std::max(fraction, std::min(elapsed() / job.time_limit, 1.0));
          task.report(fraction < 1 || to == total ? fraction : 0.999);
        };
      pass(goal, pass_task);
      done = goal;
      if (done < total && !job.checkpoint.empty() && wall.seconds() - last_checkpoint > job.checkpoint_seconds) {
        write_checkpoint();
        last_checkpoint = wall.seconds();
      }
      if (job.time_limit > 0 && done < total) {
        const double per_sample = wall.seconds() / (done - resumed_at);
        if (elapsed() + 0.5 * per_sample > job.time_limit) break;
      }
      if (job.target_error > 0 && done >= 4 && film.relative_error(scene_.film.exposure) <= job.target_error) break;
    }
  } catch (const Interrupted&) {
    if (job.checkpoint.empty()) throw;
    for (int tile = 0; tile < film.tile_count(); ++tile) film.develop(tile);
    const std::string name = job.checkpoint.string();
    if (!write_checkpoint()) throw Interrupted(fmt::format("the checkpoint {} could not be brought up to date", name));
    throw Interrupted(fmt::format("the checkpoint {0} is written; go on with --resume {0}", name));
  }
  if (task.progress && done < total) task.report(1.0);
  if (records) records->commit();
  report = collect();
  if (!job.checkpoint.empty()) write_checkpoint();
  result.layers = film.take();
  finish(result.layers, report);
  if (job.keep_state) film.save_state(result.layers);
  return result;
}

void PreparedScene::describe(Layers& layers, const Camera& camera, const RenderJob& job, int first, int end,
                             const RenderReport& report) const {
  const Plan& plan = context_.plan;
  auto& header = layers.header;
  header["scene"] = scene_.name;
  header["sceneHash"] = scene_.hash;
  header["seed"] = std::to_string(job.seed);
  header["frame"] = scene_.render.frame;
  header["samplesPerPixel"] = end - first;
  header["sampleFirst"] = first;
  header["sampleEnd"] = end;
  // A whole frame that stopped by time or error is finished with the samples it has.
  const bool open_ended = job.parts == 1 && (job.time_limit > 0 || job.target_error > 0);
  header["sampleTotal"] = open_ended ? end - first : job.spp;
  header["sampleRanges"] = fmt::format("{}-{}", first, end);
  header["recordedLayers"] = join(plan.layers.names, ",");
  header["statistics"] = std::string(plan.layers.buckets ? "buckets" : plan.layers.statistics ? "halves" : "none");
  header["program"] = job.program;
  header["exposure"] = static_cast<float>(scene_.film.exposure);
  header["renderTimeSeconds"] = static_cast<float>(report.seconds);
  header["cpuSeconds"] = static_cast<float>(report.cpu_seconds);
  header["invalidSampleCount"] = static_cast<int>(std::min<uint64_t>(report.invalid_samples, INT32_MAX));
  header["cappedPaths"] = static_cast<int>(std::min<uint64_t>(report.counters.capped_paths, INT32_MAX));
  std::string estimators = plan.media == Plan::Media::kNone        ? "no medium"
                           : plan.media == Plan::Media::kChromatic ? "delta tracking with spectral MIS"
                                                                   : "delta tracking";
  if (plan.emission) estimators += "; stratified emission";
  estimators += plan.light_sampling ? "; ratio tracking; next-event estimation with balance heuristic"
                                    : "; direction sampling only";
  header["estimators"] = estimators;
  header["biased"] = std::string(report.counters.capped_paths             ? "true: paths were cut at max_events"
                                 : surfaces_ && surfaces_->any_straight() ? "true: straight shadows of dielectrics"
                                                                          : "false");
  header["varianceConvention"] = std::string("mean_variance is the variance of the pixel mean: sample variance / n");
  if (plan.flash) header["flashIntensity"] = static_cast<float>(context_.flash.intensity);
  header["worldToCamera"] = camera.world_to_camera();
  header["worldToNDC"] = camera.world_to_ndc();
}

PathSample PreparedScene::replay(int64_t seed, int x, int y, uint32_t sample) const {
  const Camera camera(scene_.camera, scene_.film.width, scene_.film.height, world_shift());
  PathCounters counters;
  const PathRequest r = request(camera, seed, x, y, sample, pixel_starts(camera, {x, y, x + 1, y + 1}).front());
  PathSample result;
  select_path_tracer(context_.plan)(
      context_, {&r, 1}, [&](size_t, const PathSample& traced) { result = traced; }, counters);
  return result;
}

std::string RenderReport::summary() const {
  const double paths = static_cast<double>(counters.paths), lookups = static_cast<double>(counters.tracking.lookups);
  std::string text = fmt::format(
      "{:.3g} paths in {} ({} of processor time): {:.3g} paths/s, {:.3g} look-ups/s, {:.1f} scatterings per path, "
      "longest {}\n",
      paths, format_duration(seconds), format_duration(cpu_seconds), paths / seconds, lookups / seconds,
      paths > 0 ? static_cast<double>(counters.tracking.collisions) / paths : 0.0, counters.longest);
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
