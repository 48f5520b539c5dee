#include "image/cryptomatte.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace brume {
namespace {

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// The specification's examples (section 2e), and those of its manifests (1d).
TEST(Cryptomatte, HashesAreThoseOfTheSpecification) {
  EXPECT_EQ(matte_hash("torus"), 4053562365u);
  EXPECT_EQ(matte_hash("\xd1\x80\xd0\xb0\xd0\xb2\xd0\xbd\xd0\xb8\xd0\xbd\xd0\xb0"), 2518896926u);
  EXPECT_EQ(fmt::format("{:.11e}", static_cast<double>(matte_id("torus"))), "-1.54943624832e+30");
  EXPECT_EQ(
      fmt::format("{:.11e}", static_cast<double>(matte_id("\xd1\x80\xd0\xb0\xd0\xb2\xd0\xbd\xd0\xb8\xd0\xbd\xd0\xb0"))),
      "-1.31926312124e-25");
  EXPECT_EQ(matte_hex(matte_id("bunny")), "13851a76");
  EXPECT_EQ(matte_hex(matte_id("default")), "42c9679f");
  EXPECT_EQ(matte_hex(matte_id("bunny_porcelain_mat")), "b24b26d4");
  // MurmurHash3_x86_32, seed 0, of nothing and of one to three bytes more than words.
  EXPECT_EQ(matte_hash(""), 0u);
  EXPECT_EQ(matte_hash("a"), 0x3c2569b2u);
  EXPECT_EQ(matte_hash("ab"), 0x9bbfd75fu);
  EXPECT_EQ(matte_hash("abc"), 0xb3dd93fau);
}

// Of 20,000 names 160 or so have an exponent of 0 or 255.
TEST(Cryptomatte, NumbersAreNeitherSubnormalNorInfinite) {
  int changed = 0;
  for (int i = 0; i < 20000; ++i) {
    const std::string name = fmt::format("thing_{}", i);
    const float id = matte_id(name);
    ASSERT_TRUE(std::isnormal(id)) << name;
    const uint32_t flipped = std::bit_cast<uint32_t>(id) ^ matte_hash(name);
    ASSERT_TRUE(flipped == 0 || flipped == 1u << 23) << name;
    changed += flipped != 0;
    ASSERT_EQ(matte_of_hex(matte_hex(id)), id);
  }
  EXPECT_GT(changed, 100);
  EXPECT_LT(changed, 250);
  EXPECT_EQ(matte_of_hex("12345"), 0.0f);
  EXPECT_EQ(matte_of_hex("1234567g"), 0.0f);
}

class CryptomatteFrame : public ::testing::Test {
 protected:
  CryptomatteFrame() {
    frame_ = Layers(2, 1);
    const std::vector<std::string> names = {"smoke", "ball", "floor", "lamp \"a\""};
    std::vector<std::vector<MatteShare>> shares(2);
    shares[0] = {{matte_id("smoke"), 0.25f}, {matte_id("ball"), 0.5f}, {matte_id("floor"), 0.125f}};
    shares[1] = {{matte_id("floor"), 0.75f}, {matte_id("lamp \"a\""), 0.0625f}};
    add_matte_layer("CryptoObject", 3, names, shares, frame_);
    add_matte_layer("CryptoMaterial", 1, {"fog", "ball"}, {{{matte_id("fog"), 0.25f}, {matte_id("ball"), 0.5f}}, {}},
                    frame_);
  }
  std::vector<MatteLayer> layers() const { return matte_layers(frame_.header, frame_.names()); }
  float at(const std::vector<std::string>& names, int x, const std::string& layer = "") const {
    return matte_of(frame_, layers(), names, layer)(x, 0);
  }
  Layers frame_;
};

TEST_F(CryptomatteFrame, RanksAreSortedAndCut) {
  EXPECT_EQ(frame_.at("CryptoObject00.r")(0, 0), matte_id("ball"));
  EXPECT_EQ(frame_.at("CryptoObject00.g")(0, 0), 0.5f);
  EXPECT_EQ(frame_.at("CryptoObject00.b")(0, 0), matte_id("smoke"));
  EXPECT_EQ(frame_.at("CryptoObject00.a")(0, 0), 0.25f);
  EXPECT_EQ(frame_.at("CryptoObject01.r")(0, 0), matte_id("floor"));
  EXPECT_EQ(frame_.at("CryptoObject01.b")(0, 0), 0.0f) << "three levels are one layer and a half";
  EXPECT_EQ(frame_.at("CryptoMaterial00.r")(0, 0), matte_id("ball"));
  EXPECT_EQ(frame_.at("CryptoMaterial00.b")(0, 0), 0.0f);
  EXPECT_FALSE(frame_.find("CryptoMaterial01.r"));
}

TEST_F(CryptomatteFrame, HeadersNameHashConversionAndManifest) {
  const std::string key = "cryptomatte/3ae39a5/";  // of the name's hash
  EXPECT_EQ(frame_.text(key + "name"), "CryptoObject");
  EXPECT_EQ(frame_.text(key + "hash"), "MurmurHash3_32");
  EXPECT_EQ(frame_.text(key + "conversion"), "uint32_to_float32");
  EXPECT_TRUE(holds(frame_.text(key + "manifest"), "\"lamp \\\"a\\\"\":\"" + matte_hex(matte_id("lamp \"a\"")) + "\""));
  ASSERT_EQ(layers().size(), 2u);
  EXPECT_EQ(layers()[1].manifest.at("smoke"), matte_id("smoke"));
  EXPECT_EQ(matte_channels(frame_).size(), 12u);
}

TEST_F(CryptomatteFrame, MattesAreWhatThingsCover) {
  EXPECT_EQ(at({"smoke"}, 0), 0.25f);
  EXPECT_EQ(at({"smoke"}, 1), 0.0f);
  EXPECT_EQ(at({"smoke", "floor"}, 0), 0.375f);
  EXPECT_EQ(at({"*o*"}, 0, "CryptoObject"), 0.375f);
  EXPECT_EQ(at({"lamp*"}, 1), 0.0625f);
  EXPECT_EQ(at({"ball"}, 0, "CryptoMaterial"), 0.5f);
  EXPECT_EQ(at({"fog"}, 0), 0.0f) << "only one layer has it, and no level left";
}

TEST_F(CryptomatteFrame, WhatIsNotThereIsNamed) {
  EXPECT_TRUE(holds(test::error_of([&] { at({"ball"}, 0); }), "is in CryptoMaterial and in CryptoObject"));
  EXPECT_TRUE(holds(test::error_of([&] { at({"smok"}, 0, "CryptoObject"); }), "smoke"));
  EXPECT_TRUE(holds(test::error_of([&] { at({"cloud"}, 0); }), "no Cryptomatte has cloud"));
  EXPECT_TRUE(holds(test::error_of([&] { at({"smoke"}, 0, "CryptoAsset"); }), "it has CryptoMaterial, CryptoObject"));
  EXPECT_TRUE(holds(test::error_of([&] { matte_of(Layers(1, 1), {}, {"a"}, ""); }), "has no Cryptomatte"));
}

TEST_F(CryptomatteFrame, ManifestsMayLieBesideOrBeMissing) {
  const test::TemporaryFolder folder;
  const std::string key = "cryptomatte/3ae39a5/";
  frame_.header.erase(key + "manifest");
  EXPECT_EQ(at({"smoke"}, 0, "CryptoObject"), 0.25f) << "by its hash";
  frame_.header[key + "manif_file"] = std::string("names.json");
  std::vector<MatteLayer> found = layers();
  read_manifests(found, folder / "frame.exr");
  EXPECT_TRUE(holds(found[1].problem, "names.json"));
  test::write_file(folder / "names.json", "{\"smoke\": \"" + matte_hex(matte_id("smoke")) + "\"}");
  found = layers();
  read_manifests(found, folder / "frame.exr");
  EXPECT_EQ(found[1].problem, "");
  EXPECT_EQ(found[1].manifest.size(), 1u);
  test::write_file(folder / "names.json", "{\"smoke\": \"xyz\"}");
  found = layers();
  read_manifests(found, folder / "frame.exr");
  EXPECT_TRUE(holds(found[1].problem, "eight hexadecimal digits"));
  frame_.header[key + "hash"] = std::string("CRC32");
  EXPECT_TRUE(holds(layers()[1].problem, "CRC32"));
}

TEST_F(CryptomatteFrame, ViewLayersAndOtherLettersAreRead) {
  Layers other(1, 1);
  other.header["cryptomatte/0123456/name"] = std::string("ViewLayer.CryptoObject");
  other.add("ViewLayer.CryptoObject00.R", matte_id("Cube"));
  other.add("ViewLayer.CryptoObject00.G", 0.75f);
  other.add("ViewLayer.CryptoObject00.B", 0.0f);
  other.add("ViewLayer.CryptoObject00.A", 0.0f);
  other.add("ViewLayer.CryptoObject.R", 1.0f);  // a preview, which says nothing
  EXPECT_EQ(matte_of(other, matte_layers(other.header, other.names()), {"Cube"}, "CryptoObject")(0, 0), 0.75f);
}

}  // namespace
}  // namespace brume
