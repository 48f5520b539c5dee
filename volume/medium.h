#pragma once
#include <array>
#include <functional>
#include <limits>
#include <optional>

#include "volume/brick_grid.h"
#include "volume/detail.h"
#include "volume/height_falloff.h"
#include "volume/instances.h"
#include "volume/phase_function.h"
#include "volume/placement.h"

namespace brume {

/// Ray parameter of what a ray never reaches.
inline constexpr double kUnbounded = std::numeric_limits<double>::infinity();

/// Three scalar fields on one lattice: a colour or a vector per voxel.
struct VectorBricks {
  std::array<BrickGrid, 3> parts;
  dvec3 lookup(const dvec3& local) const {
    return {parts[0].lookup(local), parts[1].lookup(local), parts[2].lookup(local)};
  }
  size_t bytes() const { return parts[0].bytes() + parts[1].bytes() + parts[2].bytes(); }
};

/// Deformation motion blur of a density field, Eulerian: at the time s in frames the density at x is the one stored at
/// x - displacement(x) * s (docs/methods.md, Motion blur).
struct Displacement {
  VectorBricks field;  ///< voxels moved per frame, on the density's lattice and with its origin
  BrickGrid envelope;  ///< its cells bound the density over every displaced position; it has no values of its own
  double open = 0, close = 0;  ///< shutter times in frames
  dvec3 origin_shift{0};       ///< envelope and field local coordinates = density local coordinates + this
};

/// A density in closed form inside a shape: 1 everywhere, or falling off with height.
struct HomogeneousShape {
  enum class Shape { kBox, kSphere } shape = Shape::kBox;
  dvec3 lo{-0.5}, hi{0.5};  ///< box corners; a sphere fills the box around it
  /// The interval of a local ray inside, or an empty one (first > second).
  std::pair<double, double> intersect(const Ray& ray) const;
  bool contains(const dvec3& p) const;

  std::optional<HeightFalloff> falloff = std::nullopt;
  double density(const dvec3& p) const { return !contains(p) ? 0.0 : falloff ? falloff->density(p) : 1.0; }
  /// Integral of the density along a local ray between two points of intersect().
  double integral(const Ray& ray, double t0, double t1) const {
    return falloff ? falloff->integral(ray, t0, t1) : t1 - t0;
  }
  /// Where that integral from t0 on reaches a value, as if the shape had no end.
  double reaches(const Ray& ray, double t0, double value) const {
    return falloff ? falloff->reaches(ray, t0, value) : t0 + value;
  }
  double maximum() const;
};

/// What turns density into coefficients [1 / world unit per density]; chromatic where the channels differ.
struct Coefficients {
  dvec3 sigma_t{0};
  dvec3 albedo{0};
  bool chromatic() const { return sigma_t.x != sigma_t.y || sigma_t.x != sigma_t.z; }
};

/// A density field in the world, with the coefficients that make it a scattering medium. Fields are referred to, not
/// owned: they must outlive it.
class Medium {
 public:
  Medium() = default;
  /// @param world_from_index affine; any non-singular map of the bricks' index space
  /// @throws InputError when the transform is singular or not finite
  Medium(const BrickGrid& bricks, const dmat4& world_from_index, const Coefficients& coefficients,
         const PhaseFunction& phase);
  /// Grey extinction and Henyey-Greenstein.
  Medium(const BrickGrid& bricks, const dmat4& world_from_index, double sigma_t, const dvec3& albedo, double g)
      : Medium(bricks, world_from_index, {dvec3(sigma_t), albedo}, PhaseFunction::henyey_greenstein(g)) {}
  /// In closed form, bounded.
  Medium(const HomogeneousShape& shape, const dmat4& world_from_local, const Coefficients& coefficients,
         const PhaseFunction& phase);

