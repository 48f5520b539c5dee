#include "render/world/surfaces.h"

#if BRUME_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "base/error.h"
#include "base/parallel_for.h"
#include "base/rng.h"
#include "image/picture_io.h"
#include "volume/placement.h"

namespace brume {

/// A picture wrapped around, bilinear, in the scene's space.
struct Surfaces::Texture {
  int width = 0, height = 0;
  std::vector<vec3> texels;

  /// @param notes  what had to be done to it is added there
  Texture(const std::filesystem::path& path, const WorkingSpace& space, std::vector<std::string>& notes) {
    UsablePicture picture = read_usable_picture(path, space);
    width = picture.layers.width();
    height = picture.layers.height();
    const auto rgb = picture.layers.rgb(layer::beauty);
    texels.resize(static_cast<size_t>(width) * height);
    size_t above = 0;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int c = 0; c < 3; ++c) {
          const float v = (*rgb[static_cast<size_t>(c)])(x, y);
          // No surface reflects more than it gets; what a conversion of colours rounded up is not counted.
          above += v > 1.0f + 1e-5f;
          texels[static_cast<size_t>(y) * width + x][c] = std::min(v, 1.0f);
        }
    notes.insert(notes.end(), picture.notes.begin(), picture.notes.end());
    if (above) notes.push_back(fmt::format("{}: {} values above 1 became 1, as an albedo is", path.string(), above));
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

/// What a surface lets pass: camera rays, where these do not see it, and the share of rays that its alpha says. And
/// what it emits.
struct Surfaces::Cutout {
  const TriangleMesh* mesh;
  std::unique_ptr<Texture> texture;  ///< null: alpha alone
  std::unique_ptr<Texture> glow;     ///< of what it emits; null: the same everywhere
  double alpha = 1;
  bool seen = true;

  bool any_alpha() const { return alpha < 1 || texture; }
  /// At a point of a triangle. @param u, v  shares of its second and third corner
  double at(uint32_t triangle, float u, float v) const {
    return texture ? alpha * texture->lookup(texcoord(triangle, u, v)).x : alpha;
  }
  vec2 texcoord(uint32_t triangle, double u, double v) const {
    const ivec3& t = mesh->triangles[triangle];
    const std::vector<vec2>& uv = mesh->texcoords;
    return vec2(dvec2(uv[t.x]) * (1 - u - v) + dvec2(uv[t.y]) * u + dvec2(uv[t.z]) * v);
  }
};

namespace {

/// A number in [0, 1) for a ray and a triangle, as good as random: whether the ray meets the triangle does not depend
/// on who asks, nor on what was drawn before.
double chance_of(const RTCRay& ray, unsigned surface, unsigned triangle) {
  uint64_t hash = hash_combine(surface, triangle);
  for (const float x : {ray.org_x, ray.org_y, ray.org_z, ray.dir_x, ray.dir_y, ray.dir_z, ray.time})
    hash = hash_combine(hash, std::bit_cast<uint32_t>(x));
  return static_cast<double>(hash >> 11u) * 0x1p-53;
}

}  // namespace

struct Surfaces::Embree {
  // One instruction set for all machines: their roundings differ. No file of the user's may choose another. Embree
  // limits the whole program's TBB to so many threads: more than any machine has are no limit.
  RTCDevice device = rtcNewDevice("ignore_config_files=1,isa=sse2,threads=4096");
  RTCScene scene = rtcNewScene(device);
  Embree() { rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST); }
  ~Embree() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  Embree(const Embree&) = delete;
  Embree& operator=(const Embree&) = delete;

  /// What filter functions are told of one query.
  struct Context {
#if BRUME_EMBREE_MAJOR >= 4
    RTCRayQueryContext base;
#else
    RTCIntersectContext base;
#endif
    bool camera;
    double light = 1;  ///< what cut-outs leave of it
  };

