#include "tests/support/random_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/rng.h"
#include "base/text.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume::test {
namespace {

namespace fs = std::filesystem;

// Seeds beyond it hold a layer of fog, too; the others are the scenes that they were before there was one.
constexpr uint64_t kLastWithoutFog = 1000;
// The same of detail in most of the grids.
constexpr uint64_t kLastWithoutDetail = 2000;
// The same of a volume that stands at several places, and of the phase functions of dust and air.
constexpr uint64_t kLastWithoutPlaces = 3000;

std::string text_of(double v) {
  return fmt::format("{:.3g}", v);
}
std::string text_of(const dvec3& v) {
  return fmt::format("[{:.3g}, {:.3g}, {:.3g}]", v.x, v.y, v.z);
}
/// Uniform scale and translation.
std::string placement(double scale, const dvec3& at) {
  return fmt::format("[[{0:.3g}, 0, 0, {1:.3g}], [0, {0:.3g}, 0, {2:.3g}], [0, 0, {0:.3g}, {3:.3g}], [0, 0, 0, 1]]",
                     scale, at.x, at.y, at.z);
}

/// Draws a scene and writes it down table by table. No expression draws twice but in braces, whose order is fixed.
class Writer {
 public:
  Writer(uint64_t seed, fs::path folder, int most_media)
      : seed_(seed), folder_(std::move(folder)), most_media_(most_media), rng_(mix64(seed)) {}

  RandomScene write() {
    head();
    media();
    const int surfaces = below(3);
    for (int i = 0; i < surfaces; ++i) surface(i);
    lights();
    if (seed_ > kLastWithoutFog) fog();
    RandomScene result;
    result.seed = seed_;
    result.toml = "name = \"random_" + std::to_string(seed_) + "\"\n" + camera_ + environment_ + tables_;
    result.kinds = kinds_;
    const fs::path path = folder_ / (std::to_string(seed_) + ".toml");
    write_file(path, result.toml);
    result.scene = parse_scene(result.toml, path);
    return result;
  }

 private:
  struct Body {
    dvec3 centre{0};
    double radius = 1;
    bool grid = false;
  };

  double between(double lo, double hi) { return lo + (hi - lo) * rng_.uniform(); }
  double between_logarithmically(double lo, double hi) { return lo * std::pow(hi / lo, rng_.uniform()); }
  int below(int n) { return std::min(n - 1, static_cast<int>(rng_.uniform() * n)); }
  bool chance(double share) { return rng_.uniform() < share; }
  dvec3 tint(double lo, double hi) { return {between(lo, hi), between(lo, hi), between(lo, hi)}; }
  void line(const std::string& key, const std::string& value) { tables_ += key + " = " + value + "\n"; }
  void line(const std::string& key, double value) { line(key, text_of(value)); }
  void line(const std::string& key, const dvec3& value) { line(key, text_of(value)); }
  void name(const std::string& key, const std::string& value) { line(key, "\"" + value + "\""); }
  std::string file(const char* what, const char* suffix) {
    return fmt::format("{}_{}_{}{}", seed_, what, files_++, suffix);
  }
  void is(const std::string& kind) { kinds_.insert(kind); }

  /// The camera looks at the first body, from five radii away or from within.
  void head() {
    first_.centre = dvec3{between(-0.2, 0.2), between(-0.2, 0.2), 1.2};
    first_.radius = between(0.7, 1.1);
    inside_ = chance(0.15);
    dvec3 eye = first_.centre + dvec3{between(-2.5, 2.5), -between(4.0, 5.5), between(-0.2, 1.5)};
    if (inside_) eye = first_.centre + 0.4 * first_.radius * random_direction(rng_);
    is(inside_ ? "camera inside" : "camera outside");
    dvec3 look_at = first_.centre;
    if (inside_) look_at = eye + random_direction(rng_) * dvec3(1, 1, 0.3);
    camera_ = "\n[camera]\nposition = " + text_of(eye) + "\nlook_at = " + text_of(look_at) +
              "\nfov = " + text_of(inside_ ? 60.0 : between(24, 34)) + "\n";
    if (!inside_ && chance(0.15)) {
      is("lens");
      camera_ += "lens_radius = " + text_of(between(0.03, 0.15)) + "\n";
    }
    moves_ = chance(0.25);
    if (moves_) {
      camera_ += "shutter = [-0.25, 0.25]\n";
      if (chance(0.5)) {
        is("moving camera");
        camera_ += "position_end = " + text_of(eye + dvec3(0.1, 0, 0.05)) + "\n";
      }
    }
    camera_ += "\n[film]\nwidth = 32\nheight = 24\n";
  }

