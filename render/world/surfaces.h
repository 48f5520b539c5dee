#pragma once
#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "image/color_space.h"
#include "render/files/mesh.h"
#include "render/scene/scene.h"
#include "render/world/bsdf.h"
#include "render/world/light_kinds.h"

namespace brume {

/// What a ray met.
struct SurfaceHit {
  double t = 0;
  dvec3 normal{0};   ///< geometric, unit, on the outside
  dvec3 shading{0};  ///< of the shading: between the vertices' normals where the mesh has them
  vec2 texcoord{0};
  double margin = 0;     ///< world units: rays that leave the surface begin this far off it
  uint32_t surface = 0;  ///< which of the scene's surfaces
  uint32_t triangle = 0;
};

/// The scene's triangle meshes. The only class that knows Embree; a scene without surfaces never makes one.
///
/// Embree computes in single precision. It sees the meshes shifted and scaled into [-1, 1] and rays from where they
/// enter that box; which triangle is hit is its answer, where on it is computed from the triangle in double precision.
/// So nothing depends on where in the world a scene lies, nor how large it is (tests/render/surfaces_test.cpp). Embree
/// is held to one instruction set, so that every machine gives the same bits.
class Surfaces {
 public:
  static constexpr double kMiddle = 0.5;  ///< of the shutter

  /// @param blurred  whether the shutter is open for a while: surfaces that move stand where they start otherwise
  /// @throws InputError: meshes and textures that cannot be read, transforms that are no motion
  Surfaces(const std::vector<SurfaceSettings>& settings, const dvec3& world_shift, bool blurred = false,
           const WorkingSpace& space = {});
  ~Surfaces();

  /// Cut-outs are met or passed by a number that follows from the ray alone.
  /// @param time    in [0, 1] of the shutter
  /// @param camera  whether the ray never scattered: some surfaces are not there for it
  std::optional<SurfaceHit> intersect(const Ray& ray, double t_max, double time = kMiddle, bool camera = false) const;
  /// What is left of light on its way: nothing behind anything but cut-outs, by their alpha, and dielectrics with
  /// straight shadows.
  struct Passage {
    dvec3 light{1};
    bool straight = false;  ///< it went through one
  };
  Passage passage(const Ray& ray, double t_max, double time = kMiddle) const;
  /// Whether a surface has straight shadows, which approximate.
  bool any_straight() const { return any_straight_; }
  /// Whether a surface moves over the shutter.
  bool any_moves() const {
    return std::any_of(meshes_.begin(), meshes_.end(), [](const TriangleMesh& m) { return m.moves(); });
  }

  const SurfaceSettings& settings(uint32_t surface) const { return settings_[surface]; }
  const TriangleMesh& mesh(uint32_t surface) const { return meshes_[surface]; }
  size_t count() const { return meshes_.size(); }
  /// The number of a surface among those that emit: Lights::mesh's.
  size_t light_of(uint32_t surface) const;
  /// Radiance that a surface emits at a hit, on a side. @param front  the outside
  dvec3 emitted(const SurfaceHit& hit, bool front) const;
  /// What of an emitter's radiance its points emit, alpha included; none: all of it everywhere. Outlived by this.
  EmissionShare emission_share(uint32_t surface) const;
  /// The surface's scattering at a hit: its texture looked up.
  Bsdf bsdf(const SurfaceHit& hit) const;
  /// A point of the surface that was hit, moved off it by its margin, to the side of d.
  static dvec3 leave(const SurfaceHit& hit, const dvec3& p, const dvec3& d);

  size_t bytes() const;
  std::vector<std::string> notes() const;

 private:
  struct Texture;
  struct Cutout;
  struct Embree;
  struct Query;
  /// A ray as Embree sees it; nothing where it misses the box of the meshes.
  std::optional<Query> query(const Ray& ray, double t_max, double time) const;
  void add_mesh(const SurfaceSettings& settings, const dvec3& world_shift, bool blurred, const WorkingSpace& space);

  std::vector<SurfaceSettings> settings_;
  std::vector<Bsdf> bsdfs_;                                                 // without textures
  std::map<std::pair<double, double>, std::unique_ptr<CoatAlbedo>> coats_;  // by alpha and ior
  std::vector<TriangleMesh> meshes_;
  std::vector<std::unique_ptr<Texture>> textures_;
  std::vector<std::unique_ptr<Cutout>> cutouts_;
  std::unique_ptr<Embree> embree_;
  bool any_straight_ = false;
  dvec3 centre_{0};   // of the box of all meshes
  dvec3 half_{1};     // extents of it, times scale_
  double scale_ = 1;  // a power of two
};

}  // namespace brume
