// Parts, checkpoints, interruptions and crops: every way to take the same samples gives the same bits.

#include <gtest/gtest.h>

#include <atomic>

#include "base/error.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "render/session/render_state.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

class PartsTest : public ::testing::Test {
 protected:
  PartsTest() {
    scene_ = read_scene(test::source("data/scenes/smoke.toml"));
    scene_.film.width = 37;
    scene_.film.height = 21;
  }
  const PreparedScene& prepared() {
    if (!prepared_) prepared_ = std::make_unique<PreparedScene>(scene_, LayerRequest::of({"all"}, true, true));
    return *prepared_;
  }
  RenderJob job(int spp) {
    RenderJob j;
    j.spp = spp;
    j.seed = 5;
    j.program = "brume test";
    return j;
  }
  std::filesystem::path part(int i, int n, int spp = 13) {
    RenderJob j = job(spp);
    j.part = i;
    j.parts = n;
    j.keep_state = true;
    const auto path = folder_ / ("part" + std::to_string(i) + "_" + std::to_string(n) + ".exr");
    write_exr(path, prepared().render(j, {}).layers);
    return path;
  }
  static std::string error_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  }
  Scene scene_;
  std::unique_ptr<PreparedScene> prepared_;
  test::TemporaryFolder folder_;
};

TEST_F(PartsTest, AnyNumberOfPartsMergesToTheWholeBitForBit) {
  const Layers whole = prepared().render(job(13), {}).layers;
  for (const int n : {1, 2, 3, 5}) {
    std::vector<std::filesystem::path> files;
    for (int i = n; i >= 1; --i) files.push_back(part(i, n));  // in any order
    const Layers merged = merge_parts(files, false);
    test::expect_same_bits(whole, merged);
    EXPECT_EQ(merged.text("sampleRanges"), "0-13");
    EXPECT_EQ(merged.number("partsMerged"), n);
    EXPECT_TRUE(merged.words().empty());
  }
}

// Counted once: in parts, in their merge, in a checkpoint and in what goes on from it.
TEST_F(PartsTest, WhatTheIndirectLimitTookIsCountedOverAllParts) {
  scene_.render.indirect_limit = 0.2 / scene_.film.exposure;
  const Layers whole = prepared().render(job(13), {}).layers;
  const auto expect_counts = [&](const Layers& frame, const char* what) {
    EXPECT_EQ(frame.number("indirectLimitPaths"), whole.number("indirectLimitPaths")) << what;
    for (const char* key : {"indirectLimitTaken", "indirectLimitFound"})
      EXPECT_NEAR(*frame.number(key), *whole.number(key), 1e-6 * *whole.number(key)) << what << " " << key;
    EXPECT_EQ(frame.text("biased"), "true: paths were limited by indirect_limit") << what;
    test::expect_same_bits(whole, frame, what);
  };
  EXPECT_GT(*whole.number("indirectLimitPaths"), 100);
  expect_counts(merge_parts({part(1, 3), part(2, 3), part(3, 3)}, false), "parts");
  RenderJob first = job(5);
  first.checkpoint = folder_ / "checkpoint.exr";
  prepared().render(first, {});
  RenderJob rest = job(13);
  rest.resume = first.checkpoint;
  expect_counts(prepared().render(rest, {}).layers, "resumed");
}

TEST_F(PartsTest, PartsMergeStepByStep) {
  const auto a = part(1, 3), b = part(2, 3), c = part(3, 3);
  write_exr(folder_ / "ac.exr", merge_parts({a, c}, true));
  EXPECT_EQ(read_exr_info(folder_ / "ac.exr").header.at("sampleRanges"), Attribute(std::string("0-4,8-13")));
  test::expect_same_bits(prepared().render(job(13), {}).layers, merge_parts({folder_ / "ac.exr", b}, false));
}

