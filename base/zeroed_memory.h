#pragma once
#include <cstddef>

namespace brume {

/// Zeros, aligned to 64 bytes. Of a large block the system gives only the pages that are written, and gets them back as
/// soon as the block is freed. @throws std::bad_alloc
void* allocate_zeros(size_t bytes);
/// @param bytes  as allocated
void free_zeros(void* memory, size_t bytes) noexcept;

}  // namespace brume
