// What a person gets wrong, and what the program answers: one message that says where, what was found and what would be
// right, exit status 2, and nothing left behind.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <csignal>
#include <limits>

#include "image/exr_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::run_brume;

const std::string kScene = test::source("data/scenes/smoke.toml").string();
const std::string kCloud = test::source("data/volumes/cloud.vdb").string();

/// Exit status 2, and every part in the message.
void expect_refused(const std::string& arguments, const std::vector<std::string>& parts) {
  const auto r = run_brume(arguments);
  EXPECT_EQ(r.status, 2) << arguments << "\n" << r.err;
  EXPECT_EQ(r.out, "") << arguments;
  for (const std::string& part : parts)
    EXPECT_NE(r.err.find(part), std::string::npos) << arguments << "\nexpected: " << part << "\ngot: " << r.err;
}

class BadInput : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string scene(const std::string& volume, const std::string& more = "") {
    test::write_file(
        folder_ / "scene.toml",
        "[camera]\nposition = [0, -5, 0]\nlook_at = [0, 0, 0]\n[film]\nwidth = 8\nheight = 8\n[render]\nspp = 1\n[environment]\nradiance = 1\n[[volumes]]\nfile = \"" +
            volume + "\"\n" + more);
    return path("scene.toml");
  }
  std::string frame(const std::string& layers, const std::string& name = "frame.exr") {
    EXPECT_EQ(run_brume("render " + kScene + " -q -D film.width=16 -D film.height=16 --spp 2 --layers " + layers +
                        " -o " + path(name))
                  .status,
              0);
    return path(name);
  }
  void expect_nothing_written() const {
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path())) {
      EXPECT_NE(entry.path().filename(), "out.exr");
      EXPECT_NE(entry.path().extension(), ".part") << entry.path();
    }
  }
  test::TemporaryFolder folder_;
};

TEST_F(BadInput, ACameraThatLooksPastTheMediumIsTold) {
  const std::string render = "render " + kScene + " --spp 1 -D film.width=16 -D film.height=16 -o " + path("a.exr"),
                    note = "no path met the medium";
  EXPECT_EQ(run_brume(render).err.find(note), std::string::npos);
  const auto past = run_brume(render + " -D camera.look_at=[0,-20,0]");
  EXPECT_EQ(past.status, 0) << past.err;
  EXPECT_NE(past.err.find(note), std::string::npos) << past.err;
}

TEST_F(BadInput, CommandLine) {
  expect_refused("rendr x", {"no command 'rendr'; did you mean 'render'?"});
  expect_refused("", {"subcommand"});
  expect_refused("render", {"scene is required"});
  expect_refused("render " + kScene, {"no output; expected -o FILE.exr"});
  expect_refused("render " + kScene + " --spp 0 -o " + path("out.exr"), {"--spp"});
  expect_refused("render " + kScene + " --layers normals -o " + path("out.exr"),
                 {"no layer 'normals' to record", "gradient"});
  expect_refused("info " + path("none.vdb"), {"none.vdb: no such file"});
  expect_refused("render " + kScene + " --replay 5000,0,0",
                 {"--replay 5000,0,0: expected x,y,sample with x below 400"});
  expect_refused("render " + kScene + " --replay 1x,2,3", {"expected x,y,sample"});
  expect_refused("evaluate " + kScene + " --spp 16,x -o " + path("e"), {"expected sample counts such as 16,36,64"});
  expect_refused("evaluate " + kScene + " -f bilat -o " + path("e"), {"no filter 'bilat'"});
  expect_nothing_written();
}

