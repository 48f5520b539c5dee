// Filters that are not brume's, in the protocol: what they are given, what is added to their result, what they are
// charged for, and how they fail.

#include "evaluate/protocol/external_filter.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "base/scratch_folder.h"
#include "evaluate/protocol/cache.h"
#include "evaluate/protocol/command_filter.h"
#include "evaluate/protocol/protocol.h"
#include "evaluate/report/report.h"
#include "image/exr_io.h"
#include "image/pfm_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

constexpr int kWidth = 9, kHeight = 7;

/// A frame whose every value says what it is of: direct 1, indirect 0.5 with a trace of the seed, all layers and
/// statistics that are asked for.
Layers told_apart(const FrameRequest& request) {
  Layers frame(kWidth, kHeight);
  const auto fill = [&](const LayerName& l, float value, std::string_view which = "") {
    for (const std::string& channel : l.channel_names(which)) frame.add(channel).fill(value);
  };
  const float indirect = request.seed >= kReferenceSeed ? 0.5f : 0.5f + 0.01f * static_cast<float>(request.seed % 100);
  fill(layer::direct, 1);
  fill(layer::indirect, indirect);
  fill(layer::beauty, 1 + indirect);
  fill(layer::coverage, 1);
  fill(layer::alpha, 1);
  std::vector<LayerName> layers = {layer::beauty, layer::direct, layer::indirect};
  for (const LayerName& l : {layer::albedo, layer::normal, layer::gradient})
    if (std::find(request.data.layers.begin(), request.data.layers.end(), l.name) != request.data.layers.end()) {
      fill(l, 0.25f);
      layers.push_back(l);
    }
  if (std::find(request.data.layers.begin(), request.data.layers.end(), "guides") != request.data.layers.end()) {
    frame.add("guide.opacity.Y").fill(0.75f);
    frame.add("guide.depth.Z").fill(3);
  }
  if (request.data.statistics)
    for (const LayerName& l : layers) {
      const float value = l == layer::indirect ? 2.0f : l == layer::direct ? 3.0f : l == layer::beauty ? 4.0f : 5.0f;
      fill(l, value, statistic::mean_variance);
      fill(l, value + 0.25f, statistic::half_a);
      fill(l, value + 0.5f, statistic::half_b);
    }
  frame.header["samplesPerPixel"] = request.spp;
  return frame;
}

EvaluationScene made_up_scene(std::vector<RecordedData>* asked = nullptr) {
  return {.name = "made up",
          .hash = "01",
          .render =
              [asked](const FrameRequest& request, const Task&) {
                if (asked) asked->push_back(request.data);
                return TimedFrame{told_apart(request), request.data.statistics ? 2.0 : 1.0};
              },
          .time_guides = [](int, const Task&) { return 0.125; }};
}

EvaluationSettings settings_for(std::vector<Contender> contenders, Component component = Component::kAll) {
  EvaluationSettings settings;
  settings.spp = {4};
  settings.seeds = 2;
  settings.reference_spp = 8;
  settings.tune = false;
  settings.metrics = {"lab_rms"};
  settings.contenders = std::move(contenders);
  settings.component = component;
  return settings;
}

Evaluation evaluated(const EvaluationSettings& settings, const Cache& cache, const EvaluationScene& scene) {
  const std::vector<EvaluationScene> scenes = {scene};
  size_t stages = 0;
  Evaluation e = evaluate(scenes, settings, cache, [&](const std::string&) {
    ++stages;
    return Task{2, {}, nullptr};
  });
  EXPECT_EQ(stages, stage_count(scenes, settings));
  return e;
}

