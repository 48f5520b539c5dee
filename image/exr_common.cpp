#include "image/exr_common.h"

#include <ImfChannelList.h>
#include <ImfChromaticitiesAttribute.h>
#include <ImfEnvmapAttribute.h>
#include <ImfFloatAttribute.h>
#include <ImfIntAttribute.h>
#include <ImfMatrixAttribute.h>
#include <ImfPartType.h>
#include <ImfRgbaYca.h>
#include <ImfStandardAttributes.h>
#include <ImfStringAttribute.h>
#include <ImfVersion.h>
#include <fmt/format.h>
#include <libdeflate.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <stdexcept>

#include "base/error.h"
#include "base/file_kind.h"
#include "base/parallel_for.h"

namespace brume {

namespace fs = std::filesystem;

namespace {

// Written by the library itself or describing the pixels' packing: not ours to copy.
bool is_structural(const std::string& name) {
  static const char* const names[] = {"channels",          "compression", "dataWindow",       "displayWindow",
                                      "lineOrder",         "type",        "pixelAspectRatio", "screenWindowCenter",
                                      "screenWindowWidth", "tiles",       "chunkCount",       "fileChecksum"};
  return std::any_of(std::begin(names), std::end(names), [&](const char* n) { return name == n; });
}

/// Refuses what was packed by a method that this OpenEXR does not know. @param method  as the header has it
void check_compression(const fs::path& path, int method) {
  if (method < Imf::NUM_COMPRESSION_METHODS) return;
  throw InputError(
      fmt::format("{}: is packed by {}, which OpenEXR {} does not read; write it as ZIP or PIZ, as oiiotool "
                  "IN.exr --compression zip -o OUT.exr of a newer OpenEXR does",
                  path.string(), method == 10 || method == 11 ? "HTJ2K" : fmt::format("the unknown method {}", method),
                  OPENEXR_VERSION_STRING));
}

/// Refuses channel lists that are not in the order of their names, as the format wants them. OpenEXR sorts what it
/// reads and takes the pixels in that order: a damaged name would give one channel's values to another.
void check_channel_order(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  int32_t begin[2] = {};
  file.read(reinterpret_cast<char*>(begin), sizeof begin);
  if (!file || begin[0] != Imf::MAGIC) return;  // not an EXR
  const auto attribute = [&](std::string& name, std::string& bytes) {
    std::string type;
    int32_t size = 0;
    if (!std::getline(file, name, '\0') || name.empty() || !std::getline(file, type, '\0')) return false;
    file.read(reinterpret_cast<char*>(&size), sizeof size);
    bytes.clear();
    if (!file || size < 0) return false;
    if (name != "channels" && name != "compression") {
      file.seekg(size, std::ios::cur);
    } else {
      bytes.resize(std::min(static_cast<uintmax_t>(size), fs::file_size(path)));
      file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    }
    return static_cast<bool>(file);
  };
  constexpr size_t kAfterName = 16;  // bytes: type, linearity, subsampling
  std::string name, bytes;
  for (bool last = false; !last;) {  // of a file's headers, an empty one is the last
    last = true;
    while (attribute(name, bytes)) {
      last = false;
      if (name == "compression" && !bytes.empty()) check_compression(path, static_cast<uint8_t>(bytes[0]));
      if (name != "channels") continue;
      std::string before;
      for (size_t at = 0; at < bytes.size() && bytes[at] != '\0';) {
        const std::string channel = bytes.c_str() + at;
        if (channel <= before)
          throw InputError(fmt::format("{}: damaged: its list of channels has '{}' after '{}'; expected them in order",
                                       path.string(), channel, before));
        before = channel;
        at += channel.size() + 1 + kAfterName;
      }
    }
    if (!Imf::isMultiPart(begin[1])) break;
  }
}

/// Refuses other kinds of files with what to do instead.
void check_kind(const fs::path& path) {
  const KnownFile file = known_file(path);
  std::string advice;
  switch (file.kind) {
    case FileKind::kDisplay:
      advice =
          "its values are encoded and cut off for a display, so that the mean of noisy pixels is not the clean one; let "
          "the renderer write EXR. If this is all there is: oiiotool {} --colorconvert sRGB linear -d float -o IN.exr";
      break;
    case FileKind::kPicture:
      advice =
          "oiiotool {} -d float -o IN.exr makes one, with --colorconvert sRGB linear where it was encoded for a display";
      break;
    case FileKind::kOpenVdb:
    case FileKind::kNanoVdb:
      advice = "brume render {} --clean -o OUT.exr makes a picture of it";
      break;
    default:
      return;
  }
  throw InputError(fmt::format("{}: is {}, expected OpenEXR; {}", path.string(), file.what,
                               fmt::format(fmt::runtime(advice), path.filename().string())));
}

}  // namespace

Imf::MultiPartInputFile open_exr(const fs::path& path) {
  constexpr int kLongestSide = 1 << 16;  // pixels; no header makes us reserve more
  check_readable(path, "an OpenEXR file");
  check_kind(path);
  try {
    Imf::Header::setMaxImageSize(kLongestSide, kLongestSide);
    check_channel_order(path);
    return Imf::MultiPartInputFile(path.c_str());
  } catch (const std::exception& error) {
    fail_exr(path, "not a readable OpenEXR file", error);
  }
}

void fail_exr(const fs::path& path, const std::string& state, const std::exception& error) {
  if (dynamic_cast<const InputError*>(&error) || dynamic_cast<const Interrupted*>(&error)) throw;
  if (const auto* const memory = dynamic_cast<const std::bad_alloc*>(&error)) fail_reading(path.string(), *memory);
  const std::string_view said = error.what();
  for (const char* const word : {"bad_alloc", "allocate memory"})
    if (said.find(word) != std::string_view::npos) throw OutOfMemory(path.string(), "read it");
  throw InputError(fmt::format("{}: {}: {}", path.string(), state, said));
}

bool is_deep(const Imf::Header& header) {
  return header.hasType() && Imf::isDeepData(header.type());
}

void fail_deep(const fs::path& path, const std::string& part) {
  throw InputError(
      fmt::format("{}: {} holds deep pixels; expected flat ones, as brume flatten makes of them", path.string(), part));
}

void check_first_chunk(Imf::InputPart& part, const fs::path& path) {
  const Imf::Header& header = part.header();
  const Imf::Compression compression = header.compression();
  const bool packed = compression == Imf::ZIP_COMPRESSION || compression == Imf::ZIPS_COMPRESSION;
  if (header.hasTileDescription() || !(packed || compression == Imf::NO_COMPRESSION)) return;
  const Imath::Box2i data = header.dataWindow();
  const int first = header.lineOrder() == Imf::DECREASING_Y ? data.max.y : data.min.y;
  const int lines = compression == Imf::ZIP_COMPRESSION ? 16 : 1;
  const int begin = data.min.y + (first - data.min.y) / lines * lines, end = std::min(begin + lines - 1, data.max.y);
  size_t expected = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    const Imf::Channel& channel = c.channel();
    const auto count = [](int lo, int hi, int step) {
      size_t n = 0;
      for (int i = lo; i <= hi; ++i) n += i % step == 0;
      return n;
    };
    expected += count(data.min.x, data.max.x, channel.xSampling) * count(begin, end, channel.ySampling) *
                (channel.type == Imf::HALF ? 2 : 4);
  }
  const char* bytes = nullptr;
  int size = 0;
  part.rawPixelData(begin, bytes, size);
  // What packing would not make smaller is stored as it is.
  bool right = static_cast<size_t>(size) == expected;
  if (packed && !right && static_cast<size_t>(size) < expected) {
    std::vector<char> plain(expected);
    const std::unique_ptr<libdeflate_decompressor, decltype(&libdeflate_free_decompressor)> unpack(
        libdeflate_alloc_decompressor(), libdeflate_free_decompressor);
    right = unpack && libdeflate_zlib_decompress(unpack.get(), bytes, static_cast<size_t>(size), plain.data(), expected,
                                                 nullptr) == LIBDEFLATE_SUCCESS;
  }
  if (!right)
    throw InputError(fmt::format(
        "{}: truncated or damaged: the lines {} .. {} do not hold the {} bytes that the types and subsampling of its channels ask for",
        path.string(), begin, end, expected));
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
  if (const auto* s = std::get_if<std::string>(&value)) {
    if (name == kEnvmap)
      header.insert(name, Imf::EnvmapAttribute(*s == kCube ? Imf::ENVMAP_CUBE : Imf::ENVMAP_LATLONG));
    else
      header.insert(name, Imf::StringAttribute(*s));
  }
  if (const auto* i = std::get_if<int>(&value)) header.insert(name, Imf::IntAttribute(*i));
  if (const auto* f = std::get_if<float>(&value)) header.insert(name, Imf::FloatAttribute(*f));
  if (const auto* m = std::get_if<std::array<float, 16>>(&value)) {
    Imath::M44f matrix;
    for (size_t k = 0; k < 16; ++k) matrix[static_cast<int>(k / 4)][k % 4] = (*m)[k];
    header.insert(name, Imf::M44fAttribute(matrix));
  }
  if (const auto* c = std::get_if<Chromaticities>(&value)) {
    const auto at = [&](size_t k) { return Imath::V2f((*c)[k], (*c)[k + 1]); };
    header.insert(name, Imf::ChromaticitiesAttribute(Imf::Chromaticities(at(0), at(2), at(4), at(6))));
  }
}

