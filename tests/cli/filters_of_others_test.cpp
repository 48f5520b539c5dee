// brume evaluate with filters that are not brume's: commands of an experiment.

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "image/exr_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::run_brume;

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

class FiltersOfOthers : public testing::Test {
 protected:
  FiltersOfOthers() {
    fs::copy_file(test::source("data/volumes/cloud.vdb"), folder_ / "cloud.vdb");
    std::string scene = test::read_file(test::source("data/scenes/cloud.toml"));
    scene.replace(scene.find("../volumes/"), 11, "");
    test::write_file(folder_ / "cloud.toml", scene);
    setenv("PATH", (BRUME_STAND_INS ":" + path_).c_str(), 1);
  }
  ~FiltersOfOthers() override { setenv("PATH", path_.c_str(), 1); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  /// An experiment on small frames of the cloud.
  void write_experiment(const std::string& filters, const std::string& keys = "spp = [2]\nseeds = 2\n",
                        const std::string& name = "small.toml") const {
    test::write_file(folder_ / name,
                     "scenes = [\"cloud.toml\"]\nsize = 20\nreference_spp = 8\ncomponent = \"all\"\n"
                     "search = false\n" +
                         keys + filters);
  }
  std::string command(const std::string& more = "") const {
    return "evaluate " + path("small.toml") + " --threads 2 --cache " + path("cache") + " -o " + path("out") + " " +
           more;
  }
  json results() const { return json::parse(test::read_file(folder_ / "out/results.json")); }
  std::string refused(const std::string& filters) const {
    write_experiment(filters, "", "wrong.toml");
    const auto r = run_brume("evaluate " + path("wrong.toml") + " -o " + path("wrong"));
    EXPECT_EQ(r.status, 2) << filters;
    EXPECT_FALSE(fs::exists(folder_ / "wrong"));
    return r.err;
  }
  test::TemporaryFolder folder_;

 private:
  std::string path_ = getenv("PATH");
};

TEST_F(FiltersOfOthers, OpenImageDenoiseByItsCommandLineStandsBesideTheOthers) {
  // The example as it is, on small frames; a stand-in reads oidnDenoise's words and files.
  const auto r = run_brume("evaluate " + test::source("data/experiments/oidn.toml").string() +
                           " --size 24 --spp 4 --seeds 2 --reference-spp 16 --threads 2 -o " + path("out"));
  ASSERT_EQ(r.status, 0) << r.err;
  std::map<std::string, double> error, seconds;
  const json all = results();
  for (const json& row : all["rows"]) {
    EXPECT_FALSE(row.contains("failed")) << row;
    if (row["scene"] != "cloud" || row["region"] != "frame") continue;
    error[row["method"]] = row["metrics"]["lab_rms"]["mean"];
    seconds[row["method"]] = row["seconds"]["filter"];
    EXPECT_EQ(row["seconds"].contains("exchange"), row["method"] == "Open_Image_Denoise_default");
  }
  ASSERT_TRUE(error.contains("Open_Image_Denoise_default"));
  EXPECT_LT(error["Open_Image_Denoise_default"], 0.8 * error["noisy"]) << "it has cleaned, and nothing is upside down";
  EXPECT_GT(seconds["Open_Image_Denoise_default"], 0);
  EXPECT_TRUE(holds(r.out,
                    "Open Image Denoise is `oidnDenoise --hdr {color.pfm} --alb {albedo.pfm} --nrm {normal.pfm} "
                    "-o {output.pfm} --threads {threads}`"))
      << r.out;
  // In every table, on the page, in a plot and with a picture.
  const std::string table = test::read_file(folder_ / "out/table.md"),
                    page = test::read_file(folder_ / "out/index.html");
  for (const char* heading : {"## cloud, every filter", "## Which filter wins", "## Parameters"}) {
    const std::string part =
        table.substr(table.find(heading), table.find("\n## ", table.find(heading) + 1) - table.find(heading));
    EXPECT_TRUE(holds(part, "Open Image Denoise")) << part;
  }
  EXPECT_TRUE(holds(page, "\"Open_Image_Denoise_default\""));
  EXPECT_TRUE(holds(test::read_file(folder_ / "out/table.csv"), "Open Image Denoise,default"));
  EXPECT_TRUE(holds(test::read_file(folder_ / "out/cloud_error_seconds.svg"), "Open Image Denoise"));
  const Layers picture = read_exr(folder_ / "out/cloud_4spp_Open_Image_Denoise_default.exr");
  EXPECT_EQ(picture.text("filter"), "command");
  EXPECT_TRUE(holds(picture.text("filterParameters"), "oidnDenoise --hdr"));
  for (const auto& [name, value] : picture.header) EXPECT_FALSE(name.starts_with("evaluationS")) << name;
}

TEST_F(FiltersOfOthers, ItsWordsAreToldWhenItFails) {
  write_experiment(
      "[[filters]]\ncommand = \"oidnDenoise --hdr {color.pfm} --albdo {albedo.pfm} -o {output.pfm}\"\n"
      "[[filters]]\nfilter = \"gaussian\"\n");
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(
      r.out, "oidnDenoise  default  seed 1: ended with exit status 1; its last words: Error: invalid argument 'albdo'"))
      << r.out;
  for (const json& row : results()["rows"]) EXPECT_EQ(row.contains("failed"), row["method"] == "oidnDenoise_default");
  EXPECT_TRUE(holds(test::read_file(folder_ / "out/table.md"), "Error: invalid argument 'albdo'"));
}

