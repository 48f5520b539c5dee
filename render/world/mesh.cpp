#include "render/world/mesh.h"

#include <fmt/format.h>
#include <tiny_obj_loader.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <span>
#include <sstream>
#include <string_view>

#include "base/error.h"
#include "base/rng.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw InputError(fmt::format("{}: {}", path.string(), what));
}

void add_fan(TriangleMesh& mesh, const std::vector<int>& corners) {
  for (size_t i = 2; i < corners.size(); ++i) mesh.triangles.emplace_back(corners[0], corners[i - 1], corners[i]);
}

TriangleMesh read_obj(const fs::path& path) {
  tinyobj::ObjReaderConfig config;
  config.triangulate = false;
  tinyobj::ObjReader reader;
  if (!reader.ParseFromFile(path.string(), config))
    fail(path, fmt::format("not a readable OBJ file: {}", reader.Error().empty() ? "no geometry" : reader.Error()));
  const tinyobj::attrib_t& attributes = reader.GetAttrib();
  TriangleMesh mesh;
  const size_t count = attributes.vertices.size() / 3, texcoords = attributes.texcoords.size() / 2,
               normals = attributes.normals.size() / 3;
  const bool textured = texcoords > 0;
  bool smooth = normals > 0;
  const bool apart = textured || smooth;
  const auto position = [&](size_t i) {
    return dvec3(attributes.vertices[3 * i], attributes.vertices[3 * i + 1], attributes.vertices[3 * i + 2]);
  };
  if (!apart)
    for (size_t i = 0; i < count; ++i) mesh.positions.push_back(position(i));
  for (const tinyobj::shape_t& shape : reader.GetShapes()) {
    size_t at = 0;
    for (const auto sides : shape.mesh.num_face_vertices) {
      std::vector<int> corners;
      for (size_t k = 0; k < static_cast<size_t>(sides); ++k) {
        const tinyobj::index_t& index = shape.mesh.indices[at++];
        if (index.vertex_index < 0 || static_cast<size_t>(index.vertex_index) >= count)
          fail(path, fmt::format("a face names vertex {} of {}", index.vertex_index + 1, count));
        if (!apart) {
          corners.push_back(index.vertex_index);
          continue;
        }
        // One vertex per corner: positions, texture coordinates and normals are numbered apart in this format.
        corners.push_back(static_cast<int>(mesh.positions.size()));
        mesh.positions.push_back(position(static_cast<size_t>(index.vertex_index)));
        const auto n = static_cast<size_t>(index.normal_index);
        smooth = smooth && index.normal_index >= 0 && n < normals;
        if (smooth)
          mesh.normals.emplace_back(attributes.normals[3 * n], attributes.normals[3 * n + 1],
                                    attributes.normals[3 * n + 2]);
        if (!textured) continue;
        const auto t = static_cast<size_t>(index.texcoord_index);
        const bool has = index.texcoord_index >= 0 && t < texcoords;
        mesh.texcoords.emplace_back(has ? vec2(attributes.texcoords[2 * t], attributes.texcoords[2 * t + 1]) : vec2(0));
      }
      add_fan(mesh, corners);
    }
  }
  if (!smooth) mesh.normals.clear();
  return mesh;
}

/// The parts of a PLY header that say how to find vertices and faces.
struct PlyElement {
  struct Property {
    std::string name, type, count_type;  // a list where count_type is set
  };
  std::string name;
  size_t count = 0;
  std::vector<Property> properties;
};

class PlyReader {
 public:
  explicit PlyReader(const fs::path& path) : path_(path), stream_(path, std::ios::binary) {}

