#include "evaluate/protocol/protocol.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/rng.h"
#include "evaluate/protocol/overall.h"
#include "evaluate/protocol/speed.h"
#include "evaluate/protocol/tuning.h"
#include "evaluate/report/report.h"
#include "evaluate/report/table.h"
#include "filters/api/registry.h"
#include "image/exr_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

/// A renderer that needs no renderer: a smooth picture with an edge, noise falling as 1 / sqrt(spp).
TimedFrame synthetic(int spp, int64_t seed) {
  Layers frame(48, 32);
  Rng rng(static_cast<uint64_t>(seed) * 1000 + static_cast<uint64_t>(spp));
  for (const LayerName& l : {layer::indirect, layer::direct, layer::gradient, layer::beauty}) frame.add_rgb(l);
  for (int y = 0; y < 32; ++y)
    for (int x = 0; x < 48; ++x) {
      const bool medium = x >= 12;
      frame.add("coverage.A")(x, y) = medium;
      frame.add("A")(x, y) = medium;
      frame.add("gradient.X")(x, y) = medium;
      for (size_t c = 0; c < 3; ++c) {
        const double noise = medium ? 0.8 / std::sqrt(spp) * std::sqrt(12.0) * (rng.uniform() - 0.5) : 0;
        const float indirect = medium ? static_cast<float>(0.3 + 0.004 * y + noise) : 0.0f;
        (*frame.add_rgb(layer::indirect)[c])(x, y) = indirect;
        (*frame.add_rgb(layer::direct)[c])(x, y) = 0.1f;
        (*frame.add_rgb(layer::beauty)[c])(x, y) = indirect + 0.1f;
      }
    }
  return {std::move(frame), spp * 0.01};
}

std::vector<EvaluationScene> two_scenes() {
  std::vector<EvaluationScene> scenes;
  for (const int64_t shift : {0, 77})
    scenes.push_back({.name = shift ? "smoke" : "cloud",
                      .hash = shift ? "02" : "01",
                      .render = [shift](const FrameRequest& request, const Task&) {
                        return synthetic(request.spp, request.seed + shift);
                      }});
  return scenes;
}

Evaluation run(bool tune) {
  EvaluationSettings settings;
  settings.spp = {16, 64};
  settings.seeds = 5;
  settings.reference_spp = 4000;
  settings.tune = tune;
  for (const char* name :
       {"bilateral", "gaussian", "gradient_kernel:variant=mul", "extended_bilateral", "gradient_kernel"})
    settings.contenders.push_back(parse_contender(name));
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  const std::vector<EvaluationScene> scenes = two_scenes();
  size_t stages = 0;
  const Evaluation result = evaluate(scenes, settings, cache, [&](const std::string&) {
    ++stages;
    return Task{2, {}, nullptr};
  });
  EXPECT_EQ(stages, stage_count(scenes, settings));
  return result;
}

TEST(Evaluate, FillsEveryLineWithWhatItMeasured) {
  const Evaluation e = run(true);
  ASSERT_EQ(e.scenes.size(), 2u);
  for (const SceneResult& scene : e.scenes) {
    EXPECT_NEAR(scene.medium_share, 0.75, 1e-9);
    EXPECT_EQ(scene.methods.size(), 2u * (1 + 5 * 3 + 4));
    EXPECT_GT(scene.reference_rms, 0);
    for (const int spp : {16, 64}) {
      const MethodResult* plain = scene.find("", Tuning::kNone, spp);
      ASSERT_TRUE(plain);
      EXPECT_EQ(plain->whole().count, 5u);
      EXPECT_NEAR(plain->medium().mean / plain->whole().mean, 1 / std::sqrt(0.75), 0.01)
          << "the background has no error";
      EXPECT_DOUBLE_EQ(plain->render_seconds, spp * 0.01);
      for (const Contender& f : e.settings.contenders) {
        const MethodResult *untuned = scene.find(f.label, Tuning::kDefault, spp),
                           *best = scene.find(f.label, Tuning::kSearched, spp);
        EXPECT_LT(untuned->whole().mean, plain->whole().mean) << f.label;
        // Searched on another frame, so it may lose to the default by a hair where that is not among the candidates.
        EXPECT_LT(best->whole().mean, 1.1 * untuned->whole().mean) << f.label;
        EXPECT_GT(untuned->filter_seconds, 0);
        EXPECT_FALSE(best->parameters.empty());
      }
    }
    EXPECT_NEAR(scene.find("", Tuning::kNone, 16)->whole().mean / scene.find("", Tuning::kNone, 64)->whole().mean, 2.0,
                0.15);
  }
}

