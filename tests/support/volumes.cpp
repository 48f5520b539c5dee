#include "tests/support/volumes.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "render/scene/scene_io.h"
#include "tests/support/files.h"
#include "tests/support/vdb_grids.h"
#include "volume/vdb_io.h"

namespace brume::test {

BrickGrid make_bricks(const VoxelBox& box, const std::function<float(const ivec3&)>& density) {
  std::vector<ivec3> blocks;
  for (int x = box.lo.x & ~7; x <= box.hi.x; x += 8)
    for (int y = box.lo.y & ~7; y <= box.hi.y; y += 8)
      for (int z = box.lo.z & ~7; z <= box.hi.z; z += 8) blocks.emplace_back(x, y, z);
  return BrickGrid::build(box, blocks, [&](const ivec3& lo, float* values) {
    for (int x = 0; x <= 8; ++x)
      for (int y = 0; y <= 8; ++y)
        for (int z = 0; z <= 8; ++z) {
          const ivec3 v = lo + ivec3(x, y, z);
          const bool inside = glm::all(glm::greaterThanEqual(v, box.lo)) && glm::all(glm::lessThanEqual(v, box.hi));
          *values++ = inside ? density(v) : 0.0f;
        }
  });
}

BrickGrid constant_box(const ivec3& lo, const ivec3& hi, float density) {
  return make_bricks({lo, hi}, [density](const ivec3&) { return density; });
}

dmat4 scaling(const dvec3& s) {
  dmat4 m(1.0);
  for (int a = 0; a < 3; ++a) m[a][a] = s[a];
  return m;
}

dvec3 random_direction(Rng& rng) {
  const double z = 2 * rng.uniform() - 1, r = std::sqrt(1 - z * z);
  const SinCos phi = portable_sincos_2pi(rng.uniform());
  return {r * phi.cos, r * phi.sin, z};
}

dvec3 random_point(Rng& rng, const dvec3& lo, const dvec3& hi) {
  return lo + (hi - lo) * dvec3(rng.uniform(), rng.uniform(), rng.uniform());
}

dmat4 random_affine(Rng& rng) {
  for (;;) {
    const Frame frame(random_direction(rng));
    dmat3 m(frame.x, frame.y, frame.z);
    dmat3 stretch(1.0);
    for (int a = 0; a < 3; ++a) stretch[a][a] = std::exp(2 * rng.uniform() - 1);
    dmat3 shear(1.0);
    shear[1][0] = rng.uniform() - 0.5;
    shear[2][1] = rng.uniform() - 0.5;
    if (rng.uniform() < 0.5) stretch[0][0] *= -1;
    m = m * stretch * shear;
    if (std::abs(glm::determinant(m)) < 0.02) continue;
    dmat4 result(m);
    result[3] = glm::dvec4(random_point(rng, dvec3(-5), dvec3(5)), 1.0);
    return result;
  }
}

void write_affine_vdb(const std::filesystem::path& path, const VoxelBox& box, const dmat4& world_from_index,
                      const std::function<float(const ivec3&)>& density) {
  openvdb::initialize();
  auto grid = openvdb::FloatGrid::create(0.0f);
  grid->setName("density");
  grid->setGridClass(openvdb::GRID_FOG_VOLUME);
  auto accessor = grid->getAccessor();
  ivec3 v;
  for (v.x = box.lo.x; v.x <= box.hi.x; ++v.x)
    for (v.y = box.lo.y; v.y <= box.hi.y; ++v.y)
      for (v.z = box.lo.z; v.z <= box.hi.z; ++v.z)
        if (const float value = density(v); value != 0) accessor.setValue({v.x, v.y, v.z}, value);
  openvdb::math::Mat4d m;
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) m(i, j) = world_from_index[i][j];
  grid->setTransform(openvdb::math::Transform::createLinearTransform(m));
  openvdb::io::File file(path.string());
  file.write(openvdb::GridCPtrVec{grid});
  file.close();
}

void write_grids_vdb(const std::filesystem::path& path, const VoxelBox& box, const std::vector<NamedGrid>& grids,
                     double voxel_size) {
  openvdb::initialize();
  openvdb::GridCPtrVec all;
  for (const NamedGrid& named : grids) {
    auto grid = openvdb::FloatGrid::create(0.0f);
    if (!named.name.empty()) grid->setName(named.name);
    grid->setGridClass(openvdb::GRID_FOG_VOLUME);
    grid->setTransform(openvdb::math::Transform::createLinearTransform(voxel_size));
    auto accessor = grid->getAccessor();
    ivec3 v;
    for (v.x = box.lo.x; named.value && v.x <= box.hi.x; ++v.x)
      for (v.y = box.lo.y; v.y <= box.hi.y; ++v.y)
        for (v.z = box.lo.z; v.z <= box.hi.z; ++v.z)
          if (const float value = named.value(v); value != 0) accessor.setValue({v.x, v.y, v.z}, value);
    all.push_back(grid);
  }
  openvdb::io::File(path.string()).write(all);
}

