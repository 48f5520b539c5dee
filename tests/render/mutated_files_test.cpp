// Files with flipped bits, cut, patched and shuffled: whatever brume reads itself is refused in words, or read as it
// was written, or, where the format has no checksum, read as what it now says, without a crash and without reserving
// memory for what is not there. BRUME_MUTATIONS says how many of each kind (50 unless set; the long run takes 10,000).

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <functional>

#include "base/error.h"
#include "base/rng.h"
#include "image/exr_copy.h"
#include "image/exr_io.h"
#include "image/hdr_io.h"
#include "image/sample_records.h"
#include "render/files/mesh.h"
#include "render/scene/scene_io.h"
#include "render/session/render_state.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/frames.h"
#include "tests/support/volumes.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

int mutations() {
  const char* const wanted = std::getenv("BRUME_MUTATIONS");
  return wanted ? std::atoi(wanted) : 50;
}

/// A file with one to four changes, three of four of them in its first `header` bytes.
std::string mutated(std::string bytes, size_t header, Rng& rng) {
  const auto below = [&](size_t n) {
    return std::min(static_cast<size_t>(rng.uniform() * static_cast<double>(n)), n - 1);
  };
  for (size_t changes = 1 + below(4); changes > 0 && !bytes.empty(); --changes) {
    const size_t end = rng.uniform() < 0.75 ? std::min(header, bytes.size()) : bytes.size(), at = below(end);
    const auto patch = [&](const std::string& with) {
      bytes.replace(at, std::min(with.size(), bytes.size() - at), with);
    };
    const auto word = [&](uint32_t value) { patch({reinterpret_cast<const char*>(&value), 4}); };
    static const uint32_t kWords[] = {0,     1,        2,          3,          17,         255,
                                      65535, 1u << 16, 0x7fffffff, 0x80000000, 0xffffffff, 0x7fc00000};
    switch (below(8)) {
      case 0:
      case 1:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
      case 2:
        bytes[at] = static_cast<char>(below(256));
        break;
      case 3:
        word(kWords[below(std::size(kWords))]);
        break;
      case 4:
        bytes.insert(at, 1 + below(8), static_cast<char>(below(256)));
        break;
      case 5:
        bytes.erase(at, 1 + below(8));
        break;
      case 6:
        patch(bytes.substr(below(bytes.size()), 1 + below(64)));
        break;
      default:
        if (rng.uniform() < 0.2) bytes.resize(at);
        break;
    }
  }
  return bytes;
}

struct Outcome {
  int refused = 0, same = 0, changed = 0;
};

/// Reads mutations of a file. The one that is read last lies in the working folder under the kind's name.
/// @param read  the contents as text, to be compared; throws InputError
Outcome read_mutated(const std::string& kind, const fs::path& original, size_t header,
                     const std::function<std::string(const fs::path&)>& read) {
  const std::string bytes = test::read_file(original), whole = read(original);
  const test::TemporaryFolder folder;
  const fs::path file = folder / (kind + original.extension().string());
  Rng rng(std::hash<std::string>()(kind));
  Outcome outcome;
  for (int i = 0; i < mutations(); ++i) {
    test::write_file(file, mutated(bytes, header, rng));
    try {
      ++(read(file) == whole ? outcome.same : outcome.changed);
    } catch (const InputError& error) {
      ++outcome.refused;
      EXPECT_NE(std::string(error.what()), "");
    } catch (const std::exception& error) {
      fs::copy_file(file, fs::temp_directory_path() / ("mutated_" + file.filename().string()),
                    fs::copy_options::overwrite_existing);
      ADD_FAILURE() << kind << " mutation " << i << ": " << error.what();
    }
  }
  std::printf("%s: %d refused, %d read as they were, %d as what they say now\n", kind.c_str(), outcome.refused,
              outcome.same, outcome.changed);
  return outcome;
}

std::string text_of(const Plane& plane) {
  std::string text;
  for (int y = 0; y < plane.height(); ++y)
    text.append(reinterpret_cast<const char*>(plane.row(y)), static_cast<size_t>(plane.width()) * sizeof(float));
  return text;
}

std::string pixels_of(const Layers& frame) {
  std::string text = frame.data_window().text() + frame.display_window().text();
  for (const auto& [name, plane] : frame.channels()) text += name + text_of(plane);
  return text;
}

class MutatedFiles : public ::testing::Test {
 protected:
  fs::path part(bool keep_state) {
    Scene scene = read_scene(test::source("data/scenes/smoke.toml"));
    scene.film.width = 34;
    scene.film.height = 17;
    RenderJob job;
    job.spp = 3;
    job.keep_state = keep_state;
    job.program = "brume test";
    const fs::path path = folder_ / "part.exr";
    write_exr(path, PreparedScene(scene, LayerRequest::of({"direct", "indirect"}, true)).render(job, {}).layers);
    return path;
  }
  test::TemporaryFolder folder_;
};

