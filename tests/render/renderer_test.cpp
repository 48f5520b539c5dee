#include "render/session/renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "base/error.h"
#include "image/exr_io.h"
#include "render/scene/scene_io.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

Scene small_scene(const char* name = "smoke", int size = 40) {
  Scene scene = read_scene(test::source(std::string("data/scenes/") + name + ".toml"));
  scene.film.width = size;
  scene.film.height = size * 3 / 4;
  return scene;
}

TEST(Renderer, TheSameBitsForAnyNumberOfThreads) {
  for (const char* name : {"smoke", "cloud"}) {
    const PreparedScene scene(small_scene(name), {});
    const RenderResult one = scene.render(6, 3, {1, {}, nullptr});
    for (const int threads : {2, 7})
      test::expect_same_bits(one.layers, scene.render(6, 3, {threads, {}, nullptr}).layers);
    EXPECT_NE(one.layers.at("R")(20, 15), scene.render(6, 4, {}).layers.at("R")(20, 15))
        << "another seed, the same noise";
  }
}

TEST(Renderer, PagedVolumesAreTheSamePicture) {
  Scene scene = small_scene();
  scene.volumes[0].paging = "never";
  const PreparedScene in_memory(scene, {});
  scene.volumes[0].paging = "always";
  const PreparedScene paged(scene, {});
  test::expect_same_bits(in_memory.render(6, 3, {}).layers, paged.render(6, 3, {}).layers);
  const auto said = [](const PreparedScene& prepared) {
    return std::any_of(prepared.notes().begin(), prepared.notes().end(),
                       [](const std::string& note) { return note.find("are paged from") != std::string::npos; });
  };
  EXPECT_TRUE(said(paged));
  EXPECT_FALSE(said(in_memory));
}

TEST(Renderer, LayersAddUpExactly) {
  const RenderResult r = PreparedScene(small_scene("cloud"), {}).render(9, 1, {});
  const Layers& f = r.layers;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < f.height(); ++y)
      for (int x = 0; x < f.width(); ++x) {
        EXPECT_EQ((*f.rgb(layer::beauty)[c])(x, y),
                  (*f.rgb(layer::direct)[c])(x, y) + (*f.rgb(layer::indirect)[c])(x, y));
        EXPECT_NEAR(f.at("A")(x, y), 1 - (*f.rgb(layer::transmittance)[c])(x, y), 1e-6);
        EXPECT_LE(f.at("coverage.A")(x, y), 1.0f);
        EXPECT_EQ(f.at("sample_count.Y")(x, y), 9.0f);
        EXPECT_EQ(f.at("invalid_count.Y")(x, y), 0.0f);
        const vec3 g(f.at("gradient.X")(x, y), f.at("gradient.Y")(x, y), f.at("gradient.Z")(x, y));
        EXPECT_LE(glm::length(g), f.at("coverage.A")(x, y) + 1e-5f)
            << "a mean of unit vectors over the paths that met the surface";
      }
  EXPECT_EQ(f.text("biased"), "false");
  EXPECT_EQ(f.number("samplesPerPixel"), 9.0);
}

// The halves are independent and each unbiased: Var((A - B) / 2) is the variance of the mean. Over 1200 pixels the
// ratio is known to a few per cent; low-discrepancy samples may only make it smaller.
TEST(Renderer, HalvesAndVarianceTellTheSameNoise) {
  const RenderResult r = PreparedScene(small_scene(), {}).render(64, 1, {});
  const Layers& f = r.layers;
  for (const LayerName& l : {layer::beauty, layer::direct, layer::indirect}) {
    double halves = 0, variance = 0, mean_a = 0, mean_b = 0;
    for (int y = 0; y < f.height(); ++y)
      for (int x = 0; x < f.width(); ++x) {
        const double a = f.at(l.channel_of("half_a", 0))(x, y), b = f.at(l.channel_of("half_b", 0))(x, y);
        halves += (a - b) * (a - b) / 4;
        variance += f.at(l.channel_of("mean_variance", 0))(x, y);
        mean_a += a;
        mean_b += b;
        EXPECT_NEAR(0.5 * (a + b), f.at(l.channel(0))(x, y), 1e-5);
      }
    // The difference of the halves has four times the variance of the mean.
    EXPECT_LT(std::abs(mean_a - mean_b), 4.5 * 2 * std::sqrt(variance)) << l.label();
    EXPECT_GT(halves / variance, 0.55) << l.label();
    EXPECT_LT(halves / variance, 1.15) << l.label();
  }
}

