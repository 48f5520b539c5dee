#pragma once
#include <array>
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "base/memory_file.h"
#include "volume/displacement.h"
#include "volume/vdb_io.h"

namespace brume {

using VoxelPosition = std::array<int32_t, 3>;

/// What a reading process is asked for, and how the answer travels: both lie in one memory file.
///
/// The file begins with an ExchangeHeader; the request follows it; bricks are appended as they are made, the reply
/// last.
struct VdbRequest {
  enum class Kind : uint8_t { kInfo, kContents, kScalar, kColour, kVelocity, kHalve, kWrite };
  Kind kind = Kind::kInfo;
  std::string path = {};
  ScalarOptions options = {};                    ///< of a scalar field; paging: as the file is that both share
  std::string grid = {};                         ///< of the other kinds
  double scale = 1;                              ///< a voxel's size where one is written
  std::string output = {};                       ///< of halving
  std::string part = {};                         ///< where a file is written until it is whole
  bool half = false;                             ///< written with 16 bits
  SharedArray<VoxelPosition> leaf_corners = {};  ///< lowest voxels of the blocks of 8 x 8 x 8 that are written
  SharedArray<float> leaf_values = {};           ///< their 512 values each, z fastest
  int32_t threads = 0;
};

/// What the reply is: what was asked for, an error message, the message of NoSuchGrid, or the name of what memory was
/// not enough for.
enum class VdbOutcome : uint64_t { kAnswered, kRefused, kNoSuchGrid, kOutOfMemory };

/// The exit status of a reader that had not even the memory to say so.
constexpr int kReaderOutOfMemory = 12;

/// To be raised whenever what travels changes: a reader of another version is refused instead of misunderstood.
constexpr uint64_t kExchangeVersion = 5;

/// The beginning of the memory file.
struct ExchangeHeader {
  uint64_t request_offset = 0, request_size = 0;
  uint64_t reply_offset = 0, reply_size = 0;
  VdbOutcome outcome = VdbOutcome::kAnswered;
  uint64_t begun = 0;                    ///< the reader's version, once it has come as far as this
  uint64_t cramped = 0;                  ///< whether it may take less memory than a whole file of this size can need
  double progress = 0;                   ///< finished fraction, for the one who waits
  uint64_t asked_by = kExchangeVersion;  ///< the version of the one who asks
};

/// Answers the request in `file` with what it asks for or with an error message, for the reading process alone: while
/// OpenVDB parses a file, limits on memory and processor time hold that follow from the file's size.
void answer_vdb_request(MemoryFile& file);

template <class T>
constexpr bool kPlain = std::is_arithmetic_v<T> || std::is_enum_v<T>;

/// Packs values into bytes; arrays go into the memory file, where they are not there yet.
class Packer {
 public:
  explicit Packer(MemoryFile& file) : file_(&file) {}

  template <class... Values>
  void operator()(Values&... values) {
    (pack(values), ...);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  template <class T>
  void pack(T& value) {
    if constexpr (kPlain<T>)
      bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    else
      describe(*this, value);
  }
  void pack(std::string& text) {
    pack_size(text.size());
    bytes_ += text;
  }
  template <class T>
  void pack(std::vector<T>& values) {
    pack_size(values.size());
    for (T& value : values) pack(value);
  }
  void pack(std::map<std::string, std::string>& texts) {
    std::vector<std::pair<std::string, std::string>> pairs(texts.begin(), texts.end());
    pack(pairs);
  }
  template <class A, class B>
  void pack(std::pair<A, B>& pair) {
    (*this)(pair.first, pair.second);
  }
  template <int N, class T>
  void pack(glm::vec<N, T>& vector) {
    for (int i = 0; i < N; ++i) pack(vector[i]);
  }
  void pack(dmat4& matrix) {
    for (int column = 0; column < 4; ++column) pack(matrix[column]);
  }
  void pack(BrickGrid& grid) { grid.transfer(*this); }
  template <class T>
  void pack(SharedArray<T>& array) {
    const bool inside = array.file_offset() != SharedArray<T>::kNoFile;
    pack_size(array.empty() ? 0 : inside ? array.file_offset() : file_->append(std::as_bytes(std::span(array))));
    pack_size(array.size());
  }
  void pack_size(uint64_t size) { pack(size); }

  MemoryFile* file_;
  std::string bytes_;
};

/// Takes values out in the order in which they were packed. Arrays stay where they are.
/// @throws std::out_of_range where what was packed is damaged
class Unpacker {
 public:
  /// @param file  all of it
  Unpacker(std::shared_ptr<const Mapping> file, uint64_t offset, uint64_t size) : file_(std::move(file)) {
    rest_ = part(offset, size);
  }

