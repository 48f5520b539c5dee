#pragma once
#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "base/shared_array.h"

namespace brume {

/// A file without a name that lives in memory, or on disk, from where the system reads what is not in memory: what a
/// child process writes into it, its parent maps without a copy.
class MemoryFile {
 public:
  /// A new, empty one in memory. @throws InputError when the system has none to give
  MemoryFile();
  /// A new, empty one on disk, gone with the last process that has it. @throws InputError when none can be made there
  explicit MemoryFile(const std::filesystem::path& folder);
  /// One that this process was handed: takes over the descriptor. @throws InputError when it is none
  explicit MemoryFile(int descriptor);
  ~MemoryFile();
  MemoryFile(MemoryFile&&) = delete;

  /// Closed by programs that this one starts, unless it is handed over.
  int descriptor() const { return descriptor_; }
  bool on_disk() const { return on_disk_; }
  size_t size() const { return size_; }
  /// Grows or cuts it; new bytes are 0. @throws InputError
  void resize(size_t size);
  /// Looks what another process has made of its size.
  void update_size();
  /// Writes at its end, from a multiple of 64 bytes on. @return where   @throws InputError
  size_t append(std::span<const std::byte> bytes);
  /// Gives the memory of whole pages within a stretch back: they read as 0 afterwards. Does nothing where the system
  /// cannot.
  void discard(size_t offset, size_t size);

 private:
  int descriptor_ = -1;
  size_t size_ = 0;
  bool on_disk_ = false;
};

/// A stretch of a memory file in this process's address space, shared with all who map it.
class Mapping {
 public:
  /// @param offset  multiple of the page size   @throws InputError
  Mapping(const MemoryFile& file, size_t offset, size_t size, bool writable);
  ~Mapping();
  Mapping(Mapping&&) = delete;

  std::byte* data() const { return data_; }
  size_t size() const { return size_; }
  /// The same stretch made longer or shorter; the file must be as long. It may move. @throws InputError
  void resize(size_t size);
  /// Lets the system take the memory of what lies on disk: it is read again when it is looked at.
  void release() const;

 private:
  std::byte* data_ = nullptr;
  size_t size_ = 0;
};

/// Bytes appended to the end of a memory file through a mapping: no second buffer, and no copy when they grow.
class MappedTail {
 public:
  explicit MappedTail(MemoryFile& file);
  /// More bytes, 0 until they are written; valid until the next call. @throws InputError
  std::span<std::byte> extend(size_t bytes);
  /// Cuts the file to what was appended. Nothing may be appended afterwards.
  std::shared_ptr<const Mapping> finish();
  size_t offset() const { return offset_; }

 private:
  MemoryFile* file_;
  size_t offset_ = 0, used_ = 0;
  std::shared_ptr<Mapping> mapping_;
};

/// Values that are appended and then never change: in this process's memory, or straight into a memory file.
template <class T>
class GrowingArray {
 public:
  explicit GrowingArray(MemoryFile* file) {
    if (file) tail_.emplace(*file);
  }
  void append(std::span<const T> values) { std::copy(values.begin(), values.end(), extend(values.size()).begin()); }
  /// So many more values, 0 until they are written; valid until the next call.
  std::span<T> extend(size_t count) {
    size_ += count;
    if (tail_) return {reinterpret_cast<T*>(tail_->extend(count * sizeof(T)).data()), count};
    values_.resize(size_);
    return {values_.data() + size_ - count, count};
  }
  size_t size() const { return size_; }
  SharedArray<T> finish() {
    if (!tail_ || size_ == 0) return SharedArray<T>(std::move(values_));
    const auto mapping = tail_->finish();
    return {{reinterpret_cast<const T*>(mapping->data()), size_}, mapping, tail_->offset()};
  }

 private:
  size_t size_ = 0;
  std::vector<T> values_;
  std::optional<MappedTail> tail_;
};

}  // namespace brume