  void media() {
    bodies_.push_back(first_);
    const int count = 1 + below(most_media_);
    for (int i = 1; i < count; ++i) {
      const Body& other = bodies_[static_cast<size_t>(below(i))];
      Body body{{}, between(0.4, 1.0), false};
      const double reach = body.radius + other.radius;
      switch (below(4)) {
        case 0:
          is("apart");
          body.centre = other.centre + dvec3((chance(0.5) ? 1.15 : -1.15) * reach, 0, 0);
          break;
        case 1:
          is("overlapping");
          body.centre = other.centre + 0.5 * reach * random_direction(rng_);
          break;
        case 2:
          is("behind");
          body.centre = other.centre + dvec3{between(-0.3, 0.3), (chance(0.5) ? 1.2 : -1.2) * reach, 0};
          break;
        default:
          is("inside");
          body.radius = 0.45 * other.radius;
          body.centre = other.centre + 0.3 * other.radius * random_direction(rng_);
      }
      bodies_.push_back(body);
    }
    is(fmt::format("{} media", count));
    for (Body& body : bodies_) medium(body);
    if (seed_ > kLastWithoutPlaces) places();
  }

  /// One of the volumes at two to four places around its own: turned, smaller, denser, darker; they overlap.
  void places() {
    is("instances");
    const int volume = below(static_cast<int>(bodies_.size()));
    const Body& body = bodies_[static_cast<size_t>(volume)];
    tables_ += "\n[[instances]]\n";
    line("volume", std::to_string(volume));
    std::string matrices;
    const int count = 2 + below(3);
    for (int i = 0; i < count; ++i) {
      const Frame turned(random_direction(rng_));
      const dvec3 scale = tint(0.5, 0.9);
      const dmat3 m(turned.x * scale.x, turned.y * scale.y, turned.z * scale.z);
      const dvec3 at = body.centre + 0.5 * body.radius * random_direction(rng_) - m * body.centre;
      matrices += i > 0 ? ", [" : "[";
      for (int row = 0; row < 3; ++row)
        matrices += fmt::format("[{:.4g}, {:.4g}, {:.4g}, {:.4g}], ", m[0][row], m[1][row], m[2][row], at[row]);
      matrices += "[0, 0, 0, 1]]";
    }
    line("matrices", "[" + matrices + "]");
    line("density", between(0.5, 1.5));
    line("tint", tint(0.7, 1));
  }

  void medium(Body& body) {
    tables_ += "\n[[volumes]]\n";
    const int shape = below(5);
    body.grid = shape > 1;
    if (body.grid) {
      is("grid");
      grid(body);
      if (seed_ > kLastWithoutDetail && chance(0.8)) detail();
    } else {
      is(shape == 0 ? "box" : "sphere");
      name("shape", shape == 0 ? "box" : "sphere");
      const dvec3 half = body.radius * (shape == 0 ? dvec3(0.75, 0.6, 0.7) : dvec3(1));
      line("lo", body.centre - half);
      line("hi", body.centre + half);
    }
    const double sigma = between_logarithmically(0.3, inside_ ? 3 : 12) / (2 * body.radius);
    if (chance(0.2)) {
      is("chromatic");
      line("sigma_t", sigma * tint(0.5, 1.5));
    } else {
      line("sigma_t", sigma);
    }
    if (chance(0.3)) {
      is("coloured");
      line("albedo", tint(0.4, 0.99));
    } else {
      line("albedo", 1 - between_logarithmically(0.005, 0.5));
    }
    phase();
    if (chance(0.2)) {
      is("emissive");
      line("emission", 0.3 / body.radius * tint(0.1, 1));
    }
  }

  void phase() {
    if (seed_ > kLastWithoutPlaces && chance(0.6)) {
      const bool dust = chance(0.5);
      is(dust ? "draine" : "rayleigh");
      name("phase", dust ? "draine" : "rayleigh");
      if (dust) line("g", between(0, 0.7));
      if (dust) line("draine_alpha", between(0.1, 1));
      return;
    }
    switch (below(6)) {
      case 0:
        break;
      case 1:
        is("two lobes");
        name("phase", "two_lobes");
        line("g", between(0.3, 0.8));
        line("g2", -between(0.1, 0.4));
        line("lobe_weight", between(0.1, 0.4));
        break;
      case 2:
        is("mie");
        name("phase", "mie");
        line("droplet_diameter", between(5, 30));
        break;
      default:
        line("g", between(-0.4, 0.8));
    }
  }

  void detail() {
    is("detail");
    const double amplitude = between(0.3, 1), frequency = between_logarithmically(0.15, 1.5);
    const int octaves = 1 + below(4), seed = below(100);
    line("detail", fmt::format("{{ amplitude = {}, frequency = {}, octaves = {}, seed = {} }}", text_of(amplitude),
                               text_of(frequency), octaves, seed));
  }

