#include "workflows/evaluate.h"

#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/filter_options.h"
#include "apps/cli/output_folder.h"
#include "apps/cli/program.h"
#include "base/error.h"
#include "base/text.h"
#include "evaluate/report/page.h"
#include "evaluate/report/report.h"

namespace brume::app {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<std::string> scenes, overrides, filters;
  std::string output, cache, spp = "16,36,64";
  int seeds = 5, reference_spp = 4096, size = 0;
  bool no_tuning = false;
  std::string component = "indirect", background = "default";  // as the papers do
};

std::vector<int> parse_spp(const std::string& text) {
  std::vector<int> result;
  for (const std::string& word : split(text, ',')) {
    char* end = nullptr;
    const long value = std::strtol(word.c_str(), &end, 10);
    if (word.empty() || *end || value < 1 || value > 1 << 20)
      throw InputError(fmt::format("--spp {}: expected sample counts such as 16,36,64", text));
    result.push_back(static_cast<int>(value));
  }
  return result;
}

/// What is to be done: the file's words, and over them the command line's.
Experiment chosen_experiment(const Options& o, const CLI::App& command) {
  Experiment e;
  const bool from_file = is_experiment(o.scenes.front());
  if (from_file) {
    if (o.scenes.size() > 1)
      throw InputError(fmt::format("{} is an experiment, which names its scenes; give it alone", o.scenes.front()));
    e = read_experiment(o.scenes.front());
  }
  const auto given = [&](const char* option) { return !from_file || command.count(option) > 0; };
  if (given("--spp")) e.spp = parse_spp(o.spp);
  if (given("--seeds")) e.seeds = o.seeds;
  if (given("--reference-spp")) e.reference_spp = o.reference_spp;
  if (given("--size")) e.size = o.size;
  if (given("--component")) e.component = o.component;
  if (given("--background")) e.background = o.background;
  if (o.no_tuning) e.search = false;
  if (!from_file)
    for (const std::string& path : o.scenes) e.scenes.push_back({path, "", {}});
  for (ExperimentScene& scene : e.scenes) scene.set.insert(scene.set.end(), o.overrides.begin(), o.overrides.end());
  if (!o.filters.empty()) {
    e.filters.clear();
    for (const std::string& text : o.filters) e.filters.push_back(ExperimentFilter::of(text));
  }
  return e;
}

/// PNGs beside the plots, by rsvg-convert.
void draw_plots(const fs::path& folder) {
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const fs::path& plot = entry.path();
    if (plot.extension() != ".svg") continue;
    fs::path picture = plot;
    picture.replace_extension(".png");
    if (const auto status = run_program({"rsvg-convert", "--zoom=2", "-o", picture.string(), plot.string()}); !status) {
      note("the plots are there as SVG alone: PNGs of them are made by rsvg-convert (Debian's librsvg2-bin)");
      return;
    } else if (*status != 0) {
      warn(fmt::format("{}: rsvg-convert made no PNG of it (exit status {})", plot.filename().string(), *status));
    }
  }
}

int run(const Options& o, const CLI::App& command, const Common& common) {
  EvaluateOptions options;
  options.experiment = chosen_experiment(o, command);
  OutputFolder folder(o.output);
  const fs::path own_cache = folder.part() / "cache";
  options.cache = o.cache.empty() ? own_cache : fs::path(o.cache);
  options.all_layers = !o.cache.empty();
  options.chosen_filters = !o.filters.empty();
  options.command = common.command;
  const Evaluation result = evaluate_experiment(options, make_host(common));
  if (o.cache.empty()) fs::remove_all(own_cache);
  write_report(result, folder.part());
  draw_plots(folder.part());
  folder.commit();
  const std::string page = !page_is_built_in() ? "no page (index.html): this program was built without Node"
                           : result.scenes.empty()
                               ? "no page (index.html), which shows scenes and frames: sequences alone have none"
                               : fmt::format("all of it in one page: open {}/index.html in a browser", o.output);
  const std::string rest =
      fmt::format("{}/table.md has every table; EXRs, strips and plots lie there, too; {}", o.output, page);
  print(common.json ? json_report(result) : short_report(result) + rest + "\n");
  log(common, fmt::format("{} frames rendered, {} results filtered; out of the cache {} and {}", result.work.rendered,
                          result.work.filtered, result.work.frames_found, result.work.results_found));
  if (common.json) log(common, rest);
  return kDone;
}

}  // namespace

void add_evaluate(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  CLI::App* command = add_command(app, common, "evaluate",
                                  "compare the filters: references, noisy frames, tuning, tables, strips, plots");
  command
      ->add_option(
          "scenes", o.scenes,
          "scene files, or one experiment (docs/experiment.md); with several scenes, parameters are also transferred between them")
      ->required();
  command
      ->add_option("-o,--output", o.output,
                   "folder to write: tables, plots, EXRs, and index.html, a page to look at it all")
      ->required();
  command->add_option(
      "--cache", o.cache,
      "folder that keeps all frames and results: nothing in it is made again, and an interrupted run goes on; frames then hold what any filter may read");
  command->add_option("--spp", o.spp, "sample counts of the noisy frames")->capture_default_str();
  command->add_option("--seeds", o.seeds, "noisy frames per sample count")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--reference-spp", o.reference_spp, "of each of the two references")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  command->add_option("--size", o.size, "width in pixels instead of the scenes'")->check(CLI::Range(1, 65536));
  command->add_option("-D", o.overrides, "set a key of every scene")->allow_extra_args(false);
  command
      ->add_option("-f,--filter", o.filters, "compare only these: NAME, or NAME:parameter=value,... to fix parameters")
      ->allow_extra_args(false);
  add_component_options(*command, o.component, o.background);
  command->add_flag("--no-tuning", o.no_tuning, "published and default parameters only");
  command->add_flag("--json", common.json, "all numbers as JSON on stdout, as in results.json");
  commands[command] = [options, &common, command] {
    try {
      return run(*options, *command, common);
    } catch (const Interrupted&) {
      throw Interrupted(
          options->cache.empty()
              ? "no file was left half-written; with --cache DIR the same command would go on where it stopped"
              : fmt::format(
                    "no file was left half-written; what is done lies in {}: the same command goes on from there",
                    options->cache));
    }
  };
}

}  // namespace brume::app
