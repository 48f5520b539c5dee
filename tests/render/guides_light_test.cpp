// Light of guides among surfaces and media, against closed forms and the path tracer.

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <string_view>

#include "base/rng.h"
#include "image/light_layers.h"
#include "render/guides/guides.h"
#include "render/guides/light_fields.h"
#include "render/guides/lit_surface.h"
#include "render/guides/sky_parts.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

/// The light of a scene as its guides have it.
struct Solved {
  PreparedScene scene;
  std::vector<GuideMedia> media;
  LightFields fields;

  explicit Solved(const Scene& s)
      : scene(s, LayerRequest::of({"direct"}, false)),
        media(of(scene.context())),
        fields(media, *scene.context().lights, scene.context().surfaces, kGrey, 1, 10000, {}) {}
  static std::vector<GuideMedia> of(const PathContext& context) {
    std::vector<GuideMedia> media;
    media.emplace_back(context.media, context.emissions, 0.5);
    return media;
  }
  LitSurfaces lit() const {
    return {fields.lights(),          *scene.context().lights, fields.scaled_extinction(), fields.sky_parts(),
            scene.context().surfaces, fields.ambient_light(),  fields.surface_light()};
  }
  /// Irradiance of everything at a point in front of a surface, grey.
  double irradiance(const dvec3& p, const dvec3& normal) const {
    const SurfaceLight::Around around = fields.surface_light()->onto(p, normal);
    dvec3 sum = around.scattered;
    for (const auto& light : fields.lights()) {
      const Lit own = light->onto(lit(), around, p, normal);
      sum += own.direct + own.indirect;
    }
    return kPi * in_colour(sum, kGrey);
  }
};

/// Parallelograms as a mesh, each from a corner along two edges; its front is where the edges turn counter-clockwise.
SurfaceSettings quads(const std::vector<std::array<dvec3, 3>>& all, double albedo) {
  TriangleMesh mesh;
  for (const auto& [corner, x, y] : all) {
    const int first = static_cast<int>(mesh.positions.size());
    for (const dvec3& p : {corner, corner + x, corner + x + y, corner + y}) mesh.positions.push_back(p);
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.triangles.push_back({first, first + 2, first + 3});
  }
  SurfaceSettings settings;
  settings.mesh = std::make_shared<TriangleMesh>(mesh);
  settings.albedo = dvec3(albedo);
  return settings;
}

SurfaceSettings floor_of(double half, double z, double albedo) {
  return quads({{dvec3(-half, -half, z), dvec3(2 * half, 0, 0), dvec3(0, 2 * half, 0)}}, albedo);
}

Scene haze(double half, double sigma_t, double albedo) {
  Scene s;
  s.name = "haze";
  s.camera.position = {0.9, -0.9, 0.5};
  s.camera.look_at = {0, 0, 0};
  s.film.width = s.film.height = 24;
  s.volumes.emplace_back();
  VolumeSettings& v = s.volumes[0];
  v.shape = "box";
  v.lo = dvec3(-half);
  v.hi = dvec3(half);
  v.sigma_t = dvec3(sigma_t);
  v.albedo = dvec3(albedo);
  return s;
}

// A closed cube of albedo a in which a patch shines: what arrives at all surfaces together is what is emitted, times
// 1 + a + a^2 + ... = 1 / (1 - a). Dust that absorbs nothing changes nothing of that.
TEST(SurfaceLight, OfAClosedRoomIsWhatIsEmittedByTheSumOfAllReflections) {
  constexpr double kAlbedo = 0.7, kPatch = 0.5, kRadiance = 3;
  for (const double dust : {1e-4, 0.4}) {
    Scene scene = haze(0.99, dust, 1.0);
    const dvec3 x(2, 0, 0), y(0, 2, 0), z(0, 0, 2), corner(-1), far(1);
    scene.surfaces.push_back(
        quads({{corner, x, y}, {corner, y, z}, {corner, z, x}, {far, -y, -x}, {far, -z, -y}, {far, -x, -z}}, kAlbedo));
    SurfaceSettings patch =
        quads({{dvec3(-0.5 * kPatch, 0.5 * kPatch, 0.9), dvec3(kPatch, 0, 0), dvec3(0, -kPatch, 0)}}, kAlbedo);
    patch.radiance = dvec3(kRadiance);
    scene.surfaces.push_back(patch);
    scene.environment.radiance = dvec3(1);
    const Solved solved(scene);
    double arriving = 0;
    for (const double seen : solved.fields.surface_light()->sky_seen()) EXPECT_EQ(seen, 0);
    const SurfacePoints points(*solved.scene.context().surfaces, solved.media[0], {});
    for (const SurfacePoints::Point& point : points.points())
      if (max_component(glm::abs(point.p)) < 1) arriving += point.area * solved.irradiance(point.p, point.normal);
    const double emitted = kPi * kRadiance * kPatch * kPatch;
    EXPECT_NEAR(arriving * (1 - kAlbedo) / emitted, 1.0, dust > 0.1 ? 0.05 : 0.03) << dust;
  }
}