TEST(Evaluate, ReportsHoldTheSameNumbers) {
  const Evaluation e = run(false);
  const std::string md = markdown_report(e), csv = csv_report(e);
  EXPECT_NE(md.find("clipped to [0, 1] before the conversion"), std::string::npos) << "the policy is stated";
  EXPECT_NE(md.find("| 2.09 | 65 |"), std::string::npos) << "the paper's numbers stand beside ours";
  EXPECT_NE(md.find("Does the paper's order hold?"), std::string::npos);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + 2 * 2 * (6 + 4));
  const auto json = nlohmann::json::parse(json_report(e));
  const MethodResult* m = e.scenes[0].find("bilateral", Tuning::kPaper, 16);
  bool found = false;
  for (const auto& j : json["rows"])
    if (j["scene"] == "cloud" && j["method"] == "bilateral_paper" && j["spp"] == 16 && j["region"] == "frame") {
      found = true;
      EXPECT_DOUBLE_EQ(j["metrics"]["lab_rms"]["mean"].get<double>(), m->whole().mean);
      EXPECT_EQ(j["paper"]["rms"].get<double>(), 2.09);
    }
  EXPECT_TRUE(found);
}

TEST(Evaluate, WritesTablesStripsPlotsAndFrames) {
  const test::TemporaryFolder folder;
  const Evaluation e = run(false);
  write_report(e, folder.path());
  for (const char* name : {"table.md", "table.csv", "results.json", "cloud_error_seconds.svg",
                           "smoke_error_seconds.svg", "cloud_16spp_paper.png", "smoke_64spp_paper.png",
                           "cloud_reference.exr", "cloud_16spp_noisy.exr", "smoke_64spp_gradient_kernel_paper.exr"})
    EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
  // Every picture the table shows is there.
  const std::string md = test::read_file(folder / "table.md");
  for (size_t at = md.find("]("); at != std::string::npos; at = md.find("](", at + 1)) {
    const std::string name = md.substr(at + 2, md.find(')', at) - at - 2);
    EXPECT_TRUE(std::filesystem::exists(folder / name)) << name;
  }
  const Layers frame = read_exr(folder / "smoke_64spp_gradient_kernel_paper.exr");
  EXPECT_EQ(frame.text("filter"), "gradient_kernel");
}

TEST(Tuning, FindsThePlantedBest) {
  const TimedFrame noisy = synthetic(16, 5), reference = synthetic(1 << 20, 6);
  const LabRms metric(reference.layers.rgb(layer::beauty), nullptr, {}, {});
  TuningFrame frame(noisy.layers, {}, {}, metric, "");
  const Contender gaussian = parse_contender("gaussian");
  const FilterSettings best = search(gaussian, {&frame}, 0, {});
  // A slope and an edge of no width to keep within the medium: the widest blur wins.
  EXPECT_NE(best.text().find("sigma=4"), std::string::npos) << best.text();
  const double lowest = frame.squared_errors(gaussian, {best}, {})[0];
  for (const double e : frame.squared_errors(gaussian, candidate_settings(gaussian), {})) EXPECT_LE(lowest, e);
}

TEST(Tuning, StartsFromThePublishedParametersWhereTheyAreBetter) {
  const TimedFrame noisy = synthetic(16, 5), reference = synthetic(1 << 20, 6);
  const LabRms metric(reference.layers.rgb(layer::beauty), nullptr, {}, {});
  TuningFrame frame(noisy.layers, {}, {}, metric, "");
  Contender contender = parse_contender("gaussian:sigma=0.4,average=linear");
  contender.paper = parse_filter("gaussian:sigma=2,radius=9");
  EXPECT_EQ(search(contender, {&frame}, 0, {}).text(), contender.paper->text());
}

