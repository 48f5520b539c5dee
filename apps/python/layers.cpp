#include <fmt/format.h>
#include <pybind11/stl.h>

#include <array>
#include <memory>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "filters/api/requirements.h"
#include "image/cryptomatte.h"
#include "image/light_layers.h"

namespace brume::python {
namespace {

/// @throws py::key_error naming the nearest channel
Plane& channel_of(Layers& layers, const std::string& name) {
  if (Plane* const plane = layers.find(name)) return *plane;
  const std::vector<std::string> names = layers.names();
  throw py::key_error(fmt::format("no channel '{}'{}", name, suggestion(name, names)));
}

std::map<std::string, Attribute> to_header(const py::dict& dict) {
  std::map<std::string, Attribute> header;
  for (const auto& [key, value] : dict) header[to_text(key)] = to_attribute(to_text(key), value);
  return header;
}

py::tuple state_of(const py::object& self) {
  const auto& frame = self.cast<const Layers&>();
  const auto pair = [](const ivec2& v) { return py::make_tuple(v.x, v.y); };
  py::dict words;  // the sums of a part's samples
  for (const auto& [name, values] : frame.words())
    words[to_str(name)] = py::array_t<uint32_t>(static_cast<py::ssize_t>(values.size()), values.data());
  return py::make_tuple(py::dict(self.attr("items")()), self.attr("header"), pair(frame.origin), pair(frame.display),
                        pair(frame.display_origin), words);
}

std::shared_ptr<Layers> layers_of_state(const py::tuple& state) {
  const std::shared_ptr<Layers> frame = to_layers(state[0]);
  frame->header = to_header(state[1]);
  const auto pair = [&](size_t i) {
    const auto [x, y] = state[i].cast<std::array<int, 2>>();
    return ivec2(x, y);
  };
  frame->origin = pair(2);
  frame->display = pair(3);
  frame->display_origin = pair(4);
  for (const auto& [name, values] : py::dict(state[5])) {
    const auto array = values.cast<py::array_t<uint32_t, py::array::c_style>>();
    frame->add_words(to_text(name)).assign(array.data(), array.data() + array.size());
  }
  return frame;
}

std::shared_ptr<Layers> make_layers(const py::object& channels, const py::object& header, const py::object& like) {
  const std::shared_ptr<Layers> given = to_layers(channels);
  auto layers = py::isinstance<Layers>(channels) ? std::make_shared<Layers>(*given) : given;
  if (!like.is_none()) {
    if (!py::isinstance<Layers>(like))
      throw InputError(fmt::format("like: expected brume.Layers, found {}", type_name(like)));
    const auto& other = *like.cast<std::shared_ptr<Layers>>();
    if (other.width() != layers->width() || other.height() != layers->height())
      throw InputError(fmt::format("like: has {} x {} pixels (height x width), the channels have {} x {}",
                                   other.height(), other.width(), layers->height(), layers->width()));
    layers->lie_like(other);
    layers->header = other.header;
  }
  if (!header.is_none()) layers->header = to_header(header);
  return layers;
}

/// A layer as an array of height x width x channels, a copy: its channels lie apart.
py::array_t<float> image_of(const Layers& layers, const std::string& layer, const std::string& statistic) {
  const std::string name = layer == layer::beauty.label() ? "" : layer;
  std::vector<const Plane*> planes;
  for (const char* letters : {"RGB", "XYZ", "A", "Y", "Z"}) {
    const LayerName wanted{name, letters, ""};
    if (!layers.has(wanted, statistic)) continue;
    for (const std::string& channel : wanted.channel_names(statistic)) planes.push_back(&layers.at(channel));
    break;
  }
  if (planes.empty()) {
    const std::vector<std::string> names = layer_names(layers);
    throw py::key_error(fmt::format("no layer '{}'{}{}", layer, statistic.empty() ? "" : " with " + statistic,
                                    suggestion(layer, names)));
  }
  py::array_t<float> image({static_cast<size_t>(layers.height()), static_cast<size_t>(layers.width()), planes.size()});
  float* to = image.mutable_data();
  for (int y = 0; y < layers.height(); ++y)
    for (int x = 0; x < layers.width(); ++x)
      for (const Plane* plane : planes) *to++ = (*plane)(x, y);
  return image;
}

py::array_t<float> array_of(const Plane& plane) {
  py::array_t<float> array({static_cast<size_t>(plane.height()), static_cast<size_t>(plane.width())});
  float* to = array.mutable_data();
  for (int y = 0; y < plane.height(); ++y) to = std::copy_n(plane.row(y), plane.width(), to);
  return array;
}

/// What things cover of each pixel. @throws InputError
py::array_t<float> matte_in(const Layers& layers, const py::args& names, const std::string& layer) {
  std::vector<std::string> wanted;
  for (const py::handle name : names) wanted.push_back(to_text(name));
  if (wanted.empty()) throw InputError("matte: expected names of things, as mattes() lists them");
  return array_of(matte_of(layers, matte_layers(layers.header, layers.names()), wanted, layer));
}

py::dict mattes_of(const Layers& layers) {
  py::dict all;
  for (const MatteLayer& layer : matte_layers(layers.header, layers.names())) {
    py::list names;
    for (const auto& [name, id] : layer.manifest) names.append(to_str(name));
    all[to_str(layer.name)] = names;
  }
  return all;
}

py::tuple window(const PixelWindow& w) {
  return py::make_tuple(w.lo.x, w.lo.y, w.hi.x, w.hi.y);
}

using LayersType = py::class_<Layers, std::shared_ptr<Layers>>;

/// What makes it a mapping.
void bind_channels(LayersType& type) {
  type.def("__getitem__", [](const py::object& self, const std::string& name) {
    return view_of(channel_of(self.cast<Layers&>(), name), self);
  });
  type.def("__setitem__", [](Layers& self, const std::string& name, const py::object& array) {
    if (Plane* const plane = self.find(name)) return copy_into(*plane, name, array);
    Plane plane(self.width(), self.height());
    copy_into(plane, name, array);
    self.set(name, std::move(plane));
  });
  type.def("__contains__", [](const Layers& self, const std::string& name) { return self.find(name) != nullptr; });
  type.def("__contains__", [](const Layers&, const py::object&) { return false; });
  type.def("__len__", [](const Layers& self) { return self.channels().size(); });
  type.def("__iter__", [](const py::object& self) { return py::iter(self.attr("keys")()); });
  type.def(
      "keys",
      [](const Layers& self) {
        py::list names;
        for (const auto& [name, plane] : self.channels()) names.append(to_str(name));
        return names;
      },
      "Full names of the channels, in alphabetical order.");
  type.def(
      "values",
      [](const py::object& self) {
        py::list views;
        for (const py::handle name : self.attr("keys")()) views.append(self[py::reinterpret_borrow<py::object>(name)]);
        return views;
      },
      "Views of the channels, in the order of keys().");
  type.def(
      "items",
      [](const py::object& self) {
        return py::list(py::module_::import("builtins").attr("zip")(self.attr("keys")(), self.attr("values")()));
      },
      "Pairs of name and view.");
  type.def(
      "get",
      [](const py::object& self, const std::string& name, const py::object& otherwise) -> py::object {
        Plane* const plane = self.cast<Layers&>().find(name);
        return plane ? view_of(*plane, self) : otherwise;
      },
      py::arg("name"), py::arg("default") = py::none(), "The view of a channel, or `default` where there is none.");
}

}  // namespace

void bind_layers(py::module_& module) {
  LayersType type(
      module, "Layers",
      "A frame: named float32 channels of one size, and a header.\n\n"
      "A mapping from full channel names (\"R\", \"direct.mean_variance.G\") to arrays of height x width. The arrays are\n"
      "views of the frame's own memory, not copies, and keep it alive; their rows are padded, so that they are not\n"
      "contiguous. Assigning to a channel copies the values into its memory, which older views go on to show.");
  type.def(
      py::init(&make_layers), py::arg("channels"), py::kw_only(), py::arg("header") = py::none(),
      py::arg("like") = py::none(),
      "Copies a mapping of arrays: height x width for a channel, height x width x channels for a layer.\n\n"
      "header: str, int, float and 4 x 4 matrices by name. like: a frame whose header and windows are taken over.");
  bind_channels(type);
  type.def("image", &image_of, py::arg("layer") = "", py::arg("statistic") = "",
           "A layer as an array of height x width x channels, a copy; the beauty without a name.\n\n"
           "statistic: mean_variance, half_a, half_b or bucket_0 .. bucket_7.");
  type.def(
      "light",
      [](const Layers& self, const std::string& group) {
        const bool clean = self.find(clean_light_layer(group) + ".R") != nullptr;
        return image_of(self, clean ? clean_light_layer(group) : light_layer(group), "");
      },
      py::arg("group"),
      "The light of a light group as an array of height x width x 3, a copy; clean where the frame is.");
  type.def(
      "matte", &matte_in, py::arg("layer") = "",
      "The share of each pixel that things cover, together, as an array of height x width, from the frame's\n"
      "Cryptomatte: names as mattes() lists them, * stands for anything.\n\n"
      "layer: \"CryptoObject\" or \"CryptoMaterial\", where both have a thing of that name. Raises InputError for a\n"
      "frame without Cryptomatte, or without such a thing.");
  type.def("mattes", &mattes_of, "Names of the things in each Cryptomatte layer of the frame, by the layer's name.");
  type.def(
      "layers", [](const Layers& self) { return layer_names(self); }, "Names of the layers, without statistics.");
  type.def(
      "copy", [](const Layers& self) { return std::make_shared<Layers>(self); }, "A frame with memory of its own.");
  type.def("__copy__", [](const Layers& self) { return std::make_shared<Layers>(self); });
  type.def("__deepcopy__", [](const Layers& self, const py::dict&) { return std::make_shared<Layers>(self); });
  type.def(py::pickle(&state_of, &layers_of_state));
  type.def_property_readonly("width", &Layers::width, "[px]");
  type.def_property_readonly("height", &Layers::height, "[px]");
  type.def_property_readonly(
      "shape", [](const Layers& self) { return py::make_tuple(self.height(), self.width()); }, "(height, width) [px]");
  type.def_property_readonly(
      "data_window", [](const Layers& self) { return window(self.data_window()); },
      "Where the pixels lie in the picture that is shown: (x0, y0, x1, y1), the last two exclusive.");
  type.def_property_readonly(
      "display_window", [](const Layers& self) { return window(self.display_window()); },
      "The picture that is shown, likewise.");
  type.def_property(
      "header",
      [](const Layers& self) {
        py::dict header;
        for (const auto& [key, value] : self.header) header[to_str(key)] = to_object(value);
        return header;
      },
      [](Layers& self, const py::dict& header) { self.header = to_header(header); },
      "What the file's header says, by name, as a copy: assign a dict to change it.");
  type.def("__repr__", [](const Layers& self) {
    return to_str(fmt::format("<brume.Layers {} x {} (height x width): {}>", self.height(), self.width(),
                              join(layer_names(self))));
  });
  py::module_::import("collections.abc").attr("Mapping").attr("register")(type);
}

}  // namespace brume::python
