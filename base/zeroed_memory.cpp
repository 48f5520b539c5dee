#include "base/zeroed_memory.h"

#include <sys/mman.h>

#include <cstring>
#include <new>

namespace brume {
namespace {

constexpr std::align_val_t kAlignment{64};
constexpr size_t kLarge = size_t{1} << 22;  // below, the allocator's own blocks are cheaper than fresh pages

}  // namespace

void* allocate_zeros(size_t bytes) {
  if (bytes < kLarge) return std::memset(::operator new(bytes, kAlignment), 0, bytes);
  void* const memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) throw std::bad_alloc();
  return memory;
}

void free_zeros(void* memory, size_t bytes) noexcept {
  if (bytes < kLarge)
    ::operator delete(memory, kAlignment);
  else
    munmap(memory, bytes);
}

}  // namespace brume
