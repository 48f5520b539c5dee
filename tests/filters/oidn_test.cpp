// Open Image Denoise's networks: agreement with an evaluation by other means (../shared/prototype/oidn.py), tiles,
// files that are damaged. The published weights are not part of the project: ./run oidn fetches them, and tests that
// need them are skipped where they are not there.

#include <gtest/gtest.h>
#include <libdeflate.h>

#include <cmath>
#include <cstdlib>
#include <cstring>

#include "base/error.h"
#include "base/rng.h"
#include "filters/api/recommend.h"
#include "filters/api/registry.h"
#include "filters/kernels/convolution.h"
#include "filters/learned/tza.h"
#include "filters/learned/unet.h"
#include "filters/run/apply.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

using test::error_of;
namespace fs = std::filesystem;

template <class Number>
Number number_at(const std::string& bytes, size_t at) {
  Number number;
  std::memcpy(&number, bytes.data() + at, sizeof number);
  return number;
}

/// The arrays of an .npz, each three floats for every pixel: a ZIP of deflated .npy, listed at its end.
Layers read_npz(const fs::path& path) {
  const std::string bytes = test::read_file(path);
  const size_t end = bytes.size() - 22;
  Layers arrays;
  size_t entry = number_at<uint32_t>(bytes, end + 16);
  for (int left = number_at<uint16_t>(bytes, end + 10); left > 0; --left) {
    const auto packed = number_at<uint32_t>(bytes, entry + 20), size = number_at<uint32_t>(bytes, entry + 24),
               file = number_at<uint32_t>(bytes, entry + 42);
    const auto length = [&](size_t at) { return size_t{number_at<uint16_t>(bytes, at)}; };
    const std::string name = bytes.substr(entry + 46, length(entry + 28) - std::strlen(".npy"));
    std::string npy(size, '\0');
    libdeflate_decompressor* const inflate = libdeflate_alloc_decompressor();
    const auto result = libdeflate_deflate_decompress(
        inflate, bytes.data() + file + 30 + length(file + 26) + length(file + 28), packed, npy.data(), size, nullptr);
    libdeflate_free_decompressor(inflate);
    EXPECT_EQ(result, LIBDEFLATE_SUCCESS);
    int height = 0, width = 0;
    const size_t shape = npy.find("'shape': (");
    EXPECT_EQ(std::sscanf(npy.c_str() + shape, "'shape': (%d, %d, 3)", &height, &width), 2) << name;
    if (arrays.width() == 0) arrays = Layers(width, height);
    const size_t values = 10 + size_t{number_at<uint16_t>(npy, 8)};
    for (size_t c = 0; c < 3; ++c) {
      Plane& plane = arrays.add(name + "." + "RGB"[c]);
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
          plane(x, y) = number_at<float>(npy, values + (static_cast<size_t>(y * width + x) * 3 + c) * sizeof(float));
    }
    entry += 46 + length(entry + 28) + length(entry + 30) + length(entry + 32);
  }
  return arrays;
}

/// Where the published weights are: named, so that an installed library is not asked.
std::string published_weights() {
  const char* const named = std::getenv("BRUME_OIDN_WEIGHTS");
  return named ? named : test::source("build/oidn").string();
}

ApplyOptions beauty_alone() {
  ApplyOptions options;
  options.component = Component::kAll;
  options.outliers = Outliers::kKeep;
  return options;
}

class Published : public testing::Test {
 protected:
  void SetUp() override {
    const fs::path file = test::shared("prototype/oidn/dusty_room_93x71.npz");
    if (file.empty()) GTEST_SKIP() << "../shared is not there";
    if (!fs::exists(fs::path(published_weights()) / "rt_hdr.tza"))
      GTEST_SKIP() << "the published weights are not there; ./run oidn fetches them";
    arrays_ = read_npz(file);
    frame_ = Layers(arrays_.width(), arrays_.height());
    for (size_t c = 0; c < 3; ++c) {
      frame_.set(layer::beauty.channel(c), array("color", c));
      frame_.set(layer::albedo.channel(c), array("albedo", c));
      frame_.set(layer::normal.channel(c), array("normal", c));
    }
  }
  const Plane& array(const std::string& name, size_t c) const { return arrays_.at(name + "." + "RGB"[c]); }
  Layers denoised(const std::string& how) const {
    return apply_filter(parse_filter("oidn:weights=" + published_weights() + "," + how), frame_, beauty_alone(), {});
  }

  Layers arrays_, frame_;
};