TEST(Renderer, RecordsOnlyWhatIsAskedFor) {
  const PreparedScene scene(small_scene(), LayerRequest::of({"indirect"}, false));
  const std::vector<std::string> expected = {
      "A", "B", "G", "R", "indirect.B", "indirect.G", "indirect.R", "invalid_count.Y", "sample_count.Y"};
  EXPECT_EQ(scene.render(1, 1, {}).layers.names(), expected);
  EXPECT_FALSE(scene.plan().isosurface) << "nobody asked for the medium's isosurface";
  EXPECT_THROW(LayerRequest::of({"normals"}, true), InputError);
}

TEST(Renderer, ThePlanModelsWhatTheSceneHas) {
  EXPECT_TRUE(PreparedScene(small_scene(), {}).plan().light_sampling);
  Scene sky_only = small_scene();
  sky_only.lights.clear();
  EXPECT_FALSE(PreparedScene(sky_only, {}).plan().light_sampling) << "a constant sky needs no shadow rays";
  Scene empty = small_scene();
  empty.volumes[0].grid = "flame_noise";
  const PreparedScene absent(empty, {});
  EXPECT_FALSE(absent.plan().has_media());
  EXPECT_EQ(absent.notes().size(), 1u);
  const RenderResult r = absent.render(2, 1, {});
  EXPECT_EQ(r.layers.at("R")(5, 5), static_cast<float>(empty.environment.radiance.x))
      << "without a medium one sees the sky";
  EXPECT_EQ(r.layers.at("A")(5, 5), 0.0f);
}

TEST(Renderer, TheDepthCapIsCountedAndMarkedAsBias) {
  Scene scene = small_scene("cloud");
  scene.render.max_events = 3;
  const RenderResult r = PreparedScene(scene, {}).render(4, 1, {});
  EXPECT_GT(r.report.counters.capped_paths, 0u);
  EXPECT_NE(r.report.summary().find("cut at max_events"), std::string::npos);
  EXPECT_TRUE(r.layers.text("biased").starts_with("true"));
}

// The path is the same with and without a limit: what one sample loses is known, and so is what the picture loses.
TEST(Renderer, TheIndirectLimitBoundsEachSampleAndCountsWhatItTakes) {
  constexpr int kSpp = 6;
  const LayerRequest layers = LayerRequest::of({"direct", "indirect"}, true);
  const auto mean_of = [](const dvec3& v) { return (v.x + v.y + v.z) / 3; };
  const auto picture = [](const Layers& f, const LayerName& l) {
    double sum = 0;
    for (const Plane* p : f.rgb(l))
      for (int y = 0; y < p->height(); ++y)
        for (const float v : p->pixels(y)) sum += v;
    return sum / 3;
  };
  for (const char* majorants : {"cells", "global"}) {
    Scene scene = small_scene("cloud", 16);
    scene.render.majorants = majorants;
    const PreparedScene free(scene, layers);
    ASSERT_EQ(free.plan().one_grid, std::string(majorants) == "cells");
    const RenderResult whole = free.render(kSpp, 1, {});
    scene.render.indirect_limit = 1e9;
    const RenderResult same = PreparedScene(scene, layers).render(kSpp, 1, {});
    test::expect_same_bits(whole.layers, same.layers, "a limit that nothing reaches");
    EXPECT_EQ(same.layers.number("indirectLimitPaths"), 0.0);
    EXPECT_EQ(same.layers.text("biased"), "false");

    const double limit = scene.render.indirect_limit = 0.3 / scene.film.exposure;
    const PreparedScene prepared(scene, layers);
    const RenderResult r = prepared.render(kSpp, 1, {});
    double taken = 0, found = 0;
    uint64_t count = 0;
    for (int y = 0; y < scene.film.height; ++y)
      for (int x = 0; x < scene.film.width; ++x)
        for (uint32_t s = 0; s < kSpp; ++s) {
          const PathSample a = free.replay(1, x, y, s), b = prepared.replay(1, x, y, s);
          const double before = mean_of(a.indirect);
          const dvec3 expected = before > limit ? a.indirect * (limit / before) : a.indirect;
          EXPECT_EQ(b.indirect, expected);
          EXPECT_EQ(b.direct, a.direct);
          EXPECT_EQ(b.beauty, b.direct + b.indirect);
          EXPECT_LE(mean_of(b.indirect), limit * (1 + 1e-12));
          found += before;
          taken += before - mean_of(b.indirect);
          count += before > limit;
        }
    const LimitedLight& limited = r.report.counters.limited;
    EXPECT_GT(count, 100u);
    EXPECT_EQ(limited.paths, count);
    EXPECT_NEAR(limited.taken, taken, 1e-9 * found);
    EXPECT_NEAR(limited.found, found, 1e-9 * found);
    EXPECT_NEAR(picture(whole.layers, layer::indirect) - picture(r.layers, layer::indirect), taken / kSpp,
                1e-5 * found / kSpp);
    EXPECT_NEAR(picture(whole.layers, layer::beauty) - picture(r.layers, layer::beauty), taken / kSpp,
                1e-5 * picture(whole.layers, layer::beauty));
    for (size_t c = 0; c < 3; ++c)
      for (int y = 0; y < scene.film.height; ++y)
        for (int x = 0; x < scene.film.width; ++x)
          EXPECT_EQ((*r.layers.rgb(layer::beauty)[c])(x, y),
                    (*r.layers.rgb(layer::direct)[c])(x, y) + (*r.layers.rgb(layer::indirect)[c])(x, y));
    EXPECT_EQ(r.layers.number("indirectLimitPaths"), static_cast<double>(count));
    EXPECT_NEAR(*r.layers.number("indirectLimitTaken"), taken, 1e-6 * taken);
    EXPECT_TRUE(r.layers.text("biased").starts_with("true: paths were limited by indirect_limit"));
    EXPECT_NE(r.report.summary().find("indirect_limit took"), std::string::npos);
  }
}