  /// @param camera  whether it is a camera ray
  void intersect(RTCRayHit& ray, bool camera) const {
    Context context{{}, camera, 1};
#if BRUME_EMBREE_MAJOR >= 4
    rtcInitRayQueryContext(&context.base);
    RTCIntersectArguments arguments;
    rtcInitIntersectArguments(&arguments);
    arguments.context = &context.base;
    rtcIntersect1(scene, &ray, &arguments);
#else
    rtcInitIntersectContext(&context.base);
    rtcIntersect1(scene, &context.base, &ray);
#endif
  }

  /// The share of a ray's light, which is no camera ray, that gets through.
  double passage(RTCRay& ray) const {
    Context context{{}, false, 1};
#if BRUME_EMBREE_MAJOR >= 4
    rtcInitRayQueryContext(&context.base);
    RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.context = &context.base;
    rtcOccluded1(scene, &ray, &arguments);
#else
    rtcInitIntersectContext(&context.base);
    rtcOccluded1(scene, &context.base, &ray);
#endif
    return ray.tfar < 0 ? 0.0 : context.light;
  }

  /// @param cutout  outlives this
  /// @param to_box  from the world to what Embree sees
  template <class ToBox>
  void add(const TriangleMesh& mesh, Cutout& cutout, const ToBox& to_box) {
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    const unsigned times = mesh.moves() ? 2 : 1;
    rtcSetGeometryTimeStepCount(geometry, times);
    for (unsigned k = 0; k < times; ++k) {
      auto* const vertices = static_cast<vec3*>(rtcSetNewGeometryBuffer(
          geometry, RTC_BUFFER_TYPE_VERTEX, k, RTC_FORMAT_FLOAT3, sizeof(vec3), mesh.positions.size()));
      if (!vertices) throw std::bad_alloc();
      const dmat4 moved = k == 0 ? dmat4(1.0) : mesh.motion;
      std::transform(mesh.positions.begin(), mesh.positions.end(), vertices,
                     [&](const dvec3& p) { return vec3(to_box(dvec3(moved * glm::dvec4(p, 1.0)))); });
    }
    void* const indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof(ivec3),
                                                  mesh.triangles.size());
    if (!indices) throw std::bad_alloc();
    std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * sizeof(ivec3));
    rtcSetGeometryUserData(geometry, &cutout);
    if (!cutout.seen || cutout.any_alpha())
      rtcSetGeometryIntersectFilterFunction(geometry, [](const RTCFilterFunctionNArguments* query) {
        const auto& own = *static_cast<const Cutout*>(query->geometryUserPtr);
        if (!own.seen && reinterpret_cast<const Context*>(query->context)->camera) query->valid[0] = 0;
        if (!own.any_alpha()) return;
        const auto& ray = *reinterpret_cast<const RTCRay*>(query->ray);
        const auto& hit = *reinterpret_cast<const RTCHit*>(query->hit);
        const double alpha = own.at(hit.primID, hit.u, hit.v);
        if (alpha < 1 && !(chance_of(ray, hit.geomID, hit.primID) < alpha)) query->valid[0] = 0;
      });
    if (cutout.any_alpha())
      rtcSetGeometryOccludedFilterFunction(geometry, [](const RTCFilterFunctionNArguments* query) {
        const auto& hit = *reinterpret_cast<const RTCHit*>(query->hit);
        double& light = reinterpret_cast<Context*>(query->context)->light;
        light *= 1 - static_cast<const Cutout*>(query->geometryUserPtr)->at(hit.primID, hit.u, hit.v);
        if (light > 0) query->valid[0] = 0;
      });
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
  }
};

struct Surfaces::Query {
  RTCRay ray;
  double begin;  // of the ray in the box, in its units
};

