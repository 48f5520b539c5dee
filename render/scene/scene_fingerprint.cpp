#include "render/scene/scene_fingerprint.h"

#include <fmt/format.h>

#include <fstream>
#include <string>
#include <vector>

#include "base/rng.h"
#include "base/text.h"
#include "render/scene/scene_fields.h"

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
    std::ifstream stream(path, std::ios::binary);
    uint64_t h = 0;
    for (char buffer[1 << 16]; stream.read(buffer, sizeof buffer), stream.gcount() > 0;)
      h = hash(std::string_view(buffer, static_cast<size_t>(stream.gcount())), h);
    all_ += fmt::format("{:016x};", h);
    settings_ += fmt::format("{} = content {:016x}\n", key, h);
  }
  std::string hex() const { return fmt::format("{:016x}", hash(all_, 0)); }
  /// Lines, without the last one's end.
  std::string settings() const { return settings_.substr(0, settings_.size() - !settings_.empty()); }

 private:
  static uint64_t hash(std::string_view bytes, uint64_t h) {
    for (const char c : bytes) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001b3ull + 0x9e3779b97f4a7c15ull;
    return mix64(h);
  }
  std::string all_, settings_;
};

Fingerprint fingerprint(Scene scene) {
  Fingerprint print;
  // Samples, seed and frame are recorded beside the hash: parts of one render share it.
  const RenderSettings standard;
  scene.render.spp = standard.spp;
  scene.render.seed = standard.seed;
  scene.render.frame = standard.frame;
  print.table("camera", scene.camera);
  print.table("film", scene.film);
  print.table("render", scene.render);
  print.table("environment", scene.environment);
  print.file("camera.from_exr", scene.camera.from_exr);
  print.file("environment.file", scene.environment.file);
  const auto each = [&](const char* name, auto& tables, const auto& files_of) {
    for (size_t i = 0; i < tables.size(); ++i) {
      const std::string table = fmt::format("{}.{}", name, i);
      print.table(table, tables[i]);
      files_of(table, tables[i]);
    }
  };
  each("volumes", scene.volumes,
       [&](const std::string& t, const VolumeSettings& v) { print.file(t + ".file", v.file); });
  each("lights", scene.lights, [](const auto&...) {});
  each("surfaces", scene.surfaces, [&](const std::string& t, const SurfaceSettings& s) {
    print.file(t + ".file", s.file);
    print.file(t + ".albedo_texture", s.albedo_texture);
  });
  return print;
}

}  // namespace

void add_fingerprint(Scene& scene) {
  const Fingerprint print = fingerprint(scene);
  scene.hash = print.hex();
  scene.settings = print.settings();
}

}  // namespace brume
