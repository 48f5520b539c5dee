// What a person gets who says as little as possible, and what the program says to them.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "image/exr_io.h"
#include "image/picture_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

using nlohmann::json;
using test::run_brume;

const std::string kScene = test::source("data/scenes/smoke.toml").string();
const std::string kTiny = " -D film.width=16 -D film.height=12 ";

class Defaults : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  /// A frame whose layers hold a slope.
  std::string frame(const std::string& name, const std::vector<LayerName>& layers) {
    Layers frame(20, 16);
    frame.header["software"] = std::string("brume");  // which other renderers' frames are not
    for (const LayerName& l : layers)
      for (const std::string& channel : l.channel_names()) {
        Plane& plane = frame.add(channel);
        for (int y = 0; y < 16; ++y)
          for (int x = 0; x < 20; ++x) plane(x, y) = 0.1f * static_cast<float>(x) + 0.01f * static_cast<float>(y);
      }
    write_exr(folder_ / name, frame);
    return path(name);
  }
  std::string rendered(const std::string& options, const std::string& name = "frame.exr", int spp = 4) {
    const auto r =
        run_brume("render " + kScene + kTiny + "--spp " + std::to_string(spp) + " -q " + options + " -o " + path(name));
    EXPECT_EQ(r.status, 0) << r.err;
    return path(name);
  }
  std::string parameters(const std::string& name) const { return read_exr(folder_ / name).text("filterParameters"); }
  /// Runs what must be refused and returns the message.
  std::string refused(const std::string& arguments) {
    const auto r = run_brume(arguments);
    EXPECT_EQ(r.status, 2) << arguments << "\n" << r.err;
    return r.err;
  }
  test::TemporaryFolder folder_;
};

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

TEST_F(Defaults, OneSampleHasNoSecondHalf) {
  const std::string one = rendered("", "one.exr", 1);
  EXPECT_TRUE(holds(refused("denoise " + one + " -f nfor -o " + path("nfor.exr")), "--spp 2"));
  EXPECT_EQ(run_brume("denoise " + one + " -q -o " + path("clean.exr")).status, 0);
  EXPECT_NE(read_exr(folder_ / "clean.exr").text("filter"), "nfor");
  EXPECT_TRUE(holds(refused("evaluate " + kScene + " --spp 1,4 -f nfor -o " + path("results")), "second is empty"));
}

TEST_F(Defaults, DenoiseTakesTheBestFilterThatTheLayersAllow) {
  const json filters = json::parse(run_brume("filters --json").out)["filters"];
  const auto merit = [&](const std::string& name) {
    for (const json& f : filters)
      if (f["name"] == name) return f["merit"].get<double>();
    return -1.0;
  };
  const auto chosen = [&](const std::string& in, std::string& said) {
    const auto r = run_brume("denoise " + in + " -o " + path("clean.exr"));
    EXPECT_EQ(r.status, 0) << r.err;
    const Layers clean = read_exr(folder_ / "clean.exr");
    EXPECT_EQ(clean.text("filterComponent"), "all");
    said = r.err;
    EXPECT_TRUE(holds(said, clean.text("filter") + ": the best filter for the layers of this frame")) << said;
    return clean.text("filter");
  };
  std::string with_everything, with_statistics, with_nothing;
  const std::string best = chosen(rendered("--buckets"), with_everything);
  const std::string usual = chosen(rendered(""), with_statistics);
  const std::string plain = chosen(frame("plain.exr", {layer::beauty}), with_nothing);
  EXPECT_GE(merit(best), merit(usual));
  EXPECT_GE(merit(usual), merit(plain));
  EXPECT_TRUE(holds(with_nothing, "more of brume render would make it better")) << with_nothing;
  EXPECT_TRUE(holds(with_nothing, "the frame has no statistics: its noise is estimated from the picture"))
      << with_nothing;
}

TEST_F(Defaults, DenoiseCleansTheWholePictureAndThePapersProtocolTheIndirectLight) {
  const auto has_default = [](const std::string& help, const std::string& value) {
    return holds(help, "}=" + value) || holds(help, "} [" + value + "]");  // as CLI11 2.3 and 2.4 print it
  };
  EXPECT_TRUE(has_default(run_brume("denoise --help").out, "all"));
  EXPECT_TRUE(has_default(run_brume("evaluate --help").out, "indirect"));
}

