#include "evaluate/protocol/overall.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

namespace brume {
namespace {

/// Frames that differ in their seeds alone.
struct Cell {
  const SceneResult* scene;
  int spp;
};

bool is_meant(const SceneResult& scene, const MethodResult& m, std::optional<Tuning> setting) {
  return m.tuning == Tuning::kNone || (setting ? m.tuning == *setting : !scene.repeats_default(m));
}

/// A method's line in each cell; why not, where it has none.
struct Candidate {
  std::vector<const MethodResult*> lines;
  std::string missing;
};

Candidate candidate(const std::string& id, const std::vector<Cell>& cells) {
  Candidate found;
  for (const Cell& cell : cells) {
    const auto line = std::find_if(cell.scene->methods.begin(), cell.scene->methods.end(),
                                   [&](const MethodResult& m) { return m.spp == cell.spp && m.id() == id; });
    const std::string where = fmt::format("{}, {} spp", cell.scene->name, cell.spp);
    if (line == cell.scene->methods.end()) {
      found.missing = "not run on " + where;
      return found;
    }
    if (!line->failed.empty()) {
      found.missing = fmt::format("failed on {}: {}", where, line->failed);
      return found;
    }
    found.lines.push_back(&*line);
  }
  return found;
}

double mean(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

/// By seed, the mean over the cells of the metric or of its logarithm.
std::vector<double> means_by_seed(const Candidate& c, const Judgement& by, bool logarithms, size_t seeds) {
  std::vector<double> means(seeds, 0);
  for (const MethodResult* m : c.lines) {
    const std::vector<double> values = m->values(by);
    for (size_t seed = 0; seed < seeds; ++seed)
      means[seed] += (logarithms ? std::log(values[seed]) : values[seed]) / static_cast<double>(c.lines.size());
  }
  return means;
}

OverallMethod describe(const Candidate& c, const Judgement& by, bool geometric) {
  OverallMethod result;
  result.method = c.lines.front();
  std::vector<double> values, seconds;
  for (const MethodResult* m : c.lines) {
    const double value = mean(m->values(by));
    values.push_back(geometric ? std::log(value) : value);
    seconds.push_back(m->guide_seconds + m->filter_seconds);
    if (m->peak_bytes) result.most_bytes = std::max(result.most_bytes.value_or(0.0), *m->peak_bytes);
    result.reads_guides |= m->reads_guides;
  }
  result.value = geometric ? std::exp(mean(values)) : mean(values);
  result.seconds = mean(seconds);
  result.most_seconds = *std::max_element(seconds.begin(), seconds.end());
  return result;
}

}  // namespace

std::optional<Overall> overall(const Evaluation& e, const Judgement& by, std::optional<Tuning> setting) {
  const MetricInfo& metric = by.info();
  if (metric.better == Better::kZero) return std::nullopt;
  Overall result;
  std::vector<Cell> cells;
  std::vector<std::string> ids;
  std::set<int> counts;
  for (const SceneResult& scene : e.scenes) {
    if (by.region == Region::kMedium && scene.mask.empty()) continue;
    const auto is_there = [&](const MethodResult& m) { return !m.filter.empty() && is_meant(scene, m, setting); };
    if (std::none_of(scene.methods.begin(), scene.methods.end(), is_there)) continue;
    result.scenes.push_back(scene.name);
    for (const int spp : spp_of(scene)) cells.push_back({&scene, spp});
    for (const MethodResult& m : scene.methods) {
      counts.insert(m.spp);
      if (is_meant(scene, m, setting) && std::find(ids.begin(), ids.end(), m.id()) == ids.end()) ids.push_back(m.id());
    }
  }
  result.spp.assign(counts.begin(), counts.end());
  std::vector<Candidate> all;
  for (const std::string& id : ids) {
    Candidate found = candidate(id, cells);
    if (found.missing.empty())
      all.push_back(std::move(found));
    else
      result.left_out.emplace_back(id, found.missing);
  }
  if (all.empty()) return std::nullopt;

  result.seeds = SIZE_MAX;
  result.geometric = metric.better == Better::kLower;
  for (const Candidate& c : all)
    for (const MethodResult* m : c.lines) {
      const std::vector<double> values = m->values(by);
      result.seeds = std::min(result.seeds, values.size());
      for (const double v : values) result.geometric &= v > 0;
    }
  if (result.seeds == 0) return std::nullopt;

  std::vector<std::pair<OverallMethod, std::vector<double>>> ordered;
  for (const Candidate& c : all)
    ordered.emplace_back(describe(c, by, result.geometric), means_by_seed(c, by, result.geometric, result.seeds));
  std::stable_sort(ordered.begin(), ordered.end(), [&](const auto& a, const auto& b) {
    return as_error(metric, a.first.value) < as_error(metric, b.first.value);
  });
  const auto noisy = std::find_if(ordered.begin(), ordered.end(),
                                  [](const auto& entry) { return entry.first.method->filter.empty(); });
  for (size_t i = 0; i < ordered.size(); ++i) {
    OverallMethod& own = ordered[i].first;
    if (result.geometric && noisy != ordered.end()) own.times_less_than_noisy = noisy->first.value / own.value;
    std::vector<double> p_values;
    for (size_t k = i + 1; k < ordered.size(); ++k)
      p_values.push_back(paired_difference(ordered[i].second, ordered[k].second).p_value);
    const std::vector<bool> significant = holm_significant(p_values);
    for (size_t k = 0; k < significant.size(); ++k)
      if (!significant[k] && result.seeds > 1) own.level_with.push_back(i + 1 + k);
  }
  for (auto& [method, unused] : ordered) result.methods.push_back(std::move(method));
  return result;
}

}  // namespace brume
