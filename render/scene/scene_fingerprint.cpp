#include "render/scene/scene_fingerprint.h"

#include <fmt/format.h>

#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "base/text.h"
#include "render/scene/scene_fields.h"
#include "render/scene/volume_time.h"
#include "volume/volume_grids.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

/// The values of one table as text, in the order of their declarations.
class SettingTexts {
 public:
  template <class T>
  void operator()(const Field& field, T& value) {
    keys.push_back(field.key);
    texts.push_back(text(value));
  }
  std::vector<std::string> keys, texts;

 private:
  static std::string text(const dvec2& v) { return fmt::format("[{}, {}]", v.x, v.y); }
  static std::string text(const dvec3& v) { return fmt::format("[{}, {}, {}]", v.x, v.y, v.z); }
  static std::string text(const dmat4& m) {
    std::vector<std::string> rows;
    for (int row = 0; row < 4; ++row)
      rows.push_back(fmt::format("[{}, {}, {}, {}]", m[0][row], m[1][row], m[2][row], m[3][row]));
    return "[" + join(rows) + "]";
  }
  static std::string text(const std::vector<dmat4>& matrices) {
    uint64_t hash = 0;
    for (const dmat4& m : matrices)
      for (const char c : text(m)) hash = mix64(hash ^ static_cast<unsigned char>(c));
    return matrices.empty() ? "none" : fmt::format("{} matrices, content {:016x}", matrices.size(), hash);
  }
  static std::string text(const VolumeTime& time) { return text_of_table(time); }
  static std::string text(const VolumeDetail& detail) { return text_of_table(detail); }
  template <class Table>
  static std::string text_of_table(Table table) {
    if (!table.given) return "none";
    SettingTexts set;
    describe(set, table);
    std::string all;
    for (size_t i = 0; i < set.keys.size(); ++i)
      all += fmt::format("{}{} = {}", i ? ", " : "", set.keys[i], set.texts[i]);
    return "{" + all + "}";
  }
  static std::string text(const fs::path&) { return ""; }  // by content, not by name
  template <class Entry>
  static std::string text(const std::vector<Entry>& entries) {
    std::vector<std::string> texts;
    for (const Entry& entry : entries) texts.push_back(text(entry));
    return "[" + join(texts) + "]";
  }
  template <class T>
  static std::string text(const T& value) {
    return fmt::format("{}", value);
  }
};

/// Everything that decides the picture, as text: for the hash, and what is not at its default for people.
class Fingerprint {
 public:
  explicit Fingerprint(FileHashes* known) : known_(known) {}

  template <class Settings>
  void table(const std::string& name, Settings& settings) {
    SettingTexts set, standard;
    Settings plain;
    describe(set, settings);
    describe(standard, plain);
    for (size_t i = 0; i < set.keys.size(); ++i) {
      all_ += fmt::format("{}={};", set.keys[i], set.texts[i]);
      if (set.texts[i] != standard.texts[i]) settings_ += fmt::format("{}.{} = {}\n", name, set.keys[i], set.texts[i]);
    }
  }
  void file(const std::string& key, const fs::path& path) {
    if (path.empty()) return;
    uint64_t h = 0;
    const auto found = known_ ? known_->find(path) : FileHashes::iterator();
    if (known_ && found != known_->end()) {
      h = found->second;
    } else {
      std::ifstream stream(path, std::ios::binary);
      for (char buffer[1 << 16]; stream.read(buffer, sizeof buffer), stream.gcount() > 0;)
        h = hash(std::string_view(buffer, static_cast<size_t>(stream.gcount())), h);
      if (known_) known_->emplace(path, h);
    }
    content(key, fmt::format("{:016x}", h));
  }
  void content(const std::string& key, const std::string& hash) {
    all_ += hash + ";";
    settings_ += fmt::format("{} = content {}\n", key, hash);
  }
  std::string hex() const { return fmt::format("{:016x}", hash(all_, 0)); }
  /// Lines, without the last one's end.
  std::string settings() const { return settings_.substr(0, settings_.size() - !settings_.empty()); }

 private:
  static uint64_t hash(std::string_view bytes, uint64_t h) {
    for (const char c : bytes) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001b3ull + 0x9e3779b97f4a7c15ull;
    return mix64(h);
  }
  FileHashes* known_;
  std::string all_, settings_;
};

