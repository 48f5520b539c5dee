#include "base/child_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <ctime>

#include "base/descriptor.h"

namespace brume {
namespace {

class SpawnActions {
 public:
  SpawnActions() { posix_spawn_file_actions_init(&actions_); }
  ~SpawnActions() { posix_spawn_file_actions_destroy(&actions_); }
  SpawnActions(const SpawnActions&) = delete;
  SpawnActions& operator=(const SpawnActions&) = delete;
  void give(int ours, int theirs) { posix_spawn_file_actions_adddup2(&actions_, ours, theirs); }
  void silence(int descriptor) { posix_spawn_file_actions_addopen(&actions_, descriptor, "/dev/null", O_RDWR, 0); }
  const posix_spawn_file_actions_t* get() const { return &actions_; }

 private:
  posix_spawn_file_actions_t actions_;
};

double cpu_seconds_of(pid_t child) {
  clockid_t clock{};
  timespec time{};
  if (clock_getcpuclockid(child, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

ChildEnd collect(pid_t child) {
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  ChildEnd end;
  if (WIFSIGNALED(status))
    end.signal = WTERMSIG(status);
  else
    end.status = WEXITSTATUS(status);
  return end;
}

}  // namespace

ChildEnd run_child(const std::filesystem::path& program, const std::vector<std::string>& arguments, int descriptor,
                   const Task& task, double stall_seconds, const std::function<void()>& watch) {
  task.check();
  // The child holds the writing end of a pipe as long as it lives: the reading end tells of its end at once.
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0)
    throw InputError(fmt::format("{}: cannot be started: {}", program.string(), std::strerror(errno)));
  const Descriptor alive(ends[0]);
  pid_t child = 0;
  int error = 0;
  {
    const Descriptor given(descriptor), lifeline(ends[1]);
    close(ends[0]);
    close(ends[1]);
    SpawnActions actions;
    for (const int standard : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) actions.silence(standard);
    actions.give(given.number(), kHandedOver);
    actions.give(lifeline.number(), kHandedOver + 1);
    std::vector<std::string> words = {program.string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> pointers;
    for (std::string& word : words) pointers.push_back(word.data());
    pointers.push_back(nullptr);
    error = posix_spawn(&child, program.c_str(), actions.get(), nullptr, pointers.data(), environ);
  }
  if (error != 0) throw InputError(fmt::format("{}: cannot be started: {}", program.string(), std::strerror(error)));

  // Time is counted in polls of the child, which stop when this process is stopped.
  constexpr double kLook = 0.05;
  double used = 0;
  double idle = 0;
  while (true) {
    pollfd waiting{alive.number(), POLLIN, 0};
    if (poll(&waiting, 1, static_cast<int>(1000 * kLook)) > 0) break;
    if (watch) watch();
    const double now = cpu_seconds_of(child);
    idle = now > used ? 0.0 : idle + kLook;
    used = now;
    if (task.cancelled() || idle > stall_seconds) {
      kill(child, SIGKILL);
      break;
    }
  }
  ChildEnd end = collect(child);
  task.check();
  end.stalled = idle > stall_seconds;
  return end;
}

void follow_parent() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) std::signal(signal, SIG_IGN);
  const pid_t parent = getppid();
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) std::raise(SIGKILL);
}

}  // namespace brume
