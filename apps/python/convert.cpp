#include "apps/python/convert.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/toml_text.h"
#include "render/transport/path_sample.h"

namespace brume::python {
namespace {

using Array = py::array_t<float, py::array::c_style | py::array::forcecast>;

/// The full names of the channels of an array height x width x channels.
std::vector<std::string> channels_of(const std::string& name, py::ssize_t count) {
  const std::string key = name == layer::beauty.label() ? "" : name;
  for (const RecordedLayer& recorded : recordable_layers()) {
    const std::string own(recorded.name.name);
    const bool same = key == own || key.starts_with(own + ".");
    if (same && static_cast<py::ssize_t>(recorded.name.channels.size()) == count)
      return LayerName{key, recorded.name.channels, ""}.channel_names();
  }
  const char* const letters[] = {"Y", "", "RGB", "RGBA"};
  if (count < 1 || count > 4 || count == 2)
    throw InputError(fmt::format("layers['{}']: expected 1, 3 or 4 channels, found {}", name, count));
  return LayerName{key, letters[count - 1], ""}.channel_names();
}

/// What arguments are called where they are not what is expected.
[[noreturn]] void refuse(const std::string& name, const std::string& expected, py::handle found) {
  throw InputError(fmt::format("{}: expected {}, found {}", name, expected, to_text(py::repr(found))));
}

/// A finite number; NaN for anything else. A str is none.
double finite_number(py::handle value) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (PyUnicode_Check(value.ptr()) || PyBytes_Check(value.ptr())) return kNone;
  try {
    const double number = PyFloat_AsDouble(value.ptr());
    if (PyErr_Occurred()) throw py::error_already_set();
    return std::isfinite(number) ? number : kNone;
  } catch (py::error_already_set& error) {
    let_through(error);
    return kNone;
  }
}

void copy_rows(Plane& plane, const float* from, size_t step, size_t row_step) {
  for (int y = 0; y < plane.height(); ++y) {
    const float* const row = from + static_cast<size_t>(y) * row_step;
    const auto pixels = plane.pixels(y);
    if (step == 1)
      std::memcpy(pixels.data(), row, pixels.size_bytes());
    else
      for (size_t x = 0; x < pixels.size(); ++x) pixels[x] = row[x * step];
  }
}

}  // namespace

py::str to_str(std::string_view text) {
  PyObject* const result = PyUnicode_DecodeUTF8(text.data(), static_cast<py::ssize_t>(text.size()), "surrogateescape");
  if (!result) throw py::error_already_set();
  return py::reinterpret_steal<py::str>(result);
}

std::string to_text(py::handle text) {
  if (!PyUnicode_Check(text.ptr()))
    throw py::type_error("expected a str, found " + std::string(Py_TYPE(text.ptr())->tp_name));
  const auto bytes =
      py::reinterpret_steal<py::bytes>(PyUnicode_AsEncodedString(text.ptr(), "utf-8", "surrogateescape"));
  if (!bytes) throw py::error_already_set();
  return bytes;
}

std::string to_path(py::handle path) {
  PyObject* bytes = nullptr;
  if (!PyUnicode_FSConverter(path.ptr(), &bytes)) throw py::error_already_set();
  return py::reinterpret_steal<py::bytes>(bytes);
}

std::string to_optional_path(py::handle path) {
  return path.is_none() ? "" : to_path(path);
}

bool is_path(py::handle value) {
  return PyUnicode_Check(value.ptr()) || PyBytes_Check(value.ptr()) || py::hasattr(value, "__fspath__");
}

bool is_sequence_of_frames(py::handle value) {
  if (!PyList_Check(value.ptr()) && !PyTuple_Check(value.ptr())) return false;
  const auto frames = py::reinterpret_borrow<py::sequence>(value);
  if (frames.size() == 0) return false;
  const py::object first = frames[0];
  return is_path(first) || (PyMapping_Check(first.ptr()) && py::hasattr(first, "items")) ||
         (py::isinstance<py::array>(first) && py::reinterpret_borrow<py::array>(first).ndim() == 3);
}

std::string type_name(py::handle value) {
  return to_text(py::str(py::type::handle_of(value).attr("__name__")));
}

std::string shape_of(const py::array& array) {
  std::vector<std::string> sizes;
  for (py::ssize_t i = 0; i < array.ndim(); ++i) sizes.push_back(std::to_string(array.shape(i)));
  return sizes.empty() ? "a single number" : join(sizes, " x ");
}

void let_through(py::error_already_set& error) {
  if (!error.matches(PyExc_Exception) || error.matches(PyExc_MemoryError)) throw py::error_already_set(error);
}

