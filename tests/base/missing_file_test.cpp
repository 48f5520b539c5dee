// What is said of files that are not there.

#include "base/missing_file.h"

#include <gtest/gtest.h>

#include "base/error.h"
#include "tests/support/files.h"

namespace brume {
namespace {

TEST(MissingFile, NamesWhatMayHaveBeenMeant) {
  const test::TemporaryFolder folder;
  for (const char* name : {"smoke.vdb", "clouds.vdb", "shot.0001.exr", "shot.0002.exr"})
    test::write_file(folder / name, "");
  const auto said = [&](const char* name) { return missing_file(folder / name); };
  EXPECT_EQ(said("smok.vdb"), "no such file; did you mean " + (folder / "smoke.vdb").string() + "?");
  EXPECT_EQ(said("Cloud.vdb"), "no such file; did you mean " + (folder / "clouds.vdb").string() + "?");
  EXPECT_EQ(said("explosion.vdb"), "no such file") << "nothing like it is there";
  EXPECT_EQ(said("shot.0003.exr"), "no such file") << "another frame was not meant";
  EXPECT_EQ(said("shot.####.exr"), "no such file; frames 1-2 of it are there");
  EXPECT_EQ(said("other.####.exr"), "no file of that name is there");
  EXPECT_EQ(said("nowhere/below/smoke.vdb"), "no such file; there is no folder " + (folder / "nowhere").string());
}

TEST(MissingFile, AFileThatIsThereIsFine) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "smoke.vdb", "");
  EXPECT_NO_THROW(check_exists(folder / "smoke.vdb"));
  EXPECT_NO_THROW(check_exists(std::filesystem::path(folder / "smoke.vdb").parent_path()));
  EXPECT_THROW(check_exists(folder / "smoke.exr"), InputError);
}

}  // namespace
}  // namespace brume
