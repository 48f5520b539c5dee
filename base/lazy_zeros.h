#pragma once
#include <cstdlib>
#include <new>
#include <utility>

namespace brume {

/// For large arrays of numbers that stay 0 in most places: std::vector<T, LazyZeros<T>>(n) holds zeros without writing
/// them, so that the system gives memory only where something else is written.
template <class T>
struct LazyZeros {
  using value_type = T;

  LazyZeros() = default;
  template <class U>
  LazyZeros(const LazyZeros<U>&) {}

  T* allocate(size_t count) {
    if (void* const memory = std::calloc(count, sizeof(T))) return static_cast<T*>(memory);
    throw std::bad_alloc();
  }
  void deallocate(T* memory, size_t) { std::free(memory); }

  /// A vector's elements that are made without a value are the zeros that are there.
  template <class U>
  void construct(U*) {}
  template <class U, class... Values>
  void construct(U* place, Values&&... values) {
    ::new (static_cast<void*>(place)) U(std::forward<Values>(values)...);
  }
  template <class U>
  bool operator==(const LazyZeros<U>&) const {
    return true;
  }
};

}  // namespace brume
