#include "tests/support/files.h"

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string_view>

#include "base/error.h"

namespace brume::test {
namespace fs = std::filesystem;

TemporaryFolder::TemporaryFolder() {
  static std::atomic<int> count{0};
  path_ = fs::temp_directory_path() / ("brume_test_" + std::to_string(getpid()) + "_" + std::to_string(count++));
  fs::create_directories(path_);
}
TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

fs::path source(const std::string& relative) {
  return fs::path(BRUME_SOURCE) / relative;
}

fs::path shared(const std::string& relative) {
  const fs::path path = fs::path(BRUME_SOURCE) / ".." / "shared" / relative;
  return fs::exists(path) ? path : fs::path();
}

std::string read_file(const fs::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

void write_file(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

FullDisk::FullDisk(const fs::path& output) {
  setenv("BRUME_WRITER", "full", 1);
  fs::create_symlink("/dev/full", output.string() + ".full.part");
}

FullDisk::~FullDisk() {
  unsetenv("BRUME_WRITER");
}

int status_with_memory(size_t bytes, const std::function<int()>& work) {
  const pid_t child = fork();
  if (child == 0) {
    size_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    const rlim_t most = pages * static_cast<size_t>(sysconf(_SC_PAGESIZE)) + bytes;
    const rlimit limit{most, most};
    setrlimit(RLIMIT_AS, &limit);
    try {
      _exit(work());
    } catch (const OutOfMemory& error) {
      const std::string_view said = error.what();
      _exit(said.find(kNotEnoughMemory) == std::string_view::npos || !said.starts_with('/') ? 1 : kOutOfMemory);
    } catch (const InputError& error) {
      std::fputs((std::string(error.what()) + "\n").c_str(), stderr);
      _exit(kInputError);
    }
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

bool has_half_written(const fs::path& folder) {
  return std::any_of(fs::directory_iterator(folder), fs::directory_iterator(),
                     [](const fs::directory_entry& entry) { return entry.path().extension() == ".part"; });
}

ProgramResult run_brume(const std::string& arguments) {
  return RunningProgram(arguments).finish();
}

RunningProgram::RunningProgram(const std::string& arguments) {
  const std::string command = "exec " + std::string(BRUME_PROGRAM) + " " + arguments + " >" +
                              (folder_ / "out").string() + " 2>" + (folder_ / "err").string();
  pid_ = fork();
  if (pid_ == 0) {
    execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    _exit(127);
  }
}

RunningProgram::~RunningProgram() {
  if (!ended()) {
    send(SIGKILL);
    finish();
  }
}

std::string RunningProgram::err() const {
  return read_file(folder_ / "err");
}

bool RunningProgram::ended() {
  ended_ = ended_ || waitpid(pid_, &status_, WNOHANG) == pid_;
  return ended_;
}

void RunningProgram::send(int signal) const {
  kill(pid_, signal);
}

bool RunningProgram::wait_until(const std::function<bool()>& condition) {
  while (!condition()) {
    if (ended()) return condition();
    usleep(1000);
  }
  return true;
}

ProgramResult RunningProgram::finish() {
  if (!ended_) waitpid(pid_, &status_, 0);
  ended_ = true;
  return {WIFEXITED(status_) ? WEXITSTATUS(status_) : 128 + WTERMSIG(status_), read_file(folder_ / "out"), err()};
}

}  // namespace brume::test
