#include "image/exr_io.h"

#include <ImfChannelList.h>
#include <ImfChromaticitiesAttribute.h>
#include <ImfCompression.h>
#include <ImfEnvmapAttribute.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputPart.h>
#include <ImfIntAttribute.h>
#include <ImfMatrixAttribute.h>
#include <ImfMultiPartInputFile.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <ImfStdIO.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <ImfVersion.h>
#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <thread>

#include "base/error.h"
#include "base/output_file.h"
#include "base/parallel_for.h"
#include "image/checksum.h"
#include "image/exr_common.h"
#include "image/exr_stand_in.h"
#include "image/exr_zip.h"
#include "image/luminance_chroma.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

int packing_threads = 1;

// That several parts may span together: a forged window would ask for all memory there is.
constexpr double kMostPixelsOfParts = 1 << 30;

/// Places a frame where the file says, unless its data and display windows are one and begin at 0.
void place(Layers& layers, const PixelWindow& data, const PixelWindow& display) {
  if (data == display && display.lo == ivec2(0)) return;
  layers.origin = data.lo;
  layers.display_origin = display.lo;
  layers.display = display.hi - display.lo;
}

/// The file up to its table of chunks.
std::string header_bytes(const Layers& layers, const Imf::ChannelList& channels) {
  const Imath::Box2i data = box_of(layers.data_window());
  Imf::Header header(box_of(layers.display_window()), data);
  header.compression() = Imf::ZIP_COMPRESSION;
  header.channels() = channels;
  for (const auto& [name, value] : layers.header) insert_attribute(header, name, value);
  insert_attribute(header, std::string(kChecksumAttribute), std::string(kNoChecksum));
  header.sanityCheck();
  bool long_names = false;  // which older readers do not know
  for (auto c = channels.begin(); c != channels.end(); ++c) long_names |= std::strlen(c.name()) > 31;
  for (const auto& [name, value] : layers.header) long_names |= name.size() > 31;
  const int32_t begin[] = {Imf::MAGIC, Imf::EXR_VERSION | (long_names ? Imf::LONG_NAMES_FLAG : 0)};
  Imf::StdOSStream stream;
  stream.write(reinterpret_cast<const char*>(begin), sizeof(begin));
  header.writeTo(stream);
  return stream.str();
}

const char* pixel_type_name(Imf::PixelType type) {
  return type == Imf::HALF ? "half" : type == Imf::FLOAT ? "float" : "uint";
}

const char* compression_name(Imf::Compression c) {
  static const char* const names[] = {"none", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB"};
  return c >= 0 && c < Imf::NUM_COMPRESSION_METHODS ? names[c] : "unknown";
}

constexpr const char* kHoldPixels = "hold its pixels";

/// A channel of 32-bit values whose first one is the data window's top left.
Imf::Slice slice(Imf::PixelType type, void* first, size_t stride, const Imath::Box2i& data) {
  const auto row = static_cast<std::ptrdiff_t>(stride * 4);
  char* const base = static_cast<char*>(first) - 4 * static_cast<std::ptrdiff_t>(data.min.x) - row * data.min.y;
  return {type, base, 4, static_cast<size_t>(row)};
}

/// Whether a channel holds sums of samples.
bool is_state(const char* channel) {
  return std::string_view(channel).starts_with("state.");
}

bool has_state(const Imf::Header& header) {
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c)
    if (is_state(c.name())) return true;
  return false;
}

/// Refuses what write_exr never writes, in words. @throws InputError
void check_own_header(const Imf::MultiPartInputFile& file, const fs::path& path) {
  const Imf::Header& header = file.header(0);
  const auto expect = [&](const std::string& what, const auto& found, const auto& expected) {
    if (found != expected)
      throw InputError(fmt::format("{}: damaged, or written by another program: {} is {}, brume writes {}",
                                   path.string(), what, found, expected));
  };
  expect("the number of parts", file.parts(), 1);
  expect("tiles", header.hasTileDescription() ? "there" : "absent", std::string("absent"));
  expect("compression", compression_name(header.compression()), std::string("ZIP"));
  expect("lineOrder", static_cast<int>(header.lineOrder()), static_cast<int>(Imf::INCREASING_Y));
  expect("pixelAspectRatio", header.pixelAspectRatio(), 1.0f);
  expect("screenWindowWidth", header.screenWindowWidth(), 1.0f);
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    const std::string of_channel = fmt::format(" of channel {}", c.name());
    expect("the type" + of_channel, pixel_type_name(c.channel().type),
           std::string(is_state(c.name()) ? "uint" : "float"));
    expect("xSampling" + of_channel, c.channel().xSampling, 1);
    expect("ySampling" + of_channel, c.channel().ySampling, 1);
  }
}