/// A function that multiplies what it is given.
ExternalFilter multiplier(float factor, std::vector<std::vector<std::string>>* seen = nullptr) {
  ExternalFilter filter;
  filter.kind = "function";
  filter.words = "times";
  filter.key = fmt::format("times {}", factor);
  filter.run = [factor, seen](const ExternalInput& input, const Task&) {
    if (seen) seen->push_back(input.frame.names());
    ExternalOutput output{Layers(input.frame.width(), input.frame.height()), 2, 0.5, 1e6};
    for (const std::string& channel : layer::beauty.channel_names()) {
      Plane plane = input.frame.at(channel);
      for (int y = 0; y < plane.height(); ++y)
        for (float& value : plane.pixels(y)) value *= factor;
      output.picture.set(channel, std::move(plane));
    }
    return output;
  };
  return filter;
}

const MethodResult& line(const Evaluation& e, const std::string& label, Tuning tuning = Tuning::kDefault) {
  const MethodResult* found = e.scenes.at(0).find(label, tuning, 4);
  if (!found) throw std::runtime_error("no line " + label);
  return *found;
}

TEST(ExternalFilter, GetsTheComponentAndTheRestIsAddedBack) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  // The first seed's direct light is 1, its indirect light .51.
  for (const auto& [component, expected, seconds] : {std::tuple{Component::kAll, 3 * 1.51f, 2.0},
                                                     {Component::kIndirect, 1 + 3 * 0.51f, 2.0},
                                                     {Component::kSeparate, 3 * 1.0f + 3 * 0.51f, 4.0}}) {
    const Evaluation e =
        evaluated(settings_for({external_contender(multiplier(3), "mine")}, component), cache, made_up_scene());
    const MethodResult& m = line(e, "mine");
    ASSERT_EQ(m.failed, "");
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) EXPECT_NEAR(m.example.at("G")(x, y), expected, 1e-6);
    EXPECT_EQ(m.filter_seconds, seconds) << "those that it took, not those around it; of both signals together";
    EXPECT_EQ(m.exchange_seconds, seconds / 4);
    EXPECT_EQ(m.peak_bytes, 1e6);
    EXPECT_EQ(m.lights.contains("direct"), component == Component::kSeparate);
  }
}

TEST(ExternalFilter, WhatItDoesNotChangeStaysToTheBit) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  EvaluationScene scene = made_up_scene();
  // One sample outshines everything: brume's own filters would limit it.
  scene.render = [](const FrameRequest& request, const Task&) {
    Layers frame = told_apart(request);
    if (request.seed < kReferenceSeed)
      for (const LayerName& l : {layer::beauty, layer::indirect}) frame.add(l.channel(1))(4, 3) = 1e6f;
    return TimedFrame{std::move(frame), 1};
  };
  const Evaluation e = evaluated(settings_for({external_contender(multiplier(1), "copy")}), cache, scene);
  for (const std::string& channel : layer::beauty.channel_names())
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        EXPECT_EQ(line(e, "copy").example.at(channel)(x, y), line(e, "", Tuning::kNone).example.at(channel)(x, y));
}

