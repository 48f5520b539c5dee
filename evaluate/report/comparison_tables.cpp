#include <fmt/format.h>

#include <algorithm>

#include "base/text.h"
#include "evaluate/protocol/overall.h"
#include "evaluate/protocol/speed.h"
#include "evaluate/report/tables.h"

namespace brume {
namespace {

/// Of two methods' Lab RMS over the whole frame, paired over the seeds.
MeanInterval lab_difference(const MethodResult& a, const MethodResult& b) {
  return paired_difference(a.values(Region::kFrame, &Errors::lab_rms), b.values(Region::kFrame, &Errors::lab_rms))
      .difference;
}

}  // namespace

Table winners(const Evaluation& e) {
  Table table{"Which filter wins", "The lead is paired over the seeds, with the half width of a 95 % interval.",
              columns("scene | parameters | #spp | best (Lab RMS) | second | #lead, paired over seeds")};
  for (const SceneResult& scene : e.scenes)
    for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer})
      for (const int spp : spp_of(scene)) {
        const MethodResult *first = nullptr, *second = nullptr;
        for (const MethodResult& m : scene.methods) {
          if (m.spp != spp || m.tuning != tuning || !m.failed.empty()) continue;
          if (!first || m.whole().mean < first->whole().mean) {
            second = first;
            first = &m;
          } else if (!second || m.whole().mean < second->whole().mean) {
            second = &m;
          }
        }
        if (!first || !second) continue;
        const MeanInterval d = lab_difference(*second, *first);
        table.rows.push_back({scene.name, tuning_name(tuning), fmt::format("{}", spp),
                              fmt::format("{} ({:.3f})", first->label(), first->whole().mean),
                              fmt::format("{} ({:.3f})", second->label(), second->whole().mean),
                              d.count > 1 ? fmt::format("{:.4f} ± {:.4f}{}", d.mean, d.half_width,
                                                        d.mean > d.half_width ? "" : " (not significant)")
                                          : fmt::format("{:.4f}", d.mean)});
      }
  return table;
}

Table overall_winners(const Evaluation& e) {
  Table table{
      "Best over all scenes",
      "By Lab RMS of the whole frame: geometric mean over the scenes and sample counts named. Level: what the seeds cannot tell from it, paired, 5 % after Holm. Seconds and memory are of guides and filter on a frame: the mean, and the most.",
      columns(
          "parameters | of | best | #Lab RMS | #times less than unfiltered | #mean [s] | #most [s] | #most [MB] | level with it | over")};
  for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer}) {
    const std::optional<Overall> answer = overall(e, {}, tuning);
    if (!answer) continue;
    std::vector<std::string> counts;
    for (const int spp : answer->spp) counts.push_back(fmt::format("{}", spp));
    const auto add = [&](const char* of, auto takes) {
      const auto best = std::find_if(answer->methods.begin(), answer->methods.end(), takes);
      if (best == answer->methods.end()) return;
      std::vector<std::string> level;
      for (const size_t other : best->level_with)
        if (takes(answer->methods[other])) level.push_back(answer->methods[other].method->label());
      table.rows.push_back({tuning_name(tuning), of, best->method->label(), fmt::format("{:.3f}", best->value),
                            best->times_less_than_noisy ? fmt::format("{:.1f}", *best->times_less_than_noisy) : "",
                            fmt::format("{:.3f}", best->seconds), fmt::format("{:.3f}", best->most_seconds),
                            best->most_bytes ? fmt::format("{:.0f}", *best->most_bytes / 1e6) : "",
                            answer->seeds > 1 ? join(level) : "one seed: cannot tell",
                            fmt::format("{}; {} spp", join(answer->scenes), join(counts))});
    };
    add("all methods", [](const OverallMethod&) { return true; });
    add("under half a second", [](const OverallMethod& m) { return m.most_seconds < kQuick; });
    add("without guides", [](const OverallMethod& m) { return !m.reads_guides; });
  }
  return table;
}

Table claims(const Evaluation& e) {
  Table table{
      "Does the paper's order hold?",
      "It finds its gradient-kernel filter below the bilateral and extended bilateral at every spp, close to the trilateral, at under a sixth of the trilateral's time. `paper` compares all four as published. Differences of Lab RMS are paired over seeds; below zero the gradient kernel is better.",
      columns("scene | parameters | #spp | against | #RMS difference | gradient kernel better? | #its time / theirs")};
  for (const SceneResult& scene : e.scenes)
    for (const Tuning tuning : {Tuning::kPaper, Tuning::kSearched})
      for (const int spp : spp_of(scene)) {
        const MethodResult* own = scene.find("gradient_kernel", tuning, spp);
        if (!own || !own->failed.empty()) continue;
        for (const char* rival : {"bilateral", "extended_bilateral", "trilateral"}) {
          const MethodResult* r = scene.find(rival, tuning, spp);
          if (!r || !r->failed.empty()) continue;
          const MeanInterval d = lab_difference(*own, *r);
          const char* verdict = d.count < 2              ? "one seed: cannot tell"
                                : d.mean < -d.half_width ? "yes"
                                : d.mean > d.half_width  ? "no"
                                                         : "level";
          const std::string spread = d.count > 1 ? fmt::format(" ± {:.4f}", d.half_width) : "";
          table.rows.push_back({scene.name, tuning_name(tuning), fmt::format("{}", spp), rival,
                                fmt::format("{:+.4f}{}", d.mean, spread), verdict,
                                fmt::format("{:.2f}", own->filter_seconds / r->filter_seconds)});
        }
      }
  return table;
}

Table pareto(const Evaluation& e) {
  Table table{
      "Speed against error",
      "The methods that no other beats in both time (render, guides and filter) and Lab RMS of the whole frame.",
      columns("scene | method | #spp | #seconds | #Lab RMS")};
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult* m : pareto_front(scene))
      table.rows.push_back(
          {scene.name, m->id(), fmt::format("{}", m->spp), fmt::format("{:.3f}", m->seconds()), interval(m->whole())});
  return table;
}

Table time_to_error(const Evaluation& e) {
  Table table{
      "Time to an error",
      "Seconds of render, guides and filter to a Lab RMS of the whole frame, between the neighbouring sample counts; how many times faster than path tracing, whose error falls as 1/√spp beyond what was measured, and than the gradient kernel with the same setting.",
      columns("scene | #Lab RMS | method | #seconds | #over path tracing | #over gradient_kernel")};
  const auto factor = [](const std::optional<double>& value) { return value ? fmt::format("{:.2f}", *value) : ""; };
  for (const SceneResult& scene : e.scenes)
    for (const TimeToError& t : times_to_error(scene))
      if (!scene.repeats_default(*t.method))
        table.rows.push_back({scene.name, fmt::format("{:g}", t.error), t.method->id(),
                              fmt::format("{:.3f}", t.seconds), factor(t.over_path_tracing),
                              factor(t.over_gradient_kernel)});
  return table;
}

}  // namespace brume
