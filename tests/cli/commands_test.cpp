// Every verb, as a person types it.

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

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
  EXPECT_EQ(run_brume("help").out, run_brume("--help").out);
  EXPECT_EQ(run_brume("help denoise").out, run_brume("denoise --help").out);
  EXPECT_TRUE(run_brume("--version").out.starts_with("brume 0."));
  for (const char* verb : {"info", "generate", "halve", "render", "merge", "denoise", "compare", "evaluate", "filters",
                           "docs", "picture", "submit"}) {
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

TEST(Commands, SequencesAreFoundByTheirNumbers) {
  const test::TemporaryFolder folder;
  const auto shot = [&](const std::string& number) { return (folder / ("shot." + number + ".exr")).string(); };
  for (const std::string number : {"0009", "0010", "0012"})
    ASSERT_EQ(run_brume("render " + kScene + kSmall + " --layers direct,indirect,flash --seed 1" + number + " -o " +
                        shot(number))
                  .status,
              0);
  const std::string out = (folder / "out.exr").string();
  const auto r = run_brume("denoise " + shot("0010") + " -f virtual_flash --extra-frames 2 -o " + out);
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_NE(r.err.find("shot.0010.exr: of the frames beside it, shot.0008.exr, shot.0011.exr are not there"),
            std::string::npos)
      << r.err;
  EXPECT_EQ(read_exr(out).text("filterFrames"), "-1, +2");
  const std::string beside = test::read_file(shot("0009"));
  const auto over = run_brume("denoise " + shot("0010") + " -f virtual_flash --extra-frames 1 -o " + shot("0009"));
  EXPECT_EQ(over.status, 2);
  EXPECT_NE(over.err.find("is read by this command and would be destroyed"), std::string::npos) << over.err;
  EXPECT_EQ(test::read_file(shot("0009")), beside);
  const auto unnumbered = run_brume("denoise " + out + " -f virtual_flash --extra-frames 1 -o " + shot("1"));
  EXPECT_EQ(unnumbered.status, 2);
  EXPECT_NE(unnumbered.err.find("needs the frame's number in the file's name"), std::string::npos) << unnumbered.err;
  const auto alone = run_brume("denoise " + shot("0012") + " -f virtual_flash --extra-frames 1 -o " + out);
  EXPECT_EQ(alone.status, 2);
  EXPECT_NE(alone.err.find("no frame beside it can be used; not there: shot.0011.exr, shot.0013.exr"),
            std::string::npos)
      << alone.err;
}

TEST(Commands, SequencesAreCleanedFrameByFrameAndResumed) {
  const test::TemporaryFolder folder;
  const std::string frames = (folder / "shot.####.exr").string(), clean = (folder / "clean.####.exr").string();
  const auto shot = [&](const std::string& number) { return folder / ("shot." + number + ".exr"); };
  const auto result = [&](const std::string& number) { return folder / ("clean." + number + ".exr"); };
  for (const std::string number : {"0001", "0002", "0003", "0005"})
    ASSERT_EQ(run_brume("render " + kScene + kSmall + " --layers direct,indirect,guides --seed 1" + number + " -o " +
                        shot(number).string())
                  .status,
              0);
  const std::string whole = test::read_file(shot("0003"));
  std::ofstream(shot("0003"), std::ios::binary) << whole.substr(0, whole.size() / 2);
  const std::string command = "denoise " + frames + " --frames 1-5 -o " + clean;
  const auto first = run_brume(command);
  EXPECT_EQ(first.status, 1);
  EXPECT_NE(first.err.find("frame 3 failed"), std::string::npos) << first.err;
  EXPECT_NE(first.err.find("frame 4 failed"), std::string::npos) << first.err;
  EXPECT_NE(first.err.find("3 done (1-2, 5); 2 failed (3-4)"), std::string::npos) << first.err;
  EXPECT_EQ(read_exr(result("0001")).text("filterFrames"), "+1");
  EXPECT_FALSE(std::filesystem::exists(result("0003")));
  // What is complete stays; what looked at a frame that has changed since is cleaned anew.
  std::ofstream(shot("0003"), std::ios::binary) << whole;
  const auto again = run_brume(command + " --resume");
  EXPECT_NE(again.err.find("4 done (1-3, 5); 1 failed (4)"), std::string::npos) << again.err;
  EXPECT_EQ(read_exr(result("0003")).text("filterFrames"), "-2, -1, +2");
  const auto once_more = run_brume(command + " --resume");
  EXPECT_NE(once_more.err.find("4 were complete (1-3, 5); 1 failed (4)"), std::string::npos) << once_more.err;
  // An output that was cut off is no result.
  std::filesystem::resize_file(result("0002"), std::filesystem::file_size(result("0002")) / 2);
  const auto repaired = run_brume(command + " --resume");
  EXPECT_NE(repaired.err.find("1 done (2); 3 were complete (1, 3, 5)"), std::string::npos) << repaired.err;
  const auto one_file = run_brume("denoise " + frames + " --frames 1-2 -o " + (folder / "out.exr").string());
  EXPECT_EQ(one_file.status, 2);
  EXPECT_NE(one_file.err.find("all 2 frames would go into one file"), std::string::npos) << one_file.err;
}

TEST(Commands, AFrameOfASequenceIsCleanedAsByItself) {
  const test::TemporaryFolder folder;
  const std::string frames = (folder / "shot.####.exr").string(), clean = (folder / "clean.####.exr").string();
  for (const std::string number : {"1", "2", "3"})
    ASSERT_EQ(run_brume("render " + kScene + kSmall + " --layers direct,indirect,guides --seed " + number + " -o " +
                        (folder / ("shot.000" + number + ".exr")).string())
                  .status,
              0);
  ASSERT_EQ(run_brume("denoise " + frames + " --frames 1-3 --extra-frames 1 -o " + clean).status, 0);
  const std::string alone = (folder / "alone.exr").string();
  ASSERT_EQ(run_brume("denoise " + (folder / "shot.0002.exr").string() + " --extra-frames 1 -o " + alone).status, 0);
  const Layers a = read_exr(folder / "clean.0002.exr"), b = read_exr(alone);
  for (const char* c : {"R", "G", "B"})
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x) ASSERT_EQ(a.at(c)(x, y), b.at(c)(x, y));
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
  EXPECT_EQ(j["filters"].size(), 22u);
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
  EXPECT_TRUE(r.out.starts_with("smoke: Lab RMS of the whole frame, default parameters"));
  EXPECT_LE(std::count(r.out.begin(), r.out.end(), '\n'), 7) << "every other table is in table.md\n" << r.out;
  EXPECT_NE(r.out.find((folder / "out").string() + "/table.md"), std::string::npos) << r.out;
  EXPECT_TRUE(test::read_file(folder / "out/table.md").starts_with("# Filters on media passes"));
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
  EXPECT_NE(test::read_file(folder / "out/table.md").find("one seed: cannot tell"), std::string::npos)
      << "a single seed proves nothing";
  EXPECT_EQ(test::read_file(folder / "out/mine.txt"), "keep");
  EXPECT_TRUE(std::filesystem::exists(folder / "out/table.csv"));
}