TEST(Contenders, AreEveryFilterAndTheSettingsItDeclares) {
  std::vector<std::string> labels;
  for (const Contender& c : all_contenders()) labels.push_back(c.label);
  size_t expected = 0;
  for (const FilterEntry* e : all_filters()) {
    // Whose records are large is there only when asked for.
    const bool there = e->records != FilterEntry::Records::kNeeds;
    EXPECT_EQ(std::count(labels.begin(), labels.end(), e->name), there) << e->name;
    expected += there ? 1 + e->also_compare.size() : 0;
  }
  EXPECT_EQ(labels.size(), expected);
  EXPECT_EQ(std::count(labels.begin(), labels.end(), "gradient_kernel gate"), 1);
  EXPECT_TRUE(parse_contender("gradient_kernel").paper) << "published parameters beside the defaults";
  EXPECT_FALSE(parse_contender("gradient_kernel:variant=gate").paper) << "nobody published our variant";
  // What makes the line is not searched.
  for (const FilterSettings& f : candidate_settings(parse_contender("gradient_kernel:variant=gate")))
    EXPECT_NE(f.text().find("variant=gate"), std::string::npos);
  const Contender bilateral = parse_contender("bilateral:sigma-range=80,sigma-domain=1.5");
  for (const FilterSettings& f : candidate_settings(bilateral))
    EXPECT_NE(f.text().find("sigma-range=80"), std::string::npos) << f.text();
  EXPECT_EQ(on_the_edge(parse_contender("bilateral"), bilateral.settings), std::vector<std::string>{"sigma-range"});
}

TEST(Protocol, RecordsTheUnionOfTheLayersThatTheFiltersDeclare) {
  EvaluationSettings settings;
  settings.contenders = {parse_contender("bilateral")};
  EXPECT_EQ(data_to_record(settings).layers, (std::vector<std::string>{"coverage", "direct", "indirect"}));
  settings.contenders.push_back(parse_contender("gradient_kernel"));
  EXPECT_EQ(data_to_record(settings).layers, (std::vector<std::string>{"coverage", "direct", "gradient", "indirect"}));
  EXPECT_FALSE(data_to_record(settings).statistics);
  settings.contenders = {parse_contender("welch")};
  EXPECT_TRUE(data_to_record(settings).statistics && data_to_record(settings).buckets);
  EXPECT_FALSE(data_to_record(settings).records);
  settings.contenders = {parse_contender("random_parameter")};
  EXPECT_TRUE(data_to_record(settings).records);
  // Features cost the renderer most: only where a setting that will run reads them.
  const auto transmittance = [&] {
    const std::vector<std::string> names = data_to_record(settings).layers;
    return std::find(names.begin(), names.end(), "transmittance") != names.end();
  };
  settings.contenders = {parse_contender("nl_means")};
  EXPECT_TRUE(transmittance()) << "the search tries them";
  settings.tune = false;
  EXPECT_FALSE(transmittance()) << "at its defaults it compares colours";
  settings.tune = true;
  settings.contenders = {parse_contender("nl_means:feature-strength=0")};
  EXPECT_FALSE(transmittance());
}

/// A method of one seed with this time and error.
MethodResult timed(const std::string& filter, int spp, double seconds, double error) {
  MethodResult m;
  m.filter = filter;
  m.tuning = filter.empty() ? Tuning::kNone : Tuning::kDefault;
  m.spp = spp;
  m.parameters = filter;
  m.render_seconds = 0.5 * seconds;
  m.guide_seconds = 0.25 * seconds;
  m.filter_seconds = 0.25 * seconds;
  Errors errors;
  errors.lab_rms = error;
  m.errors[0] = {errors};
  return m;
}

// Path tracing: 4 in 1 s, 2 in 4 s. The gradient kernel: 2 in 1.5 s, 0.8 in 6 s. A slow filter: 1.5 in 10 s, 0.5 in 40
// s.
TEST(Speed, HandComputed) {
  SceneResult scene;
  scene.methods = {timed("", 4, 1, 4),  timed("gradient_kernel", 4, 1.5, 2),  timed("slow", 4, 10, 1.5),
                   timed("", 16, 4, 2), timed("gradient_kernel", 16, 6, 0.8), timed("slow", 16, 40, 0.5)};
  MethodResult published = scene.methods[1];
  published.tuning = Tuning::kPaper;
  scene.methods.push_back(published);  // the same parameters under another name are no method of their own
  std::vector<std::string> front;
  for (const MethodResult* m : pareto_front(scene)) front.push_back(fmt::format("{} {}", m->id(), m->spp));
  EXPECT_EQ(front, (std::vector<std::string>{"noisy 4", "gradient_kernel_default 4", "gradient_kernel_default 16",
                                             "slow_default 16"}));
  const std::vector<TimeToError> times = times_to_error(scene);
  const auto find = [&](const std::string& method, double error) {
    const auto it = std::find_if(times.begin(), times.end(), [&](const TimeToError& t) {
      return t.method->id() == method && std::abs(t.error - error) < 1e-9;
    });
    EXPECT_NE(it, times.end()) << method << " " << error;
    return it == times.end() ? TimeToError{nullptr, 0, 0, {}, {}} : *it;
  };
  const TimeToError own = find("gradient_kernel_default", 1);
  EXPECT_NEAR(own.seconds, 1.5 * std::pow(4.0, std::log(0.5) / std::log(0.4)), 1e-9);
  EXPECT_NEAR(*own.over_path_tracing, 16 / own.seconds, 1e-9) << "half of what takes 4 s takes 16";
  EXPECT_NEAR(*own.over_gradient_kernel, 1, 1e-12);
  const TimeToError slow = find("slow_default", 1);
  EXPECT_NEAR(*slow.over_gradient_kernel, own.seconds / slow.seconds, 1e-9);
  EXPECT_FALSE(find("slow_default", 0.5).over_gradient_kernel) << "it never gets there";
  EXPECT_NEAR(find("noisy", 2).seconds, 4, 1e-9);
}

