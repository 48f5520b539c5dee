#include "evaluate/protocol/result_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <list>
#include <new>
#include <span>
#include <thread>

#include "base/error.h"
#include "base/peak_memory.h"
#include "base/text.h"
#include "evaluate/protocol/external_filter.h"
#include "filters/inputs/guide_layers.h"
#include "filters/run/clean_lights.h"
#include "image/light_layers.h"

namespace brume {
namespace {

// Of entries in the cache.
constexpr const char *kSeconds = "evaluationSeconds", *kPeak = "evaluationPeakBytes",
                     *kExchange = "evaluationExchangeSeconds";

std::string exact(double value) {
  return fmt::format("{}", value);
}

/// What exact() wrote into an entry's header.
std::optional<double> number_of(const Layers& entry, const std::string& key) {
  const std::string text = entry.text(key);
  return text.empty() ? std::nullopt : std::optional(std::stod(text));
}

/// Cancels a task when its time is up, or when the user does.
class Deadline {
 public:
  Deadline(double seconds, const Task& task) {
    if (!(seconds > 0)) {
      cancel_ = task.cancel;
      return;
    }
    cancel_ = &stop_;
    watch_ = std::thread([this, seconds, user = task.cancel] {
      const Stopwatch clock;
      std::unique_lock lock(mutex_);
      while (!done_) {
        if (user && user->load()) stop_ = true;
        if (clock.seconds() > seconds) {
          over_ = true;
          stop_ = true;
        }
        const double left = std::max(0.0, seconds - clock.seconds());
        changed_.wait_for(lock, std::chrono::duration<double>(over_ ? 0.02 : std::min(0.02, left)));
      }
    });
  }
  ~Deadline() {
    if (!watch_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      done_ = true;
    }
    changed_.notify_one();
    watch_.join();
  }
  Deadline(Deadline&&) = delete;
  const std::atomic<bool>* cancel() const { return cancel_; }
  bool over() const { return over_; }

