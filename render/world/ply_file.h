#pragma once
#include <filesystem>

#include "render/world/mesh.h"

namespace brume {

/// Reads the polygons of a PLY: ASCII, binary of either byte order. Of vertices x, y, z, normals (nx, ny, nz) and
/// texture coordinates (u, v; s, t; texture_u, texture_v) are taken, of faces vertex_indices or vertex_index and, where
/// vertices have none, texture coordinates of their corners (texcoord); of tristrips the triangles. Properties may have
/// any type and order; others, and other elements, are passed over.
/// @throws InputError: another format, a header that cannot be read, truncated (says where), no faces, none of use
///         (PolygonMesh)
/// Source: Turk, The PLY Polygon File Format.
TriangleMesh read_ply(const std::filesystem::path& path);

}  // namespace brume