TEST_F(Published, AgreesWithAnotherEvaluationInEveryModeAndQuality) {
  for (const auto& [how, name] : {std::pair("mode=color", "out_color_high"),
                                  {"mode=color,quality=balanced", "out_color_high"},
                                  {"mode=color,quality=fast", "out_color_fast"},
                                  {"mode=albedo", "out_alb_high"},
                                  {"mode=albedo-normal", "out_aux_high"},
                                  {"mode=albedo-normal,quality=fast", "out_aux_fast"},
                                  {"mode=prefilter,quality=balanced", "out_prefilter_balanced"},
                                  {"mode=prefilter", "out_prefilter_high"},
                                  {"mode=auto", "out_prefilter_high"}}) {
    const Layers clean = denoised(how);
    double worst = 0;
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < clean.height(); ++y)
        for (int x = 0; x < clean.width(); ++x) {
          const double expected = array(name, c)(x, y), found = clean.at(layer::beauty.channel(c))(x, y);
          worst = std::max(worst, std::abs(found - expected) / (std::abs(expected) + 1e-3));
        }
    EXPECT_LT(worst, 1e-3) << how;
    std::printf("%s: relative difference at most %.1e\n", how, worst);
  }
}

// Networks of random weights, so that all but the agreement above is tested without the published ones.

using Tensors = std::map<std::string, Tensor>;

/// A tensor archive; halves where `half`.
std::string tza_of(const Tensors& tensors, bool half) {
  std::string values, table;
  const auto put = [](std::string& to, auto number) {
    to.append(reinterpret_cast<const char*>(&number), sizeof number);
  };
  put(table, static_cast<uint32_t>(tensors.size()));
  constexpr size_t kHeader = 64;
  for (const auto& [name, t] : tensors) {
    put(table, static_cast<uint16_t>(name.size()));
    table += name;
    put(table, static_cast<uint8_t>(t.sizes.size()));
    for (const int size : t.sizes) put(table, static_cast<uint32_t>(size));
    table += t.layout + (half ? 'h' : 'f');
    put(table, static_cast<uint64_t>(kHeader + values.size()));
    for (const float v : t.values) {
      if (half) {
        const auto bits = std::bit_cast<uint32_t>(v);  // of normal halves
        put(values,
            static_cast<uint16_t>((bits >> 16 & 0x8000) | (((bits >> 23 & 255) - 112) << 10) | (bits >> 13 & 1023)));
      } else {
        put(values, v);
      }
    }
  }
  std::string head;
  put(head, uint16_t{0x41D7});
  head += {2, 0};
  put(head, static_cast<uint64_t>(kHeader + values.size()));
  head.resize(kHeader);
  return head + values + table;
}

Tensors random_network(int inputs, bool large) {
  Rng rng(5);
  Tensors tensors;
  const auto layer = [&](const std::string& name, int from, int to) {
    Tensor weight{{to, from, 3, 3}, "oihw", {}}, bias{{to}, "x", {}};
    // Numbers that a half holds exactly, of a size such that values neither fade nor grow.
    const auto draw = [&](double size) {
      return static_cast<float>((std::floor(256 * rng.uniform()) - 127.5) / 128 * size);
    };
    for (int i = 0; i < to * from * 9; ++i)
      weight.values.push_back(draw(std::exp2(std::round(std::log2(1 / std::sqrt(2.0 * from))))));
    for (int i = 0; i < to; ++i) bias.values.push_back(draw(0.125));
    tensors[name + ".weight"] = weight;
    tensors[name + ".bias"] = bias;
    return to;
  };
  const int left[] = {inputs, 9, 20, 16, 33};
  int at = large ? inputs : layer("enc_conv0", inputs, 18);
  for (int i = 1; i <= 4; ++i) {
    const std::string name = "enc_conv" + std::to_string(i);
    if (large) at = layer(name + "a", at, 17);
    at = layer(name + (large ? "b" : ""), at, left[i]);
  }
  at = layer("enc_conv5b", layer("enc_conv5a", at, 24), 40);
  for (int i = 4; i >= 1; --i) {
    const std::string name = "dec_conv" + std::to_string(i);
    at = layer(name + "b", layer(name + "a", at + left[i - 1], 35), 19);
  }
  layer(large ? "dec_conv1c" : "dec_conv0", at, 3);
  return tensors;
}

/// A folder with a random network for every mode.
struct RandomWeights {
  test::TemporaryFolder folder;
  RandomWeights() {
    for (const auto& [name, inputs] :
         {std::pair("hdr", 3), {"hdr_alb", 6}, {"hdr_alb_nrm", 9}, {"hdr_calb_cnrm", 9}, {"alb", 3}, {"nrm", 3}})
      for (const std::string size : {"", "_small", "_large"})
        test::write_file(folder / ("rt_" + (name + size) + ".tza"),
                         tza_of(random_network(inputs, size == "_large"), true));
  }
  FilterSettings filter(const std::string& mode) const {
    return parse_filter("oidn:weights=" + folder.path().string() + ",mode=" + mode);
  }
};