TEST(SurfaceLight, OfAFloorUnderAnEvenSkyIsTheSky) {
  Scene scene = haze(0.3, 1e-4, 0.5);
  scene.environment.radiance = dvec3(0.8);
  scene.surfaces.push_back(floor_of(20, -0.35, 0.5));
  const Solved solved(scene);
  for (const dvec3& p : {dvec3(0, 0, 0), dvec3(0.9, -0.4, 0), dvec3(7, 3, 0)}) {
    const dvec3 on = p + dvec3(0, 0, -0.35 + 1e-6) - solved.scene.world_shift();
    EXPECT_NEAR(solved.irradiance(on, {0, 0, 1}), kPi * 0.8, 0.002) << p.x;
    EXPECT_NEAR(solved.irradiance(on - dvec3(0, 0, 2e-6), {0, 0, -1}), kPi * 0.8, 0.002) << "from below";
  }
}

// A ball of light between a floor and the sun: what the sun sends onto the floor is missing below it, as it is for
// paths, also where the ball is dark.
TEST(SurfaceLight, OfASunIsMissingInTheShadowOfALamp) {
  Scene scene = haze(0.3, 1e-4, 0.5);
  scene.surfaces.push_back(floor_of(20, -0.35, 0.5));
  scene.lights.resize(2);
  scene.lights[0].type = "sun";
  scene.lights[0].direction = {0, 0, 1};
  scene.lights[0].irradiance = dvec3(2);
  scene.lights[1].type = "sphere";
  scene.lights[1].position = {3, 1, 1};
  scene.lights[1].radius = 0.4;
  for (const auto& [solid, radiance] : {std::pair(true, 1e-6), std::pair(true, 0.0), std::pair(false, 1e-6)}) {
    scene.lights[1].solid = solid;
    scene.lights[1].radiance = dvec3(radiance);
    const Solved solved(scene);
    const auto on_floor = [&](double x, double y) {
      return solved.irradiance(dvec3(x, y, -0.35 + 1e-6) - solved.scene.world_shift(), {0, 0, 1});
    };
    EXPECT_NEAR(on_floor(3, 1), solid ? 0 : 2, 0.01);
    EXPECT_NEAR(on_floor(3.3, 1.2), solid ? 0 : 2, 0.01);
    EXPECT_NEAR(on_floor(3.5, 1), 2, 0.01);
  }
}

// Of each side there are points for the whole area, and between them what is linear is found exactly.
TEST(SurfacePoints, CoverASurfaceAndInterpolateLinearly) {
  Scene scene = haze(0.3, 1e-4, 0.5);
  scene.surfaces.push_back(floor_of(2, -0.35, 0.5));
  const Solved solved(scene);
  const SurfacePoints points(*solved.scene.context().surfaces, solved.media[0], {});
  double front = 0, back = 0;
  for (const SurfacePoints::Point& point : points.points()) (point.normal.z > 0 ? front : back) += point.area;
  EXPECT_NEAR(front, 16, 1e-9);
  EXPECT_NEAR(back, 16, 1e-9);
  Rng rng(3);
  for (int i = 0; i < 200; ++i) {
    const dvec3 p =
        test::random_point(rng, dvec3(-1.5, -1.5, -0.35), dvec3(1.5, 1.5, -0.35)) - solved.scene.world_shift();
    const SurfacePoints::Around around = points.around(p, {0, 0, 1});
    dvec3 sum(0);
    double weights = 0;
    for (size_t k = 0; k < around.count; ++k) {
      sum += around.weight[k] * points.points()[static_cast<size_t>(around.point[k])].p;
      weights += around.weight[k];
    }
    EXPECT_NEAR(weights, 1, 1e-12);
    EXPECT_LT(glm::length(dvec2(sum - p)), 0.01) << p.x << " " << p.y;
  }
}

