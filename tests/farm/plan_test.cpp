// What is asked of a farm: the commands of a shot, and what its folder says is left of them.

#include "farm/plan.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <optional>
#include <thread>

#include "base/error.h"
#include "base/host.h"
#include "base/text.h"
#include "farm/opencue.h"
#include "farm/slurm.h"
#include "farm/submit_lock.h"
#include "image/exr_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

class Farm : public ::testing::Test {
 protected:
  Farm() {
    shot_.folder = folder_ / "shot";
    shot_.name = "smoke";
    shot_.program = "brume test";
    shot_.brume = "/opt/my brume/brume";
    shot_.scene = "/scenes/smoke.toml";
    shot_.frames = {1, 2, 3};
    shot_.parts = 4;
    shot_.spp = 10;
    shot_.layers = "direct,indirect";
    shot_.statistics = "halves";
    shot_.filter = "gaussian";
    shot_.window = 1;
    shot_.save();
  }
  /// A file with the header that this shot's have.
  void write(const fs::path& path, int frame, int first, int end, const std::string& filter = "") const {
    Layers layers(4, 3);
    layers.add("R", 0.5f);
    layers.header = {{"program", shot_.program},
                     {"frame", frame},
                     {"seed", std::string("0")},
                     {"recordedLayers", shot_.layers},
                     {"statistics", shot_.statistics},
                     {"sampleFirst", first},
                     {"sampleEnd", end},
                     {"samplesPerPixel", end - first}};
    if (!filter.empty()) layers.header["filter"] = filter;
    fs::create_directories(path.parent_path());
    write_exr(path, layers);
  }
  static const Stage* stage(const std::vector<Stage>& stages, const std::string& name) {
    for (const Stage& s : stages)
      if (s.name == name) return &s;
    return nullptr;
  }
  std::vector<std::string> left(const std::string& name) const {
    const std::vector<Stage> stages = plan(shot_, examine(shot_, true));
    std::vector<std::string> names;
    if (const Stage* s = stage(stages, name))
      for (const ShotCommand& command : s->commands) names.push_back(command.name);
    return names;
  }
  test::TemporaryFolder folder_;
  Shot shot_;
};

TEST_F(Farm, APlanIsTheCommandsThatWouldBeTyped) {
  const std::vector<Stage> stages = plan(shot_);
  ASSERT_EQ(stages.size(), 3u);
  EXPECT_EQ(stage(stages, "render")->commands.size(), 12u);
  const std::string folder = shot_.folder.string();
  EXPECT_EQ(
      stage(stages, "render")->commands[1].line(),
      "mkdir -p " + folder +
          "/parts/0001 && '/opt/my brume/brume' render /scenes/smoke.toml --frames 1 --spp 10 --seed 0 --layers direct,indirect --part 2/4 --checkpoint " +
          folder + "/parts/0001/00002.checkpoint.exr -o " + folder + "/parts/0001/00002.exr --progress lines --resume");
  EXPECT_EQ(stage(stages, "merge")->commands[2].line(), "'/opt/my brume/brume' merge '" + folder +
                                                            "/parts/0003/#####.exr' --parts 1-4 -o " + folder +
                                                            "/frames/smoke.0003.exr --resume --discard");
  const std::string denoise = stage(stages, "denoise")->commands[0].line();
  EXPECT_NE(denoise.find("frames/smoke.0001.exr " + folder + "/frames/smoke.0002.exr; do"), std::string::npos)
      << "it waits for its neighbours: " << denoise;
  EXPECT_NE(denoise.find("--extra-frames 1"), std::string::npos) << denoise;
}

