// What goes to stdout, and whether it got there; what stderr says of it.

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <sstream>

#include "base/text.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using test::run_brume;

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// The verbs that --help lists.
std::vector<std::string> verbs() {
  const std::string help = run_brume("--help").out;
  std::istringstream lines(help.substr(help.find("Subcommands:")));
  std::vector<std::string> names;
  std::string line;
  for (std::getline(lines, line); std::getline(lines, line);)
    if (line.starts_with("  ") && line.size() > 2 && line[2] != ' ')
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
  return names;
}

/// Runs the program with a stdout of its own.
struct Printed {
  int status;
  std::string err;
};
Printed run_onto(const std::string& redirection, const std::string& arguments, const test::TemporaryFolder& folder) {
  const std::string err = (folder / "err").string();
  const int ended =
      std::system((std::string(BRUME_PROGRAM) + " " + arguments + " " + redirection + " 2>" + err).c_str());
  return {WIFEXITED(ended) ? WEXITSTATUS(ended) : 128 + WTERMSIG(ended), test::read_file(err)};
}

TEST(Output, OfEveryVerbThatDoesNotGetThereIsAnError) {
  const test::TemporaryFolder folder;
  const auto path = [&](const std::string& name) { return (folder / name).string(); };
  const std::string scene = test::source("data/scenes/smoke.toml").string(), part = path("part1.exr");
  const std::string render = "render " + scene + " -D film.width=16 -D film.height=12 --spp 2 -q -o ";
  for (const std::string half : {"1", "2"})
    ASSERT_EQ(run_brume(render + path("part" + half + ".exr") + " --part " + half + "/2").status, 0);
  const std::vector<std::pair<std::string, std::string>> commands = {
      {"info", "info " + part},
      {"generate", "generate cloud --resolution 16 -q -o " + path("cloud.vdb")},
      {"halve", "halve " + test::source("data/volumes/fire.vdb").string() + " -q -o " + path("half.vdb")},
      {"render", render + path("a.exr")},
      {"guides", "guides --like " + part + " --scene " + scene + " -q -o " + path("guides.exr")},
      {"merge", "merge " + part + " " + path("part2.exr") + " -q -o " + path("whole.exr")},
      {"submit", "submit commands " + scene + " --frames 1-2 -q -o " + path("shot")},
      {"denoise", "denoise " + part + " -f gaussian -q -o " + path("clean.exr")},
      {"compare", "compare " + part + " " + path("part2.exr") + " --json -q"},
      {"evaluate", "evaluate " + scene +
                       " --size 12 --spp 2 --seeds 1 --reference-spp 2 -f gaussian --no-tuning -q -o " +
                       path("results")},
      {"filters", "filters"},
      {"docs", "docs scene"},
      {"view", "view " + scene + " -q"},
      {"flatten", "flatten " + path("deep.exr") + " -o " + path("flat.exr")},
      {"matte", "matte " + path("grouped.exr") + " smoke --layer CryptoObject -o " + path("matte.exr")},
      {"mix", "mix " + path("grouped.exr") + " --gain sun=2 -o " + path("mixed.exr")},
      {"picture", "picture " + part + " -q -o " + path("a.png")},
  };
  ASSERT_EQ(run_brume(render + path("grouped.exr") + " -D render.light_groups=true --layers cryptomatte --deep " +
                      path("deep.exr"))
                .status,
            0);
  std::vector<std::string> tested;
  for (const auto& [verb, arguments] : commands) tested.push_back(verb);
  std::vector<std::string> known = verbs();
  std::sort(known.begin(), known.end());
  std::sort(tested.begin(), tested.end());
  ASSERT_EQ(tested, known);

  int pipe_ends[2];  // whose reader has left
  ASSERT_EQ(pipe(pipe_ends), 0);
  close(pipe_ends[0]);
  const std::string closed_pipe = ">&" + std::to_string(pipe_ends[1]);
  std::vector<std::string> all = {"--help", "--version", "render --help"};
  for (const auto& [verb, arguments] : commands) all.push_back(arguments);
  for (const std::string& arguments : all) {
    for (const auto& [redirection, reason] : {std::pair<std::string, std::string>(">/dev/full", "No space left"),
                                              {">&-", "Bad file descriptor"},
                                              {closed_pipe, "Broken pipe"}}) {
      const Printed r = run_onto(redirection, arguments, folder);
      EXPECT_EQ(r.status, 2) << arguments << " " << redirection;
      EXPECT_TRUE(holds(r.err, "brume: stdout cannot be written: " + reason)) << arguments << " " << redirection << "\n"
                                                                              << r.err;
      std::filesystem::remove_all(folder / "shot");  // submit adds rounds to a shot that is there
    }
    if (arguments.starts_with("view ")) continue;  // which serves until Ctrl-C
    const Printed r = run_onto(">/dev/null", arguments, folder);
    EXPECT_EQ(r.status, 0) << arguments << "\n" << r.err;
    std::filesystem::remove_all(folder / "shot");
  }
  close(pipe_ends[1]);
}