  /// Loosens the majorants that free flights and ratio tracking use by a factor of at least 1, or takes one for the
  /// whole grid: neither changes an expectation.
  void set_majorants(double scale, bool global) {
    majorant_scale_ = scale;
    global_majorant_ = global;
  }
  double majorant_scale() const { return majorant_scale_; }
  bool global_majorant() const { return global_majorant_; }
  void set_colour(const VectorBricks& colour, const Placement& where) {
    colour_ = &colour;
    colour_placement_ = where;
  }
  void set_displacement(const Displacement& displacement) { displacement_ = &displacement; }
  /// Multiplies the density of a grid by noise. Emission does not know it.
  void set_detail(const Detail& detail) { detail_ = &detail; }
  const Detail* detail() const { return detail_; }
  /// The transform at the shutter's end; it moves there in a straight line from the one given at construction.
  void set_motion(const dmat4& world_from_index_end);
  bool moves() const { return displacement_ != nullptr || end_.has_value(); }
  /// Where it is placed at a time in [0, 1] of the shutter.
  Placement placement_at(double time) const;
  /// Whether that depends on the time.
  bool transform_moves() const { return end_.has_value(); }
  /// The medium as it is at a time in [0, 1] of the shutter.
  Medium at_time(double time) const;
  /// Finds the density at kCell + 1 points along each axis, z fastest, from a local point on, a distance apart.
  using SampleDensity = std::function<void(const dvec3& first, double spacing, float* values)>;
  /// The medium with its density as it is now at the points of a finer lattice, linear between them: one that is
  /// displaced is looked up far faster so. Any other medium as it is. Its detail is lost.
  /// @param per_voxel  points of the lattice along a voxel
  /// @param bricks     is given the density; must outlive the medium
  Medium resampled(int per_voxel, BrickGrid& bricks, const SampleDensity& sample, const Task& task) const;

  /// Where it stands instead of its own place; null: there. Not of media that move or are chromatic.
  const Instances* instances() const { return instances_; }
  void set_instances(const Instances& instances) { instances_ = &instances; }
  /// One of its instances, as a medium of its own.
  Medium instance(size_t number) const;
  /// The one whose voxels have the largest optical depth; itself where it has no instances.
  Medium thickest() const { return instances_ ? instance(instances_->thickest()) : *this; }
  /// Calls visit(medium, number) for each instance that a world ray may meet before t_max; once with itself where it
  /// has none.
  template <class Visit>
  void each_met(const Ray& world, double t_max, const Visit& visit) const {
    if (!instances_) return visit(*this, size_t{0});
    instances_->each_met(world, t_max, [&](size_t i) { visit(instance(i), i); });
  }
  /// Calls visit(medium, number) for each instance whose box holds a world point, or once with itself.
  template <class Visit>
  void each_around(const dvec3& world, const Visit& visit) const {
    if (!instances_) return visit(*this, size_t{0});
    instances_->each_around(world, [&](size_t i) { visit(instance(i), i); });
  }

  /// Whether camera rays that end in it see nothing there.
  bool holdout() const { return holdout_; }
  void set_holdout(bool holdout) { holdout_ = holdout; }

  bool empty() const { return !homogeneous_ && (bricks_ == nullptr || bricks_->empty()); }
  const std::optional<HomogeneousShape>& homogeneous() const { return homogeneous_; }
  bool falls_off() const { return homogeneous_ && homogeneous_->falloff; }
  /// Meaningless for a homogeneous medium.
  const BrickGrid& bricks() const { return *bricks_; }
  const Displacement* displacement() const { return displacement_; }
  /// The cells that a ray walks through: the bricks', or the displaced field's.
  const BrickGrid& walked() const { return displacement_ ? displacement_->envelope : *bricks_; }
  /// Local coordinates of walked() from those of the bricks.
  dvec3 walked_shift() const { return displacement_ ? displacement_->origin_shift : dvec3(0); }

  /// The segments of constant majorant along a local ray. Not for a homogeneous medium.
  MajorantWalk walk(const Ray& local, double t_min, double t_max) const {
    return {walked(), {local.o + walked_shift(), local.d}, t_min, t_max, majorant_factor()};
  }

