#pragma once
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace brume {

/// An array that never changes again: copies share it. Its values lie in this process's own memory or in mapped memory
/// that another process wrote.
template <class T>
class SharedArray {
 public:
  SharedArray() = default;
  explicit SharedArray(std::vector<T> values) {
    values.shrink_to_fit();
    const auto owned = std::make_shared<const std::vector<T>>(std::move(values));
    values_ = *owned;
    owner_ = owned;
  }
  /// @param owner        keeps the values alive
  /// @param file_offset  where they begin in the MemoryFile that holds them
  SharedArray(std::span<const T> values, std::shared_ptr<const void> owner, size_t file_offset)
      : values_(values), owner_(std::move(owner)), file_offset_(file_offset) {}

  const T* data() const { return values_.data(); }
  size_t size() const { return values_.size(); }
  bool empty() const { return values_.empty(); }
  const T& operator[](size_t i) const { return values_[i]; }
  const T* begin() const { return values_.data(); }
  const T* end() const { return values_.data() + values_.size(); }

  static constexpr size_t kNoFile = static_cast<size_t>(-1);
  /// kNoFile where the values are this process's own.
  size_t file_offset() const { return file_offset_; }

 private:
  std::span<const T> values_;
  std::shared_ptr<const void> owner_;
  size_t file_offset_ = kNoFile;
};

}  // namespace brume
