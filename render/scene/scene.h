#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/vec.h"

namespace brume {

struct TriangleMesh;
struct VolumeGrids;

// Plain data of a scene. Keys, units, ranges and meanings stand once, in scene_fields.h.

/// A camera as an EXR's header has it.
struct CameraMatrices {
  std::string name;           ///< of the frame, for errors
  int width = 0, height = 0;  ///< of the picture [px]
  std::array<float, 16> world_to_camera{}, world_to_ndc{};
};

struct CameraSettings {
  std::string type = "perspective";
  dvec3 position{0}, look_at{0}, up{0, 0, 1};
  double fov = 40;
  double width = 1;
  std::string fov_axis = "x";
  dvec2 shift{0};
  double pixel_aspect = 1;
  double lens_radius = 0, focus_distance = 0;
  int blades = 0;
  double blade_rotation = 0;
  dvec2 shutter{0};
  std::vector<double> position_end, look_at_end, up_end;  ///< three numbers, or none: the camera stands still
  std::vector<std::vector<double>> keys;  ///< of a moving camera; none once a frame's camera is taken from them
  std::filesystem::path from_exr;
  std::shared_ptr<const CameraMatrices> matrices;  ///< the same of a frame in memory; not part of a scene's text
};

struct FilmSettings {
  int width = 400, height = 400;
  double exposure = 1.0;
  std::string color_space = "lin_rec709";  ///< of every colour in the scene and of its frames: WorkingSpace
};

/// Where a volume of arrays lies; a file says it of its own grids.
struct ArrayPlacement {
  dvec3 voxel_size{1}, origin{0};
};

/// Which frame of a sequence of files a volume shows.
struct VolumeTime {
  std::vector<std::vector<double>> frame;  ///< rows of a frame of the scene and one of the volume; none: by fps
  double fps = 24, scene_fps = 24, offset = 0;
  int first = -1, last = -1;
  std::string beyond = "error", missing = "error", between = "motion";
  bool given = false;  ///< whether the volume has the table
};

/// Noise below the voxels of a volume's density.
struct VolumeDetail {
  double amplitude = 0.8, frequency = 1;
  int octaves = 3;
  int64_t seed = 0;
  bool given = false;  ///< whether the volume has the table
};

struct VolumeSettings;

/// What that comes to at the scene's frame; not part of a scene's text.
struct VolumeMoment {
  double frame = 0;                             ///< of the volume
  double rate = 1;                              ///< frames of the volume per frame of the scene
  std::shared_ptr<const VolumeSettings> later;  ///< the same volume of the next file; null: it is not needed
  double share = 0;                             ///< of the way from the volume's files to those of `later`
  double frames = 1;                            ///< from one to the other
  bool none = false;                            ///< whether there is no volume then
  /// What the keys of the volume's files name, with a place for the frame's number.
  std::map<std::string, std::filesystem::path> names;
};

struct VolumeSettings {
  std::filesystem::path file;
  std::string grid;
  std::string name, material_name;  ///< of mattes; empty: MatteNames makes one
  std::string role = "visible";
  std::string shape = "grid";
  dvec3 lo{-0.5}, hi{0.5};  ///< equal for a layer without an end
  std::vector<double> up;   ///< three numbers, or none: the environment's
  double base_height = 0, scale_height = 1;
  std::string preset = "none";
  dvec3 sigma_t{1.0}, albedo{0.8};
  dvec3 sigma_a{0.0}, sigma_s{0.0};
  double density = 1.0;
  dvec3 color{0.5}, absorption_color{0.0};
  double scatter = 1.0;
  dvec3 scatter_color{0.5}, transparent{0.36787944117144233};
  double transparent_depth = 1.0;
  std::vector<std::vector<double>> remap;
  double max_density = 0;
  std::string phase = "henyey_greenstein";
  double g = 0.0, g2 = 0.0, lobe_weight = 0.5, droplet_diameter = 20.0, draine_alpha = 1.0;
  double particle_index = 1.1, size_slope = 3.5835;
  std::string albedo_grid = "none";
  std::filesystem::path albedo_file, temperature_file, flame_file, velocity_file;  ///< empty: `file`
  dvec3 emission{0};
  std::string temperature_grid = "none";
  double temperature_offset = 0, temperature_scale = 1, blackbody_intensity = 1;
  std::string blackbody_law = "planck";
  std::string flame_grid = "none";
  std::vector<std::vector<double>> flame_ramp;
  double flame_intensity = 1;
  std::string velocity_grid = "none";
  double velocity_scale = 1;
  VolumeTime time;
  VolumeDetail detail;
  VolumeMoment moment;
  dmat4 object_to_world{1};
  dmat4 object_to_world_end{0};  ///< all zero: the volume stands still
  dvec3 index_offset{0};
  bool convert_level_set = false;
  std::string paging = "auto";
  std::string group;
  bool enabled = true;
  ArrayPlacement placement;
  /// Those in memory, read from the file before or made of arrays; null: they are read. Not part of a scene's text.
  std::shared_ptr<const VolumeGrids> grids;
};

/// Places where a volume stands, in memory; equal lengths, or none of all but matrices.
struct InstanceList {
  std::vector<dmat4> matrices;  ///< to the scene's space
  std::vector<double> densities;
  std::vector<dvec3> tints;
  std::vector<double> time_offsets;  ///< frames of the volume's sequence
};

struct InstanceSettings {
  int volume = 0;    ///< number among those of the scene's text; once read, in Scene::volumes
  std::string name;  ///< of mattes; empty: the volume's
  std::vector<dmat4> matrices;
  std::filesystem::path file;
  dmat4 object_to_world{1};
  double density = 1;
  dvec3 tint{1};
  double time_offset = 0;
  bool enabled = true;
  std::shared_ptr<const InstanceList> arrays;  ///< in place of matrices and file; not part of a scene's text
  std::string arrays_content;                  ///< tells them from others
};

struct EnvironmentSettings {
  dvec3 radiance{0};
  std::filesystem::path file;
  double rotation = 0;
  dvec3 up{0, 0, 1};
  bool visible_to_camera = true;
  std::string sky = "none";
  double turbidity = 3;
  dvec3 sun_direction{0.5, 0.3, 0.6};
  bool sky_sun = true;
  double ground_albedo = 0.2;
  double altitude = 0, air = 0, metres_per_unit = 1;
  std::string group;
};

struct LightSettings {
  std::string type;
  dvec3 direction{0}, irradiance{0};
  double angular_diameter = 0.53;
  dvec3 position{0}, radiance{0};
  double radius = 0;
  dvec3 edge_x{0}, edge_y{0};
  bool two_sided = false;
  dvec3 intensity{0};
  double cone_angle = 60, cone_softness = 0.15;
  bool cosine_falloff = false;
  bool visible_to_camera = false;
  bool solid = true;
  std::string group;
  bool enabled = true;
};

struct SurfaceSettings {
  std::filesystem::path file;
  std::string name, material_name;  ///< of mattes; empty: MatteNames makes one
  std::string material = "diffuse";
  dvec3 albedo{0.5};
  std::filesystem::path albedo_texture;
  dvec3 translucence{0};
  double alpha = 1;
  std::filesystem::path alpha_texture;
  dvec3 edge_albedo{1}, reflection_tint{1};
  double roughness = 0.3, ior = 1.5;
  std::string normals = "smooth";
  dvec3 radiance{0};
  std::filesystem::path radiance_texture;
  bool two_sided = false;
  std::string role = "visible";
  bool visible_to_camera = true;
  std::string shadow = "traced";
  std::string group;
  dmat4 object_to_world{1};
  dmat4 object_to_world_end{0};  ///< all zero: the surface stands still
  bool enabled = true;
  /// In its own space, where it is in memory already; null: it is read. Not part of a scene's text.
  std::shared_ptr<const TriangleMesh> mesh;
  std::string mesh_content;  ///< of a mesh that comes from no file: tells it from others
};

struct RenderSettings {
  int spp = 64;
  int64_t seed = 0;
  int frame = 0;
  int noise_frame = -1;
  int max_events = 100000;
  double indirect_limit = 0;
  int roulette_start = 16;
  std::string light_sampling = "auto";
  double surface_density = 0.01;
  std::string lookup = "stochastic";
  std::string first_collision = "auto";
  std::string near_lights = "auto";
  std::string flash_relief = "both";
  std::string majorants = "cells";
  bool light_groups = false;
  double mist_start = 0, mist_depth = 25;
  std::string mist_falloff = "quadratic";
  int cryptomatte_levels = 6;
  int cell_size = 8;
  double majorant_scale = 1;
};

/// What a scene's text does not hold: volumes, instances and meshes of arrays, by their places in its lists, from 0,
/// and the camera of a frame.
struct SceneArrays {
  struct Mesh {
    std::shared_ptr<const TriangleMesh> mesh;
    std::string content;  ///< SurfaceSettings::mesh_content
  };
  struct Instances {
    std::shared_ptr<const InstanceList> list;
    std::string content;  ///< InstanceSettings::arrays_content
  };
  std::map<size_t, std::shared_ptr<const VolumeGrids>> volumes;
  std::map<size_t, Instances> instances;
  std::map<size_t, Mesh> meshes;
  std::shared_ptr<const CameraMatrices> camera;  ///< instead of the text's
};

struct Scene {
  std::string name;
  CameraSettings camera;
  FilmSettings film;
  RenderSettings render;
  EnvironmentSettings environment;
  std::vector<VolumeSettings> volumes;
  std::vector<InstanceSettings> instances;
  std::vector<LightSettings> lights;
  std::vector<SurfaceSettings> surfaces;
  std::filesystem::path path;  ///< of the scene file
  std::string hash;            ///< of every value that decides the picture, the files' contents included
  std::string settings;        ///< a line for each of them that is not at its default: "camera.fov = 30"
};

/// A medium without an end.
inline bool is_everywhere(const VolumeSettings& volume) {
  return volume.shape == "everywhere";
}
/// Fog that falls off with height, without an end to the sides.
inline bool is_endless_layer(const VolumeSettings& volume) {
  return volume.shape == "layer" && volume.lo == volume.hi;
}
/// Whether what there is depends on where the camera is.
inline bool lies_around_camera(const Scene& scene) {
  return scene.environment.air > 0 || std::any_of(scene.volumes.begin(), scene.volumes.end(), [](const auto& v) {
           return is_everywhere(v) || is_endless_layer(v);
         });
}
/// Whether noise makes a volume's density finer, and whether that follows its velocity.
inline bool has_detail(const VolumeSettings& volume) {
  return volume.detail.given && volume.detail.amplitude > 0;
}
inline bool carries_detail(const VolumeSettings& volume) {
  return has_detail(volume) && volume.velocity_grid != "none";
}
/// The frame of its sequence that a volume shows.
inline double frame_of(const VolumeSettings& volume, int scene_frame) {
  return volume.time.given ? volume.moment.frame : scene_frame;
}
/// Hides what is behind it and is not seen itself.
inline bool is_holdout(const VolumeSettings& volume) {
  return volume.role == "holdout";
}
inline bool has_everywhere(const Scene& scene) {
  return std::any_of(scene.volumes.begin(), scene.volumes.end(), is_everywhere);
}

}  // namespace brume
