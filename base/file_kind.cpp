#include "base/file_kind.h"

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "base/error.h"
#include "base/missing_file.h"

namespace brume {
namespace {

using namespace std::string_view_literals;

struct Beginning {
  std::string_view bytes;
  FileKind kind;
  const char* what;
};

constexpr Beginning kBeginnings[] = {
    {"\x76\x2f\x31\x01"sv, FileKind::kOpenExr, "an OpenEXR file"},
    {" BDV"sv, FileKind::kOpenVdb, "an OpenVDB file"},
    {"Nano"sv, FileKind::kNanoVdb, "a NanoVDB file"},
    {"#?RADIANCE"sv, FileKind::kRadiance, "a Radiance HDR picture"},
    {"#?RGBE"sv, FileKind::kRadiance, "a Radiance HDR picture"},
    {"PF\n"sv, FileKind::kFloatMap, "a portable float map"},
    {"Pf\n"sv, FileKind::kFloatMap, "a portable float map"},
    {"\x89PNG"sv, FileKind::kDisplay, "a PNG picture"},
    {"\xff\xd8\xff"sv, FileKind::kDisplay, "a JPEG picture"},
    {"GIF8"sv, FileKind::kDisplay, "a GIF picture"},
    {"BM"sv, FileKind::kDisplay, "a BMP picture"},
    {"P3\n"sv, FileKind::kDisplay, "a PPM picture"},
    {"P6\n"sv, FileKind::kDisplay, "a PPM picture"},
    {"II*\0"sv, FileKind::kPicture, "a TIFF picture"},
    {"MM\0*"sv, FileKind::kPicture, "a TIFF picture"},
    {"SDPX"sv, FileKind::kPicture, "a DPX picture"},
    {"XPDS"sv, FileKind::kPicture, "a DPX picture"},
    {"8BPS"sv, FileKind::kPicture, "a Photoshop picture"},
    {"\0\0\0\x0cjP"sv, FileKind::kPicture, "a JPEG 2000 picture"},
};

}  // namespace

KnownFile known_file(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return {};
  std::array<char, 12> begin{};
  std::ifstream file(path, std::ios::binary);
  file.read(begin.data(), begin.size());
  const std::string_view found(begin.data(), static_cast<size_t>(file.gcount()));
  for (const Beginning& b : kBeginnings)
    if (found.starts_with(b.bytes)) return {b.kind, b.what};
  if (found.starts_with("RIFF") && found.substr(8) == "WEBP") return {FileKind::kDisplay, "a WebP picture"};
  return {};
}

void check_readable(const std::filesystem::path& path, std::string_view expected) {
  namespace fs = std::filesystem;
  const auto fail = [&](const std::string& found) { throw InputError(fmt::format("{}: {}", path.string(), found)); };
  std::error_code ignored;
  check_exists(path);
  if (fs::is_directory(path, ignored)) fail(fmt::format("is a folder, expected {}", expected));
  if (!fs::is_regular_file(path, ignored))
    fail(fmt::format("is a pipe or a device, expected {}, which is not read from its beginning to its end", expected));
  if (!std::ifstream(path)) fail(fmt::format("cannot be opened: {}", std::strerror(errno)));
  if (fs::file_size(path, ignored) == 0) fail(fmt::format("is empty, 0 bytes; expected {}", expected));
}

}  // namespace brume
