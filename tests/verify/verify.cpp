// The long run: estimators held to closed forms and to one another with many more paths than the tests can afford.
// Prints a Markdown table and fails where a row is more than 4.5 standard errors off. Called by ./run verify.

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <span>

#include "base/progress.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

bool all_well = true;

/// @param expected_error  of the expected value; 0 where it is exact   @param last_digit  half a unit of a printed
/// table
void row(const std::string& what, double value, double error, double expected, double expected_error, double last_digit,
         int spp) {
  const double sigma = std::hypot(error, expected_error);
  const double off = std::max(0.0, std::abs(value - expected) - last_digit) / std::max(sigma, 1e-300);
  const bool well = off <= 4.5;
  all_well = all_well && well;
  fmt::print("| {} | {} | {:.6f} | {:.6f} | {:.4f} % | {:.4f} % | {} |\n", what, spp, value, expected,
             100 * (value / expected - 1), 100 * (4.5 * sigma + last_digit) / std::abs(expected),
             well ? "holds" : "**does not hold**");
  std::fflush(stdout);
}

test::Mean render(const Scene& scene, int spp, int64_t seed, const LayerName& layer = layer::beauty) {
  return test::mean_radiance(
      PreparedScene(scene, LayerRequest::of({"direct", "indirect"}, true)).render(spp, seed, {}).layers, layer);
}

void furnaces() {
  for (const char* majorants : {"cells", "global"}) {
    Scene s = test::scene_of(test::source("data/volumes/cloud.vdb"), 20, 1, 0.8);
    s.film.width = s.film.height = 64;
    s.environment.radiance = dvec3(1);
    s.render.light_sampling = "all";
    s.render.majorants = majorants;
    const int spp = 4000;
    const test::Mean m = render(s, spp, 1);
    row(fmt::format("white furnace, light sampling, majorants = {}", majorants), m.value.x, m.error.x, 1, 0, 0, spp);
  }
  Scene s = test::scene_of(test::source("data/volumes/smoke.vdb"), 20, 0.6, 0.3);
  s.film.width = s.film.height = 64;
  s.environment.radiance = dvec3(1);
  s.volumes[0].sigma_t = dvec3(20, 8, 3);
  s.volumes[0].emission = s.volumes[0].sigma_t * 0.4;
  const int spp = 4000;
  const test::Mean m = render(s, spp, 1);
  for (int c = 0; c < 3; ++c)
    row(fmt::format("equilibrium furnace, chromatic, channel {}", c), m.value[c], m.error[c], 1, 0, 0, spp);
}

void slabs() {
  struct Slab {
    double tau, albedo, up;
  };
  const test::TemporaryFolder folder;
  test::write_affine_vdb(folder / "slab.vdb", {{-8, -8, -10}, {8, 8, 10}}, test::scaling(dvec3(1e5, 1e5, 0.05)),
                         [](const ivec3&) { return 1.0f; });
  for (const Slab& slab : {Slab{1, 1, .08575}, Slab{1, .9, .06685}, Slab{4, 1, .21281}, Slab{10, 1, .27751}}) {
    Scene s;
    s.film.width = s.film.height = 32;
    s.camera.position = dvec3(0, 0, 50);
    s.camera.up = dvec3(0, 1, 0);
    s.camera.fov = 0.01;
    s.volumes.emplace_back();
    s.volumes[0].file = folder / "slab.vdb";
    s.volumes[0].albedo = dvec3(slab.albedo);
    s.volumes[0].sigma_t = dvec3(slab.tau / (21 * 0.05));
    LightSettings sun;
    sun.type = "sun";
    sun.direction = dvec3(0, 0, 1);
    sun.irradiance = dvec3(1);
    sun.angular_diameter = 0;
    s.lights.push_back(sun);
    const int spp = 20000;
    const test::Mean m = render(s, spp, 3);
    row(fmt::format("slab, optical depth {}, albedo {}: reflected radiance", slab.tau, slab.albedo), m.value.x,
        m.error.x, slab.up, 0, 5e-6, spp);
  }
}

void demo_scenes() {
  for (const char* name : {"cloud", "smoke"}) {
    Scene s = read_scene(test::source(std::string("data/scenes/") + name + ".toml"));
    s.film.width = s.film.height = 100;
    const int spp = 2000;
    const auto frame = [&](int64_t seed) {
      return PreparedScene(s, LayerRequest::of({"direct", "indirect"}, true)).render(spp, seed, {}).layers;
    };
    s.render.first_collision = "free";
    const Layers lanes = frame(1);
    s.render.first_collision = "forced";
    const Layers forced = frame(5);
    s.render.first_collision = "free";
    s.render.majorant_scale = 3;
    const Layers loose = frame(2);
    s.render.majorant_scale = 1;
    s.render.lookup = "interpolated";
    const Layers interpolated = frame(3);
    s.render.majorants = "global";
    const Layers in_double = frame(4);
    for (const LayerName& l : {layer::direct, layer::indirect}) {
      const test::Mean expected = test::mean_radiance(in_double, l);
      for (const auto& [what, layers] : {std::pair("lanes", &lanes),
                                         {"lanes, forced first collisions", &forced},
                                         {"lanes, majorants tripled", &loose},
                                         {"lanes, interpolated look-ups", &interpolated}}) {
        const test::Mean m = test::mean_radiance(*layers, l);
        row(fmt::format("{}, {}: {} against double precision", name, l.label(), what), m.value.y, m.error.y,
            expected.value.y, expected.error.y, 0, spp);
      }
    }
  }
}

