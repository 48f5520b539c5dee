#pragma once
#include <span>
#include <vector>

#include "base/vec.h"

namespace brume {

/// Triangles of a polygon, as places of their corners in it.
struct PolygonTriangles {
  std::vector<ivec3> triangles;  ///< turn the way the polygon does; none where it has no area
  bool crosses_itself = false;   ///< edges cross: the triangles overlap, or leave something out
};

/// Cuts a polygon into triangles that cover it once, by ear clipping in the plane that it lies in most. It may be
/// concave, have corners on straight edges, corners that coincide, and holes that are tied to its outline by an edge
/// there and back. One that is not flat is cut as its projection is. Convex polygons become a fan around their first
/// corner. O(n^2) for n corners at worst, n log n for most.
/// @param corners  three or more, finite
/// Source: Meisters 1975, Polygons Have Ears; the plane by Newell's method (Sutherland et al. 1974).
PolygonTriangles triangulate(std::span<const dvec3> corners);

}  // namespace brume
