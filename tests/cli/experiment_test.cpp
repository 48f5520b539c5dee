// brume evaluate with an experiment's file and a cache.

#include <gtest/gtest.h>
#include <signal.h>

#include <nlohmann/json.hpp>

#include "base/rng.h"
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

/// What must not depend on when and how often a run was interrupted: all but times and memory.
json without_times(json results) {
  for (const char* timed : {"command", "pareto", "time_to_error", "overall"}) results.erase(timed);
  for (json& row : results["rows"])
    for (const char* timed : {"seconds", "peak_memory_bytes"}) row.erase(timed);
  for (json& scene : results["scenes"]) scene.erase("reference_seconds");
  return results;
}

class Experiments : public testing::Test {
 protected:
  Experiments() {
    // A scene of its own folder, so that its volume can be changed.
    fs::copy_file(test::source("data/volumes/cloud.vdb"), folder_ / "cloud.vdb");
    std::string scene = test::read_file(test::source("data/scenes/cloud.toml"));
    scene.replace(scene.find("../volumes/"), 11, "");
    test::write_file(folder_ / "cloud.toml", scene);
    test::write_file(folder_ / "small.toml",
                     "scenes = [\"cloud.toml\"]\nsize = 20\nspp = [2, 4]\nseeds = 2\nreference_spp = 8\n"
                     "component = \"all\"\nsearch = false\n"
                     "[[filters]]\nfilter = \"bilateral\"\n[[filters]]\nfilter = \"gradient_kernel\"\n");
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string command(const std::string& more = "", const std::string& cache = "cache") const {
    return "evaluate " + path("small.toml") + " --threads 2 --cache " + path(cache) + " -o " + path("out") + " " + more;
  }
  json results() const { return json::parse(test::read_file(folder_ / "out/results.json")); }
  std::string refused(const std::string& experiment) const {
    test::write_file(folder_ / "wrong.toml", experiment);
    const auto r = run_brume("evaluate " + path("wrong.toml") + " -o " + path("wrong"));
    EXPECT_EQ(r.status, 2) << experiment;
    EXPECT_FALSE(fs::exists(folder_ / "wrong"));
    return r.err;
  }
  test::TemporaryFolder folder_;
};

TEST_F(Experiments, NothingIsMadeAgainWhereNothingChanged) {
  const auto first = run_brume(command());
  ASSERT_EQ(first.status, 0) << first.err;
  const json before = results();
  EXPECT_EQ(before["rows"].size(), 2u * 2 * (1 + 2 * 2));
  EXPECT_EQ(before["experiment"]["name"], "small");
  EXPECT_EQ(before["experiment"]["file"], test::read_file(folder_ / "small.toml"));
  const auto again = run_brume(command());
  EXPECT_TRUE(holds(again.err, "0 frames rendered, 0 results filtered")) << again.err;
  json after = results();
  EXPECT_EQ(after, before) << "times too: they are those of when it was made";

  // Another filter: the frames are there, and it alone is run.
  const auto more = run_brume(command("-f bilateral -f gradient_kernel -f wavelet"));
  EXPECT_TRUE(holds(more.err, "0 frames rendered, 8 results filtered"))
      << more.err << "paper and default, 2 x 2 frames";

  // Another seed is one more frame of each sample count.
  EXPECT_TRUE(holds(run_brume(command("--seeds 3")).err, "2 frames rendered, "));
}

TEST_F(Experiments, DamagedEntriesAreMadeAgain) {
  ASSERT_EQ(run_brume(command()).status, 0);
  const json before = without_times(results());
  int damaged = 0;
  for (const auto& file : fs::recursive_directory_iterator(folder_ / "cache"))
    if (file.path().extension() == ".exr" && ++damaged % 2 == 0)
      fs::resize_file(file.path(), fs::file_size(file.path()) - fs::file_size(file.path()) / 4);
  EXPECT_GT(damaged, 20);
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_EQ(without_times(results()), before);
}

TEST_F(Experiments, AnInterruptedRunSaysThatItsCacheGoesOn) {
  test::RunningProgram program(command("--reference-spp 16384 --progress json"));
  ASSERT_TRUE(program.wait_until([&] { return holds(program.err(), "\"progress\""); }));
  program.send(SIGINT);
  const auto r = program.finish();
  EXPECT_EQ(r.status, 3);
  EXPECT_TRUE(holds(r.err, path("cache") + ": the same command goes on from there")) << r.err;
}

TEST_F(Experiments, EverythingIsMadeAgainWhenTheVolumeChanged) {
  ASSERT_EQ(run_brume(command("--spp 2")).status, 0);
  const json before = results();
  fs::remove(folder_ / "cloud.vdb");
  ASSERT_EQ(run_brume("generate cloud --resolution 24 -q -o " + path("cloud.vdb")).status, 0);
  const auto r = run_brume(command("--spp 2"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.err, "out of the cache 0 and 0")) << r.err;
  EXPECT_NE(results()["scenes"][0]["hash"], before["scenes"][0]["hash"]);
  EXPECT_NE(results()["rows"][0]["metrics"]["lab_rms"], before["rows"][0]["metrics"]["lab_rms"]);
}

TEST_F(Experiments, AKilledRunGoesOnToTheSameTables) {
  ASSERT_EQ(run_brume(command("", "whole")).status, 0);
  const json expected = without_times(results());
  fs::remove_all(folder_ / "out");
  // Killed once the cache holds so many entries: between frames, between results, and while one is written.
  Rng rng(11);
  size_t wanted = 0;
  int killed = 0;
  for (int attempt = 0; attempt < 10; ++attempt) {
    wanted += 1 + static_cast<size_t>(3 * rng.uniform());
    test::RunningProgram program(command());
    const bool running = program.wait_until([&] {
      std::error_code ignored;
      size_t entries = 0;
      for (const auto& file : fs::recursive_directory_iterator(folder_ / "cache", ignored))
        entries += file.path().extension() == ".exr";
      return entries >= wanted;
    });
    if (running) {
      program.send(SIGKILL);
      ++killed;
    }
    program.finish();
  }
  EXPECT_GE(killed, 3);
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_FALSE(holds(r.err, "out of the cache 0 and")) << r.err;
  EXPECT_EQ(without_times(results()), expected);
}

TEST_F(Experiments, AnotherVersionsCacheIsLeftAloneAndSaid) {
  fs::create_directories(folder_ / "cache/brume-0.0.1--0123456789ab--01234567");
  test::write_file(folder_ / "cache/brume-0.0.1--0123456789ab--01234567/0.exr", "of another version");
  const auto r = run_brume(command("--spp 2 --seeds 1"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.err, "holds results of another version too, which are not used: brume-0.0.1")) << r.err;
  EXPECT_TRUE(fs::exists(folder_ / "cache/brume-0.0.1--0123456789ab--01234567/0.exr"));
}

TEST_F(Experiments, ADamagedEntryIsMadeAgain) {
  ASSERT_EQ(run_brume(command("--spp 2 --seeds 1 -f bilateral")).status, 0);
  const json before = without_times(results());
  for (const auto& file : fs::recursive_directory_iterator(folder_ / "cache"))
    if (file.path().extension() == ".exr") fs::resize_file(file.path(), fs::file_size(file.path()) / 2);
  const auto r = run_brume(command("--spp 2 --seeds 1 -f bilateral"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_EQ(without_times(results()), before);
}

TEST_F(Experiments, AFullDiskIsAnErrorOfTheCache) {
  test::write_file(folder_ / "cloud.toml",
                   "[camera]\nposition = [0, -4, 0]\nlook_at = [0, 0, 0]\nup = [0, 0, 1]\n[environment]\nradiance = 1\n"
                   "[[volumes]]\nshape = \"box\"\nlo = [-1, -1, -1]\nhi = [1, 1, 1]\nsigma_t = 1\nalbedo = 0.5\n");
  const std::string full = "sh -c 'ulimit -f 20; " + std::string(BRUME_PROGRAM) + " " + command("--spp 2 --seeds 1") +
                           " >/dev/null 2>" + path("err") + "'";
  const int status = std::system(full.c_str());
  EXPECT_EQ(WEXITSTATUS(status), 2);
  EXPECT_TRUE(holds(test::read_file(folder_ / "err"), "the cache cannot be written: "))
      << test::read_file(folder_ / "err");
  EXPECT_FALSE(fs::exists(folder_ / "out"));
}

TEST_F(Experiments, AFilterThatFailsIsALineThatSaysSo) {
  test::write_file(folder_ / "small.toml",
                   "scenes = [\"cloud.toml\"]\nsize = 20\nspp = [1, 4]\nseeds = 2\nreference_spp = 8\nsearch = false\n"
                   "[[filters]]\nfilter = \"nfor\"\n[[filters]]\nfilter = \"bilateral\"\n[[filters]]\n"
                   "filter = \"sbf\"\ntime_limit = 0.0001\n");
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  int halves = 0, late = 0, numbers = 0;
  const json all = results();
  for (const json& row : all["rows"]) {
    const std::string failed = row.value("failed", "");
    EXPECT_EQ(failed.empty(), !row["metrics"].empty());
    halves += row["method"] == "nfor_default" && row["spp"] == 1 && holds(failed, "half");
    late += row["method"] == "sbf_default" && holds(failed, "took longer than 0.0001 s");
    numbers += row["method"] == "bilateral_default" && failed.empty();
  }
  EXPECT_EQ(halves, 2) << "frame and medium";
  EXPECT_EQ(late, 4);
  EXPECT_EQ(numbers, 4);
  EXPECT_TRUE(holds(r.out, "What failed, and why")) << r.out;
  EXPECT_TRUE(holds(run_brume(command()).err, " results filtered")) << "again, from the cache";
}

TEST_F(Experiments, FramesOfOtherRenderersStandBesideScenes) {
  const std::string render = "render " + path("cloud.toml") + " -D film.width=20 -D film.height=20 --layers none -q ";
  ASSERT_EQ(run_brume(render + "--spp 256 --seed 9 -o " + path("reference.exr")).status, 0);
  for (const char* seed : {"1", "2"})
    ASSERT_EQ(run_brume(render + "--spp 4 --seed " + seed + " -o " + path("noisy") + seed + ".exr").status, 0);
  test::write_file(
      folder_ / "small.toml",
      "[[filters]]\nfilter = \"bilateral\"\n[[filters]]\nfilter = \"gradient_kernel\"\n[[frames]]\nname = \"theirs\"\nreference = \"reference.exr\"\nnoisy = [\"noisy1.exr\", \"noisy2.exr\"]\nspp = 4\n");
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.err, "0 frames rendered")) << r.err;
  const json all = results();
  EXPECT_EQ(all["scenes"][0]["references"], 1);
  double noisy = 0, clean = 0;
  for (const json& row : all["rows"]) {
    if (row["region"] != "frame") continue;
    if (row["method"] == "noisy") noisy = row["metrics"]["lab_rms"]["mean"];
    if (row["method"] == "bilateral_default") clean = row["metrics"]["lab_rms"]["mean"];
    if (row["method"] == "gradient_kernel_default") {
      EXPECT_TRUE(holds(row.value("failed", ""), "gradient")) << "these frames have none: " << row;
    }
  }
  const json direct = json::parse(run_brume("compare --json " + path("noisy1.exr") + " " + path("reference.exr")).out);
  EXPECT_NEAR(all["rows"][0]["metrics"]["lab_rms"]["values"][0].get<double>(),
              direct["metrics"]["lab_rms"].get<double>(), 1e-9);
  EXPECT_GT(noisy, clean);
  EXPECT_GT(clean, 0);

  ASSERT_EQ(run_brume("render " + path("cloud.toml") + " -D film.width=16 -D film.height=16 --spp 1 -q -o " +
                      path("noisy2.exr"))
                .status,
            0);
  EXPECT_TRUE(holds(run_brume(command()).err, "has 16 x 16 pixels, expected 20 x 20")) << "another size";
}

TEST_F(Experiments, SayWhereFiltersAreNotComparedAlike) {
  const std::string run = "--spp 2 --seeds 1 -f bilateral -f transport_regression --component ";
  const auto indirect = run_brume(command(run + "indirect"));
  ASSERT_EQ(indirect.status, 0) << indirect.err;
  for (const std::string& told : {indirect.err, indirect.out})
    EXPECT_TRUE(holds(told, "transport_regression cleans the direct light as well")) << told;
  const auto all = run_brume(command(run + "all"));
  EXPECT_FALSE(holds(all.err + all.out, "direct light as well"));
}

TEST_F(Experiments, DirectAndIndirectLightAreJudgedByThemselves) {
  const auto rows = [&](const std::string& component) {
    const auto r = run_brume(command("--spp 4 --seeds 2 -f gaussian --no-tuning --component " + component));
    EXPECT_EQ(r.status, 0) << r.err;
    EXPECT_EQ(holds(test::read_file(folder_ / "out/table.md"), "## Direct and indirect light by themselves"),
              component != "all");
    const json all = results();
    std::map<std::string, json> found;
    for (const json& row : all["rows"])
      if (row["region"] == "medium") found[row["method"]] = row.value("lights", json::object());
    return found;
  };
  for (const char* component : {"all", "indirect", "separate"}) {
    auto found = rows(component);
    const json noisy = found["noisy"], clean = found["gaussian_default"];
    if (component != std::string("all"))
      for (const char* light : {"direct", "indirect"}) {
        ASSERT_TRUE(noisy.contains(light)) << component << noisy;
        EXPECT_FALSE(noisy[light].contains("ssim")) << "not measured";
      }
    EXPECT_EQ(clean.contains("direct"), component == std::string("separate")) << clean;
    EXPECT_EQ(clean.contains("indirect"), component != std::string("all")) << clean;
    for (const auto& [light, metrics] : clean.items()) {
      EXPECT_EQ(metrics["lab_rms"]["values"].size(), 2u);
      // Twenty pixels are few: what a Gaussian blurs of the shadows' edges is more than the noise of the direct light.
      const double ratio = metrics["mse"]["mean"].get<double>() / noisy[light]["mse"]["mean"].get<double>();
      EXPECT_LT(ratio, light == "indirect" ? 0.9 : 5) << component << light;
      EXPECT_NE(ratio, 1);
    }
  }
}

TEST_F(Experiments, PassesOfLightGroupsAreCleanedAndJudged) {
  std::string scene = test::read_file(folder_ / "cloud.toml");
  const size_t light = scene.find("[[lights]]\n");
  ASSERT_NE(light, std::string::npos);
  scene.insert(light + 11, "group = \"key\"\n");
  test::write_file(folder_ / "cloud.toml", scene);
  const auto run = [&](const std::string& component) {
    const auto r = run_brume(
        command("--spp 4 --seeds 2 -f transport_regression -f gaussian --no-tuning --component " + component));
    EXPECT_EQ(r.status, 0) << r.err;
    const json written = results();
    std::map<std::string, json> found;
    for (const json& row : written["rows"])
      if (row["region"] == "frame") found[row["method"]] = row.value("lights", json::object());
    return found;
  };
  auto all = run("all");
  const json noisy = all["noisy"], clean = all["transport_regression_default"];
  double sum = 0;
  for (const char* group : {"light.key", "light.rest"}) {
    ASSERT_TRUE(noisy.contains(group) && clean.contains(group)) << noisy << clean;
    EXPECT_TRUE(all["gaussian_default"].contains(group));
    const double error = clean[group]["lab_rms"]["mean"].get<double>();
    EXPECT_GT(error, 0);
    EXPECT_LT(error, 0.5 * noisy[group]["lab_rms"]["mean"].get<double>()) << group;
    sum += error;
  }
  // The column of tables is their mean.
  EXPECT_TRUE(holds(test::read_file(folder_ / "out/table.md"), "## Passes"));
  EXPECT_TRUE(holds(test::read_file(folder_ / "out/table.csv"), fmt::format(",{:.6g},", sum / 2)));
  // Where direct light stays noisy, groups would, too.
  auto indirect = run("indirect");
  EXPECT_FALSE(indirect["gaussian_default"].contains("light.key"));
  EXPECT_TRUE(indirect["transport_regression_default"].contains("light.key")) << "it cleans direct light by itself";
}

TEST_F(Experiments, SequencesAreJudgedByHowTheyFlicker) {
  const auto experiment = [&](const std::string& frames) {
    return "size = 24\nspp = [8]\nseeds = 2\nreference_spp = 64\nsearch = false\ncomponent = \"all\"\n"
           "scenes = [\"cloud.toml\"]\n[[filters]]\nfilter = \"gaussian\"\n[[filters]]\nfilter = \"nl_means\"\n"
           "[[filters]]\nfilter = \"sbf\"\ntime_limit = 1e-4\n"
           "[[sequences]]\nfile = \"cloud.toml\"\nname = \"shot\"\nframes = \"" +
           frames + "\"\nset = [\"render.max_events=40\"]\n";
  };
  test::write_file(folder_ / "small.toml", experiment("1-4"));
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.out, "Through time")) << r.out;
  const json all = results();
  ASSERT_EQ(all["sequences"].size(), 1u);
  const json& shot = all["sequences"][0];
  EXPECT_EQ(shot["name"], "shot");
  EXPECT_EQ(shot["frames"], json({1, 2, 3, 4}));
  // Nothing moves but noise.
  EXPECT_LT(shot["reference_change"]["frame"].get<double>(), 1);
  std::map<std::string, json> rows;
  for (const json& row : shot["rows"])
    if (row["region"] == "frame") rows[row["label"].get<std::string>() + row["reach"].dump()] = row;
  ASSERT_EQ(rows.size(), 5u) << "path tracing, gaussian, sbf, nl_means alone and with frames beside: " << shot["rows"];
  EXPECT_TRUE(holds(rows["sbf0"].value("failed", ""), "frame 1, seed 1: took longer than 0.0001 s"));
  EXPECT_TRUE(holds(r.out, "took longer than 0.0001 s"));
  const auto mean = [&](const char* row, const char* what) { return rows[row][what]["mean"].get<double>(); };
  for (const char* row : {"path tracing0", "gaussian0", "nl_means0"}) {
    EXPECT_EQ(rows[row]["lab_rms"]["values"].size(), 2u);
    // Independent noise changes by the root of two times itself; a filter's bias does not change.
    EXPECT_LT(mean(row, "temporal_error"), 1.1 * std::sqrt(2.0) * mean(row, "lab_rms")) << row;
    EXPECT_GT(mean(row, "flicker"), 0) << row;
  }
  EXPECT_NEAR(mean("path tracing0", "temporal_error"), std::sqrt(2.0) * mean("path tracing0", "lab_rms"),
              0.15 * mean("path tracing0", "temporal_error"));
  EXPECT_LT(mean("gaussian0", "temporal_error"), mean("path tracing0", "temporal_error"));
  for (const auto& [name, row] : rows) {
    if (!name.starts_with("nl_means") || row["reach"] == 0) continue;
    EXPECT_LT(row["temporal_error"]["mean"].get<double>(), mean("nl_means0", "temporal_error"));
  }
  EXPECT_TRUE(holds(run_brume(command()).err, "0 frames rendered, 0 results filtered")) << "nothing anew";

  for (const auto& [frames, what] : {std::pair("7", "expected at least two"), {"4-1", "4-1"}})
    EXPECT_TRUE(holds(refused(experiment(frames)), what)) << frames;
}