TEST_F(Farm, WhatIsWholeIsNotDoneAgain) {
  EXPECT_EQ(left("render").size(), 12u);
  write(shot_.part(1, 2), 1, 2, 5);
  EXPECT_EQ(left("render").size(), 11u);
  write(shot_.frame(1), 1, 0, 10);
  EXPECT_EQ(left("render").size(), 8u) << "a frame needs its parts no more";
  EXPECT_EQ(left("merge"), (std::vector<std::string>{"merge.0002", "merge.0003"}));
  EXPECT_EQ(left("denoise").size(), 3u);
  for (const int frame : {2, 3}) write(shot_.frame(frame), frame, 0, 10);
  for (const int frame : shot_.frames) write(shot_.clean(frame), frame, 0, 10, "gaussian");
  EXPECT_TRUE(plan(shot_, examine(shot_, true)).empty());
  EXPECT_TRUE(examine(shot_, false).complete());
}

TEST_F(Farm, WhatIsDamagedOrOfAnotherShotIsNamedAndDoneAgain) {
  const auto refused = [&](const std::string& why) {
    const ShotFiles files = examine(shot_, true);
    ASSERT_EQ(files.refused.size(), 1u);
    EXPECT_NE(files.refused[0].find("parts/0001/00002.exr: " + why), std::string::npos) << files.refused[0];
    EXPECT_EQ(left("render").size(), 12u);
  };
  const fs::path part = shot_.part(1, 2);
  write(part, 1, 2, 5);
  const std::string whole = test::read_file(part);
  test::write_file(part, whole.substr(0, whole.size() - 5));
  refused("truncated or damaged");
  write(part, 2, 2, 5);
  refused("the frame is 2 in the file, 1 in the shot");
  write(part, 1, 0, 5);
  refused("holds the samples 0 .. 4, not 2 .. 4");
  write(part, 1, 2, 4);
  refused("holds the samples 2 .. 3, not 2 .. 4");
  shot_.program = "brume older";
  write(part, 1, 2, 5);
  shot_.program = "brume test";
  refused("the program version is brume older in the file, brume test in the shot");
}

TEST_F(Farm, TooLittleMemoryIsNotDamage) {
  // A merge that ended for it is not a reason to hold its parts against the scene.
  for (int part = 1; part <= shot_.parts; ++part) write(shot_.part(1, part), 1, 10 * (part - 1) / 4, 10 * part / 4);
  EXPECT_EQ(left("render").size(), 8u);
  for (const auto& [why, commands] : {std::pair("a and b are not parts of one render", 12u),
                                      {"a.exr: not enough memory to read it, which takes at least 3 GB", 8u}}) {
    test::write_file(shot_.log("merge.0001"), std::string("brume task: begun in round 1 on n7\nbrume: ") + why +
                                                  "\nbrume task: ended with 2 after 5 s\n");
    EXPECT_EQ(left("render").size(), commands) << why;
  }
  if (!test::can_limit_memory()) GTEST_SKIP() << "memory cannot be limited here";
  {
    Layers large(8192, 256);
    for (const char* name : {"R", "G", "B", "A", "Z"}) large.add(name, 0.5f);
    const Layers small = read_exr((write(shot_.frame(1), 1, 0, 10), shot_.frame(1)));
    large.header = small.header;
    write_exr(shot_.frame(1), large);
  }
  for (size_t bytes = size_t{1} << 16; bytes < size_t{1} << 28; bytes *= 2) {
    const int found =
        test::status_with_memory(bytes, [&] { return examine(shot_, true).frames.at(1).empty() ? 0 : 1; });
    EXPECT_TRUE(found == 0 || found == test::kOutOfMemory) << "with " << bytes << " bytes: " << found;
  }
  EXPECT_TRUE(examine(shot_, true).frames.at(1).empty());
}

TEST_F(Farm, TimesOfFilesMeanNothing) {
  write(shot_.frame(1), 1, 0, 10);
  write(shot_.clean(1), 1, 0, 10, "gaussian");
  using namespace std::chrono_literals;
  for (const auto ahead : {-100000h, 100000h}) {
    fs::last_write_time(shot_.frame(1), fs::file_time_type::clock::now() + ahead);
    EXPECT_EQ(left("denoise"), (std::vector<std::string>{"denoise.0002", "denoise.0003"}));
  }
}

