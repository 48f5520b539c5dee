// Scenes built in Blender (scenes.py), rendered by Cycles there and by brume from their translation: the mean of the
// frame within 1 %, blocks of 10 x 10 pixels within the noise that two independent renders of each tell.
// BRUME_BLENDER_KEEP=FOLDER keeps the frames there, and a picture of each scene: Cycles, brume, their difference.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include "filters/patch/student.h"
#include "image/exr_io.h"
#include "image/picture_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

constexpr int kBlock = 10;
constexpr double kLevel = 1e-3;     // chance that any block of any scene differs by accident, Sidak-corrected
constexpr double kRounding = 1e-4;  // of blocks without noise: half floats of Cycles' textures

struct BlenderScene {
  const char* name;
  int cycles_samples, brume_samples;
  bool alpha = false;  ///< whether the film is transparent
};
constexpr BlenderScene kScenes[] = {
    {"perspective", 48, 192}, {"orthographic", 64, 256}, {"motion", 32, 192}, {"fire", 48, 192},
    {"shaders", 32, 192},     {"fog", 64, 256},          {"lights", 64, 256}, {"world", 48, 192, true},
    {"meshes", 128, 512},     {"roles", 48, 192, true},  {"fluid", 48, 192},
};
/// Skies that brume has another one for: said, and as bright on what they light.
constexpr BlenderScene kSkies[] = {{"sky_preetham", 256, 256}, {"sky_hosek", 256, 256}, {"sky_nishita", 256, 256}};

/// Mean of two independent frames, and the square of half their difference, which is the mean's variance in the mean,
/// with what both may miss alike: where an edge lies, to one of a pixel's samples.
struct Frame {
  std::array<Plane, 4> mean, variance;
};

using Four = std::array<const Plane*, 4>;

Four rgba_of(const Layers& frame, const std::string& layer) {
  return {&frame.at(layer + "R"), &frame.at(layer + "G"), &frame.at(layer + "B"), &frame.at(layer + "A")};
}

/// Largest difference between a pixel and those around it.
float contrast(const Plane& plane, int x, int y) {
  float most = 0;
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) {
      const int nx = std::clamp(x + dx, 0, plane.width() - 1), ny = std::clamp(y + dy, 0, plane.height() - 1);
      most = std::max(most, std::abs(plane(nx, ny) - plane(x, y)));
    }
  return most;
}

Frame frame_of(const Four& first, const Four& second, int samples) {
  Frame frame;
  for (size_t c = 0; c < 4; ++c) {
    frame.mean[c] = frame.variance[c] = Plane(first[c]->width(), first[c]->height());
    for (int y = 0; y < first[c]->height(); ++y)
      for (int x = 0; x < first[c]->width(); ++x) {
        const float a = (*first[c])(x, y), b = (*second[c])(x, y);
        frame.mean[c](x, y) = 0.5f * (a + b);
        frame.variance[c](x, y) = 0.25f * (a - b) * (a - b);
      }
    for (int y = 0; y < first[c]->height(); ++y)
      for (int x = 0; x < first[c]->width(); ++x) {
        const float step = contrast(frame.mean[c], x, y) / static_cast<float>(samples);
        frame.variance[c](x, y) += step * step / 12;
      }
  }
  return frame;
}

double sum_of(const Plane& plane, int x0, int y0, int x1, int y1) {
  double sum = 0;
  for (int y = y0; y < y1; ++y)
    for (int x = x0; x < x1; ++x) sum += plane(x, y);
  return sum;
}

/// Standard errors that a difference of one of `count` blocks may have.
double most_standard_errors(double count) {
  const double each = 1 - std::pow(1 - kLevel, 1 / count);
  // The variance of a block is estimated from the differences of its pixels.
  return student_quantile(1 - each, kBlock * kBlock);
}

std::string name_of(const ::testing::TestParamInfo<BlenderScene>& scene) {
  return scene.param.name;
}

class BlenderScenes : public ::testing::TestWithParam<BlenderScene> {
 protected:
  fs::path folder() const {
    const char* const kept = std::getenv("BRUME_BLENDER_KEEP");
    return kept ? fs::path(kept) / GetParam().name : folder_.path();
  }

  /// Smoke of the project's own whose velocities reach beyond it: where they end, semi-Lagrangian schemes differ.
  void write_moving_smoke(const fs::path& path) const {
    const VoxelBox box{ivec3(-24), ivec3(24)}, around{ivec3(-40), ivec3(40)};
    const fs::path still = folder() / "still.vdb";
    test::write_affine_vdb(still, box, test::scaling(dvec3(0.03)), [](const ivec3& v) {
      const double r = glm::length(dvec3(v)) / 22,
                   wave = std::sin(0.35 * v.x) * std::sin(0.3 * v.y) * std::sin(0.4 * v.z);
      return static_cast<float>(std::max(0.0, std::min(1.0, 3 * (1 - r)) + 0.5 * wave * (r < 1 ? 1 : 0)));
    });
    test::write_velocity_vdb(path, still, around, {1.2, 0.3, 0.6});
    fs::remove(still);
  }

