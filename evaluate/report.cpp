#include "evaluate/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/output_file.h"
#include "base/text.h"
#include "evaluate/plot.h"
#include "evaluate/strips.h"
#include "image/exr_io.h"

namespace brume {
namespace {

using nlohmann::json;

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

/// How many times longer plain path tracing would take for this method's error, its error falling as 1 / sqrt(spp).
double speed_up(const MethodResult& m, const MethodResult& plain) {
  const double equal_seconds = plain.render_seconds * std::pow(plain.whole.mean / m.whole.mean, 2);
  return m.whole.mean > 0 ? equal_seconds / (m.render_seconds + m.filter_seconds) : 0.0;
}

/// File name part of a method.
std::string file_name(const MethodResult& m) {
  std::string name = m.filter.empty() ? "noisy" : m.filter + "_" + tuning_name(m.tuning);
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == ' ' || c == '='; }, '_');
  return name;
}

/// Standard error that the references' noise leaves in every RMS of a scene, the same for all its methods and so
/// outside their intervals: mean (e - n1)(e - n2) has variance (2 e^2 s^2 + s^4) / N.
double common_error(const SceneResult& scene, double rms) {
  const double s2 = scene.reference_rms * scene.reference_rms, n = static_cast<double>(scene.width) * scene.height;
  return std::sqrt((2 * rms * rms * s2 + s2 * s2) / n) / (2 * rms);
}

double best_rms(const SceneResult& scene) {
  double best = std::numeric_limits<double>::infinity();
  for (const MethodResult& m : scene.methods) best = std::min(best, m.whole.mean);
  return best;
}

std::string scene_table(const SceneResult& scene, const Evaluation& e) {
  std::string text = fmt::format(
      "\n## {}\n\n{} x {}, {:.1f} % of the pixels show the medium. Two independent references of {} spp each ({:.0f} s "
      "in all), each with a Lab RMS "
      "noise of {:.3f}; their noise is taken off by multiplying the differences to the two, which leaves a standard "
      "error of {:.4f} in every RMS, common to all methods and not in the intervals. {}{}.\n\n"
      "| spp | method | parameters | Lab RMS, frame | Lab RMS, medium | bias, medium | filter [ms] | render + filter "
      "[s] | times faster than path tracing at equal RMS | paper: RMS | paper: time [s] |\n"
      "|---:|---|---|---:|---:|---:|---:|---:|---:|---:|---:|\n",
      scene.name, scene.width, scene.height, 100 * scene.medium_share, scene.reference_spp, scene.reference_seconds,
      scene.reference_rms, common_error(scene, best_rms(scene)),
      scene.reference_rms > 0.1 * best_rms(scene)
          ? fmt::format("One reference's noise is {:.2f} of the best method's RMS: without the second it would decide "
                        "the order. ",
                        scene.reference_rms / best_rms(scene))
          : "",
      scene.policy.text());
  for (const int spp : e.settings.spp)
    for (const MethodResult& m : scene.methods) {
      if (m.spp != spp) continue;
      const auto paper = m.tuning == Tuning::kNone || m.tuning == Tuning::kPaper
                             ? paper_numbers(scene.name, m.filter, spp)
                             : std::nullopt;
      text += fmt::format(
          "| {} | {} | {} | {} | {} | {:+.2f} % | {} | {:.3f} | {} | {} | {} |\n", spp, m.label(),
          tuning_name(m.tuning), interval(m.whole), interval(m.medium), 100 * m.relative_bias,
          m.filter.empty() ? "" : fmt::format("{:.1f}", 1e3 * m.filter_seconds), m.render_seconds + m.filter_seconds,
          m.filter.empty() ? "1" : fmt::format("{:.1f}", speed_up(m, *scene.find("", Tuning::kNone, spp))),
          paper ? fmt::format("{:.2f}", paper->rms) : "",
          paper && paper->seconds > 0 ? fmt::format("{:.0f}", paper->seconds) : "");
    }
  return text;
}

