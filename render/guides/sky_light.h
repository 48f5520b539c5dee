#pragma once
#include <vector>

#include "render/guides/guide_light.h"

namespace brume {

/// Everything infinitely far but the suns.
class SkyLight final : public GuideLight {
 public:
  using GuideLight::GuideLight;
  const SkyLight* sky() const override { return this; }
  Radiance arriving(const LightSolve& solve) override;
  Lit onto(const LitSurfaces& surfaces, const SurfaceLight::Around& around, const dvec3& p,
           const dvec3& normal) const override;
  /// Radiance outside, for each of ScatteringSolver::directions, that light travels along.
  const std::vector<double>& incoming() const { return incoming_; }
  /// What the group has of light whose colours are known.
  dvec3 share() const { return channel == kGrey ? dvec3(1) : colour; }

 private:
  std::vector<double> incoming_;
};

}  // namespace brume