TEST(Renderer, TheIndirectLimitIsTheSameInDoublePrecision) {
  Scene scene = small_scene("cloud", 32);
  scene.render.indirect_limit = 0.3 / scene.film.exposure;
  const auto render = [&](const char* majorants, int64_t seed) {
    scene.render.majorants = majorants;
    return PreparedScene(scene, {}).render(64, seed, {});
  };
  const RenderResult a = render("cells", 1), b = render("global", 2);
  const test::Mean x = test::mean_radiance(a.layers, layer::indirect),
                   y = test::mean_radiance(b.layers, layer::indirect);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(x.value[c], y.value[c], 4 * std::hypot(x.error[c], y.error[c]));
  const LimitedLight &p = a.report.counters.limited, &q = b.report.counters.limited;
  EXPECT_NEAR(p.taken / p.found, q.taken / q.found, 0.05 * p.taken / p.found);
}

TEST(Renderer, RouletteDoesNotChangeTheMean) {
  Scene scene = small_scene();
  scene.volumes[0].sigma_t = dvec3(60);
  const auto mean = [&](int start) {
    scene.render.roulette_start = start;
    return test::mean_radiance(PreparedScene(scene, {}).render(200, start, {}).layers, layer::indirect);
  };
  const test::Mean early = mean(1), late = mean(1000000);
  EXPECT_NEAR(early.value.x, late.value.x, 4 * std::hypot(early.error.x, late.error.x));
}

// World times 10, coefficients over 10, everything turned and mirrored: the same picture, up to the noise of other
// paths.
TEST(Renderer, ScaleAndRigidMotionOfTheWorldDoNotMatter) {
  Scene a = small_scene(), b = a;
  dmat4 m(dmat3(dvec3(0, 10, 0), dvec3(-10, 0, 0), dvec3(0, 0, 10)));
  m[3] = glm::dvec4(300, -200, 1e6, 1);
  const auto point = [&](const dvec3& p) { return dvec3(m * glm::dvec4(p, 1)); };
  b.volumes[0].object_to_world = m * b.volumes[0].object_to_world;
  b.volumes[0].sigma_t /= 10;
  b.camera.position = point(b.camera.position);
  b.camera.look_at = point(b.camera.look_at);
  b.lights[0].direction = dmat3(m) * b.lights[0].direction;
  const test::Mean x = test::mean_radiance(PreparedScene(a, {}).render(100, 1, {}).layers),
                   y = test::mean_radiance(PreparedScene(b, {}).render(100, 1, {}).layers);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(x.value[c], y.value[c], 4 * std::hypot(x.error[c], y.error[c]));
}

