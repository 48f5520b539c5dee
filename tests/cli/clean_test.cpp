// `brume render --clean`: from a volume or a scene to a clean picture in one command.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "image/exr_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"
#include "volume/vdb_io.h"

namespace brume {
namespace {

using test::run_brume;

const std::string kCloud = test::source("data/volumes/cloud.vdb").string();
const std::string kSmoke = test::source("data/scenes/smoke.toml").string();
const std::string kTiny = " -D film.width=48 -D film.height=40 --progress none ";

class Clean : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string refused(const std::string& arguments) {
    const auto r = run_brume(arguments + " -o " + path("refused.exr"));
    EXPECT_EQ(r.status, 2) << arguments << "\n" << r.err;
    EXPECT_FALSE(std::filesystem::exists(folder_ / "refused.exr"));
    return r.err;
  }
  test::TemporaryFolder folder_;
};

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST_F(Clean, ABareVolumeIsFramedLitAndCleaned) {
  const auto r = run_brume("render " + kCloud + kTiny + "--spp 8 --clean --layers direct,indirect,guides -o " +
                           path("cloud.exr") + " --png " + path("cloud.png") + " --save-scene " + path("cloud.toml"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.err, "volumes.0.sigma_t = ")) << r.err;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "cloud.png"));
  const Layers frame = read_exr(folder_ / "cloud.exr");
  for (const char* name : {"noisy.R", "direct.R", "indirect.R", "clean_direct.R", "clean_indirect.R", "clean_error.Y"})
    EXPECT_TRUE(frame.find(name)) << name;
  float largest = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const float parts = frame.at("clean_direct.G")(x, y) + frame.at("clean_indirect.G")(x, y);
      ASSERT_NEAR(frame.at("G")(x, y), parts, 1e-6f + 1e-6f * std::abs(parts));
      largest = std::max(largest, frame.at("guide.opacity.Y")(x, y));
    }
  EXPECT_GT(largest, 0.9f) << "the cloud is in the picture, and dense";
  EXPECT_EQ(frame.at("guide.opacity.Y")(0, 0), 0.0f) << "with something around it";

  const auto again = run_brume("render " + path("cloud.toml") + kTiny +
                               "--spp 8 --clean --layers direct,indirect,guides -o " + path("again.exr"));
  ASSERT_EQ(again.status, 0) << again.err;
  test::expect_same_bits(frame, read_exr(folder_ / "again.exr"), "the saved scene");
}

TEST_F(Clean, ABareVolumeOfAnyNameGivesASceneThatGivesTheSamePicture) {
  const std::string name = "12\" puff\\ 'a'\tb.vdb", moved = "12\" puff\\ 'a'\tb.toml";
  const auto word = [](const std::string& text) {
    std::string quoted = "'";
    for (const char c : text) quoted += c == '\'' ? "'\\''" : std::string(1, c);
    return quoted + "'";
  };
  test::write_grids_vdb(folder_ / name, {{0, 0, 0}, {15, 15, 15}},
                        {{"Smoke", [](const ivec3& v) { return static_cast<float>(v.x + v.z) / 30; }}});
  const std::string said =
      " -D film.width=20 -D film.height=36 -D volumes.0.albedo=0.5 -D volumes.0.sigma_t=0.3 "
      "--spp 2 --layers none --progress none ";
  const auto r =
      run_brume("render " + word(path(name)) + said + "-o " + path("a.exr") + " --save-scene " + word(path(moved)));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(holds(r.err, "assumed no grid 'density'; grid 'Smoke' is used")) << r.err;
  const std::string text = test::read_file(folder_ / moved);
  EXPECT_TRUE(holds(text, "sigma_t = 0.3\n") && holds(text, "width = 20\n")) << text;
  for (const std::string& again : {said, std::string(" --spp 2 --layers none --progress none ")}) {
    const auto second = run_brume("render " + word(path(moved)) + again + "-o " + path("b.exr"));
    ASSERT_EQ(second.status, 0) << second.err;
    test::expect_same_bits(read_exr(folder_ / "a.exr"), read_exr(folder_ / "b.exr"), again);
  }
}

