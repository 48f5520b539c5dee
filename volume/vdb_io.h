#pragma once
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/progress.h"
#include "volume/grid_names.h"
#include "volume/medium.h"

namespace brume {

struct StoredVelocity;

/// What one grid of a file is, for people and for error messages.
struct GridSummary {
  std::string name;         ///< as GridEntry::name
  std::string type;         ///< OpenVDB's name: float, double, vec3s, ...
  std::string grid_class;   ///< fog volume, level set, staggered, unknown
  std::string compression;  ///< of this grid: none, zip, blosc, active mask
  bool half = false;        ///< saved with 16 bits
  bool linear = true;       ///< false for frustums, whose voxels fan out from a camera
  uint64_t active_voxels = 0, active_tiles = 0;
  VoxelBox box;  ///< of the active voxels; empty() for an empty grid
  dvec3 voxel_size{0};
  dmat4 world_from_index{1};  ///< meaningful where linear
  bool has_range = false;     ///< scalar and not empty
  double minimum = 0, maximum = 0, background = 0;
  uint64_t nan_count = 0, infinite_count = 0, negative_count = 0;  ///< over stored values, scalars only
  uint64_t minus_infinite_count = 0;                               ///< of the infinite ones
  uint64_t denormal_count = 0;                                     ///< positive ones below stored_values' kLeastDensity
  std::map<std::string, std::string> metadata;
};

struct VdbSummary {
  std::string format_version, library_version;
  uint64_t bytes = 0;
  std::map<std::string, std::string> metadata;
  std::vector<GridSummary> grids;

  std::vector<GridEntry> entries() const;
};

/// A file has no grid of the kind that is looked for under its usual names: where a scene says "auto", there is none.
struct NoSuchGrid : InputError {
  using InputError::InputError;
};

// OpenVDB is known to a program of its own, brume-vdb-reader, which reads and writes the files: OpenVDB trusts what a
// file says, and a damaged one can crash it. The reader runs with limits on its memory and processor time, and cuts
// grids to bricks in memory that both programs share. It is looked for beside this program or the shared library that
// this code is in, in the folder above, in libexec there and in PATH; the environment variable BRUME_VDB_READER names
// another one. Cancelling a task ends it. All that follow throw InputError when a file is damaged, whatever the reader
// did over it.

/// @throws InputError: missing, not a VDB, truncated
VdbSummary read_vdb_info(const std::filesystem::path& path, const Task& task = {});

/// The same without a look at the grids' values: names, types, classes and metadata. @throws InputError: as
/// read_vdb_info
VdbSummary read_vdb_contents(const std::filesystem::path& path, const Task& task = {});

/// Whether the values of a grid that is read lie in memory or in a temporary file, in the folder that TMPDIR names or
/// in /var/tmp, of which the system holds in memory what is looked at. They are the same values.
enum class Paging : uint8_t {
  kAuto,    ///< in a file where they take more than 2 GB
  kAlways,  ///< in a file
  kNever    ///< in memory
};

struct ScalarOptions {
  std::string grid = {};  ///< empty: usual_grid() of `use`
  GridUse use = GridUse::kDensity;
  bool convert_level_set = false;                     ///< take a level set's inside as fog
  std::vector<std::pair<double, double>> remap = {};  ///< a curve through (stored, meant) that voxels go through
  double limit = 0;                                   ///< voxels above are taken as this, after remap; 0: none
  bool needs_flames = false;  ///< no field, and a note, where the file's usual grid of flames holds none
  Paging paging = Paging::kAuto;
};

/// A scalar field as the renderer walks it, and what was found on the way.
struct ScalarField {
  BrickGrid bricks;
  dmat4 world_from_index{1};
  GridSummary summary;
  std::vector<std::string> notes;  ///< sanitised voxels, dropped background, empty grid: one line each
};

/// Loads a scalar fog volume: any affine transform, float or double, saved as half or not, with active tiles; masks
/// count 1, whole numbers as such. NaN, negative and denormal voxels become 0, infinite ones the largest finite value,
/// all counted in the notes. A grid whose voxels fan out from a camera (a frustum) is sampled on equal cubes. A
/// background other than 0 counts inside the active bounding box and is dropped outside. An empty grid, or a file
/// without any, is no error: the medium is absent.
/// @throws InputError: as read_vdb_info, and: no such grid (lists those that exist; NoSuchGrid where none was named),
///         several that could be meant, not scalar, level set, points, singular transform
ScalarField load_scalar(const std::filesystem::path& path, const ScalarOptions& options, const Task& task = {});

struct VectorField {
  VectorBricks bricks;
  dmat4 world_from_index{1};
  std::vector<std::string> notes;
};

/// Loads a colour: a grid of three-vectors, or three scalar grids named like Cd_r, Cd.g, Cdb or Cd.x, Cd.y, Cd.z.
/// @throws InputError: as load_scalar; a grid of another type
VectorField load_colour(const std::filesystem::path& path, const std::string& grid, const Task& task = {});

/// Loads a velocity as it is stored: a grid of three-vectors (staggered or not) or three scalar grids named like vel.x,
/// vel.y, vel.z.
/// @throws InputError: as load_scalar; neither a grid of three-vectors nor three grids of numbers
StoredVelocity load_velocity(const std::filesystem::path& path, const std::string& grid, const Task& task = {});

struct ShutterMotion {
  double scale;        ///< world units of the velocity's file per frame, for one unit of stored velocity
  double open, close;  ///< shutter, in frames around the density's own time
};

/// Loads a velocity onto a density's lattice, in voxels per frame, extended to wherever it brings the density; and
/// bounds the density over all that the motion between two times can bring to each place.
/// @throws InputError: as load_velocity
Displacement load_displacement(const std::filesystem::path& path, const std::string& grid, const ScalarField& density,
                               const ShutterMotion& motion, std::vector<std::string>& notes, const Task& task = {});

/// Writes a fog volume "density" whose voxels sit at voxel_size * (i, j, k). @throws InputError
/// @param sample   density at a voxel; values <= 0 are left inactive
/// @param is_zero  whether a box is known to hold nothing; null: each voxel is asked for
void write_density(const std::filesystem::path& path, const VoxelBox& box, double voxel_size,
                   const std::function<float(const ivec3&)>& sample, bool half, const Task& task = {},
                   const std::function<bool(const VoxelBox&)>& is_zero = {});

/// Writes a copy of a grid at half the resolution, each voxel the mean of the 2 x 2 x 2 it replaces, saved as half.
/// @return active voxels written   @throws InputError
uint64_t write_halved_density(const std::filesystem::path& from, const std::string& grid,
                              const std::filesystem::path& to, const Task& task = {});

}  // namespace brume