py::array to_real_array(const std::string& what, py::handle value) {
  py::array given;
  bool is_array = !PyUnicode_Check(value.ptr());
  try {
    if (is_array) given = py::array(py::reinterpret_borrow<py::object>(value));
  } catch (py::error_already_set& error) {
    let_through(error);
    is_array = false;
  }
  if (!is_array) throw InputError(fmt::format("{}: expected an array of numbers, found {}", what, type_name(value)));
  for (py::ssize_t i = 0; i < given.ndim(); ++i)
    if (given.shape(i) > std::numeric_limits<int>::max())
      throw InputError(fmt::format("{}: expected at most {} rows along an axis, found {}", what,
                                   std::numeric_limits<int>::max(), shape_of(given)));
  if (std::string_view("biuf").find(given.dtype().kind()) == std::string_view::npos)
    throw py::type_error(
        fmt::format("{}: expected real numbers, found {}", what, to_text(py::str(given.dtype().attr("name")))));
  return given;
}

int64_t to_whole_number(const std::string& name, py::handle value, int64_t lowest, int64_t highest) {
  const std::string range = highest == std::numeric_limits<int64_t>::max() ? fmt::format("{} or more", lowest)
                                                                           : fmt::format("{} .. {}", lowest, highest);
  try {
    if (!PyIndex_Check(value.ptr())) refuse(name, "a whole number, " + range, value);
    const auto whole = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
    if (!whole) throw py::error_already_set();
    int overflow = 0;
    const int64_t number = PyLong_AsLongLongAndOverflow(whole.ptr(), &overflow);
    if (overflow != 0 || number < lowest || number > highest) refuse(name, range, value);
    return number;
  } catch (py::error_already_set& error) {
    let_through(error);
  }
  refuse(name, "a whole number, " + range, value);  // an array of NumPy of other numbers
}

int to_int(const std::string& name, py::handle value, int lowest, int highest) {
  return static_cast<int>(to_whole_number(name, value, lowest, highest));
}

double to_positive(const std::string& name, py::handle value, bool or_zero) {
  const double number = finite_number(value);
  if (!(number > 0 || (or_zero && number == 0)))
    refuse(name, or_zero ? "a number of 0 or more" : "a number above 0", value);
  return number;
}

bool to_bool(const std::string& name, py::handle value, const char* expected) {
  py::detail::make_caster<bool> caster;
  if (!caster.load(value, /*convert=*/false)) refuse(name, expected, value);
  return py::detail::cast_op<bool>(caster);
}

std::vector<int> to_ints(const std::string& name, py::handle values, const std::string& form) {
  const bool listed = py::isinstance<py::sequence>(values) || py::isinstance<py::array>(values);
  std::vector<int> numbers;
  if (listed && !PyUnicode_Check(values.ptr()) && !PyBytes_Check(values.ptr()))
    for (const py::handle value : values)
      numbers.push_back(to_int(name, value, std::numeric_limits<int>::min(), std::numeric_limits<int>::max()));
  if (numbers.size() != split(form, ',').size()) refuse(name, form, values);
  return numbers;
}

std::string to_key(py::handle keyword) {
  std::string name = to_text(keyword);
  for (size_t at = 0; (at = name.find("__", at)) != std::string::npos;) name.replace(at, 2, ".");
  return name;
}

std::string to_toml_key(const std::string& key) {
  const bool bare = !key.empty() && std::all_of(key.begin(), key.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-';
  });
  return bare ? key : to_toml_value(to_str(key));
}

std::string to_toml_value(py::handle value) {
  if (PyUnicode_Check(value.ptr())) return toml_string(to_text(value));
  if (py::hasattr(value, "__fspath__")) return toml_string(to_path(value));
  if (py::hasattr(value, "tolist")) return to_toml_value(value.attr("tolist")());  // of NumPy
  if (PyBool_Check(value.ptr())) return value.ptr() == Py_True ? "true" : "false";
  if (PyIndex_Check(value.ptr())) return to_text(py::str(value));
  if (PyFloat_Check(value.ptr())) return to_text(py::str(py::float_(py::reinterpret_borrow<py::object>(value))));
  if (PyDict_Check(value.ptr())) {  // a table in a table, such as time of a volume
    std::vector<std::string> entries;
    for (const auto& [key, entry] : py::reinterpret_borrow<py::dict>(value))
      if (!entry.is_none()) entries.push_back(to_toml_key(to_text(key)) + " = " + to_toml_value(entry));
    return "{" + join(entries) + "}";
  }
  if (!py::isinstance<py::sequence>(value) || PyBytes_Check(value.ptr()))
    throw py::type_error("expected a number, bool, str, path or a list of these for a key of a scene, found " +
                         type_name(value));
  std::vector<std::string> parts;
  for (const py::handle part : value) parts.push_back(to_toml_value(part));
  return "[" + join(parts) + "]";
}

std::string to_toml(py::handle value) {
  return PyUnicode_Check(value.ptr()) ? to_text(value) : to_toml_value(value);
}

std::vector<std::string> to_words(const py::object& value) {
  if (py::isinstance<py::str>(value)) {
    const std::string text = to_text(value);
    return text.empty() ? std::vector<std::string>() : split(text, ',');
  }
  std::vector<std::string> words;
  for (const py::handle word : value) words.push_back(to_text(word));
  return words;
}

