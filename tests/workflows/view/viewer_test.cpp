// Looking at a scene while it is edited: what is computed anew, what is shown, what a picture converges to.

#include "workflows/view/viewer.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <fstream>
#include <sstream>

#include "base/error.h"
#include "image/color_space.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "render/world/volume_scene.h"
#include "tests/support/files.h"
#include "tests/support/viewing.h"
#include "workflows/render_frame.h"

namespace brume {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using test::Audience;
using test::look;
using test::mean;
using test::value;
using test::Viewing;

const fs::path kCloud = test::source("data/scenes/cloud.toml");

TEST(Viewer, PredictsAtOnceAndThenPathTraces) {
  Viewing v(kCloud);
  v.viewer.look(look(7));
  const auto clean = v.audience.first([](const ViewPicture& p) { return !p.predicted && p.samples >= 64; });
  ASSERT_TRUE(clean);
  const auto predicted = std::find_if(v.audience.pictures.rbegin(), v.audience.pictures.rend(),
                                      [](const ViewPicture& p) { return p.predicted; });
  ASSERT_NE(predicted, v.audience.pictures.rend());
  EXPECT_TRUE(predicted->full);
  EXPECT_EQ(predicted->id, 7u);
  EXPECT_EQ(predicted->width, 48);
  EXPECT_EQ(predicted->height, 36);
  EXPECT_EQ(predicted->channels, 3);
  EXPECT_EQ(predicted->halves.size(), 3u * 48 * 36);
  EXPECT_NEAR(mean(*predicted) / mean(*clean), 1, 0.1);
  ASSERT_TRUE(clean->error);
  EXPECT_GT(*clean->error, 0);
  EXPECT_LT(*clean->error, 0.1);
  EXPECT_TRUE(v.viewer.frame() && v.viewer.frame()->find("noisy.R"));
}

/// Root mean square difference of a picture to a frame's beauty, over the beauty's own.
double difference(const ViewPicture& p, const Layers& frame) {
  double squares = 0, sum = 0;
  for (int c = 0; c < 3; ++c) {
    const Plane& plane = frame.at(std::string(1, "RGB"[c]));
    for (int y = 0; y < plane.height(); ++y)
      for (int x = 0; x < plane.width(); ++x) {
        squares += std::pow(value(p, c, x, y) - plane(x, y), 2);
        sum += std::pow(plane(x, y), 2);
      }
  }
  return std::sqrt(squares / sum);
}

// Against a render of the program with another seed: clean pictures are never worse than their samples, and both come
// to it.
TEST(Viewer, ConvergesToTheRender) {
  Viewing v(kCloud);
  ViewLook wanted = look(1, {"render.seed=5"}, {24, 18});
  wanted.layers = {"picture", "noisy"};
  v.viewer.look(wanted);
  const auto at = [&](const char* layer, int samples) {
    return v.audience.first(
        [&](const ViewPicture& p) { return !p.predicted && p.layer == layer && p.samples >= samples; });
  };
  const auto early = at("picture", 8), noisy = at("noisy", 512), clean = at("picture", 512);
  ASSERT_TRUE(early && noisy && clean);
  RenderOptions options;
  options.scene = kCloud;
  options.overrides = {"film.width=24", "film.height=18"};
  options.spp = 4096;
  options.layers = LayerRequest::of({}, false);
  const Layers reference = render_frame(options, {}).layers;
  const double of_noisy = difference(*noisy, reference), of_clean = difference(*clean, reference);
  EXPECT_LT(of_clean, 1.02 * of_noisy);
  EXPECT_LT(of_clean, 0.7 * difference(*early, reference));
  EXPECT_LT(of_noisy, 0.06);
}

TEST(Viewer, AMovingPictureIsSmallerAndARestingOneWhole) {
  Viewing v(kCloud);
  ViewLook moving = look(1, {}, {640, 480});
  moving.moving = true;
  v.viewer.look(moving);
  const auto first = v.audience.first([](const ViewPicture&) { return true; });
  ASSERT_TRUE(first);
  EXPECT_LT(first->width, 640);
  EXPECT_FALSE(first->full);
  // Without another look it comes to rest.
  EXPECT_TRUE(v.audience.first([](const ViewPicture& p) { return p.full && p.width == 640; }));
}

TEST(Viewer, AnotherCameraSolvesNoLightAnotherSunDoes) {
  Viewing v(kCloud);
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return !p.predicted; }));
  v.viewer.look(look(2, {"camera.position=[0.0, -8.0, 1.0]", "camera.fov=30"}));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 2 && p.full; }));
  v.viewer.look(look(3, {"lights.0.direction=[1, 0, 0.2]"}));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 3 && p.full; }));
  const auto solved = [&](uint64_t id) {
    return v.audience.wait([](const Audience&) { return true; }) &&
           std::count(v.audience.stages.begin(), v.audience.stages.end(), std::pair(id, ViewStage::kSolvingLight)) > 0;
  };
  EXPECT_TRUE(solved(1));
  EXPECT_FALSE(solved(2));
  EXPECT_TRUE(solved(3));
}

