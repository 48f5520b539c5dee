#include "render/scene/scene_io.h"
#include "tests/fuzz/support.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  return brume::fuzz::read_as_file(data, size, ".toml", [](const auto& path) { brume::read_scene(path, {}); });
}