/// Refuses a file that is not as brume wrote it. @throws InputError; Interrupted
void check_own_file(const Imf::MultiPartInputFile& file, const fs::path& path, const Task& task) {
  const bool own = has_state(file.header(0));
  if (own) check_own_header(file, path);
  const Imf::Header& header = file.header(0);
  if (own || header.find(std::string(kChecksumAttribute)) != header.end()) verify_checksum(path, own, task);
}

/// Reads the first and the last line of a part, whose chunks a file that was cut off has lost.
void check_ends(Imf::MultiPartInputFile& file, int part, const fs::path& path) {
  const Imf::Header& header = file.header(part);
  const Imath::Box2i data = header.dataWindow();
  const auto channel = header.channels().begin();
  if (channel == header.channels().end() || channel.channel().xSampling != 1 || channel.channel().ySampling != 1)
    return;
  std::vector<float> line(static_cast<size_t>(data.max.x - data.min.x + 1));
  try {
    Imf::InputPart input(file, part);
    Imf::FrameBuffer buffer;
    buffer.insert(channel.name(), slice(Imf::FLOAT, line.data(), 0, data));
    input.setFrameBuffer(buffer);
    for (const int y : {data.min.y, data.max.y}) input.readPixels(y, y);
  } catch (const std::exception& error) {
    fail_exr(path, "truncated or damaged", error);
  }
}

}  // namespace

bool ExrInfo::deep() const {
  return !parts.empty() && std::all_of(parts.begin(), parts.end(), [](const Part& p) { return p.deep(); });
}

struct ExrFile::Open {
  explicit Open(const fs::path& path) : stand_in(path), file(open_exr(stand_in.exr())) {}
  ExrStandIn stand_in;
  Imf::MultiPartInputFile file;
};

ExrFile::ExrFile(const fs::path& path) : path_(path), open_(new Open(path)) {}
ExrFile::~ExrFile() = default;
ExrFile::ExrFile(ExrFile&&) noexcept = default;

const fs::path& ExrFile::exr() const {
  return open_->stand_in.exr();
}

const ExrInfo& ExrFile::info() const try {
  if (info_) return *info_;
  Imf::MultiPartInputFile& file = open_->file;
  ExrInfo info;
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    const bool deep = is_deep(header);
    if (!deep) check_ends(file, part, path_);
    const PixelWindow data = window_of(header.dataWindow());
    info.display = window_of(header.displayWindow());
    if (part == 0) info.data = data;
    info.width = info.display.width();
    info.height = info.display.height();
    info.compression = compression_name(header.compression());
    ExrInfo::Part& described =
        info.parts.emplace_back(ExrInfo::Part{.name = header.hasName() ? header.name() : "",
                                              .view = header.hasView() ? header.view() : "",
                                              .type = header.hasType()              ? header.type()
                                                      : header.hasTileDescription() ? Imf::TILEDIMAGE
                                                                                    : Imf::SCANLINEIMAGE,
                                              .data = data});
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
      described.channels.push_back(c.name());
      if (!deep)
        info.channels.push_back({channel_name_in_frame(file, part, c.name()), pixel_type_name(c.channel().type), data,
                                 static_cast<size_t>(part), c.name()});
    }
    if (part == 0 && Imf::hasMultiView(header)) info.views = Imf::multiView(header);
    info.header.merge(exr_attributes(header, file.parts() > 1));
  }
  return info_.emplace(std::move(info));
} catch (const std::bad_alloc& error) {
  fail_reading(path_.string(), error);
}

ExrInfo read_exr_info(const fs::path& path) {
  return ExrFile(path).info();
}

