// The rooms of the house: who may include whom, and which library stays behind which door.

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/support/files.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::set<std::string>> kMayInclude = {
    {"base", {"base"}},
    {"volume", {"volume", "base"}},
    {"image", {"image", "base"}},
    {"render", {"render", "volume", "image", "base"}},
    {"filters", {"filters", "image", "base"}},
    {"evaluate", {"evaluate", "filters", "image", "base"}},
    {"app", {"app", "evaluate", "filters", "render", "volume", "image", "base"}},
};

TEST(Architecture, EachRoomIncludesOnlyWhatItMayKnow) {
  const std::regex include("#include \"([a-z]+)/");
  int seen = 0;
  for (const auto& [room, allowed] : kMayInclude)
    for (const auto& entry : fs::recursive_directory_iterator(test::source(room))) {
      if (entry.path().extension() != ".h" && entry.path().extension() != ".cpp") continue;
      const std::string text = test::read_file(entry.path());
      for (auto it = std::sregex_iterator(text.begin(), text.end(), include); it != std::sregex_iterator();
           ++it, ++seen)
        EXPECT_TRUE(allowed.contains((*it)[1])) << entry.path() << " includes " << (*it)[0];
    }
  EXPECT_GT(seen, 100);
}

// Inside render/ the rooms stand in a row: each knows those before it and itself.
TEST(Architecture, TheRendererKnowsItsRoomsInOneDirection) {
  const std::vector<std::string> rooms = {"scene", "world", "trace", "lanes", "frame"};
  const std::regex include("#include \"render/([a-z_]+)/");
  int seen = 0;
  for (const auto& entry : fs::recursive_directory_iterator(test::source("render"))) {
    if (entry.path().extension() != ".h" && entry.path().extension() != ".cpp") continue;
    const auto own = std::find(rooms.begin(), rooms.end(), entry.path().parent_path().filename().string());
    ASSERT_NE(own, rooms.end()) << entry.path() << " stands in no room";
    const std::string text = test::read_file(entry.path());
    for (auto it = std::sregex_iterator(text.begin(), text.end(), include); it != std::sregex_iterator();
         ++it, ++seen) {
      const auto met = std::find(rooms.begin(), rooms.end(), (*it)[1]);
      EXPECT_TRUE(met != rooms.end() && met <= own) << entry.path() << " includes " << (*it)[0];
    }
  }
  EXPECT_GT(seen, 50);
}

TEST(Architecture, EachLibraryIsKnownToItsOneFile) {
  const std::pair<const char*, const char*> doors[] = {
      {"<openvdb/", "volume/vdb_file.cpp"},     {"<Imf", "image/exr_io.cpp"},
      {"<libdeflate", "image/exr_zip.cpp"},     {"<toml.hpp>", "render/scene/scene_io.cpp"},
      {"<embree", "render/world/surfaces.cpp"}, {"<tiny_obj", "render/world/mesh.cpp"}};
  for (const auto& [library, door] : doors)
    for (const auto& [room, allowed] : kMayInclude)
      for (const auto& entry : fs::recursive_directory_iterator(test::source(room)))
        if (entry.is_regular_file() &&
            test::read_file(entry.path()).find(std::string("#include ") + library) != std::string::npos) {
          EXPECT_EQ(fs::relative(entry.path(), test::source(".")).string(), door);
        }
}

}  // namespace
}  // namespace brume
