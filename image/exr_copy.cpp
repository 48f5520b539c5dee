#include "image/exr_copy.h"

#include <ImfChannelList.h>
#include <ImfDeepScanLineInputPart.h>
#include <ImfDeepScanLineOutputPart.h>
#include <ImfDeepTiledInputPart.h>
#include <ImfDeepTiledOutputPart.h>
#include <ImfInputPart.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfStdIO.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <ImfTiledInputPart.h>
#include <ImfTiledOutputFile.h>
#include <ImfTiledOutputPart.h>
#include <ImfVersion.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <list>
#include <optional>
#include <stdexcept>

#include "base/error.h"
#include "base/output_file.h"
#include "image/checksum.h"
#include "image/exr_common.h"
#include "image/luminance_chroma.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

/// The headers as they are stored: OpenEXR adds attributes to those that it hands out.
std::vector<Imf::Header> stored_headers(const fs::path& path, int& version) {
  Imf::StdIFStream stream(path.c_str());
  char begin[8];
  stream.read(begin, sizeof(begin));
  std::memcpy(&version, begin + 4, sizeof(version));
  std::vector<Imf::Header> headers;
  do {
    headers.emplace_back().readFrom(stream, version);
  } while (Imf::isMultiPart(version) && !headers.back().readsNothing());
  if (Imf::isMultiPart(version)) headers.pop_back();
  return headers;
}

/// What happens to one part.
struct PartPlan {
  struct Change {
    std::string channel, target;  // within the part
    const Plane* values;
    ivec2 origin;  // of the values
  };
  std::vector<Change> changes;
  std::list<Plane> made;  // luminance and chroma
};

/// Room for some lines of every channel of a part, in their own types.
class Lines {
 public:
  /// Reserves lines y0 .. y1 of a channel and adds them to a frame buffer.
  char* add(Imf::FrameBuffer& frame, const std::string& name, const Imf::Channel& channel, const Imath::Box2i& lines) {
    const int size = channel.type == Imf::HALF ? 2 : 4;
    const int step_x = channel.xSampling, step_y = channel.ySampling;
    const auto count = [](int lo, int hi, int step) { return static_cast<size_t>((hi - lo + step) / step); };
    const size_t width = count(lines.min.x, lines.max.x, step_x), height = count(lines.min.y, lines.max.y, step_y);
    std::vector<char>& bytes = bytes_[name];
    bytes.resize(width * height * static_cast<size_t>(size));
    frame.insert(name, Imf::Slice::Make(channel.type, bytes.data(), lines, static_cast<size_t>(size),
                                        static_cast<size_t>(size) * width, step_x, step_y));
    return bytes.data();
  }

 private:
  std::map<std::string, std::vector<char>> bytes_;
};

/// Values of a change at a part's resolution level, subsampled where the channel is.
struct Level {
  const Imf::Channel* channel;
  std::string target;
  const Plane* values;
  ivec2 shift;  // of the level's first pixel in `values`
  Plane own;    // what `values` points to where it had to be made

  /// Writes the lines of a box of the level, whose first pixel is `origin`.
  void fill(char* bytes, const Imath::Box2i& lines, const Imath::V2i& origin) const {
    const int step_x = channel->xSampling, step_y = channel->ySampling;
    for (int y = lines.min.y; y <= lines.max.y; y += step_y) {
      const float* row = values->row((y - origin.y) / step_y + shift.y) + shift.x;
      for (int x = lines.min.x; x <= lines.max.x; x += step_x) {
        const float value = *row++;
        if (channel->type == Imf::HALF) {
          const half h = to_half(value);
          std::memcpy(bytes, &h, 2);
          bytes += 2;
        } else {
          std::memcpy(bytes, &value, 4);
          bytes += 4;
        }
      }
    }
  }
};

/// The pixels of a plane from `lo` on.
Plane cut(const Plane& plane, ivec2 lo, ivec2 size) {
  Plane result(size.x, size.y);
  for (int y = 0; y < size.y; ++y) std::copy_n(plane.row(y + lo.y) + lo.x, size.x, result.row(y));
  return result;
}

constexpr int kLines = 256;  // moved at once: a whole number of every compression's blocks

ivec2 size_of(const Imath::Box2i& box) {
  return window_of(box).hi - window_of(box).lo;
}

class PartCopier {
 public:
  PartCopier(Imf::MultiPartInputFile& in, const fs::path& path, int index, const PartPlan& plan, const Task& task)
      : in_(in), in_path_(path.string()), index_(index), plan_(plan), header_(in.header(index)), task_(task) {}

