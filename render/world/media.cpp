#include "render/world/media.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.h"

namespace brume {

struct SceneMedia::Volume {
  ScalarField density, temperature, flame;
  VectorField colour;
  Displacement displacement, temperature_displacement, flame_displacement;
};

namespace {

PhaseFunction phase_of(const VolumeSettings& v) {
  if (v.phase == "two_lobes") return PhaseFunction::two_lobes(v.g, v.g2, v.lobe_weight);
  if (v.phase == "mie") return PhaseFunction::mie(v.droplet_diameter);
  return PhaseFunction::henyey_greenstein(v.g);
}

ScalarOptions options_for(const std::string& name, std::vector<std::string> usual) {
  ScalarOptions options;
  options.grid = name == "auto" ? "" : name;
  options.usual_names = std::move(usual);
  return options;
}

EmissionRamp fire_ramp(const VolumeSettings& v) {
  std::vector<std::pair<double, dvec3>> stops;
  for (const auto& row : v.flame_ramp) stops.emplace_back(row[0], dvec3(row[1], row[2], row[3]));
  if (stops.empty())
    stops = {{0.0, dvec3(0)}, {0.3, {0.3, 0.02, 0.0}}, {0.65, {1.0, 0.25, 0.03}}, {1.0, {1.0, 0.8, 0.4}}};
  return EmissionRamp::of_colours(stops, v.flame_intensity);
}

}  // namespace

SceneMedia::SceneMedia(const Scene& scene, const Task& task) {
  for (const VolumeSettings& v : scene.volumes) load(v, scene, task);
  for (Medium& m : media_) m.set_majorants(scene.render.majorant_scale, scene.render.majorants == "global");
  bounds_ = {scene.camera.look_at - world_shift_, 1.0};
  bool first = true;
  const auto enclose = [&](const Medium::Sphere& s) {
    if (first) {
      bounds_ = s, first = false;
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
  for (const EmissionField& e : emissions_) enclose(e.bounding_sphere());  // flames without smoke
}

void SceneMedia::note_faint_fire(const VolumeSettings& v, double exposure, double brightest) {
  // As if all of the way across were as bright as the brightest voxel.
  const double shown = brightest * exposure * 2 * emissions_.back().bounding_sphere().radius;
  if (shown > 0.01 || !(shown > 0)) return;
  notes_.push_back(
      fmt::format("{}: its fire is too faint to be seen, at most {:.2g} of white with blackbody_intensity = {}; {:.1g} "
                  "would show it",
                  v.file.string(), shown, v.blackbody_intensity, 10 * v.blackbody_intensity / shown));
}

void SceneMedia::load(const VolumeSettings& v, const Scene& scene, const Task& task) {
  volumes_.push_back(std::make_shared<Volume>());
  Volume& volume = *volumes_.back();
  const auto adopt = [&](std::vector<std::string>& notes) {
    notes_.insert(notes_.end(), notes.begin(), notes.end());
    notes.clear();
  };
  check_transform(v.object_to_world, "object_to_world");
  const bool moves = v.object_to_world_end != dmat4(0.0);
  if (moves) check_transform(v.object_to_world_end, "object_to_world_end");
  const bool open_shutter = scene.camera.shutter.y > scene.camera.shutter.x;
  if (moves && !open_shutter)
    notes_.push_back("a volume moves but camera.shutter opens and closes at once: it is rendered where it starts");
  const dmat4 offset = translation(v.index_offset);
  const std::string file = v.file.filename().string();

  if (v.shape != "grid") {
    const HomogeneousShape shape{v.shape == "box" ? HomogeneousShape::Shape::kBox : HomogeneousShape::Shape::kSphere,
                                 v.lo, v.hi};
    if (!shifted_) {
      shifted_ = true;
      world_shift_ = dvec3(v.object_to_world * glm::dvec4(0.5 * (v.lo + v.hi), 1.0));
    }
    Medium medium(shape, translation(-world_shift_) * v.object_to_world, {v.sigma_t, v.albedo}, phase_of(v));
    if (moves && open_shutter) medium.set_motion(translation(-world_shift_) * v.object_to_world_end);
    if (v.emission != dvec3(0)) emissions_.emplace_back(medium, v.emission);
    if (medium.extinction_per_density() > 0) media_.push_back(medium);
    return;
  }

  ScalarOptions density_options{v.grid};
  density_options.convert_level_set = v.convert_level_set;
  for (const auto& row : v.remap) density_options.remap.emplace_back(row[0], row[1]);
  volume.density = load_scalar(v.file, density_options, task);
  adopt(volume.density.notes);
  parts_.push_back({fmt::format("{}: {}", file, volume.density.summary.name), volume.density.bricks.bytes()});
  const dmat4 world_from_index = v.object_to_world * volume.density.world_from_index * offset;
  if (!shifted_ && !volume.density.bricks.empty()) {
    shifted_ = true;
    const BrickGrid& b = volume.density.bricks;
    world_shift_ =
        dvec3(world_from_index * glm::dvec4(0.5 * (b.support_lo() + b.support_hi()) + dvec3(b.origin()), 1.0));
  }
  const dmat4 shift = translation(-world_shift_);
  const auto place = [&](const dmat4& from_index, const BrickGrid& bricks) {
    return Placement(shift * v.object_to_world * from_index * offset * translation(dvec3(bricks.origin())));
  };

  Medium medium(volume.density.bricks, shift * world_from_index, {v.sigma_t, v.albedo}, phase_of(v));
  if (v.albedo_grid != "none") {
    volume.colour = load_colour(v.file, v.albedo_grid == "auto" ? "" : v.albedo_grid, task);
    adopt(volume.colour.notes);
    medium.set_colour(volume.colour.bricks, place(volume.colour.world_from_index, volume.colour.bricks.parts[0]));
    parts_.push_back({file + ": albedo colour", volume.colour.bricks.bytes()});
  }
  const bool flows = v.velocity_grid != "none" && open_shutter;
  if (v.velocity_grid != "none" && !open_shutter)
    notes_.push_back("velocity_grid is set but camera.shutter opens and closes at once: no motion blur");
  // What moves a field over the shutter, on the field's own lattice.
  const auto set_in_motion = [&](Medium& shape, const ScalarField& field, Displacement& displacement) {
    if (flows && !field.bricks.empty()) {
      displacement = load_displacement(v.file, v.velocity_grid == "auto" ? "" : v.velocity_grid, field,
                                       v.velocity_scale, scene.camera.shutter.x, scene.camera.shutter.y, notes_, task);
      shape.set_displacement(displacement);
      parts_.push_back({fmt::format("{}: velocity of {}", file, field.summary.name),
                        displacement.field.bytes() + displacement.envelope.bytes()});
    }
    if (moves && open_shutter) shape.set_motion(shift * v.object_to_world_end * field.world_from_index * offset);
  };
  set_in_motion(medium, volume.density, volume.displacement);
  if (!medium.empty() && medium.extinction_per_density() > 0) media_.push_back(medium);

  const auto glow = [&](const ScalarField& field, Displacement& displacement, EmissionRamp ramp) {
    if (field.bricks.empty()) return;
    Medium shape(field.bricks, shift * v.object_to_world * field.world_from_index * offset, {}, {});
    set_in_motion(shape, field, displacement);
    emissions_.emplace_back(shape, std::move(ramp));
  };
  if (const double highest = volume.density.bricks.maximum(); v.emission != dvec3(0) && !medium.empty())
    emissions_.emplace_back(medium, EmissionRamp::of_colours({{0.0, dvec3(0)}, {highest, v.emission * highest}}, 1.0));
  if (v.temperature_grid != "none") {
    volume.temperature = load_scalar(v.file, options_for(v.temperature_grid, {"temperature", "temp"}), task);
    adopt(volume.temperature.notes);
    parts_.push_back({file + ": temperature", volume.temperature.bricks.bytes()});
    const double highest = volume.temperature.bricks.maximum();
    const double kelvin = v.temperature_offset + v.temperature_scale * highest;
    if (kelvin < 500)
      notes_.push_back(fmt::format(
          "{}: grid '{}' holds {:.4g} .. {:.4g}, at most {:.4g} K with temperature_offset {} and temperature_scale {}: "
          "too cold to glow (below 500 K). Set temperature_scale to the kelvin of one unit",
          v.file.string(), volume.temperature.summary.name, volume.temperature.summary.minimum, highest, kelvin,
          v.temperature_offset, v.temperature_scale));
    else if (kelvin > 20000)
      notes_.push_back(
          fmt::format("{}: grid '{}' holds {:.4g} .. {:.4g}, up to {:.4g} K with temperature_offset {} and "
                      "temperature_scale {}: hotter than any fire",
                      v.file.string(), volume.temperature.summary.name, volume.temperature.summary.minimum, highest,
                      kelvin, v.temperature_offset, v.temperature_scale));
    if (kelvin >= 500) {
      const EmissionRamp ramp = EmissionRamp::of_blackbody(v.temperature_offset, v.temperature_scale, highest,
                                                           v.blackbody_intensity, v.blackbody_law == "planck");
      glow(volume.temperature, volume.temperature_displacement, ramp);
      if (!volume.temperature.bricks.empty()) note_faint_fire(v, scene.film.exposure, luminance(ramp(highest)));
    }
  }
  if (v.flame_grid != "none") {
    volume.flame = load_scalar(v.file, options_for(v.flame_grid, {"flame", "flames", "heat"}), task);
    adopt(volume.flame.notes);
    parts_.push_back({file + ": flame", volume.flame.bricks.bytes()});
    glow(volume.flame, volume.flame_displacement, fire_ramp(v));
  }
  // Last: what bounds moving fields reads them in the cells they were loaded in.
  for (ScalarField* field : {&volume.density, &volume.temperature, &volume.flame})
    field->bricks = field->bricks.recut(scene.render.cell_size, task);
}

}  // namespace brume
