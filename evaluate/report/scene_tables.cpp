#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "evaluate/report/paper_numbers.h"
#include "evaluate/report/tables.h"

namespace brume {
namespace {

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

}  // namespace

std::string interval(const MeanInterval& m) {
  return m.count > 1 ? fmt::format("{:.3f} ± {:.3f}", m.mean, m.half_width) : fmt::format("{:.3f}", m.mean);
}

std::string error_text(const MethodResult& m, const MeanInterval& value) {
  return m.failed.empty() ? interval(value) : "failed";
}

double speed_up(const MethodResult& m, const MethodResult& plain) {
  const double equal_seconds = plain.render_seconds * std::pow(plain.whole().mean / m.whole().mean, 2);
  return m.whole().mean > 0 ? equal_seconds / (m.seconds()) : 0.0;
}

Table scene_table(const SceneResult& scene) {
  Table table{
      scene.name, scene_text(scene),
      columns(
          "#spp | method | parameters | #Lab RMS, frame | #Lab RMS, medium | #bias, medium | #render [s] | #guides [s] | #filter [ms] | #all [s] | #memory [MB] | #times faster than path tracing at equal RMS | #paper: RMS | #paper: time [s]")};
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

Table summary_table(const SceneResult& scene, const Evaluation& e) {
  std::vector<Tuning> tunings;
  for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer})
    if (std::any_of(scene.methods.begin(), scene.methods.end(),
                    [&](const MethodResult& m) { return m.tuning == tuning; }))
      tunings.push_back(tuning);
  Table table{scene.name + ", every filter", "Lab RMS of the whole frame.", columns("filter")};
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

Table ranking(const SceneResult& scene, const Evaluation& e) {
  const bool searched = std::any_of(scene.methods.begin(), scene.methods.end(),
                                    [](const MethodResult& m) { return m.tuning == Tuning::kSearched; });
  const Tuning tuning = searched ? Tuning::kSearched : Tuning::kDefault;
  const std::vector<int> counts = spp_of(scene);
  Table table{fmt::format("{}: Lab RMS of the whole frame, {} parameters, and milliseconds of filtering", scene.name,
                          tuning_name(tuning)),
              "", columns("")};
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

}  // namespace brume
