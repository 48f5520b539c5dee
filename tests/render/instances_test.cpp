#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "render/scene/instance_files.h"
#include "render/scene/scene_io.h"
#include "render/session/renderer.h"
#include "render/world/media.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

using test::error_of;

std::vector<Instance> random_instances(Rng& rng, int count, double spread, const dvec3& middle = dvec3(0)) {
  std::vector<Instance> all;
  for (int i = 0; i < count; ++i) {
    const dmat4 m = translation(middle + test::random_point(rng, dvec3(-spread), dvec3(spread))) *
                    test::scaling(dvec3(0.3 + rng.uniform())) * test::scaling(dvec3(1, 1, i % 2 ? 1 : -1));
    all.push_back({Placement(m).to_local(), 1.0, dvec3(1)});
  }
  return all;
}

// Boxes around them are met in order; nothing that a ray meets is missing, and nothing else is met but by what single
// precision rounds.
TEST(Instances, AreFoundInTheOrderInWhichARayMeetsTheirBoxes) {
  Rng rng(1);
  // Numbers around those at which the tree gets another level, near the origin and where single precision is coarse.
  for (const int count : {1, 2, 3, 16, 17, 257, 500, 5000}) {
    const dvec3 middle = count % 2 ? dvec3(0) : dvec3(0, -40000, 300);
    const double spacing = 1e-5 * (1 + glm::length(middle)), rounding = 3e-6 * (10 + glm::length(middle));
    const std::vector<Instance> places = random_instances(rng, count, 6, middle);
    const Instances all(places, dvec3(-0.5), dvec3(0.5));
    const dvec3 wider(0.5 + rounding / 0.3);  // of the smallest scale
    const Instances grown(places, -wider, wider);
    for (int k = 0; k < 300; ++k) {
      Ray ray{middle + test::random_point(rng, dvec3(-9), dvec3(9)), test::random_direction(rng)};
      if (k % 3 == 0) ray.d = dvec3(k % 2, 1 - k % 2, 0);
      const double t_max = k % 4 == 0 ? 5 : kUnbounded, begin = all.begin(ray);
      std::set<uint32_t> expected, found;
      for (uint32_t i = 0; i < all.size(); ++i) {
        const auto [t0, t1] = all.part(i, ray, t_max);
        if (t0 < t1) expected.insert(i);
      }
      Instances::Met last;
      std::array<Instances::Met, 3> some;
      while (const size_t n = all.next(ray, begin, t_max, last, some)) {
        for (size_t i = 0; i < n; ++i) {
          ASSERT_TRUE(last < some[i]) << count << " " << k;
          last = some[i];
          EXPECT_TRUE(found.insert(last.number).second);
          const auto [g0, g1] = grown.part(last.number, ray, t_max + rounding);
          EXPECT_LT(g0, g1) << count << " " << k;
          if (expected.contains(last.number)) {
            EXPECT_LE(begin + static_cast<double>(last.t), all.part(last.number, ray, t_max).first + spacing);
          }
        }
        if (n < some.size()) break;
      }
      for (const uint32_t i : expected) EXPECT_TRUE(found.contains(i)) << count << " " << k << " " << i;
      std::set<uint32_t> unordered;
      all.each_met(ray, t_max, [&](size_t i) { unordered.insert(static_cast<uint32_t>(i)); });
      EXPECT_EQ(unordered, expected);
      EXPECT_EQ(all.meets(ray, t_max), !expected.empty());
    }
  }
}

