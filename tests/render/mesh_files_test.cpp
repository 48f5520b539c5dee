#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/error.h"
#include "render/files/mesh.h"
#include "tests/support/files.h"

namespace brume {
namespace {

const std::string kSquare = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\n";

bool holds(const std::vector<std::string>& notes, const std::string& part) {
  return std::any_of(notes.begin(), notes.end(),
                     [&](const std::string& note) { return note.find(part) != std::string::npos; });
}

double area_of(const TriangleMesh& mesh) {
  double sum = 0;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) sum += mesh.area(i);
  return sum;
}

class MeshFile : public ::testing::Test {
 protected:
  TriangleMesh obj(const std::string& text) { return read("a.obj", text); }
  TriangleMesh ply(const std::string& text) { return read("a.ply", text); }
  std::string error_of(const std::string& name, const std::string& text) {
    try {
      read(name, text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  void expect_refused(const std::string& name, const std::string& text, const std::string& part) {
    const std::string error = error_of(name, text);
    EXPECT_NE(error.find(part), std::string::npos) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  }

 private:
  TriangleMesh read(const std::string& name, const std::string& text) {
    test::write_file(folder_ / name, text);
    return load_mesh(folder_ / name, dmat4(1));
  }
  test::TemporaryFolder folder_;
};

TEST_F(MeshFile, ObjLinesOfEveryKindAreRead) {
  const std::pair<const char*, std::string> files[] = {
      {"a byte order mark", "\xEF\xBB\xBF" + kSquare + "f 1 2 3 4\n"},
      {"lines that go on", kSquare + "f 1 2 \\\n 3 4\n"},
      {"lines that go on, with blanks and \\r\\n",
       "v 0 0 0\r\nv 2 0 \\ \r\n 0\r\nv 2 2 0\r\nv 0 2 0\r\nf 1 2 3\\\r\n 4\r\n"},
      {"\\r alone", "v 0 0 0\rv 2 0 0\rv 2 2 0\rv 0 2 0\rf 1 2 3 4"},
      {"comments behind",
       "v 0 0 0 # first\nv 2 0 0\t#\nv 2 2 0\nv 0 2 0\nf 1 2 3 4 # a face # and more\n#\n# f 1 2 9\n"},
      {"empty places for texture coordinates", kSquare + "f 1/ 2/ 3/ 4/\n"},
      {"empty places for both", kSquare + "f 1// 2// 3// 4//\n"},
      {"places from the end", kSquare + "f -4 -3 -2 -1\n"},
      {"a face before its vertices", "f 1 2 3 4\n" + kSquare},
      {"tabs and blanks", "\t v\t0  0 0\n v 2 0 0 \nv 2 2 0\nv 0 2 0\n  f  1\t2 3   4  \n"},
      {"weights, colours, signs and exponents", "v 0 0 +0 1\nv 2e0 0 0 1 0.5 0.5\nv .2E+1 2. -0\nv 0 2 0\nf 1 2 3 4\n"},
      {"the old name of faces", kSquare + "fo 1 2 3 4\n"},
      {"groups, materials, lines and points",
       "mtllib no.mtl\no a\n" + kSquare + "g x y\nusemtl m#1\ns off\nl 1 2\np 3\nf 1 2 3 4\nvp 0 0\ncall b.obj\n"}};
  for (const auto& [what, text] : files) {
    const TriangleMesh mesh = obj(text);
    EXPECT_EQ(mesh.triangles.size(), 2u) << what;
    EXPECT_DOUBLE_EQ(area_of(mesh), 4) << what;
    EXPECT_GT(mesh.normal(0).z, 0.99) << what;
    EXPECT_TRUE(mesh.notes.empty()) << what << ": " << mesh.notes[0];
  }
  EXPECT_DOUBLE_EQ(obj("v 1000000.125 0 0\nv 1000001.375 0 0\nv 1000000.125 1 0\nf 1 2 3\n").positions[1].x,
                   1000001.375)
      << "in double precision";
}

TEST_F(MeshFile, TextureCoordinatesAndNormalsFollowTheirCorners) {
  // A notched square whose texture coordinates are a tenth of its positions, numbered backwards; one normal for all.
  const std::string outline = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nvt 0 .4\nvt .1 .1\nvt .4 0\nvt 0 0\nvn 0 0 3\n";
  for (const char* face : {"f 1/4/1 2/3/1 3/2/1 4/1/1\n", "f -4/-1/-1 -3/-2/-1 -2/-3/-1 -1/-4/-1\n"}) {
    const TriangleMesh mesh = obj(outline + face);
    ASSERT_EQ(mesh.triangles.size(), 2u);
    EXPECT_DOUBLE_EQ(area_of(mesh), 4);
    ASSERT_EQ(mesh.texcoords.size(), mesh.positions.size());
    ASSERT_EQ(mesh.normals.size(), mesh.positions.size());
    for (size_t i = 0; i < mesh.positions.size(); ++i) {
      EXPECT_NEAR(mesh.texcoords[i].x, 0.1 * mesh.positions[i].x, 1e-7);
      EXPECT_NEAR(mesh.texcoords[i].y, 0.1 * mesh.positions[i].y, 1e-7);
      EXPECT_EQ(mesh.normals[i], vec3(0, 0, 1));
    }
  }
  const TriangleMesh wrong = obj(outline + "f 1/4/1 2/3/1 3/9/1 4/1/0\n");
  EXPECT_TRUE(holds(wrong.notes,
                    "1 corners name texture coordinates that are not there: they have 0, 0, the first in line 10"));
  EXPECT_TRUE(holds(wrong.notes, "1 corners name normals that are not there: it is shaded by its triangles"));
  EXPECT_TRUE(wrong.normals.empty());
  EXPECT_TRUE(holds(obj(outline + "f 1/4/1 2/3/1 3/2/1 4/1\n").notes, "1 corners have no normal"));
  EXPECT_TRUE(holds(obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt nan 0\nvt 1 0\nvt 0 inf\nf 1/1 2/2 3/3\n").notes,
                    "texture coordinates of 2 vertices that are not finite became 0, 0"));
}

TEST_F(MeshFile, FacesThatCannotBeUsedAreCountedAndTold) {
  const TriangleMesh mesh = obj(
      kSquare +
      "v nan 0 0\nv 1 -inf 0\nv 1.#QNAN 0 0\nf 1 2\nf 1 2 3 4\nf 1 2 99\nf 0 1 2\nf 1 2 5\nf 1 2 3 6\nf 1 7 3\nf 4 3 2 9\n");
  EXPECT_DOUBLE_EQ(area_of(mesh), 4);
  EXPECT_TRUE(holds(mesh.notes, "a.obj: 1 faces with fewer than three corners were left out, the first in line 8"));
  EXPECT_TRUE(
      holds(mesh.notes, "3 faces with vertices that are not there (99 of 7) were left out, the first in line 10"));
  EXPECT_TRUE(holds(mesh.notes, "3 faces with coordinates that are not finite were left out, the first in line 12"));
  EXPECT_EQ(mesh.positions.size(), 4u) << "vertices of no triangle go";
  EXPECT_TRUE(holds(obj("v 0 0 0\nv 1 0 1\nv 1 0 0\nv 0 0 1\nf 1 2 3 4\n").notes, "1 polygons cross themselves"));
  expect_refused("a.obj", kSquare, "a.obj: holds no faces: no line of its 4 begins with f; it has 4 vertices");
  expect_refused("a.obj", "cstype bezier\nv 0 0 0\nsurf 0 1 0 1 1\n",
                 "and 1 free-form surfaces, which brume does not read");
  expect_refused("a.obj", "", "holds no faces");
  expect_refused("a.obj", kSquare + "f 1 2\nf 1\n",
                 "none of its 2 faces can be used: the one in line 5 has fewer than three");
  expect_refused("a.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
                 "the one in line 4 has coordinates that are not finite");
  expect_refused("a.obj", kSquare + "f 1 2 3 x\n", "line 5: 'f 1 2 3 x'; expected whole numbers as corners");
  expect_refused("a.obj", kSquare + "f 1 2 3/1/1/1\n", "expected corners as v, v/vt");
  expect_refused("a.obj", "v 0 0\n", "line 1: 'v 0 0'; expected three numbers");
  expect_refused("a.obj", "v 0,5 0 1\n", "line 1: 'v 0,5 0 1'; expected three numbers");
  expect_refused("a.obj", std::string("\xFF\xFEv\0", 4), "is UTF-16 text");
}

/// A notched square of area 4 with a vertex to spare. @param count  type of its faces' numbers of corners
std::string header(const std::string& format, const std::string& real, const std::string& count,
                   const std::string& index, const std::string& end = "\n",
                   const std::string& list = "vertex_indices") {
  std::string text;
  for (const std::string& line :
       {std::string("ply"), "format " + format + " 1.0", std::string("comment element vertex 9"),
        std::string("obj_info by a test"), std::string("element nothing 2"), std::string("property list uchar short a"),
        std::string("property uchar b"), std::string("element vertex 5"), std::string("property uchar red"),
        "property " + real + " z", "property " + real + " y", std::string("property list uchar int more"),
        "property " + real + " x", std::string("element face 1"), std::string("property uchar flags"),
        "property list " + count + ' ' + index + ' ' + list, std::string("element after 1"),
        std::string("property int c"), std::string("end_header")})
    text += line + end;
  return text;
}

const double kNotched[5][3] = {{0, 0, 0}, {4, 0, 0}, {1, 1, 0}, {0, 4, 0}, {9, 9, 9}};

class BinaryPly {
 public:
  explicit BinaryPly(bool big) : swap_(big == (std::endian::native == std::endian::little)) {}
  template <class T>
  void add(T value) {
    char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    if (swap_) std::reverse(bytes, bytes + sizeof value);
    text.append(bytes, sizeof value);
  }
  template <class Real, class Count, class Index>
  void add_notched() {
    for (int k = 0; k < 2; ++k) {
      add<uint8_t>(1);
      add<int16_t>(-1);
      add<uint8_t>(13);
    }
    for (const auto& p : kNotched) {
      add<uint8_t>(10);
      add(static_cast<Real>(p[2]));
      add(static_cast<Real>(p[1]));
      add<uint8_t>(2);
      add<int32_t>(7);
      add<int32_t>(8);
      add(static_cast<Real>(p[0]));
    }
    add<uint8_t>(255);
    add(static_cast<Count>(4));
    for (const int i : {0, 1, 2, 3}) add(static_cast<Index>(i));
    add<int32_t>(5);
  }
  std::string text;

 private:
  bool swap_;
};

TEST_F(MeshFile, PlyOfEveryFormatTypeAndOrderIsRead) {
  const auto check = [&](const std::string& text, const std::string& what) {
    const TriangleMesh mesh = ply(text);
    EXPECT_DOUBLE_EQ(area_of(mesh), 4) << what;
    EXPECT_EQ(mesh.positions.size(), 4u) << what;
    EXPECT_GT(mesh.normal(0).z, 0.99) << what;
    EXPECT_TRUE(mesh.notes.empty()) << what;
  };
  const std::string rows =
      "1 -1 13\n1 -1 13\n10 0 0 2 7 8 0\n10 0 0 2 7 8 4e0\n10 0 1 2 7 8 1\n10 0 4 2 7 8 0\n10 9 9 2 7 8 +9\n255 4 0 1 2 3\n5\n";
  for (const char* end : {"\n", "\r\n", "\r"}) {
    std::string lines;
    for (const char c : rows) lines += c == '\n' ? std::string(end) : std::string(1, c);
    check(header("ascii", "float", "uchar", "int", end) + lines, "ascii");
    check(header("ascii", "float32", "int8", "uint16", end, "vertex_index") + lines, "ascii");
  }
  for (const bool big : {false, true}) {
    const std::string format = big ? "binary_big_endian" : "binary_little_endian";
    const auto binary = [&]<class Real, class Count, class Index>(Real, Count, Index, const char* real,
                                                                  const char* count, const char* index,
                                                                  const char* end) {
      BinaryPly body(big);
      body.add_notched<Real, Count, Index>();
      check(header(format, real, count, index, end) + body.text, format + ' ' + real + ' ' + count + ' ' + index);
    };
    binary(0.0f, uint8_t{0}, int32_t{0}, "float", "uchar", "int", "\n");
    binary(0.0, int8_t{0}, uint32_t{0}, "double", "char", "uint", "\r\n");
    binary(0.0, uint16_t{0}, uint16_t{0}, "float64", "ushort", "uint16", "\r");
    binary(0.0f, int16_t{0}, int16_t{0}, "float32", "int16", "short", "\n");
    binary(0.0f, uint32_t{0}, uint8_t{0}, "float32", "uint32", "uint8", "\n");
    binary(0.0f, int32_t{0}, int8_t{0}, "float32", "int32", "int8", "\n");
    binary(int16_t{0}, uint8_t{0}, float{0}, "short", "uint8", "float", "\n");
  }
}

TEST_F(MeshFile, PlyNormalsTextureCoordinatesAndStripsAreRead) {
  const auto text = [](const std::string& properties, const std::string& rows, const std::string& faces) {
    return "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n" +
           properties + faces + "end_header\n" + rows;
  };
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  for (const char* names : {"u v", "s t", "texture_u texture_v", "texture_s texture_t"}) {
    const std::string u = std::string(names).substr(0, std::string(names).find(' ')),
                      v = std::string(names).substr(u.size() + 1);
    const TriangleMesh mesh = ply(text(
        "property float nx\nproperty float ny\nproperty float nz\nproperty float " + u + "\nproperty float " + v + "\n",
        "0 0 0 0 0 1 0 0\n2 0 0 0 0 1 1 0\n2 2 0 0 0 1 1 1\n0 2 0 0 0 1 0 1\n4 0 1 2 3\n", face));
    ASSERT_EQ(mesh.texcoords.size(), 4u) << names;
    EXPECT_EQ(mesh.texcoords[2], vec2(1, 1));
    ASSERT_EQ(mesh.normals.size(), 4u);
    EXPECT_EQ(mesh.normals[3], vec3(0, 0, 1));
  }
  const std::string corners = "0 0 0\n2 0 0\n2 2 0\n0 2 0\n";
  const TriangleMesh wedges =
      ply(text("", corners + "4 0 1 2 3 8 0 0 .5 0 .5 1 0 1\n", face + "property list uchar float texcoord\n"));
  ASSERT_EQ(wedges.texcoords.size(), wedges.positions.size());
  for (size_t i = 0; i < wedges.positions.size(); ++i)
    EXPECT_FLOAT_EQ(wedges.texcoords[i].x, static_cast<float>(wedges.positions[i].x) / 4);
  const TriangleMesh strips =
      ply(text("", corners + "9 0 1 3 2 -1 0 1 1 1\n", "element tristrips 1\nproperty list int int vertex_indices\n"));
  EXPECT_EQ(strips.triangles.size(), 2u);
  EXPECT_DOUBLE_EQ(area_of(strips), 4);
  for (size_t i = 0; i < 2; ++i) EXPECT_GT(strips.normal(i).z, 0.99) << "every second one is turned around";
}

TEST_F(MeshFile, PlyThatCannotBeReadSaysWhere) {
  const std::string vertices =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string face = vertices + "element face 2\nproperty list uchar int vertex_indices\nend_header\n";
  const std::string corners = "0 0 0\n2 0 0\n0 2 0\n";
  EXPECT_TRUE(holds(ply(face + corners + "3 0 1 2\n3 0 1 7\n").notes,
                    "1 faces with vertices that are not there (8 of 3) were left out, the first in face 2"));
  EXPECT_TRUE(holds(ply(face + "0 0 0\n2 0 0\n0 2 0\n3 0 1 2\n3 0 1 -1\n").notes, "(there are 3)"));
  EXPECT_TRUE(holds(ply(face + corners + "3 0 1 2\n2 0 1\n").notes, "fewer than three corners"));
  expect_refused("a.ply", vertices + "end_header\n" + corners, "holds no faces; it has 3 of 'vertex'");
  expect_refused("a.ply", face + corners + "3 0 1 2\n3 0 1\n", "truncated: the file ends in face 2 of 2");
  expect_refused("a.ply", face + "0 0 zero\n", "damaged: 'zero' is no number in vertex 1 of 3");
  expect_refused("a.ply", face + corners + "-3 0 1 2\n", "damaged: a list of -3 entries in face 1 of 2");
  expect_refused("a.ply", face + "0 0 nan\n2 0 0\n0 2 0\n3 0 1 2\n3 2 1 0\n",
                 "none of its 2 faces can be used: the one in face 1 has coordinates that are not finite");
  expect_refused("a.ply",
                 vertices + "element face 1\nproperty list uchar int corners\nend_header\n" + corners + "3 0 1 2\n",
                 "its faces have no list vertex_indices; they have corners");
  expect_refused("a.ply", "ply\nformat ascii 1.0\nelement vertex x\n", "'element vertex x'; expected an element");
  expect_refused("a.ply", "ply\nformat ascii 1.0\nproperties of nothing\nend_header\n",
                 "'properties of nothing' in its header");
  expect_refused("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n",
                 "unknown PLY type 'half'");
}

}  // namespace
}  // namespace brume
