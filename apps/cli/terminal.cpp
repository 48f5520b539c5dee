#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "apps/cli/command.h"
#include "base/sequence.h"
#include "base/text.h"

namespace brume::app {
namespace {

/// Shows a finished fraction with the time left: a bar on a terminal, a line per tenth elsewhere, JSON for machines.
class ProgressLine {
 public:
  ProgressLine(std::string label, std::string style) : label_(std::move(label)), style_(std::move(style)) {
    if (style_ == "auto") style_ = isatty(STDERR_FILENO) ? "bar" : "lines";
  }
  void update(double fraction) {
    const double elapsed = watch_.seconds();
    // The pace is that since the first report: what came before it was preparation.
    if (fraction < first_fraction_) first_fraction_ = fraction, first_seconds_ = elapsed;
    const double pace = (fraction - first_fraction_) / (1 - first_fraction_);
    const std::string left = fraction < 1 ? time_left(pace, elapsed - first_seconds_) : "";
    if (style_ == "json") {
      if (fraction < 1 && elapsed - last_ < 0.2) return;
      last_ = elapsed;
      nlohmann::json line = {
          {"stage", label_}, {"progress", fraction}, {"seconds", elapsed}, {"seconds_left", nullptr}};
      if (fraction >= 1)
        line["seconds_left"] = 0.0;
      else if (pace > 0)
        line["seconds_left"] = (elapsed - first_seconds_) * (1 - pace) / pace;
      std::fputs((line.dump() + "\n").c_str(), stderr);
    } else if (style_ == "bar") {
      if (fraction < 1 && elapsed - last_ < 0.1) return;
      last_ = elapsed;
      constexpr int kWidth = 30;
      const int filled = static_cast<int>(fraction * kWidth);
      const std::string tail = fraction >= 1 ? format_duration(elapsed) : left.empty() ? "" : left + " left";
      std::fputs(fmt::format("\r{:<44} [{:#<{}}{:.<{}}] {:3.0f} %  {:<16}{}", label_, "", filled, "", kWidth - filled,
                             100 * fraction, tail, fraction >= 1 ? "\n" : "")
                     .c_str(),
                 stderr);
    } else if (style_ == "lines") {
      const int tenth = static_cast<int>(std::floor(fraction * 10 + 1e-9));
      if (fraction * 10 < tenth_ - 0.5) tenth_ = tenth - 1;  // more is to do than was thought
      if (tenth <= tenth_ || (elapsed < 2 && fraction < 1)) return;
      tenth_ = tenth;
      std::fputs(fmt::format("brume: {}: {} %{}\n", label_, tenth * 10,
                             fraction >= 1  ? ", " + format_duration(elapsed)
                             : left.empty() ? ""
                                            : ", " + left + " left")
                     .c_str(),
                 stderr);
    }
    std::fflush(stderr);
  }

 private:
  std::string label_, style_;
  Stopwatch watch_;
  double last_ = -1, first_fraction_ = 2, first_seconds_ = 0;
  int tenth_ = -1;
};

int output_error = 0;  // errno of the first thing that could not be printed

void tell(const Common& common, const Host::Update& update) {
  if (common.progress == "json") {
    nlohmann::json line = {{"picture", update.picture.string()}, {"number", update.number},
                           {"samples", update.samples},          {"error", nullptr},
                           {"seconds", update.seconds},          {"last", update.last}};
    if (update.error) line["error"] = *update.error;
    std::fputs((line.dump() + "\n").c_str(), stderr);
    std::fflush(stderr);
    return;
  }
  log(common, fmt::format("{}: {:.4g} samples per pixel{}", update.picture.string(), update.samples,
                          update.error ? fmt::format(", estimated relative error {:.4g}", *update.error) : ""));
}

}  // namespace

std::atomic<bool> interrupted{false};

void stop_with_stdin() {
  constexpr auto kOrderlyEnd = std::chrono::seconds(10);  // after stdin has closed; then the process is ended
  std::thread([=] {
    std::array<char, 256> ignored{};
    while (true) {
      const ssize_t got = read(STDIN_FILENO, ignored.data(), ignored.size());
      if (got == 0 || (got < 0 && errno != EINTR)) break;
    }
    interrupted = true;
    std::this_thread::sleep_for(kOrderlyEnd);
    std::_Exit(kInterrupted);
  }).detach();
}

Task make_task(const Common& common, const std::string& label) {
  Task task{common.threads, {}, &interrupted};
  const bool silent = common.progress == "none" || (common.quiet && common.progress == "auto");
  if (!silent)
    task.progress = [line = std::make_shared<ProgressLine>(label, common.progress)](double f) { line->update(f); };
  return task;
}

Host make_host(const Common& common) {
  Host host{common.threads, &interrupted};
  host.tell = [&common](Host::Word word, const std::string& text) {
    switch (word) {
      case Host::Word::kLog:
        return log(common, text);
      case Host::Word::kRemark:
        return common.quiet ? void() : note(text);
      case Host::Word::kNote:
        return note(text);
      case Host::Word::kMessage:
        return warn(text);
      case Host::Word::kWarning:
        return warn("warning: " + text);
    }
  };
  host.progress = [&common](const std::string& stage) { return make_task(common, stage).progress; };
  host.wrote = [](const std::filesystem::path& file) { print(file.string() + "\n"); };
  host.updated = [&common](const Host::Update& update) { tell(common, update); };
  return host;
}

int status_of(FrameEnd end) {
  return end == FrameEnd::kMissed ? kThresholdFailed : kDone;
}

int status_of(const SequenceEnd& end) {
  return end.well() ? kDone : kThresholdFailed;
}

Verb add_command(CLI::App& app, Common& common, const std::string& name, const std::string& description) {
  const Verb command{app.add_subcommand(name, description)};
  command("--threads", common.threads, "threads to use; 0: all")->check(CLI::Range(0, 4096))->group("Common");
  command("-q,--quiet", common.quiet, "errors and warnings only on stderr")->group("Common");
  command("--stop-with-stdin", common.stop_with_stdin,
          "end, as at Ctrl-C, once stdin is closed: for programs that start this one and must not leave it behind")
      ->group("Common");
  command("--progress", common.progress, "progress on stderr")
      ->check(CLI::IsMember({"auto", "bar", "lines", "json", "none"}))
      ->group("Common");
  return command;
}

void log(const Common& common, const std::string& text) {
  if (common.quiet) return;
  for (const std::string& line : split(text, '\n'))
    if (!line.empty()) warn(line);
}
void warn(const std::string& text) {
  std::fputs(("brume: " + text + "\n").c_str(), stderr);
}
void note(const std::string& text) {
  static std::set<std::string> told;
  if (told.insert(text).second) warn("note: " + text);
}
void print(const std::string& text) {
  if (std::fputs(text.c_str(), stdout) == EOF && output_error == 0) output_error = errno;
}

bool print_now() {
  if (std::fflush(stdout) != 0 && output_error == 0) output_error = errno;
  return output_error == 0;
}

void open_streams() {
  // A file that is opened while one of the three is closed would take its number, and what is printed.
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (fcntl(stream, F_GETFD) < 0) open("/dev/null", stream == STDOUT_FILENO ? O_RDONLY : O_RDWR);
  std::signal(SIGPIPE, SIG_IGN);  // a reader who leaves is an error of that write
}

int close_output(int status) {
  if (std::fclose(stdout) != 0 && output_error == 0) output_error = errno;
  if (output_error == 0) return status;
  warn(fmt::format("stdout cannot be written: {}; what was printed is not complete", std::strerror(output_error)));
  return status == kInterrupted ? status : kBadInput;
}

}  // namespace brume::app
