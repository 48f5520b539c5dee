#include <fmt/format.h>

#include <memory>
#include <utility>
#include <vector>

#include "apps/python/bindings.h"
#include "apps/python/convert.h"
#include "apps/view/server.h"
#include "base/sequence.h"
#include "help_view_txt.h"

namespace brume::python {
namespace {

/// The servers of this process, ended with the interpreter. For who holds Python's lock.
std::vector<std::unique_ptr<web::Server>>& servers() {
  static auto* const all = new std::vector<std::unique_ptr<web::Server>>;
  return *all;
}

std::string view(const py::object& scene, const py::object& frames, int threads, const py::kwargs& keywords) {
  ViewOptions options;
  options.scene = to_path(scene);
  options.overrides = to_overrides(keywords);
  if (!frames.is_none()) options.frames = parse_frames(to_text(frames));
  if (threads < 0)
    throw InputError(fmt::format("threads: expected 0 (all of the machine's) or more, found {}", threads));
  Host host;
  host.threads = threads;
  std::unique_ptr<web::Server> server;
  {
    const py::gil_scoped_release others_may_run;
    check_viewable(options);
    server = std::make_unique<web::Server>(options, web::ServerOptions{}, host);
  }
  servers().push_back(std::move(server));
  return servers().back()->address();
}

}  // namespace

void bind_view(py::module_& module) {
  module.def("view", &view, py::arg("scene"), py::kw_only(), py::arg("frames") = py::none(), py::arg("threads") = 0,
             help(embedded::help_view_txt).c_str());
  py::module_::import("atexit").attr("register")(py::cpp_function([] {
    std::vector<std::unique_ptr<web::Server>> all = std::move(servers());
    const py::gil_scoped_release others_may_run;
    all.clear();
  }));
}

}  // namespace brume::python