TEST_F(Farm, ManyPartsAreMergedInGroups) {
  shot_.parts = 10'000;
  shot_.spp = 20'000;
  const std::vector<Stage> stages = plan(shot_);
  EXPECT_EQ(stage(stages, "render")->commands.size(), 30'000u);
  EXPECT_EQ(stage(stages, "gather")->commands.size(), 300u);
  EXPECT_NE(stage(stages, "gather")->commands[1].line().find("--parts 101-200 "), std::string::npos);
  EXPECT_NE(stage(stages, "gather")->commands[1].line().find("--mergeable"), std::string::npos);
  EXPECT_NE(stage(stages, "merge")->commands[0].line().find("group.#####.exr' --parts 1-100 "), std::string::npos);
  // Every part is in one group.
  int next = 1;
  for (int group = 1; group <= shot_.groups(); ++group) {
    EXPECT_EQ(shot_.parts_of_group(group).first, next);
    next = shot_.parts_of_group(group).second + 1;
  }
  EXPECT_EQ(next, 10'001);
}

TEST_F(Farm, OneArrayForEachStageHoweverManyCommands) {
  shot_.frames.resize(240);
  for (int i = 0; i < 240; ++i) shot_.frames[static_cast<size_t>(i)] = i + 1;
  shot_.parts = 8;
  const auto jobs = slurm_jobs(shot_, plan(shot_), "/shot/rounds/1", {});
  ASSERT_EQ(jobs.size(), 4u);
  EXPECT_EQ(jobs[0].commands, 1920);
  EXPECT_EQ(jobs[0].tasks, 960) << "below MaxArraySize: a task runs two commands";
  EXPECT_EQ(jobs[1].tasks, 240);
  EXPECT_EQ(
      sbatch_lines(jobs, "/shot/rounds/1"),
      (std::vector<std::string>{"render=$(sbatch --parsable /shot/rounds/1/render.sh)",
                                "merge=$(sbatch --parsable --dependency=afterany:$render /shot/rounds/1/merge.sh)",
                                "denoise=$(sbatch --parsable --dependency=afterany:$merge /shot/rounds/1/denoise.sh)",
                                "retry=$(sbatch --parsable --dependency=afterany:$denoise /shot/rounds/1/retry.sh)"}));
}

TEST_F(Farm, LogsTellWhoDidWhatAndWhy) {
  test::write_file(
      shot_.log("render.0001.00002"),
      "brume task: begun in round 1 on n7\nbrume: render smoke: 30 %, 4 s left\nbrume: no space\n"
      "brume task: ended with 2 after 5 s\nbrume task: begun in round 2 on n8\nbrume: render smoke: 70 %\n");
  const CommandLog log = read_log(shot_, "render.0001.00002");
  ASSERT_EQ(log.attempts.size(), 2u);
  EXPECT_EQ(log.attempts[0].node, "n7");
  EXPECT_EQ(log.attempts[0].status, 2);
  EXPECT_EQ(log.attempts[0].seconds, 5);
  EXPECT_EQ(log.attempts[1].round, 2);
  EXPECT_FALSE(log.attempts[1].status);
  EXPECT_EQ(log.percent, 70);
}

TEST_F(Farm, TheReasonIsTheLastMessageOfTheLastAttempt) {
  const auto reason = [&](const std::string& said) {
    test::write_file(shot_.log("render.0001.00002"),
                     "brume task: begun in round 1 on n7\nbrume: no space\nbrume task: ended with 2 after 5 s\n"
                     "brume: merged beside it\nbrume task: begun in round 2 on n8\n" +
                         said + "brume task: ended with 1 after 1 s\nbrume: merged beside it\n");
    return read_log(shot_, "render.0001.00002").reason;
  };
  EXPECT_EQ(
      reason("brume: note: 3 %, 9 s left\nbrume: f.exr: No space left on device\nbrume: render s: 30 %, 4 s left\n"),
      "f.exr: No space left on device");
  EXPECT_EQ(reason("brume: f.exr: fills the disk to 100 %: No space left on device\n"),
            "f.exr: fills the disk to 100 %: No space left on device");
  EXPECT_EQ(reason("brume: s.toml: unknown key\n --> s.toml\n   |\n 3 | k = 1\n   | ^ here\n\n"),
            "s.toml: unknown key");
  EXPECT_EQ(reason("sh: 1: exec: /opt/brume: not found\n"), "sh: 1: exec: /opt/brume: not found");
  EXPECT_EQ(reason(""), "") << "of an earlier attempt";
}

TEST_F(Farm, WhatCommandsOrScriptsCannotHoldIsRefused) {
  EXPECT_NO_THROW(shot_.check());
  const auto refused = [&](const auto& change, const std::string& why, bool by_slurm_alone = false) {
    Shot shot = shot_;
    SlurmOptions options;
    change(shot, options);
    if (by_slurm_alone) {
      EXPECT_NO_THROW(shot.check());
    }
    try {
      shot.check();
      check_slurm(shot, options);
      ADD_FAILURE() << "taken; expected: " << why;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
  };
  refused([](Shot& s, auto&) { s.folder = "/a\nb"; }, "/a\\x0ab: holds a line break");
  refused([](Shot& s, auto&) { s.scene = "/a\rb"; }, "the scene /a\\x0db: holds a line break");
  refused([](Shot& s, auto&) { s.brume = "/a\x1b"; }, "the program /a\\x1b: holds");
  refused([](Shot& s, auto&) { s.overrides = {"a=1\n"}; }, "-D a=1\\x0a: holds");
  refused([](Shot& s, auto&) { s.folder = "/a/sh\xe9t"; }, "is not UTF-8");
  refused([](Shot& s, auto&) { s.folder = "/a/####"; }, "holds a place for a frame's number");
  refused([](Shot& s, auto&) { s.name = "a$F"; }, "holds a place for a frame's number");
  refused([](Shot& s, auto&) { s.name = std::string(129, 'x'); }, "has 129 bytes; expected at most 128");
  refused([](Shot& s, auto&) { s.folder = "/a/b\\"; }, "backslash", true);
  refused([](Shot&, SlurmOptions& o) { o.sbatch = {"--comment=a\ntouch b"}; },
          "--sbatch --comment=a\\x0atouch b: holds", true);
  refused([](Shot&, SlurmOptions& o) { o.sbatch = {"render"}; }, "expected an option of sbatch", true);
  refused([](Shot&, SlurmOptions& o) { o.time = "1\n2"; }, "--time 1\\x0a2: holds", true);
}

TEST_F(Farm, OneSubmitterHoldsTheLock) {
  const fs::path file = shot_.folder / "submit.lock";
  const auto refusal = [&] {
    try {
      const SubmitLock lock(shot_.folder, false);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  {
    const SubmitLock lock(shot_.folder, false);
    EXPECT_NE(refusal().find(fmt::format("is being submitted by {}, process {}, since 2", host_name(), getpid())),
              std::string::npos)
        << refusal();
    EXPECT_NE(refusal().find("wait for it"), std::string::npos) << refusal();
  }
  EXPECT_FALSE(fs::exists(file));
  // As another machine holds it; as a process of this one left it that is gone.
  test::write_file(file, "render7 4711 2026-01-02T03:04:05Z\n");
  EXPECT_NE(refusal().find("by render7, process 4711, since 2026-01-02T03:04:05Z; wait for it"), std::string::npos)
      << refusal();
  const pid_t child = fork();
  if (child == 0) _exit(0);
  waitpid(child, nullptr, 0);
  test::write_file(file, fmt::format("{} {} 2026-01-02T03:04:05Z\n", host_name(), child));
  EXPECT_NE(refusal().find("that process is gone, and --break-lock goes on without it"), std::string::npos)
      << refusal();
  EXPECT_TRUE(fs::exists(file));
  {
    const SubmitLock first(shot_.folder, true);
    EXPECT_EQ(first.broken(), fmt::format("{}, process {}, since 2026-01-02T03:04:05Z", host_name(), child));
    // Broken, the first does not take away the lock of who broke it.
    test::write_file(file, "render7 4711 2026-01-02T03:04:05Z\n");
  }
  EXPECT_TRUE(fs::exists(file));
}

TEST_F(Farm, OfSubmittersAtOnceOneHoldsTheLock) {
  std::atomic<int> holders{0}, refused{0}, ready{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&] {
      std::optional<SubmitLock> lock;
      try {
        lock.emplace(shot_.folder, false);
        ++holders;
      } catch (const InputError&) {
        ++refused;
      }
      // Nobody gives it up before all have tried.
      for (++ready; ready < 8;) std::this_thread::yield();
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(holders, 1);
  EXPECT_EQ(refused, 7);
}

TEST_F(Farm, ANodeWhereMostFailsIsLeftOut) {
  const fs::path round = write_round(shot_, plan(shot_));
  EXPECT_EQ(round.filename(), "1");
  EXPECT_EQ(write_round(shot_, plan(shot_)).filename(), "2");
  const auto attempt = [&](const std::string& command, const std::string& node, int status) {
    test::write_file(shot_.log(command), "brume task: begun in round 1 on " + node + "\nbrume task: ended with " +
                                             std::to_string(status) + " after 1 s\n");
  };
  attempt("render.0001.00001", "bad", 2);
  EXPECT_TRUE(failing_nodes(shot_, 1).empty()) << "where nothing else is left, it is not";
  attempt("render.0001.00002", "good", 0);
  attempt("render.0001.00003", "good", 137);
  EXPECT_EQ(failing_nodes(shot_, 1), std::set<std::string>{"bad"});
}

TEST_F(Farm, TheSameShotIsFoundAgainAndAnotherIsNot) {
  Shot same = Shot::load(shot_.folder);
  EXPECT_EQ(same.difference(shot_), "");
  same.parts = 8;
  same.frames = {1, 2, 3, 4};
  EXPECT_EQ(shot_.difference(same), "frames is 1-3 there, 1-4 here; parts is 4 there, 8 here");
  EXPECT_THROW(Shot::load(folder_.path()), InputError);
  test::write_file(shot_.folder / "shot.json", "{\"parts\": ");
  EXPECT_THROW(Shot::load(shot_.folder), InputError);
}

TEST_F(Farm, OpenCueGetsALayerForEachStage) {
  const std::string outline = opencue_outline(shot_, plan(shot_), "/shot/rounds/1");
  EXPECT_NE(
      outline.find(
          "render = Shell(\"render\", command=[\"sh\", \"/shot/rounds/1/run.sh\", \"render\", \"#IFRAME#\", \"1\"], range=\"1-12\", chunk=1)"),
      std::string::npos)
      << outline;
  EXPECT_NE(outline.find("merge.depend_all(render)"), std::string::npos) << outline;
}

TEST_F(Farm, OpenCueHandsWordsToAShell) {
  shot_.folder = "/it's a \"shot\"";
  const std::string outline = opencue_outline(shot_, plan(shot_), shot_.folder / "rounds/1");
  EXPECT_NE(outline.find(R"(command=["sh", "'/it'\\''s a \"shot\"/rounds/1/run.sh'", "render")"), std::string::npos)
      << outline;
}

TEST(ShellWord, IsTakenAsItIs) {
  EXPECT_EQ(shell_word("a-b_1.exr"), "a-b_1.exr");
  EXPECT_EQ(shell_word("a b"), "'a b'");
  EXPECT_EQ(shell_word("it's"), "'it'\\''s'");
  EXPECT_EQ(shell_word("parts/####.exr"), "'parts/####.exr'");
  EXPECT_EQ(shell_word(""), "''");
}

}  // namespace
}  // namespace brume