  /// A layer that falls off with height, around everything or in a box.
  void fog() {
    tables_ += "\n[[volumes]]\n";
    name("shape", "layer");
    if (chance(0.5)) {
      is("endless layer");
    } else {
      is("layer");
      line("lo", first_.centre - dvec3{between(1, 2.5), between(1, 2.5), 1.1});
      line("hi", first_.centre + dvec3{between(1, 2.5), between(1, 2.5), between(0.2, 2)});
    }
    line("up", dvec3{between(-0.2, 0.2), between(-0.2, 0.2), 1});
    line("base_height", between(-0.3, 0.8));
    line("scale_height", between_logarithmically(0.2, 1.5));
    const double sigma = between_logarithmically(0.05, 0.4);
    const bool chromatic = chance(0.3);
    if (chromatic) is("chromatic");
    line("sigma_t", chromatic ? sigma * tint(0.5, 1.5) : dvec3(sigma));
    line("albedo", tint(0.6, 0.99));
    if (chance(0.4)) {
      is("fournier_forand");
      name("phase", "fournier_forand");
      line("particle_index", between(1.05, 1.2));
      line("size_slope", between(3.6, 4.6));
    } else {
      line("g", between(-0.2, 0.7));
    }
  }

  /// Density of a few waves that falls off towards the rim; turned, and its voxels stretched.
  void grid(const Body& body) {
    constexpr int kHalf = 12;
    const Frame frame(random_direction(rng_));
    const dvec3 stretch = body.radius / kHalf * tint(0.8, 1);
    dmat4 world_from_index(dmat3(frame.x * stretch.x, frame.y * stretch.y, frame.z * stretch.z));
    world_from_index[3] = glm::dvec4(body.centre, 1.0);
    const dvec3 wave = tint(0.2, 0.7), phase = tint(0, 6);
    const auto density = [&](const ivec3& v) {
      const double r = glm::length(dvec3(v)) / kHalf;
      const SinCos x = portable_sincos_2pi(wave.x * v.x / 6.0 + phase.x),
                   y = portable_sincos_2pi(wave.y * v.y / 6.0 + phase.y),
                   z = portable_sincos_2pi(wave.z * v.z / 6.0 + phase.z);
      return static_cast<float>(std::max(0.0, (1 - r) * 2 + 0.7 * (x.sin + y.sin + z.sin) / 1.5));
    };
    const VoxelBox box{ivec3(-kHalf), ivec3(kHalf)};
    const auto round = [&](const ivec3& v) { return glm::length(dvec3(v)) < kHalf ? density(v) : 0.0f; };
    const std::string path = file("grid", ".vdb");
    if (moves_ && chance(0.7)) {
      is("velocities");
      const std::string still = file("still", ".vdb");
      write_affine_vdb(folder_ / still, box, world_from_index, round);
      write_velocity_vdb(folder_ / path, folder_ / still, box, 0.25 * random_direction(rng_));
      fs::remove(folder_ / still);
      name("file", path);
      name("velocity_grid", "auto");
      return;
    }
    name("file", path);
    if (chance(0.2)) {
      is("colour grid");
      write_coloured_vdb(folder_ / path, box, round,
                         [&](const ivec3& v) { return vec3(v + kHalf) / (2.0f * kHalf + 1) * 0.6f + 0.4f; });
      name("albedo_grid", "auto");
      line("object_to_world", placement(body.radius / kHalf, body.centre));
      return;
    }
    write_affine_vdb(folder_ / path, box, world_from_index, round);
    if (moves_) {
      is("moving object");
      line("object_to_world", placement(1, dvec3(0)));
      line("object_to_world_end", placement(1, dvec3(0.15, 0, 0.05)));
    }
  }

  void mesh(const char* which) {
    const std::string path = std::string(which) + ".obj";
    fs::copy_file(source("data/meshes/" + path), folder_ / path, fs::copy_options::overwrite_existing);
    name("file", path);
  }

  void surface(int i) {
    tables_ += "\n[[surfaces]]\n";
    if (i == 0 && chance(0.6)) {
      is("floor");
      mesh("floor");
      line("albedo", tint(0.2, 0.6));
      return;
    }
    mesh("ball");
    switch (below(5)) {
      case 3:
        is("coated ball");
        name("material", "coated");
        line("albedo", tint(0.1, 0.8));
        line("roughness", between(0.1, 0.7));
        break;
      case 0:
        is("diffuse ball");
        line("albedo", tint(0.1, 0.8));
        break;
      case 1:
        is("mirror");
        name("material", "conductor");
        line("albedo", tint(0.7, 0.98));
        line("roughness", 0.0);
        break;
      case 2:
        is("rough metal");
        name("material", "conductor");
        line("albedo", tint(0.7, 0.98));
        line("roughness", between(0.2, 0.6));
        break;
      default:
        is("glass");
        name("material", "dielectric");
        line("roughness", 0.0);
        name("shadow", "straight");
    }
    // Beside the first body, before it, behind it or within.
    static const dvec3 kPlaces[] = {{1.5, -0.3, -0.5}, {-1.5, -0.2, 0}, {0.3, -1.7, -0.3}, {0, 1.8, 0.2}, {0, 0, 0.1}};
    const int place = below(inside_ ? 2 : 5);
    if (place == 4) is("mesh inside");
    line("object_to_world", placement(between(0.25, 0.5), first_.centre + first_.radius * kPlaces[place]));
  }

