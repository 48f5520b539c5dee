#include "render/world/media.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

#include "base/error.h"
#include "image/color_space.h"
#include "render/world/everywhere.h"
#include "render/world/volume_checks.h"
#include "render/world/volume_fields.h"
#include "render/world/volume_places.h"
#include "volume/array_volume.h"
#include "volume/detail_flow.h"
#include "volume/volume_grids.h"

namespace brume {

struct SceneMedia::Volume {
  ScalarField density, temperature, flame;
  VectorField colour;
  Displacement displacement, temperature_displacement, flame_displacement;
  DetailFlow flow;
};

namespace {

PhaseFunction phase_of(const VolumeSettings& v) {
  if (v.phase == "two_lobes") return PhaseFunction::two_lobes(v.g, v.g2, v.lobe_weight);
  if (v.phase == "draine") return PhaseFunction::draine(v.g, v.draine_alpha);
  if (v.phase == "rayleigh") return PhaseFunction::draine(0, 1);
  if (v.phase == "mie") return PhaseFunction::mie(v.droplet_diameter);
  if (v.phase == "fournier_forand") return PhaseFunction::fournier_forand(v.particle_index, v.size_slope);
  return PhaseFunction::henyey_greenstein(v.g);
}

/// Whether the same fields are read for both, wherever they lie and whatever they are made of.
bool reads_the_same(const VolumeSettings& a, const VolumeSettings& b) {
  const auto read = [](const VolumeSettings& v) {
    const bool arrays = v.grids && v.grids->of_arrays();
    return std::tuple(v.shape, v.file, v.grid, v.convert_level_set, v.remap, v.max_density, v.albedo_grid,
                      v.temperature_grid, v.flame_grid, v.velocity_grid, v.velocity_scale, v.placement.voxel_size,
                      v.placement.origin, arrays ? v.grids->content : std::string(), v.albedo_file, v.temperature_file,
                      v.flame_file, v.velocity_file, v.time.between, v.moment.later ? v.moment.share : 0,
                      v.moment.frames, v.moment.rate, carries_detail(v));
  };
  const bool later = a.moment.later != nullptr;
  return read(a) == read(b) && later == (b.moment.later != nullptr) &&
         (!later || read(*a.moment.later) == read(*b.moment.later));
}

constexpr const char* kAuto = "auto";

EmissionRamp fire_ramp(const VolumeSettings& v) {
  std::vector<std::pair<double, dvec3>> stops;
  for (const auto& row : v.flame_ramp) stops.emplace_back(row[0], dvec3(row[1], row[2], row[3]));
  if (stops.empty())
    stops = {{0.0, dvec3(0)}, {0.3, {0.3, 0.02, 0.0}}, {0.65, {1.0, 0.25, 0.03}}, {1.0, {1.0, 0.8, 0.4}}};
  return EmissionRamp::of_colours(stops, v.flame_intensity);
}

}  // namespace

/// One volume of a scene on its way from its settings to media and emissions.
class SceneMedia::Loader {
 public:
  Loader(SceneMedia& into, const VolumePlaces& places, size_t i, const Task& task)
      : into_(into),
        v_(places.world.volumes[i]),
        places_(places.instances[i]),
        lists_(places.lists[i]),
        number_(places.volume[i]),
        scene_(places.world),
        task_(task),
        file_(v_.file.empty() ? fmt::format("volumes.{}", number_) : v_.file.filename().string()),
        named_(v_.file.empty() ? file_ : v_.file.string()),
        moves_(v_.object_to_world_end != dmat4(0.0)),
        shutter_opens_(scene_.camera.shutter.y > scene_.camera.shutter.x),
        fields_(v_, (shutter_opens_ && v_.velocity_grid != "none") || carries_detail(v_), into.notes_, task) {}

