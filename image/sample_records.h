#pragma once
#include <filesystem>
#include <fstream>
#include <mutex>
#include <string>
#include <vector>

#include "base/output_file.h"

namespace brume {

/// What a file of per-sample records holds: for each sample of each pixel the same list of numbers.
///
/// On disk: a line "brume-records 2", a line of JSON with the members below, then the tiles in row order, each a block
/// of float32 [pixel][sample][number], little-endian, pixels row by row. Every block's place follows from its number,
/// so that tiles can be written in any order and read one at a time: no frame of records ever needs to fit in memory.
/// Last come CRC-32s as uint32: of the two lines, then of each tile.
struct RecordLayout {
  int width = 0, height = 0, tile = 16, samples = 0;
  struct Field {
    std::string name;
    int components;
  };
  std::vector<Field> fields;
  std::string description;  ///< of the render: scene hash, seed

  int components() const;
  int tiles_x() const { return (width + tile - 1) / tile; }
  int tile_count() const { return tiles_x() * ((height + tile - 1) / tile); }
  /// Pixels of a tile: x0, y0, x1, y1, the last two exclusive.
  struct Bounds {
    int x0, y0, x1, y1;
    size_t pixels() const { return static_cast<size_t>(x1 - x0) * static_cast<size_t>(y1 - y0); }
  };
  Bounds bounds(int tile_index) const;
  /// Numbers in all blocks.
  uint64_t values() const;
  /// Numbers in a tile's block, and in all blocks before it.
  size_t block_size(int tile_index) const;
  uint64_t block_offset(int tile_index) const;
};

/// Writes records tile by tile, from any thread, in any order. The file appears whole or not at all.
class RecordWriter {
 public:
  /// @throws InputError when the file cannot be written
  RecordWriter(const std::filesystem::path& path, const RecordLayout& layout);
  /// @param values  layout.block_size(tile) numbers   @throws InputError: disk full
  void write(int tile, const std::vector<float>& values);
  /// After the last tile.
  void commit();

 private:
  RecordLayout layout_;
  OutputFile output_;
  std::ofstream stream_;
  std::mutex writing_;
  uint64_t data_begin_ = 0;
  std::vector<uint32_t> checksums_;
};

/// Reads records one tile at a time.
class RecordReader {
 public:
  /// @throws InputError: missing, another format, truncated, damaged
  explicit RecordReader(const std::filesystem::path& path);
  const RecordLayout& layout() const { return layout_; }
  /// @throws InputError: damaged
  std::vector<float> read(int tile);

 private:
  std::filesystem::path path_;
  std::ifstream stream_;
  RecordLayout layout_;
  uint64_t data_begin_ = 0;
  std::vector<uint32_t> checksums_;
};

}  // namespace brume
