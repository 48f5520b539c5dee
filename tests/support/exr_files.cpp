#include "tests/support/exr_files.h"

#include <ImfChannelList.h>
#include <ImfDeepFrameBuffer.h>
#include <ImfDeepScanLineInputPart.h>
#include <ImfDeepScanLineOutputFile.h>
#include <ImfDeepScanLineOutputPart.h>
#include <ImfFrameBuffer.h>
#include <ImfInputPart.h>
#include <ImfMultiPartInputFile.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStdIO.h>
#include <ImfTiledInputPart.h>
#include <ImfTiledOutputFile.h>
#include <ImfTiledOutputPart.h>
#include <ImfVersion.h>

#include <cstring>
#include <list>

namespace brume::test {
namespace {

/// Room for one channel over a box, and its place in a frame buffer.
struct Room {
  std::vector<char> bytes;
  Imf::PixelType type;
  Imath::Box2i box;
  int step_x, step_y;

  Room(const Imf::Channel& channel, const Imath::Box2i& box_)
      : type(channel.type), box(box_), step_x(channel.xSampling), step_y(channel.ySampling) {
    bytes.resize(static_cast<size_t>(columns()) * static_cast<size_t>(rows()) * size());
  }
  size_t size() const { return type == Imf::HALF ? 2 : 4; }
  int columns() const { return (box.max.x - box.min.x) / step_x + 1; }
  int rows() const { return (box.max.y - box.min.y) / step_y + 1; }
  Imf::Slice slice() {
    return Imf::Slice::Make(type, bytes.data(), box, size(), size() * static_cast<size_t>(columns()), step_x, step_y);
  }
  void put(size_t index, double value) {
    char* const to = bytes.data() + index * size();
    const half h(static_cast<float>(value));
    const float f = static_cast<float>(value);
    const auto u = static_cast<uint32_t>(value);
    std::memcpy(to,
                type == Imf::HALF    ? static_cast<const void*>(&h)
                : type == Imf::FLOAT ? static_cast<const void*>(&f)
                                     : &u,
                size());
  }
  ExrBits bits() const {
    ExrBits all(bytes.size() / size(), 0u);
    for (size_t i = 0; i < all.size(); ++i) std::memcpy(&all[i], bytes.data() + i * size(), size());
    return all;
  }
};

Imf::FrameBuffer filled(const ExrPart& part, const Imath::Box2i& box, std::list<Room>& rooms) {
  Imf::FrameBuffer buffer;
  for (auto c = part.header.channels().begin(); c != part.header.channels().end(); ++c) {
    Room& room = rooms.emplace_back(c.channel(), box);
    size_t i = 0;
    for (int y = 0; y < room.rows(); ++y)
      for (int x = 0; x < room.columns(); ++x)
        room.put(i++, part.value(c.name(), box.min.x + x * room.step_x, box.min.y + y * room.step_y));
    buffer.insert(c.name(), room.slice());
  }
  return buffer;
}

template <class Out>
void write_tiles(const ExrPart& part, Out& out) {
  for (int ly = 0; ly < out.numYLevels(); ++ly)
    for (int lx = 0; lx < out.numXLevels(); ++lx) {
      if (!out.isValidLevel(lx, ly)) continue;
      std::list<Room> rooms;
      out.setFrameBuffer(filled(part, out.dataWindowForLevel(lx, ly), rooms));
      out.writeTiles(0, out.numXTiles(lx) - 1, 0, out.numYTiles(ly) - 1, lx, ly);
    }
}

template <class Out>
void write_lines(const ExrPart& part, Out& out) {
  const Imath::Box2i data = part.header.dataWindow();
  std::list<Room> rooms;
  out.setFrameBuffer(filled(part, data, rooms));
  out.writePixels(data.max.y - data.min.y + 1);
}

std::string part_name(const Imf::Header& header) {
  return header.hasName() ? header.name() : "";
}

}  // namespace

Imf::Header exr_header(int width, int height) {
  Imf::Header header(width, height);
  header.compression() = Imf::NO_COMPRESSION;
  return header;
}

void add_channels(Imf::Header& header, const std::vector<std::string>& names, Imf::PixelType type) {
  for (const std::string& name : names) header.channels().insert(name, Imf::Channel(type));
}

std::vector<std::string> channels_of(const std::string& layer, const std::string& letters) {
  std::vector<std::string> names;
  for (const char letter : letters) names.push_back((layer.empty() ? "" : layer + ".") + letter);
  return names;
}

void write_exr_file(const std::filesystem::path& path, const std::vector<ExrPart>& parts) {
  if (parts.size() == 1) {
    if (parts[0].header.hasTileDescription()) {
      Imf::TiledOutputFile out(path.c_str(), parts[0].header);
      write_tiles(parts[0], out);
    } else {
      Imf::OutputFile out(path.c_str(), parts[0].header);
      write_lines(parts[0], out);
    }
    return;
  }
  std::vector<Imf::Header> headers;
  for (const ExrPart& part : parts) {
    headers.push_back(part.header);
    headers.back().setType(part.header.hasTileDescription() ? Imf::TILEDIMAGE : Imf::SCANLINEIMAGE);
  }
  Imf::MultiPartOutputFile file(path.c_str(), headers.data(), static_cast<int>(headers.size()));
  for (int index = 0; index < static_cast<int>(parts.size()); ++index) {
    const ExrPart& part = parts[static_cast<size_t>(index)];
    if (part.header.hasTileDescription()) {
      Imf::TiledOutputPart out(file, index);
      write_tiles(part, out);
    } else {
      Imf::OutputPart out(file, index);
      write_lines(part, out);
    }
  }
}

void write_deep_exr(const std::filesystem::path& path) {
  Imf::Header header(4, 4);
  header.setName("smoke");
  header.setType(Imf::DEEPSCANLINE);
  header.compression() = Imf::ZIPS_COMPRESSION;
  add_channels(header, {"Z"}, Imf::FLOAT);
  Imf::DeepScanLineOutputFile out(path.c_str(), header);
  std::vector<unsigned> counts(16, 0);
  std::vector<float*> samples(16, nullptr);
  Imf::DeepFrameBuffer buffer;
  buffer.insertSampleCountSlice(Imf::Slice(Imf::UINT, reinterpret_cast<char*>(counts.data()), 4, 16));
  buffer.insert("Z", Imf::DeepSlice(Imf::FLOAT, reinterpret_cast<char*>(samples.data()), sizeof(float*),
                                    4 * sizeof(float*), sizeof(float)));
  out.setFrameBuffer(buffer);
  out.writePixels(4);
}

void write_deep_and_flat_exr(const std::filesystem::path& path, const ExrPart& flat) {
  const Imath::Box2i window = flat.header.displayWindow();
  const int width = window.max.x + 1, height = window.max.y + 1;
  Imf::Header deep(width, height);
  deep.setName("smoke");
  deep.setType(Imf::DEEPSCANLINE);
  deep.compression() = Imf::ZIPS_COMPRESSION;
  add_channels(deep, {"A", "Z"}, Imf::FLOAT);
  const Imf::Header headers[] = {deep, flat.header};
  Imf::MultiPartOutputFile file(path.c_str(), headers, 2);
  {
    const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
    std::vector<unsigned> counts(pixels);
    std::vector<float> values(2 * pixels);
    std::vector<float*> samples(pixels);
    for (size_t i = 0; i < pixels; ++i) {
      counts[i] = static_cast<unsigned>(i % 3);
      samples[i] = &values[2 * i];
      values[2 * i] = static_cast<float>(i % 7);
      values[2 * i + 1] = static_cast<float>(i % 5);
    }
    const auto row = static_cast<size_t>(width);
    Imf::DeepFrameBuffer buffer;
    buffer.insertSampleCountSlice(
        Imf::Slice(Imf::UINT, reinterpret_cast<char*>(counts.data()), sizeof(unsigned), row * sizeof(unsigned)));
    for (const char* channel : {"A", "Z"})
      buffer.insert(channel, Imf::DeepSlice(Imf::FLOAT, reinterpret_cast<char*>(samples.data()), sizeof(float*),
                                            row * sizeof(float*), sizeof(float)));
    Imf::DeepScanLineOutputPart out(file, 0);
    out.setFrameBuffer(buffer);
    out.writePixels(height);
  }
  Imf::OutputPart out(file, 1);
  write_lines(flat, out);
}

std::string deep_bytes(const std::filesystem::path& path, const std::string& part) {
  Imf::MultiPartInputFile file(path.c_str());
  std::string all;
  for (int index = 0; index < file.parts(); ++index) {
    if (file.header(index).name() != part) continue;
    Imf::DeepScanLineInputPart in(file, index);
    const Imath::Box2i window = in.header().dataWindow();
    for (int y = window.min.y; y <= window.max.y; ++y) {
      uint64_t size = 0;
      in.rawPixelData(y, nullptr, size);
      std::string bytes(size, '\0');
      in.rawPixelData(y, bytes.data(), size);
      all += bytes;
    }
  }
  return all;
}

std::map<std::string, ExrBits> exr_bits(const std::filesystem::path& path) {
  std::map<std::string, ExrBits> result;
  Imf::MultiPartInputFile file(path.c_str());
  for (int index = 0; index < file.parts(); ++index) {
    const Imf::Header& header = file.header(index);
    const auto level = [&](const Imath::Box2i& box, const std::string& name, const auto& read) {
      std::list<Room> rooms;
      Imf::FrameBuffer buffer;
      for (auto c = header.channels().begin(); c != header.channels().end(); ++c)
        buffer.insert(c.name(), rooms.emplace_back(c.channel(), box).slice());
      read(buffer);
      auto room = rooms.begin();
      for (auto c = header.channels().begin(); c != header.channels().end(); ++c, ++room)
        result[part_name(header) + "/" + c.name() + "/" + name] = room->bits();
    };
    if (!header.hasTileDescription()) {
      Imf::InputPart in(file, index);
      level(header.dataWindow(), "0,0", [&](const Imf::FrameBuffer& buffer) {
        in.setFrameBuffer(buffer);
        in.readPixels(header.dataWindow().min.y, header.dataWindow().max.y);
      });
      continue;
    }
    Imf::TiledInputPart in(file, index);
    for (int ly = 0; ly < in.numYLevels(); ++ly)
      for (int lx = 0; lx < in.numXLevels(); ++lx)
        if (in.isValidLevel(lx, ly))
          level(in.dataWindowForLevel(lx, ly), std::to_string(lx) + "," + std::to_string(ly),
                [&](const Imf::FrameBuffer& buffer) {
                  in.setFrameBuffer(buffer);
                  in.readTiles(0, in.numXTiles(lx) - 1, 0, in.numYTiles(ly) - 1, lx, ly);
                });
  }
  return result;
}

std::map<std::string, std::string> exr_attributes(const std::filesystem::path& path) {
  // Read as they are stored: MultiPartInputFile adds some of its own.
  std::map<std::string, std::string> result;
  Imf::StdIFStream stream(path.c_str());
  char begin[8];
  stream.read(begin, sizeof(begin));
  int version;
  std::memcpy(&version, begin + 4, sizeof(version));
  while (true) {
    Imf::Header header;
    header.readFrom(stream, version);
    if (header.readsNothing()) break;
    for (auto a = header.begin(); a != header.end(); ++a) {
      if (std::string(a.name()) == "channels" || std::string(a.name()) == "chunkCount") continue;
      Imf::StdOSStream bytes;
      a.attribute().writeValueTo(bytes, version);
      result[part_name(header) + "/" + a.name()] = a.attribute().typeName() + (":" + bytes.str());
    }
    if (!Imf::isMultiPart(version)) break;
  }
  return result;
}

std::vector<std::pair<std::string, std::string>> exr_channels(const std::filesystem::path& path) {
  std::vector<std::pair<std::string, std::string>> result;
  Imf::MultiPartInputFile file(path.c_str());
  for (int index = 0; index < file.parts(); ++index) {
    const Imf::Header& header = file.header(index);
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c)
      result.emplace_back(part_name(header) + "/" + c.name(),
                          std::to_string(c.channel().type) + " " + std::to_string(c.channel().xSampling) + " " +
                              std::to_string(c.channel().ySampling) + " " + std::to_string(c.channel().pLinear));
  }
  return result;
}

}  // namespace brume::test