TEST(Commands, PartsMergeToTheWhole) {
  const test::TemporaryFolder folder;
  const auto file = [&](const char* name) { return (folder / name).string(); };
  ASSERT_EQ(run_brume("render " + kScene + kSmall + " -o " + file("whole.exr")).status, 0);
  for (const char* part : {"1", "2"}) {
    const auto r = run_brume("render " + kScene + kSmall + " --part " + part + "/2 -o " + file("p") + part + ".exr");
    ASSERT_EQ(r.status, 0) << r.err;
  }
  const auto merge = run_brume("merge " + file("p2.exr") + " " + file("p1.exr") + " -o " + file("merged.exr"));
  ASSERT_EQ(merge.status, 0) << merge.err;
  EXPECT_EQ(json::parse(
                run_brume("compare --json " + file("merged.exr") + " " + file("whole.exr")).out)["metrics"]["lab_rms"],
            0.0);
  const auto half = run_brume("merge " + file("p2.exr") + " -o " + file("half.exr"));
  EXPECT_EQ(half.status, 0);
  EXPECT_NE(half.err.find("2 of 4 samples per pixel are there (samples 2-4)"), std::string::npos) << half.err;
  const auto twice = run_brume("merge " + file("p2.exr") + " " + file("p2.exr") + " -o " + file("no.exr"));
  EXPECT_EQ(twice.status, 2);
  EXPECT_NE(twice.err.find("overlap"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(folder / "no.exr"));
}

TEST(Commands, CheckpointsAreGoneOnWith) {
  const test::TemporaryFolder folder;
  const auto file = [&](const char* name) { return (folder / name).string(); };
  const std::string size = " -D film.width=32 -D film.height=24 -q";
  ASSERT_EQ(run_brume("render " + kScene + size + " --spp 6 -o " + file("whole.exr")).status, 0);
  ASSERT_EQ(
      run_brume("render " + kScene + size + " --spp 2 --checkpoint " + file("c.exr") + " -o " + file("a.exr")).status,
      0);
  const auto more =
      run_brume("render " + kScene + size + " --spp 6 --resume " + file("c.exr") + " -o " + file("b.exr"));
  ASSERT_EQ(more.status, 0) << more.err;
  EXPECT_EQ(
      json::parse(run_brume("compare --json " + file("b.exr") + " " + file("whole.exr")).out)["metrics"]["lab_rms"],
      0.0);
  const auto other =
      run_brume("render " + kScene + size + " --spp 8 --seed 4 --resume " + file("c.exr") + " -o " + file("d.exr"));
  EXPECT_EQ(other.status, 2);
  EXPECT_NE(other.err.find("the seed is 0 in the first, 4 in the second"), std::string::npos) << other.err;
  const auto timed = run_brume("render " + kScene + size + " --time 0.5s -o " + file("t.exr"));
  EXPECT_EQ(timed.status, 0) << timed.err;
  const int samples = std::get<int>(read_exr_info(file("t.exr")).header.at("samplesPerPixel"));
  EXPECT_GE(samples, 1) << "one pass at least, however slow the machine";
  EXPECT_LT(samples, 1 << 20);
}

// What tev would read: a picture is made, then its pixels come tile by tile.
TEST(Commands, TheViewerGetsThePictureAsItGrows) {
  const int server = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(bind(server, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(listen(server, 1), 0);
  socklen_t length = sizeof address;
  getsockname(server, reinterpret_cast<sockaddr*>(&address), &length);
  std::string received;
  std::thread viewer([&] {
    const int client = accept(server, nullptr, nullptr);
    char buffer[4096];
    for (ssize_t n; (n = read(client, buffer, sizeof buffer)) > 0;) received.append(buffer, static_cast<size_t>(n));
    close(client);
  });
  const test::TemporaryFolder folder;
  const auto r = run_brume("render " + kScene + kSmall + " --tev 127.0.0.1:" + std::to_string(ntohs(address.sin_port)) +
                           " -o " + (folder / "a.exr").string());
  viewer.join();
  close(server);
  ASSERT_EQ(r.status, 0) << r.err;
  size_t at = 0, updates = 0;
  std::vector<bool> seen(32 * 24);
  const auto integer = [&](size_t offset) {
    int32_t v;
    std::memcpy(&v, received.data() + offset, 4);
    return v;
  };
  while (at < received.size()) {
    const int32_t size = integer(at);
    const int type = received[at + 4];
    const size_t name = at + 6;
    ASSERT_EQ(std::string(received.data() + name), "smoke");
    const size_t fields = name + 6;
    if (at == 0) {
      EXPECT_EQ(type, 4);
      EXPECT_EQ(integer(fields), 32);
      EXPECT_EQ(integer(fields + 4), 24);
      EXPECT_EQ(integer(fields + 8), 4);
    } else {
      EXPECT_EQ(type, 6);
      const size_t window = fields + 4 + 8;  // count, four names of one letter
      for (int y = 0; y < integer(window + 12); ++y)
        for (int x = 0; x < integer(window + 8); ++x)
          seen[static_cast<size_t>((integer(window + 4) + y) * 32 + integer(window) + x)] = true;
      ++updates;
    }
    at += static_cast<size_t>(size);
  }
  EXPECT_EQ(at, received.size());
  EXPECT_GE(updates, 4u);
  EXPECT_EQ(std::count(seen.begin(), seen.end(), true), 32 * 24);
  const auto nobody = run_brume("render " + kScene + kSmall + " --tev 127.0.0.1:1 -o " + (folder / "b.exr").string());
  EXPECT_EQ(nobody.status, 2);
  EXPECT_NE(nobody.err.find("nobody listens at 127.0.0.1:1"), std::string::npos);
}

}  // namespace
}  // namespace brume