/// A thin ring around z.
SurfaceSettings ring(double radius, double tube, double z) {
  constexpr int kAround = 96, kTube = 12;
  TriangleMesh mesh;
  for (int i = 0; i < kAround; ++i)
    for (int k = 0; k < kTube; ++k) {
      const double a = 2 * kPi * i / kAround, b = 2 * kPi * k / kTube;
      const double r = radius + tube * std::cos(b);
      mesh.positions.push_back({r * std::cos(a), r * std::sin(a), z + tube * std::sin(b)});
    }
  const auto at = [](int i, int k) { return i % kAround * kTube + k % kTube; };
  for (int i = 0; i < kAround; ++i)
    for (int k = 0; k < kTube; ++k) {
      mesh.triangles.push_back({at(i, k), at(i + 1, k), at(i + 1, k + 1)});
      mesh.triangles.push_back({at(i, k), at(i + 1, k + 1), at(i, k + 1)});
    }
  SurfaceSettings settings;
  settings.mesh = std::make_shared<TriangleMesh>(mesh);
  settings.albedo = dvec3(0);
  settings.radiance = dvec3(5);
  return settings;
}

// A thin ring of radius R, tube r and radiance L, by h above a floor: each piece of it is seen across, 2 r wide, so
// that below its middle E = L 2 r 2 pi R h / (R^2 + h^2)^(3/2).
TEST(EmittingMeshes, ARingLightsTheFloorBelowItsMiddleAsTheClosedForm) {
  constexpr double kR = 0.8, kTube = 0.02, kH = 0.6;
  Scene scene = haze(0.1, 1e-4, 0.5);
  scene.environment.radiance = dvec3(0);
  scene.surfaces.push_back(ring(kR, kTube, 0.2));
  scene.surfaces.push_back(floor_of(3, 0.2 - kH, 0.0));
  const Solved solved(scene);
  const double expected = 5 * 2 * kTube * 2 * kPi * kR * kH / std::pow(kR * kR + kH * kH, 1.5);
  const dvec3 p = dvec3(0, 0, 0.2 - kH + 1e-6) - solved.scene.world_shift();
  // A tube of twelve sides is narrower by sin(x) / x, x = 15 degrees, on average.
  EXPECT_NEAR(solved.irradiance(p, {0, 0, 1}) / (0.9886 * expected), 1.0, 0.02);
}

// A ball of radiance L and radius r, its middle by d from a point whose normal is at an angle b to it: E = L pi (r /
// d)^2 cos b where all of it is above the horizon.
TEST(Lamps, ABallLightsAFloorAsTheClosedForm) {
  constexpr double kRadius = 0.5, kRadiance = 3;
  for (const double height : {0.55, 0.7, 1.0, 3.0})
    for (const double aside : {0.0, 0.1, 0.8}) {
      Scene scene = haze(0.1, 1e-4, 0.5);
      scene.environment.radiance = dvec3(0);
      scene.lights.emplace_back();
      scene.lights[0].type = "sphere";
      scene.lights[0].position = dvec3(aside, 0, height - 1);
      scene.lights[0].radius = kRadius;
      scene.lights[0].radiance = dvec3(kRadiance);
      scene.surfaces.push_back(floor_of(3, -1, 0.0));
      const Solved solved(scene);
      const double distance = std::hypot(height, aside), sine = kRadius / distance, cosine = height / distance;
      const dvec3 p = dvec3(0, 0, -1 + 1e-6) - solved.scene.world_shift();
      EXPECT_NEAR(solved.irradiance(p, {0, 0, 1}) / (kRadiance * kPi * sine * sine * cosine), 1.0, 0.02)
          << height << " " << aside;
    }
}

double mean_of(const Layers& frame, const std::string& layer, size_t channel) {
  double sum = 0;
  for (int y = 0; y < frame.height(); ++y)
    for (int x = 0; x < frame.width(); ++x)
      sum += static_cast<double>(frame.at(layer + "." + "RGB"[channel])(x, y)) / (frame.width() * frame.height());
  return sum;
}

