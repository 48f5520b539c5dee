#include "render/world/surfaces.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/error.h"
#include "image/exr_io.h"
#include "image/picture_io.h"
#include "volume/placement.h"

namespace brume {

/// A picture wrapped around, bilinear, linear Rec. 709.
struct Surfaces::Texture {
  int width = 0, height = 0;
  std::vector<vec3> texels;

  explicit Texture(const std::filesystem::path& path) {
    const Layers picture = read_any_picture(path);
    width = picture.width(), height = picture.height();
    const auto rgb = picture.rgb(layer::beauty);
    texels.resize(static_cast<size_t>(width) * height);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        texels[static_cast<size_t>(y) * width + x] =
            glm::clamp(vec3((*rgb[0])(x, y), (*rgb[1])(x, y), (*rgb[2])(x, y)), 0.0f, 1.0f);
  }
  dvec3 lookup(const vec2& uv) const {
    const double x = wrap(uv.x) * width - 0.5, y = wrap(1.0 - uv.y) * height - 0.5;  // v points up
    const double fx = x - std::floor(x), fy = y - std::floor(y);
    const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
    const auto texel = [&](int tx, int ty) {
      return dvec3(texels[static_cast<size_t>((ty + height) % height) * width + (tx + width) % width]);
    };
    return (texel(x0, y0) * (1 - fx) + texel(x0 + 1, y0) * fx) * (1 - fy) +
           (texel(x0, y0 + 1) * (1 - fx) + texel(x0 + 1, y0 + 1) * fx) * fy;
  }

 private:
  static double wrap(double v) { return v - std::floor(v); }
};

struct Surfaces::Embree {
  RTCDevice device = rtcNewDevice("threads=1");
  RTCScene scene = rtcNewScene(device);
  Embree() { rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST); }
  ~Embree() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  Embree(const Embree&) = delete;
  Embree& operator=(const Embree&) = delete;
};

Surfaces::Surfaces(const std::vector<SurfaceSettings>& settings, const dvec3& world_shift)
    : settings_(settings), embree_(std::make_unique<Embree>()) {
  for (const SurfaceSettings& s : settings_) {
    check_transform(s.object_to_world, "a surface's object_to_world");
    any_straight_ = any_straight_ || s.shadow == "straight";
    meshes_.push_back(load_mesh(s.file, translation(-world_shift) * s.object_to_world));
    textures_.push_back(s.albedo_texture.empty() ? nullptr : std::make_unique<Texture>(s.albedo_texture));
    const TriangleMesh& mesh = meshes_.back();
    if (textures_.back() && mesh.texcoords.empty())
      throw InputError(
          fmt::format("{}: has no texture coordinates for {}", s.file.string(), s.albedo_texture.string()));
    RTCGeometry geometry = rtcNewGeometry(embree_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(vec3),
                                             mesh.positions.size());
    void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(ivec3),
                                            mesh.triangles.size());
    if (!vertices || !indices) throw std::bad_alloc();
    std::memcpy(vertices, mesh.positions.data(), mesh.positions.size() * sizeof(vec3));
    std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * sizeof(ivec3));
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(embree_->scene, geometry);
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(embree_->scene);
}

Surfaces::~Surfaces() = default;

namespace {

RTCRay embree_ray(const Ray& ray, double t_max) {
  RTCRay r{};
  r.org_x = static_cast<float>(ray.o.x), r.org_y = static_cast<float>(ray.o.y), r.org_z = static_cast<float>(ray.o.z);
  r.dir_x = static_cast<float>(ray.d.x), r.dir_y = static_cast<float>(ray.d.y), r.dir_z = static_cast<float>(ray.d.z);
  r.tnear = 0;
  r.tfar =
      t_max < std::numeric_limits<float>::max() ? static_cast<float>(t_max) : std::numeric_limits<float>::infinity();
  r.mask = ~0u;
  return r;
}

}  // namespace