TEST(ExternalFilter, SeesWhatItAskedForAndNothingElse) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  std::vector<std::vector<std::string>> plain, asked;
  std::vector<float> variance;
  ExternalFilter modest = multiplier(1, &plain), curious = multiplier(2, &asked);
  curious.layers = {layer::albedo};
  curious.guides = curious.statistics = true;
  const auto run = curious.run;
  curious.run = [&variance, run](const ExternalInput& input, const Task& task) {
    EXPECT_EQ(input.spp, 4);
    EXPECT_TRUE(input.seed == kFirstNoisySeed || input.seed == kFirstNoisySeed + 1);
    variance.push_back(input.frame.at("mean_variance.R")(0, 0));
    return run(input, task);
  };
  std::vector<RecordedData> recorded;
  const Evaluation e =
      evaluated(settings_for({external_contender(modest, "modest"), external_contender(curious, "curious")},
                             Component::kIndirect),
                cache, made_up_scene(&recorded));
  EXPECT_EQ(plain.at(0), (std::vector<std::string>{"A", "B", "G", "R", "coverage.A"}));
  std::vector<std::string> all = {
      "A", "B", "G", "R", "albedo.B", "albedo.G", "albedo.R", "coverage.A", "guide.depth.Z", "guide.opacity.Y"};
  for (const char* which : {"half_a", "half_b", "mean_variance"})
    for (const char* channel : {"B", "G", "R"}) {
      all.push_back(fmt::format("{}.{}", which, channel));
      all.push_back(fmt::format("albedo.{}.{}", which, channel));
    }
  std::sort(all.begin(), all.end());
  EXPECT_EQ(asked.at(0), all);
  EXPECT_EQ(variance.at(0), 2) << "of the indirect light, under the picture's name";
  // Who reads more is charged for rendering more.
  EXPECT_EQ(line(e, "modest").render_seconds, 1);
  EXPECT_EQ(line(e, "modest").guide_seconds, 0);
  EXPECT_EQ(line(e, "curious").render_seconds, 2);
  EXPECT_EQ(line(e, "curious").guide_seconds, 0.125);
  const auto has = [](const RecordedData& data, const std::string& name) {
    return std::find(data.layers.begin(), data.layers.end(), name) != data.layers.end();
  };
  EXPECT_TRUE(std::any_of(recorded.begin(), recorded.end(),
                          [&](const RecordedData& d) { return has(d, "albedo") && has(d, "guides") && d.statistics; }));
}

TEST(ExternalFilter, StandsUnderEachSettingAsItIs) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  int runs = 0;
  ExternalFilter counted = multiplier(0.9f);
  const auto run = counted.run;
  counted.run = [&runs, run](const ExternalInput& input, const Task& task) {
    ++runs;
    return run(input, task);
  };
  EvaluationSettings settings = settings_for({external_contender(counted, "mine"), parse_contender("gaussian")});
  settings.tune = settings.ablation = settings.sensitivity = true;
  const Evaluation e = evaluated(settings, cache, made_up_scene());
  EXPECT_EQ(runs, 2) << "once for each seed, and for no search or study";
  EXPECT_EQ(line(e, "mine").whole().mean, line(e, "mine", Tuning::kSearched).whole().mean);
  for (const SensitivityResult& s : e.scenes[0].sensitivity) EXPECT_EQ(s.result.filter, "gaussian");
  const std::string table = markdown_report(e), short_text = short_report(e), csv = csv_report(e);
  for (const std::string* text : {&table, &short_text})
    EXPECT_NE(text->find("mine is `times`: no parameters of it are known, so that nothing is searched"),
              std::string::npos);
  EXPECT_NE(csv.find(",times,"), std::string::npos);
  const auto json = nlohmann::json::parse(json_report(e));
  std::set<std::string> methods, pairs;
  for (const auto& m : json["methods"])
    if (m["label"] == "mine") {
      methods.insert(m["id"]);
      EXPECT_EQ(m["filter"], "function");
      EXPECT_EQ(m["command"], "times");
    }
  EXPECT_EQ(methods, (std::set<std::string>{"mine_default", "mine_searched"}));
  for (const auto& p : json["pairs"])
    for (const auto& m : p["methods"]) pairs.insert(m);
  EXPECT_TRUE(pairs.contains("mine_default") && pairs.contains("mine_searched")) << "who beats whom";
  for (const auto& row : json["rows"])
    if (row["method"] == "mine_default") {
      EXPECT_EQ(row["seconds"]["exchange"], 0.5);
    }
  runs = 0;
  evaluated(settings, cache, made_up_scene());
  EXPECT_EQ(runs, 0) << "out of the cache";
}

/// Why a filter has failed.
std::string failure(const std::function<ExternalOutput(const ExternalInput&)>& run, double time_limit = 0) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  ExternalFilter filter = multiplier(1);
  filter.run = [&run](const ExternalInput& input, const Task&) { return run(input); };
  Contender contender = external_contender(filter, "mine");
  contender.time_limit = time_limit;
  return line(evaluated(settings_for({contender}), cache, made_up_scene()), "mine").failed;
}

