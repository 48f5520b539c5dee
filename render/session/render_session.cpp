#include "render/session/render_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/error.h"
#include "base/parallel_for.h"
#include "render/transport/wavefront.h"

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
                   job.show != nullptr || job.next_round != nullptr),
      keep_(progressive_ || job.keep_state || !job.resume.empty()),
      camera_(scene.camera()),
      film_((check_memory(Film::layer_bytes(window_.width(), window_.height(), scene.plan().layers) +
                              (keep_ ? Film::state_bytes(window_.width(), window_.height(), scene.plan().layers) : 0.0),
                          fmt::format("a film of {} x {}", window_.width(), window_.height()),
                          "make it smaller, or record fewer layers or no statistics"),
             window_.width()),
            window_.height(), scene.plan().layers),
      context_(scene.context()),
      checkpoint_(job.checkpoint, job.warn),
      tiles_(static_cast<size_t>(film_.tile_count())) {
  if (job.target_error > 0 && !scene.plan().layers.statistics)
    throw InputError("a target error needs statistics: without them no error is estimated");
  if (!job.resume.empty()) resume();
  if (!job.records.empty()) open_records();
  stop_.cancel = task.cancel;
  context_.stop = &stop_;
  if (!job.show) scene.guides(job.samples_for_guides(), quiet(task));  // who watches first sees what needs none
}

void RenderSession::develop_all() {
  parallel_for(film_.tile_count(), {task_.threads}, [&](int tile) { film_.develop(tile); });
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
    const bool out_of_time = !task_.cancelled() && stop_.due();
    if (!out_of_time && job_.checkpoint.empty()) throw;
    if (keep_) develop_all();
    if (!out_of_time) {
      const std::string name = job_.checkpoint.string();
      if (!write_checkpoint())
        throw Interrupted(fmt::format("the checkpoint {} could not be brought up to date", name));
      throw Interrupted(fmt::format("the checkpoint {0} is written; go on with --resume {0}", name));
    }
  }
  task_.report(1.0);
  if (records_) records_->commit();
  record_guides(quiet(task_));
  if (!job_.checkpoint.empty() && job_.checkpoint_at_end) write_checkpoint();
  RenderResult result;
  result.report = report();
  result.layers = film_.take();
  for (const auto& [name, plane] : guides_.channels()) result.layers.set(name, std::move(*guides_.find(name)));
  for (const auto& [name, plane] : guides_.stored()) result.layers.set_stored(name, plane);
  result.deep = std::move(deep_);
  if (job_.mattes)
    result.mattes = record_mattes(scene_.scene(), scene_.media(), context_, camera_, {window_.x0, window_.y0},
                                  {window_.width(), window_.height()}, quiet(task_));
  finish_header(result.layers, result.report);
  if (job_.keep_state) film_.save_state(result.layers, {task_.threads});
  return result;
}

void RenderSession::run_passes() {
  const auto total = static_cast<uint32_t>(end_ - first_);
  done_ = resumed_at_ = std::min(total, fewest_taken());
  resumed_samples_ = samples_taken();
  if (done_ == total) return;
  if (job_.time_limit > 0) {
    // Whole passes end by themselves near the limit. What takes half as long again is stuck in a flight.
    const double most = std::max(0.0, 1.5 * job_.time_limit + 1 - resumed_.seconds);
    stop_.deadline = std::chrono::steady_clock::now() + std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                                                            std::chrono::duration<double>(std::min(most, 1e9)));
  }
  bounds_ = scene_.entry_bounds(camera_, window_, quiet(task_));
  last_checkpoint_ = wall_.seconds();
  task_.report(0);
  if (job_.next_round) return run_rounds();
  // The pass that a checkpoint was interrupted in is ended first.
  uint32_t goal = most_taken();
  if (goal > done_)
    goal = std::min(goal, total);
  else if (done_ > 0 && enough())
    return;
  else
    goal = next_goal();
  for (;; goal = next_goal()) {
    pass(std::vector<uint32_t>(tiles_.size(), goal));
    done_ = goal;
    if (done_ < total) write_regular_checkpoint();
    if (done_ == total || enough()) break;
    show_picture();
  }
}

void RenderSession::write_regular_checkpoint() {
  if (job_.checkpoint.empty() || wall_.seconds() - last_checkpoint_ <= job_.checkpoint_seconds) return;
  write_checkpoint();
  last_checkpoint_ = wall_.seconds();
}

double RenderSession::sampling_to_come() const {
  double all = 0;
  for (int tile = 0; tile < film_.tile_count(); ++tile)
    all += static_cast<double>(film_.bounds(tile).pixels()) *
           (job_.next_round ? goals_[static_cast<size_t>(tile)] : static_cast<uint32_t>(end_ - first_));
  const double now = samples_taken(), taken = now - resumed_samples_;
  double seconds = taken > 0 ? sampling_seconds_ / taken * (all - now) : 0;
  if (job_.time_limit > 0) seconds = std::min(seconds, job_.time_limit - elapsed());
  return seconds;
}