TEST(Instances, RaysThatEndWhereTheyBeginMeetThoseAround) {
  Rng rng(2);
  for (const int count : {5, 60, 400, 40000}) {  // up to sixteen around each; more; no lists
    const Instances all(random_instances(rng, count, 4), dvec3(-0.5), dvec3(0.5));
    for (int k = 0; k < 300; ++k) {
      const auto number = static_cast<uint32_t>(rng.uniform() * count);
      const Placement placement(all[number].to_local);
      const auto inside = [&] { return placement.to_world(test::random_point(rng, dvec3(-0.6), dvec3(0.6))); };
      const dvec3 from = inside(), to = inside();
      const Ray ray{from, glm::normalize(to - from)};
      const double t_max = k % 10 == 0 ? kUnbounded : glm::distance(from, to);
      const auto found = [&](const auto& next) {
        std::vector<Instances::Met> every;
        Instances::Met last;
        std::array<Instances::Met, 4> some;
        while (const size_t n = next(last, some)) {
          every.insert(every.end(), some.begin(), some.begin() + static_cast<std::ptrdiff_t>(n));
          last = every.back();
          if (n < some.size()) break;
        }
        return every;
      };
      const double begin = all.begin(ray);
      const auto by_list =
          found([&](const auto& last, auto& some) { return all.next_from(number, ray, t_max, last, some); });
      const auto by_tree = found([&](const auto& last, auto& some) { return all.next(ray, begin, t_max, last, some); });
      ASSERT_EQ(by_list.size(), by_tree.size()) << count << " " << k;
      for (size_t i = 0; i < by_list.size(); ++i) {
        EXPECT_EQ(by_list[i].number, by_tree[i].number);
        EXPECT_EQ(by_list[i].t, by_tree[i].t);
      }
    }
  }
}

class InstanceFiles : public ::testing::Test {
 protected:
  InstanceSettings written(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    InstanceSettings settings;
    settings.file = folder_ / name;
    return settings;
  }
  std::string error(const std::string& name, const std::string& text) {
    const InstanceSettings settings = written(name, text);
    return error_of([&] { places_of(settings, "instances.0"); });
  }
  test::TemporaryFolder folder_;
};

// A quarter turn about z, twice as large: x becomes y.
TEST_F(InstanceFiles, HoldPlacesTurnsAndScales) {
  const std::string numbers = "1,2,3,0,0,0.70710678118654752,0.70710678118654752,2,0.5,1,0.5,0.25";
  for (const char* names : {"x,y,z,orient.x,orient.y,orient.z,orient.w,pscale,density,tint_r,tint_g,tint_b",
                            "P[x],P[y],P[z],rot[0],rot[1],rot[2],rot[3],scale,density,tint[0],tint[1],tint[2]"}) {
    const InstanceList list = places_of(written("a.csv", std::string(names) + "\r\n" + numbers + "\r\n"), "");
    ASSERT_EQ(list.matrices.size(), 1u);
    const dvec3 p(list.matrices[0] * glm::dvec4(1, 0, 0, 1));
    EXPECT_LT(glm::distance(p, dvec3(1, 4, 3)), 1e-12);
    EXPECT_EQ(list.densities[0], 0.5);
    EXPECT_EQ(list.tints[0], dvec3(1, 0.5, 0.25));
  }
  EXPECT_EQ(places_of(written("g.csv", "x y z tint\n1 2 3 .5\n"), "").tints[0], dvec3(0.5));
  const InstanceList rows =
      places_of(written("m.csv", "m00;m01;m02;m03;m10;m11;m12;m13;m20;m21;m22;m23\n1;0;0;7;0;2;0;8;0;0;3;9\n"), "");
  EXPECT_EQ(dvec3(rows.matrices[0] * glm::dvec4(1, 1, 1, 1)), dvec3(8, 10, 12));
  const InstanceList points =
      places_of(written("p.ply",
                        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float "
                        "z\nproperty float scale_x\nproperty float scale_y\nproperty float scale_z\nend_header\n"
                        "0 0 0 1 1 1\n1 2 3 2 3 4\n"),
                "");
  ASSERT_EQ(points.matrices.size(), 2u);
  EXPECT_EQ(dvec3(points.matrices[1] * glm::dvec4(1, 1, 1, 1)), dvec3(3, 5, 7));
}

