// What other programs need of `brume render`: pictures while it renders, and an end when theirs comes.

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <nlohmann/json.hpp>
#include <sstream>

#include "image/exr_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::run_brume;

const std::string kSmoke = test::source("data/scenes/smoke.toml").string();
const std::string kTiny = " -D film.width=48 -D film.height=40 ";

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

class Updates : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  test::TemporaryFolder folder_;
};

/// The lines of JSON that tell of pictures.
std::vector<nlohmann::json> told(const std::string& err) {
  std::vector<nlohmann::json> found;
  std::istringstream lines(err);
  for (std::string line; std::getline(lines, line);)
    if (const auto json = nlohmann::json::parse(line, nullptr, false); json.is_object() && json.contains("picture"))
      found.push_back(json);
  return found;
}

// The first picture comes after one sample, the last one is the result.
TEST_F(Updates, AreToldAndTheResultStaysTheSame) {
  for (const std::string options : {"--spp 16", "--spp 16 --clean", "--clean --target-error 0.01",
                                    "--spp 16 --clean-filter gaussian --crop 8,4,40,30"}) {
    const std::string render = "render " + kSmoke + kTiny + options + " -q -o ";
    ASSERT_EQ(run_brume(render + path("plain.exr")).status, 0) << options;
    const auto r = run_brume(render + path("a.exr") + " --progress json --updates " + path("update.exr"));
    ASSERT_EQ(r.status, 0) << options << "\n" << r.err;
    const std::vector<nlohmann::json> updates = told(r.err);
    ASSERT_GE(updates.size(), 2u) << options << "\n" << r.err;
    for (size_t i = 0; i < updates.size(); ++i) {
      EXPECT_EQ(updates[i]["number"], static_cast<int>(i) + 1);
      EXPECT_EQ(updates[i]["picture"], path("update.exr"));
      EXPECT_EQ(updates[i]["last"], i + 1 == updates.size());
    }
    EXPECT_EQ(updates.front()["samples"], 1) << options;
    EXPECT_GT(updates.back()["samples"], 1) << options;

    const Layers plain = read_exr(folder_ / "plain.exr"), frame = read_exr(folder_ / "a.exr"),
                 update = read_exr(folder_ / "update.exr");
    test::expect_same_bits(plain, frame, options);
    EXPECT_EQ(update.names(), (std::vector<std::string>{"A", "B", "G", "R"}));
    EXPECT_EQ(update.data_window(), frame.data_window());
    for (const std::string& channel : update.names())
      for (int y = 0; y < frame.height(); ++y)
        for (int x = 0; x < frame.width(); ++x)
          ASSERT_EQ(update.at(channel)(x, y), frame.at(channel)(x, y)) << options << " " << channel;
    if (holds(options, "--clean ")) {
      EXPECT_NEAR(updates.back()["error"].get<double>(), frame.number("estimatedCleanError").value_or(-1), 1e-6);
    }
  }
}

TEST_F(Updates, AreWordsWithoutJson) {
  const auto r = run_brume("render " + kSmoke + kTiny + "--spp 4 -o " + path("a.exr") + " --updates " + path("u.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.err, path("u.exr") + ": 1 samples per pixel")) << r.err;
}

// Each frame of a sequence is shown in the same file, or in one of its own.
TEST_F(Updates, OfASequence) {
  const auto r = run_brume("render " + kSmoke + kTiny + "--spp 2 --frames 1-2 -q --progress json -o " +
                           path("a.####.exr") + " --updates " + path("u.####.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  for (const char* name : {"u.0001.exr", "u.0002.exr"}) EXPECT_TRUE(std::filesystem::exists(folder_ / name)) << name;
  EXPECT_EQ(told(r.err).size(), 4u) << r.err;
}

TEST_F(Updates, AFullDiskCostsThePicturesNotTheRender) {
  const test::FullDisk full(folder_ / "u.exr");
  const auto r = run_brume("render " + kSmoke + kTiny + "--spp 8 -q --progress json -o " + path("a.exr") +
                           " --updates " + path("u.exr"));
  EXPECT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.err, "warning: ") && holds(r.err, "no more pictures are shown")) << r.err;
  EXPECT_TRUE(told(r.err).empty()) << r.err;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "a.exr"));
}

TEST_F(Updates, AreRefusedWhereTheyWouldDestroyOtherFiles) {
  const std::string render = "render " + kSmoke + kTiny + "--spp 2 -o " + path("a.exr");
  const auto same = run_brume(render + " --updates " + path("a.exr"));
  EXPECT_EQ(same.status, 2);
  EXPECT_TRUE(holds(same.err, "--updates")) << same.err;
  const auto checkpoint = run_brume(render + " --checkpoint " + path("c.exr") + " --updates " + path("c.exr"));
  EXPECT_EQ(checkpoint.status, 2);
  EXPECT_TRUE(holds(run_brume(render + " --updates " + path("u.png")).err, ".exr"));
  EXPECT_TRUE(holds(run_brume(render + " --updates " + path("nowhere/u.exr")).err, "no folder"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "a.exr"));
}

/// A pipe by name: whoever has it open for writing keeps readers waiting.
class Lifeline {
 public:
  explicit Lifeline(const std::filesystem::path& path) {
    mkfifo(path.c_str(), 0600);
    end_ = open(path.c_str(), O_RDWR | O_CLOEXEC);
  }
  ~Lifeline() { cut(); }
  void cut() {
    if (end_ >= 0) close(end_);
    end_ = -1;
  }

 private:
  int end_;
};

// Samples for hours; whoever started it goes, and nothing is left.
TEST_F(Updates, AProgramWhoseStdinClosesEnds) {
  Lifeline lifeline(folder_ / "lifeline");
  test::RunningProgram program("render " + kSmoke + " --spp 1000000 -q --progress json --stop-with-stdin -o " +
                               path("a.exr") + " --updates " + path("u.exr") + " <" + path("lifeline"));
  ASSERT_TRUE(program.wait_until([&] { return !told(program.err()).empty(); })) << program.err();
  lifeline.cut();
  const test::ProgramResult r = program.finish();
  EXPECT_EQ(r.status, 3) << r.err;
  EXPECT_TRUE(holds(r.err, "interrupted")) << r.err;
  EXPECT_FALSE(std::filesystem::exists(folder_ / "a.exr"));
  EXPECT_FALSE(test::has_half_written(folder_.path()));
}

TEST_F(Updates, AnOpenStdinEndsNothing) {
  Lifeline lifeline(folder_ / "lifeline");
  EXPECT_EQ(run_brume("render " + kSmoke + kTiny + "--spp 2 -q --stop-with-stdin -o " + path("a.exr") + " <" +
                      path("lifeline"))
                .status,
            0);
}

// Interrupted while it renders, it ends without finishing what it was at.
TEST_F(Updates, AnInterruptedRenderLeavesTheLastPictureAndNoHalfWrittenOne) {
  test::RunningProgram program("render " + kSmoke + " --spp 1000000 -q --progress json -o " + path("a.exr") +
                               " --updates " + path("u.exr"));
  ASSERT_TRUE(program.wait_until([&] { return told(program.err()).size() > 2; })) << program.err();
  program.send(SIGTERM);
  EXPECT_EQ(program.finish().status, 3);
  EXPECT_EQ(read_exr(folder_ / "u.exr").width(), 400);
  EXPECT_FALSE(test::has_half_written(folder_.path()));
}

}  // namespace
}  // namespace brume
