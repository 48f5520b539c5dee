#include "workflows/evaluate.h"

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <cstdio>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "evaluate/report/report.h"
#include "help_evaluate_txt.h"

namespace brume::python {
namespace {

/// The last words of an exception of Python's, in one line.
std::string last_words(py::error_already_set& error) {
  // There is none where no line of Python's ran: a call with the wrong number of arguments.
  const py::object trace = error.trace() ? error.trace() : py::none();
  const py::list lines = py::module_::import("traceback").attr("format_exception")(error.type(), error.value(), trace);
  std::vector<std::string> words;
  for (const std::string& line : split(to_text(py::str("").attr("join")(lines)), '\n')) {
    const size_t begin = line.find_first_not_of(' ');
    // What points into the line above tells nothing here.
    if (begin != std::string::npos && line.find_first_not_of(" ^~") != std::string::npos)
      words.push_back(line.substr(begin));
  }
  constexpr size_t kLines = 4;
  if (words.size() > kLines) words.erase(words.begin(), words.end() - static_cast<std::ptrdiff_t>(kLines));
  return join(words, " / ");
}

/// Calls a function of Python's. @throws InputError for its failure; py::error_already_set for what ends the run
ExternalOutput call(py::handle function, const ExternalInput& input) {
  ExternalOutput output;
  try {
    const Stopwatch before;
    const py::object frame = py::cast(std::make_shared<Layers>(input.frame));
    output.exchange_seconds = before.seconds();
    const Stopwatch clock;
    const py::object result = function(frame);
    output.seconds = clock.seconds();
    if (result.is_none())
      throw InputError("it gave nothing back (None); expected height x width x 3 numbers, or Layers");
    const Stopwatch after;
    output.picture = *to_layers(result);
    output.exchange_seconds += after.seconds();
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_Exception)) throw;
    throw InputError(
        fmt::format("raised {}; its last words: {}", to_text(error.type().attr("__name__")), last_words(error)));
  } catch (const InputError& error) {
    throw InputError(fmt::format("its result is no picture: {}", error.what()));
  } catch (const py::builtin_exception& error) {
    throw InputError(fmt::format("its result is no picture: {}", error.what()));
  }
  return output;
}

/// Everything that decides a function's result. @throws InputError for one that cannot be told from another
std::string key_of(const std::string& label, py::handle function) {
  try {
    return to_text(py::module_::import("brume._fingerprint").attr("fingerprint")(function));
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError)) throw;
    throw InputError(fmt::format(
        "filters['{}']: {}, so that the cache could not tell when the function's results are out of date; set its attribute cache_key, such as \"version 1\", to say so yourself",
        label, to_text(py::str(error.value()))));
  }
}

/// Where functions are called from: known once the work has begun.
struct Caller {
  const Work* work = nullptr;
};

/// A function as a filter. @param function, caller  outlive it
Contender contender_of(const std::string& label, py::handle function, bool cached, const Caller& caller) {
  ExternalFilter filter;
  const std::vector<LayerName> known = layers_to_ask_for();
  if (py::hasattr(function, "layers"))
    for (const std::string& name : to_words(function.attr("layers")))
      filter.ask_for(name, known, fmt::format("filters['{}'].layers", label));
  if (py::hasattr(function, "statistics"))
    filter.statistics = to_bool(fmt::format("filters['{}'].statistics", label), function.attr("statistics"));
  filter.kind = "function";
  filter.words = py::hasattr(function, "__qualname__") ? to_text(function.attr("__qualname__"))
                                                       : to_text(py::type::handle_of(function).attr("__qualname__"));
  filter.key = "function " + (cached ? key_of(label, function) : label);
  filter.run = [&caller, function](const ExternalInput& input, const Task&) {
    ExternalOutput output;
    caller.work->in_caller([&] { output = call(function, input); });
    return output;
  };
  Contender contender = external_contender(std::move(filter), label);
  if (py::hasattr(function, "time_limit"))
    contender.time_limit =
        to_positive(fmt::format("filters['{}'].time_limit", label), function.attr("time_limit"), /*or_zero=*/true);
  return contender;
}

/// Filters by label: functions and names.
struct NamedFilters {
  std::vector<std::pair<std::string, py::object>> entries;
  bool replace = false;  ///< those of the experiment

  explicit NamedFilters(const py::object& given) {
    if (given.is_none()) return;
    if (PyMapping_Check(given.ptr()) && py::hasattr(given, "items")) {
      for (const auto& [label, filter] : py::dict(given))
        entries.emplace_back(to_text(label), py::reinterpret_borrow<py::object>(filter));
      return;
    }
    replace = true;
    if (py::isinstance<py::str>(given) || PyCallable_Check(given.ptr())) {
      entries.emplace_back("", given);
      return;
    }
    for (const py::handle filter : given) entries.emplace_back("", py::reinterpret_borrow<py::object>(filter));
  }
};

