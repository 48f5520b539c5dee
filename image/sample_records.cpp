#include "image/sample_records.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>

#include "base/error.h"
#include "base/missing_file.h"
#include "image/checksum.h"

namespace brume {
namespace {

constexpr const char* kMagic = "brume-records 2";

}  // namespace

int RecordLayout::components() const {
  return std::accumulate(fields.begin(), fields.end(), 0, [](int sum, const Field& f) { return sum + f.components; });
}

RecordLayout::Bounds RecordLayout::bounds(int i) const {
  const int x0 = i % tiles_x() * tile, y0 = i / tiles_x() * tile;
  return {x0, y0, std::min(x0 + tile, width), std::min(y0 + tile, height)};
}

uint64_t RecordLayout::values() const {
  return static_cast<uint64_t>(width) * height * samples * components();
}

size_t RecordLayout::block_size(int i) const {
  return bounds(i).pixels() * static_cast<size_t>(samples) * static_cast<size_t>(components());
}

uint64_t RecordLayout::block_offset(int i) const {
  // Whole rows of tiles above, then the tiles to the left.
  const Bounds b = bounds(i);
  const uint64_t pixels = static_cast<uint64_t>(b.y0) * width + static_cast<uint64_t>(b.x0) * (b.y1 - b.y0);
  return pixels * samples * components();
}

RecordWriter::RecordWriter(const std::filesystem::path& path, const RecordLayout& layout)
    : layout_(layout), output_(path) {
  nlohmann::json header = {
      {"width", layout.width},     {"height", layout.height},           {"tile", layout.tile},
      {"samples", layout.samples}, {"fields", nlohmann::json::array()}, {"description", layout.description}};
  for (const RecordLayout::Field& f : layout.fields)
    header["fields"].push_back({{"name", f.name}, {"components", f.components}});
  const std::string text = fmt::format("{}\n{}\n", kMagic, header.dump());
  data_begin_ = text.size();
  checksums_.resize(1 + static_cast<size_t>(layout.tile_count()));
  checksums_[0] = crc32(std::as_bytes(std::span(text)));
  stream_.open(output_.part(), std::ios::binary);
  if (!(stream_ << text)) throw InputError(fmt::format("{}: cannot be written", path.string()));
}

void RecordWriter::write(int tile, const std::vector<float>& values) {
  const std::lock_guard lock(writing_);
  checksums_[1 + static_cast<size_t>(tile)] = crc32(std::as_bytes(std::span(values)));
  stream_.seekp(static_cast<std::streamoff>(data_begin_ + layout_.block_offset(tile) * sizeof(float)));
  stream_.write(reinterpret_cast<const char*>(values.data()),
                static_cast<std::streamsize>(values.size() * sizeof(float)));
  if (!stream_) throw InputError(fmt::format("{}: cannot be written; is the disk full?", output_.part().string()));
}

void RecordWriter::commit() {
  stream_.seekp(static_cast<std::streamoff>(data_begin_ + layout_.values() * sizeof(float)));
  stream_.write(reinterpret_cast<const char*>(checksums_.data()),
                static_cast<std::streamsize>(checksums_.size() * sizeof(uint32_t)));
  stream_.close();
  if (!stream_) throw InputError(fmt::format("{}: cannot be written; is the disk full?", output_.part().string()));
  output_.commit();
}

RecordReader::RecordReader(const std::filesystem::path& path) : path_(path), stream_(path, std::ios::binary) {
  const auto fail = [&](const std::string& what) { throw InputError(fmt::format("{}: {}", path.string(), what)); };
  check_exists(path);
  if (!stream_) fail("cannot be opened");
  std::string magic, header;
  std::getline(stream_, magic);
  if (magic != kMagic) fail("not a file of sample records; expected one written by brume render --records");
  std::getline(stream_, header);
  data_begin_ = magic.size() + header.size() + 2;
  try {
    const auto json = nlohmann::json::parse(header);
    layout_.width = json.at("width");
    layout_.height = json.at("height");
    layout_.tile = json.at("tile");
    layout_.samples = json.at("samples");
    layout_.description = json.at("description");
    for (const auto& f : json.at("fields")) layout_.fields.push_back({f.at("name"), f.at("components")});
  } catch (const nlohmann::json::exception& error) {
    fail(fmt::format("damaged header: {}", error.what()));
  }
  constexpr int kLongestSide = 1 << 16;
  if (std::min({layout_.width, layout_.height, layout_.tile, layout_.samples}) < 1 ||
      std::max(layout_.width, layout_.height) > kLongestSide)
    fail("damaged header: sizes");
  const auto along = [&](int side) { return (static_cast<uint64_t>(side) + layout_.tile - 1) / layout_.tile; };
  const uint64_t tiles = along(layout_.width) * along(layout_.height);
  const uint64_t data_end = data_begin_ + layout_.values() * sizeof(float);
  const uint64_t expected = data_end + (1 + tiles) * sizeof(uint32_t);
  const uint64_t found = std::filesystem::file_size(path);
  if (found != expected) fail(fmt::format("truncated or damaged: {} bytes, its header promises {}", found, expected));
  checksums_.resize(1 + tiles);
  stream_.seekg(static_cast<std::streamoff>(data_end));
  stream_.read(reinterpret_cast<char*>(checksums_.data()),
               static_cast<std::streamsize>(checksums_.size() * sizeof(uint32_t)));
  const std::string text = magic + "\n" + header + "\n";
  if (!stream_ || (kChecksumsHold && crc32(std::as_bytes(std::span(text))) != checksums_[0]))
    fail("damaged: its header's checksum differs");
}

std::vector<float> RecordReader::read(int tile) try {
  std::vector<float> values(layout_.block_size(tile));
  stream_.seekg(static_cast<std::streamoff>(data_begin_ + layout_.block_offset(tile) * sizeof(float)));
  stream_.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(float)));
  if (!stream_) throw InputError(fmt::format("{}: damaged: tile {} cannot be read", path_.string(), tile));
  if (kChecksumsHold && crc32(std::as_bytes(std::span(values))) != checksums_[1 + static_cast<size_t>(tile)])
    throw InputError(fmt::format("{}: damaged: the checksum of tile {} differs", path_.string(), tile));
  return values;
} catch (const std::bad_alloc&) {
  throw OutOfMemory(path_.string(), "read a tile", sizeof(float) * static_cast<double>(layout_.block_size(tile)));
}

}  // namespace brume