Surfaces::Surfaces(const std::vector<SurfaceSettings>& settings, const dvec3& world_shift, bool blurred,
                   const WorkingSpace& space)
    : settings_(settings), embree_(std::make_unique<Embree>()) {
  dvec3 lo(std::numeric_limits<double>::infinity()), hi = -lo;
  meshes_.reserve(settings_.size());  // cut-outs point at them
  for (const SurfaceSettings& s : settings_) {
    add_mesh(s, world_shift, blurred, space);
    const TriangleMesh& mesh = meshes_.back();
    for (const dmat4& moved : {dmat4(1.0), mesh.motion}) {
      if (moved == dmat4(0.0)) continue;
      for (const ivec3& triangle : mesh.triangles)
        for (int k = 0; k < 3; ++k) {
          const dvec3 p(moved * glm::dvec4(mesh.positions[triangle[k]], 1.0));
          lo = glm::min(lo, p);
          hi = glm::max(hi, p);
        }
    }
  }
  centre_ = 0.5 * (lo + hi);
  const double extent = max_component(0.5 * (hi - lo));
  scale_ = std::exp2(-std::ceil(std::log2(extent)));
  half_ = 0.5 * (hi - lo) * scale_;
  for (size_t i = 0; i < meshes_.size(); ++i)
    embree_->add(meshes_[i], *cutouts_[i], [&](const dvec3& p) { return (p - centre_) * scale_; });
  // The same tree for any number of threads.
  run_on_threads(1, [&] { rtcCommitScene(embree_->scene); });
}

void Surfaces::add_mesh(const SurfaceSettings& s, const dvec3& world_shift, bool blurred, const WorkingSpace& space) {
  check_transform(s.object_to_world, "a surface's object_to_world");
  any_straight_ = any_straight_ || s.shadow == "straight";
  bsdfs_.push_back({s.material == "conductor"    ? Bsdf::Kind::kConductor
                    : s.material == "dielectric" ? Bsdf::Kind::kDielectric
                    : s.material == "coated"     ? Bsdf::Kind::kCoated
                                                 : Bsdf::Kind::kDiffuse,
                    s.albedo, s.roughness, s.ior, s.material == "conductor" ? s.edge_albedo : s.reflection_tint});
  if (Bsdf& bsdf = bsdfs_.back(); bsdf.kind == Bsdf::Kind::kCoated) {
    const auto [known, fresh] = coats_.try_emplace({bsdf.alpha(), bsdf.ior}, nullptr);
    if (fresh) known->second = std::make_unique<CoatAlbedo>(bsdf.alpha(), bsdf.ior);
    bsdf.coat = known->second.get();
  }
  const dmat4 opens = translation(-world_shift) * s.object_to_world;
  const std::string name = s.file.empty() ? fmt::format("surfaces.{}", meshes_.size()) : s.file.string();
  meshes_.push_back(s.mesh ? place_mesh(*s.mesh, name, opens) : load_mesh(s.file, opens));
  TriangleMesh& mesh = meshes_.back();
  if (blurred && s.object_to_world_end != dmat4(0.0)) {
    check_transform(s.object_to_world_end, "a surface's object_to_world_end");
    mesh.motion = translation(-world_shift) * s.object_to_world_end * glm::inverse(opens);
    if (glm::determinant(dmat3(mesh.motion)) < 0)
      throw InputError(fmt::format("{}: object_to_world_end turns it inside out; expected a motion", name));
  }
  textures_.push_back(s.albedo_texture.empty() ? nullptr
                                               : std::make_unique<Texture>(s.albedo_texture, space, mesh.notes));
  if (textures_.back() && mesh.texcoords.empty())
    throw InputError(fmt::format("{}: has no texture coordinates for {}", name, s.albedo_texture.string()));
  bsdfs_.back().passed = s.translucence;
  cutouts_.push_back(std::make_unique<Cutout>(Cutout{&mesh, nullptr, nullptr, s.alpha, s.visible_to_camera}));
  Cutout& own = *cutouts_.back();
  for (const auto& [path, texture] : {std::pair(&s.alpha_texture, &own.texture), {&s.radiance_texture, &own.glow}}) {
    if (path->empty()) continue;
    if (mesh.texcoords.empty())
      throw InputError(fmt::format("{}: has no texture coordinates for {}", name, path->string()));
    *texture = std::make_unique<Texture>(*path, texture == &own.glow ? space : WorkingSpace(), mesh.notes);
  }
}

Surfaces::~Surfaces() = default;