/// @param filters, caller  outlive the options
void add_filters(EvaluateOptions& options, const NamedFilters& filters, const Caller& caller) {
  if (filters.replace) options.experiment.filters.clear();
  for (const auto& [label, filter] : filters.entries) {
    if (py::isinstance<py::str>(filter)) {
      ExperimentFilter& own = options.experiment.filters.emplace_back(ExperimentFilter::of(to_text(filter)));
      own.label = label;
      continue;
    }
    if (!PyCallable_Check(filter.ptr()))
      throw InputError(fmt::format("filters['{}']: expected a function or a filter's name, found {}", label,
                                   to_text(py::repr(filter))));
    const std::string name = !label.empty()                    ? label
                             : py::hasattr(filter, "__name__") ? to_text(filter.attr("__name__"))
                                                               : "";
    if (name.empty()) throw InputError("filters: one has no name; give a mapping from labels to filters");
    options.others.push_back(contender_of(name, filter, !options.cache.empty(), caller));
  }
}

std::vector<int> to_counts(const py::object& spp) {
  constexpr int kMost = 1 << 20;
  const bool listed = (py::isinstance<py::sequence>(spp) || py::isinstance<py::array>(spp)) && !is_path(spp);
  std::vector<int> counts;
  if (!listed || (py::isinstance<py::array>(spp) && py::reinterpret_borrow<py::array>(spp).ndim() == 0))
    counts = {to_int("spp", spp, 1, kMost)};
  else
    for (const py::handle count : spp) counts.push_back(to_int("spp", count, 1, kMost));
  if (counts.empty()) throw InputError("spp: expected at least one sample count");
  return counts;
}

/// Stages "[3/14] ..." as parts of the whole.
std::function<void(double)> progress_of_stage(const Task& whole, const std::string& stage) {
  size_t number = 1, count = 1;
  if (!whole.progress || std::sscanf(stage.c_str(), "[%zu/%zu]", &number, &count) != 2) return {};
  const auto of_all = static_cast<double>(count);
  return share(whole, static_cast<double>(number - 1) / of_all, static_cast<double>(number) / of_all).progress;
}

py::object evaluate(const py::object& experiment, const py::object& filters, const py::object& output,
                    const py::object& cache, const py::object& size, const py::object& spp, const py::object& seeds,
                    const py::object& reference_spp, const py::object& component, const py::object& background,
                    const py::object& search, int threads, const py::object& progress, const py::kwargs& keywords) {
  std::vector<std::filesystem::path> files;
  if (PyUnicode_Check(experiment.ptr()) || PyBytes_Check(experiment.ptr()) || py::hasattr(experiment, "__fspath__"))
    files.emplace_back(to_path(experiment));
  else
    for (const py::handle file : experiment) files.emplace_back(to_path(file));
  if (files.empty()) throw InputError("experiment: expected a file, found none");
  EvaluateOptions options;
  Experiment& e = options.experiment;
  e = open_experiment(files);
  const bool only_scenes = e.text.empty();
  options.output = to_optional_path(output);
  options.cache = to_optional_path(cache);
  options.command = "brume.evaluate of Python";
  if (!size.is_none()) e.size = to_int("size", size, 1, 65536);
  if (!spp.is_none()) e.spp = to_counts(spp);
  if (!seeds.is_none()) e.seeds = to_int("seeds", seeds, 1, 1000);
  if (!reference_spp.is_none()) e.reference_spp = to_int("reference_spp", reference_spp, 1, 1 << 24);
  if (!component.is_none()) e.component = to_text(component);
  if (!background.is_none()) e.background = to_text(background);
  if (!search.is_none()) e.tune = to_bool("search", search);
  for (ExperimentScene& scene : e.scenes)
    for (const std::string& assignment : to_overrides(keywords)) scene.set.push_back(assignment);
  const NamedFilters named(filters);
  Caller caller;
  add_filters(options, named, caller);
  options.chosen_filters = named.replace || (only_scenes && !named.entries.empty());

  std::string results;
  run_work({progress}, threads, [&](const Work& work) {
    caller.work = &work;
    Host host = host_of(work);
    host.progress = [&](const std::string& stage) { return progress_of_stage(work.task, stage); };
    results = json_report(evaluate_experiment(options, host));
  });
  return py::module_::import("json").attr("loads")(to_str(results));
}

}  // namespace

void bind_evaluate(py::module_& module) {
  const auto unless_given = [](const char* name) { return py::arg(name) = py::none(); };
  module.def("evaluate", &evaluate, py::arg("experiment"), unless_given("filters"), py::kw_only(),
             unless_given("output"), unless_given("cache"), unless_given("size"), unless_given("spp"),
             unless_given("seeds"), unless_given("reference_spp"), unless_given("component"),
             unless_given("background"), unless_given("search"), py::arg("threads") = 0, unless_given("progress"),
             help(embedded::help_evaluate_txt).c_str());
}

}  // namespace brume::python