  void load() {
    check_transform(v_.object_to_world, "object_to_world");
    if (moves_) check_transform(v_.object_to_world_end, "object_to_world_end");
    if (moves_ && !shutter_opens_)
      note("a volume moves but camera.shutter opens and closes at once: it is rendered where it starts");
    const std::vector<VolumeSettings>& all = scene_.volumes;
    const size_t own = into_.volumes_.size();
    const auto same = std::find_if(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(own),
                                   [&](const VolumeSettings& other) { return reads_the_same(other, v_); });
    into_.volumes_.push_back(nullptr);
    if (v_.shape != "grid") {
      load_shape();
      return;
    }
    fresh_ = &*same == &v_;
    into_.volumes_[own] = fresh_ ? std::make_shared<Volume>() : into_.volumes_[static_cast<size_t>(same - all.begin())];
    volume_ = into_.volumes_[own].get();
    load_density();
    if (v_.temperature_grid != "none") load_temperature();
    if (v_.flame_grid != "none") load_flame();
    // Last: what bounds moving fields reads them in the cells they were loaded in.
    if (fresh_)
      for (ScalarField* field : {&volume_->density, &volume_->temperature, &volume_->flame})
        field->bricks = field->bricks.recut(cell_size_for(field->bricks), task_);
    check_flights();
    check_range(volume_->density, named_);
  }

 private:
  void note(const std::string& text) { into_.notes_.push_back(text); }
  void adopt(std::vector<std::string>& notes) {
    into_.notes_.insert(into_.notes_.end(), notes.begin(), notes.end());
    notes.clear();
  }
  /// The scene's; where millions of cells share a few bricks, wider ones, so that their flat index stays small, too.
  int cell_size_for(const BrickGrid& grid) const {
    constexpr uint64_t kMany = 1 << 22, kPerBrick = 1 << 13;
    constexpr int kWide = 16;
    uint64_t cells = 0;
    grid.each_distinct_cell([&](const BrickGrid::Cell&, uint64_t count) { cells += count; });
    const bool shared = cells >= kMany && cells >= kPerBrick * grid.brick_count();
    return shared ? std::max(kWide, scene_.render.cell_size) : scene_.render.cell_size;
  }
  bool of_arrays() const { return v_.grids && v_.grids->of_arrays(); }
  /// Unless an earlier volume did. Arrays lie where the scene says, files' grids where the file does.
  template <class Field, class Read>
  void read_into(Field& field, const Read& read) {
    if (!fresh_) return;
    field = read();
    adopt(field.notes);
    if (!of_arrays()) return;
    field.world_from_index = translation(v_.placement.origin);
    for (int a = 0; a < 3; ++a) field.world_from_index[a][a] = v_.placement.voxel_size[a];
  }
  void count(const std::string& name, size_t bytes) {
    if (fresh_ && bytes > 0) into_.parts_.push_back({file_ + ": " + name, bytes});
  }

  /// The first volume's middle becomes the world's origin.
  void shift_world_to(const dvec3& middle) {
    if (into_.shifted_) return;
    into_.shifted_ = true;
    into_.world_shift_ = middle;
  }
  /// Where the volume stands, or its first instance.
  dmat4 first_place() const {
    return places_.matrices.empty() ? v_.object_to_world : places_.matrices[0] * v_.object_to_world;
  }
  dmat4 world_from_object() const { return translation(-into_.world_shift_) * v_.object_to_world; }
  /// @param from_index  of a field's lattice, to the object's space
  dmat4 world_from(const dmat4& from_index) const {
    return world_from_object() * from_index * translation(v_.index_offset);
  }

  void load_shape() {
    HomogeneousShape shape{v_.shape == "sphere" ? HomogeneousShape::Shape::kSphere : HomogeneousShape::Shape::kBox,
                           v_.lo, v_.hi};
    dmat4 object_from_local(1);
    if (is_everywhere(v_)) {
      const EverywhereBox box = everywhere_box(scene_, v_);
      shape.lo = box.lo, shape.hi = box.hi;
    }
    if (v_.shape == "layer") {
      const LayerPlace place = layer_place(scene_, v_);
      shape.lo = place.box.lo, shape.hi = place.box.hi;
      shape.falloff = place.falloff;
      object_from_local = place.object_from_local;
    }
    shift_world_to(dvec3(first_place() * object_from_local * glm::dvec4(0.5 * (shape.lo + shape.hi), 1.0)));
    Medium medium(shape, world_from_object() * object_from_local, {v_.sigma_t, v_.albedo}, phase_of(v_));
    if (moves_ && shutter_opens_)
      medium.set_motion(translation(-into_.world_shift_) * v_.object_to_world_end * object_from_local);
    if (v_.emission != dvec3(0) && !is_holdout(v_)) into_.emissions_.emplace_back(medium, v_.emission);
    if (medium.extinction_per_density() > 0) add_medium(medium, object_from_local);
  }

