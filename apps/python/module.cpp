// The extension module brume._brume; apps/python/brume/__init__.py gives it to Python.

#include <fmt/format.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <set>

#include "apps/python/convert.h"
#include "apps/python/layers.h"
#include "apps/python/work.h"
#include "apps/view/server.h"
#include "base/output_file.h"
#include "base/sequence.h"
#include "filters/api/registry.h"
#include "image/exr_io.h"
#include "image/foreign.h"
#include "workflows/choices.h"
#include "workflows/comparison.h"
#include "workflows/denoise_frame.h"
#include "workflows/filters_json.h"
#include "workflows/frame.h"
#include "workflows/render_frame.h"
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
    "scene: path of a scene file (TOML) or of an OpenVDB file, around which a scene is made up; or the text of a scene,\n"
    "which is a str of several lines. spp, seed: instead of the scene's. layers: names to record, \"none\" or \"all\".\n"
    "statistics: mean_variance, half_a and half_b too. buckets: eight bucket means too. clean: True cleans the picture\n"
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

/// Where the words of a workflow go: to the logger "brume".
Host host_of(const Work& work) {
  Host host{work.task.threads, work.task.cancel};
  host.tell = [&work](Host::Word word, const std::string& text) {
    (word == Host::Word::kLog || word == Host::Word::kRemark ? work.log : work.note)(text);
  };
  host.progress = [&work](const std::string&) { return work.task.progress; };
  return host;
}

LayersPointer render(const py::object& scene, const py::object& spp, const py::object& seed, const py::object& layers,
                     bool statistics, bool buckets, const py::object& clean, const py::object& crop, int threads,
                     const py::object& progress, const py::kwargs& keywords) {
  RenderOptions options;
  if (py::isinstance<py::str>(scene) && to_text(scene).find('\n') != std::string::npos) {
    options.scene = "scene.toml";
    options.scene_text = to_text(scene);
  } else {
    options.scene = to_path(scene);
  }
  options.overrides = to_overrides(keywords);
  if (py::isinstance<py::str>(clean))
    options.clean_filter = to_text(clean);
  else if (clean.cast<bool>())
    options.clean_filter = "transport_regression";
  if (!layers.is_none()) {
    std::vector<std::string> names = to_words(layers);
    if (names == std::vector<std::string>{"none"}) names.clear();
    options.layers = LayerRequest::of(names, statistics, buckets);
  } else if (!options.clean_filter.empty()) {
    options.layers.names = {"direct", "indirect"};
  }
  options.layers.statistics = statistics;
  options.layers.buckets = buckets;
  if (!crop.is_none()) {
    const auto [x0, y0, x1, y1] = crop.cast<std::array<int, 4>>();
    options.crop = fmt::format("{},{},{},{}", x0, y0, x1, y1);
  }
  if (!spp.is_none()) options.spp = spp.cast<int>();
  if (!seed.is_none()) options.seed = seed.cast<int64_t>();
  if (options.spp && (*options.spp < 1 || *options.spp > 1 << 24))
    throw InputError(fmt::format("spp: expected 1 .. {}, found {}", 1 << 24, *options.spp));
  if (options.seed && *options.seed < 0)
    throw InputError(fmt::format("seed: expected 0 or more, found {}", *options.seed));

  LayersPointer result;
  run_work(progress, threads, [&](const Work& work) {
    Host host = host_of(work);
    if (!options.clean_filter.empty())
      host.progress = [&](const std::string& stage) {
        const bool renders = stage.starts_with("render ");
        return share(work.task, renders ? 0 : 0.9, renders ? 0.9 : 1).progress;
      };
    result = std::make_shared<Layers>(render_frame(options, host).layers);
  });
  return result;
}

// ---- denoise

