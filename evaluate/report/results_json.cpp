// results.json: everything that an evaluation measured, for the page and for programs.

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "evaluate/protocol/external_filter.h"
#include "evaluate/protocol/overall.h"
#include "evaluate/protocol/speed.h"
#include "evaluate/report/paper_numbers.h"
#include "evaluate/report/report.h"

namespace brume {
namespace {

using json = nlohmann::ordered_json;

/// What `entry` makes of each.
template <class Range, class Entry>
json list_of(const Range& range, Entry entry) {
  json list = json::array();
  for (const auto& element : range) list.push_back(entry(element));
  return list;
}

json experiment_json(const EvaluationSettings& s) {
  constexpr const char *kComponents[] = {"indirect", "all", "separate"},
                       *kBackgrounds[] = {"default", "bilateral", "filter"};
  return {{"name", s.name},
          {"component", kComponents[static_cast<size_t>(s.component)]},
          {"background", kBackgrounds[static_cast<size_t>(s.background)]},
          {"reference_spp", s.reference_spp},
          {"reference_noise", s.reference_noise},
          {"searched", s.tune},
          {"time_limit", s.time_limit},
          {"contenders", list_of(s.contenders, [](const Contender& c) { return c.label; })},
          {"file", s.text}};
}

json metrics_json(const EvaluationSettings& s) {
  json list = json::array();
  for (const MetricInfo& m : all_metrics())
    if (is_reported(s, m.id))
      list.push_back({{"id", m.id},
                      {"name", m.name},
                      {"unit", m.unit},
                      {"better", better_name(m.better)},
                      {"definition", m.definition}});
  return list;
}

/// Four digits: what stands in long lists.
double rounded(double value) {
  return std::stod(fmt::format("{:.4g}", value));
}

/// The settings of a scene or evaluation by which its methods are listed: each, and all together.
constexpr std::optional<Tuning> kSettings[] = {std::nullopt, Tuning::kPaper, Tuning::kDefault, Tuning::kSearched,
                                               Tuning::kTransfer};

/// "" for all settings.
std::string setting_name(std::optional<Tuning> setting) {
  return setting ? tuning_name(*setting) : "";
}

/// Calls `add` with every region and reported metric that a scene may be judged by.
template <class Add>
void for_each_judgement(const EvaluationSettings& settings, Add add) {
  for (const Region region : kRegions)
    for (size_t metric = 0; metric < all_metrics().size(); ++metric)
      if (is_reported(settings, all_metrics()[metric].id)) add(Judgement{region, metric});
}

json judgement_json(const Judgement& by) {
  return {{"region", region_name(by.region)}, {"metric", by.info().id}};
}

/// By region and metric, where it can be told.
json reference_errors_json(const SceneResult& scene, const EvaluationSettings& settings) {
  json regions = json::object();
  for_each_judgement(settings, [&](const Judgement& by) {
    if (by.info().better == Better::kZero) return;
    if (const auto error = scene.reference_error(by)) regions[region_name(by.region)][by.info().id] = *error;
  });
  return regions;
}

json scene_json(const SceneResult& scene, const EvaluationSettings& settings) {
  return {{"name", scene.name},
          {"hash", scene.hash},
          {"exposure", scene.policy.exposure},
          {"width", scene.width},
          {"height", scene.height},
          {"medium_share", scene.medium_share},
          {"references", scene.references},
          {"reference_spp", scene.reference_spp},
          {"reference_noise", scene.reference_rms},
          {"reference_errors", reference_errors_json(scene, settings)},
          {"reference_seconds", scene.reference_seconds},
          {"colours", scene.policy.text()}};
}

/// Each method once, whatever scenes and sample counts it ran on.
json methods_json(const Evaluation& e) {
  json list = json::array();
  std::vector<std::string> known;
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods) {
      if (std::find(known.begin(), known.end(), m.id()) != known.end()) continue;
      known.push_back(m.id());
      const auto contender = std::find_if(e.settings.contenders.begin(), e.settings.contenders.end(),
                                          [&](const Contender& c) { return c.label == m.filter; });
      const bool is_filter = contender != e.settings.contenders.end();
      std::vector<std::string> features;
      if (is_filter)
        features = contender->features.empty() ? contender->settings.preferred_features() : contender->features;
      // Those of a search are another in every row.
      const bool fixed = m.tuning == Tuning::kDefault || m.tuning == Tuning::kPaper;
      const ExternalFilter* const external = is_filter ? contender->external.get() : nullptr;
      json method = {{"id", m.id()},
                     {"label", m.label()},
                     {"filter", external    ? external->kind
                                : is_filter ? contender->settings.entry().name
                                            : ""},
                     {"parameters", fixed ? m.parameters : ""},
                     {"features", features},
                     {"guides", is_filter && contender->reads_guides(contender->settings)},
                     {"setting", is_filter ? tuning_name(m.tuning) : "none"}};
      if (external) method["command"] = external->words;
      list.push_back(std::move(method));
    }
  return list;
}

json interval_json(const std::vector<double>& values) {
  const MeanInterval interval = mean_interval(values);
  return {{"mean", interval.mean}, {"half_width", interval.half_width}, {"values", values}};
}

/// @param scope  of the errors: what it lacks was not measured
json metric_values(const EvaluationSettings& settings, const std::vector<Errors>& by_seed,
                   ErrorScope scope = ErrorScope::kAll) {
  json metrics = json::object();
  if (by_seed.empty()) return metrics;
  for (size_t i = 0; i < all_metrics().size(); ++i) {
    const MetricInfo& info = all_metrics()[i];
    if (info.scope > scope || !is_reported(settings, info.id)) continue;
    metrics[info.id] = interval_json(values_of(by_seed, i));
  }
  return metrics;
}

void add_rows(json& rows, const SceneResult& scene, const EvaluationSettings& settings) {
  for (const MethodResult& m : scene.methods)
    for (const Region region : kRegions) {
      if (region == Region::kMedium && scene.mask.empty()) continue;
      json row = {
          {"scene", scene.name},
          {"spp", m.spp},
          {"method", m.id()},
          {"region", region_name(region)},
          {"parameters", m.parameters},
          {"at_the_edge", m.edges},
          {"metrics", metric_values(settings, m.errors[static_cast<size_t>(region)])},
          {"seconds", {{"render", m.render_seconds}, {"guides", m.guide_seconds}, {"filter", m.filter_seconds}}}};
      for (const auto& [light, errors] : m.lights)
        row["lights"][light] = metric_values(settings, errors[static_cast<size_t>(region)], ErrorScope::kPixels);
      if (m.exchange_seconds) row["seconds"]["exchange"] = *m.exchange_seconds;
      if (m.peak_bytes) row["peak_memory_bytes"] = *m.peak_bytes;
      if (!m.failed.empty()) row["failed"] = m.failed;
      if (const auto paper = paper_numbers(scene.name, m.filter, m.spp); paper && m.tuning <= Tuning::kPaper)
        row["paper"] = {{"rms", paper->rms}, {"seconds", paper->seconds}};
      rows.push_back(std::move(row));
    }
}

/// All pairs of some methods by one metric, and who is better when all of these are looked at together.
json pairs_of(const std::vector<const MethodResult*>& methods, Region region, size_t metric) {
  std::vector<std::vector<double>> values;
  json ids = json::array(), half_widths = json::array();
  for (const MethodResult* m : methods) {
    values.push_back(values_of(m->errors[static_cast<size_t>(region)], metric));
    ids.push_back(m->id());
  }
  std::vector<PairedDifference> differences;
  std::vector<double> p_values;
  for (size_t i = 0; i < values.size(); ++i)
    for (size_t k = i + 1; k < values.size(); ++k) {
      differences.push_back(paired_difference(values[i], values[k]));
      p_values.push_back(differences.back().p_value);
      half_widths.push_back(rounded(differences.back().difference.half_width));
    }
  const std::vector<bool> significant = holm_significant(p_values);
  const bool lower = all_metrics()[metric].better == Better::kLower;
  std::string better;
  for (size_t i = 0; i < differences.size(); ++i)
    better += !significant[i] ? '-' : (differences[i].difference.mean < 0) == lower ? 'a' : 'b';
  return {{"metric", all_metrics()[metric].id}, {"methods", ids}, {"half_width", half_widths}, {"better", better}};
}

/// The methods of one tuning against one another, the unfiltered frames among them, by every metric of which
/// differences tell something: not by a bias, of which zero is the best.
void add_pairs(json& pairs, const SceneResult& scene, const EvaluationSettings& settings) {
  for (const int spp : spp_of(scene))
    for (const Region region : kRegions)
      for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer}) {
        if (region == Region::kMedium && scene.mask.empty()) continue;
        std::vector<const MethodResult*> methods;
        for (const MethodResult& m : scene.methods)
          if (m.spp == spp && m.failed.empty() && (m.tuning == tuning || m.tuning == Tuning::kNone))
            methods.push_back(&m);
        if (methods.size() < 2) continue;
        for (size_t metric = 0; metric < all_metrics().size(); ++metric) {
          const MetricInfo& info = all_metrics()[metric];
          if (info.better == Better::kZero || !is_reported(settings, info.id)) continue;
          json group = {
              {"scene", scene.name}, {"spp", spp}, {"region", region_name(region)}, {"setting", tuning_name(tuning)}};
          group.update(pairs_of(methods, region, metric));
          pairs.push_back(std::move(group));
        }
      }
}