Judgement judged_by(Region region, const std::string& metric) {
  size_t place = 0;
  while (all_metrics()[place].id != metric) ++place;
  return {region, place};
}

// Over the whole frame the quick filter is as good as the slow one, over the medium worse, and by PSNR nothing beats
// path tracing of 20 dB after 1 s and 26.02 dB, four times less squared error, after 4 s.
TEST(Speed, FollowsRegionAndMetric) {
  SceneResult scene;
  scene.methods = {timed("", 4, 1, 4), timed("", 16, 4, 2), timed("quick", 16, 5, 1), timed("slow", 16, 20, 1)};
  const double medium[] = {8, 4, 3, 1}, decibels[] = {20, 26.0206, 19, 18};
  for (size_t i = 0; i < 4; ++i) {
    MethodResult& m = scene.methods[i];
    m.errors[0][0].psnr = decibels[i];
    m.errors[1] = m.errors[0];
    m.errors[1][0].lab_rms = medium[i];
  }
  const auto front = [&](const Judgement& by) {
    std::string ids;
    for (const MethodResult* m : pareto_front(scene, by)) ids += fmt::format("{}{} ", m->filter, m->spp);
    return ids;
  };
  EXPECT_EQ(front({}), "4 16 quick16 ");
  EXPECT_EQ(front(judged_by(Region::kMedium, "lab_rms")), "4 16 quick16 slow16 ");
  EXPECT_EQ(front(judged_by(Region::kFrame, "psnr")), "4 16 ");
  EXPECT_EQ(front(judged_by(Region::kFrame, "ssim")), "4 ") << "all have the same";

  const auto seconds = [&](const Judgement& by, double error) {
    for (const TimeToError& t : times_to_error(scene, by))
      if (t.method->filter.empty() && std::abs(t.error - error) < 1e-9) return t.seconds;
    return 0.0;
  };
  EXPECT_NEAR(seconds({}, 2), 4, 1e-9);
  EXPECT_NEAR(seconds(judged_by(Region::kMedium, "lab_rms"), 5), std::pow(8 / 5.0, 2), 1e-9);
  EXPECT_NEAR(seconds(judged_by(Region::kFrame, "psnr"), 22), std::pow(10, 0.2), 1e-4) << "time as 1 / squared error";
  EXPECT_EQ(seconds(judged_by(Region::kMedium, "lab_rms"), 2), 0) << "it never gets there";
}

TEST(Speed, OfOneSettingCountsItsMethodsAndPathTracing) {
  SceneResult scene;
  scene.methods = {timed("", 4, 1, 4), timed("ours", 4, 2, 1), timed("theirs", 4, 2.5, 2)};
  scene.methods[2].tuning = Tuning::kPaper;
  EXPECT_EQ(pareto_front(scene).size(), 2u);
  const std::vector<const MethodResult*> front = pareto_front(scene, {}, Tuning::kPaper);
  ASSERT_EQ(front.size(), 2u);
  EXPECT_EQ(front[1]->filter, "theirs") << "what beats it is of another setting";
}

