#include "tests/support/reference_tracer.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "render/transport/path_layers.h"
#include "volume/gradient.h"

namespace brume::test {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

/// Weight of a sample drawn with density `own` that another technique draws with density `other` (Veach 1997).
double balance(double own, double other) {
  return own / (own + other);
}

/// Scattering at a vertex: of a direction, its value (of a surface: times the cosine) and the density of drawing it.
using Scattering = std::function<std::pair<dvec3, double>(const dvec3& wi)>;

class Tracer {
 public:
  Tracer(const PathContext& scene, const PathRequest& request)
      : scene_(scene),
        lights_(*scene.lights),
        rng_(request.key),
        time_(request.time),
        ray_(request.ray),
        eye_(request.ray.o) {
    std::vector<Medium> all;
    for (const Medium& m : scene.media)
      if (m.instances())
        for (size_t i = 0; i < m.instances()->size(); ++i) all.push_back(m.instance(i));
      else
        all.push_back(m);
    for (const Medium& m : all) {
      media_.push_back(m.at_time(request.time));
      spheres_.push_back(media_.back().bounding_sphere());
      sigma_maj_ += m.extinction_per_density() * m.maximum_density();
    }
    for (const EmissionField& e : scene.emissions) emissions_.push_back(e.at_time(request.time));
    hero_ = std::min(2, static_cast<int>(3 * rng_.uniform()));
  }

  PathSample trace() {
    if (scene_.plan.isosurface) meet_isosurface();
    if (scene_.plan.marched()) march();
    while (step()) {
    }
    LimitedLight limited;
    limit_indirect(scene_.indirect_limit, s_.indirect, limited);
    (first_on_surface_ ? s_.surface_indirect : s_.volume_indirect) = s_.indirect;
    s_.beauty = s_.direct + s_.indirect;
    s_.flash = s_.direct + scene_.flash.intensity * lamp_;
    return s_;
  }

 private:
  /// The nearest isosurface of all media counts.
  void meet_isosurface() {
    double nearest = kFar;
    for (const Medium& m : media_) {
      if (m.holdout()) continue;
      const Ray local = m.to_local(ray_);
      const auto t = find_isosurface(m, local, static_cast<float>(scene_.isosurface_density * m.maximum_density()));
      if (!t || !(*t < nearest)) continue;
      nearest = *t;
      s_.coverage = 1;
      s_.gradient = isosurface_gradient(m, local, *t).value_or(dvec3(0));
    }
  }

  /// Optical depth, and the gradient at each medium's first collision, as if the others were not there.
  void march() {
    for (const Medium& m : media_) s_.optical_depth += optical_depth(m, m.to_local(ray_), kFar);
    s_.optical_depth = std::min(s_.optical_depth, kDeepest);
    std::vector<const Medium*> collided;
    for (TentativeCollision c = first_collision(ray_, kFar); next(ray_, c);) {
      if (std::find(collided.begin(), collided.end(), c.medium) != collided.end()) continue;
      if (!(rng_.uniform() < max_component(c.real))) continue;
      collided.push_back(c.medium);
      if (const auto g = density_gradient(*c.medium, c.medium->to_local(ray_.at(c.t))))
        s_.gradient_transmittance_weighted += glm::normalize(*g);
    }
  }

