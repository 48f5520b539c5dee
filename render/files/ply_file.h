#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "render/files/mesh.h"

namespace brume {

/// Reads the polygons of a PLY: ASCII, binary of either byte order. Of vertices x, y, z, normals (nx, ny, nz) and
/// texture coordinates (u, v; s, t; texture_u, texture_v) are taken, of faces vertex_indices or vertex_index and, where
/// vertices have none, texture coordinates of their corners (texcoord); of tristrips the triangles. Properties may have
/// any type and order; others, and other elements, are passed over.
/// @throws InputError: another format, a header that cannot be read, truncated (says where), no faces, none of use
///         (PolygonMesh)
/// Source: Turk, The PLY Polygon File Format.
TriangleMesh read_ply(const std::filesystem::path& path);

/// The vertices of a PLY, whatever they hold beside lists.
struct PlyPoints {
  std::vector<std::string> names;  ///< of their properties
  std::vector<double> values;      ///< of one vertex after the other
};
/// @throws InputError: as read_ply; no vertices, or more than `most`
PlyPoints read_ply_points(const std::filesystem::path& path, size_t most);

}  // namespace brume
