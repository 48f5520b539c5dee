// Programs of others: their words, how they end, what they may take, and that nothing of them is left.

#include "base/command.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <functional>
#include <thread>

#include "base/error.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using test::error_of;
namespace fs = std::filesystem;
using Words = std::vector<std::string>;

Command shell(const std::string& script) {
  Command command;
  command.program = find_program("sh");
  command.words = {"sh", "-c", script};
  return command;
}

/// A process that has ended; one that nobody has collected yet counts too.
bool is_over(const std::string& process) {
  std::ifstream file("/proc/" + process + "/stat");
  std::string text;
  std::getline(file, text);
  return text.empty() || text.find(") Z ") != std::string::npos;
}

bool is_over_in_the_end(const std::string& process) {
  while (!is_over(process)) usleep(1000);  // killed processes do not live on, and a test that hangs is found
  return true;
}

bool has_text(const fs::path& file) {
  return test::read_file(file).ends_with("\n");
}

std::string first_line(const fs::path& file) {
  const std::string text = test::read_file(file);
  return text.substr(0, text.find('\n'));
}

TEST(CommandWords, ArePartedAsAShellDoes) {
  EXPECT_EQ(parse_words("a  bc\td\n"), (Words{"a", "bc", "d"}));
  EXPECT_EQ(parse_words(R"(one 'two words' "three \"more\" words" four\ words)"),
            (Words{"one", "two words", "three \"more\" words", "four words"}));
  EXPECT_EQ(parse_words(R"(--name='a b'c "" '' 'it'"'"'s')"), (Words{"--name=a bc", "", "", "it's"}));
  EXPECT_EQ(parse_words(R"('$HOME | *' "a\b" back\\slash)"), (Words{"$HOME | *", "a\\b", "back\\slash"}));
  EXPECT_EQ(parse_words("{frame} a~b #x"), (Words{"{frame}", "a~b", "#x"}));
  EXPECT_TRUE(parse_words(" ").empty());
}

TEST(CommandWords, WhatAShellWouldDoIsRefused) {
  for (const char* line : {"a | b", "a > b", "a < b", "a & b", "a; b", "$HOME/a", "`a`", "a *.exr", "~/a", "a ?"})
    EXPECT_NE(error_of([&] { parse_words(line); }).find("would be for a shell"), std::string::npos) << line;
  EXPECT_EQ(error_of([] { parse_words("a 'b c"); }), "the quote ' at character 3 of the command has no end");
  EXPECT_NE(error_of([] { parse_words("a \\"); }).find("a backslash ends the command"), std::string::npos);
}

TEST(CommandProgram, IsFoundInPathOrBesideTheFolder) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "mine", "#!/bin/sh\n");
  EXPECT_TRUE(find_program("./mine", folder.path()).empty()) << "it may not be run";
  fs::permissions(folder / "mine", fs::perms::owner_all);
  EXPECT_EQ(find_program("./mine", folder.path()).lexically_normal(), folder / "mine");
  EXPECT_TRUE(find_program("mine", folder.path()).empty()) << "not in PATH";
  EXPECT_TRUE(find_program("sh").is_absolute());
  EXPECT_TRUE(find_program("").empty());
  EXPECT_TRUE(find_program(folder.path().string()).empty()) << "a folder";
}

TEST(CommandRun, TellsHowItEndedAndWhatItSaidLast) {
  const CommandEnd good = run_command(shell("exit 0"), {});
  EXPECT_TRUE(good.good());
  EXPECT_GT(good.seconds, 0);
  const CommandEnd bad = run_command(shell("echo on stdout; seq 100 >&2; exit 7"), {});
  EXPECT_FALSE(bad.good());
  EXPECT_EQ(bad.status, 7);
  EXPECT_EQ(bad.said, "95\n96\n97\n98\n99\n100");
  EXPECT_EQ(run_command(shell("printf '\\033[1mbold\\033[0m\\r10 %%\\r20 %%\\n\\n'; exit 1"), {}).said,
            "bold\n10 %\n20 %")
      << "stdout where stderr is empty, without a terminal's codes";
  EXPECT_EQ(run_command(shell("kill -SEGV $$"), {}).signal, SIGSEGV);
  EXPECT_EQ(run_command(shell("yes | head -c 100000000 >&2; echo end >&2"), {}).said.substr(10), "end")
      << "much is taken, its end is kept";
}

TEST(CommandRun, HasNoInputItsOwnFolderAndEnvironment) {
  const test::TemporaryFolder folder;
  setenv("BRUME_TEST_KEPT", "kept", 1);
  setenv("BRUME_TEST_OTHER", "ours", 1);
  Command command = shell("cat; echo $BRUME_TEST_KEPT $BRUME_TEST_OTHER >here; exit 0");
  command.folder = folder.path();
  command.environment["BRUME_TEST_OTHER"] = "theirs";
  EXPECT_TRUE(run_command(command, {}).good());
  EXPECT_EQ(test::read_file(folder / "here"), "kept theirs\n");
}