  template <class... Values>
  void operator()(Values&... values) {
    (unpack(values), ...);
  }

 private:
  std::span<const std::byte> part(uint64_t offset, uint64_t size) const {
    if (offset > file_->size() || size > file_->size() - offset) throw std::out_of_range("a place that is not there");
    return {file_->data() + offset, size};
  }
  std::span<const std::byte> take(uint64_t size) {
    if (size > rest_.size()) throw std::out_of_range("ends too soon");
    const auto taken = rest_.first(size);
    rest_ = rest_.subspan(size);
    return taken;
  }
  uint64_t take_size() {
    uint64_t size = 0;
    unpack(size);
    return size;
  }
  template <class T>
  void unpack(T& value) {
    if constexpr (std::is_same_v<T, bool>)
      value = std::to_integer<int>(take(1)[0]) != 0;
    else if constexpr (kPlain<T>)
      std::memcpy(&value, take(sizeof value).data(), sizeof value);
    else
      describe(*this, value);
  }
  void unpack(std::string& text) {
    const auto bytes = take(take_size());
    text.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }
  template <class T>
  void unpack(std::vector<T>& values) {
    const uint64_t count = take_size();
    if (count > rest_.size()) throw std::out_of_range("a list longer than what holds it");
    values.resize(count);
    for (T& value : values) unpack(value);
  }
  void unpack(std::map<std::string, std::string>& texts) {
    std::vector<std::pair<std::string, std::string>> pairs;
    unpack(pairs);
    texts = {pairs.begin(), pairs.end()};
  }
  template <class A, class B>
  void unpack(std::pair<A, B>& pair) {
    (*this)(pair.first, pair.second);
  }
  template <int N, class T>
  void unpack(glm::vec<N, T>& vector) {
    for (int i = 0; i < N; ++i) unpack(vector[i]);
  }
  void unpack(dmat4& matrix) {
    for (int column = 0; column < 4; ++column) unpack(matrix[column]);
  }
  void unpack(BrickGrid& grid) {
    grid.transfer(*this);
    if (!grid.consistent()) throw std::out_of_range("a grid that contradicts itself");
  }
  template <class T>
  void unpack(SharedArray<T>& array) {
    const uint64_t offset = take_size(), count = take_size();
    if (count > file_->size() / sizeof(T) || offset % alignof(T) != 0) throw std::out_of_range("an array out of place");
    array = {{reinterpret_cast<const T*>(part(offset, count * sizeof(T)).data()), count}, file_, offset};
  }

  std::shared_ptr<const Mapping> file_;
  std::span<const std::byte> rest_;
};

template <class Archive>
void describe(Archive& archive, VoxelBox& box) {
  archive(box.lo, box.hi);
}
template <class Archive>
void describe(Archive& archive, ScalarOptions& o) {
  archive(o.grid, o.use, o.convert_level_set, o.remap, o.limit, o.needs_flames, o.paging);
}
template <class Archive>
void describe(Archive& archive, VdbRequest& r) {
  archive(r.kind, r.path, r.options, r.grid, r.scale, r.output, r.part, r.half, r.leaf_corners, r.leaf_values,
          r.threads);
}
template <class Archive>
void describe(Archive& archive, GridSummary& s) {
  archive(s.name, s.type, s.grid_class, s.compression, s.half, s.linear, s.active_voxels, s.active_tiles, s.box,
          s.voxel_size, s.world_from_index, s.has_range, s.minimum, s.maximum, s.background, s.nan_count,
          s.infinite_count, s.negative_count, s.minus_infinite_count, s.denormal_count, s.metadata);
}
template <class Archive>
void describe(Archive& archive, VdbSummary& s) {
  archive(s.format_version, s.library_version, s.bytes, s.metadata, s.grids);
}
template <class Archive>
void describe(Archive& archive, ScalarField& f) {
  archive(f.bricks, f.world_from_index, f.summary, f.notes);
}
template <class Archive>
void describe(Archive& archive, VectorField& f) {
  archive(f.bricks.parts[0], f.bricks.parts[1], f.bricks.parts[2], f.world_from_index, f.notes);
}
template <class Archive>
void describe(Archive& archive, StoredVelocity::Component& c) {
  archive(c.values, c.stored, c.world_from_index, c.shift, c.box);
}
template <class Archive>
void describe(Archive& archive, StoredVelocity& v) {
  archive(v.name, v.components[0], v.components[1], v.components[2], v.notes);
}

}  // namespace brume
