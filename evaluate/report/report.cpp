#include "evaluate/report/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/output_file.h"
#include "base/text.h"
#include "evaluate/protocol/overall.h"
#include "evaluate/protocol/speed.h"
#include "evaluate/report/page.h"
#include "evaluate/report/plot.h"
#include "evaluate/report/strips.h"
#include "evaluate/report/table.h"
#include "image/exr_io.h"

namespace brume {
namespace {

struct PaperRow {
  const char* filter;
  int spp;
  PaperNumbers cloud, smoke;
};

// Table 1: RMS and runtime in seconds on a Pentium E2180 at 2 GHz, references of 2000 spp.
constexpr PaperRow kPaperTable[] = {
    {"", 16, {8.62, 0}, {8.15, 0}},
    {"bilateral", 16, {2.09, 65}, {2.23, 64}},
    {"extended_bilateral", 16, {1.78, 73}, {2.14, 76}},
    {"trilateral", 16, {1.56, 438}, {2.12, 477}},
    {"gradient_kernel", 16, {1.67, 76}, {2.06, 78}},
    {"", 36, {5.79, 0}, {5.57, 0}},
    {"bilateral", 36, {1.86, 62}, {1.859, 62}},
    {"extended_bilateral", 36, {1.54, 72}, {1.82, 75}},
    {"trilateral", 36, {1.21, 443}, {1.82, 479}},
    {"gradient_kernel", 36, {1.34, 75}, {1.67, 78}},
    {"", 64, {4.33, 0}, {4.23, 0}},
    {"bilateral", 64, {1.66, 63}, {1.74, 62}},
    {"extended_bilateral", 64, {1.33, 72}, {1.66, 76}},
    {"trilateral", 64, {1.08, 444}, {1.62, 487}},
    {"gradient_kernel", 64, {1.21, 75}, {1.47, 79}},
};

std::string interval(const MeanInterval& m) {
  return m.count > 1 ? fmt::format("{:.3f} ± {:.3f}", m.mean, m.half_width) : fmt::format("{:.3f}", m.mean);
}

std::string machine_text(const Provenance& p) {
  return fmt::format("{}, {} threads", p.processor, p.threads);
}

/// How many times longer plain path tracing would take for this method's error, its error falling as 1 / sqrt(spp).
double speed_up(const MethodResult& m, const MethodResult& plain) {
  const double equal_seconds = plain.render_seconds * std::pow(plain.whole().mean / m.whole().mean, 2);
  return m.whole().mean > 0 ? equal_seconds / (m.seconds()) : 0.0;
}

/// Standard error that the references' noise leaves in every RMS of a scene, the same for all its methods and so
/// outside their intervals: mean (e - n1)(e - n2) has variance (2 e^2 s^2 + s^4) / N.
double common_error(const SceneResult& scene, double rms) {
  const double s2 = scene.reference_rms * scene.reference_rms, n = static_cast<double>(scene.width) * scene.height;
  return std::sqrt((2 * rms * rms * s2 + s2 * s2) / n) / (2 * rms);
}

double best_rms(const SceneResult& scene) {
  double best = std::numeric_limits<double>::infinity();
  for (const MethodResult& m : scene.methods)
    if (m.failed.empty()) best = std::min(best, m.whole().mean);
  return best;
}

/// What a table was made with.
std::vector<std::pair<std::string, std::string>> origin(const Evaluation& e, const SceneResult* scene = nullptr) {
  const Provenance& p = e.settings.provenance;
  std::vector<std::string> hashes;
  for (const SceneResult& s : e.scenes)
    if (!scene || scene == &s) hashes.push_back(s.name + " " + s.hash);
  if (!scene)
    for (const SequenceResult& s : e.sequences)
      hashes.push_back(fmt::format("{} {} .. {}", s.name, s.hashes.front(), s.hashes.back()));
  const int64_t last = kFirstNoisySeed + e.settings.seeds - 1;
  return {{"brume", fmt::format("{} ({})", p.version, p.commit)},
          {"command", p.command},
          {"scenes", join(hashes)},
          {"seeds", fmt::format("{} .. {}", kFirstNoisySeed, last)},
          {"machine", machine_text(p)}};
}

std::string error_text(const MethodResult& m, const MeanInterval& value) {
  return m.failed.empty() ? interval(value) : "failed";
}

std::string scene_text(const SceneResult& scene) {
  std::string text = fmt::format("{} x {}, {:.1f} % of the pixels show the medium. ", scene.width, scene.height,
                                 100 * scene.medium_share);
  if (scene.references > 1) {
    const double best = best_rms(scene);
    text += fmt::format(
        "Two independent references{} ({:.0f} s in all), each with a Lab RMS noise of {:.3f}; their noise is taken off by multiplying the differences to the two, which leaves a standard error of {:.4f} in every RMS, common to all methods and not in the intervals. ",
        scene.reference_spp > 0 ? fmt::format(" of {} spp each", scene.reference_spp) : "", scene.reference_seconds,
        scene.reference_rms, common_error(scene, best));
    if (scene.reference_rms > 0.1 * best)
      text += fmt::format(
          "One reference's noise is {:.2f} of the best method's RMS: without the second it would decide the order. ",
          scene.reference_rms / best);
  } else {
    text += "One reference, whose noise is in every error. ";
  }
  return text + scene.policy.text() + ".";
}

Table scene_table(const SceneResult& scene) {
  Table table{scene.name,
              scene_text(scene),
              {{"spp"},
               {"method", false},
               {"parameters", false},
               {"Lab RMS, frame"},
               {"Lab RMS, medium"},
               {"bias, medium"},
               {"render [s]"},
               {"guides [s]"},
               {"filter [ms]"},
               {"all [s]"},
               {"memory [MB]"},
               {"times faster than path tracing at equal RMS"},
               {"paper: RMS"},
               {"paper: time [s]"}}};
  for (const int spp : spp_of(scene))
    for (const MethodResult& m : scene.methods) {
      if (m.spp != spp) continue;
      const auto paper = m.tuning == Tuning::kNone || m.tuning == Tuning::kPaper
                             ? paper_numbers(scene.name, m.filter, spp)
                             : std::nullopt;
      const bool plain = m.filter.empty(), ran = m.failed.empty();
      const auto times = [&]() -> std::string {
        if (plain || !ran || m.seconds() <= 0) return plain ? "1" : "";
        return fmt::format("{:.1f}", speed_up(m, *scene.find("", Tuning::kNone, spp)));
      };
      table.rows.push_back(
          {fmt::format("{}", spp), m.label(), tuning_name(m.tuning), error_text(m, m.whole()),
           scene.mask.empty() ? "" : error_text(m, m.medium()),
           ran && !scene.mask.empty()
               ? fmt::format("{:+.2f} %", 100 * m.interval(Region::kMedium, &Errors::relative_bias).mean)
               : "",
           fmt::format("{:.3f}", m.render_seconds), m.guide_seconds > 0 ? fmt::format("{:.3f}", m.guide_seconds) : "",
           plain || !ran ? "" : fmt::format("{:.1f}", 1e3 * m.filter_seconds),
           ran ? fmt::format("{:.3f}", m.seconds()) : "",
           m.peak_bytes ? fmt::format("{:.0f}", *m.peak_bytes / 1e6) : "", times(),
           paper ? fmt::format("{:.2f}", paper->rms) : "",
           paper && paper->seconds > 0 ? fmt::format("{:.0f}", paper->seconds) : ""});
    }
  return table;
}

/// One line for each filter, with every tuning's error side by side.
Table summary_table(const SceneResult& scene, const Evaluation& e) {
  std::vector<Tuning> tunings;
  for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer})
    if (std::any_of(scene.methods.begin(), scene.methods.end(),
                    [&](const MethodResult& m) { return m.tuning == tuning; }))
      tunings.push_back(tuning);
  Table table{scene.name + ", every filter", "Lab RMS of the whole frame.", {{"filter", false}}};
  for (const int spp : spp_of(scene))
    for (const Tuning tuning : tunings) table.columns.push_back({fmt::format("{} spp, {}", spp, tuning_name(tuning))});
  table.columns.push_back({"ms"});
  const auto line = [&](const std::string& filter) {
    std::vector<std::string> row = {filter.empty() ? "path tracing" : filter};
    double seconds = 0;
    for (const int spp : spp_of(scene))
      for (const Tuning tuning : tunings) {
        const MethodResult* m = scene.find(filter, filter.empty() ? Tuning::kNone : tuning, spp);
        row.push_back(m ? error_text(*m, m->whole()) : "");
        if (m && tuning == Tuning::kDefault) seconds = m->filter_seconds;
      }
    row.push_back(filter.empty() ? "" : fmt::format("{:.1f}", 1e3 * seconds));
    table.rows.push_back(std::move(row));
  };
  line("");
  for (const Contender& contender : e.settings.contenders) line(contender.label);
  return table;
}

