#pragma once
#include <pybind11/pybind11.h>

#include <string>
#include <string_view>

namespace brume::python {

/// A docstring that is a file of apps/python/help/.
inline std::string help(std::string_view file) {
  return std::string(file.substr(0, file.size() - 1));
}

// Each adds a part of the package to its module: a file of that name. What the package offers under its own name, its
// signatures and its stubs follow from what stands in the module (brume/__init__.py, describe.py).

void bind_layers(pybind11::module_& module);
void bind_files(pybind11::module_& module);
void bind_scene(pybind11::module_& module);
void bind_render(pybind11::module_& module);
void bind_guides(pybind11::module_& module);
void bind_merge(pybind11::module_& module);
void bind_mix(pybind11::module_& module);
void bind_denoise(pybind11::module_& module);
void bind_compare(pybind11::module_& module);
void bind_evaluate(pybind11::module_& module);
void bind_view(pybind11::module_& module);

}  // namespace brume::python