  /// One flight and the event at its end; false when the path has ended.
  bool step() {
    auto [light, t_max] = lights_.nearest(from_vertex(), kFar, events_ == 0, passed_);
    t_max -= passed_;
    std::optional<SurfaceHit> hit;
    if (scene_.surfaces) hit = scene_.surfaces->intersect(ray_, t_max, time_, events_ == 0);
    if (hit) t_max = hit->t;

    TentativeCollision c = first_collision(ray_, t_max);
    for (double before = 0;; before = c.t) {
      const bool found = next(ray_, c);
      emit(before, found ? c.t : t_max);
      if (!found) break;
      // The hero channel decides; every channel keeps the probability of the same choice.
      const bool real = rng_.uniform() < c.real[hero_];
      event(real ? c.real : 1.0 - c.real);
      if (real) return scatter(*c.medium, c.t);
    }
    if (hit) return meet_surface(*hit);
    const Ray whole = from_vertex();
    if (light) {
      const double t = passed_ + t_max;
      find_light(light->radiance(whole, t), lights_.choice(false).probability(*light, whole.o) * light->pdf(whole, t),
                 light->solid() ? s_.background : s_.surface);
      if (!light->solid()) {  // its light is added, and the ray goes on
        passed_ = t;
        ray_.o = whole.at(t);
        return true;
      }
    } else {
      for (const InfiniteLight* sky : lights_.infinite())
        if (events_ > 0 || sky->visible())
          find_light(sky->radiance(ray_.d), lights_.choice(false).probability(*sky, whole.o) * sky->pdf(ray_.d),
                     s_.background);
    }
    if (events_ == 0) s_.transmittance = weight_;
    return false;
  }
  /// The ray from its last vertex on, which lies passed_ before it.
  Ray from_vertex() const { return {ray_.o - passed_ * ray_.d, ray_.d}; }

  // ---- tentative collisions: a Poisson process whose rate bounds the extinction of all media together

  struct TentativeCollision {
    double t = 0, end = 0;  ///< ray parameters: of the collision, and where the ray has left all media
    const Medium* medium = nullptr;
    dvec3 real{0};  ///< probability, for each channel, that it is a real one
  };
  TentativeCollision first_collision(const Ray& ray, double t_max) const {
    TentativeCollision c{t_max, 0};
    for (const Medium::Sphere& s : spheres_) {
      const double middle = glm::dot(s.centre - ray.o, ray.d), off = glm::distance(ray.at(middle), s.centre);
      if (!(off < s.radius)) continue;
      const double half = std::sqrt((s.radius - off) * (s.radius + off));
      c.t = std::min(c.t, std::max(0.0, middle - half));
      c.end = std::max(c.end, std::min(t_max, middle + half));
    }
    return c;
  }
  bool next(const Ray& ray, TentativeCollision& c) {
    if (!(c.t < c.end)) return false;
    c.t += rng_.exponential() / sigma_maj_;
    if (!(c.t < c.end)) return false;
    double choice = rng_.uniform() * sigma_maj_;
    for (const Medium& m : media_) {
      c.medium = &m;
      choice -= m.extinction_per_density() * m.maximum_density();
      if (choice < 0) break;
    }
    const Medium& m = *c.medium;
    c.real = m.extinction_ratio() * std::min(1.0, m.density(m.to_local(ray.at(c.t))) / m.maximum_density());
    return true;
  }
  /// Multiplies the path's weight by what a choice left to each channel, divided by the mean over the channels of the
  /// probabilities of all choices so far: the balance heuristic over the choice of the hero.
  void event(const dvec3& factor) {
    weight_ *= factor;
    pdf_ *= factor;
    const double m = (pdf_.x + pdf_.y + pdf_.z) / 3;
    weight_ /= m;
    pdf_ /= m;
  }
  /// Ratio tracking.
  dvec3 transmittance(const Ray& ray, double t_max) {
    dvec3 product(1);
    TentativeCollision c = first_collision(ray, t_max);
    while (product != dvec3(0) && next(ray, c)) product *= 1.0 - c.real;
    return product;
  }

  // ---- light

