#pragma once
#include <pybind11/stl.h>

#include "apps/python/scene.h"
#include "workflows/render_frame.h"

namespace brume::python {

/// brume.render, and Scene.render where `scene` is self.
py::object render(const py::object& scene, const py::object& spp, const py::object& seed, const py::object& layers,
                  bool statistics, bool buckets, const py::object& clean, const std::string& outliers,
                  const py::object& crop, const py::object& time, const py::object& target_error,
                  const py::object& part, const py::object& frames, bool fixed_seed, const py::object& output,
                  const py::object& png, const py::object& records, const py::object& deep, int deep_samples,
                  const py::object& checkpoint, double checkpoint_every, const py::object& resume,
                  const py::object& on_picture, int threads, const py::object& progress, const py::kwargs& keywords);

std::string render_help(bool of_scene);

/// Declares it for the module or a class. @param first  arguments before the keywords
template <class Target, class... First>
void add_render(Target& target, const std::string& help, const First&... first) {
  target.def("render", &render, first..., py::kw_only(), py::arg("spp") = py::none(), py::arg("seed") = py::none(),
             py::arg("layers") = py::none(), py::arg("statistics") = true, py::arg("buckets") = false,
             py::arg("clean") = false, py::arg("outliers") = "extreme", py::arg("crop") = py::none(),
             py::arg("time") = py::none(), py::arg("target_error") = py::none(), py::arg("part") = py::none(),
             py::arg("frames") = py::none(), py::arg("fixed_seed") = false, py::arg("output") = py::none(),
             py::arg("png") = py::none(), py::arg("records") = py::none(), py::arg("deep") = py::none(),
             py::arg("deep_samples") = 16, py::arg("checkpoint") = py::none(), py::arg("checkpoint_every") = 300.0,
             py::arg("resume") = py::none(), py::arg("on_picture") = py::none(), py::arg("threads") = 0,
             py::arg("progress") = py::none(), help.c_str());
}

/// @throws InputError
void set_layers(RenderOptions& options, const py::object& layers, bool statistics, bool buckets,
                const py::object& clean);
void set_spp(RenderOptions& options, const py::object& spp);
void set_source(RenderOptions& options, const SceneSource& source);
/// What became of the frames of a sequence: lists of their numbers under done, missed, skipped and failed.
py::dict to_dict(const SequenceEnd& end);

}  // namespace brume::python
