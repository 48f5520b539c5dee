#pragma once
#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "base/rng.h"
#include "render/transport/near_light.h"
#include "render/transport/path_states.h"
#include "render/world/lights.h"
#include "volume/medium.h"

namespace brume {

struct PathContext;
struct WorldPaths;
class MediaFlights;

// Light that is scattered close to a lamp in smoke, on its way to a vertex anywhere. Flights find such places seldom,
// and what they find there grows as 1 / r^2, with a variance that has no bound: bright pixels wherever a flight
// happened to end at a lamp. So vertices aim at the smoke around a lamp, too, at a point of a ball whose density falls
// as 1 / r^2 itself, and see it lit by the lamp.
//
// From a vertex at the distance h from the lamp, points at the distance r scatter 1 / h^2 of their light towards it
// where r < h, and 1 / r^2 beyond: radii are drawn by 1 / (r + h)^2, evenly for vertices far away. Without that light
// scattered twice beside the lamp, at x and y, has no bound.
//
// Both techniques reach the same pairs of a vertex x and a point y, so their shares are weighed by the balance
// heuristic: points by their density p(y), flights by pdf(direction) sigma / |x - y|^2, where one number, the mean
// extinction of the ball, stands for what the flight meets. Weights of any kind are unbiased where they sum to 1; with
// these the factor 1 / |x - y|^2 is left to flights, and 1 / r^2 to points.
//
// Source: balance heuristic of Veach 1997; points drawn around a lamp instead of vertices of a path from it: ours.

/// A lamp in grids, and the ball around it.
struct LitBall {
  const Light* light;
  dvec3 centre;
  double radius;
  double sigma_t;  ///< mean along the radii [1/m]
  double power;    ///< of what is scattered in the ball, in the units of Light::importance times squared distance

  /// The distance of a vertex from the lamp.
  double distance(const dvec3& p) const { return std::max(glm::distance(centre, p), 1e-3 * radius); }
  /// Draws how far a point is from the lamp, for a vertex at the distance h.
  double sample(double h, double u) const { return h * radius * u / (h + radius * (1 - u)); }
  /// Density of drawing a point of the ball at the distance r from the lamp [1/m^3].
  double density(double h, double r) const {
    return r < radius ? h * (h + radius) / (radius * (r + h) * (r + h)) / (4 * kPi * r * r) : 0.0;
  }
  /// About what it brings to a vertex: as 1 / h^2 from far away, as 1 / h inside.
  double importance(double h) const { return power / (h * (h + 0.4 * radius)); }
};

/// Balls around point and spot lights in the smoke of grids; none where there are very many lights.
/// @param near_lights  those that are sampled along flights
/// @param setting  auto or off
std::vector<LitBall> choose_lit_balls(std::span<const Medium> media, const Lights& lights,
                                      std::span<const NearLight> near_lights, std::string_view setting);

/// Points of lit balls as seen from the vertices of the paths on one thread.
class BallSamples {
 public:
  /// What a vertex does to light from a direction, and its density of drawing that direction.
  struct Scattering {
    dvec3 value;
    double pdf;
    dvec3 from;  ///< where the shadow ray begins
  };

  /// Refers to all of them.
  BallSamples(const PathContext& context, PathStates& paths, WorldPaths& world, MediaFlights& flights);

  /// Keeps where the flight to a path's collision began, before that is where the path is.
  void leave(size_t slot);
  /// Weights light samples at collisions by the balance heuristic: without the share that points on flights find.
  void weigh(const SlotList& shadows);
  /// The flights' share of a light sample at a path's collision. @param p  where it is
  double share_of_flights(size_t slot, const Light* light, const dvec3& p) const;
  /// Draws a point for a vertex. @param events  of the path, the vertex included   @param scattering  (wi) tells a
  /// Scattering, the path's throughput included
  template <class Of>
  void draw(size_t slot, const dvec3& p, uint32_t events, const Of& scattering) {
    Point point;
    if (!draw_point(slot, p, events, point)) return;
    const Scattering s = scattering(point.wi);
    add(slot, s, point);
  }
  /// Adds the light of the points that were drawn, as far as it arrives.
  void trace();

 private:
  struct Point {
    const LitBall* ball;
    dvec3 p, wi;
    double distance, density;  // from the vertex; of drawing it there
  };
  struct Leg {
    Ray ray;
    double end;
  };
  bool draw_point(size_t slot, const dvec3& vertex, uint32_t events, Point& point);
  void add(size_t slot, const Scattering& scattering, const Point& point);
  /// How likely a vertex draws a point at all, and of which ball.
  struct Chances {
    double total = 0, any = 1;  // importance of all balls
    double of(const LitBall& ball, double h) const { return any * ball.importance(h) / total; }
  };
  Chances chances(const dvec3& vertex) const;
  void pass(std::array<Leg, kPool>& legs, bool from_lamp);

  const PathContext& c_;
  PathStates& p_;
  WorldPaths& w_;
  MediaFlights& flights_;
  struct Came {
    dvec3 from{0};
    bool scattered = false;  // at a vertex there that draws points
    double pdf = 0;          // of the direction
  };
  std::array<Came, kPool> came_;
  std::array<Leg, kPool> to_point_, to_lamp_;
  std::array<const Light*, kPool> lamp_;
  Column3 light_;  // of the points
  SlotList drawn_;
};

}  // namespace brume