TEST_F(BadInput, Scenes) {
  expect_refused("render " + path("none.toml") + " -o " + path("out.exr"), {"none.toml: no such file"});
  expect_refused("render " + folder_.path().string() + " -o " + path("out.exr"),
                 {"is a folder, expected a scene file"});
  expect_refused("render " + scene(kCloud, "sigma = 3\n") + " -o " + path("out.exr"),
                 {"unknown key 'sigma'", "did you mean", "scene.toml", "sigma = 3"});
  expect_refused("render " + scene(kCloud, "albedo = \"white\"\n") + " -o " + path("out.exr"),
                 {"'albedo' is text", "albedo = \"white\""});
  expect_refused("render " + scene(kCloud, "g = 1.5\n") + " -o " + path("out.exr"),
                 {"'g' is out of range", "-0.999 .. 0.999"});
  expect_refused("render " + scene(kCloud, "object_to_world = [[1,0,0,0],[0,1,0,0],[0,0,0,0],[0,0,0,1]]\n") + " -o " +
                     path("out.exr"),
                 {"object_to_world is singular"});
  expect_refused("render " + kScene + " -D film.width=65536 -D film.height=65536 -o " + path("out.exr"),
                 {"a film of 65536 x 65536 needs", "make it smaller"});
  expect_refused("render " + scene("none.vdb") + " -o " + path("out.exr"), {"none.vdb: no such file"});
  expect_refused("render " + scene(kCloud) + " -D camera.look_at=[0,-5,0] -o " + path("out.exr"),
                 {"position and look_at are the same point"});
  expect_nothing_written();
}

/// A file of one grid 'density' of a kind that is no fog volume, written by OpenVDB.
std::string grid(const std::string& kind) {
  return test::source("tests/data/grids/" + kind + ".vdb").string();
}

TEST_F(BadInput, Volumes) {
  const std::string bytes = test::read_file(kCloud);
  test::write_file(folder_ / "cut.vdb", bytes.substr(0, bytes.size() / 2));
  test::write_file(folder_ / "text.vdb", "hello there");
  expect_refused("render " + scene("cut.vdb") + " -o " + path("out.exr"),
                 {"cut.vdb: truncated: its last grid ends at byte"});
  expect_refused("info " + path("cut.vdb"), {"truncated"});
  expect_refused("render " + scene("text.vdb") + " -o " + path("out.exr"), {"text.vdb: not an OpenVDB file"});
  expect_refused("render " + scene(kCloud, "grid = \"smoke\"\n") + " -o " + path("out.exr"),
                 {"no grid 'smoke'; the file has: density (float)"});

  expect_refused("render " + scene(grid("level_set")) + " -o " + path("out.exr"),
                 {"is a level set; expected a fog volume", "convert_level_set = true"});
  expect_nothing_written();
}

TEST_F(BadInput, Points) {
  expect_refused("render " + scene(grid("points")) + " -o " + path("out.exr"), {"holds points; expected a fog volume"});
  expect_refused("render " + scene(grid("vectors")) + " -o " + path("out.exr"),
                 {"of type vec3s; expected float or double"});
  expect_nothing_written();
}

TEST_F(BadInput, OddVoxelsAndEmptyGridsAreNotedNotRefused) {
  test::write_affine_vdb(folder_ / "odd.vdb", {{0, 0, 0}, {3, 0, 0}}, dmat4(1.0), [](const ivec3& v) {
    return std::array{1.0f, std::numeric_limits<float>::quiet_NaN(), -1.0f,
                      std::numeric_limits<float>::infinity()}[static_cast<size_t>(v.x)];
  });
  const auto odd = run_brume("render " + scene("odd.vdb") + " -q -o " + path("odd.exr"));
  EXPECT_EQ(odd.status, 0) << odd.err;
  for (const char* part : {"1 NaN voxels became 0", "1 negative voxels became 0", "1 infinite voxels became"})
    EXPECT_NE(odd.err.find(part), std::string::npos) << odd.err;
  const auto empty =
      run_brume("render " + kScene + " -q -D volumes.0.grid=flame_noise -D film.width=8 -D film.height=8 --spp 1 -o " +
                path("empty.exr"));
  EXPECT_EQ(empty.status, 0) << empty.err;
  EXPECT_NE(empty.err.find("grid 'flame_noise' is empty: the field is absent"), std::string::npos) << empty.err;
}

