// brume render --frames: one scene, many frames, none of which takes the others with it.

#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>

#include "image/exr_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using test::run_brume;

bool same(const Plane& a, const Plane& b) {
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x)
      if (a(x, y) != b(x, y)) return false;
  return true;
}

class Sequence : public ::testing::Test {
 protected:
  Sequence() {
    for (const char* frame : {"0001", "0002", "0004"})
      fs::create_symlink(test::source("data/volumes/smoke.vdb"), folder_ / (std::string("v.") + frame + ".vdb"));
    test::write_file(folder_ / "shot.toml", R"([camera]
position = [0, -7, 1.5]
look_at = [0, 0, 1.45]
fov = 26.5
[film]
width = 24
height = 20
[environment]
radiance = 1
[[volumes]]
file = "v.####.vdb"
grid = "density_noise"
sigma_t = 18
object_to_world = [[1, 0, 0, -1], [0, 1, 0, -1], [0, 0, 1, 0], [0, 0, 0, 1]]
)");
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  test::ProgramResult render(const std::string& options) const {
    const auto unless_given = [&](const std::string& option, const std::string& value) {
      return options.find(option) == std::string::npos ? option + " " + value + " " : "";
    };
    return run_brume("render " + path("shot.toml") + " --progress none " + unless_given("--spp", "4") +
                     unless_given("--layers", "direct,indirect") + options);
  }
  std::string frame(int number) const { return path("f.000" + std::to_string(number) + ".exr"); }
  static std::string header(const std::string& file, const std::string& key) {
    Layers layers(1, 1);
    layers.header = read_exr_info(file).header;
    return layers.text(key);
  }
  test::TemporaryFolder folder_;
};

TEST_F(Sequence, AFrameThatFailsIsNamedAndTheRestGoesOn) {
  const auto r = render("--frames 1-4 -o '" + path("f.####.exr") + "' --png '" + path("f.$F4.png") + "'");
  EXPECT_EQ(r.status, 1) << r.err;
  EXPECT_NE(r.err.find("frame 3 failed:"), std::string::npos) << r.err;
  EXPECT_NE(r.err.find("v.0003.vdb: no such file"), std::string::npos) << r.err;
  EXPECT_NE(r.err.find("of 4 frames: 3 done (1-2, 4); 1 failed (3)"), std::string::npos) << r.err;
  EXPECT_EQ(r.out, frame(1) + "\n" + frame(2) + "\n" + frame(4) + "\n");
  EXPECT_TRUE(fs::exists(path("f.0004.png")));
  EXPECT_FALSE(fs::exists(frame(3)));
  EXPECT_EQ(read_exr(frame(4)).number("frame"), 4);
}

TEST_F(Sequence, EveryFrameHasItsOwnNoiseUnlessTheSeedIsFixed) {
  ASSERT_EQ(render("--frames 1-2 -o '" + path("f.####.exr") + "'").status, 0);
  ASSERT_EQ(render("--frames 1-2 --fixed-seed -o '" + path("s.####.exr") + "'").status, 0);
  const auto red = [](const std::string& file) { return read_exr(file).at("R"); };
  EXPECT_FALSE(same(red(frame(1)), red(frame(2))));
  EXPECT_TRUE(same(red(path("s.0001.exr")), red(path("s.0002.exr"))));
  // A frame is the same whether it is rendered alone or among others.
  ASSERT_EQ(render("-D render.frame=2 -o " + path("alone.exr")).status, 0);
  EXPECT_TRUE(same(red(frame(2)), red(path("alone.exr"))));
}

TEST_F(Sequence, ResumeLeavesOutWhatIsCompleteAndNothingElse) {
  const std::string sequence = "--frames 1,2,4 -o '" + path("f.####.exr") + "' ";
  ASSERT_EQ(render(sequence).status, 0);
  const auto again = render(sequence + "--resume");
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(again.out, "") << "nothing was rendered";
  EXPECT_NE(again.err.find("of 3 frames: 3 were complete (1-2, 4)"), std::string::npos) << again.err;

  const auto rendered_again = [&](const std::string& options, int number, const std::string& why) {
    const auto r = render(sequence + options + " --resume");
    EXPECT_EQ(r.status, 0) << r.err;
    EXPECT_NE(r.out.find(frame(number)), std::string::npos) << r.err;
    EXPECT_NE(r.err.find(frame(number) + " is rendered again: " + why), std::string::npos) << r.err;
    return r;
  };
  // Cut off, and damaged in the middle of what a copy that breaks off may have left.
  const std::string whole = test::read_file(frame(2));
  test::write_file(frame(2), whole.substr(0, whole.size() / 2));
  EXPECT_EQ(rendered_again("", 2, "truncated or damaged").out, frame(2) + "\n") << "the others were complete";
  EXPECT_EQ(test::read_file(frame(2)).size(), whole.size());
  test::write_file(frame(2), whole.substr(0, whole.size() / 2) + std::string(whole.size() / 2, '\0'));
  rendered_again("", 2, "truncated or damaged");
  // Of another seed, scene, number of samples, and with other layers.
  rendered_again("--seed 3", 4, "the seed is 0 in the file, 3 now");
  rendered_again("--seed 3 -D camera.fov=30", 4, "camera.fov is 26.5 in the file, 30 now");
  rendered_again("--seed 3 -D camera.fov=30 --spp 2", 4, "holds the samples 0 .. 3, not 0 .. 1");
  rendered_again("--seed 3 -D camera.fov=30 --spp 2 --layers direct", 4, "the list of layers is");
  // Of another volume under the same name.
  fs::remove(path("v.0004.vdb"));
  fs::copy_file(test::source("data/volumes/smoke.vdb"), path("v.0004.vdb"));
  EXPECT_EQ(render("--frames 4 -o '" + path("g.####.exr") + "'").status, 0);
  ASSERT_EQ(run_brume("halve -q " + test::source("data/volumes/smoke.vdb").string() + " -o " + path("h.vdb")).status,
            0);
  fs::rename(path("h.vdb"), path("v.0004.vdb"));
  const auto other = render("--frames 4 -o '" + path("g.####.exr") + "' --resume");
  EXPECT_NE(other.err.find("volumes.0.file is content"), std::string::npos) << other.err;
}

TEST_F(Sequence, CleanFramesThatEndByTheirErrorAreComplete) {
  const std::string clean = "render " + path("shot.toml") +
                            " --progress none --frames 1-2 --clean --target-error 0.5 -o '" + path("f.####.exr") + "' ";
  ASSERT_EQ(run_brume(clean).status, 0);
  const auto again = run_brume(clean + "--resume");
  EXPECT_NE(again.err.find("2 were complete"), std::string::npos) << again.err;
  const auto other = run_brume(clean + "--resume --clean-filter transport_regression:window=12");
  EXPECT_NE(other.err.find("rendered again"), std::string::npos) << other.err;
}

TEST_F(Sequence, AnInterruptedFrameGoesOnFromItsCheckpoint) {
  const std::string parts =
      "--frames 1-2 --part 2/3 --checkpoint '" + path("c.####.exr") + "' --resume -o '" + path("f.####.exr") + "'";
  ASSERT_EQ(render(parts).status, 0);
  const std::string pixels = path("whole.exr");
  fs::rename(frame(1), pixels);
  EXPECT_FALSE(fs::exists(path("c.0001.exr"))) << "it has done its service";
  // As if the first run had been stopped: a checkpoint with fewer samples.
  {
    test::RunningProgram program("render " + path("shot.toml") +
                                 " --layers direct,indirect --progress none --spp 4000000 --frames 1-2 --checkpoint '" +
                                 path("c.####.exr") + "' --checkpoint-every 0.001 --resume -o '" + path("f.####.exr") +
                                 "'");
    ASSERT_TRUE(program.wait_until([&] { return fs::exists(path("c.0001.exr")); })) << program.err();
    program.send(SIGTERM);
    const auto r = program.finish();
    EXPECT_EQ(r.status, 3) << r.err;
    EXPECT_NE(r.err.find("the checkpoint " + path("c.0001.exr") + " is written"), std::string::npos) << r.err;
  }
  // Another render's checkpoint is not gone on with, and says why.
  const auto r = render(parts);
  EXPECT_EQ(r.status, 0) << r.err;
  EXPECT_NE(r.err.find("c.0001.exr is left aside: holds the samples 0 .. "), std::string::npos) << r.err;
  EXPECT_EQ(read_exr_state(frame(1)).words(), read_exr_state(pixels).words());
  // Its own is: no sample is taken again.
  ASSERT_EQ(render("--spp 8 --frames 1 -o '" + path("a.####.exr") + "'").status, 0);
  ASSERT_EQ(render("--spp 8 -D render.frame=1 --checkpoint " + path("c.0001.exr") + " -o " + path("b.exr")).status, 0);
  const auto resumed =
      render("--spp 8 --frames 1 --resume --checkpoint '" + path("c.####.exr") + "' -o '" + path("d.####.exr") + "'");
  EXPECT_EQ(resumed.status, 0) << resumed.err;
  EXPECT_NE(resumed.err.find("0 paths in"), std::string::npos) << resumed.err;
  const Layers whole = read_exr(path("a.0001.exr")), gone_on = read_exr(path("d.0001.exr"));
  for (const auto& [name, plane] : whole.channels()) EXPECT_TRUE(same(plane, gone_on.at(name))) << name;
}

// The time is over when it goes on, so that what the checkpoint held is what the frame has.
TEST_F(Sequence, AFrameThatTimeOrErrorEndsGoesOnFromItsCheckpoint) {
  const auto interrupted = [&](const std::string& options) {
    fs::remove(frame(1));
    test::RunningProgram program("render " + path("shot.toml") + " --layers direct,indirect --progress none " +
                                 options + " --frames 1 --checkpoint '" + path("c.####.exr") +
                                 "' --checkpoint-every 0.001 --resume -o '" + path("f.####.exr") + "'");
    EXPECT_TRUE(program.wait_until([&] { return fs::exists(path("c.0001.exr")); })) << program.err();
    program.send(SIGTERM);
    EXPECT_EQ(program.finish().status, 3) << options;
  };
  const auto resumed = [&](const std::string& options) {
    const auto r =
        run_brume("render " + path("shot.toml") + " --layers direct,indirect --progress none " + options +
                  " --frames 1 --checkpoint '" + path("c.####.exr") + "' --resume -o '" + path("f.####.exr") + "'");
    EXPECT_EQ(r.status, 0) << options << r.err;
    EXPECT_EQ(r.err.find("left aside"), std::string::npos) << options << r.err;
    return read_exr(frame(1));
  };
  for (const std::string samples : {"", "--spp 4000000 "})
    for (const std::string clean : {"", "--clean "}) {
      interrupted(samples + clean + "--time 1h");
      const Layers checkpoint = read_exr(path("c.0001.exr"));
      const Layers whole = resumed(samples + clean + "--time 0.001s");
      EXPECT_GE(whole.number("samplesPerPixel"), checkpoint.number("samplesPerPixel")) << samples << clean;
      EXPECT_GT(whole.number("renderTimeSeconds"), 0.001);
      EXPECT_EQ(whole.header.count("interrupted"), 0u) << "the pass it was interrupted in is ended";
    }
  interrupted("--target-error 1e-9");
  EXPECT_GT(resumed("--target-error 1").number("samplesPerPixel").value_or(0), 0);
}

TEST_F(Sequence, PartsAreMergedWhenAllAreThereAndOnce) {
  const std::string parts = path("parts/##.exr"), merge = "merge '" + parts + "' --parts 1-3 -o " + path("m.exr");
  const auto render_part = [&](int part) {
    ASSERT_EQ(render("--part " + std::to_string(part) + "/3 -D render.frame=1 -o " + path("parts/0") +
                     std::to_string(part) + ".exr")
                  .status,
              0);
  };
  fs::create_directory(path("parts"));
  render_part(1);
  const auto missing = run_brume(merge);
  EXPECT_EQ(missing.status, 2);
  EXPECT_NE(missing.err.find("2 of 3 parts are not there: 2-3 (" + parts + ")"), std::string::npos) << missing.err;
  EXPECT_EQ(run_brume(merge + " --when-complete").status, 0);
  EXPECT_FALSE(fs::exists(path("m.exr")));
  render_part(2);
  render_part(3);
  // Groups that are merged are merged again, to the same bits.
  ASSERT_EQ(run_brume("merge '" + parts + "' --parts 1-2 --mergeable -q -o " + path("g.1.exr")).status, 0);
  fs::copy_file(path("parts/03.exr"), path("g.2.exr"));
  ASSERT_EQ(run_brume("merge '" + path("g.#.exr") + "' -q -o " + path("grouped.exr")).status, 0);
  EXPECT_EQ(run_brume(merge + " --when-complete --discard").status, 0);
  EXPECT_FALSE(fs::exists(path("parts"))) << "the parts, and the folder that holds nothing else";
  const Layers merged = read_exr(path("m.exr")), grouped = read_exr(path("grouped.exr"));
  for (const auto& [name, plane] : merged.channels()) EXPECT_TRUE(same(plane, grouped.at(name))) << name;
  const auto again = run_brume(merge + " --resume");
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_NE(again.err.find("is merged already"), std::string::npos) << again.err;
  const std::string whole = test::read_file(path("m.exr"));
  test::write_file(path("m.exr"), whole.substr(0, whole.size() / 2));
  const auto cut = run_brume(merge + " --resume");
  EXPECT_EQ(cut.status, 2) << "it must be merged again, and the parts are gone";
  EXPECT_NE(cut.err.find("is merged again: "), std::string::npos) << cut.err;
  EXPECT_EQ(run_brume("merge " + path("g.1.exr") + " --parts 1-3 -o " + path("n.exr")).status, 2);
}

TEST_F(Sequence, TheSignalThatFarmsSendEndsInACheckpoint) {
  test::RunningProgram program("render " + path("shot.toml") + " --progress none --spp 4000000 -D render.frame=1 " +
                               "--checkpoint " + path("c.exr") + " --checkpoint-every 0.001 -o " + path("f.exr"));
  ASSERT_TRUE(program.wait_until([&] { return fs::exists(path("c.exr")); })) << program.err();
  program.send(SIGUSR1);
  const auto r = program.finish();
  EXPECT_EQ(r.status, 3) << r.err;
  EXPECT_NE(r.err.find("is written; go on with --resume"), std::string::npos) << r.err;
}

TEST_F(Sequence, WritersOfOneFileDoNotMeet) {
  // As one that was killed left it, or another is writing.
  test::write_file(path("f.exr.n1.7.part"), "half");
  ASSERT_EQ(setenv("BRUME_WRITER", "n2/8", 1), 0);
  const auto r = render("-D render.frame=1 -o " + path("f.exr"));
  unsetenv("BRUME_WRITER");
  EXPECT_EQ(r.status, 0) << r.err;
  EXPECT_EQ(test::read_file(path("f.exr.n1.7.part")), "half");
  EXPECT_TRUE(fs::exists(path("f.exr")));
  EXPECT_FALSE(fs::exists(path("f.exr.n2_8.part")));
}

TEST_F(Sequence, ABareSequenceOfVolumesHasOneCamera) {
  const auto r =
      run_brume("render '" + path("v.$F4.vdb") + "' --frames 1,2,4 --spp 1 --layers direct -D film.width=24 " +
                "-D film.height=20 -o '" + path("f.####.exr") + "' --save-scene " + path("made.toml"));
  EXPECT_EQ(r.status, 0) << r.err;
  EXPECT_NE(test::read_file(path("made.toml")).find("file = \"v.$F4.vdb\""), std::string::npos);
  EXPECT_EQ(header(frame(1), "sceneHash"), header(frame(4), "sceneHash"));
  const auto again = run_brume("render " + path("made.toml") + " --frames 1,2,4 --spp 1 --layers direct -D " +
                               "film.width=24 -D film.height=20 --resume -o '" + path("f.####.exr") + "'");
  EXPECT_NE(again.err.find("3 were complete"), std::string::npos) << again.err;
}

/// Voxels of a small cube.
float cube(const ivec3& v) {
  return v.x > 0 && v.y > 0 && v.z > 0 && v.x < 9 && v.y < 9 && v.z < 9 ? 0.5f : 0.0f;
}

TEST_F(Sequence, OfBareVolumesRendersAllFramesButTheBadOnes) {
  const VoxelBox box{{0, 0, 0}, {9, 9, 9}};
  const auto rendered = [&](const std::string& frames) {
    return run_brume("render '" + path("a.####.vdb") + "' --frames " + frames +
                     " --spp 1 --layers none --progress none " + "-D film.width=16 -D film.height=12 -o '" +
                     path("o.####.exr") + "'");
  };
  test::write_grids_vdb(path("a.0001.vdb"), box, {{"density", cube}});
  test::write_grids_vdb(path("a.0002.vdb"), box, {{"density", cube}, {"flame", cube}, {"temperature", cube}});
  test::write_grids_vdb(path("a.0003.vdb"), box, {{"soot", cube}, {"dust", cube}});
  test::write_file(path("a.0004.vdb"), test::read_file(path("a.0001.vdb")).substr(0, 900));
  test::write_grids_vdb(path("a.0006.vdb"), box, {});
  const auto r = rendered("1-6");
  EXPECT_EQ(r.status, 1) << r.err;
  EXPECT_NE(r.err.find("frame 3 failed: " + path("a.0003.vdb") + ": no grid 'density'"), std::string::npos) << r.err;
  EXPECT_NE(r.err.find("frame 4 failed: " + path("a.0004.vdb") + ": truncated"), std::string::npos) << r.err;
  EXPECT_NE(r.err.find("frame 5 failed: " + path("a.0005.vdb") + ": no such file"), std::string::npos) << r.err;
  EXPECT_NE(r.err.find("of 6 frames: 3 done (1-2, 6); 3 failed (3-5)"), std::string::npos) << r.err;
  const auto first = rendered("1-2");
  EXPECT_EQ(first.status, 0) << first.err;
  const auto none = rendered("3-5");
  EXPECT_EQ(none.status, 1) << none.err;
  EXPECT_NE(none.err.find("frame 3 failed: " + path("a.0003.vdb") +
                          ": no grid 'density', and several that could be it: "
                          "'dust', 'soot'"),
            std::string::npos)
      << none.err;
}

TEST_F(Sequence, OfBareVolumesWithoutFramesIsOfAllThatAreThere) {
  for (const char* name : {"a.0001.vdb", "a.0003.vdb"})
    test::write_grids_vdb(path(name), {{0, 0, 0}, {9, 9, 9}}, {{"density", cube}});
  const std::string options = "render '" + path("a.####.vdb") +
                              "' --spp 1 --layers none --progress none -D film.width=16 -D film.height=12 -o '";
  const auto all = run_brume(options + path("o.####.exr") + "'");
  EXPECT_EQ(all.status, 0) << all.err;
  EXPECT_TRUE(fs::exists(path("o.0001.exr")) && fs::exists(path("o.0003.exr")));
  EXPECT_FALSE(fs::exists(path("o.####.exr"))) << "the number stands in place of its place";
  EXPECT_EQ(run_brume(options + path("take#2.exr") + "'").status, 0);
  EXPECT_TRUE(fs::exists(path("take#2.exr"))) << "a name with a single # is a name";
}

TEST_F(Sequence, AFolderNamedByTheFrameIsMade) {
  EXPECT_EQ(render("--frames 1-2 -o '" + path("$F4/f.exr") + "'").status, 0);
  EXPECT_TRUE(fs::exists(path("0002/f.exr")));
  EXPECT_EQ(render("--frames 1-2 -o '" + path("none/f.$F4.exr") + "'").status, 1) << "no other folder is";
}

TEST_F(Sequence, WhatIsWrongWithTheOptionsIsToldOnce) {
  const auto refused = [&](const std::string& options, const std::string& message) {
    const auto r = render(options);
    EXPECT_EQ(r.status, 2) << options;
    EXPECT_NE(r.err.find(message), std::string::npos) << options << "\n" << r.err;
  };
  const std::string out = " -o '" + path("f.####.exr") + "'";
  refused("--frames 1-4 -o " + path("f.exr"), "all 4 frames would go into one file; expected a name such as");
  refused("--frames 1-4 --png " + path("f.png") + out, "--png " + path("f.png") + ": all 4 frames");
  refused("--frames 4-1" + out, "'4-1' ends before it begins");
  refused("--frames 1-4", "no output; expected -o with a name such as shot.####.exr");
  refused("--frames 1-4 --explain" + out, "--explain looks at one frame");
  refused("--frames 1-4 --part 5/2" + out, "--part 5/2: expected i/N");
  refused("--frames 1-4 --layers deph" + out, "did you mean 'depth'?");
  refused(out, "f.####.exr: a name for a sequence, of one frame; expected --frames, as 1-240");
  refused("--resume -o " + path("f.exr"), "--resume needs the checkpoint to go on from, or --frames");
  refused("--fixed-seed -o " + path("f.exr"), "--fixed-seed is for --frames");
}

}  // namespace
}  // namespace brume
