#include "render/frame/render_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "render/lanes/wavefront.h"

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

RenderSession::RenderSession(const PreparedScene& scene, const RenderJob& job, const Task& task)
    : scene_(scene),
      job_(job),
      task_(task),
      window_(job.crop.value_or(RenderJob::Crop{0, 0, scene.scene().film.width, scene.scene().film.height})),
      first_(job.first_sample()),
      end_(job.end_sample()),
      progressive_(job.time_limit > 0 || job.target_error > 0 || !job.checkpoint.empty() || job.watch != nullptr ||
                   job.next_round != nullptr),
      keep_(progressive_ || job.keep_state || !job.resume.empty()),
      camera_(scene.camera()),
      film_((check_memory(Film::layer_bytes(window_.width(), window_.height(), scene.plan().layers) +
                              (keep_ ? Film::state_bytes(window_.width(), window_.height(), scene.plan().layers) : 0.0),
                          fmt::format("a film of {} x {}", window_.width(), window_.height()),
                          "make it smaller, or record fewer layers or no statistics"),
             window_.width()),
            window_.height(), scene.plan().layers),
      context_(scene.context()),
      trace_(select_path_tracer(scene.plan())),
      checkpoint_(job.checkpoint, job.warn),
      tiles_(static_cast<size_t>(film_.tile_count())) {
  if (job.target_error > 0 && !scene.plan().layers.statistics)
    throw InputError("a target error needs statistics: without them no error is estimated");
  if (!job.resume.empty()) resume();
  if (!job.records.empty()) open_records();
  stop_.cancel = task.cancel;
  context_.stop = &stop_;
  scene.guides(job.samples_for_guides(), quiet(task));
}

void RenderSession::resume() {
  const Layers saved = read_exr_state(job_.resume);
  Layers expected(film_.width(), film_.height());
  finish_header(expected, {});
  check_same_render(saved, job_.resume.string(), expected, "this render", /*same_samples=*/true);
  film_.merge_state(saved, job_.resume.string(), quiet(task_));
  for (int tile = 0; tile < film_.tile_count(); ++tile) film_.develop(tile);
  resumed_.seconds = saved.number("renderTimeSeconds").value_or(0.0);
  resumed_.cpu_seconds = saved.number("cpuSeconds").value_or(0.0);
  resumed_.counters.capped_paths = static_cast<uint64_t>(saved.number("cappedPaths").value_or(0.0));
  resumed_.invalid_samples = static_cast<uint64_t>(saved.number("invalidSampleCount").value_or(0.0));
}

void RenderSession::open_records() {
  if (progressive_ || !job_.resume.empty() || job_.parts > 1)
    throw InputError("sample records are written in one go: not with time, error, checkpoint, resume, part or viewer");
  const Scene& scene = scene_.scene();
  const RecordLayout layout{
      film_.width(), film_.height(),       Film::kTile,
      end_ - first_, PathRecord::fields(), fmt::format("scene {} hash {} seed {}", scene.name, scene.hash, job_.seed)};
  records_ = std::make_unique<RecordWriter>(job_.records, layout);
}

RenderResult RenderSession::run() {
  wall_ = Stopwatch();
  cpu_start_ = cpu_seconds();
  try {
    run_passes();
  } catch (const Interrupted&) {
    for (int tile = 0; tile < film_.tile_count(); ++tile)
      if (keep_) film_.develop(tile);
    const bool out_of_time = !task_.cancelled() && stop_.due();
    if (!out_of_time) {
      if (job_.checkpoint.empty()) throw;
      const std::string name = job_.checkpoint.string();
      if (!write_checkpoint())
        throw Interrupted(fmt::format("the checkpoint {} could not be brought up to date", name));
      throw Interrupted(fmt::format("the checkpoint {0} is written; go on with --resume {0}", name));
    }
  }
  if (task_.progress && done_ < static_cast<uint32_t>(end_ - first_)) task_.report(1.0);
  if (records_) records_->commit();
  if (!job_.checkpoint.empty() && job_.checkpoint_at_end) write_checkpoint();
  RenderResult result;
  result.report = report();
  record_guides(quiet(task_));
  result.layers = film_.take();
  for (const auto& [name, plane] : guides_.channels()) result.layers.set(name, plane);
  finish_header(result.layers, result.report);
  if (job_.keep_state) film_.save_state(result.layers);
  return result;
}

