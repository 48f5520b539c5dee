#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <thread>

#include "apps/cli/command.h"
#include "apps/cli/frame.h"
#include "apps/view/display_cube.h"
#include "apps/view/server.h"
#include "base/command.h"
#include "base/sequence.h"

namespace brume::app {
namespace {

struct Options {
  ViewOptions view;
  web::ServerOptions server;
  PictureOptions picture;  // its display alone
  std::string frames;
  bool open = false;
};

bool is_loopback(const std::string& host) {
  return host == "localhost" || host == "::1" || host.starts_with("127.");
}

int run(const Options& o, const Common& common) {
  ViewOptions view = o.view;
  view.frames = frames_or_all_of(view.scene, o.frames);
  check_viewable(view);
  if (!is_loopback(o.server.host))
    warn(
        fmt::format("--host {}: whoever on the network learns the address can look at the scene, change what is shown "
                    "and make this machine compute; nothing is encrypted",
                    o.server.host));
  web::ServerOptions serving = o.server;
  if (const std::optional<Display> display = o.picture.chosen_display()) serving.display_cube = web::cube_of(*display);
  const web::Server server(view, serving, make_host(common));
  print(server.address() + "\n");
  if (!print_now()) return kDone;  // nobody can learn the address; close_output says why
  if (const auto program = o.open ? find_program("xdg-open") : std::filesystem::path(); !program.empty())
    run_command({.program = program, .words = {"xdg-open", server.address()}, .supervised = false}, {});
  else if (o.open)
    note("--open: there is no xdg-open; open the address by hand");
  log(common, "Ctrl-C ends it");
  while (!interrupted) std::this_thread::sleep_for(std::chrono::milliseconds(50));
  return kDone;
}

}  // namespace

void add_view(CLI::App& app, Common& common, Commands& commands) {
  const auto options = std::make_shared<Options>();
  Options& o = *options;
  const Verb command = add_command(
      app, common, "view",
      "look at a volume or a scene in a browser: turn it, light it, edit it, and see it clean; or at frames: their layers, and their lights mixed");
  command("scene", o.view.scene, "scene file (TOML), an OpenVDB file, or a frame (EXR) with layers, of any program")
      ->required();
  command(
      "--frames", o.frames,
      "a time line of these: 1-48, 1-240x2, or several with commas between; names with ####, $F4 or %04d become each frame's, also the scene's and those in it. Of a scene whose name has such a place all that are there, unless said");
  command("-D", o.view.overrides, "set a key of the scene: -D camera.fov=30")->allow_extra_args(false);
  command("--clean-filter", o.view.clean_filter, "clean with this filter: NAME or NAME:parameter=value,...")
      ->capture_default_str();
  command("--map", o.view.map,
          "of frames: TOML file that says which layer of another renderer's frame plays which part");
  add_display_options(command, o.picture, "the page shows pictures");
  command("--host", o.server.host,
          "address to listen on; any but the loopback lets others look who learn the page's address")
      ->capture_default_str();
  command("--port", o.server.port, "port to listen on; 0: one that is free")->capture_default_str();
  command("--keep", o.server.keep, "go on rendering when the last page has been gone for a minute");
  command("--open", o.open, "open the page in the browser");
  commands[command] = [options, &common] { return run(*options, common); };
}

}  // namespace brume::app
