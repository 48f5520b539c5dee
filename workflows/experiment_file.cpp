#include "workflows/experiment_file.h"

#include <fmt/format.h>

#include <fstream>
#include <sstream>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/output_file.h"
#include "base/text.h"
#include "evaluate/metrics/metric.h"
#include "evaluate/protocol/command_filter.h"
#include "experiment_md_in.h"
#include "filters/api/registry.h"
#include "render/scene/field_reference.h"
#include "render/scene/toml_table.h"
#include "render/transport/path_sample.h"
#include "workflows/choices.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

// What a key means, once: the parser, its errors and docs/experiment.md come from here.

template <class Visitor>
void describe(Visitor& v, ExperimentScene& s) {
  v({.key = "file", .help = "scene file", .required = true}, s.file);
  v({"name", "", "in tables and file names; empty: the scene's own"}, s.name);
  v({"set", "", "keys of the scene with other values, as -D takes them: \"camera.fov=30\""}, s.set);
}

template <class Visitor>
void describe(Visitor& v, ExperimentFilter& f) {
  v({"filter", "", "name of a filter, `brume filters` lists them"}, f.filter);
  v({"command", "",
     "in place of `filter`, a program that cleans a frame: \"python3 mine.py {frame} {output}\" ([filters.md](filters.md#filters-of-others))"},
    f.command);
  v({"parameters", "", "\"name=value,...\": fixed, and left alone by searches"}, f.parameters);
  v({"label", "", "in tables; empty: the filter and what is fixed, or the command's script or program"}, f.label);
  v({"features", "", "that it is given, as `denoise --features`; empty: those of its own choice"}, f.features);
  v({"guides", "", "whether it is given guides, where it reads them"}, f.guides);
  v({"time_limit", "s", "on a frame, after which it has failed; 0: the experiment's", 0}, f.time_limit);
  v({"study", "", "whether ablation and sensitivity, where asked for, look at it"}, f.study);
  v({"layers", "",
     "of a command: that it reads beside the colour, as `render --layers` names them; \"guides\" for all guides"},
    f.layers);
  v({"statistics", "", "of a command: whether it reads variance and half images, of the colour and of its layers"},
    f.statistics);
  v({"memory_limit", "GB", "of a command and all that it starts, beyond which it has failed; 0: none", 0},
    f.memory_limit);
  v({"depends", "",
     "of a command: files and folders that decide its result beside those that its words name, so that cached results are made again when they change"},
    f.depends);
}

template <class Visitor>
void describe(Visitor& v, ExperimentFrames& f) {
  v({.key = "name", .help = "in tables and file names", .required = true}, f.name);
  v({.key = "reference", .help = "EXR that the filtered frames should equal", .required = true}, f.reference);
  v({"second_reference", "", "an independent one, to take the references' noise off"}, f.second_reference);
  v({.key = "noisy", .help = "EXRs that differ in their random numbers only", .required = true}, f.noisy);
  v({"spp", "", "samples per pixel of the noisy frames, for the tables", 1, 1 << 24}, f.spp);
  v({"exposure", "1", "factor from radiance to display; 0: the reference's header, or 1", 0, 1e12}, f.exposure);
}

template <class Visitor>
void describe(Visitor& v, ExperimentSequence& s) {
  v({.key = "file", .help = "scene file", .required = true}, s.file);
  v({.key = "frames", .help = "\"1-16\", \"1-240x2\"; at least two", .required = true}, s.frames);
  v({"name", "", "in tables; empty: the scene's own"}, s.name);
  v({"set", "", "keys of the scene with other values, as -D takes them"}, s.set);
}

template <class Visitor>
void describe(Visitor& v, Experiment& e) {
  v({"name", "", "of the experiment; empty: the file's"}, e.name);
  v({"size", "px", "width of the rendered frames; 0: the scenes' own", 0, 65536}, e.size);
  v({"spp", "", "sample counts of the noisy frames", 1, 1 << 20}, e.spp);
  v({"seeds", "", "noisy frames of each sample count; intervals are over them", 1, 1000}, e.seeds);
  v({"reference_spp", "", "of each of the two references", 1, 1 << 24}, e.reference_spp);
  v({"reference_noise", "of the best error",
     "double the references' samples until the noise of their mean is this share of the best method's error; 0: leave them. What noise they have is taken off by the product of the differences to both in any case",
     0, 10},
    e.reference_noise);
  v({"most_reference_spp", "", "where that ends", 1, 1 << 24}, e.most_reference_spp);
  v({.key = "component",
     .help =
         "what of a frame is cleaned: the whole picture; the light scattered twice and more, as in the papers; or that and the rest, each by itself",
     .choices = kComponents.names()},
    e.component);
  v({.key = "background",
     .help = "pixels without coverage: what the filter declares, the bilateral filter, or the filter",
     .choices = kBackgrounds.names()},
    e.background);
  v({"search", "", "whether parameters are searched, on frames of their own and on the other scenes"}, e.tune);
  v({"restarts", "", "of searches in spaces too large to try everything, from random places", 0, 100}, e.restarts);
  v({"time_limit", "s", "of a filter on a frame, after which it has failed; 0: none", 0}, e.time_limit);
  v({"time_layers", "",
     "charge methods that read no statistics for a render without them, which is timed once for each sample count; otherwise for the frames as they are"},
    e.time_layers);
  v({"ablation", "", "run each filter with each layer and feature that it can do without left out, and alone"},
    e.ablation);
  v({"sensitivity", "", "run each filter with each parameter at each of its candidates, the others at their best"},
    e.sensitivity);
  v({"study_spp", "", "sample counts of ablation and sensitivity; empty: the one in the middle", 1, 1 << 20},
    e.study_spp);
  v({"metrics", "", "to report, of those that `brume compare` prints; empty: all"}, e.metrics);
}