TEST_F(PartsTest, WhatDoesNotBelongTogetherIsRefused) {
  const auto a = part(1, 2), b = part(2, 2);
  EXPECT_NE(error_of([&] { merge_parts({a, b, a}, false); }).find("overlap: samples 0 .. 5"), std::string::npos);
  const auto other = [&](const std::function<void(Scene&, RenderJob&)>& change) {
    Scene s = scene_;
    RenderJob j = job(13);
    j.part = 2;
    j.parts = 2;
    j.keep_state = true;
    change(s, j);
    write_exr(folder_ / "other.exr", PreparedScene(s, LayerRequest::of({"all"}, true, true)).render(j, {}).layers);
    return error_of([&] { merge_parts({a, folder_ / "other.exr"}, false); });
  };
  EXPECT_EQ(other([](Scene&, RenderJob&) {}), "");
  EXPECT_NE(other([](Scene&, RenderJob& j) { j.seed = 6; }).find("the seed is 6 in the first, 5 in the second"),
            std::string::npos);
  EXPECT_NE(other([](Scene& s, RenderJob&) { s.hash = "another"; }).find("the scene's fingerprint is another"),
            std::string::npos);
  EXPECT_NE(other([](Scene&, RenderJob& j) { j.program = "brume old"; }).find("the program version is brume old"),
            std::string::npos);
  EXPECT_NE(other([](Scene&, RenderJob& j) {
              j.crop = RenderJob::Crop{0, 0, 9, 9};
            }).find("the crop is 0,0,9,9 of 37 x 21"),
            std::string::npos);
  EXPECT_NE(other([](Scene&, RenderJob& j) { j.spp = 26; }).find("a part of a render of 13 samples per pixel"),
            std::string::npos);
  // But a finished frame goes on with the later samples of a longer one.
  RenderJob later = job(26);
  later.part = 2;
  later.parts = 2;
  later.keep_state = true;
  write_exr(folder_ / "later.exr", prepared().render(later, {}).layers);
  RenderJob all = job(13);
  all.keep_state = true;
  write_exr(folder_ / "all.exr", prepared().render(all, {}).layers);
  const Layers longer = merge_parts({folder_ / "all.exr", folder_ / "later.exr"}, false);
  test::expect_same_bits(prepared().render(job(26), {}).layers, longer);
  EXPECT_EQ(longer.number("sampleTotal"), 26);
  write_exr(folder_ / "plain.exr", prepared().render(job(2), {}).layers);
  EXPECT_NE(error_of([&] {
              merge_parts({a, folder_ / "plain.exr"}, false);
            }).find("holds no sums of its samples"),
            std::string::npos);
}

// Cut after any number of tiles, and again, and gone on with: the same bits as in one go, with more samples too.
TEST_F(PartsTest, InterruptedAndResumedIsAsIfNothingHadHappened) {
  const Layers whole = prepared().render(job(24), {}).layers;
  RenderJob j = job(16);
  j.checkpoint = folder_ / "state.exr";
  int cuts = 0;
  for (int attempt = 0; attempt < 12; ++attempt) {
    std::atomic<bool> cancel{false};
    int tiles = 0;
    j.watch = [&](const Film&, int) { cancel = ++tiles > 3 + 2 * attempt; };
    try {
      prepared().render(j, {1, {}, &cancel});
      break;
    } catch (const Interrupted& stopped) {
      ++cuts;
      EXPECT_NE(std::string(stopped.what()).find("--resume"), std::string::npos);
    }
    j.resume = j.checkpoint;
  }
  EXPECT_GE(cuts, 2);
  j.resume = j.checkpoint;
  j.watch = nullptr;
  j.spp = 24;
  const Layers resumed = prepared().render(j, {}).layers;
  test::expect_same_bits(whole, resumed);
  EXPECT_EQ(resumed.number("samplesPerPixel"), 24);
  // A finished checkpoint merges like a part; one of another seed is no state to go on from.
  test::expect_same_bits(whole, merge_parts({j.checkpoint}, false));
  j.seed = 6;
  EXPECT_NE(error_of([&] { prepared().render(j, {}); }).find("the seed"), std::string::npos);
}

/// Rounds in which tiles are given different numbers of samples, as a filter's error estimate gives them.
NextRound uneven_rounds(const RenderRound& round) {
  NextRound next;
  next.error = 0.1 / round.film.taken(0);
  EXPECT_EQ(round.earlier.size(), round.film.taken(0) - 3) << "rounds before a checkpoint are not forgotten";
  for (const RoundError& e : round.earlier) EXPECT_GE(e.error, 0.1 / (round.film.taken(0) - 1));
  for (int tile = 0; tile < round.film.tile_count(); ++tile)
    next.goals.push_back(round.film.taken(tile) * (tile % 2 ? 2 : 1) + 1);
  next.samples_needed = 40.0 * round.film.width() * round.film.height();
  return next.goals[1] > 40 ? NextRound() : next;
}