TEST_F(Defaults, WhatFollowsAFilterIsItsOwn) {
  const std::string in = "denoise " + frame("in.exr", {layer::beauty, layer::gradient}) + " -q ";
  const auto ran = [&](const std::string& options) {
    const auto r = run_brume(in + options + " -o " + path("o.exr"));
    EXPECT_EQ(r.status, 0) << r.err;
  };
  ran("-f bilateral --radius 3 -f a_trous --levels 2 --sigma-color=7");
  EXPECT_TRUE(holds(parameters("o.bilateral.exr"), "radius=3 "));
  EXPECT_TRUE(holds(parameters("o.a_trous.exr"), "levels=2")) << parameters("o.a_trous.exr");
  ran("-f bilateral --radius 3 -f guided --radius 4");
  EXPECT_TRUE(holds(parameters("o.bilateral.exr"), "radius=3 "));
  EXPECT_TRUE(holds(parameters("o.guided.exr"), "radius=4 "));
  ran("--radius 2 -f bilateral -f trilateral:sigma-spatial=1 --radius 5 --filter=bilateral:radius=1");
  EXPECT_TRUE(holds(parameters("o.bilateral.exr"), "radius=2 ")) << "before the first -f: for every filter";
  EXPECT_TRUE(holds(parameters("o.trilateral.exr"), "radius=5 ")) << "its own comes last";
  EXPECT_TRUE(holds(parameters("o.trilateral.exr"), "sigma-spatial=1 "));
  EXPECT_TRUE(holds(parameters("o.bilateral.2.exr"), "radius=1 "));
}

TEST_F(Defaults, AParameterWithoutItsFilterIsRefused) {
  const std::string in = "denoise " + frame("in.exr", {layer::beauty}) + " -o " + path("o.exr");
  const std::string alone = refused(in + " --radius 3");
  EXPECT_TRUE(holds(alone, "denoise has no option '--radius'")) << alone;
  EXPECT_TRUE(holds(alone, "-f NAME --radius VALUE")) << alone;
  EXPECT_TRUE(holds(refused(in + " --exposur 3"), "did you mean '--exposure'?"));
  EXPECT_TRUE(holds(refused(in + " -f bilateral --radius"), "--radius has no value; it follows -f bilateral"));
  EXPECT_TRUE(holds(refused(in + " -f bilateral --radius --quiet"), "--radius has no value"));
}

TEST_F(Defaults, FiltersStandInTheOrderOfTheirMerit) {
  const json filters = json::parse(run_brume("filters --json").out)["filters"];
  ASSERT_FALSE(filters.empty());
  double last = std::numeric_limits<double>::infinity();
  for (const json& f : filters) {
    EXPECT_LE(f["merit"].get<double>(), last) << f["name"];
    EXPECT_FALSE(f["take_it"].get<std::string>().empty()) << f["name"];
    last = f["merit"];
  }
}

TEST_F(Defaults, GuidedRefusesToBlurWithoutFeatures) {
  const std::string plain = frame("plain.exr", {layer::beauty});
  const std::string said = refused("denoise " + plain + " -f guided -o " + path("o.exr"));
  EXPECT_TRUE(holds(said, "filter guided is led by features, and the frame has none")) << said;
  EXPECT_TRUE(holds(said, "transmittance")) << "the layers they are made from";
}

TEST_F(Defaults, AnyLayerBecomesAPicture) {
  Layers layers(2, 1);
  for (Plane* plane : layers.add_rgb(layer::beauty)) (*plane)(1, 0) = 4.0f;
  layers.add("coverage.A")(0, 0) = 0.5f;
  for (const std::string& channel : layer::gradient.channel_names()) layers.add(channel)(0, 0) = -0.25f;
  layers.header["exposure"] = 0.125f;
  write_exr(folder_ / "f.exr", layers);
  const auto shown = [&](const std::string& options, int x) {
    const auto r = run_brume("picture " + path("f.exr") + " -o " + path("f.png") + " " + options);
    EXPECT_EQ(r.status, 0) << r.err;
    return static_cast<double>(read_any_picture(folder_ / "f.png").at("G")(x, 0));
  };
  const double step = 0.01;  // of 8 bits, in the light tones
  EXPECT_NEAR(shown("", 1), 0.5, step) << "the header's exposure";
  EXPECT_NEAR(shown("--exposure 0.05", 1), 0.2, step);
  EXPECT_EQ(shown("--exposure 1", 1), 1.0) << "clipped";
  EXPECT_NEAR(shown("--exposure 1 --tone filmic", 1), 1 - 0.82 / (1 + 3.82 / 0.82), step);
  EXPECT_NEAR(shown("--layer coverage", 0), 0.5, step) << "no radiance: the exposure is 1";
  EXPECT_NEAR(shown("--layer gradient", 0), 0.25, step);
  const std::string none = refused("picture " + path("f.exr") + " -o " + path("g.png") + " --layer direct");
  EXPECT_TRUE(holds(none, "has no layer 'direct' to show; it has: beauty, coverage, gradient")) << none;
}

