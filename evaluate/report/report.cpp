#include "evaluate/report/report.h"

#include <fmt/format.h>

#include <vector>

#include "base/output_file.h"
#include "base/text.h"
#include "evaluate/report/page.h"
#include "evaluate/report/paper_numbers.h"
#include "evaluate/report/plot.h"
#include "evaluate/report/strips.h"
#include "evaluate/report/tables.h"
#include "image/exr_io.h"

namespace brume {
namespace {

std::string machine_text(const Provenance& p) {
  return fmt::format("{}, {} threads", p.processor, p.threads);
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

/// The tables of the report, in its order.
std::vector<Table> report_tables(const Evaluation& e) {
  std::vector<Table> tables;
  if (Table best = overall_winners(e); !best.rows.empty()) tables.push_back(std::move(best));
  for (const SceneResult& scene : e.scenes) tables.push_back(summary_table(scene, e));
  for (const SceneResult& scene : e.scenes) tables.push_back(scene_table(scene));
  for (Table& table : std::vector<Table>{winners(e), claims(e), passes(e), lights(e), sequences(e), pareto(e),
                                         time_to_error(e), ablation(e), sensitivity(e), parameters(e), failures(e)})
    if (!table.rows.empty()) tables.push_back(std::move(table));
  return tables;
}

}  // namespace

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
  Table table{
      "", "",
      columns(
          "#scene | #spp | #method | #tuning | #lab_rms | #lab_rms_ci95 | #lab_rms_medium | #lab_rms_medium_ci95 | #passes | #rel_mse_medium | #bias_medium | #render_seconds | #guide_seconds | #filter_seconds | #peak_memory_bytes | #speed_up_equal_rms | #paper_rms | #paper_seconds | #parameters | #failed | #scene_hash")};
  table.origin = origin(e);
  const auto number = [](double value) { return fmt::format("{:.6g}", value); };
  for (const SceneResult& scene : e.scenes)
    for (const MethodResult& m : scene.methods) {
      const auto paper = paper_numbers(scene.name, m.filter, m.spp);
      const auto measured = [&](double value) { return m.failed.empty() ? number(value) : ""; };
      const auto passes = [&](const MethodResult& of) {
        const std::vector<double> values = of.passes(Region::kFrame);
        return values.empty() ? "" : measured(mean_interval(values).mean);
      };
      const auto medium = [&](double value) { return scene.mask.empty() ? "" : measured(value); };
      table.rows.push_back({scene.name,
                            fmt::format("{}", m.spp),
                            m.label(),
                            tuning_name(m.tuning),
                            measured(m.whole().mean),
                            measured(m.whole().half_width),
                            medium(m.medium().mean),
                            medium(m.medium().half_width),
                            m.lights.empty() ? "" : passes(m),
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
