#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "render/files/mesh.h"

namespace brume {

/// What a mesh file says, before its polygons are cut into triangles.
class PolygonMesh {
 public:
  static constexpr int kNone = -1, kNowhere = -2;
  /// Places in the lists below; kNowhere or out of range for what a file names and has not.
  struct Corner {
    int position, texcoord = kNone, normal = kNone;
  };

  std::vector<dvec3> positions;
  std::vector<vec2> texcoords;
  std::vector<vec3> normals;

  /// @param number  where it stands in the file
  void add_face(std::span<const Corner> corners, size_t number);
  size_t faces() const { return faces_.size(); }

  /// Triangles of all faces that can be used; the others are counted in notes, as are polygons that cross themselves
  /// and corners whose texture coordinates or normals are not there. Normals are kept where every corner has one.
  /// @param word  what a face's number counts: "line", "face"
  /// @throws InputError when none of the faces can be used, saying why and where
  TriangleMesh triangles(const std::filesystem::path& path, const std::string& word) const;

 private:
  struct Face {
    size_t first, count;  // of its corners
    size_t number;        // as add_face has it
  };
  /// Whether vertices are those of the lists above; whether they have texture coordinates and normals.
  struct Vertices {
    bool shared, textured, smooth;
  };
  struct Flaws;

  std::span<const Corner> corners_of(const Face& face) const { return {corners_.data() + face.first, face.count}; }
  Vertices kind_of_vertices(Flaws& flaws) const;
  std::vector<dvec3> polygon(const Face& face, Flaws& flaws) const;

  std::vector<Corner> corners_;
  std::vector<Face> faces_;
};

}  // namespace brume
