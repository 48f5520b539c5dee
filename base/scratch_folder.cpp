#include "base/scratch_folder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdlib>
#include <system_error>

#include "base/error.h"
#include "base/host.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

// PREFIX HOST . PROCESS . six characters
constexpr std::string_view kPrefix = "brume-scratch.";

void remove_abandoned(const fs::path& place) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(place, ignored)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(kPrefix)) continue;
    const size_t end = name.rfind('.'), middle = name.rfind('.', end - 1);
    if (middle < kPrefix.size() || middle == std::string::npos) continue;
    const std::string host = name.substr(kPrefix.size(), middle - kPrefix.size());
    if (is_gone(host, std::atoi(name.c_str() + middle + 1))) fs::remove_all(entry.path(), ignored);
  }
}

/// Where temporary files go. @throws InputError where there is no such folder
fs::path place_of_scratch() {
  std::error_code error;
  fs::path place = fs::temp_directory_path(error);
  if (!error) return place;
  for (const char* name : {"TMPDIR", "TMP", "TEMP", "TEMPDIR"})
    if (const char* const folder = std::getenv(name))
      throw InputError(
          fmt::format("{}: the folder for temporary files ({}) is not there; expected a folder", folder, name));
  throw InputError("/tmp: the folder for temporary files is not there; expected TMPDIR to name one");
}

}  // namespace

ScratchFolder::ScratchFolder() {
  const fs::path place = place_of_scratch();
  remove_abandoned(place);
  std::string name = (place / fmt::format("{}{}.{}.XXXXXX", kPrefix, host_name(), getpid())).string();
  if (!mkdtemp(name.data()))
    throw InputError(fmt::format("{}: cannot be made: {}", name, std::generic_category().message(errno)));
  path_ = name;
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace brume
