#include "image/exr_common.h"

#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfIntAttribute.h>
#include <ImfMatrixAttribute.h>
#include <ImfRgbaYca.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>

#include "base/error.h"
#include "base/parallel_for.h"

namespace brume {

namespace fs = std::filesystem;

Imf::MultiPartInputFile open_exr(const fs::path& path) {
  constexpr int kLongestSide = 1 << 16;  // pixels; no header makes us reserve more
  std::error_code ignored;
  if (!fs::exists(path, ignored)) throw InputError(fmt::format("{}: no such file", path.string()));
  if (fs::is_directory(path, ignored))
    throw InputError(fmt::format("{}: is a folder, expected an OpenEXR file", path.string()));
  if (fs::is_regular_file(path, ignored) && fs::file_size(path, ignored) == 0)
    throw InputError(fmt::format("{}: is empty, 0 bytes; expected an OpenEXR file", path.string()));
  try {
    Imf::Header::setMaxImageSize(kLongestSide, kLongestSide);
    return Imf::MultiPartInputFile(path.c_str());
  } catch (const std::exception& error) {
    fail_exr(path, "not a readable OpenEXR file", error);
  }
}

void fail_exr(const fs::path& path, const std::string& state, const std::exception& error) {
  if (const auto* const memory = dynamic_cast<const std::bad_alloc*>(&error)) fail_reading(path.string(), *memory);
  const std::string_view said = error.what();
  for (const char* const word : {"bad_alloc", "allocate memory"})
    if (said.find(word) != std::string_view::npos) throw OutOfMemory(path.string(), "read it");
  throw InputError(fmt::format("{}: {}: {}", path.string(), state, said));
}

void check_exr_memory(const fs::path& path, double bytes) {
  if (bytes > 0.8 * physical_memory())
    throw OutOfMemory(fmt::format("{}: {}: its pixels need {:.1f} GB, this machine has {:.1f} GB", path.string(),
                                  kNotEnoughMemory, bytes / 1e9, physical_memory() / 1e9));
}

std::string part_label(const Imf::MultiPartInputFile& file, int part) {
  const Imf::Header& header = file.header(part);
  if (header.hasName()) return fmt::format("part '{}'", header.name());
  return file.parts() < 2 ? "its only part" : fmt::format("part {}", part + 1);
}

std::string channel_name_in_frame(const Imf::MultiPartInputFile& file, int part, const std::string& channel) {
  const Imf::Header& header = file.header(part);
  if (file.parts() < 2 || !header.hasName() || channel.starts_with(header.name() + ".")) return channel;
  return header.name() + "." + channel;
}

void insert_attribute(Imf::Header& header, const std::string& name, const Attribute& value) {
  if (const auto* s = std::get_if<std::string>(&value)) header.insert(name, Imf::StringAttribute(*s));
  if (const auto* i = std::get_if<int>(&value)) header.insert(name, Imf::IntAttribute(*i));
  if (const auto* f = std::get_if<float>(&value)) header.insert(name, Imf::FloatAttribute(*f));
  if (const auto* m = std::get_if<std::array<float, 16>>(&value)) {
    Imath::M44f matrix;
    for (size_t k = 0; k < 16; ++k) matrix[static_cast<int>(k / 4)][k % 4] = (*m)[k];
    header.insert(name, Imf::M44fAttribute(matrix));
  }
}

Imath::Box2i box_of(const PixelWindow& w) {
  return {Imath::V2i(w.lo.x, w.lo.y), Imath::V2i(w.hi.x - 1, w.hi.y - 1)};
}

PixelWindow window_of(const Imath::Box2i& b) {
  return {{b.min.x, b.min.y}, {b.max.x + 1, b.max.y + 1}};
}

std::optional<std::string> chroma_layer(const Imf::ChannelList& channels) {
  for (auto c = channels.begin(); c != channels.end(); ++c) {
    const std::string name = c.name();
    if (name != "RY" && !name.ends_with(".RY")) continue;
    const std::string layer = name.substr(0, name.size() - 2);
    if (channels.findChannel(layer + "Y") && channels.findChannel(layer + "BY") && !channels.findChannel(layer + "R"))
      return layer;
  }
  return std::nullopt;
}

std::array<float, 3> luminance_weights(const Imf::Header& header) {
  const Imath::V3f w =
      Imf::RgbaYca::computeYw(Imf::hasChromaticities(header) ? Imf::chromaticities(header) : Imf::Chromaticities());
  return {w.x, w.y, w.z};
}

}  // namespace brume