/// Maps of a network, evaluated as its layers are defined, in double precision.
struct Maps {
  int channels, width, height;
  std::vector<double> values = std::vector<double>(static_cast<size_t>(channels * width * height));
  double& at(int c, int x, int y) { return values[static_cast<size_t>((c * height + y) * width + x)]; }
  double at(int c, int x, int y) const {
    return x < 0 || y < 0 || x >= width || y >= height ? 0 : values[static_cast<size_t>((c * height + y) * width + x)];
  }
};

Maps made(int channels, int width, int height, const std::function<double(int, int, int)>& value) {
  Maps out{channels, width, height};
  for (int c = 0; c < channels; ++c)
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) out.at(c, x, y) = value(c, x, y);
  return out;
}

Maps reference_network(const Tensors& tensors, Maps in, bool large) {
  const auto layer = [&](const std::string& name, const Maps& from, bool rectified = true) {
    const Tensor &weight = tensors.at(name + ".weight"), &bias = tensors.at(name + ".bias");
    return made(weight.sizes[0], from.width, from.height, [&](int o, int x, int y) {
      double sum = bias.values[static_cast<size_t>(o)];
      for (int c = 0; c < from.channels; ++c)
        for (int tap = 0; tap < 9; ++tap)
          sum += weight.values[static_cast<size_t>((o * from.channels + c) * 9 + tap)] *
                 from.at(c, x + tap % 3 - 1, y + tap / 3 - 1);
      return rectified ? std::max(sum, 0.0) : sum;
    });
  };
  const auto pooled = [](const Maps& m) {
    return made(m.channels, m.width / 2, m.height / 2, [&](int c, int x, int y) {
      return std::max(
          {m.at(c, 2 * x, 2 * y), m.at(c, 2 * x + 1, 2 * y), m.at(c, 2 * x, 2 * y + 1), m.at(c, 2 * x + 1, 2 * y + 1)});
    });
  };
  std::vector<Maps> left = {in};
  Maps at = large ? in : layer("enc_conv0", in);
  for (int i = 1; i <= 4; ++i) {
    const std::string name = "enc_conv" + std::to_string(i);
    if (large) at = layer(name + "a", at);
    left.push_back(at = pooled(layer(name + (large ? "b" : ""), at)));
  }
  at = layer("enc_conv5b", layer("enc_conv5a", at));
  for (int i = 4; i >= 1; --i) {
    const Maps& beside = left[static_cast<size_t>(i - 1)];
    const Maps both = made(at.channels + beside.channels, beside.width, beside.height, [&](int c, int x, int y) {
      return c < at.channels ? at.at(c, x / 2, y / 2) : beside.at(c - at.channels, x, y);
    });
    const std::string name = "dec_conv" + std::to_string(i);
    at = layer(name + "b", layer(name + "a", both));
  }
  return large ? layer("dec_conv1c", at) : layer("dec_conv0", at, false);
}

std::vector<Plane> random_planes(int count, int width, int height) {
  std::vector<Plane> planes;
  for (int i = 0; i < count; ++i)
    planes.push_back(make_plane(width, height, {}, [&](int x, int y) {
      return static_cast<float>(test::chance(x, y, 77 + static_cast<uint64_t>(i)));
    }));
  return planes;
}

double worst_difference(const Rgb& a, const Rgb& b) {
  double worst = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < a[c].height(); ++y)
      for (int x = 0; x < a[c].width(); ++x) worst = std::max<double>(worst, std::abs(a[c](x, y) - b[c](x, y)));
  return worst;
}

TEST(Unet, IsItsLayersOneByOne) {
  const test::TemporaryFolder folder;
  for (const bool large : {false, true})
    for (const int inputs : {3, 9}) {
      const Tensors tensors = random_network(inputs, large);
      test::write_file(folder / "net.tza", tza_of(tensors, false));
      const std::vector<Plane> in = random_planes(inputs, 37, 21);
      const Rgb found = Unet(folder / "net.tza", inputs).evaluate(pointers(in), {});
      const Maps expected = reference_network(
          tensors,
          made(inputs, 48, 32,
               [&](int c, int x, int y) {
                 return x < 37 && y < 21 ? static_cast<double>(in[static_cast<size_t>(c)](x, y)) : 0.0;
               }),
          large);
      double worst = 0, size = 0;
      for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 21; ++y)
          for (int x = 0; x < 37; ++x) {
            worst = std::max(worst,
                             std::abs(expected.at(c, x, y) - static_cast<double>(found[static_cast<size_t>(c)](x, y))));
            size = std::max(size, std::abs(expected.at(c, x, y)));
          }
      EXPECT_GT(size, 0.05) << "something is left to compare";
      EXPECT_LT(worst, 1e-4 * size) << "large " << large << ", " << inputs << " inputs";
    }
}