/// Methods of three seeds: the same error times 1, 1.02, .98 of two scenes, but for `wobbly`, which is better on
/// average and not for sure.
Evaluation two_scenes_compared() {
  Evaluation e;
  for (const char* name : {"small", "large"}) {
    SceneResult scene;
    scene.name = name;
    const double scale = name == std::string("small") ? 1 : 100;
    for (const auto& [filter, error, seconds, guides] : {std::tuple{"", 8.0, 0.0, false},
                                                         {"steady", 2.0, 0.25, false},
                                                         {"wobbly", 1.9, 0.75, true},
                                                         {"far", 4.0, 0.25, true}}) {
      MethodResult m;
      m.filter = filter;
      m.tuning = *filter ? Tuning::kDefault : Tuning::kNone;
      m.spp = 16;
      m.parameters = filter;
      m.render_seconds = 1;
      m.filter_seconds = seconds;
      m.reads_guides = guides;
      m.peak_bytes = 1e6 * scale;
      for (const double factor : {1.0, 1.02, 0.98}) {
        Errors errors;
        errors.lab_rms = error * scale * (filter == std::string("wobbly") ? std::pow(factor, 10) : factor);
        errors.psnr = 30 - error;
        m.errors[0].push_back(errors);
      }
      scene.methods.push_back(std::move(m));
    }
    e.scenes.push_back(std::move(scene));
  }
  return e;
}

TEST(OverallAnswer, IsTheGeometricMeanOverScenesWithTiesByPairs) {
  const Evaluation e = two_scenes_compared();
  const std::optional<Overall> answer = overall(e, {}, Tuning::kDefault);
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->scenes, (std::vector<std::string>{"small", "large"}));
  EXPECT_EQ(answer->spp, std::vector<int>{16});
  EXPECT_EQ(answer->seeds, 3u);
  EXPECT_TRUE(answer->geometric);
  ASSERT_EQ(answer->methods.size(), 4u);
  const OverallMethod &best = answer->methods[0], &second = answer->methods[1];
  EXPECT_EQ(best.method->filter, "wobbly");
  EXPECT_EQ(best.level_with, std::vector<size_t>{1}) << "the steady one, and not the far ones";
  EXPECT_TRUE(best.reads_guides);
  EXPECT_EQ(second.method->filter, "steady");
  EXPECT_NEAR(second.value, 20, 1e-9) << "the root of 2 times 200";
  EXPECT_NEAR(*second.times_less_than_noisy, 4, 1e-9);
  EXPECT_TRUE(second.level_with.empty());
  EXPECT_EQ(second.most_seconds, 0.25) << "rendering is not in it";
  EXPECT_EQ(*second.most_bytes, 1e8);
  EXPECT_FALSE(overall(e, {}, Tuning::kSearched)) << "nothing was";
  EXPECT_FALSE(overall(e, judged_by(Region::kMedium, "lab_rms"), {})) << "no scene has a medium";
  EXPECT_FALSE(overall(e, judged_by(Region::kFrame, "relative_bias"), {}));
  const std::optional<Overall> decibels = overall(e, judged_by(Region::kFrame, "psnr"), {});
  EXPECT_FALSE(decibels->geometric);
  EXPECT_NEAR(decibels->methods[0].value, 28.1, 1e-9);
}

TEST(OverallAnswer, LeavesOutWhatHasNoNumberSomewhere) {
  Evaluation e = two_scenes_compared();
  e.scenes[1].methods[2].failed = "no memory";
  e.scenes[1].methods[2].forget_errors();
  std::optional<Overall> answer = overall(e, {}, {});
  ASSERT_EQ(answer->methods.size(), 3u);
  EXPECT_EQ(answer->methods[0].method->filter, "steady");
  ASSERT_EQ(answer->left_out.size(), 1u);
  EXPECT_EQ(answer->left_out[0],
            (std::pair<std::string, std::string>("wobbly_default", "failed on large, 16 spp: no memory")));
  // An error of zero has no logarithm.
  e.scenes[0].methods[1].errors[0][2].lab_rms = 0;
  answer = overall(e, {}, {});
  EXPECT_FALSE(answer->geometric);
  EXPECT_NEAR(answer->methods[0].value, 0.5 * (2 * (1 + 1.02) / 3 + 200), 1e-9);
}

