#include "render/files/mesh.h"

#include "tests/fuzz/support.h"

// A PLY file is known by its first bytes, whatever its name.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  return brume::fuzz::read_as_file(data, size, ".obj",
                                   [](const auto& path) { brume::load_mesh(path, brume::dmat4(1)); });
}
