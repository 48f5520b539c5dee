#include "image/guide_names.h"

#include <gtest/gtest.h>

#include "tests/support/files.h"

namespace brume {
namespace {

TEST(GuideNames, StandInTheirPageWithUnitAndMeaning) {
  const std::string page = test::read_file(test::source("docs/guides.md"));
  for (const GuideName& guide : kGuideNames) {
    const std::string row = "| `" + std::string(guide.name.substr(kGuidePrefix.size())) + "` | " +
                            std::string(guide.channels) + " | " + std::string(guide.unit) + " | " +
                            std::string(guide.meaning) + " |\n";
    EXPECT_NE(page.find(row), std::string::npos) << "docs/guides.md lacks this row:\n" << row;
  }
}

TEST(GuideNames, AreFoundWhateverTheLightIsCalled) {
  const auto name_of = [](std::string_view layer) { return find_guide(layer).first->name; };
  EXPECT_EQ(name_of("guide.opacity"), "guide.opacity");
  EXPECT_EQ(name_of("guide.single.sun_2"), "guide.single.LIGHT");
  EXPECT_EQ(name_of("guide.single.emission"), "guide.single.emission");
  EXPECT_EQ(name_of("guide.multiple.sun_tail_half"), "guide.multiple.LIGHT_tail_half");
  EXPECT_EQ(name_of("guide.multiple.sun_half"), "guide.multiple.LIGHT_half");
  EXPECT_EQ(find_guide("guide.single.sphere_2").second, "light of sphere 2 scattered once: w E p V");
  EXPECT_EQ(find_guide("guide.something").first, nullptr);
}

TEST(GuideNames, TellTheirClassByTheirFirstWord) {
  EXPECT_EQ(guide_class("guide.multiple.coloured"), GuideClass::kMultiple);
  EXPECT_EQ(guide_class("guide.surface_material"), GuideClass::kMaterial);
  EXPECT_EQ(guide_class("guide.surface.sun"), GuideClass::kSurface);
  EXPECT_EQ(guide_class("guide.something"), GuideClass::kGeometry);
}

}  // namespace
}  // namespace brume
