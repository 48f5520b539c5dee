#include "evaluate/protocol.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>
#include <set>
#include <thread>

#include "filters/guide_layers.h"
#include "filters/requirements.h"

namespace brume {
namespace {

// Seeds: two references, one frame to tune on, then the frames that are reported. None is shared.
constexpr int64_t kReferenceSeed = 1000001, kTuningSeed = 2000001, kNoisySeed = 1;

/// One scene's frames while the protocol runs.
struct Frames {
  TimedFrame reference[2];
  std::vector<TimedFrame> tuning;              // by spp
  std::vector<std::vector<TimedFrame>> noisy;  // by spp, seed
};

/// What the search found for a contender at one spp of one scene.
struct Found {
  FilterSettings here;                      // on this scene's frame
  std::optional<FilterSettings> elsewhere;  // on the other scenes' frames, where there are any
};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const size_t n = values.size();
  return n % 2 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

/// Runs `filter` (null: none) over a scene's noisy frames of one spp and measures.
MethodResult measure(const std::vector<TimedFrame>& noisy, const FilterSettings* filter, const ApplyOptions& options,
                     const SceneResult& scene, const Frames& frames, const Task& task) {
  MethodResult result;
  std::vector<double> whole, medium, rel, bias, filter_seconds, render_seconds;
  const RgbPlanes r1 = frames.reference[0].layers.rgb(layer::beauty),
                  r2 = frames.reference[1].layers.rgb(layer::beauty);
  for (size_t seed = 0; seed < noisy.size(); ++seed) {
    Layers clean;
    if (filter) {
      ApplyReport report;
      std::optional<RecordReader> records;
      ApplyOptions own = options;
      if (filter->entry().parts) own.component = Component::kAll;
      if (!noisy[seed].records.empty()) own.records = &records.emplace(noisy[seed].records);
      // The first run warms caches and threads; slow filters do not notice.
      clean = apply_filter(*filter, noisy[seed].layers, own, task, &report);
      if (seed == 0 && report.seconds < 1) clean = apply_filter(*filter, noisy[seed].layers, own, task, &report);
      filter_seconds.push_back(report.seconds);
    } else {
      clean = noisy[seed].layers;
    }
    const RgbPlanes x = clean.rgb(layer::beauty);
    const Errors all = compare(x, r1, scene.policy, {}, &r2), inside = compare(x, r1, scene.policy, scene.mask, &r2);
    whole.push_back(all.lab_rms);
    medium.push_back(inside.lab_rms);
    rel.push_back(inside.rel_mse);
    bias.push_back(inside.relative_bias);
    render_seconds.push_back(noisy[seed].seconds);
    if (seed == 0) {
      result.example = Layers(clean.width(), clean.height());
      result.example.header = clean.header;
      for (size_t c = 0; c < 3; ++c) result.example.set(layer::beauty.channel(c), *x[c]);
    }
  }
  result.whole = mean_interval(whole);
  result.medium = mean_interval(medium);
  result.rel_mse_medium = mean_interval(rel);
  result.relative_bias = mean_interval(bias).mean;
  result.render_seconds = median(render_seconds);
  result.filter_seconds = filter ? median(filter_seconds) : 0.0;
  result.whole_by_seed = whole;
  if (filter) result.parameters = filter->text();
  return result;
}

SceneResult describe_scene(const EvaluationScene& scene, const EvaluationSettings& settings, const Frames& frames) {
  const Layers &a = frames.reference[0].layers, &b = frames.reference[1].layers;
  SceneResult result;
  result.name = scene.name;
  result.policy = {scene.exposure, true};
  result.width = a.width();
  result.height = a.height();
  result.reference_spp = settings.reference_spp;
  result.reference_seconds = frames.reference[0].seconds + frames.reference[1].seconds;
  result.reference = Layers(a.width(), a.height());
  for (const LayerName& l : {layer::beauty, layer::coverage})
    for (size_t c = 0; c < l.channels.size(); ++c) {
      Plane mean = a.at(l.channel(c));
      const Plane& other = b.at(l.channel(c));
      for (int y = 0; y < mean.height(); ++y)
        for (int x = 0; x < mean.width(); ++x) mean(x, y) = 0.5f * (mean(x, y) + other(x, y));
      result.reference.set(l.channel(c), std::move(mean));
    }
  result.mask = medium_mask(result.reference);
  for (const uint8_t m : result.mask) result.medium_share += m / static_cast<double>(result.mask.size());
  // The difference of two references carries the noise of both.
  result.reference_rms = compare(a.rgb(layer::beauty), b.rgb(layer::beauty), result.policy).lab_rms / std::sqrt(2.0);
  return result;
}

}  // namespace

const char* tuning_name(Tuning tuning) {
  switch (tuning) {
    case Tuning::kPaper:
      return "paper";
    case Tuning::kDefault:
      return "default";
    case Tuning::kSearched:
      return "searched";
    case Tuning::kTransfer:
      return "transfer";
    default:
      return "-";
  }
}

const MethodResult* SceneResult::find(const std::string& filter, Tuning tuning, int spp) const {
  for (const MethodResult& m : methods)
    if (m.filter == filter && m.tuning == tuning && m.spp == spp) return &m;
  return nullptr;
}

/// Whether any of the settings that will run reads features.
bool reads_features(const Contender& contender, bool tune) {
  if (contender.settings.uses_features() || (contender.paper && contender.paper->uses_features())) return true;
  if (!tune) return false;
  const std::vector<FilterSettings> all = candidate_settings(contender);
  return std::any_of(all.begin(), all.end(), [](const FilterSettings& s) { return s.uses_features(); });
}

/// Whether any of them prefers features that are made from guides.
bool prefers_guides(const Contender& contender, bool tune) {
  const auto prefers = [](const FilterSettings& s) {
    const std::vector<std::string> names = s.preferred_features();
    return s.uses_features() && std::any_of(names.begin(), names.end(), FeaturePlan::is_of_guides);
  };
  if (prefers(contender.settings)) return true;
  if (!tune) return false;
  const std::vector<FilterSettings> all = candidate_settings(contender);
  return std::any_of(all.begin(), all.end(), prefers);
}

RecordedData data_to_record(const EvaluationSettings& settings) {
  std::set<std::string> names = {"coverage"};  // the mask of medium pixels
  RecordedData data;
  for (const Contender& contender : settings.contenders) {
    const FilterEntry& filter = contender.settings.entry();
    std::vector<LayerName> layers = required_layers(filter, {settings.component, settings.background});
    if (filter.parts) layers.insert(layers.end(), {layer::direct, layer::indirect});
    layers.insert(layers.end(), filter.can_use.begin(), filter.can_use.end());
    const bool features = reads_features(contender, settings.tune);
    if (features) layers.insert(layers.end(), FeaturePlan::sources().begin(), FeaturePlan::sources().end());
    for (const LayerName& l : layers)
      if (!l.name.empty() && !is_guide(l.name)) names.insert(std::string(l.name));
    if (filter.guides || prefers_guides(contender, settings.tune)) names.insert("guides");
    data.statistics |= filter.can_use_statistics >= Statistics::kVariance || features || filter.variances;
    data.buckets |= filter.can_use_statistics >= Statistics::kBuckets;
    data.records |= filter.records == FilterEntry::Records::kNeeds;
  }
  data.layers = {names.begin(), names.end()};
  return data;
}

size_t stage_count(const EvaluationSettings& settings, size_t scenes) {
  const size_t spp = settings.spp.size(), tune = settings.tune ? 1 : 0;
  const size_t frames = 2 + spp * (tune + static_cast<size_t>(settings.seeds));
  return scenes * (frames + tune * spp * settings.contenders.size() + 1);
}

std::string machine_name() {
  std::ifstream info("/proc/cpuinfo");
  std::string processor = "unknown processor";
  for (std::string line; std::getline(info, line);)
    if (line.starts_with("model name")) {
      processor = line.substr(line.find(':') + 2);
      break;
    }
  return fmt::format("{}, {} threads", processor, std::thread::hardware_concurrency());
}

Evaluation evaluate(const std::vector<EvaluationScene>& scenes, const EvaluationSettings& settings,
                    const std::function<Task(const std::string&)>& stage) {
  Evaluation result{settings, {}, machine_name()};
  std::vector<Frames> all(scenes.size());
  for (size_t s = 0; s < scenes.size(); ++s) {
    const EvaluationScene& scene = scenes[s];
    Frames& frames = all[s];
    const auto record_file = [&](int64_t seed, int spp) {
      return settings.records.empty() ? std::filesystem::path()
                                      : settings.records / fmt::format("{}.{}.{}.records", scene.name, spp, seed);
    };
    for (int r = 0; r < 2; ++r)
      frames.reference[r] = scene.render_reference(settings.reference_spp, kReferenceSeed + r,
                                                   stage(fmt::format("{}: reference {} of 2", scene.name, r + 1)));
    for (const int spp : settings.spp) {
      if (settings.tune)
        frames.tuning.push_back(scene.render(spp, kTuningSeed, record_file(kTuningSeed, spp),
                                             stage(fmt::format("{}: {} spp to tune on", scene.name, spp))));
      auto& noisy = frames.noisy.emplace_back();
      for (int seed = 0; seed < settings.seeds; ++seed)
        noisy.push_back(
            scene.render(spp, kNoisySeed + seed, record_file(kNoisySeed + seed, spp),
                         stage(fmt::format("{}: {} spp, seed {} of {}", scene.name, spp, seed + 1, settings.seeds))));
    }
    result.scenes.push_back(describe_scene(scene, settings, frames));
  }

  const auto options = [&](size_t s) {
    return ApplyOptions{settings.component, settings.background, scenes[s].exposure};
  };
  std::vector<std::vector<TuningFrame>> tuning_frames(scenes.size());  // by scene, spp
  if (settings.tune)
    for (size_t s = 0; s < scenes.size(); ++s) {
      const RgbPlanes r1 = all[s].reference[0].layers.rgb(layer::beauty),
                      r2 = all[s].reference[1].layers.rgb(layer::beauty);
      const LabRms metric(r1, &r2, result.scenes[s].policy, {});
      for (const TimedFrame& noisy : all[s].tuning)
        tuning_frames[s].emplace_back(noisy.layers, noisy.records, options(s), metric);
    }
  const auto find = [&](size_t s, size_t k, const Contender& contender) {
    const Task task = stage(fmt::format("{}: tune {}, {} spp", scenes[s].name, contender.label, settings.spp[k]));
    std::vector<TuningFrame*> others;
    for (size_t o = 0; o < scenes.size(); ++o)
      if (o != s) others.push_back(&tuning_frames[o][k]);
    Found found{search(contender, {&tuning_frames[s][k]}, share(task, 0, others.empty() ? 1 : 0.5)), {}};
    if (!others.empty()) found.elsewhere = search(contender, others, share(task, 0.5, 1));
    return found;
  };
  std::vector<std::vector<std::vector<Found>>> found(scenes.size());  // by scene, spp, contender
  if (settings.tune)
    for (size_t s = 0; s < scenes.size(); ++s)
      for (size_t k = 0; k < settings.spp.size(); ++k) {
        std::vector<Found>& list = found[s].emplace_back();
        for (const Contender& contender : settings.contenders) list.push_back(find(s, k, contender));
      }

  for (size_t s = 0; s < scenes.size(); ++s) {
    SceneResult& scene = result.scenes[s];
    const Task task = stage(fmt::format("{}: filter and measure", scene.name));
    size_t done = 0;
    const size_t total = settings.spp.size() * (1 + settings.contenders.size());
    for (size_t k = 0; k < settings.spp.size(); ++k) {
      const auto add = [&](const Contender* contender, const FilterSettings* filter, Tuning tuning) {
        const auto same = std::find_if(scene.methods.begin(), scene.methods.end(), [&](const MethodResult& m) {
          return contender && m.filter == contender->label && m.spp == settings.spp[k] &&
                 m.parameters == filter->text();
        });
        // What has been measured is not measured again.
        MethodResult m = same != scene.methods.end()
                             ? *same
                             : measure(all[s].noisy[k], filter, options(s), scene, all[s], quiet(task));
        m.spp = settings.spp[k];
        m.tuning = tuning;
        m.edges.clear();
        if (contender) m.filter = contender->label;
        if (tuning == Tuning::kSearched) m.edges = on_the_edge(*contender, *filter);
        scene.methods.push_back(std::move(m));
      };
      add(nullptr, nullptr, Tuning::kNone);
      task.report(static_cast<double>(++done) / static_cast<double>(total));
      for (size_t f = 0; f < settings.contenders.size(); ++f) {
        const Contender& contender = settings.contenders[f];
        if (contender.paper) add(&contender, &*contender.paper, Tuning::kPaper);
        add(&contender, &contender.settings, Tuning::kDefault);
        if (settings.tune) {
          add(&contender, &found[s][k][f].here, Tuning::kSearched);
          if (found[s][k][f].elsewhere) add(&contender, &*found[s][k][f].elsewhere, Tuning::kTransfer);
        }
        task.report(static_cast<double>(++done) / static_cast<double>(total));
      }
    }
  }
  return result;
}

}  // namespace brume