namespace {

/// What is read of one part: planes over its data window, by their names in the frame.
struct Part {
  PixelWindow data;
  std::map<std::string, Plane> planes;
};

struct Subsampled {
  Plane plane;
  int step_x, step_y;
};

/// Red, green and blue in place of the luminance and chroma of a layer ("LAYER." or empty).
void replace_chroma(std::map<std::string, Plane>& planes, const std::string& layer,
                    const std::array<float, 3>& weights) {
  const auto take = [&](const char* channel) { return std::move(planes.extract(layer + channel).mapped()); };
  std::array<Plane, 3> rgb = rgb_from_luminance_chroma({take("Y"), take("RY"), take("BY")}, weights);
  for (size_t c = 0; c < 3; ++c) planes.insert_or_assign(layer + "RGB"[c], std::move(rgb[c]));
}

/// @param bytes  of all planes so far, added to
Part read_part(Imf::MultiPartInputFile& file, int index, const fs::path& path,
               const std::function<bool(const std::string&)>& wanted, double& bytes) {
  const Imf::Header& header = file.header(index);
  Part part{window_of(header.dataWindow()), {}};
  const auto name_of = [&](const std::string& channel) { return channel_name_in_frame(file, index, channel); };
  const auto is_wanted = [&](const std::string& channel) { return !wanted || wanted(name_of(channel)); };
  const std::optional<std::string> chroma = chroma_layer(header.channels());
  const bool colours = chroma && (is_wanted(*chroma + "R") || is_wanted(*chroma + "G") || is_wanted(*chroma + "B"));
  std::map<std::string, Subsampled> subsampled;
  Imf::FrameBuffer frame;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    const std::string channel = c.name(), name = name_of(channel);
    const bool of_chroma =
        chroma && (channel == *chroma + "Y" || channel == *chroma + "RY" || channel == *chroma + "BY");
    if (of_chroma ? !colours : !is_wanted(channel)) continue;
    if (name.starts_with("state.") && c.channel().type == Imf::UINT) continue;  // large, and for read_exr_state() alone
    const int step_x = c.channel().xSampling, step_y = c.channel().ySampling;
    const auto size = part.data.hi - part.data.lo;
    bytes += 4.0 * size.x * size.y;
    check_exr_memory(path, bytes);
    Plane* plane;
    try {
      if (step_x == 1 && step_y == 1) {
        plane = &part.planes.try_emplace(name, size.x, size.y).first->second;
      } else {
        Subsampled coarse{Plane((size.x + step_x - 1) / step_x, (size.y + step_y - 1) / step_y), step_x, step_y};
        plane = &subsampled.insert_or_assign(name, std::move(coarse)).first->second.plane;
      }
    } catch (const std::bad_alloc&) {
      throw OutOfMemory(path.string(), kHoldPixels, bytes);
    }
    frame.insert(channel, Imf::Slice::Make(Imf::FLOAT, plane->row(0), header.dataWindow(), 4, 4 * plane->stride(),
                                           step_x, step_y));
  }
  if (part.planes.empty() && subsampled.empty()) return part;
  try {
    Imf::InputPart input(file, index);
    check_first_chunk(input, path);
    input.setFrameBuffer(frame);
    input.readPixels(part.data.lo.y, part.data.hi.y - 1);
  } catch (const std::exception& error) {
    fail_exr(path, "truncated or damaged", error);
  }
  for (const auto& [name, coarse] : subsampled)
    part.planes.insert_or_assign(
        name, upsampled(coarse.plane, part.data.width(), part.data.height(), coarse.step_x, coarse.step_y));
  if (colours) replace_chroma(part.planes, name_of(*chroma), luminance_weights(header));
  return part;
}

}  // namespace

Layers ExrFile::read(const std::function<bool(const std::string&)>& wanted) const try {
  Imf::MultiPartInputFile& file = open_->file;
  if (exr() == path_) check_own_file(file, path_, {});
  const PixelWindow display = window_of(file.header(0).displayWindow());
  std::map<std::string, Attribute> header_of_all;
  std::vector<Part> parts;
  double bytes = 0;
  int deep = 0;
  for (int index = 0; index < file.parts(); ++index) {
    const Imf::Header& header = file.header(index);
    if (is_deep(header)) {
      if (++deep == file.parts()) fail_deep(path_, part_label(file, index));
      continue;
    }
    if (window_of(header.displayWindow()) != display)
      throw InputError(fmt::format("{}: its parts differ in size; expected one size", path_.string()));
    header_of_all.merge(exr_attributes(header, file.parts() > 1));
    Part part = read_part(file, index, path_, wanted, bytes);
    if (!part.planes.empty()) parts.push_back(std::move(part));
  }
  PixelWindow data = parts.empty() ? window_of(file.header(0).dataWindow()) : parts[0].data;
  for (const Part& part : parts) data = {glm::min(data.lo, part.data.lo), glm::max(data.hi, part.data.hi)};
  const double pixels = (static_cast<double>(data.hi.x) - data.lo.x) * (static_cast<double>(data.hi.y) - data.lo.y);
  if (parts.size() > 1 && pixels > kMostPixelsOfParts)
    throw InputError(fmt::format("{}: its parts lie too far apart to be one frame: together they span {}",
                                 path_.string(), data.text()));
  Layers layers(data.width(), data.height());
  layers.header = std::move(header_of_all);
  place(layers, data, display);
  for (Part& part : parts) {
    const ivec2 shift = part.data.lo - data.lo;
    for (auto& [name, plane] : part.planes) {
      if (part.data == data) {
        layers.set(name, std::move(plane));
        continue;
      }
      Plane& whole = layers.add(name);
      for (int y = 0; y < plane.height(); ++y)
        for (int x = 0; x < plane.width(); ++x) whole(x + shift.x, y + shift.y) = plane(x, y);
    }
  }
  return layers;
} catch (const std::bad_alloc& error) {
  fail_reading(path_.string(), error);
}

