#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/text.h"
#include "image/layers.h"

namespace brume::python {

namespace py = pybind11;
using LayersPointer = std::shared_ptr<Layers>;

/// Text of a file as Python's str, bytes that are no UTF-8 escaped as Python does it for file names.
py::str to_str(std::string_view text);
/// The other way round. @throws py::type_error for what is no str
std::string to_text(py::handle text);
/// A path: str, bytes or os.PathLike. @throws py::type_error
std::string to_path(py::handle path);
/// A number, bool, str or list as it stands in a TOML file; a str is bare.
std::string to_toml(py::handle value);

/// Words of a str with commas, or of any iterable of str.
std::vector<std::string> to_words(const py::object& value);
/// camera__fov=30 as the command line's "camera.fov=30".
std::vector<std::string> to_overrides(const py::kwargs& keywords);
/// "header", "auto" or a number above 0, as choose_exposure takes it. @throws InputError
std::string to_exposure(const py::object& value);

py::object to_object(const Attribute& attribute);
/// @throws InputError for what a header cannot hold
Attribute to_attribute(const std::string& key, py::handle value);

/// A plane as a writable array of height x width that looks into it. @param owner  keeps the plane alive
py::array_t<float> view_of(Plane& plane, py::handle owner);
/// Copies an array into a plane, whose rows are padded. @throws InputError for another shape
void copy_into(Plane& plane, const std::string& name, py::handle array);

/// The layers that an argument means: a Layers object itself, or a copy of a mapping of names to arrays, height x width
/// for a channel, height x width x channels for a layer. @throws InputError
LayersPointer to_layers(py::handle layers);

}  // namespace brume::python
