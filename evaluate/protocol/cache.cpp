#include "evaluate/protocol/cache.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>

#include "base/error.h"
#include "base/host.h"
#include "base/rng.h"
#include "image/exr_io.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr const char* kKey = "cacheKey";
constexpr const char* kText = "cacheText";

/// A version as the name of a folder.
std::string folder_name(const std::string& version) {
  std::string name;
  for (const char c : version) name += std::isalnum(static_cast<unsigned char>(c)) || c == '.' ? c : '-';
  return name;
}

class Hash {
 public:
  void add(std::string_view text) {
    for (const char c : text) {
      a_ = mix64(a_ ^ static_cast<unsigned char>(c));
      b_ = (b_ ^ static_cast<unsigned char>(c)) * 0x100000001b3ull + 0x9e3779b97f4a7c15ull;
    }
  }
  std::string text() const { return fmt::format("{:016x}{:016x}", a_, mix64(b_)); }

 private:
  uint64_t a_ = 0x243f6a8885a308d3ull, b_ = 0x13198a2e03707344ull;
};

/// What killed runs have left half written; a day later nobody writes it any more.
void remove_abandoned(const fs::path& folder) {
  std::error_code ignored;
  const auto old = fs::file_time_type::clock::now() - std::chrono::hours(24);
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (entry.path().filename().string().starts_with("writing.") && fs::last_write_time(entry.path(), ignored) < old)
      fs::remove(entry.path(), ignored);
}

}  // namespace

Cache::Cache(const fs::path& folder, const std::string& version) : folder_(folder / folder_name(version)) {
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error))
    throw InputError(fmt::format("{}: is a file, expected the name of a folder for the cache", folder.string()));
  fs::create_directories(folder_, error);
  if (error) throw InputError(fmt::format("{}: cannot be made: {}", folder_.string(), error.message()));
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_directory(error) && entry.path() != folder_ && entry.path().filename().string().starts_with("brume-"))
      others_.push_back(entry.path().filename().string());
  remove_abandoned(folder_);
}

std::string Cache::hash(std::string_view text) {
  Hash all;
  all.add(text);
  return all.text();
}

std::string Cache::hash_contents(const fs::path& path) {
  Hash all;
  if (fs::is_directory(path)) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(path))
      if (entry.is_regular_file()) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) all.add(file.lexically_relative(path).string() + "\n" + hash_contents(file));
    return all.text();
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(fmt::format("{}: cannot be read", path.string()));
  std::string block(1 << 20, '\0');
  while (stream) {
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    all.add({block.data(), static_cast<size_t>(stream.gcount())});
  }
  return all.text();
}

fs::path Cache::companion(const std::string& key, const std::string& extension) const {
  return folder_ / (hash(key) + extension);
}

std::optional<Layers> Cache::find(const std::string& key, const std::function<bool(const std::string&)>& wanted) const {
  std::error_code ignored;
  if (!fs::exists(path(key), ignored)) return std::nullopt;
  try {
    Layers entry = read_exr(path(key), wanted);
    if (entry.text(kKey) == key) {
      entry.header.erase(kKey);
      return entry;
    }
  } catch (const InputError&) {
    // Damaged: as good as missing, and written anew.
  }
  return std::nullopt;
}

void Cache::store(const std::string& key, Layers entry) const {
  entry.header[kKey] = key;
  const fs::path aside = folder_ / fmt::format("writing.{}.{}.{}.exr", host_name(), getpid(), hash(key));
  std::error_code error;
  try {
    write_exr(aside, entry);
  } catch (const InputError& failure) {
    throw InputError(fmt::format("the cache cannot be written: {}", failure.what()));
  }
  fs::rename(aside, path(key), error);
  if (error) throw InputError(fmt::format("{}: cannot be written: {}", path(key).string(), error.message()));
}

std::optional<std::string> Cache::find_text(const std::string& key) const {
  const std::optional<Layers> entry = find(key);
  if (!entry) return std::nullopt;
  return entry->text(kText);
}

void Cache::store_text(const std::string& key, const std::string& text) const {
  Layers entry(1, 1);
  entry.add("Y");
  entry.header[kText] = text;
  store(key, std::move(entry));
}

}  // namespace brume