TEST(Viewer, OtherLayersAreShownWhileSamplesGoOn) {
  Viewing v(kCloud);
  v.viewer.look(look(1));
  const auto before = v.audience.first([](const ViewPicture& p) { return p.samples >= 16; });
  ASSERT_TRUE(before);
  ViewLook noisy = look(2);
  noisy.layers = {"noisy", "clean_error"};
  v.viewer.look(noisy);
  const auto picture = v.audience.first([](const ViewPicture& p) { return p.id == 2 && p.layer == "noisy"; });
  const auto error = v.audience.first([](const ViewPicture& p) { return p.id == 2 && p.layer == "clean_error"; });
  ASSERT_TRUE(picture && error);
  EXPECT_GE(picture->samples, before->samples);
  EXPECT_EQ(error->channels, 1);
}

TEST(Viewer, SunsAndVolumesCanBeSwitchedOffAndLampsAdded) {
  Viewing v(kCloud);
  const auto mean_of = [&](uint64_t id, std::vector<std::string> assignments) {
    v.viewer.look(look(id, std::move(assignments)));
    const auto p = v.audience.first([&](const ViewPicture& q) { return q.id == id && !q.predicted; });
    return p ? mean(*p) : -1.0;
  };
  const double all = mean_of(1, {}), dark = mean_of(2, {"lights.0.enabled=false"}),
               empty = mean_of(3, {"volumes.0.enabled=false"}),
               lamp = mean_of(4, {"lights.0.enabled=false",
                                  "lights.1={type=\"sphere\",position=[0,-3,1],radius=0.2,radiance=[90,90,90]}"});
  EXPECT_GT(all, 1.2 * dark);
  EXPECT_NEAR(empty, (0.16 + 0.21 + 0.31) / 3, 1e-3);
  EXPECT_GT(lamp, 1.05 * dark);
}

TEST(Viewer, ShowsRec709WhateverTheSceneComputesIn) {
  Viewing v(kCloud);
  const auto sky = [&](uint64_t id, const std::string& space) {
    v.viewer.look(
        look(id, {"film.color_space=\"" + space + "\"", "environment.sky=\"preetham\"", "environment.radiance=1"}));
    const auto p = v.audience.first([&](const ViewPicture& q) { return q.id == id && !q.predicted; });
    return p ? dvec3(value(*p, 0, 1, 1), value(*p, 1, 1, 1), value(*p, 2, 1, 1)) : dvec3(-1);
  };
  const dvec3 plain = sky(1, "lin_rec709"), wide = sky(2, "aces2065-1");
  EXPECT_GT(plain.z, 1.2 * plain.x);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(wide[c], plain[c], 0.02 * plain[c]) << c;
  const std::shared_ptr<const Layers> frame = v.viewer.frame();
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->chromaticities(), WorkingSpace("aces2065-1").chromaticities);
  EXPECT_GT(std::abs(frame->at("R")(1, 1) - plain.x), 0.1 * plain.x) << "what is kept is in the scene's space";
}