  void render_in_blender() const {
    fs::create_directories(folder());
    write_moving_smoke(folder() / "moving.vdb");
    const std::string command = "blender -b --factory-startup --python-exit-code 9 --python " +
                                test::source("tests/blender/scenes.py").string() + " -- " + GetParam().name + " " +
                                folder().string() + " samples=" + std::to_string(GetParam().cycles_samples) + " >" +
                                (folder() / "log.txt").string() + " 2>&1";
    ASSERT_EQ(std::system(command.c_str()), 0) << test::read_file(folder() / "log.txt");
  }

  void render_in_brume() const {
    for (const char* seed : {"1", "2"}) {
      const auto r =
          test::run_brume("render " + (folder() / "scene.toml").string() + " -o " + (folder() / "brume_").string() +
                          seed + ".exr" + " --spp " + std::to_string(GetParam().brume_samples) + " --seed " + seed +
                          " --layers none --no-statistics -q -D render.max_events=64");  // as many as Cycles takes
      ASSERT_EQ(r.status, 0) << r.err;
    }
  }

  Frame frame(const std::string& name, const std::string& layer, int samples) const {
    const Layers first = read_exr(folder() / (name + "_1.exr")), second = read_exr(folder() / (name + "_2.exr"));
    return frame_of(rgba_of(first, layer), rgba_of(second, layer), samples);
  }

  /// Cycles, brume and four times their difference, side by side.
  void keep_picture(const Frame& theirs, const Frame& ours) const {
    const int width = ours.mean[0].width(), height = ours.mean[0].height();
    std::array<Plane, 3> picture;
    for (size_t c = 0; c < 3; ++c) {
      picture[c] = Plane(3 * width, height);
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
          const float a = theirs.mean[c](x, y), b = ours.mean[c](x, y);
          picture[c](x, y) = a;
          picture[c](width + x, y) = b;
          picture[c](2 * width + x, y) = 0.2f + 4 * (b - a);
        }
    }
    write_png(folder() / "side_by_side.png", to_picture({&picture[0], &picture[1], &picture[2]}));
  }

 private:
  test::TemporaryFolder folder_;
};

TEST_P(BlenderScenes, LookAsInCycles) {
  render_in_blender();
  if (HasFatalFailure()) return;
  EXPECT_EQ(test::read_file(folder() / "scene.toml").find("# Left out"), std::string::npos)
      << "everything here has a counterpart\n"
      << test::read_file(folder() / "scene.toml");
  render_in_brume();
  if (HasFatalFailure()) return;
  const Frame theirs = frame("cycles", "ViewLayer.Combined.", GetParam().cycles_samples),
              ours = frame("brume", "", GetParam().brume_samples);
  keep_picture(theirs, ours);
  const int width = ours.mean[0].width(), height = ours.mean[0].height();
  ASSERT_EQ(theirs.mean[0].width(), width);
  ASSERT_EQ(theirs.mean[0].height(), height);
  const int columns = width / kBlock, rows = height / kBlock, channels = GetParam().alpha ? 4 : 3;
  const double most = most_standard_errors(1.0 * columns * rows * channels * static_cast<double>(std::size(kScenes)));
  for (size_t c = 0; c < static_cast<size_t>(channels); ++c) {
    const double a = sum_of(theirs.mean[c], 0, 0, width, height), b = sum_of(ours.mean[c], 0, 0, width, height);
    const double error =
        std::sqrt(sum_of(theirs.variance[c], 0, 0, width, height) + sum_of(ours.variance[c], 0, 0, width, height));
    EXPECT_NEAR(b / a, 1.0, 0.01) << "RGBA"[c];
    EXPECT_LT(4 * error, 0.01 * a) << "too noisy to tell";
    double worst = 0, squares = 0;
    for (int by = 0; by < rows; ++by)
      for (int bx = 0; bx < columns; ++bx) {
        const auto block = [&](const Plane& plane) {
          return sum_of(plane, bx * kBlock, by * kBlock, (bx + 1) * kBlock, (by + 1) * kBlock);
        };
        const double theirs_here = block(theirs.mean[c]), ours_here = block(ours.mean[c]);
        const double noise = std::sqrt(block(theirs.variance[c]) + block(ours.variance[c]));
        const double rounding = kRounding * std::abs(theirs_here) + 1e-5;
        const double off = std::max(0.0, std::abs(ours_here - theirs_here) - rounding) / std::max(noise, 1e-9);
        EXPECT_LT(off, most) << "RGBA"[c] << " of block " << bx << ", " << by << ": " << ours_here << " instead of "
                             << theirs_here << ", noise " << noise;
        worst = std::max(worst, off);
        squares += off * off;
      }
    std::printf("  %s %c: mean ratio %.5f (noise %.5f), worst block %.2f of %.2f standard errors, rms %.2f\n",
                GetParam().name, "RGBA"[c], b / a, error / a, worst, most, std::sqrt(squares / (rows * columns)));
  }
}