void lanes_against_double(const char* name, Scene s, int spp, std::span<const LayerName> layers) {
  std::vector<std::string> names;
  for (const LayerName& l : layers) names.emplace_back(l.name);
  const auto frame = [&](const char* majorants, int64_t seed) {
    s.render.majorants = majorants;
    return PreparedScene(s, LayerRequest::of(names, true)).render(spp, seed, {}).layers;
  };
  const Layers lanes = frame("cells", 1), in_double = frame("global", 2);
  for (const LayerName& l : layers) {
    const test::Mean m = test::mean_radiance(lanes, l), expected = test::mean_radiance(in_double, l);
    row(fmt::format("{}, {}: lanes against double precision", name, l.label()), m.value.y, m.error.y, expected.value.y,
        expected.error.y, 0, spp);
  }
}

// Lights that stand in and before a grid: rays end on them, and the choice between them depends on the point.
void lamps() {
  Scene s = read_scene(test::source("data/scenes/smoke.toml"));
  s.film.width = s.film.height = 100;
  s.volumes[0].phase = "two_lobes";
  s.volumes[0].g2 = 0.6;
  s.volumes[0].lobe_weight = 0.5;
  s.environment.radiance = dvec3(0);
  s.lights.assign(3, {});
  s.lights[0].type = "sphere";
  s.lights[0].position = dvec3(0, 0, 1.5);
  s.lights[0].radius = 0.4;
  s.lights[0].radiance = dvec3(5);
  s.lights[0].visible_to_camera = true;
  s.lights[1].type = "rectangle";
  s.lights[1].position = dvec3(-1.5, -1.5, 2);
  s.lights[1].radiance = dvec3(4);
  s.lights[1].edge_x = dvec3(0, 1, 0.3);
  s.lights[1].edge_y = dvec3(1, 0.2, 0);
  s.lights[2].type = "point";
  s.lights[2].position = dvec3(1.5, -1, 1);
  s.lights[2].intensity = dvec3(3);
  lanes_against_double("smoke among lamps", s, 2000, std::array{layer::direct, layer::indirect});
}

void fire() {
  Scene s = read_scene(test::source("data/scenes/fire.toml"));
  s.film.width = s.film.height = 100;
  s.surfaces.clear();
  lanes_against_double("fire without meshes", s, 2000, std::array{layer::emission, layer::direct, layer::indirect});
}

// A lamp in fog: its near part along flights against collisions alone. The lamp is beyond the picture's edge: close to
// it the collisions' estimate has no bounded variance to compare with.
void lamp_in_fog() {
  Scene s;
  s.film.width = s.film.height = 64;
  s.camera.position = dvec3(-2.5, -6, 0);
  s.camera.look_at = dvec3(-2.5, 0, 0);
  s.camera.fov = 30;
  s.volumes.emplace_back();
  s.volumes[0].shape = "box";
  s.volumes[0].sigma_t = dvec3(0.8);
  s.volumes[0].albedo = dvec3(0.8);
  s.volumes[0].g = 0.3;
  for (int a = 0; a < 3; ++a) s.volumes[0].object_to_world[a][a] = 4;
  s.volumes[0].object_to_world[0][0] = 8;
  LightSettings lamp;
  lamp.type = "point";
  lamp.position = dvec3(0);
  lamp.intensity = dvec3(2);
  s.lights.push_back(lamp);
  const int spp = 2000;
  for (const LayerName& l : {layer::direct, layer::indirect}) {
    s.render.near_lights = "off";
    const test::Mean whole = render(s, spp, 1, l);
    s.render.near_lights = "auto";
    const test::Mean split = render(s, spp, 2, l);
    row(fmt::format("lamp in fog, {}: equiangular near part against collisions", l.label()), split.value.x,
        split.error.x, whole.value.x, whole.error.x, 0, spp);
  }
}

}  // namespace
}  // namespace brume

int main() {
  using namespace brume;
  const Stopwatch watch;
  fmt::print(
      "| what | spp | measured | expected | difference | smallest bias found | |\n|---|---:|---:|---:|---:|---:|---|\n");
  furnaces();
  slabs();
  demo_scenes();
  lamps();
  fire();
  lamp_in_fog();
  fmt::print("\n{} in all.\n", format_duration(watch.seconds()));
  return all_well ? 0 : 1;
}