std::map<std::string, Attribute> exr_attributes(const Imf::Header& header, bool one_of_several) {
  std::map<std::string, Attribute> result;
  for (auto it = header.begin(); it != header.end(); ++it) {
    const std::string name = it.name();
    if (is_structural(name) || (one_of_several && (name == "name" || name == "view"))) continue;
    const Imf::Attribute& attribute = it.attribute();
    if (const auto* s = dynamic_cast<const Imf::StringAttribute*>(&attribute)) result[name] = s->value();
    if (const auto* i = dynamic_cast<const Imf::IntAttribute*>(&attribute)) result[name] = i->value();
    if (const auto* f = dynamic_cast<const Imf::FloatAttribute*>(&attribute)) result[name] = f->value();
    if (const auto* m = dynamic_cast<const Imf::M44fAttribute*>(&attribute)) {
      std::array<float, 16> values;
      for (size_t i = 0; i < 16; ++i) values[i] = m->value()[static_cast<int>(i / 4)][i % 4];
      result[name] = values;
    }
    if (const auto* c = dynamic_cast<const Imf::ChromaticitiesAttribute*>(&attribute)) {
      const Imf::Chromaticities& v = c->value();
      result[name] = Chromaticities{v.red.x, v.red.y, v.green.x, v.green.y, v.blue.x, v.blue.y, v.white.x, v.white.y};
    }
    if (const auto* e = dynamic_cast<const Imf::EnvmapAttribute*>(&attribute); e && name == kEnvmap)
      result[name] = std::string(e->value() == Imf::ENVMAP_CUBE ? kCube : "latlong");
  }
  return result;
}

ExrOutputStream::ExrOutputStream(const fs::path& path) : Imf::OStream(path.c_str()), file_(path, std::ios::binary) {
  check();
}

void ExrOutputStream::write(const char bytes[], int count) {
  file_.write(bytes, count);
  check();
}

void ExrOutputStream::seekp(uint64_t position) {
  file_.seekp(static_cast<std::streamoff>(position));
  check();
}

void ExrOutputStream::close() {
  file_.close();
  check();
}

void ExrOutputStream::check() const {
  if (!file_) throw std::runtime_error(std::strerror(errno));
}

half to_half(float value) {
  return std::isfinite(value) ? half(std::clamp(value, -static_cast<float>(HALF_MAX), static_cast<float>(HALF_MAX)))
                              : half(value);
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