Fingerprint fingerprint(Scene scene, FileHashes* known) {
  Fingerprint print(known);
  // Samples, seed and frame are recorded beside the hash: parts of one render share it.
  const RenderSettings standard;
  scene.render.spp = standard.spp;
  scene.render.seed = standard.seed;
  const int frame = std::exchange(scene.render.frame, standard.frame);
  print.table("camera", scene.camera);
  print.table("film", scene.film);
  print.table("render", scene.render);
  print.table("environment", scene.environment);
  print.file("camera.from_exr", scene.camera.from_exr);
  if (const auto& m = scene.camera.matrices)
    print.content("camera.matrices",
                  fmt::format("{} {}", fmt::join(m->world_to_camera, " "), fmt::join(m->world_to_ndc, " ")));
  print.file("environment.file", scene.environment.file);
  const auto each = [&](const char* name, auto& tables, const auto& files_of) {
    for (size_t i = 0; i < tables.size(); ++i) {
      const std::string table = fmt::format("{}.{}", name, i);
      print.table(table, tables[i]);
      files_of(table, tables[i]);
    }
  };
  each("volumes", scene.volumes, [&](const std::string& t, VolumeSettings& v) {
    for (const auto& [key, file] : kVolumeFiles) print.file(t + "." + key, v.*file);
    if (v.time.given) {
      const VolumeMoment& m = v.moment;
      print.content(t + ".time", fmt::format("{} {} {}", m.later ? m.share : 0, m.frames, m.rate));
      if (m.later)
        for (const auto& [key, file] : kVolumeFiles) print.file(t + ".later." + key, (*m.later).*file);
    }
    if (carries_detail(v)) print.content(t + ".detail", fmt::format("{}", frame_of(v, frame)));
    if (!v.grids || !v.grids->of_arrays()) return;
    print.table(t, v.placement);
    print.content(t + ".arrays", v.grids->content);
  });
  each("instances", scene.instances, [&](const std::string& t, const InstanceSettings& s) {
    print.file(t + ".file", s.file);
    if (!s.arrays_content.empty()) print.content(t + ".arrays", s.arrays_content);
  });
  each("lights", scene.lights, [](const auto&...) {});
  each("surfaces", scene.surfaces, [&](const std::string& t, const SurfaceSettings& s) {
    print.file(t + ".file", s.file);
    if (!s.mesh_content.empty()) print.content(t + ".arrays", s.mesh_content);
    print.file(t + ".albedo_texture", s.albedo_texture);
    print.file(t + ".alpha_texture", s.alpha_texture);
    print.file(t + ".radiance_texture", s.radiance_texture);
  });
  return print;
}

}  // namespace

void add_fingerprint(Scene& scene, FileHashes* known) {
  const Fingerprint print = fingerprint(scene, known);
  scene.hash = print.hex();
  scene.settings = print.settings();
}

std::string world_of(const Scene& scene) {
  std::string text;
  const auto add = [&](auto settings) {
    SettingTexts set;
    describe(set, settings);
    text += join(set.texts, ";") + "\n";
  };
  const auto add_file = [&](const fs::path& path) { text += path.string() + "\n"; };
  // A key that is not named here counts, so that a new one is safe before somebody thinks of it.
  CameraSettings camera = scene.camera;
  const CameraSettings any_camera;
  camera.type = any_camera.type;
  camera.position = any_camera.position;
  camera.look_at = any_camera.look_at;
  camera.up = any_camera.up;
  camera.fov = any_camera.fov;
  camera.width = any_camera.width;
  camera.fov_axis = any_camera.fov_axis;
  camera.shift = any_camera.shift;
  camera.pixel_aspect = any_camera.pixel_aspect;
  camera.lens_radius = any_camera.lens_radius;
  camera.focus_distance = any_camera.focus_distance;
  camera.blades = any_camera.blades;
  camera.blade_rotation = any_camera.blade_rotation;
  if (lies_around_camera(scene)) camera = scene.camera;
  add(camera);
  RenderSettings render = scene.render;
  const RenderSettings any_render;
  render.spp = any_render.spp;
  render.seed = any_render.seed;
  render.frame = any_render.frame;
  render.noise_frame = any_render.noise_frame;
  render.max_events = any_render.max_events;
  render.indirect_limit = any_render.indirect_limit;
  render.roulette_start = any_render.roulette_start;
  render.lookup = any_render.lookup;
  render.first_collision = any_render.first_collision;
  render.near_lights = any_render.near_lights;
  render.flash_relief = any_render.flash_relief;
  add(render);
  FilmSettings film;  // the rest of it is of the camera
  film.color_space = scene.film.color_space;
  add(film);
  add(scene.environment);
  add_file(scene.environment.file);
  for (const VolumeSettings& v : scene.volumes) {
    add(v);
    for (const auto& [key, file] : kVolumeFiles) add_file(v.*file);
    if (v.time.given) text += fmt::format("{} {} {}\n", v.moment.share, v.moment.frames, v.moment.rate);
    if (v.moment.later)
      for (const auto& [key, file] : kVolumeFiles) add_file((*v.moment.later).*file);
    if (carries_detail(v)) text += fmt::format("{}\n", frame_of(v, scene.render.frame));
    if (!v.grids || !v.grids->of_arrays()) continue;
    add(v.placement);
    text += v.grids->content + "\n";
  }
  text += "instances\n";
  for (const InstanceSettings& s : scene.instances) {
    add(s);
    add_file(s.file);
    text += s.arrays_content + "\n";
  }
  text += "lights\n";
  for (const LightSettings& light : scene.lights) add(light);
  text += "surfaces\n";
  for (const SurfaceSettings& s : scene.surfaces) {
    add(s);
    add_file(s.file);
    add_file(s.albedo_texture);
    add_file(s.alpha_texture);
    add_file(s.radiance_texture);
    text += s.mesh_content + "\n";
  }
  return text;
}

}  // namespace brume