TEST(Viewer, AProblemIsToldAndTheNextLookIsAnswered) {
  Viewing v(kCloud);
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.full; }));
  for (const auto& [id, wrong, expected] :
       {std::tuple(2, "volumes.0.albedo=3", "albedo"),
        {3, "camera.look_at=[0.0, -6.2, 1.0]", "camera"},
        {4, "nonsense", "-D"},
        {5, "lights.7.radius=1", "entries"},
        {6, "volumes.0.file=\"/etc/passwd\"", "no file that the scene names"},
        {7, "volumes.1={file=\"../volumes/smoke.vdb\"}", "no file that the scene names"},
        {8, "environment.\"fi\\u006ce\"=\"/etc/passwd\"", ""}}) {
    v.viewer.look(look(static_cast<uint64_t>(id), {wrong}));
    const auto told = [id = id](const Audience& a) {
      return !a.problems.empty() && a.problems.back().first == static_cast<uint64_t>(id);
    };
    ASSERT_TRUE(v.audience.wait(told)) << wrong;
    EXPECT_NE(v.audience.problems.back().second.find(expected), std::string::npos) << v.audience.problems.back().second;
  }
  v.viewer.look(look(9));
  EXPECT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 9 && p.full; }));
}

TEST(Viewer, APointIsFoundInTheMediumAndNotBesideIt) {
  Viewing v(kCloud);
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.full; }));
  v.viewer.probe({2, {0.5, 0.5}});
  v.viewer.probe({3, {0.5, 0.5}});
  ASSERT_TRUE(v.audience.wait([](const Audience& a) { return !a.points.empty() && a.points.back().first == 3; }));
  const auto middle = v.audience.points.back().second;
  ASSERT_TRUE(middle);
  EXPECT_NEAR(middle->x, 0, 0.05);
  EXPECT_GT(middle->y, -1.8);
  EXPECT_LT(middle->y, 0.5);
  v.viewer.probe({4, {0.01, 0.01}});
  ASSERT_TRUE(v.audience.wait([](const Audience& a) { return a.points.back().first == 4; }));
  EXPECT_FALSE(v.audience.points.back().second);
}

TEST(Viewer, AFileThatChangesIsLoadedAgain) {
  const test::TemporaryFolder folder;
  const fs::path scene = folder / "scene.toml";
  const std::string text = test::read_file(kCloud);
  const std::string volumes = test::source("data/volumes").string();
  const auto write = [&](const std::string& albedo) {
    std::string own = text;
    own.replace(own.find("../volumes"), 10, volumes);
    own.replace(own.find("albedo = 0.995"), 14, "albedo = " + albedo);
    std::ofstream(scene) << own;
  };
  write("0.995");
  fs::last_write_time(scene, fs::file_time_type::clock::now() - 10s);
  Viewing v(scene);
  v.viewer.look(look(1));
  const auto bright = v.audience.first([](const ViewPicture& p) { return !p.predicted; });
  ASSERT_TRUE(bright);
  v.viewer.check_files();
  write("0.5");
  v.viewer.check_files();
  ASSERT_TRUE(v.audience.wait([](const Audience& a) {
    return std::any_of(a.scenes.begin(), a.scenes.end(), [](const ViewSceneText& s) { return s.reloaded; });
  }));
  ASSERT_TRUE(v.audience.first([&](const ViewPicture& p) { return !p.predicted && mean(p) < 0.8 * mean(*bright); }));
}

// As a program writes its scene anew and says so, instead of waiting until the file is looked at.
TEST(Viewer, AnotherRevisionIsReadAtOnceAndItsFilesAreKnown) {
  const test::TemporaryFolder folder;
  const fs::path scene = folder / "scene.toml", volume = folder / "cloud.vdb";
  fs::copy_file(test::source("data/volumes/cloud.vdb"), volume);
  const auto write = [&](const std::string& albedo) {
    std::string own = test::read_file(kCloud);
    own.replace(own.find("../volumes/cloud.vdb"), 20, volume.string());
    own.replace(own.find("albedo = 0.995"), 14, "albedo = " + albedo);
    test::write_file(scene, own);
  };
  write("0.995");
  Viewing v(scene);
  v.viewer.look(look(1));
  const auto bright = v.audience.first([](const ViewPicture& p) { return p.full; });
  ASSERT_TRUE(bright);
  test::write_file(volume, "no volume");  // what was in it is known
  write("0.5");
  ViewLook second = look(2);
  second.revision = 1;
  second.most_samples = 8;
  v.viewer.look(second);
  const auto dark = v.audience.first([](const ViewPicture& p) { return p.id == 2 && p.full; });
  ASSERT_TRUE(dark && v.audience.problems.empty());
  EXPECT_LT(mean(*dark), 0.8 * mean(*bright));
  EXPECT_FALSE(v.audience.scenes.back().reloaded);
  ASSERT_TRUE(v.audience.wait([](const Audience& a) {
    return !a.told.empty() && a.told.back().stage == ViewStage::kDone;
  })) << "after as many samples as were asked for";
  EXPECT_EQ(v.audience.told.back().samples, 8);
}

