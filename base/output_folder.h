#pragma once
#include <filesystem>
#include <optional>
#include <string>

namespace brume {

/// A lock on a file that its process holds until it ends, however it ends.
class FileLock {
 public:
  /// Makes the file and locks it before it gets its name, so that nobody sees it without its lock. @throws InputError
  static FileLock make(const std::filesystem::path& path);
  /// Locks a file that is there; not held where another process holds it, or there is no such file.
  static FileLock take(const std::filesystem::path& path);
  ~FileLock();
  FileLock(FileLock&& other) noexcept;
  bool held() const { return file_ >= 0; }

 private:
  explicit FileLock(int file);
  int file_;
};

/// Results are written beside the target under a name of this run alone and moved in when they are whole. What else
/// lies in the target stays; files of an earlier evaluation are replaced. What killed runs have left is removed.
class OutputFolder {
 public:
  /// @throws InputError where it cannot be made
  explicit OutputFolder(const std::string& path);
  ~OutputFolder();
  OutputFolder(OutputFolder&&) = delete;
  const std::filesystem::path& part() const { return part_; }
  /// @throws InputError
  void commit();

 private:
  std::filesystem::path path_, part_;
  std::optional<FileLock> lock_;
};

}  // namespace brume