  template <class Out>
  void lines(Out& out) const {
    Imf::InputPart input(in_, index_);
    const Imath::Box2i data = header_.dataWindow();
    const std::list<Level> levels = changes_at(size_of(data));
    const bool upwards = header_.lineOrder() == Imf::DECREASING_Y;
    const int blocks = (data.max.y - data.min.y) / kLines + 1;
    Lines room;
    for (int k = 0; k < blocks; ++k) {
      task_.check();
      const int first = data.min.y + kLines * (upwards ? blocks - 1 - k : k);
      const Imath::Box2i box(Imath::V2i(data.min.x, first),
                             Imath::V2i(data.max.x, std::min(first + kLines - 1, data.max.y)));
      Imf::FrameBuffer from, to;
      buffers(room, box, data.min, levels, from, to);
      read(from, [&] {
        input.setFrameBuffer(from);
        input.readPixels(box.min.y, box.max.y);
      });
      out.setFrameBuffer(to);
      out.writePixels(box.max.y - box.min.y + 1);
    }
  }

  template <class Out>
  void tiles(Out& out) const {
    Imf::TiledInputPart input(in_, index_);
    for (int ly = 0; ly < input.numYLevels(); ++ly)
      for (int lx = 0; lx < input.numXLevels(); ++lx) {
        if (!input.isValidLevel(lx, ly)) continue;
        const Imath::Box2i data = input.dataWindowForLevel(lx, ly);
        const std::list<Level> levels = changes_at(size_of(data));
        const int rows = input.numYTiles(ly), columns = input.numXTiles(lx);
        const bool upwards = header_.lineOrder() == Imf::DECREASING_Y;
        Lines room;
        for (int k = 0; k < rows; ++k) {
          task_.check();
          const int row = upwards ? rows - 1 - k : k;
          const Imath::Box2i tile = input.dataWindowForTile(0, row, lx, ly);
          const Imath::Box2i box(Imath::V2i(data.min.x, tile.min.y), Imath::V2i(data.max.x, tile.max.y));
          Imf::FrameBuffer from, to;
          buffers(room, box, data.min, levels, from, to);
          read(from, [&] {
            input.setFrameBuffer(from);
            input.readTiles(0, columns - 1, row, row, lx, ly);
          });
          out.setFrameBuffer(to);
          out.writeTiles(0, columns - 1, row, row, lx, ly);
        }
      }
  }

 private:
  /// The changes at a level of that size.
  std::list<Level> changes_at(ivec2 size) const {
    std::list<Level> levels;
    const PixelWindow part = window_of(header_.dataWindow());
    const ivec2 whole = part.hi - part.lo;
    for (const PartPlan::Change& change : plan_.changes) {
      const Imf::Channel& channel = header_.channels()[change.channel];
      Level& level = levels.emplace_back(Level{&channel, change.target, change.values, part.lo - change.origin, {}});
      const bool subsampled = channel.xSampling != 1 || channel.ySampling != 1;
      if (size == whole && !subsampled) continue;
      level.own = cut(*change.values, level.shift, whole);
      level.own = subsampled ? downsampled(level.own, channel.xSampling, channel.ySampling)
                             : resampled(level.own, size.x, size.y);
      level.values = &level.own;
      level.shift = ivec2(0);
    }
    return levels;
  }
  /// Calls pixels() where there is anything to read.
  template <class Read>
  void read(const Imf::FrameBuffer& buffer, const Read& pixels) const {
    if (buffer.begin() == buffer.end()) return;
    try {
      pixels();
    } catch (const std::exception& error) {
      fail_exr(in_path_, "truncated or damaged", error);
    }
  }
  /// What is read as it is, and what is written: that, and the changes.
  void buffers(Lines& room, const Imath::Box2i& box, const Imath::V2i& origin, const std::list<Level>& levels,
               Imf::FrameBuffer& from, Imf::FrameBuffer& to) const {
    for (auto c = header_.channels().begin(); c != header_.channels().end(); ++c) {
      const bool replaced =
          std::any_of(levels.begin(), levels.end(), [&](const Level& l) { return l.target == c.name(); });
      if (!replaced) room.add(from, c.name(), c.channel(), box);
    }
    to = from;
    for (const Level& l : levels) l.fill(room.add(to, l.target, *l.channel, box), box, origin);
  }

  Imf::MultiPartInputFile& in_;
  std::string in_path_;
  int index_;
  const PartPlan& plan_;
  const Imf::Header& header_;
  const Task& task_;
};