std::vector<std::string> to_overrides(const py::kwargs& keywords) {
  std::vector<std::string> overrides;
  for (const auto& [key, value] : keywords) {
    if (!value.is_none()) overrides.push_back(to_key(key) + "=" + to_toml(value));
  }
  return overrides;
}

std::string to_exposure(const py::object& value) {
  if (py::isinstance<py::str>(value)) {
    const std::string text = to_text(value);
    if (text == "header" || text == "auto") return text;
  } else if (const double number = finite_number(value); number > 0) {
    return fmt::format("{}", number);
  }
  refuse("exposure", "header, auto or a number above 0", value);
}

py::object to_object(const Attribute& attribute) {
  if (const auto* text = std::get_if<std::string>(&attribute)) return to_str(*text);
  if (const auto* number = std::get_if<int>(&attribute)) return py::int_(*number);
  if (const auto* number = std::get_if<float>(&attribute)) return py::float_(static_cast<double>(*number));
  if (const auto* space = std::get_if<Chromaticities>(&attribute)) return py::array_t<float>({4, 2}, space->data());
  const auto& matrix = std::get<std::array<float, 16>>(attribute);
  return py::array_t<float>({4, 4}, matrix.data());
}

Attribute to_attribute(const std::string& key, py::handle value) {
  if (PyUnicode_Check(value.ptr())) return to_text(value);
  const std::string what = fmt::format("header['{}']", key);
  if (PyLong_Check(value.ptr()))
    return to_int(what, value, std::numeric_limits<int>::min(), std::numeric_limits<int>::max());
  if (PyFloat_Check(value.ptr())) return value.cast<float>();
  const Array array(to_real_array(what, value));
  if (array.size() == 8) {
    Chromaticities space{};
    std::copy_n(array.data(), 8, space.begin());
    return space;
  }
  if (array.size() != 16)
    throw InputError(fmt::format("{}: expected a str, a number, 4 x 4 numbers or 4 x 2 chromaticities, found {}", what,
                                 to_text(py::repr(value))));
  std::array<float, 16> matrix{};
  std::copy_n(array.data(), 16, matrix.begin());
  return matrix;
}

py::array_t<float> view_of(Plane& plane, py::handle owner) {
  const auto row = static_cast<py::ssize_t>(plane.stride() * sizeof(float));
  return py::array_t<float>({plane.height(), plane.width()}, {row, static_cast<py::ssize_t>(sizeof(float))},
                            plane.row(0), owner);
}

void copy_into(Plane& plane, const std::string& name, py::handle value) {
  const py::array given = to_real_array(fmt::format("layers['{}']", name), value);
  if (given.ndim() != 0 && (given.ndim() != 2 || given.shape(0) != plane.height() || given.shape(1) != plane.width()))
    throw InputError(fmt::format("layers['{}']: expected {} x {} (height x width), found {}", name, plane.height(),
                                 plane.width(), shape_of(given)));
  const Array array(given);
  if (array.ndim() == 0) {
    plane.fill(*array.data());
    return;
  }
  copy_rows(plane, array.data(), 1, static_cast<size_t>(plane.width()));
}

std::shared_ptr<Layers> to_layers(py::handle value) {
  if (py::isinstance<Layers>(value)) return value.cast<std::shared_ptr<Layers>>();
  py::dict arrays;
  if (PyMapping_Check(value.ptr()) && py::hasattr(value, "items"))
    arrays = py::dict(py::reinterpret_borrow<py::object>(value));
  else
    arrays["beauty"] = value;
  std::shared_ptr<Layers> layers;
  for (const auto& [key, entry] : arrays) {
    const std::string name = to_text(key);
    const Array array(to_real_array(fmt::format("layers['{}']", name), entry));
    if (array.ndim() != 2 && array.ndim() != 3)
      throw InputError(fmt::format(
          "layers['{}']: expected height x width for a channel, or height x width x channels for a layer, found {}",
          name, shape_of(array)));
    if (array.size() == 0) throw InputError(fmt::format("layers['{}']: has no pixels: {}", name, shape_of(array)));
    const auto height = static_cast<int>(array.shape(0)), width = static_cast<int>(array.shape(1));
    if (!layers) layers = std::make_shared<Layers>(width, height);
    if (height != layers->height() || width != layers->width())
      throw InputError(fmt::format("layers['{}']: {} x {} pixels, the layers before it have {} x {}", name, height,
                                   width, layers->height(), layers->width()));
    if (array.ndim() == 2) {
      copy_rows(layers->add(name), array.data(), 1, static_cast<size_t>(width));
      continue;
    }
    const auto count = static_cast<size_t>(array.shape(2));
    const std::vector<std::string> channels = channels_of(name, array.shape(2));
    for (size_t c = 0; c < count; ++c)
      copy_rows(layers->add(channels[c]), array.data() + c, count, count * static_cast<size_t>(width));
  }
  if (!layers) throw InputError("no layers: expected at least one channel");
  return layers;
}

}  // namespace brume::python
