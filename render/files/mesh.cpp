#include "render/files/mesh.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <span>
#include <string_view>

#include "base/error.h"
#include "base/missing_file.h"
#include "base/rng.h"
#include "render/files/obj_file.h"
#include "render/files/ply_file.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw InputError(fmt::format("{}: {}", path.string(), what));
}

/// Leaves out vertices that no triangle has: those of faces that were left out may be no numbers.
void drop_unused_vertices(TriangleMesh& mesh) {
  std::vector<int> place(mesh.positions.size(), -1);
  for (const ivec3& t : mesh.triangles)
    for (int k = 0; k < 3; ++k) place[static_cast<size_t>(t[k])] = 0;
  int count = 0;
  for (int& p : place)
    if (p == 0) p = count++;
  if (static_cast<size_t>(count) == place.size()) return;
  const auto compact = [&](auto& values) {
    if (values.empty()) return;
    for (size_t i = 0; i < place.size(); ++i)
      if (place[i] >= 0) values[static_cast<size_t>(place[i])] = values[i];
    values.resize(static_cast<size_t>(count));
  };
  compact(mesh.positions);
  compact(mesh.texcoords);
  compact(mesh.normals);
  for (ivec3& t : mesh.triangles)
    for (int k = 0; k < 3; ++k) t[k] = place[static_cast<size_t>(t[k])];
}

}  // namespace

TriangleMesh place_mesh(TriangleMesh mesh, const std::string& name, const dmat4& world_from_object) {
  for (dvec3& p : mesh.positions) p = dvec3(world_from_object * glm::dvec4(p, 1.0));
  const auto count = static_cast<int>(mesh.positions.size());
  size_t degenerate = 0, broken = 0;
  std::vector<ivec3> kept;
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const ivec3& t = mesh.triangles[i];
    if (std::min({t.x, t.y, t.z}) < 0 || std::max({t.x, t.y, t.z}) >= count)
      fail(name, fmt::format("face {} names a vertex that is not there; there are {}", i, count));
    const double area = mesh.area(i);
    if (!std::isfinite(area))
      ++broken;
    else if (!(area > 0))
      ++degenerate;
    else
      kept.push_back(t);
  }
  mesh.triangles = std::move(kept);
  if (broken) mesh.notes.push_back(fmt::format("{}: {} triangles that are not finite were dropped", name, broken));
  if (degenerate) mesh.notes.push_back(fmt::format("{}: {} degenerate triangles were dropped", name, degenerate));
  if (mesh.triangles.empty()) fail(name, "holds no triangle with an area");
  drop_unused_vertices(mesh);
  const dmat3 normal_to_world = glm::transpose(glm::inverse(dmat3(world_from_object)));
  bool usable = true;
  for (vec3& n : mesh.normals) {
    const dvec3 turned = normal_to_world * dvec3(n);
    const double length = glm::length(turned);
    usable = usable && length > 0 && std::isfinite(length);
    n = vec3(turned / length);
  }
  if (!usable) {
    mesh.normals.clear();
    mesh.notes.push_back(fmt::format("{}: has normals without a direction: shaded by its triangles", name));
  }
  size_t nowhere = 0;
  for (vec2& uv : mesh.texcoords) {
    if (std::isfinite(uv.x) && std::isfinite(uv.y)) continue;
    ++nowhere;
    uv = vec2(0);
  }
  if (nowhere)
    mesh.notes.push_back(
        fmt::format("{}: texture coordinates of {} vertices that are not finite became 0, 0", name, nowhere));
  // A mirroring transform turns triangles inside out; their outside is kept where it was.
  if (glm::determinant(dmat3(world_from_object)) < 0)
    for (ivec3& t : mesh.triangles) std::swap(t.y, t.z);
  return mesh;
}

std::string content_of(const TriangleMesh& mesh) {
  uint64_t hash = 0;
  const auto add = [&](const auto& values) {
    hash = hash_combine(hash, values.size());
    const auto bytes = std::as_bytes(std::span(values));
    for (size_t i = 0; i + 4 <= bytes.size(); i += 4) {
      uint32_t word;
      std::memcpy(&word, bytes.data() + i, 4);
      hash = hash_combine(hash, word);
    }
  };
  add(mesh.positions);
  add(mesh.triangles);
  add(mesh.texcoords);
  add(mesh.normals);
  return fmt::format("{:016x}", hash);
}

TriangleMesh read_mesh(const fs::path& path) try {
  std::error_code error;
  check_exists(path);
  if (fs::is_directory(path, error)) fail(path, "is a folder, expected a mesh (OBJ or PLY)");
  char magic[4] = {};
  std::ifstream(path, std::ios::binary).read(magic, 3);
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (std::string_view(magic) == "ply") return read_ply(path);
  if (extension == ".obj") return read_obj(path);
  fail(path, "is neither PLY (by its first bytes) nor OBJ (by its name)");
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

TriangleMesh load_mesh(const fs::path& path, const dmat4& world_from_object) try {
  return place_mesh(read_mesh(path), path.string(), world_from_object);
} catch (const std::bad_alloc& error) {
  fail_reading(path.string(), error);
}

}  // namespace brume