bool is_tiled(const Imf::Header& header) {
  return header.hasType() ? header.type() == Imf::TILEDIMAGE : header.hasTileDescription();
}

/// As it is packed.
void copy_deep_part(Imf::MultiPartInputFile& in, int index, Imf::MultiPartOutputFile& out) {
  if (in.header(index).type() == Imf::DEEPTILE) {
    Imf::DeepTiledInputPart from(in, index);
    Imf::DeepTiledOutputPart(out, index).copyPixels(from);
  } else {
    Imf::DeepScanLineInputPart from(in, index);
    Imf::DeepScanLineOutputPart(out, index).copyPixels(from);
  }
}

bool loses_bits(Imf::Compression compression) {
  return compression == Imf::B44_COMPRESSION || compression == Imf::B44A_COMPRESSION ||
         compression == Imf::DWAA_COMPRESSION || compression == Imf::DWAB_COMPRESSION;
}

void check_covers(const ExrEdit& edit, const Imf::Header& header) {
  const PixelWindow part = window_of(header.dataWindow());
  if (part.common(edit.window) != part)
    throw std::logic_error("channel " + edit.channel + " lies in " + part.text() + ", its new values in " +
                           edit.window.text());
}

/// Places the edits of one part. @return how many it took
size_t plan_part(const Imf::MultiPartInputFile& file, int index, std::span<const ExrEdit> edits, PartPlan& plan) {
  const Imf::Header& header = file.header(index);
  const std::optional<std::string> chroma = chroma_layer(header.channels());
  std::array<const ExrEdit*, 3> colours{};
  size_t taken = 0;
  // A frame's name for a new channel begins with the part's, where the old one's does.
  const auto own = [&](const std::string& in_frame) {
    const std::string prefix = channel_name_in_frame(file, index, "");
    return in_frame.starts_with(prefix) ? in_frame.substr(prefix.size()) : in_frame;
  };
  for (const ExrEdit& edit : edits) {
    if (chroma)
      for (size_t c = 0; c < 3; ++c)
        if (edit.channel == channel_name_in_frame(file, index, *chroma + "RGB"[c])) {
          colours[c] = &edit;
          check_covers(edit, header);
          ++taken;
        }
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
      const std::string name = c.name();
      if (channel_name_in_frame(file, index, name) != edit.channel) continue;
      if (c.channel().type == Imf::UINT) throw std::logic_error("channel " + edit.channel + " holds whole numbers");
      check_covers(edit, header);
      const bool named_in_full = name == edit.channel;
      const std::string target = edit.beside.empty() ? name : named_in_full ? edit.beside : own(edit.beside);
      plan.changes.push_back({name, target, edit.values, edit.window.lo});
      ++taken;
    }
  }
  if (colours[0] && colours[1] && colours[2]) {
    LuminanceChroma picture = luminance_chroma_from_rgb({colours[0]->values, colours[1]->values, colours[2]->values},
                                                        luminance_weights(header));
    const std::pair<const char*, Plane*> planes[] = {{"Y", &picture.y}, {"RY", &picture.ry}, {"BY", &picture.by}};
    for (const auto& [channel, plane] : planes) {
      std::string target = *chroma + channel;
      if (!colours[0]->beside.empty()) {
        const std::string beside = own(colours[0]->beside);
        target = beside.substr(0, beside.size() - 1) + channel;
      }
      plan.made.push_back(std::move(*plane));
      plan.changes.push_back({*chroma + channel, target, &plan.made.back(), colours[0]->window.lo});
    }
  } else if (colours[0] || colours[1] || colours[2]) {
    throw std::logic_error("luminance and chroma take R, G and B together");
  }
  return taken;
}

/// Adds a part's new channels and attributes.
void change_header(Imf::Header& header, const PartPlan& plan, const std::map<std::string, Attribute>& attributes,
                   const fs::path& from) {
  Imf::ChannelList channels = header.channels();
  for (const PartPlan::Change& change : plan.changes) {
    if (change.target == change.channel) continue;
    if (channels.findChannel(change.target))
      throw InputError(fmt::format("{}: has a channel {} already; take another suffix", from.string(), change.target));
    channels.insert(change.target, header.channels()[change.channel]);
  }
  header.channels() = channels;
  for (const auto& [name, value] : attributes) insert_attribute(header, name, value);
}