TEST(Renderer, HardCasesEndFiniteWithNothingHidden) {
  struct Case {
    const char* name;
    std::function<void(Scene&)> change;
  };
  const Case cases[] = {
      {"density 1e-8", [](Scene& s) { s.volumes[0].sigma_t = dvec3(1e-8); }},
      {"density 1e6", [](Scene& s) { s.volumes[0].sigma_t = dvec3(1e6); }},
      {"g = 0.999", [](Scene& s) { s.volumes[0].g = 0.999; }},
      {"g = -0.999", [](Scene& s) { s.volumes[0].g = -0.999; }},
      {"g = 1e-4", [](Scene& s) { s.volumes[0].g = 1e-4; }},
      {"black", [](Scene& s) { s.volumes[0].albedo = dvec3(0); }},
      {"one channel white", [](Scene& s) { s.volumes[0].albedo = dvec3(1, 0, 0.5); }},
      {"camera inside",
       [](Scene& s) {
         s.camera.position = dvec3(0, 0, 1.5);
         s.camera.look_at = dvec3(0, 0, 2);
         s.camera.up = dvec3(0, 1, 0);
       }},
      {"along an axis and an edge",
       [](Scene& s) {
         s.camera.position = dvec3(0, -7, 1);
         s.camera.look_at = dvec3(0, 0, 1);
         s.camera.fov = 1e-3;
       }},
      {"world of 1e-6",
       [](Scene& s) {
         s.volumes[0].object_to_world = test::scaling(dvec3(1e-6)) * s.volumes[0].object_to_world;
         s.volumes[0].sigma_t *= 1e6;
         s.camera.position *= 1e-6;
         s.camera.look_at *= 1e-6;
       }},
      {"world of 1e7, far away",
       [](Scene& s) {
         s.volumes[0].object_to_world =
             test::translation(dvec3(1e12)) * test::scaling(dvec3(1e7)) * s.volumes[0].object_to_world;
         s.volumes[0].sigma_t *= 1e-7;
         s.camera.position = s.camera.position * 1e7 + 1e12;
         s.camera.look_at = s.camera.look_at * 1e7 + 1e12;
       }},
      {"sphere light inside",
       [](Scene& s) {
         s.lights[0] = LightSettings{};
         s.lights[0].type = "sphere";
         s.lights[0].position = dvec3(0, 0, 1.6);
         s.lights[0].radius = 0.01;
         s.lights[0].radiance = dvec3(1e4);
       }},
      {"black sun and sky",
       [](Scene& s) {
         s.lights[0].irradiance = dvec3(0);
         s.environment.radiance = dvec3(0);
       }},
      {"one pixel", [](Scene& s) { s.film.width = s.film.height = 1; }},
  };
  for (const Case& c : cases) {
    Scene scene = small_scene("smoke", 16);
    c.change(scene);
    const RenderResult r = PreparedScene(scene, {}).render(4, 1, {});
    EXPECT_EQ(r.report.invalid_samples, 0u) << c.name;
    EXPECT_EQ(r.report.counters.tracking.majorant_violations, 0u) << c.name;
    EXPECT_EQ(r.report.counters.capped_paths, 0u) << c.name;
    for (const auto& [name, plane] : r.layers.channels())
      EXPECT_EQ(count_not_finite(plane), 0u) << c.name << " " << name;
  }
}

TEST(Renderer, SingularTransformsAreRefused) {
  Scene scene = small_scene();
  scene.volumes[0].object_to_world = test::scaling(dvec3(1, 1, 0));
  try {
    PreparedScene prepared(scene, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("object_to_world is singular"), std::string::npos) << error.what();
  }
}

TEST(Renderer, ReplayIsTheSampleThatWasRendered) {
  Scene scene = small_scene();
  const PreparedScene prepared(scene, {});
  const RenderResult r = prepared.render(1, 5, {});
  const PathSample s = prepared.replay(5, 20, 12, 0);
  EXPECT_EQ(r.layers.at("direct.R")(20, 12), static_cast<float>(s.direct.x));
  EXPECT_EQ(r.layers.at("indirect.G")(20, 12), static_cast<float>(s.indirect.y));
}

TEST(Renderer, StopsWhenCancelled) {
  std::atomic<bool> cancel{false};
  const PreparedScene scene(small_scene("cloud"), {});
  EXPECT_THROW(scene.render(200, 1, {2, [&](double) { cancel = true; }, &cancel}), Interrupted);
}

}  // namespace
}  // namespace brume
