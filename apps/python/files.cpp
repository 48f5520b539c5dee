#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/python/work.h"
#include "base/output_file.h"
#include "help_read_txt.h"
#include "help_write_txt.h"
#include "image/exr_io.h"
#include "image/foreign.h"

namespace brume::python {
namespace {

LayersPointer read(const py::object& path, const py::object& channels, bool adopt) {
  const std::string file = to_path(path);
  std::optional<std::vector<std::string>> wanted;
  if (!channels.is_none()) wanted = to_words(channels);
  LayersPointer layers;
  run_work({}, 0, [&](const Work& work) {
    layers = std::make_shared<Layers>(read_exr(file, [&](const std::string& channel) {
      return !wanted || std::any_of(wanted->begin(), wanted->end(), [&](const std::string& name) {
        return channel == name || channel.starts_with(name + ".");
      });
    }));
    if (wanted && layers->channels().empty()) {
      std::vector<std::string> there;
      for (const ExrInfo::Channel& channel : read_exr_info(file).channels) there.push_back(channel.name);
      throw InputError(fmt::format("{}: no channel {}; it has: {}", file, join(*wanted), join(there)));
    }
    if (!adopt) return;
    const ExrInfo info = read_exr_info(file);
    if (const std::string recognised = adopt_foreign_layers(*layers, &info); !recognised.empty()) work.log(recognised);
  });
  return layers;
}

void write(const py::object& path, const py::object& layers) {
  const std::string file = to_path(path);
  const LayersPointer frame = to_layers(layers);
  run_work({}, 0, [&](const Work& work) {
    check_writable(file, {}, ".exr");
    write_exr(file, *frame, work.task);
  });
}

}  // namespace

void bind_files(py::module_& module) {
  module.def("read", &read, py::arg("path"), py::arg("channels") = py::none(), py::kw_only(), py::arg("adopt") = true,
             help(embedded::help_read_txt).c_str());
  module.def("write", &write, py::arg("path"), py::arg("layers"), help(embedded::help_write_txt).c_str());
}

}  // namespace brume::python
