#include "base/output_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdlib>
#include <utility>

#include "base/error.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLock = "in_use";

void remove_abandoned(const std::string& prefix) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(fs::path(prefix).parent_path(), ignored)) {
    if (!entry.path().string().starts_with(prefix)) continue;
    const FileLock lock = FileLock::take(entry.path() / kLock);
    if (lock.held()) fs::remove_all(entry.path(), ignored);
  }
}

}  // namespace

FileLock FileLock::make(const fs::path& path) {
  const fs::path unnamed = path.string() + ".new";
  FileLock lock(open(unnamed.c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0666));
  std::error_code error;
  if (lock.held()) fs::rename(unnamed, path, error);
  if (!lock.held() || error) throw InputError(fmt::format("{}: cannot be written", path.string()));
  return lock;
}

FileLock FileLock::take(const fs::path& path) {
  return FileLock(open(path.c_str(), O_RDWR | O_CLOEXEC));
}

FileLock::~FileLock() {
  if (file_ >= 0) close(file_);
}

FileLock::FileLock(FileLock&& other) noexcept : file_(std::exchange(other.file_, -1)) {}

FileLock::FileLock(int file) : file_(file) {
  if (file_ >= 0 && flock(file_, LOCK_EX | LOCK_NB) != 0) {
    close(file_);
    file_ = -1;
  }
}

OutputFolder::OutputFolder(const std::string& path)
    : path_(fs::absolute(path + "/x").lexically_normal().parent_path()) {
  if (fs::exists(path_) && !fs::is_directory(path_))
    throw InputError(fmt::format("{}: is a file, expected the name of a folder to write", path));
  const std::string prefix = path_.string() + ".part.";
  std::error_code error;
  fs::create_directories(path_.parent_path(), error);
  remove_abandoned(prefix);
  std::string name = prefix + "XXXXXX";
  if (!mkdtemp(name.data()))
    throw InputError(fmt::format("{}: cannot be made: {}", name, std::generic_category().message(errno)));
  part_ = name;
  lock_.emplace(FileLock::make(part_ / kLock));
}

OutputFolder::~OutputFolder() {
  std::error_code ignored;
  fs::remove_all(part_, ignored);
}

void OutputFolder::commit() {
  std::error_code error;
  fs::create_directories(path_, error);
  for (const auto& entry : fs::directory_iterator(part_)) {
    if (entry.path().filename() == kLock) continue;
    const fs::path target = path_ / entry.path().filename();
    // A folder is not replaced by rename: its files are moved into the one that is there.
    if (entry.is_directory() && fs::is_directory(target)) {
      for (const auto& file : fs::directory_iterator(entry.path()))
        if (!error) fs::rename(file.path(), target / file.path().filename(), error);
    } else {
      fs::rename(entry.path(), target, error);
    }
    if (error) throw InputError(fmt::format("{}: cannot be written: {}", path_.string(), error.message()));
  }
}

}  // namespace brume