  /// @param object_from_local  of the medium's coordinates
  void add_medium(Medium& medium, const dmat4& object_from_local) {
    Origin origin{number_, lists_};
    if (!places_.matrices.empty()) {
      origin.instances.clear();
      std::vector<Instance> all;
      all.reserve(places_.matrices.size());
      for (size_t k = 0; k < places_.matrices.size(); ++k) {
        if (!(places_.densities[k] > 0)) continue;
        const dmat4 world_from_local =
            translation(-into_.world_shift_) * places_.matrices[k] * v_.object_to_world * object_from_local;
        all.push_back({Placement(world_from_local).to_local(), places_.densities[k], places_.tints[k]});
        origin.instances.push_back(lists_[k]);
      }
      if (all.empty()) return;
      const auto [lo, hi] = medium.support();
      into_.instances_.push_back(std::make_shared<Instances>(std::move(all), lo, hi));
      medium.set_instances(*into_.instances_.back());
      into_.parts_.push_back(
          {fmt::format("{}: {} instances", file_, into_.instances_.back()->size()), into_.instances_.back()->bytes()});
    }
    medium.set_holdout(is_holdout(v_));
    into_.media_.push_back(medium);
    into_.origins_.push_back(std::move(origin));
  }

  void load_density() {
    ScalarOptions options{v_.grid};
    options.convert_level_set = v_.convert_level_set;
    for (const auto& row : v_.remap) options.remap.emplace_back(row[0], row[1]);
    options.limit = v_.max_density;
    options.paging = paging_of(v_);
    ScalarField& density = volume_->density;
    const bool unchanged =
        !options.convert_level_set && options.remap.empty() && !(options.limit > 0) && !v_.moment.later;
    read_into(density, [&] {
      if (of_arrays()) return v_.grids->density ? adjusted_density(*v_.grids->density, options, task_) : ScalarField();
      return v_.grids && v_.grids->density && unchanged ? *v_.grids->density : fields_.density(options);
    });
    count(density.summary.name, density.bricks.bytes());
    if (const BrickGrid& b = density.bricks; !b.empty()) {
      const dvec3 middle = 0.5 * (b.support_lo() + b.support_hi()) + dvec3(b.origin());
      shift_world_to(
          dvec3(first_place() * density.world_from_index * translation(v_.index_offset) * glm::dvec4(middle, 1.0)));
    }
    Medium medium(density.bricks, world_from(density.world_from_index), {v_.sigma_t, v_.albedo}, phase_of(v_));
    if (v_.albedo_grid != "none" && !medium.empty()) load_colour_into(medium);
    if (v_.velocity_grid != "none" && !shutter_opens_ && !v_.time.given && !has_detail(v_))
      note("velocity_grid is set but camera.shutter opens and closes at once: no motion blur");
    set_in_motion(medium, density, volume_->displacement);
    const Medium smooth = medium;
    if (has_detail(v_) && !medium.empty()) add_detail(medium, density);
    if (!medium.empty() && medium.extinction_per_density() > 0)
      add_medium(medium,
                 density.world_from_index * translation(v_.index_offset) * translation(dvec3(density.bricks.origin())));
    if (const double highest = density.bricks.maximum(); v_.emission != dvec3(0) && !medium.empty())
      into_.emissions_.emplace_back(smooth,
                                    EmissionRamp::of_colours({{0.0, dvec3(0)}, {highest, v_.emission * highest}}, 1.0));
  }

  /// Says before anything is rendered where flights would take very long.
  void check_flights() {
    if (into_.media_.empty()) return;
    Medium medium = into_.media_.back().thickest();
    if (medium.empty() || medium.homogeneous() || &medium.bricks() != &volume_->density.bricks) return;
    medium.set_majorants(scene_.render.majorant_scale, scene_.render.majorants == "global");
    if (const auto slow = flights_note(medium, volume_->density.summary.name, named_, number_)) note(*slow);
  }

