#include "base/command.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <optional>
#include <random>

#include "base/descriptor.h"
#include "base/output_file.h"
#include "base/peak_memory.h"
#include "base/text.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

/// A pipe whose ends do not lie where a child's own descriptors go.
struct Pipe {
  std::optional<Descriptor> reading, writing;

  Pipe() {
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0)
      throw InputError(fmt::format("no pipe to a program: {}", std::strerror(errno)));
    reading.emplace(ends[0]);
    writing.emplace(ends[1]);
    close(ends[0]);
    close(ends[1]);
  }
};

/// The end of what a program writes to a stream.
class Tail {
 public:
  Tail() { fcntl(reading(), F_SETFL, O_NONBLOCK); }
  int reading() const { return pipe_.reading->number(); }
  int writing() const { return pipe_.writing->number(); }
  void close_writing() { pipe_.writing.reset(); }

  /// Takes what is there, of a program that never pauses a part.
  void drain() {
    std::array<char, 4096> block{};
    ssize_t count = 0;
    for (int blocks = 0; blocks < 64 && (count = read(reading(), block.data(), block.size())) > 0; ++blocks) {
      text_.append(block.data(), static_cast<size_t>(count));
      if (text_.size() > 2 * kKept) text_.erase(0, text_.size() - kKept);
    }
  }

  /// Its last lines, without what moves a terminal's cursor.
  std::string last_lines() const {
    std::vector<std::string> lines = {""};
    for (size_t i = 0; i < text_.size(); ++i) {
      const char c = text_[i];
      if (c == '\x1b' && i + 1 < text_.size() && text_[i + 1] == '[') {
        while (i + 1 < text_.size() && !std::isalpha(static_cast<unsigned char>(text_[i + 1]))) ++i;
        ++i;
      } else if (c == '\n' || c == '\r') {
        lines.emplace_back();
      } else if (static_cast<unsigned char>(c) >= ' ') {
        lines.back() += c;
      }
    }
    std::erase_if(lines, [](const std::string& line) { return line.find_first_not_of(' ') == std::string::npos; });
    if (lines.size() > kLines) lines.erase(lines.begin(), lines.end() - static_cast<std::ptrdiff_t>(kLines));
    for (std::string& line : lines) shorten(line);
    return join(lines, "\n");
  }

 private:
  static constexpr size_t kKept = 4096, kLines = 6, kLongest = 300;

  static void shorten(std::string& line) {
    if (line.size() <= kLongest) return;
    size_t end = kLongest;
    while (end > 0 && (static_cast<unsigned char>(line[end]) & 0xc0) == 0x80) --end;  // between characters of UTF-8
    line.replace(end, std::string::npos, "...");
  }

  Pipe pipe_;
  std::string text_;
};

/// When a process began, in ticks since the machine did: tells it from a later one of the same number. 0: it is gone.
uint64_t beginning_of(pid_t process) {
  const std::string text = read_text(fmt::format("/proc/{}/stat", process));
  const size_t name_end = text.rfind(')');  // names may hold blanks
  if (name_end == std::string::npos) return 0;
  const std::vector<std::string> fields = split(std::string_view(text).substr(name_end + 2), ' ');
  constexpr size_t kState = 0, kBeginning = 19;
  if (fields.size() <= kBeginning || fields[kState] == "Z" || fields[kState] == "X") return 0;
  return std::strtoull(fields[kBeginning].c_str(), nullptr, 10);
}

/// A name for a variable that only one program, and what it starts, has in its environment.
std::string new_mark() {
  static std::atomic<int> count{0};
  return fmt::format("BRUME_COMMAND_{}_{}_{:08x}", getpid(), ++count, std::random_device()());
}

/// A program and everything that it has started: what was seen before its parent ended, and what has its mark.
class ProcessTree {
 public:
  ProcessTree(pid_t root, std::string mark) : root_(root), mark_(std::move(mark)) { known_[root] = beginning_of(root); }