TEST(Output, ViewPrintsItsAddressAndEndsWithCtrlC) {
  test::RunningProgram view("view " + test::source("data/scenes/smoke.toml").string());
  ASSERT_TRUE(view.wait_until([&] { return holds(view.err(), "Ctrl-C ends it"); }));
  view.send(SIGINT);
  const test::ProgramResult ended = view.finish();
  EXPECT_EQ(ended.status, 0) << ended.err;
  EXPECT_TRUE(ended.out.starts_with("http://127.0.0.1:")) << ended.out;
  for (const auto& [words, expected] : {std::pair("view missing.vdb", "missing.vdb: no such file"),
                                        {"view missing.vdb --host nowhere", "missing.vdb: no such file"}}) {
    const test::ProgramResult r = run_brume(words);
    EXPECT_EQ(r.status, 2);
    EXPECT_TRUE(holds(r.err, expected)) << r.err;
  }
  const test::ProgramResult r =
      run_brume("view " + test::source("data/scenes/smoke.toml").string() + " --host nowhere");
  EXPECT_EQ(r.status, 2);
  EXPECT_TRUE(holds(r.err, "--host nowhere: is no address")) << r.err;
}

TEST(Output, AnUnknownOptionNamesOneThatBeginsSo) {
  // "    'compare') words='--json --max ...' ;;" of every verb, from the completions.
  std::istringstream lines(run_brume("docs bash").out);
  int tried = 0;
  for (std::string line; std::getline(lines, line);) {
    const size_t words = line.find(") words='-h");
    if (words == std::string::npos) continue;
    const std::string verb = line.substr(line.find_first_not_of(' '), words - line.find_first_not_of(' '));
    if (std::find(verb.begin(), verb.end(), ' ') != verb.end()) continue;
    const std::vector<std::string> options = split(line.substr(words + 9, line.rfind('\'') - words - 9), ' ');
    for (const std::string& option : options) {
      if (!option.starts_with("--") || option.size() < 6) continue;
      const std::string begun = option.substr(0, std::max<size_t>(5, option.size() / 2));
      if (std::find(options.begin(), options.end(), begun) != options.end()) continue;
      const std::string err = run_brume(verb + " x y " + begun).err;
      const size_t meant = err.find("did you mean '" + begun);
      EXPECT_NE(meant, std::string::npos) << verb << " " << begun << ": " << err;
      ++tried;
    }
  }
  EXPECT_GT(tried, 100);
  EXPECT_TRUE(holds(run_brume("compare a b --second=c").err, "did you mean '--second-reference'?"));
  EXPECT_TRUE(holds(run_brume("denoise a -f nl_means --quie").err, "did you mean '--quiet'?"));
}

