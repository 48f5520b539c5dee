#pragma once
#include <string>

#include "base/error.h"
#include "base/text.h"
#include "tests/support/files.h"
#include "tests/support/holds.h"
#include "tests/support/vdb_grids.h"
#include "volume/vdb_io.h"

namespace brume::test {

inline void write(const std::filesystem::path& path, const openvdb::GridPtrVec& grids) {
  openvdb::io::File file(path.string());
  file.write(grids);
  file.close();
}

/// Five voxels in a row, of values 1 to 5.
template <class Grid>
typename Grid::Ptr small_grid(const std::string& name) {
  openvdb::initialize();
  auto grid = Grid::create();
  grid->setName(name);
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  for (int i = 0; i < 5; ++i) grid->tree().setValue(openvdb::Coord(i, 0, 0), typename Grid::ValueType(i + 1));
  return grid;
}

/// What load_scalar says of a file that it refuses; empty: it reads it.
inline std::string load_error(const std::filesystem::path& path, const ScalarOptions& options = {}) {
  try {
    load_scalar(path, options);
  } catch (const InputError& error) {
    return error.what();
  } catch (const OutOfMemory& error) {
    return std::string("memory: ") + error.what();
  }
  return "";
}

inline std::string notes_of(const ScalarField& field) {
  return join(field.notes, "\n");
}

}  // namespace brume::test
