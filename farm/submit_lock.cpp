#include "farm/submit_lock.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <sstream>

#include "base/error.h"
#include "base/host.h"
#include "base/output_file.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

struct Holder {
  std::string host, time;
  int process = 0;  ///< 0: the file is empty, since it has just been made

  std::string text() const {
    return process > 0 ? fmt::format("{}, process {}, since {}", host, process, time) : "another process";
  }
};

Holder holder_of(const fs::path& file) {
  Holder holder;
  std::istringstream(read_text(file)) >> holder.host >> holder.process >> holder.time;
  return holder;
}

/// Writes a file that is not there yet. @return 0, or what is wrong as errno says it
int make_exclusively(const fs::path& file, const std::string& text) {
  const int descriptor = open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor < 0) return errno;
  const ssize_t written = write(descriptor, text.data(), text.size());
  const int error = written == static_cast<ssize_t>(text.size()) ? 0 : errno;
  close(descriptor);
  if (error != 0) unlink(file.c_str());
  return error;
}

}  // namespace

SubmitLock::SubmitLock(const fs::path& folder, bool break_it)
    : file_(folder / "submit.lock"),
      text_(fmt::format("{} {} {:%Y-%m-%dT%H:%M:%SZ}\n", host_name(), getpid(), fmt::gmtime(std::time(nullptr)))) {
  std::error_code made;
  fs::create_directories(folder, made);
  if (made) throw InputError(fmt::format("{}: cannot be made: {}", folder.string(), made.message()));
  int error = make_exclusively(file_, text_);
  if (error == EEXIST && break_it) {
    broken_ = holder_of(file_).text();
    unlink(file_.c_str());
    error = make_exclusively(file_, text_);
  }
  if (error == EEXIST) {
    const Holder holder = holder_of(file_);
    throw InputError(fmt::format("{}: is being submitted by {}; {}", folder.string(), holder.text(),
                                 is_gone(holder.host, holder.process)
                                     ? "that process is gone, and --break-lock goes on without it"
                                     : "wait for it, or go on with --break-lock where that process is gone"));
  }
  if (error != 0) throw InputError(fmt::format("{}: cannot be made: {}", file_.string(), std::strerror(error)));
}

SubmitLock::~SubmitLock() {
  // Who broke it has another one there.
  if (read_text(file_) == text_) unlink(file_.c_str());
}

}  // namespace brume
