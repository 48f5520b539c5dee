#include <gtest/gtest.h>

#include <atomic>
#include <fstream>

#include "base/output_file.h"
#include "base/parallel_for.h"
#include "base/text.h"
#include "tests/support/files.h"

namespace brume {
namespace {

TEST(NearestName, FindsWhatWasMeant) {
  const std::vector<std::string> known = {"position", "look_at", "fov"};
  EXPECT_EQ(nearest_name("postion", known), "position");
  EXPECT_EQ(nearest_name("lookat", known), "look_at");
  EXPECT_EQ(nearest_name("temperature", known), "");
}

TEST(OutputFile, AppearsWholeOrNotAtAll) {
  const test::TemporaryFolder folder;
  const auto path = folder / "out.txt";
  {
    OutputFile file(path);
    std::ofstream(file.part()) << "half";
    EXPECT_FALSE(std::filesystem::exists(path));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "an uncommitted part stayed behind";
  write_text(path, "whole");
  EXPECT_EQ(test::read_file(path), "whole");
  EXPECT_THROW(write_text(folder / "no/such/folder.txt", "x"), InputError);
}

TEST(ParallelFor, CallsEachIndexOnceReportsToOneAndStops) {
  for (const int threads : {1, 2, 7}) {
    std::vector<std::atomic<int>> calls(1000);
    std::atomic<double> last{0};
    parallel_for(1000, {threads, [&](double f) { last = f; }, nullptr},
                 [&](int i) { ++calls[static_cast<size_t>(i)]; });
    for (const auto& c : calls) ASSERT_EQ(c, 1);
    EXPECT_EQ(last, 1.0);
  }
  std::atomic<bool> cancel{false};
  std::atomic<int> done{0};
  EXPECT_THROW(parallel_for(100000, {2, {}, &cancel}, [&](int) { cancel = ++done >= 10; }), Interrupted);
  EXPECT_LT(done, 100);
}

TEST(TimeLeft, IsSilentUntilItCanTell) {
  EXPECT_EQ(time_left(0.001, 10), "");
  EXPECT_EQ(time_left(0.25, 30), "1 m 30 s");
  EXPECT_EQ(format_duration(7800), "2 h 10 m");
}

}  // namespace
}  // namespace brume