TEST_F(PartsTest, RoundsThatAreInterruptedGoOnAsIfNothingHadHappened) {
  RenderJob j = job(1 << 20);
  j.guide_samples = 4;
  j.first_round = 3;
  j.next_round = uneven_rounds;
  const RenderResult whole = prepared().render(j, {});
  EXPECT_EQ(whole.report.most_samples_per_pixel, 31);
  EXPECT_EQ(whole.report.samples_per_pixel, 6);
  EXPECT_EQ(whole.layers.number("samplesPerPixelMost"), 31);
  j.checkpoint = folder_ / "state.exr";
  int cuts = 0;
  for (bool done = false; !done;) {
    std::atomic<bool> cancel{false};
    int tiles = 0;
    j.watch = [&](const Film&, int) { cancel = ++tiles > 4; };
    try {
      test::expect_same_bits(whole.layers, prepared().render(j, {1, {}, &cancel}).layers);
      done = true;
    } catch (const Interrupted&) {
      ++cuts;
    }
    j.resume = j.checkpoint;
  }
  EXPECT_GE(cuts, 3);
  // Each tile has samples of its own, which no part of other samples can join.
  EXPECT_NE(error_of([&] {
              merge_parts({j.checkpoint, part(2, 2)}, false);
            }).find("was rendered in rounds"),
            std::string::npos);
}

// What a bar shows between rounds is the way to the target, not the way through the round.
TEST_F(PartsTest, ProgressOfRoundsIsThatOfTheWholeRender) {
  RenderJob j = job(1 << 20);
  j.guide_samples = 4;
  j.first_round = 3;
  double last = 0, largest_in_first_round = 0, largest = 0;
  int rounds = 0;
  j.next_round = [&](const RenderRound& round) {
    ++rounds;
    return uneven_rounds(round);
  };
  const auto report = [&](double fraction) {
    last = fraction;
    if (rounds == 0) largest_in_first_round = std::max(largest_in_first_round, fraction);
    if (fraction < 1) largest = std::max(largest, fraction);
  };
  prepared().render(j, {1, report});
  EXPECT_LT(largest_in_first_round, 0.01) << "nothing is known yet";
  EXPECT_GT(largest, 0.2);
  EXPECT_LT(largest, 0.9) << "fewer samples than were thought to be needed";
  EXPECT_EQ(last, 1);
}

// No flipped bit of a part is ever merged: the header is held to what brume writes, each byte to a checksum.
TEST_F(PartsTest, ADamagedPartIsRefusedAndSaysWhere) {
  const auto whole = part(1, 2);
  const std::string bytes = test::read_file(whole);
  const auto damaged = [&](size_t at, char value) {
    std::string changed = bytes;
    changed[at] = value;
    test::write_file(folder_ / "damaged.exr", changed);
    const std::string error = error_of([&] { merge_parts({folder_ / "damaged.exr"}, false); });
    EXPECT_EQ(error_of([&] { check_exr(folder_ / "damaged.exr"); }).empty(), error.empty()) << at;
    return error;
  };
  // A channel's name is followed by its type, four bytes that are not used for anything, xSampling and ySampling.
  const size_t channel = bytes.find("state.0007") + 11;
  EXPECT_NE(damaged(channel + 8, 37).find("xSampling of channel state.0007 is 37, brume writes 1"), std::string::npos);
  EXPECT_NE(damaged(channel + 12, 7).find("ySampling of channel state.0007 is 7"), std::string::npos);
  EXPECT_NE(damaged(channel, 2).find("the type of channel state.0007 is float"), std::string::npos);
  const size_t seed = bytes.find(std::string("seed\0string\0", 12)) + 16;
  EXPECT_NE(damaged(seed, bytes[seed] ^ 1).find("fileChecksum in its header is"), std::string::npos);
  EXPECT_EQ(error_of([&] { merge_parts({whole}, false); }), "");
  for (size_t at = 0; at < bytes.size(); at += bytes.size() / 100) EXPECT_NE(damaged(at, bytes[at] ^ 0x10), "") << at;
}