std::optional<Surfaces::Query> Surfaces::query(const Ray& ray, double t_max, double time) const {
  constexpr double kRoom = 1e-5;  // around the box, for its rounding and the rays'
  const dvec3 o = (ray.o - centre_) * scale_;
  double begin = 0, end = t_max * scale_;
  for (int a = 0; a < 3; ++a) {
    const double wall = half_[a] + kRoom;
    if (ray.d[a] == 0) {
      if (std::abs(o[a]) > wall) return std::nullopt;
      continue;
    }
    const double ta = (-wall - o[a]) / ray.d[a], tb = (wall - o[a]) / ray.d[a];
    begin = std::max(begin, std::min(ta, tb));
    end = std::min(end, std::max(ta, tb));
  }
  if (!(begin < end)) return std::nullopt;
  const vec3 from(o + begin * ray.d), d(ray.d);
  Query q{{}, begin};
  q.ray.org_x = from.x;
  q.ray.org_y = from.y;
  q.ray.org_z = from.z;
  q.ray.dir_x = d.x;
  q.ray.dir_y = d.y;
  q.ray.dir_z = d.z;
  q.ray.tnear = 0;
  q.ray.tfar = static_cast<float>(end - begin);
  q.ray.time = static_cast<float>(time);
  q.ray.mask = ~0u;
  return q;
}