void add_pictures(json& pictures, const SceneResult& scene) {
  pictures.push_back(
      {{"scene", scene.name}, {"spp", 0}, {"method", "reference"}, {"file", scene.name + "_reference.exr"}});
  for (const MethodResult& m : scene.methods)
    if (m.failed.empty())
      pictures.push_back({{"scene", scene.name}, {"spp", m.spp}, {"method", m.id()}, {"file", picture_file(scene, m)}});
}

json number_or_null(const std::optional<double>& value) {
  return value ? json(rounded(*value)) : json(nullptr);
}

void add_pareto(json& list, const SceneResult& scene, const EvaluationSettings& settings) {
  for_each_judgement(settings, [&](const Judgement& by) {
    for (const std::optional<Tuning> setting : kSettings) {
      const json front = list_of(pareto_front(scene, by, setting), [](const MethodResult* m) {
        return json{{"method", m->id()}, {"spp", m->spp}};
      });
      json group = {{"scene", scene.name}, {"setting", setting_name(setting)}};
      group.update(judgement_json(by));
      group["front"] = front;
      if (!front.empty()) list.push_back(std::move(group));
    }
  });
}

/// A list for each region and metric, of each method at each error.
void add_times(json& list, const SceneResult& scene, const EvaluationSettings& settings) {
  for_each_judgement(settings, [&](const Judgement& by) {
    const json times = list_of(times_to_error(scene, by), [](const TimeToError& t) {
      return json{{"method", t.method->id()},
                  {"error", rounded(t.error)},
                  {"seconds", rounded(t.seconds)},
                  {"factor_over_path_tracing", number_or_null(t.over_path_tracing)},
                  {"factor_over_gradient_kernel", number_or_null(t.over_gradient_kernel)}};
    });
    json group = {{"scene", scene.name}};
    group.update(judgement_json(by));
    group["times"] = times;
    if (!times.empty()) list.push_back(std::move(group));
  });
}