template <class Entry>
std::vector<Entry> tables(const toml::value& root, const char* name, const fs::path& folder) {
  std::vector<Entry> entries;
  if (!root.contains(name)) return entries;
  const toml::value& list = root.at(name);
  if (!list.is_array())
    fail_at(fmt::format("'{}' is {}", name, toml_type_name(list)), list, fmt::format("expected [[{}]]", name));
  for (const toml::value& entry : list.as_array()) {
    TomlTable table(entry, fmt::format("[[{}]]", name), folder);
    describe(table, entries.emplace_back());
    table.reject_unknown();
    table.check_files();
  }
  return entries;
}

/// Which keys of [[filters]] go with which kind of filter.
constexpr const char *kOfFilters[] = {"parameters", "features", "guides", "study"},
                     *kOfCommands[] = {"layers", "statistics", "memory_limit", "depends"};

/// Everything about a filter that can be wrong before anything runs. @throws InputError, at its line
void check_filter(ExperimentFilter& filter, const toml::value& table, const fs::path& folder) {
  if (table.contains("filter") == table.contains("command"))
    fail_at(table.contains("filter") ? "[[filters]] has both 'filter' and 'command'"
                                     : "[[filters]] has neither 'filter' nor 'command'",
            table.contains("filter") ? table.at("command") : table,
            "expected filter = \"NAME\" for one of brume's, or command = \"PROGRAM {frame} {output}\"");
  const bool is_command = table.contains("command");
  for (const char* key : is_command ? kOfFilters : kOfCommands)
    if (table.contains(key))
      fail_at(fmt::format("'{}' of [[filters]] is for {}", key, is_command ? "brume's own filters" : "commands"),
              table.at(key),
              is_command ? "a command takes its parameters among its words, and layers = [\"guides\"] for guides"
                         : "a filter of brume's declares itself what it reads");
  if (!is_command) return;
  filter.folder = folder.empty() ? fs::path(".") : folder;
  const auto try_command = [&](const ExperimentFilter& what, const char* key, const char* hint) {
    try {
      filter_of_command(what);
    } catch (const InputError& error) {
      fail_at(error.what(), table.at(key), hint);
    }
  };
  ExperimentFilter words = filter;
  words.layers.clear();
  try_command(words, "command", "in this command");
  if (!filter.layers.empty()) try_command(filter, "layers", "expected names of layers");
  for (const FilterEntry* own : all_filters())
    if (filter.label == own->name)
      fail_at(fmt::format("the command is labelled '{}', which is a filter of brume's", filter.label),
              table.at("label"), "expected a name of its own");
}

std::vector<ExperimentFilter> filters_of(const toml::value& root, const fs::path& folder) {
  std::vector<ExperimentFilter> filters = tables<ExperimentFilter>(root, "filters", folder);
  for (size_t i = 0; i < filters.size(); ++i) check_filter(filters[i], root.at("filters").as_array()[i], folder);
  return filters;
}

std::vector<ExperimentScene> scenes_of(const toml::value& root, const fs::path& folder) {
  if (!root.contains("scenes") || !root.at("scenes").is_array()) return tables<ExperimentScene>(root, "scenes", folder);
  const auto& list = root.at("scenes").as_array();
  if (list.empty() || !list.front().is_string()) return tables<ExperimentScene>(root, "scenes", folder);
  std::vector<ExperimentScene> scenes;
  for (const toml::value& entry : list) {
    if (!entry.is_string()) fail_at("'scenes' is not texts alone", entry, "expected files, or [[scenes]]");
    const fs::path file = folder / toml::get<std::string>(entry);
    std::error_code ignored;
    if (!fs::exists(file, ignored))
      fail_at(fmt::format("a scene is {}: {}", file.string(), missing_file(file)), entry,
              "expected a file; its path starts at the experiment's folder");
    scenes.push_back({file, "", {}});
  }
  return scenes;
}

}  // namespace

