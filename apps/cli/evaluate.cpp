#include "workflows/evaluate.h"

#include <fmt/format.h>

#include <cstdlib>
#include <memory>

#include "apps/cli/command.h"
#include "apps/cli/filter_options.h"
#include "base/error.h"
#include "base/text.h"
#include "evaluate/report/page.h"
#include "evaluate/report/report.h"

namespace brume::app {
namespace {

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
  const bool from_file = is_experiment(o.scenes.front());
  Experiment e = open_experiment({o.scenes.begin(), o.scenes.end()});
  const auto given = [&](const char* option) { return !from_file || command.count(option) > 0; };
  if (given("--spp")) e.spp = parse_spp(o.spp);
  if (given("--seeds")) e.seeds = o.seeds;
  if (given("--reference-spp")) e.reference_spp = o.reference_spp;
  if (given("--size")) e.size = o.size;
  if (given("--component")) e.component = o.component;
  if (given("--background")) e.background = o.background;
  if (o.no_tuning) e.tune = false;
  for (ExperimentScene& scene : e.scenes) scene.set.insert(scene.set.end(), o.overrides.begin(), o.overrides.end());
  if (!o.filters.empty()) {
    e.filters.clear();
    for (const std::string& text : o.filters) e.filters.push_back(ExperimentFilter::of(text));
  }
  return e;
}

int run(const Options& o, const CLI::App& command, const Common& common) {
  EvaluateOptions options;
  options.experiment = chosen_experiment(o, command);
  options.cache = o.cache;
  options.output = o.output;
  options.chosen_filters = !o.filters.empty();
  options.command = common.command;
  const Evaluation result = evaluate_experiment(options, make_host(common));
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
  const Verb command = add_command(app, common, "evaluate",
                                   "compare the filters: references, noisy frames, tuning, tables, strips, plots");
  command(
      "scenes", o.scenes,
      "scene files, or one experiment (docs/experiment.md); with several scenes, parameters are also transferred between them")
      ->required();
  command("-o,--output", o.output, "folder to write: tables, plots, EXRs, and index.html, a page to look at it all")
      ->required();
  command(
      "--cache", o.cache,
      "folder that keeps all frames and results: nothing in it is made again, and an interrupted run goes on; frames then hold what any filter may read");
  command("--spp", o.spp, "sample counts of the noisy frames")->capture_default_str();
  command("--seeds", o.seeds, "noisy frames per sample count")->check(CLI::Range(1, 1000))->capture_default_str();
  command("--reference-spp", o.reference_spp, "of each of the two references")
      ->check(CLI::Range(1, 1 << 24))
      ->capture_default_str();
  command("--size", o.size, "width in pixels instead of the scenes'")->check(CLI::Range(1, 65536));
  command("-D", o.overrides, "set a key of every scene")->allow_extra_args(false);
  command("-f,--filter", o.filters, "compare only these: NAME, or NAME:parameter=value,... to fix parameters")
      ->allow_extra_args(false);
  add_component_options(command, o.component, o.background);
  command("--no-tuning", o.no_tuning, "published and default parameters only");
  command("--json", common.json, "all numbers as JSON on stdout, as in results.json");
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
