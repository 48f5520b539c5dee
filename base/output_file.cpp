#include "base/output_file.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include "base/error.h"

namespace brume {
namespace fs = std::filesystem;

void check_writable(const fs::path& path, std::span<const fs::path> inputs, std::string_view extension) {
  const fs::path folder = path.parent_path().empty() ? fs::path(".") : path.parent_path();
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

std::string name_of_writer() {
  const char* const writer = std::getenv("BRUME_WRITER");
  if (!writer || !*writer) return "";
  std::string name = std::string(".") + writer;
  std::replace(name.begin(), name.end(), '/', '_');
  return name;
}

}  // namespace

OutputFile::OutputFile(fs::path path) : path_(std::move(path)), part_(path_.string() + name_of_writer() + ".part") {
  check_writable(path_);
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

void write_text(const fs::path& path, std::string_view text) {
  OutputFile file(path);
  std::ofstream stream(file.part(), std::ios::binary);
  stream.write(text.data(), static_cast<std::streamsize>(text.size()));
  stream.close();
  if (!stream) throw InputError(fmt::format("{}: cannot be written: {}", path.string(), std::strerror(errno)));
  file.commit();
}

}  // namespace brume
