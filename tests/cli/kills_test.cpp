// Long commands that are killed again and again, at moments drawn at random, end like one that nobody disturbed: with
// its bits, or, where time or the estimate of an error end them, with what they promise. BRUME_KILLS says how often
// each is killed (once unless set; the long run takes 15).

#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <functional>

#include "base/rng.h"
#include "image/exr_io.h"
#include "image/sample_records.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using test::run_brume;

int kills() {
  const char* const wanted = std::getenv("BRUME_KILLS");
  return wanted ? std::atoi(wanted) : 1;
}

class Kills : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  /// Runs a command, kills it as often as asked for, and lets it end.
  /// @param resuming  the command as it is now, which may depend on the files that are there
  test::ProgramResult killed(const std::function<std::string()>& resuming) {
    static Rng rng(27);
    int done = 0;
    // A command that has nothing left to do ends by itself.
    for (int attempt = 0; done < kills() && attempt < 3 * kills(); ++attempt) {
      test::RunningProgram program(resuming());
      usleep(static_cast<useconds_t>(50e3 + 1.5e6 * rng.uniform() * rng.uniform()));
      static const int kSignals[] = {SIGKILL, SIGTERM, SIGINT};
      program.send(kSignals[rng.bits() % 3]);
      const int status = program.finish().status;
      done += status == 3 || status > 128;
      EXPECT_TRUE(status == 0 || status == 1 || status == 3 || status > 128) << status << program.err();
    }
    std::printf("killed %d times\n", done);
    test::ProgramResult end = run_brume(resuming());
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path()))
      EXPECT_NE(entry.path().extension(), ".part") << entry.path() << ": left behind";
    return end;
  }

  /// Of one frame with a checkpoint.
  std::string frame(const std::string& options) const {
    return "render " + test::source("data/scenes/smoke.toml").string() +
           " -D film.width=72 -D film.height=64 --progress none --layers direct,indirect " + options;
  }
  test::ProgramResult killed_frame(const std::string& options) {
    const std::string checkpoint = path("c.exr");
    return killed([&] {
      return frame(options) + " --checkpoint-every 0.05 --checkpoint " + checkpoint +
             (fs::exists(checkpoint) ? " --resume " + checkpoint : "") + " -o " + path("f.exr");
    });
  }
  void expect_undisturbed(const std::string& options) {
    ASSERT_EQ(run_brume(frame(options) + " -o " + path("whole.exr")).status, 0);
    const auto r = killed_frame(options);
    ASSERT_EQ(r.status, 0) << options << r.err;
    test::expect_same_bits(read_exr(folder_ / "whole.exr"), read_exr(folder_ / "f.exr"), options);
  }
  test::TemporaryFolder folder_;
};

TEST_F(Kills, ARenderEndsWithTheBitsOfOneThatWasNot) {
  expect_undisturbed("--spp 1000");
}
TEST_F(Kills, APartToo) {
  expect_undisturbed("--spp 2000 --part 2/2");
}
TEST_F(Kills, ACleanFrameToo) {
  expect_undisturbed("--spp 500 --clean");
}
TEST_F(Kills, RoundsThatEndByTheCleanErrorToo) {
  expect_undisturbed("--clean --target-error 0.004");
}

TEST_F(Kills, ATargetErrorIsReached) {
  const auto r = killed_frame("--target-error 0.012");
  EXPECT_EQ(r.status, 0) << r.err;
  EXPECT_LE(read_exr(folder_ / "f.exr").number("estimatedRelativeError").value_or(1), 0.012);
}

TEST_F(Kills, TimeThatIsAskedForIsUsed) {
  for (const std::string clean : {"", " --clean"}) {
    fs::remove(path("c.exr"));
    const auto r = killed_frame("--time 4s" + clean);
    EXPECT_EQ(r.status, 0) << r.err;
    // Rounds that would not end in time are not begun.
    EXPECT_GT(read_exr(folder_ / "f.exr").number("renderTimeSeconds").value_or(0), clean.empty() ? 3 : 1.5) << clean;
  }
}

TEST_F(Kills, ASequenceEndsWithTheBitsOfOneThatWasNot) {
  const auto sequence = [&](const std::string& name, const std::string& more) {
    return frame("--spp 150 --clean --frames 1-4 -o '" + path(name + ".####.exr") + "' " + more);
  };
  ASSERT_EQ(run_brume(sequence("whole", "")).status, 0);
  const auto r = killed(
      [&] { return sequence("f", "--resume --checkpoint '" + path("c.####.exr") + "' --checkpoint-every 0.05"); });
  ASSERT_EQ(r.status, 0) << r.err;
  for (const std::string number : {"0001", "0002", "0003", "0004"})
    test::expect_same_bits(read_exr(folder_ / ("whole." + number + ".exr")),
                           read_exr(folder_ / ("f." + number + ".exr")), number);
  const auto cleaned = [&](const std::string& name) {
    return "denoise '" + path("whole.####.exr") + "' --frames 1-4 -f nfor --resume --progress none -o '" +
           path(name + ".####.exr") + "'";
  };
  ASSERT_EQ(run_brume(cleaned("clean")).status, 0);
  ASSERT_EQ(killed([&] { return cleaned("g"); }).status, 0);
  for (const std::string number : {"0001", "0004"})
    test::expect_same_bits(read_exr(folder_ / ("clean." + number + ".exr")),
                           read_exr(folder_ / ("g." + number + ".exr")), number);
}

// Records are written in one go: what is killed leaves nothing, and is begun anew.
TEST_F(Kills, RecordsAppearWholeOrNotAtAll) {
  const auto command = [&](const std::string& name) {
    return frame("--spp 60 --records " + path(name + ".records") + " -o " + path(name + ".exr"));
  };
  ASSERT_EQ(run_brume(command("whole")).status, 0);
  const auto r = killed([&] { return command("f"); });
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(test::read_file(folder_ / "whole.records") == test::read_file(folder_ / "f.records"));
}

}  // namespace
}  // namespace brume