  void load_colour_into(Medium& medium) {
    VectorField& colour = volume_->colour;
    read_into(colour, [&] { return v_.grids && v_.grids->colour ? *v_.grids->colour : fields_.colour(); });
    const auto& parts = colour.bricks.parts;
    if (v_.albedo_grid == kAuto && parts[0].empty() && parts[1].empty() && parts[2].empty()) return;
    const dmat4 to_origin = translation(dvec3(colour.bricks.parts[0].origin()));
    medium.set_colour(colour.bricks, Placement(world_from(colour.world_from_index) * to_origin));
    count("albedo colour", colour.bricks.bytes());
  }

  /// Noise that follows the velocity, where there is one.
  void add_detail(Medium& medium, const ScalarField& density) {
    const VolumeDetail& d = v_.detail;
    const auto detail = std::make_shared<Detail>(Detail::Settings{d.amplitude, d.frequency, d.octaves, d.seed},
                                                 density.bricks.origin());
    if (carries_detail(v_)) {
      if (fresh_ && !still_) volume_->flow = detail_flow(density);
      if (!volume_->flow.empty()) detail->carry(volume_->flow, frame_of(v_, scene_.render.frame));
    }
    medium.set_detail(*detail);
    into_.details_.push_back(detail);
  }

  /// By the velocity that blurs the density, or that of the frame.
  DetailFlow detail_flow(const ScalarField& density) {
    Displacement of_frame;
    const bool blurred = volume_->displacement.field.bytes() > 0;
    if (!blurred) load_displacement(density, of_frame, dvec2(0));
    DetailFlow flow(blurred ? volume_->displacement : of_frame, density.bricks, task_);
    count("velocity of its detail", flow.bytes());
    return flow;
  }

  void displace(Medium& shape, const ScalarField& field, Displacement& displacement) {
    if (fresh_) {
      load_displacement(field, displacement, v_.moment.rate * scene_.camera.shutter);
      count("velocity of " + field.summary.name, displacement.field.bytes() + displacement.envelope.bytes());
    }
    if (!displacement.envelope.empty()) shape.set_displacement(displacement);
  }

  /// @param shutter  in frames of the volume
  void load_displacement(const ScalarField& field, Displacement& displacement, const dvec2& shutter) {
    try {
      if (of_arrays()) {
        for (const std::string& line : v_.grids->velocity->notes)
          if (std::find(into_.notes_.begin(), into_.notes_.end(), line) == into_.notes_.end()) note(line);
        displacement =
            displacement_of(*v_.grids->velocity, field, {v_.velocity_scale, shutter.x, shutter.y}, into_.notes_, task_);
      } else {
        displacement = fields_.displacement(field, shutter.x, shutter.y);
      }
    } catch (const NoSuchGrid& error) {
      if (v_.velocity_grid != kAuto) throw;
      note(fmt::format("{}: \"auto\" finds none, and nothing is {}", error.what(),
                       shutter_opens_ ? "blurred by its motion" : "carried along"));
      still_ = true;
    }
  }

  /// What moves a field over the shutter, on the field's own lattice.
  void set_in_motion(Medium& shape, const ScalarField& field, Displacement& displacement) {
    if (!shutter_opens_) return;
    if (v_.velocity_grid != "none" && !still_ && v_.moment.rate != 0 && !field.bricks.empty())
      displace(shape, field, displacement);
    if (moves_)
      shape.set_motion(translation(-into_.world_shift_) * v_.object_to_world_end * field.world_from_index *
                       translation(v_.index_offset));
  }

  void add_emission(const ScalarField& field, Displacement& displacement, EmissionRamp ramp) {
    if (field.bricks.empty() || is_holdout(v_)) return;
    Medium shape(field.bricks, world_from(field.world_from_index), {}, {});
    set_in_motion(shape, field, displacement);
    into_.emissions_.emplace_back(shape, std::move(ramp));
  }