TEST(Unet, HalvesAreReadAsTheyAreStored) {
  const test::TemporaryFolder folder;
  const Tensors tensors = random_network(3, false);
  test::write_file(folder / "net.tza", tza_of(tensors, true));
  for (const auto& [name, read] : read_tza(folder / "net.tza")) {
    EXPECT_EQ(read.sizes, tensors.at(name).sizes);
    EXPECT_EQ(read.values, tensors.at(name).values) << name;
  }
}

// 400 px hold tiles whose surroundings are cut off on both sides; the smallest memory makes the smallest tiles.
TEST(Unet, TilesAndThreadsChangeNoBit) {
  const test::TemporaryFolder folder;
  for (const bool large : {false, true}) {
    test::write_file(folder / "net.tza", tza_of(random_network(3, large), false));
    const Unet net(folder / "net.tza", 3);
    for (const ivec2& size : {ivec2(400, 30), ivec2(30, 400)}) {
      const std::vector<Plane> in = random_planes(3, size.x, size.y);
      const Rgb whole = net.evaluate(pointers(in), {1, {}, nullptr});
      EXPECT_EQ(worst_difference(whole, net.evaluate(pointers(in), {7, {}, nullptr})), 0);
      for (const double memory : {0.0, 5e6})
        EXPECT_EQ(worst_difference(whole, net.evaluate(pointers(in), {}, memory)), 0) << memory;
    }
  }
}

TEST(Oidn, RunsOnAnySizeInEveryModeReportsAndStops) {
  const RandomWeights weights;
  for (const std::string mode : {"auto", "color", "albedo", "albedo-normal", "prefilter"})
    for (const ivec2& size : {ivec2(1, 1), ivec2(1, 19), ivec2(33, 2), ivec2(45, 38)}) {
      Layers frame = test::noisy_frame(size.x, size.y, 3);
      for (const LayerName& l : {layer::albedo, layer::normal})
        test::put(frame, l, "", [](int x, int, size_t) { return static_cast<float>(x % 3 - 1); });
      (*frame.add_rgb(layer::beauty)[1])(0, 0) = size.x > 1 ? std::numeric_limits<float>::quiet_NaN() : -1.0f;
      double last = 0;
      ApplyReport report;
      const Layers clean = apply_filter(weights.filter(mode), frame, beauty_alone(),
                                        {2,
                                         [&](double v) {
                                           EXPECT_GE(v, last);
                                           last = v;
                                         },
                                         nullptr},
                                        &report);
      EXPECT_EQ(last, 1.0);
      EXPECT_EQ(report.repaired_pixels, size.x > 1 ? 1u : 0u);
      for (const auto& [name, plane] : clean.channels())
        for (int y = 0; y < size.y; ++y)
          for (int x = 0; x < size.x; ++x)
            ASSERT_TRUE(std::isfinite(plane(x, y)) && plane(x, y) >= 0) << mode << " " << name;
      std::atomic<bool> cancel{true};
      EXPECT_THROW(apply_filter(weights.filter(mode), frame, beauty_alone(), {2, {}, &cancel}), Interrupted);
    }
}

TEST(Oidn, TwiceTheLightIsTwiceTheResult) {
  const RandomWeights weights;
  const Layers frame = test::noisy_frame(50, 40, 3);
  Layers bright = frame;
  for (Plane* plane : bright.add_rgb(layer::beauty))
    for (int y = 0; y < 40; ++y)
      for (float& v : plane->pixels(y)) v *= 2;
  const Layers a = apply_filter(weights.filter("color"), frame, beauty_alone(), {}),
               b = apply_filter(weights.filter("color"), bright, beauty_alone(), {});
  for (int y = 0; y < 40; ++y)
    for (int x = 0; x < 50; ++x) ASSERT_NEAR(b.at("G")(x, y), 2 * a.at("G")(x, y), 1e-4 * (1 + b.at("G")(x, y)));
}