std::optional<SurfaceHit> Surfaces::intersect(const Ray& ray, double t_max) const {
  RTCRayHit query{};
  query.ray = embree_ray(ray, t_max);
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(embree_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  SurfaceHit hit;
  hit.t = query.ray.tfar;
  hit.surface = query.hit.geomID;
  hit.triangle = query.hit.primID;
  const TriangleMesh& mesh = meshes_[hit.surface];
  hit.normal = hit.shading = mesh.normal(hit.triangle);
  const ivec3& t = mesh.triangles[hit.triangle];
  const auto between = [&](const auto& values) {
    const float u = query.hit.u, v = query.hit.v;
    return values[t.x] * (1 - u - v) + values[t.y] * u + values[t.z] * v;
  };
  if (!mesh.texcoords.empty()) hit.texcoord = between(mesh.texcoords);
  if (!mesh.normals.empty() && settings_[hit.surface].normals == "smooth") {
    const dvec3 smooth(between(mesh.normals));
    const double length = glm::length(smooth);
    // Normals of the file that point inwards are turned; where they cancel out, the triangle's own stands in.
    if (length > 1e-3) hit.shading = smooth / (glm::dot(smooth, hit.normal) < 0 ? -length : length);
  }
  return hit;
}

Surfaces::Passage Surfaces::passage(const Ray& ray, double t_max) const {
  if (!any_straight_) {
    RTCRay query = embree_ray(ray, t_max);
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(embree_->scene, &context, &query);
    return {dvec3(query.tfar < 0 ? 0.0 : 1.0)};
  }
  Passage passage;
  Ray rest = ray;
  while (const std::optional<SurfaceHit> hit = intersect(rest, t_max)) {
    if (settings_[hit->surface].shadow != "straight") return {dvec3(0)};
    // Unbent, so that both faces are met at the angle in the air.
    const Bsdf glass = bsdf(*hit);
    passage.light *= glass.albedo * (1 - fresnel_dielectric(std::abs(glm::dot(rest.d, hit->normal)), glass.ior));
    passage.straight = true;
    if (passage.light == dvec3(0)) return passage;
    rest.o = leave(rest.at(hit->t), hit->normal, rest.d);
    t_max -= hit->t;
  }
  return passage;
}

Bsdf Surfaces::bsdf(const SurfaceHit& hit) const {
  const SurfaceSettings& s = settings_[hit.surface];
  Bsdf bsdf;
  bsdf.kind = s.material == "conductor"    ? Bsdf::Kind::kConductor
              : s.material == "dielectric" ? Bsdf::Kind::kDielectric
                                           : Bsdf::Kind::kDiffuse;
  bsdf.albedo = s.albedo;
  if (textures_[hit.surface]) bsdf.albedo *= textures_[hit.surface]->lookup(hit.texcoord);
  bsdf.roughness = s.roughness;
  bsdf.ior = s.ior;
  return bsdf;
}

// Embree traces in single precision; the offset covers its rounding and that of the hit point.
dvec3 Surfaces::leave(const dvec3& p, const dvec3& normal, const dvec3& d) {
  const double size = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z), 1e-3});
  return p + normal * (glm::dot(normal, d) < 0 ? -1e-5 * size : 1e-5 * size);
}

size_t Surfaces::bytes() const {
  size_t sum = 0;
  for (const TriangleMesh& m : meshes_)
    sum += m.positions.size() * (sizeof(vec3) * 3 + sizeof(vec2)) + m.triangles.size() * (sizeof(ivec3) * 2 + 64);
  for (const auto& t : textures_)
    if (t) sum += t->texels.size() * sizeof(vec3);
  return sum;
}

std::vector<std::string> Surfaces::notes() const {
  std::vector<std::string> notes;
  for (const TriangleMesh& m : meshes_) notes.insert(notes.end(), m.notes.begin(), m.notes.end());
  return notes;
}

}  // namespace brume
