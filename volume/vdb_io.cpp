#include "volume/vdb_io.h"

#include <dlfcn.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>

#include "base/command.h"
#include "base/error.h"
#include "base/memory_file.h"
#include "base/output_file.h"
#include "base/parallel_for.h"
#include "base/resident_limit.h"
#include "base/text.h"
#include "volume/displacement.h"
#include "volume/vdb_exchange.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr const char* kReader = "brume-vdb-reader";
constexpr const char* kReaderVariable = "BRUME_VDB_READER";
constexpr double kStallSeconds = 120;

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw InputError(fmt::format("{}: {}", path.string(), what));
}

/// The folder of the program, or of the shared library that this code lies in: of the Python module.
fs::path own_folder() {
  std::error_code error;
  Dl_info info{};
  fs::path file;
  // Of a program that was found by its bare name the path is unknown here.
  if (dladdr(reinterpret_cast<const void*>(&own_folder), &info) != 0 && info.dli_fname) file = info.dli_fname;
  if (!file.has_parent_path() || file.extension() != ".so") file = fs::read_symlink("/proc/self/exe", error);
  return fs::absolute(file, error).parent_path();
}

/// The program that reads files: where the environment says, near this program, or among the programs of the system.
fs::path find_reader() {
  if (const char* const named = std::getenv(kReaderVariable)) return named;
  std::error_code error;
  const fs::path here = own_folder();
  for (const fs::path& folder : {here, here.parent_path(), here.parent_path() / "libexec"})
    if (fs::exists(folder / kReader, error)) return folder / kReader;
  if (const char* const path = std::getenv("PATH"))
    for (const std::string& folder : split(path, ':'))
      if (!folder.empty() && fs::exists(fs::path(folder) / kReader, error)) return fs::path(folder) / kReader;
  throw InputError(fmt::format(
      "{}: not found; expected it beside this program, in {}, among the programs that PATH finds, or where {} says",
      kReader, here.string(), kReaderVariable));
}

/// What to say of a reader that ended without an answer.
std::string cause(const CommandEnd& end) {
  if (end.passed == CommandEnd::Limit::kStall) return "OpenVDB came to a standstill over it";
  if (end.signal == SIGXCPU) return "OpenVDB took far longer over it than its size allows";
  if (end.signal != 0) return fmt::format("OpenVDB crashed on it ({})", strsignal(end.signal));
  return fmt::format("OpenVDB ended on it with status {}", end.status);
}

void run_reader(const VdbRequest& request, const MemoryFile& file, ExchangeHeader& header, const Task& task) {
  const auto report = [&] {
    if (const double fraction = std::atomic_ref(header.progress).load(); fraction > 0) task.report(fraction);
  };
  const fs::path reader = find_reader();
  const CommandEnd end = run_command({.program = reader,
                                      .words = {reader.string()},
                                      .stall_limit = kStallSeconds,
                                      .handed_over = file.descriptor(),
                                      .supervised = false,
                                      .watch = report},
                                     task);
  // A larger number is no version: the reader, or what it runs in, has written over it.
  constexpr uint64_t kLatestVersion = 1 << 16;
  if (header.begun && header.begun != kExchangeVersion && header.begun < kLatestVersion)
    throw InputError(fmt::format(
        "{}: belongs to another version of brume (it speaks {}, expected {}); install both together, or set {}",
        reader.string(), header.begun, kExchangeVersion, kReaderVariable));
  // What a terminal sends reaches the reader too, perhaps before it has begun to ignore it.
  if (end.signal == SIGINT || end.signal == SIGTERM || end.signal == SIGHUP) throw Interrupted();
  // Its libraries are not loaded, or one of them gives up before the program begins.
  constexpr int kNotLoaded = 127;
  if (!header.begun && (end.status == kNotLoaded || end.signal == SIGABRT))
    fail(request.path, fmt::format("cannot be read: {} does not start, for lack of memory or of a library", kReader));
  if (end.status == kReaderOutOfMemory) throw OutOfMemory(request.path, "read it");
  if (end.signal == SIGKILL && end.passed == CommandEnd::Limit::kNone)
    throw OutOfMemory(fmt::format("{}: {}? The system stopped OpenVDB over it, out of memory perhaps", request.path,
                                  kNotEnoughMemory));
  const char* const failed = request.kind == VdbRequest::Kind::kWrite ? "cannot be written"
                             : header.cramped                         ? "not enough memory to read it, or damaged"
                                                                      : "damaged";
  if (end.signal != 0 || end.status != 0) fail(request.path, fmt::format("{}: {}", failed, cause(end)));
}