void RenderSession::run_passes() {
  const auto total = static_cast<uint32_t>(end_ - first_);
  done_ = resumed_at_ = std::min(total, fewest_taken());
  if (done_ == total) return;
  if (job_.time_limit > 0) {
    // Whole passes end by themselves near the limit. What takes half as long again is stuck in a flight.
    const double most = std::max(0.0, 1.5 * job_.time_limit + 1 - resumed_.seconds);
    stop_.deadline = std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                                            std::chrono::duration<double>(std::min(most, 1e9)));
  }
  bounds_ = scene_.entry_bounds(camera_, window_, quiet(task_));
  if (job_.next_round) return run_rounds();
  double last_checkpoint = wall_.seconds();
  while (done_ < total) {
    const uint32_t goal = next_goal();
    pass(std::vector<uint32_t>(tiles_.size(), goal));
    done_ = goal;
    if (done_ < total && !job_.checkpoint.empty() && wall_.seconds() - last_checkpoint > job_.checkpoint_seconds) {
      write_checkpoint();
      last_checkpoint = wall_.seconds();
    }
    if (enough()) break;
  }
}

void RenderSession::run_rounds() {
  const auto most = static_cast<uint32_t>(end_ - first_);
  std::vector<uint32_t> goals(tiles_.size(), std::min(most, static_cast<uint32_t>(job_.first_round)));
  double last_checkpoint = wall_.seconds();
  const auto samples = [&] {
    double sum = 0;
    for (int tile = 0; tile < film_.tile_count(); ++tile)
      sum += static_cast<double>(film_.bounds(tile).pixels()) * film_.taken(tile);
    return sum;
  };
  const double resumed = samples();
  double sampling = 0;  // seconds
  for (;;) {
    bool more = false;
    for (size_t tile = 0; tile < goals.size(); ++tile) {
      goals[tile] = std::min(goals[tile], most);
      more = more || goals[tile] > film_.taken(static_cast<int>(tile));
    }
    if (!more) break;
    const Stopwatch watch;
    pass(goals);
    sampling += watch.seconds();
    done_ = fewest_taken();
    if (!job_.checkpoint.empty() && wall_.seconds() - last_checkpoint > job_.checkpoint_seconds) {
      write_checkpoint();
      last_checkpoint = wall_.seconds();
    }
    double growth = std::numeric_limits<double>::infinity();
    const double taken = samples();
    if (job_.time_limit > 0) growth = 1 + (job_.time_limit - elapsed()) * (taken - resumed) / (sampling * taken);
    const Layers frame = frame_so_far(quiet(task_));
    goals = job_.next_round({film_, frame, growth});
  }
}

void RenderSession::record_guides(const Task& task) {
  const Guides* const guides = scene_.guides(job_.samples_for_guides(), task);
  if (!guides || guides_.width() > 0) return;
  guides_ = Layers(film_.width(), film_.height());
  guides->record(camera_, {window_.x0, window_.y0}, guides_, task);
}

Layers RenderSession::frame_so_far(const Task& task) {
  record_guides(task);
  Layers frame = film_.layers();
  for (const auto& [name, plane] : guides_.channels()) frame.set(name, plane);
  finish_header(frame, report());
  return frame;
}

uint32_t RenderSession::next_goal() const {
  const auto total = static_cast<uint32_t>(end_ - first_);
  if (!progressive_) return total;
  const double taken = done_ - resumed_at_, per_sample = taken > 0 ? wall_.seconds() / taken : 0.0;
  double length = std::max(1.0, 0.5 * taken);
  if (per_sample > 0) {
    length = std::min(length, std::max(1.0, 10.0 / per_sample));
    if (job_.time_limit > 0) length = std::min(length, std::max(1.0, (job_.time_limit - elapsed()) / per_sample));
  }
  return static_cast<uint32_t>(std::min<double>(total, done_ + length));
}

bool RenderSession::enough() const {
  if (job_.time_limit > 0 && done_ < static_cast<uint32_t>(end_ - first_)) {
    const double per_sample = wall_.seconds() / (done_ - resumed_at_);
    if (elapsed() + 0.5 * per_sample > job_.time_limit) return true;
  }
  return job_.target_error > 0 && film_.relative_error(scene_.scene().film.exposure) <= job_.target_error;
}

void RenderSession::pass(const std::vector<uint32_t>& goals) {
  Task task = task_;
  const uint32_t goal = *std::max_element(goals.begin(), goals.end());
  if (task_.progress && job_.next_round)
    task.progress = [&](double f) { task_.report(0.999 * f); };
  else if (task_.progress)
    task.progress = [&, from = done_](double f) {
      const auto total = static_cast<uint32_t>(end_ - first_);
      double fraction = (from - resumed_at_ + f * (goal - from)) / (total - resumed_at_);
      if (job_.time_limit > 0) fraction = std::max(fraction, std::min(elapsed() / job_.time_limit, 1.0));
      task_.report(fraction < 1 || goal == total ? fraction : 0.999);
    };
  parallel_for(film_.tile_count(), task, [&](int tile) {
    const uint32_t own = goals[static_cast<size_t>(tile)];
    if (film_.taken(tile) >= own) return;
    std::vector<PathRecord> records(records_ ? static_cast<size_t>(film_.bounds(tile).pixels()) * own : 0);
    while (film_.taken(tile) < own) {
      stop_.check();
      trace_batch(tile, own, records);
    }
    finish_tile(tile, records);
  });
}

