#pragma once
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume {

/// Frames and results in a folder, each under everything that decides what it is. An entry appears whole or not at all,
/// so that a run that was killed goes on where it stopped; entries of another version of the program lie in a folder of
/// their own and are never seen.
///
/// A key is text, a line for each thing that decides the entry; the file's name is its hash, and the file holds the key
/// itself, so that two keys of one hash are not taken for each other. Not for use by several threads at once; several
/// processes may share a folder.
class Cache {
 public:
  /// @param folder   made where it is missing
  /// @param version  of the program: another one's entries are not used   @throws InputError
  Cache(const std::filesystem::path& folder, const std::string& version);

  /// An entry, if it is there; what cannot be read counts as missing.
  /// @param wanted  channels to read; all without it
  std::optional<Layers> find(const std::string& key, const std::function<bool(const std::string&)>& wanted = {}) const;
  bool has(const std::string& key) const {
    return find(key, [](const std::string&) { return false; }).has_value();
  }
  /// @throws InputError when it cannot be written, a full disk for one
  void store(const std::string& key, Layers entry) const;

  /// The same of a text.
  std::optional<std::string> find_text(const std::string& key) const;
  void store_text(const std::string& key, const std::string& text) const;

  /// A file that lies beside an entry and is written by somebody else.
  std::filesystem::path companion(const std::string& key, const std::string& extension) const;

  /// The other versions whose entries lie in the folder.
  const std::vector<std::string>& others() const { return others_; }

  /// 32 hexadecimal digits.
  static std::string hash(std::string_view text);
  /// The same of what a file holds, or of all files in a folder with their names. @throws InputError where there is
  /// none
  static std::string hash_contents(const std::filesystem::path& path);

 private:
  std::filesystem::path path(const std::string& key) const { return companion(key, ".exr"); }

  std::filesystem::path folder_;
  std::vector<std::string> others_;
};

}  // namespace brume
