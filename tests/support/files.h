#pragma once
#include <filesystem>
#include <functional>
#include <string>

namespace brume::test {

/// A folder of its own, removed at the end.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// A file of the project.
std::filesystem::path source(const std::string& relative);
/// A file of ../shared; empty path when the project stands without it.
std::filesystem::path shared(const std::string& relative);

struct ProgramResult {
  int status;  ///< exit status; 128 + n when killed by signal n
  std::string out, err;
};
/// Runs the brume program. `arguments` are words for a shell.
ProgramResult run_brume(const std::string& arguments);

/// The brume program, running; killed at the end of its scope.
class RunningProgram {
 public:
  /// @param arguments  words for a shell
  explicit RunningProgram(const std::string& arguments);
  ~RunningProgram();
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;

  /// Waits for as long as it takes, so that no test depends on the machine's speed.
  /// @return false when the program ends before the condition holds
  bool wait_until(const std::function<bool()>& condition);
  void send(int signal) const;
  /// What it has written to stderr so far.
  std::string err() const;
  /// Waits for its end.
  ProgramResult finish();

 private:
  bool ended();
  TemporaryFolder folder_;
  int pid_ = 0, status_ = 0;
  bool ended_ = false;
};

/// Lets the next writing of a file, here or in a program that is started, meet a full disk, the one after that find
/// room: what is written before it gets its name goes to /dev/full.
class FullDisk {
 public:
  explicit FullDisk(const std::filesystem::path& output);
  ~FullDisk();
};

/// Does something in a child process that may take no more than so many bytes of memory beyond what this one has.
/// @return its exit status: what `work` returns, or kOutOfMemory, kInputError where it throws these
constexpr int kOutOfMemory = 101, kInputError = 102;
int status_with_memory(size_t bytes, const std::function<int()>& work);

/// Whether memory can be limited here: not under AddressSanitizer, which needs all addresses.
constexpr bool can_limit_memory() {
#ifdef __SANITIZE_ADDRESS__
  return false;
#else
  return true;
#endif
}

/// Whether a folder holds a file that is being written, or was left so.
bool has_half_written(const std::filesystem::path& folder);

void write_file(const std::filesystem::path& path, const std::string& text);
std::string read_file(const std::filesystem::path& path);

}  // namespace brume::test
