#pragma once
#include <algorithm>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "render/scene/light_groups.h"
#include "render/world/environment.h"
#include "render/world/field_cones.h"
#include "render/world/field_light.h"
#include "render/world/light_kinds.h"
#include "render/world/light_tree.h"

namespace brume {

/// Lights that next-event estimation chooses among, by their importance at the vertex. Among fields alone it often
/// chooses none where directions find them well.
class LightChoice {
 public:
  LightChoice() = default;
  explicit LightChoice(std::vector<const Light*> lights);

  const std::vector<const Light*>& lights() const { return lights_; }
  size_t count() const { return lights_.size(); }
  /// A direction to one of them, its pdf including the probability of choosing that one from p.
  LightSample sample(const dvec3& p, double choice, const dvec2& u) const;
  /// Probability that sample() picks the light from p; 0 for one that is never picked.
  double probability(const Light& light, const dvec3& p) const;
  /// That of each of some lights. @param out  room for as many
  void probabilities(std::span<const Light* const> lights, const dvec3& p, double* out) const;
  /// Sum of the importance of all of them.
  double importance(const dvec3& p) const;
  /// Samples fields from nearer by, where there is no other light, which their samples would take away.
  void sample_fields_nearer(bool nearer) { nearer_ = nearer && fields_alone_; }

 private:
  double importance_of(const Light& light, const dvec3& p) const;
  double single_total(const dvec3& p) const;
  double share_of(const Light& light, const dvec3& p, const LightTree::Cut* many, double total) const;

  std::vector<const Light*> lights_;
  std::vector<const Light*> single_;  // weighed one by one: all, but for those of the tree
  LightTree tree_;                    // of many that stand somewhere
  std::unordered_map<const Light*, size_t> number_, number_in_tree_;
  bool fields_alone_ = false;
  bool nearer_ = false;
  bool same_everywhere_ = true;  // only infinite lights: the choice does not depend on the point
  std::vector<double> share_;    // where same_everywhere_
};

/// All lights of a scene, and which of them next-event estimation aims at.
class Lights {
 public:
  Lights() = default;
  /// @param world_shift  subtracted from positions
  Lights(const Scene& scene, const dvec3& world_shift, const Task& task = {});
  /// A mesh that emits; returns its number for mesh(). @param surface  its number in the scene
  size_t add_mesh(const TriangleMesh& mesh, const dvec3& radiance, bool two_sided, size_t surface, EmissionShare share);
  /// The volumes of all fields that emit. @param volumes  numbers in the scene
  void set_emissions(const std::vector<size_t>& volumes);
  /// A field that emits; fields keep their order. One that moves or emits nothing is no light.
  /// @param media  that scatter its light
  void add_field(const EmissionField& field, std::span<const Medium> media, const Task& task = {});
  /// Whether directions aim at fields that emit, too (Plan::aims_at_fire): points of fields are sampled from nearer by
  /// then, where there is no other light.
  void aim_at_fields(bool aims) { all_choice_.sample_fields_nearer(aims); }
  /// To be called once all lights are there.
  void finish(const std::string& mode);

  /// Names of the scene's light groups, which have layers of their own; empty: it has none.
  const std::vector<std::string>& groups() const { return groups_.names; }
  /// Empty where there are no groups.
  std::string group_name(size_t group) const { return groups().empty() ? "" : groups()[group]; }
  /// The group of everything that emits in the media; nothing where it is of several.
  std::optional<size_t> group_of_all_emissions() const;
  /// The group of everything that camera rays can see; nothing where it is of several.
  std::optional<size_t> group_of_background() const;
  /// Of a field that emits, by its number.
  size_t group_of_emission(size_t field) const { return field < emission_groups_.size() ? emission_groups_[field] : 0; }

  const std::vector<const InfiniteLight*>& infinite() const { return infinite_; }
  const std::vector<const FiniteLight*>& finite() const { return finite_; }
  const MeshLight& mesh(size_t i) const { return *meshes_[i]; }
  /// Null for a field that is no light.
  const FieldLight* field(size_t i) const { return i < fields_.size() ? fields_[i] : nullptr; }
  size_t mesh_count() const { return meshes_.size(); }
  const std::vector<const Sun*>& suns() const { return suns_; }
  const std::vector<const PointLight*>& points() const { return points_; }
  /// Calls visit(light) for all but the environment, each as the kind that it is.
  template <class Visit>
  void each_sharp(const Visit& visit) const {
    for (const Sun* sun : suns_) visit(*sun);
    for (const FiniteLight* light : finite_) visit(*light);
    for (const PointLight* light : points_) visit(*light);
    for (const MeshLight* light : meshes_) visit(*light);
  }
  /// Null where the scene has none.
  const Environment* environment() const { return environment_; }
  /// Whether lights stand somewhere.
  bool all_solid() const {
    return std::all_of(finite_.begin(), finite_.end(), [](const FiniteLight* light) { return light->solid(); });
  }
  /// Whether all rays of a cone that never scattered and meet nothing see the same.
  bool uniform_background(const RayCone& rays) const {
    return finite_.empty() && std::all_of(infinite_.begin(), infinite_.end(), [&](const InfiniteLight* light) {
             return !light->visible() || light->uniform(rays);
           });
  }
  bool local() const { return !finite_.empty() || !points_.empty() || !meshes_.empty(); }
  /// The light that a ray meets before t_max, and where; null for none.
  /// @param seen   only lights that rays see which never scattered
  /// @param t_min  those up to there are behind it
  std::pair<const FiniteLight*, double> nearest(const Ray& ray, double t_max, bool seen, double t_min = 0) const;
  /// Whether a solid light is in the way of a sample of another one.
  bool blocked(const Ray& shadow, double distance, const Light* from) const;

  /// Whether anything shines.
  bool any() const;
  bool any_sampled() const { return all_choice_.count() > 0; }
  bool any_delta() const;
  /// What a vertex chooses among. @param fields  whether it samples fields that emit
  const LightChoice& choice(bool fields = true) const { return fields ? all_choice_ : choice_without_fields_; }
  /// Whether smoke scatters the light of fields, so that field_cones() has any.
  bool any_scattered_field() const;
  /// Directions from a point to fields that emit. @param normal  of a surface that scatters to one side; 0: to all
  FieldCones field_cones(const dvec3& p, const dvec3& normal = dvec3(0)) const;
  /// A sample of the choice without radiance where another finite light is in the way.
  LightSample sample_visible(const dvec3& p, double choice, const dvec2& u, bool fields) const;
  /// Lights of no power, and what the environment has to say.
  std::vector<std::string> notes() const;

 private:
  /// Calls visit(light) for the finite lights that a ray may meet before t_max.
  template <class Visit>
  void finite_along(const Ray& ray, double t_max, const Visit& visit) const {
    if (finite_tree_.empty())
      for (const FiniteLight* light : finite_) visit(*light);
    else
      finite_tree_.along(ray, t_max, [&](size_t number) { visit(*finite_[number]); });
  }

  LightGroups groups_;
  std::vector<size_t> emission_groups_;
  std::vector<std::unique_ptr<Light>> all_;  // the environment first, black or not
  std::vector<const InfiniteLight*> infinite_;
  std::vector<const FiniteLight*> finite_;
  LightTree finite_tree_;  // where they are many
  std::vector<const MeshLight*> meshes_;
  std::vector<const FieldLight*> fields_;
  std::vector<const Sun*> suns_;
  std::vector<const PointLight*> points_;
  const Environment* environment_ = nullptr;
  LightChoice all_choice_, choice_without_fields_;
};

}  // namespace brume
