#pragma once
#include <memory>
#include <string>

#include "volume/vdb_io.h"

namespace brume {

/// Grids of a volume that are in memory already: read from its file before, or made of arrays. Null: there is none.
struct VolumeGrids {
  std::shared_ptr<const ScalarField> density, temperature, flame;
  std::shared_ptr<const VectorField> colour;
  std::shared_ptr<const VectorField> velocity;  ///< as it is stored, world units per frame; of arrays alone
  ivec3 size{0};                                ///< of the arrays; 0: read from a file
  std::string content;                          ///< of arrays: tells their values from others

  bool of_arrays() const { return size.x > 0; }
};

}  // namespace brume