TEST(Viewer, WithoutMediaAMovingPictureIsTracedCoarsely) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "floor.obj", "v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\nf 1 2 3 4\n");
  const fs::path scene = folder / "scene.toml";
  test::write_file(scene,
                   "[camera]\nposition = [0, -6, 3]\nlook_at = [0, 0, 0]\nfov = 40\n"
                   "[environment]\nradiance = [1, 1, 1]\n[[surfaces]]\nfile = \"floor.obj\"\nalbedo = 0.5\n");
  Viewing v(scene);
  ViewLook moving = look(1, {}, {640, 480});
  moving.moving = true;
  moving.layers = {"picture", "alpha"};
  v.viewer.look(moving);
  const auto first = v.audience.first([](const ViewPicture& p) { return p.layer == "picture"; });
  ASSERT_TRUE(first);
  EXPECT_FALSE(first->full || first->predicted);
  EXPECT_LT(first->width, 640);
  EXPECT_GT(mean(*first), 0.4);
  const auto alpha = v.audience.first([](const ViewPicture& p) { return p.layer == "alpha"; });
  ASSERT_TRUE(alpha);
  EXPECT_GT(mean(*alpha), 0.5);
  EXPECT_LT(mean(*alpha), 1);
  EXPECT_TRUE(v.audience.first([](const ViewPicture& p) { return p.full && p.width == 640; }));
}

TEST(Viewer, FramesOfASequenceAreThose) {
  const test::TemporaryFolder folder;
  for (const int seed : {1, 2}) {
    const std::string file = (folder / ("s.000" + std::to_string(seed) + ".vdb")).string();
    ASSERT_EQ(test::run_brume("generate cloud --resolution 24 --seed " + std::to_string(seed) + " -o " + file).status,
              0);
  }
  Viewing v(folder / "s.####.vdb", {1, 2});
  ViewLook second = look(1);
  second.frame = 2;
  v.viewer.look(look(1));
  const auto a = v.audience.first([](const ViewPicture& p) { return p.frame == 1 && p.full; });
  second.id = 2;
  v.viewer.look(second);
  const auto b = v.audience.first([](const ViewPicture& p) { return p.frame == 2 && p.full; });
  ASSERT_TRUE(a && b);
  EXPECT_NE(a->halves, b->halves);
  ASSERT_FALSE(v.audience.scenes.empty());
  EXPECT_EQ(v.audience.scenes[0].frames, (std::vector<int>{1, 2}));
  for (const ViewSceneText& scene : v.audience.scenes) EXPECT_EQ(scene.name, "s.####");
}

// The first look is sketched whatever the machine; a later one unless its whole picture takes next to no time.
TEST(Viewer, AnotherCameraIsSeenCoarseFirstAndThenInSteps) {
  Viewing v(kCloud);
  for (const uint64_t id : {1, 2}) {
    v.viewer.look(look(id, {fmt::format("camera.fov={}", 30 + id)}, {960, 720}));
    const auto whole = v.audience.first([&](const ViewPicture& p) { return p.id == id && p.full; });
    ASSERT_TRUE(whole);
    EXPECT_EQ(whole->width, 960);
    int before = 0, shown = 0;
    for (const ViewPicture& p : v.audience.pictures) {
      if (p.id != id || !p.predicted) continue;
      EXPECT_GE(p.width, before) << "pictures grow";
      before = p.width;
      if (++shown == 1 && (id == 1 || whole->seconds > 1)) {
        EXPECT_LT(p.width, 960);
      }
      if (p.full) break;
    }
  }
}