TEST_F(FiltersOfOthers, OnlyWhatChangedIsRunAgain) {
  test::write_file(folder_ / "mine.sh", "cp $1 $2\n");
  test::write_file(folder_ / "model", "1");
  const std::string filters =
      "[[filters]]\ncommand = \"sh mine.sh {color.pfm} {output.pfm}\"\ndepends = [\"model\"]\n"
      "[[filters]]\nfilter = \"gaussian\"\n";
  write_experiment(filters);
  ASSERT_EQ(run_brume(command()).status, 0);
  const json before = results();
  EXPECT_TRUE(holds(run_brume(command()).err, "0 frames rendered, 0 results filtered"));
  EXPECT_EQ(results(), before) << "times and memory too";
  test::write_file(folder_ / "mine.sh", "cp $1 $2 # another\n");
  EXPECT_TRUE(holds(run_brume(command()).err, "0 frames rendered, 2 results filtered"));
  test::write_file(folder_ / "model", "2");
  EXPECT_TRUE(holds(run_brume(command()).err, "0 frames rendered, 2 results filtered"));
  // A failure is tried again, one of time is not: it would take as long.
  test::write_file(folder_ / "mine.sh", "exit 1\n");
  EXPECT_TRUE(holds(run_brume(command()).err, "1 results filtered"));
  EXPECT_TRUE(holds(run_brume(command()).err, "1 results filtered"));
  test::write_file(folder_ / "mine.sh", "sleep 1000\n");
  write_experiment("[[filters]]\ncommand = \"sh mine.sh {color.pfm} {output.pfm}\"\ntime_limit = 0.1\n");
  EXPECT_TRUE(holds(run_brume(command()).out, "took longer than 0.1 s and was ended"));
  EXPECT_TRUE(holds(run_brume(command()).err, "0 results filtered"));
}

TEST_F(FiltersOfOthers, LimitsOfMemoryAreInGigabytes) {
  test::write_file(folder_ / "mine.sh", "dd if=/dev/zero of=/dev/null bs=300M count=1000000\n");
  write_experiment("[[filters]]\ncommand = \"sh mine.sh {frame} {output}\"\nmemory_limit = 0.1\n");
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.out, "more than the 0.1 GB that it may, and was ended")) << r.out;
}

TEST_F(FiltersOfOthers, InSequencesEveryFrameIsCleanedByItself) {
  test::write_file(folder_ / "mine.sh", "echo $3 >>seeds; cp $1 $2\n");
  write_experiment(
      "[[filters]]\ncommand = \"sh mine.sh {color.pfm} {output.pfm} {seed}\"\nlabel = \"copy\"\n"
      "[[sequences]]\nfile = \"cloud.toml\"\nname = \"shot\"\nframes = \"1-3\"\n",
      "spp = [2]\nseeds = 1\n");
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  const json all = results();
  std::map<std::string, json> rows;
  for (const json& row : all["sequences"][0]["rows"])
    if (row["region"] == "frame") rows[row["label"]] = row;
  EXPECT_EQ(rows["copy"]["lab_rms"], rows["path tracing"]["lab_rms"]);
  EXPECT_EQ(rows["copy"]["reach"], 0);
  const std::string seeds = test::read_file(folder_ / "seeds");
  EXPECT_TRUE(holds(seeds, "1\n") && holds(seeds, "3000001\n") && holds(seeds, "3002001\n")) << seeds;
}

