#include "evaluate/protocol/scene_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "base/error.h"
#include "evaluate/protocol/external_filter.h"
#include "image/light_layers.h"

namespace brume {
namespace {

bool is_reference_channel(const std::string& channel) {
  return is_judged(channel) || channel == layer::coverage.channel(0);
}

/// A light that is judged by itself, of a noisy frame or reference and of a clean picture.
struct JudgedLight {
  LayerName light, clean;
};
constexpr JudgedLight kJudgedLights[] = {{layer::direct, layer::clean_direct},
                                         {layer::indirect, layer::clean_indirect}};

/// What a contender alone asks to be recorded, guides aside: they are timed by themselves.
RecordedData own_data(const Contender& contender, EvaluationSettings settings) {
  settings.contenders = {contender};
  settings.all_layers = false;
  RecordedData data = data_to_record(settings);
  std::erase(data.layers, "guides");
  return data;
}

}  // namespace

SceneRun::SceneRun(const EvaluationScene& scene, const EvaluationSettings& settings, const ResultStore& store)
    : scene_(scene), settings_(settings), store_(store), data_(data_to_record(settings)) {
  if (scene.foreign) {
    spp_ = {scene.foreign->spp};
    seeds_ = scene.foreign->seeds;
  } else {
    spp_ = settings.spp;
    seeds_ = settings.seeds;
  }
  options_ = options_of(settings, scene.exposure);
  if (scene.foreign) options_.component = Component::kAll;
  for (const MetricInfo& m : all_metrics())
    if (m.scope == ErrorScope::kAll && is_reported(settings, m.id)) scope_ = ErrorScope::kAll;
}

void SceneRun::load_references(int spp, const Task& task) {
  const int count = scene_.foreign ? scene_.foreign->references : 2;
  references_.clear();
  for (int r = 0; r < count; ++r)
    references_.push_back(store_.frame(scene_, spp, kReferenceSeed + r, data_of_references(),
                                       share(task, r / static_cast<double>(count), (r + 1.0) / count),
                                       is_reference_channel));
  reference_spp_ = scene_.foreign ? 0 : spp;
  describe();
}

void SceneRun::render(int spp, int seed, const Task& task) {
  if (!scene_.foreign) store_.frame(scene_, spp, kFirstNoisySeed + seed, data_, task, no_channel);
}

TuningFrame SceneRun::tuning_frame(int spp, const Task& task) {
  TimedFrame frame = store_.frame(scene_, spp, kTuningSeed, data_, task);
  const std::string key = store_.frame_key(scene_, spp, kTuningSeed, data_);
  const RgbPlanes r1 = references_.front().layers.rgb(layer::beauty), r2 = second();
  return TuningFrame(std::move(frame.layers), data_.records ? store_.records(key) : std::filesystem::path(), options_,
                     LabRms(r1, &r2, result_.policy, {}), key + fmt::format("\nreferences {}", reference_spp_));
}

double SceneRun::render_seconds(NoisyFrames& frames, const Contender* contender, const Task& task) {
  if (scene_.foreign) return 0;
  RecordedData data = contender ? own_data(*contender, settings_) : data_of_references();
  const bool as_recorded = data.statistics || data.buckets || data.records || !settings_.time_layers;
  if (!as_recorded && contender) data = light_data_;
  if (!as_recorded && !(data == data_)) return store_.render_seconds(scene_, frames.spp(), data, task);
  std::vector<double> seconds;
  for (size_t seed = 0; seed < frames.count(); ++seed) seconds.push_back(frames.seconds(seed, task));
  return median(seconds);
}

MethodResult SceneRun::run(NoisyFrames& frames, const Contender* contender, const FilterSettings* filter, Tuning tuning,
                           const Task& task) {
  MethodResult m;
  m.spp = frames.spp();
  m.tuning = tuning;
  m.render_seconds = render_seconds(frames, contender, task);
  if (!contender) {
    for (size_t seed = 0; seed < frames.count(); ++seed) m.pictures.push_back(frames.key(seed));
    measure(m, frames, task);
    return m;
  }
  m.filter = contender->label;
  m.parameters = filter->text();
  if (contender->external) m.command = contender->external->words;
  if (tuning == Tuning::kSearched) m.edges = on_the_edge(*contender, *filter);
  m.reads_guides = contender->reads_guides(*filter);
  if (m.reads_guides) m.guide_seconds = store_.guide_seconds(scene_, frames.spp(), task);
  run_all(filter_run(*contender, *filter), frames, m, task);
  return m;
}

FilterRun SceneRun::filter_run(const Contender& contender, const FilterSettings& filter) const {
  FilterRun run(contender, filter, settings_, options_);
  run.options.keep_parts = true;
  return run;
}

void SceneRun::run_all(const FilterRun& run, NoisyFrames& frames, MethodResult& m, const Task& task, bool example) {
  std::vector<double> seconds, exchange;
  std::vector<std::optional<Layers>> pictures;
  for (size_t seed = 0; seed < frames.count(); ++seed) {
    FilterOutcome outcome = store_.filter(run, frames, seed, quiet(task), [&](const std::string& key) {
      return (example && seed == 0) || !store_.known_errors(errors_key(key));
    });
    if (!outcome.failed.empty()) {
      m.failed = fmt::format("seed {}: {}", kFirstNoisySeed + static_cast<int64_t>(seed), outcome.failed);
      return;
    }
    seconds.push_back(outcome.seconds);
    if (outcome.exchange_seconds) exchange.push_back(*outcome.exchange_seconds);
    m.pictures.push_back(outcome.key);
    pictures.push_back(std::move(outcome.picture));
    if (outcome.peak_bytes) m.peak_bytes = std::max(m.peak_bytes.value_or(0.0), *outcome.peak_bytes);
  }
  m.filter_seconds = median(seconds);
  if (!exchange.empty()) m.exchange_seconds = median(exchange);
  measure(m, frames, task, std::move(pictures), example);
}

void SceneRun::measure(MethodResult& m, NoisyFrames& frames, const Task& task,
                       std::vector<std::optional<Layers>> pictures, bool example) {
  m.forget_errors();
  if (!m.failed.empty()) return;
  pictures.resize(m.pictures.size());
  for (size_t seed = 0; seed < m.pictures.size(); ++seed) {
    task.check();
    const auto picture = [&]() -> const Layers& {
      if (!pictures[seed])
        pictures[seed] = m.filter.empty() ? frames.judged(seed, task) : store_.picture(m.pictures[seed]);
      return *pictures[seed];
    };
    const std::string key = errors_key(m.pictures[seed]);
    std::optional<PictureErrors> errors = store_.known_errors(key);
    if (!errors) {
      const Layers& judged = picture();
      try {
        errors = errors_of_picture(judged, m.filter.empty(), task);
      } catch (const InputError& error) {
        m.failed = fmt::format("seed {}: {}", kFirstNoisySeed + static_cast<int64_t>(seed), error.what());
        m.forget_errors();
        return;
      }
      store_.keep_errors(key, *errors);
    }
    for (const auto& [light, by_region] : *errors)
      for (size_t region = 0; region < by_region.size(); ++region)
        (light.empty() ? m.errors : m.lights[light])[region].push_back(by_region[region]);
    if (seed == 0 && example) m.example = only_colours(picture());
    pictures[seed].reset();
  }
}

void SceneRun::refine_references(const std::vector<std::unique_ptr<NoisyFrames>>& frames, const Task& task) {
  if (scene_.foreign || !(settings_.reference_noise > 0)) return;
  while (2 * reference_spp_ <= settings_.most_reference_spp) {
    double best = std::numeric_limits<double>::infinity();
    for (const MethodResult& m : result_.methods)
      if (m.failed.empty()) best = std::min(best, m.whole().mean);
    const double noise_of_mean = result_.reference_rms / std::sqrt(2.0);
    if (noise_of_mean <= settings_.reference_noise * best) return;
    load_references(2 * reference_spp_, task);
    for (MethodResult& m : result_.methods)
      for (const auto& noisy : frames)
        if (noisy->spp() == m.spp) measure(m, *noisy, task);
  }
}

void SceneRun::filter_and_measure(const std::vector<std::vector<Found>>& found, const Task& task) {
  prepare_light_data();
  std::vector<std::unique_ptr<NoisyFrames>> all;
  size_t done = 0;
  const size_t total = spp_.size() * (1 + settings_.contenders.size());
  const auto report = [&] { task.report(static_cast<double>(++done) / static_cast<double>(total)); };
  for (size_t k = 0; k < spp_.size(); ++k) {
    // Of another renderer's frames each is read again where it is needed.
    NoisyFrames& frames = *all.emplace_back(std::make_unique<NoisyFrames>(store_, scene_, spp_[k], seeds_, data_));
    const auto add = [&](const Contender* contender, const FilterSettings* filter, Tuning tuning) {
      const auto same = std::find_if(result_.methods.begin(), result_.methods.end(), [&](const MethodResult& m) {
        return contender && m.filter == contender->label && m.spp == spp_[k] && m.parameters == filter->text();
      });
      // What has been measured is not measured again.
      MethodResult m;
      if (same != result_.methods.end()) {
        m = *same;
        m.tuning = tuning;
        m.edges = tuning == Tuning::kSearched ? on_the_edge(*contender, *filter) : std::vector<std::string>();
      } else {
        m = run(frames, contender, filter, tuning, task);
      }
      result_.methods.push_back(std::move(m));
    };
    add(nullptr, nullptr, Tuning::kNone);
    report();
    for (size_t f = 0; f < settings_.contenders.size(); ++f) {
      const Contender& contender = settings_.contenders[f];
      if (contender.paper) add(&contender, &*contender.paper, Tuning::kPaper);
      add(&contender, &contender.settings, Tuning::kDefault);
      if (!found.empty()) {
        add(&contender, &found[k][f].here, Tuning::kSearched);
        if (found[k][f].elsewhere) add(&contender, &*found[k][f].elsewhere, Tuning::kTransfer);
      }
      report();
    }
    frames.forget();
  }
  refine_references(all, task);
}

void SceneRun::study(const Task& task) {
  std::vector<std::pair<int, const Contender*>> studies;
  for (const int spp : spp_)
    if (is_studied(spp))
      for (const Contender& contender : settings_.contenders)
        if (contender.study) studies.emplace_back(spp, &contender);
  std::unique_ptr<NoisyFrames> frames;
  for (size_t i = 0; i < studies.size(); ++i) {
    const auto& [spp, contender] = studies[i];
    if (!frames || frames->spp() != spp) frames = std::make_unique<NoisyFrames>(store_, scene_, spp, seeds_, data_);
    const MethodResult* best = result_.find(contender->label, Tuning::kSearched, spp);
    if (!best) best = result_.find(contender->label, Tuning::kDefault, spp);
    if (best->failed.empty()) {
      const FilterSettings settings = settings_from(contender->settings.entry(), best->parameters);
      const Task part = share(task, static_cast<double>(i) / static_cast<double>(studies.size()),
                              static_cast<double>(i + 1) / static_cast<double>(studies.size()));
      if (settings_.ablation) ablate(*contender, settings, *best, *frames, part);
      if (settings_.sensitivity) vary(*contender, settings, *best, *frames, part);
    }
    task.report(static_cast<double>(i + 1) / static_cast<double>(studies.size()));
  }
}

bool SceneRun::is_studied(int spp) const {
  if (scene_.foreign || settings_.study_spp.empty()) return spp == spp_[spp_.size() / 2];
  return std::find(settings_.study_spp.begin(), settings_.study_spp.end(), spp) != settings_.study_spp.end();
}

MethodResult SceneRun::studied(const FilterRun& run, const MethodResult& like, NoisyFrames& frames, const Task& task) {
  MethodResult m;
  m.filter = like.filter;
  m.tuning = like.tuning;
  m.spp = like.spp;
  m.parameters = run.filter->text();
  run_all(run, frames, m, task, /*example=*/false);
  return m;
}

void SceneRun::ablate(const Contender& contender, const FilterSettings& settings, const MethodResult& best,
                      NoisyFrames& frames, const Task& task) {
  const FilterRun run = filter_run(contender, settings);
  const std::vector<StudiedLayer> layers = layers_to_study(contender, settings, frames.at(0, task).layers, task);
  for (size_t i = 0; i < layers.size(); ++i) {
    result_.ablation.push_back({layers[i].label, false, studied(without_layer(run, layers, i), best, frames, task)});
    if (layers.size() > 1)
      result_.ablation.push_back(
          {layers[i].label, true, studied(with_layer_alone(run, layers, i), best, frames, task)});
  }
}

void SceneRun::vary(const Contender& contender, const FilterSettings& settings, const MethodResult& best,
                    NoisyFrames& frames, const Task& task) {
  for (const StudiedParameter& parameter : parameters_to_study(contender, settings))
    for (const auto& [value, changed] : parameter.values)
      result_.sensitivity.push_back(
          {parameter.name, value, studied(filter_run(contender, changed), best, frames, task)});
}

std::string SceneRun::errors_key(const std::string& picture_key) const {
  return fmt::format("errors\n{}\nscope {}\nexposure {}\n{} references of {} spp", picture_key,
                     static_cast<int>(scope_), result_.policy.exposure, references_.size(), reference_spp_);
}

PictureErrors SceneRun::errors_of_picture(const Layers& picture, bool noisy, const Task& task) const {
  PictureErrors errors = {{"", errors_of_layer(picture, layer::beauty, layer::beauty, scope_, task)}};
  const auto judge = [&](const LayerName& light, const LayerName& clean) {
    const LayerName& own = noisy ? light : clean;
    if (picture.has(own) && references_.front().layers.has(light))
      errors[std::string(light.name)] = errors_of_layer(picture, own, light, ErrorScope::kPixels, task);
  };
  for (const auto& [light, clean] : kJudgedLights) judge(light, clean);
  for (const std::string& group : light_groups_in(references_.front().layers)) {
    const std::string light = light_layer(group), clean = clean_light_layer(group);
    judge({light, layer::beauty.channels, ""}, {clean, layer::beauty.channels, ""});
  }
  return errors;
}

std::vector<Errors> SceneRun::errors_of_layer(const Layers& picture, const LayerName& own, const LayerName& theirs,
                                              ErrorScope scope, const Task& task) const {
  const RgbPlanes first = references_.front().layers.rgb(theirs), other = references_.back().layers.rgb(theirs);
  std::vector<Mask> masks = {{}};
  if (!result_.mask.empty()) masks.push_back(result_.mask);
  return compare_regions(picture.rgb(own), first, result_.policy, masks, references_.size() > 1 ? &other : nullptr,
                         scope, task);
}

void SceneRun::prepare_light_data() {
  const RecordedData plain = data_of_references();
  std::set<std::string> names(plain.layers.begin(), plain.layers.end());
  for (const Contender& contender : settings_.contenders) {
    const RecordedData own = own_data(contender, settings_);
    if (!own.statistics && !own.buckets && !own.records) names.insert(own.layers.begin(), own.layers.end());
  }
  light_data_.layers = {names.begin(), names.end()};
}

void SceneRun::describe() {
  const Layers& a = references_.front().layers;
  const Layers& b = references_.back().layers;
  result_.name = scene_.name;
  result_.hash = scene_.hash;
  result_.policy = {scene_.exposure, true};
  result_.width = a.width();
  result_.height = a.height();
  result_.references = static_cast<int>(references_.size());
  result_.reference_spp = reference_spp_;
  result_.reference_seconds = 0;
  for (const TimedFrame& r : references_) result_.reference_seconds += r.seconds;
  result_.reference = Layers(a.width(), a.height());
  result_.reference.header = a.header;
  for (const LayerName& l : {layer::beauty, layer::coverage})
    for (const std::string& channel : l.channel_names()) {
      if (!a.find(channel) || !b.find(channel)) continue;
      Plane mean = a.at(channel);
      const Plane& other = b.at(channel);
      for (int y = 0; y < mean.height(); ++y)
        for (int x = 0; x < mean.width(); ++x) mean(x, y) = 0.5f * (mean(x, y) + other(x, y));
      result_.reference.set(channel, std::move(mean));
    }
  result_.mask = medium_mask(result_.reference);
  result_.medium_share = 0;
  for (const uint8_t m : result_.mask) result_.medium_share += m / static_cast<double>(result_.mask.size());
  // The difference of two references carries the noise of both.
  result_.reference_rms =
      compare(a.rgb(layer::beauty), b.rgb(layer::beauty), result_.policy, {}, nullptr, ErrorScope::kPixels).lab_rms /
      std::sqrt(2.0);
  result_.reference_errors.clear();
  if (references_.size() < 2) return;
  std::vector<Mask> masks = {{}};
  if (!result_.mask.empty()) masks.push_back(result_.mask);
  result_.reference_errors = compare_regions(a.rgb(layer::beauty), result_.reference.rgb(layer::beauty), result_.policy,
                                             masks, nullptr, ErrorScope::kPixels);
}

}  // namespace brume