  const Coefficients& coefficients() const { return coefficients_; }
  /// The largest channel: tracking samples with it.
  double extinction_per_density() const { return sigma_max_; }
  /// Each channel's extinction as a share of the largest.
  const dvec3& extinction_ratio() const { return ratio_; }
  bool chromatic() const { return coefficients_.chromatic(); }
  /// Single-scattering albedo at a world point: constant, or tinted by the colour grid.
  dvec3 albedo(const dvec3& world) const {
    if (!colour_) return coefficients_.albedo;
    return coefficients_.albedo * glm::clamp(colour_->lookup(colour_placement_.to_local(world)), 0.0, 1.0);
  }
  const dvec3& albedo() const { return coefficients_.albedo; }
  /// The same of an instance, at a world point of it.
  dvec3 albedo(size_t number, const dvec3& world) const {
    const Instance& one = (*instances_)[number];
    return one.tint * albedo(placement_.to_world(one.to_local(world)));
  }
  bool coloured() const { return colour_ != nullptr; }
  const PhaseFunction& phase() const { return phase_; }

  const Placement& placement() const { return placement_; }
  Ray to_local(const Ray& world) const { return placement_.to_local(world); }
  RayCone to_local(const RayCone& world) const { return placement_.to_local(world); }
  dvec3 to_local(const dvec3& world) const { return placement_.to_local(world); }
  dvec3 to_world(const dvec3& local) const { return placement_.to_world(local); }
  dvec3 gradient_to_world(const dvec3& local) const { return placement_.gradient_to_world(local); }
  double voxel_volume() const { return placement_.voxel_volume(); }
  /// Of instances on average.
  double voxel_size() const { return instances_ ? instances_->voxel_size() : placement_.voxel_size(); }

  /// Density at a local point, displaced and with detail where the medium is.
  double density(const dvec3& local) const {
    if (homogeneous_) return homogeneous_->density(local);
    const dvec3 stored = displacement_ ? displaced(local) : local;
    const double found = bricks_->lookup(stored);
    return detail_ && found > 0 ? found * detail_->factor(stored) : found;
  }
  /// The same at a local point of a segment of walk(), for less.
  double density(const MajorantWalk::Segment& segment, const dvec3& local) const {
    if (displacement_) return density(local);
    const double found = smooth_density(segment, local);
    return detail_ && found > 0 ? found * detail_->factor(local) : found;
  }
  /// Both without detail.
  double smooth_density(const dvec3& local) const {
    if (homogeneous_) return homogeneous_->density(local);
    return bricks_->lookup(displacement_ ? displaced(local) : local);
  }
  double smooth_density(const MajorantWalk::Segment& segment, const dvec3& local) const {
    return displacement_ ? smooth_density(local) : bricks_->lookup_in(*segment.cell, segment.coordinates, local);
  }
  /// Where the density that is now at a local point is stored.
  dvec3 displaced(const dvec3& local) const {
    return local - time_ * displacement_->field.lookup(local + displacement_->origin_shift);
  }
  /// What detail multiplies all bounds of the stored density by; 1 without it.
  double majorant_factor() const { return detail_ ? detail_->greatest() : 1.0; }
  double maximum_density() const {
    return homogeneous_ ? homogeneous_->maximum() : bricks_->maximum() * majorant_factor();
  }
  /// Extinction at a local point [1 / world unit], of the largest channel.
  double sigma_t(const dvec3& local) const { return sigma_max_ * density(local); }

  /// Local box outside of which there is nothing.
  std::pair<dvec3, dvec3> support() const;
  struct Sphere {
    dvec3 centre{0};
    double radius = 0;
  };
  /// Corners of a world box around it, or around all of its instances.
  std::array<dvec3, 8> corners() const;
  /// Encloses the support, world space.
  Sphere bounding_sphere() const;

 private:
  void set_coefficients(const Coefficients& coefficients);

  const BrickGrid* bricks_ = nullptr;
  std::optional<HomogeneousShape> homogeneous_;
  Placement placement_;
  std::optional<dmat4> end_;  // world_from_local at the shutter's end
  const VectorBricks* colour_ = nullptr;
  Placement colour_placement_;
  const Displacement* displacement_ = nullptr;
  const Detail* detail_ = nullptr;
  const Instances* instances_ = nullptr;
  double time_ = 0, majorant_scale_ = 1;
  bool global_majorant_ = false, holdout_ = false;
  Coefficients coefficients_;
  double sigma_max_ = 0;
  dvec3 ratio_{1};
  PhaseFunction phase_;
};

}  // namespace brume