void RenderSession::show_picture() {
  constexpr double kMostShare = 0.25;  // of the time
  const bool first = last_shown_ < 0;
  if (!job_.show || (!first && kMostShare * (wall_.seconds() - last_shown_) < showing_seconds_)) return;
  if (!first) {  // guides are needed at the end in any case; a picture on the way only where the end is not as near
    const Stopwatch watch;
    record_guides(quiet(task_));
    guide_seconds_ = std::max(guide_seconds_, watch.seconds());
    if (sampling_to_come() < std::max(guide_seconds_, showing_seconds_)) return;
  }
  const Stopwatch watch;
  job_.show(
      film_, [&] { return film_so_far(); }, first);
  task_.check();
  showing_seconds_ = watch.seconds();
  last_shown_ = wall_.seconds();
}

void RenderSession::run_rounds() {
  const auto most = static_cast<uint32_t>(end_ - first_);
  if (goals_.empty()) goals_.assign(tiles_.size(), static_cast<uint32_t>(job_.first_round));
  double sampling = 0;  // seconds
  for (bool resumed = fewest_taken() > 0;; resumed = false) {
    bool more = false;
    for (size_t tile = 0; tile < goals_.size(); ++tile) {
      goals_[tile] = std::min(goals_[tile], most);
      more = more || goals_[tile] > film_.taken(static_cast<int>(tile));
    }
    // A checkpoint may hold all of its round.
    if (!more && !resumed) break;
    if (more) {
      const Stopwatch watch;
      const double before = samples_taken();
      if (job_.show && before == 0) {  // who watches need not wait for the whole of the first round
        for (uint32_t few = 1; 2 * few <= goals_.front(); few *= 2) {
          pass(std::vector<uint32_t>(tiles_.size(), few));
          show_picture();
        }
      }
      pass(goals_);
      sampling += watch.seconds();
      rounds_.add_sampling(samples_taken() - before, watch.seconds());
      done_ = fewest_taken();
      write_regular_checkpoint();
    }
    const Stopwatch watch;
    NextRound next = ask_for_round(sampling);
    rounds_.add_estimate(watch.seconds());
    if (next.goals.empty()) break;
    if (next.error > 0) errors_.push_back({samples_taken(), next.error});
    goals_ = std::move(next.goals);
    rounds_.expect(next.samples_needed, next.rounds_needed);
  }
}

NextRound RenderSession::ask_for_round(double sampling_seconds) {
  double growth = std::numeric_limits<double>::infinity();
  if (job_.time_limit > 0) {
    const double taken = samples_taken(), fresh = taken - resumed_samples_;
    // Before a session has samples of its own, those that it resumed tell their pace.
    const double seconds_per_sample = fresh > 0 ? sampling_seconds / fresh : resumed_.seconds / taken;
    growth = 1 + (job_.time_limit - elapsed()) / (seconds_per_sample * taken);
  }
  record_guides(quiet(task_));
  const Layers frame = film_so_far();
  return job_.next_round({film_, frame, growth, errors_});
}

void RenderSession::record_guides(const Task& task) {
  if (job_.recorded_guides && guides_.width() == 0) guides_ = *job_.recorded_guides;
  const Guides* const guides = scene_.guides(job_.samples_for_guides(), task);
  if (!guides || guides_.width() > 0) return;
  guides_ = Layers(film_.width(), film_.height());
  const ivec2 corner(window_.x0, window_.y0);
  if (job_.deep_samples > 0)
    deep_.emplace(corner, ivec2(film_.width(), film_.height()), static_cast<size_t>(job_.deep_samples));
  DeepRecord* const deep = deep_ ? &*deep_ : nullptr;
  if (job_.stored)
    guides->record_stored(camera_, corner, guides_, task, job_.stored, deep);
  else
    guides->record(camera_, corner, guides_, task, /*sketch=*/false, deep);
}

