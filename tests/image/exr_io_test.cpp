#include "image/exr_io.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <gtest/gtest.h>

#include <bit>
#include <limits>

#include "base/error.h"
#include "base/rng.h"
#include "image/foreign.h"
#include "image/hdr_io.h"
#include "image/picture_io.h"
#include "tests/support/files.h"

namespace brume {
namespace {

Layers sample_frame() {
  Layers frame(37, 11);
  Plane& red = frame.add("R");
  Plane& deep = frame.add("indirect.mean_variance.G");
  for (int y = 0; y < 11; ++y)
    for (int x = 0; x < 37; ++x) {
      red(x, y) = static_cast<float>(x) - 1e20f * static_cast<float>(y);
      deep(x, y) = 1e-30f * static_cast<float>(x * y);
    }
  red(3, 4) = std::numeric_limits<float>::quiet_NaN();
  red(5, 6) = -std::numeric_limits<float>::infinity();
  frame.header["scene"] = std::string("x");
  frame.header["samplesPerPixel"] = 16;
  frame.header["exposure"] = 0.5f;
  frame.header["worldToCamera"] = std::array<float, 16>{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
  return frame;
}

TEST(Exr, EveryValueAndAttributeSurvives) {
  const test::TemporaryFolder folder;
  const Layers frame = sample_frame();
  write_exr(folder / "a.exr", frame);
  const Layers back = read_exr(folder / "a.exr");
  ASSERT_EQ(back.names(), frame.names());
  for (const auto& [name, plane] : frame.channels())
    for (int y = 0; y < 11; ++y)
      for (int x = 0; x < 37; ++x)
        EXPECT_EQ(std::bit_cast<uint32_t>(plane(x, y)), std::bit_cast<uint32_t>(back.at(name)(x, y)));
  for (const auto& [key, value] : frame.header) EXPECT_EQ(back.header.at(key), value) << key;
  EXPECT_EQ(read_exr_info(folder / "a.exr").channels.size(), 2u);
}

// From hardly any memory to enough of it: a whole file is read, or said not to fit.
TEST(Exr, TooLittleMemoryIsNotDamage) {
  if (!test::can_limit_memory()) GTEST_SKIP() << "memory cannot be limited here";
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder / "large.exr";
  {
    Layers frame(4096, 256);
    for (const char* name : {"R", "G", "B", "A", "guide.x", "guide.y"}) frame.add(name, 0.5f);
    frame.add_words("state.x");
    write_exr(path, frame);
  }
  const std::pair<const char*, std::function<void()>> readers[] = {{"info", [&] { read_exr_info(path); }},
                                                                   {"check", [&] { check_exr(path); }},
                                                                   {"pixels", [&] { read_exr(path); }},
                                                                   {"state", [&] { read_exr_state(path); }}};
  for (const auto& [name, read] : readers) {
    const auto status = [&](size_t bytes) {
      return test::status_with_memory(bytes, [&, &work = read] {
        work();
        return 0;
      });
    };
    for (size_t bytes = size_t{1} << 16; bytes < size_t{1} << 28; bytes *= 2) {
      const int found = status(bytes);
      EXPECT_TRUE(found == 0 || found == test::kOutOfMemory) << name << " with " << bytes << " bytes: " << found;
    }
    EXPECT_EQ(status(size_t{1} << 30), 0) << name;
  }
  EXPECT_EQ(test::status_with_memory(size_t{1} << 20, [&] { return read_exr(path).width(); }), test::kOutOfMemory);
}

// Noise, which packing cannot make smaller and which is stored as it is, beside smoothness, over many groups of lines.
TEST(Exr, NoiseAndWordsSurvive) {
  const test::TemporaryFolder folder;
  for (const bool smooth : {false, true}) {
    Layers frame(5, 16 * 16 + 16 * 3 + 7);
    frame.origin = {3, -2}, frame.display = {20, 400};
    std::vector<uint32_t>& words = frame.add_words("state.0000");
    Plane& plane = frame.add("G");
    Rng rng({7, 0, 0, 0});
    for (size_t i = 0; i < words.size(); ++i) {
      words[i] = smooth ? static_cast<uint32_t>(i) : rng.bits();
      plane(static_cast<int>(i % 5), static_cast<int>(i / 5)) = smooth ? 1.0f : std::bit_cast<float>(rng.bits());
    }
    write_exr(folder / "a.exr", frame);
    const size_t bytes = std::filesystem::file_size(folder / "a.exr"), plain = 2 * words.size() * sizeof(uint32_t);
    EXPECT_GE(bytes, smooth ? 0 : plain);
    EXPECT_LE(bytes, smooth ? plain / 2 : plain + 1000);
    EXPECT_EQ(*read_exr_state(folder / "a.exr").find_words("state.0000"), words);
    const Layers back = read_exr(folder / "a.exr");
    EXPECT_EQ(back.data_window(), frame.data_window()) << "overscan is kept";
    EXPECT_EQ(back.display_window(), frame.display_window());
    size_t differing = 0;
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < 5; ++x)
        differing += std::bit_cast<uint32_t>(back.at("G")(x, y)) != std::bit_cast<uint32_t>(plane(x, y));
    EXPECT_EQ(differing, 0u);
  }
}

// Two parts of one picture, each with its own data window.
TEST(Exr, PartsWithTheirOwnDataWindowsBecomeOneFrame) {
  const test::TemporaryFolder folder;
  const auto write = [&](const Imath::Box2i& first, const Imath::Box2i& second) {
    std::vector<Imf::Header> headers;
    for (const auto& [name, data] : {std::pair("left", first), {"right", second}}) {
      Imf::Header header(Imath::Box2i(Imath::V2i(0), Imath::V2i(19, 9)), data);
      header.setName(name);
      header.setType(Imf::SCANLINEIMAGE);
      header.channels().insert("Y", Imf::Channel(Imf::FLOAT));
      headers.push_back(header);
    }
    Imf::MultiPartOutputFile file((folder / "parts.exr").c_str(), headers.data(), 2);
    const std::vector<float> ones(1000, 1.0f);  // as many as any part here has pixels
    for (int part = 0; part < 2; ++part) {
      const Imath::Box2i data = headers[static_cast<size_t>(part)].dataWindow();
      Imf::FrameBuffer buffer;
      buffer.insert("Y", Imf::Slice::Make(Imf::FLOAT, ones.data(), data));
      Imf::OutputPart output(file, part);
      output.setFrameBuffer(buffer);
      output.writePixels(data.max.y - data.min.y + 1);
    }
  };
  write({{-2, 1}, {3, 4}}, {{2, 3}, {25, 8}});
  const Layers frame = read_exr(folder / "parts.exr");
  EXPECT_EQ(frame.data_window(), (PixelWindow{{-2, 1}, {26, 9}}));
  EXPECT_EQ(frame.display_window(), (PixelWindow{{0, 0}, {20, 10}}));
  double left = 0, right = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x) {
      left += frame.at("left.Y")(x, y);
      right += frame.at("right.Y")(x, y);
    }
  EXPECT_EQ(left, 6 * 4);
  EXPECT_EQ(right, 24 * 6);
  EXPECT_EQ(frame.at("left.Y")(0, 0), 1.0f);
  EXPECT_EQ(frame.at("right.Y")(27, 7), 1.0f);
  write({{0, 0}, {1, 1}}, {{1000000, 1000000}, {1000001, 1000001}});
  try {
    read_exr(folder / "parts.exr");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("too far apart"), std::string::npos) << error.what();
  }
}