TEST_F(MutatedFiles, PartsAndCheckpointsAreReadAsTheyWereOrNotAtAll) {
  const Outcome o = read_mutated("part", part(true), 4096, [](const fs::path& path) {
    const Layers merged = merge_parts({path}, true);
    return pixels_of(merged) + merged.text("sceneHash") + merged.text("seed") + merged.text("sampleRanges");
  });
  EXPECT_EQ(o.changed, 0);
}

TEST_F(MutatedFiles, FramesShowWhatWasWrittenWhileTheirChecksumIsThere) {
  const Outcome o = read_mutated("frame", part(false), 4096, [](const fs::path& path) {
    if (test::read_file(path).find("fileChecksum") == std::string::npos) throw InputError("another program's");
    return pixels_of(read_exr(path));
  });
  EXPECT_EQ(o.changed, 0);
}

TEST_F(MutatedFiles, RecordsAreReadAsTheyWereOrNotAtAll) {
  const test::Records records(test::noisy_frame(20, 18, 1));
  const Outcome o = read_mutated("sample", records.folder / "x.records", 2048, [](const fs::path& path) {
    RecordReader reader(path);
    std::string text;
    for (int tile = 0; tile < reader.layout().tile_count(); ++tile)
      for (const float v : reader.read(tile)) text.append(reinterpret_cast<const char*>(&v), sizeof v);
    return text;
  });
  EXPECT_EQ(o.changed, 0);
}

// Formats without a checksum say what they say now; nothing else is asked of them than not to crash, and to be finite.
TEST_F(MutatedFiles, FramesOfOtherProgramsAreReadOrRefused) {
  const fs::path cycles = test::shared("references/cycles/odd/allpasses_half_64.exr");
  if (cycles.empty()) GTEST_SKIP() << "no shared files";
  const Outcome o = read_mutated("cycles", cycles, 8192, [](const fs::path& path) {
    read_exr_info(path);
    check_exr(path);
    return pixels_of(read_exr(path));
  });
  EXPECT_LT(o.changed, mutations() / 10);
  read_mutated("copied", cycles, 8192, [&](const fs::path& path) {
    copy_exr(path, folder_ / "copy.exr", {});
    return std::string();
  });
}

TEST_F(MutatedFiles, SkiesMeshesAndScenesAreReadOrRefused) {
  const auto finite = [](const Layers& frame) {
    for (const auto& [name, plane] : frame.channels())
      for (int y = 0; y < plane.height(); ++y)
        for (const float v : plane.pixels(y)) EXPECT_TRUE(std::isfinite(v));
    return pixels_of(frame);
  };
  for (const char* name : {"columns_exposed", "flat", "new_runs", "old_runs"})
    read_mutated(name, test::source(std::string("tests/fuzz/corpus/hdr/") + name + ".hdr"), 100,
                 [&](const fs::path& path) { return finite(read_hdr(path)); });
  for (const char* name :
       {"notched.obj", "quad.obj", "quads_binary.ply", "strips_big_endian.ply", "triangle_ascii.ply"})
    read_mutated(name, test::source(std::string("tests/fuzz/corpus/mesh/") + name), 200, [&](const fs::path& path) {
      for (const dvec3& p : load_mesh(path, dmat4(1)).positions) EXPECT_TRUE(std::isfinite(p.x + p.y + p.z));
      return std::string();
    });
  fs::create_directory(folder_ / "data");
  fs::copy(test::source("data"), folder_ / "data", fs::copy_options::recursive | fs::copy_options::overwrite_existing);
  for (const char* name : {"smoke", "fire"})
    read_mutated(name, test::source(std::string("data/scenes/") + name + ".toml"), 4096, [&](const fs::path& path) {
      // Beside the volumes and meshes that it names.
      fs::copy_file(path, folder_ / "data/scenes/x.toml", fs::copy_options::overwrite_existing);
      return read_scene(folder_ / "data/scenes/x.toml").settings;
    });
}

TEST_F(MutatedFiles, VolumesAreReadOrRefused) {
  for (const char* name : {"blosc", "double", "zip"})
    read_mutated(name, test::source(std::string("tests/fuzz/corpus/vdb/") + name + ".vdb"), 2048,
                 [](const fs::path& path) {
                   const ScalarField field = load_scalar(path, {});
                   EXPECT_TRUE(field.bricks.empty() || std::isfinite(field.bricks.maximum()));
                   return std::string();
                 });
}

}  // namespace
}  // namespace brume
