// The rooms of the house: who may include whom, and which library stays behind which door.

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <string_view>
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
    {"workflows", {"workflows", "evaluate", "filters", "render", "volume", "image", "base"}},
    {"farm", {"farm", "image", "base"}},
    {"apps/view", {"apps/view", "workflows", "evaluate", "filters", "render", "volume", "image", "base"}},
    {"apps/cli",
     {"apps/cli", "apps/view", "farm", "workflows", "evaluate", "filters", "render", "volume", "image", "base"}},
    {"apps/python",
     {"apps/python", "apps/view", "workflows", "evaluate", "filters", "render", "volume", "image", "base"}},
};

TEST(Architecture, EachRoomIncludesOnlyWhatItMayKnow) {
  const std::regex include("#include \"(apps/[a-z]+|[a-z]+)/");
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

// Inside these the rooms stand in a row: each knows those before it and itself.
TEST(Architecture, RoomsWithinRoomsKnowEachOtherInOneDirection) {
  const std::map<std::string, std::vector<std::string>> houses = {
      {"render", {"files", "scene", "world", "transport", "guides", "film", "session"}},
      {"filters",
       {"kernels", "inputs", "api", "patch", "window", "regression", "regression/transport", "multiscale", "per_sample",
        "learned", "combined", "run"}},
      {"evaluate", {"metrics", "protocol", "report"}}};
  int seen = 0;
  for (const auto& [house, rooms] : houses) {
    const auto room_of = [&](const std::string& folder) { return std::find(rooms.begin(), rooms.end(), folder); };
    const std::regex include("#include \"" + house + "/([a-z_/]+)/[a-z0-9_]+\\.h\"");
    for (const auto& entry : fs::recursive_directory_iterator(test::source(house))) {
      if (entry.path().extension() != ".h" && entry.path().extension() != ".cpp") continue;
      const auto own = room_of(fs::relative(entry.path().parent_path(), test::source(house)).string());
      ASSERT_NE(own, rooms.end()) << entry.path() << " stands in no room";
      const std::string text = test::read_file(entry.path());
      for (auto it = std::sregex_iterator(text.begin(), text.end(), include); it != std::sregex_iterator();
           ++it, ++seen) {
        const auto met = room_of((*it)[1]);
        EXPECT_TRUE(met != rooms.end() && met <= own) << entry.path() << " includes " << (*it)[0];
      }
    }
  }
  EXPECT_GT(seen, 250);
}

TEST(Architecture, EachLibraryIsKnownToItsOwnFiles) {
  const std::pair<const char*, std::set<std::string>> doors[] = {
      {"<openvdb/",
       {"volume/vdb/leaves.h", "volume/vdb/frustum.cpp", "volume/vdb/nano.cpp", "volume/vdb/reading.cpp",
        "volume/vdb/reading.h", "volume/vdb/scalar.cpp", "volume/vdb/write.cpp"}},
      {"<Imf",
       {"image/exr_common.cpp", "image/exr_common.h", "image/exr_copy.cpp", "image/exr_deep.cpp", "image/exr_io.cpp"}},
      {"<libdeflate", {"image/checksum.cpp", "image/exr_common.cpp", "image/exr_zip.cpp", "image/packed_half.cpp"}},
      {"<toml.hpp>", {"render/scene/toml_table.h"}},
      {"<OpenImageDenoise/", {"filters/learned/oidn_library.cpp"}},
      {"<embree", {"render/world/surfaces.cpp"}},
      {"<boost/beast", {"apps/view/server.cpp"}},
      {"<boost/asio", {"apps/view/server.cpp"}}};
  const auto includes = [](const std::filesystem::path& file, const std::string& header) {
    return test::read_file(file).find("#include " + header) != std::string::npos;
  };
  for (const auto& [library, behind] : doors)
    for (const auto& [room, allowed] : kMayInclude)
      for (const auto& entry : fs::recursive_directory_iterator(test::source(room)))
        if (entry.is_regular_file() && includes(entry.path(), library)) {
          EXPECT_TRUE(behind.contains(fs::relative(entry.path(), test::source(".")).string())) << entry.path();
        }
  // Their headers are for them alone.
  const std::set<std::string> tables = {"render/scene/scene_checks.h",    "render/scene/scene_io.cpp",
                                        "render/scene/scene_outline.cpp", "render/scene/toml_table.cpp",
                                        "workflows/experiment_file.cpp",  "workflows/frame_map.cpp",
                                        "workflows/mix_text.cpp"};
  for (const auto& [room, allowed] : kMayInclude)
    for (const auto& entry : fs::recursive_directory_iterator(test::source(room)))
      if (entry.is_regular_file() && includes(entry.path(), "\"render/scene/toml_table.h\"")) {
        EXPECT_TRUE(tables.contains(fs::relative(entry.path(), test::source(".")).string())) << entry.path();
      }
  for (const auto& [room, allowed] : kMayInclude)
    for (const auto& entry : fs::recursive_directory_iterator(test::source(room)))
      if (entry.is_regular_file() && includes(entry.path(), "\"image/exr_common.h\"")) {
        EXPECT_TRUE(entry.path().filename().string().starts_with("exr_")) << entry.path();
      }
}

/// The comments of a source, without their slashes, lines joined by blanks.
std::string comments(const std::string& source) {
  std::istringstream lines(source);
  std::string line, all;
  while (std::getline(lines, line)) {
    const size_t at = line.find("//");
    if (at != std::string::npos) all += line.substr(std::min(line.find_first_not_of('/', at), line.size())) + ' ';
  }
  return std::regex_replace(all, std::regex(" +"), " ");
}

// A reader of the clone can open what a comment refers to, and finds the heading that it names.
TEST(Architecture, WhatCommentsCiteStandsInTheClone) {
  std::vector<std::string> headings;
  std::istringstream methods(test::read_file(test::source("docs/methods.md")));
  for (std::string line; std::getline(methods, line);)
    if (line.starts_with("## ")) headings.push_back(line.substr(3));
  const std::regex page("([A-Za-z_./]+\\.md)\\b(, ([A-Z]))?");
  int cited = 0;
  for (const char* room :
       {"base", "volume", "image", "render", "filters", "evaluate", "workflows", "farm", "apps", "tests", "bench"})
    for (const auto& entry : fs::recursive_directory_iterator(test::source(room))) {
      if (entry.path().extension() != ".h" && entry.path().extension() != ".cpp") continue;
      const std::string text = comments(test::read_file(entry.path()));
      for (auto it = std::sregex_iterator(text.begin(), text.end(), page); it != std::sregex_iterator(); ++it) {
        const std::string name = (*it)[1];
        EXPECT_TRUE(fs::exists(test::source(name))) << entry.path() << " cites " << name;
        if (name != "docs/methods.md" || !(*it)[3].matched) continue;
        ++cited;
        const std::string_view rest = std::string_view(text).substr(static_cast<size_t>(it->position(3)));
        EXPECT_TRUE(std::any_of(headings.begin(), headings.end(),
                                [&](const std::string& heading) { return rest.starts_with(heading); }))
            << entry.path() << " cites docs/methods.md, " << rest.substr(0, 40);
      }
    }
  EXPECT_GT(cited, 20);
}

// So can a reader of a page: files and folders of the clone, tests by room and unit, and pages that are linked. What
// was there once has a page of its own.
TEST(Architecture, WhatPagesCiteStandsInTheClone) {
  std::vector<fs::path> pages = {test::source("README.md"), test::source("CONTRIBUTING.md"),
                                 test::source("tests/README.md")};
  for (const auto& entry : fs::directory_iterator(test::source("docs")))
    if (entry.path().extension() == ".md" && entry.path().filename() != "history.md") pages.push_back(entry.path());
  const std::regex path(
      "(^|[^A-Za-z0-9_/.-])((base|image|volume|render|filters|evaluate|workflows|farm|apps|tests|bench|data|docs|cmake|"
      "include)/[A-Za-z0-9_./-]*[A-Za-z0-9_])([{*<#-]?)");
  const std::regex link("\\]\\(([A-Za-z0-9_./-]+)(#[^)]*)?\\)");
  // Files that a reader is told to write.
  const std::regex example("mine\\.cpp|my_filter\\.cpp|FOLDER");
  const fs::path root = test::source("");
  int cited = 0;
  for (const fs::path& page : pages) {
    const std::string text = test::read_file(page);
    const auto stands = [&](const std::string& name) {
      for (const fs::path& folder : {root, root / "tests", page.parent_path()})
        for (const char* ending : {"", ".cpp", ".h", ".py"})
          if (fs::exists(folder / (name + ending))) return true;
      return false;
    };
    for (auto it = std::sregex_iterator(text.begin(), text.end(), path); it != std::sregex_iterator(); ++it) {
      const std::string name = (*it)[2];
      if ((*it)[4].length() > 0 || std::regex_search(name, example)) continue;
      ++cited;
      EXPECT_TRUE(stands(name)) << page << " cites " << name;
    }
    for (auto it = std::sregex_iterator(text.begin(), text.end(), link); it != std::sregex_iterator(); ++it) {
      ++cited;
      EXPECT_TRUE(fs::exists(page.parent_path() / std::string((*it)[1]))) << page << " links to " << (*it)[1];
    }
  }
  EXPECT_GT(cited, 200);
}

}  // namespace
}  // namespace brume
