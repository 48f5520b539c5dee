#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstring>
#include <fstream>
#include <numeric>

#include "base/command.h"
#include "base/memory_file.h"
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
  EXPECT_EQ(nearest_name("POSITION", known), "position");
  EXPECT_EQ(nearest_name("Look", known), "look_at");
  EXPECT_EQ(nearest_name("temperature", known), "");
  const std::vector<std::string> options = {"json", "second-reference", "seconds", "seeds"};
  EXPECT_EQ(nearest_name("second", options), "seconds") << "the shortest that begins so";
  EXPECT_EQ(nearest_name("second-r", options), "second-reference") << "its beginning";
  EXPECT_EQ(nearest_name("seed", options), "seeds");
  EXPECT_EQ(nearest_name("jsno", options), "json");
  EXPECT_EQ(nearest_name("minute", options), "") << "of six letters four differ";
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

TEST(OutputFile, WritersOfOneFileDoNotMeet) {
  const test::TemporaryFolder folder;
  const auto path = folder / "out.txt";
  {
    OutputFile a(path), b(path);
    EXPECT_NE(a.part(), b.part());
    std::ofstream(a.part()) << "whole a";
    std::ofstream(b.part()) << "whole b";
    b.commit();
    EXPECT_EQ(test::read_file(path), "whole b");
    a.commit();
    EXPECT_EQ(test::read_file(path), "whole a");
  }
  EXPECT_FALSE(test::has_half_written(folder.path()));
}

TEST(OutputFile, WhatAKilledProcessHasLeftIsRemovedByTheNextWriter) {
  const test::TemporaryFolder folder;
  const auto path = folder / "out.txt";
  const pid_t child = fork();
  if (child == 0) {
    const OutputFile file(path);
    std::ofstream(file.part()) << "half";
    _exit(0);
  }
  waitpid(child, nullptr, 0);
  EXPECT_TRUE(test::has_half_written(folder.path()));
  test::write_file(folder / "out.txt.another-machine.1.00000000.part", "being written");
  const OutputFile living(path);
  std::ofstream(living.part()) << "being written";
  write_text(path, "whole");
  EXPECT_TRUE(std::filesystem::exists(living.part()));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 3)
      << "the file, and what a living process and another machine are writing";
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

/// A program that is not supervised, as the reader of volumes is run.
CommandEnd run_shell(const std::string& script, const Task& task = {}, double stall_limit = 0,
                     const std::function<void()>& watch = {}, int handed_over = -1) {
  return run_command({.program = "/bin/sh",
                      .words = {"sh", "-c", script},
                      .stall_limit = stall_limit,
                      .handed_over = handed_over,
                      .supervised = false,
                      .watch = watch},
                     task);
}

TEST(UnsupervisedCommand, TellsHowTheProgramEnded) {
  EXPECT_EQ(run_shell("exit 0").status, 0);
  EXPECT_EQ(run_shell("exit 7").status, 7);
  const CommandEnd killed = run_shell("kill -SEGV $$");
  EXPECT_EQ(killed.signal, SIGSEGV);
  EXPECT_EQ(killed.passed, CommandEnd::Limit::kNone);
  EXPECT_THROW(run_command({.program = "/no/such/program", .words = {"program"}, .supervised = false}, {}), InputError);
}

TEST(UnsupervisedCommand, EndsAProgramThatDoesNothing) {
  const CommandEnd end = run_shell("exec sleep 100000", {}, 0.2);
  EXPECT_EQ(end.passed, CommandEnd::Limit::kStall);
  EXPECT_EQ(end.signal, SIGKILL);
}

TEST(UnsupervisedCommand, EndsTheProgramWhenTheTaskIsCancelled) {
  std::atomic<bool> cancel{false};
  EXPECT_THROW(run_shell("while true; do :; done", {1, {}, &cancel}, 0, [&] { cancel = true; }), Interrupted);
}

TEST(MemoryFile, WhatAChildWritesIsMappedHere) {
  MemoryFile file;
  file.resize(3);
  EXPECT_EQ(run_shell("printf 'abcdef' >&3", {}, 0, {}, file.descriptor()).status, 0);
  file.update_size();
  ASSERT_EQ(file.size(), 6u);
  const Mapping mapping(file, 0, file.size(), /*writable=*/false);
  EXPECT_EQ(std::memcmp(mapping.data(), "abcdef", 6), 0);
}

TEST(GrowingArray, HoldsTheSameInAFileAsInMemory) {
  std::vector<float> values(3000000);
  std::iota(values.begin(), values.end(), 0.0f);
  MemoryFile file;
  file.append(std::as_bytes(std::span("first")));
  for (MemoryFile* where : {static_cast<MemoryFile*>(nullptr), &file}) {
    GrowingArray<float> growing(where);
    for (size_t at = 0; at < values.size(); at += 1000) growing.append({values.data() + at, 1000});
    const SharedArray<float> array = growing.finish();
    EXPECT_TRUE(std::equal(values.begin(), values.end(), array.begin(), array.end()));
    EXPECT_EQ(array.file_offset() == SharedArray<float>::kNoFile, where == nullptr);
  }
  // What another program finds: the values where their offset says, and no more than a page after them.
  const Mapping mapping(file, 0, file.size(), /*writable=*/false);
  EXPECT_EQ(std::memcmp(mapping.data() + 4096, values.data(), values.size() * sizeof(float)), 0);
  EXPECT_LE(file.size(), 4096 + values.size() * sizeof(float) + 4096);
}

TEST(TimeLeft, IsSilentUntilItCanTell) {
  EXPECT_EQ(time_left(0.001, 10), "");
  EXPECT_EQ(time_left(0.25, 30), "1 m 30 s");
  EXPECT_EQ(format_duration(7800), "2 h 10 m");
}

}  // namespace
}  // namespace brume
