#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/vec.h"

namespace brume {

// Plain data of a scene. Keys, units, ranges and meanings stand once, in scene_fields.h.

struct CameraSettings {
  dvec3 position{0}, look_at{0}, up{0, 0, 1};
  double fov = 40;
  std::string fov_axis = "x";
};

struct FilmSettings {
  int width = 400, height = 400;
  double exposure = 1.0;
};

struct VolumeSettings {
  std::filesystem::path file;
  std::string grid;
  double sigma_t = 1.0;
  dvec3 albedo{0.8};
  double g = 0.0;
  dmat4 object_to_world{1};
  dvec3 index_offset{0};
  bool convert_level_set = false;
};

struct EnvironmentSettings {
  dvec3 radiance{0};
  std::filesystem::path file;
  double rotation = 0;
  dvec3 up{0, 0, 1};
  bool visible_to_camera = true;
};

struct LightSettings {
  std::string type;
  dvec3 direction{0}, irradiance{0};
  double angular_diameter = 0.53;
  dvec3 position{0}, radiance{0};
  double radius = 0;
  bool visible_to_camera = false;
};

struct RenderSettings {
  int spp = 64;
  int64_t seed = 0;
  int frame = 0;
  int max_events = 100000;
  int roulette_start = 16;
  std::string light_sampling = "auto";
  double surface_density = 0.01;
};

struct Scene {
  std::string name;
  CameraSettings camera;
  FilmSettings film;
  RenderSettings render;
  EnvironmentSettings environment;
  std::vector<VolumeSettings> volumes;
  std::vector<LightSettings> lights;
  std::filesystem::path path;  ///< of the scene file
  std::string hash;            ///< of every value that decides the picture, the files' contents included
};

}  // namespace brume