/// What happens to each part. @throws InputError where the file cannot be copied
std::vector<PartPlan> plan_parts(Imf::MultiPartInputFile& in, const fs::path& from, std::span<const ExrEdit> edits,
                                 ExrCopyReport& report) {
  std::vector<PartPlan> plans(static_cast<size_t>(in.parts()));
  size_t placed = 0;
  for (int index = 0; index < in.parts(); ++index) {
    const Imf::Header& header = in.header(index);
    if (is_deep(header) && in.parts() == 1) fail_deep(from, part_label(in, index));
    if (!in.partComplete(index))
      throw InputError(
          fmt::format("{}: truncated or damaged: {} lacks some of its pixels", from.string(), part_label(in, index)));
    if (is_deep(header)) continue;
    PartPlan& plan = plans[static_cast<size_t>(index)];
    placed += plan_part(in, index, edits, plan);
    if (!plan.changes.empty() && loses_bits(header.compression())) report.recoded.push_back(part_label(in, index));
    const auto is_float = [&](const PartPlan::Change& c) { return header.channels()[c.channel].type == Imf::FLOAT; };
    if (header.compression() == Imf::PXR24_COMPRESSION &&
        std::any_of(plan.changes.begin(), plan.changes.end(), is_float))
      report.rounded.push_back(part_label(in, index));
  }
  if (placed != edits.size()) throw std::logic_error("an edited channel is not in " + from.string());
  return plans;
}

/// One part of several: packed as it is where nothing in it changes.
template <class Input, class Output, class Changed>
void copy_part(Imf::MultiPartInputFile& in, int index, Imf::MultiPartOutputFile& file, bool unchanged,
               const Changed& changed) {
  Output part(file, index);
  if (!unchanged) return changed(part);
  Input input(in, index);
  part.copyPixels(input);
}

void copy_parts(Imf::MultiPartInputFile& in, const fs::path& from, const std::vector<PartPlan>& plans,
                const std::vector<Imf::Header>& headers, bool several, ExrOutputStream& stream, const Task& task) {
  const int threads = Imf::globalThreadCount();
  if (!several) {
    const PartCopier copier(in, from, 0, plans[0], task);
    if (is_tiled(in.header(0))) {
      Imf::TiledOutputFile file(stream, headers[0], threads);
      copier.tiles(file);
    } else {
      Imf::OutputFile file(stream, headers[0], threads);
      copier.lines(file);
    }
    return;
  }
  Imf::MultiPartOutputFile file(stream, headers.data(), static_cast<int>(headers.size()), false, threads);
  for (int index = 0; index < in.parts(); ++index) {
    const PartPlan& plan = plans[static_cast<size_t>(index)];
    const PartCopier copier(in, from, index, plan, task);
    task.check();
    if (is_deep(in.header(index)))
      copy_deep_part(in, index, file);
    else if (is_tiled(in.header(index)))
      copy_part<Imf::TiledInputPart, Imf::TiledOutputPart>(in, index, file, plan.changes.empty(),
                                                           [&](auto& part) { copier.tiles(part); });
    else
      copy_part<Imf::InputPart, Imf::OutputPart>(in, index, file, plan.changes.empty(),
                                                 [&](auto& part) { copier.lines(part); });
  }
}

}  // namespace

void round_to_half(Plane& plane) {
  for (int y = 0; y < plane.height(); ++y)
    for (float& value : plane.pixels(y)) value = to_half(value);
}

ExrCopyReport copy_exr(const fs::path& from, const fs::path& to, std::span<const ExrEdit> edits,
                       const std::map<std::string, Attribute>& attributes, const Task& task) try {
  Imf::MultiPartInputFile in = open_exr(from);
  ExrCopyReport report;
  const std::vector<PartPlan> plans = plan_parts(in, from, edits, report);
  int version = 0;
  std::vector<Imf::Header> headers = stored_headers(from, version);
  for (size_t i = 0; i < headers.size(); ++i)
    if (!plans[i].changes.empty()) change_header(headers[i], plans[i], attributes, from);
  const std::string checksum(kChecksumAttribute);
  const bool has_checksum = headers[0].findTypedAttribute<Imf::StringAttribute>(checksum);
  if (has_checksum) insert_attribute(headers[0], checksum, std::string(kNoChecksum));
  OutputFile output(to);
  try {
    ExrOutputStream stream(output.part());
    copy_parts(in, from, plans, headers, Imf::isMultiPart(version), stream, task);
    stream.close();
    if (has_checksum) write_checksum(output.part());
  } catch (const std::exception& error) {
    fail_exr(to, fmt::format("cannot be written from {}", from.string()), error);
  }
  output.commit();
  return report;
} catch (const std::bad_alloc& error) {
  fail_reading(from.string(), error);
}

}  // namespace brume