/// All of a memory file. Of one on disk no more is held in memory than a part.
std::shared_ptr<const Mapping> mapped(const MemoryFile& file) {
  static constexpr size_t kMostResident = size_t{2} << 30;
  if (!file.on_disk()) return std::make_shared<Mapping>(file, 0, file.size(), /*writable=*/false);
  struct Paged {
    Mapping mapping;
    ResidentLimit limit;
    explicit Paged(const MemoryFile& of)
        : mapping(of, 0, of.size(), /*writable=*/false), limit(mapping, std::min(kMostResident, of.size() / 2)) {}
  };
  const auto paged = std::make_shared<const Paged>(file);
  return {paged, &paged->mapping};
}

/// Where temporary files go: they may be larger than what is kept in memory, as /tmp often is.
fs::path folder_of_pages() {
  const char* const named = std::getenv("TMPDIR");
  return named && *named ? named : "/var/tmp";
}

/// Whether a grid's values go into a file.
bool is_paged(const fs::path& path, const ScalarOptions& options, const Task& task) {
  constexpr double kMostInMemory = 2e9;
  constexpr uint64_t kSmallFile = 1 << 26;  // one below unpacks to so much only where most values are shared
  if (options.paging != Paging::kAuto) return options.paging == Paging::kAlways;
  std::error_code error;
  if (const uint64_t size = fs::file_size(path, error); error || size < kSmallFile) return false;
  double bytes = 0;
  for (const GridSummary& grid : read_vdb_contents(path, task).grids) {
    if (!options.grid.empty() && grid.name != options.grid) continue;
    if (const auto known = grid.metadata.find("file_mem_bytes"); known != grid.metadata.end())
      bytes = std::max(bytes, std::strtod(known->second.c_str(), nullptr));
  }
  return bytes * BrickGrid::kBrick / 512 > kMostInMemory;
}

/// Has a file read by a process of its own, which a damaged one may crash, and takes over what that leaves in memory.
/// @param file  begins with room for the header
template <class Result>
Result ask(VdbRequest& request, MemoryFile& file, const Task& task) try {
  request.threads = task.threads;
  const Mapping beginning(file, 0, sizeof(ExchangeHeader), /*writable=*/true);
  auto& header = *new (beginning.data()) ExchangeHeader();
  {
    Packer pack(file);
    pack(request);
    header.request_offset = file.append(std::as_bytes(std::span(pack.bytes())));
    header.request_size = pack.bytes().size();
  }
  run_reader(request, file, header, task);

  file.update_size();
  if (file.size() < sizeof(ExchangeHeader)) fail(request.path, "damaged: its reader left nothing");
  try {
    Unpacker unpack(mapped(file), header.reply_offset, header.reply_size);
    if (header.outcome != VdbOutcome::kAnswered) {
      std::string message;
      unpack(message);
      if (header.outcome == VdbOutcome::kOutOfMemory) throw OutOfMemory(message, "read it");
      if (header.outcome == VdbOutcome::kNoSuchGrid) throw NoSuchGrid(message);
      throw InputError(message);
    }
    Result result{};
    unpack(result);
    task.report(1.0);
    return result;
  } catch (const std::out_of_range& error) {
    fail(request.path, fmt::format("damaged: its reader left no answer ({})", error.what()));
  }
} catch (const std::bad_alloc& error) {
  fail_reading(request.path, error);
}

template <class Result>
Result ask(VdbRequest& request, const Task& task) {
  MemoryFile file;
  file.resize(sizeof(ExchangeHeader));
  return ask<Result>(request, file, task);
}

}  // namespace

std::vector<GridEntry> VdbSummary::entries() const {
  std::vector<GridEntry> all;
  for (const GridSummary& grid : grids) all.push_back({grid.name, grid.type, grid.grid_class});
  return all;
}

VdbSummary read_vdb_info(const fs::path& path, const Task& task) {
  VdbRequest request{VdbRequest::Kind::kInfo, path.string()};
  return ask<VdbSummary>(request, task);
}

VdbSummary read_vdb_contents(const fs::path& path, const Task& task) {
  VdbRequest request{VdbRequest::Kind::kContents, path.string()};
  return ask<VdbSummary>(request, task);
}

ScalarField load_scalar(const fs::path& path, const ScalarOptions& options, const Task& task) {
  VdbRequest request{VdbRequest::Kind::kScalar, path.string()};
  request.options = options;
  if (!is_paged(path, options, task)) {
    request.options.paging = Paging::kNever;
    return ask<ScalarField>(request, task);
  }
  request.options.paging = Paging::kAlways;
  const fs::path folder = folder_of_pages();
  MemoryFile file(folder);
  file.resize(sizeof(ExchangeHeader));
  auto field = ask<ScalarField>(request, file, task);
  if (field.bricks.empty()) return field;
  field.notes.push_back(fmt::format("grid '{}': its values, {:.2f} GB, are paged from a temporary file in {}",
                                    field.summary.name, static_cast<double>(field.bricks.bytes()) / 1e9,
                                    folder.string()));
  return field;
}