// A sun, a red lamp and a sky above a floor and a wall with haze between them: what surfaces and media send one another
// of each is what they send where it is alone, and all of them together are the whole.
TEST(LightGroups, AmongSurfacesArePredictedAsTheirLightsAlone) {
  Scene scene = haze(0.4, 1.5, 0.9);
  scene.camera.position = {1.6, -2.2, 1.3};
  scene.camera.fov = 40;
  scene.environment.radiance = dvec3(0.1, 0.15, 0.3);
  scene.surfaces.push_back(floor_of(1.5, -0.45, 0.6));
  scene.surfaces.push_back(quads({{dvec3(-0.6, -1.5, -0.45), dvec3(0, 3, 0), dvec3(0, 0, 1.5)}}, 0.7));
  LightSettings sun, lamp;
  sun.type = "sun";
  sun.direction = {0.6, -0.5, 0.7};
  sun.irradiance = dvec3(2);
  lamp.type = "sphere";
  lamp.position = {0.2, 0.9, 0.5};
  lamp.radius = 0.1;
  lamp.radiance = {20, 6, 3};
  scene.lights = {sun, lamp};
  const auto guides_of = [](const Scene& s) {
    return PreparedScene(s, LayerRequest::of({"guides"}, false)).render(1, 1).layers;
  };
  const Layers without = guides_of(scene);
  scene.render.light_groups = true;
  const Layers frame = guides_of(scene);
  const auto group = [](const char* name) { return predicted_light_layer(name, "indirect"); };
  double apart = 0, all = 0;
  for (size_t c = 0; c < 3; ++c)
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        const auto at = [&](const std::string& layer) { return frame.at(layer + "." + "RGB"[c])(x, y); };
        const float whole = at("guide.predicted_indirect");
        apart += std::pow(whole - without.at(std::string("guide.predicted_indirect.") + "RGB"[c])(x, y), 2);
        all += std::pow(whole, 2);
        ASSERT_NEAR(at(group("sky")) + at(group("sun")) + at(group("sphere")), whole, 0.01 * whole + 1e-6);
      }
  // Light is found at more pixels instead of between them, where one of the groups asks for it, and else the same: what
  // lies between pixels may be off by .02.
  EXPECT_LT(std::sqrt(apart / all), 0.03);
  for (size_t c = 0; c < 3; ++c)
    EXPECT_NEAR(mean_of(frame, "guide.predicted_indirect", c) / mean_of(without, "guide.predicted_indirect", c), 1.0,
                0.02);
  for (const char* const name : {"sky", "sun", "sphere"}) {
    Scene alone = scene;
    alone.render.light_groups = false;
    if (std::string_view(name) != "sky") alone.environment.radiance = dvec3(0);
    if (std::string_view(name) != "sun") alone.lights[0].irradiance = dvec3(0);
    if (std::string_view(name) != "sphere") alone.lights[1].radiance = dvec3(0);
    const Layers expected = guides_of(alone);
    for (size_t c = 0; c < 3; ++c)
      EXPECT_NEAR(mean_of(frame, group(name), c) / mean_of(expected, "guide.predicted_indirect", c), 1.0, 0.05)
          << name << " " << c;
  }
}

// Around thin haze, against the tracer: scattered once, near the ring and far from it. Nodes outside of the haze are
// dark, and light is interpolated between them and those inside: a few per cent are lost at its border.
TEST(EmittingMeshes, ARingAroundHazeIsScatteredAsTheTracerDoes) {
  Scene scene = haze(0.5, 0.3, 0.9);
  scene.environment.radiance = dvec3(0);
  scene.camera.position = {0, -5, 1.2};
  scene.camera.fov = 20;
  scene.surfaces.push_back(ring(0.75, 0.05, 0));
  scene.surfaces[0].visible_to_camera = false;
  const Layers frame = PreparedScene(scene, LayerRequest::of({"direct", "guides"}, false)).render(1024, 1).layers;
  double expected = 0, predicted = 0;
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 24; ++x) {
      expected += frame.at("direct.G")(x, y);
      predicted += frame.at("guide.single.mesh.Y")(x, y);
    }
  EXPECT_NEAR(predicted / expected, 1.0, 0.05);
}

// Fog of g = 0.5 around a spot's beam, scattered twice and more, in 4 x 4 blocks of the picture: where only two moments
// of the light are known, half of them are 20 to 45 % too bright.
TEST(ScatteringSolver, LightBesideABeamIsTheTracers) {
  Scene scene = read_scene(test::source("bench/scenes/general/fog_and_spot.toml"));
  scene.surfaces.clear();
  scene.environment.radiance = dvec3(0);
  scene.film.width = 48;
  scene.film.height = 36;
  const Layers frame = PreparedScene(scene, LayerRequest::of({"indirect", "guides"}, false)).render(1024, 1).layers;
  double all = 0, all_expected = 0;
  for (int block = 0; block < 16; ++block) {
    double predicted = 0, expected = 0;
    for (int y = block / 4 * 9; y < block / 4 * 9 + 9; ++y)
      for (int x = block % 4 * 12; x < block % 4 * 12 + 12; ++x) {
        predicted += frame.at("guide.predicted_indirect.G")(x, y);
        expected += frame.at("indirect.G")(x, y);
      }
    EXPECT_NEAR(predicted / expected, 1.0, 0.2) << block;
    all += predicted;
    all_expected += expected;
  }
  EXPECT_NEAR(all / all_expected, 1.0, 0.06);
}

