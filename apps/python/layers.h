#pragma once
#include <pybind11/pybind11.h>

namespace brume::python {

/// The class brume.Layers.
void bind_layers(pybind11::module_& module);

}  // namespace brume::python
