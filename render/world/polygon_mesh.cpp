#include "render/world/polygon_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "render/world/polygon.h"

namespace brume {
namespace {

/// Things of one kind: how many, and where the first one was.
struct Count {
  size_t count = 0, first = 0;
  void add(size_t number) {
    if (count++ == 0) first = number;
  }
};

bool finite(const dvec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

bool in_range(int index, size_t count) {
  return index >= 0 && static_cast<size_t>(index) < count;
}

}  // namespace

void PolygonMesh::add_face(std::span<const Corner> corners, size_t number) {
  faces_.push_back({corners_.size(), corners.size(), number});
  corners_.insert(corners_.end(), corners.begin(), corners.end());
}

TriangleMesh PolygonMesh::triangles(const std::filesystem::path& path, const std::string& word) const {
  TriangleMesh mesh;
  Count few, missing, not_finite, crossing, bad_texcoords, bad_normals, without_normal;
  // Where corners name the same place in all lists, vertices are shared; otherwise each corner has its own.
  const bool textured = !texcoords.empty();
  bool smooth = !normals.empty(), shared = true;
  for (const Face& face : faces_)
    for (size_t k = 0; k < face.count; ++k) {
      const Corner& c = corners_[face.first + k];
      shared = shared && (!textured || c.texcoord == c.position) && (!smooth || c.normal == c.position);
      if (textured && c.texcoord != kNone && !in_range(c.texcoord, texcoords.size())) bad_texcoords.add(face.number);
      if (smooth && c.normal == kNone) without_normal.add(face.number);
      if (smooth && c.normal != kNone && !in_range(c.normal, normals.size())) bad_normals.add(face.number);
    }
  shared =
      shared && (!textured || texcoords.size() == positions.size()) && (!smooth || normals.size() == positions.size());
  smooth = smooth && without_normal.count == 0 && bad_normals.count == 0;
  if (shared) {
    mesh.positions = positions;
    mesh.texcoords = texcoords;
    if (smooth) mesh.normals = normals;
  }
  std::vector<dvec3> polygon;
  std::vector<int> vertices;
  std::string missing_one;
  for (const Face& face : faces_) {
    const std::span<const Corner> corners(corners_.data() + face.first, face.count);
    if (face.count < 3) {
      few.add(face.number);
      continue;
    }
    const auto absent = std::find_if(corners.begin(), corners.end(),
                                     [&](const Corner& c) { return !in_range(c.position, positions.size()); });
    if (absent != corners.end()) {
      if (missing.count == 0)
        missing_one = absent->position < 0 ? fmt::format("there are {}", positions.size())
                                           : fmt::format("{} of {}", absent->position + 1, positions.size());
      missing.add(face.number);
      continue;
    }
    polygon.clear();
    for (const Corner& c : corners) polygon.push_back(positions[static_cast<size_t>(c.position)]);
    if (!std::all_of(polygon.begin(), polygon.end(), finite)) {
      not_finite.add(face.number);
      continue;
    }
    vertices.clear();
    for (const Corner& c : corners) {
      vertices.push_back(shared ? c.position : static_cast<int>(mesh.positions.size()));
      if (shared) continue;
      mesh.positions.push_back(positions[static_cast<size_t>(c.position)]);
      if (textured)
        mesh.texcoords.push_back(in_range(c.texcoord, texcoords.size()) ? texcoords[static_cast<size_t>(c.texcoord)]
                                                                        : vec2(0));
      if (smooth) mesh.normals.push_back(normals[static_cast<size_t>(c.normal)]);
    }
    const PolygonTriangles cut = triangulate(polygon);
    if (cut.crosses_itself) crossing.add(face.number);
    for (const ivec3& t : cut.triangles)
      mesh.triangles.emplace_back(vertices[static_cast<size_t>(t.x)], vertices[static_cast<size_t>(t.y)],
                                  vertices[static_cast<size_t>(t.z)]);
  }

  const std::string name = path.string();
  const std::pair<const Count&, std::string> unusable[] = {
      {few, "fewer than three corners"},
      {missing, fmt::format("vertices that are not there ({})", missing_one)},
      {not_finite, "coordinates that are not finite"}};
  for (const auto& [count, what] : unusable) {
    if (count.count == 0) continue;
    if (mesh.triangles.empty())
      throw InputError(fmt::format("{}: none of its {} faces can be used: the one in {} {} has {}", name, faces_.size(),
                                   word, count.first, what));
    mesh.notes.push_back(fmt::format("{}: {} faces with {} were left out, the first in {} {}", name, count.count, what,
                                     word, count.first));
  }
  const auto note = [&](const Count& count, const char* what) {
    if (count.count)
      mesh.notes.push_back(fmt::format("{}: {} {}, the first in {} {}", name, count.count, what, word, count.first));
  };
  note(crossing, "polygons cross themselves: their triangles overlap or leave something out");
  note(bad_texcoords, "corners name texture coordinates that are not there: they have 0, 0");
  note(bad_normals, "corners name normals that are not there: it is shaded by its triangles");
  note(without_normal, "corners have no normal: it is shaded by its triangles");
  return mesh;
}

}  // namespace brume
