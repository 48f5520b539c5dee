#pragma once
#include <memory>
#include <optional>
#include <vector>

#include "render/scene/scene.h"
#include "render/world/bsdf.h"
#include "render/world/mesh.h"

namespace brume {

/// What a ray met.
struct SurfaceHit {
  double t = 0;
  dvec3 normal{0};   ///< geometric, unit, on the outside
  dvec3 shading{0};  ///< of the shading: between the vertices' normals where the mesh has them
  vec2 texcoord{0};
  uint32_t surface = 0;  ///< which of the scene's surfaces
  uint32_t triangle = 0;
};

/// The scene's triangle meshes. The only class that knows Embree; a scene without surfaces never makes one.
class Surfaces {
 public:
  /// @throws InputError: meshes and textures that cannot be read
  Surfaces(const std::vector<SurfaceSettings>& settings, const dvec3& world_shift);
  ~Surfaces();

  std::optional<SurfaceHit> intersect(const Ray& ray, double t_max) const;
  /// What is left of light on its way: nothing behind anything but dielectrics with straight shadows.
  struct Passage {
    dvec3 light{1};
    bool straight = false;  ///< it went through one
  };
  Passage passage(const Ray& ray, double t_max) const;
  /// Whether a surface has straight shadows, which approximate.
  bool any_straight() const { return any_straight_; }

  const SurfaceSettings& settings(uint32_t surface) const { return settings_[surface]; }
  const TriangleMesh& mesh(uint32_t surface) const { return meshes_[surface]; }
  size_t count() const { return meshes_.size(); }
  /// The surface's scattering at a hit: its texture looked up.
  Bsdf bsdf(const SurfaceHit& hit) const;
  /// A point on the surface, moved off it along the normal by a rounding error's width, to the side of d.
  static dvec3 leave(const dvec3& p, const dvec3& normal, const dvec3& d);

  size_t bytes() const;
  std::vector<std::string> notes() const;

 private:
  struct Texture;
  struct Embree;
  std::vector<SurfaceSettings> settings_;
  std::vector<TriangleMesh> meshes_;
  std::vector<std::unique_ptr<Texture>> textures_;
  std::unique_ptr<Embree> embree_;
  bool any_straight_ = false;
};

}  // namespace brume
