// The program brume-vdb-reader: reads or writes one VDB file for brume, which survives whatever a damaged one does to
// OpenVDB (volume/vdb_io.h).

#include <sys/resource.h>

#include <csignal>
#include <cstdio>
#include <exception>

#include "base/command.h"
#include "base/memory_file.h"
#include "volume/vdb_exchange.h"

int main() {
  std::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error of that write, with its message
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  try {
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