// A spot's beam is as narrow as a pixel beside it: steps as long as elsewhere make single pixels three times too
// bright.
TEST(Guides, OfABeamBesideItsSpotAreTheMeanOverThePixel) {
  constexpr int kFiner = 8;
  Scene scene = read_scene(test::source("bench/scenes/general/fog_and_spot.toml"));
  scene.surfaces.clear();
  scene.camera.look_at = dvec3(-1.995, 0.0, 2.72);
  scene.camera.fov = 3;
  const auto predicted = [&](int finer) {
    scene.film.width = 16 * finer;
    scene.film.height = 12 * finer;
    Layers frame = PreparedScene(scene, LayerRequest::of({"direct", "guides"}, false)).render(1, 1).layers;
    return frame.at("guide.predicted_direct.G");
  };
  const Plane coarse = predicted(1), fine = predicted(kFiner);
  float most = 0, all = 0, all_fine = 0;
  Plane mean(16, 12);
  for (int y = 0; y < 12 * kFiner; ++y)
    for (int x = 0; x < 16 * kFiner; ++x) mean(x / kFiner, y / kFiner) += fine(x, y) / (kFiner * kFiner);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 16; ++x) {
      most = std::max(most, mean(x, y));
      all += coarse(x, y);
      all_fine += mean(x, y);
    }
  ASSERT_GT(most, 1);
  EXPECT_NEAR(all / all_fine, 1, 0.03);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 16; ++x) EXPECT_NEAR(coarse(x, y), mean(x, y), 0.2f * most) << x << ", " << y;
}

// Of unit vectors the products of the moments of the second order add up to P2 of the cosine between them.
TEST(Moments, OfTheSecondOrderAreP2) {
  Rng rng(7);
  for (int i = 0; i < 100; ++i) {
    const dvec3 a = glm::normalize(test::random_point(rng, dvec3(-1), dvec3(1))),
                b = glm::normalize(test::random_point(rng, dvec3(-1), dvec3(1)));
    const std::array<float, kMostMoments> of_a = moments_of(a), of_b = moments_of(b);
    double sum = 0;
    for (size_t k = 4; k < kMostMoments; ++k) sum += static_cast<double>(of_a[k]) * static_cast<double>(of_b[k]);
    const double cosine = glm::dot(a, b);
    EXPECT_NEAR(sum, 1.5 * cosine * cosine - 0.5, 1e-6);
  }
}

// What becomes suns is taken from the sky: together they light as before.
TEST(SkyParts, KeepTheLightOfAPicture) {
  const Scene scene = read_scene(test::source("bench/scenes/kinds/picture_sky.toml"));
  const Environment sky(scene.environment);
  const SkyParts parts(sky);
  ASSERT_GE(parts.suns().size(), 1u);
  Rng rng(5);
  dvec3 whole(0), rest(0), suns(0);
  constexpr int kDirections = 400000;
  double brightest = 0;
  for (int i = 0; i < kDirections; ++i) {
    const dvec3 d = test::random_direction(rng);
    whole += 4 * kPi / kDirections * sky.radiance(d);
    rest += 4 * kPi / kDirections * parts.radiance(d);
    brightest = std::max(brightest, in_colour(parts.radiance(d), kGrey));
  }
  for (const auto& sun : parts.suns()) suns += sun->irradiance();
  for (int c = 0; c < 3; ++c) EXPECT_NEAR((rest[c] + suns[c]) / whole[c], 1.0, 0.02) << c;
  EXPECT_LT(brightest, 9 * in_colour(whole, kGrey) / (4 * kPi)) << "no bright part is left";
}

TEST(Guides, SayWhatTheyLeaveOut) {
  const auto left_out = [](const char* file) {
    Scene scene = read_scene(test::source(std::string("bench/scenes/") + file));
    for (SurfaceSettings& surface : scene.surfaces) surface.shadow = "traced";
    const PreparedScene prepared(scene, LayerRequest::of({"direct"}, false));
    std::string all;
    for (const std::string& text : Guides(prepared.context(), 0, 100).left_out()) all += text + "\n";
    return all;
  };
  const std::string glass = left_out("general/behind_glass.toml"), smoke = left_out("kinds/ring_in_smoke.toml");
  EXPECT_NE(glass.find("through glass"), std::string::npos) << glass;
  EXPECT_EQ(smoke.find("through glass"), std::string::npos) << smoke;
  EXPECT_NE(smoke.find("'mesh'"), std::string::npos) << smoke;
}

}  // namespace
}  // namespace brume