VectorField load_colour(const fs::path& path, const std::string& grid, const Task& task) {
  VdbRequest request{VdbRequest::Kind::kColour, path.string()};
  request.grid = grid;
  return ask<VectorField>(request, task);
}

StoredVelocity load_velocity(const fs::path& path, const std::string& grid, const Task& task) {
  VdbRequest request{VdbRequest::Kind::kVelocity, path.string()};
  request.grid = grid;
  return ask<StoredVelocity>(request, task);
}

Displacement load_displacement(const fs::path& path, const std::string& grid, const ScalarField& density,
                               const ShutterMotion& motion, std::vector<std::string>& notes, const Task& task) {
  const StoredVelocity velocity = load_velocity(path, grid, task);
  notes.insert(notes.end(), velocity.notes.begin(), velocity.notes.end());
  try {
    return displacement_over(velocity, density, motion, notes, task);
  } catch (const InputError& error) {
    fail(path, error.what());
  }
}

void write_density(const fs::path& path, const VoxelBox& box, double voxel_size,
                   const std::function<float(const ivec3&)>& sample, bool half, const Task& task,
                   const std::function<bool(const VoxelBox&)>& is_zero) {
  constexpr int kLeaf = 8, kValues = kLeaf * kLeaf * kLeaf, kBatch = 4096;
  OutputFile output(path);
  MemoryFile file;
  file.resize(sizeof(ExchangeHeader));
  GrowingArray<float> values(&file);
  std::vector<VoxelPosition> corners;
  const ivec3 first = box.lo >> 3;
  const ivec3 leaves = (box.hi >> 3) - first + 1;
  const int64_t total = static_cast<int64_t>(leaves.x) * leaves.y * leaves.z;
  const auto corner_of = [&](int64_t leaf) {
    return kLeaf * (first + ivec3(leaf / leaves.z / leaves.y, leaf / leaves.z % leaves.y, leaf % leaves.z));
  };
  std::vector<float> batch(static_cast<size_t>(kBatch) * kValues);
  for (int64_t begin = 0; begin < total; begin += kBatch) {
    const int count = static_cast<int>(std::min<int64_t>(kBatch, total - begin));
    parallel_for(count, {task.threads, {}, task.cancel}, [&](int leaf) {
      const ivec3 corner = corner_of(begin + leaf);
      if (is_zero && is_zero({corner, corner + (kLeaf - 1)})) {
        std::fill_n(batch.begin() + static_cast<std::ptrdiff_t>(leaf) * kValues, kValues, 0.0f);
        return;
      }
      for (int i = 0; i < kValues; ++i) {
        const ivec3 v = corner + ivec3(i >> 6, i >> 3 & 7, i & 7);
        const bool inside = glm::all(glm::greaterThanEqual(v, box.lo)) && glm::all(glm::lessThanEqual(v, box.hi));
        batch[static_cast<size_t>(leaf) * kValues + i] = inside ? sample(v) : 0.0f;
      }
    });
    for (int leaf = 0; leaf < count; ++leaf) {
      const std::span<const float> of_leaf(batch.data() + static_cast<size_t>(leaf) * kValues, kValues);
      if (std::none_of(of_leaf.begin(), of_leaf.end(), [](float value) { return value > 0; })) continue;
      const ivec3 corner = corner_of(begin + leaf);
      corners.push_back({corner.x, corner.y, corner.z});
      values.append(of_leaf);
    }
    // The rest is the writing.
    task.report(0.9 * static_cast<double>(begin + count) / static_cast<double>(total));
  }
  VdbRequest request{VdbRequest::Kind::kWrite, path.string()};
  request.part = output.part().string();
  request.scale = voxel_size;
  request.half = half;
  request.leaf_corners = SharedArray(std::move(corners));
  request.leaf_values = values.finish();
  ask<uint64_t>(request, file, task);
  output.commit();
}

uint64_t write_halved_density(const fs::path& from, const std::string& grid, const fs::path& to, const Task& task) {
  OutputFile output(to);
  VdbRequest request{VdbRequest::Kind::kHalve, from.string()};
  request.grid = grid;
  request.output = to.string();
  request.part = output.part().string();
  const auto voxels = ask<uint64_t>(request, task);
  output.commit();
  return voxels;
}

}  // namespace brume
