#pragma once
#include <atomic>
#include <functional>
#include <map>
#include <string>
#include <type_traits>

#include "apps/cli/cli11.h"
#include "base/progress.h"
#include "workflows/sequence.h"

namespace brume::app {

/// Set by Ctrl-C; every long computation looks at it.
extern std::atomic<bool> interrupted;

/// Options that every command has.
struct Common {
  int threads = 0;
  bool quiet = false;
  std::string progress = "auto";  ///< auto, bar, lines, json, none
  bool json = false;
  bool stop_with_stdin = false;
  std::string command;  ///< what the user typed, for tables
};

enum ExitStatus { kDone = 0, kThresholdFailed = 1, kBadInput = 2, kInterrupted = 3 };

/// A verb: its subcommand on the command line, and what it does once parsed.
using Commands = std::map<const CLI::App*, std::function<int()>>;

void add_info(CLI::App& app, Common& common, Commands& commands);
void add_generate(CLI::App& app, Common& common, Commands& commands);
void add_halve(CLI::App& app, Common& common, Commands& commands);
void add_render(CLI::App& app, Common& common, Commands& commands);
void add_view(CLI::App& app, Common& common, Commands& commands);
void add_guides(CLI::App& app, Common& common, Commands& commands);
void add_merge(CLI::App& app, Common& common, Commands& commands);
void add_flatten(CLI::App& app, Common& common, Commands& commands);
void add_matte(CLI::App& app, Common& common, Commands& commands);
void add_mix(CLI::App& app, Common& common, Commands& commands);
void add_submit(CLI::App& app, Common& common, Commands& commands);
void add_denoise(CLI::App& app, Common& common, Commands& commands);
void add_compare(CLI::App& app, Common& common, Commands& commands);
void add_evaluate(CLI::App& app, Common& common, Commands& commands);
void add_filters(CLI::App& app, Common& common, Commands& commands);
void add_docs(CLI::App& app, Common& common, Commands& commands);
void add_picture(CLI::App& app, Common& common, Commands& commands);

/// A verb on the command line: `verb("--spp", spp, "paths per pixel")` adds an option, or a flag where that is a bool.
struct Verb {
  CLI::App* app;
  operator CLI::App*() const { return app; }
  CLI::App* operator->() const { return app; }
  template <class T>
  CLI::Option* operator()(const std::string& names, T& value, const std::string& help) const {
    if constexpr (std::is_same_v<T, bool>)
      return app->add_flag(names, value, help);
    else
      return app->add_option(names, value, help);
  }
};

/// Adds a verb with the options that every command has.
Verb add_command(CLI::App& app, Common& common, const std::string& name, const std::string& description);

/// A task on the chosen threads that reports to the terminal and stops at Ctrl-C.
Task make_task(const Common& common, const std::string& label);
/// From now on this program is interrupted, as by Ctrl-C, once stdin has ended: the end of who started it closes that.
void stop_with_stdin();
/// The terminal, for workflows.
Host make_host(const Common& common);

int status_of(FrameEnd end);
int status_of(const SequenceEnd& end);

// Every line on stderr but a progress bar begins with "brume: ".

/// To stderr, unless --quiet.
void log(const Common& common, const std::string& text);
/// To stderr, always.
void warn(const std::string& text);
/// "note: ..." to stderr, always, but each text once only: not for every frame of a sequence.
void note(const std::string& text);
/// To stdout. Whether it got there, close_output tells.
void print(const std::string& text);
/// Hands on what was printed, for who waits for it. @return whether it got there
bool print_now();

/// Before anything is opened: closed streams stay what they are, with writes to stdout failing.
void open_streams();
/// After the last print. @return `status`, or kBadInput, with a message, where stdout could not be written
int close_output(int status);

}  // namespace brume::app
