#pragma once
#include <cstddef>
#include <cstring>
#include <memory>
#include <new>
#include <span>

#include "base/zeroed_memory.h"

namespace brume {

/// One channel of an image: float rows, each aligned to a cache line and padded to a whole number of lines, so that
/// SIMD code may load and store past the last pixel. Row 0 is the top.
class Plane {
 public:
  static constexpr size_t kAlignment = 64, kLine = kAlignment / sizeof(float);

  Plane() = default;
  Plane(int width, int height, float value = 0.0f)
      : width_(width), height_(height), stride_(stride_of(width)), data_(allocate(size())) {
    fill(value);
  }
  /// Pixels that are all still to be written.
  static Plane unset(int width, int height) {
    Plane plane;
    plane.set_size(width, height);
    plane.data_ = allocate(plane.size());
    plane.clear_padding();
    return plane;
  }
  /// Zeros that take no memory while nothing else is written: for channels of which most may stay empty.
  static Plane lazy_zeros(int width, int height) {
    Plane plane;
    plane.set_size(width, height);
    const size_t bytes = plane.size() * sizeof(float);
    plane.data_ = Storage(static_cast<float*>(allocate_zeros(bytes)), Free(Free::kZeroed, bytes));
    return plane;
  }
  /// Owns its pixels, also where the other is a view.
  Plane(const Plane& other)
      : width_(other.width_), height_(other.height_), stride_(stride_of(width_)), data_(allocate(size())) {
    for (int y = 0; y < height_; ++y) std::memcpy(row(y), other.row(y), static_cast<size_t>(width_) * sizeof(float));
    clear_padding();
  }
  Plane(Plane&&) noexcept = default;
  Plane& operator=(Plane other) noexcept {
    width_ = other.width_;
    height_ = other.height_;
    stride_ = other.stride_;
    data_.swap(other.data_);
    return *this;
  }

  /// A view to read a rectangle of another plane through, which must outlive it. Code that reads past the last pixel
  /// of a row finds the other plane's pixels there.
  /// @param x0  a multiple of kLine, so that rows are aligned
  static Plane view(const Plane& of, int x0, int y0, int width, int height) {
    Plane part;
    part.width_ = width;
    part.height_ = height;
    part.stride_ = of.stride_;
    part.data_ = Storage(const_cast<float*>(of.row(y0) + x0), Free(Free::kNothing, 0));
    return part;
  }

  int width() const { return width_; }
  int height() const { return height_; }
  size_t stride() const { return stride_; }
  bool empty() const { return width_ == 0 || height_ == 0; }

  float* row(int y) { return data_.get() + static_cast<size_t>(y) * stride_; }
  const float* row(int y) const { return data_.get() + static_cast<size_t>(y) * stride_; }
  float& operator()(int x, int y) { return row(y)[x]; }
  float operator()(int x, int y) const { return row(y)[x]; }
  /// The pixels of a row, without the padding.
  std::span<float> pixels(int y) { return {row(y), static_cast<size_t>(width_)}; }
  std::span<const float> pixels(int y) const { return {row(y), static_cast<size_t>(width_)}; }

  void fill(float value) {
    for (size_t i = 0; i < size(); ++i) data_[i] = value;
  }

 private:
  struct Free {
    enum Kind { kNothing, kOwn, kZeroed };
    Kind kind;
    size_t bytes;
    Free() noexcept : kind(kNothing), bytes(0) {}
    Free(Kind what, size_t allocated) noexcept : kind(what), bytes(allocated) {}
    void operator()(float* p) const {
      if (kind == kZeroed)
        free_zeros(p, bytes);
      else if (kind == kOwn)
        ::operator delete[](p, std::align_val_t{kAlignment});
    }
  };
  using Storage = std::unique_ptr<float[], Free>;
  static Storage allocate(size_t count) {
    const size_t bytes = count * sizeof(float);
    return Storage(static_cast<float*>(::operator new[](bytes, std::align_val_t{kAlignment})), Free(Free::kOwn, bytes));
  }
  /// An odd number of cache lines: rows a power of two apart would share a few sets of the cache.
  static size_t stride_of(int width) { return ((static_cast<size_t>(width) + kLine - 1) / kLine | 1) * kLine; }
  size_t size() const { return stride_ * static_cast<size_t>(height_); }
  void set_size(int width, int height) {
    width_ = width;
    height_ = height;
    stride_ = stride_of(width);
  }
  void clear_padding() {
    for (int y = 0; y < height_; ++y)
      std::memset(row(y) + width_, 0, (stride_ - static_cast<size_t>(width_)) * sizeof(float));
  }

  int width_ = 0, height_ = 0;
  size_t stride_ = 0;
  Storage data_;
};

}  // namespace brume