TEST_F(Defaults, RenderAndDenoiseTakeExposureAndTone) {
  const std::string in = rendered("--png " + path("a.png") + " --exposure 4 --tone filmic");
  rendered("--png " + path("b.png"), "b.exr");
  EXPECT_NE(test::read_file(folder_ / "a.png"), test::read_file(folder_ / "b.png"));
  const std::string denoise = "denoise -q " + in + " -f gaussian -o " + path("o.exr") + " --exposure 4 --png ";
  ASSERT_EQ(run_brume(denoise + path("c.png") + " --tone filmic").status, 0);
  ASSERT_EQ(run_brume(denoise + path("d.png")).status, 0);
  EXPECT_NE(test::read_file(folder_ / "c.png"), test::read_file(folder_ / "d.png"));
}

TEST_F(Defaults, AnExposureThatIsNoneIsRefusedBeforeTheWork) {
  const std::string said = refused("render " + kScene + kTiny + "--exposure dark -o " + path("o.exr"));
  EXPECT_TRUE(holds(said, "--exposure: 'dark': expected header, auto or a number above 0")) << said;
  EXPECT_FALSE(std::filesystem::exists(folder_ / "o.exr"));
}

TEST_F(Defaults, NumbersAreDecimalWhateverTheirZeros) {
  EXPECT_EQ(read_exr_info(rendered("--seed 010")).header.at("seed"), Attribute(std::string("10")));
  EXPECT_EQ(read_exr_info(rendered("--seed 08 --threads 01")).header.at("seed"), Attribute(std::string("8")));
  EXPECT_EQ(read_exr_info(rendered("--seed 0")).header.at("seed"), Attribute(std::string("0")));
}

TEST_F(Defaults, ASceneIsNoHostOfAViewer) {
  const auto r = run_brume("render --tev " + kScene + kTiny + " -o " + path("o.exr"));
  EXPECT_FALSE(holds(r.err, "scene is required")) << r.err;
  EXPECT_FALSE(holds(r.err, "smoke.toml:14158")) << r.err;
}

TEST_F(Defaults, EveryLineOnStderrHasOnePrefix) {
  const std::string frame = path("frame.exr");
  for (const std::string& arguments :
       {"render " + kScene + kTiny + "-D camera.look_at=[0,-20,0] -o " + frame,
        "denoise " + frame + " -o " + path("c.exr"), "denoise " + frame + " -f bilatral -o " + path("d.exr"),
        "compare " + frame, std::string("rendr")}) {
    std::istringstream lines(run_brume(arguments).err);
    int count = 0;
    for (std::string line; std::getline(lines, line); ++count) EXPECT_TRUE(line.starts_with("brume: ")) << line;
    EXPECT_GT(count, 0) << arguments;
  }
}

TEST_F(Defaults, ARemarkIsMadeOnceForAllFrames) {
  for (const int number : {1, 2}) {
    Layers layers(12, 10);
    for (const char* channel : {"R", "G", "B"}) layers.add(std::string("Layer.Combined.") + channel, 0.5f);
    write_exr(folder_ / ("shot." + std::to_string(number) + ".exr"), layers);
  }
  const auto r = run_brume("compare " + path("shot.1.exr") + " " + path("shot.2.exr"));
  ASSERT_EQ(r.status, 0) << r.err;
  const std::string remark = "read as Blender Cycles multilayer 'Layer'";
  const size_t first = r.err.find(remark);
  ASSERT_NE(first, std::string::npos) << r.err;
  EXPECT_EQ(r.err.find(remark, first + 1), std::string::npos) << r.err;
}

TEST_F(Defaults, AnUnreadableSetOfChannelsIsNamed) {
  const std::string odd = frame("odd.exr", {LayerName{"", "Y", ""}, LayerName{"Noisy Image", "RGB", ""}});
  const std::string named = "it has: Noisy Image, Y";
  for (const std::string& arguments :
       {"denoise " + odd + " -o " + path("o.exr"), "denoise " + odd + " -f bilateral -o " + path("o.exr"),
        "compare " + odd + " " + odd}) {
    const std::string said = refused(arguments);
    EXPECT_TRUE(holds(said, named)) << said;
  }
}

