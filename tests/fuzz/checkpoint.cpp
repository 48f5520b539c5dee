#include "image/exr_io.h"
#include "render/session/render_state.h"
#include "tests/fuzz/support.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  return brume::fuzz::read_as_file(data, size, ".exr", [](const auto& path) {
    const brume::ExrInfo info = brume::read_exr_info(path);
    if (brume::fuzz::small(info.width, info.height, static_cast<double>(info.channels.size())))
      brume::merge_parts({path}, /*keep_state=*/true);
  });
}