  /// Adds light found after `events` events.
  void deposit(const dvec3& L, uint64_t events, dvec3& unscattered) {
    if (events >= 2) {
      s_.indirect += L;
      return;
    }
    s_.direct += L;
    (events == 0 ? unscattered : first_on_surface_ ? s_.surface : s_.single) += L;
  }
  /// Light that the path has run into. @param pdf_light  of light sampling at the last vertex; 0 where it never aims
  void find_light(const dvec3& radiance, double pdf_light, dvec3& unscattered) {
    if (straight_ && pdf_light > 0) return;  // found by light sampling, straight through glass
    const bool one_technique = events_ == 0 || specular_ || !(pdf_light > 0);
    deposit(weight_ * radiance * (one_technique ? 1.0 : balance(pdf_direction_, pdf_light)), events_, unscattered);
  }
  /// What fields emit between two points of the flight: one point in each stratum of a voxel's length at most.
  void emit(double t0, double t1) {
    for (const EmissionField& field : emissions_) {
      const Medium::Sphere s = field.bounding_sphere();
      const double middle = glm::dot(s.centre - ray_.o, ray_.d);
      const double from = std::max(t0, middle - s.radius), to = std::min(t1, middle + s.radius);
      if (!(from < to)) continue;
      const int count = static_cast<int>(std::ceil((to - from) / std::max(field.shape().voxel_size(), s.radius / 64)));
      const double width = (to - from) / count;
      for (int i = 0; i < count; ++i)
        deposit(weight_ * field.coefficient(ray_.at(from + (i + rng_.uniform()) * width)) * width, events_,
                s_.emission);
    }
  }
  /// Next-event estimation at a vertex. @param from  the surface it lies on; null in a medium
  dvec3 sampled_light(const dvec3& p, double choice, const dvec2& u, const Scattering& scattering,
                      const SurfaceHit* from, bool shadowed = true, bool only_technique = false) {
    const LightSample light = lights_.choice(only_technique).sample(p, choice, u);
    if (!(light.pdf > 0)) return dvec3(0);
    const auto [value, pdf] = scattering(light.wi);
    const Ray shadow{from ? Surfaces::leave(*from, p, light.wi) : p, light.wi};
    const dvec3 L = weight_ * value * light.radiance / light.pdf;
    double mis = light.delta || only_technique ? 1.0 : balance(light.pdf, pdf);
    if (L == dvec3(0) || !shadowed) return L * mis;
    if (lights_.blocked(shadow, light.distance, light.light)) return dvec3(0);
    Surfaces::Passage passage;
    if (scene_.surfaces) passage = scene_.surfaces->passage(shadow, light.distance * (1 - 1e-4), time_);
    if (passage.light == dvec3(0)) return dvec3(0);
    if (passage.straight) mis = 1;  // no direction sampling finds light straight through glass
    return L * mis * passage.light * transmittance(shadow, light.distance);
  }

  // ---- events

  /// Russian roulette and the cap on events; false where the path ends.
  bool survives() {
    if (events_ + 1 >= static_cast<uint64_t>(scene_.roulette_start)) {
      const double chance = std::clamp(max_component(weight_), 0.05, 1.0);
      if (!(rng_.uniform() < chance)) return false;
      weight_ /= chance;
    }
    return events_ + 1 < static_cast<uint64_t>(scene_.max_events);
  }

  bool scatter(const Medium& medium, double t) {
    if (events_ == 0 && medium.holdout()) {
      s_.transmittance = weight_;
      return false;
    }
    ray_.o = ray_.at(t);
    passed_ = 0;
    const dvec3 albedo = medium.albedo(ray_.o), d = ray_.d;
    if (events_ == 0) lamp_ = record_first_scatter(scene_, media_, medium, eye_, ray_.o, d, weight_, albedo, s_);
    weight_ *= albedo;
    const Scattering phase = [&](const dvec3& wi) {
      const double p = medium.phase().value(glm::dot(d, wi));
      return std::pair(dvec3(p), p);
    };
    if (lights_.any_sampled())
      deposit(sampled_light(ray_.o, rng_.uniform(), pair(), phase, nullptr), events_ + 1, s_.single);
    if (!survives()) return false;
    ray_.d = medium.phase().sample(d, pair());
    pdf_direction_ = phase(ray_.d).second;
    specular_ = straight_ = false;
    sampled_light_ = true;
    ++events_;
    return true;
  }

