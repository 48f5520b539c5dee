#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "base/error.h"
#include "base/resident_limit.h"
#include "tests/support/files.h"
#include "volume/procedural.h"
#include "volume/vdb_io.h"

// Values that lie in a temporary file.

namespace brume {
namespace {

namespace fs = std::filesystem;

/// An environment variable for as long as it lives.
class Variable {
 public:
  Variable(const char* name, const std::string& value) : name_(name) { setenv(name, value.c_str(), 1); }
  ~Variable() { unsetenv(name_); }
  Variable(const Variable&) = delete;

 private:
  const char* name_;
};

/// The number in a line of /proc/self/status [bytes].
size_t status(const std::string& what) {
  std::ifstream stream("/proc/self/status");
  for (std::string line; std::getline(stream, line);)
    if (line.starts_with(what + ":")) return std::strtoull(line.c_str() + what.size() + 1, nullptr, 10) * 1024;
  return 0;
}

fs::path cloud(const test::TemporaryFolder& folder, bool half) {
  const ProceduralVolume v = procedural_cloud(150, 3);
  write_density(folder / "cloud.vdb", v.box, v.voxel_size, v.density, half, {}, v.is_zero);
  return folder / "cloud.vdb";
}

TEST(Paging, ValuesInAFileAreThoseInMemory) {
  const test::TemporaryFolder folder;
  for (const bool half : {false, true})
    for (const double limit : {0.0, 0.5}) {
      const fs::path path = cloud(folder, half);
      const ScalarField in_memory = load_scalar(path, {.limit = limit, .paging = Paging::kNever});
      const ScalarField paged = load_scalar(path, {.limit = limit, .paging = Paging::kAlways});
      const BrickGrid &a = in_memory.bricks, &b = paged.bricks;
      ASSERT_EQ(a.origin(), b.origin());
      ASSERT_EQ(a.cells(), b.cells());
      ASSERT_EQ(a.brick_count(), b.brick_count());
      ASSERT_GT(a.brick_count(), 500u);
      size_t compared = 0;
      a.each_cell([&](const ivec3& c) {
        const BrickGrid::Cell &p = a.cell(c), &q = b.cell(c);
        ++compared;
        ASSERT_EQ(p.majorant, q.majorant);
        ASSERT_TRUE(std::equal(a.brick(p), a.brick(p) + a.brick_values(), b.brick(q)));
      });
      EXPECT_GT(compared, 500u);
      EXPECT_EQ(in_memory.summary.active_voxels, paged.summary.active_voxels);
      EXPECT_EQ(in_memory.summary.minimum, paged.summary.minimum);
      EXPECT_EQ(in_memory.summary.maximum, paged.summary.maximum);
      ASSERT_EQ(paged.notes.size(), in_memory.notes.size() + 1);
      EXPECT_NE(paged.notes.back().find("paged from a temporary file in"), std::string::npos);
    }
}

TEST(Paging, SmallVolumesStayInMemory) {
  const test::TemporaryFolder folder;
  const Variable nowhere("TMPDIR", (folder / "missing").string());
  EXPECT_FALSE(load_scalar(cloud(folder, true), {}).bricks.empty()) << "no temporary file is made";
}

TEST(Paging, AFolderThatIsMissingIsNamed) {
  const test::TemporaryFolder folder;
  const fs::path path = cloud(folder, true), missing = folder / "missing";
  const Variable nowhere("TMPDIR", missing.string());
  try {
    load_scalar(path, {.paging = Paging::kAlways});
    FAIL() << "expected an error";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(missing.string()), std::string::npos) << error.what();
  }
}

TEST(Paging, NothingStaysInTheFolder) {
  const test::TemporaryFolder folder, pages;
  const fs::path path = cloud(folder, true);
  const Variable here("TMPDIR", pages.path().string());
  const ScalarField field = load_scalar(path, {.paging = Paging::kAlways});
  EXPECT_GT(field.bricks.maximum(), 0);
  EXPECT_TRUE(fs::is_empty(pages.path()));
}

// Values are read while bricks are made, after the limits of parsing have ended.
TEST(Paging, ADamagedFileIsAnError) {
  const test::TemporaryFolder folder;
  const fs::path path = cloud(folder, true);
  const auto size = static_cast<long>(fs::file_size(path));
  {
    std::fstream file(path, std::ios::binary | std::ios::in | std::ios::out);
    file.seekp(size / 2);
    const std::string noise(static_cast<size_t>(size / 4), '\xa5');
    file.write(noise.data(), static_cast<std::streamsize>(noise.size()));
  }
  EXPECT_THROW(load_scalar(path, {.paging = Paging::kAlways}), InputError);
}

TEST(ResidentLimit, KeepsAMappingSmallAndItsContents) {
  constexpr size_t kSize = size_t{96} << 20, kMost = size_t{16} << 20, kStep = 4096;
  const test::TemporaryFolder folder;
  MemoryFile file(folder.path());
  ASSERT_TRUE(file.on_disk());
  file.resize(kSize);
  {
    const Mapping written(file, 0, kSize, /*writable=*/true);
    for (size_t i = 0; i < kSize; i += kStep) written.data()[i] = static_cast<std::byte>(i / kStep * 7);
  }
  const Mapping mapping(file, 0, kSize, /*writable=*/false);
  const ResidentLimit limit(mapping, kMost);
  const size_t before = status("RssFile");  // code that came into memory before the limit was set counts, too
  const auto read = [&] {
    for (size_t i = 0; i < kSize; i += kStep) ASSERT_EQ(mapping.data()[i], static_cast<std::byte>(i / kStep * 7));
  };
  read();
  for (int i = 0; i < 3000 && status("RssFile") > before + kMost; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_LE(status("RssFile"), before + kMost);
  read();
}

}  // namespace
}  // namespace brume
