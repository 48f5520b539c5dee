// The program brume-vdb-reader: reads or writes one VDB file for brume, which survives whatever a damaged one does to
// OpenVDB (volume/vdb_io.h).

#include <sys/mman.h>
#include <sys/resource.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>

#include "base/command.h"
#include "base/memory_file.h"
#include "base/parallel_for.h"
#include "base/peak_memory.h"
#include "volume/vdb_exchange.h"

namespace {

/// Starts TBB's threads while there is memory for them: TBB 2022 waits for ever where it finds none at its start.
/// @throws std::bad_alloc
void start_threads() {
  constexpr size_t kAmple = 64 << 20;
  void* const room = mmap(nullptr, kAmple, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (room == MAP_FAILED) throw std::bad_alloc();
  munmap(room, kAmple);
  brume::parallel_for(2, {}, [](int) {});
}

}  // namespace

int main() {
  std::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error of that write, with its message
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  brume::keep_freed_memory();  // in large pages: clearing small ones takes longer than reading a small volume
  try {
    start_threads();
    brume::MemoryFile exchange(brume::kHandedOver);
    brume::answer_vdb_request(exchange);
  } catch (const std::bad_alloc&) {
    return brume::kReaderOutOfMemory;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "brume-vdb-reader: %s. brume starts this program; it is of no use by itself\n", error.what());
    return 2;
  }
  return 0;
}
