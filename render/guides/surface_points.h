#pragma once
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "base/progress.h"
#include "render/guides/guide_media.h"
#include "render/world/surfaces.h"

namespace brume {

/// Points spread evenly over the diffuse surfaces of a scene, each for the part of a surface around it: close together
/// near the media, on small meshes and where another surface is near, farther apart elsewhere. Both sides of a surface
/// have points of their own.
class SurfacePoints {
 public:
  struct Point {
    dvec3 p{0}, normal{0};  ///< a margin in front of the surface
    dvec3 albedo{0};        ///< mean
    double area = 0;
    double reach = kFar;  ///< harmonic mean distance to what it faces; to be set by who has looked
    /// Rays that meet its part of the surface from the front, and where.
    std::vector<std::pair<Ray, SurfaceHit>> samples;
  };
  SurfacePoints(const Surfaces& surfaces, const GuideMedia& media, const Task& task);

  std::vector<Point>& points() { return points_; }
  const std::vector<Point>& points() const { return points_; }
  /// The point nearest to a place of a surface with a normal, of those that face alike; -1 where there is none.
  int nearest(const dvec3& p, const dvec3& normal) const;

  static constexpr size_t kAround = 12;
  struct Around {
    std::array<int, kAround> point{};
    std::array<double, kAround> weight{};  ///< of sum 1; beyond a row of points also negative
    size_t count = 0;
  };
  /// Points around a place of a surface and their weights, so that what varies linearly over a plane is found exactly.
  Around around(const dvec3& p, const dvec3& normal) const;

 private:
  /// Points that know their reach, which says how close together others have to be, and the least share of their usual
  /// distances that these may have; none: distances are the usual ones.
  struct Near {
    const SurfacePoints* points = nullptr;
    double closest = 1;
  };
  class Spread;
  void spread(const Surfaces& surfaces, const GuideMedia& media, double wider, const Near& near);
  /// Finds how far the points are from what is near them. @return whether any is nearer to that than to other points
  bool find_reach(const Surfaces& surfaces, const Task& task);
  void grow_tree();
  void settle(const Surfaces& surfaces, const Task& task);
  void build(size_t begin, size_t end);
  struct Search;
  void search(size_t begin, size_t end, Search& found) const;

  std::vector<Point> points_;
  // A k-d tree: the middle one of a range splits it along its axis.
  struct Node {
    dvec3 p, normal;
    int point, axis;
  };
  std::vector<Node> tree_;
};

}  // namespace brume
