#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "base/rng.h"
#include "render/session/renderer.h"
#include "volume/medium.h"

namespace brume::test {

/// Bricks of a function on a lattice.
BrickGrid make_bricks(const VoxelBox& box, const std::function<float(const ivec3&)>& density);
/// Density 1 on every voxel of a box.
BrickGrid constant_box(const ivec3& lo, const ivec3& hi, float density = 1.0f);

using brume::translation;
dmat4 scaling(const dvec3& s);
/// A random affine map: rotated, scaled, sheared, mirrored in half of the cases.
dmat4 random_affine(Rng& rng);
dvec3 random_direction(Rng& rng);
dvec3 random_point(Rng& rng, const dvec3& lo, const dvec3& hi);

/// Writes bricks' function as a VDB with any affine transform.
void write_affine_vdb(const std::filesystem::path& path, const VoxelBox& box, const dmat4& world_from_index,
                      const std::function<float(const ivec3&)>& density);

/// A scalar grid to write; values of 0 are left inactive, an empty function leaves it empty.
struct NamedGrid {
  std::string name;
  std::function<float(const ivec3&)> value;
};
/// Writes scalar grids over a box, voxels of one size, as fog volumes.
void write_grids_vdb(const std::filesystem::path& path, const VoxelBox& box, const std::vector<NamedGrid>& grids,
                     double voxel_size = 1.0);

/// Sets one more voxel of a file's grid.
void add_voxel(const std::filesystem::path& path, const std::string& grid, const ivec3& voxel, float value);

/// Copies the density of a VDB and adds a velocity grid "vel", the same vector everywhere in a box, on the same
/// lattice.
void write_velocity_vdb(const std::filesystem::path& path, const std::filesystem::path& density, const VoxelBox& box,
                        const dvec3& velocity);
/// Writes a density grid and the colour grid `Cd`, which reaches one voxel farther to all sides.
void write_coloured_vdb(const std::filesystem::path& path, const VoxelBox& box,
                        const std::function<float(const ivec3&)>& density,
                        const std::function<vec3(const ivec3&)>& colour);

/// Mean radiance of a picture over all its pixels, and the standard error of that mean from the samples' variance.
struct Mean {
  dvec3 value{0}, error{0};
};
Mean mean_radiance(const Layers& frame, const LayerName& layer = layer::beauty);

/// Fails, naming the first channel and pixel, unless two frames hold the same channels with the same bits.
void expect_same_bits(const Layers& a, const Layers& b, const std::string& what = "");

/// A scene that looks at the whole of a volume file from `distance` bounding radii away.
Scene scene_of(const std::filesystem::path& volume, double sigma_t, double albedo, double g);

/// One of the scenes that come with the program, `size` pixels square.
Scene demo(const char* name, int size);

}  // namespace brume::test