TEST_F(FiltersOfOthers, WhatIsWrongIsUnderlinedInTheFile) {
  const auto expect = [&](const std::string& filters, const std::string& what, const std::string& line) {
    const std::string error = refused(filters);
    EXPECT_TRUE(holds(error, what)) << error;
    EXPECT_TRUE(holds(error, line) && (holds(error, "~~") || holds(error, "^^"))) << error;
  };
  const std::string good = "command = \"cp {frame} {output}\"\n";
  expect("[[filters]]\nlabel = \"mine\"\n", "[[filters]] has neither 'filter' nor 'command'", "[[filters]]");
  expect("[[filters]]\nfilter = \"bilateral\"\n" + good, "[[filters]] has both 'filter' and 'command'",
         good.substr(0, 20));
  expect("[[filters]]\n" + good + "parameters = \"radius=3\"\n",
         "'parameters' of [[filters]] is for brume's own filters", "parameters = ");
  expect("[[filters]]\n" + good + "guides = true\n", "'guides' of [[filters]] is for brume's own filters",
         "guides = true");
  expect("[[filters]]\nfilter = \"bilateral\"\nlayers = [\"albedo\"]\n", "'layers' of [[filters]] is for commands",
         "layers = ");
  expect("[[filters]]\ncommand = \"no_such_program {frame} {output}\"\n",
         "no program 'no_such_program' in the folders of PATH", "command = \"no_such_program");
  expect("[[filters]]\ncommand = \"sh mine.sh {frame} {output}\"\n", "mine.sh: no such file", "command = \"sh");
  expect("[[filters]]\ncommand = \"cp {farme} {output}\"\n", "did you mean '{frame}'?", "command = \"cp");
  expect("[[filters]]\n" + good + "layers = [\"albdeo\"]\n", "no layer 'albdeo' for layers; did you mean 'albedo'?",
         "layers = ");
  expect("[[filters]]\n" + good + "depends = [\"weights.bin\"]\n", "weights.bin: no such file", "depends = ");
  expect("[[filters]]\n" + good + "label = \"bilateral\"\n",
         "the command is labelled 'bilateral', which is a filter of brume's", "label = ");
  expect("[[filters]]\n" + good + "memory_limit = -1\n", "'memory_limit' is out of range", "memory_limit = ");
  EXPECT_TRUE(holds(refused("[[filters]]\n" + good + "[[filters]]\n" + good), "two filters are called 'cp'"));
}

TEST_F(FiltersOfOthers, ARunThatIsKilledTakesThemWithItAndTheNextCleansUp) {
  const test::TemporaryFolder scratch;
  setenv("TMPDIR", scratch.path().c_str(), 1);
  test::write_file(folder_ / "mine.sh", "[ -e go_on ] || { echo $$ >process; exec sleep 1000; }\ncp $1 $2\n");
  write_experiment("[[filters]]\ncommand = \"sh mine.sh {frame} {output}\"\n");
  {
    test::RunningProgram program(command());
    ASSERT_TRUE(program.wait_until([&] { return holds(test::read_file(folder_ / "process"), "\n"); }));
    program.send(SIGKILL);
    program.finish();
  }
  const std::string process = test::read_file(folder_ / "process");
  const fs::path stat = "/proc/" + process.substr(0, process.find('\n')) + "/stat";
  while (fs::exists(stat) && !holds(test::read_file(stat), ") Z ")) usleep(1000);
  EXPECT_FALSE(fs::is_empty(scratch.path())) << "nobody was left to remove it";
  test::write_file(folder_ / "go_on", "");
  const auto r = run_brume(command());
  unsetenv("TMPDIR");
  ASSERT_EQ(r.status, 0) << r.err;
  size_t left = 0;
  for (const auto& entry : fs::directory_iterator(scratch.path()))
    left += entry.path().filename().string().starts_with("brume-scratch.");
  EXPECT_EQ(left, 0u);
}

TEST_F(FiltersOfOthers, ARunThatIsInterruptedEndsThem) {
  test::write_file(folder_ / "mine.sh", "echo $$ >process; exec sleep 1000\n");
  write_experiment("[[filters]]\ncommand = \"sh mine.sh {frame} {output}\"\n");
  test::RunningProgram program(command());
  ASSERT_TRUE(program.wait_until([&] { return holds(test::read_file(folder_ / "process"), "\n"); }));
  program.send(SIGINT);
  EXPECT_EQ(program.finish().status, 3);
  const std::string process = test::read_file(folder_ / "process");
  EXPECT_FALSE(fs::exists("/proc/" + process.substr(0, process.find('\n')) + "/stat"));
}

TEST(FilterReference, IsInStepWithTheCode) {
  EXPECT_EQ(test::read_file(test::source("docs/filters.md")), run_brume("docs filters").out)
      << "run: brume docs filters > docs/filters.md";
}

}  // namespace
}  // namespace brume
