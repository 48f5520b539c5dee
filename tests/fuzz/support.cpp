#include "tests/fuzz/support.h"

#include <unistd.h>

#include <cstdlib>
#include <fstream>

#include "base/error.h"

namespace brume::fuzz {
namespace fs = std::filesystem;

namespace {

/// A folder of this process, removed at its end.
struct Folder {
  fs::path path = fs::temp_directory_path() / ("brume_fuzz_" + std::to_string(getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
};

}  // namespace

int read_as_file(const uint8_t* data, size_t size, const std::string& extension,
                 const std::function<void(const fs::path&)>& read) {
  static const Folder folder;
  const fs::path path = folder.path / ("input" + extension);
  std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  try {
    read(path);
  } catch (const InputError& error) {
    if (std::string(error.what()).size() < 10) std::abort();
  } catch (const OutOfMemory&) {
    // A header may ask for more than there is.
  }
  return 0;
}

bool small(double width, double height, double channels) {
  return width * height * channels < 1 << 22;
}

}  // namespace brume::fuzz