void RenderSession::trace_batch(int tile, uint32_t goal, std::vector<PathRecord>& records) {
  static thread_local std::vector<PathRequest> requests;
  static thread_local std::vector<float> rows;
  TileReport& report = tiles_[static_cast<size_t>(tile)];
  const Film::Bounds b = film_.bounds(tile);
  const uint32_t start = film_.taken(tile);
  const uint32_t count = std::min(goal - start, static_cast<uint32_t>(std::max(1, kBatch / b.pixels())));
  const auto first = static_cast<uint32_t>(first_);
  requests.clear();
  for (int y = b.y0; y < b.y1; ++y)
    for (int x = b.x0; x < b.x1; ++x)
      for (uint32_t s = start; s < start + count; ++s)
        requests.push_back(scene_.request(camera_, job_.seed, window_.x0 + x, window_.y0 + y, first + s,
                                          bounds_[static_cast<size_t>(y) * film_.width() + x]));
  if (records_)
    for (size_t i = 0; i < requests.size(); ++i) {
      PathRecord& record = records[i / count * goal + requests[i].key.sample - first];
      const Sobol sobol(requests[i].key);
      record.film = vec2(sobol.pair(0));
      record.lens = vec2(sobol.pair(1));
      record.time = static_cast<float>(requests[i].time);
      requests[i].record = &record;
    }
  // What the film keeps of the samples, in the requests' order: the tracer hands them in as they end.
  const size_t row_size = film_.row_size();
  rows.resize(requests.size() * row_size);
  trace_(
      context_, requests, [&](size_t i, const PathSample& s) { film_.pack(s, rows.data() + i * row_size); },
      report.counters);
  for (int pixel = 0; pixel < b.pixels(); ++pixel) {
    const size_t at = static_cast<size_t>(pixel) * count;
    const uint32_t index = requests[at].key.sample;
    const auto rejected = film_.add(tile, pixel, rows.data() + at * row_size, count, index);
    report.invalid += rejected.size();
    if (!rejected.empty() && !report.first_invalid)
      report.first_invalid = {window_.x0 + b.x0 + pixel % b.width(), window_.y0 + b.y0 + pixel / b.width(),
                              index + rejected.front()};
  }
  film_.set_taken(tile, start + count);
}

void RenderSession::finish_tile(int tile, const std::vector<PathRecord>& records) {
  if (records_) {
    const float* const begin = records.front().values();
    records_->write(tile, std::vector<float>(begin, begin + records.size() * (sizeof(PathRecord) / sizeof(float))));
  }
  film_.develop(tile);
  if (!keep_) film_.drop(tile);
  if (job_.watch) {
    const std::lock_guard lock(watching_);
    job_.watch(film_, tile);
  }
}

uint32_t RenderSession::fewest_taken() const {
  uint32_t fewest = UINT32_MAX;
  for (int tile = 0; tile < film_.tile_count(); ++tile) fewest = std::min(fewest, film_.taken(tile));
  return fewest;
}

bool RenderSession::uneven() const {
  const uint32_t fewest = fewest_taken();
  for (int tile = 0; tile < film_.tile_count(); ++tile)
    if (film_.taken(tile) != fewest) return true;
  return false;
}

RenderReport RenderSession::report() const {
  RenderReport total = resumed_;
  for (const TileReport& r : tiles_) {  // in tile order: the sums do not depend on the threads
    total.counters.merge(r.counters);
    total.invalid_samples += r.invalid;
    if (!total.first_invalid) total.first_invalid = r.first_invalid;
  }
  total.seconds = elapsed();
  total.cpu_seconds = resumed_.cpu_seconds + cpu_seconds() - cpu_start_;
  total.samples_per_pixel = static_cast<int>(fewest_taken());
  total.uneven = !job_.next_round && uneven();
  if (scene_.plan().layers.statistics) total.error = film_.relative_error(scene_.scene().film.exposure);
  return total;
}

bool RenderSession::write_checkpoint() {
  // Interrupted or not, it is written whole.
  Layers frame = frame_so_far(Task{task_.threads});
  film_.save_state(frame);
  return checkpoint_.write(frame);
}