// As spreadsheets, simulations and people write them: spaces, decimal commas, comments, blank lines, columns of text.
TEST_F(InstanceFiles, MayBeWrittenInManyWays) {
  const auto expect = [&](const std::string& text) {
    const InstanceList list = places_of(written("a.csv", text), "");
    ASSERT_EQ(list.matrices.size(), 2u) << text;
    EXPECT_EQ(dvec3(list.matrices[1][3]), dvec3(1.5, 0, -2)) << text;
    EXPECT_EQ(list.matrices[1][0].x, 0.5) << text;
  };
  expect("x,y,z,pscale\n0,0,0,1\n1.5,0,-2,0.5\n");
  expect("x y z pscale\n0 0 0 1\n 1.5  0   -2 0.5 \n");
  expect("x\ty\tz\tpscale\n0\t0\t0\t1\n1.5\t0\t-2\t0.5");
  expect("x;y;z;pscale\n0,0;0,0;0,0;1,0\n1,5;0,0;-2,0;0,5\n");
  expect("# clouds\n\nx, y, z, pscale\n0, 0, 0, 1\n  # the second\n1.5, 0, -2, 0.5\n\n\n");
  expect("name,x,y,z,pscale\ncloud_a,0,0,0,1\ncloud_b,1.5,0,-2,0.5\n");
  expect("name,\"x\",y,z,pscale\n\"a, b\",0,0,0,1\n\"c, d, e\",1.5,0,-2,0.5\n");
  expect("\"x, of all\";x;y;z;pscale\n1;0;0;0;1\n1;1,5;0;-2;0,5\n");
  expect("# made by hand\n# x,y,z,pscale\n0,0,0,1\n1.5,0,-2,0.5\n");
  expect("# x y z pscale\n0.0 0.0 0.0 1.0\n1.5 0.0 -2.0 0.5\n");
  expect("#x,y,z,pscale\n0 0 0 1\n1.5 0 -2 0.5\n");
  EXPECT_NE(error("a.csv", "x,y,z\n\n1,2,3\n# here\n1,two,3\n").find("line 5, column 'y': 'two' is no number"),
            std::string::npos);
}

// z goes along N, y as far as it may along up.
TEST_F(InstanceFiles, MayHaveNAndUpInsteadOfAQuaternion) {
  const InstanceList list =
      places_of(written("a.csv", "x,y,z,N.x,N.y,N.z,up.x,up.y,up.z,pscale\n1,2,3,4,0,0,0,0,9,2\n"), "");
  const auto turned = [&](const dvec3& d) { return dvec3(list.matrices[0] * glm::dvec4(d, 0)); };
  EXPECT_LT(glm::distance(turned({0, 0, 1}), dvec3(2, 0, 0)), 1e-12);
  EXPECT_LT(glm::distance(turned({0, 1, 0}), dvec3(0, 0, 2)), 1e-12);
  EXPECT_LT(glm::distance(turned({1, 0, 0}), dvec3(0, 2, 0)), 1e-12);
  // Normals alone are those of a mesh.
  EXPECT_EQ(places_of(written("a.csv", "x,y,z,nx,ny,nz\n0,0,0,1,0,0\n"), "").matrices[0], dmat4(1));
  // Single columns of these names mean something else.
  EXPECT_EQ(places_of(written("a.csv", "x,y,z,nx,n0,up0\n0,0,0,1,0,0\n"), "").matrices[0], dmat4(1));
  EXPECT_NE(error("a.csv", "x,y,z,nx,ny,nz,upx,upy,upz\n0,0,0,0,0,1,0,0,2\n").find("expected N above 0 and across up"),
            std::string::npos);
}

// As spreadsheets and Maya name them.
TEST_F(InstanceFiles, MayHaveShortNames) {
  const InstanceList list = places_of(
      written("a.csv", "tx,ty,tz,qw,qx,qy,qz,sx,sy,sz\n1,2,3,0.70710678118654752,0,0,0.70710678118654752,2,3,4\n"), "");
  EXPECT_LT(glm::distance(dvec3(list.matrices[0] * glm::dvec4(1, 0, 0, 1)), dvec3(1, 4, 3)), 1e-12);
  EXPECT_LT(glm::distance(dvec3(list.matrices[0] * glm::dvec4(0, 1, 0, 1)), dvec3(-2, 2, 3)), 1e-12);
}

