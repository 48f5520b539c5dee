#pragma once
#include <filesystem>
#include <string>

namespace brume {

/// A folder of its own among the system's temporary files (TMPDIR), removed with what it holds in the end. What killed
/// processes of this machine have left of theirs is removed by the next that makes one.
class ScratchFolder {
 public:
  /// @throws InputError when it cannot be made
  ScratchFolder();
  ~ScratchFolder();
  ScratchFolder(ScratchFolder&&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace brume