std::string denoise_help() {
  std::string text =
      "Cleans a frame with a filter; with the best that its layers allow where none is named.\n\n"
      "layers: brume.Layers, which is read where it lies, or a mapping of arrays, which is copied first, or an array of\n"
      "height x width x 3. The result is a new brume.Layers: R, G, B, what else the filter makes, and a header with the\n"
      "filter and its parameters.\n\n"
      "component: all cleans the beauty, indirect that layer, direct being added back, separate both by themselves. background: bilateral\n"
      "or filter for pixels without coverage, or default. noise: layers or spatial: where variance comes from. outliers:\n"
      "extreme limits single samples that outshine all around them; clamp, redistribute or keep fireflies. features: names to use, \"none\", or all. carry: layers to filter with the\n"
      "same weights. guides: a path or Layers by brume guides. exposure: a number, \"header\" or \"auto\". tile: side of\n"
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

LayersPointer denoise(const py::object& layers, const py::object& filter, const std::string& component,
                      const std::string& background, const std::string& noise, const std::string& outliers,
                      const py::object& features, const py::object& carry, const py::object& guides,
                      const py::object& exposure, int tile, int threads, const py::object& progress,
                      const py::kwargs& parameters) {
  DenoiseOptions options;
  options.how.component = kComponents.of(component);
  options.how.background = kBackgrounds.of(background);
  options.how.noise = kNoiseSources.of(noise);
  options.how.outliers = kOutlierRules.of(outliers);
  if (!features.is_none()) options.how.features = to_words(features);
  for (const std::string& name : to_words(carry)) options.how.carried.push_back(kColourLayers.of(name));
  if (tile < 0) throw InputError(fmt::format("tile: expected 0 or more, found {}", tile));
  options.how.tile = tile;
  options.picture.exposure = to_exposure(exposure);
  const LayersPointer frame = to_layers(layers);
  LayersPointer guide_layers;
  std::string guide_path;
  if (py::isinstance<Layers>(guides))
    guide_layers = guides.cast<LayersPointer>();
  else if (!guides.is_none())
    guide_path = to_path(guides);
  if (!filter.is_none()) options.filters = {parse_filter(to_text(filter))};
  if (options.filters.empty() && parameters.size() > 0)
    throw InputError(fmt::format("{}: a parameter without a filter; name the filter too",
                                 to_text(py::list(parameters.attr("keys")())[0])));
  for (const auto& [key, value] : parameters) options.filters[0].set(parameter_name(to_text(key)), to_toml(value));

  LayersPointer result;
  run_work(progress, threads, [&](const Work& work) {
    std::optional<NamedFrame> known;
    if (guide_layers) known = {"the guides", *guide_layers};
    if (!guide_path.empty()) known = read_guides(guide_path);
    result = std::make_shared<Layers>(denoise_frame(*frame, known ? &*known : nullptr, options, host_of(work)));
  });
  return result;
}

// ---- metrics

constexpr const char* kMetricsHelp =
    "Error measures of a picture against a reference, as `brume compare --json` gives them.\n\n"
    "picture, reference, second: Layers, a mapping of arrays, or height x width x 3. second: an independent reference,\n"
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
  std::vector<Errors> errors;
  run_work(py::none(), 0, [&](const Work& work) {
    const Comparison pictures(std::move(x), std::move(r), std::move(r2), host_of(work));
    errors = pictures.errors(layer_name, pictures.policy(exposure_text, clip), ErrorScope::kAll, work.task);
  });
  py::dict result = to_dict(errors[0]);
  if (errors.size() > 1) result["medium"] = to_dict(errors[1]);
  return result;
}

// ---- view

constexpr const char* kViewHelp =
    "Serves a page on this machine's loopback that shows a scene, to turn, light and edit it, and returns its address.\n\n"
    "scene: path of a scene file (TOML) or of an OpenVDB file. frames: \"1-48\", a time line; the names are patterns\n"
    "then. Every other keyword sets a key of the scene: camera__fov=30. It is served until the interpreter ends; the\n"
    "address holds a secret, and who does not know it is not answered. Raises InputError.";

/// The servers of this process, ended with the interpreter.
std::vector<std::unique_ptr<web::Server>>& servers() {
  static auto* const all = new std::vector<std::unique_ptr<web::Server>>;
  return *all;
}

std::string view(const py::object& scene, const py::object& frames, int threads, const py::kwargs& keywords) {
  ViewOptions options;
  options.scene = to_path(scene);
  options.overrides = to_overrides(keywords);
  if (!frames.is_none()) options.frames = parse_frames(to_text(frames));
  const std::filesystem::path first = file_of_frame(options.scene, options.frames.empty() ? 0 : options.frames[0]);
  if (std::error_code error; !std::filesystem::exists(first, error))
    throw InputError(fmt::format("{}: no such file", first.string()));
  if (threads < 0)
    throw InputError(fmt::format("threads: expected 0 (all of the machine's) or more, found {}", threads));
  Host host;
  host.threads = threads;
  const py::gil_scoped_release others_may_run;
  servers().push_back(std::make_unique<web::Server>(options, web::ServerOptions{}, host));
  return servers().back()->address();
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
  module.def("view", &view, py::arg("scene"), py::kw_only(), py::arg("frames") = py::none(), py::arg("threads") = 0,
             kViewHelp);
  py::module_::import("atexit").attr("register")(py::cpp_function([] {
    const py::gil_scoped_release others_may_run;
    servers().clear();
  }));
  module.def(
      "filters",
      [] {
        const py::object read_json = py::module_::import("json").attr("loads");
        return py::object(read_json(to_str(filters_json(filters_by_merit())))["filters"]);
      },
      "The declarations of the filters, what serves best first, as `brume filters --json` gives them.");
}

}  // namespace brume::python