TEST_F(InstanceFiles, RefuseAnglesInsteadOfPassingThemOver) {
  EXPECT_NE(error("a.csv", "tx,ty,tz,rx,ry,rz\n0,0,0,0,0,0\n0,0,0,0,45,0\n").find("line 3, 'ry': 45; expected 0, as "),
            std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z,Yaw\n0,0,0,90\n").find("line 2, 'Yaw': 90; expected 0"), std::string::npos);
  EXPECT_EQ(places_of(written("a.csv", "x,y,z,yaw,pitch,roll\n0,0,0,0,0,0\n"), "").matrices[0], dmat4(1));
  EXPECT_EQ(places_of(written("a.csv", "x,y,z,qx,qy,qz,qw,yaw\n0,0,0,0,0,0,1,90\n"), "").matrices[0], dmat4(1));
}

TEST_F(InstanceFiles, SayWhatIsWrongAndWhere) {
  EXPECT_NE(error("a.csv", "x,y\n1,2\n").find("no place; expected x, y, z, or m00 .. m23; it has x, y"),
            std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z\n1,2,3\n1,2\n").find("line 3 has 2 columns; expected 3"), std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z\n1,2,big\n").find("line 2, column 'z': 'big' is no number"), std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z\n1,2,nan\n").find("line 2, 'z': nan; expected a finite number"), std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z\n1,2,nan\n1,2,big\n").find("line 2, 'z': nan; expected a finite number"),
            std::string::npos);
  EXPECT_NE(error("a.csv", "# places\n\n1,2,3\n4,5,6\n").find("line 3 has numbers alone; expected a line of 3 names"),
            std::string::npos);
  EXPECT_NE(error("a.csv", "1,2,3\n").find("line 1 has numbers alone"), std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z,pscale\n1,2,3,0\n").find("line 2: its matrix is singular"), std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z,density\n1,2,3,-1\n").find("'density': -1; expected at least 0"), std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z,rot_x,rot_y,rot_z\n1,2,3,0,0,0\n").find("3 parts of 'rot'; expected 4"),
            std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z\n").find("holds no places"), std::string::npos);
  EXPECT_NE(error("a.csv", "").find("no place"), std::string::npos);
  EXPECT_NE(error("a.txt", "x,y,z\n1,2,3\n").find("expected .csv or .ply"), std::string::npos);
  EXPECT_NE(error("a.ply", "ply\nformat ascii 1.0\nelement vertex 10000000\nproperty float x\nend_header\n")
                .find("10000000 points; expected at most"),
            std::string::npos);
  EXPECT_NE(error("a.csv", "x,y,z\n" + std::string(10'000'000, '\n')).find("places; expected at most"),
            std::string::npos);
}

TEST(InstancesOfScenes, SayWhatIsWrong) {
  const auto error = [](const std::string& text) {
    return error_of([&] {
      parse_scene_alone(
          "[camera]\nposition = [0, -5, 0]\nlook_at = [0, 0, 0]\n[[volumes]]\nshape = \"sphere\"\n" + text,
          "scene.toml");
    });
  };
  const std::string one = "matrices = [[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]\n";
  EXPECT_EQ(error("[[instances]]\n" + one), "");
  EXPECT_NE(error("[[instances]]\n").find("neither 'matrices' nor 'file'"), std::string::npos);
  EXPECT_NE(error("[[instances]]\nmatrices = []\n").find("'matrices' is empty"), std::string::npos);
  EXPECT_NE(error("[[instances]]\nvolume = 1\n" + one).find("'volume' is 1"), std::string::npos);
  EXPECT_NE(error("[[instances]]\nfile = \"none.csv\"\n").find("no such file"), std::string::npos);
  EXPECT_NE(error("[[instances]]\nmatrices = [[[1,0,0,0],[0,0,0,0],[0,0,1,0],[0,0,0,1]]]\n")
                .find("matrix 0 of 'matrices' is singular"),
            std::string::npos);
  EXPECT_NE(error("[[instances]]\nmatrices = [[[nan,0,0,0],[0,0,0,0],[0,0,1,0],[0,0,0,1]]]\n").find("out of range"),
            std::string::npos);
}

