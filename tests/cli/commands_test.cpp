// Every verb, as a person types it.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "image/exr_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using nlohmann::json;
using test::run_brume;

const std::string kScene = test::source("data/scenes/smoke.toml").string();
const std::string kSmall = " -D film.width=32 -D film.height=24 --spp 4 -q";

TEST(Commands, HelpAndVersion) {
  EXPECT_EQ(run_brume("--help").status, 0);
  EXPECT_TRUE(run_brume("--version").out.starts_with("brume 0."));
  for (const char* verb :
       {"info", "generate", "halve", "render", "denoise", "compare", "evaluate", "filters", "docs"}) {
    const auto r = run_brume(std::string(verb) + " --help");
    EXPECT_EQ(r.status, 0) << verb;
    EXPECT_NE(r.out.find("--threads"), std::string::npos) << verb;
  }
  EXPECT_NE(run_brume("denoise --help").out.find("--sigma-gradient"), std::string::npos)
      << "the filters' parameters are in the help";
}

TEST(Commands, InfoOfAVolume) {
  const auto text = run_brume("info " + test::source("data/volumes/cloud.vdb").string());
  EXPECT_EQ(text.status, 0);
  EXPECT_NE(text.out.find("692003 voxels"), std::string::npos);
  const json j = json::parse(run_brume("info --json " + test::source("data/volumes/smoke.vdb").string()).out);
  EXPECT_EQ(j["grids"][0]["name"], "density_noise");
  EXPECT_EQ(j["grids"][0]["half"], true);
  EXPECT_EQ(j["grids"][1]["active_voxels"], 0);
}

TEST(Commands, RenderDenoiseCompareGoTogether) {
  const test::TemporaryFolder folder;
  const std::string frame = (folder / "frame.exr").string(), clean = (folder / "clean.exr").string(),
                    other = (folder / "other.exr").string();
  const auto render =
      run_brume("render " + kScene + kSmall + " -o " + frame + " --png " + (folder / "frame.png").string());
  ASSERT_EQ(render.status, 0) << render.err;
  EXPECT_EQ(render.out, frame + "\n") << "results go to stdout";
  EXPECT_EQ(render.err, "") << "--quiet";
  ASSERT_EQ(run_brume("render " + kScene + kSmall + " --seed 9 --threads 1 -o " + other).status, 0);

  const ExrInfo info = read_exr_info(frame);
  EXPECT_EQ(info.width, 32);
  for (const char* key : {"software", "version", "commit", "scene", "sceneHash", "seed", "samplesPerPixel",
                          "renderTimeSeconds", "cpuSeconds", "worldToCamera", "worldToNDC", "estimators", "biased",
                          "invalidSampleCount", "varianceConvention", "exposure"})
    EXPECT_TRUE(info.header.contains(key)) << key;

  const auto denoise = run_brume("denoise " + frame + " -f gradient_kernel --sigma-range 15 -o " + clean);
  ASSERT_EQ(denoise.status, 0) << denoise.err;
  EXPECT_NE(read_exr(clean).text("filterParameters").find("sigma-range=15"), std::string::npos);

  const auto compare = run_brume("compare --json " + clean + " " + other);
  ASSERT_EQ(compare.status, 0) << compare.err;
  const json j = json::parse(compare.out);
  EXPECT_GT(j["metrics"]["lab_rms"].get<double>(), 0.0);
  EXPECT_GT(j["medium"]["lab_rms"].get<double>(), j["metrics"]["lab_rms"].get<double>());
  EXPECT_EQ(run_brume("compare " + frame + " " + frame + " --max lab_rms=0").status, 0);
  const auto failed = run_brume("compare " + frame + " " + other + " --max lab_rms=1e-6");
  EXPECT_EQ(failed.status, 1) << "a stated threshold failed";
  EXPECT_NE(failed.err.find("lab_rms is"), std::string::npos);
}

