#include <fmt/format.h>
#include <pybind11/stl.h>

#include <array>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "workflows/render_frame.h"

namespace brume::python {
namespace {

constexpr const char* kRenderHelp =
    "Renders a scene to layers.\n\n"
    "scene: path of a scene file (TOML) or of an OpenVDB file, around which a scene is made up; or the text of a scene,\n"
    "which is a str of several lines. spp, seed: instead of the scene's. layers: names to record, \"none\" or \"all\".\n"
    "statistics: mean_variance, half_a and half_b too. buckets: eight bucket means too. clean: True cleans the picture\n"
    "with noise-free guides, a filter's name with that filter; the raw picture becomes the layer noisy. crop:\n"
    "(x0, y0, x1, y1), the last two exclusive. Every other keyword sets a key of the scene, a dot written as two\n"
    "underscores: camera__fov=30. Raises InputError.";

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

}  // namespace

void bind_render(py::module_& module) {
  module.def("render", &render, py::arg("scene"), py::kw_only(), py::arg("spp") = py::none(),
             py::arg("seed") = py::none(), py::arg("layers") = py::none(), py::arg("statistics") = true,
             py::arg("buckets") = false, py::arg("clean") = false, py::arg("crop") = py::none(), py::arg("threads") = 0,
             py::arg("progress") = py::none(), kRenderHelp);
}

}  // namespace brume::python
