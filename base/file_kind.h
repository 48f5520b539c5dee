#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace brume {

/// What a file is, by its first bytes.
enum class FileKind {
  kUnknown,
  kOpenExr,
  kOpenVdb,
  kNanoVdb,
  kRadiance,
  kFloatMap,  ///< portable float map
  kDisplay,   ///< a picture whose values are encoded for a display, as a rule with 8 bits: PNG, JPEG and the like
  kPicture,   ///< another picture: TIFF, DPX, Photoshop, JPEG 2000
};

struct KnownFile {
  FileKind kind = FileKind::kUnknown;
  std::string what;  ///< "a PNG picture"; empty where it is unknown
};

/// Nothing known of what cannot be opened. Does not read from pipes, which lose what is read.
KnownFile known_file(const std::filesystem::path& path);

/// Refuses what no reader can read: nothing, a folder, a pipe, what may not be opened, an empty file.
/// @param expected  "an OpenEXR file"   @throws InputError
void check_readable(const std::filesystem::path& path, std::string_view expected);

}  // namespace brume