TEST(CommandRun, WhatCannotBeStartedIsAnError) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "no_program", "no program");
  fs::permissions(folder / "no_program", fs::perms::owner_all);
  Command command;
  command.program = folder / "no_program";
  command.words = {"./no_program"};
  EXPECT_EQ(error_of([&] { run_command(command, {}); }), "./no_program: cannot be started: Exec format error");
  command = shell("exit 0");
  command.folder = folder / "nowhere";
  EXPECT_EQ(error_of([&] { run_command(command, {}); }), "sh: cannot be started: No such file or directory");
}

TEST(CommandRun, EndsWhereItsTimeIsUp) {
  Command command = shell("echo waiting >&2; sleep 1000");
  command.time_limit = 0.2;
  const CommandEnd end = run_command(command, {});
  EXPECT_EQ(end.passed, CommandEnd::Limit::kTime);
  EXPECT_FALSE(end.good());
  EXPECT_GT(end.seconds, 0.2);
}

TEST(CommandRun, EndsWhereItHoldsTooMuch) {
  // dd holds a block, in a child of the shell.
  const auto holding = [](const std::string& megabytes) {
    return shell("dd if=/dev/zero of=/dev/null bs=" + megabytes + "M count=1000000 & wait");
  };
  Command command = holding("300");
  command.memory_limit = 100e6;
  const CommandEnd end = run_command(command, {});
  EXPECT_EQ(end.passed, CommandEnd::Limit::kMemory);
  EXPECT_GT(end.peak_bytes, 100e6);
  EXPECT_LT(end.peak_bytes, 400e6);
  // Not where each of two holds little enough, but both together.
  command = shell("for i in 1 2; do dd if=/dev/zero of=/dev/null bs=80M count=1000000 & done; wait");
  command.memory_limit = 120e6;
  EXPECT_EQ(run_command(command, {}).passed, CommandEnd::Limit::kMemory);
}

TEST(CommandRun, TellsItsPeakOfMemory) {
  const test::TemporaryFolder folder;
  // Nobody takes the block before it is there, and for half a second more.
  Command command = shell(
      "sh -c 'echo $$ >writer; exec dd if=/dev/zero bs=200M count=1' | sh -c '\n"
      "until grep -q \"VmRSS:.*2[0-9][0-9][0-9][0-9][0-9] kB\" /proc/$(cat writer)/status; do sleep 0.01; done\n"
      "sleep 0.5; cat >here'");
  command.folder = folder.path();
  const double peak = run_command(command, {}).peak_bytes;
  EXPECT_GT(peak, 200e6);
  EXPECT_LT(peak, 300e6);
}

TEST(CommandRun, NothingThatItStartedOutlivesIt) {
  const test::TemporaryFolder folder;
  Command command = shell(
      "sh -c 'echo $$ >child; exec sleep 1000' &\n"
      "while [ ! -s child ]; do sleep 0.01; done\n"
      "[ -z \"$STAY\" ] || { setsid sh -c 'echo $$ >session; exec sleep 1000' & sleep 1000; }");
  command.folder = folder.path();
  // Cancelled once both are there.
  command.environment["STAY"] = "yes";
  std::atomic<bool> cancel{false};
  std::thread user([&] {
    while (!has_text(folder / "child") || !has_text(folder / "session")) usleep(1000);
    cancel = true;
  });
  EXPECT_THROW(run_command(command, {1, {}, &cancel}), Interrupted);
  user.join();
  for (const char* name : {"child", "session"}) EXPECT_TRUE(is_over_in_the_end(first_line(folder / name))) << name;
  // At its own end.
  fs::remove(folder / "child");
  command.environment["STAY"] = "";
  EXPECT_TRUE(run_command(command, {}).good());
  EXPECT_TRUE(is_over_in_the_end(first_line(folder / "child")));
}

TEST(CommandRun, DaemonsThatItLeftBehindDoNotOutliveIt) {
  const test::TemporaryFolder folder;
  // In a session of its own, its parent gone at once, before anyone looks.
  Command command = shell(
      "(setsid sh -c 'echo $$ >daemon; exec sleep 1000' &)\n"
      "while [ ! -s daemon ]; do sleep 0.01; done");
  command.folder = folder.path();
  EXPECT_TRUE(run_command(command, {}).good());
  EXPECT_TRUE(is_over_in_the_end(first_line(folder / "daemon")));
}

TEST(CommandRun, LongLinesAreCutBetweenCharacters) {
  const std::string said = run_command(shell("printf 'x' >&2; yes ä | head -1000 | tr -d '\\n' >&2; exit 1"), {}).said;
  EXPECT_EQ(said.size(), 299u + 3) << said;
  EXPECT_EQ(said.substr(297), "ä...");
}

TEST(CommandRun, DiesWithThoseWhoRunIt) {
  const test::TemporaryFolder folder;
  Command command = shell("echo $$ >process; exec sleep 1000");
  command.folder = folder.path();
  const pid_t parent = fork();
  if (parent == 0) {
    run_command(command, {});
    _exit(0);
  }
  while (!has_text(folder / "process")) usleep(1000);
  kill(parent, SIGKILL);
  EXPECT_TRUE(is_over_in_the_end(first_line(folder / "process")));
}

}  // namespace
}  // namespace brume