TEST(ExternalFilter, EachFailureIsNamed) {
  const auto picture = [](int width, int height) {
    Layers layers(width, height);
    layers.add_rgb(layer::beauty);
    return layers;
  };
  EXPECT_EQ(failure([](const ExternalInput&) -> ExternalOutput { throw InputError("no luck"); }), "seed 1: no luck");
  EXPECT_EQ(failure([&](const ExternalInput&) { return ExternalOutput{picture(kHeight, kWidth)}; }),
            "seed 1: its picture has 7 x 9 pixels, expected 9 x 7 as the frame");
  EXPECT_EQ(failure([&](const ExternalInput&) {
              Layers grey(kWidth, kHeight);
              grey.add("Y");
              return ExternalOutput{grey};
            }),
            "seed 1: its picture has no channels R, G, B; it has: Y");
  EXPECT_EQ(failure([&](const ExternalInput&) {
              Layers broken = picture(kWidth, kHeight);
              broken.add("G")(5, 2) = std::numeric_limits<float>::quiet_NaN();
              broken.add("B")(5, 2) = std::numeric_limits<float>::infinity();
              broken.add("B")(6, 2) = -std::numeric_limits<float>::infinity();
              return ExternalOutput{broken};
            }),
            "seed 1: 2 of the 63 pixels of its picture are NaN or infinite, the first in column 5, row 2");
  EXPECT_EQ(failure(
                [&](const ExternalInput&) {
                  return ExternalOutput{picture(kWidth, kHeight), 3};
                },
                2.5),
            "seed 1: took longer than 2.5 s");
  EXPECT_EQ(failure([](const ExternalInput&) -> ExternalOutput { throw std::bad_alloc(); }),
            "seed 1: not enough memory");
}

TEST(ExternalFilter, CachedResultsAreJudgedByTheLimitsOfToday) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  // Each result takes 2 s and 1 MB, and fails in the run where it may hold less.
  const auto failed = [&](double time_limit, double memory_limit, int* runs = nullptr) {
    ExternalFilter filter = multiplier(0.5f);
    filter.memory_limit = memory_limit;
    filter.run = [run = filter.run, memory_limit, runs](const ExternalInput& input, const Task& task) {
      if (runs) ++*runs;
      if (memory_limit > 0 && memory_limit < 1e6) throw LimitPassed("held too much");
      return run(input, task);
    };
    Contender contender = external_contender(std::move(filter), "mine");
    contender.time_limit = time_limit;
    return line(evaluated(settings_for({contender}), cache, made_up_scene()), "mine").failed;
  };
  int runs = 0;
  EXPECT_EQ(failed(0, 5e5, &runs), "seed 1: held too much");
  EXPECT_GT(runs, 0);
  EXPECT_EQ(failed(0, 5e5, &(runs = 0)), "seed 1: held too much");
  EXPECT_EQ(runs, 0) << "a failure is kept";
  EXPECT_EQ(failed(0, 2e6), "") << "and forgotten where more is allowed";
  EXPECT_EQ(failed(1, 0, &(runs = 0)), "seed 1: took longer than 1 s") << "a result is kept, but too late for today";
  EXPECT_EQ(failed(0, 9e5), "seed 1: held 0.001 GB, more than the 0.0009 GB that it may");
  EXPECT_EQ(runs, 0);
  EXPECT_EQ(failed(3, 2e6), "");
}

TEST(ExternalFilter, ALayerThatOtherRenderersDidNotRecordIsNamed) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  ExternalFilter filter = multiplier(1);
  filter.layers = {layer::flash};
  const Evaluation e = evaluated(settings_for({external_contender(filter, "mine")}), cache, made_up_scene());
  EXPECT_NE(line(e, "mine").failed.find("filter mine needs the layer 'flash', which the frame does not have"),
            std::string::npos)
      << line(e, "mine").failed;
}

// ---- commands