TEST(Viewer, SamplesAreCountedWhileTheyAreTaken) {
  Viewing v(kCloud);
  v.viewer.look(look(1, {}, {320, 240}));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.samples >= 16; }));
  bool within = false;
  for (const ViewProgress& p : v.audience.told) {
    if (p.share) {
      EXPECT_GE(*p.share, 0);
      EXPECT_LE(*p.share, 1);
    }
    if (p.stage != ViewStage::kSampling) continue;
    EXPECT_GE(p.goal, 8);
    EXPECT_LE(p.samples, p.goal);
    within = within || p.goal > 8;
  }
  EXPECT_TRUE(within) << "the goals of later rounds are told";
}

// Whatever has been computed: the text and command are those of the look that is asked for, and a frame of another
// camera is none of it.
TEST(Viewer, WhatIsKeptIsTheLookThatIsAskedFor) {
  Viewing v(kCloud);
  const ViewLook first = look(1), second = look(2, {"camera.fov=21"});
  EXPECT_THROW(v.viewer.scene_text(first), InputError);
  v.viewer.look(first);
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return !p.predicted; }));
  ASSERT_TRUE(v.viewer.frame(first));
  EXPECT_EQ(v.viewer.frame(second), nullptr);
  EXPECT_NE(v.viewer.scene_text(second).find("fov = 21"), std::string::npos) << v.viewer.scene_text(second);
  EXPECT_NE(v.viewer.command(second).find("camera.fov=21"), std::string::npos);
  EXPECT_NE(v.viewer.command(second).find("film.width=48"), std::string::npos);
  v.viewer.look(second);
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 2 && p.full; }));
  const auto frame = v.viewer.frame(second);
  ASSERT_TRUE(frame);
  EXPECT_TRUE(frame->find("R") && frame->find("guide.opacity.Y"));
  EXPECT_EQ(v.viewer.frame(first), nullptr);
  const Scene scene = read_scene(kCloud, std::vector<std::string>{"camera.fov=21", "film.width=48", "film.height=36"});
  for (const bool sampled : {false, true}) {
    if (sampled) {
      ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 2 && !p.predicted; }));
    }
    const auto kept = v.viewer.frame(second);
    ASSERT_TRUE(kept);
    EXPECT_EQ(kept->text("sceneHash"), scene.hash);
    EXPECT_EQ(kept->text("sceneSettings"), scene.settings);
    EXPECT_TRUE(kept->header.contains("worldToCamera"));
  }
}

// What the program makes up around a bare volume follows the picture's size and the camera's field of view: a command
// that left it to be made up again would show something else.
TEST(Viewer, TheCommandOfABareVolumeRendersWhatIsSeen) {
  const fs::path volume = test::source("data/volumes/cloud.vdb");
  Viewing v(volume);
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.predicted; }));
  EXPECT_EQ(v.viewer.command(look(1)).find("camera."), std::string::npos) << v.viewer.command(look(1));
  for (const ViewLook& other : {look(2, {}, {36, 96}), look(3, {"camera.fov=12"}), look(4, {"volumes.0.albedo=0.5"})}) {
    std::vector<std::string> said;
    std::istringstream words(v.viewer.command(other));
    for (std::string word; words >> word;) {
      if (word != "-D") continue;
      words >> std::ws;
      if (words.peek() == '\'')
        std::getline(words.ignore(), word, '\'');
      else
        words >> word;
      said.push_back(word);
    }
    const Scene seen = parse_scene_alone(v.viewer.scene_text(other), volume, {}),
                rendered = parse_scene_alone(scene_for_volume(volume, said).text(volume.string()), volume, said);
    EXPECT_EQ(rendered.camera.position, seen.camera.position) << v.viewer.command(other);
    EXPECT_EQ(rendered.camera.look_at, seen.camera.look_at);
    EXPECT_EQ(rendered.camera.fov, seen.camera.fov);
    EXPECT_EQ(rendered.volumes[0].sigma_t, seen.volumes[0].sigma_t);
    EXPECT_EQ(rendered.film.width, seen.film.width);
  }
}

