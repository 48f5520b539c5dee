#include "base/memory_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>

#include "base/error.h"

namespace brume {
namespace {

[[noreturn]] void fail(size_t size = 0) {
  if (errno == ENOMEM) throw OutOfMemory("shared with another process", "exchange data", static_cast<double>(size));
  throw InputError(fmt::format("no memory to share with another process: {}", std::strerror(errno)));
}

size_t page_size() {
  static const auto size = static_cast<size_t>(sysconf(_SC_PAGESIZE));
  return size;
}

size_t rounded_up(size_t value, size_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

}  // namespace

MemoryFile::MemoryFile() : descriptor_(memfd_create("brume", MFD_CLOEXEC)) {
  if (descriptor_ < 0) fail();
}

MemoryFile::MemoryFile(const std::filesystem::path& folder) : on_disk_(true) {
  std::string name = (folder / "brume-XXXXXX").string();
  descriptor_ = mkostemp(name.data(), O_CLOEXEC);
  if (descriptor_ < 0)
    throw InputError(fmt::format("{}: no temporary file can be made there: {}", folder.string(), std::strerror(errno)));
  unlink(name.c_str());
}

// Files in memory alone can be sealed.
MemoryFile::MemoryFile(int descriptor) : descriptor_(descriptor), on_disk_(fcntl(descriptor, F_GET_SEALS) < 0) {
  update_size();
}

MemoryFile::~MemoryFile() {
  close(descriptor_);
}

void MemoryFile::update_size() {
  struct stat status {};
  if (fstat(descriptor_, &status) != 0) fail();
  size_ = static_cast<size_t>(status.st_size);
}

void MemoryFile::resize(size_t size) {
  // A file that is written through a mapping must have its room on disk beforehand: later there is no error to be told.
  if (on_disk_ && size > size_)
    if (const int error = posix_fallocate(descriptor_, static_cast<off_t>(size_), static_cast<off_t>(size - size_)))
      throw InputError(fmt::format("no room for a temporary file of {:.1f} GB: {}", static_cast<double>(size) / 1e9,
                                   std::strerror(error)));
  if (ftruncate(descriptor_, static_cast<off_t>(size)) != 0) fail(size);
  size_ = size;
}

size_t MemoryFile::append(std::span<const std::byte> bytes) {
  constexpr size_t kAlignment = 64;
  const size_t offset = rounded_up(size_, kAlignment);
  size_t written = 0;
  while (written < bytes.size()) {
    const ssize_t count =
        pwrite(descriptor_, bytes.data() + written, bytes.size() - written, static_cast<off_t>(offset + written));
    if (count <= 0) fail();
    written += static_cast<size_t>(count);
  }
  size_ = std::max(size_, offset + bytes.size());
  return offset;
}

void MemoryFile::discard(size_t offset, size_t size) {
  const size_t begin = rounded_up(offset, page_size()), end = (offset + size) / page_size() * page_size();
  if (begin < end)
    fallocate(descriptor_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(begin),
              static_cast<off_t>(end - begin));
}

Mapping::Mapping(const MemoryFile& file, size_t offset, size_t size, bool writable) : size_(size) {
  void* const at = mmap(nullptr, size, writable ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED, file.descriptor(),
                        static_cast<off_t>(offset));
  if (at == MAP_FAILED) fail(size);
  data_ = static_cast<std::byte*>(at);
}

Mapping::~Mapping() {
  munmap(data_, size_);
}

void Mapping::resize(size_t size) {
  void* const at = mremap(data_, size_, size, MREMAP_MAYMOVE);
  if (at == MAP_FAILED) fail(size);
  data_ = static_cast<std::byte*>(at);
  size_ = size;
}

void Mapping::release() const {
  madvise(data_, size_, MADV_DONTNEED);
}

MappedTail::MappedTail(MemoryFile& file) : file_(&file), offset_(rounded_up(file.size(), page_size())) {}

std::span<std::byte> MappedTail::extend(size_t bytes) {
  const size_t begin = used_, needed = used_ + bytes;
  if (!mapping_ || needed > mapping_->size()) {
    constexpr size_t kFirst = size_t{1} << 22, kOnDisk = size_t{1} << 27;
    // What has been written on disk need not stay in memory.
    const size_t ahead = file_->on_disk() ? std::min(2 * used_, used_ + kOnDisk) : 2 * used_;
    const size_t capacity = rounded_up(std::max({kFirst, needed, ahead}), page_size());
    file_->resize(offset_ + capacity);
    if (mapping_ && file_->on_disk()) mapping_->release();
    if (mapping_)
      mapping_->resize(capacity);
    else
      mapping_ = std::make_shared<Mapping>(*file_, offset_, capacity, /*writable=*/true);
  }
  used_ = needed;
  return {mapping_->data() + begin, bytes};
}

std::shared_ptr<const Mapping> MappedTail::finish() {
  const size_t size = rounded_up(used_, page_size());
  mapping_->resize(size);
  file_->resize(offset_ + size);
  return mapping_;
}

}  // namespace brume