constexpr LayerName kKnown[] = {layer::albedo, layer::normal, layer::coverage};

ExternalFilter command(const std::string& words, const std::filesystem::path& folder = ".",
                       const std::vector<std::string>& layers = {}) {
  return command_filter({.command = words, .folder = folder, .layers = layers}, kKnown);
}

std::string refusal(const std::string& words, const std::vector<std::string>& layers = {}) {
  try {
    command(words, ".", layers);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(CommandFilter, PlacesSayWhatItReads) {
  const ExternalFilter plain = command("cp {color.pfm} {output.pfm}");
  EXPECT_TRUE(plain.layers.empty() && !plain.guides && !plain.statistics);
  EXPECT_EQ(plain.words, "cp {color.pfm} {output.pfm}");
  const ExternalFilter three = command("cp {color.pfm} {albedo.pfm} {normal.exr} {output}", ".", {"albedo"});
  EXPECT_EQ(three.layers, (std::vector<LayerName>{layer::albedo, layer::normal})) << "each once";
  EXPECT_FALSE(three.statistics);
  EXPECT_TRUE(command("cp {albedo.half_a.pfm} {output}").statistics);
  EXPECT_TRUE(command("cp {color.mean_variance.exr} {output}").layers.empty());
  EXPECT_TRUE(command("cp {guide.opacity.pfm} {output}").guides);
  EXPECT_TRUE(command("cp {frame} {output}", ".", {"guides"}).guides);
}

TEST(CommandFilter, WhatItsWordsGetWrongIsNamed) {
  const std::string place = refusal("cp {fram} {output}");
  EXPECT_NE(place.find("no place '{fram}' in a command; did you mean '{frame}'? Known: {frame}, {output}, "),
            std::string::npos)
      << place;
  EXPECT_NE(refusal("cp {albdo.pfm} {output}").find("no layer 'albdo' for {albdo.pfm}; did you mean 'albedo'?"),
            std::string::npos);
  EXPECT_NE(refusal("cp {frame} {output}", {"nrmal"}).find("no layer 'nrmal' for layers; did you mean 'normal'?"),
            std::string::npos);
  EXPECT_NE(refusal("cp {frame}").find("does not say where its picture goes: expected {output}"), std::string::npos);
  EXPECT_NE(refusal("cp {output}").find("reads nothing of the frame: expected {frame}"), std::string::npos);
  EXPECT_NE(refusal("cp {frame} {output} {output.pfm}").find("to both output.exr and output.pfm"), std::string::npos);
  EXPECT_NE(refusal("cp {frame").find("'{' is not closed"), std::string::npos);
  EXPECT_NE(refusal("cp frame} {output}").find("'}' closes none"), std::string::npos);
  EXPECT_NE(refusal("").find("has no words"), std::string::npos);
  EXPECT_NE(refusal("brume_no_program {frame} {output}").find("no program 'brume_no_program' in the folders of PATH"),
            std::string::npos);
  EXPECT_NE(refusal("./brume_no_program {frame} {output}").find("brume_no_program: no such program"),
            std::string::npos);
  EXPECT_NE(refusal("sh missing.sh {frame} {output}").find("missing.sh: no such file"), std::string::npos);
  EXPECT_NE(refusal("{frame} {output}").find("begins with a place to fill in"), std::string::npos);
  EXPECT_NE(refusal("cp {frame} {output} | cat").find("'|' would be for a shell"), std::string::npos);
}

TEST(CommandFilter, IsCalledAsItsScript) {
  EXPECT_EQ(command_label("python3 -u scripts/mine.py {frame} {output}"), "mine");
  EXPECT_EQ(command_label("/opt/oidn/bin/oidnDenoise --hdr {color.pfm} -o {output.pfm}"), "oidnDenoise");
}

TEST(CommandFilter, ItsKeyIsAllThatDecidesItsResult) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "mine.sh", "cp $1 $2\n");
  test::write_file(folder / "weights.bin", "1");
  std::filesystem::create_directory(folder / "helpers");
  test::write_file(folder / "helpers/a.py", "1");
  CommandFilter settings{.command = "sh mine.sh {frame} {output} --weights=weights.bin", .folder = folder.path()};
  settings.depends = {folder / "helpers"};
  std::set<std::string> keys;
  const auto is_new = [&] {
    return keys.insert(external_contender(command_filter(settings, kKnown), "mine").external->key).second;
  };
  EXPECT_TRUE(is_new());
  EXPECT_FALSE(is_new());
  settings.memory_limit = 1e9;
  EXPECT_FALSE(is_new()) << "a limit decides whether there is a result, not which";
  for (const char* file : {"mine.sh", "weights.bin", "helpers/a.py", "helpers/b.py"}) {
    test::write_file(folder / file, "cp $1 $2 # changed\n");
    EXPECT_TRUE(is_new()) << file;
    EXPECT_FALSE(is_new()) << file;
  }
  test::write_file(folder / "unrelated", "changed");
  EXPECT_FALSE(is_new());
  settings.statistics = true;
  EXPECT_TRUE(is_new());
  settings.layers = {"albedo"};
  EXPECT_TRUE(is_new());
  settings.command += " --more";
  EXPECT_TRUE(is_new());
}