TEST_F(Experiments, WhatIsWrongInTheFileIsNamed) {
  const std::string scene = "scenes = [\"cloud.toml\"]\n";
  EXPECT_TRUE(holds(refused(scene + "seds = 3\n"), "unknown key 'seds' in an experiment; did you mean 'seeds'?"));
  EXPECT_TRUE(holds(refused("scenes = [\"clowd.toml\"]\n"), "clowd.toml: no such file"));
  EXPECT_TRUE(holds(refused(scene + "spp = [0]\n"), "'spp' is out of range"));
  EXPECT_TRUE(holds(refused(scene + "spp = 16\n"), "expected integers in brackets"));
  EXPECT_TRUE(holds(refused(scene + "[[filters]]\nfilter = \"bilat\"\n"), "no filter 'bilat'"));
  EXPECT_TRUE(holds(refused(scene + "[[filters]]\nfilter = \"bilateral\"\nparameters = \"radius=99\"\n"), "radius"));
  EXPECT_TRUE(holds(refused(scene + "metrics = [\"lab_rsm\"]\n"), "no metric 'lab_rsm'; did you mean 'lab_rms'?"));
  EXPECT_TRUE(holds(refused(scene + "study_spp = [5]\n"), "study_spp 5 is none of"));
  EXPECT_TRUE(holds(refused(scene + "component = \"some\"\n"), "'component' cannot be 'some'"));
  EXPECT_TRUE(holds(refused("[[filters]]\nfilter = \"bilateral\"\n"), "neither scenes, frames nor sequences"));
  EXPECT_TRUE(holds(refused(scene + "[[filters]]\nfilter = \"bilateral\"\n[[filters]]\nfilter = \"bilateral\"\n"),
                    "two filters are called 'bilateral'"));
  EXPECT_TRUE(holds(refused("[[scenes]]\nfile = \"cloud.toml\"\n[[scenes]]\nfile = \"cloud.toml\"\n"),
                    "two scenes are named 'cloud'"));
  EXPECT_TRUE(holds(refused("[[scenes]]\nfile = \"cloud.toml\"\nname = \"a/b\"\n"), "a scene is named 'a/b'"));
}