TEST_F(BadInput, Frames) {
  const std::string plain = frame("none");
  expect_refused("denoise " + plain + " -f gradient_kernel -o " + path("out.exr"),
                 {"filter gradient_kernel needs the layer 'gradient', which the frame does not have (it has: beauty",
                  "brume render SCENE -o OUT.exr --layers gradient", "frame.exr"});
  expect_refused("denoise " + plain + " -f bilatera -o " + path("out.exr"),
                 {"no filter 'bilatera'; did you mean 'bilateral'?"});
  expect_refused("denoise " + plain + " -f bilateral --sigma-rnge 3 -o " + path("out.exr"),
                 {"no parameter 'sigma-rnge'; did you mean 'sigma-range'?"});
  expect_refused("denoise " + plain + " -f bilateral --sigma-range 1e9 -o " + path("out.exr"),
                 {"expected a number in 0 .. 1000"});
  expect_refused("denoise " + path("none.exr") + " -f bilateral -o " + path("out.exr"), {"none.exr: no such file"});
  expect_refused("denoise " + plain + " -f bilateral --exposure dark -o " + path("out.exr"),
                 {"expected header, auto or a number above 0"});
  const std::string bytes = test::read_file(plain);
  test::write_file(folder_ / "cut.exr", bytes.substr(0, bytes.size() / 2));
  expect_refused("denoise " + path("cut.exr") + " -f bilateral -o " + path("out.exr"),
                 {"cut.exr: truncated or damaged"});
  expect_refused("info " + path("cut.exr"), {"cut.exr: truncated or damaged"});
  expect_refused("compare " + plain + " " + plain + " --layer indirect", {"has no layer 'indirect'; it has: beauty"});
  expect_nothing_written();
}

TEST_F(BadInput, FilesOfOtherKindsAreAnsweredWithWhatToDo) {
  const std::string clean = " -o " + path("out.exr");
  const auto denoise = [&](const std::string& name, const std::string& bytes) {
    test::write_file(folder_ / name, bytes);
    return "denoise " + path(name) + clean;
  };
  expect_refused(denoise("a.png", "\x89PNG\r\n"),
                 {"a.png: is a PNG picture, expected OpenEXR; its values are encoded and cut off for a display",
                  "oiiotool a.png --colorconvert sRGB linear -d float -o IN.exr"});
  expect_refused(denoise("a.jpg", "\xff\xd8\xff\xe0"), {"is a JPEG picture, expected OpenEXR"});
  expect_refused(denoise("a.tif", std::string("II*\0", 4)),
                 {"is a TIFF picture, expected OpenEXR; oiiotool a.tif -d float -o IN.exr makes one"});
  expect_refused("denoise " + kCloud + clean, {"is an OpenVDB file", "brume render cloud.vdb --clean"});
  expect_refused("info " + path("a.png"), {"is neither an OpenVDB nor an OpenEXR file", "it is a PNG picture"});
  expect_refused("info " + folder_.path().string(), {"is a folder, expected an OpenVDB or OpenEXR file"});
  // A method of packing that this OpenEXR does not know.
  std::string newer = test::read_file(frame("none"));
  const size_t at = newer.find(std::string("compression\0compression\0", 24)) + 28;
  newer[at] = 10;
  expect_refused(denoise("newer.exr", newer), {"newer.exr: is packed by HTJ2K, which OpenEXR", "as ZIP or PIZ"});
  expect_nothing_written();
}

TEST_F(BadInput, SizesAndNonFinitePixels) {
  Layers a(8, 8), b(9, 8), nan(8, 8);
  for (Layers* f : {&a, &b, &nan})
    for (const LayerName& l : {layer::beauty, layer::direct, layer::indirect}) f->add_rgb(l);
  (*nan.add_rgb(layer::beauty)[0])(3, 3) = std::numeric_limits<float>::quiet_NaN();
  (*nan.add_rgb(layer::indirect)[0])(3, 3) = std::numeric_limits<float>::quiet_NaN();
  write_exr(folder_ / "a.exr", a);
  write_exr(folder_ / "b.exr", b);
  write_exr(folder_ / "nan.exr", nan);
  expect_refused("compare " + path("a.exr") + " " + path("b.exr"), {"a.exr is 8 x 8", "b.exr is 9 x 8"});
  expect_refused("compare " + path("nan.exr") + " " + path("a.exr"),
                 {"1 pixels are NaN or infinite in a picture to compare, the first at pixel 3,3"});
  const auto cleaned = run_brume("denoise " + path("nan.exr") + " -q -f bilateral -o " + path("clean.exr"));
  EXPECT_EQ(cleaned.status, 0);
  EXPECT_NE(cleaned.err.find("1 pixels were NaN or infinite"), std::string::npos) << cleaned.err;
}

