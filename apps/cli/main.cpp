#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <sstream>
#include <system_error>

#include "apps/cli/arguments.h"
#include "apps/cli/command.h"
#include "base/error.h"
#include "base/peak_memory.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "workflows/version.h"

namespace CLI {

template Option* App::add_option<std::string>(std::string, std::string&, std::string);
template Option* App::add_option<std::vector<std::string>>(std::string, std::vector<std::string>&, std::string);
template Option* App::add_option<int>(std::string, int&, std::string);
template Option* App::add_option<double>(std::string, double&, std::string);
template Option* App::add_flag<bool>(std::string, bool&, std::string);

}  // namespace CLI

namespace brume::app {

namespace {

// The first signal asks for an orderly end, the next one is the system's and kills.
void on_interrupt(int signal) {
  interrupted = true;
  std::signal(signal, SIG_DFL);
}

int parse_error(const CLI::App& app, const CLI::ParseError& error, int argc, char** argv) {
  if (error.get_exit_code() == 0) {  // --help, --version
    std::ostringstream text;
    app.exit(error, text);
    print(text.str());
    return kDone;
  }
  std::string message = error.what();
  std::vector<std::string> verbs;
  for (const CLI::App* command : app.get_subcommands({})) verbs.push_back(command->get_name());
  if (argc > 1 && app.get_subcommands().empty() && argv[1][0] != '-')
    message = fmt::format("no command '{}'{}", argv[1], suggestion(argv[1], verbs));
  warn(message + " (--help tells what there is)");
  return kBadInput;
}

/// The words as a shell takes them, the program by its name alone.
std::string command_line(int argc, char** argv) {
  std::string text = "brume";
  for (int i = 1; i < argc; ++i) text += " " + shell_word(argv[i]);
  return text;
}

int run(int argc, char** argv) {
  CLI::App app("Renders OpenVDB smoke and clouds without bias, and removes Monte Carlo noise from media passes.",
               "brume");
  app.set_version_flag("--version", version_text());
  app.require_subcommand(1);
  app.get_formatter()->column_width(36);
  Common common;
  common.command = command_line(argc, argv);
  Commands commands;
  add_info(app, common, commands);
  add_generate(app, common, commands);
  add_halve(app, common, commands);
  add_render(app, common, commands);
  add_view(app, common, commands);
  add_guides(app, common, commands);
  add_merge(app, common, commands);
  add_mix(app, common, commands);
  add_flatten(app, common, commands);
  add_matte(app, common, commands);
  add_submit(app, common, commands);
  add_denoise(app, common, commands);
  add_compare(app, common, commands);
  add_evaluate(app, common, commands);
  add_filters(app, common, commands);
  add_docs(app, common, commands);
  add_picture(app, common, commands);
  read_integers_as_decimal(app);
  try {
    std::vector<std::string> words = arrange(app, {argv + 1, argv + argc});
    std::reverse(words.begin(), words.end());  // as CLI11 wants them
    app.parse(std::move(words));
  } catch (const CLI::ParseError& error) {
    return parse_error(app, error, argc, argv);
  } catch (const InputError& error) {
    warn(error.what());
    return kBadInput;
  }
  std::signal(SIGINT, on_interrupt);
  std::signal(SIGTERM, on_interrupt);
  std::signal(SIGHUP, on_interrupt);
  std::signal(SIGUSR1, on_interrupt);  // what farms send before a job's time is over
  std::signal(SIGXFSZ, SIG_IGN);       // a file that may not grow is an error of that write, with its message
  if (common.stop_with_stdin) stop_with_stdin();
  try {
    set_exr_threads(common.threads);
    return commands.at(app.get_subcommands().front())();
  } catch (const InputError& error) {
    warn(error.what());
    return kBadInput;
  } catch (const Interrupted& error) {
    warn(error.what());
    return kInterrupted;
  } catch (const OutOfMemory& error) {
    warn(error.what());
    return kBadInput;
  } catch (const std::bad_alloc&) {
    warn(fmt::format("{} for this; try a smaller picture or volume", kNotEnoughMemory));
    return kBadInput;
  } catch (const std::exception& error) {
    const auto* const system = dynamic_cast<const std::system_error*>(&error);
    warn(system && system->code() == std::errc::resource_unavailable_try_again
             ? fmt::format("no further thread can be started: {}, or a limit on processes", kNotEnoughMemory)
             : fmt::format("{}. This should have been caught earlier; please report it", error.what()));
    return kBadInput;
  }
}

}  // namespace
}  // namespace brume::app

int main(int argc, char** argv) {
  brume::keep_freed_memory();
  brume::app::open_streams();
  return brume::app::close_output(brume::app::run(argc, argv));
}
