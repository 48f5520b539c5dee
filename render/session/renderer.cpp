#include "render/session/renderer.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/error.h"
#include "base/parallel_for.h"
#include "render/scene/scene_fingerprint.h"
#include "render/session/flash_lamp.h"
#include "render/session/render_session.h"
#include "render/session/scene_notes.h"
#include "render/transport/emission.h"
#include "render/transport/lane_detail.h"
#include "render/transport/wavefront.h"

namespace brume {

PreparedScene::PreparedScene(Scene scene, const LayerRequest& layers, const Task& task)
    : scene_(std::move(scene)), media_(scene_, task), lights_(scene_, media_.world_shift(), task) {
  bool catcher = false;
  if (!scene_.surfaces.empty()) {
    const bool blurred = scene_.camera.shutter.y > scene_.camera.shutter.x;
    surfaces_ = std::make_unique<Surfaces>(scene_.surfaces, media_.world_shift(), blurred,
                                           WorkingSpace(scene_.film.color_space));
    for (uint32_t i = 0; i < surfaces_->count(); ++i) {
      const SurfaceSettings& s = scene_.surfaces[i];
      if (s.radiance != dvec3(0))
        lights_.add_mesh(surfaces_->mesh(i), s.radiance, s.two_sided, i, surfaces_->emission_share(i));
      catcher = catcher || s.role == "shadow_catcher";
    }
  }
  lights_.set_emissions(media_.emission_volumes());
  const std::string& sampling = scene_.render.light_sampling;
  if (sampling != "none" && (!media_.media().empty() || surfaces_))
    for (const EmissionField& field : media_.emissions()) lights_.add_field(field, media_.media(), task);
  // A shadow catcher gathers light by light sampling alone, so the constant sky takes part in it.
  lights_.finish(catcher && sampling == "auto" ? "all" : sampling);
  if (sampling == "none" && lights_.any_delta())
    throw InputError(
        "light_sampling = \"none\" cannot find exactly parallel light or points; give the sun an angular_diameter above 0, or use spheres");
  world_notes_ = media_.notes();
  if (surfaces_) {
    const std::vector<std::string> own = surfaces_->notes();
    world_notes_.insert(world_notes_.end(), own.begin(), own.end());
  }
  context_.media = media_.media();
  context_.emissions = media_.emissions();
  context_.lights = &lights_;
  context_.surfaces = surfaces_.get();
  context_.isosurface_density = scene_.render.surface_density;
  context_.world_shift = media_.world_shift();
  context_.plan = make_plan(scene_, media_, lights_, surfaces_.get(), camera(), layers);
  lights_.aim_at_fields(context_.plan.aims_at_fire);
  prepare_lanes(task);
  context_ = context_for(scene_, camera(), context_.plan, task);
  notes_ = notes_for(scene_, layers);
}

PathContext PreparedScene::context_for(const Scene& scene, const Camera& camera, Plan plan, const Task& task) {
  PathContext context = context_;
  context.max_events = scene.render.max_events;
  context.indirect_limit = scene.render.indirect_limit;
  context.roulette_start = scene.render.roulette_start;
  context.plan = std::move(plan);
  if (context.plan.splits_camera_rays) {
    stop_.cancel = task.cancel;
    context.stop = &stop_;
    context.plan.first_collision.paths = choose_path_counts(context, scene, camera, task);
  }
  if (context.plan.isosurface) find_isosurfaces(task);
  if (context.plan.flash) {
    stop_.cancel = task.cancel;
    context.stop = &stop_;
    context.flash = calibrated_flash_lamp(context, scene, camera, media_.bounds());
  }
  context.stop = nullptr;
  return context;
}

std::vector<std::string> PreparedScene::notes_for(const Scene& scene, const LayerRequest& layers) const {
  std::vector<std::string> notes = world_notes_;
  const std::vector<std::string> own = scene_notes(scene, media_, lights_, layers);
  notes.insert(notes.end(), own.begin(), own.end());
  return notes;
}

void PreparedScene::become(Scene scene, const LayerRequest& layers, const Task& task) {
  if (world_of(scene) != world_of(scene_)) throw std::logic_error("PreparedScene::become: a scene of another world");
  const Camera camera(scene.camera, scene.film.width, scene.film.height, world_shift());
  const Plan plan = make_plan(scene, media_, lights_, surfaces_.get(), camera, layers);
  lights_.aim_at_fields(plan.aims_at_fire);
  try {
    context_ = context_for(scene, camera, plan, task);
  } catch (...) {  // it stays what it was
    lights_.aim_at_fields(context_.plan.aims_at_fire);
    throw;
  }
  notes_ = notes_for(scene, layers);
  scene_ = std::move(scene);
}

PreparedScene::KeptGuides& PreparedScene::kept_guides(int samples) const {
  const double pixels = static_cast<double>(scene_.film.width) * scene_.film.height;
  const std::lock_guard lock(guides_mutex_);
  return guides_[{Guides::detail(samples), Guides::most_nodes(pixels)}];
}

bool PreparedScene::has_guides(int samples) const {
  KeptGuides& kept = kept_guides(samples);
  const std::unique_lock lock(kept.solving, std::try_to_lock);
  return lock && kept.solved;
}

std::function<void(const Task&)> PreparedScene::guides_solver(int samples) const {
  const double pixels = static_cast<double>(scene_.film.width) * scene_.film.height;
  return [&kept = kept_guides(samples), context = context_, samples, pixels](const Task& task) {
    const std::lock_guard lock(kept.solving);
    if (!kept.solved) kept.solved.emplace(context, samples, pixels, task);
  };
}

const Guides* PreparedScene::guides(int samples, const Task& task) const {
  if (!plan().layers.guides) return nullptr;
  guides_solver(samples)(task);
  return &*kept_guides(samples).solved;
}

size_t PreparedScene::guides_solved() const {
  const std::lock_guard lock(guides_mutex_);
  return static_cast<size_t>(
      std::count_if(guides_.begin(), guides_.end(), [](const auto& kept) { return kept.second.solved.has_value(); }));
}

namespace {

/// Detail loosens all majorants. Where a cell holds many tentative collisions, tighter bounds of smaller cells save
/// more of them than crossing twice as many cells costs.
bool wants_small_cells(const Medium& medium) {
  constexpr double kMany = 16;  // tentative collisions along a cell
  if (!medium.detail() || medium.displacement()) return false;
  double sum = 0, squares = 0;
  medium.bricks().each_distinct_cell([&](const BrickGrid::Cell& cell, uint64_t count) {
    const double majorant = cell.majorant, cells = static_cast<double>(count);
    sum += cells * majorant;
    squares += cells * majorant * majorant;
  });
  const double length = medium.bricks().cell_size() * medium.voxel_size();
  return squares / sum * medium.majorant_factor() * medium.extinction_per_density() * length > kMany;
}

}  // namespace

void PreparedScene::prepare_lanes(const Task& task) {
  lane_grids_.reserve(context_.media.size());
  for (size_t i = 0; i < context_.media.size(); ++i) {
    const Medium& medium = context_.media[i];
    DisplacedLaneGrid& displaced = displaced_grids_.emplace_back();
    LaneGrid& grid = lane_grids_.emplace_back();
    if (plan().media[i] != Precision::kLanes) continue;
    if (const Displacement* const d = medium.displacement())
      displaced = {LaneGrid::of_values(medium.bricks()),
                   {LaneGrid::of_values(d->field.parts[0]), LaneGrid::of_values(d->field.parts[1]),
                    LaneGrid::of_values(d->field.parts[2])}};
    const double scale = scene_.render.majorant_scale * medium.majorant_factor();
    grid = LaneGrid(medium.walked(), scale, task);
    if (wants_small_cells(medium)) displaced.density = LaneGrid::halved(medium.bricks(), scale, task);
  }
  for (const EmissionField& field : context_.emissions)
    emission_grids_.push_back(LaneEmission::fits(field) ? LaneGrid(field.shape().bricks(), 1.0, task) : LaneGrid());
  context_.lane_grids = lane_grids_;
  context_.emission_grids = emission_grids_;
  context_.displaced_grids = displaced_grids_;
}

/// Of the media that have none yet.
void PreparedScene::find_isosurfaces(const Task& task) {
  for (size_t i = 0; i < lane_grids_.size(); ++i) {
    const Medium& medium = context_.media[i];
    if (plan().media[i] != Precision::kLanes || medium.displacement() || !lane_grids_[i].isosurface_cell.empty())
      continue;
    lane_grids_[i].find_isosurface(medium.bricks(),
                                   static_cast<float>(scene_.render.surface_density * medium.maximum_density()), task);
  }
}

// Cones of blocks of 8 x 8 pixels are bounded first, then their quarters from there on, down to single pixels. Blocks
// are the same in every crop.
std::vector<EntryBound> PreparedScene::entry_bounds(const Camera& camera, const RenderJob::Crop& window,
                                                    const Task& task) const {
  constexpr int kBlock = 8;
  const int width = window.width();
  std::vector<EntryBound> bounds(static_cast<size_t>(width) * window.height());
  if (!plan().one_grid || camera.moves()) return bounds;
  const auto rounded_down = [](double t) { return std::nextafter(static_cast<float>(t), 0.0f); };
  const auto visit = [&](const auto& self, const ivec2& corner, int size, const LaneGrid::Entry& from) -> void {
    const auto inside = [](int begin, int extent, int low, int high) { return begin + extent > low && begin < high; };
    if (!inside(corner.x, size, window.x0, window.x1) || !inside(corner.y, size, window.y0, window.y1)) return;
    const LaneGrid::Entry entry =
        lane_grids_[0].entry_bound(context_.media[0].to_local(*camera.ray_cone(corner, corner + size)), from);
    if (std::isinf(entry.medium)) {  // for none of its pixels
      for (int y = std::max(corner.y, window.y0); y < std::min(corner.y + size, window.y1); ++y)
        for (int x = std::max(corner.x, window.x0); x < std::min(corner.x + size, window.x1); ++x)
          bounds[static_cast<size_t>(y - window.y0) * width + (x - window.x0)] = {EntryBound::kNever,
                                                                                  EntryBound::kNever};
      return;
    }
    if (size > 1) {
      for (int k = 0; k < 4; ++k) self(self, corner + ivec2(k & 1, k >> 1) * (size / 2), size / 2, entry);
      return;
    }
    bounds[static_cast<size_t>(corner.y - window.y0) * width + (corner.x - window.x0)] = {
        rounded_down(entry.medium), rounded_down(entry.surface), static_cast<int16_t>(entry.axis),
        static_cast<int16_t>(entry.layer)};
  };
  const int first_row = window.y0 / kBlock, rows = (window.y1 - 1) / kBlock - first_row + 1;
  parallel_for(rows, task, [&](int row) {
    for (int x = window.x0 / kBlock * kBlock; x < window.x1; x += kBlock)
      visit(visit, {x, (first_row + row) * kBlock}, kBlock, {0, 0});
  });
  return bounds;
}

RenderResult PreparedScene::render(const RenderJob& job, const Task& task) const {
  return RenderSession(*this, job, task).run();
}

RenderResult PreparedScene::render(int spp, int64_t seed, const Task& task) const {
  RenderJob job;
  job.spp = spp;
  job.seed = seed;
  return render(job, task);
}

PathSample PreparedScene::replay(int64_t seed, int x, int y, uint32_t sample) const {
  const Camera own_camera = camera();
  PathCounters counters;
  const PathRequest r = request(own_camera, seed, x, y, sample, entry_bounds(own_camera, {x, y, x + 1, y + 1}).front());
  PathSample result;
  trace_paths(
      context_, {&r, 1}, [&](size_t, const PathSample& traced) { result = traced, result.groups = nullptr; }, counters);
  return result;
}

}  // namespace brume