TEST_F(Experiments, AGuideIsOneLayerWhoeverReadsIt) {
  test::write_file(folder_ / "small.toml",
                   "scenes = [\"cloud.toml\"]\nsize = 20\nspp = [4]\nseeds = 1\nreference_spp = 8\nsearch = false\n"
                   "component = \"all\"\nablation = true\n[[filters]]\nfilter = \"transport_regression\"\n"
                   "[[filters]]\nfilter = \"guided\"\nparameters = \"preset=guides\"\n");
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  std::map<std::string, std::set<std::string>> readers;
  const json all = results();
  for (const json& row : all["ablation"]) readers[row["layer"]].insert(row["method"]);
  EXPECT_EQ(readers["guide.opacity"].size(), 2u);
  EXPECT_EQ(readers["guide.predicted_direct"].size(), 2u);
  for (const auto& [layer, methods] : readers) EXPECT_FALSE(layer.starts_with("guide-")) << layer;
}

TEST_F(Experiments, StudiesFillTheirTables) {
  test::write_file(folder_ / "small.toml",
                   "scenes = [\"cloud.toml\"]\nsize = 20\nspp = [64]\nseeds = 2\nreference_spp = 8\nsearch = false\n"
                   "component = \"all\"\nablation = true\nsensitivity = true\nmetrics = [\"lab_rms\", \"psnr\"]\n"
                   "[[filters]]\nfilter = \"gaussian\"\n[[filters]]\nfilter = \"wlr\"\nstudy = false\n"
                   "[[filters]]\nfilter = \"guided\"\nfeatures = [\"opacity\", \"single\"]\n");
  const auto r = run_brume(command());
  ASSERT_EQ(r.status, 0) << r.err;
  const json all = results();
  EXPECT_EQ(all["metrics"].size(), 2u);
  std::set<std::string> removed, alone, varied;
  for (const json& row : all["ablation"]) {
    EXPECT_EQ(row["method"], "guided_opacity_single_default");
    (row["how"] == "alone" ? alone : removed).insert(row["layer"]);
  }
  EXPECT_EQ(removed, (std::set<std::string>{"opacity", "single"}));
  EXPECT_EQ(alone, removed);
  for (const json& row : all["sensitivity"])
    varied.insert(row["method"].get<std::string>() + " " + row["parameter"].get<std::string>());
  EXPECT_TRUE(varied.contains("gaussian_default sigma"));
  EXPECT_FALSE(varied.contains("wlr_default search-radius"));
  // With the candidate that the method has, a study is the method.
  for (const json& row : all["rows"])
    if (row["method"] == "gaussian_default" && row["region"] == "frame") {
      bool same = false;
      for (const json& s : all["sensitivity"])
        same |= s["method"] == row["method"] && s["parameter"] == "sigma" && s["metrics"] == row["metrics"];
      EXPECT_TRUE(same);
    }
}