Layers read_exr(const fs::path& path, const std::function<bool(const std::string&)>& wanted) {
  return ExrFile(path).read(wanted);
}

Layers read_exr_state(const fs::path& path, const Task& task) try {
  Imf::MultiPartInputFile file = open_exr(path);
  const Imf::Header& header = file.header(0);
  check_own_file(file, path, task);
  const Imath::Box2i data = header.dataWindow();
  const PixelWindow window = window_of(data);
  Layers layers(window.width(), window.height());
  layers.header = exr_attributes(header);
  place(layers, window, window_of(header.displayWindow()));
  Imf::FrameBuffer frame;
  double bytes = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    const bool state = is_state(c.name());
    const bool guide = std::string_view(c.name()).starts_with("guide.") && c.channel().type == Imf::FLOAT;
    if (!state && !guide) continue;
    bytes += 4.0 * layers.width() * layers.height();
    check_exr_memory(path, bytes);
    try {
      if (state) {
        frame.insert(c.name(),
                     slice(Imf::UINT, layers.add_words(c.name()).data(), static_cast<size_t>(layers.width()), data));
      } else {
        Plane& plane = layers.add(c.name());
        frame.insert(c.name(), slice(Imf::FLOAT, plane.row(0), plane.stride(), data));
      }
    } catch (const std::bad_alloc&) {
      throw OutOfMemory(path.string(), kHoldPixels, bytes);
    }
  }
  if (layers.words().empty()) return layers;
  try {
    Imf::InputPart input(file, 0);
    input.setFrameBuffer(frame);
    constexpr int kRows = 256;  // between checks of the task
    for (int y = data.min.y; y <= data.max.y; y += kRows) {
      task.check();
      input.readPixels(y, std::min(y + kRows - 1, data.max.y));
    }
  } catch (const std::exception& error) {
    fail_exr(path, "truncated or damaged", error);
  }
  return layers;
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