Layers RenderSession::film_so_far() const {
  Layers frame = film_.layers();
  for (const auto& [name, plane] : guides_.channels()) frame.set(name, plane);
  for (const auto& [name, plane] : guides_.stored()) frame.set_stored(name, plane);
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

bool RenderSession::enough() {
  if (job_.time_limit > 0 && done_ < static_cast<uint32_t>(end_ - first_)) {
    const double per_sample = done_ > resumed_at_ ? wall_.seconds() / (done_ - resumed_at_) : 0.0;
    if (elapsed() + 0.5 * per_sample > job_.time_limit) return true;
  }
  if (!(job_.target_error > 0)) return false;
  const double error = film_.relative_error(scene_.scene().film.exposure, task_.threads);
  // The squared error falls like the samples.
  if (std::isfinite(error)) needed_samples_ = samples_taken() * std::pow(error / job_.target_error, 2);
  return error <= job_.target_error;
}

double RenderSession::samples_taken() const {
  double sum = 0;
  for (int tile = 0; tile < film_.tile_count(); ++tile)
    sum += static_cast<double>(film_.bounds(tile).pixels()) * film_.taken(tile);
  return sum;
}

double RenderSession::done_share(double samples) const {
  const auto of_samples = [&](double goal) { return (samples - resumed_samples_) / (goal - resumed_samples_); };
  double share = of_samples(static_cast<double>(film_.width()) * film_.height() * (end_ - first_));
  if (job_.time_limit > 0) share = std::max(share, wall_.seconds() / (job_.time_limit - resumed_.seconds));
  if (needed_samples_ > 0) share = std::max(share, of_samples(needed_samples_));
  return std::clamp(share, 0.0, 0.999);
}

double RenderSession::rounds_share(double samples, double before, double pass_seconds) const {
  const double left = rounds_.seconds_left(samples, samples - before, pass_seconds), spent = wall_.seconds();
  return std::max(done_share(samples), left > 0 ? spent / (spent + left) : 0.0);
}

void RenderSession::pass(const std::vector<uint32_t>& goals) {
  Task task = task_;
  const Stopwatch watch;
  const double before = samples_taken();
  double after = 0, share = 0;
  for (int tile = 0; tile < film_.tile_count(); ++tile)
    after += static_cast<double>(film_.bounds(tile).pixels()) *
             std::max(film_.taken(tile), goals[static_cast<size_t>(tile)]);
  if (needed_samples_ > 0) needed_samples_ = std::max(needed_samples_, after);  // no pass ends early
  if (task_.progress)
    task.progress = [&](double f) {
      const double samples = before + f * (after - before);
      // Within a round a slower pace holds the bar; more samples than were thought to be needed pull it back after it.
      share = std::max(share, job_.next_round ? rounds_share(samples, before, watch.seconds()) : done_share(samples));
      task_.report(share);
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
  sampling_seconds_ += watch.seconds();
}

bool RenderSession::sky_is_uniform(const Film::Bounds& tile) const {
  const Plan& plan = scene_.plan();
  if (!plan.one_grid || plan.emission || records_) return false;
  const ivec2 corner(window_.x0, window_.y0);
  const std::optional<RayCone> rays =
      camera_.ray_cone(corner + ivec2(tile.x0, tile.y0), corner + ivec2(tile.x1, tile.y1));
  return rays && context_.lights->uniform_background(*rays);
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
  // Rows of what the film keeps, `count` for each pixel; one path is all that pixels of the sky alone have together.
  std::vector<size_t> row_of_request, row_of_pixel;
  size_t row_count = 0, sky = SIZE_MAX;
  const bool uniform_sky = sky_is_uniform(b);
  for (int y = b.y0; y < b.y1; ++y)
    for (int x = b.x0; x < b.x1; ++x) {
      const EntryBound& bound = bounds_[static_cast<size_t>(y) * film_.width() + x];
      const bool alone = uniform_sky && bound.medium >= EntryBound::kNever;
      row_of_pixel.push_back(alone && sky != SIZE_MAX ? sky : row_count);
      if (alone && sky != SIZE_MAX) continue;
      if (alone) sky = row_count;
      for (uint32_t s = start; s < start + (alone ? 1 : count); ++s) {
        requests.push_back(scene_.request(camera_, job_.seed, window_.x0 + x, window_.y0 + y, first + s, bound));
        row_of_request.push_back(row_count + s - start);
      }
      row_count += count;
    }
  if (records_)
    for (size_t i = 0; i < requests.size(); ++i) {
      PathRecord& record = records[i / count * goal + requests[i].key.sample - first];
      const Sobol sobol(requests[i].key);
      record.film = vec2(sobol.pair(0));
      record.lens = vec2(sobol.pair(1));
      record.time = static_cast<float>(requests[i].time);
      requests[i].record = &record;
    }
  const size_t row_size = film_.row_size();
  rows.resize(row_count * row_size);
  trace_paths(
      context_, requests,
      [&](size_t i, const PathSample& s) { film_.pack(s, rows.data() + row_of_request[i] * row_size); },
      report.counters);
  report.counters.paths += static_cast<uint64_t>(b.pixels()) * count - requests.size();
  if (sky != SIZE_MAX)
    for (uint32_t k = 1; k < count; ++k)
      std::copy_n(rows.data() + sky * row_size, row_size, rows.data() + (sky + k) * row_size);
  for (int pixel = 0; pixel < b.pixels(); ++pixel) {
    const float* const own = rows.data() + row_of_pixel[static_cast<size_t>(pixel)] * row_size;
    const auto rejected = film_.add(tile, pixel, own, count, first + start);
    report.invalid += rejected.size();
    if (!rejected.empty() && !report.first_invalid)
      report.first_invalid = {window_.x0 + b.x0 + pixel % b.width(), window_.y0 + b.y0 + pixel / b.width(),
                              first + start + rejected.front()};
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

uint32_t RenderSession::most_taken() const {
  uint32_t most = 0;
  for (int tile = 0; tile < film_.tile_count(); ++tile) most = std::max(most, film_.taken(tile));
  return most;
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
  total.most_samples_per_pixel = static_cast<int>(most_taken());
  total.mean_samples_per_pixel = samples_taken() / (static_cast<double>(film_.width()) * film_.height());
  total.uneven = !job_.next_round && total.most_samples_per_pixel > total.samples_per_pixel;
  if (scene_.plan().layers.statistics) total.error = film_.relative_error(scene_.scene().film.exposure, task_.threads);
  return total;
}

}  // namespace brume
