#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/error.h"
#include "render/files/mesh.h"
#include "tests/support/files.h"
#include "tests/support/surface_scenes.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::kFloor;

TEST(LoadMesh, ReadsObjAndPlyOfAllKinds) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "a.obj", kFloor);
  const std::string header =
      "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n";
  test::write_file(folder / "a.ply",
                   "ply\nformat ascii 1.0\n" + header + "-50 -50 0\n50 -50 0\n50 50 0\n-50 50 0\n4 0 1 2 3\n");
  std::string binary = "ply\nformat binary_little_endian 1.0\n" + header;
  for (const float v : {-50.f, -50.f, 0.f, 50.f, -50.f, 0.f, 50.f, 50.f, 0.f, -50.f, 50.f, 0.f})
    binary.append(reinterpret_cast<const char*>(&v), 4);
  binary += '\4';
  for (const int32_t v : {0, 1, 2, 3}) binary.append(reinterpret_cast<const char*>(&v), 4);
  test::write_file(folder / "b.ply", binary);
  for (const char* name : {"a.obj", "a.ply", "b.ply"}) {
    const TriangleMesh mesh = load_mesh(folder / name, dmat4(1));
    ASSERT_EQ(mesh.triangles.size(), 2u) << name;
    EXPECT_NEAR(mesh.area(0) + mesh.area(1), 1e4, 1e-3);
    EXPECT_NEAR(mesh.normal(0).z, 1, 1e-6);
    EXPECT_NEAR(load_mesh(folder / name, test::scaling(dvec3(1, 1, -1))).normal(0).z, -1, 1e-6)
        << "a mirror keeps the outside outside: what pointed up now points down";
  }
}

TEST(LoadMesh, KeepsVertexNormalsWhereEveryVertexHasOne) {
  const test::TemporaryFolder folder;
  const std::string face = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 2\nvn 1 0 1\n";
  test::write_file(folder / "all.obj", face + "f 1//1 2//2 3//1\n");
  test::write_file(folder / "some.obj", face + "f 1//1 2//2 3\n");
  test::write_file(folder / "zero.obj", face + "vn 0 0 0\nf 1//1 2//2 3//3\n");
  test::write_file(
      folder / "all.ply",
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\nelement face 1\n"
      "property list uchar int vertex_indices\nend_header\n0 0 0 0 0 2\n1 0 0 1 0 1\n0 1 0 0 0 2\n3 0 1 2\n");
  for (const char* name : {"all.obj", "all.ply"}) {
    const TriangleMesh mesh = load_mesh(folder / name, test::scaling(dvec3(2, 1, 1)));
    ASSERT_EQ(mesh.normals.size(), 3u) << name;
    EXPECT_NEAR(mesh.normals[0].z, 1, 1e-6) << "made unit";
    EXPECT_NEAR(mesh.normals[1].z / mesh.normals[1].x, 2, 1e-5) << "turned like a plane, not like an edge";
  }
  EXPECT_TRUE(load_mesh(folder / "some.obj", dmat4(1)).normals.empty());
  const TriangleMesh zero = load_mesh(folder / "zero.obj", dmat4(1));
  EXPECT_TRUE(zero.normals.empty());
  ASSERT_EQ(zero.notes.size(), 1u);
  EXPECT_NE(zero.notes[0].find("without a direction"), std::string::npos);
}

TEST(LoadMesh, BrokenFilesSayWhatIsWrong) {
  const test::TemporaryFolder folder;
  const auto error = [&](const std::string& name, const std::string& text) -> std::string {
    test::write_file(folder / name, text);
    try {
      load_mesh(folder / name, dmat4(1));
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  const auto holds = [](const std::string& text, const char* part) { return text.find(part) != std::string::npos; };
  EXPECT_TRUE(holds(error("a.stl", "solid"), "neither PLY (by its first bytes) nor OBJ"));
  EXPECT_TRUE(holds(error("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"),
                    "none of its 1 faces can be used: the one in line 4 has vertices that are not there (9 of 3)"));
  EXPECT_TRUE(holds(error("b.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"), "no triangle with an area"));
  EXPECT_TRUE(holds(error("c.ply", "ply\nformat ascii 1.0\nelement vertex 3\n"), "header has no end"));
  EXPECT_TRUE(holds(error("d.ply", "ply\nformat binary_mixed_endian 1.0\nend_header\n"), "binary_mixed_endian"));
  EXPECT_TRUE(holds(
      error(
          "e.ply",
          "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\nabc"),
      "truncated"));
  EXPECT_TRUE(holds(error("f.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float a\nend_header\n0\n"),
                    "no x, y, z"));
  // Degenerate triangles beside a good one are dropped and counted; edges shared by three triangles are no matter.
  test::write_file(folder / "g.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 2\nf 1 2 4\nf 2 1 4\n");
  const TriangleMesh mesh = load_mesh(folder / "g.obj", dmat4(1));
  EXPECT_EQ(mesh.triangles.size(), 3u);
  EXPECT_TRUE(holds(mesh.notes.at(0), "1 degenerate"));
}

}  // namespace
}  // namespace brume