void check_exr(const fs::path& path, const Task& task) try {
  constexpr int kRows = 64;  // at a time
  Imf::MultiPartInputFile file = open_exr(path);
  check_own_file(file, path, task);
  for (int index = 0; index < file.parts(); ++index) {
    const Imf::Header& header = file.header(index);
    if (is_deep(header)) fail_deep(path, part_label(file, index));
    const Imath::Box2i data = header.dataWindow();
    const auto width = static_cast<size_t>(window_of(data).width());
    std::vector<uint32_t> rows(width * kRows);
    try {
      Imf::InputPart input(file, index);
      for (int y = data.min.y; y <= data.max.y; y += kRows) {
        task.check();
        // All channels into one place: a file is decoded whole, whichever of its channels are wanted.
        Imath::Box2i window = data;
        window.min.y = y;
        Imf::FrameBuffer frame;
        const auto channel = header.channels().begin();
        if (channel == header.channels().end()) break;
        frame.insert(channel.name(),
                     Imf::Slice::Make(channel.channel().type == Imf::UINT ? Imf::UINT : Imf::FLOAT, rows.data(), window,
                                      4, 4 * width, channel.channel().xSampling, channel.channel().ySampling));
        input.setFrameBuffer(frame);
        input.readPixels(y, std::min(y + kRows - 1, data.max.y));
      }
    } catch (const std::exception& error) {
      fail_exr(path, "truncated or damaged", error);
    }
  }
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

void set_exr_threads(int threads) {
  Imf::setGlobalThreadCount(threads > 0 ? threads : static_cast<int>(std::thread::hardware_concurrency()));
  packing_threads = threads;
}

namespace {

constexpr int kLines = 16;  // packed together: ZIP's

/// The channels of a file in the order of their names.
struct FileChannels {
  Imf::ChannelList list;
  std::vector<ExrChannel> channels;
  std::vector<size_t> made;  // places of what is made while it is written

  FileChannels(const Layers& layers, const WordRows& rows) {
    std::map<std::string, ExrChannel> named;
    const auto add = [&](const std::string& name, Imf::PixelType type, ExrChannel channel) {
      list.insert(name, Imf::Channel(type));
      named[name] = channel;
    };
    for (const auto& [name, plane] : layers.channels()) add(name, Imf::FLOAT, {plane.row(0), plane.stride()});
    for (const auto& [name, words] : layers.words())
      add(name, Imf::UINT, {words.data(), static_cast<size_t>(layers.width())});
    for (const std::string& name : rows.names) add(name, Imf::UINT, {});
    for (const auto& [name, channel] : named) {
      if (!channel.values) made.push_back(channels.size());
      channels.push_back(channel);
    }
  }

  /// Whether kLines lines are those above again, as in an empty sky: so are their packed bytes.
  bool like_above(int y, int width, int height) const {
    if (y == 0 || y + kLines > height || !made.empty()) return false;
    return std::all_of(channels.begin(), channels.end(), [&](const ExrChannel& c) {
      for (int line = y; line < y + kLines; ++line) {
        const auto* const row = static_cast<const uint32_t*>(c.values) + static_cast<size_t>(line) * c.stride;
        if (std::memcmp(row, row - kLines * c.stride, static_cast<size_t>(width) * sizeof(uint32_t)) != 0) return false;
      }
      return true;
    });
  }

  std::vector<uint8_t> packed(int y, int lines, int width, const WordRows& rows) const {
    std::vector<ExrChannel> here = channels;
    for (ExrChannel& c : here)
      if (c.values) c.values = static_cast<const uint32_t*>(c.values) + static_cast<size_t>(y) * c.stride;
    static thread_local std::vector<uint32_t> words;
    const size_t size = static_cast<size_t>(lines) * width;
    words.resize(made.size() * size);
    if (!made.empty()) rows.fill(y, lines, words.data());
    for (size_t i = 0; i < made.size(); ++i) here[made[i]] = {words.data() + i * size, static_cast<size_t>(width)};
    return zip_exr_lines(here, width, 0, lines);
  }
};

}  // namespace

void write_exr(const fs::path& path, const Layers& layers, const Task& task, const WordRows& rows) {
  const int width = layers.width(), height = layers.height(), chunks = (height + kLines - 1) / kLines;
  const FileChannels channels(layers, rows);
  OutputFile output(path);
  const auto fail = [&](const char* why) {
    throw InputError(fmt::format("{}: cannot be written: {}", path.string(), why));
  };
  std::ofstream file(output.part(), std::ios::binary);
  const auto write = [&](const void* bytes, size_t size) {
    file.write(static_cast<const char*>(bytes), static_cast<std::streamsize>(size));
  };
  try {
    const std::string header = header_bytes(layers, channels.list);
    write(header.data(), header.size());
  } catch (const std::exception& error) {
    fail(error.what());
  }
  std::vector<uint64_t> begins(static_cast<size_t>(chunks), 0);
  const auto table = file.tellp();
  const auto write_table = [&] { write(begins.data(), begins.size() * sizeof(uint64_t)); };
  write_table();  // its place
  std::vector<std::vector<uint8_t>> packed(16);
  std::vector<uint8_t> last;
  for (int first = 0; first < chunks && file; first += static_cast<int>(packed.size())) {
    const int count = std::min(chunks - first, static_cast<int>(packed.size()));
    const auto line = [&](int k) { return (first + k) * kLines; };
    parallel_for(count, {packing_threads, {}, task.cancel}, [&](int k) {
      const int y = line(k);
      packed[static_cast<size_t>(k)] = channels.like_above(y, width, height)
                                           ? std::vector<uint8_t>()
                                           : channels.packed(y, std::min(kLines, height - y), width, rows);
    });
    for (int k = 0; k < count; ++k) {
      std::vector<uint8_t>& own = packed[static_cast<size_t>(k)];
      if (!own.empty()) last.swap(own);
      begins[static_cast<size_t>(first + k)] = static_cast<uint64_t>(file.tellp());
      const int32_t head[] = {layers.origin.y + line(k), static_cast<int32_t>(last.size())};
      write(head, sizeof(head));
      write(last.data(), last.size());
    }
  }
  file.seekp(table);
  write_table();
  file.close();
  if (!file) fail(std::strerror(errno));
  write_checksum(output.part());
  output.commit();
}

}  // namespace brume
