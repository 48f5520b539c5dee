#pragma once
#include <array>
#include <cstddef>
#include <optional>

#include "volume/volume_grids.h"

namespace brume {

/// A dense box of values over x, y and z in somebody else's memory; its rows may lie in any order, and apart.
struct VoxelArray {
  enum class Type : uint8_t { kFloat, kDouble };
  const std::byte* data = nullptr;
  Type type = Type::kFloat;
  ivec3 size{0};
  std::array<std::ptrdiff_t, 3> stride{};  ///< bytes to the next value along x, y and z

  double at(const ivec3& v) const {
    const std::byte* const where = data + v.x * stride[0] + v.y * stride[1] + v.z * stride[2];
    if (type == Type::kDouble) return *reinterpret_cast<const double*>(where);
    return static_cast<double>(*reinterpret_cast<const float*>(where));
  }
};

/// Arrays of one volume, all of one size.
struct VolumeArrays {
  std::optional<VoxelArray> density = {}, temperature = {}, flame = {};
  std::optional<std::array<VoxelArray, 3>> colour = {}, velocity = {};  ///< by component
};

/// The grids that a file of these values would give: element (i, j, k) is the value of voxel (i, j, k), which sits at
/// that point of index space; outside of the arrays all is 0. NaN, negative and denormal values count as 0, infinite
/// ones as the largest finite value, all counted in the notes; of colours and velocities what is not finite is 0,
/// counted too. The values are copied once, into bricks, but for where all is 0.
/// @param others  grids of arrays of the same size that stay as they are where none is given instead; null: none
/// @throws InputError for more voxels along an axis than a grid may have; Interrupted
std::shared_ptr<const VolumeGrids> grids_of_arrays(const VolumeArrays& arrays, const VolumeGrids* others = nullptr,
                                                   const Task& task = {});

/// The values of a grid again, x slowest and z fastest. @param size  of the array that it was made of
/// @param step  values between two that are written
void copy_values(const BrickGrid& grid, const ivec3& size, float* to, std::ptrdiff_t step = 1);

/// A density whose voxels have gone through the curve and the limit of `options`, as a file's do when it is read.
ScalarField adjusted_density(const ScalarField& stored, const ScalarOptions& options, const Task& task);

/// The motion of a density of arrays by its velocity, as load_displacement makes it of a file.
/// Both have the density's lattice.
Displacement displacement_of(const VectorField& velocity, const ScalarField& density, const ShutterMotion& motion,
                             std::vector<std::string>& notes, const Task& task);

}  // namespace brume