json overall_json(const Evaluation& e) {
  json list = json::array();
  for_each_judgement(e.settings, [&](const Judgement& by) {
    for (const std::optional<Tuning> setting : kSettings) {
      const std::optional<Overall> answer = overall(e, by, setting);
      if (!answer) continue;
      const json methods = list_of(answer->methods, [&](const OverallMethod& m) {
        return json{
            {"method", m.method->id()},
            {"value", m.value},
            {"times_less_than_noisy", number_or_null(m.times_less_than_noisy)},
            {"seconds", rounded(m.seconds)},
            {"most_seconds", rounded(m.most_seconds)},
            {"most_memory_bytes", m.most_bytes ? json(*m.most_bytes) : json(nullptr)},
            {"guides", m.reads_guides},
            {"level_with", list_of(m.level_with, [&](size_t other) { return answer->methods[other].method->id(); })}};
      });
      const json left_out = list_of(answer->left_out, [](const auto& method) {
        return json{{"method", method.first}, {"why", method.second}};
      });
      json group = judgement_json(by);
      group.update({{"setting", setting_name(setting)},
                    {"scenes", answer->scenes},
                    {"spp", answer->spp},
                    {"seeds", answer->seeds},
                    {"mean", answer->geometric ? "geometric" : "arithmetic"},
                    {"methods", methods},
                    {"left_out", left_out}});
      list.push_back(std::move(group));
    }
  });
  return list;
}

