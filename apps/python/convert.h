#pragma once
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <string>
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
/// The same; empty for None.
std::string to_optional_path(py::handle path);
/// camera__fov as the command line's "camera.fov".
std::string to_key(py::handle keyword);
/// Whether it is a str, bytes or os.PathLike.
bool is_path(py::handle value);
/// Whether it is a list or tuple of frames: Layers, mappings, pictures, paths.
bool is_sequence_of_frames(py::handle value);
/// A number, bool, str, path or list as it stands in a TOML file.
/// @throws py::type_error for what has no place there
std::string to_toml_value(py::handle value);
/// The same; a str is bare.
std::string to_toml(py::handle value);
std::string to_toml_key(const std::string& key);
/// "numpy.ndarray", for errors.
std::string type_name(py::handle value);
/// "2 x 3", for errors.
std::string shape_of(const py::array& array);
/// For a handler of what Python code raised: raises again what no error of input may hide, want of memory and what is
/// no Exception, such as KeyboardInterrupt.
void let_through(py::error_already_set& error);
/// @param what  as errors call it: "layers['R']"
/// @throws InputError for what is no array, or has more than 2^31 - 1 rows along an axis; py::type_error for one whose
///         values are not real numbers
py::array to_real_array(const std::string& what, py::handle value);

// Arguments by their names. @throws InputError that names the argument, what is expected and what was found

/// A whole number. @param highest  2^63 - 1: no limit that errors speak of
int64_t to_whole_number(const std::string& name, py::handle value, int64_t lowest, int64_t highest);
int to_int(const std::string& name, py::handle value, int lowest, int highest);
/// A finite number above 0. @param or_zero  0 is one too
double to_positive(const std::string& name, py::handle value, bool or_zero = false);
/// True or False, of NumPy too. @param expected  of the argument, in words
bool to_bool(const std::string& name, py::handle value, const char* expected = "True or False");
/// As many whole numbers as `form`, "(i, n)", has names.
std::vector<int> to_ints(const std::string& name, py::handle values, const std::string& form);

/// Words of a str with commas, or of any iterable of str.
std::vector<std::string> to_words(const py::object& value);
/// camera__fov=30 as the command line's "camera.fov=30"; None leaves a key as it is.
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
