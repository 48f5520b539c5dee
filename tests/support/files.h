#pragma once
#include <filesystem>
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

void write_file(const std::filesystem::path& path, const std::string& text);
std::string read_file(const std::filesystem::path& path);

}  // namespace brume::test
