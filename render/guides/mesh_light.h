#pragma once
#include <string>
#include <vector>

#include "render/guides/guide_light.h"

namespace brume {

/// Meshes that emit: discs of their area, in groups of neighbours that share shadows and transmittance.
class EmittingMeshes final : public GuideLight {
 public:
  /// @param meshes  which of the scene's surfaces they are
  EmittingMeshes(std::string guide_name, const dvec3& guide_colour, const Surfaces& surfaces,
                 const std::vector<uint32_t>& meshes);

  Radiance arriving(const LightSolve& solve) override;
  Lit onto(const LitSurfaces& surfaces, const SurfaceLight::Around& around, const dvec3& p,
           const dvec3& normal) const override;

 private:
  static constexpr size_t kOfGroup = 8;
  struct Disc {
    dvec3 p{0}, normal{0}, radiance{0};  ///< normal: the mean over its area, shorter where that is bent
    double area = 0;
    double spread = 0;  ///< of the cosines to the normals of its area, evenly to both sides of the mean
    bool two_sided = false;
  };
  using Group = std::array<Disc, kOfGroup>;
  void spread(const Surfaces& surfaces, uint32_t mesh, size_t groups);

  std::vector<Group> groups_;
};

}  // namespace brume
