#pragma once
#include <limits>

#include "render/scene.h"

namespace brume {

/// What a key means, once: the parser, its errors and docs/scene.md all come from here.
struct Field {
  const char* key;
  const char* unit;
  const char* help;
  double lowest = -std::numeric_limits<double>::infinity(), highest = std::numeric_limits<double>::infinity();
  bool required = false;
  std::vector<std::string> choices = {};
};

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <class Visitor>
void describe(Visitor& v, CameraSettings& c) {
  v({"position", "scene units", "the eye", -kInfinity, kInfinity, true}, c.position);
  v({"look_at", "scene units", "the point in the middle of the picture", -kInfinity, kInfinity, true}, c.look_at);
  v({"up", "", "the direction that is up in the picture"}, c.up);
  v({"fov", "degrees", "full angle of view along fov_axis", 0.001, 179}, c.fov);
  v({"fov_axis", "", "the side of the picture that fov spans", 0, 0, false, {"x", "y", "shorter"}}, c.fov_axis);
}

template <class Visitor>
void describe(Visitor& v, FilmSettings& f) {
  v({"width", "px", "columns", 1, 65536}, f.width);
  v({"height", "px", "rows", 1, 65536}, f.height);
  v({"exposure", "1",
     "factor from radiance to display, 1 being white; written into the header, where the filters and metrics find it",
     1e-12, 1e12},
    f.exposure);
}

template <class Visitor>
void describe(Visitor& v, RenderSettings& r) {
  v({"spp", "", "paths per pixel", 1, 1 << 24}, r.spp);
  v({"seed", "", "of the random numbers; another seed is an independent picture", 0, 9e18}, r.seed);
  v({"frame", "", "number of the frame, mixed into the random numbers", 0, 1 << 30}, r.frame);
  v({"max_events", "", "scatterings after which a path is cut; cuts are counted and reported", 1, 1e9}, r.max_events);
  v({"roulette_start", "", "scatterings after which Russian roulette begins", 1, 1e9}, r.roulette_start);
  v({"light_sampling",
     "",
     "auto: next-event estimation towards all lights but a constant environment, which phase sampling finds without "
     "noise; all: that one too; none: phase sampling only",
     0,
     0,
     false,
     {"auto", "all", "none"}},
    r.light_sampling);
  v({"surface_density", "of the maximum",
     "density at which the medium's surface lies, for the gradient and coverage layers", 1e-9, 1},
    r.surface_density);
}

template <class Visitor>
void describe(Visitor& v, EnvironmentSettings& e) {
  v({"radiance", "W/(m^2 sr)", "constant radiance from everywhere; a factor on the picture where file is set", 0},
    e.radiance);
  v({"file", "",
     "lat-long picture, EXR or Radiance HDR; its top is up, its middle faces +y where up is z, -z where up is y"},
    e.file);
  v({"rotation", "degrees", "turns the picture about up, counter-clockwise seen from above"}, e.rotation);
  v({"up", "", "the direction of the picture's top edge"}, e.up);
  v({"visible_to_camera", "", "whether rays that never scatter see it"}, e.visible_to_camera);
}

template <class Visitor>
void describe(Visitor& v, VolumeSettings& s) {
  v({"file", "", "OpenVDB file", 0, 0, true}, s.file);
  v({"grid", "", "name of the density grid; empty: density, or the one grid whose name begins so"}, s.grid);
  v({"sigma_t", "1 / scene unit", "extinction per density", 0}, s.sigma_t);
  v({"albedo", "1", "single-scattering albedo, grey or RGB", 0, 1}, s.albedo);
  v({"g", "1", "mean cosine of the Henyey-Greenstein phase function, positive forward", -0.999, 0.999}, s.g);
  v({"object_to_world", "", "4 x 4, rows first, applied after the file's own transform; points are columns"},
    s.object_to_world);
  v({"index_offset", "voxels",
     "added to voxel coordinates; 0.5 matches Blender Cycles, which samples half a voxel off"},
    s.index_offset);
  v({"convert_level_set", "", "fill a level set's inside with fog instead of refusing it"}, s.convert_level_set);
}

template <class Visitor>
void describe(Visitor& v, LightSettings& l) {
  v({"type",
     "",
     "sun: parallel light from a disc; sphere: a ball that emits, and that rays end on",
     0,
     0,
     true,
     {"sun", "sphere"}},
    l.type);
  v({"direction", "", "sun: towards the light"}, l.direction);
  v({"irradiance", "W/m^2", "sun: on a plane that faces it", 0}, l.irradiance);
  v({"angular_diameter", "degrees", "sun: of its disc; 0 is exactly parallel light", 0, 180}, l.angular_diameter);
  v({"position", "scene units", "sphere: its centre"}, l.position);
  v({"radius", "scene units", "sphere: its radius", 0}, l.radius);
  v({"radiance", "W/(m^2 sr)", "sphere: of its surface", 0}, l.radiance);
  v({"visible_to_camera", "", "whether rays that never scatter see it"}, l.visible_to_camera);
}

}  // namespace brume
