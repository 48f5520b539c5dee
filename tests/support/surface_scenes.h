#pragma once
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "base/math.h"
#include "render/scene/scene.h"
#include "tests/support/files.h"

namespace brume::test {

/// A ball of quadrilaterals as OBJ, outside out.
inline void write_ball(const std::filesystem::path& path, double radius, int n = 48, bool normals = false) {
  std::ofstream f(path);
  const int rings = n / 2;
  for (int j = 0; j <= rings; ++j)
    for (int i = 0; i < n; ++i) {
      const double theta = kPi * j / rings, phi = 2 * kPi * i / n;
      f << "v " << radius * std::sin(theta) * std::cos(phi) << ' ' << radius * std::sin(theta) * std::sin(phi) << ' '
        << radius * std::cos(theta) << '\n';
      if (normals)
        f << "vn " << std::sin(theta) * std::cos(phi) << ' ' << std::sin(theta) * std::sin(phi) << ' '
          << std::cos(theta) << '\n';
    }
  const auto corner = [&](int v) { return normals ? fmt::format("{}//{}", v + 1, v + 1) : fmt::format("{}", v + 1); };
  for (int j = 0; j < rings; ++j)
    for (int i = 0; i < n; ++i)
      f << "f " << corner(j * n + i) << ' ' << corner((j + 1) * n + i) << ' ' << corner((j + 1) * n + (i + 1) % n)
        << ' ' << corner(j * n + (i + 1) % n) << '\n';
}

/// A square of 100 x 100 around the origin.
inline const char* const kFloor =
    "v -50 -50 0\nv 50 -50 0\nv 50 50 0\nv -50 50 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

/// A camera looks at one mesh, the ball or the floor.
class SurfaceTest : public ::testing::Test {
 protected:
  SurfaceTest() {
    write_ball(folder_ / "ball.obj", 1.0);
    write_file(folder_ / "floor.obj", kFloor);
  }
  Scene scene(const char* mesh) {
    Scene s;
    s.film.width = s.film.height = 16;
    s.camera.position = dvec3(0, -6, 3);
    s.camera.fov = 26;
    s.surfaces.emplace_back();
    s.surfaces[0].file = folder_ / mesh;
    return s;
  }
  TemporaryFolder folder_;
};

}  // namespace brume::test
