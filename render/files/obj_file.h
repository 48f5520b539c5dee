#pragma once
#include <filesystem>

#include "render/files/mesh.h"

namespace brume {

/// Reads the polygons of a Wavefront OBJ: `v`, `vt`, `vn` and `f`. Groups, materials, lines, points and free-form
/// surfaces are passed over. Lines may end in \n, \r\n or \r and go on after a backslash; a comment may follow
/// anything; corners may name any of v, v/t, v//n, v/t/n, with parts left empty, counted from the end where negative.
/// @throws InputError: a line that cannot be read (says which), no faces, none of use (PolygonMesh)
/// Source: Wavefront, Object Files (.obj), appendix B1 of the Advanced Visualizer's manual.
TriangleMesh read_obj(const std::filesystem::path& path);

}  // namespace brume
