#pragma once
#include <limits>

#include "image/color_space.h"
#include "render/scene/scene.h"

namespace brume {

/// What a key means, once: the parser, its errors and docs/scene.md all come from here.
struct Field {
  const char* key;
  const char* unit = "";
  const char* help = "";
  double lowest = -std::numeric_limits<double>::infinity(), highest = std::numeric_limits<double>::infinity();
  bool required = false;
  std::vector<std::string> choices = {};
};

/// Of everything that shines.
inline const Field kGroup = {
    "group", "", "its light is recorded in the layers light.GROUP too; where any other has one, in light.rest"};

/// Of everything that mattes tell apart.
inline const Field kName = {
    "name", "",
    "of its matte (--layers cryptomatte), in any alphabet; empty: the file's name without its ending and frame, or what shape it has, with a number behind it where that is another's name. Things of one name have one matte"};

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <class Visitor>
void describe(Visitor& v, CameraSettings& c) {
  v({.key = "type", .help = "how rays spread", .choices = {"perspective", "orthographic"}}, c.type);
  v({"position", "scene units", "the eye"}, c.position);
  v({"look_at", "scene units", "the point in the middle of the picture, unless it is shifted"}, c.look_at);
  v({"up", "", "the direction that is up in the picture"}, c.up);
  v({"fov", "degrees", "perspective: full angle of view along fov_axis", 0.001, 179}, c.fov);
  v({"width", "scene units", "orthographic: extent of the picture along fov_axis", 1e-12}, c.width);
  v({.key = "fov_axis", .help = "the side of the picture that fov and width span", .choices = {"x", "y", "shorter"}},
    c.fov_axis);
  v({"shift", "picture sizes",
     "[right, up]: shows what lies this far off, in widths and heights of the picture, without turning the camera, as the shift of a lens; [0.5, 0]: the point ahead is at the left edge"},
    c.shift);
  v({"pixel_aspect", "1", "width of a pixel over its height", 0.01, 100}, c.pixel_aspect);
  v({"lens_radius", "scene units", "of the thin lens; 0 is a pinhole, all in focus", 0}, c.lens_radius);
  v({"focus_distance", "scene units", "from the eye to the plane in focus, along the view; 0: through look_at", 0},
    c.focus_distance);
  v({"blades", "", "of the aperture: 0 is a disc, 3 or more a polygon", 0, 64}, c.blades);
  v({"blade_rotation", "degrees", "turns the polygon"}, c.blade_rotation);
  v({"shutter", "frames", "[open, close] around the frame's time; equal: no motion blur", -1000, 1000}, c.shutter);
  v({"position_end", "scene units", "where the eye is when the shutter closes; empty: it stands still"},
    c.position_end);
  v({"look_at_end", "scene units", "what the eye looks at when the shutter closes; empty: as before"}, c.look_at_end);
  v({"up_end", "", "up when the shutter closes; empty: as before"}, c.up_end);
  v({"keys", "frame, scene units",
     "a camera that moves from frame to frame, instead of position and look_at: [[frame, position x, y, z, look_at x, y, z], ...], rising in the first. A smooth curve through the keys (cubic Hermite, tangents from the neighbouring keys), straight between two, at rest before the first and after the last; it moves over the shutter too"},
    c.keys);
  v({"from_exr", "",
     "take position, view and projection from the worldToCamera and worldToNDC of an EXR's header; the film has its shape"},
    c.from_exr);
}

template <class Visitor>
void describe(Visitor& v, FilmSettings& f) {
  v({"width", "px", "columns", 1, 65536}, f.width);
  v({"height", "px", "rows", 1, 65536}, f.height);
  v({"exposure", "1",
     "factor from radiance to display, 1 being white; written into the header, where the filters and metrics find it",
     1e-12, 1e12},
    f.exposure);
  v({.key = "color_space",
     .help =
         "linear RGB of the scene's colours and of its frames, whose chromaticities say so; pictures, black bodies and skies are converted to it",
     .choices = {kWorkingSpaces.begin(), kWorkingSpaces.end()}},
    f.color_space);
}

template <class Visitor>
void describe(Visitor& v, RenderSettings& r) {
  v({"spp", "", "paths per pixel", 1, 1 << 24}, r.spp);
  v({"seed", "", "of the random numbers; another seed is an independent picture", 0, 9e18}, r.seed);
  v({"frame", "", "number of the frame: for names with ####, camera.keys, and mixed into the random numbers", 0,
     999'999'999},
    r.frame);
  v({"noise_frame", "",
     "frame whose random numbers are used; below 0: this one's, so that the noise of every frame is another", -1,
     999'999'999},
    r.noise_frame);
  v({"max_events", "", "scatterings after which a path is cut; cuts are counted and reported", 1, 1e9}, r.max_events);
  v({"indirect_limit", "radiance",
     "mean of the three channels that the indirect light of one path may bring to its pixel; 0: no limit. Brighter paths are scaled down to it and keep their hue. It takes fireflies and darkens the picture: what it takes is counted and reported. Cycles (clamp indirect) limits the same mean, but at each light that a path finds",
     0, 1e30},
    r.indirect_limit);
  v({"roulette_start", "", "scatterings after which Russian roulette begins", 1, 1e9}, r.roulette_start);
  v({.key = "light_sampling",
     .help =
         "auto: next-event estimation towards all lights, fire among them, but a constant environment, which phase sampling finds without noise; all: that one too; none: phase sampling only",
     .choices = {"auto", "all", "none"}},
    r.light_sampling);
  v({"surface_density", "of the maximum", "density of the medium's isosurface, for the gradient and coverage layers",
     1e-9, 1},
    r.surface_density);
  v({.key = "lookup",
     .help =
         "look-ups of density. stochastic: one voxel of the eight around a point, by its trilinear weight; interpolated: all eight",
     .choices = {"stochastic", "interpolated"}},
    r.lookup);
  v({.key = "first_collision",
     .help =
         "where all there is lies in one still grey grid and nothing emits. forced: each camera ray scatters what does not pass, wherever there is anything to scatter; free: it collides or passes by chance; auto: forced where the medium is thin",
     .choices = {"auto", "forced", "free"}},
    r.first_collision);
  v({.key = "near_lights",
     .help =
         "auto: light of points, spots and spheres inside homogeneous media is sampled along flights too, equiangularly, and vertices aim at the smoke around points and spots in grids; off: at collisions only",
     .choices = {"auto", "off"}},
    r.near_lights);
  v({.key = "flash_relief",
     .help =
         "what shapes the flash layer beyond opacity. falloff: the lamp's, by distance; gradient: shading by the density gradient; both; none; offset: both, and the lamp not at the eye but a tenth of the medium's diagonal up and to the right of it, seen through the medium",
     .choices = {"both", "falloff", "gradient", "none", "offset"}},
    r.flash_relief);
  v({"light_groups", "",
     "every light without a group is one by itself, named after its kind: sky, sun, sun_2, point, mesh, fire, ..."},
    r.light_groups);
  v({"mist_start", "scene units",
     "distance from the camera at which the layer mist begins to grow from 0; of an orthographic one depth"},
    r.mist_start);
  v({"mist_depth", "scene units", "from there on: where it is 1", 1e-9, 1e30}, r.mist_depth);
  v({.key = "mist_falloff",
     .help = "how mist grows with the share of mist_depth: its square, itself, its root",
     .choices = {"quadratic", "linear", "inverse_quadratic"}},
    r.mist_falloff);
  v({"cryptomatte_levels", "",
     "things that a pixel's mattes tell apart, those that cover most of it; two for each layer of Cryptomatte", 1, 64},
    r.cryptomatte_levels);
  v({.key = "majorants",
     .help =
         "cells: bounds of cell_size^3 voxels; global: one bound for the whole grid and flights in double precision, the textbook's tracer, to compare",
     .choices = {"cells", "global"}},
    r.majorants);
  v({"cell_size", "voxels",
     "side of a majorant cell, a power of two: smaller bounds are tighter, larger are crossed in fewer steps; at least 16 where millions of cells hold one and the same value",
     2, 32},
    r.cell_size);
  v({"majorant_scale", "1", "loosens every majorant: costs time and changes no mean, to check that", 1, 1000},
    r.majorant_scale);
}

template <class Visitor>
void describe(Visitor& v, EnvironmentSettings& e) {
  v({"radiance", "W/(m^2 sr)", "constant radiance from everywhere; a factor where file or sky is set", 0}, e.radiance);
  v({"file", "",
     "lat-long picture, EXR or Radiance HDR (or PNG, JPEG: sRGB, no brighter than 1); its top is up, its middle faces +y where up is z, -z where up is y. A cube map (EXR, envmap = cube) becomes one, +Z in the middle"},
    e.file);
  v({"rotation", "degrees", "turns the picture about up, counter-clockwise seen from above"}, e.rotation);
  v({"up", "", "the direction of the picture's top edge"}, e.up);
  v({"visible_to_camera", "", "whether rays that never scatter see it"}, e.visible_to_camera);
  v({.key = "sky",
     .help =
         "preetham: a clear daylight sky, luminance in kcd/m^2 times radiance, and its sun in klux; atmosphere: the same of air, aerosol and ozone around a round planet with all orders of scattering, from noon until the sun is 6 degrees below the horizon",
     .choices = {"none", "preetham", "atmosphere"}},
    e.sky);
  v({"turbidity", "1", "haze of the sky: 2 is very clear, 10 hazy", 1.9, 10}, e.turbidity);
  v({"sun_direction", "", "sky: towards its sun, above the horizon; of an atmosphere at most 6 degrees below it"},
    e.sun_direction);
  v({"sky_sun", "", "whether the sky brings its sun"}, e.sky_sun);
  v({"ground_albedo", "1",
     "sky: reflectance of the ground below the horizon, which the sky lights, and with sky_sun its sun", 0, 1},
    e.ground_albedo);
  v({"altitude", "metres", "atmosphere: of the camera above the sea", 0, 20000}, e.altitude);
  v({"air", "scene units",
     "atmosphere: how far to the sides of the camera, and a tenth of it upwards, its air is a medium of the scene, so that what is far off fades into it; the sky begins where that ends; 0: nowhere",
     0},
    e.air);
  v({"metres_per_unit", "metres", "atmosphere: what a scene unit is, for air", 1e-6, 1e6}, e.metres_per_unit);
  v(kGroup, e.group);
}

template <class Visitor>
void describe(Visitor& v, VolumeTime& t) {
  v({"frame", "frames",
     "[[frame of the scene, frame of the volume], ...], rising in the first: straight between two rows, at rest before the first and after the last. Frames of the volume may have fractions"},
    t.frame);
  v({"fps", "1/s",
     "instead of frame: frames of the files per second; the volume's frame is offset + the scene's * fps / scene_fps",
     1e-6, 1e6},
    t.fps);
  v({"scene_fps", "1/s", "frames of the scene per second, beside fps", 1e-6, 1e6}, t.scene_fps);
  v({"offset", "frames", "added to the volume's frame", -1e9, 1e9}, t.offset);
  v({"first", "frames", "first frame of the sequence; -1: of the files that are there", -1, 999'999'999}, t.first);
  v({"last", "frames", "its last frame; -1: of the files that are there", -1, 999'999'999}, t.last);
  v({.key = "beyond",
     .help =
         "before first and after last. error: an error; hold: the nearest of them; loop: from first to last again and again; ping_pong: forwards and backwards; empty: no volume",
     .choices = {"error", "hold", "loop", "ping_pong", "empty"}},
    t.beyond);
  v({.key = "missing",
     .help =
         "where a file between first and last is not there. error: an error; hold: the last file before it; between: what is between the files before and after it",
     .choices = {"error", "hold", "between"}},
    t.missing);
  v({.key = "between",
     .help =
         "frames between two files. motion: both are carried there along their velocities (velocity_grid, velocity_scale), the total density kept; blend: mixed where they are, as without a velocity; nearest: the nearer of the two",
     .choices = {"motion", "blend", "nearest"}},
    t.between);
}

template <class Visitor>
void describe(Visitor& v, VolumeDetail& d) {
  v({"amplitude", "1", "the density is multiplied by 1 + amplitude * noise: 0 is none, 1 eats holes and doubles peaks",
     0, 1},
    d.amplitude);
  v({"frequency", "1/voxel",
     "bumps and hollows of the widest octave along a voxel of the density grid: 1 is one as wide as a voxel", 1e-3, 64},
    d.frequency);
  v({"octaves", "", "each is half as wide and half as strong as the one before: 3 reach four times below the first", 1,
     8},
    d.octaves);
  v({"seed", "", "another one is other noise", 0, 9e18}, d.seed);
}

template <class Visitor>
void describe(Visitor& v, VolumeSettings& s) {
  v({"file", "", "OpenVDB or NanoVDB file"}, s.file);
  v({"grid", "",
     "name of the density grid; empty: density, smoke, fog and such names of other programs, or a file's only grid of numbers whatever its name. Several grids of one name are density[0], density[1], grids without a name [0], [1], as brume info lists them"},
    s.grid);
  v({.key = "shape",
     .help =
         "grid: the file's density; box, sphere: density 1 everywhere inside lo .. hi; everywhere: density 1 around camera and lamps, as far as light matters (ten mean free paths on): no light reaches the scene from infinity then; layer: fog that falls off with height, density 1 below base_height and exp(-(height - base_height) / scale_height) above, inside lo .. hi or, without them, without an end",
     .choices = {"grid", "box", "sphere", "everywhere", "layer"}},
    s.shape);
  v(kName, s.name);
  v({"material_name", "", "of its matte among materials; empty: its preset, or volume"}, s.material_name);
  v({.key = "role",
     .help =
         "holdout: hides what is behind it as far as it is opaque and leaves a hole in alpha there; is not seen and emits nothing, but throws its shadow and scatters light onto everything else",
     .choices = {"visible", "holdout"}},
    s.role);
  v({"lo", "scene units", "box, sphere, layer: lowest corner of the box (around the sphere)"}, s.lo);
  v({"hi", "scene units", "box, sphere, layer: highest corner"}, s.hi);
  v({"up", "", "layer: the direction in which it falls off; empty: that of [environment]"}, s.up);
  v({"base_height", "scene units", "layer: along up from the origin; below, it is as dense as it gets"}, s.base_height);
  v({"scale_height", "scene units", "layer: climb over which it falls to 1 / e", 1e-12}, s.scale_height);
  v({"sigma_t", "1 / scene unit", "extinction per density, grey or RGB", 0}, s.sigma_t);
  v({"albedo", "1", "single-scattering albedo, grey or RGB", 0, 1}, s.albedo);
  v({"sigma_a", "1 / scene unit", "absorption per density; with sigma_s instead of sigma_t and albedo", 0}, s.sigma_a);
  v({"sigma_s", "1 / scene unit", "scattering per density; with sigma_a", 0}, s.sigma_s);
  v({.key = "preset",
     .help =
         "principled: density, color, absorption_color, g as Blender's Principled Volume takes them; standard_volume: density, scatter, scatter_color, transparent, transparent_depth, g as Arnold does",
     .choices = {"none", "principled", "standard_volume"}},
    s.preset);
  v({"density", "1", "factor on the density grid; in presets their parameter of that name", 0}, s.density);
  v({"color", "1", "principled: scattering colour", 0, 1}, s.color);
  v({"absorption_color", "1", "principled: colour that absorption leaves", 0, 1}, s.absorption_color);
  v({"scatter", "1", "standard_volume: weight of scatter_color", 0, 1}, s.scatter);
  v({"scatter_color", "1", "standard_volume: scattering colour", 0, 1}, s.scatter_color);
  v({"transparent", "1", "standard_volume: what is left of light after transparent_depth at density 1", 1e-6, 1},
    s.transparent);
  v({"transparent_depth", "scene units", "standard_volume: the depth of transparent", 1e-12}, s.transparent_depth);
  v({"remap", "", "a curve [[stored, meant], ...] that voxels go through, rising in the first"}, s.remap);
  v({"max_density", "", "voxels above are taken as this, after remap: what a few damaged voxels need; 0: no limit", 0},
    s.max_density);
  v({.key = "phase",
     .help =
         "henyey_greenstein: g; two_lobes: g and g2 mixed by lobe_weight; mie: water droplets of droplet_diameter, as the fit of Jendersie and d'Eon; draine: dust, henyey_greenstein of g >= 0 times 1 + draine_alpha cos^2; rayleigh: air, draine of 0 and 1; fournier_forand: particles in water, of particle_index and size_slope",
     .choices = {"henyey_greenstein", "two_lobes", "mie", "draine", "rayleigh", "fournier_forand"}},
    s.phase);
  v({"g", "1", "mean cosine, positive forward", -0.999, 0.999}, s.g);
  v({"g2", "1", "two_lobes: mean cosine of the second lobe", -0.999, 0.999}, s.g2);
  v({"lobe_weight", "1", "two_lobes: share of the second lobe", 0, 1}, s.lobe_weight);
  v({"draine_alpha", "1", "draine: weight of the squared cosine", 0, 1e3}, s.draine_alpha);
  v({"droplet_diameter", "micrometres", "mie: of the droplets", 5, 50}, s.droplet_diameter);
  v({"particle_index", "1", "fournier_forand: index of refraction of the particles over that of the water", 1.01, 1.35},
    s.particle_index);
  v({"size_slope", "1",
     "fournier_forand: the number of particles falls with this power of their size; 3.5835 with an index of 1.1 turns 1.83 % of the light back, as measured in the sea",
     3.2, 4.9},
    s.size_slope);
  v({"albedo_grid", "",
     "colour grid that multiplies albedo; none, or auto: color, Cd and such names, if there is one; or three grids, such as Cd_r, Cd_g, Cd_b"},
    s.albedo_grid);
  v({"albedo_file", "", "the file of albedo_grid; none: file"}, s.albedo_file);
  v({"emission", "W/(m^2 sr) / scene unit", "emission coefficient per density", 0}, s.emission);
  v({"temperature_grid", "",
     "emits as a black body; none, or auto: temperature and such names, if there is one and the file has no empty grid of flames: then it is the heat of smoke that does not burn"},
    s.temperature_grid);
  v({"temperature_file", "", "the file of temperature_grid; none: file. Its voxels need not be those of the density"},
    s.temperature_file);
  v({"temperature_offset", "K", "kelvin = temperature_offset + temperature_scale * value"}, s.temperature_offset);
  v({"temperature_scale", "K",
     "what one unit of the grid is: 1 for kelvin; Blender's fluids store about 0 .. 3, their shader's default is 1000",
     0},
    s.temperature_scale);
  v({"blackbody_intensity", "1 / scene unit",
     "emission coefficient where emitted light has luminance 1; planck: a body at 6500 K has it", 0},
    s.blackbody_intensity);
  v({.key = "blackbody_law",
     .help =
         "planck: visible radiance of a black body; stefan_boltzmann: Blender's sigma T^4 1e-6 / pi with its colour",
     .choices = {"planck", "stefan_boltzmann"}},
    s.blackbody_law);
  v({"flame_grid", "",
     "emits the colours of flame_ramp; none, or auto: flame, flames, fire, burn, heat and such names, if there is one"},
    s.flame_grid);
  v({"flame_file", "", "the file of flame_grid; none: file"}, s.flame_file);
  v({"flame_ramp", "", "[[value, r, g, b], ...], rising in the first; empty: from dark red to pale yellow over 0 .. 1"},
    s.flame_ramp);
  v({"flame_intensity", "W/(m^2 sr) / scene unit", "emission coefficient of the ramp's colour 1", 0},
    s.flame_intensity);
  v({"velocity_grid", "",
     "deformation motion blur over the camera's shutter, and the way between two frames of a sequence (time); none, or auto: velocity, vel, v, if there is one; or three grids of its components, such as vel.x, vel.y, vel.z"},
    s.velocity_grid);
  v({"velocity_file", "", "the file of velocity_grid; none: file"}, s.velocity_file);
  v({"velocity_scale", "", "the file's world units per frame for one unit of stored velocity"}, s.velocity_scale);
  v({"time", "table", "which frame of a sequence of files is shown, below: time = { frame = [[1, 1], [48, 25.5]] }"},
    s.time);
  v({"detail", "table",
     "grid: structure below the voxel, by noise, below: detail = { amplitude = 0.8 }. Of the density alone: what emits keeps its own"},
    s.detail);
  v({"object_to_world", "", "4 x 4, rows first, applied after the file's own transform; points are columns"},
    s.object_to_world);
  v({"object_to_world_end", "", "the same when the shutter closes; all zero: it stands still"}, s.object_to_world_end);
  v({"index_offset", "voxels",
     "added to voxel coordinates; 0.5 matches Blender Cycles, which samples half a voxel off"},
    s.index_offset);
  v({"convert_level_set", "", "fill a level set's inside with fog instead of refusing it"}, s.convert_level_set);
  v({.key = "paging",
     .help =
         "where the file's values lie while it is rendered: in memory (never), in a temporary file of which parts are in memory (always), or there where they take more than 2 GB (auto); the picture is the same",
     .choices = {"auto", "always", "never"}},
    s.paging);
  v(kGroup, s.group);
  v({"enabled", "", "false leaves it out of the scene"}, s.enabled);
}

template <class Visitor>
void describe(Visitor& v, ArrayPlacement& p) {
  v({"voxel_size", "scene units per voxel", "of a volume of arrays: one number, or three along x, y and z", 1e-300},
    p.voxel_size);
  v({"origin", "scene units", "of a volume of arrays: where the value with the indices 0, 0, 0 sits"}, p.origin);
}

template <class Visitor>
void describe(Visitor& v, InstanceSettings& s) {
  v({"volume", "", "which of [[volumes]], counted from 0 as they stand in the file", 0, 1e6}, s.volume);
  v({"name", "", "of the matte of these places (--layers cryptomatte); empty: the volume's"}, s.name);
  v({"matrices", "",
     "where it stands: [matrix, ...], each 4 x 4, rows first, applied after the volume's own object_to_world; points are columns"},
    s.matrices);
  v({"file", "",
     "the same from a file, a place for each row of a CSV or each point of a PLY: x, y, z, and as far as they are there orientation, scale, density, tint and time_offset; or m00 .. m23, rows of a matrix"},
    s.file);
  v({"object_to_world", "", "4 x 4, rows first: moves all of them"}, s.object_to_world);
  v({"density", "1", "factor on the volume's density", 0}, s.density);
  v({"tint", "1", "factor on its albedo, grey or RGB", 0}, s.tint);
  v({"time_offset", "frames",
     "of a volume with a table time: added to its frame, for these places alone; one of each place, from its file, comes on top",
     -1e9, 1e9},
    s.time_offset);
  v({"enabled", "", "false leaves it out of the scene"}, s.enabled);
}

template <class Visitor>
void describe(Visitor& v, LightSettings& l) {
  v({.key = "type",
     .help = "sun: parallel light from a disc; sphere, rectangle: surfaces that emit and that rays end on; point, spot",
     .required = true,
     .choices = {"sun", "sphere", "rectangle", "point", "spot"}},
    l.type);
  v({"direction", "", "sun: towards the light; spot: where it shines"}, l.direction);
  v({"irradiance", "W/m^2", "sun: on a plane that faces it", 0}, l.irradiance);
  v({"angular_diameter", "degrees", "sun: of its disc; below 1e-5 its light is exactly parallel", 0, 180},
    l.angular_diameter);
  v({"position", "scene units", "sphere, rectangle: its centre; point, spot"}, l.position);
  v({"radius", "scene units", "sphere: its radius", 0}, l.radius);
  v({"edge_x", "scene units", "rectangle: one edge"}, l.edge_x);
  v({"edge_y", "scene units", "rectangle: the other; it emits to the side of edge_x x edge_y"}, l.edge_y);
  v({"two_sided", "", "rectangle: emits to both sides"}, l.two_sided);
  v({"radiance", "W/(m^2 sr)", "sphere, rectangle: of its surface", 0}, l.radiance);
  v({"intensity", "W/sr", "point, spot", 0}, l.intensity);
  v({"cone_angle", "degrees", "spot: full angle of the cone", 0.01, 179.9}, l.cone_angle);
  v({"cone_softness", "1", "spot: share of the cone in which it fades out", 0, 1}, l.cone_softness);
  v({"cosine_falloff", "", "spot: whether its intensity also falls with the cosine of the angle to its axis"},
    l.cosine_falloff);
  v({"visible_to_camera", "", "whether rays that never scatter see it"}, l.visible_to_camera);
  v({"solid", "",
     "sphere, rectangle: whether it hides what lies behind; false: its light is added to that, as Blender's lamps do"},
    l.solid);
  v(kGroup, l.group);
  v({"enabled", "", "false leaves it out of the scene"}, l.enabled);
}

template <class Visitor>
void describe(Visitor& v, SurfaceSettings& s) {
  v({.key = "file", .help = "mesh of polygons of any shape, OBJ or PLY", .required = true}, s.file);
  v(kName, s.name);
  v({"material_name", "", "of its matte among materials; empty: its material"}, s.material_name);
  v({.key = "material",
     .help =
         "diffuse; coated: diffuse under a layer of varnish, as plastics, floors and walls; conductor: a metal; dielectric: glass or water, its faces closed around the inside",
     .choices = {"diffuse", "conductor", "dielectric", "coated"}},
    s.material);
  v({"albedo", "1",
     "diffuse: reflectance; coated: of what lies under the coat; conductor: reflectance seen head on; dielectric: tint of what passes, 1 unless given",
     0, 1},
    s.albedo);
  v({"albedo_texture", "", "picture that multiplies albedo, up to 1: PNG, JPEG (sRGB), HDR or EXR (linear)"},
    s.albedo_texture);
  v({"translucence", "1",
     "diffuse: what leaves on the other side, of leaves, paper and cloth; with albedo at most 1. albedo_texture multiplies it, too",
     0, 1},
    s.translucence);
  v({"alpha", "1", "share of light that meets the surface; the rest passes as if it were not there", 0, 1}, s.alpha);
  v({"alpha_texture", "",
     "picture whose first channel, decoded as albedo_texture's, multiplies alpha: the outline of leaves on a card"},
    s.alpha_texture);
  v({"edge_albedo", "1", "conductor: reflectance seen at grazing angles", 0, 1}, s.edge_albedo);
  v({"reflection_tint", "1", "dielectric, coated: tint of what its faces reflect", 0, 1}, s.reflection_tint);
  v({"roughness", "1",
     "conductor, dielectric, coated: square root of the GGX width; 0 is perfectly smooth; of a coat at least 0.03", 0,
     1},
    s.roughness);
  v({"ior", "1", "dielectric, coated: index of refraction inside over outside", 1.0001, 4}, s.ior);
  v({.key = "normals",
     .help = "smooth: shading between the vertices' normals where the file has them; flat: by the triangles",
     .choices = {"smooth", "flat"}},
    s.normals);
  v({"radiance", "W/(m^2 sr)", "emitted by the outside: an area light of any shape", 0}, s.radiance);
  v({"radiance_texture", "",
     "picture that multiplies radiance, up to 1, as albedo_texture does albedo: screens, windows, flames"},
    s.radiance_texture);
  v({"two_sided", "", "emits to both sides"}, s.two_sided);
  v({.key = "role",
     .help =
         "holdout: cuts a hole into the picture, alpha 0; shadow_catcher: unseen, its light goes to the layers catcher and catcher_unshadowed",
     .choices = {"visible", "holdout", "shadow_catcher"}},
    s.role);
  v({"visible_to_camera", "", "whether rays that never scatter meet it; all others do"}, s.visible_to_camera);
  v({.key = "shadow",
     .help =
         "smooth dielectric. traced: light passes bent, and only paths that end on a light find it behind: unbiased, but dark behind points and noisy under small suns; straight: light sampling looks through, unbent and dimmed by Fresnel: biased as far as the bending matters",
     .choices = {"traced", "straight"}},
    s.shadow);
  v({"object_to_world", "", "4 x 4, rows first; points are columns"}, s.object_to_world);
  v({"object_to_world_end", "", "the same when the shutter closes; all zero: it stands still"}, s.object_to_world_end);
  v(kGroup, s.group);
  v({"enabled", "", "false leaves it out of the scene"}, s.enabled);
}

}  // namespace brume