// One medium whatever the number of places; those that emit stand there as so many volumes, of which there is an end.
TEST(InstancesOfScenes, ShareAMediumUnlessTheyEmit) {
  Scene scene = test::scene_of(test::source("data/volumes/smoke.vdb"), 1, 0.9, 0);
  auto list = std::make_shared<InstanceList>();
  for (int i = 0; i < 300; ++i) list->matrices.push_back(translation(dvec3(i, 0, 0)));
  scene.instances.emplace_back();
  scene.instances[0].arrays = list;
  EXPECT_EQ(SceneMedia(scene, {}).media().size(), 1u);
  scene.instances[0].tint = dvec3(2, 1, 1);
  EXPECT_NE(error_of([&] { SceneMedia(scene, {}); }).find("makes an albedo of 1.8"), std::string::npos);
  scene.instances[0].tint = dvec3(1);
  scene.volumes[0].emission = dvec3(1);
  EXPECT_NE(error_of([&] { SceneMedia(scene, {}); }).find("emits (emission), and stands at 300 places"),
            std::string::npos);
  list->matrices.resize(5);
  EXPECT_EQ(SceneMedia(scene, {}).media().size(), 5u);
}

// Predicted light of instances is that of as many volumes.
TEST(InstancesOfScenes, HaveTheGuidesOfAsManyVolumes) {
  Scene scene = test::scene_of(test::source("data/volumes/cloud.vdb"), 8, 0.99, 0.5);
  scene.environment.radiance = dvec3(0.3);
  LightSettings sun;
  sun.type = "sun", sun.direction = dvec3(-0.8, -0.3, 0.5), sun.irradiance = dvec3(3);
  scene.lights.push_back(sun);
  Scene copies = scene;
  copies.volumes.clear();
  auto list = std::make_shared<InstanceList>();
  Rng rng(3);
  for (int i = 0; i < 6; ++i) {
    list->matrices.push_back(translation(test::random_point(rng, dvec3(-1.5), dvec3(1.5))) * test::scaling(dvec3(0.7)));
    copies.volumes.push_back(scene.volumes[0]);
    copies.volumes.back().object_to_world = list->matrices.back();
  }
  scene.instances.emplace_back();
  scene.instances[0].arrays = list;
  const LayerRequest layers = LayerRequest::of({"guides"}, false);
  const Layers ours = PreparedScene(scene, layers).render(1, 1, {}).layers;
  const Layers theirs = PreparedScene(copies, layers).render(1, 1, {}).layers;
  for (const char* name :
       {"guide.opacity.Y", "guide.single.sun.Y", "guide.predicted_direct.G", "guide.predicted_indirect.G"}) {
    double a = 0, b = 0;
    for (int y = 0; y < ours.height(); ++y)
      for (int x = 0; x < ours.width(); ++x) a += ours.at(name)(x, y), b += theirs.at(name)(x, y);
    EXPECT_NEAR(a, b, 0.01 * b) << name;
  }
}

// However large the picture: their light has 100,000 nodes of less than 200 bytes, which would be 1,000,000.
TEST(InstancesOfScenes, HaveGuidesOfBoundedSize) {
  Scene scene = test::scene_of(test::source("data/volumes/cloud.vdb"), 8, 0.99, 0.5);
  scene.environment.radiance = dvec3(0.3);
  scene.film.width = scene.film.height = 300;
  auto list = std::make_shared<InstanceList>();
  for (int i = 0; i < 2025; ++i) list->matrices.push_back(translation(3.0 * dvec3(i % 45, i / 45, 0)));
  scene.instances.emplace_back();
  scene.instances[0].arrays = list;
  const PreparedScene prepared(scene, LayerRequest::of({"guides"}, false));
  EXPECT_LT(prepared.guides(4)->bytes(), size_t{20'000'000});
}

}  // namespace
}  // namespace brume