/// One line for each filter, with every tuning's error side by side.
std::string summary_table(const SceneResult& scene, const Evaluation& e) {
  std::vector<Tuning> tunings = {Tuning::kPaper, Tuning::kDefault};
  if (e.settings.tune) tunings.push_back(Tuning::kSearched);
  if (e.settings.tune && e.scenes.size() > 1) tunings.push_back(Tuning::kTransfer);
  std::string head = "| filter", rule = "|---";
  for (const int spp : e.settings.spp)
    for (const Tuning tuning : tunings) {
      head += fmt::format(" | {} spp, {}", spp, tuning_name(tuning));
      rule += "|---:";
    }
  std::string text = fmt::format("\n## {}, every filter\n\nLab RMS of the whole frame.\n\n{} | ms |\n{}|---:|\n",
                                 scene.name, head, rule);
  const auto line = [&](const std::string& filter) {
    text += "| " + (filter.empty() ? "path tracing" : filter);
    double seconds = 0;
    for (const int spp : e.settings.spp)
      for (const Tuning tuning : tunings) {
        const MethodResult* m = scene.find(filter, filter.empty() ? Tuning::kNone : tuning, spp);
        text += m ? " | " + interval(m->whole) : " | ";
        if (m && tuning == Tuning::kDefault) seconds = m->filter_seconds;
      }
    text += filter.empty() ? " |  |\n" : fmt::format(" | {:.1f} |\n", 1e3 * seconds);
  };
  line("");
  for (const Contender& contender : e.settings.contenders) line(contender.label);
  return text;
}

/// The winner of each spp, and whether it leads the second by more than the noise of the seeds.
std::string winners(const SceneResult& scene, const Evaluation& e) {
  std::string text;
  for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer})
    for (const int spp : e.settings.spp) {
      const MethodResult *first = nullptr, *second = nullptr;
      for (const MethodResult& m : scene.methods) {
        if (m.spp != spp || m.tuning != tuning) continue;
        if (!first || m.whole.mean < first->whole.mean) {
          second = first;
          first = &m;
        } else if (!second || m.whole.mean < second->whole.mean)
          second = &m;
      }
      if (!first || !second) continue;
      std::vector<double> lead;
      for (size_t i = 0; i < first->whole_by_seed.size(); ++i)
        lead.push_back(second->whole_by_seed[i] - first->whole_by_seed[i]);
      const MeanInterval d = mean_interval(lead);
      text += fmt::format("| {} | {} | {} | {} ({:.3f}) | {} ({:.3f}) | {} |\n", scene.name, tuning_name(tuning), spp,
                          first->label(), first->whole.mean, second->label(), second->whole.mean,
                          d.count > 1 ? fmt::format("{:.4f} ± {:.4f}{}", d.mean, d.half_width,
                                                    d.mean > d.half_width ? "" : " (not significant)")
                                      : fmt::format("{:.4f}", d.mean));
    }
  return text;
}

/// The paper's claims about its own filter, one by one.
std::string claims(const SceneResult& scene, const Evaluation& e) {
  std::string text;
  for (const Tuning tuning : {Tuning::kPaper, Tuning::kSearched})
    for (const int spp : e.settings.spp) {
      const MethodResult* own = scene.find("gradient_kernel", tuning, spp);
      if (!own) continue;
      for (const char* rival : {"bilateral", "extended_bilateral", "trilateral"}) {
        const MethodResult* r = scene.find(rival, tuning, spp);
        if (!r) continue;
        std::vector<double> difference;
        for (size_t i = 0; i < own->whole_by_seed.size(); ++i)
          difference.push_back(own->whole_by_seed[i] - r->whole_by_seed[i]);
        const MeanInterval d = mean_interval(difference);
        const char* verdict = d.count < 2              ? "one seed: cannot tell"
                              : d.mean < -d.half_width ? "yes"
                              : d.mean > d.half_width  ? "no"
                                                       : "level";
        const std::string spread = d.count > 1 ? fmt::format(" ± {:.4f}", d.half_width) : "";
        text += fmt::format("| {} | {} | {} | {} | {:+.4f}{} | {} | {:.2f} |\n", scene.name, tuning_name(tuning), spp,
                            rival, d.mean, spread, verdict, own->filter_seconds / r->filter_seconds);
      }
    }
  return text;
}