void add_voxel(const std::filesystem::path& path, const std::string& grid, const ivec3& voxel, float value) {
  openvdb::initialize();
  openvdb::io::File in(path.string());
  in.open(/*delayLoad=*/false);
  const auto typed = openvdb::gridPtrCast<openvdb::FloatGrid>(in.readGrid(grid));
  in.close();
  typed->tree().setValue({voxel.x, voxel.y, voxel.z}, value);
  openvdb::io::File(path.string()).write(openvdb::GridCPtrVec{typed});
}

void write_velocity_vdb(const std::filesystem::path& path, const std::filesystem::path& density, const VoxelBox& box,
                        const dvec3& velocity) {
  openvdb::initialize();
  openvdb::io::File in(density.string());
  in.open();
  const openvdb::GridBase::Ptr grid = in.readGrid("density");
  auto field = openvdb::Vec3SGrid::create(openvdb::Vec3s(0.0f));
  field->setName("vel");
  field->setTransform(grid->transform().copy());
  field->fill(
      {{box.lo.x, box.lo.y, box.lo.z}, {box.hi.x, box.hi.y, box.hi.z}},
      openvdb::Vec3s(static_cast<float>(velocity.x), static_cast<float>(velocity.y), static_cast<float>(velocity.z)));
  openvdb::io::File(path.string()).write(openvdb::GridCPtrVec{grid, field});
}

void write_coloured_vdb(const std::filesystem::path& path, const VoxelBox& box,
                        const std::function<float(const ivec3&)>& density,
                        const std::function<vec3(const ivec3&)>& colour) {
  openvdb::initialize();
  auto values = openvdb::FloatGrid::create(0.0f);
  auto colours = openvdb::Vec3SGrid::create(openvdb::Vec3s(0.0f));
  values->setName("density");
  colours->setName("Cd");
  values->setGridClass(openvdb::GRID_FOG_VOLUME);
  auto value = values->getAccessor();
  auto rgb = colours->getAccessor();
  ivec3 v;
  for (v.x = box.lo.x - 1; v.x <= box.hi.x + 1; ++v.x)
    for (v.y = box.lo.y - 1; v.y <= box.hi.y + 1; ++v.y)
      for (v.z = box.lo.z - 1; v.z <= box.hi.z + 1; ++v.z) {
        const vec3 c = colour(v);
        rgb.setValue({v.x, v.y, v.z}, {c.x, c.y, c.z});
        if (glm::all(glm::greaterThanEqual(v, box.lo)) && glm::all(glm::lessThanEqual(v, box.hi)))
          value.setValue({v.x, v.y, v.z}, density(v));
      }
  openvdb::io::File(path.string()).write(openvdb::GridCPtrVec{values, colours});
}

Mean mean_radiance(const Layers& frame, const LayerName& layer) {
  Mean mean;
  const double pixels = static_cast<double>(frame.width()) * frame.height();
  for (int c = 0; c < 3; ++c) {
    const Plane& value = frame.at(layer.channel(static_cast<size_t>(c)));
    const Plane& variance = frame.at(layer.channel_of(statistic::mean_variance, static_cast<size_t>(c)));
    for (int y = 0; y < frame.height(); ++y)
      for (int x = 0; x < frame.width(); ++x) {
        mean.value[c] += value(x, y) / pixels;
        mean.error[c] += variance(x, y) / (pixels * pixels);
      }
    mean.error[c] = std::sqrt(mean.error[c]);
  }
  return mean;
}

void expect_same_bits(const Layers& a, const Layers& b, const std::string& what) {
  ASSERT_EQ(a.names(), b.names()) << what;
  for (const auto& [name, plane] : a.channels())
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x)
        ASSERT_EQ(std::bit_cast<uint32_t>(plane(x, y)), std::bit_cast<uint32_t>(b.at(name)(x, y)))
            << what << " " << name << " " << x << " " << y;
}

Scene scene_of(const std::filesystem::path& volume, double sigma_t, double albedo, double g) {
  Scene scene;
  scene.name = volume.stem().string();
  scene.film.width = scene.film.height = 24;
  scene.volumes.emplace_back();
  scene.volumes[0].file = volume;
  scene.volumes[0].sigma_t = dvec3(sigma_t);
  scene.volumes[0].albedo = dvec3(albedo);
  scene.volumes[0].g = g;
  const ScalarField field = load_scalar(volume, {});
  const Medium medium(field.bricks, field.world_from_index, sigma_t, dvec3(albedo), g);
  const Medium::Sphere sphere = medium.bounding_sphere();
  scene.camera.look_at = sphere.centre;
  scene.camera.position = sphere.centre + dvec3(0.3, -3, 0.8) * sphere.radius;
  scene.camera.fov = 30;
  return scene;
}

Scene demo(const char* name, int size) {
  Scene scene = read_scene(source(std::string("data/scenes/") + name + ".toml"));
  scene.film.width = scene.film.height = size;
  return scene;
}

}  // namespace brume::test
