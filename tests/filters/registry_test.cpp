#include "filters/api/registry.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "base/error.h"
#include "tests/support/files.h"

namespace brume {
namespace {

std::string error_of(const std::string& filter) {
  try {
    parse_filter(filter);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// A filter's file declares it once; the linker, or a file that CMake does not know, must not lose it.
TEST(Registry, HoldsEveryFilterThatAFileDeclares) {
  size_t declared = 0;
  for (const auto& file : std::filesystem::recursive_directory_iterator(test::source("filters"))) {
    if (file.path().extension() != ".cpp") continue;
    const std::string text = test::read_file(file.path());
    const std::string registration = "const Registration registration(entry);";
    for (size_t at = text.find(registration); at != std::string::npos; at = text.find(registration, at + 1)) ++declared;
  }
  EXPECT_GE(declared, 19u);
  EXPECT_EQ(all_filters().size(), declared);
  for (size_t i = 1; i < all_filters().size(); ++i) EXPECT_LT(all_filters()[i - 1]->name, all_filters()[i]->name);
}

TEST(Registry, EveryFilterHasThePublishedParametersAsAPreset) {
  for (const FilterEntry* e : all_filters()) {
    FilterSettings paper(*e);
    ASSERT_NO_THROW(paper.set("preset", "paper")) << e->name;
    for (const auto& [name, value] : e->find_preset("paper").settings) {
      ASSERT_TRUE(e->find(name)) << e->name << " " << name;
      EXPECT_NE(Parameter::text(FilterSettings(*e).get(*e->find(name))), value)
          << e->name << ": " << name << " is the default already";
    }
  }
}

TEST(Registry, WhatIsNamedStandsAboveAPresetWhateverTheOrder) {
  const std::string published = parse_filter("rdfc:preset=paper").text();
  EXPECT_NE(published, parse_filter("rdfc").text());
  EXPECT_TRUE(holds(published, "candidates=published"));
  EXPECT_EQ(parse_filter("rdfc:preset=paper,candidates=with-color").text(),
            parse_filter("rdfc:candidates=with-color,preset=paper").text());
  EXPECT_TRUE(holds(parse_filter("rdfc:strength=0.7,preset=paper").text(), " strength=0.7 "));
  EXPECT_TRUE(holds(error_of("rdfc:preset=papr"), "filter rdfc has no preset 'papr'; did you mean 'paper'?"))
      << error_of("rdfc:preset=papr");
  EXPECT_TRUE(holds(filters_reference(), "preset `paper`, as published: `")) << "the page shows them";
}

TEST(Registry, ParametersAreSetAndChecked) {
  const FilterSettings s = parse_filter("bilateral:sigma-range=12.5,average=linear");
  EXPECT_EQ(s.text(), "radius=6 sigma-domain=1.5 sigma-range=12.5 noise-factor=0 average=linear");
  EXPECT_TRUE(holds(error_of("bilatral"), "no filter 'bilatral'; did you mean 'bilateral'?")) << error_of("bilatral");
  EXPECT_TRUE(holds(error_of("bilateral:sigma-rang=1"), "no parameter 'sigma-rang'; did you mean 'sigma-range'?"));
  EXPECT_TRUE(holds(error_of("bilateral:sigma-range=-1"), "expected a number in 0 .. 1000 Lab units"));
  EXPECT_TRUE(holds(error_of("bilateral:sigma-range=nan"), "expected a number"));
  EXPECT_TRUE(holds(error_of("bilateral:sigma-range="), "expected a number"));
  EXPECT_TRUE(holds(error_of("bilateral:radius=2.5"), "expected an integer in 0 .. 32"));
  EXPECT_TRUE(holds(error_of("gradient_kernel:variant=papr"), "expected one of paper, mul, gate"));
  EXPECT_TRUE(holds(error_of("bilateral:radius"), "expected parameter=value"));
}

TEST(Registry, EveryDeclarationIsComplete) {
  for (const FilterEntry* e : all_filters()) {
    EXPECT_FALSE(e->summary.empty() || e->source.empty() || e->when.empty()) << e->name;
    EXPECT_GT(e->merit, 0) << e->name;
    FilterSettings settings(*e);
    EXPECT_GE(settings.apron(), 0);
    for (const Parameter& p : e->parameters) {
      EXPECT_FALSE(p.help.empty()) << e->name << " " << p.name;
      // The default lies in the range, and is accepted as text; candidates too.
      settings.set(p.name, Parameter::text(settings.get(p)));
      for (const Parameter::Value& v : p.candidates) settings.set(p.name, Parameter::text(v));
    }
  }
}

}  // namespace
}  // namespace brume