TEST(Oidn, SaysWhatIsMissing) {
  const RandomWeights weights;
  Layers frame(20, 20);
  frame.add_rgb(layer::beauty);
  const auto error_in = [&](const std::string& mode) {
    return error_of([&] { apply_filter(weights.filter(mode), frame, beauty_alone(), {}); });
  };
  EXPECT_EQ(error_in("auto"), "");
  EXPECT_EQ(error_in("color"), "");
  EXPECT_NE(error_in("albedo").find("mode=albedo needs the layer 'albedo'"), std::string::npos) << error_in("albedo");
  EXPECT_NE(error_in("prefilter").find("mode=prefilter needs the layers 'albedo', 'normal'"), std::string::npos)
      << error_in("prefilter");
  frame.add_rgb(layer::albedo);
  EXPECT_EQ(error_in("albedo"), "");
  EXPECT_NE(error_in("albedo-normal").find("needs the layer 'normal', which"), std::string::npos)
      << error_in("albedo-normal");

  const test::TemporaryFolder empty;
  const std::string missing =
      error_of([&] { apply_filter(parse_filter("oidn:weights=" + empty.path().string()), frame, beauty_alone(), {}); });
  EXPECT_NE(missing.find(empty.path().string()), std::string::npos) << missing;
  EXPECT_NE(missing.find("./run oidn fetches them"), std::string::npos) << missing;
  test::write_file(empty / "rt_other.tza", "");
  const std::string no_file =
      error_of([&] { apply_filter(parse_filter("oidn:weights=" + empty.path().string()), frame, beauty_alone(), {}); });
  EXPECT_NE(no_file.find("rt_hdr_alb.tza: cannot be opened"), std::string::npos) << no_file;
  // What is recommended does not depend on it.
  EXPECT_NE(recommend_filter(frame, beauty_alone()).filter.entry().name, "oidn");
}

TEST(Tza, DamagedFilesAreErrorsThatSayWhat) {
  const test::TemporaryFolder folder;
  const fs::path file = folder / "net.tza";
  const std::string good = tza_of(random_network(3, false), true);
  const auto error_with = [&](const std::string& bytes) {
    test::write_file(file, bytes);
    return error_of([&] { Unet(file, 3); });
  };
  const auto expect = [&](const std::string& bytes, const std::string& words) {
    const std::string error = error_with(bytes);
    EXPECT_NE(error.find(file.string() + ": "), std::string::npos) << error;
    EXPECT_NE(error.find(words), std::string::npos) << error;
  };
  EXPECT_EQ(error_with(good), "");
  expect("", "is no tensor archive");
  expect("P" + good.substr(1), "is no tensor archive");
  expect(std::string(good).replace(2, 1, "\x03"), "of version 3; expected 2");
  expect(good.substr(0, good.size() - 1), "is cut");
  expect(good.substr(0, 1000), "its table lies beyond its end");
  Tensors tensors = random_network(3, false);
  tensors.erase("dec_conv2a.bias");
  expect(tza_of(tensors, true), "has no array 'dec_conv2a.bias'");
  tensors = random_network(6, false);
  expect(tza_of(tensors, true), "array 'enc_conv0.weight' is 18 x 6 x 3 x 3 (oihw); expected 3 x 3 taps of 3 inputs");
  tensors = random_network(3, false);
  tensors["enc_conv3.bias"].values[2] = std::numeric_limits<float>::infinity();
  expect(tza_of(tensors, false), "array 'enc_conv3.bias' is not finite");
  tensors = random_network(3, false);
  tensors["enc_conv3.bias"].sizes = {1 << 30};
  expect(tza_of(tensors, false), "array 'enc_conv3.bias' has a size of 1073741824");
  tensors["enc_conv3.bias"].sizes = {1 << 27, 1 << 27, 1 << 27};
  tensors["enc_conv3.bias"].layout = "xyz";
  expect(tza_of(tensors, false), "is cut: array 'enc_conv3.bias' lies beyond its end");

  Rng rng(9);
  int refused = 0;
  for (int i = 0; i < 300; ++i) {
    std::string bytes = good;
    for (int k = 0; k < 3; ++k) {
      const size_t table = good.size() - 1400, from = rng.uniform() < 0.8 ? table : 0;
      bytes[from + static_cast<size_t>(rng.uniform() * static_cast<double>(bytes.size() - from))] =
          static_cast<char>(256 * rng.uniform());
    }
    if (rng.uniform() < 0.2) bytes.resize(static_cast<size_t>(rng.uniform() * static_cast<double>(bytes.size())));
    refused += !error_with(bytes).empty();
  }
  EXPECT_GT(refused, 150);
}

}  // namespace
}  // namespace brume
