#include "image/exr_deep.h"

#include <ImfChannelList.h>
#include <ImfDeepFrameBuffer.h>
#include <ImfDeepScanLineInputPart.h>
#include <ImfDeepScanLineOutputFile.h>
#include <ImfDeepTiledInputPart.h>
#include <ImfPartType.h>
#include <ImfThreading.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "base/error.h"
#include "base/output_file.h"
#include "image/exr_common.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using Type = DeepPicture::Channel::Type;

constexpr int kZipLevel = 4;
constexpr int kRows = 32;             // that are read and written together
constexpr double kMostPacked = 1100;  // times that deflate makes anything smaller

Imf::PixelType type_in_file(Type type) {
  return type == Type::kHalf ? Imf::HALF : type == Type::kFloat ? Imf::FLOAT : Imf::UINT;
}

/// Where OpenEXR finds each pixel's samples in some rows of a picture.
class RowPointers {
 public:
  RowPointers(const Imath::Box2i& data, int rows) : data_(data), counts_(pixels(rows)) {}

  /// The buffer with the counts of the rows from y on.
  Imf::DeepFrameBuffer counts(int y) {
    Imf::DeepFrameBuffer buffer;
    buffer.insertSampleCountSlice(
        {Imf::UINT, base(counts_.data(), sizeof(uint32_t), y), sizeof(uint32_t), sizeof(uint32_t) * width()});
    return buffer;
  }
  std::vector<uint32_t>& all_counts() { return counts_; }
  /// Adds a channel, whose samples of row y begin at `values`.
  void add(Imf::DeepFrameBuffer& buffer, const std::string& name, Imf::PixelType type, const void* values, int y) {
    std::vector<const char*>& to = pointers_[name];
    to.resize(counts_.size());
    const size_t size = type == Imf::HALF ? sizeof(half) : sizeof(float);
    const char* at = static_cast<const char*>(values);
    for (size_t i = 0; i < counts_.size(); ++i) {
      to[i] = at;
      at += counts_[i] * size;
    }
    buffer.insert(
        name, Imf::DeepSlice(type, base(to.data(), sizeof(char*), y), sizeof(char*), sizeof(char*) * width(), size));
  }
  size_t width() const { return static_cast<size_t>(data_.max.x - data_.min.x + 1); }

 private:
  size_t pixels(int rows) const { return width() * static_cast<size_t>(rows); }
  /// What lies at pixel 0, 0 where the first row is y.
  char* base(void* first, size_t size, int y) const {
    return static_cast<char*>(first) - (static_cast<std::ptrdiff_t>(data_.min.x) +
                                        static_cast<std::ptrdiff_t>(y) * static_cast<std::ptrdiff_t>(width())) *
                                           static_cast<std::ptrdiff_t>(size);
  }

  const Imath::Box2i data_;
  std::vector<uint32_t> counts_;
  std::map<std::string, std::vector<const char*>> pointers_;
};

/// Refuses what no picture can be made of. @throws InputError
void check_values(const DeepPicture& picture, const fs::path& path) {
  const auto fail = [&](size_t sample, const std::string& what) {
    const auto pixel = std::upper_bound(picture.begin.begin(), picture.begin.end(), sample) - picture.begin.begin() - 1;
    const ivec2 at = picture.data.lo + ivec2(pixel % picture.width(), pixel / picture.width());
    throw InputError(fmt::format("{}: the deep pixel {},{} {}", path.string(), at.x, at.y, what));
  };
  for (const auto& [name, channel] : picture.channels) {
    if (channel.type == Type::kUint) continue;
    const bool alpha = name == "A" || name == "AR" || name == "AG" || name == "AB",
               depth = name == "Z" || name == "ZBack";
    for (size_t i = 0; i < channel.values.size(); ++i) {
      const float v = channel.values[i];
      if (depth ? std::isnan(v) : !std::isfinite(v))
        fail(i, fmt::format("has a sample whose {} is {}; expected a number", name, v));
      if (alpha && !(v >= 0 && v <= 1.001f))
        fail(i, fmt::format("has a sample whose {} is {}; expected 0 .. 1", name, v));
    }
  }
  const DeepPicture::Channel *const z = picture.find("Z"), *const z_back = picture.find("ZBack");
  for (size_t i = 0; z && z_back && i < z->values.size(); ++i)
    if (z_back->values[i] < z->values[i])
      fail(i, fmt::format("has a sample from Z = {} to ZBack = {}; expected ZBack at or behind Z", z->values[i],
                          z_back->values[i]));
}