INSTANTIATE_TEST_SUITE_P(Each, BlenderScenes, ::testing::ValuesIn(kScenes), name_of);

class BlenderSkies : public BlenderScenes {};

TEST_P(BlenderSkies, AreAsBright) {
  render_in_blender();
  if (HasFatalFailure()) return;
  EXPECT_NE(test::read_file(folder() / "scene.toml").find("# Left out: World: "), std::string::npos);
  render_in_brume();
  if (HasFatalFailure()) return;
  const Frame theirs = frame("cycles", "ViewLayer.Combined.", GetParam().cycles_samples),
              ours = frame("brume", "", GetParam().brume_samples);
  for (size_t c = 0; c < 3; ++c) {
    const int width = ours.mean[c].width(), height = ours.mean[c].height();
    const double ratio = sum_of(ours.mean[c], 0, 0, width, height) / sum_of(theirs.mean[c], 0, 0, width, height);
    std::printf("  %s %c: mean ratio %.4f\n", GetParam().name, "RGB"[c], ratio);
    EXPECT_NEAR(ratio, 1, std::string(GetParam().name) == "sky_preetham" ? 0.01 : 0.08) << "RGB"[c];
  }
}

INSTANTIATE_TEST_SUITE_P(Each, BlenderSkies, ::testing::ValuesIn(kSkies), name_of);

// notes.py: every thing that has no counterpart, each said once, and the rest a scene that brume renders.
TEST(BlenderNotes, SayWhatIsLeftOutAndWhatIsTakenInstead) {
  const test::TemporaryFolder folder;
  const std::string command = "blender -b --factory-startup --python-exit-code 9 --python " +
                              test::source("tests/blender/notes.py").string() + " -- " + folder.path().string() + " >" +
                              (folder / "log.txt").string() + " 2>&1";
  ASSERT_EQ(std::system(command.c_str()), 0) << test::read_file(folder / "log.txt");
  const std::string notes = test::read_file(folder / "notes.txt") + "\n",
                    errors = test::read_file(folder / "errors.txt");
  for (const char* note : {"Rolling shutter: is left out",
                           "Shutter curve: is left out",
                           "Camera: its aperture is stretched",
                           "Camera: its zoom is left out of the motion blur",
                           "World: its sun stands at or below the horizon",
                           "World: its sky (Nishita) is Preetham's",
                           "World: it is seen by rays of every kind in brume, glossy too",
                           "Disk: its ellipse is a rectangle of the same area",
                           "Narrow: its spread of 60 degrees is left out",
                           "Soft spot: its radius of 0.3 is left out",
                           "Portal: the light is left out",
                           "Shadowless: its light casts shadows",
                           "Picky: its light reaches rays of every kind in brume, glossy too",
                           "Moving lamp: the light stands still",
                           "Constant: its constant falloff is left out",
                           "Patterned: 'Strength' of its light depends on Noise Texture",
                           "Missing: the volume is left out: its file",
                           "Glow: its volume is seen by rays of every kind in brume, camera too",
                           "Glow: what it emits everywhere it emits where the grid 'density' is above 0",
                           "Turning: 'Anisotropy' of its volume varies; its mean, 0.5, is taken",
                           "Constant density: the volume is left out: no grid of its file drives its density",
                           "Gridless fog: its fog is left out",
                           "Plastic: the material has sheen",
                           "Blend: the material is a mixture; its diffuse part (0.7) is taken alone",
                           "Toon: the material has Toon BSDF, which brume lacks; a diffuse surface is taken",
                           "Bumpy: the material's displacement is left out",
                           "Bumpy: the material has bumps",
                           "Bumpy: the material has a diffuse roughness of 0.5",
                           "Clear: is transparent",
                           "Boxed: the material's image is projected box",
                           "Boxed: the material's image (clip) repeats",
                           "Boxed: is seen by rays of every kind but the camera's in brume, shadow too",
                           "Bare: has no UV map",
                           "Far: is seen beyond 100, where Blender's camera clips",
                           "Soft: its deformation is left out of the motion blur",
                           "Torch: the light that it emits stands still"}) {
    const size_t at = notes.find(note);
    EXPECT_NE(at, std::string::npos) << note << "\n" << notes;
    EXPECT_EQ(notes.find(note, at + 1), std::string::npos) << note << " is said twice";
  }
  EXPECT_EQ(std::count(notes.begin(), notes.end(), '\n'), 36) << notes;
  EXPECT_EQ(errors,
            "Camera: brume has no pano camera; it has perspective and orthographic ones\n"
            "Disk: is a light; brume looks through cameras alone\n"
            "the scene has no camera");
  const auto r =
      test::run_brume("render " + (folder / "scene.toml").string() + " --spp 1 -q -o " + (folder / "a.exr").string());
  EXPECT_EQ(r.status, 0) << r.err;
}

}  // namespace
}  // namespace brume
