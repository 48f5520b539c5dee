#include "render/files/polygon_mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "render/files/polygon.h"

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

struct PolygonMesh::Flaws {
  Count few, missing, not_finite;  // faces that cannot be used
  std::string missing_vertex;      // of the first of `missing`
  Count crossing, bad_texcoords, bad_normals, without_normal;

  /// @throws InputError when none of the faces could be used
  std::vector<std::string> notes(const std::string& file, const std::string& word, size_t faces, bool any) const {
    std::vector<std::string> all;
    const std::pair<const Count&, std::string> unusable[] = {
        {few, "fewer than three corners"},
        {missing, fmt::format("vertices that are not there ({})", missing_vertex)},
        {not_finite, "coordinates that are not finite"}};
    for (const auto& [count, what] : unusable) {
      if (count.count == 0) continue;
      if (!any)
        throw InputError(fmt::format("{}: none of its {} faces can be used: the one in {} {} has {}", file, faces, word,
                                     count.first, what));
      all.push_back(fmt::format("{}: {} faces with {} were left out, the first in {} {}", file, count.count, what, word,
                                count.first));
    }
    const auto note = [&](const Count& count, const char* what) {
      if (count.count)
        all.push_back(fmt::format("{}: {} {}, the first in {} {}", file, count.count, what, word, count.first));
    };
    note(crossing, "polygons cross themselves: their triangles overlap or leave something out");
    note(bad_texcoords, "corners name texture coordinates that are not there: they have 0, 0");
    note(bad_normals, "corners name normals that are not there: it is shaded by its triangles");
    note(without_normal, "corners have no normal: it is shaded by its triangles");
    return all;
  }
};

void PolygonMesh::add_face(std::span<const Corner> corners, size_t number) {
  faces_.push_back({corners_.size(), corners.size(), number});
  corners_.insert(corners_.end(), corners.begin(), corners.end());
}

/// Vertices are shared where corners name the same place in all lists; otherwise each corner has its own.
PolygonMesh::Vertices PolygonMesh::kind_of_vertices(Flaws& flaws) const {
  const bool textured = !texcoords.empty(), has_normals = !normals.empty();
  bool shared = true;
  for (const Face& face : faces_)
    for (const Corner& c : corners_of(face)) {
      shared = shared && (!textured || c.texcoord == c.position) && (!has_normals || c.normal == c.position);
      if (textured && c.texcoord != kNone && !in_range(c.texcoord, texcoords.size()))
        flaws.bad_texcoords.add(face.number);
      if (!has_normals) continue;
      if (c.normal == kNone)
        flaws.without_normal.add(face.number);
      else if (!in_range(c.normal, normals.size()))
        flaws.bad_normals.add(face.number);
    }
  shared = shared && (!textured || texcoords.size() == positions.size()) &&
           (!has_normals || normals.size() == positions.size());
  return {shared, textured, has_normals && flaws.without_normal.count == 0 && flaws.bad_normals.count == 0};
}

/// Where the corners of a face are; nothing where it cannot be used.
std::vector<dvec3> PolygonMesh::polygon(const Face& face, Flaws& flaws) const {
  if (face.count < 3) {
    flaws.few.add(face.number);
    return {};
  }
  std::vector<dvec3> polygon;
  for (const Corner& c : corners_of(face)) {
    if (in_range(c.position, positions.size())) {
      polygon.push_back(positions[static_cast<size_t>(c.position)]);
      continue;
    }
    if (flaws.missing.count == 0)
      flaws.missing_vertex = c.position < 0 ? fmt::format("there are {}", positions.size())
                                            : fmt::format("{} of {}", c.position + 1, positions.size());
    flaws.missing.add(face.number);
    return {};
  }
  if (std::all_of(polygon.begin(), polygon.end(), finite)) return polygon;
  flaws.not_finite.add(face.number);
  return {};
}

TriangleMesh PolygonMesh::triangles(const std::filesystem::path& path, const std::string& word) const {
  Flaws flaws;
  const auto [shared, textured, smooth] = kind_of_vertices(flaws);
  TriangleMesh mesh;
  if (shared) {
    mesh.positions = positions;
    mesh.texcoords = texcoords;
    if (smooth) mesh.normals = normals;
  }
  std::vector<int> vertices;
  for (const Face& face : faces_) {
    const std::vector<dvec3> corners = polygon(face, flaws);
    if (corners.empty()) continue;
    vertices.clear();
    for (const Corner& c : corners_of(face)) {
      vertices.push_back(shared ? c.position : static_cast<int>(mesh.positions.size()));
      if (shared) continue;
      mesh.positions.push_back(positions[static_cast<size_t>(c.position)]);
      if (textured)
        mesh.texcoords.push_back(in_range(c.texcoord, texcoords.size()) ? texcoords[static_cast<size_t>(c.texcoord)]
                                                                        : vec2(0));
      if (smooth) mesh.normals.push_back(normals[static_cast<size_t>(c.normal)]);
    }
    const PolygonTriangles cut = triangulate(corners);
    if (cut.crosses_itself) flaws.crossing.add(face.number);
    for (const ivec3& t : cut.triangles)
      mesh.triangles.emplace_back(vertices[static_cast<size_t>(t.x)], vertices[static_cast<size_t>(t.y)],
                                  vertices[static_cast<size_t>(t.z)]);
  }
  mesh.notes = flaws.notes(path.string(), word, faces_.size(), !mesh.triangles.empty());
  return mesh;
}

}  // namespace brume