/// The line of a command, run in a folder.
MethodResult run_command_filter(const std::string& words, const std::filesystem::path& folder, double time_limit = 0,
                                double memory_limit = 0, std::vector<std::string> layers = {}) {
  const test::TemporaryFolder cache_folder;
  const Cache cache(cache_folder.path(), "test");
  Contender contender = external_contender(
      command_filter({.command = words, .folder = folder, .layers = std::move(layers), .memory_limit = memory_limit},
                     kKnown),
      "mine");
  contender.time_limit = time_limit;
  return line(evaluated(settings_for({contender}), cache, made_up_scene()), "mine");
}

TEST(CommandFilter, RunsInItsFolderAndLeavesNothing) {
  const test::TemporaryFolder folder, scratch;
  setenv("TMPDIR", scratch.path().c_str(), 1);
  test::write_file(folder / "mine.sh", "echo \"$3 $4 $5 $OMP_NUM_THREADS {\" >>told; ls $6 >listed; cp $1 $2\n");
  const MethodResult m =
      run_command_filter("sh mine.sh {frame} {output} {spp} {seed} {threads} {folder} {{}}", folder.path());
  unsetenv("TMPDIR");
  EXPECT_EQ(m.failed, "");
  EXPECT_NEAR(m.example.at("R")(3, 3), 1.51, 1e-6);
  EXPECT_GT(m.filter_seconds, 0);
  EXPECT_GT(m.exchange_seconds.value_or(0), 0);
  EXPECT_EQ(test::read_file(folder / "told").substr(0, 12), "4 1 2 2 {\n4 ")
      << "two runs of less than a second for each seed";
  EXPECT_EQ(test::read_file(folder / "listed"), "frame.exr\n");
  EXPECT_TRUE(std::filesystem::is_empty(scratch.path()));
}

TEST(CommandFilter, LayersAreFilesByThemselves) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "mine.sh", "cp $1 $2 $3 $4 $5 .; cp $1 $6\n");
  const MethodResult m = run_command_filter(
      "sh mine.sh {color.pfm} {albedo.mean_variance.pfm} {coverage.exr} {guide.depth.pfm} {normal.exr} {output.pfm}",
      folder.path());
  ASSERT_EQ(m.failed, "");
  const auto first = [&](const char* file, const char* channel) {
    const std::filesystem::path path = folder / file;
    return (path.extension() == ".pfm" ? read_pfm(path) : read_exr(path)).at(channel)(0, 0);
  };
  EXPECT_NEAR(first("color.pfm", "B"), 1.52, 1e-6) << "the second seed's";
  EXPECT_EQ(first("albedo.mean_variance.pfm", "G"), 5);
  EXPECT_EQ(first("coverage.exr", "Y"), 1);
  EXPECT_EQ(first("guide.depth.pfm", "Y"), 3);
  EXPECT_EQ(first("normal.exr", "R"), 0.25f);
  const std::string missing = run_command_filter("cp {guide.spread.pfm} {output.pfm}", folder.path()).failed;
  EXPECT_NE(missing.find("the frame has no layer for {guide.spread.pfm}; its channels are A, B, G, R, "),
            std::string::npos)
      << missing;
}

