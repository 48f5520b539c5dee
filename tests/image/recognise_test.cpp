// Which renderer wrote a file, and what its statistics mean: names as each renderer writes them (docs/frames.md).

#include <gtest/gtest.h>

#include <algorithm>

#include "image/foreign.h"
#include "tests/support/frames.h"

namespace brume {
namespace {

ExrInfo file_of(const std::vector<std::string>& channels, const std::string& type = "float") {
  ExrInfo info;
  for (const std::string& name : channels) info.channels.push_back({name, type, {}});
  return info;
}

/// A part by a name and a view, which may be empty, with its channels.
struct NamedPart {
  std::string name, view;
  std::vector<std::string> channels;
};

/// Several parts, as read_exr_info() tells them.
ExrInfo parts_of(const std::vector<NamedPart>& parts) {
  ExrInfo info;
  for (const NamedPart& part : parts) {
    info.parts.push_back({part.name, part.view, "scanlineimage", {}, part.channels});
    for (const std::string& own : part.channels) {
      const std::string name = own.starts_with(part.name + ".") ? own : part.name + "." + own;
      info.channels.push_back({name, "half", {}, info.parts.size() - 1, own});
    }
  }
  return info;
}

const std::vector<std::string> kRgba = {"A", "B", "G", "R"}, kRgb = {"B", "G", "R"};

std::vector<std::string> layers_of(const std::vector<std::pair<std::string, std::string>>& layers) {
  std::vector<std::string> names;
  for (const auto& [layer, letters] : layers)
    for (const char letter : letters) names.push_back((layer.empty() ? "" : layer + ".") + letter);
  return names;
}

ForeignFrame only(const ExrInfo& file) {
  const std::vector<ForeignFrame> pictures = recognise(file);
  EXPECT_EQ(pictures.size(), 1u);
  return pictures.empty() ? ForeignFrame() : pictures[0];
}

std::vector<std::string> names_of(const std::vector<ForeignSignal>& signals) {
  std::vector<std::string> names;
  for (const ForeignSignal& s : signals) names.push_back(s.name);
  return names;
}

std::string feature(const ForeignFrame& picture, const LayerName& layer) {
  for (const ForeignFeature& f : picture.features)
    if (f.layer == layer) return f.channels[0];
  return "";
}

/// A frame of one value per channel.
Layers values(const std::map<std::string, float>& channels) {
  Layers frame(2, 1);
  for (const auto& [name, value] : channels) frame.add(name, value);
  return frame;
}

/// What the signal's statistics become.
Layers adopted(const ForeignFrame& picture, const Layers& file, std::string* why = nullptr) {
  Layers frame(file.width(), file.height());
  adopt_features(picture, file, frame);
  const std::string unusable = adopt_signal(picture, picture.color, file, frame);
  if (why) *why = unusable;
  return frame;
}

TEST(Recognise, CyclesWhateverItsViewLayerIsCalled) {
  ExrInfo file = file_of(layers_of({{"A.b c.Combined", "RGBA"},
                                    {"A.b c.VolumeDir", "RGB"},
                                    {"A.b c.VolumeInd", "RGB"},
                                    {"A.b c.Env", "RGB"},
                                    {"A.b c.Emit", "RGB"},
                                    {"A.b c.DiffDir", "RGB"},
                                    {"A.b c.DiffInd", "RGB"},
                                    {"A.b c.DiffCol", "RGB"},
                                    {"A.b c.GlossCol", "RGB"},
                                    {"A.b c.Shadow", "RGB"},
                                    {"A.b c.CryptoObject00", "rgba"},
                                    {"A.b c.Denoising Albedo", "RGB"},
                                    {"A.b c.Denoising Normal", "XYZ"},
                                    {"A.b c.Normal", "XYZ"},
                                    {"A.b c.Depth", "Z"},
                                    {"A.b c.IndexOB", "X"},
                                    {"A.b c.Debug Sample Count", "X"}}));
  file.header["cycles.A.b c.samples"] = std::string("48");
  const ForeignFrame p = only(file);
  EXPECT_EQ(p.label(), "Blender Cycles multilayer 'A.b c'");
  EXPECT_EQ(names_of(p.passes),
            (std::vector<std::string>{"DiffDir", "DiffInd", "VolumeDir", "VolumeInd", "Env", "Emit"}));
  EXPECT_EQ((*p.passes[0].factor)[2], "A.b c.DiffCol.B");
  EXPECT_FALSE(p.passes[2].factor.has_value());
  EXPECT_TRUE(p.passes[3].indirect);
  EXPECT_EQ(feature(p, layer::albedo), "A.b c.Denoising Albedo.R");
  EXPECT_EQ(feature(p, layer::normal), "A.b c.Denoising Normal.X");
  EXPECT_EQ(feature(p, layer::depth), "A.b c.Depth.Z");
  EXPECT_EQ(p.alpha, "A.b c.Combined.A");
  EXPECT_EQ(p.samples, 48);
  for (const std::string& name : p.channels()) {
    EXPECT_EQ(name.find("Crypto"), std::string::npos);
    EXPECT_EQ(name.find("Index"), std::string::npos);
  }
  // The sample count is a share of the layer's samples.
  std::map<std::string, float> pixels;
  for (const std::string& name : p.channels()) pixels[name] = 0.5f;
  const Layers frame = adopted(p, values(pixels));
  EXPECT_EQ(frame.at("sample_count.Y")(1, 0), 24.0f);
}

TEST(Recognise, CyclesPassesUnderTheNamesOfBlender5) {
  const ForeignFrame p = only(file_of(layers_of({{"V.Combined", "RGBA"},
                                                 {"V.Volume Direct", "RGB"},
                                                 {"V.Volume Indirect", "RGB"},
                                                 {"V.Environment", "RGB"},
                                                 {"V.Emission", "RGB"},
                                                 {"V.Transmission Indirect", "RGB"},
                                                 {"V.Transmission Color", "RGB"}})));
  EXPECT_EQ(names_of(p.passes), (std::vector<std::string>{"TransInd", "VolumeDir", "VolumeInd", "Env", "Emit"}));
}

TEST(Recognise, EveryViewLayerIsAPicture) {
  const auto pictures = recognise(file_of(layers_of({{"fog.Combined", "RGBA"}, {"set.Combined", "RGBA"}})));
  ASSERT_EQ(pictures.size(), 2u);
  EXPECT_EQ(pictures[0].view, "fog");
  EXPECT_EQ(pictures[1].view, "set");
}

TEST(Recognise, APictureThatBlenderDenoisedIsMadeFromTheNoisyOne) {
  const ForeignFrame p = only(file_of(layers_of({{"V.Combined", "RGBA"}, {"V.Noisy Image", "RGBA"}})));
  EXPECT_EQ(p.color.channels[0], "V.Noisy Image.R");
  EXPECT_EQ(p.target[0], "V.Combined.R");
  EXPECT_EQ(p.remarks.size(), 1u);
}

TEST(Recognise, TheVarianceOfPbrtIsThatOfTheSamples) {
  for (const bool dotted : {true, false}) {
    std::vector<std::string> channels =
        layers_of({{"", "RGB"}, {"Albedo", "RGB"}, {"Variance", "RGB"}, {"RelativeVariance", "RGB"}});
    for (const std::string name : {"P", "N", "Ns"})
      for (const char axis : {'x', 'y', 'z'})
        channels.push_back(dotted ? name + "." + static_cast<char>(std::toupper(axis)) : name + axis);
    ExrInfo file = file_of(channels, "half");
    file.header["samplesPerPixel"] = 64;
    const ForeignFrame p = only(file);
    EXPECT_EQ(p.renderer, "pbrt-v4 G-buffer film");
    EXPECT_EQ(feature(p, layer::normal), dotted ? "Ns.X" : "Nsx");
    EXPECT_EQ(feature(p, layer::position), dotted ? "P.X" : "Px");
    ASSERT_EQ(p.remarks.size(), 1u);
    EXPECT_NE(p.remarks[0].find("16 bits"), std::string::npos);
    std::map<std::string, float> pixels;
    for (const std::string& name : channels) pixels[name] = name.starts_with("Variance") ? 3.2f : 0.5f;
    EXPECT_FLOAT_EQ(adopted(p, values(pixels)).at("mean_variance.G")(0, 0), 0.05f) << "3.2 / 64";
    file.header.clear();
    std::string why;
    const Layers without = adopted(only(file), values(pixels), &why);
    EXPECT_FALSE(without.find("mean_variance.R")) << "a guess would be wrong by a factor";
    EXPECT_NE(why.find("--samples"), std::string::npos) << why;
  }
}

TEST(Recognise, TheMomentsOfMitsubaBecomeVariance) {
  // aov below moment: the colours' own second moments.
  const std::vector<std::string> channels = layers_of({{"", "RGBA"},
                                                       {"m.img", "RGBA"},
                                                       {"m.nn", "XYZ"},
                                                       {"m.dd", "T"},
                                                       {"m", "XYZ"},
                                                       {"m2_m.img", "RGBA"},
                                                       {"m2_m.nn", "XYZ"},
                                                       {"m2_m", "XYZ"}});
  ExrInfo file = file_of(channels);
  file.header["samplesPerPixel"] = 5;
  const auto pictures = recognise(file);
  ASSERT_EQ(pictures.size(), 2u) << "the film's own picture, and the same as a layer";
  EXPECT_EQ(pictures[1].label(), "Mitsuba 3 'm.img'");
  EXPECT_EQ(pictures[1].color.variance->channels[0], "m2_m.img.R");
  EXPECT_EQ(feature(pictures[1], layer::depth), "m.dd.T");
  std::map<std::string, float> pixels;
  for (const std::string& name : channels) pixels[name] = name.starts_with("m2_") ? 8.0f : 2.0f;
  EXPECT_FLOAT_EQ(adopted(pictures[1], values(pixels)).at("mean_variance.R")(0, 0), 1.0f) << "(8 - 2 * 2) / (5 - 1)";

  // The picture on top has moments in CIE XYZ only. Grey light: X, Y, Z = white's times one number.
  EXPECT_TRUE(pictures[0].color.variance->xyz.has_value());
  const double white[] = {0.95047, 1.0, 1.08883};
  for (size_t c = 0; c < 3; ++c) {
    pixels[std::string("m.") + "XYZ"[c]] = static_cast<float>(2 * white[c]);
    pixels[std::string("m2_m.") + "XYZ"[c]] = static_cast<float>(8 * white[c] * white[c]);
  }
  const Layers grey = adopted(pictures[0], values(pixels));
  for (const char* c : {"R", "G", "B"}) EXPECT_NEAR(grey.at(std::string("mean_variance.") + c)(0, 0), 1.0f, 2e-5f) << c;
}

TEST(Recognise, TheStatisticsOfRenderMan) {
  const ForeignFrame p = only(file_of(layers_of({{"Ci", "rgba"},
                                                 {"mse", "rgb"},
                                                 {"diffuse", "rgb"},
                                                 {"diffuse_mse", "rgb"},
                                                 {"diffuse_even", "rgb"},
                                                 {"diffuse_odd", "rgb"},
                                                 {"specular", "rgb"},
                                                 {"specular_var", "rgb"},
                                                 {"albedo", "rgb"},
                                                 {"albedo_var", "rgb"},
                                                 {"albedo_mse", "rgb"},
                                                 {"normal", "xyz"},
                                                 {"normal_var", "xyz"},
                                                 {"sampleCount", "r"},
                                                 {"CryptoMaterial00", "rgba"}})));
  EXPECT_EQ(p.renderer, "RenderMan");
  EXPECT_EQ(names_of(p.passes), (std::vector<std::string>{"diffuse", "specular"}));
  EXPECT_EQ(p.color.variance->meaning, VarianceMeaning::kOfMean);
  EXPECT_EQ(p.passes[0].variance->meaning, VarianceMeaning::kOfMean);
  EXPECT_EQ((*p.passes[0].halves)[1][2], "diffuse_odd.b");
  EXPECT_EQ(p.passes[1].variance->meaning, VarianceMeaning::kOfSamples);
  EXPECT_EQ(p.sample_count, "sampleCount.r");
  std::map<std::string, float> pixels;
  for (const std::string& name : p.channels()) pixels[name] = name == "sampleCount.r" ? 10.0f : 2.5f;
  const Layers file = values(pixels);
  Layers frame(2, 1);
  adopt_features(p, file, frame);
  EXPECT_EQ(adopt_signal(p, p.passes[1], file, frame), "");
  EXPECT_FLOAT_EQ(frame.at("mean_variance.R")(0, 0), 0.25f) << "divided by each pixel's own count";
  EXPECT_FLOAT_EQ(frame.at("albedo.mean_variance.R")(0, 0), 2.5f) << "_mse goes before _var";
  EXPECT_FLOAT_EQ(frame.at("normal.mean_variance.Z")(0, 0), 0.25f);
}

TEST(Recognise, ArnoldsVarianceHasNoStatedLevel) {
  const ForeignFrame p = only(file_of(layers_of({{"", "RGBA"},
                                                 {"variance", "RGB"},
                                                 {"volume_direct", "RGB"},
                                                 {"volume_indirect", "RGB"},
                                                 {"direct", "RGB"},
                                                 {"denoise_albedo", "RGB"},
                                                 {"N", "XYZ"}})));
  EXPECT_EQ(p.renderer, "Arnold");
  EXPECT_EQ(p.color.variance->meaning, VarianceMeaning::kUnstated);
  EXPECT_EQ(names_of(p.passes), (std::vector<std::string>{"volume_direct", "volume_indirect"}))
      << "direct is the same light, cut another way";
  EXPECT_EQ(feature(p, layer::albedo), "denoise_albedo.R");
}

TEST(Recognise, LightGroupsByTheNamesThatRenderersGiveThem) {
  const auto groups_of = [](const ForeignFrame& picture) {
    std::vector<std::string> groups;
    for (const ForeignSignal& light : picture.lights) groups.push_back(light.group);
    return groups;
  };
  const std::vector<std::string> both = {"default", "key"};
  const ForeignFrame arnold = only(
      file_of(layers_of({{"", "RGBA"}, {"RGBA_default", "RGBA"}, {"RGBA_key", "RGBA"}, {"RGBA_variance", "RGB"}})));
  EXPECT_EQ(arnold.renderer, "Arnold");
  EXPECT_EQ(groups_of(arnold), both);
  EXPECT_EQ(names_of(arnold.lights), (std::vector<std::string>{"RGBA_default", "RGBA_key"}));
  EXPECT_EQ(groups_of(only(file_of(layers_of({{"C", "RGBA"}, {"C_default", "RGB"}, {"C_key", "RGB"}})))), both);
  EXPECT_EQ(groups_of(only(file_of(layers_of({{"", "RGBA"}, {"C_default", "RGB"}, {"C_key", "RGB"}})))), both);
  EXPECT_EQ(groups_of(only(file_of(
                layers_of({{"V.Combined", "RGBA"}, {"V.Combined_default", "RGB"}, {"V.Combined_key", "RGB"}})))),
            both);
}

TEST(Recognise, LightSelectsAreLightGroups) {
  const ForeignFrame vray =
      only(file_of(layers_of({{"", "RGBA"}, {"VRayLightSelect_fill", "RGB"}, {"VRayLightSelect_key", "RGB"}})));
  EXPECT_EQ(names_of(vray.lights), (std::vector<std::string>{"VRayLightSelect_fill", "VRayLightSelect_key"}));
  EXPECT_TRUE(vray.remarks.empty());
}

TEST(Recognise, WhatMayBeLightGroupsIsTold) {
  const ForeignFrame told = only(file_of(layers_of(
      {{"", "RGBA"}, {"beauty_fill", "RGB"}, {"beauty_key", "RGB"}, {"beauty_variance", "RGB"}, {"albedo", "RGB"}})));
  EXPECT_TRUE(told.lights.empty());
  ASSERT_EQ(told.remarks.size(), 1u);
  EXPECT_NE(told.remarks[0].find("lights = [\"beauty_fill\", \"beauty_key\"] (--map"), std::string::npos)
      << told.remarks[0];
  EXPECT_TRUE(only(file_of(layers_of({{"", "RGBA"}, {"beauty", "RGB"}, {"lighting", "RGB"}}))).remarks.empty());
}

TEST(Recognise, ColoursWithLayersOfCommonNames) {
  const ForeignFrame p = only(file_of(layers_of({{"", "RGBA"}, {"Albedo", "RGB"}, {"NORMAL", "XYZ"}, {"z", "Z"}})));
  EXPECT_EQ(feature(p, layer::albedo), "Albedo.R");
  EXPECT_EQ(feature(p, layer::normal), "NORMAL.X");
  EXPECT_EQ(feature(p, layer::depth), "z.Z");
  EXPECT_TRUE(p.conflicts.empty());
  const ForeignFrame odd =
      only(file_of({"beauty.red", "beauty.green", "beauty.blue", "albedo.r", "albedo.g", "albedo.b"}));
  EXPECT_EQ(odd.color.channels, (ChannelTriple{"beauty.red", "beauty.green", "beauty.blue"}));
  EXPECT_EQ(feature(odd, layer::albedo), "albedo.r");
  EXPECT_EQ(only(file_of({"Y"})).target, (ChannelTriple{"Y", "Y", "Y"}));
  EXPECT_EQ(only(file_of({"Y", "RY", "BY"})).target, (ChannelTriple{"R", "G", "B"})) << "as read_exr gives them";
}

// As renderers write each pass into a file of its own (Redshift, V-Ray).
TEST(Recognise, APassOfAMediumAloneIsThePicture) {
  for (const std::string name : {"VolumeLighting", "Volume Lighting", "VRayAtmosphere", "fire_emission"}) {
    const ForeignFrame p = only(file_of(layers_of({{name, "RGBA"}, {"Normals", "XYZ"}, {"shadow", "RGB"}})));
    EXPECT_EQ(p.target[0], name + ".R");
    EXPECT_EQ(p.alpha, name + ".A");
    EXPECT_EQ(feature(p, layer::normal), "Normals.X");
    ASSERT_FALSE(p.remarks.empty());
    EXPECT_TRUE(p.remarks[0].starts_with(name + " is taken for the picture")) << p.remarks[0];
  }
  EXPECT_TRUE(recognise(file_of(layers_of({{"VolumeLighting", "RGB"}, {"VolumeFog", "RGB"}}))).empty());
  EXPECT_TRUE(recognise(file_of(layers_of({{"VolumeNormals", "RGB"}, {"Depth", "Z"}}))).empty());
  EXPECT_EQ(only(parts_of({{"shadow", "", kRgb}, {"VolumeFog", "", kRgb}})).target[0], "VolumeFog.R");
}

TEST(Recognise, BothEyesAreCleaned) {
  const auto pictures = recognise(
      file_of(layers_of({{"left", "RGBA"}, {"right", "RGBA"}, {"left.albedo", "RGB"}, {"right.albedo", "RGB"}})));
  ASSERT_EQ(pictures.size(), 2u);
  EXPECT_EQ(feature(pictures[1], layer::albedo), "right.albedo.R");
}

// openexr-images/Beachball/multipart.0001.exr, and names of the same kind without the attribute.
TEST(Recognise, TheViewsOfPartsAreEyes) {
  for (const bool told : {true, false})
    for (const std::string dash : {"_", ".", " "}) {
      const std::string left = told ? "left" : "", right = told ? "right" : "";
      const auto pictures = recognise(parts_of({{"rgba" + dash + "right", right, kRgba},
                                                {"depth" + dash + "left", left, {"Z"}},
                                                {"forward" + dash + "left", left, {"forward.u", "forward.v"}},
                                                {"rgba" + dash + "left", left, kRgba},
                                                {"albedo" + dash + "left", left, kRgb}}));
      ASSERT_EQ(pictures.size(), 2u) << told << dash;
      EXPECT_EQ(pictures[0].view, "right");
      EXPECT_EQ(pictures[0].target[0], "rgba" + dash + "right.R");
      EXPECT_TRUE(pictures[0].features.empty()) << "the left eye's are no features of the right one";
      EXPECT_EQ(pictures[1].view, "left");
      EXPECT_EQ(pictures[1].alpha, "rgba" + dash + "left.A");
      EXPECT_EQ(feature(pictures[1], layer::depth), "depth" + dash + "left.Z");
      EXPECT_EQ(feature(pictures[1], layer::albedo), "albedo" + dash + "left.R");
    }
  const auto by_letter = recognise(parts_of({{"beauty_L", "", kRgb}, {"beauty_R", "", kRgb}}));
  ASSERT_EQ(by_letter.size(), 2u);
  EXPECT_EQ(by_letter[1].view, "beauty right");
  const auto bare = recognise(parts_of({{"left", "", kRgba}, {"right", "", kRgba}, {"left.albedo", "", kRgb}}));
  ASSERT_EQ(bare.size(), 2u);
  EXPECT_EQ(feature(bare[0], layer::albedo), "left.albedo.R");
  EXPECT_EQ(feature(bare[1], layer::albedo), "");
  const auto strange = recognise(parts_of({{"R", "right", kRgba}, {"L", "left", kRgba}}));
  ASSERT_EQ(strange.size(), 2u) << "names that say nothing beside attributes that do";
  EXPECT_EQ(strange[1].target[0], "L.R");
}

// openexr-images/MultiView, Beachball/singlepart.0001.exr, stereo files of Blender.
TEST(Recognise, TheViewsOfOnePartAreEyes) {
  ExrInfo file = file_of({"A", "B", "G", "R", "Z", "left.A", "left.B", "left.G", "left.R", "albedo.left.B",
                          "albedo.left.G", "albedo.left.R", "whitebarmask.left.mask"});
  file.views = {"right", "left"};
  const auto pictures = recognise(file);
  ASSERT_EQ(pictures.size(), 2u);
  EXPECT_EQ(pictures[0].label(), "a frame of colours 'right'");
  EXPECT_EQ(feature(pictures[0], layer::depth), "Z");
  EXPECT_EQ(pictures[1].target[0], "left.R");
  EXPECT_EQ(feature(pictures[1], layer::albedo), "albedo.left.R");
  EXPECT_EQ(feature(pictures[1], layer::depth), "") << "the default view's";

  ExrInfo blender;
  for (const std::string eye : {"left", "right"})
    for (const auto& [pass, letters] : {std::pair<std::string, std::string>{"Combined", "RGBA"},
                                        {"VolumeDir", "RGB"},
                                        {"VolumeInd", "RGB"},
                                        {"Depth", "Z"}})
      for (const char letter : letters)
        blender.channels.push_back({"ViewLayer." + pass + "." + eye + "." + letter, "half", {}});
  blender.views = {"left", "right"};
  blender.header["cycles.ViewLayer.samples"] = std::string("16");
  const auto eyes = recognise(blender);
  ASSERT_EQ(eyes.size(), 2u);
  EXPECT_EQ(eyes[1].label(), "Blender Cycles multilayer 'ViewLayer right'");
  EXPECT_EQ(eyes[1].passes[1].channels[0], "ViewLayer.VolumeInd.right.R");
  EXPECT_EQ(feature(eyes[1], layer::depth), "ViewLayer.Depth.right.Z");
  EXPECT_EQ(eyes[1].samples, 16);
}

TEST(Recognise, PartsByTheNamesOfOtherPrograms) {
  struct Case {
    std::vector<NamedPart> parts;
    std::string beauty, albedo, normal, depth;
  };
  const std::vector<std::string> xyz = {"X", "Y", "Z"};
  const std::vector<Case> cases = {
      // Karma and Mantra
      {{{"C", "", kRgba}, {"albedo", "", kRgb}, {"N", "", kRgb}}, "C.R", "albedo.R", "N.R", ""},
      // V-Ray
      {{{"RGB_color", "", kRgb}, {"VRayDiffuseFilter", "", kRgb}, {"VRayNormals", "", xyz}, {"VRayZDepth", "", {"Z"}}},
       "RGB_color.R",
       "VRayDiffuseFilter.R",
       "VRayNormals.X",
       "VRayZDepth.Z"},
      {{{"RGB color", "", kRgba}, {"Z Depth", "", {"Z"}}}, "RGB color.R", "", "", "Z Depth.Z"},
      // Arnold: its layers' names stand in the channels, too, or only in the parts
      {{{"RGBA", "", kRgba}, {"N", "", {"N.X", "N.Y", "N.Z"}}, {"Z", "", {"Z"}}, {"diffuse_albedo", "", kRgb}},
       "RGBA.R",
       "diffuse_albedo.R",
       "N.X",
       "Z.Z"},
      // Nuke: one view of the name main, channels in words
      {{{"rgba_main", "main", {"alpha", "blue", "green", "red"}}, {"depth_main", "main", {"depth.Z"}}},
       "rgba_main.red",
       "",
       "",
       "depth_main.depth.Z"},
      {{{"rgba.main", "", kRgba}, {"depth.main", "", {"Z"}}}, "rgba.main.R", "", "", "depth.main.Z"},
      // names that say nothing, layers in the channels, as OpenEXR recommends
      {{{"part0", "", kRgba}, {"part1", "", {"albedo.B", "albedo.G", "albedo.R"}}, {"part2", "", {"Z"}}},
       "part0.R",
       "part1.albedo.R",
       "",
       ""},
      {{{"CryptoObject", "", kRgba}, {"beauty", "", kRgb}}, "beauty.R", "", "", ""},
  };
  for (const Case& c : cases) {
    const auto pictures = recognise(parts_of(c.parts));
    ASSERT_EQ(pictures.size(), 1u) << c.beauty;
    EXPECT_EQ(pictures[0].target[0], c.beauty);
    EXPECT_EQ(feature(pictures[0], layer::albedo), c.albedo) << c.beauty;
    EXPECT_EQ(feature(pictures[0], layer::normal), c.normal) << c.beauty;
    EXPECT_EQ(feature(pictures[0], layer::depth), c.depth) << c.beauty;
    EXPECT_TRUE(pictures[0].conflicts.empty() && pictures[0].alike.empty()) << c.beauty;
  }
  EXPECT_TRUE(recognise(parts_of({{"diffuse", "", kRgb}, {"specular", "", kRgb}})).empty())
      << "neither is the picture more than the other";
}

TEST(Recognise, ViewLayersInPartsOfTheirOwn) {
  const auto pictures = recognise(
      parts_of({{"fog", "", {"Combined.B", "Combined.G", "Combined.R", "VolumeDir.B", "VolumeDir.G", "VolumeDir.R"}},
                {"set", "", {"Combined.B", "Combined.G", "Combined.R"}}}));
  ASSERT_EQ(pictures.size(), 2u);
  EXPECT_EQ(pictures[1].label(), "Blender Cycles multilayer 'set'");
}

TEST(Recognise, TwoCandidatesForOnePartAreListed) {
  const ForeignFrame p = only(file_of(layers_of({{"", "RGB"}, {"albedo", "RGB"}, {"diffuse_albedo", "RGB"}})));
  ASSERT_EQ(p.conflicts.size(), 1u);
  EXPECT_NE(p.conflicts[0].find("albedo could be any of albedo, diffuse_albedo"), std::string::npos) << p.conflicts[0];
  // Of colours the pixels decide.
  const ForeignFrame colours = only(file_of(layers_of({{"beauty", "RGB"}, {"rgba", "RGBA"}})));
  EXPECT_EQ(colours.alike, (std::vector<ChannelTriple>{{"rgba.R", "rgba.G", "rgba.B"}}));
  const ForeignFrame top = only(file_of(layers_of({{"", "RGB"}, {"beauty", "RGB"}})));
  EXPECT_EQ(top.target[0], "R");
  EXPECT_EQ(top.alike, (std::vector<ChannelTriple>{{"beauty.R", "beauty.G", "beauty.B"}}));
}

TEST(Recognise, NothingWhereThereIsNoColour) {
  EXPECT_TRUE(recognise(file_of({"depth.Z", "id"})).empty());
  EXPECT_TRUE(recognise(file_of(layers_of({{"Noisy Picture", "RGB"}}))).empty());
}

TEST(Recognise, ThreeCoordinatesOnTopAreCieXyzWhereNothingElseIsAPicture) {
  const ForeignFrame xyz = only(file_of({"A", "X", "Y", "Z"}));
  EXPECT_TRUE(xyz.cie_xyz);
  EXPECT_EQ(xyz.target, (ChannelTriple{"X", "Y", "Z"}));
  EXPECT_EQ(xyz.alpha, "A");
  EXPECT_EQ(feature(xyz, layer::depth), "");
  // Beside colours they are a position, whose Z is no depth.
  const ForeignFrame beside = only(file_of({"B", "G", "R", "X", "Y", "Z"}));
  EXPECT_FALSE(beside.cie_xyz);
  EXPECT_EQ(feature(beside, layer::depth), "");
  EXPECT_EQ(feature(only(file_of({"Y", "Z"})), layer::depth), "Z");

  Plane x(1, 1, 0.95047f), y(1, 1, 1.0f), z(1, 1, 1.08883f);
  rgb_from_xyz({&x, &y, &z});
  for (const Plane* white : {&x, &y, &z}) EXPECT_NEAR((*white)(0, 0), 1, 1e-3);
  x(0, 0) = 2;
  rgb_from_xyz({&x, &y, &z});
  xyz_from_rgb({&x, &y, &z});
  EXPECT_NEAR(x(0, 0), 2, 1e-5);
}

TEST(Recognise, NamesThatBeginWithADot) {
  const ExrInfo file = file_of({".A", ".B", ".G", ".R"});
  EXPECT_EQ(only(file).target, (ChannelTriple{".R", ".G", ".B"}));
  EXPECT_EQ(channels_text(file_of({".id", "a.", "L.R"})), ".id a.; L: R");
}

TEST(Recognise, BrumesOwnFramesAreKnownByTheirStatistics) {
  const Layers frame = test::noisy_frame(4, 4, 1);
  EXPECT_TRUE(is_brume_frame(file_of(frame.names())));
  EXPECT_FALSE(is_brume_frame(file_of(layers_of({{"", "RGB"}, {"albedo", "RGB"}}))));
  ExrInfo stamped = file_of(layers_of({{"", "RGB"}}));
  stamped.header["software"] = std::string("brume");
  EXPECT_TRUE(is_brume_frame(stamped));
}

TEST(Recognise, ADepthWhereNothingIsMetIsNone) {
  const ForeignFrame p = only(file_of({"R", "G", "B", "Z"}));
  Layers file = values({{"R", 1}, {"G", 1}, {"B", 1}, {"Z", 1e10f}});
  (*file.find("Z"))(1, 0) = 7;
  const Layers frame = adopted(p, file);
  EXPECT_EQ(frame.at("depth.Z")(0, 0), 0.0f);
  EXPECT_EQ(frame.at("depth.Z")(1, 0), 7.0f);
}

}  // namespace
}  // namespace brume