TEST(Commands, SeveralFiltersWriteSeveralFiles) {
  const test::TemporaryFolder folder;
  const std::string frame = (folder / "frame.exr").string();
  ASSERT_EQ(run_brume("render " + kScene + kSmall + " --layers direct,indirect -o " + frame).status, 0);
  const auto r =
      run_brume("denoise " + frame + " -q -f bilateral:sigma-range=5 -f gaussian -o " + (folder / "out.exr").string());
  EXPECT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(std::filesystem::exists(folder / "out.bilateral.exr"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out.gaussian.exr"));
  const auto twice =
      run_brume("denoise " + frame + " -q -f gaussian:sigma=1 -f gaussian:sigma=2 -o " + (folder / "t.exr").string());
  EXPECT_EQ(twice.status, 0) << twice.err;
  EXPECT_NE(read_exr(folder / "t.gaussian.exr").text("filterParameters"),
            read_exr(folder / "t.gaussian.2.exr").text("filterParameters"));
}

TEST(Commands, FramesOfOtherRenderersAreCleaned) {
  const auto cycles = test::shared("references/cycles/smoke/smoke_400_spp0016.exr");
  if (cycles.empty()) GTEST_SKIP() << "no reference frames beside the project";
  const test::TemporaryFolder folder;
  const std::string clean = (folder / "clean.exr").string(),
                    reference = test::shared("references/cycles/smoke/smoke_400_ref_1.exr").string(),
                    second = test::shared("references/cycles/smoke/smoke_400_ref_3.exr").string();
  ASSERT_EQ(run_brume("denoise " + cycles.string() + " -q -f gaussian:sigma=0.8 -o " + clean).status, 0);
  const auto error = [&](const std::string& picture) {
    return json::parse(run_brume("compare --json " + picture + " " + reference + " --second-reference " + second)
                           .out)["metrics"]["lab_rms"]
        .get<double>();
  };
  // Measured elsewhere: 1.73 for the noisy frame, the reference's own noise taken off.
  EXPECT_NEAR(error(cycles.string()), 1.73, 0.02);
  EXPECT_LT(error(clean), 0.75 * error(cycles.string()));
}

TEST(Commands, GenerateInfoHalve) {
  const test::TemporaryFolder folder;
  for (const char* kind : {"cloud", "smoke"}) {
    const std::string path = (folder / kind).string() + ".vdb", half = (folder / kind).string() + "_half.vdb";
    ASSERT_EQ(run_brume(std::string("generate ") + kind + " -q --resolution 48 --seed 3 -o " + path).status, 0);
    ASSERT_EQ(run_brume("halve -q " + path + " -o " + half).status, 0);
    const json a = json::parse(run_brume("info --json " + path).out)["grids"][0],
               b = json::parse(run_brume("info --json " + half).out)["grids"][0];
    EXPECT_EQ(a["class"], "fog volume");
    EXPECT_GT(a["active_voxels"].get<int>(), 1000);
    EXPECT_NEAR(b["voxel_size"][0].get<double>(), 2 * a["voxel_size"][0].get<double>(), 1e-9);
  }
}

TEST(Commands, ExplainAndReplay) {
  const auto explain = run_brume("render " + kScene + " --explain");
  EXPECT_EQ(explain.status, 0);
  for (const char* part : {"bricks", "majorant", "Embree is not touched", "emission        none", "film"})
    EXPECT_NE(explain.out.find(part), std::string::npos) << part;
  EXPECT_NE(run_brume("render " + kScene + " --replay 200,200,0").out.find("coverage 1"), std::string::npos);
}

TEST(Commands, FiltersAsJson) {
  const json j = json::parse(run_brume("filters --json").out);
  EXPECT_EQ(j["filters"].size(), 5u);
  EXPECT_EQ(run_brume("filters trilateral").out.find("gaussian"), std::string::npos);
}

TEST(Commands, ProgressForMachines) {
  const test::TemporaryFolder folder;
  const auto r = run_brume("render " + kScene + " -D film.width=32 -D film.height=24 --spp 4 --progress json -o " +
                           (folder / "a.exr").string());
  const std::string last = r.err.substr(0, r.err.find("paths in"));
  EXPECT_NE(last.find("\"progress\":1.0"), std::string::npos) << r.err;
}

TEST(Commands, EvaluateWritesItsFolder) {
  const test::TemporaryFolder folder;
  const auto r =
      run_brume("evaluate " + kScene +
                " --size 24 --spp 2,4 --seeds 2 --reference-spp 8 -f bilateral -f gradient_kernel --no-tuning -q -o " +
                (folder / "out").string());
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(r.out.starts_with("# Filters on media passes"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out/table.csv"));
  EXPECT_TRUE(std::filesystem::exists(folder / "out/smoke_4spp_paper.png"));
  EXPECT_FALSE(std::filesystem::exists(folder / "out.part"));
  // Again into the same folder, named with a slash: results are replaced, what else lies there stays.
  test::write_file(folder / "out/mine.txt", "keep");
  const auto again =
      run_brume("evaluate " + kScene +
                " --size 24 --spp 2 --seeds 1 --reference-spp 8 -f bilateral -f gradient_kernel --no-tuning -q -o " +
                (folder / "out/").string());
  ASSERT_EQ(again.status, 0) << again.err;
  EXPECT_NE(again.out.find("one seed: cannot tell"), std::string::npos) << "a single seed proves nothing";
  EXPECT_EQ(test::read_file(folder / "out/mine.txt"), "keep");
  EXPECT_TRUE(std::filesystem::exists(folder / "out/table.csv"));
}

}  // namespace
}  // namespace brume