TEST(Output, AnOptionOfOtherProgramsNamesOurs) {
  for (const auto& [words, expected] : {std::pair("render a.vdb --samples 4", "did you mean '--spp'?"),
                                        {"render a.vdb --resolution=64x48", "did you mean '--size'?"},
                                        {"render a.vdb --denoise", "did you mean '--clean'?"},
                                        {"submit slurm a.toml --width 64", "did you mean '--size'?"},
                                        {"render a.vdb --size 64", "--size 64: expected WIDTHxHEIGHT"},
                                        {"render a.vdb --size 4294967297x1", "expected WIDTHxHEIGHT"},
                                        {"render a.vdb --size 64x48px", "--size 64x48px: expected WIDTHxHEIGHT"}}) {
    const test::ProgramResult r = run_brume(words);
    EXPECT_EQ(r.status, 2) << words;
    EXPECT_TRUE(holds(r.err, expected)) << r.err;
  }
}

TEST(Output, FiltersAreATableAndEachHasItsDetails) {
  const std::string table = run_brume("filters").out, details = run_brume("filters --all").out;
  std::istringstream names(run_brume("filters --json").out);
  int filters = 0;
  for (std::string line; std::getline(names, line);) {
    const std::string key = "      \"name\": \"";
    if (!line.starts_with(key)) continue;
    const std::string name = line.substr(key.size(), line.rfind('"') - key.size());
    EXPECT_TRUE(holds(table, "\n" + name + " ")) << name;
    EXPECT_TRUE(holds("\n" + details, "\n" + name + "\n")) << name;
    ++filters;
  }
  EXPECT_EQ(filters, 22);
  EXPECT_LE(std::count(table.begin(), table.end(), '\n'), filters + 3);
  EXPECT_TRUE(holds(run_brume("filters bilateral").out, "--sigma-range"));
}

TEST(Output, DocsAloneListsItsPages) {
  const auto list = run_brume("docs");
  EXPECT_EQ(list.status, 0);
  for (const char* page : {"scene", "experiment", "filters", "man", "bash", "zsh", "fish"})
    EXPECT_TRUE(holds(list.out, "brume docs " + std::string(page))) << list.out;
}

TEST(Output, FramesOfOtherScenesAreComparedWithANote) {
  const test::TemporaryFolder folder;
  const auto path = [&](const std::string& name) { return (folder / name).string(); };
  for (const std::string scene : {"smoke", "cloud"})
    ASSERT_EQ(run_brume("render " + test::source("data/scenes/" + scene + ".toml").string() +
                        " -D film.width=16 -D film.height=12 --spp 2 -q -o " + path(scene + ".0001.exr"))
                  .status,
              0);
  ASSERT_EQ(run_brume("render " + test::source("data/scenes/smoke.toml").string() +
                      " -D film.width=16 -D film.height=12 -D camera.fov=20 --spp 2 -q -o " + path("near.0001.exr"))
                .status,
            0);
  const auto compared = [&](const std::string& arguments) { return run_brume("compare " + arguments).err; };
  EXPECT_TRUE(holds(compared(path("smoke.0001.exr") + " " + path("cloud.0001.exr")),
                    "were rendered from scenes that differ: smoke and cloud"));
  EXPECT_TRUE(holds(compared(path("smoke.0001.exr") + " " + path("near.0001.exr")),
                    "camera.fov is 26.5 in the one, 20 in the other"));
  EXPECT_TRUE(
      holds(compared(path("smoke.####.exr") + " " + path("cloud.####.exr") + " --frames 1"), "smoke and cloud"));
  EXPECT_TRUE(holds(
      compared(path("smoke.0001.exr") + " " + path("smoke.0001.exr") + " --second-reference " + path("cloud.0001.exr")),
      "cloud and smoke"));
  EXPECT_EQ(compared(path("smoke.0001.exr") + " " + path("smoke.0001.exr")), "");
}

}  // namespace
}  // namespace brume