  void load_temperature() {
    ScalarField& temperature = volume_->temperature;
    read_into(temperature,
              [&] { return v_.grids && v_.grids->temperature ? *v_.grids->temperature : fields_.temperature(); });
    if (temperature.bricks.empty()) return;
    check_range(temperature, named_);
    count("temperature", temperature.bricks.bytes());
    const double highest = temperature.bricks.maximum();
    const double kelvin = v_.temperature_offset + v_.temperature_scale * highest;
    const std::string range = fmt::format(
        "{}: grid '{}' holds {:.4g} .. {:.4g}, at most {:.4g} K with temperature_offset {} and temperature_scale {}",
        named_, temperature.summary.name, temperature.summary.minimum, highest, kelvin, v_.temperature_offset,
        v_.temperature_scale);
    if (kelvin < EmissionRamp::kColdest) {
      note(range + ": too cold to glow (below 500 K). Set temperature_scale to the kelvin of one unit");
      return;
    }
    if (kelvin > 20000) note(range + ": hotter than any fire");
    const EmissionRamp ramp =
        EmissionRamp::of_blackbody(v_.temperature_offset, v_.temperature_scale, highest, v_.blackbody_intensity,
                                   v_.blackbody_law == "planck", WorkingSpace(scene_.film.color_space).from_rec709);
    add_emission(temperature, volume_->temperature_displacement, ramp);
    note_faint_fire(luminance(ramp(highest)));
  }

  /// @param brightest  emission coefficient, luminance
  void note_faint_fire(double brightest) {
    if (is_holdout(v_)) return;
    // As if all of the way across were as bright as the brightest voxel.
    const double shown = brightest * scene_.film.exposure * 2 * into_.emissions_.back().bounding_sphere().radius;
    if (shown > 0.01 || !(shown > 0)) return;
    note(fmt::format(
        "{}: its fire is too faint to be seen, at most {:.2g} of white with blackbody_intensity = {}; {:.1g} would show it",
        named_, shown, v_.blackbody_intensity, 10 * v_.blackbody_intensity / shown));
  }

  void load_flame() {
    ScalarField& flame = volume_->flame;
    read_into(flame, [&] { return v_.grids && v_.grids->flame ? *v_.grids->flame : fields_.flame(); });
    check_range(flame, named_);
    count("flame", flame.bricks.bytes());
    add_emission(flame, volume_->flame_displacement, fire_ramp(v_));
  }

  SceneMedia& into_;
  const VolumeSettings& v_;
  const InstanceList& places_;
  const std::vector<size_t>& lists_;  // of places_, or of the place of a copy: the number of its [[instances]]
  const size_t number_;               // of the volume in the scene's text
  const Scene& scene_;
  const Task& task_;
  const std::string file_, named_;  // how notes and errors call the volume
  const bool moves_, shutter_opens_;
  bool fresh_ = true;   // no volume before this one reads the same
  bool still_ = false;  // the file has no velocity
  Volume* volume_ = nullptr;
  VolumeFields fields_;
};

SceneMedia::SceneMedia(const Scene& scene, const Task& task) {
  const VolumePlaces places(scene);
  for (size_t i = 0; i < places.volume.size(); ++i) {
    Loader(*this, places, i, task).load();
    emission_volumes_.resize(emissions_.size(), places.volume[i]);
  }
  for (Medium& m : media_) m.set_majorants(scene.render.majorant_scale, scene.render.majorants == "global");
  bounds_ = {scene.camera.look_at - world_shift_, 1.0};
  bool first = true;
  const auto enclose = [&](const Medium::Sphere& s) {
    if (first) {
      bounds_ = s;
      first = false;
      return;
    }
    const double d = glm::distance(bounds_.centre, s.centre);
    if (d + s.radius <= bounds_.radius) return;
    if (d + bounds_.radius <= s.radius) {
      bounds_ = s;
      return;
    }
    const double radius = 0.5 * (d + bounds_.radius + s.radius);
    bounds_.centre += (s.centre - bounds_.centre) * ((radius - bounds_.radius) / d);
    bounds_.radius = radius;
  };
  for (const Medium& m : media_) enclose(m.bounding_sphere());
  if (!first) return;
  for (const EmissionField& e : emissions_) enclose(e.bounding_sphere());  // emission without density
}

}  // namespace brume
