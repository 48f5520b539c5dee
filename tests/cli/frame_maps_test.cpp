// What is refused and what is said of it, and maps that name what a file holds.

#include <gtest/gtest.h>

#include "image/exr_io.h"
#include "tests/support/cycles_frame.h"
#include "tests/support/exr_files.h"
#include "tests/support/files.h"
#include "tests/support/foreign_frames.h"

namespace brume {
namespace {

using test::channels_of;
using test::cycles_header;
using test::cycles_value;
using test::Frames;
using test::header_of;
using test::holds;
using test::kHeight;
using test::kWidth;
using test::noisy;
using test::run_brume;

TEST_F(Frames, TwoCandidatesAreListedAndAMapDecides) {
  write({{header_of({":RGB", "albedo:RGB", "diffuse_albedo:RGB"}, Imf::FLOAT), noisy}});
  EXPECT_TRUE(holds(refused(), "the albedo could be any of albedo, diffuse_albedo; say which in a mapping file"));
  test::write_file(path("layers.toml"), "color = \"\"\nalbedo = \"diffuse_albedo\"\n");
  denoise("-f bilateral --map " + path("layers.toml"));
  expect_kept_but({""});
}

TEST_F(Frames, AMapNamesPassesVarianceAndSamples) {
  write({{header_of({"look.dev:RGB", "fog:rgb", "fog noise:rgb", "rest of it:RGB", "cnt:Y", "odd:RGB", "even:RGB"},
                    Imf::FLOAT),
          [](const std::string& channel, int x, int y) {
            if (channel == "cnt.Y") return 4.0;
            if (!holds(channel, "look.dev")) return noisy(channel, x, y);
            const char c = channel.back();
            return noisy(std::string("fog.") + static_cast<char>(std::tolower(c)), x, y) +
                   noisy(std::string("rest of it.") + c, x, y);
          }}});
  test::write_file(
      path("layers.toml"),
      "renderer = \"House\"\ncolor = [\"look.dev.R\", \"look.dev.G\", \"look.dev.B\"]\nsample_count = \"cnt\"\n"
      "halves = [\"odd\", \"even\"]\n"
      "[[passes]]\nlayer = \"fog\"\nvariance = \"fog noise\"\nvariance_is = \"samples\"\nindirect = true\n"
      "[[passes]]\nlayer = \"rest of it\"\n");
  const std::string said = denoise("-f sbf --map " + path("layers.toml"));
  EXPECT_TRUE(holds(said, "House: cleaned fog, rest of it with sbf, dev = fog + rest of it")) << said;
  EXPECT_TRUE(holds(said, "no variance in the file for rest of it: estimated")) << said;
}

TEST_F(Frames, AMapsMistakesAreUnderlined) {
  Imf::Header header = header_of({":RGB", "albedo:RGB", "CryptoObject00:RGB"}, Imf::FLOAT);
  test::add_channels(header, channels_of("id"), Imf::UINT);
  write({{header, noisy}});
  const std::pair<std::string, std::string> mistakes[] = {
      {"color = \"\"\nalbdo = \"albedo\"\n", "unknown key 'albdo'; did you mean 'albedo'?"},
      {"color = \"\"\nalbedo = \"albeda\"\n",
       "the file has no layer 'albeda' of three channels R G B or X Y Z; did you mean 'albedo'?"},
      {"color = [\"R\", \"G\", \"b\"]\n", "the file has no channel 'b'"},
      {"color = \"CryptoObject00\"\n", "holds identities, which are never filtered"},
      {"color = \"id\"\n", "holds identities, which are never filtered"},
      {"albedo = \"albedo\"\n", "the map has no 'color'"},
      {"color = \"\"\nsamples = 0\n", "'samples' is out of range"},
      {"color = \"\"\nvariance = \"albedo\"\nvariance_is = \"men\"\n",
       "'variance_is' cannot be 'men'; did you mean 'mean'?"},
      {"color = \"\"\nvariance_is = \"mean\"\n", "'variance_is' stands without 'variance'"},
      {"color = \"\"\nhalves = [\"albedo\"]\n", "'halves' are not two"},
      {"color = \"\"\n[[passes]]\nindirect = true\n", "a pass has no 'layer'"},
      {"color = \"\"\n[[passes]]\nlayer = \"\"\n", "a pass is the picture itself"},
      {"color = \"\"\n[[passes]]\nlayer = \"albedo\"\n[[passes]]\nlayer = \"albedo\"\n", "a pass is named twice"},
      {"color = \"\n", "layers.toml"},
  };
  for (const auto& [map, message] : mistakes) {
    test::write_file(path("layers.toml"), map);
    const std::string said = refused("-f bilateral --map " + path("layers.toml"));
    EXPECT_TRUE(holds(said, message)) << said;
    EXPECT_TRUE(holds(said, "layers.toml")) << said;
  }
  EXPECT_TRUE(holds(refused("--map " + path("none.toml")), "none.toml: no such file"));
}

TEST_F(Frames, DamagedFilesAreRefused) {
  test::write_file(in, "");
  EXPECT_TRUE(holds(refused(), "is empty, 0 bytes"));
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  const std::string bytes = test::read_file(in);
  for (const size_t size : {bytes.size() / 10, bytes.size() / 2, bytes.size() - 5}) {
    test::write_file(in, bytes.substr(0, size));
    const std::string said = refused();
    EXPECT_TRUE(holds(said, "shot.exr")) << said;
  }
}

TEST_F(Frames, TheInputIsNeverWrittenOver) {
  write({{cycles_header(Imf::FLOAT), cycles_value}});
  const std::string bytes = test::read_file(in);
  const auto r = run_brume("denoise " + in + " -o " + in + " -f bilateral");
  EXPECT_EQ(r.status, 2);
  EXPECT_TRUE(holds(r.err, "would be destroyed")) << r.err;
  EXPECT_EQ(test::read_file(in), bytes);
}

TEST_F(Frames, WholeNumbersAreNoLight) {
  write({{header_of({":RGB"}, Imf::UINT), [](const std::string&, int, int) { return 3.0; }}});
  EXPECT_TRUE(holds(refused(), "channel B holds whole numbers"));
}

TEST_F(Frames, BrumesOwnFramesAreKeptWhereAsked) {
  write_exr(in, test::noisy_frame(kWidth, kHeight, 3));
  denoise("-f bilateral");
  EXPECT_EQ(read_exr(out).find("gradient.X"), nullptr) << "as ever";
  const std::string said = denoise("-f bilateral --keep-file");
  expect_kept_but({"", "direct", "indirect"});
  EXPECT_TRUE(holds(said, "RGB = direct + indirect")) << said;
  EXPECT_FALSE(holds(said, "no variance in the file for direct, indirect")) << said;
  const Layers frame = read_exr(out);
  EXPECT_EQ(frame.at("R")(4, 4), frame.at("direct.R")(4, 4) + frame.at("indirect.R")(4, 4));
}

}  // namespace
}  // namespace brume