json to_json(const MeanInterval& m) {
  return {{"mean", m.mean}, {"half_width_95", m.half_width}, {"count", m.count}};
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

std::string markdown_report(const Evaluation& e) {
  std::string text = fmt::format(
      "# Filters on media passes\n\n"
      "The protocol of Table 1 of Xu et al. 2011: each filter cleans the {} of path-traced frames and is judged by the "
      "RMS in CIE-Lab (their equation "
      "3). `paper` parameters are the filter's preset of that name, as published (the trilateral's sigma_R, which no "
      "source gives, is 10); `default` are ours; `searched` are found by a search on a separate noisy frame of the "
      "same scene and spp, one parameter after another from the better of both; `transfer` by the same search on the "
      "other scenes. Pixels "
      "without coverage {}. "
      "Errors are means over {} seeds with the half width of a 95 % interval. Times were taken on {}; the paper's on a "
      "2 GHz Pentium E2180, and its scenes are "
      "not these, so its numbers stand beside ours for the order, not for the size. `Times faster` is the time plain "
      "path "
      "tracing would need for the same RMS, its error taken to fall as 1/√spp from the same spp, over render + filter "
      "time; "
      "every frame pays for the layers that the filters read.\n",
      e.settings.component == Component::kIndirect ? "indirect component" : "whole picture",
      e.settings.background == BackgroundRule::kBilateral ? "get the bilateral filter, as there"
                                                          : "are filtered like the rest",
      e.settings.seeds, e.machine);
  for (const SceneResult& scene : e.scenes) text += summary_table(scene, e);
  for (const SceneResult& scene : e.scenes) text += scene_table(scene, e);
  text +=
      "\n## Which filter wins\n\n| scene | parameters | spp | best (Lab RMS) | second | lead, paired over seeds "
      "|\n|---|---|---:|---|---|---|\n";
  for (const SceneResult& scene : e.scenes) text += winners(scene, e);
  text +=
      "\n## Does the paper's order hold?\n\nIt finds its gradient-kernel filter below the bilateral and extended "
      "bilateral at every spp, close to the "
      "trilateral, at under a sixth of the trilateral's time. `paper` compares all four as published. Differences of "
      "Lab RMS are paired over seeds; below zero "
      "the gradient kernel is better.\n\n"
      "| scene | parameters | spp | against | RMS difference | gradient kernel better? | its time / theirs "
      "|\n|---|---|---:|---|---:|---|---:|\n";
  for (const SceneResult& scene : e.scenes) text += claims(scene, e);
  text +=
      "\n## Parameters\n\nWhere a searched value is the first or last of its candidates, the optimum may lie further "
      "out.\n\n"
      "| scene | spp | filter | parameters | | at the edge |\n|---|---:|---|---|---|---|\n";
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods)
      if (!m.filter.empty())
        text += fmt::format("| {} | {} | {} | {} | `{}` | {} |\n", scene.name, m.spp, m.filter, tuning_name(m.tuning),
                            m.parameters, join(m.edges));
  text += "\n## Pictures\n\n";
  for (const SceneResult& scene : e.scenes) {
    text += fmt::format("![{0}: error against seconds]({0}_error_seconds.svg)\n\n", scene.name);
    for (const int spp : e.settings.spp)
      text += fmt::format("![{0}, {1} spp]({0}_{1}spp_{2}.png)\n\n", scene.name, spp,
                          tuning_name(e.settings.tune ? Tuning::kSearched : Tuning::kDefault));
  }
  return text;
}