std::optional<SurfaceHit> Surfaces::intersect(const Ray& ray, double t_max, double time, bool camera) const {
  const std::optional<Query> q = query(ray, t_max, time);
  if (!q) return std::nullopt;
  RTCRayHit found{};
  found.ray = q->ray;
  found.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  embree_->intersect(found, camera);
  if (found.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  SurfaceHit hit;
  hit.surface = found.hit.geomID;
  hit.triangle = found.hit.primID;
  const TriangleMesh& mesh = meshes_[hit.surface];
  std::array<dvec3, 3> corners = mesh.corners(hit.triangle);
  const dmat4 moved = mesh.moves() ? mesh.moved(time) : dmat4(1.0);
  if (mesh.moves())
    for (dvec3& corner : corners) corner = dvec3(moved * glm::dvec4(corner, 1.0));
  const auto [a, b, c] = corners;
  const dvec3 cross = glm::cross(b - a, c - a);
  hit.normal = hit.shading = glm::normalize(cross);
  // Where the ray meets the triangle's plane. Along the plane that says nothing, and Embree's answer stands.
  const double rough = (q->begin + static_cast<double>(found.ray.tfar)) / scale_;
  const double exact = glm::dot(a - ray.o, cross) / glm::dot(ray.d, cross);
  hit.t = std::abs(exact - rough) * scale_ < 1e-4 && exact > 0 ? exact : rough;
  // Embree's roundings of the triangle, relative to it: eight units in the last place of its largest coordinate.
  const auto largest = [&](const dvec3& p) { return max_component(glm::abs(p - centre_)); };
  hit.margin = std::max({largest(a), largest(b), largest(c)}) * 0x1p-21;
  const ivec3& t = mesh.triangles[hit.triangle];
  if (mesh.texcoords.empty() && mesh.normals.empty()) return hit;
  const dvec3 p = ray.at(hit.t);
  const double area2 = glm::dot(cross, cross);
  const auto u = static_cast<float>(glm::dot(glm::cross(p - a, c - a), cross) / area2);
  const auto v = static_cast<float>(glm::dot(glm::cross(b - a, p - a), cross) / area2);
  const auto between = [&](const auto& values) {
    return values[t.x] * (1 - u - v) + values[t.y] * u + values[t.z] * v;
  };
  if (!mesh.texcoords.empty()) hit.texcoord = between(mesh.texcoords);
  if (!mesh.normals.empty() && settings_[hit.surface].normals == "smooth") {
    const dmat3 turned = mesh.moves() ? glm::transpose(glm::inverse(dmat3(moved))) : dmat3(1.0);
    const auto normal = [&](int vertex) {
      const dvec3 n(mesh.normals[vertex]);
      return mesh.moves() ? glm::normalize(turned * n) : n;
    };
    const dvec3 smooth =
        normal(t.x) * (1.0 - u - v) + normal(t.y) * static_cast<double>(u) + normal(t.z) * static_cast<double>(v);
    const double length = glm::length(smooth);
    // Normals of the file that point inwards are turned; where they cancel out, the triangle's own stands in.
    if (length > 1e-3) hit.shading = smooth / (glm::dot(smooth, hit.normal) < 0 ? -length : length);
  }
  return hit;
}

Surfaces::Passage Surfaces::passage(const Ray& ray, double t_max, double time) const {
  if (!any_straight_) {
    std::optional<Query> q = query(ray, t_max, time);
    if (!q) return {};
    return {dvec3(embree_->passage(q->ray))};
  }
  Passage passage;
  Ray rest = ray;
  while (const std::optional<SurfaceHit> hit = intersect(rest, t_max, time)) {
    if (settings_[hit->surface].shadow != "straight") return {dvec3(0)};
    // Unbent, so that both faces are met at the angle in the air.
    const Bsdf glass = bsdf(*hit);
    passage.light *= glass.albedo * (1 - fresnel_dielectric(std::abs(glm::dot(rest.d, hit->normal)), glass.ior));
    passage.straight = true;
    if (passage.light == dvec3(0)) return passage;
    rest.o = leave(*hit, rest.at(hit->t), rest.d);
    t_max -= hit->t;
  }
  return passage;
}

Bsdf Surfaces::bsdf(const SurfaceHit& hit) const {
  Bsdf bsdf = bsdfs_[hit.surface];
  if (!textures_[hit.surface]) return bsdf;
  const dvec3 colour = textures_[hit.surface]->lookup(hit.texcoord);
  bsdf.albedo *= colour;
  bsdf.passed *= colour;
  return bsdf;
}

dvec3 Surfaces::emitted(const SurfaceHit& hit, bool front) const {
  const SurfaceSettings& s = settings_[hit.surface];
  if (!front && !s.two_sided) return dvec3(0);
  const Texture* const glow = cutouts_[hit.surface]->glow.get();
  return glow ? s.radiance * glow->lookup(hit.texcoord) : s.radiance;
}

EmissionShare Surfaces::emission_share(uint32_t surface) const {
  const Cutout& own = *cutouts_[surface];
  if (!own.glow && !own.any_alpha()) return {};
  return [&own](uint32_t triangle, double u, double v) {
    const double alpha = own.at(triangle, static_cast<float>(u), static_cast<float>(v));
    return own.glow ? alpha * own.glow->lookup(own.texcoord(triangle, u, v)) : dvec3(alpha);
  };
}

size_t Surfaces::light_of(uint32_t surface) const {
  size_t index = 0;
  for (uint32_t i = 0; i < surface; ++i) index += settings_[i].radiance != dvec3(0);
  return index;
}

dvec3 Surfaces::leave(const SurfaceHit& hit, const dvec3& p, const dvec3& d) {
  return p + hit.normal * (glm::dot(hit.normal, d) < 0 ? -hit.margin : hit.margin);
}

size_t Surfaces::bytes() const {
  size_t sum = 0;
  for (const TriangleMesh& m : meshes_)
    sum += m.positions.size() * (sizeof(dvec3) + sizeof(vec3) * 2 + sizeof(vec2)) +
           m.triangles.size() * (sizeof(ivec3) * 2 + 64);
  for (const auto& t : textures_)
    if (t) sum += t->texels.size() * sizeof(vec3);
  for (const auto& c : cutouts_)
    for (const auto* t : {&c->texture, &c->glow})
      if (*t) sum += (*t)->texels.size() * sizeof(vec3);
  return sum;
}

std::vector<std::string> Surfaces::notes() const {
  std::vector<std::string> notes;
  for (const TriangleMesh& m : meshes_) notes.insert(notes.end(), m.notes.begin(), m.notes.end());
  return notes;
}

}  // namespace brume