TEST(Viewer, ARepairedFileEndsItsProblemAndAMissingOneIsTold) {
  const test::TemporaryFolder folder;
  const fs::path scene = folder / "scene.toml";
  std::string text = test::read_file(kCloud);
  text.replace(text.find("../volumes"), 10, test::source("data/volumes").string());
  const auto write = [&](const std::string& what, std::chrono::seconds ago) {
    std::ofstream(scene) << what;
    fs::last_write_time(scene, fs::file_time_type::clock::now() - ago);
  };
  const auto reloads = [](const Audience& a) {
    return std::count_if(a.scenes.begin(), a.scenes.end(), [](const ViewSceneText& s) { return s.reloaded; });
  };
  write(text, 30s);
  Viewing v(scene);
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.full; }));
  write("[camera]\nnonsense = 1\n" + text, 20s);
  v.viewer.check_files();
  ASSERT_TRUE(v.audience.wait([](const Audience& a) { return a.wrong.size() == 1; }));
  EXPECT_FALSE(v.audience.wrong[0].lasting);
  write(text, 10s);
  v.viewer.check_files();
  ASSERT_TRUE(v.audience.wait([&](const Audience& a) { return reloads(a) == 1; }));
  // Gone: told once, when two looks at the folder agree.
  fs::rename(scene, folder / "away.toml");
  for (int i = 0; i < 4; ++i) v.viewer.check_files();
  ASSERT_EQ(v.audience.wrong.size(), 2u);
  EXPECT_TRUE(v.audience.wrong[1].lasting);
  EXPECT_NE(v.audience.wrong[1].text.find("scene.toml: the file is gone"), std::string::npos);
  // Back with the time that it had.
  fs::rename(folder / "away.toml", scene);
  v.viewer.check_files();
  ASSERT_TRUE(v.audience.wait([&](const Audience& a) { return reloads(a) == 2; }));
}

TEST(Viewer, AVolumeThatChangesIsReadAgain) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "own.vdb";
  const auto generate = [&](int seed) {
    return test::run_brume(fmt::format("generate cloud --resolution 24 --seed {} -o {}", seed, file.string())).status;
  };
  ASSERT_EQ(generate(1), 0);
  fs::last_write_time(file, fs::file_time_type::clock::now() - 30s);
  std::ofstream(folder / "scene.toml") << "[camera]\nposition = [0, -4, 0]\nlook_at = [0, 0, 0]\n[environment]\n"
                                          "radiance = 1\n[[volumes]]\nfile = \"own.vdb\"\nsigma_t = 5\n";
  Viewing v(folder / "scene.toml");
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return p.full; }));
  v.viewer.check_files();
  ASSERT_EQ(generate(2), 0);
  for (int i = 0; i < 2; ++i) v.viewer.check_files();  // it is read once it has stopped to change
  ASSERT_TRUE(v.audience.wait([](const Audience& a) {
    return std::any_of(a.scenes.begin(), a.scenes.end(), [](const ViewSceneText& s) { return s.reloaded; });
  }));
}

TEST(Viewer, AProblemOfAGridOffersTheGridsOfTheFile) {
  const test::TemporaryFolder folder;
  const std::string file = (folder / "own.vdb").string();
  ASSERT_EQ(test::run_brume("generate cloud --resolution 24 -o " + file).status, 0);
  std::ofstream(folder / "scene.toml") << "[camera]\nposition = [0, -4, 0]\nlook_at = [0, 0, 0]\n[environment]\n"
                                          "radiance = 1\n[[volumes]]\nfile = \"own.vdb\"\ngrid = \"soot\"\n"
                                          "sigma_t = 5\n";
  Viewing v(folder / "scene.toml");
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.wait([](const Audience& a) { return !a.wrong.empty(); }));
  const ViewProblem& problem = v.audience.wrong[0];
  EXPECT_EQ(problem.grid_key, "volumes.0.grid");
  ASSERT_EQ(problem.grids.size(), 1u);
  EXPECT_EQ(problem.grids[0].name, "density");
  EXPECT_EQ(problem.grids[0].type, "float");
  EXPECT_TRUE(problem.grids[0].usable);
  v.viewer.look(look(2, {"volumes.0.grid=density"}));
  EXPECT_TRUE(v.audience.first([](const ViewPicture& p) { return p.id == 2 && p.full; }));
  // A bare file in which there is no density at all names what it holds.
  Viewing bare(test::source("tests/data/grids/vectors.vdb"));
  bare.viewer.look(look(1));
  ASSERT_TRUE(bare.audience.wait([](const Audience& a) { return !a.wrong.empty(); }));
  ASSERT_FALSE(bare.audience.wrong[0].grids.empty());
  EXPECT_FALSE(bare.audience.wrong[0].grids[0].usable);
}