std::string csv_report(const Evaluation& e) {
  std::string text =
      "scene,spp,method,tuning,lab_rms,lab_rms_ci95,lab_rms_medium,lab_rms_medium_ci95,rel_mse_medium,bias_medium,"
      "render_seconds,filter_seconds,"
      "speed_up_equal_rms,paper_rms,paper_seconds,parameters\n";
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods) {
      const auto paper = paper_numbers(scene.name, m.filter, m.spp);
      text += fmt::format("{},{},{},{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{},{},{}\n",
                          scene.name, m.spp, m.label(), tuning_name(m.tuning), m.whole.mean, m.whole.half_width,
                          m.medium.mean, m.medium.half_width, m.rel_mse_medium.mean, m.relative_bias, m.render_seconds,
                          m.filter_seconds, speed_up(m, *scene.find("", Tuning::kNone, m.spp)),
                          paper ? fmt::format("{}", paper->rms) : "",
                          paper && paper->seconds > 0 ? fmt::format("{}", paper->seconds) : "", m.parameters);
    }
  return text;
}

std::string json_report(const Evaluation& e) {
  json scenes = json::array();
  for (const SceneResult& scene : e.scenes) {
    json methods = json::array();
    for (const MethodResult& m : scene.methods) {
      json j = {{"spp", m.spp},
                {"method", m.label()},
                {"tuning", tuning_name(m.tuning)},
                {"at_the_edge", m.edges},
                {"parameters", m.parameters},
                {"lab_rms", to_json(m.whole)},
                {"lab_rms_medium", to_json(m.medium)},
                {"rel_mse_medium", to_json(m.rel_mse_medium)},
                {"bias_medium", m.relative_bias},
                {"render_seconds", m.render_seconds},
                {"filter_seconds", m.filter_seconds},
                {"lab_rms_by_seed", m.whole_by_seed},
                {"speed_up_equal_rms", speed_up(m, *scene.find("", Tuning::kNone, m.spp))}};
      if (const auto paper = paper_numbers(scene.name, m.filter, m.spp))
        j["paper"] = {{"rms", paper->rms}, {"seconds", paper->seconds}};
      methods.push_back(j);
    }
    scenes.push_back({{"name", scene.name},
                      {"width", scene.width},
                      {"height", scene.height},
                      {"medium_share", scene.medium_share},
                      {"reference_spp", scene.reference_spp},
                      {"reference_rms", scene.reference_rms},
                      {"exposure", scene.policy.exposure},
                      {"policy", scene.policy.text()},
                      {"methods", methods}});
  }
  return json{{"machine", e.machine}, {"seeds", e.settings.seeds}, {"scenes", scenes}}.dump(
             1, ' ', false, json::error_handler_t::replace) +
         "\n";
}

void write_report(const Evaluation& e, const std::filesystem::path& folder) {
  write_text(folder / "table.md", markdown_report(e));
  write_text(folder / "table.csv", csv_report(e));
  write_text(folder / "table.json", json_report(e));
  for (const SceneResult& scene : e.scenes) {
    write_text(folder / fmt::format("{}_error_seconds.svg", scene.name), error_seconds_plot(scene));
    write_exr(folder / fmt::format("{}_reference.exr", scene.name), scene.reference);
    for (const int spp : e.settings.spp)
      for (const Tuning tuning : {Tuning::kPaper, Tuning::kDefault, Tuning::kSearched, Tuning::kTransfer}) {
        if (const auto strip = comparison_strip(scene, spp, tuning))
          write_png(folder / fmt::format("{}_{}spp_{}.png", scene.name, spp, tuning_name(tuning)), *strip);
      }
    for (const MethodResult& m : scene.methods)
      write_exr(folder / fmt::format("{}_{}spp_{}.exr", scene.name, m.spp, file_name(m)), m.example);
  }
}

}  // namespace brume
