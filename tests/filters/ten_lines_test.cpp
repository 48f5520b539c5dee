// The ten lines of C++ in docs/filters.md, as they stand there: compiled, registered, searched and run.

#include DOCUMENTED_FILTER

#include <gtest/gtest.h>

#include "evaluate/protocol/tuning.h"
#include "filters/run/apply.h"
#include "tests/support/files.h"

namespace brume {
namespace {

TEST(TenLines, AreTenAndAFilterLikeTheOthers) {
  const std::string code = test::read_file(DOCUMENTED_FILTER);
  EXPECT_EQ(std::count(code.begin(), code.end(), '\n'), 10);
  Layers frame(9, 9);
  for (Plane* plane : frame.add_rgb(layer::beauty)) (*plane)(4, 4) = 25;
  ApplyOptions options;
  options.component = Component::kAll;
  options.outliers = Outliers::kKeep;
  std::vector<double> told;
  const Layers clean =
      apply_filter(parse_filter("mine"), frame, options, {1, [&](double f) { told.push_back(f); }, nullptr});
  EXPECT_TRUE(std::is_sorted(told.begin(), told.end()) && told.back() == 1);
  EXPECT_FLOAT_EQ(clean.at("G")(4, 4), 1) << "of 5 x 5";
  EXPECT_FLOAT_EQ(clean.at("G")(1, 4), 0);
  EXPECT_EQ(candidate_settings(parse_contender("mine")).size(), 5u)
      << "its default, what was published, and what a search tries";
}

}  // namespace
}  // namespace brume
