#include "workflows/motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "base/parallel_for.h"
#include "render/world/camera.h"
#include "render/world/media.h"
#include "render/world/surfaces.h"

namespace brume {
namespace {

constexpr double kNothing = 1e-6;    // of a pixel
constexpr double kInstant = 1e-6;    // frames: a shutter that is open long enough for velocities to be read
constexpr int kPoints = 3;           // along a part of a pixel, each for as much of what it covers
constexpr double kSamePlace = 0.02;  // of the distance: a hit and a part of a pixel that are one surface

/// Where a point is a frame earlier and later.
struct Moved {
  dvec3 previous, next;
};

dmat4 step(const dmat4& now, const dmat4& then) {
  return now == then ? dmat4(1) : then * glm::inverse(now);
}

dvec3 apply(const dmat4& matrix, const dvec3& p) {
  return dvec3(matrix * glm::dvec4(p, 1.0));
}

/// Where a displaced medium's local point goes in one frame.
dvec3 velocity(const Medium& medium, const dvec3& local) {
  const Displacement* const moves = medium.displacement();
  return moves ? dvec3(moves->field.lookup(local + moves->origin_shift)) : dvec3(0);
}

/// A volume of the scene by itself.
struct MovingVolume {
  SceneMedia media;
  dmat4 to_previous, to_next;
};

class Motion {
 public:
  Motion(MotionScenes& scenes, const std::function<void(const std::string&)>& say, const Task& task) {
    Scene alone = scenes.now;
    alone.camera.shutter = {0, kInstant};
    alone.lights.clear();
    alone.surfaces.clear();
    alone.instances.clear();
    alone.environment.air = 0;
    for (size_t i = 0; i < scenes.now.volumes.size(); ++i) {
      const bool placed = std::any_of(scenes.now.instances.begin(), scenes.now.instances.end(),
                                      [&](const auto& s) { return s.enabled && static_cast<size_t>(s.volume) == i; });
      if (placed) {
        say(fmt::format("volumes.{}: its instances stand still in the layer motion", i));
        continue;
      }
      VolumeSettings v = scenes.now.volumes[i];
      v.object_to_world_end = dmat4(0);
      v.temperature_grid = v.flame_grid = "none";
      v.emission = dvec3(0);
      alone.volumes = {v};
      const auto place = [&](const Scene& scene) { return scene.volumes[i].object_to_world; };
      const dmat4 now = v.object_to_world;
      volumes_.push_back(
          {SceneMedia(alone, quiet(task)), step(now, place(scenes.previous)), step(now, place(scenes.next))});
      scenes.now.volumes[i].grids.reset();
      alone.volumes.clear();
    }
    bool moves = false;
    for (size_t i = 0; i < scenes.now.surfaces.size(); ++i) {
      const dmat4 now = scenes.now.surfaces[i].object_to_world;
      surface_steps_.push_back(
          {step(now, scenes.previous.surfaces[i].object_to_world), step(now, scenes.next.surfaces[i].object_to_world)});
      moves = moves || surface_steps_.back() != std::pair(dmat4(1), dmat4(1));
    }
    if (moves) surfaces_.emplace(scenes.now.surfaces, dvec3(0));
  }

  bool nothing_moves() const {
    return !surfaces_ && std::all_of(volumes_.begin(), volumes_.end(), [](const MovingVolume& v) {
      const auto& media = v.media.media();
      return v.to_previous == dmat4(1) && v.to_next == dmat4(1) &&
             std::none_of(media.begin(), media.end(), [](const Medium& m) { return m.displacement() != nullptr; });
    });
  }

  /// Of a point inside media: the mean over those that are there, by their extinction.
  Moved inside(const dvec3& p) const {
    double all = 0;
    Moved moved{dvec3(0), dvec3(0)};
    for (const MovingVolume& v : volumes_)
      for (const Medium& medium : v.media.media()) {
        const dvec3 local = medium.to_local(p - v.media.world_shift());
        const double sigma = medium.sigma_t(local);
        if (!(sigma > 0)) continue;
        const dvec3 by = velocity(medium, local);
        const auto at = [&](const dvec3& q) { return medium.to_world(q) + v.media.world_shift(); };
        moved.previous += sigma * apply(v.to_previous, at(local - by));
        moved.next += sigma * apply(v.to_next, at(local + by));
        all += sigma;
      }
    return all > 0 ? Moved{moved.previous / all, moved.next / all} : Moved{p, p};
  }

  /// Of a point of a surface that a ray sees.
  Moved on_surface(const Ray& ray, const dvec3& p) const {
    if (!surfaces_) return {p, p};
    const double t = glm::dot(p - ray.o, ray.d);
    Ray near = ray;  // what else the ray meets, at an edge, is of another part
    near.o += (1 - kSamePlace) * t * ray.d;
    const auto hit = surfaces_->intersect(near, 2 * kSamePlace * t, 0, true);
    if (!hit) return {p, p};
    const auto& [previous, next] = surface_steps_[hit->surface];
    return {apply(previous, p), apply(next, p)};
  }