// The truth of the synthetic scenes is known: the mean of many samples.
TEST(Evaluate, TellsTheReferencesOwnErrorByRegionAndMetric) {
  EvaluationSettings settings;
  settings.spp = {4};
  settings.seeds = 1;
  settings.reference_spp = 64;
  settings.tune = false;
  settings.contenders = {parse_contender("gaussian")};
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  const Evaluation e = evaluate(two_scenes(), settings, cache, [](const std::string&) { return Task{2, {}, nullptr}; });
  const SceneResult& scene = e.scenes[0];
  const TimedFrame truth = synthetic(1 << 30, 1);
  const std::vector<Errors> found = compare_regions(scene.reference.rgb(layer::beauty), truth.layers.rgb(layer::beauty),
                                                    scene.policy, {Mask{}, scene.mask}, nullptr, ErrorScope::kPixels);
  for (const Region region : kRegions)
    for (const char* metric : {"lab_rms", "lab_rms_unclipped", "mse", "rel_mse", "psnr"}) {
      const Judgement by = judged_by(region, metric);
      const double expected = as_error(by.info(), values_of({found[static_cast<size_t>(region)]}, by.metric)[0]);
      ASSERT_TRUE(scene.reference_error(by)) << metric;
      EXPECT_NEAR(as_error(by.info(), *scene.reference_error(by)), expected, 0.1 * expected) << metric;
    }
  EXPECT_FALSE(scene.reference_error(judged_by(Region::kFrame, "ssim"))) << "no law is known";
}

TEST(Tuning, TriesEveryCombinationWhereThereAreFew) {
  const TimedFrame noisy = synthetic(16, 5), reference = synthetic(1 << 20, 6);
  const LabRms metric(reference.layers.rgb(layer::beauty), nullptr, {}, {});
  TuningFrame frame(noisy.layers, {}, {}, metric);
  const Contender contender = parse_contender("bilateral:noise-factor=0,average=linear,sigma-range=40");
  std::vector<FilterSettings> all = candidate_settings(contender);
  ASSERT_GT(all.size(), 3u);
  const std::vector<double> errors = frame.squared_errors(contender, all, {2, {}, nullptr});
  const FilterSettings found = search(contender, {&frame}, 0, {2, {}, nullptr});
  EXPECT_EQ(frame.squared_errors(contender, {found}, {})[0], *std::min_element(errors.begin(), errors.end()));
}

TEST(Tuning, MorePlacesToBeginFromAreNeverWorse) {
  const TimedFrame noisy = synthetic(16, 5), reference = synthetic(1 << 20, 6);
  const LabRms metric(reference.layers.rgb(layer::beauty), nullptr, {}, {});
  TuningFrame frame(noisy.layers, {}, {}, metric);
  const Contender contender = parse_contender("gradient_kernel");
  double before = 1e300;
  for (const int restarts : {0, 1, 3}) {
    const FilterSettings found = search(contender, {&frame}, restarts, {2, {}, nullptr});
    const double error = frame.squared_errors(contender, {found}, {})[0];
    EXPECT_LE(error, before) << restarts;
    EXPECT_EQ(found.text(), search(contender, {&frame}, restarts, {1, {}, nullptr}).text()) << "the same every time";
    before = error;
  }
}

// References begin with much noise and are rendered on until it is a tenth of the best method's error.
TEST(Evaluate, ReferencesAreRenderedUntilTheirNoiseIsSmall) {
  const test::TemporaryFolder folder;
  const Cache cache(folder.path(), "test");
  EvaluationSettings settings;
  settings.spp = {16};
  settings.seeds = 2;
  settings.reference_spp = 64;
  settings.reference_noise = 0.1;
  settings.tune = false;
  settings.metrics = {"lab_rms"};
  settings.contenders = {parse_contender("gaussian")};
  const std::vector<EvaluationScene> scenes = two_scenes();
  const Evaluation e = evaluate(scenes, settings, cache, [](const std::string&) { return Task{2, {}, nullptr}; });
  for (const SceneResult& scene : e.scenes) {
    double best = 1e300;
    for (const MethodResult& m : scene.methods) best = std::min(best, m.whole().mean);
    EXPECT_LE(scene.reference_rms / std::sqrt(2.0), 0.1 * best);
    EXPECT_GT(scene.reference_spp, 64);
    EXPECT_GT(2 * scene.reference_rms / std::sqrt(2.0), 0.1 * best) << "and no longer";
  }
}

TEST(Tables, EscapeWhatTheirFormatsMeanOtherwise) {
  const Table table{"Title", "", {{"a|b", false}, {"c,d"}}, {{"x_y", "1 \"2\""}}, {{"made", "50 % & more"}}};
  EXPECT_EQ(table.markdown_grid(), "| a\\|b | c,d |\n|---|---:|\n| x_y | 1 \"2\" |\n");
  EXPECT_EQ(table.csv(), "a|b,\"c,d\",made\nx_y,\"1 \"\"2\"\"\",50 % & more\n");
}

}  // namespace
}  // namespace brume