TEST_F(Defaults, PartsOfUnlikeScenesNameTheKeyThatDiffers) {
  const std::string a = rendered("--part 1/2", "a.exr"), b = rendered("--part 2/2 -D volumes.0.g=0.25", "b.exr");
  const std::string said = refused("merge " + a + " " + b + " -o " + path("m.exr"));
  EXPECT_TRUE(holds(said, "volumes.0.g is 0.25 in the first, ")) << said;
  EXPECT_FALSE(holds(said, "fingerprint")) << said;
  rendered("--checkpoint " + path("state.exr"), "c.exr");
  const std::string resumed =
      refused("render " + kScene + kTiny + "-D camera.fov=33 --resume " + path("state.exr") + " -o " + path("d.exr"));
  EXPECT_TRUE(holds(resumed, "camera.fov is 26.5 in the first, 33 in the second")) << resumed;
}

TEST_F(Defaults, TheSizeOfAPictureIsOneOption) {
  const auto size = [&](const std::string& options) {
    const auto r = run_brume("render " + kScene + " --spp 1 -q --layers none " + options + " -o " + path("sized.exr"));
    EXPECT_EQ(r.status, 0) << r.err;
    const Layers frame = read_exr(path("sized.exr"));
    return ivec2(frame.width(), frame.height());
  };
  EXPECT_EQ(size("--size 20x12"), ivec2(20, 12));
  EXPECT_EQ(size("--size 20x12 -D film.width=8 -D camera.fov=20"), ivec2(20, 12));
  const auto none = run_brume("render " + kScene + " --size 0x12 -o " + path("none.exr"));
  EXPECT_EQ(none.status, 2);
  EXPECT_TRUE(holds(none.err, "film.width=0")) << none.err;
}

TEST_F(Defaults, AMissingFileNamesItsKey) {
  const std::string said = refused("render " + kScene + " -D environment.file=auto -o " + path("o.exr"));
  EXPECT_TRUE(holds(said, "'file' of [environment] is ")) << said;
  EXPECT_TRUE(holds(said, "auto: no such file")) << said;
}

TEST_F(Defaults, WhatAKilledEvaluationLeftIsNoObstacle) {
  for (const char* left : {"out.part", "out.part.dead", "out.part.mine"})
    std::filesystem::create_directory(folder_ / left);
  test::write_file(folder_ / "out.part.dead/in_use", "");
  test::write_file(folder_ / "out.part.mine/notes.txt", "keep");
  const auto r =
      run_brume("evaluate " + kScene +
                " --size 16 --spp 2 --seeds 1 --reference-spp 4 -f bilateral --no-tuning -q -o " + path("out"));
  ASSERT_EQ(r.status, 0) << r.err;
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out/table.csv"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out/in_use"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.part.dead")) << "its process is gone";
  EXPECT_TRUE(std::filesystem::exists(folder_ / "out.part.mine/notes.txt")) << "not one of ours";
  for (const auto& entry : std::filesystem::directory_iterator(folder_.path()))
    EXPECT_TRUE(!entry.path().filename().string().starts_with("out.part.") ||
                entry.path().filename() == "out.part.mine")
        << entry.path();
}

TEST_F(Defaults, AVolumesWorldBoundsArePrinted) {
  const std::string cloud = test::source("data/volumes/cloud.vdb").string();
  const json grid = json::parse(run_brume("info --json " + cloud).out)["grids"][0];
  const json &rows = grid["world_from_index"], &box = grid["box"];
  for (const size_t axis : {0u, 1u, 2u}) {  // upright, without shear
    const double scale = rows[axis][axis], offset = rows[axis][3];
    EXPECT_NEAR(grid["world_bounds"][0][axis].get<double>(), scale * (box[0][axis].get<double>() - 0.5) + offset, 1e-9);
    EXPECT_NEAR(grid["world_bounds"][1][axis].get<double>(), scale * (box[1][axis].get<double>() + 0.5) + offset, 1e-9);
  }
  EXPECT_TRUE(holds(run_brume("info " + cloud).out, "world bounds  ["));
}

TEST_F(Defaults, AFireTooFaintToBeSeenNamesItsKey) {
  const std::string render = "render " + test::source("data/scenes/fire.toml").string() +
                             " -D film.width=8 -D film.height=8 --spp 1 -q -o " + path("f.exr");
  const auto faint = run_brume(render + " -D volumes.0.blackbody_intensity=1");
  ASSERT_EQ(faint.status, 0) << faint.err;
  EXPECT_TRUE(holds(faint.err, "too faint to be seen")) << faint.err;
  EXPECT_TRUE(holds(faint.err, "with blackbody_intensity = 1; ")) << faint.err;
  EXPECT_FALSE(holds(run_brume(render).err, "too faint"));
}

}  // namespace
}  // namespace brume