void RenderSession::finish_header(Layers& frame, const RenderReport& report) const {
  if (job_.crop) {
    frame.origin = ivec2(window_.x0, window_.y0);
    frame.display = ivec2(scene_.scene().film.width, scene_.scene().film.height);
  }
  describe(frame, report, first_, first_ + report.samples_per_pixel);
  if (report.uneven)
    frame.header["interrupted"] = std::string("true: some tiles have more samples than samplesPerPixel");
  if (job_.next_round)
    frame.header["adaptive"] = std::string("true: sample_count says how many samples each pixel has");
  if (job_.stamp) job_.stamp(frame);
}

void RenderSession::describe(Layers& frame, const RenderReport& report, int first, int end) const {
  const Scene& scene = scene_.scene();
  const Plan& plan = scene_.plan();
  auto& header = frame.header;
  describe_render(frame, scene, plan.layers, job_);
  header["samplesPerPixel"] = end - first;
  header["sampleFirst"] = first;
  header["sampleEnd"] = end;
  // A whole frame that stopped by time or error is finished with the samples it has.
  const bool open_ended = job_.parts == 1 && (job_.time_limit > 0 || job_.target_error > 0);
  header["sampleTotal"] = open_ended ? end - first : job_.spp;
  header["sampleRanges"] = fmt::format("{}-{}", first, end);
  header["exposure"] = static_cast<float>(scene.film.exposure);
  header["renderTimeSeconds"] = static_cast<float>(report.seconds);
  header["cpuSeconds"] = static_cast<float>(report.cpu_seconds);
  header["invalidSampleCount"] = static_cast<int>(std::min<uint64_t>(report.invalid_samples, INT32_MAX));
  header["cappedPaths"] = static_cast<int>(std::min<uint64_t>(report.counters.capped_paths, INT32_MAX));
  if (report.error) header["estimatedRelativeError"] = static_cast<float>(*report.error);
  std::string estimators = plan.media == Plan::Media::kNone        ? "no medium"
                           : plan.media == Plan::Media::kChromatic ? "delta tracking with spectral MIS"
                                                                   : "delta tracking";
  if (plan.emission) estimators += "; stratified emission";
  estimators += plan.light_sampling ? "; ratio tracking; next-event estimation with balance heuristic"
                                    : "; direction sampling only";
  header["estimators"] = estimators;
  header["biased"] = std::string(report.counters.capped_paths ? "true: paths were cut at max_events"
                                 : scene_.straight_shadows()  ? "true: straight shadows of dielectrics"
                                                              : "false");
  header["varianceConvention"] = std::string("mean_variance is the variance of the pixel mean: sample variance / n");
  if (plan.flash) header["flashIntensity"] = static_cast<float>(context_.flash.intensity);
  header["worldToCamera"] = camera_.world_to_camera();
  header["worldToNDC"] = camera_.world_to_ndc();
}

void describe_render(Layers& frame, const Scene& scene, const LayerRequest& layers, const RenderJob& job) {
  auto& header = frame.header;
  header["scene"] = scene.name;
  header["sceneHash"] = scene.hash;
  header["sceneSettings"] = scene.settings;
  header["seed"] = std::to_string(job.seed);
  header["frame"] = scene.render.frame;
  header["recordedLayers"] = join(layers.text(), ",");
  header["statistics"] = std::string(layers.buckets ? "buckets" : layers.statistics ? "halves" : "none");
  header["program"] = job.program;
}

std::string RenderReport::summary() const {
  const double paths = static_cast<double>(counters.paths), lookups = static_cast<double>(counters.tracking.lookups);
  std::string text = fmt::format(
      "{:.3g} paths in {} ({} of processor time): {:.3g} paths/s, {:.3g} look-ups/s, {:.1f} scatterings per path, "
      "longest {}\n",
      paths, format_duration(seconds), format_duration(cpu_seconds), paths / seconds, lookups / seconds,
      paths > 0 ? static_cast<double>(counters.tracking.collisions) / paths : 0.0, counters.longest);
  if (uneven)
    text += fmt::format("warning: the time ran out in the middle of a pass: some tiles have more than {} samples\n",
                        samples_per_pixel);
  if (counters.capped_paths)
    text += fmt::format("warning: {} paths were cut at max_events, carrying {:.3g} of the throughput of all paths\n",
                        counters.capped_paths, counters.capped_throughput / paths);
  if (invalid_samples)
    text += fmt::format("warning: {} samples were not finite and were left out{}\n", invalid_samples,
                        first_invalid ? fmt::format("; the first: --replay {},{},{}", first_invalid->x,
                                                    first_invalid->y, first_invalid->sample)
                                      : ", all of them before this session");
  if (counters.tracking.majorant_violations)
    text += fmt::format("warning: {} look-ups passed their majorant: a bug, please report it\n",
                        counters.tracking.majorant_violations);
  return text;
}

}  // namespace brume
