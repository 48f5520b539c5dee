#include "workflows/scene_cache.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "render/files/mesh.h"
#include "render/world/volume_fields.h"

namespace brume {
namespace {

constexpr double kMostMemory = 0.25;  // of the machine's, for all scenes but the last one

double bytes_of(const PreparedScene& scene) {
  double sum = 0;
  for (const Medium& m : scene.context().media)
    if (!m.homogeneous()) sum += static_cast<double>(m.bricks().bytes());
  return sum;
}

/// What is known under a key, or else what `read` gives, from now on known.
template <class Map, class Read>
auto known_or_read(Map& known, const typename Map::key_type& key, const Read& read) {
  auto value = known[key].lock();
  if (!value) known[key] = value = read();
  return value;
}

}  // namespace

void SceneCache::add_grids(VolumeSettings& v, const Task& task) {
  if (v.shape != "grid" || (v.grids && v.grids->of_arrays())) return;
  auto grids = std::make_shared<VolumeGrids>();
  if (v.moment.later) {  // what is between two frames is made of both
    v.grids = std::move(grids);
    return;
  }
  const auto scalar = [&](const char* what, const std::string& name, GridUse use) {
    const std::filesystem::path& file = file_of(v, use);
    return known_or_read(fields_, {file, what, name}, [&] {
      ++counts_.read;
      return std::make_shared<const ScalarField>(use == GridUse::kDensity
                                                     ? load_scalar(file, {.grid = name, .paging = paging_of(v)}, task)
                                                     : load_field(v, name, use, task));
    });
  };
  // What goes through a curve or a limit on its way does so in the file's own precision.
  if (!v.convert_level_set && v.remap.empty() && !(v.max_density > 0)) {
    grids->density = scalar("density", v.grid, GridUse::kDensity);
    fields_[{v.file, "density", grids->density->summary.name}] = grids->density;
  }
  if (v.temperature_grid != "none")
    grids->temperature = scalar("temperature", v.temperature_grid, GridUse::kTemperature);
  if (v.flame_grid != "none") grids->flame = scalar("flame", v.flame_grid, GridUse::kFlame);
  if (v.albedo_grid != "none")
    grids->colour = known_or_read(colours_, {file_of(v, GridUse::kColour), "colour", v.albedo_grid}, [&] {
      ++counts_.read;
      return std::make_shared<const VectorField>(load_colour_field(file_of(v, GridUse::kColour), v.albedo_grid, task));
    });
  v.grids = std::move(grids);
}

void SceneCache::add_mesh(SurfaceSettings& s) {
  if (s.mesh) return;
  s.mesh = known_or_read(meshes_, s.file, [&] {
    ++counts_.read;
    return std::make_shared<const TriangleMesh>(read_mesh(s.file));
  });
}

PreparedScene& SceneCache::prepare(Scene scene, const LayerRequest& layers, const Task& task) {
  std::string world = world_of(scene);
  const auto known = std::find_if(kept_.begin(), kept_.end(), [&](const Kept& kept) { return kept.world == world; });
  for (VolumeSettings& v : scene.volumes) add_grids(v, task);
  for (SurfaceSettings& s : scene.surfaces) add_mesh(s);
  if (known != kept_.end()) {
    known->prepared->become(std::move(scene), layers, task);
    kept_.splice(kept_.begin(), kept_, known);
    return last();
  }
  auto prepared = std::make_unique<PreparedScene>(std::move(scene), layers, task);
  ++counts_.prepared;
  for (const VolumeSettings& v : prepared->scene().volumes)
    if (v.shape == "grid" && !v.grids->density && !v.grids->of_arrays()) ++counts_.read;  // by its loader
  kept_.push_front({std::move(world), std::move(prepared), nullptr});
  drop_old();
  return last();
}

void SceneCache::drop_old() {
  double bytes = 0;
  size_t kept = 1;
  for (auto it = std::next(kept_.begin()); it != kept_.end();) {
    bytes += bytes_of(*it->prepared);
    if (kept < most_ && !it->world.empty() && bytes < kMostMemory * physical_memory()) {
      ++kept;
      ++it;
    } else {
      counts_.lights_solved += it->prepared->guides_solved();
      it = kept_.erase(it);
    }
  }
  std::erase_if(fields_, [](const auto& entry) { return entry.second.expired(); });
  std::erase_if(colours_, [](const auto& entry) { return entry.second.expired(); });
  std::erase_if(meshes_, [](const auto& entry) { return entry.second.expired(); });
}

const Guides& SceneCache::sketch(const Task& task) {
  Kept& now = kept_.front();
  if (!now.sketch) {
    const FilmSettings& film = now.prepared->scene().film;
    now.sketch = std::make_unique<Guides>(now.prepared->context(), 0, 1.0 * film.width * film.height, task);
  }
  return *now.sketch;
}

SceneCache::Counts SceneCache::counts() const {
  Counts counts = counts_;
  for (const Kept& kept : kept_) counts.lights_solved += kept.prepared->guides_solved();
  return counts;
}

void SceneCache::know(const std::filesystem::path& file, std::shared_ptr<const ScalarField> density) {
  const std::string name = density->summary.name;
  fields_[{file, "density", name}] = std::move(density);
}

void SceneCache::forget() {
  for (Kept& kept : kept_) kept.world.clear();
  fields_.clear();
  colours_.clear();
  meshes_.clear();
  hashes_.clear();
}

}  // namespace brume
