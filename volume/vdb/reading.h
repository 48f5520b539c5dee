#pragma once
#include <openvdb/openvdb.h>
#include <sys/resource.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "volume/vdb_exchange.h"

// What the answers to all kinds of requests begin with: files are opened, looked through, and a grid is chosen.

namespace brume::vdb {

/// Limits of this process while OpenVDB parses a file, which believes what a damaged one says of its sizes.
///
/// A leaf of 512 voxels takes at least 128 bytes of a file, its mask twice, and at most 16 KiB of memory; so do the
/// nodes above it, in proportion. A file's bytes thus bound what it can honestly unpack to.
class ParsingLimits {
 public:
  explicit ParsingLimits(uint64_t file_bytes);
  ~ParsingLimits();
  /// Whether the machine, or limits that held before, allow less than a file of this size can honestly need.
  bool cramped() const { return cramped_; }
  ParsingLimits(const ParsingLimits&) = delete;
  ParsingLimits& operator=(const ParsingLimits&) = delete;

 private:
  rlimit memory_{}, processor_{};
  bool cramped_ = false;
};

/// One request being answered.
struct Reading {
  MemoryFile& memory;  ///< where bricks go
  ExchangeHeader& header;
  Task task;
  std::optional<ParsingLimits> limits = {};
};

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& what);

/// Grids whose values are halves in memory, too, which OpenVDB knows by itself from version 13 on.
using HalfTree = openvdb::tree::Tree4<openvdb::math::half, 5, 4, 3>::Type;
using HalfGrid = openvdb::Grid<HalfTree>;

/// To be called before OpenVDB is used.
void initialize();

/// Opens a file whose table of contents has been checked against its length.
std::unique_ptr<openvdb::io::File> open(Reading& reading, const std::filesystem::path& path);

/// Whether a file is NanoVDB's.
bool is_nano(const std::filesystem::path& path);
/// Writes the grids of such a file as those of a .vdb. @throws InputError, and what NanoVDB throws over damaged
/// contents
void unpack_nano(const std::filesystem::path& path, std::ostream& vdb);

std::map<std::string, std::string> texts(const openvdb::MetaMap& meta);
dmat4 affine_matrix(const openvdb::math::Transform& transform);

/// What a grid's metadata say of it.
GridSummary named(const openvdb::GridBase& grid);
/// The same, and what its values say.
GridSummary summarize(const openvdb::GridBase& grid, const Task& task);

std::vector<std::string> grid_names(openvdb::io::File& file);
std::string list_grids(openvdb::io::File& file);

/// The grid that is wanted, or without a wish the one that usual_grid() takes.
/// @throws NoSuchGrid where there is no usual one; InputError
std::string choose_grid(openvdb::io::File& file, const std::filesystem::path& path, const std::string& wanted,
                        GridUse use, std::vector<std::string>& notes);

/// Refuses grids that this machine cannot hold together, by what the file says of their size, before any of them is
/// read.
void check_memory(openvdb::io::File& file, const std::filesystem::path& path, const std::vector<std::string>& names);

/// Refuses what no density can be read from, with what to do instead.
void check_scalar_field(const std::filesystem::path& path, const GridSummary& grid, openvdb::io::File& file);

/// A grid whose voxels fan out from a camera as one of equal cubes, which a note tells; any other as it is. Level sets
/// are to be made fog before. @throws InputError for other transforms that are not affine, and where memory is short
openvdb::GridBase::Ptr with_equal_voxels(const std::filesystem::path& path, const openvdb::GridBase::Ptr& grid,
                                         std::vector<std::string>& notes, const Task& task);

// The answers, one file for each kind.

/// @param values  whether the grids are read and looked through, or their metadata only
VdbSummary read_summary(Reading& reading, const std::filesystem::path& path, bool values);
ScalarField read_scalar(Reading& reading, const std::filesystem::path& path, const ScalarOptions& options);
VectorField read_colour(Reading& reading, const std::filesystem::path& path, const std::string& wanted);
StoredVelocity read_velocity(Reading& reading, const std::filesystem::path& path, const std::string& wanted);
/// Writes the leaves that a request brings, and gives their memory back on the way. @return active voxels
uint64_t write_leaves(const VdbRequest& request, MemoryFile& memory);
uint64_t halve(Reading& reading, const std::filesystem::path& path, const std::string& name,
               const std::filesystem::path& output, const std::filesystem::path& part);

}  // namespace brume::vdb