ExperimentFilter ExperimentFilter::of(const std::string& text) {
  ExperimentFilter filter;
  const size_t colon = text.find(':');
  filter.filter = text.substr(0, colon);
  if (colon != std::string::npos) filter.parameters = text.substr(colon + 1);
  return filter;
}

std::vector<LayerName> layers_to_ask_for() {
  std::vector<LayerName> layers;
  for (const RecordedLayer& l : recordable_layers()) layers.push_back(l.name);
  return layers;
}

ExternalFilter filter_of_command(const ExperimentFilter& filter) {
  return command_filter({.command = filter.command,
                         .folder = filter.folder,
                         .layers = filter.layers,
                         .statistics = filter.statistics,
                         .memory_limit = 1e9 * filter.memory_limit,
                         .depends = filter.depends},
                        layers_to_ask_for());
}

bool is_experiment(const fs::path& path) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return false;
  std::ifstream stream(path, std::ios::binary);
  char magic[4] = {};
  stream.read(magic, sizeof magic);
  if (std::find(std::begin(magic), std::end(magic), '\0') != std::end(magic) && stream) return false;  // binary
  stream.clear();
  stream.seekg(0);
  try {
    const toml::value root = parse_toml(stream, path.string());
    return !root.contains("camera") && (root.contains("scenes") || root.contains("frames") ||
                                        root.contains("sequences") || root.contains("filters"));
  } catch (const InputError&) {
    return false;  // the reader of scenes says what is wrong
  }
}

Experiment read_experiment(const fs::path& path) {
  std::istringstream text(read_text(path));
  const toml::value root = parse_toml(text, path.string());
  const fs::path folder = path.parent_path();
  Experiment experiment;
  experiment.name = path.stem().string();
  experiment.text = text.str();
  TomlTable table(root, "an experiment", folder);
  describe(table, experiment);
  experiment.scenes = scenes_of(root, folder);
  experiment.filters = filters_of(root, folder);
  experiment.frames = tables<ExperimentFrames>(root, "frames", folder);
  experiment.sequences = tables<ExperimentSequence>(root, "sequences", folder);
  table.knows({"scenes", "filters", "frames", "sequences"});
  table.reject_unknown();
  if (experiment.scenes.empty() && experiment.frames.empty() && experiment.sequences.empty())
    throw InputError(fmt::format(
        "{}: has neither scenes, frames nor sequences; expected scenes = [\"FILE\"], [[scenes]], [[frames]] or [[sequences]]",
        path.string()));
  for (const ExperimentFrames& frames : experiment.frames)
    if (frames.noisy.empty())
      throw InputError(fmt::format("{}: frames '{}' have no noisy ones; expected noisy = [\"FILE\", ...]",
                                   path.string(), frames.name));
  return experiment;
}

Experiment open_experiment(const std::vector<fs::path>& files) {
  for (const fs::path& file : files)
    if (is_experiment(file)) {
      if (files.size() > 1)
        throw InputError(fmt::format("{} is an experiment, which names its scenes; give it alone", file.string()));
      return read_experiment(file);
    }
  Experiment experiment;
  for (const fs::path& file : files) experiment.scenes.push_back({file, "", {}});
  return experiment;
}

std::string experiment_reference() {
  FieldReference reference;
  const auto table = [&](const char* heading, const char* about, auto settings) {
    reference.begin(heading, about);
    describe(reference, settings);
  };
  table("an experiment", "The keys that stand above all tables.", Experiment{});
  table("[[scenes]]", "Rendered scenes; `scenes = [\"FILE\", ...]` for files with nothing set.", ExperimentScene{});
  table(
      "[[filters]]",
      "Without any, every filter there is but those that read sample records. Each names one of brume's, `filter`, or a program, `command`.",
      ExperimentFilter{});
  table(
      "[[frames]]",
      "Frames that another renderer made stand beside the scenes: their noisy frames are cleaned as a whole and judged by their own reference. Nothing is searched on them.",
      ExperimentFrames{});
  table(
      "[[sequences]]",
      "Frames of a moving scene, each with random numbers of its own, `reference_spp` samples in each of two references. Every filter cleans them with its fixed and default parameters, each frame alone and, where it looks through time, with as many on either side as it declares; what is told is Lab RMS over all frames, and temporal error and flicker ([sequences.md](sequences.md)).",
      ExperimentSequence{});
  std::string metrics;
  for (const MetricInfo& m : all_metrics())
    metrics += fmt::format("| `{}` | {} | {} | {} | {} |\n", m.id, m.name, m.unit, better_name(m.better), m.definition);
  const std::string page(embedded::experiment_md_in);
  return replaced(replaced(page, "@KEYS@", reference.text), "@METRICS@", metrics);
}

}  // namespace brume
