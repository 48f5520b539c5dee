#include <fmt/format.h>

#include "apps/python/bindings.h"
#include "apps/python/scene.h"
#include "base/output_file.h"
#include "help_guides_txt.h"
#include "image/exr_io.h"
#include "workflows/guide_frame.h"

namespace brume::python {
namespace {

LayersPointer guides(const py::object& like, const py::object& scene, const py::object& volume,
                     const py::object& samples, const py::object& output, int threads, const py::object& progress,
                     const py::kwargs& keywords) {
  GuideOptions options;
  const SceneChanges changes(keywords);
  std::optional<SceneArgument> argument;
  if (!scene.is_none()) argument.emplace(scene);
  const bool is_file = is_path(like);
  const std::string file = is_file ? to_path(like) : std::string();
  if (!is_file) options.like = GuidedFrame::of(*to_layers(like), "the frame");
  options.volume = to_optional_path(volume);
  if (!samples.is_none()) options.samples = to_int("samples", samples, 1, 1 << 24);
  const std::string path = to_optional_path(output);
  if (!argument && changes.has_arrays()) throw InputError("arrays: expected a scene whose volumes or meshes they are");

  LayersPointer result;
  run_work({progress}, threads, [&](const Work& work) {
    std::optional<SceneUse> use;
    Host host = host_of(work);
    if (is_file) options.like = GuidedFrame::of_file(file);
    if (argument) {
      if (argument->object()) {
        use.emplace(*argument->object(), work.task);
        options.scenes = &use->cache();
        host = use->host(work);
      }
      options.scene = argument->source(changes.overrides(), work.task);
      changes.apply_arrays(*options.scene, work.task);
      for (const std::string& line : options.scene->assumptions) work.log("assumed " + line);
    }
    options.overrides = changes.overrides();
    host.progress = [&work](const std::string& stage) {
      const bool solves = stage.starts_with("light ");
      return share(work.task, solves ? 0 : 0.7, solves ? 0.7 : 1).progress;
    };
    const Scene guided = guided_scene(options, host);
    if (!path.empty()) check_writable(path, {}, ".exr");
    result = std::make_shared<Layers>(guide_frame(guided, options, host).layers);
    if (!path.empty()) write_exr(path, *result, host.silent());
  });
  return result;
}

}  // namespace

void bind_guides(py::module_& module) {
  module.def("guides", &guides, py::arg("like"), py::arg("scene") = py::none(), py::kw_only(),
             py::arg("volume") = py::none(), py::arg("samples") = py::none(), py::arg("output") = py::none(),
             py::arg("threads") = 0, py::arg("progress") = py::none(), help(embedded::help_guides_txt).c_str());
}

}  // namespace brume::python