TEST_F(PartsTest, ACropHasTheWholesPixels) {
  const Layers whole = prepared().render(job(3), {}).layers;
  RenderJob j = job(3);
  j.crop = RenderJob::Crop{5, 4, 30, 19};
  const Layers crop = prepared().render(j, {}).layers;
  ASSERT_EQ(crop.width(), 25);
  for (int y = 0; y < 15; ++y)
    for (int x = 0; x < 25; ++x) ASSERT_EQ(crop.at("indirect.G")(x, y), whole.at("indirect.G")(x + 5, y + 4));
  write_exr(folder_ / "crop.exr", crop);
  const Layers read = read_exr(folder_ / "crop.exr");
  EXPECT_EQ(read.data_window(), (PixelWindow{{5, 4}, {30, 19}})) << "the file says where in the whole it lies";
  EXPECT_EQ(read.display_window(), whole.data_window());
  EXPECT_EQ(read.at("R")(7, 5), whole.at("R")(12, 9));
  const Layers shown = over_display_window(read);
  EXPECT_EQ(shown.at("R")(12, 9), whole.at("R")(12, 9));
  EXPECT_EQ(shown.at("R")(2, 2), 0.0f) << "absent";
}

// It stops soon after the error is reached, and what it reached is what the frame's variance says.
TEST_F(PartsTest, StopsAtTheTargetError) {
  RenderJob j = job(1 << 20);
  j.target_error = 0.05;
  j.guide_samples = 4;
  const RenderResult r = prepared().render(j, {});
  EXPECT_GT(r.report.samples_per_pixel, 4);
  EXPECT_LT(r.report.samples_per_pixel, 4096);
  double sum = 0;
  for (const char c : {'R', 'G', 'B'})
    for (int y = 0; y < 21; ++y)
      for (int x = 0; x < 37; ++x) {
        const double m = r.layers.at(std::string(1, c))(x, y);
        sum += r.layers.at(std::string("mean_variance.") + c)(x, y) / (m * m + 0.01);
      }
  EXPECT_LE(std::sqrt(sum / (3 * 37 * 21)), 0.05 * 1.001);
  RenderJob fixed = job(r.report.samples_per_pixel);
  fixed.guide_samples = 4;
  test::expect_same_bits(prepared().render(fixed, {}).layers, r.layers);
}

// One path stands for all samples of such pixels.
TEST_F(PartsTest, PixelsOfAUniformSkyShowItInEverySample) {
  const RenderResult r = prepared().render(job(13), {});
  EXPECT_EQ(r.report.counters.paths, 37u * 21u * 13u);
  int sky = 0;
  for (int y = 0; y < 21; ++y)
    for (int x = 0; x < 37; ++x) {
      EXPECT_EQ(r.layers.at("sample_count.Y")(x, y), 13);
      if (r.layers.at("A")(x, y) > 0) continue;
      ++sky;
      for (size_t c = 0; c < 3; ++c) {
        const auto radiance = static_cast<float>(scene_.environment.radiance[static_cast<int>(c)]);
        for (const auto which : {std::string_view(), statistic::half_a, statistic::half_b, statistic::buckets[3]}) {
          EXPECT_EQ((*r.layers.rgb(layer::beauty, which)[c])(x, y), radiance) << x << " " << y << " " << which;
          EXPECT_EQ((*r.layers.rgb(layer::indirect, which)[c])(x, y), 0) << x << " " << y << " " << which;
        }
        EXPECT_EQ((*r.layers.rgb(layer::beauty, statistic::mean_variance)[c])(x, y), 0);
      }
    }
  EXPECT_GT(sky, 100);
  EXPECT_LT(sky, 37 * 21 - 100);
}