  bool meet_surface(const SurfaceHit& hit) {
    const SurfaceSettings& settings = scene_.surfaces->settings(hit.surface);
    if (events_ == 0 && settings.role == "holdout") {
      s_.transmittance = weight_;
      return false;
    }
    const dvec3 p = ray_.at(hit.t), wo = -ray_.d;
    const bool front = glm::dot(wo, hit.normal) > 0;
    const Bsdf bsdf = scene_.surfaces->bsdf(hit);
    // The shading normal gives the angles, the geometric one the side: directions on which they differ carry nothing.
    const dvec3 outside = front ? hit.normal : -hit.normal, smooth = front ? hit.shading : -hit.shading;
    const Frame frame(glm::dot(wo, smooth) > 1e-4 ? smooth : outside);
    const auto to_local = [&](const dvec3& w) { return w * dmat3(frame.x, frame.y, frame.z); };
    const auto leaks = [&](const dvec3& wi) { return glm::dot(wi, outside) * to_local(wi).z < 0; };
    const Scattering scattering = [&](const dvec3& wi) {
      if (leaks(wi)) return std::pair(dvec3(0), 0.0);
      return std::pair(bsdf.value(to_local(wo), to_local(wi), !front), bsdf.pdf(to_local(wo), to_local(wi), !front));
    };
    if (events_ == 0 && settings.role == "shadow_catcher") {
      const double choice = rng_.uniform();
      const dvec2 u = pair();
      const dvec3 off = Surfaces::leave(hit, p, wo);
      s_.catcher += sampled_light(off, choice, u, scattering, nullptr, true, true);
      s_.catcher_unshadowed += sampled_light(off, choice, u, scattering, nullptr, false, true);
      ray_.o = Surfaces::leave(hit, p, ray_.d);  // unseen itself
      passed_ = 0;
      return true;
    }
    if ((front || settings.two_sided) && settings.radiance != dvec3(0)) {
      const dvec3 before = s_.surface;
      const MeshLight& light = lights_.mesh(scene_.surfaces->light_of(hit.surface));
      find_light(scene_.surfaces->emitted(hit, front),
                 lights_.choice(false).probability(light, from_vertex().o) *
                     light.pdf(passed_ + hit.t, glm::dot(wo, hit.normal)),
                 s_.surface);
      if (events_ == 0) s_.surface_emission = s_.surface - before;
    }
    if (events_ == 0) {
      first_on_surface_ = true;
      s_.albedo = s_.surface_albedo = bsdf.albedo + bsdf.passed;
      s_.surface_share = 1;
      s_.normal = frame.z;
      s_.depth = glm::distance(eye_, p);
      s_.position = p + scene_.world_shift;
    }
    if (lights_.any_sampled() && !bsdf.delta())
      deposit(sampled_light(p, rng_.uniform(), pair(), scattering, &hit), events_ + 1, s_.surface);
    if (!survives()) return false;
    Bsdf::Sample out;
    if (!bsdf.sample(to_local(wo), !front, {rng_.uniform(), rng_.uniform(), rng_.uniform()}, out)) return false;
    ray_.d = glm::normalize(frame.to_world(out.wi));
    weight_ *= out.weight;
    if (weight_ == dvec3(0) || leaks(ray_.d)) return false;
    ray_.o = Surfaces::leave(hit, p, ray_.d);
    passed_ = 0;
    pdf_direction_ = out.pdf;
    specular_ = bsdf.delta();
    straight_ = sampled_light_ && settings.shadow == "straight" && out.transmitted;
    sampled_light_ = !specular_ || straight_;
    ++events_;
    return true;
  }
  dvec2 pair() {
    const double x = rng_.uniform();
    return {x, rng_.uniform()};
  }

  const PathContext& scene_;
  const Lights& lights_;
  Rng rng_;
  std::vector<Medium> media_;  // at the path's time, as the fields
  std::vector<EmissionField> emissions_;
  std::vector<Medium::Sphere> spheres_;  // around the media
  double sigma_maj_ = 0;
  double time_;  // of the shutter
  Ray ray_;
  double passed_ = 0;  // from the last vertex to the light that the ray passed and goes on from
  dvec3 eye_;
  dvec3 weight_{1}, pdf_{1};  // of each channel; the mean of pdf_ is kept at 1
  int hero_ = 0;
  uint64_t events_ = 0;  // scatterings and bounces so far
  double pdf_direction_ = 1;
  bool specular_ = false;       // the last vertex was a mirror or clear glass
  bool sampled_light_ = false;  // light sampling reaches the last vertex, at most straight through glass
  bool straight_ = false;       // since then the path has gone straight through glass
  bool first_on_surface_ = false;
  dvec3 lamp_{0};  // of the flash image
  PathSample s_;
};

}  // namespace

PathSample reference_path(const PathContext& scene, const PathRequest& request) {
  return Tracer(scene, request).trace();
}

}  // namespace brume::test