/// @param read_counts, read_rows  take the first and the last of some rows
template <class Part, class ReadCounts, class ReadRows>
DeepPicture read_part(const fs::path& path, const Imf::Header& header, Part& part, int step, const Task& task,
                      const ReadCounts& read_counts, const ReadRows& read_rows) {
  const Imath::Box2i data = header.dataWindow();
  const PixelWindow window = window_of(data);
  const auto width = static_cast<size_t>(window.width());
  std::vector<uint32_t> counts(width * static_cast<size_t>(window.height()));
  const double most_bytes = static_cast<double>(fs::file_size(path)) * kMostPacked;
  double channels = 0, samples = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) ++channels;
  for (int y = data.min.y; y <= data.max.y; y += step) {
    task.check();
    const int last = std::min(y + step - 1, data.max.y);
    RowPointers rows(data, last - y + 1);
    part.setFrameBuffer(rows.counts(y));
    read_counts(y, last);
    for (const uint32_t count : rows.all_counts()) samples += count;
    if (samples * channels > most_bytes)
      throw InputError(fmt::format("{}: truncated or damaged: it says that it has more than {:.3g} deep samples",
                                   path.string(), samples));
    std::copy(rows.all_counts().begin(), rows.all_counts().end(),
              counts.begin() + static_cast<std::ptrdiff_t>(width) * (y - data.min.y));
  }
  check_exr_memory(path, samples * channels * sizeof(float) + 16.0 * static_cast<double>(counts.size()));
  DeepPicture picture(window, window_of(header.displayWindow()), counts);
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    const Imf::PixelType type = c.channel().type;
    picture.add(c.name(), type == Imf::HALF ? Type::kHalf : type == Imf::FLOAT ? Type::kFloat : Type::kUint);
  }
  for (int y = data.min.y; y <= data.max.y; y += step) {
    task.check();
    const int last = std::min(y + step - 1, data.max.y);
    const size_t first = width * static_cast<size_t>(y - data.min.y);
    RowPointers rows(data, last - y + 1);
    std::copy_n(counts.begin() + static_cast<std::ptrdiff_t>(first), rows.all_counts().size(),
                rows.all_counts().begin());
    Imf::DeepFrameBuffer buffer = rows.counts(y);
    for (auto& [name, channel] : picture.channels)
      rows.add(buffer, name, channel.type == Type::kUint ? Imf::UINT : Imf::FLOAT,
               channel.values.data() + picture.begin[first], y);
    part.setFrameBuffer(buffer);
    read_counts(y, last);
    if (!std::equal(rows.all_counts().begin(), rows.all_counts().end(),
                    counts.begin() + static_cast<std::ptrdiff_t>(first)))
      throw InputError(
          fmt::format("{}: truncated or damaged: its lines {} .. {} do not say twice how many samples they have",
                      path.string(), y, last));
    read_rows(y, last);
  }
  return picture;
}

}  // namespace

bool has_deep_part(const fs::path& path) try {
  Imf::MultiPartInputFile file = open_exr(path);
  for (int part = 0; part < file.parts(); ++part)
    if (is_deep(file.header(part))) return true;
  return false;
} catch (const InputError&) {
  return false;
}