/// One line for each filter, with its best setting, the best first: at most samples, and what failed last.
Table ranking(const SceneResult& scene, const Evaluation& e) {
  const bool searched = std::any_of(scene.methods.begin(), scene.methods.end(),
                                    [](const MethodResult& m) { return m.tuning == Tuning::kSearched; });
  const Tuning tuning = searched ? Tuning::kSearched : Tuning::kDefault;
  const std::vector<int> counts = spp_of(scene);
  Table table{fmt::format("{}: Lab RMS of the whole frame, {} parameters, and milliseconds of filtering", scene.name,
                          tuning_name(tuning)),
              "",
              {{"", false}}};
  for (const int spp : counts) table.columns.push_back({fmt::format("{} spp", spp)});
  table.columns.push_back({"ms"});
  std::vector<std::pair<double, std::vector<std::string>>> lines;
  const auto add = [&](const std::string& filter) {
    const auto found = [&](int spp) { return scene.find(filter, filter.empty() ? Tuning::kNone : tuning, spp); };
    const MethodResult* last = found(counts.back());
    if (!last) return;
    std::vector<std::string> line = {last->label()};
    for (const int spp : counts) line.push_back(error_text(*found(spp), found(spp)->whole()));
    line.push_back(filter.empty() || !last->failed.empty() ? "" : fmt::format("{:.1f}", 1e3 * last->filter_seconds));
    lines.emplace_back(last->failed.empty() ? last->whole().mean : std::numeric_limits<double>::infinity(),
                       std::move(line));
  };
  add("");
  for (const Contender& contender : e.settings.contenders) add(contender.label);
  std::stable_sort(lines.begin(), lines.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (auto& [error, line] : lines) table.rows.push_back(std::move(line));
  return table;
}

/// Of two methods' Lab RMS over the whole frame, paired over the seeds.
MeanInterval lab_difference(const MethodResult& a, const MethodResult& b) {
  return paired_difference(a.values(Region::kFrame, &Errors::lab_rms), b.values(Region::kFrame, &Errors::lab_rms))
      .difference;
}

/// The winner of each spp, and whether it leads the second by more than the noise of the seeds.
Table winners(const Evaluation& e) {
  Table table{"Which filter wins",
              "The lead is paired over the seeds, with the half width of a 95 % interval.",
              {{"scene", false},
               {"parameters", false},
               {"spp"},
               {"best (Lab RMS)", false},
               {"second", false},
               {"lead, paired over seeds"}}};
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

/// The best method over everything, of each setting: of all, of those that clean a frame in under half a second, and of
/// those that need no guides.
Table overall_winners(const Evaluation& e) {
  Table table{
      "Best over all scenes",
      "By Lab RMS of the whole frame: geometric mean over the scenes and sample counts named. Level: what the seeds cannot tell from it, paired, 5 % after Holm. Seconds and memory are of guides and filter on a frame: the mean, and the most.",
      {{"parameters", false},
       {"of", false},
       {"best", false},
       {"Lab RMS"},
       {"times less than unfiltered"},
       {"mean [s]"},
       {"most [s]"},
       {"most [MB]"},
       {"level with it", false},
       {"over", false}}};
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

/// The paper's claims about its own filter, one by one.
Table claims(const Evaluation& e) {
  Table table{
      "Does the paper's order hold?",
      "It finds its gradient-kernel filter below the bilateral and extended bilateral at every spp, close to the trilateral, at under a sixth of the trilateral's time. `paper` compares all four as published. Differences of Lab RMS are paired over seeds; below zero the gradient kernel is better.",
      {{"scene", false},
       {"parameters", false},
       {"spp"},
       {"against", false},
       {"RMS difference"},
       {"gradient kernel better?", false},
       {"its time / theirs"}}};
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

/// Whether a line says no more than the one of the same filter at its defaults: a filter that is not brume's is the
/// same under every setting.
bool repeats_another(const MethodResult& m) {
  return !m.command.empty() && m.tuning != Tuning::kDefault;
}

Table parameters(const Evaluation& e) {
  Table table{"Parameters",
              "Where a searched value is the first or last of its candidates, the optimum may lie further out.",
              {{"scene", false},
               {"spp"},
               {"filter", false},
               {"setting", false},
               {"parameters", false},
               {"at the edge", false}}};
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods)
      if (!m.filter.empty() && !repeats_another(m))
        table.rows.push_back({scene.name, fmt::format("{}", m.spp), m.filter, tuning_name(m.tuning),
                              fmt::format("`{}`", m.command.empty() ? m.parameters : m.command), join(m.edges)});
  return table;
}

Table failures(const Evaluation& e) {
  Table table{"What failed, and why",
              "",
              {{"scene", false}, {"spp"}, {"filter", false}, {"setting", false}, {"reason", false}}};
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

Table pareto(const Evaluation& e) {
  Table table{
      "Speed against error",
      "The methods that no other beats in both time (render, guides and filter) and Lab RMS of the whole frame.",
      {{"scene", false}, {"method", false}, {"spp"}, {"seconds"}, {"Lab RMS"}}};
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
      {{"scene", false}, {"Lab RMS"}, {"method", false}, {"seconds"}, {"over path tracing"}, {"over gradient_kernel"}}};
  const auto factor = [](const std::optional<double>& value) { return value ? fmt::format("{:.2f}", *value) : ""; };
  for (const SceneResult& scene : e.scenes)
    for (const TimeToError& t : times_to_error(scene))
      if (!scene.repeats_default(*t.method))
        table.rows.push_back({scene.name, fmt::format("{:g}", t.error), t.method->id(),
                              fmt::format("{:.3f}", t.seconds), factor(t.over_path_tracing),
                              factor(t.over_gradient_kernel)});
  return table;
}

Table sequences(const Evaluation& e) {
  Table table{
      "Through time",
      "Each filter with its default parameters, alone and with as many frames on either side as it declares. Temporal error: RMS in CIE-Lab of how the picture changes from frame to frame less how the reference does; flicker: RMS of how it changes, less that of the reference.",
      {{"sequence", false},
       {"spp"},
       {"method", false},
       {"frames beside"},
       {"Lab RMS, frame"},
       {"Lab RMS, medium"},
       {"temporal error, frame"},
       {"temporal error, medium"},
       {"flicker, medium"},
       {"filter s"}}};
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

/// A study's error, and how many times that of the method as it is.
std::vector<std::string> study_cells(const SceneResult& scene, const MethodResult& m) {
  const MethodResult* whole = scene.find(m.filter, m.tuning, m.spp);
  if (!m.failed.empty()) return {"failed: " + m.failed, ""};
  return {interval(m.whole()), fmt::format("{:.3f}", m.whole().mean / whole->whole().mean)};
}

Table ablation(const Evaluation& e) {
  Table table{
      "What each layer is worth",
      "Lab RMS of the whole frame with a feature or guide left out, and with that one alone; times the error of the filter with all of them.",
      {{"scene", false}, {"spp"}, {"method", false}, {"layer", false}, {"how", false}, {"Lab RMS"}, {"times"}}};
  for (const SceneResult& scene : e.scenes)
    for (const AblationResult& a : scene.ablation) {
      std::vector<std::string> row = {scene.name, fmt::format("{}", a.result.spp), a.result.id(), a.layer,
                                      a.alone ? "alone" : "without"};
      for (std::string& cell : study_cells(scene, a.result)) row.push_back(std::move(cell));
      table.rows.push_back(std::move(row));
    }
  return table;
}

Table sensitivity(const Evaluation& e) {
  Table table{
      "What each parameter does",
      "Lab RMS of the whole frame with one parameter at each of its candidates, the others as they are; times the error of the filter as it is.",
      {{"scene", false}, {"spp"}, {"method", false}, {"parameter", false}, {"value"}, {"Lab RMS"}, {"times"}}};
  for (const SceneResult& scene : e.scenes)
    for (const SensitivityResult& s : scene.sensitivity) {
      std::vector<std::string> row = {scene.name, fmt::format("{}", s.result.spp), s.result.id(), s.parameter, s.value};
      for (std::string& cell : study_cells(scene, s.result)) row.push_back(std::move(cell));
      table.rows.push_back(std::move(row));
    }
  return table;
}

/// Direct and indirect light by themselves, where they are cleaned so.
Table lights(const Evaluation& e) {
  Table table{
      "Direct and indirect light by themselves",
      "Lab RMS over the pixels that show the medium, or the whole frame where none do, of the light that was scattered once and of the rest, where a method cleans them apart.",
      {{"scene", false}, {"spp"}, {"method", false}, {"picture"}, {"direct"}, {"indirect"}}};
  const bool filtered = std::any_of(e.scenes.begin(), e.scenes.end(), [](const SceneResult& scene) {
    return std::any_of(scene.methods.begin(), scene.methods.end(),
                       [](const MethodResult& m) { return !m.filter.empty() && !m.lights.empty(); });
  });
  if (!filtered) return table;
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods) {
      if (m.lights.empty()) continue;
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

/// The tables of the report, in its order.
std::vector<Table> report_tables(const Evaluation& e) {
  std::vector<Table> tables;
  if (Table best = overall_winners(e); !best.rows.empty()) tables.push_back(std::move(best));
  for (const SceneResult& scene : e.scenes) tables.push_back(summary_table(scene, e));
  for (const SceneResult& scene : e.scenes) tables.push_back(scene_table(scene));
  for (Table& table : std::vector<Table>{winners(e), claims(e), lights(e), sequences(e), pareto(e), time_to_error(e),
                                         ablation(e), sensitivity(e), parameters(e), failures(e)})
    if (!table.rows.empty()) tables.push_back(std::move(table));
  return tables;
}

}  // namespace

std::optional<PaperNumbers> paper_numbers(const std::string& scene, const std::string& filter, int spp) {
  for (const PaperRow& row : kPaperTable)
    if (row.spp == spp && filter == row.filter) {
      if (scene == "cloud") return row.cloud;
      if (scene == "smoke") return row.smoke;
    }
  return std::nullopt;
}

std::string short_report(const Evaluation& e) {
  std::string text;
  for (const SceneResult& scene : e.scenes) text += ranking(scene, e).text() + "\n";
  for (const Table& table : {sequences(e), failures(e)})
    if (!table.rows.empty()) text += table.text() + "\n";
  for (const std::string& remark : {remark_on_parts(e.settings), remark_on_others(e.settings)})
    if (!remark.empty()) text += remark + ".\n\n";
  return text;
}

std::string markdown_report(const Evaluation& e) {
  std::string text = fmt::format(
      "# Filters on media passes\n\n"
      "The protocol of Table 1 of Xu et al. 2011: each filter cleans the {} of path-traced frames and is judged by the RMS in CIE-Lab (their equation 3). `paper` parameters are the filter's preset of that name, as published (the trilateral's sigma_R, which no source gives, is 10); `default` are ours; `searched` are found by a search on a separate noisy frame of the same scene and spp, one parameter after another from the better of both; `transfer` by the same search on the other scenes. Pixels without coverage {}. Errors are means over {} seeds with the half width of a 95 % interval. Times were taken on {}; the paper's on a 2 GHz Pentium E2180, and its scenes are not these, so its numbers stand beside ours for the order, not for the size. `Times faster` is the time plain path tracing would need for the same RMS, its error taken to fall as 1/√spp from the same spp, over render + filter time; methods that read no statistics are charged for a render without them, and those that read guides for these.\n",
      e.settings.component == Component::kIndirect   ? "indirect component"
      : e.settings.component == Component::kSeparate ? "direct and indirect component, apart,"
                                                     : "whole picture",
      e.settings.background == BackgroundRule::kBilateral ? "get the bilateral filter, as there"
                                                          : "are filtered like the rest",
      e.settings.seeds, machine_text(e.settings.provenance));
  for (const std::string& remark : {remark_on_parts(e.settings), remark_on_others(e.settings)})
    if (!remark.empty()) text += fmt::format("\n{}.\n", remark);
  for (const Table& table : report_tables(e)) {
    text += fmt::format("\n## {}\n\n{}{}", table.title, table.caption.empty() ? "" : table.caption + "\n\n",
                        table.markdown_grid());
  }
  if (!e.scenes.empty()) text += "\n## Pictures\n\n";
  for (const SceneResult& scene : e.scenes) {
    text += fmt::format("![{0}: error against seconds]({0}_error_seconds.svg)\n\n", scene.name);
    for (const int spp : spp_of(scene))
      text += fmt::format("![{0}, {1} spp]({0}_{1}spp_{2}.png)\n\n", scene.name, spp,
                          tuning_name(e.settings.tune ? Tuning::kSearched : Tuning::kDefault));
  }
  text += "## Made with\n\n";
  for (const auto& [key, value] : origin(e)) text += fmt::format("- {}: `{}`\n", key, value);
  return text;
}

std::string csv_report(const Evaluation& e) {
  Table table{"", ""};
  for (const char* title : {"scene",
                            "spp",
                            "method",
                            "tuning",
                            "lab_rms",
                            "lab_rms_ci95",
                            "lab_rms_medium",
                            "lab_rms_medium_ci95",
                            "rel_mse_medium",
                            "bias_medium",
                            "render_seconds",
                            "guide_seconds",
                            "filter_seconds",
                            "peak_memory_bytes",
                            "speed_up_equal_rms",
                            "paper_rms",
                            "paper_seconds",
                            "parameters",
                            "failed",
                            "scene_hash"})
    table.columns.push_back({title});
  table.origin = origin(e);
  const auto number = [](double value) { return fmt::format("{:.6g}", value); };
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods) {
      const auto paper = paper_numbers(scene.name, m.filter, m.spp);
      const auto measured = [&](double value) { return m.failed.empty() ? number(value) : ""; };
      const auto medium = [&](double value) { return scene.mask.empty() ? "" : measured(value); };
      table.rows.push_back({scene.name,
                            fmt::format("{}", m.spp),
                            m.label(),
                            tuning_name(m.tuning),
                            measured(m.whole().mean),
                            measured(m.whole().half_width),
                            medium(m.medium().mean),
                            medium(m.medium().half_width),
                            medium(m.interval(Region::kMedium, &Errors::rel_mse).mean),
                            medium(m.interval(Region::kMedium, &Errors::relative_bias).mean),
                            number(m.render_seconds),
                            number(m.guide_seconds),
                            measured(m.filter_seconds),
                            m.peak_bytes ? number(*m.peak_bytes) : "",
                            m.failed.empty() ? number(speed_up(m, *scene.find("", Tuning::kNone, m.spp))) : "",
                            paper ? number(paper->rms) : "",
                            paper && paper->seconds > 0 ? number(paper->seconds) : "",
                            m.command.empty() ? m.parameters : m.command,
                            m.failed,
                            scene.hash});
    }
  return table.csv();
}

std::string picture_file(const SceneResult& scene, const MethodResult& m) {
  return fmt::format("{}_{}spp_{}.exr", scene.name, m.spp, m.id());
}

/// A picture with what it was made with in its header.
Layers stamped(Layers picture, const Evaluation& e, const SceneResult& scene) {
  for (const char* own : {"evaluationSeconds", "evaluationPeakBytes", "evaluationExchangeSeconds"})
    picture.header.erase(own);
  const Provenance& p = e.settings.provenance;
  picture.header["version"] = p.version;
  picture.header["commit"] = p.commit;
  picture.header["evaluateCommand"] = p.command;
  picture.header["machine"] = machine_text(p);
  picture.header["sceneHash"] = scene.hash;
  return picture;
}

void write_report(const Evaluation& e, const std::filesystem::path& folder) {
  write_text(folder / "table.md", markdown_report(e));
  write_text(folder / "table.csv", csv_report(e));
  write_text(folder / "results.json", json_report(e));
  if (page_is_built_in() && !e.scenes.empty()) write_text(folder / "index.html", results_page(e));
  for (const SceneResult& scene : e.scenes) {
    write_text(folder / fmt::format("{}_error_seconds.svg", scene.name), error_seconds_plot(scene, origin(e, &scene)));
    write_exr(folder / fmt::format("{}_reference.exr", scene.name), stamped(scene.reference, e, scene));
    for (const int spp : spp_of(scene))
      for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer}) {
        if (const auto strip = comparison_strip(scene, spp, tuning))
          write_png(folder / fmt::format("{}_{}spp_{}.png", scene.name, spp, tuning_name(tuning)), *strip);
      }
    for (const MethodResult& m : scene.methods)
      if (m.failed.empty()) write_exr(folder / picture_file(scene, m), stamped(m.example, e, scene));
  }
}

}  // namespace brume