 private:
  const std::atomic<bool>* cancel_ = nullptr;
  std::atomic<bool> stop_ = false, over_ = false;
  bool done_ = false;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::thread watch_;
};

/// What is judged of a frame or clean picture, its light groups aside.
constexpr LayerName kJudged[] = {layer::beauty, layer::direct, layer::indirect, layer::clean_direct,
                                 layer::clean_indirect};

bool is_of(std::span<const LayerName> names, const std::string& channel) {
  return std::any_of(names.begin(), names.end(), [&](const LayerName& name) {
    const auto channels = name.channel_names();
    return std::find(channels.begin(), channels.end(), channel) != channels.end();
  });
}

/// Whether it is the light of a group, noisy or clean: light.NAME.R, clean_light.NAME.R.
bool is_light_of_group(std::string_view channel) {
  const std::string clean_prefix = clean_light_layer("");
  const size_t prefix = channel.starts_with(kLightPrefix)   ? kLightPrefix.size()
                        : channel.starts_with(clean_prefix) ? clean_prefix.size()
                                                            : 0;
  return prefix > 0 && std::count(channel.begin() + static_cast<ptrdiff_t>(prefix), channel.end(), '.') == 1;
}

Layers only(const Layers& frame, const std::function<bool(const std::string&)>& wanted) {
  Layers picture = frame.without_channels();
  for (const auto& [channel, plane] : frame.channels())
    if (wanted(channel)) picture.set(channel, plane);
  return picture;
}

}  // namespace

bool no_channel(const std::string&) {
  return false;
}

bool is_judged(const std::string& channel) {
  return is_of(kJudged, channel) || is_light_of_group(channel);
}

Layers only_colours(const Layers& frame) {
  return only(frame, [](const std::string& channel) { return is_of({&layer::beauty, 1}, channel); });
}

Layers without_layers(const Layers& frame, const std::vector<std::string>& names) {
  Layers rest = frame.without_channels();
  for (const auto& [channel_name, plane] : frame.channels()) {
    const bool out = std::any_of(names.begin(), names.end(), [&, &channel = channel_name](const std::string& name) {
      return channel.starts_with(name + ".");
    });
    if (!out) rest.set(channel_name, plane);
  }
  return rest;
}

std::string guide_root() {
  return std::string(kGuidePrefix.substr(0, kGuidePrefix.size() - 1));
}

FilterSettings settings_from(const FilterEntry& filter, const std::string& text) {
  std::string assignments = text;
  std::replace(assignments.begin(), assignments.end(), ' ', ',');
  FilterSettings settings(filter);
  for (const auto& [name, value] : parse_assignments(assignments)) settings.set(name, value);
  return settings;
}

std::string ResultStore::machine() const {
  return fmt::format("machine {}, {} threads", settings_.provenance.processor, settings_.provenance.threads);
}

std::string ResultStore::frame_key(const EvaluationScene& scene, int spp, int64_t seed,
                                   const RecordedData& data) const {
  return fmt::format("frame\nscene {}\nspp {}\nseed {}\n{}\n{}", scene.hash, spp, seed, data.text(), machine());
}

TimedFrame ResultStore::frame(const EvaluationScene& scene, int spp, int64_t seed, const RecordedData& data,
                              const Task& task, const std::function<bool(const std::string&)>& wanted) const {
  if (scene.foreign) return scene.render({spp, seed, data, {}}, task);
  const std::string key = frame_key(scene, spp, seed, data);
  std::error_code ignored;
  if (!data.records || std::filesystem::exists(records(key), ignored))
    if (std::optional<Layers> found = cache_.find(key, wanted)) {
      count_found(key, work_.frames_found);
      task.report(1);
      const double seconds = number_of(*found, kSeconds).value_or(0.0);
      return {std::move(*found), seconds};
    }
  TimedFrame frame = scene.render({spp, seed, data, data.records ? records(key) : ""}, task);
  ++work_.rendered;
  known_.insert(key);
  frame.layers.header[kSeconds] = exact(frame.seconds);
  cache_.store(key, frame.layers);
  return frame;
}

double ResultStore::render_seconds(const EvaluationScene& scene, int spp, const RecordedData& data,
                                   const Task& task) const {
  if (scene.foreign) return 0;
  const std::string key = "seconds of " + frame_key(scene, spp, kFirstNoisySeed, data);
  if (const auto known = cache_.find_text(key)) return std::stod(*known);
  std::vector<double> seconds;
  do seconds.push_back(scene.render({spp, kFirstNoisySeed, data, {}}, quiet(task)).seconds);
  while (seconds.back() < 1 && seconds.size() < 3);
  ++work_.rendered;
  cache_.store_text(key, exact(median(seconds)));
  return median(seconds);
}

double ResultStore::guide_seconds(const EvaluationScene& scene, int spp, const Task& task) const {
  if (!scene.time_guides) return 0;
  const std::string key = fmt::format("guides\nscene {}\nspp {}\n{}", scene.hash, spp, machine());
  if (const auto known = cache_.find_text(key)) return std::stod(*known);
  const double seconds = scene.time_guides(spp, quiet(task));
  cache_.store_text(key, exact(seconds));
  return seconds;
}

ApplyOptions options_of(const EvaluationSettings& settings, double exposure) {
  ApplyOptions options;
  options.component = settings.component;
  options.background = settings.background;
  options.exposure = exposure;
  return options;
}

FilterRun::FilterRun(const Contender& contender, const FilterSettings& filter_, const EvaluationSettings& settings,
                     ApplyOptions options_)
    : filter(&filter_),
      options(std::move(options_)),
      time_limit(contender.time_limit > 0 ? contender.time_limit : settings.time_limit) {
  options.features = contender.features;
  if (contender.external) {
    external = &contender;
    options.outliers = Outliers::kKeep;  // what it does about them is its own affair
  } else if (!contender.guides) {
    left_out = {guide_root()};
  }
}

FilterOutcome ResultStore::filter(const FilterRun& run, NoisyFrames& frames, size_t seed, const Task& task,
                                  const std::function<bool(const std::string&)>& needs_picture) const {
  const bool records = run.filter->entry().records == FilterEntry::Records::kNeeds;
  return filter(run,
                {frames.key(seed), frames.spp(), kFirstNoisySeed + static_cast<int64_t>(seed),
                 [&]() -> const Layers& { return frames.at(seed, task).layers; },
                 records ? frames.records(seed) : std::filesystem::path()},
                task, needs_picture);
}

namespace {

/// Everything that decides what comes of a run.
std::string key_of(const FilterRun& run, const FilterInput& input) {
  return fmt::format(
      "filtered\n{} {}\nweights {}\ncomponent {}, parts {}\nbackground {}\nexposure {}\nfeatures {}\nwithout {}\ninput {}",
      run.external ? run.external->external->key : run.filter->entry().name, run.filter->text(), run.filter->weights(),
      static_cast<int>(run.options.component), run.options.keep_parts, static_cast<int>(run.options.background),
      exact(run.options.exposure), join(run.options.features, " "), join(run.left_out, " "), input.key);
}

double memory_limit_of(const FilterRun& run) {
  return run.external ? run.external->external->memory_limit : 0;
}

std::string too_long(const FilterRun& run) {
  return fmt::format("took longer than {:g} s", run.time_limit);
}

/// Which limit a result passed, be it made now or long ago under other limits; empty: none.
std::string passed_limit(const FilterRun& run, const FilterOutcome& outcome) {
  if (run.time_limit > 0 && outcome.seconds > run.time_limit) return too_long(run);
  const double limit = memory_limit_of(run), peak = outcome.peak_bytes.value_or(0.0);
  if (limit > 0 && peak > limit)
    return fmt::format("held {:.3g} GB, more than the {:.3g} GB that it may", peak / 1e9, limit / 1e9);
  return "";
}

}  // namespace

ResultStore::Cleaned ResultStore::clean(const FilterRun& run, const FilterInput& given,
                                        const std::vector<NearbyInput>& nearby, const Task& task,
                                        const Task& unlimited) {
  std::list<Layers> parts;  // of frames without what is left out
  const auto seen = [&](const Layers& whole) {
    return run.left_out.empty() ? &whole : &parts.emplace_back(without_layers(whole, run.left_out));
  };
  const Layers& input = *seen(given.frame());
  ApplyOptions options = run.options;
  if (run.filter->entry().parts) options.component = Component::kAll;
  for (const NearbyInput& other : nearby) options.sequence.push_back({other.distance, seen(*other.layers)});
  std::list<RecordReader> readers;
  Cleaned result;
  const auto apply = [&] {
    readers.clear();
    if (!given.records.empty()) options.records = &readers.emplace_back(given.records);
    for (size_t i = 0; i < nearby.size(); ++i)
      if (!nearby[i].records.empty()) options.sequence[i].records = &readers.emplace_back(nearby[i].records);
    ApplyReport report;
    if (!run.external) {
      result.picture = apply_filter(*run.filter, input, options, task, &report);
      result.seconds = report.seconds;
      return;
    }
    ExternalRun external(*run.external, given.spp, given.seed, run.time_limit);
    result.picture = apply_filter(external.settings(), input, options, task, &report);
    result.seconds = external.seconds;
    result.exchange_seconds = external.exchange_seconds;
    result.peak_bytes = external.peak_bytes;
  };
  const PeakMemory memory;
  apply();
  const std::optional<double> peak = result.peak_bytes ? result.peak_bytes : memory.growth();
  // The first run warms caches and threads, and finds its memory given back; slow filters do not notice.
  if (result.seconds < 1) apply();
  result.peak_bytes = peak;
  // Each light group by itself, in no time or memory above; where direct light stays noisy, so would they.
  if (!run.external && (run.filter->entry().parts || options.component != Component::kIndirect))
    clean_lights(*run.filter, options, input, result.picture, unlimited);
  result.picture = only(result.picture, is_judged);
  if (!run.external) return result;
  const ExternalFilter& filter = *run.external->external;
  result.picture.header["filter"] = filter.kind;
  result.picture.header["filterParameters"] = result.picture.header["filterSource"] = filter.words;
  result.picture.header["biased"] = "true: filtered by a " + filter.kind;
  return result;
}

FilterOutcome ResultStore::filter(const FilterRun& run, const FilterInput& given, const Task& task,
                                  const std::function<bool(const std::string&)>& needs_picture) const {
  FilterOutcome outcome;
  outcome.key = key_of(run, given);
  const std::string failure_key = fmt::format("{}\ntime limit {}\nmemory limit {}", outcome.key, exact(run.time_limit),
                                              exact(memory_limit_of(run)));
  const bool is_needed = !needs_picture || needs_picture(outcome.key);
  if (auto known = cache_.find(outcome.key, is_needed ? is_judged : no_channel)) {
    count_found(outcome.key, work_.results_found);
    outcome.seconds = number_of(*known, kSeconds).value_or(0.0);
    outcome.exchange_seconds = number_of(*known, kExchange);
    outcome.peak_bytes = number_of(*known, kPeak);
    outcome.failed = passed_limit(run, outcome);
    if (is_needed && outcome.failed.empty()) outcome.picture = std::move(*known);
    return outcome;
  }
  if (const auto known = cache_.find_text(failure_key)) {
    count_found(outcome.key, work_.results_found);
    outcome.failed = *known;
    return outcome;
  }
  given.frame();  // read, or rendered, before time counts
  const std::vector<NearbyInput> nearby = given.nearby ? given.nearby() : std::vector<NearbyInput>();
  ++work_.filtered;
  known_.insert(outcome.key);
  // Filters that are not brume's are held to their own seconds, in which handing over a frame is not.
  const Deadline deadline(run.external ? 0.0 : run.time_limit, task);
  Cleaned cleaned;
  const auto passes = [&](const std::string& how) {
    outcome.failed = how;
    cache_.store_text(failure_key, outcome.failed);
  };
  try {
    cleaned = clean(run, given, nearby, {task.threads, {}, deadline.cancel()}, quiet(task));
    outcome.seconds = cleaned.seconds;
  } catch (const LimitPassed& error) {
    passes(error.what());
  } catch (const InputError& error) {
    outcome.failed = error.what();
  } catch (const std::bad_alloc&) {
    outcome.failed = "not enough memory";
  } catch (const Interrupted&) {
    if (!deadline.over() || task.cancelled()) throw;
    passes(too_long(run));
  }
  if (!outcome.failed.empty()) return outcome;
  outcome.exchange_seconds = cleaned.exchange_seconds;
  outcome.peak_bytes = cleaned.peak_bytes;
  // One that was through before anyone looked has passed it all the same.
  if (const std::string how = passed_limit(run, outcome); !how.empty()) {
    passes(how);
    return outcome;
  }
  Layers& picture = cleaned.picture;
  picture.header[kSeconds] = exact(outcome.seconds);
  if (outcome.exchange_seconds) picture.header[kExchange] = exact(*outcome.exchange_seconds);
  if (outcome.peak_bytes) picture.header[kPeak] = exact(*outcome.peak_bytes);
  cache_.store(outcome.key, picture);
  outcome.picture = std::move(picture);
  return outcome;
}

Layers ResultStore::picture(const std::string& key) const {
  std::optional<Layers> found = cache_.find(key, is_judged);
  if (!found) throw InputError("a picture has gone from the cache while it was in use");
  return std::move(*found);
}

std::optional<PictureErrors> ResultStore::known_errors(const std::string& key) const {
  const std::optional<std::string> text = cache_.find_text(key);
  if (!text) return std::nullopt;
  PictureErrors errors;
  for (const std::string& line : split(*text, '\n'))
    if (const size_t colon = line.find(": "); colon != std::string::npos)
      errors[line.substr(0, colon)].push_back(errors_of(line.substr(colon + 2)));
  return errors;
}

void ResultStore::keep_errors(const std::string& key, const PictureErrors& errors) const {
  std::string text;
  for (const auto& [light, by_region] : errors)
    for (const Errors& e : by_region) text += fmt::format("{}: {}\n", light, text_of(e));
  cache_.store_text(key, text);
}

FilterSettings ResultStore::found(const std::string& key, const FilterEntry& filter,
                                  const std::function<FilterSettings()>& search) const {
  std::optional<std::string> text = cache_.find_text(key);
  if (!text) cache_.store_text(key, *(text = search().text()));
  // Always from the text, so that a search gives the same whether it was kept or made.
  return settings_from(filter, *text);
}

double NoisyFrames::seconds(size_t seed, const Task& task) const {
  if (frames_.at(seed)) return frames_[seed]->seconds;
  return store_.frame(scene_, spp_, number(seed), data_, quiet(task), no_channel).seconds;
}

Layers NoisyFrames::judged(size_t seed, const Task& task) const {
  if (frames_.at(seed)) return only(frames_[seed]->layers, is_judged);
  return store_.frame(scene_, spp_, number(seed), data_, quiet(task), is_judged).layers;
}

const TimedFrame& NoisyFrames::at(size_t seed, const Task& task) {
  std::optional<TimedFrame>& frame = frames_.at(seed);
  if (!frame) frame = store_.frame(scene_, spp_, number(seed), data_, quiet(task));
  return *frame;
}

}  // namespace brume