  void look() {
    std::vector<pid_t> open;
    for (const auto& [process, beginning] : known_) open.push_back(process);
    while (!open.empty()) {
      const pid_t process = open.back();
      open.pop_back();
      std::error_code ignored;
      for (const auto& thread : fs::directory_iterator(fmt::format("/proc/{}/task", process), ignored)) {
        std::ifstream children(thread.path() / "children");
        for (pid_t child = 0; children >> child;)
          if (known_.try_emplace(child, beginning_of(child)).second) open.push_back(child);
      }
    }
  }

  /// Bytes that it holds: what several processes share counts once.
  double held() const {
    std::vector<std::string> alive;
    for (const auto& [process, beginning] : known_)
      if (is_alive(process, beginning)) alive.push_back(std::to_string(process));
    if (alive.size() == 1) return memory_of(alive[0], "VmRSS").value_or(0.0);
    double sum = 0;
    for (const std::string& process : alive)
      sum += shared_out(process).value_or(memory_of(process, "VmRSS").value_or(0.0));
    return sum;
  }

  /// What the program itself held at most.
  double most_held_by_root() const { return memory_of(std::to_string(root_), "VmHWM").value_or(0.0); }

  /// Stopped first, so that none starts another meanwhile.
  void kill_all() {
    size_t before = 0;
    while (known_.size() > before) {
      before = known_.size();
      send(SIGSTOP);
      look();
      look_for_mark();
    }
    send(SIGKILL);
  }

 private:
  void send(int signal) const {
    kill(-root_, signal);
    for (const auto& [process, beginning] : known_)
      if (process != root_ && is_alive(process, beginning)) kill(process, signal);
  }

  /// Finds those that have left the tree, as daemons do. Reads the environment of every process of this user.
  void look_for_mark() {
    std::error_code ignored;
    for (const auto& entry : fs::directory_iterator("/proc", ignored)) {
      const std::string name = entry.path().filename().string();
      const auto process = static_cast<pid_t>(std::strtol(name.c_str(), nullptr, 10));
      if (process <= 0 || known_.contains(process)) continue;
      if (read_text(entry.path() / "environ").find(mark_) != std::string::npos) known_[process] = beginning_of(process);
    }
  }

  static bool is_alive(pid_t process, uint64_t beginning) {
    return beginning != 0 && beginning_of(process) == beginning;
  }

  /// Resident bytes of a process, each page divided by how many share it.
  static std::optional<double> shared_out(const std::string& process) {
    std::ifstream file("/proc/" + process + "/smaps_rollup");
    for (std::string line; std::getline(file, line);)
      if (line.starts_with("Pss:")) return 1024 * std::strtod(line.c_str() + 4, nullptr);
    return std::nullopt;
  }

  pid_t root_;
  std::string mark_;
  std::map<pid_t, uint64_t> known_;
};

/// What the child needs between fork and exec, where memory must not be allocated.
struct Start {
  pid_t parent;
  int input, output, errors, handed_over, failure;
  const char *folder, *program;
  char *const *words, *const *environment;
};

/// The child's part: becomes the program, or tells why not.
[[noreturn]] void become(const Start& start) {
  setsid();
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != start.parent) _exit(EXIT_FAILURE);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE, SIGCHLD}) std::signal(signal, SIG_DFL);
  dup2(start.input, STDIN_FILENO);
  dup2(start.output, STDOUT_FILENO);
  dup2(start.errors, STDERR_FILENO);
  if (start.handed_over >= 0) dup2(start.handed_over, kHandedOver);
  close_range(start.handed_over >= 0 ? kHandedOver + 1 : STDERR_FILENO + 1, ~0U, CLOSE_RANGE_CLOEXEC);
  if (*start.folder == '\0' || chdir(start.folder) == 0) execve(start.program, start.words, start.environment);
  const int error = errno;
  [[maybe_unused]] const ssize_t written = write(start.failure, &error, sizeof error);
  _exit(EXIT_FAILURE);
}

