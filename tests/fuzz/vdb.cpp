#include <cstdlib>

#include "base/error.h"
#include "tests/fuzz/support.h"
#include "volume/vdb_io.h"

// Without the reading process every input would be refused, and nothing found.
extern "C" int LLVMFuzzerInitialize(int*, char***) {
  try {
    brume::read_vdb_info("no_such_file.vdb");
  } catch (const brume::InputError& error) {
    if (std::string(error.what()).find("no_such_file.vdb: no such file") != std::string::npos) return 0;
  }
  std::abort();
}

// What OpenVDB does over a damaged file happens in the reading process; this one must tell of it and go on.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  return brume::fuzz::read_as_file(data, size, ".vdb", [&](const auto& path) {
    // Tiles of millions of voxels are not wrong, they only take the time that their bricks take.
    for (const brume::GridSummary& grid : brume::read_vdb_info(path).grids) {
      const brume::dvec3 extent = brume::dvec3(grid.box.hi) - brume::dvec3(grid.box.lo);
      if (extent.x * extent.y * extent.z > 1 << 26) return;
    }
    switch (size % 3) {
      case 0:
        brume::load_colour(path, "");
        break;
      case 1: {
        brume::ScalarField density;
        density.summary.box = {brume::ivec3(0), brume::ivec3(7)};
        std::vector<std::string> notes;
        brume::load_displacement(path, "", density, {1.0, 0.0, 1.0}, notes);
        break;
      }
      default:
        brume::load_scalar(path, {});
    }
  });
}