DeepPicture read_deep_exr(const fs::path& path, const Task& task) try {
  Imf::MultiPartInputFile file = open_exr(path);
  int index = -1;
  for (int part = 0; part < file.parts(); ++part) {
    if (!is_deep(file.header(part))) continue;
    if (index >= 0)
      throw InputError(fmt::format("{}: has several deep parts, {} and {}; expected one", path.string(),
                                   part_label(file, index), part_label(file, part)));
    index = part;
  }
  if (index < 0) throw InputError(fmt::format("{}: has no deep pixels", path.string()));
  if (!file.partComplete(index))
    throw InputError(
        fmt::format("{}: truncated or damaged: {} lacks some of its pixels", path.string(), part_label(file, index)));
  const Imf::Header& header = file.header(index);
  DeepPicture picture;
  try {
    if (header.type() == Imf::DEEPTILE) {
      Imf::DeepTiledInputPart part(file, index);
      const int high = static_cast<int>(part.tileYSize());
      const auto tiles = [&](int y) { return (y - header.dataWindow().min.y) / high; };
      picture = read_part(
          path, header, part, high, task,
          [&](int y, int) { part.readPixelSampleCounts(0, part.numXTiles() - 1, tiles(y), tiles(y)); },
          [&](int y, int) { part.readTiles(0, part.numXTiles() - 1, tiles(y), tiles(y)); });
    } else {
      Imf::DeepScanLineInputPart part(file, index);
      picture = read_part(
          path, header, part, kRows, task, [&](int y, int last) { part.readPixelSampleCounts(y, last); },
          [&](int y, int last) { part.readPixels(y, last); });
    }
  } catch (const std::exception& error) {
    fail_exr(path, "truncated or damaged", error);
  }
  picture.header = exr_attributes(header, file.parts() > 1);
  check_values(picture, path);
  return picture;
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

void write_deep_exr(const fs::path& path, const DeepPicture& picture, const Task& task) {
  const Imath::Box2i data = box_of(picture.data);
  OutputFile output(path);
  try {
    Imf::Header header(box_of(picture.display), data);
    header.setType(Imf::DEEPSCANLINE);
    header.compression() = Imf::ZIPS_COMPRESSION;
    header.zipCompressionLevel() = kZipLevel;
    for (const auto& [name, channel] : picture.channels)
      header.channels().insert(name, Imf::Channel(type_in_file(channel.type)));
    for (const auto& [name, value] : picture.header)
      if (name != "version") insert_attribute(header, name, value);  // of deep pixels: the format's
    ExrOutputStream stream(output.part());
    {
      Imf::DeepScanLineOutputFile file(stream, header, Imf::globalThreadCount());
      const auto width = static_cast<size_t>(picture.width());
      for (int y = 0; y < picture.height(); y += kRows) {
        task.check();
        const int rows = std::min(kRows, picture.height() - y);
        RowPointers pointers(data, rows);
        const size_t first = width * static_cast<size_t>(y);
        for (size_t i = 0; i < pointers.all_counts().size(); ++i)
          pointers.all_counts()[i] = static_cast<uint32_t>(picture.begin[first + i + 1] - picture.begin[first + i]);
        Imf::DeepFrameBuffer buffer = pointers.counts(y + data.min.y);
        std::map<std::string, std::vector<half>> halves;  // OpenEXR writes what it is given
        for (const auto& [name, channel] : picture.channels) {
          const float* const values = channel.values.data() + picture.begin[first];
          const void* given = values;
          if (channel.type == Type::kHalf) {
            std::vector<half>& to = halves[name];
            for (size_t i = 0; i < picture.begin[first + pointers.all_counts().size()] - picture.begin[first]; ++i)
              to.push_back(to_half(values[i]));
            given = to.data();
          }
          pointers.add(buffer, name, type_in_file(channel.type), given, y + data.min.y);
        }
        file.setFrameBuffer(buffer);
        file.writePixels(rows);
      }
    }
    stream.close();
  } catch (const std::exception& error) {
    if (dynamic_cast<const Interrupted*>(&error)) throw;
    throw InputError(fmt::format("{}: cannot be written: {}", path.string(), error.what()));
  }
  output.commit();
}

}  // namespace brume
