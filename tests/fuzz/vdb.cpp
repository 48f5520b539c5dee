#include "tests/fuzz/support.h"
#include "volume/vdb_io.h"

// What OpenVDB does over a damaged file happens in the reading process; this one must tell of it and go on.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  return brume::fuzz::read_as_file(data, size, ".vdb", [&](const auto& path) {
    switch (size % 4) {
      case 0:
        brume::read_vdb_info(path);
        break;
      case 1:
        brume::load_colour(path, "");
        break;
      case 2: {
        brume::ScalarField density;
        density.summary.box = {brume::ivec3(0), brume::ivec3(7)};
        std::vector<std::string> notes;
        brume::load_displacement(path, "", density, 1.0, 0.0, 1.0, notes);
        break;
      }
      default:
        brume::load_scalar(path, {});
    }
  });
}