TEST_F(Experiments, PicturesAndTablesSayWhatMadeThem) {
  ASSERT_EQ(run_brume(command("--spp 2 --seeds 2 -f bilateral")).status, 0);
  const std::string hash = results()["scenes"][0]["hash"];
  const Layers picture = read_exr(folder_ / "out/cloud_2spp_bilateral_default.exr");
  EXPECT_TRUE(holds(picture.text("evaluateCommand"), "brume evaluate ")) << picture.text("evaluateCommand");
  EXPECT_EQ(picture.text("sceneHash"), hash);
  EXPECT_TRUE(holds(picture.text("machine"), "2 threads"));
  for (const char* file : {"table.md", "table.csv", "results.json", "cloud_error_seconds.svg"}) {
    const std::string text = test::read_file(folder_ / "out" / file);
    EXPECT_TRUE(holds(text, "brume evaluate ") && holds(text, hash)) << file;
  }
}

TEST(Compare, HasEveryMetricOfEachLayerAndLimitsBothWays) {
  const test::TemporaryFolder folder;
  const auto path = [&](const char* name) { return (folder / name).string(); };
  const std::string render = "render " + test::source("data/scenes/cloud.toml").string() +
                             " -D film.width=24 -D film.height=24 --layers direct,indirect,coverage -q ";
  ASSERT_EQ(run_brume(render + "--spp 4 --seed 1 -o " + path("a.exr")).status, 0);
  ASSERT_EQ(run_brume(render + "--spp 64 --seed 2 -o " + path("b.exr")).status, 0);
  const std::string compare = "compare " + path("a.exr") + " " + path("b.exr");
  const json all = json::parse(run_brume(compare + " --json --each-layer").out);
  for (const char* id : {"lab_rms", "rel_mse", "rel_mse_trimmed", "log_luminance_mse", "psnr", "ssim", "flip",
                         "hdr_flip", "relative_bias"})
    for (const char* region : {"metrics", "medium"}) {
      EXPECT_TRUE(all[region].contains(id)) << id;
      EXPECT_TRUE(all["layers"]["direct"][region].contains(id)) << id;
    }
  EXPECT_EQ(all["layers"].size(), 2u) << "direct and indirect";
  EXPECT_EQ(all["layers"]["indirect"]["metrics"],
            json::parse(run_brume(compare + " --json --layer indirect").out)["metrics"]);
  EXPECT_TRUE(holds(run_brume(compare + " --each-layer").out, "indirect "));

  EXPECT_EQ(run_brume(compare + " --min ssim=0.001 --max flip=0.999").status, 0);
  const auto low = run_brume(compare + " --min psnr=99");
  EXPECT_EQ(low.status, 1);
  EXPECT_TRUE(holds(low.err, "below 99")) << low.err;
  const auto wrong = run_brume(compare + " --max psnr=30");
  EXPECT_EQ(wrong.status, 2);
  EXPECT_TRUE(holds(wrong.err, "higher values of psnr are better; use --min psnr=30")) << wrong.err;
}

TEST(ExperimentReference, IsInStepWithTheParser) {
  EXPECT_EQ(test::read_file(test::source("docs/experiment.md")), run_brume("docs experiment").out)
      << "run: brume docs experiment > docs/experiment.md";
}

}  // namespace
}  // namespace brume
