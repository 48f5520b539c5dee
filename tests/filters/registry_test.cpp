#include "filters/registry.h"

#include <gtest/gtest.h>

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

TEST(Registry, HoldsEveryFilterThatIsLinked) {
  std::vector<std::string> names;
  for (const FilterEntry* e : all_filters()) names.push_back(e->name);
  EXPECT_EQ(names, (std::vector<std::string>{"a_trous", "anisotropic_diffusion", "bayesian_collaborative", "bilateral",
                                             "extended_bilateral", "gaussian", "gradient_kernel", "guided", "nfor",
                                             "nl_means", "random_parameter", "rdfc", "sbf", "sobel_guided",
                                             "trilateral", "virtual_flash", "wavelet", "welch", "wlr"}));
}

TEST(Registry, ParametersAreSetAndChecked) {
  const FilterSettings s = parse_filter("bilateral:sigma-range=12.5,average=linear");
  EXPECT_EQ(s.text(), "radius=6 sigma-domain=2 sigma-range=12.5 noise-factor=0 average=linear");
  EXPECT_TRUE(holds(error_of("bilatral"), "no filter 'bilatral'; did you mean 'bilateral'?")) << error_of("bilatral");
  EXPECT_TRUE(holds(error_of("bilateral:sigma-rang=1"), "no parameter 'sigma-rang'; did you mean 'sigma-range'?"));
  EXPECT_TRUE(holds(error_of("bilateral:sigma-range=-1"), "expected a number in 0 .. 1000 Lab units"));
  EXPECT_TRUE(holds(error_of("bilateral:sigma-range=nan"), "expected a number"));
  EXPECT_TRUE(holds(error_of("bilateral:sigma-range="), "expected a number"));
  EXPECT_TRUE(holds(error_of("bilateral:radius=2.5"), "expected an integer in 0 .. 32"));
  EXPECT_TRUE(holds(error_of("gradient_kernel:variant=papr"), "expected one of paper, add-sharp, mul, gate"));
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

TEST(Registry, DocsAreInStep) {
  EXPECT_EQ(test::read_file(test::source("docs/filters.md")), filters_reference())
      << "run: brume docs filters > docs/filters.md";
}

}  // namespace
}  // namespace brume