TEST_F(Clean, ATargetErrorSendsSamplesWhereTheCleanPictureNeedsThem) {
  const auto r = run_brume("render " + kSmoke + kTiny + "--clean --target-error 0.005 -o " + path("smoke.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  const Layers frame = read_exr(folder_ / "smoke.exr");
  EXPECT_LE(frame.number("estimatedCleanError").value_or(1), 0.005);
  const Plane& count = frame.at("sample_count.Y");
  float least = count(0, 0), most = least;
  for (int y = 0; y < frame.height(); ++y)
    for (const float v : count.pixels(y)) {
      least = std::min(least, v);
      most = std::max(most, v);
    }
  EXPECT_EQ(least, 8.0f) << "empty sky needs no more than the first round";
  EXPECT_GT(most, 2 * least);
}

TEST_F(Clean, KeepsGuidesThatAreAskedForAlone) {
  ASSERT_EQ(run_brume("render " + kSmoke + kTiny + "--spp 2 --clean -q -o " + path("clean.exr")).status, 0);
  for (const std::string& name : read_exr(folder_ / "clean.exr").names())
    EXPECT_FALSE(name.starts_with("guide.")) << name;
}

/// The largest channel difference of two sums of layers; what is not there counts as 0.
float difference(const Layers& frame, const std::vector<std::string>& a, const std::vector<std::string>& b) {
  float worst = 0;
  for (const char channel : std::string("RGB"))
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const auto sum = [&](const std::vector<std::string>& layers) {
          float total = 0;
          for (const std::string& l : layers) total += frame.at(l + (l.empty() ? "" : ".") + channel)(x, y);
          return total;
        };
        worst = std::max(worst, std::abs(sum(a) - sum(b)));
      }
  return worst;
}

TEST_F(Clean, ASceneWithoutAMediumIsNotToldToRecordGuides) {
  test::write_file(folder_ / "floor.toml",
                   "[camera]\nposition = [0, -5, 2]\nlook_at = [0, 0, 0]\n[environment]\nradiance = [1, 1, 1]\n"
                   "[[surfaces]]\nfile = \"" +
                       test::source("data/meshes/floor.obj").string() + "\"\n");
  const auto r = run_brume("render " + path("floor.toml") + kTiny + "--spp 4 --clean -o " + path("floor.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_FALSE(holds(r.err, "has no guides")) << r.err;
}

TEST_F(Clean, RecordedPartsAreCleanTooAndAddUp) {
  const std::string fire = test::source("data/scenes/fire.toml").string();
  const std::string parts =
      "single,surface,background,emission,volume_indirect,surface_indirect,surface_emission,transmittance";
  const std::string render = "render " + fire + kTiny + "--spp 4 -q --layers direct,indirect," + parts;
  for (const char* clean : {" --clean", " --clean-filter gaussian"}) {
    ASSERT_EQ(run_brume(render + clean + " -o " + path("fire.exr")).status, 0);
    const Layers frame = read_exr(folder_ / "fire.exr");
    EXPECT_LT(difference(frame, {"direct"}, {"single", "surface", "background", "emission"}), 1e-4f);
    EXPECT_LT(difference(frame, {"indirect"}, {"volume_indirect", "surface_indirect"}), 1e-4f);
    const std::vector<std::string> direct = {"clean_single", "clean_surface", "clean_background", "clean_emission"},
                                   indirect = {"clean_volume_indirect", "clean_surface_indirect"};
    std::vector<std::string> all = direct;
    all.insert(all.end(), indirect.begin(), indirect.end());
    EXPECT_LT(difference(frame, {""}, all), 1e-4f) << clean;
    if (frame.find("clean_direct.R")) {
      EXPECT_LT(difference(frame, {"clean_direct"}, direct), 1e-4f);
      EXPECT_LT(difference(frame, {"clean_indirect"}, indirect), 1e-4f);
    }
    EXPECT_GT(difference(frame, {"clean_single"}, {"single"}), 1e-3f) << clean << ": the part was filtered";
    EXPECT_GT(difference(frame, {"clean_surface"}, {"clean_surface_emission"}), 1e-2f) << "the floor emits nothing";
  }
  // What passes the medium is known without noise, where there are guides.
  ASSERT_EQ(run_brume(render + " --clean -o " + path("fire.exr")).status, 0);
  ASSERT_EQ(run_brume("render " + fire + kTiny + "--spp 512 --seed 3 -q --layers transmittance -o " + path("exact.exr"))
                .status,
            0);
  const Layers frame = read_exr(folder_ / "fire.exr"), exact = read_exr(folder_ / "exact.exr");
  // Guides that are kept are not stored in 16 bits, and change nothing that is seen.
  ASSERT_EQ(run_brume(render + ",guides --clean -o " + path("kept.exr")).status, 0);
  const Layers kept = read_exr(folder_ / "kept.exr");
  double apart = 0, filtered = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const float single = frame.at("clean_single.G")(x, y);
      apart += std::pow(kept.at("clean_single.G")(x, y) - single, 2);
      filtered += std::pow(frame.at("single.G")(x, y) - single, 2);
    }
  EXPECT_LT(apart, 0.01 * filtered);
  double clean = 0, noisy = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const double truth = exact.at("transmittance.G")(x, y);
      clean += std::pow(frame.at("clean_transmittance.G")(x, y) - truth, 2);
      noisy += std::pow(frame.at("transmittance.G")(x, y) - truth, 2);
    }
  EXPECT_LT(clean, 0.1 * noisy);
}

// Denoisers made for surfaces read albedo and normal, bilateral ones transmittance: the render records what they can
// use.
TEST_F(Clean, RecordsTheFeaturesOfItsFilter) {
  for (const auto& [filter, layer] :
       {std::pair("sbf", "transmittance.R"), {"guided", "transmittance.R"}, {"least_risk", "normal.X"}}) {
    const auto r = run_brume("render " + kSmoke + kTiny + "--spp 4 --clean-filter " + filter + " -o " + path("f.exr"));
    ASSERT_EQ(r.status, 0) << r.err;
    EXPECT_NE(read_exr(folder_ / "f.exr").find(layer), nullptr) << filter;
  }
  const auto r = run_brume("render " + kSmoke + kTiny + "--spp 4 --clean -o " + path("f.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_EQ(read_exr(folder_ / "f.exr").find("normal.X"), nullptr) << "guides say more";
}

// A square in front of the lower half of a ball of fog: nothing is seen behind it, and alpha says so.
TEST_F(Clean, BehindAHoldoutThereIsNothing) {
  test::write_file(folder_ / "square.obj", "v -2 -1.5 0\nv 2 -1.5 0\nv 2 -1.5 -3\nv -2 -1.5 -3\nf 1 2 3 4\n");
  test::write_file(folder_ / "hold.toml",
                   "[camera]\nposition = [0, -6, 0]\nlook_at = [0, 0, 0]\nup = [0, 0, 1]\nfov = 30\n"
                   "[environment]\nradiance = [0.5, 0.6, 0.7]\nvisible_to_camera = false\n"
                   "[[volumes]]\nshape = \"sphere\"\nlo = [-1, -1, -1]\nhi = [1, 1, 1]\nsigma_t = 3\nalbedo = 0.9\n"
                   "[[lights]]\ntype = \"sun\"\ndirection = [0, -1, 1]\nirradiance = [3, 3, 3]\n"
                   "[[surfaces]]\nfile = \"square.obj\"\nrole = \"holdout\"\n");
  for (const std::string filter : {"", " --clean-filter sbf"}) {
    const std::string layers =
        filter.empty() ? "direct,indirect,transmittance,guides" : "direct,indirect,transmittance";
    const auto r = run_brume("render " + path("hold.toml") + kTiny + "--spp 32 --clean" + filter + " --layers " +
                             layers + " -o " + path("hold.exr"));
    ASSERT_EQ(r.status, 0) << r.err;
    const Layers frame = read_exr(folder_ / "hold.exr");
    float open = 0;
    double edge = 0;
    for (int x = 0; x < frame.width(); ++x) {
      for (int y = 0; y < frame.height(); ++y) {
        const float passed = frame.at("clean_transmittance.G")(x, y);
        // The square's upper edge is the middle of the picture.
        if (y >= frame.height() / 2) {
          ASSERT_EQ(frame.at("A")(x, y), 0.0f) << x << "," << y;
          ASSERT_EQ(passed, 1.0f) << filter << " " << x << "," << y;
          if (filter.empty()) {
            ASSERT_EQ(frame.at("guide.opacity.Y")(x, y), 0.0f) << x << "," << y;
          }
          for (const char* channel : {"R", "G", "B"}) ASSERT_EQ(frame.at(channel)(x, y), 0.0f) << filter;
        } else {
          open = std::max(open, 1 - passed);
        }
      }
      const int y = frame.height() / 2 - 1;  // the last row above it
      edge += static_cast<double>(1 - frame.at("clean_transmittance.G")(x, y) - frame.at("A")(x, y));
    }
    EXPECT_GT(open, 0.9f) << "the upper half is there";
    EXPECT_LT(std::abs(edge), 0.02 * frame.width()) << filter << ": the edge is where it was";
  }
}

TEST_F(Clean, AMissedTargetSaysSo) {
  const auto r = run_brume("render " + kSmoke + kTiny + "--spp 16 --clean --target-error 1e-5 -o " + path("smoke.exr"));
  EXPECT_EQ(r.status, 1);
  EXPECT_TRUE(holds(r.err, "not reached")) << r.err;
}

TEST_F(Clean, SobelGuidedSamplesByItsOwnMap) {
  const auto r =
      run_brume("render " + kSmoke + kTiny + "--clean-filter sobel_guided --time 2s --spp 64 -o " + path("smoke.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  const Layers frame = read_exr(folder_ / "smoke.exr");
  EXPECT_TRUE(frame.find("sampling_map.Y"));
  EXPECT_TRUE(frame.find("noisy.R"));
}

TEST_F(Clean, DenoisingACleanFrameStartsFromTheRawOne) {
  ASSERT_EQ(run_brume("render " + kSmoke + kTiny + "--spp 4 --clean -q -o " + path("clean.exr")).status, 0);
  ASSERT_EQ(run_brume("render " + kSmoke + kTiny + "--spp 4 -q -o " + path("raw.exr")).status, 0);
  for (const char* name : {"clean", "raw"})
    ASSERT_EQ(run_brume("denoise " + path(std::string(name) + ".exr") + " -f gaussian -q -o " +
                        path(std::string(name) + "_gaussian.exr"))
                  .status,
              0);
  const Layers a = read_exr(folder_ / "clean_gaussian.exr"), b = read_exr(folder_ / "raw_gaussian.exr");
  for (const char* channel : {"R", "G", "B"}) EXPECT_EQ(a.at(channel)(20, 20), b.at(channel)(20, 20)) << channel;
}

TEST_F(Clean, BadInputIsRefused) {
  EXPECT_TRUE(holds(refused("render " + kSmoke + kTiny + "--spp 8 --part 1/2 --clean"), "merged"));
  EXPECT_TRUE(
      holds(refused("render " + kSmoke + kTiny + "--clean-filter nfor --target-error 0.1"), "estimates its error"));
  EXPECT_TRUE(holds(refused("render " + kSmoke + kTiny + "--clean-filter random_parameter"), "record"));
  EXPECT_TRUE(holds(refused("render " + kSmoke + kTiny + "--save-scene " + path("a.toml")), "is a scene"));
  EXPECT_TRUE(holds(refused("render " + kSmoke + kTiny + "--clean-filter nforr"), "nfor"));
  // Before anything is rendered: these samples would take an hour.
  const std::string one = refused("render " + kSmoke + kTiny + "--clean-filter nfor --spp 1");
  EXPECT_TRUE(holds(one, "--clean-filter nfor")) << one;
  EXPECT_TRUE(holds(one, "Render with --spp 2 or more")) << one;
  EXPECT_FALSE(holds(one, "paths")) << "it was rendered: " << one;
  EXPECT_TRUE(
      holds(refused("render " + kSmoke + kTiny + "--clean-filter nl_means --spp 1"), "buffers=one works without"));
  EXPECT_TRUE(holds(refused("render " + kSmoke + kTiny + "--clean --outliers none"), "--outliers"));
  EXPECT_TRUE(holds(refused("render " + kSmoke + kTiny + "--outliers keep"), "expected --clean"));
  const auto fog = folder_ / "empty.vdb";
  test::write_affine_vdb(fog, {{0, 0, 0}, {7, 7, 7}}, dmat4(1.0), [](const ivec3&) { return 0.0f; });
  EXPECT_TRUE(holds(refused("render " + fog.string() + " --clean"), "empty"));
}

// A scale of metres, micrometres or light years is the volume's own affair.
TEST_F(Clean, AVolumeOfAnyScaleGivesTheSamePicture) {
  Layers first;
  for (const double scale : {1.0, 0x1p-14, 0x1p14}) {
    const auto file = folder_ / "block.vdb";
    write_density(
        file, {{0, 0, 0}, {15, 15, 15}}, scale,
        [](const ivec3& v) { return 0.2f + 0.8f * static_cast<float>((v.x * 7 + v.y * 3 + v.z) % 5) / 5; },
        /*half=*/false);
    const auto r = run_brume("render " + file.string() + kTiny + "--spp 4 --clean -o " + path("block.exr"));
    ASSERT_EQ(r.status, 0) << r.err;
    if (scale != 1) {
      EXPECT_TRUE(holds(r.err, "taken as they are")) << r.err;
    }
    Layers frame = read_exr(folder_ / "block.exr");
    if (scale == 1) {
      first = std::move(frame);
      continue;
    }
    double difference = 0;
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) difference += std::abs(frame.at("G")(x, y) - first.at("G")(x, y));
    EXPECT_LT(difference / (frame.width() * frame.height()), 0.01) << scale;
  }
}

/// The sum of layers by what stands before their groups' names, at a pixel.
double sum_of_groups(const Layers& frame, const std::string& prefix, int x, int y) {
  double sum = 0;
  for (const char* group : {"sky", "sun", "point"}) sum += static_cast<double>(frame.at(prefix + group + ".G")(x, y));
  return sum;
}

double rms_difference(const Layers& a, const Layers& b) {
  double sum = 0;
  for (int y = 0; y < a.height(); ++y)
    for (int x = 0; x < a.width(); ++x) {
      const double difference = static_cast<double>(a.at("G")(x, y)) - static_cast<double>(b.at("G")(x, y));
      sum += difference * difference;
    }
  return std::sqrt(sum / (a.width() * a.height()));
}

TEST_F(Clean, LightGroupsAddUpAndAreMixed) {
  test::write_file(folder_ / "lit.toml", fmt::format(R"(
[camera]
position = [0, -5, 1.5]
look_at = [0, 0, 1]
[film]
width = 48
height = 36
[environment]
radiance = [0.2, 0.3, 0.4]
[[volumes]]
file = "{}"
grid = "density_noise"
sigma_t = 8
object_to_world = [[1, 0, 0, -1], [0, 1, 0, -1], [0, 0, 1, 0], [0, 0, 0, 1]]
[[lights]]
type = "sun"
direction = [1, -1, 1]
irradiance = 2
[[lights]]
type = "point"
position = [0, 0, 9]
intensity = 1
enabled = false
[[lights]]
type = "point"
position = [-1.5, -1.5, 1]
intensity = [1, 0.5, 0.25]
)",
                                                     test::source("data/volumes/smoke.vdb").string()));
  const std::string render = "render " + path("lit.toml") + " --spp 4 --progress none --clean -o ";
  ASSERT_EQ(run_brume(render + path("plain.exr")).status, 0);
  auto r = run_brume(render + path("groups.exr") + " -D render.light_groups=true");
  ASSERT_EQ(r.status, 0) << r.err;
  const Layers plain = read_exr(folder_ / "plain.exr"), frame = read_exr(folder_ / "groups.exr");
  EXPECT_FALSE(frame.find("light.sun.predicted_direct.R")) << "guides are kept only where they are asked for";
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      const float clean = frame.at("G")(x, y), noisy = frame.at("noisy.G")(x, y);
      EXPECT_LE(std::abs(sum_of_groups(frame, "clean_light.", x, y) - static_cast<double>(clean)),
                std::nextafter(clean, 1e9f) - clean);
      EXPECT_NEAR(sum_of_groups(frame, "light.", x, y), noisy, 1e-6 * static_cast<double>(noisy));
      EXPECT_EQ(noisy, plain.at("noisy.G")(x, y));
    }

  ASSERT_EQ(run_brume("render " + path("lit.toml") + " --spp 512 --seed 2 -q -o " + path("reference.exr")).status, 0);
  const Layers reference = read_exr(folder_ / "reference.exr");
  const double with = rms_difference(frame, reference), without = rms_difference(plain, reference);
  EXPECT_LT(with, without) << "the picture goes towards the sum of groups that have light samples of their own";

  r = run_brume("mix " + path("groups.exr") + " --gain sun=2,sky=0 --colour point=1,.5,2 -o " + path("mixed.exr") +
                " --scene " + path("lit.toml") + " --save-scene " + path("mixed.toml"));
  EXPECT_EQ(r.status, 2) << "the scene has no groups by itself";
  r = run_brume("mix " + path("groups.exr") + " --gain sun=2,sky=0 --colour point=1,.5,2 -o " + path("mixed.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  const Layers mixed = read_exr(folder_ / "mixed.exr");
  EXPECT_FALSE(mixed.find("direct.G")) << "not known by group";
  EXPECT_TRUE(mixed.find("A"));
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x)
      EXPECT_NEAR(mixed.at("G")(x, y),
                  2 * frame.at("clean_light.sun.G")(x, y) + 0.5f * frame.at("clean_light.point.G")(x, y),
                  1e-6 * static_cast<double>(mixed.at("G")(x, y)) + 1e-9);

  const std::string text = test::read_file(folder_ / "lit.toml");
  test::write_file(folder_ / "grouped.toml", text + "[render]\nlight_groups = true\n");
  r = run_brume("mix " + path("groups.exr") + " --gain sun=2,sky=0 --colour point=1,.5,2 -o " + path("again.exr") +
                " --scene " + path("grouped.toml") + " --save-scene " + path("mixed.toml"));
  ASSERT_EQ(r.status, 0) << r.err;
  r = run_brume("render " + path("mixed.toml") + " --spp 4 --progress none -o " + path("rendered.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  const Layers rendered = read_exr(folder_ / "rendered.exr");
  EXPECT_FALSE(rendered.find("light.sky.G")) << "a black sky is no light";
  const std::string scene = test::read_file(folder_ / "mixed.toml");
  EXPECT_TRUE(holds(scene, "irradiance = [4")) << scene;
  EXPECT_TRUE(holds(scene, "intensity = [1, 0.25, 0.5]")) << scene;

  EXPECT_TRUE(
      holds(run_brume("mix " + path("groups.exr") + " --gain key=2 -o " + path("x.exr")).err, "no light group 'key'"));
  EXPECT_TRUE(
      holds(run_brume("mix " + path("plain.exr") + " --gain sun=2 -o " + path("x.exr")).err, "no light groups"));
  EXPECT_TRUE(
      holds(run_brume("mix " + path("groups.exr") + " --gain sun=-2 -o " + path("x.exr")).err, "expected GROUP="));
}

}  // namespace
}  // namespace brume
