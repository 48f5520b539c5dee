#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace brume {

/// A file that appears whole or not at all: written aside, renamed by commit(), removed if that never comes.
///
/// Machines that share a folder may do the same work twice, so each writer has a name of its own to write under:
/// `PATH.HOST.PROCESS.NUMBER.part`, where the number begins at random. Where the environment names a BRUME_WRITER, it
/// is `PATH.WRITER.part`; whoever sets that sees to it that no other writer has the same. What a killed process of this
/// machine has left of the same file is removed by the next writer.
class OutputFile {
 public:
  /// @throws InputError when the folder is missing or cannot be written to
  explicit OutputFile(std::filesystem::path path);
  ~OutputFile();
  OutputFile(OutputFile&&) = delete;

  /// Where to write until commit().
  const std::filesystem::path& part() const { return part_; }
  /// @throws InputError when the rename fails
  void commit();

 private:
  std::filesystem::path path_, part_;
  bool committed_ = false;
};

/// What a file holds, as far as it can be read: empty where it is missing.
std::string read_text(const std::filesystem::path& path);

/// Writes a whole text file atomically. @throws InputError
void write_text(const std::filesystem::path& path, std::string_view text);

/// Throws the error that OutputFile would, before hours of work are spent on what cannot be written.
/// @param inputs     files that are read: writing over one would destroy it
/// @param extension  what the file's name must end in, with the dot; empty: anything
void check_writable(const std::filesystem::path& path, std::span<const std::filesystem::path> inputs = {},
                    std::string_view extension = "");

}  // namespace brume
