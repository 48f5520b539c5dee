#include "render/world/lights.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "render/world/atmosphere_sky.h"
#include "render/world/everywhere.h"
#include "render/world/sky.h"

namespace brume {
namespace {

// Importance is zero at one point only by accident, at two only for want of power.
bool shines(const Light& light) {
  return light.importance(dvec3(0)) > 0 || light.importance(dvec3(1, 2, 3)) > 0;
}

/// What weighs a field where there are no other lights, which its samples would take away: directions have to find it
/// from half as far away as FieldLight::seldom_found() tells. There far = q / (q + kNear), here q / (q + kNear / 4).
double importance_alone(const FieldLight& field, const dvec3& p) {
  const double far = std::sqrt(0.5 * field.seldom_found(p)), nearer = 4 * far / (1 + 3 * far);
  return field.irradiance(p) * std::min(1.0, 2 * nearer * nearer);
}

}  // namespace

LightChoice::LightChoice(std::vector<const Light*> lights) : lights_(std::move(lights)) {
  std::vector<const Light*> standing;
  for (size_t i = 0; i < lights_.size(); ++i) {
    number_[lights_[i]] = i;
    (lights_[i]->place() ? standing : single_).push_back(lights_[i]);
  }
  if (standing.size() > LightTree::kFew) {
    for (size_t i = 0; i < standing.size(); ++i) number_in_tree_[standing[i]] = i;
    tree_ = LightTree(std::move(standing));
  } else {
    single_ = lights_;
  }
  for (const Light* light : lights_)
    same_everywhere_ = same_everywhere_ && dynamic_cast<const InfiniteLight*>(light) != nullptr;
  fields_alone_ = !lights_.empty() && std::all_of(lights_.begin(), lights_.end(), [](const Light* light) {
    return dynamic_cast<const FieldLight*>(light) != nullptr;
  });
  if (!same_everywhere_) return;
  double total = 0;
  for (const Light* light : lights_) total += light->importance(dvec3(0));
  for (const Light* light : lights_) share_.push_back(light->importance(dvec3(0)) / total);
}

LightSample LightChoice::sample(const dvec3& p, double choice, const dvec2& u) const {
  if (lights_.empty()) return {};
  size_t i = 0;
  double share = 1;
  const Light* light = nullptr;
  if (same_everywhere_) {
    while (i + 1 < share_.size() && choice >= share_[i]) choice -= share_[i++];
    share = share_[i];
    light = single_[i];
  } else {
    const LightTree::Cut* const many = tree_.empty() ? nullptr : &tree_.cut(p);
    const double total = single_total(p) + (many ? many->importance : 0);
    double left = choice * total, importance = 0;
    for (; i < single_.size(); ++i) {
      importance = importance_of(*single_[i], p);
      if (left < importance) break;
      if (i + 1 == single_.size() && !many) {
        if (fields_alone_) return {};
        break;
      }
      left -= importance;
    }
    if (i < single_.size()) {
      share = importance / total;
      light = single_[i];
    } else {
      std::tie(light, share) = tree_.pick(*many, p, std::min(left / many->importance, 1 - 1e-12));
      share *= many->importance / total;
    }
  }
  LightSample s = light->sample(p, u);
  s.pdf *= share;
  s.light = light;
  s.index = tree_.empty() ? i : number_.at(light);
  return s;
}

double LightChoice::probability(const Light& light, const dvec3& p) const {
  double probability = 0;
  const Light* const one = &light;
  probabilities({&one, 1}, p, &probability);
  return probability;
}

void LightChoice::probabilities(std::span<const Light* const> lights, const dvec3& p, double* out) const {
  const LightTree::Cut* const many = same_everywhere_ || tree_.empty() ? nullptr : &tree_.cut(p);
  const double total = same_everywhere_ ? 0 : single_total(p) + (many ? many->importance : 0);
  for (size_t i = 0; i < lights.size(); ++i) out[i] = share_of(*lights[i], p, many, total);
}

/// @param total  of the importance of all lights from p; not asked for where the choice is the same everywhere
double LightChoice::share_of(const Light& light, const dvec3& p, const LightTree::Cut* many, double total) const {
  const auto found = number_.find(&light);
  if (found == number_.end()) return 0;
  if (same_everywhere_) return share_[found->second];
  if (!(total > 0)) return 0;
  const auto in_tree = number_in_tree_.find(&light);
  if (in_tree == number_in_tree_.end()) return importance_of(light, p) / total;
  return many->importance / total * tree_.probability(*many, p, in_tree->second);
}

double LightChoice::importance(const dvec3& p) const {
  return single_total(p) + (tree_.empty() ? 0.0 : tree_.cut(p).importance);
}

double LightChoice::importance_of(const Light& light, const dvec3& p) const {
  return nearer_ ? importance_alone(static_cast<const FieldLight&>(light), p) : light.importance(p);
}

double LightChoice::single_total(const dvec3& p) const {
  double total = 0;
  for (const Light* light : single_)
    total += fields_alone_ ? static_cast<const FieldLight*>(light)->irradiance(p) : light->importance(p);
  return total;
}

Lights::Lights(const Scene& scene, const dvec3& world_shift, const Task& task) : groups_(light_groups_of(scene)) {
  const dvec3 from_infinity = light_from_infinity(scene);
  EnvironmentSettings around = scene.environment;
  around.radiance *= from_infinity;
  std::vector<LightSettings> settings = scene.lights;
  const WorkingSpace space(scene.film.color_space);
  std::unique_ptr<Environment> environment;
  if (around.sky == "atmosphere") {
    const AtmosphereSky sky(scene, task);
    environment = std::make_unique<Environment>(around, sky.picture(), space);
    if (around.sky_sun && max_component(sky.sun().irradiance) > 0) settings.push_back(sky.sun());
  } else {
    environment = std::make_unique<Environment>(around, space, task);
  }
  environment_ = environment.get();
  if (!environment->black()) infinite_.push_back(environment_);
  all_.push_back(std::move(environment));
  if (scene.environment.sky == "preetham" && scene.environment.sky_sun)
    settings.push_back(preetham_sun(scene.environment, space));
  all_.back()->group = groups_.environment;
  for (size_t i = 0; i < settings.size(); ++i) {
    LightSettings& s = settings[i];
    if (s.type == "sun") {
      s.irradiance *= from_infinity;
      if (s.irradiance == dvec3(0)) continue;
      auto light = std::make_unique<Sun>(s);
      suns_.push_back(light.get());
      infinite_.push_back(light.get());
      all_.push_back(std::move(light));
    } else if (s.type == "sphere" || s.type == "rectangle") {
      std::unique_ptr<FiniteLight> light;
      if (s.type == "sphere")
        light = std::make_unique<SphereLight>(s, world_shift);
      else
        light = std::make_unique<RectangleLight>(s, world_shift);
      finite_.push_back(light.get());
      all_.push_back(std::move(light));
    } else {
      auto light = std::make_unique<PointLight>(s, world_shift);
      points_.push_back(light.get());
      all_.push_back(std::move(light));
    }
    // What a sky brings is of its group.
    all_.back()->group = i < groups_.lights.size() ? groups_.lights[i] : groups_.environment;
  }
}

size_t Lights::add_mesh(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided, size_t surface,
                        EmissionShare share) {
  auto light = std::make_unique<MeshLight>(mesh, radiance, two_sided, std::move(share));
  if (!groups().empty()) light->group = groups_.surfaces[surface];
  meshes_.push_back(light.get());
  all_.push_back(std::move(light));
  return meshes_.size() - 1;
}

void Lights::set_emissions(const std::vector<size_t>& volumes) {
  for (const size_t volume : volumes) emission_groups_.push_back(groups().empty() ? 0 : groups_.volumes[volume]);
}

void Lights::add_field(const EmissionField& field, std::span<const Medium> media, const Task& task) {
  fields_.push_back(nullptr);
  if (!FieldLight::fits(field)) return;
  auto light = std::make_unique<FieldLight>(field, media, task);
  if (!shines(*light)) return;
  light->group = group_of_emission(fields_.size() - 1);
  fields_.back() = light.get();
  all_.push_back(std::move(light));
}

std::optional<size_t> Lights::group_of_all_emissions() const {
  const auto& all = emission_groups_;
  if (all.empty() || std::any_of(all.begin(), all.end(), [&](size_t group) { return group != all[0]; })) return {};
  return all[0];
}

std::optional<size_t> Lights::group_of_background() const {
  std::set<size_t> seen;
  for (const InfiniteLight* light : infinite_)
    if (light->visible()) seen.insert(light->group);
  for (const FiniteLight* light : finite_)
    if (light->visible()) seen.insert(light->group);
  for (const MeshLight* light : meshes_) seen.insert(light->group);
  return seen.size() == 1 ? std::optional(*seen.begin()) : std::nullopt;
}

void Lights::finish(const std::string& mode) {
  if (finite_.size() > LightTree::kFew) finite_tree_ = LightTree({finite_.begin(), finite_.end()});
  if (mode == "none") return;
  std::vector<const Light*> sampled;
  for (const auto& light : all_) {
    const bool sky = light.get() == environment_;
    // Phase sampling finds a constant sky without noise; a shadow ray per event would only cost.
    if (sky && (environment_->black() || (environment_->constant() && mode != "all"))) continue;
    if (shines(*light)) sampled.push_back(light.get());
  }
  all_choice_ = LightChoice(sampled);
  std::erase_if(sampled, [](const Light* light) { return dynamic_cast<const FieldLight*>(light) != nullptr; });
  choice_without_fields_ = LightChoice(std::move(sampled));
}

bool Lights::any_scattered_field() const {
  return std::any_of(fields_.begin(), fields_.end(),
                     [](const FieldLight* field) { return field && field->balls().scatter(); });
}

FieldCones Lights::field_cones(const dvec3& p, const dvec3& normal) const {
  FieldCones cones;
  for (const FieldLight* field : fields_)
    if (field) field->balls().add_cones(p, normal, cones);
  if (cones.empty()) return cones;
  double others = choice_without_fields_.importance(p);
  if (environment_->constant()) others += environment_->importance(p);
  cones.finish(others);
  return cones;
}

bool Lights::any_delta() const {
  return std::any_of(all_.begin(), all_.end(), [](const auto& light) { return light->delta(); });
}

LightSample Lights::sample_visible(const dvec3& p, double choice, const dvec2& u, bool fields) const {
  LightSample s = this->choice(fields).sample(p, choice, u);
  if (s.pdf > 0 && blocked({p, s.wi}, s.distance, s.light)) s.radiance = dvec3(0);
  return s;
}

std::pair<const FiniteLight*, double> Lights::nearest(const Ray& ray, double t_max, bool seen, double t_min) const {
  const double behind = t_min * (1 + 1e-9);  // of the light that was met at t_min
  std::pair<const FiniteLight*, double> found{nullptr, t_max};
  finite_along(ray, t_max, [&](const FiniteLight& light) {
    if (seen && !light.visible()) return;
    const double t = light.intersect(ray);
    if (t > behind && t < found.second) found = {&light, t};
  });
  return found;
}

bool Lights::blocked(const Ray& shadow, double distance, const Light* from) const {
  bool met = false;
  finite_along(shadow, distance, [&](const FiniteLight& light) {
    if (met || &light == from || !light.solid()) return;
    const double t = light.intersect(shadow);
    met = t > 0 && t < distance;
  });
  return met;
}

bool Lights::any() const {
  return !environment_->black() ||
         std::any_of(all_.begin() + 1, all_.end(), [](const auto& light) { return shines(*light); });
}

std::vector<std::string> Lights::notes() const {
  std::vector<std::string> notes = environment_->notes();
  for (size_t i = 1; i < all_.size(); ++i)
    if (!shines(*all_[i])) notes.push_back(fmt::format("light {} has no power: it lights nothing", i - 1));
  return notes;
}

}  // namespace brume