TEST(Exr, ReadsOnlyWhatIsWanted) {
  const test::TemporaryFolder folder;
  write_exr(folder / "a.exr", sample_frame());
  EXPECT_EQ(read_exr(folder / "a.exr", [](const std::string& n) { return n == "R"; }).names(),
            std::vector<std::string>{"R"});
}

void expect_input_error(const std::filesystem::path& path, const std::string& part) {
  try {
    read_exr(path);
    FAIL() << path << " was read";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(path.string()), std::string::npos) << "the message does not name the file";
  }
}

TEST(Exr, BadFilesSayWhatIsWrong) {
  const test::TemporaryFolder folder;
  expect_input_error(folder / "missing.exr", "no such file");
  expect_input_error(folder.path(), "is a folder");
  test::write_file(folder / "text.exr", "this is no image");
  expect_input_error(folder / "text.exr", "not a readable OpenEXR file");
  write_exr(folder / "whole.exr", sample_frame());
  const std::string bytes = test::read_file(folder / "whole.exr");
  test::write_file(folder / "cut.exr", bytes.substr(0, bytes.size() * 2 / 3));
  expect_input_error(folder / "cut.exr", "truncated");
}

TEST(Exr, NothingIsLeftWhenTheFolderIsMissing) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(write_exr(folder / "no/a.exr", sample_frame()), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Foreign, CyclesMultilayerIsRecognisedWhateverItsLayerIsCalled) {
  const auto path = test::shared("references/cycles/odd/allpasses_half_64.exr");
  if (path.empty()) GTEST_SKIP() << "no reference frames beside the project";
  Layers frame = read_exr(path);
  EXPECT_NE(adopt_foreign_layers(frame).find("My Layer"), std::string::npos);
  ASSERT_TRUE(frame.has(layer::beauty));
  ASSERT_TRUE(frame.has(layer::indirect));
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const float beauty = (*frame.rgb(layer::beauty)[c])(x, y);
        EXPECT_NEAR((*frame.rgb(layer::direct)[c])(x, y) + (*frame.rgb(layer::indirect)[c])(x, y), beauty,
                    1e-6f * std::abs(beauty) + 1e-7f);
      }
}

TEST(Picture, ATruncatedHdrIsRefused) {
  const test::TemporaryFolder folder;
  const std::string header = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 64 +X 4\n";
  test::write_file(folder / "whole.hdr", header + std::string(64 * 4 * 4, '\x80'));
  EXPECT_EQ(read_hdr(folder / "whole.hdr").at("R")(3, 63), 0.5f);
  for (const size_t missing : {1, 2, 3, 4, 127, 128, 129, 512}) {
    test::write_file(folder / "cut.hdr", header + std::string(64 * 4 * 4 - missing, '\x80'));
    try {
      read_hdr(folder / "cut.hdr");
      FAIL() << "it was read without " << missing << " bytes";
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("cut.hdr: truncated"), std::string::npos) << error.what();
    }
  }
}

TEST(Picture, NonFinitePixelsAreVisible) {
  Plane p(2, 1, 0.5f);
  p(1, 0) = std::numeric_limits<float>::quiet_NaN();
  const Picture picture = to_picture({&p, &p, &p});
  EXPECT_EQ(picture.rgb[3], 255);
  EXPECT_EQ(picture.rgb[4], 0);
  EXPECT_EQ(picture.rgb[5], 255);
}

}  // namespace
}  // namespace brume