 private:
  std::vector<MovingVolume> volumes_;
  std::vector<std::pair<dmat4, dmat4>> surface_steps_;
  std::optional<Surfaces> surfaces_;
};

/// The time in [0, 1] of the shutter that is the frame's own, or nearest to it.
double own_time(const CameraSettings& camera) {
  const auto [open, close] = std::pair(camera.shutter.x, camera.shutter.y);
  return close > open ? std::clamp(-open / (close - open), 0.0, 1.0) : 0.0;
}

struct View {
  Camera camera;
  double time;
  View(const Scene& scene, const FilmSettings& film)
      : camera(scene.camera, film.width, film.height), time(own_time(scene.camera)) {}
  bool operator==(const View& other) const {
    return time == other.time && camera.world_to_ndc() == other.camera.world_to_ndc() && !camera.moves() &&
           !other.camera.moves();
  }
  std::optional<dvec2> film_of(const dvec3& p) const { return camera.film_of(p, time); }
  std::optional<dvec2> film_of_direction(const dvec3& d) const { return camera.film_of_direction(d, time); }
};

/// Mean of where the things that a pixel shows were and will be, relative to the pixel, weighted by what they cover.
struct MeanMotion {
  dvec2 here;
  dvec2 before{0}, after{0};
  double all = 0;

  void add(double cover, const std::optional<dvec2>& was, const std::optional<dvec2>& will) {
    if (!was || !will) return;  // behind the camera
    before += cover * (*was - here);
    after += cover * (*will - here);
    all += cover;
  }
};

/// Calls visit(z, cover) for kPoints depths inside a part of a deep pixel, where equal shares of what it covers lie:
/// its transmittance falls off exponentially.
template <class Visit>
void each_inside(const DeepPart& part, double cover, double transmittance, const Visit& visit) {
  const double share = cover / transmittance, depth = -std::log1p(-std::min(share, 1 - 1e-9));
  const double length = part.z_back - part.z;
  for (int k = 0; k < kPoints; ++k) {
    const double of_share = (k + 0.5) / kPoints;
    visit(part.z + length * (share < 1e-4 ? of_share : -std::log1p(-of_share * std::min(share, 1 - 1e-9)) / depth),
          cover / kPoints);
  }
}

}  // namespace

void add_motion(const DeepRecord& record, MotionScenes scenes, Layers& frame,
                const std::function<void(const std::string&)>& say, const Task& task) {
  const FilmSettings film = scenes.now.film;
  const View now(scenes.now, film), previous(scenes.previous, film), next(scenes.next, film);
  for (Scene* const other : {&scenes.previous, &scenes.next})
    if (other->volumes.size() != scenes.now.volumes.size() || other->surfaces.size() != scenes.now.surfaces.size()) {
      say("the layer motion: the frame before or after has other volumes or surfaces, and what is in the scene stands still");
      other->volumes = scenes.now.volumes;
      other->surfaces = scenes.now.surfaces;
    }
  const Motion motion(scenes, say, task);
  const std::array<Plane*, 4> planes = {
      &frame.add(layer::motion_previous.channel(0)), &frame.add(layer::motion_previous.channel(1)),
      &frame.add(layer::motion_next.channel(0)), &frame.add(layer::motion_next.channel(1))};
  if (motion.nothing_moves() && now == previous && now == next) return;  // zero
  const ivec2 corner = frame.data_window().lo;
  parallel_for(frame.height(), task, [&](int y) {
    for (int x = 0; x < frame.width(); ++x) {
      const dvec2 here = dvec2(corner + ivec2(x, y)) + 0.5;
      const Ray ray = now.camera.ray(here, Camera::kLensMiddle, now.time);
      const double per_depth = 1 / (now.camera.depth(ray.o + ray.d, now.time) - now.camera.depth(ray.o, now.time));
      const auto at = [&](double z) { return ray.o + z * per_depth * ray.d; };
      MeanMotion mean{here};
      const auto add = [&](double cover, const Moved& moved) {
        mean.add(cover, previous.film_of(moved.previous), next.film_of(moved.next));
      };
      double left = 1;
      for (const DeepPart& part : record.parts({x, y})) {
        const double cover = left - static_cast<double>(part.left);
        if (!(cover > 0)) continue;
        if (part.z_back > part.z)
          each_inside(part, cover, left, [&](double z, double share) { add(share, motion.inside(at(z))); });
        else
          add(cover, motion.on_surface(ray, at(part.z)));
        left = part.left;
      }
      if (!(mean.all > kNothing)) {
        mean = {here};
        mean.add(1, previous.film_of_direction(ray.d), next.film_of_direction(ray.d));
      }
      if (!(mean.all > 0)) continue;
      const dvec2 before = mean.before / mean.all, after = mean.after / mean.all;
      const std::array<double, 4> values = {before.x, before.y, after.x, after.y};
      for (size_t i = 0; i < 4; ++i) (*planes[i])(x, y) = static_cast<float>(values[i]);
    }
  });
}

}  // namespace brume
