// The extension module brume._brume; python/brume/__init__.py gives it to Python.

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <set>

#include "base/output_file.h"
#include "evaluate/metrics/metric.h"
#include "filters/api/recommend.h"
#include "filters/api/registry.h"
#include "filters/api/requirements.h"
#include "filters/inputs/guide_layers.h"
#include "filters/run/apply.h"
#include "image/exr_io.h"
#include "image/foreign.h"
#include "python/convert.h"
#include "python/layers.h"
#include "python/work.h"
#include "render/frame/renderer.h"
#include "render/scene/scene_io.h"
#include "workflows/clean.h"
#include "workflows/filters_json.h"
#include "workflows/frame.h"
#include "workflows/scene.h"
#include "workflows/version.h"

namespace brume::python {
namespace {

using LayersPointer = std::shared_ptr<Layers>;

// ---- files

/// Words of a str with commas, or of any iterable of str.
std::vector<std::string> to_words(const py::object& value) {
  if (py::isinstance<py::str>(value)) {
    const std::string text = to_text(value);
    return text.empty() ? std::vector<std::string>() : split(text, ',');
  }
  std::vector<std::string> words;
  for (const py::handle word : value) words.push_back(to_text(word));
  return words;
}

constexpr const char* kReadHelp =
    "Reads an EXR as float32.\n\n"
    "channels: full channel names or layers to read (\"R,G,B\", [\"direct\"]); all without it. adopt: give a frame of\n"
    "another renderer brume's names beside its own. Raises InputError: missing, not an EXR, truncated, deep.";

LayersPointer read(const py::object& path, const py::object& channels, bool adopt) {
  const std::string file = to_path(path);
  std::optional<std::vector<std::string>> wanted;
  if (!channels.is_none()) wanted = to_words(channels);
  LayersPointer layers;
  run_work(py::none(), 0, [&](const Work& work) {
    layers = std::make_shared<Layers>(read_exr(file, [&](const std::string& channel) {
      return !wanted || std::any_of(wanted->begin(), wanted->end(), [&](const std::string& name) {
        return channel == name || channel.starts_with(name + ".");
      });
    }));
    if (wanted && layers->channels().empty()) {
      std::vector<std::string> there;
      for (const ExrInfo::Channel& channel : read_exr_info(file).channels) there.push_back(channel.name);
      throw InputError(fmt::format("{}: no channel {}; it has: {}", file, join(*wanted), join(there)));
    }
    if (!adopt) return;
    if (const std::string recognised = adopt_foreign_layers(*layers); !recognised.empty()) work.log(recognised);
  });
  return layers;
}

constexpr const char* kWriteHelp =
    "Writes float32 scan lines, ZIP, in one part. The file appears whole or not at all.\n\n"
    "layers: brume.Layers, which is written as it stands, or a mapping of arrays, which is copied first. Raises\n"
    "InputError: a name that does not end in .exr, a folder that is missing, a full disk.";

void write(const py::object& path, const py::object& layers) {
  const std::string file = to_path(path);
  const LayersPointer frame = to_layers(layers);
  run_work(py::none(), 0, [&](const Work& work) {
    check_writable(file, {}, ".exr");
    write_exr(file, *frame, work.task);
  });
}

// ---- render

constexpr const char* kRenderHelp =
    "Renders a scene to layers.\n\n"
    "scene: path of a scene file (TOML) or of an OpenVDB file, around which a scene is made up; or the text of a "
    "scene,\n"
    "which is a str of several lines. spp, seed: instead of the scene's. layers: names to record, \"none\" or "
    "\"all\".\n"
    "statistics: mean_variance, half_a and half_b too. buckets: eight bucket means too. clean: True cleans the "
    "picture\n"
    "with noise-free guides, a filter's name with that filter; the raw picture becomes the layer noisy. crop:\n"
    "(x0, y0, x1, y1), the last two exclusive. Every other keyword sets a key of the scene, a dot written as two\n"
    "underscores: camera__fov=30. Raises InputError.";

std::vector<std::string> to_overrides(const py::kwargs& keywords) {
  std::vector<std::string> overrides;
  for (const auto& [key, value] : keywords) {
    std::string name = to_text(key);
    for (size_t at = 0; (at = name.find("__", at)) != std::string::npos;) name.replace(at, 2, ".");
    overrides.push_back(name + "=" + to_toml(value));
  }
  return overrides;
}

LayersPointer render(const py::object& scene, const py::object& spp, const py::object& seed, const py::object& layers,
                     bool statistics, bool buckets, const py::object& clean, const py::object& crop, int threads,
                     const py::object& progress, const py::kwargs& keywords) {
  std::string path, text;
  if (py::isinstance<py::str>(scene) && to_text(scene).find('\n') != std::string::npos)
    text = to_text(scene);
  else
    path = to_path(scene);
  const std::vector<std::string> overrides = to_overrides(keywords);
  std::string filter;
  if (py::isinstance<py::str>(clean))
    filter = to_text(clean);
  else if (clean.cast<bool>())
    filter = "transport_regression";
  LayerRequest request = filter.empty() ? LayerRequest{} : LayerRequest{.names = {"direct", "indirect"}};
  if (!layers.is_none()) {
    std::vector<std::string> names = to_words(layers);
    if (names == std::vector<std::string>{"none"}) names.clear();
    request = LayerRequest::of(names, statistics, buckets);
  }
  request.statistics = statistics;
  request.buckets = buckets;
  std::optional<RenderJob::Crop> window;
  if (!crop.is_none()) {
    const auto [x0, y0, x1, y1] = crop.cast<std::array<int, 4>>();
    window = RenderJob::Crop{x0, y0, x1, y1};
  }
  const std::optional<int> samples = spp.is_none() ? std::nullopt : std::optional(spp.cast<int>());
  const std::optional<int64_t> chosen_seed = seed.is_none() ? std::nullopt : std::optional(seed.cast<int64_t>());
  if (samples && (*samples < 1 || *samples > 1 << 24))
    throw InputError(fmt::format("spp: expected 1 .. {}, found {}", 1 << 24, *samples));
  if (chosen_seed && *chosen_seed < 0)
    throw InputError(fmt::format("seed: expected 0 or more, found {}", *chosen_seed));

  LayersPointer result;
  run_work(progress, threads, [&](const Work& work) {
    const Task silent = quiet(work.task);
    LoadedScene loaded;
    if (text.empty())
      loaded = load_scene(path, overrides, silent);
    else
      loaded.scene = parse_scene(text, "scene.toml", overrides);
    if (loaded.made)
      for (const std::string& line : loaded.made->assumptions) work.log("assumed " + line);
    const FilmSettings& film = loaded.scene.film;
    if (window && (window->x0 < 0 || window->y0 < 0 || window->x1 <= window->x0 || window->y1 <= window->y0 ||
                   window->x1 > film.width || window->y1 > film.height))
      throw InputError(
          fmt::format("crop ({}, {}, {}, {}): expected (x0, y0, x1, y1) inside (0, 0, {}, {}), the last two exclusive",
                      window->x0, window->y0, window->x1, window->y1, film.width, film.height));
    const bool cleans = !filter.empty();
    const Task rendering = cleans ? share(work.task, 0, 0.9) : work.task;
    std::optional<Cleaner> cleaner;
    LayerRequest recorded = request;
    if (cleans) {
      cleaner.emplace(
          filter, film.exposure, [&](const std::string&) { return share(work.task, 0.9, 1); }, work.note);
      recorded = cleaner->request(request, samples.value_or(loaded.scene.render.spp));
    }
    RenderJob job;
    job.spp = samples.value_or(loaded.scene.render.spp);
    job.seed = chosen_seed.value_or(loaded.scene.render.seed);
    loaded.scene.render.spp = job.spp;
    loaded.scene.render.seed = job.seed;
    job.crop = window;
    job.program = version_text();
    job.stamp = [](Layers& frame) { stamp(frame); };
    job.warn = work.note;
    const PreparedScene prepared(loaded.scene, recorded, silent);
    for (const std::string& line : prepared.notes()) work.note(line);
    RenderResult rendered = prepared.render(job, rendering);
    work.log(rendered.report.summary());
    result = std::make_shared<Layers>(cleaner ? cleaner->clean(rendered.layers) : std::move(rendered.layers));
  });
  return result;
}

// ---- denoise

std::string denoise_help() {
  std::string text =
      "Cleans a frame with a filter; with the best that its layers allow where none is named.\n\n"
      "layers: brume.Layers, which is read where it lies, or a mapping of arrays, which is copied first, or an array "
      "of\n"
      "height x width x 3. The result is a new brume.Layers: R, G, B, what else the filter makes, and a header with "
      "the\n"
      "filter and its parameters.\n\n"
      "component: all cleans the beauty, indirect that layer, direct being added back, apart both. background: "
      "bilateral\n"
      "or filter for pixels without coverage, or default. noise: layers or spatial: where variance comes from. "
      "outliers:\n"
      "extreme limits single samples that outshine all around them; clamp, redistribute or keep fireflies. features: "
      "names to use, \"none\", or all. carry: layers to filter with "
      "the\n"
      "same weights. guides: a path or Layers by brume guides. exposure: a number, \"header\" or \"auto\". tile: side "
      "of\n"
      "the squares that are filtered one after another [px]; 0: by memory. Every other keyword is a parameter of the\n"
      "filter, a dash written as an underscore, or preset. Raises InputError.\n\n"
      "Filters, what serves best first, and their parameters:\n";
  for (const FilterEntry* entry : filters_by_merit()) {
    text += fmt::format("\n{}: {}\n", entry->name, entry->summary);
    const FilterSettings settings(*entry);
    for (const Parameter& p : entry->parameters)
      text += fmt::format("    {}: {} ({}; default {})\n", p.name, p.help, p.range(), Parameter::text(settings.get(p)));
  }
  return text;
}

/// "sigma-range" for the keyword sigma_range; "lambda" for lambda_, which Python keeps for itself.
std::string parameter_name(std::string keyword) {
  if (keyword.ends_with('_')) keyword.pop_back();
  std::replace(keyword.begin(), keyword.end(), '_', '-');
  return keyword;
}

std::string to_exposure(const py::object& value) {
  if (py::isinstance<py::str>(value)) {
    const std::string text = to_text(value);
    if (text == "header" || text == "auto") return text;
  } else if (const double number = value.cast<double>(); number > 0 && number <= std::numeric_limits<double>::max()) {
    return fmt::format("{}", number);
  }
  throw InputError(fmt::format("exposure {}: expected header, auto or a number above 0", to_text(py::repr(value))));
}

std::vector<LayerName> to_colour_layers(const py::object& names) {
  const LayerName known[] = {layer::direct, layer::indirect, layer::background, layer::emission,
                             layer::single, layer::surface,  layer::catcher,    layer::catcher_unshadowed};
  std::vector<std::pair<std::string, LayerName>> choices;
  for (const LayerName& l : known) choices.emplace_back(std::string(l.name), l);
  std::vector<LayerName> layers;
  for (const std::string& name : to_words(names)) layers.push_back(choose("carry", name, choices));
  return layers;
}

/// The part of a frame that a run reads, which may then be changed.
Layers part_of(const Layers& frame, const std::set<std::string>& channels) {
  Layers part(frame.width(), frame.height());
  part.header = frame.header;
  part.lie_like(frame);
  for (const std::string& name : channels)
    if (const Plane* const plane = frame.find(name)) part.set(name, *plane);
  return part;
}

/// The channels of a frame with one pixel, and those of the guides.
Layers outline_of(const Layers& frame, const std::vector<std::string>& guides) {
  Layers outline(1, 1);
  outline.header = frame.header;
  for (const auto& [name, plane] : frame.channels()) outline.add(name);
  for (const std::string& name : guides) outline.add(name);
  adopt_foreign_layers(outline);
  return outline;
}

LayersPointer denoise(const py::object& layers, const py::object& filter, const std::string& component,
                      const std::string& background, const std::string& noise, const std::string& outliers,
                      const py::object& features, const py::object& carry, const py::object& guides,
                      const py::object& exposure, int tile, int threads, const py::object& progress,
                      const py::kwargs& parameters) {
  ApplyOptions options;
  options.component =
      choose<Component>("component", component,
                        {{"all", Component::kAll}, {"indirect", Component::kIndirect}, {"apart", Component::kApart}});
  options.background = choose<BackgroundRule>("background", background,
                                              {{"default", BackgroundRule::kDefault},
                                               {"bilateral", BackgroundRule::kBilateral},
                                               {"filter", BackgroundRule::kFilter}});
  options.noise =
      choose<NoiseSource>("noise", noise, {{"layers", NoiseSource::kLayers}, {"spatial", NoiseSource::kSpatial}});
  options.outliers = choose<Outliers>("outliers", outliers,
                                      {{"extreme", Outliers::kExtreme},
                                       {"clamp", Outliers::kClamp},
                                       {"redistribute", Outliers::kRedistribute},
                                       {"keep", Outliers::kKeep}});
  if (!features.is_none()) options.features = to_words(features);
  options.carried = to_colour_layers(carry);
  if (tile < 0) throw InputError(fmt::format("tile: expected 0 or more, found {}", tile));
  options.tile = tile;
  const std::string exposure_text = to_exposure(exposure);
  const LayersPointer frame = to_layers(layers);
  LayersPointer guide_layers;
  std::string guide_path;
  if (py::isinstance<Layers>(guides))
    guide_layers = guides.cast<LayersPointer>();
  else if (!guides.is_none())
    guide_path = to_path(guides);
  std::optional<FilterSettings> settings;
  if (!filter.is_none()) settings = parse_filter(to_text(filter));
  if (!settings && parameters.size() > 0)
    throw InputError(fmt::format("{}: a parameter without a filter; name the filter too",
                                 to_text(py::list(parameters.attr("keys")())[0])));
  for (const auto& [key, value] : parameters) settings->set(parameter_name(to_text(key)), to_toml(value));

  LayersPointer result;
  run_work(progress, threads, [&](const Work& work) {
    std::vector<std::string> guide_names;
    if (!guide_path.empty()) guide_names = guide_channels(guide_path);
    if (guide_layers) guide_names = guide_layers->names();
    if (!guide_names.empty()) {
      const Layers known = guide_layers ? *guide_layers : read_exr(guide_path, is_guide);
      if (!of_one_scene(known, *frame)) {
        const std::string path = guide_layers ? "the guides" : guide_path;
        Layers both = *frame;
        adopt_foreign_layers(both);
        add_guides(known, {path, "the frame"}, both);
        if (const std::string wrong = what_speaks_against_guides(both, path, quiet(work.task)); !wrong.empty()) {
          work.note(wrong);
          guide_names.clear();
          guide_path.clear();
          guide_layers = nullptr;
        }
      }
    }
    const Layers outline = outline_of(*frame, guide_names);
    if (!settings) {
      const Recommendation best = recommend_filter(outline, options);
      work.log(best.reason);
      settings = best.filter;
    }
    const bool again = frame->has(layer::noisy);
    std::optional<Layers> changed;
    if (again || !guide_names.empty() || !frame->has(layer::beauty)) {
      std::set<std::string> channels = readable_channels(*settings, options, outline);
      if (!frame->has(layer::beauty))
        for (const std::string& name : frame->names()) channels.insert(name);
      channels.insert({"R", "G", "B"});
      changed = part_of(*frame, channels);
      adopt_foreign_layers(*changed);
      if (again) {
        work.note("the frame is clean already: what it was made from, its layer noisy, is cleaned");
        for (size_t c = 0; c < 3; ++c) changed->set(layer::beauty.channel(c), frame->at(layer::noisy.channel(c)));
      }
      add_guides(guide_path, "the frame", *changed);
      if (guide_layers) add_guides(*guide_layers, {"the guides", "the frame"}, *changed);
    }
    const Layers& given = changed ? *changed : *frame;
    options.exposure = choose_exposure(exposure_text, given);
    ApplyReport report;
    result = std::make_shared<Layers>(apply_filter(*settings, given, options, work.task, &report));
    for (const std::string& line : report.notes) work.note(line);
    stamp(*result);
  });
  return result;
}

// ---- metrics

constexpr const char* kMetricsHelp =
    "Error measures of a picture against a reference, as `brume compare --json` gives them.\n\n"
    "picture, reference, second: Layers, a mapping of arrays, or height x width x 3. second: an independent "
    "reference,\n"
    "to take the references' noise off. layer: to compare; the beauty without it. exposure: a number, \"header\" or\n"
    "\"auto\", of the reference. clip: to [0, 1] before CIE-Lab. The dict has the measures and pixels, and with a\n"
    "reference that has coverage the same over the medium under \"medium\". Raises InputError: other sizes, NaN.";

py::dict to_dict(const Errors& errors) {
  py::dict dict;
  for (const auto& [name, value] : listed(errors)) dict[py::str(name)] = value;
  dict["pixels"] = errors.pixels;
  return dict;
}

py::dict metrics(const py::object& picture, const py::object& reference, const py::object& second,
                 const std::string& layer, const py::object& exposure, bool clip) {
  const std::string layer_name = layer == layer::beauty.label() ? "" : layer;
  std::set<std::string> channels = {layer::coverage.channel(0)};
  for (const std::string& name : LayerName{layer_name, "RGB", ""}.channel_names()) channels.insert(name);
  // Cut to the common window below, so that they are copies.
  const auto named = [&](const char* name, const py::object& value) {
    const LayersPointer layers = to_layers(value);
    Layers part = part_of(*layers, channels);
    return NamedFrame{name, part.has(LayerName{layer_name, "RGB", ""}) ? std::move(part) : Layers(*layers)};
  };
  NamedFrame x = named("picture", picture), r = named("reference", reference);
  std::optional<NamedFrame> r2;
  if (!second.is_none()) r2 = named("second", second);
  const std::string exposure_text = to_exposure(exposure);
  Errors whole, medium;
  bool has_medium = false;
  run_work(py::none(), 0, [&](const Work& work) {
    for (const NamedFrame* frame : {&x, r2 ? &*r2 : nullptr})
      if (const std::string remark = frame ? remark_on_scenes(*frame, r) : ""; !remark.empty()) work.note(remark);
    std::vector<NamedFrame*> pictures = {&r, &x};
    if (r2) pictures.push_back(&*r2);
    cut_to_common_window(pictures);
    const LabPolicy policy{choose_exposure(exposure_text, r.frame), clip};
    const RgbPlanes colours = x.colours(layer_name), expected = r.colours(layer_name);
    const RgbPlanes other = r2 ? r2->colours(layer_name) : RgbPlanes{};
    whole = compare(colours, expected, policy, {}, r2 ? &other : nullptr);
    const Mask mask = medium_mask(r.frame);
    has_medium = !mask.empty();
    if (has_medium) medium = compare(colours, expected, policy, mask, r2 ? &other : nullptr);
  });
  py::dict result = to_dict(whole);
  if (has_medium) result["medium"] = to_dict(medium);
  return result;
}

// ---- the module

/// brume.InputError, whose message may hold any bytes of a file's name.
void translate(std::exception_ptr failure) {
  try {
    if (failure) std::rethrow_exception(failure);
  } catch (const InputError& error) {
    const py::object type = py::module_::import("brume._brume").attr("InputError");
    PyErr_SetObject(type.ptr(), to_str(error.what()).ptr());
  } catch (const Interrupted& error) {
    PyErr_SetString(PyExc_KeyboardInterrupt, error.what());
  }
}

}  // namespace

PYBIND11_MODULE(_brume, module) {
  set_exr_threads(0);
  module.doc() = "Renders OpenVDB smoke and clouds without bias, and removes Monte Carlo noise from media passes.";
  module.attr("__version__") = version_number();
  module.attr("__commit__") = version_commit();
  const auto error = py::reinterpret_steal<py::object>(PyErr_NewExceptionWithDoc(
      "brume.InputError", "Bad input: where, what was found, what was expected and what exists instead.",
      PyExc_ValueError, nullptr));
  module.attr("InputError") = error;
  py::register_exception_translator(&translate);
  bind_layers(module);
  module.def("read", &read, py::arg("path"), py::arg("channels") = py::none(), py::kw_only(), py::arg("adopt") = true,
             kReadHelp);
  module.def("write", &write, py::arg("path"), py::arg("layers"), kWriteHelp);
  module.def("render", &render, py::arg("scene"), py::kw_only(), py::arg("spp") = py::none(),
             py::arg("seed") = py::none(), py::arg("layers") = py::none(), py::arg("statistics") = true,
             py::arg("buckets") = false, py::arg("clean") = false, py::arg("crop") = py::none(), py::arg("threads") = 0,
             py::arg("progress") = py::none(), kRenderHelp);
  module.def("denoise", &denoise, py::arg("layers"), py::arg("filter") = py::none(), py::kw_only(),
             py::arg("component") = "all", py::arg("background") = "default", py::arg("noise") = "layers",
             py::arg("outliers") = "extreme", py::arg("features") = py::none(), py::arg("carry") = py::tuple(),
             py::arg("guides") = py::none(), py::arg("exposure") = "header", py::arg("tile") = 0,
             py::arg("threads") = 0, py::arg("progress") = py::none(), denoise_help().c_str());
  module.def("metrics", &metrics, py::arg("picture"), py::arg("reference"), py::arg("second") = py::none(),
             py::kw_only(), py::arg("layer") = "", py::arg("exposure") = "header", py::arg("clip") = true,
             kMetricsHelp);
  module.def(
      "filters",
      [] {
        const py::object read_json = py::module_::import("json").attr("loads");
        return py::object(read_json(to_str(filters_json(filters_by_merit())))["filters"]);
      },
      "The declarations of the filters, what serves best first, as `brume filters --json` gives them.");
}

}  // namespace brume::python
