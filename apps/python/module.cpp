// The extension module brume._brume; apps/python/brume/__init__.py gives it to Python.

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "base/error.h"
#include "image/exr_io.h"
#include "workflows/version.h"

namespace brume::python {
namespace {

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
  bind_files(module);
  bind_scene(module);
  bind_render(module);
  bind_guides(module);
  bind_merge(module);
  bind_mix(module);
  bind_denoise(module);
  bind_compare(module);
  bind_evaluate(module);
  bind_view(module);
}

}  // namespace brume::python