std::vector<std::string> environment_of(const Command& command, const std::string& mark) {
  std::vector<std::string> all;
  for (char** entry = environ; *entry; ++entry) {
    const std::string_view text = *entry;
    if (!command.environment.contains(std::string(text.substr(0, text.find('='))))) all.emplace_back(text);
  }
  for (const auto& [name, value] : command.environment) all.push_back(name + "=" + value);
  all.push_back(mark + "=1");
  return all;
}

std::vector<char*> pointers_to(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

/// Starts the program and waits until it is one. @throws InputError
pid_t start(const Command& command, const std::string& mark, const Tail& output, const Tail& errors) {
  const auto fail = [&](int error) {
    throw InputError(fmt::format("{}: cannot be started: {}", command.words.at(0), std::strerror(error)));
  };
  std::vector<std::string> words = command.words, environment = environment_of(command, mark);
  const std::vector<char*> word_pointers = pointers_to(words), environment_pointers = pointers_to(environment);
  const int nothing = open("/dev/null", O_RDWR | O_CLOEXEC);
  const Descriptor silence(nothing), handed_over(command.handed_over);
  close(nothing);
  Pipe failure;
  const std::string program = command.program.string(), folder = command.folder.string();
  const Start plan{.parent = getpid(),
                   .input = silence.number(),
                   .output = command.supervised ? output.writing() : silence.number(),
                   .errors = command.supervised ? errors.writing() : silence.number(),
                   .handed_over = handed_over.number(),
                   .failure = failure.writing->number(),
                   .folder = folder.c_str(),
                   .program = program.c_str(),
                   .words = word_pointers.data(),
                   .environment = environment_pointers.data()};
  // Not posix_spawn: it cannot tie the child's life to ours.
  const pid_t child = fork();
  if (child < 0) fail(errno);
  if (child == 0) become(plan);
  failure.writing.reset();
  int error = 0;
  if (read(failure.reading->number(), &error, sizeof error) != sizeof error) return child;
  waitpid(child, nullptr, 0);
  fail(error);
  return 0;
}

/// Whether a child has ended; it keeps its number until it is collected.
bool has_ended(pid_t child) {
  siginfo_t info{};
  return waitid(P_PID, static_cast<id_t>(child), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == child;
}

double processor_seconds_of(pid_t process) {
  clockid_t clock{};
  timespec time{};
  if (clock_getcpuclockid(process, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Looks after a program until its end.
class Watch {
 public:
  Watch(const Command& command, const Task& task, pid_t child, const std::string& mark, Tail& output, Tail& errors)
      : command_(command),
        task_(task),
        child_(child),
        output_(output),
        errors_(errors),
        ended_(static_cast<int>(syscall(SYS_pidfd_open, child, 0))),
        tree_(child, mark) {}
  ~Watch() {
    if (ended_ >= 0) close(ended_);
  }
  Watch(Watch&&) = delete;

  CommandEnd wait() {
    CommandEnd end;
    // Short programs are looked at sooner.
    for (int milliseconds = 1; !has_ended(child_); milliseconds = std::min(2 * milliseconds, kLook)) {
      look(end);
      if (task_.cancelled() || end.passed != CommandEnd::Limit::kNone) break;
      std::array<pollfd, 3> events = {
          pollfd{output_.reading(), POLLIN, 0}, {errors_.reading(), POLLIN, 0}, {ended_, POLLIN, 0}};
      // A stream that the program has closed would wake us all the time.
      for (size_t i = 0; i < 2; ++i)
        if (closed_.at(i)) events.at(i).fd = -1;
      poll(events.data(), events.size(), ended_ >= 0 ? milliseconds : 1);
      // In time that this process was not stopped.
      const double used = processor_seconds_of(child_);
      idle_ = used > used_ ? 0 : idle_ + 1e-3 * milliseconds;
      used_ = used;
      for (size_t i = 0; i < 2; ++i)
        closed_.at(i) = (events.at(i).revents & POLLHUP) && !(events.at(i).revents & POLLIN);
    }
    end.seconds = clock_.seconds();
    if (command_.supervised)
      tree_.kill_all();
    else if (!has_ended(child_))
      kill(child_, SIGKILL);
    int status = 0;
    while (waitpid(child_, &status, 0) < 0 && errno == EINTR) {
    }
    if (WIFSIGNALED(status))
      end.signal = WTERMSIG(status);
    else
      end.status = WEXITSTATUS(status);
    output_.drain();
    errors_.drain();
    end.said = errors_.last_lines();
    if (end.said.empty()) end.said = output_.last_lines();
    return end;
  }

 private:
  static constexpr int kLook = 20;  // [ms]

  void look(CommandEnd& end) {
    if (command_.watch) command_.watch();
    if (command_.stall_limit > 0 && idle_ > command_.stall_limit) end.passed = CommandEnd::Limit::kStall;
    if (!command_.supervised) return;
    output_.drain();
    errors_.drain();
    tree_.look();
    const double held = tree_.held();
    end.peak_bytes = std::max({end.peak_bytes, held, tree_.most_held_by_root()});
    if (command_.memory_limit > 0 && held > command_.memory_limit) end.passed = CommandEnd::Limit::kMemory;
    if (command_.time_limit > 0 && clock_.seconds() > command_.time_limit) end.passed = CommandEnd::Limit::kTime;
  }

  const Command& command_;
  const Task& task_;
  const pid_t child_;
  Tail &output_, &errors_;
  const int ended_;  // readable once the child has ended; -1 where the system has no such thing
  const Stopwatch clock_;
  ProcessTree tree_;
  std::array<bool, 2> closed_{};
  double used_ = 0, idle_ = 0;  // seconds: of the processor; since it used any
};

/// What a shell would do with a character outside of quotes.
bool is_for_a_shell(char c, bool begins_word) {
  return std::string_view("|&;<>$`*?").find(c) != std::string_view::npos || (c == '~' && begins_word);
}

}  // namespace

std::vector<std::string> parse_words(std::string_view line) {
  std::vector<std::string> words;
  bool inside = false;  // a word, which may be empty in quotes
  for (size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == ' ' || c == '\t' || c == '\n' || c == '\r') {
      inside = false;
      continue;
    }
    if (is_for_a_shell(c, !inside))
      throw InputError(fmt::format(
          "'{}' would be for a shell, and none runs the command: write it in quotes to mean itself, or put the line into a script",
          c));
    if (!inside) words.emplace_back();
    inside = true;
    if (c == '\\') {
      if (++i == line.size()) throw InputError("a backslash ends the command; expected a character after it");
      words.back() += line[i];
    } else if (c == '\'' || c == '"') {
      const size_t begin = i;
      for (++i; i < line.size() && line[i] != c; ++i) {
        if (c == '"' && line[i] == '\\' && i + 1 < line.size() && (line[i + 1] == '"' || line[i + 1] == '\\')) ++i;
        words.back() += line[i];
      }
      if (i == line.size())
        throw InputError(fmt::format("the quote {} at character {} of the command has no end", c, begin + 1));
    } else {
      words.back() += c;
    }
  }
  return words;
}

fs::path find_program(const std::string& name, const fs::path& folder) {
  const auto is_program = [](const fs::path& path) {
    std::error_code ignored;
    return fs::is_regular_file(path, ignored) && access(path.c_str(), X_OK) == 0;
  };
  if (name.find('/') != std::string::npos) {
    const fs::path path = fs::absolute(folder / name);
    return is_program(path) ? path : fs::path();
  }
  const char* const folders = std::getenv("PATH");
  if (name.empty() || !folders) return {};
  for (const std::string& place : split(folders, ':'))
    if (const fs::path path = fs::path(place.empty() ? "." : place) / name; is_program(path)) return fs::absolute(path);
  return {};
}

CommandEnd run_command(const Command& command, const Task& task) {
  task.check();
  Tail output, errors;
  const std::string mark = new_mark();
  const pid_t child = start(command, mark, output, errors);
  output.close_writing();
  errors.close_writing();
  CommandEnd end = Watch(command, task, child, mark, output, errors).wait();
  task.check();
  return end;
}

}  // namespace brume
