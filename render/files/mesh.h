#pragma once
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "base/vec.h"

namespace brume {

/// Triangles in the renderer's world space, or in their own.
struct TriangleMesh {
  std::vector<dvec3> positions;
  std::vector<ivec3> triangles;    ///< indices into positions
  std::vector<vec2> texcoords;     ///< per vertex, or empty
  std::vector<vec3> normals;       ///< per vertex, unit, or empty: shading follows the triangles
  std::vector<std::string> notes;  ///< what was dropped on the way
  dmat4 motion{0};  ///< from where it is as the shutter opens to where it closes; all zero: it stands still

  bool moves() const { return motion != dmat4(0.0); }
  /// Where it is, relative to positions, at a time in [0, 1] of the shutter.
  dmat4 moved(double time) const { return dmat4(1.0) * (1.0 - time) + motion * time; }
  std::array<dvec3, 3> corners(size_t i) const {
    const ivec3& t = triangles[i];
    return {positions[t.x], positions[t.y], positions[t.z]};
  }
  /// Geometric, counter-clockwise corners seen from its tip; unit.
  dvec3 normal(size_t i) const {
    const auto [a, b, c] = corners(i);
    return glm::normalize(glm::cross(b - a, c - a));
  }
  double area(size_t i) const {
    const auto [a, b, c] = corners(i);
    return 0.5 * glm::length(glm::cross(b - a, c - a));
  }
};

/// Moves a mesh from its own space into the world; drops triangles that have no area or are not finite, vertices that
/// no triangle has and normals where one has no direction, and says so. Texture coordinates that are not finite become
/// 0. Indices that are out of range are refused.
/// @param name  how notes and errors call it   @param world_from_object  affine   @throws InputError
TriangleMesh place_mesh(TriangleMesh mesh, const std::string& name, const dmat4& world_from_object);

/// Tells a mesh's values from others: SurfaceSettings::mesh_content.
std::string content_of(const TriangleMesh& mesh);

/// A mesh in its own space, out of a file as load_mesh reads it. @throws InputError
TriangleMesh read_mesh(const std::filesystem::path& path);

/// Reads Wavefront OBJ (obj_file.h) or PLY (ply_file.h) and places it. Polygons of any shape are cut into triangles
/// (polygon.h); faces that cannot be used, degenerate triangles and whatever else was repaired are counted in notes.
/// Vertex normals are kept where every corner has one.
/// @param world_from_object  affine
/// @throws InputError: missing, another format, truncated, no face or no triangle left
TriangleMesh load_mesh(const std::filesystem::path& path, const dmat4& world_from_object);

}  // namespace brume
