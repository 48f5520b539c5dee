#pragma once
#include <span>
#include <vector>

#include "base/progress.h"
#include "render/world/field_cones.h"
#include "render/world/light.h"
#include "volume/emission.h"

namespace brume {

/// A field that emits, as a light: its points are drawn in proportion to what their voxel emits, or evenly in a
/// homogeneous shape.
///
/// Directions drawn by a phase function or BSDF find the field, too, all along their way through it, so the two
/// techniques are weighed point by point: a point drawn with the density p per volume, seen from the distance r, counts
/// as a direction drawn with the density p r^2 length(). Weights of any kind are unbiased where they sum to 1 at each
/// point; with these the light of near points, which grows without bound as 1 / r^2, is left to directions.
/// Source: the combination is that of Simon, Hanika, Zirr, Dachsbacher 2017 (line integration), with points in place of
/// lines for the light samples.
class FieldLight final : public Light {
 public:
  /// Whether a field can be one: it stands still.
  static bool fits(const EmissionField& field) { return !field.moves(); }
  /// @param field  what it refers to must outlive the light
  /// @param media  that scatter its light
  explicit FieldLight(const EmissionField& field, std::span<const Medium> media = {}, const Task& task = {});

  LightSample sample(const dvec3& p, const dvec2& u) const override;
  double importance(const dvec3& p) const override;
  /// What an empty scene would receive from it at p, about. importance() is less where directions find it well.
  double irradiance(const dvec3& p) const;

  /// How seldom directions drawn at random find it, as a share of how far it is from being all around: 0 to 1.
  /// @param spread  mean square distance of the points meant from p
  double seldom_found(const dvec3& p, double spread = 0) const;

  /// Density of drawing a world point [1 / unit^3] times length(): times r^2 it is the density of a direction.
  double density(const dvec3& world) const;
  /// The same by voxel: of the cubes between eight values, where the values of their lowest corners are in the bricks.
  /// Empty for a homogeneous shape.
  const std::vector<float>& densities() const { return densities_; }
  /// How far a ray through the field shines, typically: the edge of a cube of as much even emission.
  double length() const { return length_; }

  /// Around what emits in it.
  const FieldBalls& balls() const { return balls_; }

 private:
  struct LitCell {
    ivec3 cell;
    double sum;  ///< of the shares of all cells up to this one
  };
  dvec3 draw(Rng& rng, double& density, dvec3& emission) const;
  void measure_bricks(std::span<const Medium> media, const Task& task);

  EmissionField field_;
  std::vector<float> densities_, rows_;  // rows_: by brick and row, the power of all rows up to it
  std::vector<LitCell> cells_;
  double intensity_ = 0;  // luminance, of the whole field [W/sr]
  double length_ = 0;
  dvec3 centre_{0};
  double spread_ = 0;  // mean square distance from the centre
  FieldBalls balls_;
};

}  // namespace brume
