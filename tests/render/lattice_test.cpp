// Lattices of nodes for guides: evenly spaced, and with planes that are farther apart where less happens.

#include "render/guides/lattice.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "render/guides/scattering_solver.h"
#include "tests/support/targets.h"
#include "tests/support/volumes.h"

namespace brume {
namespace {

constexpr size_t kMany = 10000000;

/// A box of 60 x 40 x 30 in which something of 6 x 6 x 6 wants nodes one apart, the rest nodes ten apart.
Lattice graded() {
  const std::vector<LatticeRegion> regions = {{{20, 22, 12}, {26, 28, 18}, dvec3(1)}, {{0, 0, 0}, {60, 40, 30}, dvec3(10)}};
  return *Lattice::graded({0, 0, 0}, {60, 40, 30}, regions, 1, 1, kMany);
}

double sum_over_cells(const Lattice& lattice, const NodeValues& values) {
  double sum = 0;
  for (int x = 0; x < lattice.n.x; ++x)
    for (int y = 0; y < lattice.n.y; ++y)
      for (int z = 0; z < lattice.n.z; ++z) {
        const dvec3 size = lattice.spacing * lattice.cell(x, y, z);
        sum += size.x * size.y * size.z * static_cast<double>(values[lattice.index(x, y, z)]);
      }
  return sum;
}

TEST(GradedLattice, IsAsCloseAsRegionsWantAndCoversTheBox) {
  const Lattice lattice = graded();
  const dvec3 lo(20, 22, 12), hi(26, 28, 18), end(60, 40, 30);
  for (int a = 0; a < 3; ++a) {
    const auto at = [&](int i) { return lattice.origin[a] + lattice.spacing * lattice.place(a, i); };
    for (int i = 0; i + 1 < lattice.n[a]; ++i) {
      const double width = at(i + 1) - at(i);
      EXPECT_LE(width, 10);
      if (at(i + 1) > lo[a] && at(i) < hi[a]) {
        EXPECT_EQ(width, 1) << a << ", " << i;
      }
    }
    EXPECT_LE(at(1), 0);
    EXPECT_GE(at(lattice.n[a] - 2), end[a]);
  }
  EXPECT_LT(static_cast<double>(lattice.size()),
            0.5 * static_cast<double>(Lattice::over({0, 0, 0}, end, 1, kMany).size()));
}

TEST(GradedLattice, HasNoMoreNodesThanAllowed) {
  const std::vector<LatticeRegion> regions = {{{0, 0, 0}, {60, 40, 30}, dvec3(1)}};
  const Lattice lattice = *Lattice::graded({0, 0, 0}, {60, 40, 30}, regions, 1, 10, 5000);
  EXPECT_LE(lattice.n.x * lattice.n.y * lattice.n.z, 5000);
  EXPECT_GT(lattice.n.x * lattice.n.y * lattice.n.z, 2500);
}

TEST(GradedLattice, IsNoneWhereTheWidestSpacingMakesTooManyNodes) {
  const std::vector<LatticeRegion> regions = {{{0, 0, 0}, {60, 40, 30}, dvec3(1)}};
  EXPECT_FALSE(Lattice::graded({0, 0, 0}, {60, 40, 30}, regions, 1, 2, 5000));
  EXPECT_FALSE(Lattice::graded({0, 0, 0}, {60, 40, 30}, regions, 1, 1e3, 100)) << "fewer than any has";
}

TEST(GradedLattice, FindsItsOwnNodesAndWhatLiesBetween) {
  const Lattice lattice = graded();
  for (int i = 0; i < lattice.n.x; ++i) {
    const dvec3 node = lattice.to_lattice(lattice.node(i, 3, 4));
    EXPECT_NEAR(node.x, i, 1e-4);
    EXPECT_NEAR(node.y, 3, 1e-4);
    EXPECT_NEAR(node.z, 4, 1e-4);
  }
  for (int i = 0; i + 1 < lattice.n.x; ++i)
    EXPECT_NEAR(lattice.to_lattice(0.25 * lattice.node(i, 3, 4) + 0.75 * lattice.node(i + 1, 3, 4)).x, i + 0.75, 1e-4);
}

// A field that is linear in the world's coordinates is linear between nodes, wherever they are.
TEST(GradedLattice, InterpolatesLinearFieldsExactly) {
  const Lattice lattice = graded();
  NodeValues values(lattice.size());
  const auto field = [](const dvec3& p) { return 1 + 0.1 * p.x - 0.2 * p.y + 0.3 * p.z; };
  for (int x = 0; x < lattice.n.x; ++x)
    for (int y = 0; y < lattice.n.y; ++y)
      for (int z = 0; z < lattice.n.z; ++z)
        values[lattice.index(x, y, z)] = static_cast<float>(field(lattice.node(x, y, z)));
  Rng rng(3);
  for (int i = 0; i < 200; ++i) {
    const dvec3 p = test::random_point(rng, dvec3(0), dvec3(60, 40, 30));
    EXPECT_NEAR(static_cast<double>(interpolated(lattice, values, p)), field(p), 1e-3);
  }
}

TEST(GradedLattice, CoarsenedFieldsKeepTheirSumOverCells) {
  const Lattice fine = graded(), coarse = fine.every_second();
  NodeValues values(fine.size());
  Rng rng(5);
  for (int x = 2; x < fine.n.x - 2; ++x)
    for (int y = 2; y < fine.n.y - 2; ++y)
      for (int z = 2; z < fine.n.z - 2; ++z) values[fine.index(x, y, z)] = static_cast<float>(rng.uniform());
  for (int i = 0; i < coarse.n.y; ++i) EXPECT_DOUBLE_EQ(coarse.node(0, i, 0).y, fine.node(0, 2 * i, 0).y);
  const double sum = sum_over_cells(fine, values);
  EXPECT_NEAR(sum_over_cells(coarse, coarsened(fine, values, coarse, {})), sum, 1e-5 * sum);
}

/// A dense box in a thin one that reaches far around it.
struct BoxInHaze {
  BrickGrid bricks = test::constant_box({0, 0, 0}, {7, 7, 7});
  std::vector<Medium> media;
  BoxInHaze() {
    HomogeneousShape haze;
    haze.lo = dvec3(-30, -20, -10);
    haze.hi = dvec3(40, 30, 20);
    media.emplace_back(bricks, dmat4(1.0), 0.5, dvec3(1), 0.3);
    media.emplace_back(haze, dmat4(1.0), Coefficients{dvec3(0.01), dvec3(1)}, PhaseFunction::henyey_greenstein(0.3));
  }
};

/// Where the planes of a lattice lie, as sweeps read them.
struct Places {
  std::array<std::vector<float>, 3> along;
  explicit Places(const Lattice& lattice) {
    for (int a = 0; a < 3; ++a)
      for (int i = 0; i < lattice.n[a]; ++i)
        along[static_cast<size_t>(a)].push_back(static_cast<float>(lattice.place(a, i)));
  }
  SweepDomain domain(const Lattice& lattice) const {
    SweepDomain domain{{lattice.n.x, lattice.n.y, lattice.n.z}, lattice.row()};
    for (size_t a = 0; a < 3; ++a) domain.places[a] = along[a].data();
    return domain;
  }
};

class GradedSweep : public test::EveryTarget {};

// In radiance 1 from all sides, media that emit as much as they absorb are invisible, wherever the planes are.
TEST_P(GradedSweep, KeepsEquilibrium) {
  const Lattice lattice = graded();
  const Places places(lattice);
  const SweepDomain domain = places.domain(lattice);
  std::vector<float> extinction(domain.size(), 0.0f), light(domain.size(), 0.0f);
  Rng rng(9);
  for (int x = 1; x < lattice.n.x - 1; ++x)
    for (int y = 1; y < lattice.n.y - 1; ++y)
      for (int z = 1; z < lattice.n.z - 1; ++z)
        extinction[lattice.index(x, y, z)] = 0.3f * static_cast<float>(rng.uniform());
  SweepMedia media{extinction.data(), {extinction.data()}, 1};
  for (const std::array<double, 3>& d :
       {std::array{0.8, 0.0, 0.6}, std::array{-0.64, 0.6, -0.48}, std::array{0.48, -0.8, 0.36}}) {
    const SweepBeam beam{d, {1}, 1, light.data()};
    sweep(domain, media, {&beam, 1}, {});
    for (int x = 1; x < lattice.n.x - 1; ++x)
      for (int y = 1; y < lattice.n.y - 1; ++y)
        for (int z = 1; z < lattice.n.z - 1; ++z) ASSERT_NEAR(light[lattice.index(x, y, z)], 1, 1e-4);
  }
}

// What is attenuated is the depth along the beam, by cells of any width: here only along x.
TEST_P(GradedSweep, AttenuatesByDistance) {
  const Lattice lattice = graded();
  const Places places(lattice);
  const SweepDomain domain = places.domain(lattice);
  const std::vector<float> extinction(domain.size(), 0.02f);
  std::vector<float> light(domain.size(), 0.0f);
  const SweepBeam beam{{1, 0, 0}, {1}, 1, light.data()};
  sweep(domain, {extinction.data(), {}, 0}, {&beam, 1}, {});
  const int y = lattice.n.y / 2, z = lattice.n.z / 2, last = lattice.n.x - 2;
  const double ratio = static_cast<double>(light[lattice.index(last, y, z)] / light[lattice.index(2, y, z)]);
  EXPECT_NEAR(ratio, std::exp(-0.02 * (lattice.place(0, last) - lattice.place(0, 2))), 1e-3);
}
INSTANTIATE_TEST_SUITE_P(Targets, GradedSweep, ::testing::ValuesIn(test::targets()), test::target_name);

TEST(GradedSolver, HoldsAllOfTheMedia) {
  const BoxInHaze scene;
  const GuideMedia media(scene.media, {}, 0);
  const std::vector<LatticeRegion> regions = {{{-1, -1, -1}, {8, 8, 8}, dvec3(1)}, {media.lo(), media.hi(), dvec3(6)}};
  const Lattice lattice = *Lattice::graded(media.lo(), media.hi(), regions, 1, 1, kMany);
  const ScatteringSolver fine(lattice, media, kGrey, {}), coarse(lattice.every_second(), fine, {});
  const double even =
      sum_over_cells(Lattice::over(media.lo(), media.hi(), 1, kMany),
                     ScatteringSolver(Lattice::over(media.lo(), media.hi(), 1, kMany), media, kGrey, {}).extinction());
  EXPECT_NEAR(sum_over_cells(lattice, fine.extinction()), even, 0.01 * even);
  EXPECT_NEAR(sum_over_cells(coarse.lattice(), coarse.extinction()) / 2, even, 0.01 * even);
}

// In an even sky media that absorb nothing are invisible: all orders together are the sky again.
TEST(GradedSolver, KeepsTheEnergyOfAnEvenSky) {
  const BoxInHaze scene;
  const GuideMedia media(scene.media, {}, 0);
  const std::vector<LatticeRegion> regions = {{{-1, -1, -1}, {8, 8, 8}, dvec3(1)}, {media.lo(), media.hi(), dvec3(6)}};
  ScatteringSolver solver(*Lattice::graded(media.lo(), media.hi(), regions, 1, 1, kMany), media, kGrey, {});
  const std::vector<double> sky(ScatteringSolver::directions().size(), 1.0);
  Radiance light = solver.entering(sky), sum = light;
  for (int order = 1; order < 80; ++order) {
    light = solver.transport(solver.scatter(std::move(light)));
    solver.add(light, sum);
  }
  for (const dvec3& p : {dvec3(3.5), dvec3(6, 2, 1), dvec3(-20, 5, 4), dvec3(30, -10, 10)})
    EXPECT_NEAR(static_cast<double>(interpolated(solver.lattice(), sum[0], p)), 1, 0.04) << p.x;
}

}  // namespace
}  // namespace brume