  TriangleMesh read() {
    read_header();
    TriangleMesh mesh;
    for (const PlyElement& element : elements_) {
      const int axes[8] = {find(element, {"x"}),
                           find(element, {"y"}),
                           find(element, {"z"}),
                           find(element, {"u", "s", "texture_u"}),
                           find(element, {"v", "t", "texture_v"}),
                           find(element, {"nx"}),
                           find(element, {"ny"}),
                           find(element, {"nz"})};
      if (element.name == "vertex" && (axes[0] < 0 || axes[1] < 0 || axes[2] < 0))
        fail(path_, "its vertices have no x, y, z");
      for (size_t i = 0; i < element.count; ++i) {
        std::vector<double> values(element.properties.size());
        std::vector<int> corners;
        for (size_t p = 0; p < element.properties.size(); ++p) {
          const auto& property = element.properties[p];
          if (property.count_type.empty()) {
            values[p] = number(property.type);
            continue;
          }
          const double count = number(property.count_type);
          if (!(count >= 0 && count < 1e6)) fail(path_, fmt::format("a list of {} entries", count));
          const bool face = property.name == "vertex_indices" || property.name == "vertex_index";
          for (int k = 0; k < static_cast<int>(count); ++k) {
            const double index = number(property.type);
            if (face) corners.push_back(index >= 0 && index < 2e9 ? static_cast<int>(index) : -1);
          }
        }
        if (element.name == "vertex") {
          const auto value = [&](int which) { return static_cast<float>(values[static_cast<size_t>(axes[which])]); };
          const auto coordinate = [&](int which) { return values[static_cast<size_t>(axes[which])]; };
          mesh.positions.emplace_back(coordinate(0), coordinate(1), coordinate(2));
          if (axes[3] >= 0 && axes[4] >= 0) mesh.texcoords.emplace_back(value(3), value(4));
          if (axes[5] >= 0 && axes[6] >= 0 && axes[7] >= 0) mesh.normals.emplace_back(value(5), value(6), value(7));
        } else if (element.name == "face") {
          add_fan(mesh, corners);
        }
      }
    }
    return mesh;
  }

 private:
  void read_header() {
    std::string line, word;
    std::getline(stream_, line);
    while (std::getline(stream_, line)) {
      if (!line.empty() && line.back() == '\r') line.pop_back();
      std::istringstream words(line);
      words >> word;
      if (word == "end_header") {
        for (const PlyElement& element : elements_)
          if (element.count > 0 && element.properties.empty())
            fail(path_, fmt::format("element '{}' has no properties; expected at least one", element.name));
        return;
      }
      if (word == "format") {
        words >> word;
        if (word != "ascii" && word != "binary_little_endian")
          fail(path_, fmt::format("PLY format '{}'; expected ascii or binary_little_endian", word));
        ascii_ = word == "ascii";
      } else if (word == "element") {
        PlyElement element;
        words >> element.name >> element.count;
        elements_.push_back(element);
      } else if (word == "property") {
        if (elements_.empty()) fail(path_, "a property before any element");
        PlyElement::Property property;
        words >> property.type;
        if (property.type == "list") words >> property.count_type >> property.type;
        words >> property.name;
        elements_.back().properties.push_back(property);
      }
    }
    fail(path_, "truncated: the PLY header has no end");
  }
  static int find(const PlyElement& element, std::initializer_list<const char*> names) {
    for (size_t i = 0; i < element.properties.size(); ++i)
      for (const char* name : names)
        if (element.properties[i].name == name) return static_cast<int>(i);
    return -1;
  }
  template <class T>
  double binary() {
    T value{};
    if (!stream_.read(reinterpret_cast<char*>(&value), sizeof value))
      fail(path_, "truncated: the file ends in its data");
    return static_cast<double>(value);
  }
  double number(const std::string& type) {
    if (ascii_) {
      double value;
      if (!(stream_ >> value)) fail(path_, "truncated or damaged: a number is missing");
      return value;
    }
    if (type == "float" || type == "float32") return binary<float>();
    if (type == "double" || type == "float64") return binary<double>();
    if (type == "uchar" || type == "uint8") return binary<uint8_t>();
    if (type == "char" || type == "int8") return binary<int8_t>();
    if (type == "ushort" || type == "uint16") return binary<uint16_t>();
    if (type == "short" || type == "int16") return binary<int16_t>();
    if (type == "uint" || type == "uint32") return binary<uint32_t>();
    if (type == "int" || type == "int32") return binary<int32_t>();
    fail(path_, fmt::format("unknown PLY type '{}'", type));
  }

  fs::path path_;
  std::ifstream stream_;
  bool ascii_ = true;
  std::vector<PlyElement> elements_;
};

}  // namespace

TriangleMesh place_mesh(TriangleMesh mesh, const std::string& name, const dmat4& world_from_object) {
  for (dvec3& p : mesh.positions) p = dvec3(world_from_object * glm::dvec4(p, 1.0));
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
  if (!fs::exists(path, error)) fail(path, "no such file");
  if (fs::is_directory(path, error)) fail(path, "is a folder, expected a mesh (OBJ or PLY)");
  char magic[4] = {};
  std::ifstream(path, std::ios::binary).read(magic, 3);
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(), [](char c) { return std::tolower(c); });
  if (std::string_view(magic) == "ply") return PlyReader(path).read();
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
