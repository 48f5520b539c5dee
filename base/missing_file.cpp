#include "base/missing_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <vector>

#include "base/error.h"
#include "base/sequence.h"
#include "base/text.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostNames = 5000;  // looked at in a folder

std::vector<std::string> names_in(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end && names.size() < kMostNames;
       entry.increment(error))
    names.push_back(entry->path().filename().string());
  std::sort(names.begin(), names.end());  // the same advice whatever the order on the disk
  return names;
}

std::string without_digits(std::string name) {
  std::erase_if(name, [](unsigned char c) { return std::isdigit(c) != 0; });
  return name;
}

fs::path first_missing_folder(const fs::path& path) {
  std::error_code ignored;
  fs::path missing;
  for (fs::path folder = path.parent_path(); !folder.empty() && !fs::exists(folder, ignored);
       folder = folder.parent_path())
    missing = folder;
  return missing;
}

/// The name in `path`'s folder that is most like it; nothing for another frame of its sequence, which was not meant.
std::string nearest_in_folder(const fs::path& path) {
  const std::string name = path.filename().string();
  std::vector<std::string> names = names_in(path.has_parent_path() ? path.parent_path() : fs::path("."));
  std::erase_if(names, [&](const std::string& other) { return without_digits(other) == without_digits(name); });
  return nearest_name(name, names);
}

}  // namespace

std::string missing_file(const fs::path& path) {
  const std::string text = "no such file";
  if (const auto pattern = FramePattern::of(path)) {
    const std::vector<int> frames = pattern->frames_on_disk();
    if (frames.empty()) return "no file of that name is there";
    return fmt::format("{}; frames {} of it are there", text, frames_text(frames));
  }
  if (const fs::path folder = first_missing_folder(path); !folder.empty())
    return fmt::format("{}; there is no folder {}", text, folder.string());
  const std::string nearest = nearest_in_folder(path);
  return nearest.empty() ? text : fmt::format("{}; did you mean {}?", text, (path.parent_path() / nearest).string());
}

void check_exists(const fs::path& path) {
  std::error_code ignored;
  if (!fs::exists(path, ignored)) throw InputError(fmt::format("{}: {}", path.string(), missing_file(path)));
}

}  // namespace brume