// Each sample's record is what that sample did: its colours add up to its pixel, its numbers to what replay() tells.
TEST_F(PartsTest, SampleRecordsStreamByTile) {
  LayerRequest layers;
  layers.records = true;
  const PreparedScene scene(scene_, layers);
  EXPECT_FALSE(scene.plan().one_grid);
  RenderJob j = job(5);
  j.records = folder_ / "samples.records";
  const Layers frame = scene.render(j, {}).layers;
  RecordReader reader(j.records);
  const RecordLayout& layout = reader.layout();
  ASSERT_EQ(layout.components() * sizeof(float), sizeof(PathRecord));
  ASSERT_EQ(layout.samples, 5);
  int scattered = 0;
  for (int tile = 0; tile < layout.tile_count(); ++tile) {
    const std::vector<float> values = reader.read(tile);
    const auto* record = reinterpret_cast<const PathRecord*>(values.data());
    const RecordLayout::Bounds b = layout.bounds(tile);
    for (int y = b.y0; y < b.y1; ++y)
      for (int x = b.x0; x < b.x1; ++x) {
        dvec3 sum(0);
        for (int s = 0; s < 5; ++s, ++record) {
          sum += dvec3(record->unscattered + record->single + record->indirect) / 5.0;
          const bool once = static_cast<int>(record->flags) & 1;
          ASSERT_EQ(once, record->flight_1 < 1);
          ASSERT_EQ(once, record->density_1 > 0);
          ASSERT_NEAR(glm::length(record->direction_1), once ? 1.0 : 0.0, 1e-5);
          scattered += once;
        }
        for (size_t c = 0; c < 3; ++c)
          ASSERT_NEAR(sum[static_cast<int>(c)], (*frame.rgb(layer::beauty)[c])(x, y), 1e-5);
      }
  }
  EXPECT_GT(scattered, 100);
  std::filesystem::resize_file(j.records, std::filesystem::file_size(j.records) - 4);
  EXPECT_NE(error_of([&] { RecordReader damaged(j.records); }).find("truncated or damaged"), std::string::npos);
  j.time_limit = 1;
  EXPECT_NE(error_of([&] { scene.render(j, {}); }).find("in one go"), std::string::npos);
}

// The first checkpoint meets a full disk, a later one finds room.
TEST_F(PartsTest, AFullDiskCostsTheCheckpointAndNotTheRender) {
  RenderJob j = job(13);
  j.checkpoint = folder_ / "c.exr";
  j.checkpoint_seconds = 1e-9;
  std::vector<std::string> warnings;
  j.warn = [&](const std::string& text) { warnings.push_back(text); };
  const test::FullDisk full(j.checkpoint);
  const Layers frame = prepared().render(j, {}).layers;
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_NE(warnings[0].find("no checkpoint for now, the render goes on"), std::string::npos) << warnings[0];
  EXPECT_NE(warnings[1].find("is written again"), std::string::npos) << warnings[1];
  test::expect_same_bits(prepared().render(job(13), {}).layers, frame);
  test::expect_same_bits(merge_parts({j.checkpoint}, false), frame);
  EXPECT_FALSE(test::has_half_written(folder_.path()));
}

TEST_F(PartsTest, MergingStopsWhenItIsCancelled) {
  const auto a = part(1, 2), b = part(2, 2);
  const std::atomic<bool> cancel{true};
  EXPECT_THROW(merge_parts({a, b}, false, {1, {}, &cancel}), Interrupted);
  EXPECT_THROW(write_exr(folder_ / "none.exr", read_exr(a), {1, {}, &cancel}), Interrupted);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "none.exr"));
  EXPECT_FALSE(test::has_half_written(folder_.path()));
}

TEST_F(PartsTest, BucketsHalvesAndMeansAgree) {
  const Layers f = prepared().render(job(16), {}).layers;
  for (int y = 0; y < 21; ++y)
    for (int x = 0; x < 37; ++x) {
      double even = 0, odd = 0;
      for (int k = 0; k < 8; ++k) (k % 2 ? odd : even) += f.at("direct.bucket_" + std::to_string(k) + ".R")(x, y) / 4;
      ASSERT_NEAR(even, f.at("direct.half_a.R")(x, y), 1e-5);
      ASSERT_NEAR(odd, f.at("direct.half_b.R")(x, y), 1e-5);
      // The parts of direct sum to it.
      ASSERT_NEAR(
          f.at("background.R")(x, y) + f.at("emission.R")(x, y) + f.at("single.R")(x, y) + f.at("surface.R")(x, y),
          f.at("direct.R")(x, y), 1e-6);
    }
}

}  // namespace
}  // namespace brume