TEST_F(BadInput, LightsMeshesTexturesAndFields) {
  const std::string head =
      "[camera]\nposition = [0, -5, 1]\nlook_at = [0, 0, 0]\n[film]\nwidth = 8\nheight = 8\n[render]\nspp = 1\n";
  const auto refused = [&](const std::string& text, const std::vector<std::string>& parts) {
    test::write_file(folder_ / "s.toml", head + text);
    expect_refused("render " + path("s.toml") + " -o " + path("out.exr"), parts);
    expect_nothing_written();
  };
  const auto noted = [&](const std::string& text, const std::string& part) {
    test::write_file(folder_ / "s.toml", head + text);
    const auto r = run_brume("render " + path("s.toml") + " --progress none -o " + path("fine.exr"));
    EXPECT_EQ(r.status, 0) << r.err;
    EXPECT_NE(r.err.find(part), std::string::npos) << r.err;
  };
  test::write_file(folder_ / "flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  test::write_file(folder_ / "hollow.ply", "ply\nformat ascii 1.0\nelement vertex 1000000000000000\nend_header\n");
  refused("[[surfaces]]\nfile = \"hollow.ply\"\n", {"hollow.ply: element 'vertex' has no properties"});
  refused("[[surfaces]]\nfile = \"no.obj\"\n", {"no.obj: no such file"});
  refused("[[surfaces]]\nfile = \"flat.obj\"\nalbedo_texture = \"no.png\"\n", {"no.png: no such file"});
  refused("[[surfaces]]\nfile = \"flat.obj\"\nalbedo_texture = \"s.toml\"\n", {"s.toml: not a readable picture"});
  refused("[[surfaces]]\nfile = \"flat.obj\"\nior = 2\n", {"'ior' has no meaning for a diffuse surface"});
  refused("[[surfaces]]\nfile = \"flat.obj\"\nmaterial = \"wood\"\n", {"'material' cannot be 'wood'", "diffuse"});
  refused(
      "[[lights]]\ntype = \"rectangle\"\nposition = [0, 0, 1]\nedge_x = [1, 0, 0]\nedge_y = [2, 0, 0]\nradiance = 1\n",
      {"expected two edges that span an area"});
  refused("[[volumes]]\nshape = \"box\"\nlo = [1, 0, 0]\nhi = [0, 1, 1]\n", {"'lo' is not below 'hi'"});
  noted(
      "[environment]\nradiance = 1\n[[volumes]]\nshape = \"sphere\"\n[[lights]]\ntype = \"point\"\nposition = [0, 0, 9]\nintensity = 0\n",
      "light 0 has no power");
  const std::string volume = "[environment]\nradiance = 1\n[[volumes]]\nfile = \"" + kCloud + "\"\n";
  refused(volume + "temperature_grid = \"temperature\"\n", {"no grid 'temperature'", "density (float)"});
  for (const char* key : {"temperature", "flame", "albedo", "velocity"}) {
    const std::string grid = fmt::format("{}_grid", key);
    const std::string missing = key == std::string("albedo") ? "color" : key;
    const std::string shutter = key == std::string("velocity") ? "shutter = [0, 1]\n" : "";
    test::write_file(folder_ / "auto.toml", "[camera]\nposition = [0, -5, 1]\nlook_at = [0, 0, 0]\n" + shutter +
                                                "[film]\nwidth = 8\nheight = 8\n[render]\nspp = 1\n" + volume + grid +
                                                " = \"auto\"\n");
    const auto r = run_brume("render " + path("auto.toml") + " --progress none -o " + path("fine.exr"));
    EXPECT_EQ(r.status, 0) << r.err;
    EXPECT_NE(r.err.find("no grid '" + missing + "'; the file has: density (float): \"auto\" finds none"),
              std::string::npos)
        << r.err;
  }
  refused(volume + "albedo_grid = \"density\"\n", {"grid 'density' is of type float; expected vec3s"});
  test::write_file(folder_ / "s.toml", head + "shutter = [0, 1]\n");
  const std::string shutter = "[camera]\nposition = [0, -5, 1]\nlook_at = [0, 0, 0]\nshutter = [0, 1]\n";
  test::write_file(folder_ / "v.toml", shutter + volume + "velocity_grid = \"density\"\n");
  expect_refused("render " + path("v.toml") + " -o " + path("out.exr"),
                 {"grid 'density' is of type float; expected vec3s"});
  noted(volume + "velocity_grid = \"density\"\n", "no motion blur");
}

TEST_F(BadInput, WrongKindsOfFilesAndOptions) {
  expect_refused("evaluate " + kCloud + " -o " + path("results"), {"is an OpenVDB file, expected a scene"});
  expect_refused("info " + kScene, {"is neither an OpenVDB nor an OpenEXR file"});
  expect_refused("render " + kScene + " --ssp 1 -o " + path("out.exr"),
                 {"render has no option '--ssp'; did you mean '--spp'?"});
  expect_refused("render " + kScene + " --crop 5,5,2,9 -o " + path("out.exr"),
                 {"--crop 5,5,2,9: expected x0,y0,x1,y1 inside 0,0,400,400"});
  expect_refused("render " + kScene + " --part 3/2 -o " + path("out.exr"), {"--part 3/2: expected i/N"});
  expect_refused("render " + kScene + " --time soon -o " + path("out.exr"), {"--time soon: expected a duration"});
  expect_refused("render " + kScene + " --layers deph -o " + path("out.exr"),
                 {"no layer 'deph' to record; did you mean 'depth'?"});
}

// Killed without warning while checkpoints are written: what is left is whole, and can be gone on with.
TEST_F(BadInput, KilledInTheMiddleOfACheckpoint) {
  const std::string render =
      "render " + kScene + " -q -D film.width=48 -D film.height=48 --checkpoint " + path("c.exr") + " ";
  for (int i = 0; i < 4; ++i) {
    test::RunningProgram program(render + "--checkpoint-every 0.001 --spp 16777216 -o " + path("out.exr"));
    ASSERT_TRUE(program.wait_until([&] {
      return std::filesystem::exists(path("c.exr")) && test::has_half_written(folder_.path());
    })) << program.err();
    program.send(SIGKILL);
    EXPECT_EQ(program.finish().status, 128 + SIGKILL);
    const auto more = run_brume(render + "--resume " + path("c.exr") + " --time 0.2s -o " + path("more.exr"));
    EXPECT_EQ(more.status, 0) << more.err;
    std::filesystem::remove(path("c.exr"));
  }
}

// A disk that is full: the message, and no half-written file.
TEST_F(BadInput, AFullDisk) {
  for (const auto& [command, output] :
       {std::pair("render " + kScene + " -q -D film.width=64 -D film.height=64 --spp 1 -o ", path("out.exr")),
        {"generate cloud -q --resolution 64 -o ", path("cloud.vdb")},
        {"halve -q " + kCloud + " -o ", path("half.vdb")}}) {
    const test::FullDisk full(output);
    expect_refused(command + output, {output + ": cannot be written: No space left on device"});
    EXPECT_FALSE(std::filesystem::exists(output));
    expect_nothing_written();
  }
}

// Files that were made to crash their readers or to keep them busy for ever.
TEST_F(BadInput, HostileFilesAreRefusedInWords) {
  const auto hostile = [](const std::string& name) { return test::source("tests/data/hostile/" + name).string(); };
  for (const std::string name : {"alloc.vdb", "blosc_overrun.vdb", "huge_metadata.vdb"}) {
    expect_refused("info " + hostile(name), {name + ": damaged"});
    expect_refused("render " + scene(hostile(name)) + " -o " + path("out.exr"), {name + ": damaged"});
    expect_refused("halve " + hostile(name) + " -o " + path("half.vdb"), {name + ": damaged"});
  }
  const auto lit_by = [&](const std::string& name) {
    return "render " + kScene + " -D environment.file=" + hostile(name) + " -o " + path("out.exr");
  };
  expect_refused(lit_by("zero_rows.hdr"), {"zero_rows.hdr: is 7 x 0 pixels; expected 1 .."});
  expect_refused(lit_by("cut_rle.hdr"), {"cut_rle.hdr: truncated: the file ends in row 4 of 8"});
  expect_nothing_written();
  EXPECT_FALSE(std::filesystem::exists(path("half.vdb")));
}

TEST_F(BadInput, NoCommandDestroysWhatItReads) {
  const std::string s = scene(kCloud), text = test::read_file(s), input = frame("direct,indirect");
  expect_refused("render " + s + " -o " + s, {"its name should end in .exr"});
  expect_refused("render " + s + " -o " + path("a.exr") + " --png " + s, {"its name should end in .png"});
  expect_refused("denoise " + input + " -f bilateral -o " + input, {"is read by this command and would be destroyed"});
  const std::string small = "render " + s + " -D film.width=8 -D film.height=8 --spp 1 ";
  expect_refused(small + "-o " + path("same.exr") + " --checkpoint " + path("./same.exr"), {"is the checkpoint too"});
  EXPECT_EQ(run_brume(small + "-o " + path("o.exr") + " --checkpoint " + path("ck.exr")).status, 0);
  expect_refused(small + "-o " + path("ck.exr") + " --resume " + path("ck.exr"),
                 {"is read by this command and would be destroyed"});
  std::filesystem::copy_file(kCloud, path("c.vdb"));
  expect_refused("halve " + path("c.vdb") + " -o " + path("c.vdb"), {"is read by this command and would be destroyed"});
  EXPECT_EQ(test::read_file(s), text);
}

TEST_F(BadInput, UnwritableOutputIsFoundBeforeTheWork) {
  expect_refused("render " + kScene + " --spp 100000 -o " + path("no/such/out.exr"),
                 {"out.exr: cannot be written: there is no folder"});
  expect_refused("render " + kScene + " --spp 100000 -o " + folder_.path().string(),
                 {"is a folder, expected the name of a file to write"});
  expect_refused("generate cloud -o " + path("no/out.vdb"), {"there is no folder"});
  expect_refused(
      "denoise " + frame("direct,indirect") + " -f bilateral -o " + path("out.exr") + " --png " + path("no/out.png"),
      {"there is no folder"});
  expect_nothing_written();
}

TEST_F(BadInput, CtrlCLeavesNothingHalfWritten) {
  for (const std::string& command :
       {"render " + kScene + " -D film.width=2048 -D film.height=2048 --spp 4096 --progress json -o " + path("out.exr"),
        "evaluate " + kScene + " --reference-spp 16384 --progress json -o " + path("out")}) {
    test::RunningProgram program(command);
    ASSERT_TRUE(program.wait_until([&] { return program.err().find("\"progress\"") != std::string::npos; }))
        << program.err();
    program.send(SIGINT);
    const auto r = program.finish();
    EXPECT_EQ(r.status, 3) << r.err;
    EXPECT_NE(r.err.find("interrupted; no file was left half-written"), std::string::npos) << r.err;
    EXPECT_EQ(r.err.find("with --cache DIR the same command would go on") != std::string::npos,
              command.starts_with("evaluate"));
    expect_nothing_written();
    EXPECT_FALSE(std::filesystem::exists(folder_ / "out"));
  }
}

}  // namespace
}  // namespace brume
