#pragma once
#include <ImfHeader.h>
#include <ImfPixelType.h>

#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace brume::test {

/// A part of an OpenEXR file that a test writes, whatever brume itself would write.
struct ExrPart {
  Imf::Header header;
  /// The value of a pixel; whole numbers are rounded down, half values to nearest.
  std::function<double(const std::string& channel, int x, int y)> value;
};

/// A header of scan lines without compression, whose data window is its display window.
Imf::Header exr_header(int width, int height);
/// Adds channels of one type: "R", "albedo.G".
void add_channels(Imf::Header& header, const std::vector<std::string>& names, Imf::PixelType type);
/// Of a layer: "LAYER.R" and so on; "R" and so on for an empty name.
std::vector<std::string> channels_of(const std::string& layer, const std::string& letters = "RGB");

/// Writes all resolution levels of all parts; values of lower levels are those of their own pixels.
void write_exr_file(const std::filesystem::path& path, const std::vector<ExrPart>& parts);

/// Writes 4 x 4 deep pixels without samples, as a part `smoke`.
void write_deep_exr(const std::filesystem::path& path);

/// Writes a part `smoke` of deep pixels with up to two samples, as large as the flat part that follows it.
void write_deep_and_flat_exr(const std::filesystem::path& path, const ExrPart& flat);
/// The packed lines of a part of deep scan lines.
std::string deep_bytes(const std::filesystem::path& path, const std::string& part);

/// Raw values of one channel at one resolution level, row by row, as 32 bits each.
using ExrBits = std::vector<uint32_t>;
/// "PART/CHANNEL/LX,LY" to its values.
std::map<std::string, ExrBits> exr_bits(const std::filesystem::path& path);
/// "PART/ATTRIBUTE" to its type and stored bytes, without those in which the channel list, the version of the file or
/// its number of chunks stand.
std::map<std::string, std::string> exr_attributes(const std::filesystem::path& path);
/// "PART/CHANNEL" to "type xSampling ySampling pLinear", in the file's order of parts.
std::vector<std::pair<std::string, std::string>> exr_channels(const std::filesystem::path& path);

/// The names in which two maps differ, one has and the other lacks.
template <class Map>
std::set<std::string> differing(const Map& a, const Map& b) {
  std::set<std::string> names;
  for (const auto& [name, value] : a)
    if (const auto it = b.find(name); it == b.end() || it->second != value) names.insert(name);
  for (const auto& [name, value] : b)
    if (!a.contains(name)) names.insert(name);
  return names;
}

}  // namespace brume::test