/// A line of a study for each region: what it is about, then its numbers.
void add_study(json& list, const SceneResult& scene, const EvaluationSettings& settings, const MethodResult& m,
               const json& about) {
  for (const Region region : kRegions) {
    if (region == Region::kMedium && scene.mask.empty()) continue;
    json row = {{"scene", scene.name}, {"spp", m.spp}, {"method", m.id()}};
    row.update(about);
    row["region"] = region_name(region);
    row["metrics"] = metric_values(settings, m.errors[static_cast<size_t>(region)]);
    if (!m.failed.empty()) row["failed"] = m.failed;
    list.push_back(std::move(row));
  }
}

void add_ablation(json& list, const SceneResult& scene, const EvaluationSettings& settings) {
  for (const AblationResult& a : scene.ablation)
    add_study(list, scene, settings, a.result, {{"layer", a.layer}, {"how", a.alone ? "alone" : "without"}});
}

void add_sensitivity(json& list, const SceneResult& scene, const EvaluationSettings& settings) {
  for (const SensitivityResult& s : scene.sensitivity)
    add_study(list, scene, settings, s.result, {{"parameter", s.parameter}, {"value", s.value}});
}

json sequence_json(const SequenceResult& sequence) {
  json rows = json::array();
  for (const SequenceMethod& m : sequence.methods)
    for (const Region region : kRegions) {
      const SequenceMethod::Values& values = m.regions[static_cast<size_t>(region)];
      if (m.failed.empty() && values.lab_rms.empty()) continue;
      json row = {{"spp", m.spp},
                  {"label", m.filter.empty() ? "path tracing" : m.filter},
                  {"reach", m.frame_window},
                  {"region", region_name(region)},
                  {"parameters", m.parameters},
                  {"filter_seconds", m.filter_seconds}};
      if (m.failed.empty()) {
        row["lab_rms"] = interval_json(values.lab_rms);
        row["temporal_error"] = interval_json(values.temporal_error);
        row["flicker"] = interval_json(values.flicker);
      } else {
        row["failed"] = m.failed;
      }
      rows.push_back(std::move(row));
    }
  return {{"name", sequence.name},
          {"frames", sequence.frames},
          {"hashes", sequence.hashes},
          {"width", sequence.width},
          {"height", sequence.height},
          {"reference_change", {{"frame", sequence.reference_change[0]}, {"medium", sequence.reference_change[1]}}},
          {"rows", rows}};
}

}  // namespace

std::string json_report(const Evaluation& e) {
  const Provenance& made = e.settings.provenance;
  json rows = json::array(), pairs = json::array(), pictures = json::array(), pareto = json::array(),
       times = json::array(), ablation = json::array(), sensitivity = json::array();
  for (const SceneResult& scene : e.scenes) {
    add_rows(rows, scene, e.settings);
    add_pairs(pairs, scene, e.settings);
    add_pictures(pictures, scene);
    add_pareto(pareto, scene, e.settings);
    add_times(times, scene, e.settings);
    add_ablation(ablation, scene, e.settings);
    add_sensitivity(sensitivity, scene, e.settings);
  }
  json seeds = json::array();
  for (int seed = 0; seed < e.settings.seeds; ++seed) seeds.push_back(kFirstNoisySeed + seed);
  const json result = {{"brume", made.version},
                       {"commit", made.commit},
                       {"command", made.command},
                       {"machine", {{"cpu", made.processor}, {"threads", made.threads}}},
                       {"experiment", experiment_json(e.settings)},
                       {"scenes", list_of(e.scenes, [&](const SceneResult& s) { return scene_json(s, e.settings); })},
                       {"spp", e.settings.spp},
                       {"seeds", seeds},
                       {"metrics", metrics_json(e.settings)},
                       {"methods", methods_json(e)},
                       {"rows", rows},
                       {"overall", overall_json(e)},
                       {"pairs", pairs},
                       {"pareto", pareto},
                       {"time_to_error", times},
                       {"ablation", ablation},
                       {"sensitivity", sensitivity},
                       {"sequences", list_of(e.sequences, sequence_json)},
                       {"pictures", pictures}};
  return result.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

}  // namespace brume
