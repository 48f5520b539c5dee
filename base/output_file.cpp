#include "base/output_file.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <random>
#include <sstream>

#include "base/error.h"
#include "base/host.h"

namespace brume {
namespace fs = std::filesystem;

namespace {

fs::path folder_of(const fs::path& path) {
  return path.parent_path().empty() ? fs::path(".") : path.parent_path();
}

}  // namespace

void check_writable(const fs::path& path, std::span<const fs::path> inputs, std::string_view extension) {
  const fs::path folder = folder_of(path);
  std::error_code ignored;
  if (!extension.empty() && path.extension() != extension && !fs::is_directory(path, ignored))
    throw InputError(
        fmt::format("{}: its name should end in {}, which is what would be written", path.string(), extension));
  for (const fs::path& input : inputs)
    if (fs::equivalent(path, input, ignored))
      throw InputError(
          fmt::format("{}: is read by this command and would be destroyed; name another output", path.string()));
  if (path.filename().empty() || fs::is_directory(path, ignored))
    throw InputError(fmt::format("{}: is a folder, expected the name of a file to write", path.string()));
  if (!fs::is_directory(folder, ignored))
    throw InputError(fmt::format("{}: cannot be written: there is no folder {}", path.string(), folder.string()));
  if (access(folder.c_str(), W_OK) != 0)
    throw InputError(
        fmt::format("{}: cannot be written: {}: {}", path.string(), folder.string(), std::strerror(errno)));
}

namespace {

constexpr std::string_view kPart = ".part";

/// Removes what killed processes of this machine have left of a file.
/// @param prefix  "shot.exr.HOST.", after which the process's number stands
void remove_abandoned(const fs::path& folder, const std::string& host, const std::string& prefix) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (!name.starts_with(prefix) || !name.ends_with(kPart)) continue;
    std::error_code ignored;
    if (is_gone(host, std::atoi(name.c_str() + prefix.size()))) fs::remove(entry->path(), ignored);
  }
}

/// Where to write aside.
fs::path own_part(const fs::path& path) {
  if (const char* const named = std::getenv("BRUME_WRITER"); named && *named) {
    std::string writer = named;
    std::replace(writer.begin(), writer.end(), '/', '_');
    return fmt::format("{}.{}{}", path.string(), writer, kPart);
  }
  // Processes in containers may share a machine's name and their numbers.
  static std::atomic<uint32_t> number{std::random_device{}()};
  const std::string host = host_name();
  remove_abandoned(folder_of(path), host, fmt::format("{}.{}.", path.filename().string(), host));
  return fmt::format("{}.{}.{}.{:08x}{}", path.string(), host, getpid(), ++number, kPart);
}

}  // namespace

OutputFile::OutputFile(fs::path path) : path_(std::move(path)) {
  check_writable(path_);
  part_ = own_part(path_);
}

OutputFile::~OutputFile() {
  std::error_code ignored;
  if (!committed_) fs::remove(part_, ignored);
}

void OutputFile::commit() {
  std::error_code error;
  fs::rename(part_, path_, error);
  if (error) throw InputError(fmt::format("{}: cannot be written: {}", path_.string(), error.message()));
  committed_ = true;
}

std::string read_text(const fs::path& path) {
  const std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();  // takes errors of reading for the end, which an iterator throws
  return text.str();
}

void write_text(const fs::path& path, std::string_view text) {
  OutputFile file(path);
  std::ofstream stream(file.part(), std::ios::binary);
  stream.write(text.data(), static_cast<std::streamsize>(text.size()));
  stream.close();
  if (!stream) throw InputError(fmt::format("{}: cannot be written: {}", path.string(), std::strerror(errno)));
  file.commit();
}

}  // namespace brume
