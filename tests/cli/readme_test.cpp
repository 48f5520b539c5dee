// The README's block of examples, in its order, as a person copies it: in a folder that has the clone's data. Pictures
// are smaller and times shorter than there, which is all that the program in the path changes.

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>

#include "tests/support/files.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

TEST(Readme, ExamplesRunInTheirOrder) {
  const std::string readme = test::read_file(test::source("README.md"));
  const std::string fence = "```sh\nexport PATH=\"$PWD/build/release:$PATH\"\n";
  const size_t begin = readme.find(fence), end = readme.find("```\n", begin + fence.size());
  ASSERT_NE(begin, std::string::npos);
  std::string block = readme.substr(begin + 6, end - begin - 6);
  EXPECT_GT(std::count(block.begin(), block.end(), '\n'), 20);

  const test::TemporaryFolder folder;
  fs::create_directories(folder / "build/release");
  fs::create_directory_symlink(test::source("data"), folder / "data");
  test::write_file(folder / "build/release/brume",
                   "#!/bin/sh\n"
                   "echo \"brume $*\" >>told\n"
                   "case \"$1 $2\" in\n"
                   "generate*) set -- \"$@\" --resolution 32 ;;\n"
                   "render*) set -- \"$@\" -D film.width=24 -D film.height=24 ;;\n"
                   "*/quick.toml) set -- \"$@\" --size 16 --reference-spp 4 --seeds 2 --spp 4,16 ;;\n"
                   "evaluate*) set -- \"$@\" -f bilateral ;;\n"
                   "esac\n"
                   "for word; do\n"
                   "  shift\n"
                   "  case \"$word\" in 20s) word=0.2s ;; 0.005) word=0.2 ;; 128) word=16 ;; 64) word=4 ;; esac\n"
                   "  set -- \"$@\" \"$word\"\n"
                   "done\n"
                   "exec " BRUME_PROGRAM " \"$@\"\n");
  fs::permissions(folder / "build/release/brume", fs::perms::owner_all);
  test::write_file(folder / "block.sh", block);
  const int ended = std::system(("cd " + folder.path().string() + " && sh -e block.sh >out 2>err").c_str());
  const std::string told = test::read_file(folder / "told"), err = test::read_file(folder / "err");
  EXPECT_EQ(WEXITSTATUS(ended), 0) << told << err;
  // The frames that are compared are of one scene.
  EXPECT_EQ(err.find("scenes that differ"), std::string::npos) << err;
  EXPECT_TRUE(fs::exists(folder / "results/table.md"));
}

}  // namespace
}  // namespace brume
