#pragma once
#include <memory>
#include <optional>
#include <variant>
#include <vector>

#include "render/guides/guide_light.h"
#include "render/guides/sun_depth.h"

namespace brume {

class SunLight;

/// Every kind of light that has a direction. The compiler asks for an answer to each question below for a new one,
/// which guide_lights() lists.
using KnownLight = std::variant<const Sun*, const FiniteLight*, const PointLight*>;

inline const Light& base_of(const KnownLight& light) {
  return *std::visit([](const auto* own) -> const Light* { return own; }, light);
}

/// What arrives at a point from a light, along one direction towards its middle.
struct ArrivingLight {
  dvec3 towards{0};     ///< unit
  double distance = 0;  ///< to the light
  dvec3 irradiance{0};  ///< in empty space, across that direction
  double radius = 0;    ///< of a sphere; its middle lies as much farther
  double depth = 0;     ///< optical depth towards it along the shortest way, where that is known

  /// Mean over the directions towards it.
  double transmittance(double shortest) const;
  /// Optical depth of that mean.
  double mean_depth() const;
  /// Mean cosine of the directions towards it to that of its middle: 1 of a small or distant one.
  double mean_cosine() const;

 private:
  bool small() const;
};
/// In empty space.
ArrivingLight arriving_light(const KnownLight& light, const dvec3& p);
/// What word its guides begin with.
const char* guide_word(const KnownLight& light);
/// Whether points of it can be told apart by shadows.
bool has_extent(const KnownLight& light);
/// What a ray sees of a light and the density with which sampling finds that direction; none where rays do not meet it,
/// or through surfaces alone.
struct MetLight {
  dvec3 radiance;
  double pdf;
};
std::optional<MetLight> met_by(const Ray& ray, const KnownLight& light);

/// A sun or lamp with guides of its own.
class SharpLight : public GuideLight {
 public:
  SharpLight(std::string guide_name, const dvec3& guide_colour, const KnownLight& light)
      : GuideLight(std::move(guide_name), guide_colour), light_(light) {}

  const SharpLight* sharp() const override { return this; }
  /// Parallel light; null for a lamp.
  virtual const SunLight* sun() const { return nullptr; }
  /// What arrives at a point of the media or of a surface.
  virtual ArrivingLight at(const dvec3& p) const = 0;
  /// Share of it that surfaces leave at the fine lattice's nodes; null: all of it.
  const float* visible_at_nodes() const { return visible_.empty() ? nullptr : visible_.data(); }
  /// Optical depth towards a lamp at the same nodes; null for a sun.
  virtual const float* depth_at_nodes() const { return nullptr; }
  const KnownLight& light() const { return light_; }

 protected:
  const KnownLight light_;
  Lattice lattice_;
  NodeValues visible_;  // empty without surfaces
};

class SunLight final : public SharpLight {
 public:
  using SharpLight::SharpLight;
  const SunLight* sun() const override { return this; }
  Radiance arriving(const LightSolve& solve) override;
  Lit onto(const LitSurfaces& surfaces, const SurfaceLight::Around& around, const dvec3& p,
           const dvec3& normal) const override;
  ArrivingLight at(const dvec3& p) const override;
  const dvec3& towards() const { return std::get<const Sun*>(light_)->axis(); }
  const dvec3& irradiance() const { return std::get<const Sun*>(light_)->irradiance(); }
  /// @param time  of the shutter's
  const SunDepth& depth(size_t time) const { return depth_[time]; }
  size_t bytes() const override;

 private:
  std::vector<SunDepth> depth_;
};

class LampLight final : public SharpLight {
 public:
  using SharpLight::SharpLight;
  Radiance arriving(const LightSolve& solve) override;
  Lit onto(const LitSurfaces& surfaces, const SurfaceLight::Around& around, const dvec3& p,
           const dvec3& normal) const override;
  ArrivingLight at(const dvec3& p) const override;
  const float* depth_at_nodes() const override { return depth_.data(); }
  size_t bytes() const override { return (depth_.size() + visible_.size()) * sizeof(float); }

 private:
  NodeValues depth_;
};

/// Suns and lamps that share their guides. @param only  a colour channel of theirs, or kGrey
std::unique_ptr<GuideLight> other_lights(const dvec3& colour, const std::vector<KnownLight>& lights, GuideColour only);

/// A light as seen from a point: the vector that leads there, and how much it counts among several.
struct LightTarget {
  dvec3 to;
  double weight;
};

/// What surfaces leave of lights at the nodes, and the optical depth towards them without the forward peak: known at
/// those of the coarse lattice.
class LightShares {
 public:
  /// @param target  called as target(p) for the vector that leads from a point to the light, 0 where it does not shine,
  ///                or for a list of LightTarget
  template <class Target>
  LightShares(const LightSolve& solve, const Target& target)
      : lattice_(solve.coarse), open_(lattice_.size()), depth_(lattice_.size()) {
    parallel_for(lattice_.n.x, solve.task, [&](int x) {
      for (int y = 0; y < lattice_.n.y; ++y)
        for (int z = 0; z < lattice_.n.z; ++z) look(solve, {x, y, z}, target(lattice_.node(x, y, z)));
    });
  }
  double at(const dvec3& p) const;

 private:
  void look(const LightSolve& solve, const ivec3& node, const dvec3& to);
  void look(const LightSolve& solve, const ivec3& node, const std::vector<LightTarget>& lights);

  const Lattice& lattice_;
  NodeValues open_, depth_;
};

}  // namespace brume
