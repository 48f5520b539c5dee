#include "render/files/polygon.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/math.h"
#include "base/rng.h"

namespace brume {
namespace {

using Outline = std::vector<dvec2>;

dvec3 doubled_area(const std::vector<dvec3>& p) {
  dvec3 sum(0);
  for (size_t i = 0; i < p.size(); ++i) sum += glm::cross(p[i] - p[0], p[(i + 1) % p.size()] - p[0]);
  return sum;
}

/// Triangles of a flat polygon cover it once: they all turn as it does, and their areas add up to its own.
void expect_covered(const std::vector<dvec3>& polygon, const std::string& what) {
  const PolygonTriangles cut = triangulate(polygon);
  EXPECT_FALSE(cut.crosses_itself) << what;
  const dvec3 whole = doubled_area(polygon), normal = glm::normalize(whole);
  double sum = 0;
  for (const ivec3& t : cut.triangles) {
    const dvec3 a = polygon[static_cast<size_t>(t.x)], b = polygon[static_cast<size_t>(t.y)],
                c = polygon[static_cast<size_t>(t.z)];
    const double area = glm::dot(glm::cross(b - a, c - a), normal);
    EXPECT_GT(area, 0) << what;
    sum += area;
  }
  EXPECT_NEAR(sum / glm::length(whole), 1, 1e-9) << what;
}

/// In several planes, both ways around, beginning anywhere.
void expect_covered_everywhere(const Outline& outline, const std::string& what) {
  const std::pair<dvec3, dvec3> planes[] = {
      {{1, 0, 0}, {0, 1, 0}}, {{1, 0, 0}, {0, 0, 1}}, {{0, 1, 0}, {0, 0, 1}}, {{1, 0.5, -2}, {0.3, 2, 1}}};
  for (const auto& [u, v] : planes)
    for (const bool backwards : {false, true})
      for (size_t first = 0; first < outline.size(); ++first) {
        std::vector<dvec3> polygon;
        for (const dvec2& p : outline) polygon.push_back(p.x * u + p.y * v);
        std::rotate(polygon.begin(), polygon.begin() + static_cast<std::ptrdiff_t>(first), polygon.end());
        if (backwards) std::reverse(polygon.begin(), polygon.end());
        expect_covered(polygon, what);
        if (::testing::Test::HasFailure()) return;
      }
}

TEST(Polygon, OfAnyShapeIsCoveredOnce) {
  const std::pair<const char*, Outline> shapes[] = {
      {"arrow", {{1, 0}, {0.25, 0.25}, {0, 1}, {0, 0}}},
      {"U", {{0, 0}, {3, 0}, {3, 3}, {2, 3}, {2, 1}, {1, 1}, {1, 3}, {0, 3}}},
      {"corners on straight edges", {{0, 0}, {1, 0}, {2, 0}, {2, 1}, {2, 2}, {1, 2}, {0, 2}, {0, 1}}},
      {"triangle of six corners", {{0, 0}, {1, 0}, {2, 0}, {1, 1}, {0, 2}, {0, 1}}},
      {"repeated corners", {{0, 0}, {0, 0}, {4, 0}, {4, 4}, {4, 4}, {4, 4}, {1, 2}, {0, 4}, {0, 0}}},
      {"hole on a bridge", {{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0}, {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}}},
      {"two holes on a bridge",
       {{0, 0},
        {8, 0},
        {8, 4},
        {0, 4},
        {0, 0},
        {1, 1},
        {1, 3},
        {3, 3},
        {3, 1},
        {5, 1},
        {5, 3},
        {7, 3},
        {7, 1},
        {5, 1},
        {3, 1},
        {1, 1}}},
      {"halves that touch in a point", {{0, 0}, {2, 0}, {1, 1}, {2, 2}, {0, 2}, {1, 1}}},
      {"hole that touches a corner", {{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0}, {1, 2}, {2, 1}}},
      {"hole that touches an edge", {{0, 0}, {2, 0}, {1, 1}, {2, 2}, {3, 1}, {2, 0}, {4, 0}, {4, 4}, {0, 4}}},
      {"edge there and back", {{0, 0}, {1, 0}, {2, 0}, {1, 0}, {1, 1}, {0, 1}}},
      {"comb",
       {{0, 0},
        {7, 0},
        {7, 3},
        {6, 3},
        {6, 1},
        {5, 1},
        {5, 3},
        {4, 3},
        {4, 1},
        {3, 1},
        {3, 3},
        {2, 3},
        {2, 1},
        {1, 1},
        {1, 3},
        {0, 3}}}};
  for (const auto& [name, outline] : shapes) expect_covered_everywhere(outline, name);
}

TEST(Polygon, OfRandomStarsIsCoveredOnce) {
  Rng rng(1);
  for (int k = 0; k < 1000; ++k) {
    const int n = 5 + static_cast<int>(rng.uniform() * 40);
    std::vector<dvec3> polygon;
    for (int i = 0; i < n; ++i) {
      const double angle = 2 * kPi * (i + 0.8 * rng.uniform()) / n, radius = 0.05 + rng.uniform();
      polygon.emplace_back(radius * std::cos(angle), 0.0, radius * std::sin(angle));
    }
    expect_covered(polygon, "star " + std::to_string(k));
    for (dvec3& p : polygon) p = 0x1p-20 * std::round(0x1p20 * p.x) * dvec3(1, 0, 0) + dvec3(1e6, -1e6, 1e6 + p.z);
    expect_covered(polygon, "far star " + std::to_string(k));
  }
}

TEST(Polygon, OfAnySizeIsCutAlike) {
  const std::vector<dvec3> u = {{0, 0, 0}, {3, 0, 0}, {3, 3, 0}, {2, 3, 0}, {2, 1, 0}, {1, 1, 0}, {1, 3, 0}, {0, 3, 0}};
  const std::vector<ivec3> expected = triangulate(u).triangles;
  for (const double scale : {1e-100, 1e-12, 1e12, 1e100}) {
    std::vector<dvec3> scaled;
    for (const dvec3& p : u) scaled.push_back(scale * p);
    EXPECT_EQ(triangulate(scaled).triangles, expected) << scale;
  }
}

TEST(Polygon, ThatIsConvexIsAFanAndOneThatIsNotFlatIsCutAsItsProjection) {
  const std::vector<ivec3> fan = {{0, 1, 2}, {0, 2, 3}};
  EXPECT_EQ(triangulate(std::vector<dvec3>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}).triangles, fan);
  EXPECT_EQ(triangulate(std::vector<dvec3>{{0, 0, 0}, {1, 0, 0.3}, {1, 1, 0}, {0, 1, 0.3}}).triangles, fan);
  const PolygonTriangles bent = triangulate(std::vector<dvec3>{{1, 0, 0.1}, {0.25, 0.25, 0}, {0, 1, 0.1}, {0, 0, 0}});
  EXPECT_EQ(bent.triangles.size(), 2u);
  for (const ivec3& t : bent.triangles) EXPECT_TRUE(t.x == 1 || t.y == 1 || t.z == 1) << "all meet in the notch";
}

// As terrain is made of. Along an axis some of them would look like an eight.
TEST(Polygon, OfFourCornersThatIsNotFlatIsCutWithoutAWord) {
  Rng rng(3);
  int crossing = 0;
  for (int k = 0; k < 1000; ++k) {
    const auto height = [&] { return 6 * rng.uniform(); };
    const std::vector<dvec3> quad = {{0, 0, height()}, {1, 0, height()}, {1, 1, height()}, {0, 1, height()}};
    const PolygonTriangles cut = triangulate(quad);
    EXPECT_EQ(cut.triangles.size(), 2u);
    crossing += cut.crosses_itself;
  }
  EXPECT_EQ(crossing, 0);
}

TEST(Polygon, ThatCrossesItselfIsTold) {
  const PolygonTriangles eight = triangulate(std::vector<dvec3>{{0, 0, 0}, {1, 0, 1}, {1, 0, 0}, {0, 0, 1}});
  EXPECT_TRUE(eight.crosses_itself);
  EXPECT_EQ(eight.triangles.size(), 2u);
  std::vector<dvec3> pentagram;
  for (int i = 0; i < 5; ++i) pentagram.emplace_back(std::cos(0.8 * kPi * i), std::sin(0.8 * kPi * i), 0.0);
  EXPECT_TRUE(triangulate(pentagram).crosses_itself);
  Rng rng(2);
  for (int k = 0; k < 200; ++k) {
    std::vector<dvec3> tangle;
    for (int i = 0; i < 4 + k; ++i) tangle.emplace_back(rng.uniform(), rng.uniform(), rng.uniform());
    for (const ivec3& t : triangulate(tangle).triangles)
      for (int c = 0; c < 3; ++c) ASSERT_TRUE(t[c] >= 0 && t[c] < 4 + k);
  }
}

TEST(Polygon, WithoutAnAreaEndsToo) {
  for (const std::vector<dvec3>& p :
       {std::vector<dvec3>(7, dvec3(1, 2, 3)), std::vector<dvec3>{{0, 0, 0}, {1, 0, 0}, {2, 0, 0}, {3, 0, 0}},
        std::vector<dvec3>{{0, 0, 0}, {1, 1, 0}, {2, 2, 0}, {1, 1, 0}, {0, 0, 0}}})
    for (const ivec3& t : triangulate(p).triangles)
      EXPECT_EQ(glm::cross(p[static_cast<size_t>(t.y)] - p[static_cast<size_t>(t.x)],
                           p[static_cast<size_t>(t.z)] - p[static_cast<size_t>(t.x)]),
                dvec3(0));
}

}  // namespace
}  // namespace brume