TEST(CommandFilter, HowItEndedIsTold) {
  const test::TemporaryFolder folder;
  const auto failed = [&](const std::string& script, double time_limit = 0, double memory_limit = 0) {
    test::write_file(folder / "mine.sh", script + "\n");
    return run_command_filter("sh mine.sh {color.pfm} {output.pfm}", folder.path(), time_limit, memory_limit).failed;
  };
  EXPECT_EQ(failed("cp $1 $2"), "");
  EXPECT_EQ(failed("echo first >&2; echo 'the reason' >&2; exit 3"),
            "seed 1: ended with exit status 3; its last words: first / the reason");
  EXPECT_EQ(failed("exit 4"), "seed 1: ended with exit status 4 without a word");
  EXPECT_EQ(failed("kill -SEGV $$"), "seed 1: was ended by signal 11 (Segmentation fault) without a word");
  EXPECT_EQ(failed("echo done"), "seed 1: wrote no picture to {output.pfm}; its last words: done");
  EXPECT_EQ(
      failed("echo PF >$2"),
      "seed 1: its picture cannot be read: damaged: expected width, height and a scale that is not 0 after PF without a word");
  EXPECT_EQ(failed("mkfifo $2"), "seed 1: made {output.pfm} a named pipe; expected a file without a word");
  EXPECT_EQ(failed("mkdir $2"), "seed 1: made {output.pfm} a folder; expected a file without a word");
  EXPECT_EQ(failed("ln -s /dev/zero $2"), "seed 1: made {output.pfm} a device; expected a file without a word");
  EXPECT_EQ(failed("echo \"cannot open $1\" >&2; exit 1"),
            "seed 1: ended with exit status 1; its last words: cannot open {folder}/color.pfm");
  EXPECT_EQ(failed("printf 'PF\\n1 1\\n-1\\nabcdefghijkl' >$2"),
            "seed 1: its picture has 1 x 1 pixels, expected 9 x 7 as the frame");
  EXPECT_EQ(failed("echo at work; sleep 1000", 0.2),
            "seed 1: took longer than 0.2 s and was ended; its last words: at work");
  const std::string large = failed("dd if=/dev/zero of=/dev/null bs=300M count=1000000", 0, 100e6);
  EXPECT_NE(large.find(" GB, more than the 0.1 GB that it may, and was ended"), std::string::npos) << large;
}

TEST(CommandFilter, ItsScratchFolderIsNamedInNoMessage) {
  const test::TemporaryFolder folder, scratch;
  setenv("TMPDIR", scratch.path().c_str(), 1);
  test::write_file(folder / "mine.sh", "echo no picture >$2\n");
  const std::string failed = run_command_filter("sh mine.sh {frame} {output}", folder.path()).failed;
  EXPECT_NE(failed.find("its picture cannot be read"), std::string::npos) << failed;
  EXPECT_EQ(failed.find(scratch.path().string()), std::string::npos) << failed;
  setenv("TMPDIR", (folder / "nowhere").c_str(), 1);
  std::string told;
  try {
    const ScratchFolder none;
  } catch (const InputError& error) {
    told = error.what();
  }
  unsetenv("TMPDIR");
  EXPECT_EQ(told, (folder / "nowhere").string() +
                      ": the folder for temporary files (TMPDIR) is not there; expected a folder");
}

}  // namespace
}  // namespace brume