  /// Each light gives the first body an irradiance of about 1 to 3.
  void lights() {
    const int sky = below(5);
    environment_ = "\n[environment]\n";
    if (sky == 0) {
      is("daylight sky");
      const double turbidity = between(2, 6);
      environment_ += fmt::format("sky = \"preetham\"\nradiance = 0.04\nturbidity = {:.2g}\nsun_direction = {}\n",
                                  turbidity, text_of(dvec3{between(-1, 1), between(-1, 1), between(0.3, 1)}));
    } else if (sky == 1) {
      is("picture");
      const std::string path = file("sky", ".exr");
      Layers picture(16, 8);
      for (Plane* p : picture.add_rgb(layer::beauty)) {
        const double level = between(0.1, 0.5);
        for (int y = 0; y < 8; ++y)
          for (int x = 0; x < 16; ++x) (*p)(x, y) = static_cast<float>(level * (y < 4 ? 1 + (x % 8 == 3) * 4 : 0.4));
      }
      write_exr(folder_ / path, picture);
      environment_ += "radiance = 1\nfile = \"" + path + "\"\n";
    } else {
      is("constant sky");
      const double level = between_logarithmically(0.02, 0.5);
      environment_ += "radiance = " + text_of(level * tint(0.6, 1.2)) + "\n";
    }
    const int count = sky == 0 ? below(2) : 1 + below(2);
    for (int i = 0; i < count; ++i) light();
  }

  void light() {
    const int type = below(7);
    const double level = between(1, 3);
    const dvec3 colour = level * tint(0.6, 1);
    // Points of no size in a grid would have no mean that samples find.
    const bool within = chance(0.25) && (!first_.grid || type == 2 || type == 3) && !bodies_[0].grid;
    const double distance = within ? 0.4 * first_.radius : between(1.8, 3) * first_.radius;
    dvec3 towards = random_direction(rng_);
    towards.z = std::abs(towards.z);
    const dvec3 at = first_.centre + distance * towards;
    if (type > 1 && within) is("light inside");
    if (type == 6) {
      is("mesh light");
      tables_ += "\n[[surfaces]]\n";
      mesh("ball");
      line("albedo", 0.0);
      line("radiance", colour * (distance * distance) / (0.2 * 0.2 * kPi));
      line("object_to_world", placement(0.2, at));
      return;
    }
    tables_ += "\n[[lights]]\n";
    switch (type) {
      case 0:
      case 1:
        is("sun");
        name("type", "sun");
        line("direction", dvec3(towards.x, towards.y, towards.z + 0.2));
        line("irradiance", colour);
        line("angular_diameter", chance(0.3) ? 0.0 : between(0.5, 4));
        break;
      case 2:
        is("sphere light");
        name("type", "sphere");
        line("position", at);
        line("radius", 0.15);
        line("radiance", colour * (distance * distance) / (0.15 * 0.15 * kPi));
        break;
      case 3: {
        is("rectangle");
        const Frame frame(-towards);
        name("type", "rectangle");
        line("position", at);
        line("edge_x", 0.5 * frame.x);
        line("edge_y", 0.4 * frame.y);
        line("two_sided", within ? "true" : "false");
        line("radiance", colour * (distance * distance / 0.2));
        break;
      }
      case 4:
        is("point");
        name("type", "point");
        line("position", at);
        line("intensity", colour * (distance * distance));
        break;
      default:
        is("spot");
        name("type", "spot");
        line("position", at);
        line("direction", -towards);
        line("cone_angle", between(30, 80));
        line("intensity", colour * (distance * distance));
    }
  }

  uint64_t seed_;
  fs::path folder_;
  int most_media_;
  Rng rng_;
  std::string camera_, environment_, tables_;
  std::set<std::string> kinds_;
  std::vector<Body> bodies_;
  Body first_;
  bool inside_ = false, moves_ = false;
  int files_ = 0;
};

}  // namespace

std::string RandomScene::text() const {
  return join(std::vector<std::string>(kinds.begin(), kinds.end()));
}

RandomScene random_scene(uint64_t seed, const fs::path& folder, int most_media) {
  return Writer(seed, folder, most_media).write();
}

}  // namespace brume::test