TEST(Viewer, LayersAreNamedInWordsWithUnitsAndGroups) {
  Viewing v(kCloud);
  v.viewer.look(look(1));
  ASSERT_TRUE(v.audience.first([](const ViewPicture& p) { return !p.predicted; }));
  const auto& layers = v.audience.scenes.back().layers;
  const auto depth = std::find_if(layers.begin(), layers.end(), [](const auto& l) { return l.name == "guide.depth"; });
  ASSERT_NE(depth, layers.end());
  EXPECT_EQ(depth->unit, "scene units");
  for (const auto& l : layers) {
    EXPECT_EQ(l.title.find_first_of("._"), std::string::npos) << l.title;
    EXPECT_FALSE(l.unit.empty()) << l.name;
  }
}

TEST(SceneOutline, TellsWhatTheTextSaysAndTheDefaults) {
  const std::string text =
      "[camera]\nposition = [0, -3, 0]\nlook_at = [0, 0, 0]\n[[lights]]\ntype = \"sun\"\n"
      "direction = [0, 0, 1]\nirradiance = 2\nenabled = false\n";
  const auto tables = outline_scene(text, "scene.toml", std::vector<std::string>{"camera.fov=20"});
  const auto table = [&](const std::string& path) {
    return *std::find_if(tables.begin(), tables.end(), [&](const SceneTable& t) { return t.path == path; });
  };
  EXPECT_EQ(std::get<double>(table("camera").find("fov")->value), 20);
  EXPECT_EQ(std::get<double>(table("camera").find("lens_radius")->value), 0);
  EXPECT_EQ(std::get<std::vector<double>>(table("lights.0").find("irradiance")->value), (std::vector<double>{2, 2, 2}));
  EXPECT_EQ(table("lights.0").find("irradiance")->type, SceneKey::Type::kColour);
  EXPECT_EQ(table("lights.0").find("direction")->type, SceneKey::Type::kVector);
  EXPECT_FALSE(std::get<bool>(table("lights.0").find("enabled")->value));
  EXPECT_TRUE(parse_scene_alone(text, "scene.toml").lights.empty());
}

TEST(EditedScene, KeepsCommentsAndMeansTheSame) {
  const std::vector<std::string> assignments = {
      "camera.fov=20", "camera.lens_radius=0.25", "volumes.0.albedo=[0.5, 0.6, 0.7]", "environment.sky=preetham",
      "lights.1={type=\"sphere\", position=[0, 0, 2], radius=0.1, radiance=[5, 5, 5]}"};
  for (const char* name : {"cloud", "smoke", "fire"}) {
    const fs::path path = test::source("data/scenes") / (std::string(name) + ".toml");
    const std::string text = test::read_file(path), edited = edited_scene(text, path, assignments);
    EXPECT_EQ(edited.substr(0, edited.find('\n')), text.substr(0, text.find('\n'))) << "its comment";
    const test::TemporaryFolder elsewhere;
    const Scene wanted = parse_scene(text, path, assignments), saved = parse_scene(edited, elsewhere / "scene.toml");
    EXPECT_EQ(saved.hash, wanted.hash) << edited;
    EXPECT_EQ(saved.settings, wanted.settings);
  }
}

TEST(EditedScene, WritesAnewWhatCannotBeEdited) {
  const std::string text = "camera = {position = [0, -3, 0], look_at = [0, 0, 0]}\n";
  const std::string edited = edited_scene(text, "scene.toml", std::vector<std::string>{"camera.fov=20"});
  EXPECT_EQ(parse_scene(edited, "scene.toml").camera.fov, 20);
}

}  // namespace
}  // namespace brume
