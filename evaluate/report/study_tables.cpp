#include <fmt/format.h>

#include <algorithm>

#include "base/text.h"
#include "evaluate/report/tables.h"
#include "image/light_layers.h"

namespace brume {
namespace {

/// Whether a line says no more than the one of the same filter at its defaults: a filter that is not brume's is the
/// same under every setting.
bool repeats_another(const MethodResult& m) {
  return !m.command.empty() && m.tuning != Tuning::kDefault;
}

bool is_judged_in_parts(const MethodResult& m) {
  return m.lights.contains("direct") || m.lights.contains("indirect");
}

/// A line of a study: what was done to a method, its error, and how many times that of the method as it is.
std::vector<std::string> study_row(const SceneResult& scene, const MethodResult& m, const std::string& what,
                                   const std::string& how) {
  std::vector<std::string> row = {scene.name, fmt::format("{}", m.spp), m.id(), what, how};
  if (!m.failed.empty()) {
    row.insert(row.end(), {"failed: " + m.failed, ""});
    return row;
  }
  const MethodResult* whole = scene.find(m.filter, m.tuning, m.spp);
  row.insert(row.end(), {interval(m.whole()), fmt::format("{:.3f}", m.whole().mean / whole->whole().mean)});
  return row;
}

}  // namespace

Table ablation(const Evaluation& e) {
  Table table{
      "What each layer is worth",
      "Lab RMS of the whole frame with a feature or guide left out, and with that one alone; times the error of the filter with all of them.",
      columns("scene | #spp | method | layer | how | #Lab RMS | #times")};
  for (const SceneResult& scene : e.scenes)
    for (const AblationResult& a : scene.ablation)
      table.rows.push_back(study_row(scene, a.result, a.layer, a.alone ? "alone" : "without"));
  return table;
}

Table sensitivity(const Evaluation& e) {
  Table table{
      "What each parameter does",
      "Lab RMS of the whole frame with one parameter at each of its candidates, the others as they are; times the error of the filter as it is.",
      columns("scene | #spp | method | parameter | #value | #Lab RMS | #times")};
  for (const SceneResult& scene : e.scenes)
    for (const SensitivityResult& s : scene.sensitivity)
      table.rows.push_back(study_row(scene, s.result, s.parameter, s.value));
  return table;
}

Table passes(const Evaluation& e) {
  Table table{
      "Passes",
      "Lab RMS of the whole frame, of the picture and of its light groups, each cleaned by itself so that they add up to the picture: their mean, and one by one.",
      columns("scene | #spp | method | #picture | #passes | each")};
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods) {
      const std::vector<double> mean = m.passes(Region::kFrame);
      if (mean.empty()) continue;
      std::vector<std::string> each;
      for (const auto& [light, errors] : m.lights)
        if (light.starts_with(kLightPrefix))
          each.push_back(
              fmt::format("{} {:.3f}", light.substr(kLightPrefix.size()),
                          mean_interval(values_of(errors[static_cast<size_t>(Region::kFrame)], kLabRms)).mean));
      table.rows.push_back({scene.name, fmt::format("{}", m.spp), m.id(), interval(m.whole()),
                            interval(mean_interval(mean)), join(each)});
    }
  return table;
}

Table lights(const Evaluation& e) {
  Table table{
      "Direct and indirect light by themselves",
      "Lab RMS over the pixels that show the medium, or the whole frame where none do, of the light that was scattered once and of the rest, where a method cleans them apart.",
      columns("scene | #spp | method | #picture | #direct | #indirect")};
  const bool filtered = std::any_of(e.scenes.begin(), e.scenes.end(), [](const SceneResult& scene) {
    return std::any_of(scene.methods.begin(), scene.methods.end(),
                       [](const MethodResult& m) { return !m.filter.empty() && is_judged_in_parts(m); });
  });
  if (!filtered) return table;
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods) {
      if (!is_judged_in_parts(m)) continue;
      const auto region = static_cast<size_t>(scene.mask.empty() ? Region::kFrame : Region::kMedium);
      const auto light = [&](const char* name) {
        const auto found = m.lights.find(name);
        return found == m.lights.end() ? "" : interval(mean_interval(values_of(found->second[region], kLabRms)));
      };
      table.rows.push_back({scene.name, fmt::format("{}", m.spp), m.id(),
                            interval(mean_interval(values_of(m.errors[region], kLabRms))), light("direct"),
                            light("indirect")});
    }
  return table;
}

Table sequences(const Evaluation& e) {
  Table table{
      "Through time",
      "Each filter with its default parameters, alone and with as many frames on either side as it declares. Temporal error: RMS in CIE-Lab of how the picture changes from frame to frame less how the reference does; flicker: RMS of how it changes, less that of the reference.",
      columns(
          "sequence | #spp | method | #frames beside | #Lab RMS, frame | #Lab RMS, medium | #temporal error, frame | #temporal error, medium | #flicker, medium | #filter s")};
  for (const SequenceResult& sequence : e.sequences)
    for (const SequenceMethod& m : sequence.methods) {
      std::vector<std::string> row = {sequence.name, fmt::format("{}", m.spp),
                                      m.filter.empty() ? "path tracing" : m.filter, fmt::format("{}", m.frame_window)};
      const auto add = [&](const std::vector<double>& values) {
        row.push_back(!m.failed.empty() ? "failed" : values.empty() ? "" : interval(mean_interval(values)));
      };
      const auto& [frame, medium] = m.regions;
      for (const auto* values :
           {&frame.lab_rms, &medium.lab_rms, &frame.temporal_error, &medium.temporal_error, &medium.flicker})
        add(*values);
      row.push_back(m.filter.empty() || !m.failed.empty() ? "" : fmt::format("{:.3f}", m.filter_seconds));
      table.rows.push_back(std::move(row));
    }
  return table;
}

Table parameters(const Evaluation& e) {
  Table table{"Parameters",
              "Where a searched value is the first or last of its candidates, the optimum may lie further out.",
              columns("scene | #spp | filter | setting | parameters | at the edge")};
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods)
      if (!m.filter.empty() && !repeats_another(m))
        table.rows.push_back({scene.name, fmt::format("{}", m.spp), m.filter, tuning_name(m.tuning),
                              fmt::format("`{}`", m.command.empty() ? m.parameters : m.command), join(m.edges)});
  return table;
}

Table failures(const Evaluation& e) {
  Table table{"What failed, and why", "", columns("scene | #spp | filter | setting | reason")};
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods)
      if (!m.failed.empty() && !repeats_another(m))
        table.rows.push_back({scene.name, fmt::format("{}", m.spp), m.filter, tuning_name(m.tuning), m.failed});
  for (const SequenceResult& sequence : e.sequences)
    for (const SequenceMethod& m : sequence.methods)
      if (!m.failed.empty())
        table.rows.push_back(
            {sequence.name, fmt::format("{}", m.spp), m.filter, tuning_name(Tuning::kDefault), m.failed});
  return table;
}

}  // namespace brume
